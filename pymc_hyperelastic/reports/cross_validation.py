"""Cross-validated classes, by ``ph.cross_validate``, in a report."""

import numpy as np
import xarray as xr

from pymc_hyperelastic.classes.scores import score_probabilities
from pymc_hyperelastic.evidence.verdicts import BAD as UNRELIABLE
from pymc_hyperelastic.evidence.verdicts import DOUBTFUL
from pymc_hyperelastic.plots.calibration import plot_reliability
from pymc_hyperelastic.reports.measurements import warn_of_simulated
from pymc_hyperelastic.reports.page import (
    BAD,
    CAUTION,
    NOTE,
    Page,
    frame_of,
    plural,
    short,
)

# Specimens below which the reliability of probabilities is hardly known.
_FEW = 20


def _check(result: xr.Dataset, page: Page) -> None:
    """Add notices on specimens without a score, and on doubtful fits."""
    warn_of_simulated(result.attrs, page)
    for law in result["strain_energy"].values.tolist():
        own = result.sel(strain_energy=law)
        names, verdict = result["specimen"].values, own["verdict"]
        words = f"the fit of {law} without it is"
        page.notice_where(BAD, f"{words} {UNRELIABLE}", names, verdict == UNRELIABLE)
        page.notice_where(CAUTION, f"{words} {DOUBTFUL}", names, verdict == DOUBTFUL)
        unknown = own["log_score"].isnull()
        page.notice_where(CAUTION, f"the score with {law} is unknown", names, unknown)
    if result.sizes["specimen"] < _FEW:
        count = plural(result.sizes["specimen"], "specimen")
        page.notice(NOTE, f"{count} cannot show well how reliable probabilities are")


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
            numbers = ("mean_log_score", "mean_brier_score", "accuracy")
            means = [f"{n.replace('_', ' ')} {short(float(scored[n]))}" for n in numbers]
            page.figure(
                f"Reliability of class probabilities, {law}",
                plot_reliability,
                scored.sel(forecast=["most probable class"]),
                note=f"{', '.join(means).capitalize()}.",
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
    page.table("Specimens that were left out", frame)
