"""Results made by hand for figures, and the elements that a figure holds."""

import numpy as np
import pandas as pd
import xarray as xr

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.natural_scale import NaturalScale

SEED = 20261122  # any seed will do: the draws below stand for a sampled posterior
TUBE = {"inner_radius": 7.0, "outer_radius": 9.0}
STRETCHES = (1.0, 1.2, 1.4)
DATA = ph.load_dataset("simulated_sheep_aorta")


def fitted(data, energy="NeoHookean", **draws):
    """Return a fitted class with these draws, by chain and draw."""
    draws = draws or {"mu": 30 + np.random.default_rng(SEED).normal(size=(1, 100))}
    posterior = xr.Dataset({name: (("chain", "draw"), values) for name, values in draws.items()})
    groups = {"posterior": posterior, "observed_data": data[["pressure"]].reset_coords(drop=True)}
    tree = xr.DataTree.from_dict(groups | {"constant_data": data.drop_vars("pressure")})
    tree.attrs = {"strain_energy": energy}
    return tree


def bimodal_class(mu, alpha, data):
    """Return a fitted class of Ogden materials whose posterior has the modes ``(mu, ±alpha)``."""
    rng = np.random.default_rng(SEED)
    sign = np.where(np.arange(500) % 2, -1, 1)
    shift = rng.normal(size=(2, 500))
    alpha = sign * (alpha - 0.05 * shift + 0.03 * rng.normal(size=shift.shape))
    tree = fitted(data, "Ogden", mu=mu + 0.5 * shift, alpha=alpha)
    tree.attrs["units"] = '{"mu": "kPa", "alpha": ""}'
    tree.attrs["priors"] = '{"mu": ["Uniform", [0.0, 100.0]], "alpha": ["Uniform", [-40.0, 40.0]]}'
    return tree


def straight_lines(specimens=16, stretches=(1.0,), groups=("C1",), of_diameter=False):
    """Return data of specimens at these axial stretches; each curve is a straight line."""
    rng = np.random.default_rng(SEED)
    tables = []
    for i in range(specimens):
        for experiment, stretch in enumerate(stretches, start=1):
            radius = np.linspace(7.1, 9.3, 8) / np.sqrt(stretch)
            pressure = 6 * (radius - radius[0] + 0.1) * stretch**3 + 0.1 * rng.random(8)
            labels = {"specimen": f"S{i + 1}", "group": groups[i % len(groups)]}
            labels |= {"experiment": experiment, "stretch": stretch, "pressure": pressure}
            outer = np.sqrt(radius**2 + (9.0**2 - 7.0**2) / stretch)
            read = {"outer_diameter": 2 * outer} if of_diameter else {"radius": radius}
            tables.append(pd.DataFrame(labels | read))
    measured = {"measured": "outer_diameter"} if of_diameter else {}
    frame = pd.concat(tables, ignore_index=True)
    return ph.inflation_data(frame, **TUBE, axial_stretch="stretch", **measured)


def answers(specimens=16, **variables):
    """Return a result of classify; every specimen is probably of the first class."""
    probability = np.tile([0.9, 0.1], (specimens, 1))
    dims = ("specimen", "class_label")
    tables = {"class_probability": probability, "class_probability_se": 0.2 + 0 * probability}
    tables |= variables
    return xr.Dataset(
        {k: (dims[: np.ndim(v)], v) for k, v in tables.items()},
        {"specimen": [f"S{i + 1}" for i in range(specimens)], "class_label": ["C1", "C2"]},
    )


def hierarchical_class(energy, spread):
    """Return a class whose specimens differ, and their coordinates (coordinate, draw)."""
    rng = np.random.default_rng(SEED)
    names = NaturalScale(energy).names
    count = len(names)
    location = np.array([-2.7, 1.9])[:count] + 0.05 * rng.standard_normal((1, 1000, count))
    dims, noise = ("chain", "draw", "coordinate"), np.full((1, 1000), 0.1)
    posterior = xr.Dataset(
        {
            "location": (dims, location),
            "spread": (dims, np.full_like(location, spread)),
            "correlation": ((*dims, "coordinate_2"), np.tile(np.eye(count), (1, 1000, 1, 1))),
            "noise_sd": (dims[:2], noise),
            "noise_spread": (dims[:2], 3 * noise),
        },
        {"coordinate": names, "coordinate_2": names},
    )
    tree = xr.DataTree.from_dict({"posterior": posterior})
    tree.attrs = {"strain_energy": energy.name, "reference_stress": "20.0"}
    return tree, (location[0] + spread * rng.standard_normal((1000, count))).T


def elements(figure, function, variable=None):
    """Return the elements of one kind that the backend "none" collected."""
    panels = figure.viz["plot"]
    panels = panels.dataset if isinstance(panels, xr.DataTree) else panels
    if variable is not None:
        panels = panels[variable]
    elif isinstance(panels, xr.Dataset):
        panels = panels.to_array()
    return [e for panel in panels.values.ravel() for e in panel if e["function"] == function]


def assert_band(figure, variable, draws, prob, **where):
    """Check the median and the band of draws to rounding; they are the same numbers."""
    band, median = (figure.get_viz(n, variable, **where) for n in ("band", "median"))
    levels = [(1 - prob) / 2, 0.5, (1 + prob) / 2]
    low, middle, high = draws.quantile(levels, ["chain", "draw"]).values
    for drawn, expected in (
        (band["y_bottom"], low),
        (median["y"], middle),
        (band["y_top"], high),
        (band["x"], median["x"]),
    ):
        np.testing.assert_allclose(drawn, expected, rtol=1e-10)


def texts(figure, function):
    return [element["string"] for element in elements(figure, function)]


def legend_texts(figure):
    return [t.get_text() for n in figure.get_viz("figure").legends for t in n.get_texts()]
