r"""Kinematics of an incompressible thick-walled tube that is opened, stretched and inflated.

Wall integrals, data and predictions use these functions. The reference tube has inner radius ``A``
and outer radius ``B``. A cut ring that springs open by the angle ``Φ`` enters through the opening
factor ``k = 2π/(2π − Φ)``. At axial stretch ``λz`` and internal radius ``a`` the material circle of
radius ``R`` has the current radius

.. math:: r(R)^2 = a^2 + \frac{R^2 - A^2}{k λ_z}, \qquad
    λ_θ = \frac{k r}{R}, \qquad λ_r = \frac{1}{λ_θ λ_z}.

"Inner radius" is always ``A``, in the reference tube, and "internal radius" is always ``a``, in the
current tube. All functions use arithmetic only and accept numbers, NumPy arrays, xarray objects and
PyTensor variables. Lengths have one common unit (mm inside this package), angles are in radians.
Source: C. J. Chuong and Y. C. Fung, On residual stresses in arteries, Journal of Biomechanical
Engineering 108 (1986) 189-192.
"""

from collections.abc import Mapping
from math import pi
from typing import Any

# Names of the measures of the reference tube, in the order in which functions take them.
GEOMETRY = ("inner_radius", "outer_radius", "axial_stretch", "opening_angle")
# Those of them that determine where the circles of a wall move.
UNLOADED = ("inner_radius", "axial_stretch", "opening_angle")


def opening_factor(opening_angle: Any) -> Any:
    """Ratio ``k = 2π/(2π − Φ)`` by which closing a cut ring multiplies its angles."""
    return 2 * pi / (2 * pi - opening_angle)


def hoop_elongation(
    internal_radius: Any, radius: Any, *, inner_radius: Any, axial_stretch: Any, opening_angle: Any
) -> Any:
    r"""Relative excess ``δ`` of the squared hoop stretch over ``k/λz``.

    .. math:: δ(R) = \frac{k λ_z a^2 - A^2}{R^2}, \qquad λ_θ^2 = \frac{k}{λ_z} (1 + δ)

    For ``k = 1`` the pressure of an isotropic tube is 0 at ``δ = 0``. The difference of squares is
    factored, so that ``δ`` is accurate to rounding near ``a = A/√(k λz)``, where it is 0.
    """
    scaled = (opening_factor(opening_angle) * axial_stretch) ** 0.5 * internal_radius
    return (scaled - inner_radius) * (scaled + inner_radius) / radius**2


def current_radius(
    radius: Any, internal_radius: Any, *, inner_radius: Any, axial_stretch: Any, opening_angle: Any
) -> Any:
    """Radius ``r(R)`` to which the material circle of reference radius ``R`` moves."""
    k = opening_factor(opening_angle)
    return (internal_radius**2 + (radius**2 - inner_radius**2) / (k * axial_stretch)) ** 0.5


def stretches(
    radius: Any, internal_radius: Any, *, inner_radius: Any, axial_stretch: Any, opening_angle: Any
) -> tuple[Any, Any, Any]:
    """Principal stretches ``(λr, λθ, λz)`` at reference radius ``R``; their product is one."""
    unloaded = dict(zip(UNLOADED, (inner_radius, axial_stretch, opening_angle), strict=True))
    current = current_radius(radius, internal_radius, **unloaded)
    hoop = opening_factor(opening_angle) * current / radius
    return 1 / (hoop * axial_stretch), hoop, axial_stretch


def first_invariant(radial: Any, hoop: Any, axial: Any) -> Any:
    """First invariant ``I₁ = λr² + λθ² + λz²`` of the right Cauchy-Green tensor."""
    return radial**2 + hoop**2 + axial**2


def second_invariant(radial: Any, hoop: Any, axial: Any) -> Any:
    """Second invariant ``I₂ = λr²λθ² + λθ²λz² + λz²λr²`` of the right Cauchy-Green tensor."""
    return (radial * hoop) ** 2 + (hoop * axial) ** 2 + (axial * radial) ** 2


def internal_radius_from_outer_radius(
    current_outer_radius: Any,
    *,
    inner_radius: Any,
    outer_radius: Any,
    axial_stretch: Any = 1.0,
    opening_angle: Any = 0.0,
) -> Any:
    """Internal radius ``a² = ro² − (B² − A²)/(k λz)`` from the measured outer radius ``ro``.

    Pass half of a measured outer diameter.
    """
    k = opening_factor(opening_angle)
    wall = (outer_radius - inner_radius) * (outer_radius + inner_radius) / (k * axial_stretch)
    return (current_outer_radius**2 - wall) ** 0.5


def opened_sector(
    inner_radius: Any, outer_radius: Any, *, opening_angle: Any, before: Any = 0.0
) -> tuple[Any, Any]:
    r"""Radii of the sector to which a closed ring springs open by the whole angle ``Φ``.

    A closed ring has the radii ``a < b``. The cross-section of the wall keeps its area, because the
    wall is incompressible and keeps its axial length. The second condition is an assumption: the
    middle line of the wall keeps its length, ``(2π − Φ) (A + B)/2 = π (a + b)``. Both conditions
    together imply that the wall keeps its thickness:

    .. math:: A = a + (k - 1) \frac{a + b}{2}, \qquad B = b + (k - 1) \frac{a + b}{2}

    The exact position of the neutral line depends on the material. A ring in pure bending carries
    no resultant force; to first order in thickness over radius, this puts the neutral line of a
    homogeneous wall in the middle. Source: R. S. Rivlin, Large elastic deformations of isotropic
    materials V, The problem of flexure, Proceedings of the Royal Society A 195 (1949) 463-473.

    The given radii may also be those of a sector that is open by the angle `before`.
    """
    ratio = opening_factor(opening_angle) / opening_factor(before)
    excess = (ratio - 1) * (inner_radius + outer_radius) / 2
    return inner_radius + excess, outer_radius + excess


def inferred_geometry(known: Mapping[str, Any]) -> dict[str, Any]:
    r"""Measures of the reference tube, with the outer radius that follows from other measures.

    Measures in GEOMETRY are returned unchanged. The outer radius follows from the inner radius
    ``A`` and the ``thickness`` ``h``, or the ``wall_area`` ``S`` (cross-section of the unloaded
    ring, mm²):

    .. math:: B = A + h, \qquad B = \sqrt{A^2 + k S/π} .
    """
    geometry = {k: v for k, v in known.items() if k not in ("thickness", "wall_area")}
    if "thickness" in known:
        geometry["outer_radius"] = known["inner_radius"] + known["thickness"]
    if "wall_area" in known:
        k = opening_factor(known.get("opening_angle", 0.0))
        area = k * known["wall_area"] / pi
        geometry["outer_radius"] = (known["inner_radius"] ** 2 + area) ** 0.5
    return geometry


def measure_of(name: str, geometry: Mapping[str, Any]) -> Any:
    """One measure of a known tube; ``thickness`` is ``B − A``, ``wall_area`` ``π (B² − A²)/k``."""
    if name not in ("thickness", "wall_area"):
        return geometry[name]
    inner, outer = geometry["inner_radius"], geometry["outer_radius"]
    if name == "thickness":
        return outer - inner
    return pi * (outer - inner) * (outer + inner) / opening_factor(geometry["opening_angle"])


def with_wall(geometry: Mapping[str, Any], name: str, value: Any, kept: Any) -> dict[str, Any]:
    r"""Tube whose ``thickness`` or ``wall_area`` has another value.

    The circle at the fraction ``f`` (`kept`) of the wall keeps its radius: 0 is the inner radius, 1
    the outer one. If the thickness ``h`` grows by ``δ``, ``A`` falls by ``f δ`` and ``B`` rises by
    ``(1 − f) δ``. For a wall area that grows by ``ΔS``, ``δ`` is a root of

    .. math:: (1 - 2f) δ^2 + (A + B + (1 - 2f) h) δ = k ΔS/π .
    """
    inner, outer = geometry["inner_radius"], geometry["outer_radius"]
    change = value - measure_of(name, geometry)
    if name == "wall_area":
        excess = opening_factor(geometry["opening_angle"]) * change / pi
        square = 1 - 2 * kept
        slope = inner + outer + square * (outer - inner)
        # This form holds for every f; the other root is no wall.
        change = 2 * excess / (slope + (slope**2 + 4 * square * excess) ** 0.5)
    return {
        **geometry,
        "inner_radius": inner - kept * change,
        "outer_radius": outer + (1 - kept) * change,
    }


def reopened(geometry: Mapping[str, Any], opening_angle: Any) -> dict[str, Any]:
    """Sector with another opening angle that has the same closed ring, see `opened_sector`."""
    inner, outer = opened_sector(
        geometry["inner_radius"],
        geometry["outer_radius"],
        opening_angle=opening_angle,
        before=geometry["opening_angle"],
    )
    moved = {"inner_radius": inner, "outer_radius": outer, "opening_angle": opening_angle}
    return {**geometry, **moved}
