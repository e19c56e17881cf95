r"""Kinematics of an incompressible thick-walled tube that is opened, stretched and inflated.

Wall integrals, data and predictions use these functions. The reference tube has inner radius ``A``
and outer radius ``B``. A cut ring that springs open by the angle ``Φ`` enters through the opening
factor ``k = 2π/(2π − Φ)``. At axial stretch ``λz`` and internal radius ``a`` the material circle of
radius ``R`` has the current radius

.. math:: r(R)^2 = a^2 + \frac{R^2 - A^2}{k λ_z}, \qquad
    λ_θ = \frac{k r}{R}, \qquad λ_r = \frac{1}{λ_θ λ_z}.

All functions use arithmetic only and accept numbers, NumPy arrays, xarray objects and PyTensor
variables. Lengths have one common unit (mm inside this package), angles are in radians. Source:
C. J. Chuong and Y. C. Fung, On residual stresses in arteries, Journal of Biomechanical Engineering
108 (1986) 189-192.
"""

from collections.abc import Mapping
from math import pi
from typing import Any

# Names of the measures of the reference tube, in the order in which functions take them.
GEOMETRY = ("inner_radius", "outer_radius", "axial_stretch", "opening_angle")


def opening_factor(opening_angle: Any) -> Any:
    """Ratio ``k = 2π/(2π − Φ)`` by which closing a cut ring multiplies its angles.

    Examples
    --------
    >>> opening_factor(0.0)
    1.0
    """
    return 2 * pi / (2 * pi - opening_angle)


def hoop_elongation(
    internal_radius: Any,
    radius: Any,
    *,
    inner_radius: Any,
    axial_stretch: Any = 1.0,
    opening_angle: Any = 0.0,
) -> Any:
    r"""Relative excess ``δ`` of the squared hoop stretch over ``k/λz``.

    .. math:: δ(R) = \frac{k λ_z a^2 - A^2}{R^2}, \qquad λ_θ^2 = \frac{k}{λ_z} (1 + δ)

    For ``k = 1`` the pressure of an isotropic tube is 0 at ``δ = 0``. The difference of squares is
    factored, so that ``δ`` is accurate to rounding near ``a = A``, where measured curves start.

    Examples
    --------
    >>> hoop_elongation(2.0, 1.0, inner_radius=1.0)
    3.0
    """
    scaled = (opening_factor(opening_angle) * axial_stretch) ** 0.5 * internal_radius
    return (scaled - inner_radius) * (scaled + inner_radius) / radius**2


def current_radius(
    radius: Any,
    internal_radius: Any,
    *,
    inner_radius: Any,
    axial_stretch: Any = 1.0,
    opening_angle: Any = 0.0,
) -> Any:
    """Radius ``r(R)`` to which the material circle of reference radius ``R`` moves (wall map).

    Examples
    --------
    >>> current_radius(2.0, 1.5, inner_radius=1.0)
    2.29128784747792
    """
    k = opening_factor(opening_angle)
    return (internal_radius**2 + (radius**2 - inner_radius**2) / (k * axial_stretch)) ** 0.5


def stretches(
    radius: Any,
    internal_radius: Any,
    *,
    inner_radius: Any,
    axial_stretch: Any = 1.0,
    opening_angle: Any = 0.0,
) -> tuple[Any, Any, Any]:
    """Principal stretches ``(λr, λθ, λz)`` at reference radius ``R``; their product is one.

    Examples
    --------
    >>> radial, hoop, axial = stretches(1.0, 1.25, inner_radius=1.0, axial_stretch=1.6)
    >>> radial, hoop, axial
    (0.5, 1.25, 1.6)
    """
    r = current_radius(
        radius,
        internal_radius,
        inner_radius=inner_radius,
        axial_stretch=axial_stretch,
        opening_angle=opening_angle,
    )
    hoop = opening_factor(opening_angle) * r / radius
    return 1 / (hoop * axial_stretch), hoop, axial_stretch


def first_invariant(radial: Any, hoop: Any, axial: Any) -> Any:
    """First invariant ``I₁ = λr² + λθ² + λz²`` of the right Cauchy-Green tensor.

    Examples
    --------
    >>> first_invariant(1.0, 1.0, 1.0)
    3.0
    """
    return radial**2 + hoop**2 + axial**2


def second_invariant(radial: Any, hoop: Any, axial: Any) -> Any:
    """Second invariant ``I₂ = λr²λθ² + λθ²λz² + λz²λr²`` of the right Cauchy-Green tensor.

    Examples
    --------
    >>> second_invariant(1.0, 1.0, 1.0)
    3.0
    """
    return (radial * hoop) ** 2 + (hoop * axial) ** 2 + (axial * radial) ** 2


def internal_radius_from_outer_radius(
    current_outer_radius: Any,
    *,
    inner_radius: Any,
    outer_radius: Any,
    axial_stretch: Any = 1.0,
    opening_angle: Any = 0.0,
) -> Any:
    """Internal radius ``a`` from the measured outer radius ``ro`` of an incompressible wall.

    ``a² = ro² − (B² − A²)/(k λz)``. Pass half of a measured outer diameter.

    Examples
    --------
    >>> internal_radius_from_outer_radius(2.0, inner_radius=1.0, outer_radius=2.0)
    1.0
    """
    k = opening_factor(opening_angle)
    wall = (outer_radius - inner_radius) * (outer_radius + inner_radius) / (k * axial_stretch)
    return (current_outer_radius**2 - wall) ** 0.5


def opened_sector(inner_radius: Any, outer_radius: Any, *, opening_angle: Any) -> tuple[Any, Any]:
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

    Examples
    --------
    >>> opened_sector(1.0, 1.2, opening_angle=pi)
    (2.1, 2.3)
    """
    excess = (opening_factor(opening_angle) - 1) * (inner_radius + outer_radius) / 2
    return inner_radius + excess, outer_radius + excess


def inferred_geometry(known: Mapping[str, Any]) -> dict[str, Any]:
    r"""Measures of the reference tube, with the outer radius inferred from other measures.

    ``inner_radius``, ``outer_radius``, ``axial_stretch`` and ``opening_angle`` are returned
    unchanged if `known` has them. The outer radius follows from the inner radius ``A`` and the
    ``thickness`` ``h``, or the ``wall_area`` ``S`` (cross-section of the unloaded ring, mm²):

    .. math:: B = A + h, \qquad B = \sqrt{A^2 + k S/π} .

    Examples
    --------
    >>> inferred_geometry({"inner_radius": 1.0, "thickness": 0.5})
    {'inner_radius': 1.0, 'outer_radius': 1.5}
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
    r"""One measure of a known tube; ``thickness`` is ``B − A``, ``wall_area`` ``π (B² − A²)/k``.

    Examples
    --------
    >>> measure_of("thickness", {"inner_radius": 1.0, "outer_radius": 1.5})
    0.5
    """
    if name not in ("thickness", "wall_area"):
        return geometry[name]
    inner, outer = geometry["inner_radius"], geometry["outer_radius"]
    if name == "thickness":
        return outer - inner
    return pi * (outer - inner) * (outer + inner) / opening_factor(geometry["opening_angle"])


def reopened(geometry: Mapping[str, Any], opening_angle: Any) -> dict[str, Any]:
    """Sector with another opening angle that has the same closed ring.

    The middle line of the wall and its thickness do not change, see :func:`opened_sector`.

    Examples
    --------
    >>> ring = {"inner_radius": 1.0, "outer_radius": 1.2, "opening_angle": 0.0}
    >>> reopened(ring, pi)
    {'inner_radius': 2.1, 'outer_radius': 2.3, 'opening_angle': 3.141592653589793}
    """
    inner, outer = geometry["inner_radius"], geometry["outer_radius"]
    ratio = opening_factor(opening_angle) / opening_factor(geometry["opening_angle"])
    shift = (ratio - 1) * (inner + outer) / 2
    moved = {"inner_radius": inner + shift, "outer_radius": outer + shift}
    return {**geometry, **moved, "opening_angle": opening_angle}
