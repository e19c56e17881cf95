"""Numbers as people write them into cells: decimal marks, thousands, gaps, units, dates.

pandas would read some of these as other numbers, or not at all; a cell that may mean two numbers is
not read.
"""

import re
from collections.abc import Callable, Iterable
from typing import Literal

import numpy as np

from pymc_hyperelastic.messages import LONGEST_TEXT

Decimal = Literal[".", ","]
DECIMALS: dict[Decimal, str] = {".": "decimal points", ",": "decimal commas"}

# Cells of missing numbers, in small letters.
MISSING = {"", "-", "–", "—", "?", "na", "n/a", "n.a.", "#n/a", "nan", "none", "null", "nd", "n.d."}

_SPACES = " '’\u00a0\u2009\u202f"  # between thousands; none is a decimal mark
_DIGITS, _EXPONENT = r"[0-9]+", r"(?:[eE][+-]?[0-9]{1,4})?"
_PLAIN = {
    mark: re.compile(rf"[+-]?(?:{_DIGITS}[{mark}]?[0-9]*|[{mark}]{_DIGITS}){_EXPONENT}")
    for mark in DECIMALS
}
_GROUPED = {
    mark: re.compile(
        rf"[+-]?[1-9][0-9]{{,2}}([{other}{_SPACES}])[0-9]{{3}}(?:\1[0-9]{{3}})*(?:[{mark}][0-9]*)?"
    )
    for mark, other in ((".", ","), (",", "."))
}
# One group behind the other decimal mark: 1,234 is 1234 or 1.234.
_EITHER = re.compile(r"[+-]?[1-9][0-9]{,2}[.,][0-9]{3}")
_MONTH = r"(?:jan|feb|mar|mär|mrz|apr|may|mai|jun|jul|aug|sep|oct|okt|nov|dec|dez)[a-zä]*"
_DATE = re.compile(
    r"[0-9]{1,4}([./-])[0-9]{1,2}\1[0-9]{1,4}(?:[ T].*)?"
    rf"|[0-9]{{1,4}}[. /-]+{_MONTH}\.?(?:[ ./-]+[0-9]{{2,4}})?"
    rf"|{_MONTH}\.?[ ./-]+[0-9]{{1,4}}",
    re.IGNORECASE,
)
_WITH_UNIT = re.compile(
    r"([+-]?[0-9.,](?:[0-9.,'’ ]*[0-9.,])?(?:[eE][+-]?[0-9]+)?)\s*([^0-9\s.,].*)"
)
# No measurement is larger, in any unit. Squares and cubes of smaller numbers are finite.
LARGEST = float(np.finfo(np.float32).max)


def is_missing(cell: str) -> bool:
    """Return True for a cell that says that there is no number."""
    return cell.casefold() in MISSING


def split_unit(cell: str, is_unit: Callable[[str], object]) -> tuple[str, str | None]:
    """Number and unit of a cell, both as written, or the cell and None."""
    found = len(cell) <= LONGEST_TEXT and _WITH_UNIT.fullmatch(cell)
    if found and is_unit(found[2]):
        return found[1], found[2]
    return cell, None


def number(cell: str, decimal: Decimal) -> float | None:
    """Number of a cell, or None if it is none or may be two.

    Examples
    --------
    >>> number("1.234,5", ","), number("−0.2", "."), number("1,234", ".")
    (1234.5, -0.2, None)
    """
    cell = cell.replace("−", "-")
    if len(cell) > LONGEST_TEXT:
        return None
    if not _PLAIN[decimal].fullmatch(cell):
        found = _GROUPED[decimal].fullmatch(cell)
        if not found or _EITHER.fullmatch(cell):
            return None
        cell = cell.replace(found[1], "")
    value = float(cell.replace(decimal, "."))
    return value if abs(value) < LARGEST else None


def why_no_number(cell: str, decimal: Decimal) -> str:
    """Why a cell is not read as a number, and what to do."""
    other: Decimal = "," if decimal == "." else "."
    if len(cell) > LONGEST_TEXT:
        return "not a number: correct it, or delete the line"
    if _EITHER.fullmatch(cell):
        digits = re.sub(r"[.,]", "", cell)
        return (
            f"either {digits} or {cell.replace(',', '.')}: write it without a separator of "
            f"thousands, as the other numbers have {DECIMALS[decimal]}"
        )
    if _DATE.fullmatch(cell):
        return (
            "a date, as spreadsheets make of numbers: format the column as numbers, and enter it "
            "again"
        )
    if number(cell, other) is not None:
        return f"not a number with {DECIMALS[decimal]}, as the other numbers have: correct it"
    if _PLAIN[decimal].fullmatch(cell.replace("−", "-")):
        return "larger than any measurement: correct it"
    return "not a number: correct it, or delete the line"


def decimal_of(cells: Iterable[str]) -> tuple[Decimal, bool]:
    """Decimal mark with which most cells are numbers; and whether the cells leave that open."""
    cells = list(cells)
    numbers = {mark: [c for c in cells if number(c, mark) is not None] for mark in (".", ",")}
    if len(numbers[","]) <= len(numbers["."]):
        return ".", False
    return ",", all(_EITHER.fullmatch(cell) for cell in numbers[","] if "," in cell)
