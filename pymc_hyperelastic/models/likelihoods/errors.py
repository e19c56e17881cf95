"""Sizes of measurement errors: their names, units, checks, and words.

The likelihoods of this folder state sizes by these names. Densities are computed with
:class:`Errors`, in which every size is a standard deviation.
"""

from math import isfinite
from numbers import Real
from typing import Any, NamedTuple

from pytensor.graph.basic import Variable

from pymc_hyperelastic.models.priors import is_inferred


class Errors(NamedTuple):
    """Standard deviations of measurement errors, and the weight of slopes.

    Each is a number, a variable, or a vector of one value for each point.
    """

    pressure_sd: Any
    """kPa; or mm where the radius has the error."""
    slope_weight: Any = 0.0
    """mm²; the paper's ``β``."""
    force_sd: Any = None
    """mN."""
    force_offset_sd: Any = None
    """mN; one offset for each test."""
    diameter_sd: Any = None
    """mm."""

    @property
    def with_slopes(self) -> bool:
        """True if measured slopes are part of the likelihood."""
        return is_inferred(self.slope_weight) or self.slope_weight != 0


class Size(NamedTuple):
    """One argument of a likelihood."""

    unit: str
    expected: str
    """Text of messages about an impossible value."""
    of_what: str
    """The errors that have this size, for sentences."""


# Arguments of all likelihoods by name.
SIZES = {
    "pressure_sd": Size(
        "kPa",
        "a standard deviation, a positive number of kPa (2 mmHg is 2 * ph.mmHg)",
        "errors of pressures",
    ),
    "sigma": Size(
        "kPa",
        "√2 standard deviations, a positive number of kPa (5 mmHg is 5 * ph.mmHg)",
        "errors of pressures",
    ),
    "slope_weight": Size("mm²", "a number of mm², 0 to leave the slopes out", "slopes"),
    "force_sd": Size(
        "mN", "a standard deviation, a positive number of mN", "errors of axial forces"
    ),
    "force_sigma": Size(
        "mN", "√2 standard deviations, a positive number of mN", "errors of axial forces"
    ),
    "force_offset_sd": Size(
        "mN",
        "a standard deviation, a positive number of mN, or None for a transducer without offset",
        "offsets of the force transducer, one for each test",
    ),
    "diameter_sd": Size(
        "mm",
        "a standard deviation, a positive number of mm, or None for diameters without error",
        "errors of diameters",
    ),
}


def check_size(name: str, value: Any) -> None:
    """Raise unless a value is a possible size of an error, or a scalar variable.

    Raises
    ------
    TypeError
        If the value is neither a number nor a scalar variable.
    ValueError
        If the number is negative or not finite; or zero, except for a slope weight.
    """
    expected = SIZES[name].expected
    if isinstance(value, Variable):
        if value.type.ndim:
            raise TypeError(
                f"{name} has {value.type.ndim} dimension(s); expected {expected}, or a scalar "
                "distribution"
            )
        return
    if isinstance(value, bool) or not isinstance(value, Real):
        raise TypeError(f"{name} is {value!r}; expected {expected}, or a distribution")
    if not isfinite(value) or value < 0 or (name != "slope_weight" and value == 0):
        raise ValueError(f"{name} is {value}; expected {expected}")
