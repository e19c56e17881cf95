"""The meaning of the columns of a laboratory's table, by their names.

Names are looked up in :data:`~pymc_hyperelastic.quantities.SPELLINGS`; the package does not guess.
"""

import re
import unicodedata
from collections.abc import Collection, Iterable, Mapping
from typing import Literal, NamedTuple

from pymc_hyperelastic.data.units import Unit, is_unit, known_unit
from pymc_hyperelastic.messages import LONGEST_TEXT
from pymc_hyperelastic.quantities import (
    DIAMETERS,
    IN_SHEET_TABLES,
    IN_TABLES,
    OF_SHEETS,
    SPELLINGS,
)

# Columns that tables of points need, besides a radius or a diameter.
NEEDED = ("specimen", "experiment", "pressure")
# A name that people who keep tables give to a specimen, and pressure myographs to a diameter; and a
# strain, which has several definitions.
TWO_MEANINGS = {"id": ("specimen", "inner_diameter")}
TWO_MEANINGS |= {
    f"strain{end}": (f"engineering_strain{end}", f"green_strain{end}") for end in ("", "_x", "_y")
}
# Points of tubes have one of these columns, and points of sheets one of the loads.
OF_TUBES = {"radius", "outer_diameter", "pressure"}
LOADS = [name for name in OF_SHEETS if name.endswith(("stress", "force"))]
_LOADS = {f"{load}{end}" for load in LOADS for end in ("", "_x", "_y")}
Points = Literal["tubes", "sheets", ""]


class Heading(NamedTuple):
    """The meaning of a column: its name in the package, and the unit in its header."""

    name: str
    unit: str | None = None
    is_diameter: bool = False
    """True if it holds diameters, and the quantity is a radius."""

    @property
    def scale(self) -> float:
        """The factor of its numbers."""
        return 0.5 if self.is_diameter else 1.0

    @property
    def dimension(self) -> str:
        """The dimension of its numbers, or ``"label"``."""
        return IN_TABLES[self.name].dimension

    @property
    def is_label(self) -> bool:
        """True if it holds labels, not numbers."""
        return self.dimension == "label"


_KNOWN = {name: Heading(name) for name in IN_TABLES}
_KNOWN |= {other: Heading(name) for name, others in SPELLINGS.items() for other in others.split()}
_KNOWN |= {
    other: Heading(name, is_diameter=True)
    for name, others in DIAMETERS.items()
    for other in others.split()
}


def heading(text: str) -> Heading | None:
    """The meaning of a column by its header, or None if the name is not known.

    Examples
    --------
    >>> heading("Pressure (mmHg)")
    Heading(name='pressure', unit='mmHg', is_diameter=False)
    >>> heading("inner diameter / µm")
    Heading(name='radius', unit='µm', is_diameter=True)
    """
    for name, unit in _readings(text):
        if known := _KNOWN.get(comparable(name)):
            if not (known.is_label and unit is not None):
                return known._replace(unit=unit)
    return None


def points_in(headers: Iterable[str], columns: Mapping[str, Heading]) -> Points:
    """Return of what a table with these headers has points; the `columns` are stated meanings."""
    stated = {comparable(text): known for text, known in columns.items()}
    known = set()
    for header in headers:
        found = next((stated[name] for name in called(header) if name in stated), heading(header))
        known |= {found.name} if found else set()
    if not known.isdisjoint(OF_TUBES):
        return "tubes"
    return "" if known.isdisjoint(_LOADS) else "sheets"


def allowed(points: Points, kinds: Collection[Points]) -> set[str]:
    """Quantities that a table with these points may hold, in a study with points of these kinds.

    A table of points has quantities of its kind. All other tables have those of all kinds.
    """
    own = {points} if points else {*kinds} - {""} or {"tubes"}
    of_tubes = {name for name, spec in IN_TABLES.items() if spec.dimension != "label"}
    of_tubes -= IN_SHEET_TABLES
    others = (IN_SHEET_TABLES if "sheets" not in own else set()) | (
        of_tubes if "tubes" not in own else set()
    )
    return {*IN_TABLES} - others


def names_of(name: str) -> list[str]:
    """Names by which a column is known, its own first, as messages list them."""
    return [other.replace("_", " ") for other, known in _KNOWN.items() if known.name == name]


def comparable(text: str) -> str:
    """Name as it is compared: small letters, with one "_" for all that is no letter or number."""
    return re.sub(r"[\W_]+", "_", unicodedata.normalize("NFKC", text).casefold()).strip("_")


def called(text: str) -> list[str]:
    """Names of a header, with its unit and without, in the form in which names are compared."""
    return [comparable(text), *(comparable(name) for name, _ in _readings(text))]


def unit_in(text: str, dimension: str) -> Unit | None:
    """Unit in a name, which need not be known itself."""
    units = (known_unit(unit, dimension) for _, unit in _readings(text) if unit is not None)
    return next(filter(None, units), None)


def _readings(text: str) -> list[tuple[str, str | None]]:
    """Ways to divide a name into name and unit."""
    text = " ".join(text.split())
    if len(text) > LONGEST_TEXT:  # it is a remark
        return []
    readings: list[tuple[str, str | None]] = [(text, None)]
    if found := re.fullmatch(r"(.*?)\s*(?:\[(.*)\]|\((.*)\)|\{(.*)\})", text):
        name, *units = found.groups()
        # Brackets do not count as part of the name, but what stands in them may be no unit.
        return [(name, next(unit for unit in units if unit is not None).strip())]
    if re.search(r".\s*/\s*.", text):
        name, _, unit = text.partition("/")
        readings.append((name.strip(), unit.strip()))
    for end in re.finditer(r"[\s_,]+", text):
        name, unit = text[: end.start()], text[end.end() :]
        name = re.sub(r"[\s_,]+in$", "", name)
        if is_unit(unit):
            readings.append((name, unit))
    return readings
