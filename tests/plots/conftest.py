"""Fitted classes and a classification that several figures show."""

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr
from figures import DATA, bimodal_class

import pymc_hyperelastic as ph

mpl.use("Agg")


@pytest.fixture(autouse=True)
def _figures_are_closed():
    yield
    mpl.pyplot.close("all")


@pytest.fixture(scope="module")
def classes():
    return xr.DataTree.from_dict(
        {
            name: bimodal_class(mu, alpha, ph.select(DATA, group=name, experiment=[1, 2]))
            for name, mu, alpha in (("C1", 34.0, 6.7), ("C2", 44.0, 7.1))
        }
    )


@pytest.fixture
def result():
    probability = np.array([[1.0, 0.0], [0.9, 0.1], [0.25, 0.75]])
    errors = [[1e-9] * 2, [0.01] * 2, [0.05] * 2]
    tables = {"class_probability": probability, "class_probability_se": errors}
    return xr.Dataset(
        {name: (("test", "class_label"), table) for name, table in tables.items()},
        {"class_label": ["C1", "C2"], "specimen": ("test", ["S1", "S2", "S4"])}
        | {"experiment": ("test", [3, 3, 3]), "group": ("test", ["C1", "C1", "C2"])},
        {"strain_energy": "Ogden", "simulated": 1},
    )
