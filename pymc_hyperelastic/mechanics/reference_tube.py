"""The reference tube, in the words in which a user states it."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Literal, get_args

from pymc_hyperelastic.mechanics.tube import GEOMETRY, inferred_geometry, opened_sector

Convention = Literal["whole", "fung"]
RadiiOf = Literal["sector", "ring"]

# Measures of the unloaded wall, from one radius and which the other follows.
WALL = ("thickness", "wall_area", "wall_volume", "length")


@dataclass(frozen=True)
class Tube:
    r"""Geometry of an unloaded tube, and the axial stretch at which it is inflated.

    A tube has an inner radius and an outer radius. One of them may be replaced by a measure of the
    wall: its thickness ``h``, the area ``S`` of its cross-section, or its volume and its length
    with :math:`S` the quotient of the two. With the opening factor ``k``, which is 1 without an
    opening angle,

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
    thickness, wall_area, wall_volume, length : float, optional
        Measures of the unloaded wall (mm, mm², mm³, mm), in place of one radius.
    convention : {"whole", "fung"}, optional
        Which angle is given. ``"whole"`` is the angle that the opened sector lacks of a full circle
        [1]_. ``"fung"`` is half of that: the angle between the lines from the middle of the
        sector's inner side to its two ends [2]_. It is required with an opening angle of measured
        data; elsewhere ``"whole"`` is meant unless it is stated.
    radii_of : {"sector", "ring"}, optional
        Whether the radii are those of the opened ``"sector"`` or of the closed ``"ring"`` before it
        was cut. It is required with an opening angle of measured data; elsewhere ``"sector"`` is
        meant unless it is stated. A ring keeps its wall area, its middle line and so its thickness
        when it opens.
    sd : dict of str to float, optional
        Standard deviations of measures of the tube, for :func:`inflation_data` alone: of
        ``thickness``, ``wall_area``, ``inner_radius``, ``outer_radius``, ``axial_stretch`` or
        ``opening_angle``.

    Raises
    ------
    ValueError
        If the convention is unknown, or if the wall has too many measures.

    See Also
    --------
    inflation_data, inflation_pressure

    Notes
    -----
    In :func:`inflation_data` each measure may be the name of a column of the table instead of a
    number, and the units are those that the function is told. There ``nan``, or no radius, means
    that a measure is not known. In :func:`inflation_pressure` each measure may be an array or a
    random variable.

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
    wall_volume: Any = None
    length: Any = None
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
        wall = [name for name in WALL if getattr(self, name) is not None]
        if wall and wall not in (["thickness"], ["wall_area"], ["wall_volume", "length"]):
            raise ValueError(
                f"of the wall {', '.join(wall)} {'is' if len(wall) == 1 else 'are'} given; "
                "expected thickness, or wall_area, or wall_volume with length"
            )
        if wall and self.inner_radius is not None and self.outer_radius is not None:
            raise ValueError(
                f"{', '.join(wall)} is given with both radii of the tube; leave one of the radii, "
                "or the measure of the wall, away"
            )

    def __repr__(self) -> str:
        stated = {f.name: getattr(self, f.name) for f in fields(self)}
        text = ", ".join(f"{k}={v!r}" for k, v in stated.items() if v is not None)
        return f"Tube({text})"

    def geometry(self) -> dict[str, Any]:
        """Return the stated radii, mm, axial stretch and opening angle of the opened sector, rad.

        Raises
        ------
        ValueError
            If a measure of the wall is given without a radius, or if only one radius of a closed
            ring is known.
        """
        known = {name: getattr(self, name) for name in GEOMETRY}
        known = {name: value for name, value in known.items() if value is not None}
        if self.convention == "fung" and "opening_angle" in known:
            known["opening_angle"] = 2 * known["opening_angle"]
        ring = self.radii_of == "ring" and "opening_angle" in known
        angle = known.pop("opening_angle") if ring else None
        known |= self._wall(known)
        if "thickness" in known or "wall_area" in known:
            known = inferred_geometry(known)
        if not ring:
            return known
        if ("inner_radius" in known) != ("outer_radius" in known):
            raise ValueError(f"{self}: only one radius of the closed ring is known; give both")
        if "inner_radius" in known:
            radii = known["inner_radius"], known["outer_radius"]
            inner, outer = opened_sector(*radii, opening_angle=angle)
            known |= {"inner_radius": inner, "outer_radius": outer}
        return known | {"opening_angle": angle}

    def _wall(self, known: Mapping[str, Any]) -> dict[str, Any]:
        """Return the thickness or the wall area, or the inner radius that follows from them."""
        area = self.wall_area
        if self.wall_volume is not None:
            area = self.wall_volume / self.length
        measure = {"thickness": self.thickness} if self.thickness is not None else {}
        measure |= {"wall_area": area} if area is not None else {}
        if not measure or "inner_radius" in known:
            return measure
        if "outer_radius" not in known:
            raise ValueError(f"{self}: a measure of the wall needs one radius; give it")
        return {"inner_radius": _inner_radius(known, **measure)}


def _inner_radius(known: Mapping[str, Any], thickness: Any = None, wall_area: Any = None) -> Any:
    """Inner radius of a wall whose outer radius is known."""
    outer = known["outer_radius"]
    if thickness is not None:
        return outer - thickness
    # A negative area takes the wall away from a tube of the outer radius.
    inside = {"inner_radius": outer, "wall_area": -wall_area}
    angle = {"opening_angle": known["opening_angle"]} if "opening_angle" in known else {}
    return inferred_geometry(inside | angle)["outer_radius"]
