"""The reference tube at the door: whichever way a laboratory states it, the opened sector.

Inside, the reference is the sector to which a cut ring springs open: its two radii, and the whole
angle that it lacks of a full circle. Laboratories mostly report Fung's angle and the closed ring.
"""

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pymc_hyperelastic.mechanics.tube import opened_sector, opening_factor

Convention = Literal["whole", "fung"]
RadiiOf = Literal["sector", "ring"]
Array = NDArray[np.float64]

# Powers of a length in which each measure of the wall is.
WALL = {"thickness": 1, "wall_area": 2, "wall_volume": 3, "length": 1}

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


def reference_tube(
    known: dict[str, Array],
    wall: dict[str, Array],
    convention: Convention | None,
    radii_of: RadiiOf | None,
    places: list[str],
) -> dict[str, Array]:
    """Radii of the opened sector and the whole angle that it lacks, one number a test.

    Parameters
    ----------
    known : dict
        ``inner_radius``, ``outer_radius`` (mm), ``opening_angle`` (rad), NaN where unknown.
    wall : dict
        What was given of ``thickness`` (mm), ``wall_area`` (mm²), ``wall_volume`` (mm³) and
        ``length`` (mm), of the unloaded ring.
    convention, radii_of : str or None
        Which angle, and the radii of what.
    places : list of str
        What messages call each test.

    Examples
    --------
    A ring of radii 1.0 and 1.2 mm that opens by Fung's 90 degrees has a sector of half a circle:

    >>> ring = {"inner_radius": 1.0, "outer_radius": 1.2, "opening_angle": np.pi / 2}
    >>> ring = {name: np.array([value]) for name, value in ring.items()}
    >>> reference_tube(ring, {}, "fung", "ring", ["S1"])["inner_radius"]
    array([2.1])
    """
    angle = _whole_angle(known["opening_angle"], convention, radii_of, places)
    of_ring = radii_of == "ring"
    inner, outer = known["inner_radius"], known["outer_radius"]
    if wall:
        k = np.ones_like(angle) if of_ring else opening_factor(angle)
        inner, outer = _completed(inner, outer, wall, k, places)
    if of_ring:
        _check_ring(inner, outer, angle, places)
        inner, outer = opened_sector(inner, outer, opening_angle=angle)
        _refuse(
            inner <= 0,
            places,
            "the ring would bend inside out, opening_angle is "
            "{:.6g} rad as a whole; check its sign",
            angle,
        )
    return {"inner_radius": inner, "outer_radius": outer, "opening_angle": angle}


def errors_of_tube(
    errors: dict[str, Array],
    convention: Convention | None,
    radii_of: RadiiOf | None,
    places: list[str],
) -> dict[str, Array]:
    """Standard deviations of measures of the sector, of those that were given; with their units.

    Examples
    --------
    >>> errors_of_tube({"opening_angle": np.array([0.1])}, "fung", "ring", ["S1"])
    {'opening_angle_sd': array([0.2])}
    """
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
        _refuse(bad, places, f"the error of {name} is {{:.6g}}; expected a positive number", sd)
    return {f"{name}_sd": sd for name, sd in errors.items()}


def _whole_angle(
    angle: Array, convention: Convention | None, radii_of: RadiiOf | None, places: list[str]
) -> Array:
    for name, value, options in (
        ("opening_angle_convention", convention, get_args(Convention)),
        ("radii_of", radii_of, get_args(RadiiOf)),
    ):
        if value is not None and value not in options:
            raise ValueError(f"{name} is {value!r}; expected one of {options}")
    _refuse(
        np.abs(angle) >= 2 * np.pi,
        places,
        "opening_angle is {:.6g} rad; expected an angle between -2 pi and 2 pi: for degrees, say "
        'angle_unit="deg"',
        angle,
    )
    # What is asked, all at once.
    asked = [_CONVENTIONS] if convention is None else []
    asked += [_REFERENCES] if radii_of is None else []
    cut = np.isfinite(angle) & (angle != 0) & bool(asked)
    _refuse(cut, places, "opening_angle is {:.6g} rad, and " + "; and ".join(asked), angle)
    return 2 * angle if convention == "fung" else angle


def _completed(
    inner: Array, outer: Array, wall: dict[str, Array], k: Array, places: list[str]
) -> tuple[Array, Array]:
    """Both radii, of one of them and one measure of the wall."""
    given = sorted(wall, key=list(WALL).index)
    if given not in (["thickness"], ["wall_area"], ["wall_volume", "length"]):
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
        _refuse(~(values > 0), places, f"{name} is {{:.6g}}; expected a positive number", values)
    _refuse(
        np.isnan(k) & ("thickness" not in wall),
        places,
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
    _refuse(
        squares >= outer**2,
        places,
        "a wall of a cross-section of {:.6g} mm² does not fit into the outer radius",
        area,
    )
    return np.sqrt(outer**2 - squares), outer


def _check_ring(inner: Array, outer: Array, angle: Array, places: list[str]) -> None:
    """Raise unless the ring is one, and it is known how it opens."""
    some, both = ~(np.isnan(inner) & np.isnan(outer)), ~(np.isnan(inner) | np.isnan(outer))
    _refuse(
        some & np.isnan(angle),
        places,
        "the radii are those of a closed ring, and without its opening_angle those of the sector "
        'are not known: give the angle, or None for both radii, or radii_of="sector"',
    )
    _refuse(
        some & ~both & (angle != 0),
        places,
        "of the closed ring one radius is not known; to know the sector it takes both, or one and "
        "thickness, wall_area, or wall_volume and length",
    )
    _refuse(
        both & (inner <= 0), places, "inner_radius is {:.6g} mm; expected a positive one", inner
    )
    _refuse(
        both & (outer <= inner),
        places,
        "outer_radius of the ring is {:.6g} mm; expected more than inner_radius",
        outer,
    )
    _refuse(
        both & (np.abs(angle) >= 2 * np.pi),
        places,
        "opening_angle is {:.6g} rad as a whole; expected an angle between -2 pi and 2 pi: for "
        'degrees, say angle_unit="deg"',
        angle,
    )


def _refuse(
    bad: NDArray[np.bool_], places: list[str], message: str, values: Array | None = None
) -> None:
    """Raise at the first test that is bad."""
    where = np.flatnonzero(bad)
    if where.size:
        value = "" if values is None else float(values[where[0]])
        raise ValueError(f"{places[where[0]]}: {message.format(value)}")
