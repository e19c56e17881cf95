"""Tables of points of sheets as frames for ``sheet_data``, each with its arguments."""

from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from pymc_hyperelastic.data.files.headers import LOADS, names_of
from pymc_hyperelastic.data.files.settings import Constants, Settings
from pymc_hyperelastic.data.files.sheets import Table
from pymc_hyperelastic.data.files.study import (
    constants_in_words,
    contents_in_words,
    joined_tests,
    names_in_words,
    not_found,
    stated_twice,
    without_specimens,
)
from pymc_hyperelastic.data.sheet_columns import AXES, DEFORMATIONS, columns_of
from pymc_hyperelastic.data.validation import Check, refuse
from pymc_hyperelastic.data.variables import STRESS_MEASURE, STRESS_MEASURES
from pymc_hyperelastic.messages import shown
from pymc_hyperelastic.quantities import IN_SHEET_TABLES, IN_TABLES

_LABELS = {name for name, spec in IN_TABLES.items() if spec.dimension == "label"}
# The argument `stress` of sheet_data by the name of the load.
_STATED = {"cauchy_stress": "cauchy", "nominal_stress": "nominal", "force": "force"}
_MEASURES = {"gauge_length": "displacement", "area": "force"}


class Part(NamedTuple):
    """Points with the same columns, in the units of the package, for one call of ``sheet_data``."""

    frame: pd.DataFrame
    arguments: dict[str, Any]


def sheets_of_study(
    tables: list[Table], settings: Settings, check: Check = "warn"
) -> tuple[list[Part], list[str]]:
    """Frames of the points of sheets, and their contents in words.

    Raises ValueError if a column is missing, tables do not fit together, or a test is there twice.
    """
    points = [table for table in tables if table.points == "sheets"]
    others = [table for table in tables if not table.points]
    frames = {table: _with_constants(table, settings) for table in points}
    problems = [problem for table in tables for problem in table.problems]
    problems += not_found(tables, settings) + without_specimens(others)
    for table, frame in frames.items():
        problems += stated_twice(table, _constants(table, settings))
        problems += _missing(table, frame) or _unclear(table, frame)
    refuse(problems)
    of_sheets = [table.frame.filter([*_LABELS, *IN_SHEET_TABLES]) for table in others]
    measured = [name for of in (*DEFORMATIONS, *LOADS) for name in columns_of(of)]
    frame, idle = joined_tests(list(frames.values()), of_sheets, measured, check)
    parts: dict[tuple[str, ...], list[pd.DataFrame]] = {}
    for of_table in frames.values():
        columns = [name for name in measured if name in of_table]
        rows = frame.loc[of_table.index]
        for stress, own in rows.groupby(_stress_of(rows, columns), sort=False):
            parts.setdefault((str(stress), *columns), []).append(own)
    words = [*constants_in_words(settings), *contents_in_words(frame), *idle]
    return [_part(pd.concat(own), *key) for key, own in parts.items()], words


def _with_constants(table: Table, settings: Settings) -> pd.DataFrame:
    """Points with the constants of the settings, and with columns that have no entry at all."""
    # The sheet is free along this axis, or no stress was measured along it.
    empty = {name: np.nan for name in table.headers if name not in {*table.frame, *_LABELS}}
    return table.frame.assign(**empty | _constants(table, settings))


def _constants(table: Table, settings: Settings) -> Constants:
    """Constants of the settings that sheets may have."""
    constants = settings.constants_of(table.file)
    return {name: x for name, x in constants.items() if name in IN_SHEET_TABLES | _LABELS}


def _there(frame: pd.DataFrame, quantities: tuple[str, ...]) -> list[str]:
    """Quantities of which a frame has a column."""
    return [name for name in quantities if not {*columns_of(name)}.isdisjoint(frame)]


def _missing(table: Table, frame: pd.DataFrame) -> list[str]:
    """Columns that points of sheets need and do not have."""
    lacking = [name for name in ("specimen", "experiment") if name not in {*frame, *table.headers}]
    if not _there(frame, tuple(DEFORMATIONS)):
        lacking.append(" or ".join(f"{name}_x" for name in DEFORMATIONS))
    if not lacking:
        return []
    spellings = {name: names_of(name)[1:] for name in (*lacking, "stretch_x")}
    called = "; ".join(
        f"{name} may be called {', '.join(others)}" for name, others in spellings.items() if others
    )
    first = lacking[0].split(" or ")[0]
    return [
        f"{names_in_words(table)}, and no column {', no column '.join(lacking)}: rename it, or "
        f"give its name in the settings, columns.{first} ({called})"
    ]


def _unclear(table: Table, frame: pd.DataFrame) -> list[str]:
    """Problems of several measures of deformation or load, and of a stress without its measure."""
    problems = []
    for what in (tuple(DEFORMATIONS), tuple(LOADS)):
        if len(there := _there(frame, what)) > 1:
            headers = [
                shown(table.headers[name])
                for of in there
                for name in columns_of(of)
                if name in table.headers
            ]
            problems.append(
                f"{table.file} has {' and '.join(headers)}, which state the same: keep one of "
                "them, and name the others in the list ignore of the settings"
            )
    for name, measure in _STATED.items():
        stated = {*frame.get(STRESS_MEASURE, [])} - {measure}
        if stated and name != "force" and _there(frame, (name,)):
            header = next(shown(table.headers[n]) for n in columns_of(name) if n in table.headers)
            problems.append(
                f"{table.file}: {header} is {name.replace('_', ' ')}, and stress_measure is "
                f"{shown(min(stated))}: correct one of them"
            )
    if _there(frame, ("stress",)) and STRESS_MEASURE not in frame:
        header = next(shown(table.headers[n]) for n in columns_of("stress") if n in table.headers)
        problems.append(
            f"{table.file}: {header} may be a Cauchy stress, force over the deformed cross-section "
            "(cauchy), or over the unloaded one (nominal): say which in the settings, "
            'constants.stress_measure = "cauchy" or "nominal", or in the name of the column, as in '
            "Cauchy stress"
        )
    return problems


def _stress_of(rows: pd.DataFrame, columns: list[str]) -> pd.Series:
    """Measure of the stress of every row, as ``sheet_data`` takes it."""
    (load,) = _there(rows[columns], tuple(LOADS))
    if load in _STATED:
        return pd.Series(_STATED[load], rows.index)
    stated = rows[STRESS_MEASURE].str.strip().str.casefold()
    refuse(
        [
            f"{place}: stress_measure is {shown(rows.loc[place, STRESS_MEASURE])}; expected one of "
            f"{STRESS_MEASURES}"
            for place in rows.index[~stated.isin(STRESS_MEASURES)]
        ]
    )
    return stated


def _part(rows: pd.DataFrame, stress: str, *columns: str) -> Part:
    """Points of one measure of deformation and stress, with the arguments that these need."""
    kept = [name for name in rows if name in columns or name in _LABELS]
    arguments: dict[str, Any] = {"stress": stress, "kind": "kind" if "kind" in rows else "biaxial"}
    for measure, of in _MEASURES.items():
        if not _there(rows[list(columns)], (of,)):
            continue
        by_axis = [f"{measure}_{axis}" for axis in AXES]
        if measure in rows:
            arguments[measure], names = measure, [measure]
        elif all(name in rows for name in by_axis):
            arguments[measure], names = tuple(by_axis), by_axis
        else:
            raise ValueError(
                f"{rows.index[0]}: there is a {of}, and no {measure.replace('_', ' ')}: give the "
                f"tables a column {measure}, or {by_axis[0]} and {by_axis[1]}, or the settings "
                f"constants.{measure}"
            )
        kept += names
    plain = {name: name.replace(f"{stress}_stress", "stress") for name in columns}
    frame = rows[kept].rename(columns=plain)
    if "kind" in frame:
        frame["kind"] = frame["kind"].fillna("biaxial")
    return Part(frame, arguments)
