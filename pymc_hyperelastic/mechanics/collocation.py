"""The integrals over the wall as constant matrices, for tubes with known radii and geometry.

Pressure, stiffness and axial force are linear in the response of the material. If radii and
geometry are known, they are constant matrices times the responses ``g`` at ``K`` nodes in the
walls, which do not depend on the material. A QR factorisation reduces the squared misfit of any
number of points to that of ``K`` numbers. :mod:`~pymc_hyperelastic.mechanics.interpolation` and
:mod:`~pymc_hyperelastic.mechanics.selected_nodes` choose the nodes.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytensor.tensor as pt
from numpy.typing import NDArray
from pytensor.graph.basic import Variable
from pytensor.graph.replace import _vectorize_node
from pytensor.tensor.variable import TensorVariable as Tensor

from pymc_hyperelastic.mechanics.interpolation import Basis, Interpolation
from pymc_hyperelastic.mechanics.known_tubes import Group, KnownTubes
from pymc_hyperelastic.mechanics.wall import TubeOp, broadcast_batches, response

Array = NDArray[np.float64]

# Numbers in the weights (node, point, quadrature node) that are computed at once: 32 MB.
_CHUNK = 4_000_000


class CollocatedIntegral(TubeOp):
    r"""Integrals over the walls of known tubes: constant matrices times the wall's response.

    .. math:: I_{gj} = \sum_k M_{gjk} T(\ln λ_θ^{(gk)}, \ln λ_z^{(gk)})

    Inputs are ``ln λθ`` and ``ln λz`` at the nodes (group, node), any number of matrices
    (group, row, node), then the parameters in the order of the strain energy, vectors entry by
    entry; parameters broadcast against the nodes. For each matrix there is an output (group, row).

    Attributes
    ----------
    force : bool, default False
        If True, the response is that of the axial force, else that of the pressure.
    """

    __props__ = ("strain_energy", "force")

    def __init__(self, input_types: Any = None, *, force: bool = False, **settings: Any) -> None:
        super().__init__(input_types, force=force, **settings)

    def build_inner_graph(self, *inputs: Tensor) -> list[Variable]:
        """Response at the nodes, then one matrix product for each group."""
        log_hoop, log_axial, *rest = inputs
        count = len(rest) - len(self.strain_energy.entry_names)
        matrices, entries = rest[:count], rest[count:]
        log_hoop, log_axial, *entries = pt.broadcast_arrays(log_hoop, log_axial, *entries)
        stress = response(self.strain_energy, log_hoop, log_axial, entries, force=self.force)
        # A row times the transposed matrix: a batch of rows keeps its order in memory.
        row = stress[..., None, :]
        return [(row @ matrix.swapaxes(-1, -2)).squeeze(-2) for matrix in matrices]


_vectorize_node.register(CollocatedIntegral)(broadcast_batches)


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
