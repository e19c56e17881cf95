"""How the wall is integrated in a model: constant matrices, or how many nodes of quadrature."""

from collections.abc import Mapping
from itertools import pairwise
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import pytensor
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.axial_force import AxialForceIntegral
from pymc_hyperelastic.collocation import nodes_needed, representative_values
from pymc_hyperelastic.data import GEOMETRY, measured_radius, points_of
from pymc_hyperelastic.pressure import PressureIntegral
from pymc_hyperelastic.strain_energy.base import StrainEnergy
from pymc_hyperelastic.tube import opening_factor

__all__ = ["Mode", "Rule", "current_tube", "rule_for", "tube_inputs"]

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
    energy: StrainEnergy,
    data: xr.Dataset,
    parameters: dict[str, Any],
    geometry: Mapping[str, Any] | None = None,
    *,
    mode: Mode = "auto",
    with_force: bool = False,
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
    if geometry and mode == "collocation":
        raise ValueError(
            f"mode='collocation' needs a known geometry, but {sorted(geometry)} are inferred"
        )
    if mode == "quadrature":
        return Rule("quadrature", 32)
    if not geometry:
        nodes = nodes_needed(energy, data, parameters, with_force=with_force)
        if nodes is not None:
            return Rule("collocation", nodes)
    if mode == "collocation":
        raise ValueError(
            f"the response of {energy.name} cannot be collocated over the range of these "
            "parameters: use mode='quadrature'"
        )
    return Rule("quadrature", _order_needed(energy, data, parameters, geometry or {}, with_force))


def _order_needed(
    energy: StrainEnergy,
    data: xr.Dataset,
    parameters: dict[str, Any],
    geometry: Mapping[str, Any],
    with_force: bool,
) -> int:
    """The order after the least at which curves agree with those of the highest one."""
    values = representative_values([*energy.split(parameters), *geometry.values()])
    if values is None:
        return 32
    # At both ends of every curve; of many curves at some.
    radius = measured_radius(data).values
    spans = [points_of(data, test) for test in range(data.sizes["test"])]
    ends = [span.start + f(radius[span]) for span in spans for f in (np.argmin, np.argmax)]
    inputs = {k: v[_some(np.array(ends), _MOST_POINTS)] for k, v in tube_inputs(data).items()}
    values = [_some(v, _MOST_VALUES)[:, None] for v in values]
    symbols = [pt.tensor(dtype="float64", shape=(None, 1)) for _ in values]
    count = len(energy.entry_names)
    tube = {name: inputs[name] for name in GEOMETRY}
    tube |= dict(zip(geometry, symbols[count:], strict=True))
    _, radius, _ = current_tube(inputs, tube)

    def curves(order: int) -> list[Array]:
        settings: dict[str, Any] = {"strain_energy": energy, "order": order}
        integral_inputs = radius, *tube.values(), *symbols[:count]
        outputs = PressureIntegral(**settings)(*integral_inputs)
        if with_force:
            outputs = [*outputs, AxialForceIntegral(**settings)(*integral_inputs)]
        function = pytensor.function(symbols, outputs, mode="FAST_COMPILE")
        with np.errstate(all="ignore"):
            return function(*values)

    *orders, highest = _ORDERS
    exact = curves(highest)
    possible = np.abs(exact[0]).max(axis=1) < _BEYOND * np.abs(data["pressure"].values).max()
    if not possible.any():
        return 32

    def agree(curve: Array, expected: Array) -> bool:
        error = np.abs(curve - expected)[possible]
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


def current_tube(
    inputs: Mapping[str, Any], tube: Mapping[str, Any]
) -> tuple[TensorVariable, Any, Any]:
    """Whether a tube is possible, its internal radius, and how that grows with the measured one.

    The last is ``r_o/a`` where the outer radius ``r_o`` was measured, and 1 else. Where the wall
    has no room in the measured outer diameter, or no thickness, the radius is that of another tube,
    which is possible.
    """
    if "current_outer_radius" not in inputs:
        return pt.all(tube["outer_radius"] > tube["inner_radius"]), inputs["radius"], 1.0
    outer = inputs["current_outer_radius"]
    k = opening_factor(tube["opening_angle"])
    wall = (tube["outer_radius"] ** 2 - tube["inner_radius"] ** 2) / (k * tube["axial_stretch"])
    square = outer**2 - wall
    fits = (square > 0) & (wall > 0)
    radius = pt.sqrt(pt.where(fits, square, outer**2))
    return pt.all(fits), radius, outer / radius
