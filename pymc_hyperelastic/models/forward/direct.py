"""Curves by quadrature of the wall at every point: any radius, geometry and layers."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.data.inflation import at_points, measured_radius
from pymc_hyperelastic.mechanics.axial_force import wall_force, wall_force_slope
from pymc_hyperelastic.mechanics.inversion import RadiusAtPressure
from pymc_hyperelastic.mechanics.layers import Layer, Tube, tubes_of
from pymc_hyperelastic.mechanics.pressure import wall_pressure
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.tube import GEOMETRY, inferred_geometry, opening_factor
from pymc_hyperelastic.models.forward.blocks import (
    block_arrays,
    block_product,
    identity_of_tests,
    table_arrays,
    table_of,
)
from pymc_hyperelastic.models.geometry import deviated_tube
from pymc_hyperelastic.models.priors import is_inferred

Array = NDArray[np.float64]
Arrays = dict[str, NDArray]

# Of the radius: where the last step towards that at a pressure is longer, none was found.
_LARGEST_LAST_STEP = 1e-6
# kPa/mm: its square is beyond what a misfit may be.
_OVERFLOW = np.float64(1e60)


def tube_inputs(data: xr.Dataset) -> Arrays:
    """What was measured of the tube at each point: its geometry, and one of its current radii."""
    inputs = {name: at_points(data, name) for name in GEOMETRY}
    name = "current_outer_radius" if "outer_diameter" in data else "radius"
    return inputs | {name: measured_radius(data).values.astype(float)}


def error_inputs(data: xr.Dataset, errors: Mapping[str, float | None]) -> Arrays:
    """Standard deviations at each point of measures of the tube; None is that of the data."""
    return {
        f"{name}_sd": at_points(data, f"{name}_sd")
        if sd is None
        else np.full(data.sizes["obs"], sd)
        for name, sd in errors.items()
    }


class WallVariables(NamedTuple):
    """What a wall is made of: variables of a model in place of distributions."""

    energy: Any
    """A strain energy, or layers."""
    parameters: dict[str, Any]
    """Of the strain energy; layers bring their own."""
    geometry: Mapping[str, Any]
    """What is not known of the tube."""
    deviations: Mapping[str, Any] = MappingProxyType({})
    """How far measures of the tube are from what was measured, in standard deviations."""

    @property
    def known_tube(self) -> bool:
        """Whether all of the tube is known."""
        known = not self.geometry and not self.deviations
        return known and isinstance(self.energy, StrainEnergy)


class CurrentTube(NamedTuple):
    """A tube as it was measured, at each point."""

    wall: WallVariables
    reference: Mapping[str, Any]
    radius: Any
    """Internal radius, mm. Where the tube is not possible, that of another one."""
    possible: TensorVariable
    """Whether there is such a tube at all."""
    excess: Any = None
    """``r_o² − a²``, if the outer radius ``r_o`` was measured."""

    @property
    def tubes(self) -> list[Tube]:
        """The tubes that its wall is made of."""
        reference = [self.reference[name] for name in GEOMETRY]
        return tubes_of(self.wall.energy, self.radius, reference, self.wall.parameters)

    def measured(self, radius: Any) -> Any:
        """The radius that was measured, of an internal radius."""
        return radius if self.excess is None else (radius**2 + self.excess) ** 0.5

    @property
    def growth(self) -> Any:
        """How the internal radius grows with the one that was measured."""
        return 1.0 if self.excess is None else self.measured(self.radius) / self.radius


def current_tube(inputs: Mapping[str, Any], wall: WallVariables) -> CurrentTube:
    """Tube of the given `inputs`, see :func:`tube_inputs`, but for what the wall says of it."""
    energy = wall.energy
    known = deviated_tube(inputs, wall.deviations) | dict(wall.geometry)
    closed = pt.abs(known["opening_angle"]) < 2 * np.pi
    if "wall_area" in known:
        # An impossible one may have no root; one of zero is as impossible.
        known["wall_area"] = pt.where(closed, pt.maximum(known["wall_area"], 0.0), 0.0)
    tube = inferred_geometry(known)
    outer = tube["outer_radius"]
    possible = pt.all(closed) & pt.all(pt.gt(tube["inner_radius"], 0.0))
    if isinstance(energy, StrainEnergy):
        possible &= pt.all(outer > tube["inner_radius"])
    else:
        outer = tube["inner_radius"] + sum(layer.thickness for layer in energy)
        tube["outer_radius"] = None
        for layer in energy:
            possible &= pt.all(pt.gt(layer.thickness, 0.0))
    if "current_outer_radius" not in inputs:
        return CurrentTube(wall, tube, inputs["radius"], possible)
    k = opening_factor(tube["opening_angle"])
    excess = (outer**2 - tube["inner_radius"] ** 2) / (k * tube["axial_stretch"])
    square = inputs["current_outer_radius"] ** 2 - excess
    possible &= pt.all(square > 0)
    excess = pt.where(square > 0, excess, 0.0)
    radius = pt.sqrt(inputs["current_outer_radius"] ** 2 - excess)
    return CurrentTube(wall, tube, radius, possible, excess)


def _at_points(wall: WallVariables, test: Any) -> WallVariables:
    """A wall of parameters by test as one of parameters by point."""
    if isinstance(wall.energy, StrainEnergy):
        entries = wall.energy.split(wall.parameters)
        return wall._replace(parameters=wall.energy.join([x[test] for x in entries]))

    def at_points(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(map(at_points, value))
        return value[test] if is_inferred(value) else value

    layers = [
        Layer(
            layer.energy,
            at_points(layer.thickness),
            **{name: at_points(value) for name, value in layer.parameters.items()},
        )
        for layer in wall.energy
    ]
    return wall._replace(energy=layers)


class ByPoints(ABC):
    """A way to integrate that says what the curves are at every point, and compresses nothing."""

    @abstractmethod
    def curve_arrays(self, data: xr.Dataset) -> Arrays:
        """Arrays by which the data enter :meth:`curves`."""

    @abstractmethod
    def curves(self, inputs: Mapping[str, Any], wall: WallVariables) -> dict[str, TensorVariable]:
        """What the model says at the points."""

    @abstractmethod
    def slopes(self, inputs: Mapping[str, Any], wall: WallVariables) -> dict[str, TensorVariable]:
        """How the curves rise with the radius that was measured."""

    @abstractmethod
    def conditions(self, inputs: Mapping[str, Any], wall: WallVariables) -> list[TensorVariable]:
        """Conditions of there being such a tube, where it depends on what is unknown."""

    def misfit_arrays(self, data: xr.Dataset, targets: Mapping[str, Array]) -> Arrays:
        """Arrays by which targets, NaN where there are none, enter :meth:`differences`.

        Beside those of the curves.
        """
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
    ) -> tuple[dict[str, list[TensorVariable]], list[TensorVariable]]:
        """Differences between curves and targets, and conditions of there being any."""
        curves = self.curves(inputs, wall)
        response = {"pressure": [curves["pressure"] - inputs["pressure_target"]]}
        if "slope_rows" in inputs:
            slope = self.slopes(inputs, wall)["pressure"][inputs["slope_rows"]]
            response["slope"] = [slope - inputs["slope_target"]]
        if "force_rows" in inputs:
            response |= force_differences(inputs, curves["axial_force"])
        return response, self.conditions(inputs, wall)

    def mapped_arrays(self, data: xr.Dataset, linear: Any) -> Arrays:
        """Arrays by which a linear map of each test enters :meth:`mapped`, beside the curves'."""
        identity = identity_of_tests(data)
        zero = np.zeros_like(identity)
        of_pressure = block_arrays(data, linear(identity, zero))
        of_slope = block_arrays(data, linear(zero, identity))
        return {
            "of_pressure": of_pressure.pop("blocks"),
            "of_slope": of_slope.pop("blocks"),
            **of_slope,
        }

    def mapped(self, inputs: Mapping[str, Any], wall: WallVariables) -> TensorVariable:
        """A linear map of the pressures and of the slopes by what was measured."""
        pressure = self.curves(inputs, wall)["pressure"]
        slope = self.slopes(inputs, wall)["pressure"]
        return block_product(inputs["of_pressure"], inputs, pressure) + block_product(
            inputs["of_slope"], inputs, slope
        )


def force_differences(
    inputs: Mapping[str, Any], force: TensorVariable
) -> dict[str, list[TensorVariable]]:
    """Differences between forces and targets, and where these are asked for, their sums."""
    error = force[inputs["force_rows"]] - inputs["force_target"]
    sums = {"force_sum": [table_of(error, inputs).sum(axis=-1)]} if "points" in inputs else {}
    return {"force": [error]} | sums


@dataclass(frozen=True)
class Direct(ByPoints):
    """Quadrature of so many nodes at every point.

    With `by_test` each test has parameters of its own. The `errors` are standard deviations of
    measures of the tube, with their names, or None where the data hold them.
    """

    order: int
    with_force: bool = False
    by_test: bool = False
    errors: tuple[tuple[str, float | None], ...] = ()

    def curve_arrays(self, data: xr.Dataset) -> Arrays:
        """Arrays by which the data enter :meth:`curves`."""
        arrays = tube_inputs(data) | error_inputs(data, dict(self.errors))
        if self.by_test or self.errors:
            arrays["test"] = data["test"].values
        return arrays

    def curves(self, inputs: Mapping[str, Any], wall: WallVariables) -> dict[str, TensorVariable]:
        """What the model says at the points."""
        current = self._tube(inputs, wall)
        pressure, stiffness = wall_pressure(current.tubes, self.order)
        curves = {"pressure": pressure, "stiffness": stiffness}
        if self.with_force:
            curves["axial_force"] = wall_force(current.tubes, self.order)
        if (wall.geometry or wall.deviations) and current.excess is not None:
            curves["radius"] = current.radius
        return curves

    def slopes(self, inputs: Mapping[str, Any], wall: WallVariables) -> dict[str, TensorVariable]:
        """How the curves rise with the radius that was measured."""
        current = self._tube(inputs, wall)
        slopes = {"pressure": wall_pressure(current.tubes, self.order)[1]}
        if self.with_force:
            slopes["axial_force"] = wall_force_slope(current.tubes, self.order)
        return {name: _bounded(slope) * current.growth for name, slope in slopes.items()}

    def conditions(self, inputs: Mapping[str, Any], wall: WallVariables) -> list[TensorVariable]:
        """Conditions of there being such a tube, where it depends on what is unknown."""
        if wall.known_tube:
            return []
        return [self._tube(inputs, wall).possible]

    def differences(
        self, inputs: Mapping[str, Any], wall: WallVariables, error_in: str
    ) -> tuple[dict[str, list[TensorVariable]], list[TensorVariable]]:
        """Differences between curves and targets, and conditions of there being any.

        With the error in the radius pressure is what was controlled: radius and force are those of
        the tube at the measured pressure.
        """
        if error_in != "radius":
            return super().differences(inputs, wall, error_in)
        current = self._tube(inputs, wall)
        found, there = self._at_pressure(current, inputs["pressure_target"])
        error = there.measured(there.radius) - current.measured(current.radius)
        response = {"radius": [error]}
        if "force_rows" in inputs:
            response |= force_differences(inputs, wall_force(there.tubes, self.order))
        return response, [*self.conditions(inputs, wall), found]

    def _tube(self, inputs: Mapping[str, Any], wall: WallVariables) -> CurrentTube:
        if self.by_test:
            wall = _at_points(wall, inputs["test"])
        of_points = {name: z[inputs["test"]] for name, z in wall.deviations.items()}
        return current_tube(inputs, wall._replace(deviations=of_points))

    def _at_pressure(
        self, current: CurrentTube, pressure: Any
    ) -> tuple[TensorVariable, CurrentTube]:
        """Whether there are radii of the measured pressures, and the tube at these."""
        energies, inputs = [], []
        for tube in current.tubes:
            _, inner_radius, outer_radius, *_ = tube.geometry
            energies.append(tube.energy)
            inputs += [outer_radius - inner_radius, *tube.entries]
        _, inner_radius, _, *reference = current.tubes[0].geometry
        op = RadiusAtPressure(strain_energies=tuple(energies), order=self.order)
        radius, last_step = op(pressure, current.radius, inner_radius, *reference, *inputs)
        found = last_step < _LARGEST_LAST_STEP
        radius = pt.where(found, radius, current.radius)
        return pt.all(found), current._replace(radius=radius)


def _bounded(stiffness: TensorVariable) -> TensorVariable:
    """Where it overflows, the gradient by the growth of the radius would be 0 * inf."""
    return pt.where(pt.isfinite(stiffness), stiffness, _OVERFLOW)
