"""Calibration of posteriors, by ranks of true parameters, and of class probabilities."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.evidence.checks import check_fraction
from pymc_hyperelastic.evidence.stored import check_numbers, damaged, read_number
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.curves import DRAWS, Array
from pymc_hyperelastic.plots.panels import columns_of, size_of
from pymc_hyperelastic.plots.style import PALETTE, Backend, Canvas, Visuals, check_table, stacked

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

# Variables of each bin of a table of scores, and what visuals call them.
_OF_BINS = {
    "observed_frequency": "y",
    "predicted_probability": "x",
    "frequency_lower": "y_bottom",
    "frequency_upper": "y_top",
    "bin_left": "left_edges",
    "bin_right": "right_edges",
    "count": "histogram",
}
_ERROR = "expected_calibration_error"


@one_thread
def plot_calibration_ranks(
    sbc: xr.Dataset,
    *,
    ci_prob: float = 0.95,
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    r"""Plot how far the ranks of true parameters are from uniform: a panel for each parameter.

    The line is the empirical distribution function of the ranks less the uniform one: the share of
    simulations whose rank is below ``k``, less ``k/(L + 1)``, over the latter. If the model is
    right, the whole line is inside the band with the probability `ci_prob` [1]_. A line that is
    above 0 on the left and below 0 on the right shows that posteriors are too narrow, the mirrored
    one that they are too wide, and a line above 0 throughout that they lie too high.

    Parameters
    ----------
    sbc : xarray.Dataset
        Result of :func:`pymc_hyperelastic.simulation_based_calibration`; choose parameters by
        ``sbc.sel(parameter=[...])``.
    ci_prob : float, default 0.95
        Probability that the band holds.
    backend, visuals, **pc_kwargs
        See :func:`~pymc_hyperelastic.plot_inflation`. The visuals are ``band``, ``reference``,
        ``line``, ``xlabel``, ``ylabel`` and ``title`` (of a panel, with the p-value).

    Returns
    -------
    arviz_plots.PlotCollection
        With the dimension ``parameter``.

    Raises
    ------
    TypeError, ValueError
        If `sbc` holds no ranks, or `ci_prob`, the backend or a visual is unknown.

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
    check_table(sbc, "ph.simulation_based_calibration", "rank", "p_value")
    check_fraction("ci_prob", ci_prob)
    rank, values = sbc["rank"], int(read_number(sbc, "ranked_draws")) + 1
    dims = {"simulation", "parameter"} if rank.ndim > 1 else {"simulation"}
    if set(rank.dims) != dims or not np.all((rank >= 0) & (rank < values)):
        raise damaged(sbc, f"'rank' {rank.dims} holds no ranks among {values} of each simulation")
    if rank.ndim == 1:
        rank = rank.expand_dims("parameter", axis=1)
    names = rank["parameter"].values.tolist()
    simulations, columns = rank.sizes["simulation"], columns_of(len(names), 3)
    uniform = xr.DataArray(np.arange(values + 1) / values, dims="value")
    below = (rank < xr.DataArray(np.arange(values + 1), dims="value")).mean("simulation")
    canvas = Canvas(
        "wrap",
        stacked("ranks", x=uniform, y=below - uniform),
        "band reference line xlabel ylabel title",
        (backend, visuals, pc_kwargs),
        size_of(len(names), columns),
        {"sharey": True},
        cols=["parameter"],
        col_wrap=columns,
        aes={"color": ["parameter"]},
        color=PALETTE[:1],
    )
    x, low, high = _simultaneous_band(simulations, values, ci_prob)
    grey = {"ignore_aes": "all", "color": "0.5"}
    canvas.draw("band", "fill_between_y", x=x, y_bottom=low, y_top=high, alpha=0.3, **grey)
    canvas.draw("line", "line_xy", width=1.5)
    zero = xr.zeros_like(rank.isel(simulation=0, drop=True)).to_dataset(name="ranks")
    canvas.draw("reference", "hline", data=zero, width=0.8, **grey)
    p_values = np.atleast_1d(sbc["p_value"].values).tolist()
    for i, (name, p_value) in enumerate(zip(names, p_values, strict=True)):
        where = {"coords": {"parameter": name}}
        canvas.label("title", f"{name}\n({_p_value(p_value)})", size="medium", **where)
        if i + columns >= len(names):
            canvas.label("xlabel", "rank / $(L+1)$", **where)
        if i % columns == 0:
            canvas.label("ylabel", "ECDF − uniform", **where)
    canvas.title(
        [sbc.attrs],
        f"simulation-based calibration, {simulations} simulations, "
        f"{100 * ci_prob:.3g} % simultaneous band",
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
    """Plot how often classes are right over their probability, and how many forecasts there were.

    On the diagonal, classes with a probability of 70 % are right in 70 % of all cases; below it,
    probabilities are overconfident.

    Parameters
    ----------
    scores : xarray.Dataset
        Result of :func:`pymc_hyperelastic.score_probabilities`; choose forecasts by
        ``scores.sel(forecast=["most probable class"])``.
    backend, visuals, **pc_kwargs
        See :func:`~pymc_hyperelastic.plot_inflation`. The visuals are ``diagonal``, ``interval``,
        ``points``, ``bar``, ``xlabel``, ``ylabel`` and ``title`` (of a column, with the expected
        calibration error).

    Returns
    -------
    arviz_plots.PlotCollection
        A grid with the dimensions ``part`` (diagram and count) and ``forecast`` (column).

    Raises
    ------
    TypeError, ValueError
        If `scores` holds no such table, or the backend or a visual is unknown.

    See Also
    --------
    score_probabilities, cross_validate

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
    check_table(scores, "ph.score_probabilities", *_OF_BINS, _ERROR)
    if "forecast" not in scores.dims:
        scores = scores.expand_dims("forecast")
    check_numbers(scores, scores, _ERROR, ("forecast",), finite=False)
    names = [str(name) for name in scores["forecast"].values.tolist()]
    if len(set(names)) < len(names):
        raise damaged(scores, f"forecasts are {names}, and their names must differ")
    scores = scores.assign_coords(forecast=names)
    drawn = stacked("reliability", **{axis: scores[name] for name, axis in _OF_BINS.items()})
    canvas = Canvas(
        "grid",
        drawn.expand_dims(part=["diagram", "count"]),
        "diagonal interval points bar xlabel ylabel title",
        (backend, visuals, pc_kwargs),
        (max(2.6 * len(names) + 0.7, 3.4), 4.2),
        {"height_ratios": [3, 1], "sharex": True, "sharey": "row"},
        rows=["part"],
        cols=["forecast"],
        aes={"color": ["forecast"]},
        color=PALETTE[:1],
    )
    diagram: dict[str, Any] = {"data": drawn, "coords": {"part": "diagram"}}
    grey = {"color": "0.5", "width": 0.8, "linestyle": "--", "ignore_aes": "all"}
    canvas.draw("diagonal", "dline", x=[0.0, 1.0], **diagram, **grey)
    # Points at 0 or 1 are drawn whole, though the axes end there.
    canvas.draw("interval", "ci_line_y", **diagram, width=1.2, clip_on=False)
    canvas.draw("points", "scatter_xy", **diagram, size=20, clip_on=False)
    canvas.draw("bar", "hist", data=drawn, coords={"part": "count"}, alpha=0.75)
    canvas.end_at_0_and_1()
    canvas.adjust("set_ylim", limits=(0, 1), **diagram)
    for name in names:
        title = f"{name}\n(ECE = {float(scores[_ERROR].sel(forecast=name)):.3f})"
        where = {"forecast": name}
        canvas.label("title", title, size="medium", coords=where | {"part": "diagram"})
        canvas.label("xlabel", "predicted probability", coords=where | {"part": "count"})
    for part, text in (("diagram", "observed frequency"), ("count", "count")):
        canvas.label("ylabel", text, coords={"forecast": names[0], "part": part})
    intervals = f"{100 * read_number(scores, 'prob'):.3g} % intervals"
    canvas.title([scores.attrs], f"reliability of class probabilities, {intervals}")
    return canvas.collection


def _simultaneous_band(simulations: int, values: int, ci_prob: float) -> tuple[Array, Array, Array]:
    """Band that holds the whole line of uniform ranks with this probability."""
    from arviz_stats.ecdf_utils import get_pointwise_confidence_band, simulate_confidence_bands

    # At these points the share of ranks below is binomial, though ranks are discrete.
    due = np.arange(1, values) / values
    rng = np.random.default_rng(0)  # the band is the same at every call
    pointwise = simulate_confidence_bands(simulations, 1, due, ci_prob, DRAWS, rng)
    low, high = get_pointwise_confidence_band(pointwise, simulations, due)
    x, low, high = (np.concatenate([[0.0], v, [1.0]]) for v in (due, low, high))
    return x, low - x, high - x


def _p_value(p_value: float) -> str:
    if np.isnan(p_value):
        return "not tested"
    return "p < 0.001" if p_value < 0.001 else f"p = {p_value:.3f}"
