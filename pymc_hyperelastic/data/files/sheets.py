"""One sheet of a laboratory as a frame: what its columns are, numbers in the package's units.

All that is wrong with a sheet is collected, each with its file, line, column and cell.
"""

from dataclasses import dataclass, replace
from typing import cast

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymc_hyperelastic.data.files.cells import (
    Column,
    numbers_of,
    told,
    unit_of,
    units_of_cells,
)
from pymc_hyperelastic.data.files.headers import (
    LABELS,
    NEEDED,
    TWO_MEANINGS,
    called,
    comparable,
    heading,
)
from pymc_hyperelastic.data.files.numerals import (
    DECIMALS,
    Decimal,
    decimal_of,
    is_missing,
    number,
)
from pymc_hyperelastic.data.files.settings import Settings
from pymc_hyperelastic.data.files.spellings import Unit, internal_unit, known_unit
from pymc_hyperelastic.data.files.text import SEPARATORS, Sheet, no_rows
from pymc_hyperelastic.data.labels import plain_label
from pymc_hyperelastic.messages import shown

# Columns that are named as not used.
_MOST_UNUSED = 100
_NO_LABEL = "is missing: give every line its label, fill the column down"


@dataclass(frozen=True, eq=False)
class Table:
    """A sheet that was understood: its frame, what is wrong with it, and what was understood.

    The frame has the package's names and units, and is labelled by file and line.
    """

    sheet: Sheet
    columns: list[Column]
    units: dict[str, Unit]
    frame: pd.DataFrame
    problems: list[str]
    understood: str

    def header(self, name: str) -> str:
        """What the file calls a column."""
        return next(column.header for column in self.columns if column.name == name)

    def taken(self, kind: str) -> list[str]:
        """In which units columns of a kind were taken, in words."""
        return [
            f"{shown(self.header(name))} of {self.sheet.file} was taken in {unit.spelling}"
            for name, unit in self.units.items()
            if unit.kind == kind
        ]


def table_of(sheet: Sheet, settings: Settings) -> Table:
    r"""What a sheet holds.

    Examples
    --------
    >>> from pymc_hyperelastic.data.files.text import sheet_of
    >>> sheet = sheet_of("id;p [mmHg];note\nS1;7,5;\n", "a.csv", "UTF-8")
    >>> table = table_of(sheet, Settings())
    >>> print(table.frame.round(6))
                  specimen  pressure
    a.csv, line 2       S1  0.999918
    >>> print(table.understood)
    a.csv: UTF-8, separated by semicolons, decimal commas, 1 row
      'id' is specimen: 1 label
      'p [mmHg]' is pressure in mmHg (1 mmHg is 0.133322 kPa): 7.5
      not used: 'note'
    """
    columns, unused, problems = _columns(sheet, settings)
    needed = {*NEEDED, *(known.name for known in settings.columns.values())}
    columns, sheet = _without_unit_row(sheet, columns)
    decimal, doubts = _decimal(sheet, columns, settings)
    problems += doubts
    values: dict[str, list[str] | NDArray[np.float64]] = {}
    units: dict[str, Unit] = {}
    words = []
    for column in columns:
        cells = sheet.column(column.position)
        is_label = column.name in LABELS
        if all(not cell if is_label else is_missing(cell) for cell in cells):
            unused.append(f"{shown(column.header)} (empty)")
            if column.name in needed:
                problems.append(
                    f"{sheet.file}: {shown(column.header)}, which is {column.name}, has no entry "
                    "in any line: fill it in, or name another column in the settings"
                )
        elif is_label:
            values[column.name] = cells
            words.append(_label_in_words(column, cells))
            bad = [(i, why) for i, cell in enumerate(cells) if (why := _why_no_label(cell))]
            problems += told(sheet, column, bad)
        else:
            unit, wrong = unit_of(sheet, column, settings)
            numbers, no_numbers = numbers_of(sheet, column, decimal)
            problems += wrong + no_numbers
            values[column.name] = numbers * column.scale * (unit.factor if unit else np.nan)
            words.append(_number_in_words(column, unit, numbers))
            units |= {column.name: unit} if unit else {}
    frame = pd.DataFrame(values, index=[sheet.place(i) for i in range(len(sheet.rows))])
    count = len(sheet.rows)
    head = (
        f"{sheet.file}: {sheet.encoding}, separated by {SEPARATORS[sheet.separator]}, "
        f"{DECIMALS[decimal]}, {count} row{'s' * (count > 1)}"
    )
    if unused:
        others = len(unused) - _MOST_UNUSED
        more = f" and {others} others" if others > 0 else ""
        words.append(f"not used: {', '.join(unused[:_MOST_UNUSED])}{more}")
    return Table(sheet, columns, units, frame, problems, "\n  ".join([head, *words]))


def _columns(sheet: Sheet, settings: Settings) -> tuple[list[Column], list[str], list[str]]:
    """Columns that are understood, the names of all others, and what is wrong with names."""
    columns: dict[str, Column] = {}
    unused, problems = [], []
    ignored = {comparable(name) for name in settings.ignore}
    said = {comparable(text): known for text, known in settings.columns.items()}
    named = {known.name for known in said.values()}
    where = f"{sheet.file}, line {sheet.name_line}"
    for position, header in enumerate(sheet.names):
        names = called(header)
        known = heading(header)
        if known and known.name in named:
            known = None
        known = next((said[name] for name in names if name in said), known)
        if not known or not ignored.isdisjoint(names):
            unused.append(shown(header) if header else "a column without a name")
            continue
        column = Column(position, header, known.name, known.scale)
        if column.name in columns:
            problems.append(
                f"{where}: {shown(columns[column.name].header)} and {shown(header)} are both "
                f"{column.name}: rename one, or name it in the list ignore of the settings"
            )
        columns.setdefault(column.name, column)
    for column in columns.values():
        name = comparable(column.header)
        meanings = TWO_MEANINGS.get(name, ())
        cells = sheet.column(column.position) if meanings and name not in said else []
        beside_another = "outer_diameter" in columns and _are_numbers(cells)
        if cells and (beside_another or _are_measured(cells)):
            ways = " or ".join(
                f"columns.{meaning} = {shown(column.header)}" for meaning in meanings
            )
            problems.append(
                f"{where}: {shown(column.header)} may be {' or '.join(meanings)}: say which in "
                f"the settings, {ways}"
            )
    return list(columns.values()), unused, problems


def _are_measured(cells: list[str]) -> bool:
    """Return True where all cells are numbers with decimals, as labels are not."""
    return any(mark in cell for cell in cells for mark in DECIMALS) and _are_numbers(cells)


def _are_numbers(cells: list[str]) -> bool:
    return all(any(number(cell, mark) is not None for mark in DECIMALS) for cell in cells)


def _why_no_label(cell: str) -> str:
    """Return what is wrong with a label, or nothing."""
    try:
        return "" if plain_label(cell) else _NO_LABEL
    except ValueError as error:
        return f"is unusable: {error}"


def _without_unit_row(sheet: Sheet, columns: list[Column]) -> tuple[list[Column], Sheet]:
    """Columns with the units that the line below the names states, and the sheet without it."""
    below = {c: sheet.rows[0][c.position].strip("[](){} ") for c in columns if c.name not in LABELS}
    known = {column: known_unit(text, column.kind) for column, text in below.items()}
    stated = [unit for unit in known.values() if unit and unit.kind != "ratio"]
    if not stated or any(not (known[c] or is_missing(text)) for c, text in below.items()):
        return columns, sheet
    columns = [
        column._replace(unit_below=below[column] if known.get(column) else None)
        for column in columns
    ]
    rest = replace(sheet, rows=sheet.rows[1:], lines=sheet.lines[1:])
    if not rest.rows:
        raise no_rows(sheet.file, sheet.lines[0])
    return columns, rest


def _decimal(sheet: Sheet, columns: list[Column], settings: Settings) -> tuple[Decimal, list[str]]:
    """Decimal mark of a sheet, and what to ask where its numbers leave it open."""
    cells = [
        text
        for column in columns
        if column.name not in LABELS
        for text, _ in units_of_cells(column, sheet.column(column.position))
        if not is_missing(text)
    ]
    decimal, either = decimal_of(cells)
    if settings.decimal:
        return cast(Decimal, settings.decimal), []
    # Between semicolons commas are decimal, or there would be commas between the cells.
    if not either or sheet.separator == ";":
        return decimal, []
    example = next(cell for cell in cells if "," in cell)
    return decimal, [
        f"{sheet.file}: {shown(example)}, and whatever else has a comma, may have a decimal comma "
        'or thousands that are set apart: say decimal = "," or decimal = "." in the settings'
    ]


def _label_in_words(column: Column, cells: list[str]) -> str:
    count = len(set(cells))
    return f"{shown(column.header)} is {column.name}: {count} label{'s' * (count > 1)}"


def _number_in_words(column: Column, unit: Unit | None, numbers: NDArray[np.float64]) -> str:
    half = "half of " if column.scale != 1 else ""
    words = f"{half}{shown(column.header)} is {column.name}"
    if unit and (unit.kind, unit.factor) != ("ratio", 1):
        words += f" in {unit.spelling}"
        if unit.factor != 1:
            one = f"{unit.factor:.6g} {internal_unit(unit.kind)}".strip()
            words += f" (1 {unit.spelling} is {one})"
    known = column.scale * numbers[np.isfinite(numbers)]
    if known.size:
        ends = dict.fromkeys(f"{end:.6g}" for end in (known.min(), known.max()))
        words += f": {' to '.join(ends)}"
    missing = len(numbers) - known.size
    return words + (f", {missing} missing" if missing else "")
