"""Proper scores and calibration of class probabilities, given the true classes."""

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray
from scipy.stats import binomtest

from pymc_hyperelastic.evidence.checks import check_count, check_fraction
from pymc_hyperelastic.rounding import DIGITS

Array = NDArray[np.float64]

# Name of the forecast by the most probable class.
TOP_CLASS = "most probable class"


def score_probabilities(
    probability: xr.DataArray | xr.Dataset, truth: Any, *, bins: int = 10, ci_prob: float = 0.95
) -> xr.Dataset:
    r"""Score class probabilities against the true classes, and tabulate their calibration.

    With the probability ``p_c`` of class ``c`` and the true class ``t`` of a unit,

    .. math:: \text{log score} = \ln p_t, \qquad
        \text{Brier score} = \sum_c \left(p_c - 1[c = t]\right)^2

    The best log score is 0; it is ``−inf`` if the true class had the probability 0. The Brier score
    [1]_ lies between 0, the best value, and 2. Probabilities are calibrated if events with the
    probability ``p`` occur with the frequency ``p``. Let ``n`` probabilities be divided among ``M``
    bins. If bin ``m`` holds ``n_m`` probabilities with the mean ``p̄_m``, and a fraction ``f_m`` of
    their events occurred, the expected calibration error [2]_ [3]_ is

    .. math:: \text{ECE} = \sum_{m=1}^{M} \frac{n_m}{n} \left|f_m - \bar p_m\right|

    Parameters
    ----------
    probability : xarray.DataArray or xarray.Dataset
        Probabilities (unit, class_label), where the first dimension may have any name; or the
        result of :func:`pymc_hyperelastic.classify`.
    truth : sequence of str, pandas.Series or xarray.DataArray
        The true class of each unit, in the order of the probabilities.
    bins : int, default 10
        ``M``, the number of bins of equal width between 0 and 1. A probability at an edge between
        two bins belongs to the lower bin.
    ci_prob : float, default 0.95
        Coverage of the intervals of the observed frequencies.

    Returns
    -------
    xarray.Dataset
        ``log_score`` (nats), ``brier_score`` and ``correct`` (unit); their means
        ``mean_log_score``, ``mean_brier_score`` and ``accuracy``, each with a standard error
        (``…_se``); ``expected_calibration_error`` (forecast); and for each (forecast, bin)
        ``count``, ``predicted_probability`` (mean of the bin), ``observed_frequency`` and its
        Wilson interval from ``frequency_lower`` to ``frequency_upper``. Except for the count, these
        are NaN in empty bins. One forecast is ``"most probable class"``, for which the expected
        calibration error is usually defined; the others are those of each class against all other
        classes.

    Raises
    ------
    TypeError
        If `probability` is neither a DataArray nor a result of `classify`, or `bins` is not an
        integer.
    ValueError
        If there are no units or classes, probabilities of a unit are NaN or do not add up to 1, or
        a true class is missing or unknown.

    See Also
    --------
    plot_reliability : Plot the result.

    Notes
    -----
    Intervals and standard errors assume independent units. Experiments on one specimen are not
    independent: classify by specimen, since intervals would otherwise be too narrow. If classes are
    equally probable, the first one counts as the most probable class.

    The expected calibration error is biased upwards: with few units in a bin it is large even for
    calibrated probabilities.

    References
    ----------
    .. [1] G. W. Brier, Verification of forecasts expressed in terms of probability, Monthly Weather
       Review 78 (1950) 1.
    .. [2] M. P. Naeini, G. F. Cooper and M. Hauskrecht, Obtaining well calibrated probabilities
       using Bayesian binning, AAAI Conference on Artificial Intelligence 29 (2015) 2901.
    .. [3] C. Guo, G. Pleiss, Y. Sun and K. Q. Weinberger, On calibration of modern neural networks,
       Proceedings of Machine Learning Research 70 (2017) 1321.

    Examples
    --------
    >>> import xarray as xr, pymc_hyperelastic as ph
    >>> probability = xr.DataArray(
    ...     [[0.9, 0.1], [0.6, 0.4], [0.2, 0.8]],
    ...     {"specimen": ["S1", "S2", "S3"], "class_label": ["C1", "C2"]},
    ... )
    >>> scores = ph.score_probabilities(probability, ["C1", "C2", "C2"])
    >>> scores["brier_score"].round(2).values.tolist()
    [0.02, 0.72, 0.08]
    >>> round(scores["accuracy"].item(), 3)
    0.667
    """
    check_count("bins", bins, 1)
    check_fraction("ci_prob", ci_prob)
    attrs = dict(getattr(probability, "attrs", {}))
    probability = _checked_probability(probability)
    unit = str(probability.dims[0])
    p, classes = probability.values, probability["class_label"].values.tolist()
    true = _checked_truth(truth, probability)
    rows = np.arange(len(p))
    with np.errstate(divide="ignore"):
        log_score = np.log(p[rows, true])
    brier_score = np.sum((p - np.eye(len(classes))[true]) ** 2, axis=1)
    top = p.round(DIGITS).argmax(axis=1)
    forecasts = {TOP_CLASS: (p[rows, top], top == true)}
    forecasts |= {str(name): (p[:, c], true == c) for c, name in enumerate(classes)}
    scores = {"log_score": log_score, "brier_score": brier_score, "correct": top == true}
    means = {}
    for name, values in scores.items():
        mean = "accuracy" if name == "correct" else f"mean_{name}"
        means[mean], means[f"{mean}_se"] = _mean(values.astype(float))
    edges = np.linspace(0, 1, bins + 1)
    table = xr.concat(
        [_reliability(*forecast, edges, ci_prob) for forecast in forecasts.values()], dim="forecast"
    )
    gap = abs(table["observed_frequency"] - table["predicted_probability"])
    means["expected_calibration_error"] = (table["count"] * gap).sum("bin") / len(p)
    of_units = {n: c.variable for n, c in probability.coords.items() if c.dims == (unit,)}
    of_table = {
        "forecast": list(forecasts),
        "bin_left": ("bin", edges[:-1]),
        "bin_right": ("bin", edges[1:]),
    }
    return xr.Dataset(
        {name: (unit, values) for name, values in scores.items()} | means | dict(table.data_vars),
        of_units | {"truth": (unit, np.asarray(classes)[true])} | of_table,
        {key: attrs[key] for key in ("title", "simulated", "strain_energy") if key in attrs}
        | {"prob": ci_prob},
    )


def _checked_probability(probability: Any) -> xr.DataArray:
    """Return the probabilities as (unit, class_label); raise unless they are valid."""
    if isinstance(probability, xr.Dataset) and "class_probability" in probability:
        probability = probability["class_probability"]
    if not isinstance(probability, xr.DataArray):
        raise TypeError(
            "expected the result of ph.classify or an xarray.DataArray of probabilities, not "
            f"{type(probability).__name__}"
        )
    dims = [str(dim) for dim in probability.dims]
    if len(dims) != 2 or "class_label" not in dims or "class_label" not in probability.coords:
        raise ValueError(
            "probabilities must have two dimensions, the units and 'class_label', with the names "
            f"of the classes as its coordinate; here are {dims}"
        )
    probability = probability.transpose(..., "class_label").astype(float)
    classes = probability["class_label"].values.tolist()
    if not probability.size or len(set(classes)) < len(classes):
        raise ValueError(
            f"probability has {len(probability)} unit(s) and the classes {classes}; expected at "
            "least one of each, and each class once"
        )
    for i, p in enumerate(probability.values):
        if not np.all(p >= 0) or not np.isclose(p.sum(), 1):
            raise ValueError(
                f"{_name_of_unit(probability, i)}: the probabilities {p.tolist()} are not numbers "
                "between 0 and 1 that add up to 1"
                + (" (not classified: leave the unit out)" if np.isnan(p).any() else "")
            )
    return probability


def _checked_truth(truth: Any, probability: xr.DataArray) -> NDArray[np.int64]:
    """Return the index of the true class of each unit."""
    unit, classes = probability.dims[0], probability["class_label"].values.tolist()
    names = [n for n in (unit, "specimen", "experiment") if n in probability.coords]
    of_units = {n: [*map(str, probability[n].values.tolist())] for n in names}
    stated = {}
    if isinstance(truth, xr.DataArray):
        stated = {n: truth[n].values.tolist() for n in of_units if n in truth.coords}
        truth = truth.values
    elif isinstance(truth, pd.Series):
        index = truth.index.tolist()
        for name, units in of_units.items():
            # The index may be that of another table, and equal to numbers of experiments by chance.
            other = set(units).isdisjoint(map(str, index)) or _is_default(truth)
            if not other and name != "experiment":
                stated[name] = index
    for name, units in stated.items():
        if [*map(str, units)] != of_units[name]:
            raise ValueError(f"probabilities and truth differ in {name!r}, or in its order")
    labels = np.asarray(truth).tolist()
    if not isinstance(labels, list) or len(labels) != len(probability):
        raise ValueError(
            f"truth must hold one class for each of {len(probability)} unit(s); got {truth!r}"
        )
    for i, label in enumerate(labels):
        if label not in classes:
            raise ValueError(
                f"{_name_of_unit(probability, i)}: the true class {label!r} is not among the "
                f"classes {classes}"
            )
    return np.array([classes.index(label) for label in labels])


def _is_default(values: pd.Series) -> bool:
    """Return True if an index has no labels, only the numbers of rows."""
    return values.index.name is None and values.index.equals(pd.RangeIndex(len(values)))


def _name_of_unit(probability: xr.DataArray, row: int) -> str:
    """Return the name of a unit for a message."""
    unit = str(probability.dims[0])
    names = [n for n in ("specimen", "experiment") if n in probability.coords]
    names = [n for n in names if probability[n].dims == (unit,)] or [unit]
    names = [n for n in names if n in probability.coords]
    described = ", ".join(f"{n} {probability[n].values.tolist()[row]!r}" for n in names)
    return described or f"{unit} {row}"


def _mean(values: Array) -> tuple[float, float]:
    """Return the mean of scores and its standard error; NaN for one unit or infinite scores."""
    mean = float(np.mean(values))
    if len(values) == 1 or not np.isfinite(mean):
        return mean, np.nan
    return mean, float(np.std(values, ddof=1) / np.sqrt(len(values)))


def _reliability(p: Array, occurred: NDArray[np.bool_], edges: Array, ci_prob: float) -> xr.Dataset:
    """Return predicted and observed frequencies of one forecast for each bin."""
    place = np.searchsorted(edges[1:-1].round(DIGITS), p.round(DIGITS))
    count, hits = (np.bincount(place, w, len(edges) - 1).astype(int) for w in (None, occurred))
    total = np.bincount(place, p, len(edges) - 1)
    interval = np.full((len(count), 2), np.nan)
    for m in np.flatnonzero(count):
        interval[m] = binomtest(int(hits[m]), int(count[m])).proportion_ci(ci_prob, "wilson")
    filled = np.where(count > 0, count, np.nan)
    columns = {
        "count": count,
        "predicted_probability": total / filled,
        "observed_frequency": hits / filled,
        "frequency_lower": interval[:, 0],
        "frequency_upper": interval[:, 1],
    }
    return xr.Dataset({name: ("bin", values) for name, values in columns.items()})
