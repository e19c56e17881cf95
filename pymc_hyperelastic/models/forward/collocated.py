"""Curves as constant matrices times the material's response, for known radii and geometry."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.data.inflation import measured_radius
from pymc_hyperelastic.mechanics.collocation import (
    CollocatedAxialForce,
    CollocatedPressureIntegral,
    KnownTubes,
    collocate,
    curve_matrices,
)
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.models.forward.blocks import positions, table_arrays, table_of
from pymc_hyperelastic.models.forward.direct import WallVariables

Array = NDArray[np.float64]
Arrays = dict[str, NDArray]


def known_tubes(data: xr.Dataset) -> KnownTubes:
    """The tube at every point of the data."""
    test, radius = data["test"].values, data["radius"].values.astype(float)
    geometry = {name: data[name].values[test].astype(float) for name in GEOMETRY}
    return KnownTubes(radius, **geometry, growth=measured_radius(data).values / radius)


@dataclass(frozen=True)
class Collocated:
    """Constant matrices of so many Chebyshev stretches.

    The methods are those of :class:`~pymc_hyperelastic.models.forward.direct.Direct`; geometry is
    known, and plays no part in them.
    """

    nodes: int
    with_force: bool = False
    by_test: bool = False

    def curve_arrays(self, data: xr.Dataset) -> Arrays:
        """Arrays by which the data enter :meth:`curves`."""
        group = data["test"].values if self.by_test else None
        tubes = known_tubes(data)
        matrices, place = curve_matrices(tubes, self.nodes, group)
        if not self.with_force:
            del matrices["force_matrix"], matrices["force_slope_matrix"]
        return matrices | {"place": place, "growth": tubes.growth}

    def curves(self, inputs: Mapping[str, Any], wall: WallVariables) -> dict[str, TensorVariable]:
        """What the model says at the points."""
        pressure, stiffness = self._pressure(
            inputs, inputs["pressure_matrix"], inputs["stiffness_matrix"], wall
        )
        curves = {"pressure": pressure, "stiffness": stiffness}
        if self.with_force:
            curves["axial_force"] = self._force(inputs, inputs["force_matrix"], wall)
        return {name: curve.flatten()[inputs["place"]] for name, curve in curves.items()}

    def slopes(self, inputs: Mapping[str, Any], wall: WallVariables) -> dict[str, TensorVariable]:
        """How the curves rise with the radius that was measured."""
        matrices = inputs["pressure_matrix"], inputs["stiffness_matrix"]
        slopes = {"pressure": self._pressure(inputs, *matrices, wall)[1]}
        if self.with_force:
            slopes["axial_force"] = self._force(inputs, inputs["force_slope_matrix"], wall)
        place, growth = inputs["place"], inputs["growth"]
        return {name: slope.flatten()[place] * growth for name, slope in slopes.items()}

    def conditions(self, *_: Any) -> list[TensorVariable]:
        """None: known tubes are possible."""
        return []

    def misfit_arrays(self, data: xr.Dataset, targets: Mapping[str, Array]) -> Arrays:
        """Arrays by which data and targets, NaN where there are none, enter :meth:`differences`.

        As many numbers as there are stretches stand for all points, see :func:`collocate`.
        """
        compressed = {name: target for name, target in targets.items() if name != "force_sum"}
        arrays = collocate(known_tubes(data), self.nodes, compressed)
        if "force_sum" in targets:
            arrays |= self._force_sum_arrays(data, targets["force_sum"])
        return arrays

    def differences(
        self, inputs: Mapping[str, Any], wall: WallVariables, error_in: str
    ) -> tuple[dict[str, TensorVariable], list[TensorVariable]]:
        """Differences between curves and targets, compressed."""
        # Without slopes, as many rows of nothing.
        slope_matrix = inputs.get("slope_matrix", inputs["pressure_matrix"][:, :0])
        pressure, slope = self._pressure(inputs, inputs["pressure_matrix"], slope_matrix, wall)
        response = {"pressure": pressure - inputs["pressure_target"]}
        if "slope_target" in inputs:
            response["slope"] = slope - inputs["slope_target"]
        if "force_target" in inputs:
            force = self._force(inputs, inputs["force_matrix"], wall)
            response["force"] = force - inputs["force_target"]
        if "force_sum_target" in inputs:
            sums = self._force(inputs, inputs["force_sum_matrix"], wall).flatten()
            response["force_sum"] = table_of(sums, inputs).sum(axis=-1) - inputs["force_sum_target"]
        return response, []

    def _force_sum_arrays(self, data: xr.Dataset, target: Array) -> Arrays:
        """Matrices of the sum of each test's forces: a row for each axial stretch that it has."""
        matrices, place = curve_matrices(known_tubes(data), self.nodes)
        groups, most, _ = matrices["force_matrix"].shape
        forces = matrices["force_matrix"].reshape(-1, self.nodes)
        rows = np.flatnonzero(np.isfinite(target))
        test, tests = data["test"].values[rows], data.sizes["test"]
        # What a test has at one axial stretch, group by group, and then test by test.
        part, part_of = np.unique(place[rows] // most * tests + test, return_inverse=True)
        group, test_of_part = np.divmod(part, tests)
        position, width = positions(group)
        sums = np.zeros((groups, width, self.nodes))
        row = group * width + position
        np.add.at(sums.reshape(-1, self.nodes), row[part_of], forces[place[rows]])
        by_test = np.argsort(test_of_part, kind="stable")
        table = table_arrays(test_of_part[by_test], tests)
        return {
            "force_sum_matrix": sums,
            "force_sum_target": np.bincount(test, target[rows], minlength=tests),
            "points": row[by_test][table["points"]],
            "there": table["there"],
        }

    def mapped_arrays(self, data: xr.Dataset, linear: Any) -> Arrays:
        """Arrays by which the data, and a linear map of each test, enter :meth:`mapped`."""
        arrays = self.curve_arrays(data)
        shape, place = arrays["pressure_matrix"].shape, arrays["place"]
        pressure, stiffness = (
            arrays[name].reshape(-1, self.nodes)[place]
            for name in ("pressure_matrix", "stiffness_matrix")
        )
        growth = known_tubes(data).growth[:, None]
        matrix = np.zeros((shape[0] * shape[1], shape[2]))
        matrix[place] = linear(pressure, stiffness * growth)
        return {
            "log_hoop": arrays["log_hoop"],
            "log_axial": arrays["log_axial"],
            "mapped_matrix": matrix.reshape(shape),
            "no_slopes": np.zeros((shape[0], 0, shape[2])),
            "place": place,
        }

    def mapped(self, inputs: Mapping[str, Any], wall: WallVariables) -> TensorVariable:
        """A linear map of pressures and slopes: one constant matrix times the response."""
        mapped, _ = self._pressure(inputs, inputs["mapped_matrix"], inputs["no_slopes"], wall)
        return mapped.flatten()[inputs["place"]]

    def _pressure(
        self,
        inputs: Mapping[str, Any],
        pressure_matrix: Any,
        slope_matrix: Any,
        wall: WallVariables,
    ) -> tuple[TensorVariable, TensorVariable]:
        integral = CollocatedPressureIntegral(strain_energy=wall.energy, per_group=self.by_test)
        stretches, entries = _stretches(inputs), wall.energy.split(wall.parameters)
        return integral(*stretches, pressure_matrix, slope_matrix, *entries)

    def _force(self, inputs: Mapping[str, Any], matrix: Any, wall: WallVariables) -> TensorVariable:
        integral = CollocatedAxialForce(strain_energy=wall.energy, per_group=self.by_test)
        entries = wall.energy.split(wall.parameters)
        return integral(*_stretches(inputs), matrix, *entries)


def _stretches(inputs: Mapping[str, Any]) -> tuple[Any, Any]:
    return inputs["log_hoop"], inputs["log_axial"]
