"""The evidence of a result, and a diagnosis of how far it can be trusted."""

import warnings
from collections.abc import Iterable

import numpy as np
import xarray as xr

from pymc_hyperelastic.evidence.convergence import (
    DIGITS,
    LARGEST_DEVIATION,
    LARGEST_RHAT,
    largest_rhat,
)
from pymc_hyperelastic.evidence.estimate import Estimate, combine_chains, largest_spread
from pymc_hyperelastic.evidence.importance import LARGEST_RELIABLE_K
from pymc_hyperelastic.evidence.mixture import Array
from pymc_hyperelastic.evidence.stored import read_draws, read_numbers
from pymc_hyperelastic.evidence.stored_evidence import evidence_of, stored_diagnosis
from pymc_hyperelastic.evidence.verdicts import (
    BAD,
    DOUBTFUL,
    GOOD,
    Check,
    check_small,
    registered_checks,
    worst_of,
)
from pymc_hyperelastic.messages import PACKAGE
from pymc_hyperelastic.parallel import one_thread

# Nats by which two evidences may differ whatever their errors.
_NATS = 0.3
# Fraction of the first particles with descendants above which it does not matter how far particles
# have moved.
_MANY_ANCESTORS = 0.15
# The largest value of each check that is good, and the largest that is doubtful; of "ancestors" the
# smallest values.
_LIMITS = {
    # From 1.2 chains have certainly not met the same posterior: chosen by experiment.
    "R-hat": (LARGEST_RHAT, 1.2),
    # The majority: of the stages at which particles moved too little.
    "moves": (0.5, 1.0),
    "ancestors": (0.03, 0.01),
    "weights": (LARGEST_RELIABLE_K, np.finfo(float).max),
    # Few particles may stand for much mass: three change points with 0.024 were wrong by 0.9 nats.
    # Some right models have 0.02, heavy tails 0.08 to 0.13: they are doubted in vain. Three change
    # points, of whose six modes some were missing, had 0.3 to 1 in most runs.
    "search": (0.01, 0.2),
    # The same share may be missing.
    "bounds": (0.2, 0.2),
    # Ten times the share of a uniform posterior. Exponents that data hardly determine have up to
    # 0.06 in docs/studies/misfits.py. A normal likelihood whose standard deviation is a tenth of
    # the prior's width, and whose centre is 1, 2 or 3 standard deviations beyond the limit, has
    # 0.14, 0.22 and 0.28; with a thirtieth, and the centre at the limit, 0.24.
    "limits": (0.1, 1.0),
}
_INSTEAD = (
    "; another method is NUTS with ph.bridge_sampling, or ph.fit_classes for classes whose "
    "specimens differ"
)


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
    diagnose_evidence, bridge_sampling

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> tree = ph.open_result("sampled.nc")  # saved from the example of sample_smc
    >>> value, standard_error = ph.log_evidence(tree)
    """
    evidence = evidence_of(tree)
    estimate = combine_chains(evidence["log_evidence"].values, evidence["log_evidence_se"].values)
    # An error that all chains share is not reduced by their mean.
    common = float(evidence["specimens_se"]) if "specimens_se" in evidence else 0.0
    if "at_bounds" in evidence:
        # As if all of it were missing, which it is not: particles move towards the bounds.
        common = float(np.hypot(common, np.exp(float(evidence["at_bounds"]) - estimate.value)))
    if diagnose_evidence(tree).attrs["verdict"] == BAD:
        common = np.inf
    return Estimate(estimate.value, float(np.hypot(estimate.standard_error, common)))


@one_thread
def diagnose_evidence(tree: xr.DataTree) -> xr.Dataset:
    """How far the evidence of a result can be trusted, and what that rests on.

    Compared are, as far as the result holds them:

    ``"chains"``
        The spread of the chains' log evidences, with what their errors explain one time in a
        hundred.
    ``"R-hat"``
        The largest R-hat of the unknowns: whether the chains have met the same posterior.
    ``"moves"``
        The fraction of stages at which the particles had not forgotten their places.
    ``"ancestors"``
        The smallest fraction of a chain's first particles that have descendants in the end.
    ``"prior's side"``, ``"modes"``
        By how many nats the evidence from tempering from the prior alone, or from the modes that
        optimisation has found, is larger. Evidences that are too low by far are common, since mass
        may be missed; too high by far they never are.
    ``"search"``
        The share of the particles of a second run from the prior that lie where the chains started
        with too few particles.
    ``"bounds"``
        The share of the posterior that is at a bound of the prior, where no particle arrives.
    ``"limits"``
        The share of the posterior within 1 % of a limit of a prior, other than 0 from above and the
        ends of the physical range of a fraction, an angle or a dispersion.
    ``"residuals"``
        The probability of residuals as large as those of the best curve of some test and signal, or
        specimen, under the noise that is stated or inferred.
    ``"parameters"``
        The number of material parameters, with the number of measured values.
    ``"curves"``
        The error of the posterior's curves, relative to the largest value of each.
    ``"specimens"``
        The error of a class's evidence by the draws that stand for its specimens: infinite if one
        of them was given up, or has curves that are wrong.
    ``"weights"``
        The Pareto shape of the weights, where the evidence is a mean of them.

    A mode that no chain and no optimisation has met cannot be found out, such as one that is
    narrower than about a tenth of the others in each of four unknowns.

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
    log_evidence, bridge_sampling

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> tree = ph.open_result("sampled.nc")  # saved from the example of sample_smc
    >>> ph.diagnose_evidence(tree).attrs["verdict"]
    'good'
    """
    evidence = evidence_of(tree)
    if "diagnosis" in tree.children:
        said = stored_diagnosis(tree)
        # A result of an earlier version does not say that a specimen was given up.
        if np.isfinite(evidence.get("specimens_se", 0.0)) or "specimens" in said["check"].values:
            return said
    values, errors = evidence["log_evidence"].values, evidence["log_evidence_se"].values
    checks = _checks_of_chains(tree, values, errors)
    checks += [*_checks_of_particles(evidence), *_checks_of_search(evidence)]
    checks += checks_of_limits(evidence)
    for registered in registered_checks:
        checks += registered.checks(tree, evidence)
    return _as_dataset(checks)


def _check(name: str, value: float, words: str) -> Check:
    return check_small(name, value, *_LIMITS[name], words)


def _checks_of_particles(evidence: xr.Dataset) -> list[Check]:
    """Compare how far particles moved, how many ancestors they have, and their weights."""
    checks = []
    if "stages_capped" in evidence:
        alive = float(np.min(evidence["ancestor_fraction"]))
        share = float(np.mean(evidence["stages_capped"]))
        # If most of the first particles are left, it does not matter how far they have moved.
        limit, most = _LIMITS["moves"]
        limit = most if alive > _MANY_ANCESTORS else limit
        words = f"at {share:.0%} of the stages, draws stayed near the places where they were"
        checks.append(check_small("moves", share, limit, most, words))
        words = f"all draws of a chain come from {alive:.1%} of its first draws"
        few, too_few = _LIMITS["ancestors"]
        verdict = GOOD if alive >= few else DOUBTFUL if alive >= too_few else BAD
        checks.append(Check("ancestors", alive, few, verdict, words))
    if "pareto_k" in evidence and not np.isnan(evidence["pareto_k"]).all():
        shape = float(np.nanmax(evidence["pareto_k"]))
        words = f"a few weights dominate the evidence: Pareto k is {shape:.2f}"
        checks.append(_check("weights", shape, words))
    return checks


def _checks_of_search(evidence: xr.Dataset) -> list[Check]:
    """Compare the evidence with those from the prior and the modes, and with other particles."""
    total = combine_chains(evidence["log_evidence"].values, evidence["log_evidence_se"].values)
    checks = []
    for name, of in (("prior's side", "forward"), ("modes", "at_modes")):
        if of in evidence and np.isfinite(evidence[f"{of}_se"]):
            gap = float(evidence[of]) - total.value
            error = float(np.hypot(evidence[f"{of}_se"], total.standard_error))
            limit = max(_NATS, LARGEST_DEVIATION * error)
            words = f"the evidence from the {name} is larger by {gap:.2f} nats: mass is missing"
            checks.append(check_small(name, gap, limit, limit, words))
    if (missing := 1 - float(evidence.get("forward_beta", 1.0))) > 0:
        words = (
            "the posterior is so far from the prior that tempering from the prior was given up, "
            "and the evidence was compared with no other: does a prior contradict the data, in its "
            "value, its width or its unit?"
        )
        checks.append(check_small("prior's side", missing, 0.0, 1.0, words))
    if "unmet" in evidence:
        share = float(evidence["unmet"])
        words = (
            f"{share:.0%} of the particles of a second run from the prior lie where the chains "
            "started with too few particles: a mode may be missing"
        )
        checks.append(_check("search", share, words))
    if "at_bounds" in evidence:
        share = float(np.nan_to_num(np.exp(evidence["at_bounds"] - total.value)))
        words = (
            f"{share:.0%} of the posterior lies where numbers are rounded to a bound of their "
            "prior, and may be missing: give a prior with less mass at its bounds"
        )
        checks.append(_check("bounds", share, words))
    return checks


def checks_of_limits(evidence: xr.Dataset) -> list[Check]:
    """Compare how much of the posterior is at limits of priors."""
    if not evidence.sizes.get("limit"):
        return []
    worst = int(evidence["at_limit"].values.round(DIGITS).argmax())
    share, where = float(evidence["at_limit"][worst]), evidence["limit"].values[worst]
    words = (
        f"{share:.0%} of the posterior is within 1 % of the {where}: give a wider prior, or "
        "look for an error in the data"
    )
    return [_check("limits", share, words)]


def with_diagnosis(tree: xr.DataTree) -> xr.DataTree:
    """The result with its diagnosis, which is taken once."""
    tree["diagnosis"] = diagnose_evidence(tree)
    return tree


def warn_of_evidence(tree: xr.DataTree, of: str = "") -> None:
    """Warn who called the caller if the diagnosis of a result is not good."""
    if said := judgement(diagnose_evidence(tree)):
        warnings.warn(f"{of}{said}", skip_file_prefixes=(PACKAGE,))


def judgement(diagnosis: xr.Dataset) -> str:
    """Return a sentence on the doubtful evidence, or fit, and the reason; empty if all is good."""
    verdict, words = diagnosis.attrs["verdict"], diagnosis.attrs["words"]
    if verdict == GOOD:
        return ""
    names = [""]
    if {"check", "verdict"} <= {*diagnosis.variables}:  # older results do not hold them all
        names = diagnosis["check"].values[diagnosis["verdict"].values == verdict].tolist()
    return f"the {'fit' if {*names} <= _about_fit() else 'evidence'} is {verdict}: {words}"


def _about_fit() -> set[str]:
    """Return the names of checks of how a model fits its data: the evidence may be right."""
    return {"limits", *(name for c in registered_checks for name in c.about_fit)}


def worst_verdict(trees: Iterable[xr.DataTree]) -> str:
    """The worst of the verdicts about some results."""
    return worst_of(diagnose_evidence(tree).attrs["verdict"] for tree in trees)


def _checks_of_chains(tree: xr.DataTree, values: Array, errors: Array) -> list[Check]:
    if not np.isfinite([*values, *errors]).all():
        words = (
            "a chain failed, or moved its draws only once per stage after many stages at which "
            "they stayed near the places where they were"
        )
        return [Check("chains", np.inf, 0.0, BAD, words)]
    if len(values) == 1:
        return []
    spread = float(np.std(values, ddof=1))
    limit = largest_spread(errors)
    words = (
        f"the log evidences of the chains differ by {np.ptp(values):.2f} nats, more than their "
        "errors explain"
    )
    checks = [check_small("chains", spread, limit, max(limit, _NATS), words)]
    group = "unconstrained_posterior"
    if group in tree.children:
        names, columns = [], []
        for name in map(str, read_draws(tree, group).data_vars):
            draws = read_numbers(tree, group, name, None, finite=False)
            draws = draws.transpose("chain", "draw", ...).values
            columns.append(draws.reshape(*draws.shape[:2], -1))
            names += columns[-1].shape[2] * [name]
        rhat, worst = largest_rhat(names, np.concatenate(columns, axis=2))
        words = f"chains met different parts of the posterior: R-hat of {worst} {rhat:.2f}"
        checks.append(_check("R-hat", rhat, words))
    return checks


def _as_dataset(checks: list[Check]) -> xr.Dataset:
    worst = worst_of([GOOD, *(check.verdict for check in checks)])
    said = [check for check in checks if check.verdict == worst]
    enough = _about_fit() | {name for c in registered_checks for name in c.with_advice}
    instead = "" if {c.name for c in said} <= enough else _INSTEAD
    words = "; ".join(check.words for check in said) + instead
    columns = {name: [getattr(c, name) for c in checks] for name in ("value", "limit", "verdict")}
    columns["words"] = [check.words if check.verdict != GOOD else "" for check in checks]
    return xr.Dataset(
        {name: ("check", column) for name, column in columns.items()},
        {"check": [check.name for check in checks]},
        {"verdict": worst, "words": words if worst != GOOD else "nothing is against it"},
    )
