"""The pressure integral as a constant matrix, for known radii and geometry.

Pressure and stiffness are linear in the material's response ``T(ln λθ)``. Where radii and geometry
are known, they are ``M g`` and ``S g``: ``g`` holds the response at ``K`` Chebyshev stretches that
span the walls, and the matrices do not depend on the material. The squared misfit to any number
of points is then, by a QR factorisation, that of ``K`` numbers.

Walls at one axial stretch make a group. Where the stretch varies within a group, the response is
known on a grid of hoop and axial stretches: a product of Chebyshev points in ``ln λθ`` and
``ln λz``.
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
from pymc_hyperelastic.mechanics.interpolation import Basis, Group, Interpolation, Matrices
from pymc_hyperelastic.mechanics.known_tubes import KnownTubes
from pymc_hyperelastic.mechanics.wall import TubeOp, finite_or_zero

Array = NDArray[np.float64]

# Points whose walls are handled at once: bounds memory, whatever the size of the data.
_CHUNK = 2048


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
        """What depends on what: nothing is differentiated by constants."""
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
        outputs = compress(integral.build_inner_graph(*inputs[:count]), self.known)
        cotangents = inputs[count:]
        gradients = grad(
            None,
            inputs[self.constants : count],
            known_grads=dict(zip(outputs, cotangents, strict=True)),
            disconnected_inputs="ignore",
        )
        return finite_or_zero(gradients)


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
    """Matrices of :class:`CollocatedIntegral`, compressed against the measured values.

    With a QR factorisation ``[M y] = Q [R c; 0 ρ]`` of a group, ``|M g − y|² = |R g − c|² + ρ²``
    for every response ``g``. Each kind of measurement is compressed separately, so that their
    weights may be unknown. The `targets` are what was measured at each point, NaN where nothing
    was: ``"pressure"`` (kPa), ``"slope"`` (kPa/mm, by the radius that was measured), ``"force"``
    (mN).

    Given back are ``log_hoop`` and ``log_axial`` (group, node), and for each target the ``_matrix``
    (group, row, node), ``_target`` (group, row) and ``_residual`` (the sum of all ``ρ²``). There
    are as many rows as nodes, or points where these are fewer.
    """
    interpolations = [basis.interpolation(tubes, group) for group in groups]
    collocated: dict[str, Any] = _places(interpolations)
    factors: dict[str, list[Array]] = {name: [] for name in targets}
    residual = dict.fromkeys(targets, 0.0)
    count = collocated["log_hoop"].shape[1]
    for group, interpolation in zip(groups, interpolations, strict=True):
        augmented = {name: np.zeros((0, count + 1)) for name in factors}
        for start in range(0, len(group.points), _CHUNK):
            chunk = group.points[start : start + _CHUNK]
            matrices = _matrices(tubes, chunk, interpolation, count)
            for name, target in targets.items():
                rows = np.column_stack([matrices[name], target[chunk]])
                rows = rows[~np.isnan(rows[:, -1])]
                stacked = np.concatenate([augmented[name], rows])
                few = len(stacked) <= count
                augmented[name] = stacked if few else np.linalg.qr(stacked, mode="r")
        for name, rows in augmented.items():
            factors[name].append(rows[:count])
            residual[name] += float(np.sum(rows[count:, -1] ** 2))
    for name, of_groups in factors.items():
        most = max((len(rows) for rows in of_groups), default=0)
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
    """Matrices of :class:`CollocatedIntegral` for the points themselves, uncompressed.

    Groups are padded to the same number of rows. With the matrices come the places of the points
    among all rows, group by group; 0 for points that are in none. Slopes of pressure and force are
    by the internal radius.
    """
    interpolations = [basis.interpolation(tubes, group) for group in groups]
    places = _places(interpolations)
    most = max(1, *(len(group.points) for group in groups))
    shape = len(groups), most, places["log_hoop"].shape[1]
    names = ("pressure", "stiffness", "force", "force_slope")
    matrices = {name: np.zeros(shape) for name in names}
    place = np.zeros(len(tubes.radius), int)
    for number, (group, interpolation) in enumerate(zip(groups, interpolations, strict=True)):
        place[group.points] = number * most + np.arange(len(group.points))
        for start in range(0, len(group.points), _CHUNK):
            chunk = group.points[start : start + _CHUNK]
            rows = slice(start, start + len(chunk))
            blocks = _matrices(tubes, chunk, interpolation, shape[2])
            for name, matrix in matrices.items():
                matrix[number, rows] = blocks[name]
    return places | {f"{name}_matrix": matrix for name, matrix in matrices.items()}, place


def _places(interpolations: Sequence[Interpolation]) -> dict[str, Array]:
    """Where the response is to be known: (group, node), the first node in place of none."""
    places = [interpolation.places for interpolation in interpolations]
    count = max(len(log_hoop) for log_hoop, _ in places)

    def padded(values: Array) -> Array:
        return np.concatenate([values, np.full(count - len(values), values[0])])

    log_hoop, log_axial = (np.array([padded(v) for v in of]) for of in zip(*places, strict=True))
    return {"log_hoop": log_hoop, "log_axial": log_axial}


def _matrices(
    tubes: KnownTubes, points: NDArray[np.intp], interpolation: Interpolation, count: int
) -> Matrices:
    """From responses at so many nodes to what is measured at the points: (point, node) each."""
    matrices = interpolation.matrices(tubes, points)
    return {n: np.pad(m, [(0, 0), (0, count - m.shape[1])]) for n, m in matrices.items()}
