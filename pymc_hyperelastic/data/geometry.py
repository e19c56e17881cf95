"""Check the reference tubes of a table, and convert them to opened sectors.

Inside the package the reference tube is the sector to which a cut ring springs open: its two radii,
and the whole angle that it lacks of a full circle. Laboratories mostly report Fung's angle and the
closed ring. :func:`~pymc_hyperelastic.inflation_data` calls this module.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.columns import Rows
from pymc_hyperelastic.data.inflation import ANGLE
from pymc_hyperelastic.mechanics.reference_tube import (
    Tube,
    stated_wall,
    whole_angle,
    with_both_radii,
)
from pymc_hyperelastic.mechanics.tube import opening_factor

Array = NDArray[np.float64]

_CONVENTIONS = (
    "two conventions are in use; say which is meant: "
    '{0}"whole"{1} if it is the whole angle that the opened sector lacks of a '
    'full circle, 2π less its own; {0}"fung"{1} if it is Fung\'s, half of that: between the lines '
    "from the middle of the sector's inner side to its two ends"
)
_REFERENCES = (
    "the ring and the sector to which it opened have different radii; say which are given: "
    'radii_of="ring" if the radii are those of the closed unloaded ring, before it was cut; '
    '"sector" if they are those of the sector to which it opened'
)
_TWICE = (
    "opening_angle is {:.6g} rad as a whole, twice Fung's; expected an angle between -2 pi and "
    '2 pi: if the whole angle of the gap was measured, its convention is "whole"'
)


def _refuse(
    rows: Rows, bad: NDArray, what: str, values: Array | None = None, dimension: str = ""
) -> None:
    """Record tests that are bad as errors, with their values in place of the braces."""
    for i in np.flatnonzero(bad).tolist():
        rows.refuse_test(i, what.format("" if values is None else float(values[i])), dimension)


def _conventions(rows: Rows) -> str:
    """Question for the convention, in the words of those who state it in Python or in settings."""
    words = ("opening_angle_convention=", "") if rows.of_files else ("Tube(convention=", ")")
    return _CONVENTIONS.format(*words)


def reference_tube(rows: Rows, tube: Tube, numbers: dict[str, Array]) -> dict[str, Array]:
    """Radii of the opened sector and the whole angle that it lacks, one number a test.

    Parameters
    ----------
    rows : Rows
        Rows of the tests, for messages.
    tube : Tube
        The tube, as the user states it.
    numbers : dict
        ``inner_radius``, ``outer_radius`` (mm), ``opening_angle`` (rad), NaN where unknown; and
        the stated one of ``thickness`` (mm) and ``wall_area`` (mm²), of the unloaded ring.
    """
    ring = tube.radii_of == "ring"
    with np.errstate(invalid="ignore", divide="ignore"):  # of tests that are refused
        _check_angle(rows, tube, numbers["opening_angle"])
        known = _with_wall(rows, replace(tube, axial_stretch=None, sd=None), numbers)
        inner, outer, angle = known.inner_radius, known.outer_radius, whole_angle(known)
        if ring:
            _check_ring(rows, inner, outer, angle)
        sector = known.geometry()
        if ring:
            # A ring that stays closed keeps a radius also if the other one is not known.
            sector["inner_radius"] = np.where(angle == 0, inner, sector["inner_radius"])
            sector["outer_radius"] = np.where(angle == 0, outer, sector["outer_radius"])
            bent = "the ring would bend inside out, opening_angle is {:.6g} rad as a whole; check "
            _refuse(rows, sector["inner_radius"] <= 0, f"{bent}its sign", angle)
    return sector


def kept_circle(tube: Tube, numbers: dict[str, Array], opening_angle: Array) -> Array:
    """Return the circle in the wall of each sector that a thicker wall would keep.

    Its place is a fraction of the wall: 0 at the inner radius, 1 at the outer radius. The inner
    radius is kept, or the outer one if that was stated with a measure of the wall. A ring keeps one
    of its own radii, and its middle line grows by the opening factor when it opens.
    """
    outer = bool(stated_wall(tube)) and bool(np.isnan(numbers["inner_radius"]).all())
    from_middle = 0.5 if outer else -0.5
    with np.errstate(divide="ignore"):  # a full turn is refused
        factor = opening_factor(opening_angle) if tube.radii_of == "ring" else 1.0
    return np.full(len(opening_angle), 0.5 + factor * from_middle)


def kept_circle_of(data: xr.Dataset) -> Array:
    """Return the :func:`kept_circle` of each test of data; by default it is at the inner radius."""
    if "kept_circle" not in data.variables:
        return np.zeros(data.sizes["test"])
    return np.nan_to_num(data["kept_circle"].values.astype(float))


def errors_of_tube(rows: Rows, tube: Tube, errors: dict[str, Array]) -> dict[str, Array]:
    """Standard deviations of measures of the sector, from the given ones."""
    if tube.radii_of == "ring" and (radii := [n for n in errors if n.endswith("_radius")]):
        raise ValueError(
            f"sd holds {radii[0]!r}, but the radii are those of the ring, and models take those of "
            "the sector to which it opened: give the error of its thickness or wall_area"
        )
    if "opening_angle" in errors:
        if tube.convention is None:
            raise ValueError(f"sd holds an error of the opening angle: {_conventions(rows)}")
        factor = 2 if tube.convention == "fung" else 1
        errors |= {"opening_angle": factor * errors["opening_angle"]}
    for name, sd in errors.items():
        bad = ~(np.isfinite(sd) & (sd >= 0))
        what = f"the error of {name} is {{:.6g}}; expected a positive number"
        _refuse(rows, bad, what, sd)
    return {f"{name}_sd": sd for name, sd in errors.items()}


def _check_angle(rows: Rows, tube: Tube, angle: Array) -> None:
    """Refuse tests with an impossible angle, or with one that has two meanings."""
    impossible = "opening_angle is {:.6g} rad; " + ANGLE
    _refuse(rows, np.abs(angle) >= 2 * np.pi, impossible, angle, "angle")
    if tube.convention == "fung":
        beyond = (np.abs(angle) >= np.pi) & (np.abs(angle) < 2 * np.pi)
        _refuse(rows, beyond, _TWICE, 2 * angle, "angle")
    questions = [_conventions(rows)] if tube.convention is None else []
    questions += [_REFERENCES] if tube.radii_of is None else []
    cut = np.isfinite(angle) & (angle != 0) & bool(questions)
    _refuse(rows, cut, "opening_angle is not 0, and " + "; and ".join(questions))


def _with_wall(rows: Rows, tube: Tube, numbers: dict[str, Any]) -> Tube:
    """Return the tube in numbers, with both radii in place of a measure of the wall."""
    wall = stated_wall(tube)
    if not wall:
        return replace(tube, **numbers)
    for name in wall:
        values = numbers[name]
        _refuse(rows, values <= 0, f"{name} is {{:.6g}}; expected a positive number", values)
    _refuse(
        rows,
        np.isnan(numbers["opening_angle"]) & (wall != ["thickness"]) & (tube.radii_of != "ring"),
        f"opening_angle is not known, and the radii of a sector do not follow from {wall[0]} "
        'without it: give the thickness, or radii_of="ring" with the angle',
    )
    # A radius that is not known in any test follows from the wall.
    radii = ("inner_radius", "outer_radius")
    follows = {name: None for name in radii if np.isnan(numbers[name]).all()}
    both = with_both_radii(replace(tube, **numbers | follows))
    if wall != ["thickness"] and "inner_radius" in follows:
        area = numbers["wall_area"]
        too_thick = "a wall of a cross-section of {:.6g} mm² does not fit into the outer radius"
        _refuse(rows, np.isfinite(area) & ~(both.inner_radius > 0), too_thick, area)
    return both


def _check_ring(rows: Rows, inner: Array, outer: Array, angle: Array) -> None:
    """Refuse tests unless the ring is one, and its opening is known."""
    some, both = ~(np.isnan(inner) & np.isnan(outer)), ~(np.isnan(inner) | np.isnan(outer))
    _refuse(
        rows,
        some & np.isnan(angle),
        "the radii are those of a closed ring, and without its opening_angle those of the sector "
        'are not known: give the angle, or neither radius, or radii_of="sector"',
    )
    _refuse(
        rows,
        some & ~both & (angle != 0),
        "of the closed ring one radius is not known; to know the sector it takes both, or one and "
        "thickness or wall_area",
    )
    positive = "inner_radius is {:.6g} mm; expected a positive one"
    _refuse(rows, both & (inner <= 0), positive, inner)
    larger = "outer_radius of the ring is {:.6g} mm; expected more than inner_radius"
    _refuse(rows, both & (outer <= inner), larger, outer)
