"""Reduced axial force of an inflated thick-walled tube: `AxialForceIntegral` and `axial_force`.

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
from pymc_hyperelastic.mechanics.wall import WALL_ORDER, WallIntegral, response, wall_integral


class AxialForceIntegral(WallIntegral):
    r"""Reduced axial force of an inflated tube, and its derivative by the internal radius.

    .. math::

        F(a) &= \frac{π}{k λ_z} \int_{\ln A}^{\ln B} G R^2 \, d(\ln R), \qquad
        G = 2 (σ_{zz} - σ_{rr}) - (σ_{θθ} - σ_{rr}), \\
        \frac{∂F}{∂a} &= π a \int_{\ln A}^{\ln B}
            \frac{1}{1 + δ} \frac{∂G}{∂\ln λ_θ} \, d(\ln R) .

    ``F`` is the axial force in the wall less ``π a² p``, the force of the pressure on closed ends:
    a force transducer at an end measures it. Inputs and attributes are those of
    :class:`PressureIntegral`; the outputs are in mN (kPa mm²) and mN/mm.
    """

    def build_inner_graph(self, *inputs: Tensor) -> list[Variable]:
        """Gauss-Legendre quadrature over the last axis, which the sums remove."""
        rule, log_axial, entries = self.rule(inputs)
        stress = response(self.strain_energy, rule.log_hoop, log_axial, entries, force=True)
        slope = elementwise_derivative(stress, rule.log_hoop)
        return [
            (rule.force_weight * stress).sum(axis=-1),
            np.pi * inputs[0] * (rule.pressure_weight * slope).sum(axis=-1),
        ]


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
    tubes = checked_tubes(energy, internal_radius, reference, parameters)
    return wall_force(tubes, order)


def wall_force(tubes: Sequence[Tube], order: int = WALL_ORDER) -> Tensor:
    """Axial force (mN) of a wall of concentric tubes."""
    return wall_integral(AxialForceIntegral, tubes, order)[0]


def wall_force_slope(tubes: Sequence[Tube], order: int = WALL_ORDER) -> Tensor:
    """Derivative of the axial force by the internal radius, mN/mm."""
    return wall_integral(AxialForceIntegral, tubes, order)[1]
