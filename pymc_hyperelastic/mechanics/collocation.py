"""The integrals over the wall as constant matrices, for tubes with known radii and geometry.

Pressure, stiffness and axial force are linear in the response of the material: they are constant
matrices times the responses ``g`` at ``K`` nodes in the walls, which a basis chooses. A QR
factorisation reduces the squared misfit of any number of points to that of ``K`` numbers.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytensor.tensor as pt
from pytensor.graph.basic import Variable
from pytensor.tensor.variable import TensorVariable as Tensor

from pymc_hyperelastic.mechanics.interpolation import (
    Array,
    ChebyshevNodes,
    Group,
    Interpolation,
    KnownTubes,
    Points,
)
from pymc_hyperelastic.mechanics.selected_nodes import SelectedNodes
from pymc_hyperelastic.mechanics.wall import PIECE, TubeOp, response

Basis = ChebyshevNodes | SelectedNodes


class CollocatedIntegral(TubeOp):
    r"""Integrals over the walls of known tubes: constant matrices times the wall's response.

    .. math:: I_{gj} = \sum_k M_{gjk} T(\ln λ_θ^{(gk)}, \ln λ_z^{(gk)})

    Inputs are ``ln λθ`` and ``ln λz`` at the nodes (group, node), any number of matrices
    (group, row, node), then the parameters in the order of the strain energy, vectors entry by
    entry; parameters broadcast against the nodes. For each matrix there is an output (group, row).

    Attributes
    ----------
    force : bool
        If True, the response is that of the axial force, else that of the pressure.
    """

    __props__ = ("strain_energy", "force")

    def build_inner_graph(self, *inputs: Tensor) -> list[Variable]:
        """Response at the nodes, then one matrix product for each group."""
        first = len(inputs) - len(self.strain_energy.entry_names)
        matrices = inputs[2:first]
        log_hoop, log_axial, *entries = pt.broadcast_arrays(*inputs[:2], *inputs[first:])
        stress = response(self.strain_energy, log_hoop, log_axial, entries, force=self.force)
        # A row times the transposed matrix: a batch of rows keeps its order in memory.
        row = stress[..., None, :]
        return [(row @ matrix.swapaxes(-1, -2)).squeeze(-2) for matrix in matrices]


def collocate(
    tubes: KnownTubes,
    groups: Sequence[Group],
    curves: Mapping[str, Array],
    targets: Mapping[str, Array],
) -> dict[str, Any]:
    """Return matrices of :func:`curve_matrices`, compressed against the measured values.

    With a QR factorisation ``[M y] = Q [R c; 0 ρ]`` of a group, ``|M g − y|² = |R g − c|² + ρ²``
    for every response ``g``. The `targets` are the measured values at each point, or NaN:
    ``"pressure"`` (kPa), ``"slope"`` (kPa/mm, by the radius that was measured), ``"force"`` (mN).
    Each is compressed separately, so that their weights may be unknown.

    The result holds ``log_hoop`` and ``log_axial`` (group, node), and for each target the
    ``_matrix`` (group, row, node), ``_target`` (group, row) and ``_residual`` (the sum of all
    ``ρ²``). There are as many rows as nodes, or as points if these are fewer.
    """
    count = curves["log_hoop"].shape[1]
    found: dict[str, Any] = {name: curves[name] for name in ("log_hoop", "log_axial")}
    for name, target in targets.items():
        matrix = curves["stiffness_matrix" if name == "slope" else f"{name}_matrix"]
        most = min(count, matrix.shape[1])
        compressed = np.zeros((len(groups), most, count + 1))
        residual = 0.0
        for group, of_group, block in zip(groups, matrix, compressed, strict=True):
            rows = np.column_stack([of_group[: len(group.points)], target[group.points]])
            if name == "slope":
                rows[:, :-1] *= tubes.growth[group.points, None]
            rows, rest = compressed_rows(rows[~np.isnan(rows[:, -1])])
            residual += rest
            block[: len(rows)] = rows
        found[f"{name}_matrix"] = compressed[..., :-1]
        found[f"{name}_target"] = compressed[..., -1]
        found[f"{name}_residual"] = np.array(residual)
    return found


def compressed_rows(rows: Array) -> tuple[Array, float]:
    """Return ``[R c]`` and ``ρ²`` of the rows ``[M y]``, see :func:`collocate`; few rows stay."""
    count = rows.shape[1] - 1
    if len(rows) <= count:
        return rows, 0.0
    rows = np.linalg.qr(rows, mode="r")
    return rows[:count], float(rows[count, -1] ** 2)


def curve_matrices(
    tubes: KnownTubes, groups: Sequence[Group], basis: Basis
) -> tuple[dict[str, Array], Points]:
    """Return matrices of :class:`CollocatedIntegral` for the points themselves, uncompressed.

    Groups are padded to the same number of rows and nodes: a node is repeated, with a weight of 0.
    With the matrices come the places of the points among all rows, group by group. Slopes are by
    the internal radius.
    """
    interpolations = [basis.interpolation(tubes, group) for group in groups]
    most = max(len(group.points) for group in groups)
    count = max(len(interpolation.places[0]) for interpolation in interpolations)
    names = ("pressure", "stiffness", "force", "force_slope")
    found = {f"{name}_matrix": np.zeros((len(groups), most, count)) for name in names}
    found |= {name: np.zeros((len(groups), count)) for name in ("log_hoop", "log_axial")}
    place = np.zeros(len(tubes.radius), int)
    for number, (group, interpolation) in enumerate(zip(groups, interpolations, strict=True)):
        place[group.points] = number * most + np.arange(len(group.points))
        matrices = wall_matrices(tubes.at(group.points), interpolation)
        for name in names:
            matrix = matrices[name]
            found[f"{name}_matrix"][number, : len(matrix), : matrix.shape[1]] = matrix
        for name, own in zip(("log_hoop", "log_axial"), interpolation.places, strict=True):
            found[name][number] = np.append(own, np.full(count - len(own), own[0]))
    return found, place


def wall_matrices(tubes: KnownTubes, interpolation: Interpolation) -> dict[str, Array]:
    """Return matrices (point, node) from responses at the nodes to pressures, forces and slopes.

    Besides ``"pressure"`` and ``"force"`` there are ``"stiffness"`` and ``"force_slope"``, by the
    internal radius.
    """
    points = np.arange(len(tubes.radius))
    pieces = max(1, len(points) * len(interpolation.places[0]) // PIECE)
    parts = [_matrices(tubes.at(some), interpolation) for some in np.array_split(points, pieces)]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _matrices(tubes: KnownTubes, interpolation: Interpolation) -> dict[str, Array]:
    """Matrices of :func:`wall_matrices` for some points."""
    rule, log_axial = tubes.quadrature(split=interpolation.split)
    values, slopes = (
        weights.reshape(-1, *rule.log_hoop.shape)
        for weights in interpolation.weights(rule.log_hoop.ravel(), log_axial.ravel())
    )

    def integral(weight: Array, of_nodes: Array) -> Array:
        return np.einsum("nq,knq->nk", weight, of_nodes)

    return {
        "pressure": integral(rule.pressure_weight, values),
        "stiffness": integral(rule.stiffness_weight, slopes / 2 - values),
        "force": integral(rule.force_weight, values),
        "force_slope": np.pi * tubes.radius[:, None] * integral(rule.pressure_weight, slopes),
    }
