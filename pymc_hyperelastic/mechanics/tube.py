r"""Kinematics of an incompressible thick-walled tube that is opened, stretched and inflated.

The reference tube has inner radius ``A`` and outer radius ``B``. A cut ring that springs open by
the angle ``Φ`` enters through the opening factor ``k = 2π/(2π − Φ)``. At axial stretch ``λz`` and
internal radius ``a`` the material circle of radius ``R`` has the current radius

.. math:: r(R)^2 = a^2 + \frac{R^2 - A^2}{k λ_z}, \qquad
    λ_θ = \frac{k r}{R}, \qquad λ_r = \frac{1}{λ_θ λ_z}.

Every function uses nothing but arithmetic, so numbers, NumPy arrays, xarray objects and PyTensor
variables all pass through. Lengths share one unit (mm inside this package), angles are radians.
"""

from collections.abc import Mapping
from math import pi
from typing import Any

# What states the reference tube, in the order in which functions take it.
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
    r"""Excess ``δ`` of the squared hoop stretch over that of the unloaded tube (``k = 1``).

    .. math:: δ(R) = \frac{k λ_z a^2 - A^2}{R^2}, \qquad λ_θ^2 = \frac{k}{λ_z} (1 + δ)

    With ``k = 1`` an isotropic tube carries no pressure at ``δ = 0``. The difference of squares is
    factored, so that ``δ`` keeps all its digits when the internal radius ``a`` is close to ``A``,
    where measured curves start.

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
    """Internal radius ``a`` from the measured outer radius ``ro``: the wall keeps its volume.

    ``a² = ro² − (B² − A²)/(k λz)``; for a measured outer diameter pass half of it.

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

    The wall keeps its area, and its length along the axis, so that one more condition is needed.
    It is that the line in the middle of the wall keeps its length,
    ``(2π − Φ) (A + B)/2 = π (a + b)`` of a ring with radii ``a < b``; together with the area the
    wall then keeps its thickness:

    .. math:: A = a + (k - 1) \frac{a + b}{2}, \qquad B = b + (k - 1) \frac{a + b}{2}

    Where the neutral line really is follows from the material: a ring in bending alone carries no
    force, and to the first order in thickness over radius that puts the line into the middle of the
    wall, of whatever one material it is. Source: R. S. Rivlin, Large elastic deformations of
    isotropic materials V, The problem of flexure, Proceedings of the Royal Society A 195 (1949)
    463-473; opened sectors as the reference: C. J. Chuong, Y. C. Fung, On residual stresses in
    arteries, Journal of Biomechanical Engineering 108 (1986) 189-192.

    Examples
    --------
    >>> opened_sector(1.0, 1.2, opening_angle=pi)
    (2.1, 2.3)
    """
    excess = (opening_factor(opening_angle) - 1) * (inner_radius + outer_radius) / 2
    return inner_radius + excess, outer_radius + excess


def inferred_geometry(known: Mapping[str, Any]) -> dict[str, Any]:
    r"""Reference tube, as far as some of its measures state it.

    Of ``inner_radius``, ``outer_radius``, ``axial_stretch``, ``opening_angle`` what is there is
    kept. With an inner radius ``A``, ``thickness`` ``h`` or ``wall_area`` ``S`` (of the
    cross-section of the unloaded ring, mm²) gives the outer one,

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
    r"""A measure of a tube that is known: ``h = B − A``, ``S = π (B² − A²)/k``, or as it is stated.

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
    """The tube whose closed ring is the same, and opens by another angle.

    It keeps its middle line and its thickness, see :func:`opened_sector`.

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
