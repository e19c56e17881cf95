"""How the wall is integrated in a model: constant matrices, or how many nodes of quadrature."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import pytensor
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.graph.basic import Constant, Variable
from pytensor.graph.replace import vectorize_graph
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.data.inflation import GEOMETRY, measured_radius, points_of
from pymc_hyperelastic.mechanics.axial_force import wall_force
from pymc_hyperelastic.mechanics.collocation import nodes_needed, representative_values
from pymc_hyperelastic.mechanics.layers import Layer, Tube, tubes_of
from pymc_hyperelastic.mechanics.pressure import wall_pressure
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.tube import inferred_geometry, opening_factor

__all__ = ["CurrentTube", "Mode", "Rule", "current_tube", "rule_for", "tube_inputs"]

Array = NDArray[np.float64]
Mode = Literal["auto", "collocation", "quadrature"]

# Orders of Gauss-Legendre quadrature that are tried against the last one, and what they may err,
# relative to the largest value of a curve.
_ORDERS = (8, 12, 16, 24, 32, 64)
_ORDER_TOLERANCE = 1e-11
# Parameters whose pressures exceed the measured ones by this factor are left out: their likelihood
# is nil, whatever the rule.
_BEYOND = 10.0
# Points and parameters at which they are tried.
_MOST_POINTS, _MOST_VALUES = 16, 200


class Rule(NamedTuple):
    """Constant matrices of so many Chebyshev stretches, or quadrature of so many nodes."""

    method: Literal["collocation", "quadrature"]
    nodes: int


def rule_for(
    energy: StrainEnergy | Sequence[Layer],
    data: xr.Dataset,
    parameters: dict[str, Any],
    geometry: Mapping[str, Any] | None = None,
    *,
    mode: Mode = "auto",
    with_force: bool = False,
    known_radii: bool = True,
) -> Rule:
    """The cheapest rule that is exact, but for rounding, over the range of the parameters.

    With the mode "quadrature" it has the order 32, whatever the parameters.

    Raises
    ------
    ValueError
        If there is no such mode, or collocation was asked for and is not possible.
    """
    if mode not in get_args(Mode):
        raise ValueError(f"mode is {mode!r}; expected one of {get_args(Mode)}")
    if mode == "quadrature":
        return Rule("quadrature", 32)
    reason = "layers, a geometry that is inferred, and an error in the radius"
    if isinstance(energy, StrainEnergy) and not geometry and known_radii:
        nodes = nodes_needed(energy, data, parameters, with_force=with_force)
        if nodes is not None:
            return Rule("collocation", nodes)
        reason = f"the response of {energy.name} over the range of these parameters"
    if mode == "collocation":
        raise ValueError(f"{reason} cannot be collocated: use mode='quadrature'")
    return Rule("quadrature", _order_needed(energy, data, parameters, geometry or {}, with_force))


def _order_needed(
    energy: StrainEnergy | Sequence[Layer],
    data: xr.Dataset,
    parameters: dict[str, Any],
    geometry: Mapping[str, Any],
    with_force: bool,
) -> int:
    """The order after the least at which curves agree with those of the highest one."""
    # At both ends of every curve; of many curves at some.
    radius = measured_radius(data).values
    spans = [points_of(data, test) for test in range(data.sizes["test"])]
    ends = [span.start + f(radius[span]) for span in spans for f in (np.argmin, np.argmax)]
    inputs = {k: v[_some(np.array(ends), _MOST_POINTS)] for k, v in tube_inputs(data).items()}
    tubes = current_tube(energy, inputs, geometry, parameters).tubes
    unknown = [*(v for tube in tubes for v in tube.entries), *geometry.values()]
    if not isinstance(energy, StrainEnergy):
        unknown += [layer.thickness for layer in energy]
    inferred = (v for v in unknown if isinstance(v, Variable) and not isinstance(v, Constant))
    variables = list(dict.fromkeys(inferred))  # in order, and each once
    values = representative_values(variables) if variables else None
    if values is None:
        return 32
    symbols = {v: pt.vector(dtype="float64") for v in variables}

    def curves(order: int) -> list[Array]:
        outputs = list(wall_pressure(tubes, order))
        if with_force:
            outputs.append(wall_force(tubes, order))
        batch = vectorize_graph(outputs, symbols)
        function = pytensor.function(list(symbols.values()), batch, mode="FAST_COMPILE")
        with np.errstate(all="ignore"):
            return function(*(_some(v, _MOST_VALUES) for v in values))

    *orders, highest = _ORDERS
    exact = curves(highest)
    possible = np.abs(exact[0]).max(axis=1) < _BEYOND * np.abs(data["pressure"].values).max()
    if not possible.any():
        return 32

    def agree(curve: Array, expected: Array) -> bool:
        error = np.abs(curve[possible] - expected[possible])
        scale = np.abs(expected[possible]).max(axis=1, keepdims=True)
        return bool(np.all(error <= _ORDER_TOLERANCE * scale))

    for order, safer in pairwise([*orders, highest]):
        if all(map(agree, curves(order), exact)):
            return safer
    return highest


def _some(values: NDArray, count: int) -> NDArray:
    """At most so many of the values, evenly spread, the ends included."""
    return values[np.unique(np.linspace(0, len(values) - 1, count).round().astype(int))]


def tube_inputs(data: xr.Dataset) -> dict[str, Array]:
    """What was measured of the tube at each point: its geometry, and one of its current radii."""
    inputs = {name: data[name].values.astype(float)[data["test"].values] for name in GEOMETRY}
    name = "current_outer_radius" if "outer_diameter" in data else "radius"
    return inputs | {name: measured_radius(data).values.astype(float)}


@dataclass(frozen=True)
class CurrentTube:
    """A tube as it was measured, at each point.

    Attributes
    ----------
    radius : tensor_like
        Internal radius, mm. Where the tube is not possible, that of another one.
    possible : TensorVariable
        Whether there is such a tube at all.
    wall : tensor_like, optional
        ``r_o² − a²``, if the outer radius ``r_o`` was measured.
    """

    energy: StrainEnergy | Sequence[Layer]
    reference: Mapping[str, Any]
    parameters: dict[str, Any]
    radius: Any
    possible: TensorVariable
    wall: Any = None

    @property
    def tubes(self) -> list[Tube]:
        """The tubes that its wall is made of."""
        return tubes_of(self.energy, self.radius, **self.reference, parameters=self.parameters)

    def measured(self, radius: Any) -> Any:
        """The radius that was measured, of an internal radius."""
        return radius if self.wall is None else (radius**2 + self.wall) ** 0.5

    @property
    def growth(self) -> Any:
        """How the internal radius grows with the one that was measured."""
        return 1.0 if self.wall is None else self.measured(self.radius) / self.radius


def current_tube(
    energy: StrainEnergy | Sequence[Layer],
    inputs: Mapping[str, Any],
    geometry: Mapping[str, Any],
    parameters: dict[str, Any],
) -> CurrentTube:
    """Tube of the given `inputs`, see :func:`tube_inputs`, but for the `geometry` given.

    It may hold what :func:`~pymc_hyperelastic.mechanics.tube.inferred_geometry` takes.
    """
    known = {name: inputs[name] for name in GEOMETRY} | dict(geometry)
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
        return CurrentTube(energy, tube, parameters, inputs["radius"], possible)
    k = opening_factor(tube["opening_angle"])
    wall = (outer**2 - tube["inner_radius"] ** 2) / (k * tube["axial_stretch"])
    square = inputs["current_outer_radius"] ** 2 - wall
    possible &= pt.all(square > 0)
    wall = pt.where(square > 0, wall, 0.0)
    radius = pt.sqrt(inputs["current_outer_radius"] ** 2 - wall)
    return CurrentTube(energy, tube, parameters, radius, possible, wall)
