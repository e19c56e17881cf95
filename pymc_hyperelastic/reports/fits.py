"""Fitted classes and sampled models in a report: diagnosis, fits and posteriors."""

from contextlib import suppress

import numpy as np
import pandas as pd
import xarray as xr
from arviz_stats import summary

from pymc_hyperelastic.evidence.convergence import DIGITS, LARGEST_RHAT, divergence
from pymc_hyperelastic.evidence.diagnosis import diagnose_evidence, judgement, log_evidence
from pymc_hyperelastic.evidence.importance import LARGEST_PARETO_K
from pymc_hyperelastic.evidence.stored import read_json
from pymc_hyperelastic.evidence.verdicts import VERDICTS
from pymc_hyperelastic.models.settings import inflation_data_of
from pymc_hyperelastic.plots.density import plot_parameter_density
from pymc_hyperelastic.plots.fit import plot_fit
from pymc_hyperelastic.plots.fitted_curves import signals_of
from pymc_hyperelastic.plots.residuals import knows_noise
from pymc_hyperelastic.plots.style import fitted_classes
from pymc_hyperelastic.predictions.members import specimens_differ, with_parameters
from pymc_hyperelastic.reports.measurements import show_measurements, warn_of_simulated
from pymc_hyperelastic.reports.page import (
    BAD,
    CAUTION,
    NOTE,
    Page,
    frame_of,
    short,
)
from pymc_hyperelastic.reports.settings import units_of

# Probability of the intervals and bands of a report.
PROB = 0.95
# Probabilities of the regions of a joint posterior.
_REGIONS = (0.5, PROB)
# Share of draws with the rarer sign above which the absolute value of a parameter is shown too.
_BOTH_SIGNS = 0.01
# Standard deviation of a constant, relative to it, that rounding may cause.
_ROUNDING = 1e-12
# Signals of a fit, in the titles of their figures.
_SIGNALS = {
    "pressure": "pressure",
    "stiffness": "slope of the pressure",
    "axial_force": "axial force",
    "extension_radius": "radius in extension tests",
    "extension_force": "axial force in extension tests",
}
_LEVELS = dict(zip(VERDICTS, (NOTE, CAUTION, BAD), strict=True))


def classes_of(result: xr.DataTree, page: Page) -> dict[str, xr.DataTree]:
    """Return the fitted classes by name; a sampled model has the title of the result."""
    return {page.title: result} if "posterior" in result.children else fitted_classes(result)


def has_data(tree: xr.DataTree) -> bool:
    """Return True if a result holds the inflation data to which it was fitted."""
    return "constant_data" in tree.children and "radius" in tree["constant_data"].data_vars


def _subject(name: str, page: Page) -> str:
    return name if name == page.title else f"{page.title}, class {name}"


def _check(result: xr.DataTree, page: Page) -> None:
    """Add notices on missing classes, evidences, chains, specimens and pooling."""
    classes = classes_of(result, page)
    for name, reason in read_json(result, "missing_classes", {}).items():
        page.notice(BAD, f"class {name} is missing: {reason}")
    for name, tree in classes.items():
        subject = _subject(name, page)
        if has_data(tree):
            warn_of_simulated(tree["constant_data"].attrs, page)
        _check_evidence(subject, tree, page)
        for words in divergence(tree):
            page.notice(CAUTION, words, subject)
        if tree["posterior"].sizes["chain"] == 1:
            page.notice(NOTE, "there is only one chain: convergence cannot be checked", subject)
        if "specimens" in tree.children:
            specimens = tree["specimens"].to_dataset()
            names, infinite = specimens["specimen"], ~np.isfinite(specimens["standard_error"])
            heavy = (specimens["pareto_k"] >= LARGEST_PARETO_K) & ~infinite
            page.notice_where(BAD, "the integral of a specimen failed", names, infinite, subject)
            words = f"a few weights dominate an integral (Pareto k of {LARGEST_PARETO_K} or more)"
            page.notice_where(CAUTION, words, names, heavy, subject)
    pooled = [t for t in classes.values() if has_data(t) and not specimens_differ(t)]
    if any(len(np.unique(inflation_data_of(tree)["specimen"])) > 1 for tree in pooled):
        page.notice(
            NOTE,
            "all specimens of a class share one set of parameters. However different the "
            "specimens are, the posterior becomes narrower with more data, and class probabilities "
            'are overconfident. variability="specimen" describes the differences',
        )


def _check_evidence(subject: str, tree: xr.DataTree, page: Page) -> None:
    try:
        diagnosis = diagnose_evidence(tree)
    except ValueError:
        page.notice(NOTE, "the result holds no evidence, and no diagnosis of it", subject)
        return
    verdict = diagnosis.attrs["verdict"]
    if words := judgement(diagnosis):
        page.notice(_LEVELS[verdict], words, subject)
    if has_data(tree) and "residuals" not in diagnosis["check"].values:
        page.complete = False
        page.notice(
            NOTE,
            "the result does not say whether curves fit the data within the noise, because the "
            "noise was inferred for each specimen, or because another version computed the result",
            subject,
        )
    if not np.isfinite(log_evidence(tree).standard_error) and verdict != VERDICTS[-1]:
        page.notice(BAD, "the standard error of the log evidence is infinite", subject)


def show_evidence(result: xr.DataTree, page: Page) -> None:
    """Add the evidence of each class, and the checks of its diagnosis; add notices on a fit."""
    _check(result, page)
    evidences, checks = [], {}
    for name, tree in classes_of(result, page).items():
        with suppress(ValueError):  # a result without evidence: see _check_evidence
            diagnosis = diagnose_evidence(tree)
            value, error = log_evidence(tree)
            evidences.append([name, value, error, diagnosis.attrs["verdict"]])
            checks[name] = diagnosis[["value", "limit", "verdict"]].to_dataframe()
    columns = ["class", "log evidence (nats)", "standard error", "verdict"]
    page.table("Evidence", pd.DataFrame(evidences, columns=columns))
    if checks:
        page.table(
            "Checks of the evidence",
            pd.concat(checks, names=["class"]).reorder_levels([1, 0]).reset_index(),
            "A value passes up to its limit; for ancestors and residuals, from its limit on.",
        )


def show_training(result: xr.DataTree, page: Page) -> None:
    """Add the data to which classes were fitted."""
    title = page.title
    for name, tree in classes_of(result, page).items():
        if has_data(tree):
            page.title = name if name == title else f"class {name}"
            show_measurements(inflation_data_of(tree), page)
    page.title = title


def show_fits(result: xr.DataTree, page: Page) -> None:
    """Add the fit of each specimen, and how well the curves of each were integrated."""
    classes = classes_of(result, page)
    if not all(map(has_data, classes.values())):
        page.text("The result holds no data with which its curves could be compared.")
        return
    differ = all(map(specimens_differ, classes.values()))
    whose = "each specimen" if differ else "the class in the tube of each specimen"
    note = (
        f"Lines and bands: median and {100 * PROB:.3g} % interval of the posterior for {whose}, "
        "without measurement error. Points: data."
    )
    residuals = all(map(knows_noise, classes.values()))
    if residuals:
        note += (
            " Strips: residuals in standard deviations of the measurement error; if the model is "
            "right, about 19 of 20 lie between the dashed lines."
        )
    of_classes = [signals_of(tree) for tree in classes.values()]
    for signal in dict.fromkeys(signal for signals in of_classes for signal in signals):
        page.figure(
            f"Fit of the {_SIGNALS[signal]}",
            plot_fit,
            result,
            note=note,
            signal=signal,
            residuals=residuals,
            ci_prob=PROB,
            pressure_unit=page.at.pressure_unit,
        )
    if differ and all("specimens" in tree.children for tree in classes.values()):
        names = "specimen misfit freedom pareto_k standard_error method"
        tables = []
        for name, tree in classes.items():
            tables.append(frame_of(tree["specimens"].to_dataset(), names, "specimen"))
            tables[-1].insert(1, "class", name)
        page.table(
            "Best curve of each specimen",
            pd.concat(tables),
            "If the noise is known, the misfit (squared residuals in variances of the noise) is "
            "about the number of degrees of freedom. The standard error is that of the log "
            "evidence of the specimen.",
        )


def show_posteriors(result: xr.DataTree, page: Page) -> None:
    """Add the joint posterior of two parameters, and a table of all; check convergence."""
    classes = classes_of(result, page)
    summaries = {}
    for name, tree in classes.items():
        posterior = _posterior(tree)
        finite = posterior.where(np.isfinite(posterior))
        of_class = summary(finite, ci_prob=PROB, ci_kind="eti", round_to="none", skipna=True)
        summaries[name] = of_class.drop(columns=["mcse_mean", "mcse_sd"])
        _check_convergence(_subject(name, page), posterior, summaries[name], page)
    table = pd.concat(summaries, names=["class", "parameter"]).reset_index()
    unknowns = table["parameter"][~table["parameter"].str.startswith("|")]
    if len(unknowns) > len(classes):
        page.figure(
            "Joint posterior of two parameters",
            plot_parameter_density,
            result,
            note=f"The regions hold {' and '.join(f'{100 * p:.3g} %' for p in _REGIONS)}.",
            ci_probs=_REGIONS,
        )
    units = units_of(next(iter(classes.values())))
    variables = table["parameter"].str.strip("|").str.split("[").str[0]
    table.insert(2, "unit", [units.get(name, "") for name in variables])
    note = "The columns are those of arviz.summary."
    if all(map(specimens_differ, classes.values())):
        note += " Parameters are those of the typical specimen; other unknowns describe its class."
    page.table("Posterior of the parameters", table, note)


def _posterior(tree: xr.DataTree) -> xr.Dataset:
    """Return the unknowns, and the absolute value of each scalar that has both signs."""
    with suppress(ValueError):  # the typical specimen, unless the law is unknown
        tree = with_parameters(tree, None)
    posterior = tree["posterior"].to_dataset()
    chosen = {}
    for name, draws in posterior.data_vars.items():
        if draws.ndim > 3 or {"obs", "test"} & {*draws.dims} or name == "correlation_unit":
            continue
        chosen[name] = draws
        if draws.ndim == 2 and _BOTH_SIGNS < float((draws < 0).mean()) < 1 - _BOTH_SIGNS:
            chosen[f"|{name}|"] = abs(draws)
    return xr.Dataset(chosen)


def _check_convergence(
    subject: str, posterior: xr.Dataset, table: pd.DataFrame, page: Page
) -> None:
    for name, draws in posterior.data_vars.items():
        if not np.isfinite(draws).all():
            page.notice(BAD, f"some draws of {name} are not finite", subject)
    varies = table["sd"] > _ROUNDING * table["mean"].abs()
    rhat = table.loc[varies, "r_hat"].dropna()
    if len(rhat):
        worst = rhat.round(DIGITS).idxmax()
        if rhat[worst] > LARGEST_RHAT:
            words = (
                "the chains have met different parts of the posterior: R-hat of "
                f"{worst} is {short(rhat[worst])}"
            )
            page.notice(CAUTION, words, subject)
