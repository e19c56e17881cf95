"""Walls in which fibres slacken: constant matrices where they are taut, quadrature elsewhere."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytensor.tensor as pt
import xarray as xr
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.models.forward.collocated import Arrays, Collocated, known_tubes
from pymc_hyperelastic.models.forward.direct import ByPoints, Direct, WallVariables

# What names the arrays of each part.
_TAUT, _SLACK = "taut_", "slack_"


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
