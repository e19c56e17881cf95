"""Nodes selected from the quadrature nodes of the walls: discrete empirical interpolation.

All responses of a law are combinations of one or two hundred *snapshots*, the responses of some of
its materials. A QR factorisation with column pivoting selects as many quadrature nodes, at which
the response determines the combination: Z. Drmač and S. Gugercin, SIAM Journal on Scientific
Computing 38 (2016) A631. The forward model uses them where polynomials would need too many nodes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np
from scipy.linalg import qr, solve_triangular

from pymc_hyperelastic.mechanics.interpolation import (
    Array,
    Group,
    Interpolation,
    KnownTubes,
    Points,
    evenly,
    response_function,
)
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.wall import OVERFLOW

# Materials: one array (material) for each entry of the parameters, in the order of the law.
Materials = Sequence[Array]

# Places at which materials are compared: three for each independent response of any law.
COMPARED = 1000
# Fewest nodes of one wall among these: more walls show more of a response than more nodes of each.
_FEWEST_OF_A_WALL = 4
# Quadrature nodes in the walls of a group among which nodes are selected: ten for each of these.
_CANDIDATES = 4000


@dataclass(frozen=True, eq=False)
class SelectedNodes:
    """As many nodes as there are independent responses of a law, selected by pivoted QR."""

    energy: StrainEnergy
    one_by_one: bool
    """True if stress is a sum over the moduli: a snapshot is then the response to one of them."""
    tolerance: float
    """Part of a snapshot, relative to the largest, that the others may leave unexplained."""
    split: bool = False
    """True if walls are split where ``λθ = 1``."""
    with_force: bool = False
    """True if responses of the axial force are snapshots, too."""
    snapshots: Materials = ()
    """Materials whose responses are snapshots."""
    by_stretch: ClassVar[bool] = False
    """False: all tests of a specimen, also at several axial stretches, share their nodes."""

    def with_materials(self, tubes: KnownTubes, materials: Materials) -> "SelectedNodes":
        """Return nodes for these materials, too: their independent responses become snapshots."""
        return self.with_materials_at(self._quadrature_nodes(tubes, COMPARED), materials)

    @np.errstate(all="ignore")  # some of the materials may be impossible
    def with_materials_at(
        self, places: tuple[Array, Array], materials: Materials
    ) -> "SelectedNodes":
        """Return nodes for these materials, too, which are compared at these places."""
        added = _single_moduli(self.energy, materials) if self.one_by_one else [materials]
        parts = [self.snapshots, *added] if self.snapshots else added
        candidates = [np.concatenate(values) for values in zip(*parts, strict=True)]
        with_all = replace(self, snapshots=candidates)
        (responses,) = with_all.responses(*places)
        *_, pivots = _independent(_scaled(responses, _scale(responses)).T, self.tolerance)
        chosen = np.unique(pivots % len(candidates[0]))
        return replace(with_all, snapshots=[values[chosen] for values in candidates])

    def interpolation(self, tubes: KnownTubes, group: Group) -> Interpolation:
        """Select nodes in the walls of the group."""
        return self.interpolation_at(*self._quadrature_nodes(tubes.at(group.points), _CANDIDATES))

    def interpolation_at(self, log_hoop: Array, log_axial: Array) -> Interpolation:
        """Select nodes among these places."""
        return self._at_places(log_hoop.tobytes(), log_axial.tobytes())

    @lru_cache  # the curves, the misfits and the errors of one group ask for the same nodes
    def _at_places(self, log_hoop: bytes, log_axial: bytes) -> Interpolation:
        r"""Interpolate by snapshots between nodes that are selected from these places.

        With the snapshots ``U`` at all places, ``V`` at the nodes and :math:`V = Q R`, a response
        ``g`` is :math:`g(x) = \sum_k D_k(x) g_k` with :math:`D = R^{-1} Q^T U`. Its slope is the
        same with the slopes ``U'`` of the snapshots.
        """
        places = np.frombuffer(log_hoop), np.frombuffer(log_axial)
        (snapshots,) = self.responses(*places)
        scale = _scale(snapshots)
        q_factor, r_factor, nodes = _independent(_scaled(snapshots, scale), self.tolerance)

        def weights(log_hoop: Array, log_axial: Array) -> tuple[Array, Array]:
            both = np.hstack(self.responses(log_hoop, log_axial, slope=True))
            both = solve_triangular(r_factor, q_factor.T @ _scaled(both, scale))
            values, slopes = np.hsplit(both, 2)
            return values, slopes

        return Interpolation((places[0][nodes], places[1][nodes]), weights, self.split)

    def responses(self, log_hoop: Array, log_axial: Array, slope: bool = False) -> list[Array]:
        """Return all snapshots (snapshot, place) and, if asked for, their slopes by ``ln λθ``."""
        columns = [values[:, None] for values in self.snapshots]
        parts = [
            response_function(self.energy, force, slope)(log_hoop[None], log_axial[None], *columns)
            for force in ((False, True) if self.with_force else (False,))
        ]
        # Fibres without a modulus bear nothing, also where their exponential overflows.
        joined = [np.concatenate(of_parts) for of_parts in zip(*parts, strict=True)]
        return [np.where(np.isnan(values), 0.0, values) for values in joined]

    def _quadrature_nodes(self, tubes: KnownTubes, most: int) -> tuple[Array, Array]:
        """Return some of the quadrature nodes in the walls, spread over all stretches."""
        in_order = np.argsort(tubes.log_hoop[0])
        walls = tubes.at(in_order[evenly(len(in_order), most // _FEWEST_OF_A_WALL)])
        rule, log_axial = walls.quadrature(split=self.split)
        some = evenly(rule.log_hoop.shape[1], most // len(walls.radius))
        # A piece of a wall that does not exist has weights of 0.
        exist = (rule.pressure_weight > 0)[:, some]
        return rule.log_hoop[:, some][exist], log_axial[:, some][exist]


def _independent(matrix: Array, tolerance: float) -> tuple[Array, Array, Points]:
    """Return the independent columns of a matrix as ``Q R``, and their places, by pivoting."""
    q_factor, r_factor, pivots = qr(matrix, mode="economic", pivoting=True)
    left = np.abs(np.diag(r_factor))
    count = max(1, int(np.sum(left > tolerance * left[0])))
    if left[0] == 0:  # a matrix of zeros has weights of 0
        r_factor[0, 0] = 1.0
    return q_factor[:, :count], r_factor[:count, :count], pivots[:count]


def _scale(responses: Array) -> Array:
    """Return the largest value of each response; infinite if it is 0 or its square overflows."""
    largest = np.abs(responses).max(axis=1, keepdims=True)
    return np.where((largest > 0) & (largest < OVERFLOW), largest, np.inf)


def _scaled(responses: Array, scale: Array) -> Array:
    """Return responses over their scale; those of an infinite scale become 0."""
    return np.where(scale < np.inf, responses / scale, 0.0)


def _single_moduli(energy: StrainEnergy, materials: Materials) -> list[Materials]:
    """Return the materials with one of their moduli alone, of 1 kPa."""
    is_modulus = [p.unit == "kPa" for p in energy.parameters for _ in range(p.size or 1)]
    return [
        [np.full(len(x), float(i == own)) if is_modulus[i] else x for i, x in enumerate(materials)]
        for own in np.flatnonzero(is_modulus)
    ]
