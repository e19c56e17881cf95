"""Technical diagnosis of fitted classes and sampled models in a report, and its warnings."""

from contextlib import suppress

import numpy as np
import pandas as pd
import xarray as xr
from arviz_stats import summary

from pymc_hyperelastic.data.select import warn_of_repeats
from pymc_hyperelastic.evidence.convergence import DIGITS, LARGEST_RHAT, divergence
from pymc_hyperelastic.evidence.diagnosis import diagnose_evidence, judgement, log_evidence
from pymc_hyperelastic.evidence.importance import LARGEST_PARETO_K
from pymc_hyperelastic.evidence.stored import read_json
from pymc_hyperelastic.evidence.verdicts import VERDICTS
from pymc_hyperelastic.models.settings import holds_inflation_data, inflation_data_of
from pymc_hyperelastic.predictions.members import specimens_differ
from pymc_hyperelastic.reports.fits import classes_of, of_class, tubes_in, unknowns_of
from pymc_hyperelastic.reports.meanings import NATS, PARETO_K
from pymc_hyperelastic.reports.measurements import warn_of_simulated
from pymc_hyperelastic.reports.page import BAD, CAUTION, NOTE, PROB, Page
from pymc_hyperelastic.rounding import ROUNDING, short

_LEVELS = dict(zip(VERDICTS, (NOTE, CAUTION, BAD), strict=True))
_MORE = "Sample again with more draws and chains"
# Checks of an evidence: the value, and the advice if it fails, unless the warning holds the advice.
_CHECKS = {
    "chains": ("standard deviation of the log evidences of the chains, nats", _MORE),
    "R-hat": ("largest R-hat of the unknowns: 1 if all chains found the same posterior", _MORE),
    "moves": ("fraction of steps at which the draws stayed near their places", _MORE),
    "ancestors": ("smallest fraction of the first draws from which the last ones come", _MORE),
    "prior's side": ("gain of the log evidence by a second run, from the prior, nats", _MORE),
    "modes": ("gain of the log evidence by a second run, from its modes, nats", _MORE),
    "search": ("fraction of a second run that lies where the chains hardly looked", _MORE),
    "bounds": ("fraction of the posterior at a bound of its prior", ""),
    "limits": ("fraction of the posterior within 1 % of a limit of its prior", ""),
    "residuals": (
        "probability, if the model is right, of a best curve that is as far from the data",
        "Look at the figures of the fit. Then try another law, state larger measurement errors, or "
        'fit with variability="specimen"',
    ),
    "parameters": ("number of material parameters; the limit is that of measured values", ""),
    "curves": ("error of the computed curves, relative to their largest value", ""),
    "specimens": (
        "error due to the draws that stand for the specimens, nats",
        "Look at the data of this specimen, or fit again with more draws",
    ),
    "weights": ("largest Pareto k of the weights", _MORE),
}


def _subject(name: str, page: Page) -> str:
    return name if name == page.title else f"{page.title}, class {name}"


def show_diagnosis(result: xr.DataTree, page: Page) -> None:
    """Add evidences, the checks of their diagnosis, and convergence; add notices on a fit."""
    _check(result, page)
    classes = classes_of(result, page)
    evidences, checks, specimens, summaries = [], [], [], []
    for name, tree in classes.items():
        with suppress(ValueError):  # a result without evidence: see _check_evidence
            diagnosis = diagnose_evidence(tree)
            evidences.append([name, log_evidence(tree), diagnosis.attrs["verdict"]])
            for check in diagnosis["check"].values.tolist():
                own = diagnosis.sel(check=check)
                numbers = [own[n].item() for n in ("value", "limit", "verdict")]
                checks.append([check, name, *numbers, _CHECKS.get(check, [""])[0]])
        if specimens_differ(tree) and "specimens" in tree.children:
            names = "specimen pareto_k standard_error method"
            specimens.append(of_class(name, tree["specimens"].to_dataset(), names))
        summaries.append(_convergence(name, tree, page))
    columns = ["class", "log evidence (nats)", "verdict"]
    page.table("Evidence", pd.DataFrame(evidences, columns=columns, dtype=object), NATS)
    columns = ["check", "class", "value", "limit", "verdict", "what the value is"]
    page.table(
        "Checks of the evidence",
        pd.DataFrame(checks, columns=columns, dtype=object),
        "A value is good up to its limit; for ancestors and residuals, from its limit on.",
    )
    page.table(
        "Convergence of the chains",
        pd.concat(summaries),
        "Effective sample sizes, of the middle and of the tails of the posterior, count the draws "
        "as if they were independent. R-hat is 1 if all chains found the same posterior; up to "
        f"{LARGEST_RHAT} is good.",
    )
    if specimens:
        page.table("Integral over the parameters of each specimen", pd.concat(specimens), PARETO_K)


def _convergence(name: str, tree: xr.DataTree, page: Page) -> pd.DataFrame:
    """Return R-hat and effective sample sizes of all unknowns, and add notices on them."""
    posterior = unknowns_of(tree)
    finite = posterior.where(np.isfinite(posterior))
    table = summary(finite, ci_prob=PROB, ci_kind="eti", round_to="none", skipna=True)
    _check_convergence(_subject(name, page), posterior, table, page)
    headings = {
        "ess_bulk": "effective sample size",
        "ess_tail": "effective sample size, tails",
        "r_hat": "R-hat",
    }
    frame = table[[*headings]].rename(columns=headings)
    frame.iloc[:, :2] = frame.iloc[:, :2].round()
    frame.insert(0, "parameter", frame.index)
    frame.insert(1, "class", name)
    return frame


def _check(result: xr.DataTree, page: Page) -> None:
    """Add notices on missing classes, evidences, chains, specimens and pooling."""
    classes = classes_of(result, page)
    for name, reason in read_json(result, "missing_classes", {}).items():
        todo = "Correct this and fit again: all other results leave the class out"
        page.notice(BAD, f"class {name} is missing: {reason}", todo)
    for name, tree in classes.items():
        subject = _subject(name, page)
        if holds_inflation_data(tree):
            warn_of_simulated(tree["constant_data"].attrs, page)
            with page.catching(subject):
                warn_of_repeats(inflation_data_of(tree))
        _check_evidence(subject, tree, page)
        for words in divergence(tree):
            page.notice(CAUTION, words, "", subject)
        if tree["posterior"].sizes["chain"] == 1:
            words = "there is only one chain: convergence cannot be checked"
            page.notice(NOTE, words, "Sample again with chains=4", subject)
        if "specimens" in tree.children:
            _check_specimens(tree["specimens"].to_dataset(), subject, page)
    pooled = [t for t in classes.values() if holds_inflation_data(t) and not specimens_differ(t)]
    if any(len(np.unique(inflation_data_of(tree)["specimen"])) > 1 for tree in pooled):
        page.notice(
            NOTE,
            "all specimens of a class share one set of parameters. However different the "
            "specimens are, the posterior becomes narrower with more data, and class probabilities "
            "are overconfident",
            'Fit with variability="specimen", unless the specimens are known to be equal',
        )


def _check_specimens(specimens: xr.Dataset, subject: str, page: Page) -> None:
    """Add notices on specimens whose integral failed, or depends on a few draws."""
    names, infinite = specimens["specimen"], ~np.isfinite(specimens["standard_error"])
    heavy = (specimens["pareto_k"] >= LARGEST_PARETO_K) & ~infinite
    todo = _CHECKS["specimens"][1]
    page.notice_where(BAD, "the integral of a specimen failed", todo, names, infinite, subject)
    words = f"a few weights dominate an integral (Pareto k of {LARGEST_PARETO_K} or more)"
    page.notice_where(CAUTION, words, "Fit again with more draws", names, heavy, subject)


def _check_evidence(subject: str, tree: xr.DataTree, page: Page) -> None:
    try:
        diagnosis = diagnose_evidence(tree)
    except ValueError:
        page.notice(
            NOTE,
            "the result holds no evidence, and no diagnosis of it",
            "To compare laws, sample with ph.sample_smc, or use ph.bridge_sampling",
            subject,
        )
        return
    verdict = diagnosis.attrs["verdict"]
    if words := judgement(diagnosis):
        failed = diagnosis["check"].values[diagnosis["verdict"].values == verdict].tolist()
        todo = dict.fromkeys(_CHECKS[name][1] for name in failed if name in _CHECKS)
        page.notice(_LEVELS[verdict], words, ". ".join(filter(None, todo)), subject)
    if holds_inflation_data(tree) and "residuals" not in diagnosis["check"].values:
        page.complete = False
        page.notice(
            NOTE,
            "the report cannot test whether the curves fit the data within the measurement errors: "
            "the size of the errors was inferred from the same data, or the result is of another "
            "version",
            "Look at the figures of the fit. If the errors are known, state them, as in "
            f"ph.Gaussian({'pressure_sd=0.3' if tubes_in(tree) is not None else 'stress_sd=5.0'})",
            subject,
        )
    if not np.isfinite(log_evidence(tree).standard_error) and verdict != VERDICTS[-1]:
        page.notice(BAD, "the standard error of the log evidence is infinite", _MORE, subject)


def _check_convergence(
    subject: str, posterior: xr.Dataset, table: pd.DataFrame, page: Page
) -> None:
    for name, draws in posterior.data_vars.items():
        if not np.isfinite(draws).all():
            words = f"some draws of {name} are not finite"
            page.notice(BAD, words, "Give a narrower prior, and sample again", subject)
    varies = table["sd"] > ROUNDING * table["mean"].abs()
    rhat = table.loc[varies, "r_hat"].dropna()
    if len(rhat):
        worst = rhat.round(DIGITS).idxmax()
        if rhat[worst] > LARGEST_RHAT:
            words = (
                "the chains have met different parts of the posterior: R-hat of "
                f"{worst} is {short(rhat[worst])}"
            )
            page.notice(CAUTION, words, _MORE, subject)
