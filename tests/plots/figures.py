"""Results made by hand for figures, and the elements that a figure holds."""

from itertools import pairwise

import numpy as np
import pandas as pd
import xarray as xr
from tube_posteriors import exact_points, result

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.natural_scale import NaturalScale
from pymc_hyperelastic.models.settings import ModelSettings

SEED = 20261122  # any seed will do: the draws below stand for a sampled posterior
TUBE = {"inner_radius": 7.0, "outer_radius": 9.0}
STRETCHES = (1.0, 1.2, 1.4)
DATA = ph.load_dataset("simulated_sheep_aorta")
# Inflation and extension tests of a neo-Hookean tube.
SMALL_TUBE = {"inner_radius": 1.0, "outer_radius": 1.5}
HELD, HELD_STRETCHES = (0.8, 2.0), (1.15, 1.3)
MU = 20.0
VARIED = [f"varied at {p:g} kPa" for p in HELD]
LABELS = [f"axial stretch {s}" for s in (*HELD_STRETCHES, *VARIED)]


def fitted(data, energy="NeoHookean", **draws):
    """Return a fitted class with these draws, by chain and draw."""
    draws = draws or {"mu": 30 + np.random.default_rng(SEED).normal(size=(1, 100))}
    posterior = xr.Dataset({name: (("chain", "draw"), values) for name, values in draws.items()})
    groups = {"posterior": posterior, "observed_data": data[["pressure"]].reset_coords(drop=True)}
    tree = xr.DataTree.from_dict(groups | {"constant_data": data.drop_vars("pressure")})
    tree.attrs = {"strain_energy": energy}
    return tree


def straight_lines(specimens=16, stretches=(1.0,), of_diameter=False):
    """Return data of specimens at these axial stretches; each curve is a straight line."""
    rng = np.random.default_rng(SEED)
    tables = []
    for i in range(specimens):
        for experiment, stretch in enumerate(stretches, start=1):
            radius = np.linspace(7.1, 9.3, 8) / np.sqrt(stretch)
            pressure = 6 * (radius - radius[0] + 0.1) * stretch**3 + 0.1 * rng.random(8)
            labels = {"specimen": f"S{i + 1}", "group": "C1", "experiment": experiment}
            labels |= {"stretch": stretch, "pressure": pressure}
            outer = np.sqrt(radius**2 + (9.0**2 - 7.0**2) / stretch)
            read = {"outer_diameter": 2 * outer} if of_diameter else {"radius": radius}
            tables.append(pd.DataFrame(labels | read))
    measured = {"measured": "outer_diameter"} if of_diameter else {}
    frame = pd.concat(tables, ignore_index=True)
    return ph.inflation_data(frame, ph.Tube(**TUBE, axial_stretch="stretch"), **measured)


def curve_at(pressure, stretch, *mu) -> xr.Dataset:
    """Predict the tube at these pressures and axial stretches, for each modulus."""
    tree = result(mu=list(mu or (MU,)))
    at = ph.Conditions(pressure, tube=ph.Tube(axial_stretch=stretch, **SMALL_TUBE))
    return ph.tube_properties(tree, at, energy=ph.NeoHookean())


def drifting(held, stretch):
    """Return a pressure that drifts about the held one."""
    return held * (1 + 0.2 * (stretch - 1.25))


def both_kinds(*, force=True, kinds=("inflation", "extension")) -> xr.Dataset:
    """Return inflation tests and extension tests of one specimen."""
    tests = {}
    for stretch in HELD_STRETCHES if "inflation" in kinds else ():
        tests[f"at {stretch:g}"] = np.linspace(0.3, 2.5, 6), stretch
    for held in HELD if "extension" in kinds else ():
        stretch = np.linspace(1.4, 1.1, 7)
        tests[f"held {held:g}"] = drifting(held, stretch), stretch
    frame = exact_points(ph.NeoHookean(), {"mu": MU}, tests, SMALL_TUBE)
    frame = frame if force else frame.drop(columns="axial_force")
    return ph.inflation_data(frame, ph.Tube(**SMALL_TUBE, axial_stretch="stretch"), check="ignore")


def hierarchical_class(spread):
    """Return a class whose specimens differ, and their coordinates (coordinate, draw)."""
    rng = np.random.default_rng(SEED)
    names = NaturalScale(ph.Ogden()).names
    location = np.array([-2.7, 1.9]) + 0.05 * rng.standard_normal((1, 1000, 2))
    dims, noise = ("chain", "draw", "coordinate"), np.full((1, 1000), 0.1)
    posterior = xr.Dataset(
        {
            "location": (dims, location),
            "spread": (dims, np.full_like(location, spread)),
            "correlation": ((*dims, "coordinate_2"), np.tile(np.eye(2), (1, 1000, 1, 1))),
            "pressure_sd": (dims[:2], noise),
            "noise_spread": (dims[:2], 3 * noise),
        },
        {"coordinate": names, "coordinate_2": names},
    )
    tree = xr.DataTree.from_dict({"posterior": posterior})
    tree.attrs = ModelSettings.of(ph.Ogden(), {}, reference_stress=20.0).attrs()
    return tree, (location[0] + spread * rng.standard_normal((1000, 2))).T


def elements(figure, function, variable=None):
    """Return the elements of one kind that the backend "none" collected."""
    panels = figure.viz["plot"]
    panels = panels.dataset if isinstance(panels, xr.DataTree) else panels
    if variable is not None:
        panels = panels[variable]
    elif isinstance(panels, xr.Dataset):
        panels = panels.to_array()
    # A grid may have places without a panel.
    return [e for panel in panels.values.ravel() for e in panel or () if e["function"] == function]


def points_of(figure, variable=None):
    """Return the points that are drawn, sorted."""
    dots = elements(figure, "scatter", variable)
    points = np.concatenate([np.stack([e["x"], e["y"]]) for e in dots], axis=1)
    points = points[:, ~np.isnan(points[0])]
    return points[:, np.lexsort(points)]


def measured(data, x, y, experiment):
    """Return the points of tests whose names begin like this, sorted."""
    of_kind = np.isin(data["test"], np.flatnonzero(data["experiment"].str.startswith(experiment)))
    points = np.stack([data[x].values, data[y].values])[:, of_kind]
    return points[:, np.lexsort(points)]


def assert_band(figure, variable, draws, prob, **where):
    """Check the median and the band of draws to rounding; they are the same numbers."""
    band, median = (figure.get_viz(n, variable, **where) for n in ("band", "median"))
    levels = [(1 - prob) / 2, 0.5, (1 + prob) / 2]
    low, middle, high = draws.quantile(levels, ["chain", "draw"]).values
    drawn = [band["y_bottom"], median["y"], band["y_top"], band["x"]]
    np.testing.assert_allclose(drawn, [low, middle, high, median["x"]], rtol=1e-10)


def texts(figure, function):
    return [element["string"] for element in elements(figure, function)]


def legend_texts(figure):
    return [t.get_text() for n in figure.get_viz("figure").legends for t in n.get_texts()]


def numbers_touch(axes):
    """Return True if two numbers of a horizontal axis touch."""
    axes.figure.canvas.draw()
    low, high = axes.get_xlim()
    shown = [n for n in axes.get_xticklabels() if low <= n.get_position()[0] <= high]
    boxes = [label.get_window_extent() for label in shown]
    return any(left.x1 >= right.x0 for left, right in pairwise(boxes))
