"""The first section of a report: its data, its main results, and their limits."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
import xarray as xr

from pymc_hyperelastic.classes.average import laws_of_fits
from pymc_hyperelastic.data.sheets import tubes_of
from pymc_hyperelastic.data.variables import OPTIONAL_LABELS, sheet_tests
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.plots.laws import plot_law_probability
from pymc_hyperelastic.reports.meanings import NATS
from pymc_hyperelastic.reports.page import NOTE, PROB, Page, in_words, listed, percent, plural

# A fit may have none of these, for example if its law is not defined in this process.
_NO_FINDINGS = "This page has no elastic property, no difference of groups and no decision."


def summarise(page: Page) -> dict[str, str]:
    """Return sentences on the data, the result and its limits, by heading."""
    # Four results are enough for a summary.
    findings, others = (page.findings or page.values[:1])[:4], page.findings[4:]
    text = " ".join(findings) or _NO_FINDINGS
    if others:
        text += f" {plural(len(others), 'further result')} can be found below."
    return {"Data": _data_sentence(page.data), "Result": text, "Limits": _limits_sentence(page)}


def _data_sentence(data: list[xr.Dataset]) -> str:
    """Return the numbers of groups, specimens, tests and points, and the signals."""
    if not data:
        return "The results on this page do not hold the measured curves."
    points: dict[tuple[str, ...], int] = {}
    for each in data:
        names = ["group", "specimen", "experiment"]
        names += [name for name in OPTIONAL_LABELS if name in each.coords]
        labels = [each[name].values.astype(str) for name in names]
        counts = np.bincount(each["test"].values, minlength=each.sizes["test"])
        points |= dict(zip(zip(*labels, strict=True), counts.tolist(), strict=True))
    groups: dict[str, set[str]] = {}
    for group, specimen, *_ in points:
        groups.setdefault(group, set()).add(specimen)
    sizes = [f"{len(names)} in {group}" for group, names in groups.items()]
    of = f" of {plural(len(groups), 'group')} ({listed(sizes)})" if len(groups) > 1 else ""
    specimens = plural(sum(map(len, groups.values())), "specimen")
    simulated = "simulated " if any(each.attrs.get("simulated") for each in data) else ""
    return (
        f"The {simulated}data are {plural(len(points), 'test')} with "
        f"{plural(sum(points.values()), 'point')} on {specimens}{of}; measured were "
        f"{listed(_signals(data))}."
    )


def _signals(data: list[xr.Dataset]) -> list[str]:
    tubes = [of for d in data if (of := tubes_of(d)) is not None]
    radius = {"outer diameter" if "outer_diameter" in d else "internal radius" for d in tubes}
    pressure = ["pressure", *sorted(radius)] if tubes else []
    sheets = [d for d in data if sheet_tests(d).any()]
    force = any("axial_force" in d and bool(d["axial_force"].notnull().any()) for d in data)
    of_sheets = ["stretches and stresses of sheets"] if sheets else []
    return [*pressure, *(["axial force"] if force else []), *of_sheets]


def _limits_sentence(page: Page) -> str:
    """Return a sentence with the most serious warning, if any, and the least certain property."""
    serious = [warning for warning in page.warnings if warning[0] != NOTE]
    least = page.least_certain[1]
    if least:
        least = (
            f" The least certain elastic property is {least} (median, {percent(PROB)} interval)."
        )
    if serious:
        level, text, _ = serious[0]
        several = f"The most serious of {len(serious)} warnings"
        of = several if len(serious) > 1 else "The one warning"
        return f"{of} ({level}): {text}{least}"
    which = "The checks" if page.complete else "The checks that were possible"
    return f"{which} found no problem.{least}"


def show_laws(fits: Mapping[str, xr.DataTree], page: Page) -> None:
    """Add the probabilities of the laws of several fits to the same data."""
    try:
        laws = laws_of_fits([*fits.values()])
    except ValueError:  # other data, other classes or another likelihood: they do not compare
        return
    page.title = listed([*fits])
    page.figure("Probability of each law", plot_law_probability, [*fits.values()], warned=False)
    chances = [*map(Estimate, np.exp(laws.log_probability), laws.probability_error)]
    frame = pd.DataFrame({"law": laws.labels}, dtype=object)
    frame["log evidence (nats)"] = pd.Series(laws.evidences, dtype=object)
    frame["probability"] = pd.Series(chances, dtype=object)
    note = f"The probability is that of a law if all were equally probable before the data. {NATS}"
    page.table("Probability of each law", frame, note)
    best = int(np.argmax(laws.log_probability))
    page.findings.append(
        f"{laws.labels[best]} explains the data best, of the laws {listed(laws.labels)}: its "
        f"probability is {in_words(chances[best], 'probability')}, and its log evidence "
        f"{in_words(laws.evidences[best])}."
    )
