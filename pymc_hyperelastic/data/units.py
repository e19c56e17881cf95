"""Units of input: converted at the door to kPa, mm, mN and rad, and as people write them."""

from __future__ import annotations

import math
import re
import unicodedata
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pymc_hyperelastic.messages import shown
from pymc_hyperelastic.quantities import POWERS, UNITS

if TYPE_CHECKING:
    import pint
    from numpy.typing import ArrayLike, NDArray

#: kPa in one (conventional) millimetre of mercury, so that 5 mmHg is written ``5 * ph.mmHg``.
mmHg = 0.133322387415

# Dimensions whose units pint converts; areas and volumes are powers of a length.
_BASIC = ("pressure", "stress", "length", "force", "angle", "ratio")
# Units as people write them, in small letters.
_SPELLINGS = {unit.casefold(): unit for dimension in _BASIC for unit in UNITS[dimension]}
_SPELLINGS |= {"micron": "um", "microns": "um", "in": "inch", "pond": "gf"}
_SPELLINGS |= {"n/mm2": "MPa", "kn/m2": "kPa"}
_SPELLINGS |= {"°": "deg", "degree": "deg", "degrees": "deg"}
_SPELLINGS |= {"": "1", "-": "1", "–": "1", "mm/mm": "1"}
# In small or in large letters these would be other units, or none.
_AS_WRITTEN = {"mpa", "mn", "un", "n", "nm", "m"}
# Grams are a mass; balances show forces in grams.
_GRAMS = {"g", "gr", "gram", "grams", "gramm"}


class Unit(NamedTuple):
    """A unit as a file writes it, its dimension, and its size in units of the package."""

    spelling: str
    dimension: str
    factor: float


def to_internal(
    values: ArrayLike, unit: str, dimension: str, *, keyword: str | None = None, power: int = 1
) -> NDArray[np.float64]:
    """Convert values to the unit that the package works in: kPa, mm, mN or rad.

    The `unit` is one of :data:`UNITS`, in a spelling that pint knows, such as ``"mmHg"``, ``"um"``
    or ``"degree"``; the values may be in its square or cube, the `power`. If the unit is none of
    these, a ValueError names the argument through which the caller received it, `keyword` or else
    ``f"{dimension}_unit"``.
    """
    factor = _factor(unit, dimension, keyword or f"{dimension}_unit")
    return np.asarray(values, dtype=float) * factor**power


@lru_cache
def known_unit(spelling: str, dimension: str) -> Unit | None:
    """Look up a unit that a file writes; None if it does not measure this dimension."""
    # The ordinal mark looks like the sign of degrees, and is typed for it.
    plain = unicodedata.normalize("NFKC", spelling.replace("º", "°")).replace("μ", "u")
    plain = re.sub(r"[\s_^]|\*\*", "", plain)
    power = POWERS.get(dimension, 1)
    if power > 1:
        plain, digit = plain[:-1], plain[-1:]
        if digit != str(power):
            return None
    if plain.casefold() not in _AS_WRITTEN:
        plain = _SPELLINGS.get(plain.casefold(), plain)
    basic = "length" if dimension in POWERS else dimension
    if plain not in UNITS[basic]:
        return None
    return Unit(spelling, dimension, _factor(plain, basic, "") ** power)


def is_unit(spelling: str) -> bool:
    """Return True for a unit of any dimension."""
    return any(known_unit(spelling, dimension) for dimension in (*_BASIC, *POWERS))


def expected_units(spelling: str, dimension: str) -> str:
    """List the units of a dimension in a message on another one, and explain forces in grams."""
    units = ", ".join(UNITS[dimension])
    if dimension == "force" and spelling.strip().casefold() in _GRAMS:
        units += "; grams are a mass: write gf for grams of force, or convert to mN"
    return units


@cache
def _factor(unit: str, dimension: str, keyword: str) -> float:
    """How many internal units one `unit` is."""
    if unit == UNITS[dimension][0]:  # the default: the definitions of pint take a second to read
        return 1.0
    expected = f"expected a unit of {dimension}: {expected_units(str(unit), dimension)}"
    registry, internal = _registry(), UNITS[dimension][0]
    try:
        given = registry.Unit(str(unit))
        root = _root_units(registry, given)
    # Beyond its own errors pint lets those of Python's tokenizer and parser through.
    except Exception as error:
        raise ValueError(f"{keyword}={shown(unit)} is not a known unit; {expected}") from error
    if root != _root_units(registry, registry.Unit(internal)):
        raise ValueError(f"{keyword}={shown(unit)} does not measure {dimension}; {expected}")
    factor = float(registry.Quantity(1.0, given).m_as(internal))
    known = [registry.Quantity(1.0, name).m_as(internal) for name in UNITS[dimension]]
    if not any(math.isclose(factor, other) for other in known):
        raise ValueError(
            f"{keyword}={shown(unit)} is a unit of {dimension} that is not used; {expected}"
        )
    return factor


def _root_units(registry: pint.UnitRegistry, unit: Any) -> Any:
    # Root units, not dimensions: to pint an angle and a percentage are both dimensionless.
    return registry.get_root_units(unit)[1]


@cache
def _registry() -> pint.UnitRegistry:
    # Imported here: reading pint's definitions takes longer than the rest of this module.
    import pint

    return pint.UnitRegistry()
