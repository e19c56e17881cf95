"""Units at the door: inside, pressures are in kPa, lengths in mm, forces in mN, angles in rad."""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from pymc_hyperelastic.messages import shown

if TYPE_CHECKING:
    import pint
    from numpy.typing import ArrayLike, NDArray

#: kPa in one (conventional) millimetre of mercury, so that 5 mmHg is written ``5 * ph.mmHg``.
mmHg = 0.133322387415

#: The unit that each quantity has inside the package.
INTERNAL_UNITS = {"pressure": "kPa", "length": "mm", "force": "mN", "angle": "rad"}

#: Units in which each quantity may be given, whichever way the data come in. All others are
#: refused: to pint a pixel is 1/96 inch, and a point a length too.
UNITS = {
    "pressure": ["kPa", "Pa", "hPa", "MPa", "mmHg", "torr", "cmH2O", "mbar", "bar", "psi"],
    "length": ["mm", "um", "nm", "cm", "m", "inch"],
    "force": ["mN", "uN", "N", "gf", "dyn"],
    "angle": ["rad", "deg"],
}
# Relative difference of two units that are one, such as micrometre and micron.
_ROUNDING = 1e-12


def to_internal(
    values: ArrayLike,
    unit: str,
    quantity: Literal["pressure", "length", "force", "angle"],
    *,
    keyword: str | None = None,
) -> NDArray[np.float64]:
    """Convert values of any shape to the unit that the package works in: kPa, mm, mN or rad.

    The `unit` is one of :data:`UNITS`, in a spelling that pint knows, such as ``"mmHg"``, ``"um"``
    or ``"degree"``. If it is not, a ValueError names the argument through which the caller
    received it, `keyword` or else ``f"{quantity}_unit"``.

    Examples
    --------
    >>> float(to_internal(250.0, "um", "length"))
    0.25
    """
    factor = _factor(unit, quantity, keyword or f"{quantity}_unit")
    return np.asarray(values, dtype=float) * factor


@cache
def _factor(unit: str, quantity: str, keyword: str) -> float:
    """How many internal units one `unit` is."""
    expected = f"expected a unit of {quantity}: {', '.join(UNITS[quantity])}"
    registry, internal = _registry(), INTERNAL_UNITS[quantity]
    try:
        given = registry.Unit(str(unit))
        root = _root_units(registry, given)
    # Beyond its own errors pint lets those of Python's tokenizer and parser through.
    except Exception as error:
        raise ValueError(f"{keyword}={shown(unit)} is not a known unit; {expected}") from error
    if root != _root_units(registry, registry.Unit(internal)):
        raise ValueError(f"{keyword}={shown(unit)} does not measure {quantity}; {expected}")
    factor = float(registry.Quantity(1.0, given).m_as(internal))
    known = [registry.Quantity(1.0, name).m_as(internal) for name in UNITS[quantity]]
    if not any(math.isclose(factor, other, rel_tol=_ROUNDING) for other in known):
        raise ValueError(
            f"{keyword}={shown(unit)} is a unit of {quantity} that is not used; {expected}"
        )
    return factor


def _root_units(registry: pint.UnitRegistry, unit: Any) -> Any:
    # Root units, not dimensions: to pint an angle and a percentage are both dimensionless.
    return registry.get_root_units(unit)[1]


@cache
def _registry() -> pint.UnitRegistry:
    # Here and not above: reading pint's definitions takes longer than the rest of this module.
    import pint

    return pint.UnitRegistry()
