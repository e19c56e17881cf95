"""Stored energy and incremental stiffness of the material, integrated over the wall of a tube.

Predictions use the integrals for the energy that a pulse stores and for mean wall moduli.
"""

import pytensor.tensor as pt
from pytensor.graph.basic import Variable
from pytensor.tensor.variable import TensorVariable as Tensor

from pymc_hyperelastic.mechanics.strain_energy.base import elementwise_derivative
from pymc_hyperelastic.mechanics.wall import WallIntegral


class MaterialIntegral(WallIntegral):
    r"""Stored energy and two incremental moduli, integrated over the current area of the wall.

    .. math:: \int_a^b w \, 2π r \, dr = \frac{2π}{k λ_z} \int_{\ln A}^{\ln B} w R^2 \, d(\ln R)

    The integrand ``w`` is, in turn, the energy ``Ŵ`` per unit of volume less that of the
    stress-free state, and the moduli of small strains superposed on the inflated state,

    .. math::

        C_θ = \frac{∂^2 \hat W}{∂(\ln λ_θ)^2} = \frac{∂(σ_{θθ} - σ_{rr})}{∂\ln λ_θ}, \qquad
        C_z = \frac{∂^2 \hat W}{∂(\ln λ_z)^2} = \frac{∂(σ_{zz} - σ_{rr})}{∂\ln λ_z} .

    Inputs and attributes are those of :class:`PressureIntegral`. The three outputs are in mN
    (kPa mm²); divided by the area of the wall, ``π (B² − A²)/(k λz)``, they are means in kPa.
    """

    def build_inner_graph(self, *inputs: Tensor) -> list[Variable]:
        """Gauss-Legendre quadrature over the last axis, which the sums remove."""
        rule, log_axial, entries = self.rule(inputs)
        energy, parameters = self.strain_energy, self.strain_energy.join(entries)
        # The derivatives are elementwise, so that each node needs its own axial stretch.
        log_hoop, log_axial = rule.log_hoop, log_axial + pt.zeros_like(rule.log_hoop)
        rest = pt.zeros_like(log_hoop)
        stored = energy.reduced_energy(log_hoop, log_axial, **parameters)
        stored -= energy.reduced_energy(rest, rest, **parameters)
        hoop = energy.stress_difference(log_hoop, log_axial, **parameters)
        axial = energy.axial_stress_difference(log_hoop, log_axial, **parameters)
        moduli = elementwise_derivative(hoop, log_hoop), elementwise_derivative(axial, log_axial)
        return [2 * (rule.force_weight * w).sum(axis=-1) for w in (stored, *moduli)]
