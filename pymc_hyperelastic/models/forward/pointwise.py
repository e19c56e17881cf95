"""Curves by quadrature of the wall at every point: any radius, geometry and layers."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.mechanics.integrals import wall_force, wall_pressure
from pymc_hyperelastic.mechanics.inversion import RadiusAtPressure
from pymc_hyperelastic.mechanics.wall import WALL_ORDER
from pymc_hyperelastic.models.forward.blocks import (
    table_arrays,
    table_of,
)
from pymc_hyperelastic.models.forward.integrator import LARGEST, Integrator
from pymc_hyperelastic.models.forward.numbers import SMALLEST_STEP, numeric_curves
from pymc_hyperelastic.models.forward.tube_variables import (
    Array,
    Arrays,
    CurrentTube,
    WallVariables,
    current_tube,
    error_inputs,
    tube_inputs,
    wall_at_points,
)


@dataclass(frozen=True)
class PointwiseQuadrature(Integrator):
    """Gauss-Legendre quadrature at every point, split at the kinks of the law.

    Attributes
    ----------
    order : int
        Nodes of each wall, or of each piece between kinks.
    with_force : bool
        Whether the axial force is a curve, too.
    by_test : bool
        Whether each test has parameters of its own.
    geometry_sd : tuple of (name, float or None)
        Standard deviations of the measured geometry; None are those of the data.
    """

    by_points: ClassVar[bool] = True

    order: int
    with_force: bool = False
    by_test: bool = False
    geometry_sd: tuple[tuple[str, float | None], ...] = ()

    def curve_arrays(self, data: xr.Dataset) -> Arrays:
        """Return the arrays of the data for :meth:`curves`, :meth:`slopes`, :meth:`conditions`."""
        arrays = tube_inputs(data) | error_inputs(data, dict(self.geometry_sd))
        if self.by_test or self.geometry_sd:
            arrays["test"] = data["test"].values
        return arrays

    def curves(self, inputs: Mapping[str, Any], wall: WallVariables) -> dict[str, TensorVariable]:
        """Return pressure and stiffness at the points, and the axial force if it is measured."""
        current = self._tube(inputs, wall)
        pressure, stiffness = wall_pressure(current.tube, current.radius, self.order)
        curves = {"pressure": pressure, "stiffness": stiffness}
        if self.with_force:
            curves["axial_force"], _ = wall_force(current.tube, current.radius, self.order)
        if (wall.geometry or wall.deviations) and current.excess is not None:
            curves["radius"] = current.radius
        return curves

    def slopes(self, inputs: Mapping[str, Any], wall: WallVariables) -> dict[str, TensorVariable]:
        """Return derivatives of the curves by the radius that was measured."""
        current = self._tube(inputs, wall)
        slopes = {"pressure": wall_pressure(current.tube, current.radius, self.order)[1]}
        if self.with_force:
            _, slopes["axial_force"] = wall_force(current.tube, current.radius, self.order)
        return {name: _bounded(slope) * current.growth for name, slope in slopes.items()}

    def conditions(self, inputs: Mapping[str, Any], wall: WallVariables) -> list[TensorVariable]:
        """Return the condition under which the tube is possible, unless it is known to be."""
        if wall.known_tube:
            return []
        return [pt.all(self._tube(inputs, wall).possible)]

    def misfit_arrays(self, data: xr.Dataset, targets: Mapping[str, Array]) -> Arrays:
        """Return the arrays of targets, which may be NaN, for :meth:`differences`."""
        arrays: Arrays = {}
        for name, target in targets.items():
            rows = np.flatnonzero(np.isfinite(target))
            if name == "force_sum":
                arrays |= table_arrays(data["test"].values[rows], data.sizes["test"])
            else:
                arrays |= {f"{name}_rows": rows, f"{name}_target": target[rows]}
        return arrays

    def differences(
        self, inputs: Mapping[str, Any], wall: WallVariables, error_in: str
    ) -> tuple[dict[str, TensorVariable], list[TensorVariable]]:
        """Return differences between curves and targets, and the conditions for them.

        With the error in the radius, radius and force are those of the tube at the measured
        pressure.
        """
        if error_in != "radius":
            return self._at_radius(inputs, wall)
        current = self._tube(inputs, wall)
        found, there = self._at_pressure(current, inputs["pressure_target"])
        error = there.measured(there.radius) - current.measured(current.radius)
        differences = {"radius": error}
        if "force_rows" in inputs:
            force, _ = wall_force(there.tube, there.radius, self.order)
            differences |= force_differences(inputs, force)
        return differences, [*self.conditions(inputs, wall), found]

    def values(
        self, data: xr.Dataset, wall: WallVariables, points: NDArray[np.intp]
    ) -> dict[str, Array]:
        """Return curves (material, point) of a numeric wall at some of the points."""
        settings = self.order, self.with_force, self.geometry_sd
        return numeric_curves(data, wall, points, *settings)

    def refined(self, data: xr.Dataset, wall: WallVariables) -> "PointwiseQuadrature":
        """Return the rule of twice the order of any wall: its error is that order's squared."""
        return replace(self, order=2 * WALL_ORDER)

    def _at_radius(
        self, inputs: Mapping[str, Any], wall: WallVariables
    ) -> tuple[dict[str, TensorVariable], list[TensorVariable]]:
        """Differences at the measured radii, and the conditions."""
        curves = self.curves(inputs, wall)
        differences = {"pressure": curves["pressure"] - inputs["pressure_target"]}
        if "slope_rows" in inputs:
            slope = self.slopes(inputs, wall)["pressure"][inputs["slope_rows"]]
            differences["slope"] = slope - inputs["slope_target"]
        if "force_rows" in inputs:
            differences |= force_differences(inputs, curves["axial_force"])
        return differences, self.conditions(inputs, wall)

    def _tube(self, inputs: Mapping[str, Any], wall: WallVariables) -> CurrentTube:
        if self.by_test:
            wall = wall_at_points(wall, inputs["test"])
        of_points = {name: z[inputs["test"]] for name, z in wall.deviations.items()}
        return current_tube(pt, inputs, wall._replace(deviations=of_points))

    def _at_pressure(
        self, current: CurrentTube, pressure: Any
    ) -> tuple[TensorVariable, CurrentTube]:
        """Return a condition for radii at the measured pressures, and the tube at these radii."""
        energies = tuple(layer.energy for layer in current.tube.layers)
        op = RadiusAtPressure(strain_energies=energies, order=self.order)
        radius, last_step = op(pressure, current.radius, *current.tube.inputs)
        found = last_step < SMALLEST_STEP
        radius = pt.where(found, radius, current.radius)
        return pt.all(found), current._replace(radius=radius)


def force_differences(
    inputs: Mapping[str, Any], force: TensorVariable
) -> dict[str, TensorVariable]:
    """Return differences between forces and targets, and their sums if these have a target."""
    error = force[inputs["force_rows"]] - inputs["force_target"]
    sums = {"force_sum": table_of(error, inputs).sum(axis=-1)} if "points" in inputs else {}
    return {"force": error} | sums


def _bounded(stiffness: TensorVariable) -> TensorVariable:
    """Return a bounded stiffness: the gradient of an infinite one would be 0 * inf."""
    return pt.where(pt.isfinite(stiffness), stiffness, LARGEST)
