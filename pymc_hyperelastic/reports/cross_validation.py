"""Cross-validated classes, by ``ph.cross_validate``, in a report."""

import numpy as np
import xarray as xr

from pymc_hyperelastic.classes.scores import score_probabilities
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.verdicts import BAD as UNRELIABLE
from pymc_hyperelastic.evidence.verdicts import DOUBTFUL
from pymc_hyperelastic.plots.calibration import plot_reliability
from pymc_hyperelastic.reports.measurements import warn_of_simulated
from pymc_hyperelastic.reports.page import BAD, CAUTION, NOTE, Page, frame_of, in_words, plural
from pymc_hyperelastic.rounding import short

# Specimens below which the reliability of probabilities is hardly known.
_FEW = 20


def _check(result: xr.Dataset, page: Page) -> None:
    """Add notices on specimens without a score, and on doubtful fits."""
    warn_of_simulated(result.attrs, page)
    for law in result["strain_energy"].values.tolist():
        own = result.sel(strain_energy=law)
        names, verdict = result["specimen"].values, own["verdict"]
        words = f"the fit of {law} without it, or its own evidence, is"
        more = "Cross-validate again with more draws"
        page.notice_where(BAD, f"{words} {UNRELIABLE}", more, names, verdict == UNRELIABLE)
        page.notice_where(CAUTION, f"{words} {DOUBTFUL}", more, names, verdict == DOUBTFUL)
        unknown, words = own["log_score"].isnull(), f"the score with {law} is unknown"
        page.notice_where(CAUTION, words, "Read the error of these specimens", names, unknown)
    if result.sizes["specimen"] < _FEW:
        count = plural(result.sizes["specimen"], "specimen")
        words = f"{count} cannot show well how reliable probabilities are"
        page.notice(NOTE, words, "Read the scores as estimates with a large error")


def show_cross_validation(result: xr.Dataset, page: Page) -> None:
    """Add the reliability and scores of the probabilities of specimens that were left out."""
    _check(result, page)
    count, units = result.sizes["specimen"], len(np.unique(result["left_out"].values))
    together = "" if units == count else f", in {plural(units, 'group')} that belong together,"
    page.methods.append(
        f"To test the class probabilities, each of {plural(count, 'specimen')}{together} was left "
        "out and classified by classes that were fitted to the others."
    )
    for law in result["strain_energy"].values.tolist():
        own = result.sel(strain_energy=law)
        known = own.isel(specimen=np.flatnonzero(own["log_score"].notnull().values))
        if known.sizes["specimen"]:
            scored = score_probabilities(known["class_probability"], known["true_class"])
            right = int(scored["accuracy"].item() * known.sizes["specimen"] + 0.5)
            score = float(scored["mean_log_score"])
            page.findings.append(
                f"With the law {law}, {right} of {plural(known.sizes['specimen'], 'specimen')} "
                "that were left out were assigned to the right group; the mean log score is "
                f"{in_words(Estimate(score, _standard_error(known)))} (guessing: "
                f"{short(-np.log(known.sizes['class_label']))})."
            )
            page.figure(
                f"Reliability of class probabilities, {law}",
                plot_reliability,
                scored.sel(forecast=["most probable class"]),
                note="ECE, the expected calibration error, is the mean distance from the diagonal. "
                f"The mean Brier score is {short(float(scored['mean_brier_score']))}.",
            )
    table = result.copy()
    table["verdict"] = table["verdict"].where(table["verdict"] != "", "unknown")
    names = "specimen strain_energy true_class log_score brier_score verdict"
    frame = frame_of(table, names, "strain_energy", "specimen")
    for place, label in enumerate(result["class_label"].values.tolist(), start=3):
        of_class = result["class_probability"].sel(class_label=label)
        frame.insert(
            place,
            f"probability of {label}",
            of_class.transpose("strain_energy", "specimen").values.ravel(),
        )
    note = (
        "The log score is the logarithm of the probability of the true group, at most 0. The Brier "
        "score is the sum of squared errors of the probabilities, at least 0."
    )
    page.table("Specimens that were left out", frame, note)


def _standard_error(known: xr.Dataset) -> float:
    """Return the standard error of the mean log score; infinite with one specimen."""
    scores = known["log_score"].values
    return float(np.std(scores, ddof=1) / len(scores) ** 0.5) if len(scores) > 1 else np.inf
