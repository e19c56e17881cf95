"""plot_information: expected information of planned tests."""

import fits
import numpy as np
import pytest
from figures import numbers_touch

import pymc_hyperelastic as ph

DESIGNS = {"one": {"radius": 8.0, "points": 1}, "many": {"radius": (7.3, 9.0)}}


@pytest.fixture(scope="module")
def result():
    settings = {"specimens": 10, "draws": 64, "random_seed": 1, "stop_below": 0.1}
    return ph.expected_information(fits.fit("neo_hookean_classes"), DESIGNS, **settings)


def test_points_and_errors_of_designs_equal_the_result(result):
    figure = ph.plot_information(result, backend="none")
    for name in ("information", "difference"):
        for row, design in enumerate(result["design"].values):
            where = {"panel": name, "design": design}
            expected, error = (result[n].sel(design=design).item() for n in (name, f"{name}_se"))
            point = figure.get_viz("points", **where)
            assert point["x"] == pytest.approx(expected)
            assert point["y"] == -row  # the best one is on top
            ends = figure.get_viz("error", **where)["x"]
            np.testing.assert_allclose(ends, [expected - 2 * error, expected + 2 * error])
    assert figure.get_viz("all", panel="information")["x"] == pytest.approx(np.log(2))
    assert figure.get_viz("all", panel="difference")["x"] == 0
    ticks = ph.plot_information(result).get_viz("plot", panel="information").get_yticklabels()
    assert [tick.get_text() for tick in ticks] == result["design"].values.tolist()


def test_information_about_a_quantity_has_no_upper_limit(result):
    figure = ph.plot_information(result.assign_attrs(about="mu"), backend="none")
    assert figure.get_viz("all", panel="information") is None
    assert "information about its mu" in figure.get_viz("figure_title")["string"]


def test_numbers_of_small_differences_do_not_touch(result):
    small = result.assign(difference=0.0 * result["difference"] - [0.0, 0.04])
    small["difference_se"] = 0.0 * small["difference_se"] + [0.0, 0.035]
    axes = ph.plot_information(small).get_viz("plot", panel="difference")
    assert len(axes.get_xticks()) > 1
    assert not numbers_touch(axes)
