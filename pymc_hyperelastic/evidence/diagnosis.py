"""The evidence of a result, and how far it can be trusted."""

import warnings
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import xarray as xr
from arviz_stats.base import array_stats
from scipy.stats import chi2

from pymc_hyperelastic.evidence.convergence import DIGITS, LARGEST_RHAT
from pymc_hyperelastic.evidence.estimate import Estimate, combine_chains
from pymc_hyperelastic.evidence.mixture import Array
from pymc_hyperelastic.evidence.results import check_result
from pymc_hyperelastic.evidence.tempering import stayed
from pymc_hyperelastic.files.place import PACKAGE
from pymc_hyperelastic.files.stored import (
    check_numbers,
    damaged,
    is_number,
    read_draws,
    read_group,
    read_number,
    read_numbers,
)
from pymc_hyperelastic.parallel import one_thread

# Nats by which two ways to an evidence may differ whatever their errors, and the number of errors.
_NATS, _ERRORS = 0.3, 4.0
# Chains whose spread chance explains less often than this are apart.
_CHANCE = 1e-3
# R-hat from which chains certainly have not met the same posterior.
_APART_RHAT = 1.2
# Fractions of the first particles that have descendants in the end: of fewer a chain knows little,
# and nothing; and with so many it has hardly lost any.
_FEW_ANCESTORS, _TOO_FEW_ANCESTORS, _MANY_ANCESTORS = 0.03, 0.01, 0.15
# Fraction of stages at which particles may have moved too little.
_MOST_CAPPED = 0.5
# Pareto shape of the weights up to which their mean converges at a rate that is worth its draws.
_LARGEST_SHAPE = 0.7
# Share of the posterior within 1 % of a limit of a prior from which the limit decides about it.
_MOST_AT_LIMIT = 0.5
# Residuals as large as those of a right model are once in so many studies; it is corrected for the
# number of tests and signals.
_CHANCE_OF_RESIDUALS = 2e-3
# Largest share of other particles where the reference has too few draws, for a good evidence. Few
# particles may stand for much mass: three change points with 0.024 were wrong by 0.9 nats. Some
# right models have 0.02, heavy tails 0.08: they are doubted in vain.
_MOST_UNMET = 0.01
# The same for a doubtful evidence. Three change points, of whose six modes some were missing, had
# 0.3 to 1 in most runs.
_MODE_UNMET = 0.1
# Share of the posterior at bounds up to which it is a part of the error, in nats.
_MOST_AT_BOUNDS = 0.1
# What curves may err, relative to the largest value of each: with errors of a hundredth of that a
# log density of a hundred points is then right to a thousandth.
CURVES_ERR = 1e-6
# Verdicts from good to bad.
VERDICTS = ("good", "doubtful", "not to be trusted")
_GOOD, _DOUBTFUL, _BAD = range(3)
# Checks that compare the model with its data, where the evidence itself may be right.
_OF_THE_FIT = ("limits", "residuals")
_INSTEAD = (
    "; another way is NUTS and ph.log_evidence_by_bridge, for classes of specimens that differ "
    "ph.fit_classes"
)


# What is stored of an evidence, by chain or of all of them; two that are nothing without another.
_NEEDED = ("log_evidence", "log_evidence_se")
_EVIDENCE: dict[str, tuple[str, ...]] = {
    **dict.fromkeys((*_NEEDED, "moves", "ancestors", "pareto_k"), ("chain",)),
    **dict.fromkeys(("forward", "forward_se", "at_modes", "at_modes_se"), ()),
    **dict.fromkeys(("specimens_se", "curve_error", "at_bounds", "unmet"), ()),
    "at_limit": ("limit",),
    **dict.fromkeys(("chi_square", "points"), ("test", "signal")),
}
_TOGETHER = {
    "ancestors": "moves",
    "points": "chi_square",
    "chi_square": "points",
    "forward_se": "forward",
    "at_modes_se": "at_modes",
}


class _Check(NamedTuple):
    """What was compared, by how much it differs and may differ, and what follows."""

    name: str
    value: float
    limit: float
    verdict: int
    words: str


def log_evidence(tree: xr.DataTree) -> Estimate:
    r"""Log evidence (log marginal likelihood) of a sampled model, with its standard error.

    The evidences of independent chains are averaged. The relative variance of one chain is
    estimated within the chains (see :class:`BatchedSMC`), unless they differ more from each other
    than one time in a hundred by chance: then it is that of their spread. It is infinite where
    :func:`diagnose_evidence` finds that the evidence is not to be trusted.

    Parameters
    ----------
    tree : xarray.DataTree
        Result of :func:`sample_smc`, or one class of :func:`pymc_hyperelastic.fit_classes`.

    Returns
    -------
    Estimate
        The pair (value, standard error), in nats.

    Raises
    ------
    ValueError
        If the result holds no evidence.

    See Also
    --------
    diagnose_evidence, log_evidence_by_bridge

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> tree = ph.open_result("sampled.nc")  # saved from the example of sample_smc
    >>> value, standard_error = ph.log_evidence(tree)
    """
    evidence = _evidence_of(tree)
    estimate = combine_chains(evidence["log_evidence"].values, evidence["log_evidence_se"].values)
    # What all chains have in common no mean of theirs removes.
    common = float(evidence["specimens_se"]) if "specimens_se" in evidence else 0.0
    if "at_bounds" in evidence:
        # As if all of it were missing, which it is not: particles move towards the bounds.
        common = float(np.hypot(common, np.exp(float(evidence["at_bounds"]) - estimate.value)))
    if diagnose_evidence(tree).attrs["verdict"] == VERDICTS[_BAD]:
        common = np.inf
    return Estimate(estimate.value, float(np.hypot(estimate.standard_error, common)))


@one_thread
def diagnose_evidence(tree: xr.DataTree) -> xr.Dataset:
    """How far the evidence of a result can be trusted, and what that rests on.

    Compared are, as far as the result holds them:

    ``"chains"``
        The spread of the chains' log evidences, with what their errors explain one time in a
        thousand.
    ``"R-hat"``
        Whether the chains have met the same posterior: the largest R-hat of the unknowns.
    ``"moves"``
        The fraction of stages at which the particles had not forgotten their places after
        ``max_moves``.
    ``"ancestors"``
        The smallest fraction of a chain's first particles that have descendants in the end.
    ``"prior's side"``
        By how many nats the evidence from tempering from the prior alone is larger. Evidences that
        are too low by far are common, since mass may be missed; too high by far they never are.
    ``"modes"``
        By how many nats that from the modes, which were climbed to, is larger.
    ``"search"``
        The share of other particles, led from the prior alone, that are where chains began with
        hardly any.
    ``"bounds"``
        The share of the posterior that is at a bound of the prior, where no particle arrives.
    ``"limits"``
        The share of the posterior within 1 % of a limit of a prior, other than 0 from above.
    ``"residuals"``
        The probability of residuals as large as those of the best curve of some test and signal, or
        specimen, under the noise that is stated or inferred.
    ``"curves"``
        By how much curves of the posterior err, relative to the largest value of each: they are
        made exact over the range of the priors.
    ``"specimens"``
        The error of a class's evidence by the draws that stand for its specimens: it is infinite
        if one of them was given up, or has curves that are wrong.
    ``"weights"``
        The Pareto shape of the weights, where the evidence is a mean of them.

    A mode that none of the chains and climbs has met cannot be found out: narrower than about a
    tenth of the others in each of four unknowns, it is a needle.

    Parameters
    ----------
    tree : xarray.DataTree
        Result of :func:`sample_smc`, of ``pm.sample_smc(kernel=ph.BatchedSMC)``, or one class of
        :func:`pymc_hyperelastic.fit_classes`.

    Returns
    -------
    xarray.Dataset
        By ``check``: ``value``, ``limit`` (the largest value that is good; of "ancestors" and
        "residuals" the smallest), ``verdict`` ("good", "doubtful" or "not to be trusted") and
        ``words``. Its attributes ``verdict`` and ``words`` say the worst, and why.

    Raises
    ------
    TypeError, ValueError
        If `tree` is no result, or has no evidence.

    See Also
    --------
    log_evidence, log_evidence_by_bridge

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> tree = ph.open_result("sampled.nc")  # saved from the example of sample_smc
    >>> ph.diagnose_evidence(tree).attrs["verdict"]
    'good'
    """
    evidence = _evidence_of(tree)
    if "diagnosis" in tree.children:
        said = _stored_diagnosis(tree)
        # Older ones do not say so where nothing is known of a specimen.
        if np.isfinite(evidence.get("specimens_se", 0.0)) or "specimens" in said["check"].values:
            return said
    values, errors = evidence["log_evidence"].values, evidence["log_evidence_se"].values
    total = combine_chains(values, errors)
    checks = _checks_of_chains(tree, values, errors)
    if "moves" in evidence:
        alive, share = float(np.min(evidence["ancestors"])), float(np.mean(evidence["moves"]))
        # Where most of the first particles are left, it does not matter how far they have moved.
        limit = 1.0 if alive > _MANY_ANCESTORS else _MOST_CAPPED
        words = f"particles had not forgotten their places at {share:.0%} of the stages"
        checks.append(_Check("moves", share, limit, _worse(share, limit, 1.0), words))
        verdict = _worse(-alive, -_FEW_ANCESTORS, -_TOO_FEW_ANCESTORS)
        words = f"all particles of a chain come from {alive:.1%} of the first ones"
        checks.append(_Check("ancestors", alive, _FEW_ANCESTORS, verdict, words))
    for name, of in (("prior's side", "forward"), ("modes", "at_modes")):
        if of in evidence and np.isfinite(evidence[f"{of}_se"]):
            gap = float(evidence[of]) - total.value
            error = float(np.hypot(evidence[f"{of}_se"], total.standard_error))
            limit = max(_NATS, _ERRORS * error)
            words = f"the evidence from the {name} is larger by {gap:.2f} nats: mass is missing"
            checks.append(_Check(name, gap, limit, _BAD if gap > limit else _GOOD, words))
    if "unmet" in evidence:
        share = float(evidence["unmet"])
        words = (
            f"{share:.0%} of other particles, led from the prior alone, are where chains began "
            "with hardly any: a mode may be missing"
        )
        verdict = _worse(share, _MOST_UNMET, _MODE_UNMET)
        checks.append(_Check("search", share, _MOST_UNMET, verdict, words))
    if "at_bounds" in evidence:
        share = float(np.exp(evidence["at_bounds"] - total.value))
        words = (
            f"{share:.0%} of the posterior lies where numbers are rounded to a bound of their "
            "prior, and may be missing: give a prior with less mass at its bounds"
        )
        verdict = _BAD if share > _MOST_AT_BOUNDS else _GOOD
        checks.append(_Check("bounds", share, _MOST_AT_BOUNDS, verdict, words))
    checks += _checks_of_fit(evidence)
    # Of specimens with a noise of their own the residuals are what that noise is.
    if "specimens" in tree.children and not tree["specimens"].sizes.get("noise", 1):
        fits = tree["specimens"].to_dataset()
        checks.append(_check_of_residuals(fits["misfit"], fits["freedom"]))
    if "curve_error" in evidence:
        error = float(evidence["curve_error"])
        words = (
            f"curves err by {error:.0e} of their largest value: the posterior is where priors "
            "hardly expect the material, and curves were not made exact there; give wider priors, "
            "or mode='quadrature'"
        )
        verdict = _BAD if error > CURVES_ERR else _GOOD
        checks.append(_Check("curves", error, CURVES_ERR, verdict, words))
    if "specimens_se" in evidence:
        error = float(evidence["specimens_se"])
        words = (
            "what is known of a specimen may be wrong: it was given up after long, or its curves "
            "are wrong where its material is"
        )
        verdict = _GOOD if error < np.inf else _BAD
        checks.append(_Check("specimens", error, np.inf, verdict, words))
    if "pareto_k" in evidence and not np.isnan(evidence["pareto_k"]).all():
        shape = float(np.nanmax(evidence["pareto_k"]))
        words = f"a few weights decide: their Pareto shape is {shape:.2f}"
        verdict = _worse(shape, _LARGEST_SHAPE, np.finfo(float).max)
        checks.append(_Check("weights", shape, _LARGEST_SHAPE, verdict, words))
    return _as_dataset(checks)


def doubts_of_fit(evidence: xr.Dataset) -> str:
    """What is doubtful about how a model fits its data; empty if nothing is."""
    return "; ".join(check.words for check in _checks_of_fit(evidence) if check.verdict)


def _checks_of_fit(evidence: xr.Dataset) -> list[_Check]:
    """What is known of the limits of priors, and of the residuals of the best curve."""
    checks = []
    if evidence.sizes.get("limit"):
        worst = int(evidence["at_limit"].values.round(DIGITS).argmax())
        share, where = float(evidence["at_limit"][worst]), evidence["limit"].values[worst]
        words = (
            f"{share:.0%} of the posterior is within 1 % of the {where}: give a wider prior, or "
            "look for what is wrong with the data"
        )
        verdict = _DOUBTFUL if share > _MOST_AT_LIMIT else _GOOD
        checks.append(_Check("limits", share, _MOST_AT_LIMIT, verdict, words))
    if "chi_square" in evidence:
        checks.append(_check_of_residuals(evidence["chi_square"], evidence["points"]))
    return checks


def _check_of_residuals(squares: xr.DataArray, freedom: xr.DataArray) -> _Check:
    """Whether some test, or specimen, is further from its best curve than the noise explains."""
    # Bonferroni's correction; without points there is no chance, and the least is of another test.
    chances = chi2.sf(squares, freedom) * int((freedom.values > 0).sum())
    chances = np.where(np.isfinite(chances), chances, 1.0).clip(0, 1)
    at = np.unravel_index(int(np.argmin(chances)), chances.shape)
    chance, more = float(chances[at]), int((chances < _CHANCE_OF_RESIDUALS).sum()) - 1
    labels = [str(squares[dim].values[i]) for dim, i in zip(squares.dims, at, strict=True)]
    where = ", ".join(labels) if "test" in squares.dims else f"specimen {labels[0]!r}"
    words = (
        f"the best curve is further from the data than the noise explains in {where}"
        f"{f' and in {more} more' if more > 0 else ''}: the squared residuals are "
        f"{float(squares.values[at]):.3g} variances of the noise, and about "
        f"{float(freedom.values[at]):.3g} are expected. The law does not fit, the noise is larger, "
        "specimens that share one material differ, or something is wrong with the data"
    )
    verdict = _DOUBTFUL if chance < _CHANCE_OF_RESIDUALS else _GOOD
    return _Check("residuals", chance, _CHANCE_OF_RESIDUALS, verdict, words)


def check_evidence(tree: xr.DataTree) -> None:
    """Raise unless the evidence of a result can be read, and what is said of it."""
    _evidence_of(tree)
    if "diagnosis" in tree.children:
        _stored_diagnosis(tree)


def _stored_diagnosis(tree: xr.DataTree) -> xr.Dataset:
    """The diagnosis as it was taken."""
    said = tree["diagnosis"].to_dataset()
    verdict, words = (said.attrs.get(name) for name in ("verdict", "words"))
    if not isinstance(verdict, str) or verdict not in VERDICTS or not isinstance(words, str):
        raise damaged(
            tree, f"its diagnosis has the verdict {verdict!r}; expected one of {list(VERDICTS)}"
        )
    return said


def with_diagnosis(tree: xr.DataTree) -> xr.DataTree:
    """The result with its diagnosis, which is taken once."""
    tree["diagnosis"] = diagnose_evidence(tree)
    return tree


def warn_of_evidence(tree: xr.DataTree, of: str = "") -> None:
    """Warn who called the caller if the diagnosis of a result is not good."""
    if said := judgement(diagnose_evidence(tree)):
        warnings.warn(f"{of}{said}", skip_file_prefixes=(PACKAGE,))


def judgement(diagnosis: xr.Dataset) -> str:
    """A sentence on what is doubtful, the evidence or the fit, and why; empty if all is good."""
    verdict, words = diagnosis.attrs["verdict"], diagnosis.attrs["words"]
    if verdict == VERDICTS[_GOOD]:
        return ""
    of_fit = set(_names_of(diagnosis, verdict)) <= set(_OF_THE_FIT)
    return f"the {'fit' if of_fit else 'evidence'} is {verdict}: {words}"


def _names_of(diagnosis: xr.Dataset, verdict: str) -> list[str]:
    """The checks with this verdict; older results do not hold them all."""
    if not {"check", "verdict"} <= {*map(str, diagnosis.variables)}:
        return [""]
    return [*diagnosis["check"].values[diagnosis["verdict"].values == verdict].tolist()]


def worst_verdict(trees: Iterable[xr.DataTree]) -> str:
    """The worst of the verdicts about some results."""
    return worst_of(diagnose_evidence(tree).attrs["verdict"] for tree in trees)


def worst_of(verdicts: Iterable[str]) -> str:
    """The worst of some verdicts; an empty one says nothing."""
    return max(verdicts, key=("", *VERDICTS).index)


def _checks_of_chains(tree: xr.DataTree, values: Array, errors: Array) -> list[_Check]:
    if not np.isfinite([*values, *errors]).all():
        words = (
            "a chain has failed, or went on in haste after many stages at which its particles had "
            "not forgotten their places"
        )
        return [_Check("chains", np.inf, 0.0, _BAD, words)]
    if len(values) == 1:
        return []
    spread = float(np.std(values, ddof=1))
    explained = chi2.isf(_CHANCE, len(values) - 1) / (len(values) - 1)
    limit = float(np.sqrt(np.mean(errors**2) * explained))
    words = f"chains are {np.ptp(values):.2f} nats apart, more than their errors explain"
    checks = [_Check("chains", spread, limit, _worse(spread, limit, max(limit, _NATS)), words)]
    group = "unconstrained_posterior"
    if group in tree.children:
        rhat = {}
        for name in map(str, read_draws(tree, group).data_vars):
            draws = read_numbers(tree, group, name, None, finite=False)
            draws = draws.transpose("chain", "draw", ...).values
            rhat[name] = float(np.max(array_stats.rhat(draws, chain_axis=0, draw_axis=1)))
        worst = max(rhat, key=lambda name: round(rhat[name], DIGITS))
        words = f"chains met different parts of the posterior: R-hat of {worst} {rhat[worst]:.2f}"
        verdict = _worse(rhat[worst], LARGEST_RHAT, _APART_RHAT)
        checks.append(_Check("R-hat", rhat[worst], LARGEST_RHAT, verdict, words))
    return checks


def _worse(value: float, good: float, bad: float) -> int:
    """Verdict of a value that should be small; what is no number is bad."""
    if value <= good:
        return _GOOD
    return _DOUBTFUL if value <= bad else _BAD


def _as_dataset(checks: list[_Check]) -> xr.Dataset:
    worst = max((check.verdict for check in checks), default=_GOOD)
    said = [check for check in checks if check.verdict == worst]
    instead = "" if {c.name for c in said} <= {"specimens", *_OF_THE_FIT} else _INSTEAD
    words = "; ".join(check.words for check in said) + instead
    columns = {
        "value": np.array([check.value for check in checks]),
        "limit": np.array([check.limit for check in checks]),
        "verdict": np.array([VERDICTS[check.verdict] for check in checks]),
        "words": np.array([check.words if check.verdict else "" for check in checks]),
    }
    return xr.Dataset(
        {name: ("check", column) for name, column in columns.items()},
        {"check": [check.name for check in checks]},
        {"verdict": VERDICTS[worst], "words": words if worst else "nothing is against it"},
    )


def _evidence_of(tree: xr.DataTree) -> xr.Dataset:
    """What a result says of its evidence, by chain."""
    check_result(tree)
    if "evidence" in tree.children:
        evidence = read_group(tree, "evidence")
        for name, dims in _EVIDENCE.items():
            partner = _TOGETHER.get(name)
            if name in evidence or name in _NEEDED or partner in evidence:
                check_numbers(tree, evidence, name, dims, " of 'evidence'", finite=False)
        return evidence
    stats = tree.get("sample_stats", xr.DataTree()).to_dataset()
    if "log_evidence_variance" in stats and "stage" not in stats.dims:
        return _evidence_of_pymc(tree, stats)
    raise ValueError(
        f"the result has no evidence; its groups are {sorted(tree.children)}. It comes from "
        "ph.sample_smc or ph.fit_classes (for a class: ph.log_evidence(classes['C1']))"
    )


def _evidence_of_pymc(tree: xr.DataTree, stats: xr.Dataset) -> xr.Dataset:
    """The same from what PyMC's driver stores of the kernel: a list of stages for each chain."""

    def of_chains(name: str) -> list[Array]:
        found = []
        for stages in stats[name].values if name in stats and stats[name].ndim else []:
            numbers = np.atleast_1d(np.asarray(stages, object)).tolist()
            found.append(np.array([x for x in numbers if is_number(x)], float))
        if not found or not all(np.isfinite(stages).any() for stages in found):
            raise damaged(tree, f"{name!r} of 'sample_stats' holds no stages, or no numbers")
        return found

    def last(name: str) -> Array:
        return np.array([stages[~np.isnan(stages)][-1] for stages in of_chains(name)])

    settings = {name: read_number(stats, name) for name in ("max_moves", "_n_draws")}
    capped = stayed(np.concatenate(of_chains("moves")), settings["max_moves"])
    return xr.Dataset(
        {
            "log_evidence": ("chain", last("log_marginal_likelihood")),
            "log_evidence_se": ("chain", np.sqrt(last("log_evidence_variance"))),
            "ancestors": ("chain", last("ancestors") / settings["_n_draws"]),
            "moves": ("chain", np.full(len(of_chains("moves")), capped.mean())),
        }
    )
