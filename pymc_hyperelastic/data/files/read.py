"""Inflation data from the files of a laboratory, and what was understood of them."""

import io
import os
import re
import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

from pymc_hyperelastic.data.columns import rows_of
from pymc_hyperelastic.data.doubt import Check, check_known, counted, refuse
from pymc_hyperelastic.data.files.join import named
from pymc_hyperelastic.data.files.settings import OF_KIND, Settings, read_settings, settings_of
from pymc_hyperelastic.data.files.sheets import Table, table_of
from pymc_hyperelastic.data.files.study import study_of
from pymc_hyperelastic.data.files.text import read_sheet
from pymc_hyperelastic.data.geometry import WALL
from pymc_hyperelastic.data.inflation import MEASURES
from pymc_hyperelastic.data.table import inflation_data
from pymc_hyperelastic.messages import PACKAGE, shown

Paths = str | os.PathLike[str] | Iterable[str | os.PathLike[str]]

# What to do about rows of a frame, and what about lines of a file.
_IN_FILES = {
    r"drop it, frame\.drop_duplicates\(\)": "delete the line",
    r"sort them, frame\.sort_values\(.*?\)": "sort them",
}
# Labels that stay with the tests, besides those that inflation_data knows.
_KEPT = ("animal", "split")


def read_tests(
    files: Paths,
    settings: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    *,
    check: Check = "warn",
) -> xr.Dataset:
    """Read inflation data from the text files of a laboratory as they are.

    Separators, decimal marks and encodings are found; columns are known by their names, with units
    in the names, in a line below them or in the settings. Tables of points are put below each
    other, and tables of specimens are joined to them. What may mean two things is asked, and all
    that is wrong is told at once.

    Parameters
    ----------
    files : path or iterable of paths
        CSV, TSV or text files of one study; one of them may be the TOML file of its settings.
        A table with a pressure or a measured radius is one of points, one a row. Others are of
        specimens, or of experiments where they have such a column, and are joined by it. The names
        of columns that are known are on the page What a file may look like.
    settings : path or dict, optional
        A TOML file, or a dict of the same form, for what the tables do not say. Keys are
        ``measured``, ``opening_angle_convention``, ``radii_of``, ``cycles``, as
        :func:`~pymc_hyperelastic.inflation_data` has them; ``pressure_unit``, ``radius_unit``,
        ``angle_unit``, ``force_unit`` for columns that state none; ``decimal``, ``separator``;
        ``ignore``, a list of columns; and the tables ``columns`` (what a column is called in the
        files), ``units`` (of one column), ``constants`` (the same in all rows) and ``files`` (the
        same in all rows of one file, by its name).
    check : {"warn", "raise", "ignore"}
        What to do about input that is possible, but probably not what was meant.

    Returns
    -------
    xarray.Dataset
        As :func:`~pymc_hyperelastic.inflation_data` builds it. ``row`` names file and line of each
        point; ``animal`` and ``split`` are coordinates of the tests where there are such columns.
        The attribute ``understood`` says in words what each file and each column was taken for.

    Raises
    ------
    OSError
        If a file cannot be opened.
    TypeError
        If `files` are no paths, or `settings` neither a path nor a dict.
    ValueError
        If something cannot be understood, or is not sound; the message names files, lines, columns
        and cells. What was understood until then is a note of the error (``__notes__``).

    Warns
    -----
    UserWarning
        Of what :func:`~pymc_hyperelastic.inflation_data` warns.

    See Also
    --------
    inflation_data, select

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
    paths, said = _given(files, settings)
    understood: list[str] = []
    try:
        tables = _tables(paths, said, understood)
        frame, words = study_of(tables, said, check)
        understood += words
        data, told = _data(frame, tables, said, check)
    except ValueError as error:
        if understood:
            error.add_note("What was understood:\n" + "\n".join(understood))
        raise
    if data.sizes["obs"] < len(frame):
        understood.append(f"of these the last cycle of each, {data.sizes['obs']} points, is taken")
    for message in told:
        warnings.warn(message, skip_file_prefixes=(PACKAGE,))
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
            "open file to a file first"
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
    by_name = {p.name if names.count(p.name) == 1 else str(p): p for p in paths}
    if toml:
        return by_name, read_settings(toml[0])
    return by_name, settings_of(settings or {}, "")  # type: ignore[arg-type]


def _tables(paths: dict[str, Path], settings: Settings, understood: list[str]) -> list[Table]:
    """Read all files, or raise with what is wrong with those that cannot be read at all."""
    tables: list[Table] = []
    problems = []
    for name, path in paths.items():
        try:
            tables.append(
                table_of(read_sheet(path, name, settings.separator, settings.columns), settings)
            )
        except ValueError as error:
            problems.append(str(error))
    understood += [table.understood for table in tables]
    if problems:
        refuse(problems + [problem for table in tables for problem in table.problems])
    return tables


def _data(
    frame: pd.DataFrame, tables: list[Table], settings: Settings, check: Check
) -> tuple[xr.Dataset, list[str]]:
    """Inflation data of a frame in the package's units, and of what was warned."""
    arguments: dict[str, Any] = {name: name if name in frame else None for name in WALL}
    arguments |= {n: n if n in frame else None for n in ("inner_radius", "outer_radius")}
    arguments |= {n: n for n in ("axial_stretch", "opening_angle") if n in frame}
    errors = {name: f"{name}_sd" for name in MEASURES if f"{name}_sd" in frame}
    arguments |= {"geometry_sd": errors, "check": check}
    arguments |= {"measured": "radius" if "radius" in frame else "outer_diameter"}
    arguments |= settings.conventions

    def build(rows: pd.DataFrame) -> tuple[xr.Dataset, list[str]]:
        try:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                data = _with_labels(inflation_data(rows, **arguments), rows)
        except ValueError as error:
            raise ValueError(_of_files(str(error), rows, tables)) from error
        return data, [_of_files(str(warning.message), rows, tables) for warning in caught]

    try:
        return build(frame)
    except ValueError as error:
        # Each experiment by itself, to tell what is wrong with all; what is the same is told once.
        problems: dict[str, list[str]] = {}
        for labels, rows in frame.groupby(["specimen", "experiment"], sort=False):
            try:
                build(rows)
            except ValueError as problem:
                what = str(problem).replace(named(["specimen", "experiment"], labels), "")
                problems.setdefault(what, []).append(str(problem))
        refuse([counted(same) for same in problems.values()] or [str(error)])
        raise


def _with_labels(data: xr.Dataset, frame: pd.DataFrame) -> xr.Dataset:
    """Data with labels of the tests that :func:`inflation_data` does not know."""
    rows = rows_of(frame.loc[data["row"].values])
    labels = {name: rows.frame[name].to_numpy(dtype=str) for name in _KEPT if name in frame}
    return data.assign_coords({n: ("test", rows.constant(n, of)) for n, of in labels.items()})


def _of_files(message: str, rows: pd.DataFrame, tables: list[Table]) -> str:
    """Message of :func:`inflation_data`, with the files and columns that it is of."""
    places = rows.index.str.rpartition(", line ").get_level_values(0).unique()
    files = [table for table in tables if table.sheet.file in places]
    names = "|".join(re.escape(table.sheet.file) for table in files)
    message = re.sub(rf"\brow (?=(?:{names}), line [0-9])", "", message)
    for of_frames, of_files in _IN_FILES.items():
        message = re.sub(of_frames, of_files, message)
    if not re.search(names, message):
        message = f"{', '.join(table.sheet.file for table in files)}: {message}"
    kinds = [kind for keyword, kind in OF_KIND.items() if f"{keyword}=" in message]
    taken = [words for kind in kinds for table in files for words in table.taken(kind)]
    return f"{message} ({'; '.join(taken)})" if taken else message
