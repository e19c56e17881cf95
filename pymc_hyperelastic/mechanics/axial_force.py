"""Reduced axial force of an inflated thick-walled tube, its slope, and the function `axial_force`.

The forward model uses the integrals for measured forces. Source: J. D. Humphrey, Cardiovascular
Solid Mechanics, Springer 2002.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from pytensor.graph.basic import Variable
from pytensor.tensor.variable import TensorVariable as Tensor

from pymc_hyperelastic.mechanics.layers import Layer, Tube, checked_tubes
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy, elementwise_derivative
from pymc_hyperelastic.mechanics.wall import WALL_ORDER, WallIntegral


class AxialForceIntegral(WallIntegral):
    r"""Reduced axial force of an inflated tube, as a force transducer at its end measures it.

    .. math:: F(a) = \frac{π}{k λ_z} \int_{\ln A}^{\ln B}
        \big(2 (σ_{zz} - σ_{rr}) - (σ_{θθ} - σ_{rr})\big) R^2 \, d(\ln R)

    ``F`` is the axial force in the wall less ``π a² p``, the force of the pressure on closed ends.
    Inputs and attributes are those of :class:`PressureIntegral`; the output is in mN (kPa mm²).
    """

    def build_inner_graph(self, *inputs: Tensor) -> list[Variable]:
        """Gauss-Legendre quadrature over the last axis, which the sum removes."""
        wall, log_axial, entries = self.wall(inputs)
        response = self.response(wall.log_hoop, log_axial, entries)
        return [(wall.force_weight * response).sum(axis=-1)]

    def response(self, log_hoop: Tensor, log_axial: Tensor, entries: Sequence[Any]) -> Tensor:
        """``2 (σzz − σrr) − (σθθ − σrr)`` of the material."""
        return force_response(self.strain_energy, log_hoop, log_axial, entries)


class AxialForceSlope(AxialForceIntegral):
    r"""Derivative of the reduced axial force by the internal radius, at constant axial stretch.

    .. math:: \frac{∂F}{∂a} = π a \int_{\ln A}^{\ln B} \frac{1}{1 + δ}
        \frac{∂\left(2 (σ_{zz} - σ_{rr}) - (σ_{θθ} - σ_{rr})\right)}{∂\ln λ_θ} \, d(\ln R)

    Inputs and attributes are those of :class:`AxialForceIntegral`; the output is in mN/mm.
    """

    def build_inner_graph(self, *inputs: Tensor) -> list[Variable]:
        """Quadrature with the pressure's weights: ``∂ln λθ/∂a`` times the weights of the force."""
        wall, log_axial, entries = self.wall(inputs)
        response = self.response(wall.log_hoop, log_axial, entries)
        slope = elementwise_derivative(response, wall.log_hoop)
        return [np.pi * inputs[0] * (wall.pressure_weight * slope).sum(axis=-1)]


def force_response(
    energy: StrainEnergy, log_hoop: Tensor, log_axial: Tensor, entries: Sequence[Any]
) -> Tensor:
    """``2 (σzz − σrr) − (σθθ − σrr)`` in kPa, of which the axial force is a weighted integral."""
    parameters = energy.join(entries)
    axial = energy.axial_stress_difference(log_hoop, log_axial, **parameters)
    return 2 * axial - energy.stress_difference(log_hoop, log_axial, **parameters)


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
    pressure: the axial force in the wall less ``π a² p``. Arguments are those of
    :func:`~pymc_hyperelastic.inflation_pressure`, including layers.

    Returns
    -------
    TensorVariable
        Force in mN (kPa mm²), in the broadcast shape; tension is positive.

    Raises
    ------
    TypeError
        If a material parameter is missing or unknown.
    ValueError
        If a radius or stretch is not positive and finite, the outer radius does not exceed the
        inner one, or the opening angle is 2π or more.

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
    tubes = checked_tubes(energy, internal_radius, reference, parameters)
    return wall_force(tubes, order)


def wall_force(tubes: Sequence[Tube], order: int = WALL_ORDER) -> Tensor:
    """Axial force of a wall in mN, the sum over its concentric tubes."""
    return sum(
        AxialForceIntegral(strain_energy=tube.energy, order=order)(*tube.inputs) for tube in tubes
    )


def wall_force_slope(tubes: Sequence[Tube], order: int = WALL_ORDER) -> Tensor:
    """Derivative of the axial force of a wall by its internal radius, mN/mm."""
    slope = 0.0
    for tube in tubes:
        own = AxialForceSlope(strain_energy=tube.energy, order=order)(*tube.inputs)
        # Incompressibility: the internal radius a' of a layer satisfies da'/da = a/a'.
        slope += own * (tubes[0].radius / tube.radius if tube.within else 1.0)
    return slope
