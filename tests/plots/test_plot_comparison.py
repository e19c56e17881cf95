"""Figures of differences between groups."""

import numpy as np
import pytest
from variable_classes import fit

import pymc_hyperelastic as ph

X = "log_reference_strain"


@pytest.fixture(scope="module")
def classes():
    return fit()


def compare(classes, quantity, **settings):
    settings = {"random_seed": 1, "bayes_factor": False, "draws": 200} | settings
    return ph.compare_classes(classes, quantity, **settings)


def test_rows_are_medians_and_intervals(classes):
    result = compare(classes, ["mu", X])
    figure = ph.plot_comparison(result, backend="none")
    assert list(figure.viz["plot"]["panel"].values) == ["effect_size", "best_accuracy"]
    for name in ("effect_size", "best_accuracy"):
        where = {"panel": name, "quantity": "mu", "comparison": "stiff − soft"}
        point = figure.get_viz("points", **where)
        assert point["x"] == pytest.approx(result[name].sel(quantity="mu").item())
        ends = figure.get_viz("interval", **where)["x"]
        assert ends[0] < point["x"] < ends[1]


def test_curves_are_those_of_the_groups(classes):
    pressure = [0.1, 0.3, 0.5]
    result = compare(classes, "compliance", pressure=pressure)
    figure = ph.plot_comparison(result, backend="none", statistic="mean")
    line = figure.get_viz("median", "compliance", class_label="stiff")
    found = result["value"].sel(statistic="mean", group="stiff", quantity="compliance")
    np.testing.assert_allclose(line["x"], pressure)
    np.testing.assert_allclose(line["y"], found)


def test_what_cannot_be_drawn(classes):
    result = compare(classes, "mu")
    with pytest.raises(TypeError, match=r"expected the result of ph.compare_classes"):
        ph.plot_comparison(classes)
    with pytest.raises(ValueError, match="the result lacks 'draws'"):
        ph.plot_comparison(result.drop_vars("draws"))
    with pytest.raises(ValueError, match="statistic must be one of"):
        ph.plot_comparison(result, statistic="median")
    with pytest.raises(ValueError, match="no visual is called 'bands'"):
        ph.plot_comparison(result, backend="none", visuals={"bands": False})
