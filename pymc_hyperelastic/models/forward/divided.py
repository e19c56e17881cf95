"""Walls in which fibres slacken: constant matrices where they are taut, quadrature elsewhere."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytensor.tensor as pt
import xarray as xr
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.mechanics.wall import wall_rule
from pymc_hyperelastic.models.forward.blocks import positions
from pymc_hyperelastic.models.forward.collocated import Array, Arrays, Collocated, known_tubes
from pymc_hyperelastic.models.forward.direct import ByPoints, Direct, WallVariables

# What names the arrays of each part.
_TAUT, _SLACK = "taut_", "slack_"
# So many times as many nodes where those of slack parts are given once and for all: fibres may
# slacken between them.
_FINER = 2


@dataclass(frozen=True)
class Divided(ByPoints):
    """Constant matrices for the parts of walls where ``λθ ≥ 1``, quadrature for the others.

    Pressures, stiffnesses and forces of both parts add up: each is a tube in the tube. Points
    without a slack part take no quadrature.
    """

    taut: Collocated
    slack: Direct

    def curve_arrays(self, data: xr.Dataset) -> Arrays:
        """Arrays by which the data enter :meth:`curves`."""
        tubes = known_tubes(data).divided()[1]
        there = tubes.outer_radius > tubes.inner_radius
        # Without a slack part there is one without thickness.
        rows = np.flatnonzero(there) if there.any() else np.zeros(1, int)
        parts = tubes.at(rows)
        of_parts = {name: getattr(parts, name) for name in ("radius", *GEOMETRY, "share")}
        of_parts |= {"test": data["test"].values[rows], "points": rows, "there": there}
        of_parts["place"] = np.maximum(np.cumsum(there) - 1, 0)
        taut = {_TAUT + name: array for name, array in self.taut.curve_arrays(data).items()}
        return taut | {_SLACK + name: array for name, array in of_parts.items()}

    def curves(self, inputs: Mapping[str, Any], wall: WallVariables) -> dict[str, TensorVariable]:
        """What the model says at the points."""
        taut, slack = (_inputs_of(part, inputs) for part in (_TAUT, _SLACK))
        of_parts = self.slack.curves(slack, _shortened(wall))
        of_parts["stiffness"] *= slack["share"]
        return _sum(self.taut.curves(taut, wall), of_parts, slack)

    def slopes(self, inputs: Mapping[str, Any], wall: WallVariables) -> dict[str, TensorVariable]:
        """How the curves rise with the radius that was measured, at the stretch of each point."""
        taut, slack = (_inputs_of(part, inputs) for part in (_TAUT, _SLACK))
        growth = slack["share"] * taut["growth"][slack["points"]]
        of_parts = {n: s * growth for n, s in self.slack.slopes(slack, _shortened(wall)).items()}
        return _sum(self.taut.slopes(taut, wall), of_parts, slack)

    def nearby_arrays(
        self, arrays: Arrays, energy: StrainEnergy, materials: Sequence[Array]
    ) -> Arrays:
        """Arrays of few nodes for whole walls in place of these, right for materials like those.

        Slopes are not known by them.
        """
        taut, slack = (_inputs_of(part, arrays) for part in (_TAUT, _SLACK))
        if not taut or not self.taut.empirical:
            return {}
        nearby = self.taut.nearby_arrays(self._whole(taut, slack), energy, materials)
        if not nearby:
            return {}
        # A slack part without thickness stands for all that there were.
        none = {name: slack[name][:1] for name in ("radius", *GEOMETRY, "share", "test", "points")}
        none["outer_radius"] = none["inner_radius"]
        none |= {name: np.zeros_like(slack[name]) for name in ("there", "place")}
        return {_TAUT + n: v for n, v in nearby.items()} | {_SLACK + n: v for n, v in none.items()}

    def _whole(self, taut: Arrays, slack: Arrays) -> Arrays:
        """Matrices with the nodes of quadrature of slack parts beside those of taut ones."""
        groups, most, nodes = taut["pressure_matrix"].shape
        points = np.flatnonzero(slack["there"])
        group, row = np.divmod(taut["place"][points], most)
        by_group = np.argsort(group, kind="stable")
        points, group, row = points[by_group], group[by_group], row[by_group]
        walls = [slack[name][slack["place"][points], None] for name in ("radius", *GEOMETRY)]
        order = _FINER * self.slack.order
        rule = wall_rule(np, *walls, order=order)
        log_axial = np.broadcast_to(np.log(walls[3]), rule.log_hoop.shape)
        weights = {"pressure_matrix": rule.pressure_weight, "force_matrix": rule.force_weight}
        # Of each group, the nodes of its own points.
        position, count = positions(group)
        columns = nodes + position[:, None] * order + np.arange(order)
        whole = {}
        for name, of_slack in (("log_hoop", rule.log_hoop), ("log_axial", log_axial)):
            beside = np.repeat(taut[name][:, :1], count * order, axis=1)
            whole[name] = np.concatenate([taut[name], beside], axis=1)
            whole[name][group[:, None], columns] = of_slack
        for name in (name for name in taut if name.endswith("_matrix")):
            known = name in weights
            beside = np.full((groups, most, count * order), 0.0 if known else np.nan)
            whole[name] = np.concatenate([taut[name], beside], axis=2)
            if known:
                whole[name][group[:, None], row[:, None], columns] = weights[name]
        return whole

    def conditions(self, *_: Any) -> list[TensorVariable]:
        """None: known tubes are possible."""
        return []


def _shortened(wall: WallVariables) -> WallVariables:
    """The wall where ``λθ < 1``."""
    return wall._replace(energy=wall.energy.shortened)


def _inputs_of(part: str, inputs: Mapping[str, Any]) -> dict[str, Any]:
    """Inputs of one of the parts, by the names that they have where a wall is not divided."""
    return {name.removeprefix(part): v for name, v in inputs.items() if name.startswith(part)}


def _sum(
    taut: Mapping[str, TensorVariable], slack: Mapping[str, TensorVariable], of: Mapping[str, Any]
) -> dict[str, TensorVariable]:
    """Curves of both parts together, at all points."""
    return {
        name: curve + pt.where(of["there"], slack[name][of["place"]], 0.0)
        for name, curve in taut.items()
    }
