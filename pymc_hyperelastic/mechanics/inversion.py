"""The radius at which a tube has a given pressure: the pressure integral, inverted."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytensor.tensor as pt
from pytensor.gradient import DisconnectedGrad, disconnected_grad
from pytensor.graph.basic import Apply
from pytensor.graph.replace import _vectorize_node
from pytensor.tensor.variable import TensorVariable as Tensor

from pymc_hyperelastic.mechanics.layers import Tube
from pymc_hyperelastic.mechanics.pressure import wall_pressure
from pymc_hyperelastic.mechanics.wall import WALL_ORDER

# Steps of Newton's method: with the longest steps, they reach twice the first radius and converge.
_STEPS = 10
# Longest step, in radii: longer ones leave the range of stable tubes.
_LONGEST_STEP = 0.1


def radius_at_pressure(
    tubes_at: Callable[[Tensor], Sequence[Tube]], pressure: Any, start: Any, order: int = WALL_ORDER
) -> tuple[Tensor, Tensor]:
    r"""Return the internal radius at which a tube has a given pressure, by Newton's method.

    The gradient is that of the exact solution with the stiffness ``s = ∂p/∂a``,

    .. math:: \frac{∂a}{∂p} = \frac{1}{s}, \qquad \frac{∂a}{∂x} = -\frac{1}{s} \frac{∂p}{∂x} ,

    because only the last step has one, whose start and stiffness count as constants.

    `tubes_at` returns the tubes of the wall at an internal radius (mm); Newton's method begins at
    `start`. The second output is the length of the last step in radii: large if no such radius was
    found, and infinite where the pressure falls with the radius.
    """
    radius = pt.as_tensor_variable(start)
    for _ in range(_STEPS):
        radius = disconnected_grad(radius)
        here, stiffness = wall_pressure(tubes_at(radius), order)
        rising = stiffness > 0
        slope = disconnected_grad(pt.where(rising, stiffness, 1.0)) * radius
        step = pt.where(rising, (pressure - here) / slope, np.inf)
        radius = radius * (1 + pt.clip(step, -_LONGEST_STEP, _LONGEST_STEP))
    return radius, disconnected_grad(pt.abs(step))


@_vectorize_node.register(DisconnectedGrad)
def _vectorize_disconnected(op: DisconnectedGrad, node: Apply, value: Tensor) -> Apply:
    """Apply it to the batch as a whole; PyTensor's default is a loop."""
    return op.make_node(value)
