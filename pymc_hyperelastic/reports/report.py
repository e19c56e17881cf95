"""The report of a study: one HTML page, written from its results."""

import os
import platform
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from pymc_hyperelastic.classes.classification import are_of_classes
from pymc_hyperelastic.files.stored import read_json
from pymc_hyperelastic.files.whole import written_whole
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.style import per_kilopascal
from pymc_hyperelastic.reports import (
    cohort,
    comparison,
    cross_validation,
    decisions,
    design,
    fits,
    measurements,
    properties,
    settings,
)
from pymc_hyperelastic.reports.page import BAD, LEVELS, Entry, Page, listed

_PACKAGES = ("pymc-hyperelastic", "pymc", "pytensor", "arviz", "numpy", "xarray", "matplotlib")
# Beginning of the sentence on a strain energy, and that on a further one.
_MODELLED, _ALSO = "Each vessel was modelled", "Each vessel was also modelled"
# Titles of the chapters by anchor, in their order on the page. The notices of "warnings" and the
# sentences of "methods" have templates of their own.
CHAPTERS = {
    "warnings": "Warnings and diagnoses",
    "evidence": "Evidence and its diagnosis",
    "data": "Data",
    "fits": "Fits",
    "posteriors": "Posteriors",
    "classes": "Classes and decisions",
    "differences": "Differences between groups",
    "properties": "Elastic properties",
    "design": "What to measure next",
    "settings": "Settings",
    "methods": "Methods",
}


class Kind(NamedTuple):
    """What a report says about one kind of result."""

    name: str
    """Title of a result without one."""
    names: set[str]
    """Variables of a Dataset, or groups of a DataTree, by which the kind is recognised."""
    sections: Mapping[str, Callable[[Entry, Page], None]]
    """Functions that write the chapters, by anchor."""


COHORT = Kind(
    "Fitted cohort",
    {"posterior", "evidence"},
    {
        "warnings": cohort.check_cohort,
        "evidence": cohort.show_cohort_evidence,
        "posteriors": cohort.show_cohort_posteriors,
        "properties": cohort.show_cohort_properties,
        "methods": cohort.cohort_methods,
    },
)
CLASSES = Kind(
    "Fitted classes",
    {"posterior"},
    {
        "warnings": fits.check_fits,
        "evidence": fits.show_evidence,
        "data": fits.show_training,
        "fits": fits.show_fits,
        "posteriors": fits.show_posteriors,
        "properties": properties.show_properties,
        "settings": settings.show_settings,
        "methods": settings.fit_methods,
    },
)
CLASSIFIED = Kind(
    "Classified",
    {"class_probability", "class_probability_se", "class_label"},
    {
        "warnings": decisions.check_classified,
        "classes": decisions.show_classified,
        "methods": decisions.classified_methods,
    },
)
TABLES = (
    Kind(
        "Cross-validation",
        {"log_score", "true_class", "class_label"},
        {
            "warnings": cross_validation.check_cross_validation,
            "classes": cross_validation.show_cross_validation,
            "methods": cross_validation.cross_validation_methods,
        },
    ),
    CLASSIFIED,
    Kind(
        "Explanation",
        {"log_ratio_part", "rival", "class_label"},
        {"classes": decisions.show_explanation},
    ),
    Kind(
        "Comparison of groups",
        {"difference", "comparison", "quantity"},
        {
            "warnings": comparison.check_comparison,
            "differences": comparison.show_comparison,
            "methods": comparison.comparison_methods,
        },
    ),
    Kind(
        "Planned tests",
        {"information", "design", "tests"},
        {
            "warnings": design.check_designs,
            "design": design.show_designs,
            "methods": design.designs_methods,
        },
    ),
    Kind(
        "Planned study",
        {"width", "decided", "specimens"},
        {
            "warnings": design.check_plan,
            "design": design.show_plan,
            "methods": design.plan_methods,
        },
    ),
    Kind(
        "Data",
        {"pressure", "radius", "specimen"},
        {
            "warnings": measurements.check_measurements,
            "data": measurements.show_measurements,
        },
    ),
)


@one_thread
def report(
    result: Any,
    path: str | os.PathLike[str],
    *,
    data: xr.Dataset | Mapping[str, xr.Dataset] | None = None,
    title: str | None = None,
    pressure: Any = None,
    pressure_unit: str = "mmHg",
) -> Path:
    """Write a report of results: one HTML file for the screen and for paper.

    Warnings and diagnoses come first. Then the report shows, as far as the results hold them, data,
    fits, posteriors, decisions, differences and elastic properties in figures and tables. At the
    end are the settings, a paragraph on the methods for an article, and how to cite the package.

    Parameters
    ----------
    result : xarray.DataTree, xarray.Dataset, or a list or dict of them
        Results of :func:`fit_classes`, :func:`sample_smc`, :func:`classify`, :func:`open_cohort`,
        :func:`compare_classes`, :func:`calibration_report`, :func:`expected_information` and
        :func:`plan_study`, or inflation data. Several are given as a list, or as a dict of titles
        to results. If more than 200 specimens were classified, decisions are counted, and the
        specimens with the least clear class are shown.
    path : str or path
        The file. Its folder is made if needed. An existing file is replaced once the new one is
        complete.
    data : xarray.Dataset or dict of str to xarray.Dataset, optional
        Further measurements to show, such as those that were classified.
    title : str, optional
        Heading of the page; by default the title of the data.
    pressure : array_like, optional
        Internal pressures of the elastic properties, in `pressure_unit`; by default three that all
        experiments of the classes reached.
    pressure_unit : str, default "mmHg"
        Unit of pressures on the page, as pint knows it.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    ImportError
        If Jinja2 is not installed; it comes with the extra ``cli``.
    TypeError, ValueError
        If something is no result, `path` is a folder, or the unit is unknown.

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
    per_kilopascal(pressure_unit)  # raise for an unknown unit before anything is drawn
    path = _checked_path(path)
    entries = _entries(result, data)
    page = Page(_checked_pressure(pressure), pressure_unit)
    chapters: list[dict[str, Any]] = []
    for anchor, chapter in CHAPTERS.items():
        parts = [(entry.title, _blocks(entry, anchor, page)) for entry in entries]
        if parts := [part for part in parts if part[1]]:
            chapters.append({"anchor": anchor, "title": chapter, "parts": parts})
    _check_classes(entries, page)
    page.notices.sort(key=lambda notice: LEVELS.index(notice.level))
    html = template.render(
        title=title or _title_of(entries),
        results=[f"{entry.title} ({kind_of(entry.result).name.lower()})" for entry in entries],
        page=page,
        chapters=chapters,
        methods=_methods(page.methods, entries),
        versions=_versions(entries),
        python=platform.python_version(),
        style=files(__package__).joinpath("style.css").read_text(encoding="utf-8"),
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    with written_whole(path) as beside:
        beside.write_text(html, encoding="utf-8")
    return path


def kind_of(result: Any) -> Kind:
    """Return the kind of a result; TypeError if it is no result."""
    if isinstance(result, xr.DataTree):
        groups = {*result.children}
        if COHORT.names <= groups and "error" in result["evidence"].data_vars:
            return COHORT
        if any("posterior" in tree.children for tree in (result, *result.children.values())):
            return CLASSES
    elif isinstance(result, xr.Dataset):
        for kind in TABLES:
            if kind.names <= {*result.variables}:
                return kind
    raise TypeError(
        "expected results of ph.fit_classes, ph.sample_smc, ph.classify, ph.open_cohort, "
        "ph.compare_classes, ph.calibration_report, ph.expected_information and ph.plan_study, "
        "inflation data, or a list or a dict of titles with several of these; got "
        f"{_described(result)}"
    )


def _described(result: Any) -> str:
    name = type(result).__name__
    if hasattr(result, "data_vars"):
        held = [str(name) for name in (*result.data_vars, *getattr(result, "children", ()))]
        return f"a {name} of {held[:6] or 'nothing'}"
    return f"{result!r:.60}" if isinstance(result, str | int | float) else name


def _entries(result: Any, data: Any) -> list[Entry]:
    """Return all results, each with a title of its own."""
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
    entries: list[Entry] = []
    for given_title, each in several:
        title = plain = given_title or kind_of(each).name
        kind_of(each)
        count = 1
        while title in [entry.title for entry in entries]:
            count += 1
            title = f"{plain} {count}"
        entries.append(Entry(title, each))
    return entries


def _blocks(entry: Entry, anchor: str, page: Page) -> list[dict[str, Any]]:
    """Write what a result says in a chapter, and return it."""
    page.title, page.blocks = entry.title, []
    write = kind_of(entry.result).sections.get(anchor)
    if write:
        with page.catching(f"“{CHAPTERS[anchor]}” of {entry.title}"):
            write(entry, page)
    return page.blocks


def _check_classes(entries: Sequence[Entry], page: Page) -> None:
    """Add a notice if decisions were made with other classes than those on the page."""
    fitted = [each for each in entries if kind_of(each.result) is CLASSES]
    classes = [each for each in fitted if "posterior" not in each.result.children]
    for entry in entries if classes else ():
        if kind_of(entry.result) is CLASSIFIED:
            with page.catching(entry.title):
                if not are_of_classes(entry.result, [each.result for each in classes]):
                    words = (
                        "the decisions were made with other classes than "
                        f"{listed([each.title for each in classes])} on this page. Classify again"
                    )
                    page.notice(BAD, words, entry.title)


def _template() -> Any:
    try:
        import jinja2
    except ImportError as error:
        raise ImportError(
            "ph.report needs Jinja2, which is not installed: pip install jinja2"
        ) from error
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader(__package__, "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("page.html.jinja")


def _checked_path(path: Any) -> Path:
    try:
        path = Path(path)
    except TypeError:
        raise TypeError(f"path must name a file, such as 'report.html'; got {path!r}") from None
    if path.is_dir():
        raise ValueError(f"path {str(path)!r} is a folder: name a file in it, such as report.html")
    return path


def _checked_pressure(pressure: Any) -> Any:
    if pressure is None:
        return None
    try:
        values = np.atleast_1d(np.asarray(pressure, float))
    except (TypeError, ValueError):
        values = np.array([np.nan])
    if values.ndim != 1 or not values.size or not (np.isfinite(values) & (values >= 0)).all():
        raise ValueError(f"pressure must be a number from 0 up, or several; got {pressure!r}")
    return values


def _title_of(entries: Sequence[Entry]) -> str:
    """Return the titles of the data."""
    attrs = []
    for _, result in entries:
        attrs.append(result.attrs)
        if isinstance(result, xr.DataTree):
            groups = [node for node in result.subtree if node.name == "constant_data"]
            attrs += [group.attrs for group in groups]
    titles = dict.fromkeys(str(a["title"]) for a in attrs if a.get("title"))
    return ", ".join(titles) or "Report of a study"


def _methods(sentences: Sequence[str], entries: Sequence[Entry]) -> str:
    """Return the paragraph on the methods, each sentence once."""
    paragraph: list[str] = []
    for sentence in dict.fromkeys(sentences):
        several = any(other.startswith((_MODELLED, _ALSO)) for other in paragraph)
        paragraph.append(sentence.replace(_MODELLED, _ALSO) if several else sentence)
    software = {name: _installed(name) for name in _PACKAGES}
    for _, result in entries:
        software |= _stored_versions(result)
    paragraph.append(
        f"All results were computed with pymc_hyperelastic {software['pymc-hyperelastic']} on PyMC "
        f"{software['pymc']}, PyTensor {software['pytensor']} and NumPy {software['numpy']}."
    )
    return " ".join(paragraph)


def _versions(entries: Sequence[Entry]) -> list[tuple[str, str, str]]:
    """Return the versions of packages when the results were made, and now."""
    stored: dict[str, list[str]] = {name: [] for name in _PACKAGES}
    for _, result in entries:
        for name, number in _stored_versions(result).items():
            stored.setdefault(name, []).append(number)
    return [
        (name, ", ".join(dict.fromkeys(numbers)) or "unknown", _installed(name))
        for name, numbers in stored.items()
    ]


def _installed(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def _stored_versions(result: Any) -> dict[str, str]:
    """Return the versions that a result, or its first class, holds by package."""
    trees = [result, *result.children.values()] if isinstance(result, xr.DataTree) else []
    stored = next((tree for tree in trees if "versions" in tree.attrs), None)
    versions = {} if stored is None else read_json(stored, "versions", {})
    return {str(name): str(number) for name, number in versions.items()}
