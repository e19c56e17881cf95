"""Data of tubes and of sheets from the files of a laboratory."""

import io
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

from pymc_hyperelastic.data.columns import rows_of
from pymc_hyperelastic.data.files.headers import points_in
from pymc_hyperelastic.data.files.join import named
from pymc_hyperelastic.data.files.settings import Settings, read_settings, settings_of
from pymc_hyperelastic.data.files.sheet_study import sheets_of_study
from pymc_hyperelastic.data.files.sheets import Table, table_of
from pymc_hyperelastic.data.files.study import study_of
from pymc_hyperelastic.data.files.text import Sheet, read_sheets
from pymc_hyperelastic.data.inflation import file_of
from pymc_hyperelastic.data.sheet_table import sheet_data
from pymc_hyperelastic.data.sheets import combine_tests
from pymc_hyperelastic.data.table import UNITS_IN_FILES, inflation_data
from pymc_hyperelastic.data.validation import Check, Problems, check_known, refuse
from pymc_hyperelastic.mechanics.reference_tube import WALL, Tube
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.messages import shown
from pymc_hyperelastic.quantities import MEASURES

Paths = str | os.PathLike[str] | Iterable[str | os.PathLike[str]]

# Labels that become coordinates here; inflation_data does not know them.
_KEPT = ("animal", "split")


def read_tests(
    files: Paths,
    settings: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    *,
    check: Check = "warn",
) -> xr.Dataset:
    """Read data of tubes and sheets from the text files and workbooks of a laboratory as they are.

    Separators, decimal marks and encodings are found; columns are known by their names, with units
    in the names, in a line below them or in the settings. Tables of points are put below each
    other, and tables of specimens are joined to them. An ambiguous table is an error that asks for
    a setting; all errors are reported at once.

    Parameters
    ----------
    files : path or iterable of paths
        CSV, TSV or text files of one study, perhaps compressed, or Excel workbooks, of which each
        sheet is a table; one of the files may be the TOML file of its settings.
        A table with a pressure or a measured radius has points of tubes, one a row. A table without
        them, but with a stress or a force, has points of sheets. Others are of specimens, or of
        experiments where they have such a column, and are joined by it. The names of columns that
        are known are on the page What a file may look like.
    settings : path or dict, optional
        A TOML file, or a dict of the same form, for what the tables do not say. Keys are
        ``measured`` and ``cycles``, as :func:`~pymc_hyperelastic.inflation_data` has them;
        ``opening_angle_convention`` and ``radii_of``, as ``convention`` and ``radii_of`` of
        :class:`~pymc_hyperelastic.Tube`; ``pressure_unit``, ``radius_unit``,
        ``angle_unit``, ``force_unit``, ``stress_unit`` for columns that state none; ``decimal``,
        ``separator``; ``ignore``, a list of columns; and the tables ``columns`` (what a column is
        called in the files), ``units`` (of one column), ``constants`` (the same in all rows) and
        ``files`` (the same in all rows of one file, by its name). Constants of sheets are ``kind``,
        ``gauge_length`` and ``area``, as in :func:`~pymc_hyperelastic.sheet_data`, and
        ``stress_measure``, ``"cauchy"`` or ``"nominal"``.
    check : {"warn", "raise", "ignore"}
        The reaction to input that is possible, but probably a mistake.

    Returns
    -------
    xarray.Dataset
        As :func:`~pymc_hyperelastic.inflation_data` and :func:`~pymc_hyperelastic.sheet_data` build
        it; both kinds of tests are in one Dataset, as :func:`~pymc_hyperelastic.combine_tests`
        makes it. ``row`` names file and line of each point; ``animal`` and ``split`` are
        coordinates of the tests where there are such columns. The attribute ``understood`` says in
        words what each file and each column was taken for.

    Raises
    ------
    OSError
        If a file cannot be opened.
    TypeError
        If `files` are no paths, or `settings` neither a path nor a dict.
    ValueError
        If something cannot be understood, or is not sound; the message names files, lines, columns
        and cells. A note of the error (``__notes__``) lists the files and columns that were read.

    Warns
    -----
    UserWarning
        The warnings of :func:`~pymc_hyperelastic.inflation_data` and
        :func:`~pymc_hyperelastic.sheet_data`.

    See Also
    --------
    inflation_data, sheet_data, select

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import pymc_hyperelastic as ph
    >>> table = '''Probe;test;inner diameter / µm;P (mmHg)
    ... 01;1;812,5;10
    ... 01;1;960,0;60
    ... '''
    >>> settings = {"columns": {"specimen": "Probe"}, "radius_unit": "um"}
    >>> settings["constants"] = {"inner_radius": 400, "outer_radius": 520}
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder, "curves.csv")
    ...     size = path.write_text(table, encoding="utf-8")
    ...     data = ph.read_tests(path, settings)
    >>> data["specimen"].item(), data["radius"].values.tolist(), data["row"].values[1].item()
    ('01', [0.40625, 0.48], 'curves.csv, line 3')
    >>> print(data.attrs["understood"])
    curves.csv: UTF-8, separated by semicolons, decimal commas, 2 rows
      'Probe' is specimen: 1 label
      'test' is experiment: 1 label
      half of 'inner diameter / µm' is radius in µm (1 µm is 0.001 mm): 406.25 to 480
      'P (mmHg)' is pressure in mmHg (1 mmHg is 0.133322 kPa): 10 to 60
    the same in all rows of all files: inner_radius 0.4 mm, outer_radius 0.52 mm
    together: 1 specimen, 1 experiment, 2 points
    no axial_stretch: 1 is taken
    no opening_angle: 0 is taken
    """
    check_known(check)
    paths, stated = _given(files, settings)
    understood: list[str] = []
    try:
        tables = _tables(paths, stated, understood)
        data, count = _data_of_study(tables, stated, check, understood)
    except ValueError as error:
        if understood:
            error.add_note("What was understood:\n" + "\n".join(understood))
        raise
    if data.sizes["obs"] < count:
        understood.append(f"of these the last cycle of each, {data.sizes['obs']} points, is taken")
    return data.assign_attrs(understood="\n".join(understood))


def settings_of_study(files: Paths, settings: object = None) -> Settings:
    """Return the settings of the arguments of :func:`read_tests`."""
    return _given(files, settings)[1]


def _given(files: Paths, settings: object) -> tuple[dict[str, Path], Settings]:
    """Tables by the names that messages give them, and settings."""
    several = [files] if isinstance(files, str | os.PathLike | io.IOBase) else files
    several = list(several) if isinstance(several, Iterable) else [several]
    if not all(isinstance(file, str | os.PathLike) for file in several):
        raise TypeError(
            f"files are {shown(files)}; expected a path or a list of paths. Write a text or an "
            "open file to a file first; a dict of settings is given as settings=..."
        )
    for file in map(str, several):
        if re.match("[a-z]+://", file):
            raise ValueError(f"{file} is an address, not a path: download the file, and give it")
    paths = [Path(file) for file in several]
    toml = [path for path in paths if path.suffix.lower() == ".toml"]
    if isinstance(settings, str | os.PathLike):
        toml.append(Path(settings))
    elif not isinstance(settings, Mapping | None):
        raise TypeError(f"settings are {shown(settings)}; expected a path, a dict or None")
    if len(toml) + isinstance(settings, Mapping) > 1:
        raise ValueError(f"settings are given twice, in {toml[0]} too: put them into one file")
    paths = [path for path in paths if path not in toml]
    if not paths:
        raise ValueError("no tables are given: expected CSV, TSV or text files")
    names, places = [path.name for path in paths], [path.resolve() for path in paths]
    for path, place in zip(paths, places, strict=True):
        if places.count(place) > 1:
            raise ValueError(f"{path} is given twice: its points would count twice")
    by_name = {_as_text(p.name if names.count(p.name) == 1 else str(p)): p for p in paths}
    if toml:
        return by_name, read_settings(toml[0])
    return by_name, settings_of(settings or {}, "")  # type: ignore[arg-type]


def _as_text(name: str) -> str:
    r"""Return the name of a file with bytes that are no UTF-8 as in ``\udcdc``."""
    return name.encode("utf-8", "backslashreplace").decode("utf-8")


def _data_of_study(
    tables: list[Table], settings: Settings, check: Check, understood: list[str]
) -> tuple[xr.Dataset, int]:
    """Data of all tables, and the number of their rows."""
    units = {key: words for table in tables for key, words in table.units_in_words().items()}
    has_sheets = any(table.points == "sheets" for table in tables)
    data, frames = [], []
    if not has_sheets or any(table.points == "tubes" for table in tables):
        frame, words = study_of(tables, settings, check)
        understood += words
        frame.attrs[UNITS_IN_FILES] = units
        data.append(_with_labels(_data(frame, tables, settings, check), frame, check))
        frames.append(frame)
    if has_sheets:
        parts, words = sheets_of_study(tables, settings, check)
        understood += words
        _refuse_both(frames, [part.frame for part in parts])
        for frame, arguments in parts:
            frame.attrs[UNITS_IN_FILES] = units
            cycles = {key: of for key, of in settings.conventions.items() if key == "cycles"}
            with _named_in_errors(list(dict.fromkeys(map(file_of, frame.index)))):
                own = sheet_data(frame, **arguments | cycles, check=check)
            data.append(_with_labels(own, frame, check))
            frames.append(frame)
    return combine_tests(*data) if has_sheets else data[0], sum(map(len, frames))


def _refuse_both(tubes: list[pd.DataFrame], sheets: list[pd.DataFrame]) -> None:
    """Refuse labels that tests of tubes and of sheets share."""
    keys = ["specimen", "experiment"]
    of_sheets = {
        tuple(map(str, labels)): place
        for frame in sheets
        for place, *labels in frame[keys].itertuples()
    }
    refuse(
        [
            f"{place} and {of_sheets[tuple(map(str, labels))]}: {named(keys, tuple(labels))} is a "
            "test of a tube and of a sheet: give the two different labels of the experiment"
            for frame in tubes
            for place, *labels in frame[keys].drop_duplicates().itertuples()
            if tuple(map(str, labels)) in of_sheets
        ]
    )


@contextmanager
def _named_in_errors(files: list[str]) -> Iterator[None]:
    """Name the files in an error that names none of them."""
    try:
        yield
    except ValueError as error:
        if any(file in str(error) for file in files):
            raise
        raise ValueError(f"{', '.join(files)}: {error}") from error


def _tables(paths: dict[str, Path], settings: Settings, understood: list[str]) -> list[Table]:
    """Read all files, or raise with the errors of files that cannot be read at all."""
    sheets: list[Sheet] = []
    tables: list[Table] = []
    problems = []
    for name, path in paths.items():
        try:
            sheets += read_sheets(path, name, settings.separator, settings.columns)
        except ValueError as error:
            problems.append(str(error))
    points = [points_in(sheet.names, settings.columns) for sheet in sheets]
    for sheet, of in zip(sheets, points, strict=True):
        try:
            tables.append(table_of(sheet, settings, of, points))
        except ValueError as error:
            problems.append(str(error))
    understood += [table.understood for table in tables]
    if problems:
        refuse(problems + [problem for table in tables for problem in table.problems])
    return tables


def _data(frame: pd.DataFrame, tables: list[Table], settings: Settings, check: Check) -> xr.Dataset:
    """Inflation data of a frame in the package's units."""
    arguments: dict[str, Any] = {"measured": "radius" if "radius" in frame else "outer_diameter"}
    arguments |= {"check": check} | settings.conventions
    measures: dict[str, Any] = {name: name for name in (*GEOMETRY, *WALL) if name in frame}
    measures["convention"] = arguments.pop("opening_angle_convention", None)
    measures["radii_of"] = arguments.pop("radii_of", None)
    measures["sd"] = {name: f"{name}_sd" for name in MEASURES if f"{name}_sd" in frame}
    with _named_in_errors([table.file for table in tables if not table.frame.empty]):
        return inflation_data(frame, Tube(**measures), **arguments)


def _with_labels(data: xr.Dataset, frame: pd.DataFrame, check: Check) -> xr.Dataset:
    """Data with the labels of tests that inflation_data and sheet_data do not know."""
    problems = Problems(check)
    rows = rows_of(frame.loc[data["row"].values], problems)
    labels = {name: rows.frame[name].to_numpy(dtype=str) for name in _KEPT if name in frame}
    labels = {name: ("test", rows.constant(name, of)) for name, of in labels.items()}
    problems.stop()
    return data.assign_coords(labels)
