"""Nodes that a law itself asks for: empirical interpolation of its responses.

Laws of fibres stiffen by orders of magnitude, and polynomials take thousands of stretches to follow
them where both stretches vary. All responses of such a law are nevertheless combinations of one or
two hundred: those of some of its materials, the snapshots, which need be known at as many places
of the walls alone.

References
----------
M. Barrault, Y. Maday, N. C. Nguyen and A. T. Patera, An 'empirical interpolation' method, Comptes
Rendus Mathematique 339 (2004) 667. Nodes by a factorisation with pivots: Z. Drmač and S. Gugercin,
A new selection operator for the discrete empirical interpolation method, SIAM Journal on Scientific
Computing 38 (2016) A631.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular

from pymc_hyperelastic.mechanics.interpolation import (
    Group,
    Matrices,
    Moments,
    by_moments,
    curve_errors,
    evenly,
    response_function,
)
from pymc_hyperelastic.mechanics.known_tubes import KnownTubes
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.wall import wall_rule

Array = NDArray[np.float64]
# Materials, their entries in the order of the law, (material) each.
Materials = Sequence[Array]

# What is left of a snapshot that the others do not explain, relative to the largest: less is
# rounding.
_INDEPENDENT = 3e-12
# Places in the walls of a group among which nodes are chosen, at most, and in those of all groups
# together those among which snapshots are; combinations of as many responses or places by which
# nodes, or snapshots, are told apart; groups that are looked at.
_MOST_PLACES, _COMBINATIONS, _MOST_GROUPS = 4000, 400, 3
# What curves may err, relative to their largest value, and how often snapshots are added until
# they do not. A few materials among those that are tried may err more, but not visibly: fibres that
# stiffen by orders of magnitude within a hundredth of a wall, which hardly any test shows. Or more
# of them, if none errs by more than the last number: there quadrature is no better.
TOLERANCE, _VISIBLE, _FEW, _ALL = 1e-9, 1e-3, 1 / 200, 1e-7
_MOST_ROUNDS = 4
_EVENLY = 2
_LARGEST = 1e100
# What is left of the response of a material by few nodes, relative to its largest value, is what
# curves may err by these. Materials whose responses are so many times the median's do not count.
_INDEPENDENT_NEAR, _FAR_LARGER = 1e-8, 1e3
# Walls of which nodes are kept.
_REMEMBERED = 8


@dataclass(frozen=True, eq=False)
class EmpiricalNodes:
    """As many nodes as responses of a law are independent, where they differ most.

    Attributes
    ----------
    energy : StrainEnergy
        The law.
    of_stress, of_force : sequence of array, shape (snapshot)
        Entries of the materials whose responses ``T``, and those of the axial force, the others
        are combined of.
    """

    energy: StrainEnergy
    of_stress: Materials
    of_force: Materials

    def interpolation(self, tubes: KnownTubes, group: Group) -> "EmpiricalInterpolation":
        """Nodes in the walls of the group."""
        log_hoop, log_axial = _places(tubes, group, _MOST_PLACES)
        return self._at_places(log_hoop.tobytes(), log_axial.tobytes())

    # Curves are asked for, and then how right they are.
    @lru_cache(maxsize=_REMEMBERED)
    def _at_places(self, log_hoop: bytes, log_axial: bytes) -> "EmpiricalInterpolation":
        places = np.frombuffer(log_hoop), np.frombuffer(log_axial)
        (snapshots,) = self.responses(*places)
        scale = np.abs(snapshots).max(axis=1, keepdims=True)
        known = (scale[:, 0] < _LARGEST) & (scale[:, 0] > 0)
        snapshots, scale = snapshots[known], scale[known]
        basis, triangle, chosen = qr(snapshots / scale, mode="economic", pivoting=True)
        size = np.abs(np.diag(triangle))
        count = int(np.sum(size > _INDEPENDENT * size[0]))
        nodes = chosen[:count]
        return EmpiricalInterpolation(
            self,
            known,
            (places[0][nodes], places[1][nodes]),
            scale,
            basis[:, :count],
            triangle[:count, :count],
        )

    def responses(self, log_hoop: Array, log_axial: Array, slope: bool = False) -> list[Array]:
        """All snapshots (snapshot, place) and, if asked for, their slopes by ``ln λθ``."""
        parts = [
            response_function(self.energy, force, slope)(
                log_hoop[None], log_axial[None], *_columns(materials)
            )
            for force, materials in ((False, self.of_stress), (True, self.of_force))
            if len(materials[0])
        ]
        joined = [np.concatenate(of_parts) for of_parts in zip(*parts, strict=True)]
        # Fibres without a modulus bear nothing, also where their exponential overflows.
        return [np.where(np.isnan(values), 0.0, values) for values in joined]


class EmpiricalInterpolation(NamedTuple):
    r"""Responses in the walls of a group by those at its nodes.

    With the snapshots ``U`` at all places, ``V`` at the nodes and :math:`V = Q R`, a response
    ``g`` is :math:`g(x) = \sum_k D_k(x) g_k` with :math:`D = R^{-1} Q^T U`.
    """

    nodes: EmpiricalNodes
    known: NDArray[np.bool_]
    places: tuple[Array, Array]
    scale: Array
    basis: Array
    triangle: Array

    def matrices(self, tubes: KnownTubes, points: NDArray[np.intp]) -> Matrices:
        """Integrals of the response, and of its slope by ``ln λθ``, by responses at the nodes."""
        own = tubes.at(points)
        wall = wall_rule(np, *own.walls)
        there = wall.pressure_weight > 0
        log_axial = np.broadcast_to(np.log(own.axial_stretch)[:, None], wall.log_hoop.shape)
        # Parts without thickness are anywhere where responses are known.
        log_hoop, log_axial = (
            np.where(there, x, known[0])
            for x, known in zip((wall.log_hoop, log_axial), self.places, strict=True)
        )
        both = self.nodes.responses(log_hoop.ravel(), log_axial.ravel(), slope=True)

        def by_nodes(snapshots: Array) -> Moments:
            weights = solve_triangular(
                self.triangle, self.basis.T @ (snapshots[self.known] / self.scale)
            )
            weights = weights.reshape(-1, *wall.log_hoop.shape)
            return lambda weight: np.einsum("nq,knq->nk", weight, weights)

        values, slopes = map(by_nodes, both)
        return by_moments(own, wall, (values, slopes))


def fewer_nodes(
    energy: StrainEnergy, places: tuple[Array, Array], materials: Materials, *, with_force: bool
) -> tuple[NDArray[np.intp], Array]:
    r"""Some of the places by whose responses those at all of them are known, of some materials.

    Of the materials of a prior far fewer responses are independent than of all that a law has.

    Parameters
    ----------
    energy : StrainEnergy
        The law.
    places : tuple of array, shape (place)
        ``ln λθ`` and ``ln λz``.
    materials : sequence of array, shape (material)
        Their entries, in the order of the law. Those whose responses are far larger than most are
        not learned from.
    with_force : bool
        Whether the response of the axial force is to be known, too.

    Returns
    -------
    nodes : array of int, shape (node)
        Which of the places are nodes.
    weights : array, shape (node, place)
        :math:`D` by which :math:`g(x) = \sum_k g_k D_k(x)`.
    """
    kinds = (False, True) if with_force else (False,)
    columns = _columns(materials)
    with np.errstate(all="ignore"):
        of_kinds = [
            response_function(energy, force)(places[0][None], places[1][None], *columns)[0]
            for force in kinds
        ]
        size = np.max([np.abs(response).max(axis=1) for response in of_kinds], axis=0)
        usual = np.nanmedian(size) if np.isfinite(size).any() else 0.0
        known = (size > 0) & (size < _FAR_LARGER * usual)
    if not known.any():
        # Nothing is learned of responses that all overflow.
        return np.arange(len(places[0])), np.eye(len(places[0]))
    responses = np.concatenate([r[known] / size[known, None] for r in of_kinds])
    triangle, pivots = qr(_mixed(responses), mode="r", pivoting=True)
    left = np.abs(np.diag(triangle))
    count = int(np.sum(left > _INDEPENDENT_NEAR * left[0]))
    weights = np.empty((count, len(pivots)))
    weights[:, pivots] = solve_triangular(triangle[:count, :count], triangle[:count])
    return pivots[:count], weights


def empirical_nodes(
    energy: StrainEnergy,
    tubes: KnownTubes,
    groups: Sequence[Group],
    draw: Callable[[], Materials],
    *,
    with_force: bool,
    known: Materials = (),
) -> EmpiricalNodes | None:
    """Nodes by which curves of all materials that are drawn are right; None if that fails.

    The stress of the law must be a sum over its moduli: snapshots are responses to one of them
    alone. Those are added by which curves of others, drawn afresh, are not right yet. Curves of
    materials that are `known` to matter are right in any case.
    """
    some = [groups[i] for i in evenly(len(groups), _MOST_GROUPS)]
    # Of each group those that matter there: beside the stiffest walls all others look alike.
    places = [[x[None] for x in _places(tubes, group, _MOST_PLACES // len(some))] for group in some]
    kinds = (False, True) if with_force else (False,)
    snapshots = {force: _none(energy) for force in (False, True)}
    known = known or _none(energy)
    learn_from = _joined([_spread(draw()), known])
    for _ in range(_MOST_ROUNDS):
        of_one = _one_by_one(energy, learn_from)
        candidates = {force: _joined([snapshots[force], *of_one]) for force in kinds}
        chosen = [_independent(energy, of_group, candidates) for of_group in places]
        for force in kinds:
            both = np.array(_joined([of_group[force] for of_group in chosen]))
            snapshots[force] = [*np.unique(both, axis=1)]
        nodes = EmpiricalNodes(energy, snapshots[False], snapshots[True])
        others = _joined([draw(), known])
        errors = curve_errors(energy, nodes, tubes, some, others, with_force=with_force)
        wrong, drawn = errors > TOLERANCE, len(errors) - len(known[0])
        few = wrong[:drawn].mean() <= _FEW and errors.max() < _VISIBLE
        if (few or errors.max() < _ALL) and not wrong[drawn:].any():
            return nodes
        learn_from = [v[wrong] for v in others]
    return None


def _independent(
    energy: StrainEnergy, places: Sequence[Array], candidates: Mapping[bool, Materials]
) -> dict[bool, Materials]:
    """Materials of whose stresses and axial forces those of all candidates are combinations."""
    of_kinds, columns = [], []
    for force, materials in candidates.items():
        of_all = response_function(energy, force)(*places, *_columns(materials))[0]
        size = np.abs(of_all).max(axis=1)
        known = np.flatnonzero((size < _LARGEST) & (size > 0))
        columns.append(_mixed((of_all[known] / size[known, None]).T))
        of_kinds += [(force, row) for row in known]
    triangle, pivots = qr(np.concatenate(columns, axis=1), mode="r", pivoting=True)
    left = np.abs(np.diag(triangle))
    chosen = [of_kinds[pivot] for pivot in pivots[: np.sum(left > _INDEPENDENT * left[0])]]
    rows = {kind: [row for of, row in chosen if of == kind] for kind in candidates}
    return {kind: [v[rows[kind]] for v in candidates[kind]] for kind in candidates}


def _mixed(rows: Array) -> Array:
    """Random combinations of the rows, by which columns are told apart, if these are fewer."""
    if len(rows) <= _COMBINATIONS:
        return rows
    return np.random.default_rng(1).standard_normal((_COMBINATIONS, len(rows))) @ rows


def _spread(materials: Materials) -> Materials:
    """The materials, and as many evenly over the box that holds them: few are near its corners."""
    rng, spread = np.random.default_rng(1), []
    for values in materials:
        # What is always positive may be of any order of magnitude.
        low, high = np.log([values.min(), values.max()]) if values.min() > 0 else (0, 0)
        even = np.exp(rng.uniform(low, high, _EVENLY * len(values)))
        if values.min() <= 0:
            even = rng.uniform(values.min(), values.max(), len(even))
        spread.append(np.concatenate([values, even]))
    return spread


def _one_by_one(energy: StrainEnergy, materials: Materials) -> list[Materials]:
    """The materials with one of their moduli alone, of 1 kPa."""
    is_modulus = [p.unit == "kPa" for p in energy.parameters for _ in range(p.size or 1)]
    count = len(materials[0])
    return [
        [
            np.full(count, float(place == own)) if modulus else values
            for place, (values, modulus) in enumerate(zip(materials, is_modulus, strict=True))
        ]
        for own in np.flatnonzero(is_modulus)
    ]


def _places(tubes: KnownTubes, group: Group, most: int) -> tuple[Array, Array]:
    """``ln λθ`` and ``ln λz`` of so many places in the walls of a group, both faces included."""
    own = tubes.at(group.points)
    thick = np.flatnonzero(own.outer_radius > own.inner_radius)
    # Where no wall has a part that counts, nothing is integrated: any place will do.
    own = own.at(thick) if thick.size else own
    own = own.at(evenly(len(own.radius), most // 4))
    log_hoop = wall_rule(np, *own.walls).log_hoop
    log_hoop = log_hoop[:, evenly(log_hoop.shape[1], most // len(log_hoop))]
    log_axial = np.broadcast_to(np.log(own.axial_stretch)[:, None], log_hoop.shape)
    return log_hoop.ravel(), log_axial.ravel()


def _columns(materials: Materials) -> list[Array]:
    return [np.reshape(v, (-1, 1)) for v in materials]


def _joined(parts: Sequence[Materials]) -> Materials:
    return [np.concatenate(values) for values in zip(*parts, strict=True)]


def _none(energy: StrainEnergy) -> Materials:
    return [np.empty(0) for _ in energy.entry_names]
