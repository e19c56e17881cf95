"""Nodes at which a wall's response is known, and what it is between them: Chebyshev stretches."""

from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any, NamedTuple, Protocol

import numpy as np
import pytensor
import pytensor.tensor as pt
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from pymc_hyperelastic.mechanics.axial_force import force_response
from pymc_hyperelastic.mechanics.chebyshev import Array, chebyshev_nodes, value_to_coefficient
from pymc_hyperelastic.mechanics.known_tubes import KnownTubes
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy, elementwise_derivative
from pymc_hyperelastic.mechanics.wall import WallRule, wall_rule

# Chebyshev coefficients of the response below this fraction of the largest are left out. The
# pressure is then right to about 1e-12 of the largest in the data, and rounding is not mistaken
# for signal.
COEFFICIENT_TOLERANCE = 1e-14
MOST_NODES = 64
# Of axial stretches in a grid, and of all its nodes.
_MOST_AXIAL, _MOST_IN_GRID = 32, 1024
# Lines through a grid along which it is known how many nodes the response takes: both edges, on
# which every kink that crosses the grid begins and ends, and as many between.
_LINES = np.cos(np.pi * np.arange(9) / 8)
# Points whose curves are compared with quadrature, and the order of that.
_TRIED, _FINER = 60, 48


class Group(NamedTuple):
    """Points whose walls share their nodes: centre and half width of the logarithms there."""

    points: NDArray[np.intp]
    hoop: tuple[float, float]
    """Of ``ln λθ``."""
    axial: tuple[float, float]
    """Of ``ln λz``; the half width is 0 where all have one axial stretch."""


# From weights of a wall's quadrature (point, node of it) to those of the responses (point, node).
Moments = Callable[[Array], Array]
# From responses at the nodes to what is measured at points: (point, node) each.
Matrices = dict[str, Array]


class Interpolation(Protocol):
    """Responses in the walls of a group by those at its nodes."""

    @property
    def places(self) -> tuple[Array, Array]:
        """``ln λθ`` and ``ln λz`` of the nodes."""

    def matrices(self, tubes: KnownTubes, points: NDArray[np.intp]) -> Matrices:
        """What is measured at some points of the group, by responses at the nodes.

        Besides ``"pressure"`` and ``"force"`` there are ``"stiffness"`` and ``"force_slope"``, by
        the internal radius, and ``"slope"``, by the radius that was measured; these are NaN if
        slopes are not known by the nodes.
        """


def by_moments(tubes: KnownTubes, wall: WallRule, moments: tuple[Moments, Moments]) -> Matrices:
    """Matrices by integrals of the response, and of its slope by ``ln λθ``, over walls."""
    of_response, of_slope = moments
    share = np.reshape(tubes.share, (-1, 1))
    stiffness = of_slope(wall.stiffness_weight) / 2 - of_response(wall.stiffness_weight)
    stiffness *= share
    return {
        "pressure": of_response(wall.pressure_weight),
        "stiffness": stiffness,
        "slope": stiffness * tubes.growth[:, None],
        "force": of_response(wall.force_weight),
        "force_slope": np.pi * share * tubes.radius[:, None] * of_slope(wall.pressure_weight),
    }


class Basis(Protocol):
    """A choice of nodes for any group."""

    def interpolation(self, tubes: KnownTubes, group: Group) -> Interpolation:
        """Nodes of this group, whose points are among those of the tubes."""


class Nodes(NamedTuple):
    """So many Chebyshev stretches: of the hoop stretch, and of the axial one where that varies."""

    hoop: int
    axial: int = 1

    def interpolation(self, tubes: KnownTubes, group: Group) -> "Grid":
        """Stretches that span the walls of the group."""
        return Grid(group, self)


class Grid(NamedTuple):
    """Interpolation between Chebyshev stretches."""

    group: Group
    nodes: Nodes

    @property
    def places(self) -> tuple[Array, Array]:
        """``ln λθ`` and ``ln λz``, those of one axial stretch together."""
        (hoop, hoop_half), (axial, axial_half) = self.group.hoop, self.group.axial
        log_hoop = hoop + hoop_half * chebyshev_nodes(self.nodes.hoop)
        log_axial = axial + axial_half * chebyshev_nodes(self.nodes.axial)
        return np.tile(log_hoop, self.nodes.axial), np.repeat(log_axial, self.nodes.hoop)

    def matrices(self, tubes: KnownTubes, points: NDArray[np.intp]) -> Matrices:
        """Integrals by coefficients of Chebyshev polynomials, and by those of their slopes."""
        own = tubes.at(points)
        wall = wall_rule(np, *own.walls)
        (centre, half), coefficient = self.group.hoop, value_to_coefficient(self.nodes.hoop)
        vandermonde = chebyshev.chebvander((wall.log_hoop - centre) / half, self.nodes.hoop - 1)
        derivative = np.zeros_like(coefficient)
        derivative[:-1] = chebyshev.chebder(coefficient, axis=0) / half
        between = self._between(own.axial_stretch)

        def moments(weight: Array, coefficient: Array) -> Array:
            of_hoop = np.einsum("nq,nqk->nk", weight, vandermonde) @ coefficient
            return (between[:, :, None] * of_hoop[:, None, :]).reshape(len(weight), -1)

        values = partial(moments, coefficient=coefficient)
        slopes = partial(moments, coefficient=derivative)
        return by_moments(own, wall, (values, slopes))

    def _between(self, axial_stretch: Array) -> Array:
        """At the axial stretch of its point, a response by those at the axial stretches."""
        if self.nodes.axial == 1:
            return np.ones((len(axial_stretch), 1))
        centre, half = self.group.axial
        place = (np.log(axial_stretch) - centre) / half
        vandermonde = chebyshev.chebvander(place, self.nodes.axial - 1)
        return vandermonde @ value_to_coefficient(self.nodes.axial)


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
    kinds = (False, True) if with_force else (False,)
    functions = [response_function(energy, force) for force in kinds]
    needed = Nodes(2)

    def along(log_hoop: Array, log_axial: Array) -> Array:
        """Coefficients of responses (draw, line, node) along a last axis, and their largest."""
        hoop, axial = np.broadcast_arrays(log_hoop, log_axial)
        places = hoop.reshape(1, -1), axial.reshape(1, -1)
        with np.errstate(all="ignore"):
            found = [f(*places, *(v.reshape(-1, 1) for v in values))[0] for f in functions]
        response = np.stack([r.reshape(-1, *hoop.shape) for r in found])
        possible = np.isfinite(response).all(axis=(0, 2, 3))
        return np.abs(response[:, possible] @ value_to_coefficient(hoop.shape[-1]).T)

    for group in groups:
        (hoop, hoop_half), (axial, axial_half) = group.hoop, group.axial
        lines = (axial + axial_half * (_LINES if axial_half else np.zeros(1)))[:, None]
        coefficients = along(hoop + hoop_half * chebyshev_nodes(2 * MOST_NODES), lines)
        # Force is a difference of stresses, and known to their rounding.
        smallest = tolerance * np.maximum.accumulate(coefficients.max(axis=(2, 3), keepdims=True))
        needed = needed._replace(hoop=max(needed.hoop, _significant(coefficients, smallest)))
        if axial_half:
            lines = (hoop + hoop_half * _LINES)[:, None]
            across = along(lines, axial + axial_half * chebyshev_nodes(2 * _MOST_AXIAL))
            smallest = tolerance * np.maximum.accumulate(across.max(axis=(2, 3), keepdims=True))
            needed = needed._replace(axial=max(needed.axial, _significant(across, smallest)))
        if (
            needed.hoop > MOST_NODES
            or needed.axial > _MOST_AXIAL
            or (axial_half and needed.hoop * needed.axial > _MOST_IN_GRID)
        ):
            return None
    return needed


def _significant(coefficients: Array, smallest: Array) -> int:
    """How many coefficients there are before all are below the smallest that matters."""
    significant = (coefficients > smallest).any(axis=(0, 1, 2))
    return int(np.flatnonzero(significant).max(initial=0)) + 1


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


@np.errstate(all="ignore")  # some of the materials may be impossible
def curve_errors(
    energy: StrainEnergy,
    basis: Basis,
    tubes: KnownTubes,
    groups: Sequence[Group],
    materials: Sequence[Array],
    *,
    with_force: bool,
) -> Array:
    """Errors of the curves of materials, relative to the largest value of each in its group.

    The largest of them by material, of pressures and forces. They are compared with quadrature.
    Forces are compared with that of the pressure on the lumen, too: they may be nil.
    """
    errors = np.zeros(len(materials[0]))
    entries = [np.reshape(v, (-1, 1)) for v in materials]
    for group in groups:
        interpolation = basis.interpolation(tubes, group)
        points = group.points[evenly(len(group.points), _TRIED)]
        own, matrices = tubes.at(points), interpolation.matrices(tubes, points)
        # What is integrated need not be smooth.
        finer = wall_rule(np, *own.walls, order=_FINER)
        log_axial = np.broadcast_to(np.log(own.axial_stretch)[:, None], finer.log_hoop.shape)
        kinds = [
            (False, matrices["pressure"], finer.pressure_weight),
            (True, matrices["force"], finer.force_weight),
        ]
        least = np.zeros(1)
        for force, matrix, exact_weight in kinds[: 1 + with_force]:
            exact, there = (
                response_function(energy, force)(x[None], z[None], *entries)[0]
                for x, z in ((finer.log_hoop.ravel(), log_axial.ravel()), interpolation.places)
            )
            exact = np.einsum("nq,mnq->mn", exact_weight, exact.reshape(-1, *exact_weight.shape))
            error = np.abs(there @ matrix.T - exact).max(axis=1)
            scale = np.maximum(np.abs(exact).max(axis=1), least)
            least = np.pi * own.radius.max() ** 2 * scale
            errors = np.maximum(errors, error / np.where(scale > 0, scale, 1.0))
    return errors


def evenly(count: int, most: int) -> NDArray[np.intp]:
    """At most so many of the numbers below `count`, evenly spread, the first and last included."""
    return np.unique(np.linspace(0, count - 1, most).round().astype(int))


@cache
def response_function(energy: StrainEnergy, force: bool, slope: bool = False) -> Any:
    """Function of ``ln λθ`` and ``ln λz`` (1, place), and the entries of materials (material, 1).

    It gives the responses of pressure, or of the axial force, and their slopes by ``ln λθ``.
    """
    log_hoop = pt.tensor("log_hoop", dtype="float64", shape=(1, None))
    log_axial = pt.tensor("log_axial", dtype="float64", shape=(1, None))
    entries = [pt.tensor(n, dtype="float64", shape=(None, 1)) for n in energy.entry_names]
    hoop, axial, *full = pt.broadcast_arrays(log_hoop, log_axial, *entries)
    if force:
        response = force_response(energy, hoop, axial, full)
    else:
        response = energy.stress_difference(hoop, axial, **energy.join(full))
    outputs = [response, *([elementwise_derivative(response, hoop)] if slope else [])]
    return pytensor.function([log_hoop, log_axial, *entries], outputs, mode="FAST_COMPILE")
