"""Figures of calibration: ranks of true parameters, and reliability of class probabilities."""

import matplotlib as mpl
import numpy as np
import pymc as pm
import pytest
import xarray as xr

import pymc_hyperelastic as ph
from pymc_hyperelastic.plots.calibration import _p_value, _simultaneous_band

mpl.use("Agg")

SEED = 20260  # any would do
# Sums and logarithms of a few numbers of order one.
ROUNDING = 1e-12


@pytest.fixture(scope="module")
def ranks():
    """Five parameters, of which one is ranked at 0 and 99 only."""
    rng = np.random.default_rng(SEED)
    rank = rng.integers(0, 100, (200, 5))
    rank[:, 2] = 99 * (rank[:, 2] > 49)
    return xr.Dataset(
        {"rank": (("simulation", "parameter"), rank), "p_value": ("parameter", [0.5] * 5)},
        {"parameter": [f"k[{i}]" for i in range(5)]},
        {"ranked_draws": 99, "bins": 20},
    )


@pytest.fixture(scope="module")
def scores():
    probability = [[0.95, 0.05], [0.15, 0.85], [0.9, 0.1], [0.35, 0.65]]
    result = xr.Dataset(
        {"class_probability": (("test", "class_label"), probability)},
        {"class_label": ["C1", "C2"]},
        {"simulated": 1},
    )
    return ph.score_probabilities(result, ["C1", "C2", "C2", "C2"])


def panels_of(figure):
    """Panels of the backend "none", as lists of what was drawn in each."""
    return list(figure.viz["plot"].values.ravel())


def texts(figure, function):
    return [e["string"] for panel in panels_of(figure) for e in panel if e["function"] == function]


def test_line_is_the_ecdf(ranks):
    """The line is the share of ranks below each value, less the share that is due."""
    figure = ph.plot_calibration_ranks(ranks, backend="none")
    for i, name in enumerate(ranks["parameter"].values):
        line = figure.get_viz("line", parameter=name)
        np.testing.assert_allclose(line["x"], np.arange(101) / 100, rtol=ROUNDING)
        below = [np.mean(ranks["rank"].values[:, i] < k) - k / 100 for k in range(101)]
        np.testing.assert_allclose(line["y"], below, atol=ROUNDING)
    assert texts(figure, "title") == [f"k[{i}]\n($p$ = 0.500)" for i in range(5)]
    assert texts(figure, "xlabel") == ["rank / $(L+1)$"] * 4
    assert "200 simulations, 95 % simultaneous" in figure.get_viz("figure_title")["string"]


def test_band_holds_whole_lines():
    """Of uniform ranks, a share of `prob` is inside the band throughout."""
    x, low, high = _simultaneous_band(200, 100, 0.9)
    assert x[0] == low[0] == high[0] == low[-1] == high[-1] == 0 and x[-1] == 1
    rank = np.random.default_rng(SEED).integers(0, 100, (1000, 200))
    below = np.stack([np.bincount(r, minlength=100).cumsum() for r in rank])[:, :-1] / 200
    line = below - x[1:-1]
    inside = ((line >= low[1:-1] - ROUNDING) & (line <= high[1:-1] + ROUNDING)).all(axis=1)
    # A thousand lines and a thousand for the band have standard errors of 1 % each.
    assert abs(inside.mean() - 0.9) < 0.04


def test_histogram_counts_simulations(ranks):
    """Bars are the counts that were tested; a band says how many are due."""
    figure = ph.plot_calibration_ranks(ranks, kind="histogram", prob=0.5, backend="none")
    bar = figure.get_viz("bar", parameter="k[2]")
    high = int((ranks["rank"].values[:, 2] == 99).sum())
    assert np.asarray(bar["y"]).tolist() == [200 - high] + [0] * 18 + [high]
    assert texts(figure, "ylabel") == ["simulations"] * 2
    band = figure.get_viz("band", parameter="k[0]")
    assert band["y_bottom"][0] < 200 / 20 < band["y_top"][0]


def test_one_parameter_of_several(ranks):
    """One panel may be chosen, whether its dimension is kept or not, or there is but one."""
    with pm.Model() as model:
        pm.Normal("y", pm.Normal("mean", 0, 1), 1, observed=np.zeros(20))
    settings = {"draws": 200, "random_seed": SEED, "progressbar": False}
    right = ph.simulation_based_calibration(model, simulations=20, **settings)
    for chosen in (ranks.sel(parameter=["k[1]"]), ranks.sel(parameter="k[1]"), right):
        figure = ph.plot_calibration_ranks(chosen, backend="none")
        assert dict(figure.viz["plot"].sizes) == {"parameter": 1}


@pytest.mark.parametrize(
    ("p_value", "text"),
    [(np.nan, "not tested"), (1e-9, "$p$ < 0.001"), (0.25, "$p$ = 0.250")],
)
def test_printed_p_values(p_value, text):
    """No p-value is printed as zero."""
    assert _p_value(p_value) == text


def test_reliability_shows_the_table(scores):
    """Points, intervals and bars are those of the table; columns name the forecasts."""
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


def test_every_interval_is_drawn(scores):
    """Matplotlib draws one line for each bin that is not empty."""
    figure = ph.plot_reliability(scores)
    axes = figure.get_viz("plot", part="diagram", forecast="C1")
    drawn = [line.get_xydata() for line in axes.lines if len(line.get_xydata()) == 2]
    upright = [line for line in drawn if line[0, 0] == line[1, 0]]
    known = (scores["count"].sel(forecast="C1") > 0).sum().item()
    assert len(upright) == known


def test_figures_can_be_saved_and_edited(ranks, scores, tmp_path):
    """Each figure is a PlotCollection that saves itself, takes settings and leaves visuals out."""
    figures = [
        ph.plot_calibration_ranks(ranks),
        ph.plot_calibration_ranks(ranks, kind="histogram"),
        ph.plot_reliability(scores),
    ]
    for i, figure in enumerate(figures):
        figure.savefig(tmp_path / f"{i}.png")
        assert (tmp_path / f"{i}.png").stat().st_size > 5000
        mpl.pyplot.close(figure.get_viz("figure"))
    figure = ph.plot_calibration_ranks(
        ranks, backend="none", visuals={"band": False, "line": {"width": 3}}, color=["k"]
    )
    assert "band" not in figure.viz.children
    line = figure.get_viz("line", parameter="k[0]")
    assert (line["width"], line["color"]) == (3, "k")


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda r, s: ph.plot_calibration_ranks(3), TypeError, "an xarray.Dataset, not int"),
        (lambda r, s: ph.plot_calibration_ranks(s), ValueError, "lacks 'rank'"),
        (lambda r, s: ph.plot_calibration_ranks(r, kind="bar"), ValueError, "kind must be"),
        (lambda r, s: ph.plot_calibration_ranks(r, prob=94), ValueError, "prob must be"),
        (lambda r, s: ph.plot_calibration_ranks(r, backend="tv"), ValueError, "backend must be"),
        (
            lambda r, s: ph.plot_calibration_ranks(r.assign_attrs(bins=1), kind="histogram"),
            ValueError,
            "too few for a histogram",
        ),
        (lambda r, s: ph.plot_reliability(3), TypeError, "an xarray.Dataset, not int"),
        (lambda r, s: ph.plot_reliability(r), ValueError, "lacks 'observed_frequency'"),
        (
            lambda r, s: ph.plot_reliability(s.assign_coords(forecast=[None, None, None])),
            ValueError,
            "forecasts are .* names must differ",
        ),
        (
            lambda r, s: ph.plot_reliability(s.assign(expected_calibration_error=0.1)),
            ValueError,
            "'expected_calibration_error' has the dimensions .* expected .'forecast'",
        ),
        (lambda r, s: ph.plot_reliability(s, visuals={"dot": {}}), ValueError, "no visual.*'dot'"),
    ],
)
def test_wrong_input_of_figures(ranks, scores, call, error, message):
    """Wrong input raises one error that says what is wrong."""
    with pytest.raises(error, match=message):
        call(ranks, scores)
