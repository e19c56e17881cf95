"""Sizes of measurement errors: their names, units, checks, and words."""

from math import isfinite
from numbers import Real
from typing import Any, NamedTuple

from pytensor.graph.basic import Variable

from pymc_hyperelastic.models.priors import is_inferred


class Errors(NamedTuple):
    """Standard deviations of measurement errors, and the weight of slopes, for densities.

    Each is a number, a variable, or a vector of one value for each point, in the unit of
    :data:`SIZES`; None if there is no such error.
    """

    pressure_sd: Any = None
    radius_sd: Any = None
    """In place of `pressure_sd`."""
    diameter_sd: Any = None
    """Besides `pressure_sd`."""
    force_sd: Any = None
    force_offset_sd: Any = None
    slope_weight: Any = 0.0
    stress_sd: Any = None
    stretch_sd: Any = None
    """Besides `stress_sd`."""

    @property
    def counts_slopes(self) -> bool:
        """True if measured slopes are part of the likelihood."""
        return is_inferred(self.slope_weight) or self.slope_weight != 0


class Size(NamedTuple):
    """One argument of a likelihood."""

    unit: str
    expected: str
    """Text of messages about an impossible value."""
    of_what: str
    """The errors that have this size, for sentences."""


def _sd(unit: str, of_what: str, meaning: str = "a standard deviation") -> Size:
    example = " (5 mmHg is 5 * ph.mmHg)" if unit == "kPa" else ""
    number = "a positive number" if unit == "1" else f"a positive number of {unit}{example}"
    return Size(unit, f"{meaning}, {number}", of_what)


# Arguments of all likelihoods by name.
SIZES = {
    "pressure_sd": _sd("kPa", "errors of pressures"),
    "radius_sd": _sd("mm", "errors of radii"),
    "diameter_sd": _sd("mm", "errors of diameters"),
    "force_sd": _sd("mN", "errors of axial forces"),
    "force_offset_sd": _sd("mN", "offsets of the force transducer, one for each test"),
    "stress_sd": _sd("kPa", "errors of stresses"),
    "stretch_sd": _sd("1", "errors of stretches"),
    "sigma": _sd("kPa", "errors of pressures", "√2 standard deviations"),
    "force_sigma": _sd("mN", "errors of axial forces", "√2 standard deviations"),
    "slope_weight": Size("mm²", "a number of mm², 0 to leave the slopes out", "slopes"),
}
# Those of tests of sheets.
OF_SHEETS = ("stress_sd", "stretch_sd")
# Sizes that are √2 standard deviations, and the names of these.
SD_OF_SIGMA = {"sigma": "pressure_sd", "force_sigma": "force_sd"}


def check_size(name: str, value: Any) -> None:
    """Raise unless a value is a scalar variable or a positive number; a slope weight may be 0."""
    expected = SIZES[name].expected
    if isinstance(value, Variable) and not value.type.ndim:
        return
    if isinstance(value, Variable):
        dimensions = f"{value.type.ndim} dimension(s)"
        raise TypeError(f"{name} has {dimensions}; expected {expected}, or a scalar distribution")
    if isinstance(value, bool) or not isinstance(value, Real):
        raise TypeError(f"{name} is {value!r}; expected {expected}, or a distribution")
    if not isfinite(value) or value < 0 or (name != "slope_weight" and value == 0):
        raise ValueError(f"{name} is {value}; expected {expected}")
