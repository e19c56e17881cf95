"""One page of a study: written from its results, and whole by itself."""

import os
import platform
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from pymc_hyperelastic.classes.classification import are_of_classes
from pymc_hyperelastic.io.atomic import atomic_write
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.style import per_kilopascal
from pymc_hyperelastic.reports.blocks import BAD, LEVELS, Block, Found, Page, short
from pymc_hyperelastic.reports.decisions import is_classified
from pymc_hyperelastic.reports.fits import are_fits
from pymc_hyperelastic.reports.kinds import CHAPTERS, Kind, kind_of
from pymc_hyperelastic.reports.software import methods_of, versions_of


class _Part(NamedTuple):
    """What one result says in a chapter."""

    title: str
    blocks: list[Block]


class _Chapter(NamedTuple):
    anchor: str
    title: str
    parts: list[_Part]


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
    """Write a report of results: one HTML file that needs no other, on a screen and on paper.

    What is to be known before the numbers stands first: what the data are, verdicts about
    evidences, and what cannot be judged. Data, fits, posteriors, decisions, differences and
    elastic properties follow as figures and tables, as far as the results hold them; then the
    settings, how to cite, and a paragraph on the methods that can be pasted into an article.

    Parameters
    ----------
    result : xarray.DataTree, xarray.Dataset, or a list or dict of them
        Results of :func:`fit_classes`, :func:`sample_smc`, :func:`classify`, :func:`open_cohort`,
        :func:`compare_classes`, :func:`calibration_report`, :func:`expected_information` and
        :func:`plan_study`, or inflation data. Several are given as a list, or as a dict of titles
        to results. Of more than 200 classified specimens decisions are counted, and those whose
        class is least clear are shown.
    path : str or path
        The file. Its folder is made if there is none. What was there is replaced when all of the
        new one is written, and stays if that fails.
    data : xarray.Dataset or dict of str to xarray.Dataset, optional
        Measurements that are shown beside the training data of the classes, such as those that were
        classified.
    title : str, optional
        Heading of the page; what the data are called when missing.
    pressure : array_like, optional
        Internal pressures of the elastic properties, in `pressure_unit`; by default three that all
        experiments of the classes reached.
    pressure_unit : str, default "mmHg"
        Unit of the pressures that are shown, as pint knows it.

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
    A figure that cannot be drawn is missing, and the warnings on top of the page say why. The same
    results give the same file.

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
    per_kilopascal(pressure_unit)  # an unknown unit is told before anything is drawn
    path = _checked_path(path)
    found = [(each, kind_of(each.result)) for each in _titled(result, data)]
    page = Page(_checked_pressure(pressure), pressure_unit)
    for each, kind in found:
        with page.listening(f"What speaks against {each.title}"):
            kind.check(each, page)
    _check_identity([each for each, _ in found], page)
    chapters = _chapters(found, page)
    methods = methods_of(found, page)
    # A figure tells what its data lack only when it is drawn: warnings are sorted at the end.
    page.notices.sort(key=lambda notice: LEVELS.index(notice.level))
    html = template.render(
        title=title or _title_of(found),
        words=[f"{each.title} ({kind.name.lower()})" for each, kind in found],
        notices=page.notices,
        checked=page.checked,
        complete=page.complete,
        chapters=chapters,
        methods=" ".join(methods),
        versions=versions_of(found),
        python=platform.python_version(),
        style=files(__package__).joinpath("style.css").read_text(encoding="utf-8"),
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path) as beside:
        beside.write_text(html, encoding="utf-8")
    return path


def _check_identity(found: Sequence[Found], page: Page) -> None:
    """Say where decisions were made with other classes than those that the page shows."""
    classes = [each for each in found if are_fits(each.result) and "posterior" not in each.result]
    for each in found:
        if classes and is_classified(each.result):
            with page.listening(f"What speaks against {each.title}"):
                if not are_of_classes(each.result, [one.result for one in classes]):
                    shown = " and ".join(one.title for one in classes)
                    page.notice(
                        BAD,
                        f"{each.title}: the decisions were made with other classes than {shown} on "
                        "this page. Classify again",
                    )


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
    environment.filters["short"] = short
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


def _titled(result: Any, data: Any) -> list[Found]:
    """All results, each with a title of its own."""
    several: list[tuple[str | None, Any]]
    if isinstance(result, xr.Dataset | xr.DataTree):
        several = [(None, result)]
    elif isinstance(result, Mapping):
        several = [(str(name), each) for name, each in result.items()]
    elif isinstance(result, Sequence) and not isinstance(result, str | bytes):
        several = [(None, each) for each in result]
    else:
        several = [(None, result)]
    if isinstance(data, Mapping) and not isinstance(data, xr.Dataset):
        several += [(str(name), each) for name, each in data.items()]
    elif data is not None:
        several.append((None, data))
    if not several:
        raise ValueError("there are no results: a report is of one at least")
    found: list[Found] = []
    for name, each in several:
        plain = name or kind_of(each).name
        count, title = 1, plain
        while title in {known.title for known in found}:
            count += 1
            title = f"{plain} {count}"
        found.append(Found(title, each))
    return found


def _chapters(found: Sequence[tuple[Found, Kind]], page: Page) -> list[_Chapter]:
    chapters = []
    for anchor, title in CHAPTERS.items():
        parts = []
        for each, kind in found:
            blocks: list[Block] = []
            if anchor in kind.chapters:
                with page.listening(f"The chapter “{title}” of {each.title}"):
                    blocks = kind.chapters[anchor](each, page)
            if blocks:
                parts.append(_Part(each.title, blocks))
        if parts:
            chapters.append(_Chapter(anchor, title, parts))
    return chapters


def _title_of(found: Sequence[tuple[Found, Kind]]) -> str:
    """What the data are called."""
    attrs = []
    for each, _ in found:
        attrs.append(each.result.attrs)
        if isinstance(each.result, xr.DataTree):
            trees = [each.result, *each.result.children.values()]
            attrs += [t["constant_data"].attrs for t in trees if "constant_data" in t.children]
    titles = dict.fromkeys(str(a["title"]) for a in attrs if a.get("title"))
    return ", ".join(titles) or "Report of a study"
