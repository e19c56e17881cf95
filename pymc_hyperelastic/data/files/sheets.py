"""One sheet of a laboratory as a frame: what its columns are, numbers in the package's units.

All that is wrong with a sheet is collected, each problem with its file, line, column and cell.
"""

from collections import defaultdict
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import NamedTuple, cast

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymc_hyperelastic.data.files.headers import (
    NEEDED,
    TWO_MEANINGS,
    Heading,
    Points,
    allowed,
    called,
    comparable,
    heading,
    unit_in,
)
from pymc_hyperelastic.data.files.numerals import (
    DECIMALS,
    Decimal,
    decimal_of,
    is_missing,
    number,
    split_unit,
    why_no_number,
)
from pymc_hyperelastic.data.files.settings import UNIT_KEYS, Settings
from pymc_hyperelastic.data.files.text import Sheet, lines_in_words, no_rows
from pymc_hyperelastic.data.labels import plain_label
from pymc_hyperelastic.data.units import Unit, expected_units, known_unit
from pymc_hyperelastic.messages import enumerated, shown
from pymc_hyperelastic.quantities import IN_SHEET_TABLES, IN_TABLES, UNITS

# Columns of numbers of which some cells may be missing; sheet_data refuses those it needs.
_MAY_BE_MISSING = {"axial_force", *IN_SHEET_TABLES}


class Column(NamedTuple):
    """A column of a sheet: its meaning, and its cells as text, by line."""

    header: str
    meaning: Heading
    cells: pd.Series
    unit_below: Unit | None = None
    """Unit in a line below the names."""

    @property
    def name(self) -> str:
        """Its name in the package."""
        return self.meaning.name

    def numbers_and_units(self) -> list[tuple[str, str | None]]:
        """Numbers and units of the cells, both as written."""
        dimension = self.meaning.dimension
        return [split_unit(cell, lambda text: known_unit(text, dimension)) for cell in self.cells]


@dataclass(frozen=True, eq=False)
class Table:
    """A sheet as a frame, with its problems, and a description in words.

    The frame has the package's names and units, and is labelled by file and line.
    """

    file: str
    names: list[str]
    headers: dict[str, str]
    """Headers of the columns, by their names in the package."""
    units: dict[str, Unit]
    frame: pd.DataFrame
    problems: list[str]
    understood: str
    points: Points = ""
    """The kind of its points, or empty text if it has none."""

    def units_in_words(self) -> dict[tuple[str, str], str]:
        """In which units columns were read, by file and dimension."""
        words = defaultdict(list)
        for name, unit in self.units.items():
            column = f"{shown(self.headers[name])} of {self.file} was taken in {unit.spelling}"
            words[self.file, unit.dimension].append(column)
        return {key: "; ".join(columns) for key, columns in words.items()}


def table_of(
    sheet: Sheet, settings: Settings, points: Points = "tubes", kinds: Collection[Points] = ()
) -> Table:
    r"""Table of a sheet, with these `points`, in a study with points of these `kinds`.

    Examples
    --------
    >>> from pymc_hyperelastic.data.files.text import sheet_of
    >>> sheet = sheet_of("id;p [mmHg];note\nS1;7,5;\n", "UTF-8", "a.csv")
    >>> print(table_of(sheet, Settings()).understood)
    a.csv: UTF-8, separated by semicolons, decimal commas, 1 row
      'id' is specimen: 1 label
      'p [mmHg]' is pressure in mmHg (1 mmHg is 0.133322 kPa): 7.5
      not used: 'note'
    """
    columns, unused, problems = _columns(sheet, settings, allowed(points, kinds))
    columns = _without_unit_row(sheet, columns)
    decimal, questions = _decimal(sheet, columns, settings)
    problems += questions
    needed = {*NEEDED, *(known.name for known in settings.columns.values())}
    values: dict[str, pd.Series | NDArray[np.float64]] = {}
    units: dict[str, Unit] = {}
    words = []
    for column in columns:
        is_label = column.meaning.is_label
        if all(not cell if is_label else is_missing(cell) for cell in column.cells):
            if column.name in IN_SHEET_TABLES:
                words.append(f"{shown(column.header)} is {column.name}, without any entry")
                continue
            unused.append(f"{shown(column.header)} (empty)")
            if column.name in needed:
                problems.append(
                    f"{sheet.file}: {shown(column.header)}, which is {column.name}, has no entry "
                    "in any line: fill it in, or name another column in the settings"
                )
        elif is_label:
            values[column.name] = column.cells
            count = column.cells.nunique()
            of_labels = f"{count} label{'s' * (count > 1)}"
            words.append(f"{shown(column.header)} is {column.name}: {of_labels}")
            problems += _problems(sheet, column, map(_why_no_label, column.cells))
        else:
            texts = column.numbers_and_units()
            unit, wrong = _unit_of(sheet, column, texts, settings)
            cells = [text for text, _ in texts]
            found = [None if is_missing(cell) else number(cell, decimal) for cell in cells]
            numbers = np.array([np.nan if x is None else x for x in found])
            problems += wrong
            why = (_why_no_number(column.name, cell, decimal) for cell in cells)
            problems += _problems(sheet, column, why)
            values[column.name] = numbers * column.meaning.scale * (unit.factor if unit else np.nan)
            words.append(_number_in_words(column, unit, numbers))
            units |= {column.name: unit} if unit else {}
    lines = columns[0].cells.index if columns else sheet.lines
    frame = pd.DataFrame(values, index=lines).set_axis([sheet.place(i) for i in lines])
    rows = f"{len(frame)} row{'s' * (len(frame) > 1)}"
    understood = [f"{sheet.file}: {sheet.form}, {DECIMALS[decimal]}, {rows}", *words]
    if unused:
        understood.append(f"not used: {enumerated(unused)}")
    headers = {column.name: column.header for column in columns}
    text = "\n  ".join(understood)
    return Table(sheet.file, sheet.names, headers, units, frame, problems, text, points)


def _columns(
    sheet: Sheet, settings: Settings, allowed: set[str]
) -> tuple[list[Column], list[str], list[str]]:
    """Columns with a known meaning, the headers of all others, and problems of headers."""
    columns: dict[str, Column] = {}
    unused, problems = [], []
    ignored = {comparable(name) for name in settings.ignore}
    stated = {comparable(text): known for text, known in settings.columns.items()}
    named = {known.name for known in stated.values()}
    where = f"{sheet.file}, line {sheet.name_line}"

    def cells_of(position: int) -> pd.Series:
        return pd.Series([row[position] for row in sheet.cells], sheet.lines)

    for position, header in enumerate(sheet.names):
        names = called(header)
        known = heading(header)
        if known and known.name in named:
            known = None
        known = next((stated[name] for name in names if name in stated), known)
        is_stretch = "stretch" in names or not stated.keys().isdisjoint(names)
        if known and known.name not in allowed:
            # The stretch of a tube is axial, and that of a sheet along the axis that is pulled.
            is_stretch &= known.name == "axial_stretch"
            known = known._replace(name="stretch") if is_stretch else None
        if not known or not ignored.isdisjoint(names):
            unused.append(shown(header) if header else "a column without a name")
            continue
        if known.name in columns:
            problems.append(
                f"{where}: {shown(columns[known.name].header)} and {shown(header)} are both "
                f"{known.name}: rename one, or name it in the list ignore of the settings"
            )
        columns.setdefault(known.name, Column(header, known, cells_of(position)))
    for column in columns.values():
        name = next((name for name in called(column.header) if name in TWO_MEANINGS), "")
        meanings = () if name in stated else TWO_MEANINGS.get(name, ())
        beside = "outer_diameter" in columns
        if meanings and (name != "id" or _are_measured(column, beside)):
            ways = " or ".join(f"columns.{m} = {shown(column.header)}" for m in meanings)
            problems.append(
                f"{where}: {shown(column.header)} may be {' or '.join(meanings)}: say which in "
                f"the settings, {ways}"
            )
    return list(columns.values()), unused, problems


def _are_measured(column: Column, beside_another: bool) -> bool:
    """Return True if all cells are numbers, and have decimals or stand beside a diameter."""
    decimals = any(mark in cell for cell in column.cells for mark in DECIMALS)
    return (decimals or beside_another) and all(
        any(number(cell, mark) is not None for mark in DECIMALS) for cell in column.cells
    )


def _without_unit_row(sheet: Sheet, columns: list[Column]) -> list[Column]:
    """Columns without the line below the names if it states units, which they have then."""
    below = {c.name: c.cells.iloc[0].strip("[](){} ") for c in columns if not c.meaning.is_label}
    units = {name: known_unit(text, IN_TABLES[name].dimension) for name, text in below.items()}
    stated = [unit for unit in units.values() if unit and unit.dimension != "ratio"]
    if not stated or any(not (units[name] or is_missing(text)) for name, text in below.items()):
        return columns
    if len(sheet.cells) == 1:
        raise no_rows(sheet.file, sheet.lines[0])
    return [
        column._replace(cells=column.cells.iloc[1:], unit_below=units.get(column.name))
        for column in columns
    ]


def _decimal(sheet: Sheet, columns: list[Column], settings: Settings) -> tuple[Decimal, list[str]]:
    """Decimal mark of a sheet, and what to ask if its numbers leave it open."""
    cells = [
        text
        for column in columns
        if not column.meaning.is_label
        for text, _ in column.numbers_and_units()
        if not is_missing(text)
    ]
    decimal, either = decimal_of(cells)
    if settings.decimal:
        return cast(Decimal, settings.decimal), []
    # Cells of a workbook that are numbers have points: those with a comma are texts, and are wrong.
    if not sheet.separator and any("." in c and number(c, ".") is not None for c in cells):
        return ".", []
    # Between semicolons commas are decimal, or there would be commas between the cells.
    if not either or sheet.separator == ";":
        return decimal, []
    example = next(cell for cell in cells if "," in cell)
    return decimal, [
        f"{sheet.file}: {shown(example)}, and whatever else has a comma, may have a decimal comma "
        'or thousands that are set apart: say decimal = "," or decimal = "." in the settings'
    ]


def _unit_of(
    sheet: Sheet, column: Column, texts: list[tuple[str, str | None]], settings: Settings
) -> tuple[Unit | None, list[str]]:
    """The one unit of a column, or a problem.

    Its name states it, the line below the names, the settings or the cells; and if none of these
    the settings for all columns of its dimension.
    """
    name, dimension = column.meaning.name, column.meaning.dimension
    lines = defaultdict(list)
    for line, (text, spelling) in zip(column.cells.index, texts, strict=True):
        if not is_missing(text):
            lines[spelling].append(line)
    bare = lines.pop(None, [])
    stated = {
        "its name": unit_in(column.header, dimension),
        "the line below": column.unit_below,
        "the settings": settings.units.get(name),
    }
    of_cells = {lines_in_words(of): known_unit(text, dimension) for text, of in lines.items()}
    units = {place: unit for place, unit in (stated | of_cells).items() if unit}
    first, unit = next(iter(units.items()), ("", None))
    where = f"{sheet.file}, line {sheet.name_line}: {shown(column.header)}"
    if len({unit.factor for unit in units.values()}) > 1:
        words = ", ".join(f"{unit.spelling} in {place}" for place, unit in units.items())
        fix = "convert its numbers to one unit, and write that into the name"
        return None, [f"{where} has several units, {words}: {fix}"]
    if unit and bare and not any(stated.values()):
        return None, [
            f"{where} is in {unit.spelling} in {first}, and has no unit in "
            f"{lines_in_words(bare)}: write the unit into the name, and numbers into the cells"
        ]
    if unit:
        return unit, []
    of_name = heading(column.header)
    if of_name and of_name.unit and of_name.name == name:
        return None, [
            f"{where} is {name}, and {shown(of_name.unit)} is no unit of {dimension} that is "
            f"known ({expected_units(of_name.unit, dimension)}): correct it, or name the column in "
            "the list ignore of the settings"
        ]
    if unit := settings.unit_of(name) or known_unit("", dimension):
        return unit, []
    keyword = next((key for key, of in UNIT_KEYS.items() if of == dimension), f"units.{name}")
    if name in IN_SHEET_TABLES and dimension == "length":  # not radius_unit
        keyword = f"units.{name}"
    example = shown(f"{column.header} [{UNITS[dimension][0]}]")
    return None, [
        f"{where} has no unit: write it into the name, such as {example}, or say {keyword} in "
        "the settings"
    ]


def _why_no_number(name: str, cell: str, decimal: Decimal) -> str:
    """Problem of a cell with a number, or an empty text."""
    if not is_missing(cell):
        if number(cell, decimal) is not None:
            return ""
        return f"is {shown(cell)}, {why_no_number(cell, decimal)}"
    if name in _MAY_BE_MISSING:
        return ""
    return f"is missing{f' ({shown(cell)})' if cell else ''}: fill it in, or delete the line"


def _why_no_label(cell: str) -> str:
    """Problem of a cell with a label, or an empty text."""
    try:
        plain = plain_label(cell)
    except ValueError as error:
        return f"is unusable: {error}"
    return "" if plain else "is missing: give every line its label, fill the column down"


def _problems(sheet: Sheet, column: Column, why: Iterable[str]) -> list[str]:
    """Problems of the cells of a column, one for all lines with the same problem."""
    lines = defaultdict(list)
    for line, what in zip(column.cells.index, why, strict=True):
        if what:
            lines[what].append(line)
    return [
        f"{sheet.file}, {lines_in_words(of_same)}: {shown(column.header)} {what}"
        for what, of_same in lines.items()
    ]


def _number_in_words(column: Column, unit: Unit | None, numbers: NDArray[np.float64]) -> str:
    half = "half of " if column.meaning.is_diameter else ""
    words = f"{half}{shown(column.header)} is {column.name}"
    if unit and (unit.dimension, unit.factor) != ("ratio", 1):
        words += f" in {unit.spelling}"
        if unit.factor != 1:
            internal = "" if unit.dimension == "ratio" else f" {UNITS[unit.dimension][0]}"
            words += f" (1 {unit.spelling} is {unit.factor:.6g}{internal})"
    known = column.meaning.scale * numbers[np.isfinite(numbers)]
    if known.size:
        ends = dict.fromkeys(f"{end:.6g}" for end in (known.min(), known.max()))
        words += f": {' to '.join(ends)}"
    missing = len(numbers) - known.size
    return words + (f", {missing} missing" if missing else "")
