"""Doubts about data whose sizes soft tubes or sheets do not have, with the likely mistake.

The ranges are in :data:`~pymc_hyperelastic.quantities.PLAUSIBLE`. A size outside its range may be
right, but mostly another unit or another quantity was given.
"""

from collections.abc import Callable

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.extension import LEAST_STRAIN
from pymc_hyperelastic.data.inflation import (
    at_points,
    extension_tests,
    file_of,
    place_of_test,
    points_of,
)
from pymc_hyperelastic.data.order import LEAST_FALL
from pymc_hyperelastic.data.units import mmHg
from pymc_hyperelastic.data.validation import Check, Problems, check_known
from pymc_hyperelastic.mechanics.tube import GEOMETRY, current_radius, opening_factor
from pymc_hyperelastic.messages import shown
from pymc_hyperelastic.quantities import MISTAKES, PLAUSIBLE, SHEET_VARIABLES

Array = NDArray[np.float64]


def check_plausible(data: xr.Dataset, problems: Problems) -> None:
    """Doubt numbers that no soft tube has, once for each quantity."""
    _doubt_single_points(data, problems)
    _doubt_ranges(_quantities(data), data, problems)
    _doubt_falling(data, problems)


def check_plausible_sheets(data: xr.Dataset, lateral: Array, problems: Problems) -> None:
    """Doubt numbers that no soft sheet has, once for each quantity.

    `lateral` are measured stretches across the pulled axis of points of uniaxial tests, or NaN.
    """
    _doubt_single_points(data, problems)
    _doubt_ranges(_quantities_of_sheets(data, lateral), data, problems)
    _doubt_signs(data, problems)


def _doubt_ranges(quantities: dict[str, Array], data: xr.Dataset, problems: Problems) -> None:
    """Doubt quantities, one number a test, that are beyond their plausible ranges."""
    for name, values in quantities.items():
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


def _doubt_falling(data: xr.Dataset, problems: Problems) -> None:
    """Doubt tests in which each larger radius has a smaller pressure, if its axial stretch is held.

    The pressure of a balloon may fall, too, but only after it has risen.
    """
    for test in np.flatnonzero(~extension_tests(data)):
        points = points_of(data, int(test))
        order = np.argsort(data["radius"].values[points])
        pressure = data["pressure"].values[points][order]
        fall = pressure[0] - pressure[-1]
        if np.all(np.diff(pressure) < 0) and fall > LEAST_FALL * np.abs(pressure).max():
            problems.doubt(
                "fall",
                place_of_test(data, int(test)),
                f"the pressure falls at each larger radius, from {pressure[0]:.6g} to "
                f"{pressure[-1]:.6g} kPa: was one of the two columns sorted alone, or is a sign "
                "wrong?",
            )


def check_plausible_pressures(pressure: Array, check: Check | None = None) -> None:
    """Doubt pressures, kPa, at which no tube is inflated.

    Functions without an argument `check` warn, and pass None.
    """
    if check is not None:
        check_known(check)
    high = PLAUSIBLE["highest_pressure"].high
    problems = Problems("warn", advice="") if check is None else Problems(check)
    for p in pressure[pressure > high]:
        what = (
            f"a pressure is {p:.6g} kPa, {p / mmHg:.3g} mmHg; expected at most {high:g} kPa: was "
        )
        problems.doubt("pressure", "", f"{what}it given in mmHg? Say pressure_unit='mmHg'")
    problems.report()


def _quantities(data: xr.Dataset) -> dict[str, Array]:
    """Quantities with a plausible range, one number a test."""
    # Smaller pressures may be errors of the gauge's zero: the tube is nearly unloaded.
    unloaded = -PLAUSIBLE["lowest_pressure"].low
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
        "first_stretch": np.where(pressure[lowest] < unloaded, hoop_stretch(lowest), np.nan),
        "last_stretch": np.where(pressure[highest] > unloaded, hoop_stretch(highest), np.nan),
    }
    if "axial_force" in data:
        force = np.nan_to_num(np.abs(data["axial_force"].values))
        largest = force[_extreme(np.argmax, force, test)]
        quantities["axial_stress"] = largest * k / (np.pi * (outer**2 - inner**2))
    return quantities


def _quantities_of_sheets(data: xr.Dataset, lateral: Array) -> dict[str, Array]:
    """Quantities of sheets with a plausible range, one number a test."""
    starts = _starts(data["test"].values)
    x, y, stress_x, stress_y = (data[name].values for name in SHEET_VARIABLES)
    longest = np.fmax(x, y)
    largest = np.fmax.reduceat(longest, starts)
    smallest = np.fmin.reduceat(np.fmin(x, y), starts)
    # If a strain was given as a stretch all are small, which is doubted once.
    likely = largest >= PLAUSIBLE["largest_stretch"].low
    quantities = {
        "largest_stretch": largest,
        "smallest_stretch": np.where(likely, smallest, np.nan),
        "largest_strain": np.where(likely, np.fmax(largest - 1, 1 - smallest), np.nan),
        "largest_stress": np.fmax.reduceat(np.fmax(abs(stress_x), abs(stress_y)), starts),
    }
    if np.isfinite(lateral).any():
        point = _extreme(np.nanargmax, longest, data["test"].values)
        across = np.where(largest > 1, lateral[point], np.nan)
        quantities["lateral_stretch"] = across
        quantities["thickness_stretch"] = 1 / (largest * across)
    return quantities


def _doubt_signs(data: xr.Dataset, problems: Problems) -> None:
    """Doubt tests in which the stresses do negative work where the sheet is stretched most."""
    stretches, stresses = (
        np.array([data[f"{of}_{axis}"].values for axis in "xy"]) for of in ("stretch", "stress")
    )
    logs = np.log(stretches)
    work = stresses * logs
    # The work is not known if a stress that does some was not measured. Equal stretches of two axes
    # have stresses of one sign.
    idle = np.isnan(logs) | (np.abs(logs) < LEAST_STRAIN) | np.isclose(logs[0], logs[1])
    known = np.all(np.isfinite(work) | idle, axis=0)
    for i, point in enumerate(
        _extreme(np.argmax, np.nan_to_num(np.abs(logs)).max(axis=0), data["test"].values)
    ):
        if known[point] and np.nansum(work[:, point]) < 0:
            pairs = zip("xy", stretches[:, point], stresses[:, point], strict=True)
            stated = "; ".join(
                f"stretch_{axis} {stretch:.6g}, stress_{axis} {stress:.6g} kPa"
                for axis, stretch, stress in pairs
                if np.isfinite(stress)
            )
            problems.doubt(
                "sign",
                place_of_test(data, i),
                f"where the sheet is stretched most, its stress pulls against the stretch "
                f"({stated}): was a sign exchanged, or is the stretch over another length than the "
                "unloaded one?",
            )


def _starts(test: Array) -> NDArray[np.intp]:
    """Position of the first point of every test, whose points stand together."""
    return np.searchsorted(test, np.arange(test[-1] + 1))


def _extreme(which: Callable[[Array], np.intp], values: Array, test: Array) -> Array:
    """Position of the lowest or the highest value of every test, whose points stand together."""
    starts = _starts(test)
    parts = np.split(values, starts[1:])
    return starts + np.array([which(part) for part in parts])
