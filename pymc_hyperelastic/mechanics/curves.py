"""Pressure, stiffness and axial force of an inflated thick-walled tube, as users call them.

Source of the axial force: J. D. Humphrey, Cardiovascular Solid Mechanics, Springer 2002.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from pytensor.tensor.variable import TensorVariable as Tensor

from pymc_hyperelastic.mechanics.integrals import wall_force, wall_pressure
from pymc_hyperelastic.mechanics.layers import Layer, check_geometry, double, tube_of
from pymc_hyperelastic.mechanics.reference_tube import WALL, Tube, check_is_tube, whole_angle
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.mechanics.wall import WALL_ORDER


def inflation_pressure(
    energy: StrainEnergy | Sequence[Layer],
    internal_radius: Any,
    tube: Tube,
    *,
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
    tube : Tube
        Reference tube and axial stretch, see :class:`~pymc_hyperelastic.Tube`: its inner radius
        ``A``, its outer radius ``B`` or a measure of its wall, the axial stretch ``λz``, by default
        1, and the opening angle ``Φ``, by default 0. Lengths are in mm, angles in radians. Layers
        have their thickness: with them the tube has an inner radius alone.
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
        If a material parameter is missing or unknown, or if a radius is missing.
    ValueError
        If a number of the tube is impossible (``outer_radius <= inner_radius``, say).

    See Also
    --------
    Tube, inflation_stiffness, axial_force

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> tube = ph.Tube(inner_radius=7.0, outer_radius=9.0)
    >>> p = ph.inflation_pressure(ph.Ogden(), [7.0, 8.0, 9.0], tube, mu=6.0, alpha=8.0)
    >>> (p.eval() / ph.mmHg).round(2)
    array([ 0.  ,  8.88, 19.  ])
    """
    return _curves(wall_pressure, energy, internal_radius, tube, parameters, order)[0]


def inflation_stiffness(
    energy: StrainEnergy | Sequence[Layer],
    internal_radius: Any,
    tube: Tube,
    *,
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
    >>> s = ph.inflation_stiffness(ph.Ogden(), 8.0, ph.Tube(7.0, 9.0), mu=6.0, alpha=8.0)
    >>> round(float(s.eval()), 3)
    1.165
    """
    return _curves(wall_pressure, energy, internal_radius, tube, parameters, order)[1]


def axial_force(
    energy: StrainEnergy | Sequence[Layer],
    internal_radius: Any,
    tube: Tube,
    *,
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
    >>> tube = ph.Tube(inner_radius=1.0, outer_radius=1.5, axial_stretch=1.2)
    >>> force = ph.axial_force(ph.NeoHookean(), 1.0, tube, mu=10.0)
    >>> round(float(force.eval()), 3)
    19.641
    """
    return _curves(wall_force, energy, internal_radius, tube, parameters, order)[0]


def _curves(
    integral: Callable,
    energy: StrainEnergy | Sequence[Layer],
    internal_radius: Any,
    tube: Tube,
    parameters: Mapping[str, Any],
    order: int,
) -> tuple[Tensor, Tensor]:
    """Check the geometry, and integrate over the wall."""
    check_is_tube(tube)
    stated = {name: getattr(tube, name) for name in (*GEOMETRY, *WALL)}
    check_geometry(internal_radius=internal_radius, **stated)
    numbers = {name: double(value) for name, value in stated.items()}
    in_double = replace(tube, **numbers)
    if tube.opening_angle is not None:
        check_geometry(opening_angle=whole_angle(in_double))
    # By default the tube has its unloaded length, and a cut ring stays closed.
    geometry = {"axial_stretch": 1.0, "opening_angle": 0.0} | in_double.geometry()
    check_geometry(**geometry)
    if "inner_radius" not in geometry:
        raise TypeError(f"{tube} has no inner_radius: the reference inner radius of the tube, mm")
    reference = [geometry.get(name) for name in GEOMETRY]
    return integral(tube_of(energy, reference, parameters), double(internal_radius), order)
