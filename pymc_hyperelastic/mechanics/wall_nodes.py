"""Nodes of quadrature in the walls of a specimen: exact, and many more than any material needs."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymc_hyperelastic.mechanics.interpolation import Group, Matrices, response_function
from pymc_hyperelastic.mechanics.known_tubes import KnownTubes
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.wall import WallRule, wall_rule

Array = NDArray[np.float64]


class WallNodes(NamedTuple):
    """All nodes of Gauss-Legendre quadrature in the walls of a group, as nodes of a basis.

    Walls of fibres are `divided` where ``λθ = 1``: there hoop fibres slacken. What few of the nodes
    some materials need is chosen from these by
    :func:`~pymc_hyperelastic.mechanics.empirical.fewer_nodes`. Slopes are not known by them.
    """

    order: int
    divided: bool

    def interpolation(self, tubes: KnownTubes, group: Group) -> "NodesInWalls":
        """Nodes in the walls of the points of the group."""
        own = tubes.at(group.points)
        rules, points = [], []
        for part in own.divided() if self.divided else (own,):
            there = np.flatnonzero(part.outer_radius > part.inner_radius)
            rules.append(wall_rule(np, *part.at(there).walls, order=self.order))
            points.append(group.points[there])
        joined = WallRule(*(np.concatenate(of_parts) for of_parts in zip(*rules, strict=True)))
        return NodesInWalls(joined, np.concatenate(points), tubes)

    @np.errstate(all="ignore")  # some of the materials may be impossible
    def curves(
        self,
        energy: StrainEnergy,
        tubes: KnownTubes,
        materials: Sequence[Array],
        *,
        with_force: bool,
    ) -> list[Array]:
        """Pressures, and axial forces, (material, point) of materials, entry by entry."""
        points = np.arange(len(tubes.radius))
        walls = self.interpolation(tubes, Group(points, (0.0, 0.0), (0.0, 0.0)))
        log_hoop, log_axial = (x[None] for x in walls.places)
        entries = [np.reshape(v, (-1, 1)) for v in materials]
        curves = []
        for force, weight in enumerate(walls.weights[: 1 + with_force]):
            response = response_function(energy, bool(force))(log_hoop, log_axial, *entries)[0]
            of_walls = (response.reshape(-1, *weight.shape) * weight).sum(axis=2)
            curve = np.zeros((len(points), len(of_walls)))
            np.add.at(curve, walls.points, of_walls.T)
            curves.append(curve.T)
        return curves


class NodesInWalls(NamedTuple):
    """Quadrature of walls, or of their parts, of each of the points that these are of."""

    rule: WallRule
    points: NDArray[np.intp]
    tubes: KnownTubes

    @property
    def places(self) -> tuple[Array, Array]:
        """``ln λθ`` and ``ln λz``, wall by wall."""
        log_hoop, log_axial = self.rule.log_hoop, np.log(self.tubes.axial_stretch[self.points])
        return log_hoop.ravel(), np.repeat(log_axial, log_hoop.shape[1])

    @property
    def weights(self) -> tuple[Array, Array]:
        """Of the responses of pressure and of axial force."""
        return self.rule.pressure_weight, self.rule.force_weight

    def matrices(self, tubes: KnownTubes, points: NDArray[np.intp]) -> Matrices:
        """Weights of the nodes in the wall of each point; of slopes none are known."""

        def of_points(weight: Array) -> Array:
            there = points[:, None] == self.points
            return (there[:, :, None] * weight).reshape(len(points), -1)

        pressure, force = map(of_points, self.weights)
        unknown = np.full_like(pressure, np.nan)
        slopes = dict.fromkeys(("stiffness", "slope", "force_slope"), unknown)
        return {"pressure": pressure, "force": force} | slopes
