"""The radius at which a tube has a given pressure: the pressure integral, inverted."""

from typing import Any

import numpy as np
import pytensor.tensor as pt
from pytensor.gradient import DisconnectedType, disconnected_type, grad
from pytensor.graph.basic import Variable
from pytensor.graph.replace import _vectorize_node, clone_replace
from pytensor.tensor.symbolic import TensorSymbolicOp
from pytensor.tensor.variable import TensorVariable as Tensor

from pymc_hyperelastic.mechanics.integrals import wall_pressure
from pymc_hyperelastic.mechanics.layers import Tube
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.wall import (
    WALL_ORDER,
    TubeOp,
    broadcast_batches,
    zero_at_overflow,
)

# Steps of Newton's method: with the longest steps, they reach twice the first radius and converge.
_STEPS = 10
# Longest step, in radii: longer ones leave the range of stable tubes.
_LONGEST_STEP = 0.1


class RadiusAtPressure(TensorSymbolicOp):
    r"""Internal radius at which a tube has a given pressure.

    Newton's method from a radius next to it, in steps of a tenth of the radius at most. The
    gradient is that of the exact solution,

    .. math:: \frac{∂a}{∂p} = \frac{1}{s}, \qquad \frac{∂a}{∂x} = -\frac{1}{s} \frac{∂p}{∂x}

    with the stiffness ``s = ∂p/∂a``. Inputs are the pressure (kPa), the radius to start from, and
    :attr:`Tube.inputs`; they broadcast against each other. Outputs are the radius, and the relative
    length of the last step, infinite where pressure falls with the radius: large where no such
    radius was found.
    `strain_energies` are those of the layers, `order` the nodes of the Gauss-Legendre rule.
    """

    __props__ = ("strain_energies", "order")
    inline = True
    filter_inputs = staticmethod(TubeOp.filter_inputs)
    link_mode = TubeOp.link_mode

    def __init__(
        self,
        input_types: Any = None,
        *,
        strain_energies: tuple[StrainEnergy, ...],
        order: int = WALL_ORDER,
        **settings: Any,
    ) -> None:
        super().__init__(input_types, strain_energies=strain_energies, order=order, **settings)

    def build_inner_graph(self, *inputs: Tensor) -> list[Variable]:
        """Take all steps of Newton's method."""
        pressure, radius, *rest = inputs
        tube = Tube.of_inputs(self.strain_energies, rest)
        for _ in range(_STEPS):
            here, stiffness = wall_pressure(tube, radius, self.order)
            step = pt.where(stiffness > 0, (pressure - here) / (stiffness * radius), np.inf)
            radius = radius * (1 + pt.clip(step, -_LONGEST_STEP, _LONGEST_STEP))
        return [radius, pt.abs(step)]

    def pullback(self, inputs: Any, outputs: Any, cotangents: Any) -> list[Variable]:
        """Gradient of the exact solution; zero if no solution was found."""
        cotangent = cotangents[0]
        if isinstance(cotangent.type, DisconnectedType):
            return [disconnected_type() for _ in inputs]
        # Variables of their own keep inputs apart that depend on each other.
        own = [x.type() for x in inputs]
        radius, weight = outputs[0].type(), cotangent.type()
        tube = Tube.of_inputs(self.strain_energies, own[2:])
        pressure, stiffness = wall_pressure(tube, radius, self.order)
        gradients = grad(
            None,
            own,
            known_grads={pressure - own[0]: -weight / stiffness},
            disconnected_inputs="ignore",  # the radius to start from does not matter
            return_disconnected="zero",
        )
        known = zip([*own, radius, weight], [*inputs, outputs[0], cotangent], strict=True)
        gradients = clone_replace(gradients, dict(known))
        return zero_at_overflow(gradients, outputs)


_vectorize_node.register(RadiusAtPressure)(broadcast_batches)
