"""Pressure, stiffness and axial force of an inflated thick-walled tube, as users call them.

Source of the axial force: J. D. Humphrey, Cardiovascular Solid Mechanics, Springer 2002.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pytensor.tensor.variable import TensorVariable as Tensor

from pymc_hyperelastic.mechanics.integrals import wall_force, wall_pressure
from pymc_hyperelastic.mechanics.layers import Layer, check_geometry, double, tube_of
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.mechanics.wall import WALL_ORDER


def inflation_pressure(
    energy: StrainEnergy | Sequence[Layer],
    internal_radius: Any,
    *,
    inner_radius: Any,
    outer_radius: Any = None,
    axial_stretch: Any = 1.0,
    opening_angle: Any = 0.0,
    order: int = WALL_ORDER,
    **parameters: Any,
) -> Tensor:
    r"""Internal pressure that holds a tube at the given internal radius.

    .. math:: p(a) = \int_A^B \frac{∂\hat W/∂λ_θ}{λ_z r} \, dR

    See :class:`PressureIntegral` for the rule and its accuracy. Arguments may be numbers, arrays or
    random variables; they broadcast against each other.

    Parameters
    ----------
    energy : StrainEnergy or list of Layer
        The material, such as ``ph.Ogden()``; or the layers of the wall from the inside out, see
        :class:`~pymc_hyperelastic.Layer`.
    internal_radius : tensor_like
        Current internal radius ``a``, mm.
    inner_radius, outer_radius : tensor_like
        Reference radii ``A < B``, mm; with layers no outer radius, they have their thickness.
    axial_stretch : tensor_like, default 1
        Axial stretch ``λz``.
    opening_angle : tensor_like, default 0
        Opening angle ``Φ``, radians: what the opened sector lacks of a full circle, twice Fung's.
        The radii are then those of the sector.
    order : int, default 32
        Nodes of the quadrature, on each piece of a wall in which fibres slacken. Twelve do for the
        wall of an artery, in half of the time.
    **parameters : tensor_like
        The material parameters by name; moduli in kPa.

    Returns
    -------
    TensorVariable
        Pressure in kPa, in the broadcast shape.

    Raises
    ------
    TypeError
        If a material parameter is missing or unknown.
    ValueError
        If a number given as geometry is impossible (``outer_radius <= inner_radius``, say).

    See Also
    --------
    inflation_stiffness, axial_force

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> p = ph.inflation_pressure(
    ...     ph.Ogden(), [7.0, 8.0, 9.0], inner_radius=7.0, outer_radius=9.0, mu=6.0, alpha=8.0
    ... )
    >>> (p.eval() / ph.mmHg).round(2)
    array([ 0.  ,  8.88, 19.  ])
    """
    reference = inner_radius, outer_radius, axial_stretch, opening_angle
    return _curves(wall_pressure, energy, internal_radius, reference, parameters, order)[0]


def inflation_stiffness(
    energy: StrainEnergy | Sequence[Layer],
    internal_radius: Any,
    *,
    inner_radius: Any,
    outer_radius: Any = None,
    axial_stretch: Any = 1.0,
    opening_angle: Any = 0.0,
    order: int = WALL_ORDER,
    **parameters: Any,
) -> Tensor:
    r"""Stiffness ``dp/da`` of a tube: derivative of its pressure by the internal radius.

    It governs the local speed of the pulse wave. Arguments and errors are those of
    :func:`inflation_pressure`.

    Returns
    -------
    TensorVariable
        Stiffness in kPa/mm, in the broadcast shape.

    See Also
    --------
    inflation_pressure

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> s = ph.inflation_stiffness(
    ...     ph.Ogden(), 8.0, inner_radius=7.0, outer_radius=9.0, mu=6.0, alpha=8.0
    ... )
    >>> round(float(s.eval()), 3)
    1.165
    """
    reference = inner_radius, outer_radius, axial_stretch, opening_angle
    return _curves(wall_pressure, energy, internal_radius, reference, parameters, order)[1]


def axial_force(
    energy: StrainEnergy | Sequence[Layer],
    internal_radius: Any,
    *,
    inner_radius: Any,
    outer_radius: Any = None,
    axial_stretch: Any = 1.0,
    opening_angle: Any = 0.0,
    order: int = WALL_ORDER,
    **parameters: Any,
) -> Tensor:
    r"""Reduced axial force that holds a tube at the given internal radius and axial stretch.

    .. math:: F(a) = \frac{π}{k λ_z} \int_A^B
        \left(2 λ_z \frac{∂\hat W}{∂λ_z} - λ_θ \frac{∂\hat W}{∂λ_θ}\right) R \, dR

    ``F`` is the force that must be applied at the ends of a closed tube in addition to the
    pressure: the axial force in the wall less ``π a² p``. Arguments and errors are those of
    :func:`~pymc_hyperelastic.inflation_pressure`, including layers.

    Returns
    -------
    TensorVariable
        Force in mN (kPa mm²), in the broadcast shape; tension is positive.

    See Also
    --------
    inflation_pressure, predict_axial_force

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> force = ph.axial_force(
    ...     ph.NeoHookean(), 1.0, inner_radius=1.0, outer_radius=1.5, axial_stretch=1.2, mu=10.0
    ... )
    >>> round(float(force.eval()), 3)
    19.641
    """
    reference = inner_radius, outer_radius, axial_stretch, opening_angle
    return _curves(wall_force, energy, internal_radius, reference, parameters, order)[0]


def _curves(
    integral: Callable,
    energy: StrainEnergy | Sequence[Layer],
    internal_radius: Any,
    reference: Sequence[Any],
    parameters: Mapping[str, Any],
    order: int,
) -> tuple[Tensor, Tensor]:
    """Check the geometry, and integrate over the wall."""
    check_geometry(internal_radius=internal_radius, **dict(zip(GEOMETRY, reference, strict=True)))
    radius = double(internal_radius)
    return integral(tube_of(energy, reference, parameters), radius, order)
