"""Interpolation of the response in walls of known tubes, and Chebyshev nodes in ``ln λθ``.

A basis chooses nodes in the walls of a group of points, and gives the weights with which responses
at the nodes determine the response anywhere in these walls.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any, ClassVar, NamedTuple

import numpy as np
import pytensor
import pytensor.tensor as pt
from numpy.polynomial.chebyshev import chebder, chebpts1, chebvander
from numpy.typing import NDArray
from scipy.fft import dct

from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy, elementwise_derivative
from pymc_hyperelastic.mechanics.tube import UNLOADED, stretches
from pymc_hyperelastic.mechanics.wall import WALL_ORDER, WallRule, response, wall_rule

Array = NDArray[np.float64]
Points = NDArray[np.intp]

# Logarithmic strain below which no test can distinguish stretches: the smallest half width of a
# range of ln λθ. No law overflows at this strain.
SMALL_STRAIN = 1e-3


class KnownTubes(NamedTuple):
    """Tubes with known radii and reference geometry: one entry per measured point."""

    radius: Array
    """Current internal radius, mm."""
    inner_radius: Array
    outer_radius: Array
    axial_stretch: Array
    opening_angle: Array
    growth: Array
    """Derivative of the current internal radius by the radius that was measured."""

    def at(self, points: NDArray) -> "KnownTubes":
        """Return the tubes at some of the points."""
        return KnownTubes(*(values[points] for values in self))

    @property
    def log_hoop(self) -> tuple[Array, Array]:
        """``ln λθ`` at the inner and at the outer face; it is monotonic between them."""
        tube = {name: getattr(self, name) for name in UNLOADED}
        faces = np.stack([self.inner_radius, self.outer_radius])
        inner, outer = np.log(stretches(faces, self.radius, **tube)[1])
        return inner, outer

    def quadrature(self, *, split: bool = False) -> tuple[WallRule, Array]:
        """Return the quadrature rule of each wall, and ``ln λz`` of its nodes (point, node).

        With `split` the rule is split where ``λθ = 1``, if any of the walls holds this stretch:
        fibres in the hoop direction slacken there.
        """
        inner, outer = self.log_hoop
        kinks = [np.zeros(())] if split and np.any((inner < 0) != (outer < 0)) else []
        rule = wall_rule(np, [values[:, None] for values in self[:5]], kinks=kinks)
        log_axial = np.broadcast_to(np.log(self.axial_stretch)[:, None], rule.log_hoop.shape)
        return rule, log_axial


class Group(NamedTuple):
    """Points whose walls share the nodes of a basis."""

    points: Points
    hoop: tuple[float, float]
    """Centre and half width of the range of ``ln λθ`` in the walls."""


def groups_by(tubes: KnownTubes, key: NDArray) -> list[Group]:
    """Return groups of the points that have the same `key`."""
    groups = []
    for value in np.unique(key):
        own = np.flatnonzero(key == value)
        log_hoop = tubes.at(own).log_hoop
        # A range of one stretch is widened, so that a polynomial can be differentiated there.
        half = max(float(np.ptp(log_hoop)) / 2, SMALL_STRAIN)
        groups.append(Group(own, (float(np.min(log_hoop)) + half, half)))
    return groups


class Interpolation(NamedTuple):
    """Nodes of a group of walls, and the responses in these walls from those at the nodes."""

    places: tuple[Array, Array]
    """``ln λθ`` and ``ln λz`` of the nodes."""
    weights: Callable[[Array, Array], tuple[Array, Array]]
    """Weights (node, place) of the response at given places, and of its derivative by ``ln λθ``."""
    split: bool = False
    """True if quadrature of the walls is split where ``λθ = 1``."""


@dataclass(frozen=True)
class ChebyshevNodes:
    """A number of Chebyshev points in ``ln λθ``, for walls at one axial stretch."""

    nodes: int
    by_stretch: ClassVar[bool] = True
    """True: all walls of a group must have one axial stretch."""

    def interpolation(self, tubes: KnownTubes, group: Group) -> Interpolation:
        """Return nodes that span the stretches in the walls of the group."""
        centre, half = group.hoop
        log_axial = np.full(self.nodes, np.log(tubes.axial_stretch[group.points[0]]))
        coefficient = _value_to_coefficient(self.nodes)
        derivative = chebder(coefficient, axis=0) / half

        def weights(log_hoop: Array, _: Array) -> tuple[Array, Array]:
            vandermonde = chebvander((log_hoop - centre) / half, self.nodes - 1)
            return (vandermonde @ coefficient).T, (vandermonde[:, :-1] @ derivative).T

        return Interpolation((centre + half * chebpts1(self.nodes), log_axial), weights)


@cache
def _value_to_coefficient(count: int) -> Array:
    """Matrix from values at the Chebyshev points, rising, to coefficients; exact to rounding."""
    coefficients = dct(np.eye(count)[::-1], axis=0) / count
    coefficients[0] /= 2
    return coefficients


@np.errstate(all="ignore")  # some of the materials may be impossible
def nodes_needed(
    energy: StrainEnergy,
    tubes: KnownTubes,
    groups: Sequence[Group],
    materials: Sequence[Array],
    *,
    with_force: bool = False,
    tolerance: float = 1e-14,
) -> int | None:
    """Return how many Chebyshev nodes the responses need, or None if they are more than 64.

    Quadrature of the walls is about as fast as 64 nodes, twice its own number. Needed are all
    coefficients up to the last one that exceeds the `tolerance`, relative to the largest, for any
    of the `materials`: one array for each entry of the parameters. With the default tolerance the
    pressure is exact to about 1e-12 of its largest value, and rounding errors do not count.
    """
    kinds = (False, True) if with_force else (False,)
    columns = [values.reshape(-1, 1) for values in materials]
    most, needed = 2 * WALL_ORDER, 2
    for group in groups:
        nodes = [x[None] for x in ChebyshevNodes(2 * most).interpolation(tubes, group).places]
        values = np.stack([response_function(energy, f)(*nodes, *columns)[0] for f in kinds])
        possible = np.isfinite(values).all(axis=(0, 2))
        coefficients = np.abs(values[:, possible] @ _value_to_coefficient(2 * most).T)
        # Forces are differences of stresses, and have the rounding errors of these.
        largest = np.maximum.accumulate(coefficients.max(axis=2, keepdims=True))
        significant = (coefficients > tolerance * largest).any(axis=(0, 1))
        needed = max(needed, int(np.flatnonzero(significant).max(initial=0)) + 1)
        if needed > most:
            return None
    return needed


def evenly(count: int, most: int) -> Points:
    """Return at most `most` of the numbers below `count`, evenly spread, both ends included."""
    return np.unique(np.linspace(0, count - 1, most).round().astype(int))


@lru_cache
def response_function(energy: StrainEnergy, force: bool, slope: bool = False) -> Any:
    """Compile :func:`response` and, with `slope`, its derivative by ``ln λθ``.

    The function takes ``ln λθ`` and ``ln λz`` (1, place), and the entries of materials
    (material, 1).
    """
    log_hoop, log_axial = (pt.tensor(dtype="float64", shape=(1, None)) for _ in range(2))
    entries = [pt.tensor(dtype="float64", shape=(None, 1)) for _ in energy.entry_names]
    hoop, axial, *full = pt.broadcast_arrays(log_hoop, log_axial, *entries)
    stress = response(energy, hoop, axial, full, force=force)
    outputs = [stress, *([elementwise_derivative(stress, hoop)] if slope else [])]
    return pytensor.function([log_hoop, log_axial, *entries], outputs, mode="FAST_COMPILE")
