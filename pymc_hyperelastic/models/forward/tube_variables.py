"""The tube of a model at each measured point: its wall, geometry and current radius."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.graph.basic import Constant, Variable
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.data.inflation import at_points, measured_radius
from pymc_hyperelastic.mechanics.layers import Layer, Tube, tubes_of
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.tube import GEOMETRY, inferred_geometry, opening_factor
from pymc_hyperelastic.models.geometry import deviated_tube
from pymc_hyperelastic.models.priors import is_inferred

Array = NDArray[np.float64]
Arrays = dict[str, NDArray]


def tube_inputs(data: xr.Dataset) -> Arrays:
    """Return the measured geometry of the tube and its measured current radius at each point."""
    inputs = {name: at_points(data, name) for name in GEOMETRY}
    name = "current_outer_radius" if "outer_diameter" in data else "radius"
    return inputs | {name: measured_radius(data).values.astype(float)}


def error_inputs(data: xr.Dataset, errors: Mapping[str, float | None]) -> Arrays:
    """Return the standard deviations of the measured geometry; None is that of the data."""
    return {
        f"{name}_sd": at_points(data, f"{name}_sd")
        if sd is None
        else np.full(data.sizes["obs"], sd)
        for name, sd in errors.items()
    }


class WallVariables(NamedTuple):
    """A wall and its tube, with variables of a model, or numbers, in place of distributions."""

    energy: Any
    """A strain energy, or layers."""
    parameters: dict[str, Any]
    """Parameters of the strain energy; layers have their own."""
    geometry: Mapping[str, Any]
    """Unknown geometry of the tube, by name."""
    deviations: Mapping[str, Any] = MappingProxyType({})
    """Errors of the measured geometry, in standard deviations, by name and of each test."""

    @property
    def known_tube(self) -> bool:
        """True if the wall has one material and the geometry is known."""
        known = not self.geometry and not self.deviations
        return known and isinstance(self.energy, StrainEnergy)

    @property
    def materials(self) -> list[Array]:
        """Entries of the parameters of a wall in numbers, each of shape (material)."""
        entries = self.energy.split(self.parameters)
        return [*np.broadcast_arrays(*map(np.atleast_1d, entries))]

    def by_entries(self) -> "WallVariables":
        """Return the same wall with vector parameters as tuples of their entries."""
        energy = self.energy
        if isinstance(energy, StrainEnergy):
            return self._replace(parameters=energy.join(energy.split(self.parameters)))
        layers = [
            Layer(x.energy, x.thickness, **x.energy.join(x.energy.split(x.parameters)))
            for x in energy
        ]
        return self._replace(energy=layers)

    @property
    def unknown(self) -> list[Variable]:
        """All that is not a number, each once; of vectors :meth:`by_entries`, the entries."""
        values = [*self.geometry.values(), *self.deviations.values()]
        if isinstance(self.energy, StrainEnergy):
            values += self.energy.split(self.parameters)
        else:
            for layer in self.energy:
                values += [layer.thickness, *layer.energy.split(layer.parameters)]
        inferred = [v for v in values if isinstance(v, Variable) and not isinstance(v, Constant)]
        return list(dict.fromkeys(inferred))

    def with_values(self, values: Mapping[Variable, Array], tests: int) -> "WallVariables":
        """Return the wall in numbers, with one number of each :attr:`unknown` for each material.

        The tests have the same deviations.
        """

        def number(value: Any) -> Any:
            if isinstance(value, tuple):
                return tuple(map(number, value))
            if isinstance(value, Constant):
                return value.data
            return values.get(value, value) if isinstance(value, Variable) else value

        def numbers(named: Mapping[str, Any]) -> dict[str, Any]:
            return {name: number(value) for name, value in named.items()}

        energy: Any = self.energy
        if not isinstance(energy, StrainEnergy):
            energy = [Layer(x.energy, number(x.thickness), **numbers(x.parameters)) for x in energy]
        deviations = {
            n: np.repeat(number(v)[:, None], tests, 1) for n, v in self.deviations.items()
        }
        return WallVariables(energy, numbers(self.parameters), numbers(self.geometry), deviations)


class CurrentTube(NamedTuple):
    """A tube as it was measured, at each point."""

    wall: WallVariables
    reference: Mapping[str, Any]
    radius: Any
    """Internal radius, mm; that of another tube if this one is impossible."""
    possible: TensorVariable
    """Condition for a possible tube."""
    excess: Any = None
    """``r_o² − a²``, if the outer radius ``r_o`` was measured."""

    @property
    def tubes(self) -> list[Tube]:
        """The tubes, one within the other, that make up the wall."""
        reference = [self.reference[name] for name in GEOMETRY]
        return tubes_of(self.wall.energy, self.radius, reference, self.wall.parameters)

    def measured(self, radius: Any) -> Any:
        """Return the measured radius of a tube with this internal radius."""
        return radius if self.excess is None else (radius**2 + self.excess) ** 0.5

    @property
    def growth(self) -> Any:
        """Derivative of the internal radius by the measured one."""
        return 1.0 if self.excess is None else self.measured(self.radius) / self.radius


def current_tube(inputs: Mapping[str, Any], wall: WallVariables) -> CurrentTube:
    """Return the tube of measured `inputs`, see :func:`tube_inputs`, with the wall's geometry."""
    energy = wall.energy
    known = deviated_tube(inputs, wall.deviations) | dict(wall.geometry)
    closed = pt.abs(known["opening_angle"]) < 2 * np.pi
    if "wall_area" in known:
        # A negative area may have no root; an area of zero is as impossible.
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


def wall_at_points(wall: WallVariables, test: Any) -> WallVariables:
    """Return a wall with parameters by point, from one with parameters by test."""
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
