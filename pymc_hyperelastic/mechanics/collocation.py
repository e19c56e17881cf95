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
from functools import cache
from itertools import compress
from typing import Any, NamedTuple

import numpy as np
import pytensor
import pytensor.tensor as pt
from numpy.polynomial import chebyshev
from numpy.typing import NDArray
from pytensor.gradient import DisconnectedType, disconnected_type, grad
from pytensor.graph.basic import Apply, Variable
from pytensor.graph.replace import _vectorize_node
from pytensor.tensor.blockwise import vectorize_node_fallback
from pytensor.tensor.variable import TensorVariable as Tensor

from pymc_hyperelastic.mechanics.axial_force import force_response
from pymc_hyperelastic.mechanics.chebyshev import Array, chebyshev_nodes, value_to_coefficient
from pymc_hyperelastic.mechanics.known_tubes import KnownTubes
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.wall import TubeOp, finite_or_zero, wall_rule

# Chebyshev coefficients of the response below this fraction of the largest are left out. The
# pressure is then right to about 1e-12 of the largest in the data, and rounding is not mistaken
# for signal.
COEFFICIENT_TOLERANCE = 1e-14
_MOST_NODES = 64
# Of axial stretches in a grid, and of all its nodes.
_MOST_AXIAL, _MOST_IN_GRID = 32, 1024
# Lines through a grid along which it is known how many nodes the response takes: both edges, on
# which every kink that crosses the grid begins and ends, and as many between.
_LINES = np.cos(np.pi * np.arange(9) / 8)
# Points whose walls are handled at once: bounds memory, whatever the size of the data.
_CHUNK = 2048


class Nodes(NamedTuple):
    """How many nodes: of the hoop stretch, and of the axial one where that varies."""

    hoop: int
    axial: int = 1


class Group(NamedTuple):
    """Points whose walls share their nodes: centre and half width of the logarithms there."""

    points: NDArray[np.intp]
    hoop: tuple[float, float]
    """Of ``ln λθ``."""
    axial: tuple[float, float]
    """Of ``ln λz``; the half width is 0 where all have one axial stretch."""

    def grid(self, nodes: Nodes) -> tuple[Array, Array]:
        """``ln λθ`` and ``ln λz`` at all nodes, those of one axial stretch together."""
        (hoop, hoop_half), (axial, axial_half) = self.hoop, self.axial
        log_hoop = hoop + hoop_half * chebyshev_nodes(nodes.hoop)
        log_axial = axial + axial_half * chebyshev_nodes(nodes.axial)
        return np.tile(log_hoop, nodes.axial), np.repeat(log_axial, nodes.hoop)


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
        batched = (x for x, deep in zip(variables, depths, strict=True) if deep)
        size = next((x.shape[0] for x in batched if not x.type.broadcastable[0]), 1)
        variables = tuple(
            pt.broadcast_to(x, (size, *(x.shape[1:] if deep else x.shape)))
            for x, deep in zip(variables, depths, strict=True)
        )
    outputs = type(op)(**op._props_dict())(*constants, *variables, return_list=True)
    return outputs[0].owner


def nodes_needed(
    energy: StrainEnergy,
    groups: Sequence[Group],
    values: Sequence[Array],
    *,
    with_force: bool = False,
    tolerance: float = COEFFICIENT_TOLERANCE,
) -> Nodes | None:
    """How many stretches the response must be known at, or None.

    The response is expanded for all the `values` of the parameters' entries; as many are needed as
    there are coefficients before they have fallen below the `tolerance`, relative to the largest,
    for all of them. None means that these were more than 64, or in a grid more than 32 axial
    stretches, or 1024 nodes: then the direct rule is to be used.
    """
    function, needed = _response_function(energy, with_force), Nodes(2)

    def along(log_hoop: Array, log_axial: Array) -> Array:
        """Coefficients of responses (draw, line, node) along a last axis, and their largest."""
        hoop, axial = np.broadcast_arrays(log_hoop, log_axial)
        with np.errstate(all="ignore"):
            responses = function(
                hoop.reshape(1, -1), axial.reshape(1, -1), *(v.reshape(-1, 1) for v in values)
            )
        response = np.stack([r.reshape(-1, *hoop.shape) for r in responses])
        possible = np.isfinite(response).all(axis=(0, 2, 3))
        return np.abs(response[:, possible] @ value_to_coefficient(hoop.shape[-1]).T)

    for group in groups:
        (hoop, hoop_half), (axial, axial_half) = group.hoop, group.axial
        lines = (axial + axial_half * (_LINES if axial_half else np.zeros(1)))[:, None]
        coefficients = along(hoop + hoop_half * chebyshev_nodes(2 * _MOST_NODES), lines)
        # Force is a difference of stresses, and known to their rounding.
        smallest = tolerance * np.maximum.accumulate(coefficients.max(axis=(2, 3), keepdims=True))
        needed = needed._replace(hoop=max(needed.hoop, _significant(coefficients, smallest)))
        if axial_half:
            lines = (hoop + hoop_half * _LINES)[:, None]
            across = along(lines, axial + axial_half * chebyshev_nodes(2 * _MOST_AXIAL))
            smallest = tolerance * np.maximum.accumulate(across.max(axis=(2, 3), keepdims=True))
            needed = needed._replace(axial=max(needed.axial, _significant(across, smallest)))
        if (
            needed.hoop > _MOST_NODES
            or needed.axial > _MOST_AXIAL
            or (axial_half and needed.hoop * needed.axial > _MOST_IN_GRID)
        ):
            return None
    return needed


def _significant(coefficients: Array, smallest: Array) -> int:
    """How many coefficients there are before all are below the smallest that matters."""
    significant = (coefficients > smallest).any(axis=(0, 1, 2))
    return int(np.flatnonzero(significant).max(initial=0)) + 1


def collocate(
    tubes: KnownTubes, groups: Sequence[Group], nodes: Nodes, targets: dict[str, Array]
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
    factors: dict[str, list[Array]] = {name: [] for name in targets}
    residual = dict.fromkeys(targets, 0.0)
    count = nodes.hoop * nodes.axial
    for group in groups:
        augmented = {name: np.zeros((0, count + 1)) for name in factors}
        for start in range(0, len(group.points), _CHUNK):
            chunk = group.points[start : start + _CHUNK]
            matrices = _matrices(tubes.at(chunk), group, nodes)
            for name, target in targets.items():
                rows = np.column_stack([matrices[name], target[chunk]])
                rows = rows[~np.isnan(rows[:, -1])]
                stacked = np.concatenate([augmented[name], rows])
                few = len(stacked) <= count
                augmented[name] = stacked if few else np.linalg.qr(stacked, mode="r")
        for name, rows in augmented.items():
            factors[name].append(rows[:count])
            residual[name] += float(np.sum(rows[count:, -1] ** 2))
    collocated: dict[str, Any] = _grids(groups, nodes)
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
    tubes: KnownTubes, groups: Sequence[Group], nodes: Nodes
) -> tuple[dict[str, Array], NDArray[np.intp]]:
    """Matrices of :class:`CollocatedIntegral` for the points themselves, uncompressed.

    Groups are padded to the same number of rows. With the matrices come the places of the points
    among all rows, group by group; 0 for points that are in none. Slopes of pressure and force are
    by the internal radius.
    """
    most = max(1, *(len(group.points) for group in groups))
    shape = len(groups), most, nodes.hoop * nodes.axial
    names = ("pressure", "stiffness", "force", "force_slope")
    matrices = {name: np.zeros(shape) for name in names}
    place = np.zeros(len(tubes.radius), int)
    for number, group in enumerate(groups):
        place[group.points] = number * most + np.arange(len(group.points))
        for start in range(0, len(group.points), _CHUNK):
            chunk = group.points[start : start + _CHUNK]
            rows = slice(start, start + len(chunk))
            blocks = _matrices(tubes.at(chunk), group, nodes)
            for name, matrix in matrices.items():
                matrix[number, rows] = blocks[name]
    of_curves = {f"{name}_matrix": matrix for name, matrix in matrices.items()}
    return _grids(groups, nodes) | of_curves, place


def _grids(groups: Sequence[Group], nodes: Nodes) -> dict[str, Array]:
    """Where the response is to be known: (group, node)."""
    log_hoop, log_axial = zip(*(group.grid(nodes) for group in groups), strict=True)
    return {"log_hoop": np.array(log_hoop), "log_axial": np.array(log_axial)}


def _matrices(tubes: KnownTubes, group: Group, nodes: Nodes) -> dict[str, Array]:
    """From responses at the nodes to what is measured at the points: (point, node) each.

    ``"slope"`` is the stiffness by the radius that was measured.
    """
    centre, half = group.hoop
    wall = wall_rule(np, *tubes.walls)
    vandermonde = chebyshev.chebvander((wall.log_hoop - centre) / half, nodes.hoop - 1)
    coefficient = value_to_coefficient(nodes.hoop)
    derivative = chebyshev.chebder(coefficient, axis=0) / half

    def moments(weight: Array) -> Array:
        return np.einsum("nq,nqk->nk", weight, vandermonde)

    of_pressure, weighted = moments(wall.pressure_weight), moments(wall.stiffness_weight)
    stiffness = weighted[:, :-1] @ derivative / 2 - weighted @ coefficient
    share = np.reshape(tubes.share, (-1, 1))
    stiffness *= share
    matrices = {
        "pressure": of_pressure @ coefficient,
        "stiffness": stiffness,
        "slope": stiffness * tubes.growth[:, None],
        "force": moments(wall.force_weight) @ coefficient,
        "force_slope": np.pi * share * tubes.radius[:, None] * (of_pressure[:, :-1] @ derivative),
    }
    if nodes.axial == 1:
        return matrices
    # At the axial stretch of its point, a wall's response is interpolated between those of nodes.
    centre, half = group.axial
    place = (np.log(tubes.axial_stretch) - centre) / half
    between = chebyshev.chebvander(place, nodes.axial - 1) @ value_to_coefficient(nodes.axial)
    return {
        name: (between[:, :, None] * matrix[:, None, :]).reshape(len(place), -1)
        for name, matrix in matrices.items()
    }


def groups_by(
    tubes: KnownTubes, key: NDArray, some: NDArray[np.intp], *, varied: bool
) -> list[Group]:
    """Groups of some of the points that have the same `key`; their axial stretch may be varied."""
    groups = []
    for value in np.unique(key[some]):
        own = some[key[some] == value]
        log_axial = np.log(tubes.axial_stretch[own])
        span = _span(log_axial) if varied else (float(log_axial[0]), 0.0)
        groups.append(Group(own, _span(tubes.at(own).log_hoop), span))
    return groups


def _span(values: Any) -> tuple[float, float]:
    """Centre and half width of the range of some numbers; a narrow one is widened at its end."""
    low, high = float(np.min(values)), float(np.max(values))
    half = max((high - low) / 2, 1e-3)
    return low + half, half


@cache
def _response_function(energy: StrainEnergy, with_force: bool) -> Any:
    """Responses at ``ln λθ`` and ``ln λz`` (1, node), for parameters (draw, 1)."""
    log_hoop = pt.tensor("log_hoop", dtype="float64", shape=(1, None))
    log_axial = pt.tensor("log_axial", dtype="float64", shape=(1, None))
    entries = [pt.tensor(n, dtype="float64", shape=(None, 1)) for n in energy.entry_names]
    hoop, axial, *full = pt.broadcast_arrays(log_hoop, log_axial, *entries)
    responses = [energy.stress_difference(hoop, axial, **energy.join(full))]
    if with_force:
        responses.append(force_response(energy, hoop, axial, full))
    return pytensor.function([log_hoop, log_axial, *entries], responses, mode="FAST_COMPILE")
