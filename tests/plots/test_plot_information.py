"""Figures of what planned tests are expected to tell."""

import numpy as np
import pytest
from variable_classes import fit

import pymc_hyperelastic as ph

DESIGNS = {"one": {"radius": 8.0, "points": 1}, "many": {"radius": (7.3, 9.0)}}


@pytest.fixture(scope="module")
def classes():
    return fit(draws=200, chains=1)


def told(classes, **settings):
    return ph.expected_information(
        classes, DESIGNS, specimens=20, draws=64, random_seed=1, **settings
    )


def test_points_and_their_errors(classes):
    result = told(classes)
    figure = ph.plot_information(result, backend="none")
    for name in ("information", "difference"):
        for design in DESIGNS:
            where = {"panel": name, "design": design}
            expected, error = (result[n].sel(design=design).item() for n in (name, f"{name}_se"))
            assert figure.get_viz("points", **where)["x"] == pytest.approx(expected)
            ends = figure.get_viz("error", **where)["x"]
            np.testing.assert_allclose(ends, [expected - 2 * error, expected + 2 * error])
    # The best one is on top.
    heights = [
        figure.get_viz("points", panel="information", design=d)["y"]
        for d in result["design"].values
    ]
    assert heights[0] > heights[1]
    assert figure.get_viz("all", panel="information")["x"] == pytest.approx(np.log(2))


def test_of_a_quantity_there_is_no_end(classes):
    figure = ph.plot_information(told(classes, about="mu"), backend="none")
    assert figure.get_viz("all", panel="information") is None
    assert figure.get_viz("all", panel="difference")["x"] == 0


def test_it_is_drawn(classes, tmp_path):
    ph.plot_information(told(classes)).savefig(tmp_path / "told.png")
    assert (tmp_path / "told.png").stat().st_size > 10_000


def test_what_cannot_be_drawn(classes):
    with pytest.raises(TypeError, match=r"expected the result of ph.expected_information"):
        ph.plot_information(classes)
    with pytest.raises(ValueError, match="the result lacks 'difference'"):
        ph.plot_information(told(classes).drop_vars("difference"))
