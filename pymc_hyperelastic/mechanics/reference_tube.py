"""The reference tube, in the words in which a user states it."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from math import pi
from numbers import Real
from typing import Any, Literal, get_args

from pymc_hyperelastic.mechanics.tube import GEOMETRY, inferred_geometry, opened_sector
from pymc_hyperelastic.messages import shown
from pymc_hyperelastic.quantities import MEASURES

Convention = Literal["whole", "fung"]
RadiiOf = Literal["sector", "ring"]

# Measures of the unloaded wall, from one radius and which the other follows.
WALL = ("thickness", "wall_area")


@dataclass(frozen=True)
class Tube:
    r"""Geometry of an unloaded tube, and the axial stretch at which it is inflated.

    A tube has an inner radius and an outer radius. One of them may be replaced by a measure of the
    wall: its thickness ``h``, or the area ``S`` of its cross-section, which is its volume over its
    length. With the opening factor ``k``, which is 1 without an opening angle,

    .. math:: B = A + h, \qquad B^2 = A^2 + k S/π .

    A measure that is not stated is ``None``. Each function completes the tube in its own way. The
    functions :func:`inflation_data` and :func:`inflation_pressure` take an axial stretch of 1 and
    no opening angle. Predictions take the measured tube of the specimen, and
    :func:`compare_classes` takes medians over the specimens.

    Parameters
    ----------
    inner_radius, outer_radius : float, optional
        Radii ``A < B`` of the unloaded tube, mm.
    axial_stretch : float, optional
        Length of the tube over its unloaded length.
    opening_angle : float, optional
        Angle by which a ring springs open when it is cut, radians.
    thickness, wall_area : float, optional
        Thickness (mm) of the unloaded wall, or area (mm²) of its cross-section, in place of one
        radius.
    convention : {"whole", "fung"}, optional
        Meaning of the angle. ``"whole"`` is the angle that the opened sector lacks of a full circle
        [1]_. ``"fung"`` is half of that: the angle between the lines from the middle of the
        sector's inner side to its two ends [2]_. It is required with an opening angle of measured
        data; elsewhere ``"whole"`` is meant unless it is stated.
    radii_of : {"sector", "ring"}, optional
        Configuration of the radii: the opened ``"sector"``, or the closed ``"ring"`` before it was
        cut. It is required with an opening angle of measured data; elsewhere ``"sector"`` is
        meant unless it is stated. A ring keeps its wall area, its middle line and so its thickness
        when it opens.
    sd : dict of str to float, optional
        Standard deviations of measures of the tube, for :func:`inflation_data` alone: of
        ``thickness``, ``wall_area``, ``inner_radius``, ``outer_radius``, ``axial_stretch`` or
        ``opening_angle``.

    Raises
    ------
    TypeError
        If `sd` is no dict.
    ValueError
        If the convention is unknown, if the wall has too many measures, or if `sd` names an unknown
        measure.

    See Also
    --------
    inflation_data, inflation_pressure

    Notes
    -----
    In :func:`inflation_data` each measure may be the name of a column of the table instead of a
    number, and its unit is an argument of the function. There ``nan`` means that a measure
    is not known; a radius that is not stated is not known either. In :func:`inflation_pressure`
    each measure may be an array or a random variable, and a wall of layers has no outer radius.

    A tube does not change. ``dataclasses.replace(tube, axial_stretch=1.2)`` returns a changed copy.

    References
    ----------
    .. [1] G. A. Holzapfel, T. C. Gasser, R. W. Ogden, A new constitutive framework for arterial
       wall mechanics and a comparative study of material models, Journal of Elasticity 61 (2000)
       1-48.
    .. [2] Y. C. Fung, S. Q. Liu, Change of residual strains in arteries due to hypertrophy caused
       by aortic constriction, Circulation Research 65 (1989) 1340-1349.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> ph.Tube(inner_radius=7.0, thickness=2.0).geometry()
    {'inner_radius': 7.0, 'outer_radius': 9.0}

    A closed ring with Fung's angle, as the opened sector with the whole angle:

    >>> ring = ph.Tube(1.0, 1.5, opening_angle=0.5, convention="fung", radii_of="ring")
    >>> {name: round(value, 3) for name, value in ring.geometry().items()}
    {'inner_radius': 1.237, 'outer_radius': 1.737, 'opening_angle': 1.0}
    """

    inner_radius: Any = None
    outer_radius: Any = None
    axial_stretch: Any = None
    opening_angle: Any = None
    thickness: Any = None
    wall_area: Any = None
    convention: Convention | None = None
    radii_of: RadiiOf | None = None
    sd: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        for name, options in (
            ("convention", get_args(Convention)),
            ("radii_of", get_args(RadiiOf)),
        ):
            value = getattr(self, name)
            if value is not None and value not in options:
                raise ValueError(f"{name} is {value!r}; expected one of {options}")
        wall = stated_wall(self)
        if len(wall) > 1:
            raise ValueError("thickness and wall_area are given; leave one of them away")
        if wall and self.inner_radius is not None and self.outer_radius is not None:
            raise ValueError(
                f"{wall[0]} is given with both radii of the tube; leave one of the radii, "
                "or the measure of the wall, away"
            )
        if self.sd is not None and not isinstance(self.sd, Mapping):
            raise TypeError(
                'sd must be a dict such as {"thickness": 0.01}, not ' + type(self.sd).__name__
            )
        for name in self.sd or {}:
            if name not in MEASURES:
                raise ValueError(f"sd holds {name!r}; expected some of {list(MEASURES)}")

    def __repr__(self) -> str:
        stated = {f.name: getattr(self, f.name) for f in fields(self)}
        text = ", ".join(f"{k}={v!r}" for k, v in stated.items() if v is not None)
        return f"Tube({text})"

    def geometry(self) -> dict[str, Any]:
        """Return the stated radii, mm, axial stretch and opening angle of the opened sector, rad.

        Raises
        ------
        ValueError
            If a measure of the wall is given without a radius, if only one radius of a closed ring
            is known, if the whole opening angle is a number beyond 2π, or if errors of measures
            are given.
        """
        if self.sd is not None:
            raise ValueError("only ph.inflation_data accepts errors of the tube; leave sd away")
        # Tables hold arrays, whose impossible angles are reported with the names of their tests.
        if isinstance(self.opening_angle, Real) and abs(whole_angle(self)) >= 2 * pi:
            raise ValueError(
                f"opening_angle is {whole_angle(self):.6g} rad as a whole; expected an angle "
                "between -2 pi and 2 pi, in radians"
            )
        both = with_both_radii(self)
        known = {name: getattr(both, name) for name in GEOMETRY}
        known = {name: value for name, value in known.items() if value is not None}
        if "opening_angle" not in known:
            return known
        angle = known["opening_angle"] = whole_angle(self)
        if self.radii_of != "ring":
            return known
        if ("inner_radius" in known) != ("outer_radius" in known):
            raise ValueError(
                "only one radius of the closed ring is known; give both radii, or one with the "
                "thickness or the wall area"
            )
        if "inner_radius" in known:
            radii = known["inner_radius"], known["outer_radius"]
            inner, outer = opened_sector(*radii, opening_angle=angle)
            known |= {"inner_radius": inner, "outer_radius": outer}
        return known


def check_is_tube(tube: Any) -> None:
    """Raise TypeError unless `tube` is a :class:`Tube`."""
    if not isinstance(tube, Tube):
        raise TypeError(
            f"tube is {shown(tube)}; expected a reference tube such as ph.Tube(7.0, 9.0), with the "
            "inner and the outer radius"
        )


def stated_wall(tube: Tube) -> list[str]:
    """Return the names of the measures of the wall that are stated."""
    return [name for name in WALL if getattr(tube, name) is not None]


def with_both_radii(tube: Tube) -> Tube:
    """Return a tube whose second radius, mm, replaces the measure of its wall.

    A tube without a measure of the wall is returned unchanged. The radii of a closed ring stay
    those of the ring.

    Raises
    ------
    ValueError
        If neither radius is given with the measure of the wall.
    """
    wall = stated_wall(tube)
    if not wall:
        return tube
    if tube.inner_radius is None and tube.outer_radius is None:
        raise ValueError(f"{wall[0]} is given with neither inner_radius nor outer_radius; give one")
    radii = {"inner_radius": tube.inner_radius, "outer_radius": tube.outer_radius}
    if tube.inner_radius is None and tube.thickness is not None:
        radii["inner_radius"] = tube.outer_radius - tube.thickness
    elif tube.inner_radius is None:
        # A negative area takes the wall away from a tube of the outer radius.
        radii["inner_radius"] = _outer_radius(tube, tube.outer_radius, wall_area=-tube.wall_area)
    elif tube.thickness is not None:
        radii["outer_radius"] = _outer_radius(tube, tube.inner_radius, thickness=tube.thickness)
    else:
        radii["outer_radius"] = _outer_radius(tube, tube.inner_radius, wall_area=tube.wall_area)
    return replace(tube, **dict.fromkeys(WALL), **radii)


def _outer_radius(tube: Tube, inner_radius: Any, **wall: Any) -> Any:
    """Outer radius of a tube of this inner radius and this measure of the wall."""
    known = {"inner_radius": inner_radius, **wall}
    if tube.opening_angle is not None and tube.radii_of != "ring":
        known["opening_angle"] = whole_angle(tube)
    return inferred_geometry(known)["outer_radius"]


def whole_angle(tube: Tube) -> Any:
    """Return the angle, rad, that the opened sector lacks of a full circle."""
    return 2 * tube.opening_angle if tube.convention == "fung" else tube.opening_angle
