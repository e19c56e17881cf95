"""How specimens that were left out fared: the result of ``ph.calibration_report``."""

from typing import Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.classes.scores import score_probabilities
from pymc_hyperelastic.evidence.verdicts import VERDICTS
from pymc_hyperelastic.plots.calibration import plot_reliability
from pymc_hyperelastic.reports.blocks import (
    BAD,
    CAUTION,
    NOTE,
    Block,
    Found,
    Page,
    Probability,
    Table,
    in_words,
    is_table,
    plural,
    short,
)
from pymc_hyperelastic.reports.measurements import warn_of_simulated

# Of fewer specimens the reliability of probabilities is hardly known.
_FEW = 20


def is_held_out(result: Any) -> bool:
    """Whether this comes from ``ph.calibration_report``."""
    return is_table(result, "log_score", "true_class", "class_label")


def check_held_out(found: Found, page: Page) -> None:
    """Say which specimens are not known, or rest on fits that are in doubt."""
    result: xr.Dataset = found.result
    warn_of_simulated(result.attrs, page)
    page.check("the fits without each specimen that was left out")
    names = result["specimen"].values
    for law in result["strain_energy"].values.tolist():
        own = result.sel(strain_energy=law)
        for verdict in VERDICTS[1:]:
            where = own["verdict"].values == verdict
            if where.any():
                level = BAD if verdict == VERDICTS[-1] else CAUTION
                told = in_words(names[where].tolist())
                page.notice(level, f"{found.title}, {law}: {verdict} without {told}.")
        unknown = np.isnan(own["log_score"].values)
        if unknown.any():
            told = in_words(names[unknown].tolist())
            page.notice(CAUTION, f"{found.title}, {law}: not known of {told}.")
    if result.sizes["specimen"] < _FEW:
        page.notice(
            NOTE,
            f"{found.title}: {plural(result.sizes['specimen'], 'specimen')} left out tell little "
            "of how reliable probabilities are.",
        )


def show_held_out(found: Found, page: Page) -> list[Block]:
    """How specimens that were left out fared."""
    result: xr.Dataset = found.result
    labels = [str(label) for label in result["class_label"].values]
    rows = []
    blocks: list[Block] = []
    for law in result["strain_energy"].values.tolist():
        own = result.sel(strain_energy=law)
        for i, specimen in enumerate(result["specimen"].values.tolist()):
            at = own.isel(specimen=i)
            row: list[Any] = [str(specimen), str(law), str(at["true_class"].item())]
            row += [Probability(at["class_probability"].sel(class_label=name)) for name in labels]
            scores = [float(at[name]) for name in ("log_score", "brier_score")]
            rows.append([*row, *scores, str(at["verdict"].item()) or "not known"])
        known = own.isel(specimen=np.flatnonzero(own["log_score"].notnull().values))
        if known.sizes["specimen"]:
            scored = score_probabilities(known["class_probability"], known["true_class"])
            numbers = ("mean_log_score", "mean_brier_score", "accuracy")
            mean = [f"{n.replace('_', ' ')} {short(float(scored[n]))}" for n in numbers]
            blocks += page.figure(
                plot_reliability,
                scored.sel(forecast=["most probable class"]),
                label=f"Reliability of class probabilities: {found.title}, {law}",
                caption=f"Reliability of class probabilities, {law}: {', '.join(mean)}.",
            )
    columns = ["specimen left out", "strain energy", "true class"]
    columns += [f"probability of {name}" for name in labels]
    columns += ["log score", "Brier score", "verdict"]
    return [*blocks, Table(f"Specimens that were left out: {found.title}", columns, rows)]


def held_out_sentences(found: Found) -> list[str]:
    """How specimens were left out, as sentences of an article."""
    result: xr.Dataset = found.result
    count = result.sizes["specimen"]
    units = len(set(result["left_out"].values.tolist()))
    together = "" if units == count else f", in {plural(units, 'group')} that belong together,"
    return [
        f"To see whether class probabilities can be trusted, each of {plural(count, 'specimen')}"
        f"{together} was left out and classified by classes that were fitted to the others."
    ]
