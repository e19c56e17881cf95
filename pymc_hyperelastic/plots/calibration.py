"""Whether probabilities mean what they say: ranks of true parameters, reliability of classes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.stats import binom

from pymc_hyperelastic.evidence.checks import check_fraction
from pymc_hyperelastic.evidence.stored import check_numbers, damaged, read_number
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.style import PALETTE, Backend, Canvas, Visuals, check_table, stacked

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

Array = NDArray[np.float64]

# Uniform samples by which a simultaneous band is found: its coverage is then known to 1 %.
_OF_BINS = (
    *("observed_frequency", "predicted_probability", "frequency_lower", "frequency_upper"),
    *("bin_left", "bin_right", "count", "expected_calibration_error"),
)
_BAND_SIMULATIONS = 1000
_TICKS, _TICK_LABELS = [0.0, 0.5, 1.0], ["0", "0.5", "1"]


@one_thread
def plot_calibration_ranks(
    sbc: xr.Dataset,
    *,
    kind: Literal["ecdf", "histogram"] = "ecdf",
    prob: float = 0.95,
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    r"""Plot how far the ranks of true parameters are from uniform: a panel for each parameter.

    With `kind` ``"ecdf"`` the line is the share of simulations whose rank is below ``k``, less the
    share ``k/(L + 1)`` that is due, over the latter. If the model is right, the whole line is
    inside the band with the probability `prob` [1]_. A line that rises at the left end and returns
    from below at the right tells of posteriors that are too narrow, the mirrored one of posteriors
    that are too wide; a line above 0 throughout, of posteriors that lie too high.

    With ``"histogram"`` there are the counts of the bins in which the ranks were tested, and the
    band holds each of them by itself with the probability `prob`.

    Parameters
    ----------
    sbc : xarray.Dataset
        Result of :func:`pymc_hyperelastic.simulation_based_calibration`; choose parameters by
        ``sbc.sel(parameter=[...])``.
    kind : {"ecdf", "histogram"}
        What is drawn.
    prob : float, default 0.95
        Probability that the band holds.
    backend : {"matplotlib", "none"}
        Plotting backend; ``"none"`` only collects what would be drawn.
    visuals : dict of str to dict or bool, optional
        Settings of ``band``, ``reference``, ``line`` or ``bar``, ``xlabel``, ``ylabel`` and
        ``title`` (of a panel, with the p-value); False leaves one out.
    **pc_kwargs
        Passed to :meth:`arviz_plots.PlotCollection.wrap`.

    Returns
    -------
    arviz_plots.PlotCollection
        With the dimension ``parameter``.

    Raises
    ------
    TypeError, ValueError
        If `sbc` holds no ranks, or `kind`, `prob`, the backend or a visual is unknown.

    See Also
    --------
    simulation_based_calibration

    References
    ----------
    .. [1] T. Säilynoja, P.-C. Bürkner and A. Vehtari, Graphical test for discrete uniformity and
       its applications in goodness-of-fit evaluation and multiple sample comparison, Statistics and
       Computing 32 (2022) 32.

    Examples
    --------
    >>> import pymc as pm, pymc_hyperelastic as ph
    >>> with pm.Model() as model:
    ...     mean = pm.Normal("mean", 0, 1)
    ...     y = pm.Normal("y", mean, 1, observed=[0.0, 0.0, 0.0])
    >>> sbc = ph.simulation_based_calibration(
    ...     model, simulations=40, draws=200, random_seed=1, progressbar=False
    ... )
    >>> figure = ph.plot_calibration_ranks(sbc, backend="none")
    >>> figure.viz["plot"].sizes["parameter"]
    1
    """
    from arviz_plots.visuals import fill_between_y, hist, line_xy, set_xticks

    check_table(sbc, "ph.simulation_based_calibration", "rank", "p_value")
    if kind not in ("ecdf", "histogram"):
        raise ValueError(f"kind must be 'ecdf' or 'histogram', not {kind!r}")
    check_fraction("prob", prob)
    rank, values = sbc["rank"], int(read_number(sbc, "ranked_draws")) + 1
    dims = {"simulation", "parameter"} if rank.ndim > 1 else {"simulation"}
    if set(rank.dims) != dims or not np.all((rank >= 0) & (rank < values)):
        raise damaged(sbc, f"'rank' {rank.dims} holds no ranks among {values} of each simulation")
    if rank.ndim == 1:
        rank = rank.expand_dims("parameter", axis=1)
    parameters = rank["parameter"].values.tolist()
    p_values = dict(zip(parameters, np.atleast_1d(sbc["p_value"].values).tolist(), strict=True))
    bins = int(read_number(sbc, "bins"))
    if bins < 1:
        raise damaged(sbc, f"it has {bins} bins")
    if kind == "histogram" and bins == 1:
        raise ValueError("the ranks are too few for a histogram, or no bins divide them evenly")
    rows, columns = -(-len(parameters) // 4), min(len(parameters), 4)
    if kind == "ecdf":
        ranks = _ecdf(rank, values, prob)
    else:
        ranks = _histogram(rank, values, bins, prob)
    canvas = Canvas(
        "wrap",
        ranks.drawn,
        "band reference line bar xlabel ylabel title",
        backend,
        visuals,
        pc_kwargs,
        {"figsize": (max(2.5 * columns + 0.7, 4.6), 2.3 * rows + 0.7), "sharey": True},
        cols=["parameter"],
        aes={"color": ["parameter"]},
        color=PALETTE[:1],
    )
    grey = {"ignore_aes": "all", "color": "0.5"}
    canvas.draw("band", fill_between_y, **ranks.band, alpha=0.3, **grey)
    if kind == "ecdf":
        canvas.draw("line", line_xy, width=1.5)
    else:
        canvas.draw("bar", hist, alpha=0.75)
    due = _straight("ranks", np.full(2, ranks.due), parameter=parameters)
    canvas.draw("reference", line_xy, data=due, width=0.8, **grey)
    canvas.adjust(set_xticks, values=_TICKS, labels=_TICK_LABELS)
    _label_ranks(canvas, p_values, columns, ranks.ylabel)
    band = "" if kind == "histogram" else "simultaneous "
    canvas.title(
        [sbc.attrs],
        f"simulation-based calibration, {rank.sizes['simulation']} simulations, "
        f"{100 * prob:.3g} % {band}band",
    )
    return canvas.collection


@one_thread
def plot_reliability(
    scores: xr.Dataset,
    *,
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    """Plot how often classes are right over how probable they were said to be, and how many were.

    On the diagonal, what is said to have a probability of 70 % comes true in 70 % of all cases;
    below it, classes are taken for more certain than they are.

    Parameters
    ----------
    scores : xarray.Dataset
        Result of :func:`pymc_hyperelastic.score_probabilities`; choose forecasts by
        ``scores.sel(forecast=["most probable class"])``.
    backend : {"matplotlib", "none"}
        Plotting backend; ``"none"`` only collects what would be drawn.
    visuals : dict of str to dict or bool, optional
        Settings of ``diagonal``, ``interval``, ``points``, ``bar``, ``xlabel``, ``ylabel`` and
        ``title`` (of a column, with the expected calibration error); False leaves one out.
    **pc_kwargs
        Passed to :meth:`arviz_plots.PlotCollection.grid`.

    Returns
    -------
    arviz_plots.PlotCollection
        With the dimensions ``part`` (diagram and count) and ``forecast`` (column).

    Raises
    ------
    TypeError, ValueError
        If `scores` holds no such table, or the backend or a visual is unknown.

    See Also
    --------
    score_probabilities, calibration_report

    Examples
    --------
    >>> import xarray as xr, pymc_hyperelastic as ph
    >>> probability = xr.DataArray(
    ...     [[0.9, 0.1], [0.6, 0.4], [0.2, 0.8]],
    ...     {"specimen": ["S1", "S2", "S3"], "class_label": ["C1", "C2"]},
    ... )
    >>> scores = ph.score_probabilities(probability, ["C1", "C2", "C2"])
    >>> figure = ph.plot_reliability(scores, backend="none")
    >>> figure.viz["plot"].sizes["forecast"]  # the most probable class, and each of the two
    3
    """
    from arviz_plots.visuals import (
        ci_line_y,
        hist,
        line_xy,
        scatter_xy,
        set_xlim,
        set_xticks,
        set_ylim,
    )

    check_table(scores, "ph.score_probabilities", *_OF_BINS)
    if "forecast" not in scores.dims:
        scores = scores.expand_dims("forecast")
    check_numbers(scores, scores, "expected_calibration_error", ("forecast",), finite=False)
    forecasts = [str(name) for name in scores["forecast"].values.tolist()]
    if len(set(forecasts)) < len(forecasts):
        raise damaged(scores, f"forecasts are {forecasts}, and their names must differ")
    scores = scores.assign_coords(forecast=forecasts)
    drawn = stacked(
        "reliability",
        x=scores["predicted_probability"],
        y=scores["observed_frequency"],
        y_bottom=scores["frequency_lower"],
        y_top=scores["frequency_upper"],
        left_edges=scores["bin_left"],
        right_edges=scores["bin_right"],
        histogram=scores["count"],
    )
    canvas = Canvas(
        "grid",
        drawn.expand_dims(part=["diagram", "count"]),
        "diagonal interval points bar xlabel ylabel title",
        backend,
        visuals,
        pc_kwargs,
        {"figsize": (max(2.6 * len(forecasts) + 0.7, 3.4), 4.2), "height_ratios": [3, 1]}
        | {"sharex": True, "sharey": "row"},
        rows=["part"],
        cols=["forecast"],
        aes={"color": ["forecast"]},
        color=PALETTE[:1],
    )
    ends = _straight("reliability", np.array([0.0, 1.0]), forecast=forecasts)
    diagram: dict[str, Any] = {"data": drawn, "coords": {"part": "diagram"}}
    count = {"data": drawn, "coords": {"part": "count"}}
    settings = {"color": "0.5", "width": 0.8, "linestyle": "--", "ignore_aes": "all"}
    canvas.draw("diagonal", line_xy, **diagram | {"data": ends}, **settings)
    # What lies at 0 or 1 is drawn whole, though the axes end there.
    canvas.draw("interval", ci_line_y, **diagram, width=1.2, clip_on=False)
    canvas.draw("points", scatter_xy, **diagram, size=20, clip_on=False)
    canvas.draw("bar", hist, **count, alpha=0.75)
    canvas.adjust(set_xlim, limits=(0, 1))
    canvas.adjust(set_xticks, values=_TICKS, labels=_TICK_LABELS)
    canvas.adjust(set_ylim, limits=(0, 1), **diagram)
    _label_reliability(canvas, forecasts, scores)
    intervals = f"{100 * read_number(scores, 'prob'):.3g} % intervals"
    canvas.title([scores.attrs], f"reliability of class probabilities, {intervals}")
    return canvas.collection


def _label_reliability(canvas: Canvas, forecasts: list[str], scores: xr.Dataset) -> None:
    """Each column says how wrong its forecasts are, the first one what is drawn."""
    for name in forecasts:
        error = float(scores["expected_calibration_error"].sel(forecast=name))
        where = {"coords": {"forecast": name, "part": "diagram"}}
        canvas.label("title", f"{name}\n(ECE = {error:.3f})", size="medium", **where)
        where = {"coords": {"forecast": name, "part": "count"}}
        canvas.label("xlabel", "predicted probability", **where)
    for part, text in (("diagram", "observed frequency"), ("count", "count")):
        canvas.label("ylabel", text, coords={"forecast": forecasts[0], "part": part})


def _straight(name: str, y: Array, **panels: list) -> xr.Dataset:
    """Line from the left to the right end of each panel."""
    line = xr.Dataset({name: (("plot_axis", "end"), [[0.0, 1.0], y])}, {"plot_axis": ["x", "y"]})
    return line.expand_dims(panels)


def _counts(rank: xr.DataArray, bins: int, width: int, name: str) -> xr.DataArray:
    """Number of ranks in each bin of so many ranks."""
    columns = rank.transpose("simulation", "parameter").values.T
    counts = [np.bincount(column // width, minlength=bins) for column in columns]
    return xr.DataArray(counts, {"parameter": rank["parameter"].values}, ("parameter", name))


class _Ranks(NamedTuple):
    """What is drawn of ranks, what is due to uniform ones, and the band in which these lie."""

    drawn: xr.Dataset
    due: float
    band: dict[str, Array]
    ylabel: str


def _ecdf(rank: xr.DataArray, values: int, prob: float) -> _Ranks:
    """Share of ranks below each value, less the share that is due."""
    simulations = rank.sizes["simulation"]
    share = _counts(rank, values, 1, "value").cumsum("value") / simulations
    share = share.pad(value=(1, 0), constant_values=0)
    due = xr.DataArray(np.arange(values + 1) / values, dims="value")
    x, low, high = _simultaneous_band(simulations, values, prob)
    band = {"x": x, "y_bottom": low, "y_top": high}
    return _Ranks(stacked("ranks", x=due, y=share - due), 0.0, band, "ECDF − uniform")


def _histogram(rank: xr.DataArray, values: int, bins: int, prob: float) -> _Ranks:
    """Counts of ranks in bins of equal width."""
    simulations = rank.sizes["simulation"]
    edges = np.arange(bins + 1) / bins
    left, right = (xr.DataArray(e, dims="bin") for e in (edges[:-1], edges[1:]))
    counts = _counts(rank, bins, values // bins, "bin")
    drawn = stacked("ranks", left_edges=left, right_edges=right, histogram=counts)
    low, high = (np.full(2, q) for q in binom.interval(prob, simulations, 1 / bins))
    band = {"x": np.array([0.0, 1.0]), "y_bottom": low, "y_top": high}
    return _Ranks(drawn, simulations / bins, band, "simulations")


def _simultaneous_band(simulations: int, values: int, prob: float) -> tuple[Array, Array, Array]:
    """Where the line of uniform ranks lies throughout, with this probability."""
    from arviz_stats.ecdf_utils import get_pointwise_confidence_band, simulate_confidence_bands

    # At these points the share of ranks below is binomial, though ranks are discrete.
    due = np.arange(1, values) / values
    rng = np.random.default_rng(0)
    pointwise = simulate_confidence_bands(simulations, 1, due, prob, _BAND_SIMULATIONS, rng)
    low, high = get_pointwise_confidence_band(pointwise, simulations, due)
    x, low, high = (np.concatenate([[0.0], v, [1.0]]) for v in (due, low, high))
    return x, low - x, high - x


def _label_ranks(canvas: Canvas, p_values: dict[str, float], columns: int, ylabel: str) -> None:
    """Each panel tells its p-value; only the outermost say what is drawn."""
    for i, (name, p_value) in enumerate(p_values.items()):
        where = {"coords": {"parameter": name}}
        canvas.label("title", f"{name}\n({_p_value(p_value)})", size="medium", **where)
        if i + columns >= len(p_values):
            canvas.label("xlabel", "rank / $(L+1)$", **where)
        if i % columns == 0:
            canvas.label("ylabel", ylabel, **where)


def _p_value(p_value: float) -> str:
    if np.isnan(p_value):
        return "not tested"
    return "p < 0.001" if p_value < 0.001 else f"p = {p_value:.3f}"
