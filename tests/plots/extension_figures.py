"""Inflation and extension tests of a neo-Hookean tube without errors."""

import numpy as np
import pandas as pd
import xarray as xr
from figures import elements, fitted
from tube_posteriors import result

import pymc_hyperelastic as ph

SMALL_TUBE = {"inner_radius": 1.0, "outer_radius": 1.5}
HELD, HELD_STRETCHES = (0.8, 2.0), (1.15, 1.3)
MU = 20.0
VARIED = [f"varied at {p / ph.mmHg:.0f} mmHg" for p in HELD]
LABELS = [f"axial stretch {s}" for s in (*HELD_STRETCHES, *VARIED)]


def curve_at(pressure, stretch, *mu) -> xr.Dataset:
    """Predict the tube at these pressures and axial stretches, for each modulus."""
    tree = result(mu=list(mu or (MU,)))
    at = {"pressure": pressure, "axial_stretch": stretch}
    return ph.predict_axial_force(tree, energy=ph.NeoHookean(), **SMALL_TUBE, **at)


def drifting(held, stretch):
    """Return a pressure that drifts about the held one."""
    return held * (1 + 0.2 * (stretch - 1.25))


def both_kinds(*, force=True, kinds=("inflation", "extension")) -> xr.Dataset:
    """Return inflation tests and extension tests of one specimen."""
    tests = {}
    for stretch in HELD_STRETCHES if "inflation" in kinds else ():
        tests[f"at {stretch:g}"] = np.linspace(0.3, 2.5, 6), np.full(6, stretch)
    for held in HELD if "extension" in kinds else ():
        stretch = np.linspace(1.4, 1.1, 7)
        tests[f"held {held:g}"] = drifting(held, stretch), stretch
    tables = []
    for experiment, (pressure, stretch) in tests.items():
        curve = curve_at(pressure, stretch)
        numbers = {n: curve[n].values[0, 0] for n in ("radius", "axial_force")[: 1 + force]}
        numbers |= {"pressure": pressure, "stretch": stretch}
        tables.append(pd.DataFrame({"specimen": "S1", "experiment": experiment} | numbers))
    frame = pd.concat(tables, ignore_index=True)
    return ph.inflation_data(frame, **SMALL_TUBE, axial_stretch="stretch", check="ignore")


def fitted_to(data, *mu) -> xr.DataTree:
    return fitted(data, mu=[mu])


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
