"""The integrals over the wall as constant matrices, for tubes with known radii and geometry.

Pressure, stiffness and axial force are linear in the response of the material. If radii and
geometry are known, they are constant matrices times the responses ``g`` at ``K`` nodes in the
walls, which do not depend on the material. A QR factorisation reduces the squared misfit of any
number of points to that of ``K`` numbers. :mod:`~pymc_hyperelastic.mechanics.interpolation` and
:mod:`~pymc_hyperelastic.mechanics.selected_nodes` choose the nodes.
"""

from collections.abc import Sequence
from itertools import compress
from typing import Any

import numpy as np
import pytensor.tensor as pt
from numpy.typing import NDArray
from pytensor.gradient import DisconnectedType, disconnected_type, grad
from pytensor.graph.basic import Apply, Variable
from pytensor.graph.replace import _vectorize_node
from pytensor.tensor.blockwise import vectorize_node_fallback
from pytensor.tensor.variable import TensorVariable as Tensor

from pymc_hyperelastic.mechanics.axial_force import force_response
from pymc_hyperelastic.mechanics.interpolation import Basis, Interpolation
from pymc_hyperelastic.mechanics.known_tubes import Group, KnownTubes
from pymc_hyperelastic.mechanics.wall import TubeOp, zero_at_overflow

Array = NDArray[np.float64]

# Numbers in the weights (node, point, quadrature node) that are computed at once: 32 MB.
_CHUNK = 4_000_000


class CollocatedIntegral(TubeOp):
    r"""Integrals over the walls of known tubes as constant matrices times the wall's response.

    Inputs are ``ln λθ`` and ``ln λz`` at the nodes (group, node), the matrices (group, row,
    node), then the parameters in the order of the strain energy, vectors entry by entry: scalars,
    or with `per_group` one value a group. For each matrix there is an output (group, row).
    """

    __props__: tuple[str, ...] = ("strain_energy", "per_group")

    def __init__(
        self, input_types: Any = None, *, per_group: bool = False, **settings: Any
    ) -> None:
        super().__init__(input_types, per_group=per_group, **settings)

    def build_inner_graph(self, *inputs: Tensor) -> list[Variable]:
        """Response at the nodes, then one matrix product a group."""
        log_hoop, log_axial, *matrices = inputs[: self.constants]
        entries = inputs[self.constants :]
        batched = any(x.type.ndim > self.per_group for x in entries)
        if batched:
            # The particles run along the last axis, where NumPy's sums over the others are fast.
            log_hoop, log_axial = log_hoop[..., None], log_axial[..., None]
        if self.per_group:
            entries = tuple(x.T[:, None] if x.type.ndim > 1 else x[:, None] for x in entries)
        log_hoop, log_axial, *entries = pt.broadcast_arrays(log_hoop, log_axial, *entries)
        response = self.response(log_hoop, log_axial, entries)
        if batched:
            return [pt.moveaxis(matrix @ response, -1, 0) for matrix in matrices]
        return [(matrix @ response[..., None])[..., 0] for matrix in matrices]

    # Number of inputs before the parameters.
    constants: int

    def pullback(self, inputs: Any, outputs: Any, cotangents: Any) -> list[Variable]:
        """Gradient by the parameters; the others are constants."""
        known = tuple(not isinstance(c.type, DisconnectedType) for c in cotangents)
        op = CollocatedGradient(**self._props_dict(), integral=type(self), known=known)
        of_entries = op(*inputs, *compress(cotangents, known), return_list=True)
        return [disconnected_type() for _ in range(self.constants)] + of_entries

    def connection_pattern(self, node: Apply) -> list[list[bool]]:
        """Outputs depend on the parameters; gradients by the constants are disconnected."""
        pattern = super().connection_pattern(node)
        return [[False] * len(node.outputs)] * self.constants + pattern[self.constants :]


class CollocatedPressureIntegral(CollocatedIntegral):
    r"""Pressures and stiffnesses of known tubes as constant matrices times the wall's response.

    .. math:: T_{gk} = T(\ln λ_θ^{(gk)}, \ln λ_z^{(gk)}), \qquad
        p_{gj} = \sum_k M_{gjk} T_{gk}, \qquad s_{gj} = \sum_k S_{gjk} T_{gk}

    See :class:`CollocatedIntegral` for the inputs.
    """

    constants = 4


class CollocatedAxialForce(CollocatedIntegral):
    """Axial forces of known tubes as a constant matrix times ``2 (σzz − σrr) − (σθθ − σrr)``."""

    constants = 3

    def response(self, log_hoop: Tensor, log_axial: Tensor, entries: Sequence[Any]) -> Tensor:
        """``2 (σzz − σrr) − (σθθ − σrr)`` of the material."""
        return force_response(self.strain_energy, log_hoop, log_axial, entries)


class CollocatedGradient(CollocatedIntegral):
    """Gradient of such an integral by the parameters, of a batch of them as one operation.

    After the inputs of the `integral` come the gradients by those of its outputs that are `known`.
    """

    __props__ = ("strain_energy", "per_group", "integral", "known")

    def __init__(
        self,
        input_types: Any = None,
        *,
        integral: type[CollocatedIntegral],
        known: tuple[bool, ...],
        **settings: Any,
    ) -> None:
        self.constants = integral.constants
        super().__init__(input_types, integral=integral, known=known, **settings)

    pullback = TubeOp.pullback
    connection_pattern = TubeOp.connection_pattern

    def build_inner_graph(self, *inputs: Tensor) -> list[Variable]:
        """Differentiate the integral: the response at the nodes is that of its value."""
        count = self.constants + len(self.strain_energy.entry_names)
        integral = self.integral(strain_energy=self.strain_energy, per_group=self.per_group)
        values = integral.build_inner_graph(*inputs[:count])
        outputs = [*compress(values, self.known)]
        cotangents = inputs[count:]
        gradients = grad(
            None,
            inputs[self.constants : count],
            known_grads=dict(zip(outputs, cotangents, strict=True)),
            disconnected_inputs="ignore",
        )
        batch_ndim = int(values[0].type.ndim > 2)
        return zero_at_overflow(gradients, outputs, batch_ndim)


@_vectorize_node.register(CollocatedIntegral)
def _vectorize_collocated(op: CollocatedIntegral, node: Apply, *inputs: Tensor) -> Apply:
    """Take a batch of parameters in one call; anything else is looped over."""
    constants, variables = inputs[: op.constants], inputs[op.constants :]
    # Parameters, behind which gradients by outputs (group, row) may follow.
    count = len(op.strain_energy.entry_names)
    cores = [int(op.per_group)] * count + [2] * (len(variables) - count)
    depths = [x.type.ndim - core for x, core in zip(variables, cores, strict=True)]
    if constants != tuple(node.inputs[: op.constants]) or max(depths) > 1:
        return vectorize_node_fallback(op, node, *inputs)
    if any(depths):
        batches = [x if deep else x[None] for x, deep in zip(variables, depths, strict=True)]
        whole = [x for x in batches if not x.type.broadcastable[0]]
        if whole:
            # To allocate, PyTensor would work out the shapes of the whole graph behind.
            first = whole[0].flatten(2)[:, 0] if whole[0].type.ndim > 1 else whole[0]
            batches = [
                pt.second(pt.shape_padright(first, x.type.ndim - 1), x)
                if x.type.broadcastable[0]
                else x
                for x in batches
            ]
        variables = tuple(batches)
    outputs = type(op)(**op._props_dict())(*constants, *variables, return_list=True)
    return outputs[0].owner


def collocate(
    tubes: KnownTubes, groups: Sequence[Group], basis: Basis, targets: dict[str, Array]
) -> dict[str, Any]:
    """Return matrices of :class:`CollocatedIntegral`, compressed against the measured values.

    With a QR factorisation ``[M y] = Q [R c; 0 ρ]`` of a group, ``|M g − y|² = |R g − c|² + ρ²``
    for every response ``g``. Each kind of measurement is compressed separately, so that their
    weights may be unknown. The `targets` are the measured values at each point, or NaN:
    ``"pressure"`` (kPa), ``"slope"`` (kPa/mm, by the radius that was measured), ``"force"``
    (mN).

    The result holds ``log_hoop`` and ``log_axial`` (group, node), and for each target the
    ``_matrix`` (group, row, node), ``_target`` (group, row) and ``_residual`` (the sum of all
    ``ρ²``). There are as many rows as nodes, or as points if these are fewer.
    """
    interpolations = [basis.interpolation(tubes, group) for group in groups]
    collocated: dict[str, Any] = _places(interpolations)
    factors: dict[str, list[Array]] = {name: [] for name in targets}
    residual = dict.fromkeys(targets, 0.0)
    count = collocated["log_hoop"].shape[1]
    for group, interpolation in zip(groups, interpolations, strict=True):
        augmented = {name: np.zeros((0, count + 1)) for name in factors}
        for chunk in _chunks(group, interpolation):
            matrices = _matrices(tubes, group.points[chunk], interpolation, count)
            for name, target in targets.items():
                rows = np.column_stack([matrices[name], target[group.points[chunk]]])
                rows = rows[~np.isnan(rows[:, -1])]
                stacked = np.concatenate([augmented[name], rows])
                few = len(stacked) <= count
                augmented[name] = stacked if few else np.linalg.qr(stacked, mode="r")
        for name, rows in augmented.items():
            factors[name].append(rows[:count])
            residual[name] += float(np.sum(rows[count:, -1] ** 2))
    for name, of_groups in factors.items():
        most = max(len(rows) for rows in of_groups)
        stacked = np.zeros((len(groups), most, count + 1))
        for rows, block in zip(of_groups, stacked, strict=True):
            block[: len(rows)] = rows
        collocated[f"{name}_matrix"] = stacked[..., :-1]
        collocated[f"{name}_target"] = stacked[..., -1]
        collocated[f"{name}_residual"] = np.array(residual[name])
    return collocated


def curve_matrices(
    tubes: KnownTubes, groups: Sequence[Group], basis: Basis
) -> tuple[dict[str, Array], NDArray[np.intp]]:
    """Return matrices of :class:`CollocatedIntegral` for the points themselves, uncompressed.

    Groups are padded to the same number of rows. With the matrices come the places of the points
    among all rows, group by group. Slopes of pressure and force are by the internal radius.
    """
    interpolations = [basis.interpolation(tubes, group) for group in groups]
    places = _places(interpolations)
    most = max(len(group.points) for group in groups)
    shape = len(groups), most, places["log_hoop"].shape[1]
    names = ("pressure", "stiffness", "force", "force_slope")
    matrices = {name: np.zeros(shape) for name in names}
    place = np.zeros(len(tubes.radius), int)
    for number, (group, interpolation) in enumerate(zip(groups, interpolations, strict=True)):
        place[group.points] = number * most + np.arange(len(group.points))
        for chunk in _chunks(group, interpolation):
            blocks = _matrices(tubes, group.points[chunk], interpolation, shape[2])
            for name, matrix in matrices.items():
                matrix[number, chunk] = blocks[name]
    return places | {f"{name}_matrix": matrix for name, matrix in matrices.items()}, place


def wall_matrices(tubes: KnownTubes, interpolation: Interpolation) -> dict[str, Array]:
    """Return matrices (point, node) from responses at the nodes to pressures, forces and slopes.

    Besides ``"pressure"`` and ``"force"`` there are ``"stiffness"`` and ``"force_slope"``, by the
    internal radius, and ``"slope"`` of the pressure, by the radius that was measured.
    """
    rule, log_axial = tubes.quadrature(interpolation.order, split=interpolation.split)
    values, slopes = (
        weights.reshape(-1, *rule.log_hoop.shape)
        for weights in interpolation.weights(rule.log_hoop.ravel(), log_axial.ravel())
    )

    def integral(weight: Array, of_nodes: Array) -> Array:
        return np.einsum("nq,knq->nk", weight, of_nodes)

    stiffness = integral(rule.stiffness_weight, slopes / 2 - values)
    return {
        "pressure": integral(rule.pressure_weight, values),
        "stiffness": stiffness,
        "slope": stiffness * tubes.growth[:, None],
        "force": integral(rule.force_weight, values),
        "force_slope": np.pi * tubes.radius[:, None] * integral(rule.pressure_weight, slopes),
    }


def _places(interpolations: Sequence[Interpolation]) -> dict[str, Array]:
    """Stretches of the nodes (group, node); groups with fewer nodes repeat their first one."""
    places = [interpolation.places for interpolation in interpolations]
    count = max(len(log_hoop) for log_hoop, _ in places)

    def padded(values: Array) -> Array:
        return np.concatenate([values, np.full(count - len(values), values[0])])

    log_hoop, log_axial = (np.array([padded(v) for v in of]) for of in zip(*places, strict=True))
    return {"log_hoop": log_hoop, "log_axial": log_axial}


def _chunks(group: Group, interpolation: Interpolation) -> list[slice]:
    """Slices of the points of a group whose weights have a bounded size."""
    each = len(interpolation.places[0]) * interpolation.order * (1 + interpolation.split)
    step = max(1, _CHUNK // each)
    count = len(group.points)
    return [slice(start, min(start + step, count)) for start in range(0, count, step)]


def _matrices(
    tubes: KnownTubes, points: NDArray[np.intp], interpolation: Interpolation, count: int
) -> dict[str, Array]:
    """Matrices of some points, with columns of zeros up to `count` nodes."""
    matrices = wall_matrices(tubes.at(points), interpolation)
    return {n: np.pad(m, [(0, 0), (0, count - m.shape[1])]) for n, m in matrices.items()}
