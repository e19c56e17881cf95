"""Doubts about inflation data whose sizes soft tubes do not have, with the likely mistake.

The ranges are in :data:`~pymc_hyperelastic.quantities.PLAUSIBLE`. A size outside its range may be
right, but mostly another unit or another quantity was given.
"""

from collections.abc import Callable

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.inflation import at_points, file_of, place_of_test
from pymc_hyperelastic.data.units import mmHg
from pymc_hyperelastic.data.validation import Check, Problems, check_known
from pymc_hyperelastic.mechanics.tube import GEOMETRY, current_radius, opening_factor
from pymc_hyperelastic.messages import shown
from pymc_hyperelastic.quantities import MISTAKES, PLAUSIBLE

Array = NDArray[np.float64]

# kPa: a test whose lowest pressure is below, and whose highest is above, has nearly unloaded and
# inflated tubes.
_UNLOADED = 2.0


def check_plausible(data: xr.Dataset, problems: Problems) -> None:
    """Doubt numbers that no soft tube has, once for each quantity."""
    _doubt_single_points(data, problems)
    for name, values in _quantities(data).items():
        expected = PLAUSIBLE[name]
        # Comparisons with NaN, an unknown size, are False.
        for i in np.flatnonzero((values < expected.low) | (values > expected.high)):
            is_low = values[i] < expected.low
            bound = f"at least {expected.low:g}" if is_low else f"at most {expected.high:g}"
            unit = expected.unit and f" {expected.unit}"
            problems.doubt(
                name,
                place_of_test(data, int(i)),
                f"{expected.what} is {values[i]:.6g}{unit}; expected {bound}{unit}: "
                f"{MISTAKES[name][0 if is_low else 1]}",
                expected.doubted_unit,
            )


def _doubt_single_points(data: xr.Dataset, problems: Problems) -> None:
    names = data["specimen"].to_index().unique()
    if 2 <= len(names) == data.sizes["obs"]:
        problems.doubt(
            "single points",
            file_of(data["row"].values.tolist()[0]),
            f"each of the {len(names)} specimens has a single measured point, such as specimen "
            f"{shown(names[0])}: were measured numbers taken for labels of specimens?",
        )


def check_plausible_pressures(pressure: Array, check: Check) -> None:
    """Doubt pressures, kPa, at which no tube is inflated."""
    check_known(check)
    high = PLAUSIBLE["highest_pressure"].high
    problems = Problems(check)
    for p in pressure[pressure > high]:
        what = (
            f"a pressure is {p:.6g} kPa, {p / mmHg:.3g} mmHg; expected at most {high:g} kPa: was "
        )
        problems.doubt("pressure", "", f"{what}it given in mmHg? Say pressure_unit='mmHg'")
    problems.report()


def _quantities(data: xr.Dataset) -> dict[str, Array]:
    """Quantities with a plausible range, one number a test."""
    test = data["test"].values
    pressure, radius = data["pressure"].values, data["radius"].values
    inner, outer, angle = (data[name].values for name in GEOMETRY if name != "axial_stretch")
    axial = at_points(data, "axial_stretch")
    k, middle = opening_factor(angle), (inner + outer) / 2
    lowest, highest = _extreme(np.argmin, pressure, test), _extreme(np.argmax, pressure, test)

    def hoop_stretch(points: Array) -> Array:
        """Stretch of the wall's middle, relative to the closed, stretched tube without load."""
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
        "axial_stretch": np.where(shortest < PLAUSIBLE["axial_stretch"].low, shortest, longest),
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
