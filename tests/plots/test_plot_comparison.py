"""plot_comparison: effect sizes and curves of groups."""

import fits
import numpy as np
import pytest

import pymc_hyperelastic as ph


def compare(quantity, **settings):
    classes = fits.fit("neo_hookean_classes")
    few = {"draws": 100, "specimens": 8, "random_seed": 1, "effect_prior": None}
    return ph.compare_classes(classes, quantity, **few, **settings)


@pytest.fixture(scope="module")
def result():
    return compare(["mu", "log_reference_strain"])


def test_points_and_intervals_of_effects_equal_the_result(result):
    figure = ph.plot_comparison(result, backend="none")
    intervals = {
        "effect_size": result["effect_size_interval"],
        # A larger overlap means a smaller accuracy.
        "best_accuracy": 1 - result["overlap_interval"].isel(bound=[1, 0]) / 2,
    }
    assert list(figure.viz["plot"]["panel"].values) == list(intervals)
    for name, interval in intervals.items():
        for row, quantity in enumerate(["mu", "log_reference_strain"]):
            where = {"panel": name, "quantity": quantity, "comparison": "stiff − soft"}
            point, line = (figure.get_viz(visual, **where) for visual in ("points", "interval"))
            assert point["x"] == pytest.approx(result[name].sel(quantity=quantity).item())
            np.testing.assert_allclose(line["x"], interval.sel(quantity=quantity).values.ravel())
            assert line["x"][0] < point["x"] < line["x"][1]
            np.testing.assert_array_equal(line["y"], -row)
    assert [figure.get_viz("nothing", panel=name)["x"] for name in intervals] == [0, 0.5]


def test_curves_and_bands_equal_the_values_of_the_groups():
    pressure = [1.0, 2.0, 3.0]
    with pytest.warns(UserWarning, match="have no compliance there"):
        result = compare("compliance", at=pressure)
    figure = ph.plot_comparison(result, backend="none", statistic="mean")
    line, band = (
        figure.get_viz(visual, "compliance", class_label="stiff") for visual in ("median", "band")
    )
    found = result.sel(statistic="mean", group="stiff", quantity="compliance")
    np.testing.assert_allclose(line["x"], pressure)
    np.testing.assert_allclose(line["y"], found["value"])
    for end, bound in (("y_bottom", "low"), ("y_top", "high")):
        np.testing.assert_allclose(band[end], found["value_interval"].sel(bound=bound))
