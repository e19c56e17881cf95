"""The tables of a study as one frame of points, without missing columns and repeated tests."""

from collections.abc import Iterable

import pandas as pd

from pymc_hyperelastic.data.files.headers import NEEDED, names_of
from pymc_hyperelastic.data.files.join import joined, named
from pymc_hyperelastic.data.files.settings import Constants, Settings
from pymc_hyperelastic.data.files.sheets import Table
from pymc_hyperelastic.data.inflation import FEWEST_COPIED, file_of
from pymc_hyperelastic.data.validation import Check, refuse
from pymc_hyperelastic.data.variables import TEST_LABELS
from pymc_hyperelastic.mechanics.reference_tube import WALL
from pymc_hyperelastic.messages import listed, shown
from pymc_hyperelastic.quantities import IN_SHEET_TABLES, IN_TABLES
from pymc_hyperelastic.rounding import DIGITS

MEASURED = ("radius", "outer_diameter")
# Defaults for columns that a study lacks, in words.
_OTHERWISE = {"axial_stretch": "1 is taken", "opening_angle": "0 is taken"}
# Names in tables of sheets of quantities that tables of tubes call otherwise.
_OF_SHEETS = {"axial_stretch": "stretch"}
_RADII = ("inner_radius", "outer_radius")


def study_of(
    tables: list[Table], settings: Settings, check: Check = "warn"
) -> tuple[pd.DataFrame, list[str]]:
    """One frame of all points, and its contents in words.

    Raises ValueError if a column is missing, tables do not fit together, or a test is there twice.
    """
    points = [table for table in tables if not {*MEASURED, "pressure"}.isdisjoint(table.frame)]
    others = [table for table in tables if table not in points and table.points != "sheets"]
    constants = {table: settings.constants_of(table.file) for table in points}
    problems = [problem for table in tables for problem in table.problems]
    problems += [what for each in constants.items() for what in stated_twice(*each)]
    frames = {table: table.frame.assign(**of_table) for table, of_table in constants.items()}
    problems += not_found(tables, settings) + _missing(frames, others, settings)
    refuse(problems)
    of_tubes = [table.frame.drop(columns=IN_SHEET_TABLES, errors="ignore") for table in others]
    measured = [*MEASURED, "pressure", "axial_force"]
    frame, idle = joined_tests(list(frames.values()), of_tubes, measured, check)
    frame, unused = _chosen(frame, settings, ", ".join(table.file for table in tables))
    words = [*constants_in_words(settings), *contents_in_words(frame)]
    words += [f"no {name}: {what}" for name, what in _OTHERWISE.items() if name not in frame]
    return frame, [*words, *_without_radii(frame), *idle, *unused]


def stated_twice(table: Table, constants: Constants) -> list[str]:
    """Problems of constants that have a column too."""
    return [
        f"{name} is {shown(value)} in the settings, and {table.file} has a column of it, "
        f"{shown(table.headers[name])}: remove one, or name the column in the list ignore"
        for name, value in constants.items()
        if name in table.frame
    ]


def joined_tests(
    points: list[pd.DataFrame], others: list[pd.DataFrame], measured: list[str], check: Check
) -> tuple[pd.DataFrame, list[str]]:
    """Join tables of specimens to those of points; return the frame, and rows without points.

    Raises ValueError if a test is in several files, or two have the same `measured` points.
    """
    frame, idle = joined(pd.concat(points), others)
    for name in {"experiment", "cycle"} & {*frame}:
        frame[name] = _counted(frame[name])
    tests = frame.groupby([name for name in TEST_LABELS if name in frame], sort=False)
    refuse(_scattered(tests))
    refuse([] if check == "ignore" else _alike(tests, measured))
    return frame, idle


def constants_in_words(settings: Settings) -> list[str]:
    """Constants of the settings, in words."""

    def words(name: str, value: float | str) -> str:
        if isinstance(value, str):
            return f"{name} {value!r}"
        unit = IN_TABLES[name].unit
        return f"{name} {value:.6g}{'' if unit == '1' else f' {unit}'}"

    places = {"all files": settings.constants} | settings.files
    return [
        f"the same in all rows of {place}: {', '.join(words(*each) for each in constants.items())}"
        for place, constants in places.items()
        if constants
    ]


def names_in_words(table: Table) -> str:
    """The columns of a file, in words."""
    names = table.names
    if len(names) == 1:
        return (
            f"{table.file} has one column, {shown(names[0])} (separate columns by tabs, "
            "semicolons or commas, and begin remarks above their names with #)"
        )
    return f"{table.file} has {listed(names)}"


def not_found(tables: list[Table], settings: Settings) -> list[str]:
    """Files and columns that the settings name, and that are not there."""
    texts: dict[str, list[str]] = {}
    for text, known in settings.columns.items():
        texts.setdefault(known.name, []).append(shown(text))
    files = [table.file for table in tables]
    problems = [
        f"files.{shown(file)} of the settings is not among the files, {listed(files)}"
        for file in settings.files
        if file not in files
    ]
    return problems + [
        f"columns.{name} of the settings is {' or '.join(said)}, and no file has such a column: "
        f"{'; '.join(map(names_in_words, tables))}"
        for name, said in texts.items()
        if not any({name, _OF_SHEETS.get(name)} & {*table.headers} for table in tables)
    ]


def _missing(
    points: dict[Table, pd.DataFrame], others: list[Table], settings: Settings
) -> list[str]:
    """Columns that the tables need and do not have."""
    measured = settings.conventions.get("measured")
    needed = [("specimen",), ("experiment",), (measured,) if measured else MEASURED, ("pressure",)]
    problems = []
    for table, frame in (points or {table: table.frame for table in others}).items():
        # A column that is known and empty is a problem of its table.
        known = {*frame} | ({*table.headers} & {*NEEDED})
        lacking = [names for names in needed if known.isdisjoint(names)]
        if not lacking:
            continue
        none = ", no column ".join(" or ".join(names) for names in lacking)
        spellings = {name: names_of(name)[1:] for names in lacking for name in names}
        called = "; ".join(
            f"{name} may be called {', '.join(others)}"
            for name, others in spellings.items()
            if others
        )
        of_sheets = (
            "; points of sheets have columns such as stretch_x, and cauchy_stress_x, "
            "nominal_stress_x or force_x"
            if {("pressure",), MEASURED} <= {*lacking}
            else ""
        )
        problems.append(
            f"{names_in_words(table)}, and no column {none}: rename the one that holds it, or say "
            f"what it is called, columns.{lacking[0][0]} in the settings, or what it is in all "
            f"rows, constants.{lacking[0][0]} ({called}{of_sheets})"
        )
    return problems + (without_specimens(others) if points else [])


def without_specimens(others: list[Table]) -> list[str]:
    """Problems of tables that have neither points nor specimens."""
    return [
        f"{names_in_words(table)}: these are no points, with pressures, and no specimens, with a "
        "column specimen; leave the file out, or say in the settings what its columns are"
        for table in others
        if "specimen" not in table.frame
    ]


def _chosen(frame: pd.DataFrame, settings: Settings, files: str) -> tuple[pd.DataFrame, list[str]]:
    """The frame without columns that are not needed, and these columns in words."""
    unused = {}
    if all(name in frame for name in MEASURED):
        taken = settings.conventions.get("measured")
        if taken not in MEASURED:
            raise ValueError(
                f"{files}: radius and outer_diameter have columns: say which was measured, "
                'measured = "radius" or measured = "outer_diameter" in the settings'
            )
        unused[next(name for name in MEASURED if name != taken)] = f"{taken} was measured"
    if "length" in frame and "wall_volume" not in frame:
        unused["length"] = "of the tube it says nothing without wall_volume"
    if "wall_volume" in frame and "length" not in frame:
        raise ValueError(
            f"{files}: wall_volume has a column, and the length of the unloaded tube has none: "
            "give the tables a column length, or the settings constants.length"
        )
    frame = frame.drop(columns=list(unused))
    wall = [name for name in (*WALL, "wall_volume") if name in frame]
    stated = [name for name in _RADII if name in frame] + wall
    if wall and len(stated) > 2:
        raise ValueError(
            f"{files}: the tube without load is stated by {', '.join(stated)}, which is too much: "
            "keep one radius and one measure of the wall, and name the columns of the others in "
            "the list ignore of the settings"
        )
    if "wall_volume" in frame:
        frame = frame.assign(wall_area=frame["wall_volume"] / frame["length"])
    return frame, [f"not used: {name}, since {why}" for name, why in unused.items()]


def _counted(labels: pd.Series) -> pd.Series:
    """Labels as integers if all are written as such; 1.0 is how spreadsheets may write a cycle."""
    written = labels.str.removesuffix(".0") if labels.name == "cycle" else labels
    return written.astype("int64") if written.str.fullmatch("0|[1-9][0-9]{0,17}").all() else labels


def _scattered(tests: pd.api.typing.DataFrameGroupBy) -> list[str]:
    """Problems of tests whose rows stand in several files."""
    frame = tests.obj
    files = frame.index.map(file_of)
    first = frame.loc[~pd.DataFrame({"test": tests.ngroup(), "file": files}).duplicated()]
    begins: dict[tuple, list[str]] = {}
    for place, *labels in first[tests.keys].itertuples():
        begins.setdefault(tuple(labels), []).append(place)
    return [
        f"{' and '.join(places)}: {named(tests.keys, labels)} begins in several files: give two "
        "experiments two labels, or put the rows of one into one file"
        for labels, places in begins.items()
        if len(places) > 1
    ]


def _alike(tests: pd.api.typing.DataFrameGroupBy, names: Iterable[str]) -> list[str]:
    """Problems of two experiments with the same points of the given names, as if copied."""
    seen: dict[tuple, tuple[tuple, str]] = {}
    problems = []
    measured = tests.obj.columns.intersection([*names])
    for labels, rows in tests:
        values = rows[measured].to_numpy()
        points = tuple(sorted(tuple(f"{x:.{DIGITS}g}" for x in row) for row in values))
        # Its cycles may well be the same, as they are read.
        experiment, place = labels[:2], f"{named(tests.keys, labels)} ({rows.index[0]})"
        other, first = seen.setdefault(points, (experiment, place))
        if len(points) >= FEWEST_COPIED and other != experiment:
            problems.append(
                f"{first} and {place} have the same {len(points)} points, as if one had been "
                'copied: remove one, or correct it; if it is right, say check="ignore"'
            )
    return problems


def contents_in_words(frame: pd.DataFrame) -> list[str]:
    """Numbers of specimens, experiments and points of a study in words."""

    def count(n: int, what: str) -> str:
        return f"{n} {what}{'s' * (n != 1)}"

    specimens = frame["specimen"].nunique()
    experiments = frame.groupby(["specimen", "experiment"]).ngroups
    words = [
        f"together: {count(specimens, 'specimen')}, {count(experiments, 'experiment')}, "
        f"{count(len(frame), 'point')}"
    ]
    if "group" in frame:
        groups = frame.groupby("group", sort=False)["specimen"].nunique()
        words += [f"group {group!r}: {count(n, 'specimen')}" for group, n in groups.items()]
    return words


def _without_radii(frame: pd.DataFrame) -> list[str]:
    """Consequences of radii of the unloaded tube that have no column, in words."""
    wall = ["wall_volume", "length"] if "wall_volume" in frame else frame.columns.intersection(WALL)
    lacking = [name for name in _RADII if name not in frame]
    if len(wall) and len(lacking) == 1:
        return [f"no {lacking[0]}: it follows from {' and '.join(wall)}"]
    return [
        f"no {name}: no law can be fitted without; give the tables a column of it, the settings "
        f"constants.{name}, or a model in Python a prior"
        for name in lacking
    ]
