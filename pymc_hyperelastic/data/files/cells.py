"""Cells of a column: their unit, their numbers, and what is wrong with them."""

from collections import defaultdict
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymc_hyperelastic.data.files.headers import KINDS, heading, unit_in
from pymc_hyperelastic.data.files.numerals import (
    Decimal,
    is_missing,
    number,
    split_unit,
    why_no_number,
)
from pymc_hyperelastic.data.files.settings import OF_KIND, Settings
from pymc_hyperelastic.data.files.spellings import Unit, known_unit, units_of
from pymc_hyperelastic.data.files.text import Sheet, lines_in_words
from pymc_hyperelastic.messages import shown

# What may be missing in some rows.
_MAY_BE_MISSING = ("axial_force",)


class Column(NamedTuple):
    """A column of a sheet: where it is, what it is, and what its numbers are times.

    Numbers have a `kind`, what they measure, and perhaps a `unit` in a line below the names.
    """

    position: int
    header: str
    name: str
    scale: float = 1.0
    unit_below: str | None = None

    @property
    def kind(self) -> str:
        """What its numbers measure, or "label"."""
        return KINDS.get(self.name, "label")


def units_of_cells(column: Column, cells: Iterable[str]) -> list[tuple[str, str | None]]:
    """Numbers and units of cells, both as written.

    Examples
    --------
    >>> units_of_cells(Column(0, "p", "pressure"), ["12 mmHg", "13", "S 1"])
    [('12', 'mmHg'), ('13', None), ('S 1', None)]
    """
    is_unit: Callable[[str], object] = lambda text: known_unit(text, column.kind)  # noqa: E731
    return [split_unit(cell, is_unit) for cell in cells]


def unit_of(sheet: Sheet, column: Column, settings: Settings) -> tuple[Unit | None, list[str]]:
    r"""The one unit of a column, or what is wrong.

    Its name states it, the line below the names, the settings or the cells; and if none of these
    the settings for all columns of its kind.

    Examples
    --------
    >>> from pymc_hyperelastic.data.files.text import sheet_of
    >>> sheet = sheet_of("p [mmHg]\n12\n2 kPa", "a.csv", "UTF-8")
    >>> unit, problems = unit_of(sheet, Column(0, "p [mmHg]", "pressure"), Settings())
    >>> problems[0].partition(", mmHg in its name, kPa in line 3: ")[0]
    "a.csv, line 1: 'p [mmHg]' has several units"
    """
    kind, settings_of_name = column.kind, settings.units.get(column.name)
    said = {"its name": unit_in(column.header, kind), "the line below": column.unit_below}
    said["the settings"] = settings_of_name.spelling if settings_of_name else None
    lines = defaultdict(list)
    cells = units_of_cells(column, sheet.column(column.position))
    for line, (text, spelling) in zip(sheet.lines, cells, strict=True):
        if not is_missing(text):
            lines[spelling].append(line)
    bare = lines.pop(None, [])
    in_name = any(said.values())
    places = [(text, place) for place, text in said.items()]
    places += [(text, lines_in_words(of_text)) for text, of_text in lines.items()]
    found = [(known_unit(text, kind), place) for text, place in places if text]
    units = [(unit, place) for unit, place in found if unit]
    where = f"{sheet.file}, line {sheet.name_line}: {shown(column.header)}"
    if len({unit.factor for unit, _ in units}) > 1:
        words = ", ".join(f"{unit.spelling} in {place}" for unit, place in units)
        fix = "convert its numbers to one unit, and write that into the name"
        return None, [f"{where} has several units, {words}: {fix}"]
    if units and bare and not in_name:
        return None, [
            f"{where} is in {units[0][0].spelling} in {units[0][1]}, and has no unit in "
            f"{lines_in_words(bare)}: write the unit into the name, and numbers into the cells"
        ]
    if units:
        return units[0][0], []
    stated = heading(column.header)
    if stated and stated.unit and stated.name == column.name:
        return None, [
            f"{where} is {column.name}, and {shown(stated.unit)} is no unit of {kind} that is "
            f"known ({units_of(kind)}): correct it, or name the column in the list ignore of the "
            "settings"
        ]
    unit = settings.unit_of(column.name) or known_unit("", kind)
    if unit:
        return unit, []
    keyword = next((k for k, of in OF_KIND.items() if of == kind), f"units.{column.name}")
    example = shown(f"{column.header} [{units_of(kind).split(', ')[0]}]")
    return None, [
        f"{where} has no unit: write it into the name, such as {example}, or say {keyword} in "
        "the settings"
    ]


def numbers_of(
    sheet: Sheet, column: Column, decimal: Decimal
) -> tuple[NDArray[np.float64], list[str]]:
    r"""Numbers of a column in its own unit, NaN where they are missing or none; and what is wrong.

    Examples
    --------
    >>> from pymc_hyperelastic.data.files.text import sheet_of
    >>> sheet = sheet_of("p\n12\n-\nhigh", "a.csv", "UTF-8")
    >>> numbers, problems = numbers_of(sheet, Column(0, "p", "pressure"), ".")
    >>> print(numbers, *problems, sep="\n")
    [12. nan nan]
    a.csv, line 3: 'p' is missing ('-'): fill it in, or delete the line
    a.csv, line 4: 'p' is 'high', not a number: correct it, or delete the line
    """
    values = np.full(len(sheet.rows), np.nan)
    wrong = []
    cells = units_of_cells(column, sheet.column(column.position))
    for i, (text, _) in enumerate(cells):
        if not is_missing(text):
            value = number(text, decimal)
            values[i] = np.nan if value is None else value
            if value is None:
                wrong.append((i, f"is {shown(text)}, {why_no_number(text, decimal)}"))
        elif column.name not in _MAY_BE_MISSING:
            said = f" ({shown(text)})" if text else ""
            wrong.append((i, f"is missing{said}: fill it in, or delete the line"))
    return values, told(sheet, column, wrong)


def told(sheet: Sheet, column: Column, wrong: Iterable[tuple[int, str]]) -> list[str]:
    """What is wrong in rows of a column, once for all of which it is the same."""
    lines = defaultdict(list)
    for i, what in wrong:
        lines[what].append(sheet.lines[i])
    return [
        f"{sheet.file}, {lines_in_words(of_same)}: {shown(column.header)} {what}"
        for what, of_same in lines.items()
    ]
