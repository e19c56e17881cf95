"""Planned tests and studies, by ``ph.expected_information`` and ``ph.plan_study``, in a report."""

import xarray as xr

from pymc_hyperelastic.classes.quantities import MOST_LACKING
from pymc_hyperelastic.design.information import MOST_UNSURE
from pymc_hyperelastic.plots.information import plot_information
from pymc_hyperelastic.reports.meanings import quantity_in_words
from pymc_hyperelastic.reports.measurements import warn_of_simulated
from pymc_hyperelastic.reports.page import CAUTION, NOTE, Page, frame_of, in_words, listed, percent
from pymc_hyperelastic.rounding import short

_TODO = {"lacking": "Plan lower pressures or stretches", "unsure": "Repeat with more draws"}


def _check_designs(result: xr.Dataset, page: Page) -> None:
    """Add notices on designs that are as good as the best, and on specimens that are left out."""
    warn_of_simulated(result.attrs, page)
    if "stop" in result.attrs:
        page.notice(NOTE, result.attrs["words"], "")
    names = result["design"].values.tolist()
    best, *others = names
    near = (result["difference"] + 2 * result["difference_se"]).values[1:] >= 0
    if near.any():
        designs = listed([name for name, is_near in zip(others, near, strict=True) if is_near])
        words = f"{designs} may be as good as {best}: the difference is within two standard errors"
        page.notice(NOTE, words, "Choose by cost, or repeat with more specimens")
    for variable, limit, words in (
        (
            "lacking",
            MOST_LACKING,
            "of the specimens cannot be tested in this way, and are left out",
        ),
        ("unsure", MOST_UNSURE, "of the specimens have few effective draws"),
    ):
        for name, share in zip(names, result[variable].values.tolist(), strict=True):
            if share > limit:
                todo = _TODO[variable]
                page.notice(CAUTION, f"{share:.1%} {words}", todo, f"{page.title}, {name}")


def show_designs(result: xr.Dataset, page: Page) -> None:
    """Add the expected information of planned tests."""
    _check_designs(result, page)
    about = str(result.attrs["about"]).replace("_", " ")
    page.methods.append(
        f"Planned tests were ranked by the expected information about the {about} of a new "
        f"specimen, estimated with {result.sizes['specimen']} specimens that were simulated from "
        "the classes and measured in each of the tests."
    )
    what = f"Expected information of planned tests about the {about} of a new specimen"
    note = "Lines: ± two standard errors."
    if about == "class":
        note += " Grey line on the left: the largest possible information."
    page.figure(what, plot_information, result, note=note)
    names = "design tests information difference change_by_half"
    note = (
        "One nat of information is worth as much as narrowing a range of equally probable values "
        "to 1/2.7 of its width. The difference is that from the first design. The change by half "
        "is the change of the estimate with half of the draws: it should be small."
    )
    frame = frame_of(result, names, "design")
    page.table(f"{what}, in nats", frame, note)
    page.findings.append(
        f"The planned test {result['design'].values[0]} is expected to give the most information "
        f"about the {about} of a new specimen, {in_words(frame['information'][0])} nats."
    )
    if about == "class":
        most = short(float(result.attrs["entropy"]))
        page.text(f"Certain knowledge of the class would be {most} nats.")


def show_plan(result: xr.Dataset, page: Page) -> None:
    """Add what studies of each size are expected to find."""
    warn_of_simulated(result.attrs, page)
    studies = f"{result.attrs['studies']} simulated studies"
    page.notice(
        NOTE,
        f"shares are those of {studies}, with parameters from the posterior of the pilot study",
        "",
    )
    page.methods.append(
        f"The number of specimens was planned by assurance: the results for differences in "
        f"{listed(result['quantity'].values.tolist())} were those of {studies} of "
        f"{listed(result['specimens'].values.tolist())} specimens per group, with parameters drawn "
        "from the posterior of the pilot study."
    )
    prob = percent(result.attrs["interval"])
    names = "quantity unit comparison specimens width width_interval decided wrong covered"
    most = result.isel(specimens=[-1])
    width = frame_of(most, "width_interval", "quantity", "comparison", "specimens").iloc[0, 0]
    page.findings.append(
        f"With {most['specimens'].item()} specimens per group, the {prob} interval of the "
        f"difference in {quantity_in_words(result['quantity'].values[0])} is expected to be "
        f"{in_words(width)} wide."
    )
    page.table(
        "Expected results for differences",
        frame_of(result, names, "quantity", "comparison", "specimens"),
        f"For each number of specimens per group, the width of the {prob} interval (median and "
        f"range of {prob} of the studies), and the shares of studies that decide, decide wrongly "
        "and cover the truth. A study decides if its interval lies beyond "
        f"{short(float(result.attrs['relevant']))} on one side.",
    )
    page.table(
        "Expected classification of new specimens",
        frame_of(result, "specimens log_score", "specimens"),
        f"The best attainable mean log score is {short(float(result['best_log_score']))}.",
    )
