"""plot_calibration_ranks and plot_reliability."""

import numpy as np
import pytest
import xarray as xr
from figures import texts

import pymc_hyperelastic as ph
from pymc_hyperelastic.plots.calibration import _simultaneous_band

SEED = 20260  # any would do
# Sums and logarithms of a few numbers of order one.
ROUNDING = 1e-12


@pytest.fixture(scope="module")
def ranks():
    """Five parameters, of which one is ranked at 0 and 99 only."""
    rng = np.random.default_rng(SEED)
    rank = rng.integers(0, 100, (200, 5))
    rank[:, 2] = 99 * (rank[:, 2] > 49)
    p_value = ("parameter", [0.5, 1e-9, np.nan, 0.25, 0.001])
    tables = {"rank": (("simulation", "parameter"), rank), "p_value": p_value}
    return xr.Dataset(tables, {"parameter": [f"k[{i}]" for i in range(5)]}, {"ranked_draws": 99})


@pytest.fixture(scope="module")
def scores():
    dims, first = ("test", "class_label"), np.array([0.95, 0.15, 0.9, 0.35])
    table = {"class_probability": (dims, np.stack([first, 1 - first], axis=1))}
    result = xr.Dataset(table, {"class_label": ["C1", "C2"]}, {"simulated": 1})
    return ph.score_probabilities(result, ["C1", "C2", "C2", "C2"])


def test_line_is_the_difference_between_ecdf_and_uniform_distribution(ranks):
    figure = ph.plot_calibration_ranks(ranks, backend="none")
    for i, name in enumerate(ranks["parameter"].values):
        line = figure.get_viz("line", parameter=name)
        np.testing.assert_allclose(line["x"], np.arange(101) / 100, rtol=ROUNDING)
        below = [np.mean(ranks["rank"].values[:, i] < k) - k / 100 for k in range(101)]
        np.testing.assert_allclose(line["y"], below, atol=ROUNDING)
    p_values = ["p = 0.500", "p < 0.001", "not tested", "p = 0.250", "p = 0.001"]
    assert texts(figure, "title") == [f"k[{i}]\n({p})" for i, p in enumerate(p_values)]
    assert texts(figure, "xlabel") == ["rank / $(L+1)$"] * 3
    assert texts(figure, "ylabel") == ["ECDF − uniform"] * 2
    assert "200 simulations, 95 % simultaneous" in figure.get_viz("figure_title")["string"]
    one = ph.plot_calibration_ranks(ranks.sel(parameter="k[1]"), backend="none")
    assert dict(one.viz["plot"].sizes) == {"parameter": 1}


def test_simultaneous_band_contains_its_share_of_uniform_ranks():
    x, low, high = _simultaneous_band(200, 100, 0.9)
    assert x[0] == low[0] == high[0] == low[-1] == high[-1] == 0 and x[-1] == 1
    rank = np.random.default_rng(SEED).integers(0, 100, (1000, 200))
    below = np.stack([np.bincount(r, minlength=100).cumsum() for r in rank])[:, :-1] / 200
    line = below - x[1:-1]
    inside = ((line >= low[1:-1] - ROUNDING) & (line <= high[1:-1] + ROUNDING)).all(axis=1)
    # A thousand lines and a thousand for the band have standard errors of 1 % each.
    assert abs(inside.mean() - 0.9) < 0.04


def test_reliability_points_intervals_and_bars_equal_the_scores(scores):
    figure = ph.plot_reliability(scores, backend="none")
    assert dict(figure.viz["plot"].sizes) == {"part": 2, "forecast": 3}
    for name in ("most probable class", "C1", "C2"):
        table = scores.sel(forecast=name)
        points, bars = (figure.get_viz(v, forecast=name) for v in ("points", "bar"))
        np.testing.assert_array_equal(points["x"], table["predicted_probability"])
        np.testing.assert_array_equal(points["y"], table["observed_frequency"])
        np.testing.assert_array_equal(bars["y"], table["count"])
        interval = figure.get_viz("interval", forecast=name)
        np.testing.assert_array_equal(interval["y_bottom"], table["frequency_lower"])
        np.testing.assert_array_equal(interval["y_top"], table["frequency_upper"])
    error = scores["expected_calibration_error"].values[0]
    assert texts(figure, "title")[0] == f"most probable class\n(ECE = {error:.3f})"
    assert texts(figure, "ylabel") == ["observed frequency", "count"]
    title = figure.get_viz("figure_title")["string"]
    assert title == "reliability of class probabilities, 95 % intervals, SIMULATED data"
    one = ph.plot_reliability(scores.sel(forecast="C1"), backend="none")
    assert one.viz["plot"].sizes["forecast"] == 1
