"""Whether probabilities mean what they say: those of parameters, and those of classes."""

import json
import warnings
from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
import pymc as pm
import pytensor
import xarray as xr
from numpy.typing import NDArray
from pymc.progress_bar import create_simple_progress
from scipy.stats import binomtest, chisquare

from pymc_hyperelastic.batched import BatchedFunction
from pymc_hyperelastic.kernel import BatchedSMC, check_count
from pymc_hyperelastic.smc import seed_sequence

__all__ = ["score_probabilities", "simulation_based_calibration"]

Array = NDArray[np.float64]

# The chi-square distribution of the test is an approximation that needs so many counts in a bin.
# What is wrong with a posterior shifts many ranks a little, which few bins show better than many.
_LEAST_EXPECTED, _MOST_BINS = 10, 20
# By how much probabilities of classes that were rounded may miss a sum of 1.
_SUM_TOLERANCE = 1e-6

# What the forecast of the most probable class is called.
TOP_CLASS = "most probable class"

_NO_DATA = (
    "they have a density, but nothing can be drawn from them; give the likelihood as observed "
    'variables, as ph.inflation_model(..., likelihood="generative") does, and leave others out'
)


def simulation_based_calibration(
    model: pm.Model,
    *,
    simulations: int = 300,
    draws: int = 500,
    ranked_draws: int = 99,
    var_names: Sequence[str] | None = None,
    simulator: pm.Model | None = None,
    random_seed: Any = None,
    progressbar: bool = True,
    **kernel_settings: Any,
) -> xr.Dataset:
    r"""Check by simulation that a model's posteriors are as wide, and lie where, they should.

    Parameters ``θ`` are drawn from the prior, data ``y`` from the likelihood at ``θ``, and the
    posterior given ``y`` is sampled. If model and sampler are right, the rank of each entry of
    ``θ`` among ``L`` independent draws ``θ₁ … θ_L`` of the posterior is uniform [1]_:

    .. math:: r = \sum_{l=1}^{L} 1[θ_l < θ], \qquad P(r = k) = \frac{1}{L + 1},
        \quad k = 0, \dots, L

    Ranks that pile up at both ends tell of posteriors that are too narrow, ranks in the middle of
    such that are too wide, and ranks at one end of such that are biased.

    Parameters
    ----------
    model : pymc.Model
        Any model with continuous free variables and observed variables. The observed values are
        replaced by simulated ones; the model itself is left as it is.
    simulations : int, default 300
        Number of simulated data sets, each of which is fitted by itself.
    draws : int, default 500
        Particles of each fit, one chain of :func:`pymc_hyperelastic.sample_smc`.
    ranked_draws : int, default 99
        ``L``, the number of them, chosen at random, among which a true value is ranked. Particles
        may stand at one place in twos or threes; of a fifth of them hardly any do. Draws that equal
        the true value count as smaller or not at random.
    var_names : sequence of str, optional
        Variables that are ranked, deterministics among them; all free variables when missing.
    simulator : pymc.Model, optional
        Another model, with variables of the same names, from which parameters and data are drawn.
        With it one sees whether a wrong model would be found out.
    random_seed : int or sequence of int, optional
        One seed for the whole; the same seed gives the same result.
    progressbar : bool
        Whether to show progress. After an interrupt the simulations already complete are returned.
    **kernel_settings
        Further settings of :class:`pymc_hyperelastic.BatchedSMC`, such as ``threshold``.

    Returns
    -------
    xarray.Dataset
        ``rank``, ``truth``, ``posterior_mean`` and ``posterior_sd``, each (simulation, parameter),
        and ``p_value`` (parameter). The coordinate ``parameter`` names each entry, as in ``mu`` or
        ``k[0, 1]``, and ``variable`` the variable that it belongs to. Attributes tell the settings
        and the number of ``bins`` of the test.

    Raises
    ------
    TypeError
        If the model or the simulator is no PyMC model, or a number is not a whole one.
    ValueError
        If the model has no observed variables, or Potentials (nothing can be simulated from them),
        or discrete free variables; if a variable is unknown, or the simulator lacks it; if
        simulated data are not finite; or if a posterior cannot be sampled.

    See Also
    --------
    plot_calibration_ranks : The figure that belongs to it.

    Notes
    -----
    ``p_value`` is that of Pearson's chi-square test of uniform ranks. There are as many bins of
    equal width, up to 20, as divide ``L + 1`` and hold ten ranks at least on average; with fewer
    than 20 simulations, or if no such number divides ``L + 1``, the p-value is NaN. Each parameter
    is tested by itself: of twenty, one has a p-value below 0.05 by chance.

    A posterior that ignores the data, and equals the prior, passes too. Whether the data tell
    anything is seen in ``posterior_sd`` beside the spread of ``truth``.

    References
    ----------
    .. [1] S. Talts, M. Betancourt, D. Simpson, A. Vehtari and A. Gelman, Validating Bayesian
       inference algorithms with simulation-based calibration, arXiv:1804.06788 (2018).

    Examples
    --------
    >>> import pymc as pm, pymc_hyperelastic as ph
    >>> with pm.Model() as model:
    ...     mean = pm.Normal("mean", 0, 1)
    ...     y = pm.Normal("y", mean, 1, observed=[0.0, 0.0, 0.0])
    >>> sbc = ph.simulation_based_calibration(
    ...     model, simulations=40, draws=200, random_seed=1, progressbar=False
    ... )
    >>> dict(sbc["rank"].sizes)
    {'simulation': 40, 'parameter': 1}
    >>> bool(sbc["p_value"].sel(parameter="mean") > 0.01)
    True
    """
    check_count("simulations", simulations, 2)
    check_count("ranked_draws", ranked_draws, 1)
    check_count("draws", draws, ranked_draws)
    _check_simulates("model", model)
    names = _ranked_variables(model, var_names)
    observed = [v.name for v in model.observed_RVs]
    if simulator is not None:
        _check_simulates("simulator", simulator)
        lacking = [name for name in (*names, *observed) if name not in simulator.named_vars]
        if lacking:
            raise ValueError(f"the simulator has no variables {lacking}, which the model has")
    seed = seed_sequence(random_seed)
    seeds = seed.generate_state(1 + simulations).tolist()
    simulated = _simulate(simulator or model, [*names, *observed], simulations, seeds.pop())
    _check_simulated(model, simulated, names)

    # One model, in which only the values of the data change: compiled once.
    data = {
        name: pytensor.shared(
            simulated[name][0], name=f"{name}_simulated", shape=simulated[name].shape[1:]
        )
        for name in observed
    }
    conditioned = pm.observe(model, data)
    kernel = BatchedSMC(draws=draws, model=conditioned, **kernel_settings)
    variables = [conditioned[name] for name in names]
    constrain = BatchedFunction.of_model(conditioned, conditioned.replace_rvs_by_values(variables))
    truth = _columns([simulated[name] for name in names])
    rank = np.zeros(truth.shape, dtype=int)
    mean, sd = np.full(truth.shape, np.nan), np.full(truth.shape, np.nan)
    complete = 0
    progress = create_simple_progress(progressbar)
    with progress:
        bar = progress.add_task("Calibrating", completed=0, total=simulations)
        try:
            for i in range(simulations):
                for name, shared in data.items():
                    shared.set_value(simulated[name][i])
                rng = np.random.default_rng(seeds[i])
                posterior = _posterior(kernel, constrain, rng, i)
                mean[i], sd[i] = posterior.mean(axis=0), posterior.std(axis=0, ddof=1)
                rank[i] = _rank(truth[i], rng.permutation(posterior)[:ranked_draws], rng)
                complete = i + 1
                progress.advance(bar)
        except KeyboardInterrupt:
            if not complete:
                raise
            warnings.warn(
                f"interrupted: {complete} of {simulations} simulations are complete", stacklevel=2
            )
    rank = rank[:complete]
    bins = _number_of_bins(complete, ranked_draws)
    of_both = ("simulation", "parameter")
    entries = [_entries(model, name, simulated[name].shape[1:]) for name in names]
    return xr.Dataset(
        {
            "rank": (of_both, rank),
            "p_value": ("parameter", _uniformity(rank, bins, ranked_draws)),
            "truth": (of_both, truth[:complete]),
            "posterior_mean": (of_both, mean[:complete]),
            "posterior_sd": (of_both, sd[:complete]),
        },
        {
            "simulation": range(complete),
            "parameter": [label for labels in entries for label in labels],
            "variable": ("parameter", np.repeat(names, [len(labels) for labels in entries])),
        },
        {
            "draws": draws,
            "ranked_draws": ranked_draws,
            "bins": bins,
            "random_seed": json.dumps(seed.entropy),
        },
    )


def _check_simulates(what: str, model: Any) -> None:
    """Raise unless data can be drawn from the model."""
    if not isinstance(model, pm.Model):
        raise TypeError(f"the {what} must be a pm.Model, not {type(model).__name__}")
    if not model.observed_RVs:
        potentials = [v.name for v in model.potentials]
        raise ValueError(
            f"the {what} has no observed variables: there are no data to simulate"
            + (f" ({potentials} are Potentials: {_NO_DATA})" if potentials else "")
        )
    if model.potentials:
        raise ValueError(
            f"the {what} has the Potentials {[v.name for v in model.potentials]}: {_NO_DATA}"
        )


def _ranked_variables(model: pm.Model, var_names: Sequence[str] | None) -> list[str]:
    if isinstance(var_names, str):
        raise TypeError(f"var_names must be a list of names, not {var_names!r}")
    if var_names is None:
        return [v.name for v in model.free_RVs]
    known = [v.name for v in model.unobserved_RVs]
    lacking = [name for name in var_names if name not in known]
    if lacking or not var_names:
        raise ValueError(
            f"var_names is {list(var_names)}; the model has the variables {known} to rank"
        )
    return list(dict.fromkeys(var_names))


def _simulate(
    model: pm.Model, names: Sequence[str], simulations: int, random_seed: int
) -> dict[str, Array]:
    """Joint draws of the variables from the model's prior, simulations along the first axis."""
    variables = [model[name] for name in names]
    # Drawn a few hundred times, in all: not worth the time that other modes take to compile.
    drawn = pm.draw(variables, simulations, random_seed=random_seed, mode="FAST_COMPILE")
    return {name: np.asarray(v) for name, v in zip(names, drawn, strict=True)}


def _check_simulated(model: pm.Model, simulated: dict[str, Array], parameters: list[str]) -> None:
    """Raise unless all is finite, and of the shape that the model has."""
    for name, values in simulated.items():
        static = model[name].type.shape
        if len(static) != values.ndim - 1 or any(
            n not in (None, m) for n, m in zip(static, values.shape[1:], strict=True)
        ):
            raise ValueError(
                f"the simulator's {name!r} has the shape {values.shape[1:]}, the model's {static}"
            )
        bad = ~np.isfinite(values.reshape(len(values), -1)).all(axis=1)
        if bad.any():
            first = int(bad.argmax())
            at = ", ".join(f"{p} = {simulated[p][first]}" for p in parameters)
            raise ValueError(
                f"{bad.sum()} of {len(values)} simulations have a {name!r} that is not finite, the "
                f"first of them simulation {first}, at {at}: give priors under which data are "
                "finite"
            )


def _posterior(
    kernel: BatchedSMC, constrain: BatchedFunction, rng: np.random.Generator, simulation: int
) -> Array:
    """Sample the posterior of the data at hand: a row for each draw, a column for each entry."""
    try:
        kernel.temper(None, rng)
    except ValueError as error:
        raise ValueError(f"simulation {simulation}: {error}") from error
    posterior = _columns(constrain(kernel.tempered_posterior))
    if not np.isfinite(posterior).all():
        raise ValueError(
            f"simulation {simulation}: the posterior has draws that are not finite, which have no "
            "rank: choose other variables by var_names"
        )
    return posterior


def _columns(values: Sequence[Array]) -> Array:
    """All entries of several variables, side by side."""
    return np.concatenate([np.reshape(v, (len(v), -1)) for v in values], axis=1)


def _rank(truth: Array, posterior: Array, rng: np.random.Generator) -> NDArray[np.int64]:
    """Number of draws that are smaller than the truth, ties broken at random."""
    equal = (posterior == truth).sum(axis=0)
    return (posterior < truth).sum(axis=0) + rng.integers(0, equal + 1)


def _number_of_bins(simulations: int, ranked_draws: int) -> int:
    """Largest number of equal bins in which enough ranks are expected."""
    most = min(max(simulations // _LEAST_EXPECTED, 1), _MOST_BINS)
    return max(n for n in range(1, most + 1) if (ranked_draws + 1) % n == 0)


def _uniformity(rank: NDArray[np.int64], bins: int, ranked_draws: int) -> Array:
    """P-value of the chi-square test of each column of ranks."""
    if bins == 1:
        return np.full(rank.shape[1], np.nan)
    width = (ranked_draws + 1) // bins
    counts = [np.bincount(column // width, minlength=bins) for column in rank.T]
    return np.array([chisquare(count).pvalue for count in counts])


def _entries(model: pm.Model, name: str, shape: tuple[int, ...]) -> list[str]:
    """Label of each entry of a variable."""
    if not shape:
        return [name]
    dims = model.named_vars_to_dims.get(name) or [None] * len(shape)
    levels = [model.coords.get(dim) or range(n) for dim, n in zip(dims, shape, strict=True)]
    return [f"{name}[{', '.join(map(str, index))}]" for index in product(*levels)]


def score_probabilities(
    probability: xr.DataArray | xr.Dataset,
    truth: Any,
    *,
    bins: int = 10,
    prob: float = 0.94,
) -> xr.Dataset:
    r"""Score class probabilities against the true classes, and tabulate how reliable they are.

    With the probability ``p_c`` of class ``c`` and the true class ``t`` of a unit,

    .. math:: \text{log score} = \ln p_t, \qquad
        \text{Brier score} = \sum_c \left(p_c - 1[c = t]\right)^2

    A log score is best at 0, and ``−inf`` where the truth was called impossible; a Brier score
    [1]_ is best at 0 and 2 at worst. Probabilities are reliable if, of all that are near ``p``, a
    share of ``p`` comes true. With the probabilities divided among ``M`` bins, ``n_m`` of ``n`` in
    bin ``m``, of mean ``p̄_m`` and of which a share ``f_m`` came true, the expected calibration
    error [2]_ [3]_ is

    .. math:: \text{ECE} = \sum_{m=1}^{M} \frac{n_m}{n} \left|f_m - \bar p_m\right|

    Parameters
    ----------
    probability : xarray.DataArray or xarray.Dataset
        Probabilities (unit, class_label), whatever the first dimension is called; or the result of
        :func:`pymc_hyperelastic.classify`.
    truth : sequence of str or xarray.DataArray
        The true class of each unit.
    bins : int, default 10
        ``M``, the number of bins of equal width between 0 and 1. What lies between two belongs to
        the lower one.
    prob : float, default 0.94
        Coverage of the intervals of the observed frequencies.

    Returns
    -------
    xarray.Dataset
        ``log_score``, ``brier_score`` and ``correct`` (unit); their means ``mean_log_score``,
        ``mean_brier_score`` and ``accuracy``, each with a standard error (``…_se``);
        ``expected_calibration_error`` (forecast), and the table behind it, (forecast, bin):
        ``count``, ``predicted_probability`` (mean of the bin), ``observed_frequency`` and its
        Wilson interval from ``frequency_lower`` to ``frequency_upper``, all NaN where a bin is
        empty. The forecasts are ``"most probable class"``, whose error is the one that goes by the
        name in the literature, and those of each class against the others.

    Raises
    ------
    TypeError
        If the probabilities are no DataArray, or `bins` is no whole number.
    ValueError
        If there are no units or classes, the probabilities of a unit are not known or do not add
        up to 1, or a true class is missing or unknown.

    See Also
    --------
    plot_reliability : The figure that belongs to it.

    Notes
    -----
    The most probable class of a unit counts once, so that the binomial intervals hold if units are
    independent. Experiments on one specimen are not: classify by specimen, or take intervals and
    standard errors as too short. Between equal probabilities the first class is the one that
    counts.

    The calibration error is never negative: with few units in a bin it is large by chance alone.

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
    if not 0 < prob < 1:
        raise ValueError(f"prob must be a probability between 0 and 1, not {prob}")
    attrs = dict(getattr(probability, "attrs", {}))
    probability = _checked_probability(probability)
    unit = str(probability.dims[0])
    p, classes = probability.values, probability["class_label"].values.tolist()
    true = _checked_truth(truth, probability)
    rows = np.arange(len(p))
    with np.errstate(divide="ignore"):
        log_score = np.log(p[rows, true])
    brier_score = np.sum((p - np.eye(len(classes))[true]) ** 2, axis=1)
    top = p.argmax(axis=1)
    forecasts = {TOP_CLASS: (p[rows, top], top == true)}
    forecasts |= {str(name): (p[:, c], true == c) for c, name in enumerate(classes)}
    scores = {"log_score": log_score, "brier_score": brier_score, "correct": top == true}
    means = {}
    for name, values in scores.items():
        mean = "accuracy" if name == "correct" else f"mean_{name}"
        means[mean], means[f"{mean}_se"] = _mean(values.astype(float))
    edges = np.linspace(0, 1, bins + 1)
    table = xr.concat(
        [_reliability(*forecast, edges, prob) for forecast in forecasts.values()], dim="forecast"
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
        | {"prob": prob},
    )


def _checked_probability(probability: Any) -> xr.DataArray:
    """Probabilities by unit and class."""
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
            f"there are probabilities of {len(probability)} unit(s) and of the classes {classes}; "
            "expected one of each at least, and each class once"
        )
    for i, p in enumerate(probability.values):
        if not np.all((p >= 0) & (p <= 1 + _SUM_TOLERANCE)) or abs(p.sum() - 1) > _SUM_TOLERANCE:
            raise ValueError(
                f"{_name_of_unit(probability, i)}: the probabilities {p.tolist()} are not numbers "
                "between 0 and 1 that add up to 1"
                + (" (not classified: leave the unit out)" if np.isnan(p).any() else "")
            )
    return probability


def _checked_truth(truth: Any, probability: xr.DataArray) -> NDArray[np.int64]:
    """Index of the true class of each unit."""
    unit, classes = probability.dims[0], probability["class_label"].values.tolist()
    if isinstance(truth, xr.DataArray):
        for index in (unit,) if unit in truth.coords and unit in probability.coords else ():
            if truth[index].values.tolist() != probability[index].values.tolist():
                raise ValueError(f"probabilities and truth differ in {index!r}, or in its order")
        truth = truth.values
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


def _name_of_unit(probability: xr.DataArray, row: int) -> str:
    """What a unit is called in a message."""
    unit = str(probability.dims[0])
    names = [n for n in ("specimen", "experiment") if n in probability.coords]
    names = [n for n in names if probability[n].dims == (unit,)] or [unit]
    known = [n for n in names if n in probability.coords]
    described = ", ".join(f"{n} {probability[n].values.tolist()[row]!r}" for n in known)
    return described or f"{unit} {row}"


def _mean(values: Array) -> tuple[float, float]:
    """Mean of the scores of units, and its standard error where there is one."""
    mean = float(np.mean(values))
    if len(values) == 1 or not np.isfinite(mean):
        return mean, np.nan
    return mean, float(np.std(values, ddof=1) / np.sqrt(len(values)))


def _reliability(p: Array, came_true: NDArray[np.bool_], edges: Array, prob: float) -> xr.Dataset:
    """Predicted and observed frequencies of one forecast, by bin."""
    place = np.searchsorted(edges[1:-1], p)
    count, hits = (np.bincount(place, w, len(edges) - 1).astype(int) for w in (None, came_true))
    total = np.bincount(place, p, len(edges) - 1)
    interval = np.full((len(count), 2), np.nan)
    for m in np.flatnonzero(count):
        interval[m] = binomtest(int(hits[m]), int(count[m])).proportion_ci(prob, "wilson")
    filled = np.where(count > 0, count, np.nan)
    columns = {
        "count": count,
        "predicted_probability": total / filled,
        "observed_frequency": hits / filled,
        "frequency_lower": interval[:, 0],
        "frequency_upper": interval[:, 1],
    }
    return xr.Dataset({name: ("bin", values) for name, values in columns.items()})
