"""The report of a study: one HTML page, written from its results."""

import os
import platform
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import xarray as xr

from pymc_hyperelastic.classes.classification import are_of_classes
from pymc_hyperelastic.data.variables import sheet_tests
from pymc_hyperelastic.io.atomic import atomic_write
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.predictions.conditions import Conditions, as_conditions
from pymc_hyperelastic.reports import comparison, decisions, diagnosis
from pymc_hyperelastic.reports.cohort import (
    show_cohort_evidence,
    show_cohort_posteriors,
    show_cohort_properties,
)
from pymc_hyperelastic.reports.comparison import show_comparison
from pymc_hyperelastic.reports.cross_validation import show_cross_validation
from pymc_hyperelastic.reports.decisions import show_classified, show_explanation
from pymc_hyperelastic.reports.design import show_designs, show_plan
from pymc_hyperelastic.reports.fits import show_fits, show_parameters, show_training
from pymc_hyperelastic.reports.measurements import show_measurements
from pymc_hyperelastic.reports.page import BAD, Page, listed
from pymc_hyperelastic.reports.properties import show_properties
from pymc_hyperelastic.reports.settings import add_methods, show_settings
from pymc_hyperelastic.reports.summary import show_laws, summarise
from pymc_hyperelastic.reports.versions import show_versions, versions_of

# Beginnings of the sentence on a strain energy, and those on a further one.
_MODELLED = {
    f"Each {of} was modelled": f"Each {of} was also modelled" for of in ("vessel", "sheet")
}
# Titles of the chapters by anchor, in their order on the page. The sentences on methods are at its
# end; those of fits are written first.
CHAPTERS = {
    "methods": "Methods",
    "data": "Data",
    "fits": "Fit of the model to the data",
    "parameters": "Parameters",
    "properties": "Elastic properties",
    "differences": "Differences between groups",
    "classes": "Decisions on specimens",
    "design": "What to measure next",
    "diagnosis": "Technical diagnosis",
    "settings": "Settings and versions",
}


class Kind(NamedTuple):
    """A kind of result, and the functions that report it."""

    title: str
    """Title of a result without one."""
    names: str
    """Variables of a Dataset, or groups of a DataTree, by which the kind is recognised."""
    sections: Mapping[str, Callable[[Any, Page], None]]
    """Functions that write the chapters, by anchor."""


COHORT = Kind(
    "Fitted cohort",
    "posterior evidence",
    {
        "parameters": show_cohort_posteriors,
        "properties": show_cohort_properties,
        "diagnosis": show_cohort_evidence,
    },
)
CLASSES = Kind(
    "Fitted classes",
    "posterior",
    {
        "methods": add_methods,
        "data": show_training,
        "fits": show_fits,
        "parameters": show_parameters,
        "properties": show_properties,
        "diagnosis": diagnosis.show_diagnosis,
        "settings": show_settings,
    },
)
MODEL = CLASSES._replace(title="Fitted model")
CLASSIFIED = Kind(
    "Classified",
    "class_probability decision",
    {"classes": show_classified, "diagnosis": decisions.show_diagnosis},
)
TABLES = (
    Kind(
        "Cross-validation", "log_score true_class class_label", {"classes": show_cross_validation}
    ),
    CLASSIFIED,
    Kind("Explanation", "log_ratio_part rival class_label", {"classes": show_explanation}),
    Kind(
        "Comparison of groups",
        "difference comparison quantity",
        {"differences": show_comparison, "diagnosis": comparison.show_diagnosis},
    ),
    Kind("Planned tests", "information design tests", {"design": show_designs}),
    Kind("Planned study", "width decided specimens", {"design": show_plan}),
    Kind("Data", "pressure radius specimen", {"data": show_measurements}),
    Kind("Data", "stretch_x stress_x specimen", {"data": show_measurements}),
)


@one_thread
def report(
    result: Any,
    path: str | os.PathLike[str],
    data: xr.Dataset | Mapping[str, xr.Dataset] | None = None,
    *,
    title: str | None = None,
    at: Conditions | Any = None,
) -> Path:
    """Write a report of results: one HTML file for the screen and for paper.

    The report begins with a summary of the data, the result and its limits, and with warnings, each
    of which says what to do. Then it shows, as far as the results hold them, data, fits,
    parameters, elastic properties, differences and decisions in figures and tables. At the end are
    the technical diagnosis, settings, versions and checksums, a paragraph on the methods for an
    article, and how to cite the package.

    Parameters
    ----------
    result : xarray.DataTree, xarray.Dataset, or a list or dict of them
        Results of :func:`fit_classes`, :func:`sample_smc`, :func:`classify`,
        :func:`explain_classification`, :func:`fit_cohort`, :func:`compare_classes`,
        :func:`cross_validate`, :func:`expected_information` and :func:`plan_study`, or data of
        tubes or sheets. Several are given as a list, or as a dict of titles to results. If more
        than 200 specimens were classified, decisions are counted, and the specimens with the least
        clear class are shown.
    path : str or path
        The file. Its folder is made if needed. An existing file is replaced once the new one is
        complete.
    data : xarray.Dataset or dict of str to xarray.Dataset, optional
        Further measurements to show, such as those that were classified.
    title : str, optional
        Heading of the page; by default the title of the data.
    at : Conditions, or array_like of pressures in kPa, optional
        Conditions for the elastic properties; their unit is that of all pressures on the page. By
        default there are three pressures that all experiments of the classes reached, in kPa, and
        the tube has the medians of the measured ones. The ``pressure_range`` is not used.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    ImportError
        If Jinja2 is not installed; it comes with the extra ``cli``.
    TypeError, ValueError
        If something is no result, `path` is a folder, or a pressure is below 0.

    See Also
    --------
    fit_classes, classify, compare_classes

    Notes
    -----
    If a figure cannot be drawn, a warning at the top of the page gives the reason. The same results
    give the same file.

    Examples
    --------
    >>> import tempfile, pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = ph.report(data, f"{folder}/aortas.html")
    ...     "SIMULATED sheep aorta" in file.read_text(encoding="utf-8")
    True
    """
    template = _template()
    at = as_conditions(at)
    if at.pressure is not None and at.pressures.min() < 0:
        raise ValueError(f"at states the pressure {at.pressures.min():g}; expected at least 0")
    results = _titled(result, data)
    path = Path(path)
    if path.is_dir():
        raise ValueError(f"path {str(path)!r} is a folder: name a file in it, such as report.html")
    page = Page(at)
    chapters = [
        {
            "anchor": anchor,
            "title": chapter,
            "parts": [(name, _blocks(name, each, anchor, page)) for name, each in results.items()]
            + _parts_of_all(results, anchor, page),
        }
        for anchor, chapter in CHAPTERS.items()
    ]
    _check_classes(results, page)
    html = template.render(
        title=title or _title_of(results),
        results=[f"{name} ({kind_of(each).title.lower()})" for name, each in results.items()],
        page=page,
        subject=_subject(page),
        summary=summarise(page),
        chapters=chapters,
        methods=_methods(page.methods, results),
        version=version("pymc-hyperelastic"),
        python=platform.python_version(),
        style=files(__package__).joinpath("style.css").read_text(encoding="utf-8"),
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path) as beside:
        beside.write_text(html, encoding="utf-8", errors="replace")
    return path


def kind_of(result: Any) -> Kind:
    """Return the kind of a result; TypeError if it is no result."""
    if isinstance(result, xr.DataTree):
        groups = {*result.children}
        if {*COHORT.names.split()} <= groups and "error" in result["evidence"].data_vars:
            return COHORT
        if "posterior" in groups:
            return MODEL
        if any("posterior" in tree.children for tree in result.children.values()):
            return CLASSES
    elif isinstance(result, xr.Dataset):
        for kind in TABLES:
            if {*kind.names.split()} <= {*result.variables}:
                return kind
    raise TypeError(
        "expected results of ph.fit_classes, ph.sample_smc, ph.classify, ph.fit_cohort, "
        "ph.compare_classes, ph.cross_validate, ph.expected_information and ph.plan_study, "
        "data of tubes or sheets, or a list or a dict of titles with several of these; got "
        f"{_described(result)}"
    )


def _described(result: Any) -> str:
    name = type(result).__name__
    if hasattr(result, "data_vars"):
        held = [str(name) for name in (*result.data_vars, *getattr(result, "children", ()))]
        return f"a {name} of {held[:6] or 'nothing'}"
    return f"{result!r:.60}" if isinstance(result, str | int | float) else name


def _titled(result: Any, data: Any) -> dict[str, Any]:
    """Return all results by titles that differ."""
    several: list[tuple[str | None, Any]] = []
    for given in (result, data):
        if isinstance(given, Mapping) and not isinstance(given, xr.Dataset | xr.DataTree):
            several += [(str(title), each) for title, each in given.items()]
        elif isinstance(given, Sequence) and not isinstance(given, str | bytes):
            several += [(None, each) for each in given]
        elif given is result or given is not None:
            several.append((None, given))
    if not several:
        raise ValueError("there are no results; expected at least one")
    titled: dict[str, Any] = {}
    for given_title, each in several:
        kind = kind_of(each)
        title = plain = given_title or kind.title
        number = 1
        while title in titled:
            number += 1
            title = f"{plain} {number}"
        titled[title] = each
    return titled


def _blocks(title: str, result: Any, anchor: str, page: Page) -> list[dict[str, Any]]:
    """Write what a result says in a chapter, and return it."""
    page.title, page.blocks = title, []
    write = kind_of(result).sections.get(anchor)
    if write:
        with page.catching(f"“{CHAPTERS[anchor]}” of {title}"):
            write(result, page)
    return page.blocks


def _parts_of_all(
    results: Mapping[str, Any], anchor: str, page: Page
) -> list[tuple[str, list[dict[str, Any]]]]:
    """Write what concerns several results in a chapter: the probability of laws, and versions."""
    page.title, page.blocks = "", []
    fits = {name: each for name, each in results.items() if kind_of(each) in (CLASSES, MODEL)}
    if anchor == "fits" and len(fits) > 1:
        with page.catching("Probability of each law"):
            show_laws(fits, page)
    if anchor == "settings":
        kinds = {name: kind_of(each).title.lower() for name, each in results.items()}
        show_versions(results, kinds, page)
    return [("All results", page.blocks)]


def _check_classes(results: Mapping[str, Any], page: Page) -> None:
    """Add a notice if decisions were made with other classes than those on the page."""
    classes = {title: result for title, result in results.items() if kind_of(result) is CLASSES}
    for title, result in results.items() if classes else ():
        if kind_of(result) is CLASSIFIED:
            with page.catching(title):
                if not are_of_classes(result, [*classes.values()]):
                    words = (
                        f"the decisions were made with other classes than {listed([*classes])} on "
                        "this page"
                    )
                    page.notice(BAD, words, "Classify again with these classes", title)


def _template() -> Any:
    try:
        import jinja2
    except ImportError as error:
        raise ImportError(
            "ph.report needs Jinja2, which is not installed: pip install jinja2"
        ) from error
    loader, strict = jinja2.PackageLoader(__package__, "."), jinja2.StrictUndefined
    environment = jinja2.Environment(loader=loader, autoescape=True, undefined=strict)
    environment.trim_blocks = environment.lstrip_blocks = True
    return environment.get_template("page.html.jinja")


def _title_of(results: Mapping[str, Any]) -> str:
    """Return the titles of the data."""
    attrs = [result.attrs for result in results.values()]
    for result in results.values():
        nodes = result.subtree if isinstance(result, xr.DataTree) else ()
        attrs += [node.attrs for node in nodes if node.name == "constant_data"]
    titles = dict.fromkeys(str(a["title"]) for a in attrs if a.get("title"))
    return ", ".join(titles) or "Report of a study"


def _subject(page: Page) -> str:
    """Return what the page is about: tubes, sheets, or both."""
    sheets = [sheet_tests(data) for data in page.data]
    if any(of.any() for of in sheets):
        alone = all(of.all() for of in sheets)
        return "stretched sheets" if alone else "inflated tubes and stretched sheets"
    return "inflated tubes"


def _methods(sentences: Sequence[str], results: Mapping[str, Any]) -> str:
    """Return the paragraph on the methods, each sentence once, and the versions of packages."""
    paragraph: list[str] = []
    for sentence in dict.fromkeys(sentences):
        for first, also in _MODELLED.items():
            if any(other.startswith(first) for other in paragraph):
                sentence = sentence.replace(first, also)
        paragraph.append(sentence)
    versions: dict[str, list[str]] = {}
    for result in results.values():
        for name, numbers in versions_of(result).items():
            versions.setdefault(name, []).extend(numbers)
    if versions:
        used = [f"{name} {' or '.join(dict.fromkeys(n))}" for name, n in versions.items()]
        paragraph.append(f"Models were sampled with {listed(used)}.")
    return " ".join(paragraph)
