"""Whether inflation data are of a size that soft tubes have, and what was probably meant if not.

The ranges hold arteries from arterioles to a dilated aorta, veins and other soft tubes, with some
room; what lies beyond may be right, but mostly another unit or another quantity was given.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.doubt import Check, doubt
from pymc_hyperelastic.data.inflation import at_points, describe_test
from pymc_hyperelastic.data.units import mmHg
from pymc_hyperelastic.mechanics.tube import GEOMETRY, current_radius, opening_factor
from pymc_hyperelastic.messages import shown

Array = NDArray[np.float64]


class Expected(NamedTuple):
    """A range, and why a number may be below or above it."""

    what: str
    unit: str
    low: float
    high: float
    below: str
    above: str


SMALL = "are inner_radius and outer_radius diameters, in another unit, or of another tube?"
LARGE = "is the measured radius a diameter, in another unit than inner_radius, or of another tube?"
LENGTHS = "was another unit meant? radius_unit=... is that of every length, measured or of the tube"
RANGES = {
    "highest_pressure": Expected(
        "the highest pressure",
        "kPa",
        0.1,
        40.0,  # 300 mmHg
        "was it given in MPa or bar, pressure_unit=...?",
        'was it given in mmHg or Pa, pressure_unit="mmHg"?',
    ),
    "lowest_pressure": Expected(
        "the lowest pressure",
        "kPa",
        -2.0,
        np.inf,
        "was the pressure around the tube, or the gauge's zero, not subtracted?",
        "",
    ),
    "ring_radius": Expected(
        "the inner radius of the closed tube without load", "mm", 0.01, 30.0, LENGTHS, LENGTHS
    ),
    "largest_radius": Expected("the largest internal radius", "mm", 0.01, 40.0, LENGTHS, LENGTHS),
    "wall": Expected(
        "the thickness of the wall over its mean radius",
        "",
        0.01,
        0.8,
        "is inner_radius a diameter, or are the two radii not of one tube?",
        "is outer_radius a diameter?",
    ),
    "axial_stretch": Expected(
        "axial_stretch",
        "",
        0.8,
        2.5,
        "was a strain given? A strain of 0.45 is a stretch of 1.45",
        "was it given in per cent? 145 % is a stretch of 1.45",
    ),
    "opening_angle": Expected(
        "the opening angle",
        "rad",
        0.06,
        2 * np.pi,
        'were radians given with angle_unit="deg"?',
        "",
    ),
    "first_stretch": Expected(
        "the hoop stretch at the lowest pressure, over that without load,",
        "",
        0.75,
        1.7,
        SMALL,
        LARGE,
    ),
    "last_stretch": Expected(
        "the hoop stretch at the highest pressure, over that without load,",
        "",
        0.9,
        2.6,
        SMALL,
        LARGE,
    ),
    "axial_stress": Expected(
        "the largest axial force over the area of the wall",
        "kPa",
        0.0,
        2000.0,
        "",
        "was another unit meant, force_unit=...?",
    ),
}
# Where the lowest pressure of a test is below, and the highest above, kPa, the tube is nearly
# without load, and inflated.
_UNLOADED = 2.0


def check_plausible(data: xr.Dataset, check: Check) -> None:
    """Doubt numbers that no soft tube has, one message for each quantity."""
    if check == "ignore":
        return
    doubt(_single_points(data), check)
    for name, values in _quantities(data).items():
        expected = RANGES[name]
        # NaN, where something is not known, is no reason for doubt.
        outside = np.flatnonzero((values < expected.low) | (values > expected.high))
        found = [_doubtful(expected, values[i]) for i in outside]
        places = [describe_test(data, int(i)) for i in outside]
        messages = [f"{place}: {what}" for place, what in zip(places, found, strict=True)]
        doubt(messages, check)


def _single_points(data: xr.Dataset) -> list[str]:
    """Return a doubt if no specimen has a curve.

    Examples
    --------
    >>> from pymc_hyperelastic.data.datasets import load_dataset
    >>> _single_points(load_dataset("simulated_sheep_aorta"))
    []
    """
    names = data["specimen"].to_index().unique()
    if len(names) < 2 or len(names) < data.sizes["obs"]:
        return []
    return [
        f"each of the {len(names)} specimens has a single measured point, such as specimen "
        f"{shown(names[0])}: were measured numbers taken for labels of specimens?"
    ]


def check_plausible_pressures(pressure: Array, check: Check) -> None:
    """Doubt pressures at which no tube is inflated.

    Examples
    --------
    >>> check_plausible_pressures(np.array([2.0, 16.0]), "raise")
    >>> check_plausible_pressures(np.array([100.0]), "raise")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ValueError: a pressure is 100 kPa, 750 mmHg; ... given in mmHg? Say pressure_unit='mmHg'
    """
    high = RANGES["highest_pressure"].high
    doubt(
        [
            f"a pressure is {p:.6g} kPa, {p / mmHg:.3g} mmHg; expected at most {high:g} kPa: "
            "was it given in mmHg? Say pressure_unit='mmHg'"
            for p in pressure[pressure > high]
        ],
        check,
    )


def _doubtful(expected: Expected, value: float) -> str:
    unit = expected.unit and f" {expected.unit}"
    if value < expected.low:
        bound, why = f"at least {expected.low:g}", expected.below
    else:
        bound, why = f"at most {expected.high:g}", expected.above
    return f"{expected.what} is {value:.6g}{unit}; expected {bound}{unit}: {why}"


def _quantities(data: xr.Dataset) -> dict[str, Array]:
    """What has a range in :data:`RANGES`, one number a test."""
    test = data["test"].values
    pressure, radius = data["pressure"].values, data["radius"].values
    inner, outer, angle = (data[name].values for name in GEOMETRY if name != "axial_stretch")
    axial = at_points(data, "axial_stretch")
    k, middle = opening_factor(angle), (inner + outer) / 2
    lowest, highest = _extreme(np.argmin, pressure, test), _extreme(np.argmax, pressure, test)

    def hoop_stretch(points: Array) -> Array:
        """Of the wall's middle, over that of the closed, stretched tube without load."""
        stretch = axial[points]
        r = current_radius(
            middle, radius[points], inner_radius=inner, axial_stretch=stretch, opening_angle=angle
        )
        return k * r / middle * np.sqrt(stretch)

    shortest, longest = (axial[_extreme(f, axial, test)] for f in (np.argmin, np.argmax))
    quantities = {
        "highest_pressure": pressure[highest],
        "lowest_pressure": pressure[lowest],
        "ring_radius": middle / k - (outer - inner) / 2,
        "largest_radius": radius[_extreme(np.argmax, radius, test)],
        "wall": k * (outer - inner) / middle,
        # The shortest of stretches that vary if it is implausible, else the longest.
        "axial_stretch": np.where(shortest < RANGES["axial_stretch"].low, shortest, longest),
        "opening_angle": np.where(angle == 0, np.nan, np.abs(angle)),
        "first_stretch": np.where(pressure[lowest] < _UNLOADED, hoop_stretch(lowest), np.nan),
        "last_stretch": np.where(pressure[highest] > _UNLOADED, hoop_stretch(highest), np.nan),
    }
    if "axial_force" in data:
        force = np.nan_to_num(np.abs(data["axial_force"].values))
        largest = force[_extreme(np.argmax, force, test)]
        quantities["axial_stress"] = largest * k / (np.pi * (outer**2 - inner**2))
    return quantities


def _extreme(which: Callable[[Array], np.intp], values: Array, test: Array) -> Array:
    """Position of the lowest or the highest value of every test, whose points stand together."""
    starts = np.searchsorted(test, np.arange(test[-1] + 1))
    parts = np.split(values, starts[1:])
    return starts + np.array([which(part) for part in parts])
