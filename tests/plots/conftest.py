"""Fitted classes and a classification that several figures show."""

import fits
import matplotlib as mpl
import pytest
import xarray as xr
from matplotlib import pyplot as plt

mpl.use("Agg")


@pytest.fixture(autouse=True)
def _figures_are_closed():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def classes():
    """Return two classes whose posteriors have the modes ``(mu, ±alpha)``."""
    return fits.fit("pooled")


@pytest.fixture(scope="module")
def few_draws(classes):
    """Return the classes with draws enough for curves, not for densities."""
    return classes.isel(draw=slice(20))


@pytest.fixture
def result():
    tables = {
        "class_probability": [[1.0, 0.0], [0.9, 0.1], [0.25, 0.75]],
        "class_probability_se": [[1e-9] * 2, [0.01] * 2, [0.05] * 2],
    }
    labels = {"specimen": ["S1", "S2", "S4"], "experiment": [3] * 3, "group": ["C1", "C1", "C2"]}
    return xr.Dataset(
        {name: (("test", "class_label"), table) for name, table in tables.items()},
        {"class_label": ["C1", "C2"]} | {name: ("test", label) for name, label in labels.items()},
        {"strain_energy": "Ogden", "simulated": 1},
    )
