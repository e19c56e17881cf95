"""The pressure integral as a constant matrix, for known radii and geometry.

Pressure and stiffness are linear in the material's response ``T(ln λθ)``. Where radii and geometry
are known, they are ``M g`` and ``S g``: ``g`` holds the response at ``K`` Chebyshev stretches that
span the walls, and the matrices do not depend on the material. The squared misfit to any number
of points is then, by a QR factorisation, that of ``K`` numbers.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytensor
import pytensor.tensor as pt
from numpy.polynomial import chebyshev
from numpy.typing import NDArray
from pytensor.graph.basic import Apply, Variable
from pytensor.graph.replace import _vectorize_node
from pytensor.tensor.blockwise import vectorize_node_fallback
from pytensor.tensor.variable import TensorVariable as Tensor

from pymc_hyperelastic.mechanics.axial_force import force_response
from pymc_hyperelastic.mechanics.chebyshev import Array, chebyshev_nodes, value_to_coefficient
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.tube import stretches
from pymc_hyperelastic.mechanics.wall import TubeOp, wall_rule

# Chebyshev coefficients of the response below this fraction of the largest are left out. The
# pressure is then right to about 1e-12 of the largest in the data, and rounding is not mistaken
# for signal.
_COEFFICIENT_TOLERANCE = 1e-14
_MOST_NODES = 64
# Points whose walls are handled at once: bounds memory, whatever the size of the data.
_CHUNK = 2048


class KnownTubes(NamedTuple):
    """Tubes whose radii and geometry are known, one entry a point."""

    radius: Array
    """Internal radius, mm."""
    inner_radius: Array
    outer_radius: Array
    axial_stretch: Array
    opening_angle: Array
    growth: Array
    """How the internal radius grows with the one that was measured."""

    def at(self, points: NDArray[np.intp]) -> "KnownTubes":
        """Some of the points."""
        return KnownTubes(*(values[points] for values in self))

    @property
    def walls(self) -> list[Array]:
        """Internal radius and geometry, each (point, 1)."""
        return [values[:, None] for values in self[:-1]]


class CollocatedIntegral(TubeOp):
    r"""Integrals over the walls of known tubes as constant matrices times the wall's response.

    Inputs are ``ln λθ`` at the nodes (group, node), ``ln λz`` (group), the matrices (group, row,
    node), then the parameters in the order of the strain energy, vectors entry by entry: scalars,
    or with `per_group` one value a group. For each matrix there is an output (group, row).
    """

    __props__ = ("strain_energy", "per_group")

    def __init__(
        self, input_types: Any = None, *, per_group: bool = False, **settings: Any
    ) -> None:
        super().__init__(input_types, per_group=per_group, **settings)

    def build_inner_graph(self, *inputs: Tensor) -> list[Variable]:
        """Response at the nodes, then one matrix product a group."""
        log_hoop, log_axial, *matrices = inputs[: self.constants]
        entries = inputs[self.constants :]
        batched = any(x.type.ndim > self.per_group for x in entries)
        log_axial = log_axial[:, None]
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


class CollocatedPressureIntegral(CollocatedIntegral):
    r"""Pressures and stiffnesses of known tubes as constant matrices times the wall's response.

    .. math:: T_{gk} = T(\ln λ_θ^{(gk)}, \ln λ_z^{(g)}), \qquad
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


@_vectorize_node.register(CollocatedIntegral)
def _vectorize_collocated(op: CollocatedIntegral, node: Apply, *inputs: Tensor) -> Apply:
    """Take a batch of parameters in one call; anything else is looped over."""
    constants, entries = inputs[: op.constants], inputs[op.constants :]
    deepest = max(x.type.ndim for x in entries)
    if constants != tuple(node.inputs[: op.constants]) or deepest > 1 + op.per_group:
        return vectorize_node_fallback(op, node, *inputs)
    entries = pt.broadcast_arrays(*(pt.atleast_Nd(x, n=deepest) for x in entries))
    outputs = type(op)(**op._props_dict())(*constants, *entries, return_list=True)
    return outputs[0].owner


def nodes_needed(
    energy: StrainEnergy, tubes: KnownTubes, values: Sequence[Array], *, with_force: bool = False
) -> int | None:
    """Number ``K`` of Chebyshev stretches at which the response must be known, or None.

    The response is expanded for all the `values` of the parameters' entries; ``K`` is where the
    coefficients have fallen below rounding for all of them. None means that more than 64 were
    needed: then the direct rule is to be used.
    """
    node = chebyshev_nodes(2 * _MOST_NODES)
    needed = 2
    for axial_stretch, _, (centre, half) in _groups(tubes):
        shape = (-1, 1)
        with np.errstate(all="ignore"):
            responses = _response_function(energy, with_force)(
                (centre + half * node)[None, :],
                np.full((1, 1), np.log(axial_stretch)),
                *(v.reshape(shape) for v in values),
            )
        response = np.stack(responses)
        response = response[:, np.isfinite(response).all(axis=(0, 2))]
        coefficients = np.abs(response @ value_to_coefficient(node.size).T)
        # Force is a difference of stresses, and known to their rounding.
        largest = np.maximum.accumulate(coefficients.max(axis=2, keepdims=True))
        significant = (coefficients > _COEFFICIENT_TOLERANCE * largest).any(axis=(0, 1))
        needed = max(needed, int(np.flatnonzero(significant).max(initial=0)) + 1)
    return needed if needed <= _MOST_NODES else None


def collocate(tubes: KnownTubes, count: int, targets: dict[str, Array]) -> dict[str, Any]:
    """Matrices of :class:`CollocatedIntegral`, compressed against the measured values.

    With a QR factorisation ``[M y] = Q [R c; 0 ρ]`` of a group, ``|M g − y|² = |R g − c|² + ρ²``
    for every response ``g``. Each kind of measurement is compressed separately, so that their
    weights may be unknown. The `targets` are what was measured at each point, NaN where nothing
    was: ``"pressure"`` (kPa), ``"slope"`` (kPa/mm, by the radius that was measured), ``"force"``
    (mN).

    Given back are ``log_hoop`` (group, node), ``log_axial`` (group), and for each target the
    ``_matrix`` (group, node, node), ``_target`` (group, node) and ``_residual`` (the sum of all
    ``ρ²``), with `count` nodes.
    """
    node = chebyshev_nodes(count)
    hoop, axial = [], []
    factors: dict[str, list[Array]] = {name: [] for name in targets}
    residual = dict.fromkeys(targets, 0.0)
    for axial_stretch, points, (centre, half) in _groups(tubes):
        hoop.append(centre + half * node)
        axial.append(np.log(axial_stretch))
        augmented = {name: np.zeros((count + 1, count + 1)) for name in factors}
        for start in range(0, len(points), _CHUNK):
            chunk = points[start : start + _CHUNK]
            matrices = _matrices(tubes.at(chunk), centre, half, count)
            for name, target in targets.items():
                rows = np.column_stack([matrices[name], target[chunk]])
                rows = rows[~np.isnan(rows[:, -1])]
                stacked = np.concatenate([augmented[name], rows])
                augmented[name] = np.linalg.qr(stacked, mode="r")
        for name, triangle in augmented.items():
            factors[name].append(triangle[:-1])
            residual[name] += triangle[-1, -1] ** 2
    collocated: dict[str, Any] = {"log_hoop": np.array(hoop), "log_axial": np.array(axial)}
    for name, triangles in factors.items():
        stacked = np.array(triangles)
        collocated[f"{name}_matrix"] = stacked[..., :-1]
        collocated[f"{name}_target"] = stacked[..., -1]
        collocated[f"{name}_residual"] = np.array(residual[name])
    return collocated


def curve_matrices(
    tubes: KnownTubes, count: int, group: NDArray | None = None
) -> tuple[dict[str, Array], NDArray[np.intp]]:
    """Matrices of :class:`CollocatedIntegral` for the points themselves, uncompressed.

    Points of one `group` stand together; when missing, those of one axial stretch do. Groups are
    padded to the same number of rows. With the matrices come the places of the points among all
    rows, group by group. Slopes of pressure and force are by the internal radius.
    """
    groups = _groups(tubes, group)
    node = chebyshev_nodes(count)
    most = max(len(points) for _, points, _ in groups)
    shape = len(groups), most, count
    names = ("pressure", "stiffness", "force", "force_slope")
    matrices = {name: np.zeros(shape) for name in names}
    place = np.zeros(len(tubes.radius), int)
    for number, (_, points, (centre, half)) in enumerate(groups):
        place[points] = number * most + np.arange(len(points))
        for start in range(0, len(points), _CHUNK):
            chunk = points[start : start + _CHUNK]
            rows = slice(start, start + len(chunk))
            blocks = _matrices(tubes.at(chunk), centre, half, count)
            for name, matrix in matrices.items():
                matrix[number, rows] = blocks[name]
    return {
        "log_hoop": np.array([centre + half * node for *_, (centre, half) in groups]),
        "log_axial": np.array([np.log(axial_stretch) for axial_stretch, *_ in groups]),
        **{f"{name}_matrix": matrix for name, matrix in matrices.items()},
    }, place


def _matrices(tubes: KnownTubes, centre: float, half: float, count: int) -> dict[str, Array]:
    """From responses at the nodes to what is measured at the points: (point, node) each.

    ``"slope"`` is the stiffness by the radius that was measured.
    """
    wall = wall_rule(np, *tubes.walls)
    vandermonde = chebyshev.chebvander((wall.log_hoop - centre) / half, count - 1)
    coefficient = value_to_coefficient(count)
    derivative = chebyshev.chebder(coefficient, axis=0) / half

    def moments(weight: Array) -> Array:
        return np.einsum("nq,nqk->nk", weight, vandermonde)

    of_pressure, weighted = moments(wall.pressure_weight), moments(wall.stiffness_weight)
    stiffness = weighted[:, :-1] @ derivative / 2 - weighted @ coefficient
    return {
        "pressure": of_pressure @ coefficient,
        "stiffness": stiffness,
        "slope": stiffness * tubes.growth[:, None],
        "force": moments(wall.force_weight) @ coefficient,
        "force_slope": np.pi * tubes.radius[:, None] * (of_pressure[:, :-1] @ derivative),
    }


def _groups(
    tubes: KnownTubes, group: NDArray | None = None
) -> list[tuple[float, NDArray[np.intp], tuple[float, float]]]:
    """Axial stretch, points, and the centre and half width of ``ln λθ``, of each group."""
    key = tubes.axial_stretch if group is None else group
    groups = []
    for value in np.unique(key):
        points = np.flatnonzero(key == value)
        # Along a wall the stretch is monotonic: its two faces bound it.
        radius, inner, outer, axial, angle = tubes.at(points).walls
        tube = {"inner_radius": inner, "axial_stretch": axial, "opening_angle": angle}
        faces = [np.log(stretches(face, radius, **tube)[1]) for face in (inner, outer)]
        low, high = np.min(faces), np.max(faces)
        half = max((high - low) / 2, 1e-3)
        groups.append((float(axial[0, 0]), points, ((low + high) / 2, half)))
    return groups


@cache
def _response_function(energy: StrainEnergy, with_force: bool) -> Any:
    """Responses at ``ln λθ`` (1, node) and ``ln λz`` (1, 1), for parameters (draw, 1)."""
    log_hoop = pt.tensor("log_hoop", dtype="float64", shape=(1, None))
    log_axial = pt.tensor("log_axial", dtype="float64", shape=(1, 1))
    entries = [pt.tensor(n, dtype="float64", shape=(None, 1)) for n in energy.entry_names]
    hoop, axial, *full = pt.broadcast_arrays(log_hoop, log_axial, *entries)
    responses = [energy.stress_difference(hoop, axial, **energy.join(full))]
    if with_force:
        responses.append(force_response(energy, hoop, axial, full))
    return pytensor.function([log_hoop, log_axial, *entries], responses, mode="FAST_COMPILE")
