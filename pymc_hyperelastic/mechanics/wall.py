"""Integrals over the wall of a tube: the quadrature rule, and the Op that integrals share."""

from collections.abc import Iterable, Sequence
from functools import cache, lru_cache, reduce
from itertools import compress, pairwise
from operator import and_
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import pytensor.tensor as pt
from pytensor.compile.inner_function import link_only_mode
from pytensor.compile.mode import Mode
from pytensor.gradient import DisconnectedType, grad
from pytensor.graph.basic import Apply, Variable
from pytensor.graph.op import Op
from pytensor.graph.replace import _vectorize_node, graph_replace
from pytensor.tensor.symbolic import TensorSymbolicOp
from pytensor.tensor.variable import TensorVariable as Tensor

from pymc_hyperelastic.mechanics.layers import check_energy
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.tube import UNLOADED, hoop_elongation, opening_factor

# Nodes of the Gauss-Legendre rule of a wall, or of each piece between kinks: exact to 1e-10 for
# the thickest tubes, see PressureIntegral.
WALL_ORDER = 32
# Integrals, slopes and sums of squares beyond this count as overflow, in kPa or their units: it is
# far beyond any tube, and their multiples and squares are finite.
OVERFLOW = np.float64(1e60)
# Walls, or entries of matrices, that are integrated at once: arrays of their nodes, 1 MB each, stay
# in the processor's cache.
PIECE = 4096


class TubeOp(TensorSymbolicOp):
    """Base class of Ops of a tube's wall, which are computed by other Ops, with a gradient."""

    # Inlined when compiled, value and gradient share their common terms: two to four times faster.
    inline = True

    def __call__(self, *inputs: Any, **settings: Any) -> Any:
        """Apply it, by the same Op wherever inputs are of the same types."""
        inputs, op = self.filter_inputs(*inputs), self
        if not hasattr(self, "fgraph"):
            kind: Any = type(self)
            given = self._props_dict() | self._init_kwargs
            op = _built(kind, tuple(x.type for x in inputs), tuple(given.items()))
        return super(TubeOp, op).__call__(*inputs, **settings)

    @staticmethod
    def filter_inputs(*inputs: Any) -> tuple[Tensor, ...]:
        """Return inputs in double precision: PyTensor reads the number 7.0 as single precision."""
        return tuple(pt.cast(pt.as_tensor_variable(x), "float64") for x in inputs)

    def pullback(self, inputs: Any, outputs: Any, cotangents: Any) -> list[Variable]:
        """Gradient by every input: the same rule, differentiated under the integral.

        If an integral overflows, non-finite entries of the gradient become zero, so that a
        likelihood that rejects such pressures has the gradient zero. A gradient that is not a
        number at finite values stays visible.
        """
        # Variables of their own keep inputs apart that depend on each other.
        own, found = ([x.type() for x in variables] for variables in (inputs, outputs))
        used = [not isinstance(x.type, DisconnectedType) for x in cotangents]
        known = dict(compress(self.known_gradients(own, found, cotangents), used))
        settings = {"disconnected_inputs": "ignore", "return_disconnected": "disconnected"}
        gradients = grad(None, own, known_grads=known, **settings)
        given = dict(zip([*own, *found], [*inputs, *outputs], strict=True))
        finite = reduce(and_, [pt.all(pt.abs(x) < OVERFLOW) for x in compress(outputs, used)])
        connected = [g for g in gradients if isinstance(g, Tensor)]
        replaced = iter(graph_replace(connected, given, strict=False) if connected else [])
        return [_bounded(next(replaced), finite) if isinstance(g, Tensor) else g for g in gradients]

    def known_gradients(self, inputs: Any, outputs: Any, cotangents: Any) -> Iterable[tuple]:
        """Return expressions of the inputs, at known outputs, and gradients by these."""
        return zip(self.build_inner_graph(*inputs), cotangents, strict=True)

    def link_mode(self, impl: str | None) -> Mode:
        """Python for Python: PyMC asks for shapes in this way, and needs no compiler for it."""
        return link_only_mode("py") if impl == "py" else super().link_mode(impl)


def _bounded(gradient: Tensor, finite: Tensor) -> Tensor:
    return pt.where(pt.isfinite(gradient) | finite, gradient, 0.0)


@lru_cache
def _built(kind: Any, input_types: tuple[Any, ...], settings: tuple[Any, ...]) -> TubeOp:
    """Return the Op for inputs of these types; most models need one that was built before."""
    return kind(list(input_types), **dict(settings))


def response(
    law: StrainEnergy, log_hoop: Tensor, log_axial: Tensor, entries: Any, *, force: bool = False
) -> Tensor:
    """Return the stress in kPa that a wall integral is linear in.

    It is ``T = σθθ − σrr`` for the pressure, and ``2 (σzz − σrr) − T`` for the axial `force`.
    """
    parameters = law.join(entries)
    hoop = law.stress_difference(log_hoop, log_axial, **parameters)
    if not force:
        return hoop
    return 2 * law.axial_stress_difference(log_hoop, log_axial, **parameters) - hoop


class WallRule(NamedTuple):
    """Quadrature rule of a wall: nodes and weights along the last axis."""

    log_hoop: Any
    pressure_weight: Any
    """Weights of ``T``."""
    stiffness_weight: Any
    """Weights of ``½ ∂T/∂ln λθ − T``."""
    force_weight: Any
    """Weights of ``2 (σzz − σrr) − T``."""


class WallIntegral(TubeOp):
    """An integral over the wall by quadrature; see :class:`PressureIntegral` for its inputs."""

    __props__ = ("strain_energy", "order")

    def __init__(
        self,
        input_types: Any = None,
        *,
        strain_energy: Any,
        order: int = WALL_ORDER,
        **settings: Any,
    ) -> None:
        check_energy(strain_energy)
        super().__init__(input_types, strain_energy=strain_energy, order=order, **settings)

    def rule(self, inputs: Sequence[Tensor]) -> tuple[WallRule, Tensor, Any]:
        """Return the rule, ``ln λz`` and the parameters' entries, nodes along a new last axis."""
        inputs = pt.broadcast_arrays(*(pt.expand_dims(x, -1) for x in inputs))
        geometry, entries = inputs[:5], inputs[5:]
        log_axial = pt.log(geometry[3])
        kinks = self.strain_energy.kinks(log_axial, **self.strain_energy.join(entries))
        return wall_rule(pt, geometry, order=self.order, kinks=kinks), log_axial, entries


def wall_rule(
    xp: ModuleType, geometry: Sequence[Any], *, order: int = WALL_ORDER, kinks: Sequence[Any] = ()
) -> WallRule:
    """Return the quadrature rule of a wall, in pieces between the `kinks`, values of ``ln λθ``.

    `geometry` is that of :class:`PressureIntegral`; its last axis, along which the nodes run, has
    length 1. `xp` is ``numpy`` for numbers and ``pytensor.tensor`` for variables.
    """
    internal_radius, inner_radius, outer_radius, axial_stretch, opening_angle = geometry
    log_ratio, k = xp.log(outer_radius / inner_radius), opening_factor(opening_angle)
    tube = dict(zip(UNLOADED, (inner_radius, axial_stretch, opening_angle), strict=True))
    node, weight = gauss_legendre(order)
    if kinks:
        excess = hoop_elongation(internal_radius, inner_radius, **tube)
        unloaded = xp.log(k / axial_stretch) / 2
        places = [_place(xp, kink - unloaded, excess, log_ratio) for kink in kinks]
        node, weight = _split(xp, node, weight, places)
    radius = inner_radius * xp.exp(node * log_ratio)
    delta = hoop_elongation(internal_radius, radius, **tube)
    log_hoop = (xp.log(k) - xp.log(axial_stretch) + xp.log1p(delta)) / 2
    stretching = 2 * k * axial_stretch * internal_radius / (radius * (1 + delta)) ** 2
    return WallRule(
        log_hoop,
        weight * log_ratio / (1 + delta),
        weight * log_ratio * stretching,
        np.pi / (k * axial_stretch) * weight * log_ratio * radius**2,
    )


def _place(xp: ModuleType, log_stretch: Any, excess: Any, log_ratio: Any) -> Any:
    """Place of a hoop stretch in the wall, from 0 inside to 1 outside; 0 if it is not there.

    The square of the stretch, relative to the unloaded tube's, exceeds 1 by ``δ``, which falls with
    the square of the radius from `excess` at the inner surface.
    """
    there = (abs(log_stretch) > 0) & (abs(log_stretch) < np.inf)
    ratio = excess / xp.expm1(2 * xp.where(there, log_stretch, 1.0))
    inside = (ratio > 1) & (ratio < xp.exp(2 * log_ratio)) & there
    return xp.where(inside, xp.log(xp.where(inside, ratio, 1.0)) / (2 * log_ratio), 0.0)


def _split(xp: ModuleType, node: Any, weight: Any, places: Sequence[Any]) -> tuple[Any, Any]:
    """The rule on [0, 1] as one rule on each piece between the given places."""
    ends = [xp.zeros_like(places[0]), *_in_order(xp, places), xp.ones_like(places[0])]
    pieces = list(pairwise(ends))
    return (
        xp.concatenate([low + (high - low) * node for low, high in pieces], axis=-1),
        xp.concatenate([(high - low) * weight for low, high in pieces], axis=-1),
    )


def _in_order(xp: ModuleType, places: Sequence[Any]) -> list[Any]:
    """Sort a few variables by size; the gradient of PyTensor's own sort does not run in JAX."""
    ordered: list[Any] = []
    for place in places:
        for i, other in enumerate(ordered):
            ordered[i], place = xp.minimum(other, place), xp.maximum(other, place)
        ordered.append(place)
    return ordered


@_vectorize_node.register(TubeOp)
def broadcast_batches(op: Op, node: Apply, *inputs: Tensor) -> Apply:
    """Broadcast batch dimensions from the left; the Op needs no loop over them."""
    core_ndim = node.outputs[0].type.ndim
    aligned = []
    for core, batched in zip(node.inputs, inputs, strict=True):
        batch_ndim = batched.type.ndim - core.type.ndim
        missing = range(batch_ndim, batch_ndim + core_ndim - core.type.ndim)
        aligned.append(pt.expand_dims(batched, tuple(missing)))
    return type(op)(**op._props_dict())(*aligned, return_list=True)[0].owner


@cache
def gauss_legendre(order: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights of the Gauss-Legendre rule on [0, 1]."""
    node, weight = np.polynomial.legendre.leggauss(order)
    return (node + 1) / 2, weight / 2
