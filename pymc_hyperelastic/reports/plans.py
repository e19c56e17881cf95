"""What to measure next: results of ``ph.expected_information`` and ``ph.plan_study``."""

from typing import Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.plots.information import plot_information
from pymc_hyperelastic.reports.blocks import (
    CAUTION,
    NOTE,
    Block,
    Found,
    Page,
    Probability,
    Table,
    Text,
    in_words,
    is_table,
    short,
)
from pymc_hyperelastic.reports.measurements import warn_of_simulated

# Shares of specimens that are told, as the functions themselves do.
_LACKING, _UNSURE = 0.005, 0.05
# Standard errors within which a design is as good as the first.
_ERRORS = 2


def are_designs(result: Any) -> bool:
    """Whether this comes from ``ph.expected_information``."""
    return is_table(result, "information", "design", "tests")


def check_designs(found: Found, page: Page) -> None:
    """Say what cannot be told apart, and which designs not all specimens bear."""
    result: xr.Dataset = found.result
    warn_of_simulated(result.attrs, page)
    page.check("whether planned tests can be told apart, and what is left out of them")
    if "words" in result.attrs:
        page.notice(NOTE, f"{found.title}: {result.attrs['words']}.")
    names = np.array(result["design"].values.tolist(), dtype=object)
    near = result["difference"].values + _ERRORS * result["difference_se"].values >= 0
    if near[1:].any():
        words = f"{in_words(names[1:][near[1:]].tolist())} may be as good as {names[0]}"
        page.notice(NOTE, f"{found.title}: {words}: the difference is within two standard errors.")
    for of, limit, words in (
        ("lacking", _LACKING, "of the specimens cannot be tested so, and are left out"),
        ("unsure", _UNSURE, "of the specimens have few effective draws: more are needed"),
    ):
        for name, share in zip(names, result[of].values.tolist(), strict=True):
            if share > limit:
                page.notice(CAUTION, f"{found.title}, {name}: {share:.1%} {words}.")


def show_designs(found: Found, page: Page) -> list[Block]:
    """Expected information of planned tests, as a figure and a table."""
    result: xr.Dataset = found.result
    about = str(result.attrs["about"]).replace("_", " ")
    of = f"the {about} of a new specimen"
    blocks = page.figure(
        plot_information,
        result,
        label=f"What planned tests are expected to tell: {found.title}",
        caption=f"What planned tests are expected to tell of {of}: {found.title}. Lines: two "
        "standard errors to each side.",
    )
    names = ("information", "difference", "change_by_half")
    rows = []
    for i, name in enumerate(result["design"].values.tolist()):
        own = result.isel(design=i)
        numbers = [float(own[n + end]) for n in names for end in ("", "_se")]
        rows.append([str(name), str(own["tests"].item()), *numbers])
    headings = ["information", "less than the first", "change by half of the draws"]
    columns = [heading for each in headings for heading in (each, "its standard error")]
    caption = f"Expected information of planned tests about {of}, in nats: {found.title}"
    blocks.append(Table(caption, ["design", "tests", *columns], rows))
    if about == "class":
        most = short(float(result.attrs["entropy"]))
        blocks.append(Text(f"All that can be told of the class are {most} nats."))
    return blocks


def designs_sentences(found: Found) -> list[str]:
    """How planned tests were compared, as sentences of an article."""
    result: xr.Dataset = found.result
    about = str(result.attrs["about"]).replace("_", " ")
    count = result.sizes["specimen"]
    return [
        f"Planned tests were ranked by the information that they are expected to give of the "
        f"{about} of a new specimen, found of {count} specimens simulated from the classes and "
        "measured in every one of them."
    ]


def is_plan(result: Any) -> bool:
    """Whether this comes from ``ph.plan_study``."""
    return is_table(result, "width", "decided", "specimens")


def check_plan(found: Found, page: Page) -> None:
    """Say how many studies a plan rests on."""
    result: xr.Dataset = found.result
    warn_of_simulated(result.attrs, page)
    page.check("what plans of studies rest on")
    page.notice(
        NOTE,
        f"{found.title}: shares of {result.attrs['studies']} simulated studies, whose truths are "
        "those that the pilot holds for possible.",
    )


def show_plan(found: Found, page: Page) -> list[Block]:
    """What studies of each size would find."""
    result: xr.Dataset = found.result
    prob = f"{100 * float(result.attrs['interval']):.3g} %"
    rows = []
    for quantity in result["quantity"].values.tolist():
        for comparison in result["comparison"].values.tolist():
            for size in result["specimens"].values.tolist():
                own = result.sel(quantity=quantity, comparison=comparison, specimens=size)
                ends = [float(own["width_interval"].sel(bound=b)) for b in ("low", "high")]
                width = [float(own["width"]), float(own["width_se"]), *ends]
                decided = [Probability(own["decided"]), float(own["decided_se"])]
                shares = [*decided, Probability(own["wrong"]), Probability(own["covered"])]
                unit = str(own["unit"].item())
                rows.append([quantity, unit if unit != "1" else "", comparison, size])
                rows[-1] += [*width, *shares]
    columns = ["quantity", "unit", "comparison", "specimens of each group"]
    columns += [f"width of the {prob} interval", "its standard error", "from", "to"]
    columns += ["share decided", "its standard error", "share decided wrongly", "share covered"]
    beyond = short(float(result.attrs["relevant"]))
    blocks: list[Block] = [
        Table(
            f"What studies would find of differences: {found.title}. Widths are the median and "
            f"where {prob} of the studies lie; decided are those whose interval lies beyond "
            f"{beyond} on one side.",
            columns,
            rows,
        )
    ]
    scores = [
        [size, *(float(result[n].sel(specimens=size)) for n in ("log_score", "log_score_se"))]
        for size in result["specimens"].values.tolist()
    ]
    headings = ["specimens of each group", "mean log score", "its standard error"]
    caption = f"How well studies would classify new specimens: {found.title}"
    blocks.append(Table(caption, headings, scores))
    best = short(float(result["best_log_score"]))
    blocks.append(Text(f"Who knew the groups themselves would have a mean log score of {best}."))
    return blocks


def plan_sentences(found: Found) -> list[str]:
    """How a study was planned, as sentences of an article."""
    result: xr.Dataset = found.result
    sizes = in_words(result["specimens"].values.tolist())
    names = in_words(result["quantity"].values.tolist())
    return [
        f"The number of specimens was planned by assurance: what {result.attrs['studies']} "
        f"simulated studies of {sizes} specimens a group, with truths drawn from the posterior of "
        f"the pilot, would find of differences in {names}."
    ]
