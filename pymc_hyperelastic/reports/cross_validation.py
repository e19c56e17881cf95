"""Cross-validated classes, by ``ph.calibration_report``, in a report."""

import numpy as np
import xarray as xr

from pymc_hyperelastic.classes.scores import score_probabilities
from pymc_hyperelastic.evidence.verdicts import VERDICTS
from pymc_hyperelastic.plots.calibration import plot_reliability
from pymc_hyperelastic.reports.decisions import warn_of_some
from pymc_hyperelastic.reports.measurements import warn_of_simulated
from pymc_hyperelastic.reports.page import (
    BAD,
    CAUTION,
    NOTE,
    Entry,
    Page,
    frame_of,
    plural,
    short,
)

# Specimens below which the reliability of probabilities is hardly known.
_FEW = 20


def check_cross_validation(entry: Entry, page: Page) -> None:
    """Add notices on specimens without a score, and on doubtful fits."""
    result: xr.Dataset = entry.result
    warn_of_simulated(result.attrs, page)
    page.check("the fits without each specimen")
    for law in result["strain_energy"].values.tolist():
        own = result.sel(strain_energy=law)
        cases = [
            (CAUTION, f"{law}: the score is unknown for", np.isnan(own["log_score"].values)),
            (CAUTION, f"{law}: the fit is {VERDICTS[1]} without", own["verdict"] == VERDICTS[1]),
            (BAD, f"{law}: the fit is {VERDICTS[2]} without", own["verdict"] == VERDICTS[2]),
        ]
        names = result["specimen"].values
        warn_of_some(page, names, [(a, b, np.asarray(where)) for a, b, where in cases])
    if result.sizes["specimen"] < _FEW:
        count = plural(result.sizes["specimen"], "specimen")
        page.notice(NOTE, f"{count} cannot show well how reliable probabilities are")


def show_cross_validation(entry: Entry, page: Page) -> None:
    """Add the reliability and scores of the probabilities of specimens that were left out."""
    result: xr.Dataset = entry.result
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
    labels = result["class_label"].values.tolist()
    probability = result["class_probability"]
    each = {f"probability of {x}": probability.sel(class_label=x, drop=True) for x in labels}
    columns = {
        "specimen": "specimen left out",
        "strain_energy": "strain energy",
        "true_class": "true class",
        **{heading: heading for heading in each},
        "log_score": "log score",
        "brier_score": "Brier score",
        "verdict": "verdict",
    }
    table = result.assign(each)
    table["verdict"] = table["verdict"].where(table["verdict"] != "", "unknown")
    frame = frame_of(table, columns, ["strain_energy", "specimen"])
    page.table("Specimens that were left out", frame)


def cross_validation_methods(entry: Entry, page: Page) -> None:
    """Add a sentence on how specimens were left out."""
    result: xr.Dataset = entry.result
    count = result.sizes["specimen"]
    units = len(np.unique(result["left_out"].values))
    together = "" if units == count else f", in {plural(units, 'group')} that belong together,"
    page.methods.append(
        f"To test the class probabilities, each of {plural(count, 'specimen')}{together} was left "
        "out and classified by classes that were fitted to the others."
    )
