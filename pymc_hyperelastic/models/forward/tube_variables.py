"""The tube of a model at each measured point: its wall, geometry and current radius."""

from collections.abc import Callable, Mapping
from types import MappingProxyType, ModuleType
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pytensor.graph.basic import Constant, Variable
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.data.geometry import kept_circle_of
from pymc_hyperelastic.data.inflation import at_points, measured_radius
from pymc_hyperelastic.mechanics.layers import LayeredTube, tube_of
from pymc_hyperelastic.mechanics.reference_tube import WALL
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.tube import GEOMETRY, inferred_geometry, opening_factor
from pymc_hyperelastic.models.geometry import deviated_tube
from pymc_hyperelastic.models.priors import is_inferred

Array = NDArray[np.float64]
Arrays = dict[str, NDArray]
Points = NDArray[np.intp]
# Variables of a model or numbers, and expressions of these, by name.
Values = Mapping[str, Any]
Curves = dict[str, TensorVariable]
# Standard deviations of the measured geometry by name; None are those of the data.
GeometrySd = tuple[tuple[str, float | None], ...]


def tube_inputs(data: xr.Dataset, errors: GeometrySd) -> Arrays:
    """Return the measured geometry, its errors, and the measured current radius at each point."""
    inputs = {name: at_points(data, name) for name in GEOMETRY}
    if not set(WALL).isdisjoint(dict(errors)):
        inputs["kept_circle"] = kept_circle_of(data)[data["test"].values]
    name = "current_outer_radius" if "outer_diameter" in data else "radius"
    inputs[name] = measured_radius(data).values.astype(float)
    for name, sd in errors:
        sds = at_points(data, f"{name}_sd") if sd is None else np.full(data.sizes["obs"], sd)
        inputs[f"{name}_sd"] = sds
    return inputs


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
        """Entries of the parameters of a numeric wall, each of shape (material)."""
        entries = self.energy.split(self.parameters)
        return [*np.broadcast_arrays(*map(np.atleast_1d, entries))]

    @property
    def unknown(self) -> list[Variable]:
        """All that is not a number, each once."""
        values = [*self.geometry.values(), *self.deviations.values()]
        if isinstance(self.energy, StrainEnergy):
            values += self.energy.split(self.parameters)
        else:
            for layer in self.energy:
                values += [layer.thickness, *layer.energy.split(layer.parameters)]
        inferred = [v for v in values if is_inferred(v) and not isinstance(v, Constant)]
        return list(dict.fromkeys(inferred))

    def mapped(self, change: Callable[[Any], Any]) -> "WallVariables":
        """Return the wall with a function of all parameters, entry by entry, and of the geometry.

        Vectors become tuples of their entries. Deviations stay.
        """
        geometry = {name: change(value) for name, value in self.geometry.items()}
        if not isinstance(self.energy, StrainEnergy):
            layers = [layer.mapped(change) for layer in self.energy]
            return self._replace(energy=layers, geometry=geometry)
        entries = [change(entry) for entry in self.energy.split(self.parameters)]
        return self._replace(parameters=self.energy.join(entries), geometry=geometry)

    def some(self, chosen: NDArray[Any]) -> "WallVariables":
        """Return the numeric wall with some of its materials."""
        walls = self.mapped(lambda value: value[chosen] if np.ndim(value) else value)
        return walls._replace(deviations={n: z[chosen] for n, z in self.deviations.items()})

    def with_values(self, values: Mapping[Variable, Array], tests: int) -> "WallVariables":
        """Return a numeric wall, with one number of each :attr:`unknown` for each material.

        The tests have the same deviations.
        """

        def number(value: Any) -> Any:
            if isinstance(value, Constant):
                return value.data
            return values.get(value, value) if is_inferred(value) else value

        deviations = {
            n: np.repeat(number(v)[:, None], tests, 1) for n, v in self.deviations.items()
        }
        return self.mapped(number)._replace(deviations=deviations)


class CurrentTube(NamedTuple):
    """A tube as it was measured, at each point."""

    tube: LayeredTube
    radius: Any
    """Internal radius, mm; that of another tube if this one is impossible."""
    possible: Any
    """True for a possible tube, at each point or of all."""
    excess: Any = None
    """``r_o² − a²``, if the outer radius ``r_o`` was measured."""

    def measured(self, radius: Any) -> Any:
        """Return the measured radius of a tube with this internal radius."""
        return radius if self.excess is None else (radius**2 + self.excess) ** 0.5

    @property
    def growth(self) -> Any:
        """Derivative of the internal radius by the measured one."""
        return 1.0 if self.excess is None else self.measured(self.radius) / self.radius


def current_tube(xp: ModuleType, inputs: Mapping[str, Any], wall: WallVariables) -> CurrentTube:
    """Return the tube of measured `inputs`, see :func:`tube_inputs`, with the wall's geometry.

    `xp` is ``numpy`` for numbers and ``pytensor.tensor`` for variables.
    """
    energy = wall.energy
    known = deviated_tube(inputs, wall.deviations) | dict(wall.geometry)
    closed = xp.abs(known["opening_angle"]) < 2 * np.pi
    if "wall_area" in known:
        # A negative area may have no root; an area of zero is as impossible.
        known["wall_area"] = xp.where(closed, xp.maximum(known["wall_area"], 0.0), 0.0)
    tube = inferred_geometry(known)
    inner, outer = tube["inner_radius"], tube["outer_radius"]
    possible = closed & (inner > 0)
    if isinstance(energy, StrainEnergy):
        possible = possible & (outer > inner)
    else:
        outer, tube["outer_radius"] = inner + sum(layer.thickness for layer in energy), None
        for layer in energy:
            possible = possible & (xp.minimum(inner, layer.thickness) > 0)
    unloaded = tube_of(energy, [tube[name] for name in GEOMETRY], wall.parameters)
    if "current_outer_radius" not in inputs:
        return CurrentTube(unloaded, inputs["radius"], possible)
    area = (outer**2 - inner**2) / (opening_factor(tube["opening_angle"]) * tube["axial_stretch"])
    square = inputs["current_outer_radius"] ** 2 - area
    excess = xp.where(square > 0, area, 0.0)
    radius = xp.sqrt(inputs["current_outer_radius"] ** 2 - excess)
    return CurrentTube(unloaded, radius, possible & (square > 0), excess)
