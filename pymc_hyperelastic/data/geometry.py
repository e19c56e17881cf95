"""The reference tube at the door: whichever way a laboratory states it, the opened sector.

Inside, the reference is the sector to which a cut ring springs open: its two radii, and the whole
angle that it lacks of a full circle. Laboratories mostly report Fung's angle and the closed ring.
"""

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pymc_hyperelastic.data.columns import Rows
from pymc_hyperelastic.mechanics.tube import opened_sector, opening_factor

Convention = Literal["whole", "fung"]
RadiiOf = Literal["sector", "ring"]
Array = NDArray[np.float64]

# Measures of the unloaded wall.
WALL = ("thickness", "wall_area", "wall_volume", "length")
_COMPLETE_WALLS = (["thickness"], ["wall_area"], ["wall_volume", "length"])

_CONVENTIONS = (
    "two conventions are in use; say which is meant: "
    'opening_angle_convention="whole" if it is the whole angle that the opened sector lacks of a '
    'full circle, 2π less its own; "fung" if it is Fung\'s, half of that: between the lines from '
    "the middle of the sector's inner side to its two ends"
)
_REFERENCES = (
    "the ring and the sector to which it opened have different radii; say which are given: "
    'radii_of="ring" if the radii are those of the closed unloaded ring, before it was cut; '
    '"sector" if they are those of the sector to which it opened'
)
_DEGREES = 'expected an angle between -2 pi and 2 pi: for degrees, say angle_unit="deg"'


def _refuse(
    rows: Rows, bad: NDArray, what: str, values: Array | None = None, dimension: str = ""
) -> None:
    """Record tests that are bad as errors, with their values in place of the braces."""
    for i in np.flatnonzero(bad).tolist():
        rows.refuse_test(i, what.format("" if values is None else float(values[i])), dimension)


def reference_tube(
    rows: Rows,
    known: dict[str, Array],
    wall: dict[str, Array],
    convention: Convention | None,
    radii_of: RadiiOf | None,
) -> dict[str, Array]:
    """Radii of the opened sector and the whole angle that it lacks, one number a test.

    Parameters
    ----------
    rows : Rows
        Whose tests these are, for messages.
    known : dict
        ``inner_radius``, ``outer_radius`` (mm), ``opening_angle`` (rad), NaN where unknown.
    wall : dict
        What was given of ``thickness`` (mm), ``wall_area`` (mm²), ``wall_volume`` (mm³) and
        ``length`` (mm), of the unloaded ring.
    convention, radii_of : str or None
        Which angle, and the radii of what.
    """
    with np.errstate(invalid="ignore", divide="ignore"):  # of tests that are refused
        angle = _whole_angle(rows, known["opening_angle"], convention, radii_of)
        inner, outer = known["inner_radius"], known["outer_radius"]
        if wall:
            k = np.ones_like(angle) if radii_of == "ring" else opening_factor(angle)
            inner, outer = _completed(rows, inner, outer, wall, k)
        if radii_of == "ring":
            _check_ring(rows, inner, outer, angle)
            inner, outer = opened_sector(inner, outer, opening_angle=angle)
            bent = "the ring would bend inside out, opening_angle is {:.6g} rad as a whole; check "
            _refuse(rows, inner <= 0, f"{bent}its sign", angle)
    return {"inner_radius": inner, "outer_radius": outer, "opening_angle": angle}


def errors_of_tube(
    rows: Rows,
    errors: dict[str, Array],
    convention: Convention | None,
    radii_of: RadiiOf | None,
) -> dict[str, Array]:
    """Standard deviations of measures of the sector, from the given ones."""
    if radii_of == "ring" and (radii := [n for n in errors if n.endswith("_radius")]):
        raise ValueError(
            f"geometry_sd holds {radii[0]!r}, but the radii are those of the ring, and models take "
            "those of the sector to which it opened: give the error of its thickness or wall_area"
        )
    if "opening_angle" in errors:
        if convention is None:
            raise ValueError(f"geometry_sd holds an error of the opening angle: {_CONVENTIONS}")
        errors |= {"opening_angle": errors["opening_angle"] * (2 if convention == "fung" else 1)}
    for name, sd in errors.items():
        bad = ~(np.isfinite(sd) & (sd >= 0))
        what = f"the error of {name} is {{:.6g}}; expected a positive number"
        _refuse(rows, bad, what, sd)
    return {f"{name}_sd": sd for name, sd in errors.items()}


def _whole_angle(
    rows: Rows, angle: Array, convention: Convention | None, radii_of: RadiiOf | None
) -> Array:
    for name, value, options in (
        ("opening_angle_convention", convention, get_args(Convention)),
        ("radii_of", radii_of, get_args(RadiiOf)),
    ):
        if value is not None and value not in options:
            raise ValueError(f"{name} is {value!r}; expected one of {options}")
    impossible = "opening_angle is {:.6g} rad; " + _DEGREES
    _refuse(rows, np.abs(angle) >= 2 * np.pi, impossible, angle, "angle")
    questions = [_CONVENTIONS] if convention is None else []
    questions += [_REFERENCES] if radii_of is None else []
    cut = np.isfinite(angle) & (angle != 0) & bool(questions)
    _refuse(rows, cut, "opening_angle is {:.6g} rad, and " + "; and ".join(questions), angle)
    return 2 * angle if convention == "fung" else angle


def _completed(
    rows: Rows, inner: Array, outer: Array, wall: dict[str, Array], k: Array
) -> tuple[Array, Array]:
    """Both radii, from one of them and one measure of the wall."""
    given = sorted(wall, key=WALL.index)
    if given not in _COMPLETE_WALLS:
        raise ValueError(
            f"of the wall {', '.join(given)} {'is' if len(given) == 1 else 'are'} given; expected "
            "thickness, or wall_area, or wall_volume with length"
        )
    if np.isnan(inner).all() == np.isnan(outer).all():
        neither = np.isnan(inner).all()
        raise ValueError(
            f"{', '.join(given)} is given with {'neither' if neither else 'both'} of inner_radius "
            "and outer_radius; expected one of them, and None for the other"
        )
    for name, values in wall.items():
        _refuse(rows, ~(values > 0), f"{name} is {{:.6g}}; expected a positive number", values)
    _refuse(
        rows,
        np.isnan(k) & ("thickness" not in wall),
        f"opening_angle is not known, and the radii of a sector do not follow from {given[0]} "
        'without it: give the thickness, or radii_of="ring" with the angle',
    )
    if "thickness" in wall:
        h = wall["thickness"]
        return (outer - h, outer) if np.isnan(inner).all() else (inner, inner + h)
    area = wall["wall_area"] if "wall_area" in wall else wall["wall_volume"] / wall["length"]
    squares = k * area / np.pi
    if np.isnan(outer).all():
        return inner, np.sqrt(inner**2 + squares)
    too_thick = "a wall of a cross-section of {:.6g} mm² does not fit into the outer radius"
    _refuse(rows, squares >= outer**2, too_thick, area)
    return np.sqrt(outer**2 - squares), outer


def _check_ring(rows: Rows, inner: Array, outer: Array, angle: Array) -> None:
    """Refuse tests unless the ring is one, and its opening is known."""
    some, both = ~(np.isnan(inner) & np.isnan(outer)), ~(np.isnan(inner) | np.isnan(outer))
    _refuse(
        rows,
        some & np.isnan(angle),
        "the radii are those of a closed ring, and without its opening_angle those of the sector "
        'are not known: give the angle, or None for both radii, or radii_of="sector"',
    )
    _refuse(
        rows,
        some & ~both & (angle != 0),
        "of the closed ring one radius is not known; to know the sector it takes both, or one and "
        "thickness, wall_area, or wall_volume and length",
    )
    positive = "inner_radius is {:.6g} mm; expected a positive one"
    _refuse(rows, both & (inner <= 0), positive, inner)
    larger = "outer_radius of the ring is {:.6g} mm; expected more than inner_radius"
    _refuse(rows, both & (outer <= inner), larger, outer)
    impossible = "opening_angle is {:.6g} rad as a whole; " + _DEGREES
    _refuse(rows, both & (np.abs(angle) >= 2 * np.pi), impossible, angle, "angle")
