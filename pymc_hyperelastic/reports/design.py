"""Planned tests and studies, by ``ph.expected_information`` and ``ph.plan_study``, in a report."""

import xarray as xr

from pymc_hyperelastic.plots.information import plot_information
from pymc_hyperelastic.reports.measurements import warn_of_simulated
from pymc_hyperelastic.reports.page import CAUTION, NOTE, Entry, Page, frame_of, listed, short

# Share of specimens that cannot be tested by a design above which it is a warning.
_LACKING = 0.005
# Share of specimens with few effective draws above which it is a warning.
_UNSURE = 0.05
# Standard errors of the difference within which a design may be as good as the best one.
_ERRORS = 2


def check_designs(entry: Entry, page: Page) -> None:
    """Add notices on designs that are as good as the best, and on specimens that are left out."""
    result: xr.Dataset = entry.result
    warn_of_simulated(result.attrs, page)
    page.check("whether planned tests differ by more than their errors, and which are impossible")
    if "words" in result.attrs:
        page.notice(NOTE, result.attrs["words"])
    names = result["design"].values.tolist()
    best, *others = names
    near = (result["difference"] + _ERRORS * result["difference_se"]).values[1:] >= 0
    if near.any():
        designs = listed([name for name, is_near in zip(others, near, strict=True) if is_near])
        words = f"{designs} may be as good as {best}: the difference is within two standard errors"
        page.notice(NOTE, words)
    for variable, limit, words in (
        ("lacking", _LACKING, "of the specimens cannot be tested in this way, and are left out"),
        ("unsure", _UNSURE, "of the specimens have few effective draws: more draws are needed"),
    ):
        for name, share in zip(names, result[variable].values.tolist(), strict=True):
            if share > limit:
                page.notice(CAUTION, f"{share:.1%} {words}", f"{entry.title}, {name}")


def show_designs(entry: Entry, page: Page) -> None:
    """Add the expected information of planned tests."""
    result: xr.Dataset = entry.result
    about = str(result.attrs["about"]).replace("_", " ")
    what = f"Expected information of planned tests about the {about} of a new specimen"
    page.figure(what, plot_information, result, note="Lines: ± two standard errors.")
    headings = {
        "information": "information",
        "difference": "less than the best",
        "change_by_half": "change with half of the draws",
    }
    columns = {"design": "design", "tests": "tests"}
    for name, heading in headings.items():
        columns |= {name: heading, f"{name}_se": "its standard error"}
    page.table(f"{what}, in nats", frame_of(result, columns, ["design"]))
    if about == "class":
        most = short(float(result.attrs["entropy"]))
        page.text(f"Tests that tell the class with certainty would give {most} nats.")


def designs_methods(entry: Entry, page: Page) -> None:
    """Add a sentence on how planned tests were compared."""
    about = str(entry.result.attrs["about"]).replace("_", " ")
    page.methods.append(
        f"Planned tests were ranked by the expected information about the {about} of a new "
        f"specimen, estimated with {entry.result.sizes['specimen']} specimens that were simulated "
        "from the classes and measured in each of the tests."
    )


def check_plan(entry: Entry, page: Page) -> None:
    """Add a notice on the number of simulated studies."""
    result: xr.Dataset = entry.result
    warn_of_simulated(result.attrs, page)
    page.check("the number of simulated studies")
    page.notice(
        NOTE,
        f"the shares are those of {result.attrs['studies']} simulated studies, with parameters "
        "from the posterior of the pilot study",
    )


def show_plan(entry: Entry, page: Page) -> None:
    """Add what studies of each size are expected to find."""
    result: xr.Dataset = entry.result
    prob = f"{100 * float(result.attrs['interval']):.3g} %"
    columns = {
        "quantity": "quantity",
        "unit": "unit",
        "comparison": "comparison",
        "specimens": "specimens per group",
        "width": f"width of the {prob} interval",
        "width_se": "its standard error",
        "width_interval:low": "from",
        "width_interval:high": "to",
        "decided": "share decided",
        "decided_se": "its standard error",
        "wrong": "share decided wrongly",
        "covered": "share covered",
    }
    table = result.assign_coords(unit=result["unit"].where(result["unit"] != "1", ""))
    page.table(
        "Expected results for differences",
        frame_of(table, columns, ["quantity", "comparison", "specimens"]),
        f"The width is the median, with the range of {prob} of the studies. A study decides if "
        f"its interval lies beyond {short(float(result.attrs['relevant']))} on one side.",
    )
    columns = {
        "specimens": "specimens per group",
        "log_score": "mean log score",
        "log_score_se": "its standard error",
    }
    page.table(
        "Expected classification of new specimens",
        frame_of(result, columns, ["specimens"]),
        f"The best attainable mean log score is {short(float(result['best_log_score']))}.",
    )


def plan_methods(entry: Entry, page: Page) -> None:
    """Add a sentence on how a study was planned."""
    result: xr.Dataset = entry.result
    sizes = listed(result["specimens"].values.tolist())
    page.methods.append(
        "The number of specimens was planned by assurance: for "
        f"{result.attrs['studies']} simulated studies of {sizes} specimens per group, with "
        "parameters drawn from the posterior of the pilot study, the expected results for "
        f"differences in {listed(result['quantity'].values.tolist())} were computed."
    )
