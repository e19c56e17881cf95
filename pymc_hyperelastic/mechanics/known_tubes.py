"""Tubes with known radii and reference geometry, for integrators that tabulate a wall."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymc_hyperelastic.mechanics.tube import UNLOADED, stretches
from pymc_hyperelastic.mechanics.wall import WALL_ORDER, WallRule, wall_rule

Array = NDArray[np.float64]

# Smallest half width of a range of ln λθ: below a thousandth no test can distinguish stretches.
_NARROWEST = 1e-3


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
        _, inner, _ = stretches(self.inner_radius, self.radius, **tube)
        _, outer, _ = stretches(self.outer_radius, self.radius, **tube)
        return np.log(inner), np.log(outer)

    def quadrature(self, order: int = WALL_ORDER, *, split: bool = False) -> tuple[WallRule, Array]:
        """Return the quadrature rule of each wall, and ``ln λz`` of its nodes (point, node).

        With `split` the rule is split where ``λθ = 1``, if any of the walls holds this stretch:
        fibres in the hoop direction slacken there.
        """
        inner, outer = self.log_hoop
        kinks = [np.zeros(())] if split and np.any((inner < 0) != (outer < 0)) else []
        geometry = [values[:, None] for values in self[:5]]
        rule = wall_rule(np, geometry, order=order, kinks=kinks)
        log_axial = np.broadcast_to(np.log(self.axial_stretch)[:, None], rule.log_hoop.shape)
        return rule, log_axial


class Group(NamedTuple):
    """Points whose walls share the nodes of a basis."""

    points: NDArray[np.intp]
    hoop: tuple[float, float]
    """Centre and half width of the range of ``ln λθ`` in the walls."""


def groups_by(tubes: KnownTubes, key: NDArray) -> list[Group]:
    """Return groups of the points that have the same `key`."""
    groups = []
    for value in np.unique(key):
        own = np.flatnonzero(key == value)
        log_hoop = tubes.at(own).log_hoop
        low, high = float(np.min(log_hoop)), float(np.max(log_hoop))
        # A range of one stretch is widened, so that a polynomial can be differentiated there.
        half = max((high - low) / 2, _NARROWEST)
        groups.append(Group(own, (low + half, half)))
    return groups
