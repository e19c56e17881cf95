"""Units as people write them, and how many units of the package each is.

They are looked up in the tables of this module, and in no other way.
"""

import re
import unicodedata
from functools import lru_cache
from typing import Any, NamedTuple

from pymc_hyperelastic.data.units import INTERNAL_UNITS, UNITS, to_internal

_OTHERS = {"micron": "um", "microns": "um", "in": "inch", "pond": "gf"}
_OTHERS |= {"°": "deg", "degree": "deg", "degrees": "deg"}
_POWERS = {"length": 1, "area": 2, "volume": 3}
_RATIOS = {"": 1.0, "1": 1.0, "-": 1.0, "–": 1.0, "mm/mm": 1.0, "%": 0.01}
# In small or in large letters these would be other units, or none.
_AS_WRITTEN = {"mpa", "mn", "un", "n", "nm", "m"}
_IN_SMALL_LETTERS = {unit.casefold(): unit for units in UNITS.values() for unit in units} | _OTHERS


class Unit(NamedTuple):
    """A unit as a file writes it, what it measures, and how many units of the package it is."""

    spelling: str
    kind: str
    factor: float


def internal_unit(kind: str) -> str:
    """Unit of the package: kPa, mm, mm2, mm3, mN, rad, or nothing.

    Examples
    --------
    >>> internal_unit("area")
    'mm2'
    """
    if kind in ("area", "volume"):
        return f"mm{_POWERS[kind]}"
    return INTERNAL_UNITS.get(kind, "")


@lru_cache
def known_unit(spelling: str, kind: str) -> Unit | None:
    """Look a unit up, or None if it is none that measures such a kind.

    Examples
    --------
    >>> known_unit("µm²", "area")
    Unit(spelling='µm²', kind='area', factor=1e-06)
    >>> known_unit("mmhg", "pressure").spelling, round(known_unit("mmhg", "pressure").factor, 6)
    ('mmhg', 0.133322)
    >>> known_unit("mmHg", "length") is None
    True
    """
    # The ordinal mark looks like the sign of degrees, and is typed for it.
    plain = unicodedata.normalize("NFKC", spelling.replace("º", "°")).replace("μ", "u")
    plain = re.sub(r"[\s_^]|\*\*", "", plain)
    if kind == "ratio":
        return Unit(spelling, kind, _RATIOS[plain]) if plain in _RATIOS else None
    quantity: Any = "length" if kind in _POWERS else kind
    power = _POWERS.get(kind, 1)
    if power > 1:
        plain, of_power = plain[:-1], plain[-1:]
        if of_power != str(power):
            return None
    if plain.casefold() not in _AS_WRITTEN:
        plain = _IN_SMALL_LETTERS.get(plain.casefold(), plain)
    if plain not in UNITS[quantity]:
        return None
    return Unit(spelling, kind, float(to_internal(1.0, plain, quantity)) ** power)


def units_of(kind: str) -> str:
    """Units of a kind, as messages list them.

    Examples
    --------
    >>> units_of("angle")
    'rad, deg'
    """
    if kind == "ratio":
        return "1, %"
    power = f"{_POWERS[kind]}" if kind in ("area", "volume") else ""
    return ", ".join(unit + power for unit in UNITS["length" if kind in _POWERS else kind])


def is_unit(spelling: str) -> bool:
    """Whether it is a unit of anything.

    Examples
    --------
    >>> is_unit("mmHg"), is_unit("diameter")
    (True, False)
    """
    return any(known_unit(spelling, kind) for kind in (*UNITS, *_POWERS, "ratio"))
