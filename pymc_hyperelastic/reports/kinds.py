"""Which kinds of results there are, and what a report says of each.

Another kind is a row of `KINDS`: how it is known, what is checked, what stands in which chapter,
and the sentences of an article that are due to it.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from pymc_hyperelastic.reports.blocks import Block, Found, Page, Table
from pymc_hyperelastic.reports.cohort import (
    check_cohort,
    cohort_sentences,
    is_cohort,
    show_cohort_posteriors,
    show_cohort_properties,
    show_cohort_trust,
)
from pymc_hyperelastic.reports.decisions import (
    check_classified,
    classified_sentences,
    is_classified,
    show_classified,
)
from pymc_hyperelastic.reports.differences import (
    check_comparison,
    comparison_sentences,
    is_comparison,
    show_comparison,
)
from pymc_hyperelastic.reports.fits import are_fits, show_fits, show_posteriors, show_training
from pymc_hyperelastic.reports.held_out import (
    check_held_out,
    held_out_sentences,
    is_held_out,
    show_held_out,
)
from pymc_hyperelastic.reports.measurements import (
    are_measurements,
    check_measurements,
    show_measurements,
)
from pymc_hyperelastic.reports.methods import fit_sentences
from pymc_hyperelastic.reports.plans import (
    are_designs,
    check_designs,
    check_plan,
    designs_sentences,
    is_plan,
    plan_sentences,
    show_designs,
    show_plan,
)
from pymc_hyperelastic.reports.properties import show_properties
from pymc_hyperelastic.reports.settings import settings_of, settings_rows
from pymc_hyperelastic.reports.trust import check_fits, show_trust

# In their order on the page, each by its anchor; warnings go before, citing and methods after.
CHAPTERS = {
    "trust": "Evidence and its diagnosis",
    "data": "Data",
    "fits": "Fits",
    "posteriors": "Posteriors",
    "classes": "Classes and decisions",
    "differences": "Differences between groups",
    "properties": "Elastic properties",
    "plans": "What to measure next",
    "settings": "Settings",
}


class Kind(NamedTuple):
    """What a report says of one kind of result."""

    name: str
    """What a result is called that nobody has given a title."""
    is_one: Callable[[Any], bool]
    check: Callable[[Found, Page], None]
    """Notices of what is to be known before the numbers."""
    chapters: Mapping[str, Callable[[Found, Page], list[Block]]]
    methods: Callable[[Found], Sequence[str]]


def _show_settings(found: Found, page: Page) -> list[Block]:
    rows = settings_rows(settings_of(found.result))
    return [Table(f"Settings: {found.title}", ["setting", "value"], rows)]


def _nothing(found: Found) -> Sequence[str]:
    return []


# A cohort has posteriors as fitted classes have, and is asked for before them.
KINDS = (
    Kind(
        "Fitted cohort",
        is_cohort,
        check_cohort,
        {
            "trust": show_cohort_trust,
            "posteriors": show_cohort_posteriors,
            "properties": show_cohort_properties,
        },
        cohort_sentences,
    ),
    Kind(
        "Fitted classes",
        are_fits,
        check_fits,
        {
            "trust": show_trust,
            "data": show_training,
            "fits": show_fits,
            "posteriors": show_posteriors,
            "properties": show_properties,
            "settings": _show_settings,
        },
        fit_sentences,
    ),
    Kind("Left out", is_held_out, check_held_out, {"classes": show_held_out}, held_out_sentences),
    Kind(
        "Classified",
        is_classified,
        check_classified,
        {"classes": show_classified},
        classified_sentences,
    ),
    Kind(
        "Comparison of groups",
        is_comparison,
        check_comparison,
        {"differences": show_comparison},
        comparison_sentences,
    ),
    Kind("Planned tests", are_designs, check_designs, {"plans": show_designs}, designs_sentences),
    Kind("Planned study", is_plan, check_plan, {"plans": show_plan}, plan_sentences),
    Kind("Data", are_measurements, check_measurements, {"data": show_measurements}, _nothing),
)


def kind_of(result: Any) -> Kind:
    """The kind of a result; TypeError if it is none of them."""
    for kind in KINDS:
        if kind.is_one(result):
            return kind
    raise TypeError(
        "a report is of results of ph.fit_classes, ph.sample_smc, ph.classify, ph.open_cohort, "
        "ph.compare_classes, ph.calibration_report, ph.expected_information and ph.plan_study, of "
        "inflation data, or of several of these as a list, or a dict of titles to results; here is "
        f"{_described(result)}"
    )


def _described(result: Any) -> str:
    what = type(result).__name__
    if hasattr(result, "data_vars"):
        held = [str(name) for name in (*result.data_vars, *getattr(result, "children", ()))]
        return f"a {what} of {held[:6] or 'nothing'}"
    return f"{result!r:.60}" if isinstance(result, str | int | float) else what
