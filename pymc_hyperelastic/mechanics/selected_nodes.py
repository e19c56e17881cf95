"""Nodes selected from the quadrature nodes of the walls: discrete empirical interpolation.

Laws of fibres stiffen by orders of magnitude, and polynomials need thousands of nodes to follow
them where both stretches vary. All responses of such a law are nevertheless combinations of one or
two hundred *snapshots*, the responses of some of its materials. A QR factorisation with column
pivoting selects as many quadrature nodes, at which the response determines the combination.

References
----------
M. Barrault, Y. Maday, N. C. Nguyen and A. T. Patera, An 'empirical interpolation' method, Comptes
Rendus Mathematique 339 (2004) 667. Nodes by a factorisation with pivots: Z. Drmač and S. Gugercin,
A new selection operator for the discrete empirical interpolation method, SIAM Journal on Scientific
Computing 38 (2016) A631.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular

from pymc_hyperelastic.mechanics.interpolation import evenly, response_function
from pymc_hyperelastic.mechanics.known_tubes import Group, KnownTubes
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy

Array = NDArray[np.float64]
# Materials: one array (material) for each entry of the parameters, in the order of the law.
Materials = Sequence[Array]

# Quadrature nodes in a wall. Thin walls of arteries need 12; the error of the curves is checked.
_ORDER = 16
# Largest number of quadrature nodes of a group among which nodes are selected: bounds the time of
# the factorisation, and leaves ten for each node that is selected.
_MOST_CANDIDATES = 4000
# Random combinations of responses that are factorised in place of all responses: more than the
# number of independent responses of any law, which is below 300.
_COMBINATIONS = 400
# Groups in whose walls snapshots are selected.
_MOST_GROUPS = 3
# kPa: responses beyond it are left out, because their squares overflow.
_LARGEST = 1e100
# Groups whose nodes are kept: the curves, the misfits and the errors of one group ask for them.
_CACHED_GROUPS = 8


@dataclass(frozen=True, eq=False)
class SelectedNodes:
    """As many nodes as there are independent responses of a law, selected by pivoted QR.

    Attributes
    ----------
    energy : StrainEnergy
        The law.
    one_by_one : bool
        Whether stress is a sum over the moduli, so that a snapshot is the response to one of them.
    tolerance : float
        Part of a snapshot that the others do not explain, relative to the largest, below which it
        is left out.
    split : bool
        Whether walls are split where ``λθ = 1``.
    of_stress, of_force : sequence of array, shape (snapshot)
        Materials whose responses of pressure, and of axial force, are snapshots.
    by_stretch : bool
        False: all tests of a specimen, also at several axial stretches, share their nodes.
    """

    energy: StrainEnergy
    one_by_one: bool
    tolerance: float
    split: bool = False
    of_stress: Materials = ()
    of_force: Materials = ()
    by_stretch: bool = False

    def with_materials(
        self, tubes: KnownTubes, groups: Sequence[Group], materials: Materials, *, with_force: bool
    ) -> "SelectedNodes":
        """Return nodes for these materials, too: their independent responses become snapshots."""
        added = _single_moduli(self.energy, materials) if self.one_by_one else [materials]
        kinds = (False, True) if with_force else (False,)
        snapshots = {False: self.of_stress, True: self.of_force}
        candidates = {
            force: _joined([*([snapshots[force]] if snapshots[force] else []), *added])
            for force in kinds
        }
        some = [groups[i] for i in evenly(len(groups), _MOST_GROUPS)]
        chosen = []
        for group in some:
            places = self._candidates(tubes, group, _MOST_CANDIDATES // len(some))
            chosen.append(_independent(self.energy, places, candidates, self.tolerance))
        for force in kinds:
            both = np.array(_joined([of_group[force] for of_group in chosen]))
            snapshots[force] = [*np.unique(both, axis=1)]
        return replace(self, of_stress=snapshots[False], of_force=snapshots[True])

    def interpolation(self, tubes: KnownTubes, group: Group) -> "SnapshotInterpolation":
        """Select nodes in the walls of the group."""
        log_hoop, log_axial = self._candidates(tubes, group, _MOST_CANDIDATES)
        return self._at_places(log_hoop.tobytes(), log_axial.tobytes())

    @lru_cache(maxsize=_CACHED_GROUPS)
    def _at_places(self, log_hoop: bytes, log_axial: bytes) -> "SnapshotInterpolation":
        places = np.frombuffer(log_hoop), np.frombuffer(log_axial)
        (snapshots,) = self.responses(*places)
        scale = np.abs(snapshots).max(axis=1, keepdims=True)
        kept = (scale[:, 0] < _LARGEST) & (scale[:, 0] > 0)
        snapshots, scale = snapshots[kept], scale[kept]
        basis, triangle, pivots = qr(snapshots / scale, mode="economic", pivoting=True)
        size = np.abs(np.diag(triangle))
        count = int(np.sum(size > self.tolerance * size[0])) if size.size else 0
        nodes = pivots[:count] if count else pivots[:1]
        return SnapshotInterpolation(
            self,
            (places[0][nodes], places[1][nodes]),
            _ORDER,
            self.split,
            kept,
            scale,
            basis[:, :count],
            triangle[:count, :count],
        )

    def responses(self, log_hoop: Array, log_axial: Array, slope: bool = False) -> list[Array]:
        """Return all snapshots (snapshot, place) and, if asked for, their slopes by ``ln λθ``."""
        parts = [
            response_function(self.energy, force, slope)(
                log_hoop[None], log_axial[None], *_columns(materials)
            )
            for force, materials in ((False, self.of_stress), (True, self.of_force))
            if materials and len(materials[0])
        ]
        joined = [np.concatenate(of_parts) for of_parts in zip(*parts, strict=True)]
        # Fibres without a modulus bear nothing, also where their exponential overflows.
        return [np.where(np.isnan(values), 0.0, values) for values in joined]

    def _candidates(self, tubes: KnownTubes, group: Group, most: int) -> tuple[Array, Array]:
        """Return at most `most` quadrature nodes in the walls of a group."""
        own = tubes.at(group.points)
        own = own.at(evenly(len(own.radius), most // 4))
        rule, log_axial = own.quadrature(_ORDER, split=self.split)
        some = evenly(rule.log_hoop.shape[1], most // len(rule.log_hoop))
        counts = (rule.pressure_weight > 0)[:, some]
        return rule.log_hoop[:, some][counts], log_axial[:, some][counts]


class SnapshotInterpolation(NamedTuple):
    r"""Interpolation of responses in the walls of a group by snapshots.

    With the snapshots ``U`` at all places, ``V`` at the nodes and :math:`V = Q R`, a response
    ``g`` is :math:`g(x) = \sum_k D_k(x) g_k` with :math:`D = R^{-1} Q^T U`. Its slope is the same
    with the slopes ``U'`` of the snapshots.
    """

    nodes: SelectedNodes
    places: tuple[Array, Array]
    order: int
    split: bool
    kept: NDArray[np.bool_]
    scale: Array
    basis: Array
    triangle: Array

    def weights(self, log_hoop: Array, log_axial: Array) -> tuple[Array, Array]:
        """Return the weights (node, place) of the response, and of its derivative by ``ln λθ``."""
        if not self.triangle.size:
            return np.zeros((1, len(log_hoop))), np.zeros((1, len(log_hoop)))
        values, slopes = (
            solve_triangular(self.triangle, self.basis.T @ (snapshots[self.kept] / self.scale))
            for snapshots in self.nodes.responses(log_hoop, log_axial, slope=True)
        )
        return values, slopes


@np.errstate(all="ignore")  # some of the materials may be impossible
def _independent(
    energy: StrainEnergy,
    places: tuple[Array, Array],
    candidates: dict[bool, Materials],
    tolerance: float,
) -> dict[bool, Materials]:
    """Return materials whose responses span those of all candidates, by kind of response."""
    of_kinds, columns = [], []
    for force, materials in candidates.items():
        function = response_function(energy, force)
        of_all = function(*(x[None] for x in places), *_columns(materials))[0]
        size = np.abs(of_all).max(axis=1)
        kept = np.flatnonzero((size < _LARGEST) & (size > 0))
        columns.append(_combined((of_all[kept] / size[kept, None]).T))
        of_kinds += [(force, row) for row in kept]
    triangle, pivots = qr(np.concatenate(columns, axis=1), mode="r", pivoting=True)
    left = np.abs(np.diag(triangle))
    count = np.sum(left > tolerance * left.max(initial=0.0))
    chosen = [of_kinds[pivot] for pivot in pivots[:count]]
    rows = {kind: [row for of, row in chosen if of == kind] for kind in candidates}
    return {kind: [v[rows[kind]] for v in candidates[kind]] for kind in candidates}


def _combined(rows: Array) -> Array:
    """Return random combinations of the rows, if these are fewer."""
    if len(rows) <= _COMBINATIONS:
        return rows
    return np.random.default_rng(1).standard_normal((_COMBINATIONS, len(rows))) @ rows


def _single_moduli(energy: StrainEnergy, materials: Materials) -> list[Materials]:
    """Return the materials with one of their moduli alone, of 1 kPa."""
    is_modulus = [p.unit == "kPa" for p in energy.parameters for _ in range(p.size or 1)]
    count = len(materials[0])
    return [
        [
            np.full(count, float(place == own)) if modulus else values
            for place, (values, modulus) in enumerate(zip(materials, is_modulus, strict=True))
        ]
        for own in np.flatnonzero(is_modulus)
    ]


def _columns(materials: Materials) -> list[Array]:
    return [np.reshape(values, (-1, 1)) for values in materials]


def _joined(parts: Sequence[Materials]) -> Materials:
    return [np.concatenate(values) for values in zip(*parts, strict=True)]
