"""Which way a wall is integrated: constant matrices of how many stretches, or how many nodes."""

from bisect import bisect_left
from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, get_args

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.graph.basic import Constant, Variable
from pytensor.graph.replace import vectorize_graph
from pytensor.graph.utils import MissingInputError
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.data.inflation import (
    at_points,
    extension_tests,
    measured_radius,
    points_of,
)
from pymc_hyperelastic.mechanics.axial_force import wall_force
from pymc_hyperelastic.mechanics.collocation import nodes_needed
from pymc_hyperelastic.mechanics.pressure import wall_pressure
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.models.forward.collocated import Collocated, groups_of, known_tubes
from pymc_hyperelastic.models.forward.direct import (
    Direct,
    WallVariables,
    current_tube,
    error_inputs,
    tube_inputs,
)

Array = NDArray[np.float64]
Mode = Literal["auto", "collocation", "quadrature"]

# Orders of Gauss-Legendre quadrature that are tried against the last one, and what they may err,
# relative to the largest value of a curve. With the mode "quadrature" it is the order between.
_ORDERS, _USUAL_ORDER = (8, 12, 16, 24, 32, 64), 32
_ORDER_TOLERANCE = 1e-11
# What quadrature mostly takes, with which constant matrices of extension tests compete.
_CHEAP_ORDER = 12
# Parameters whose pressures exceed the measured ones by this factor are left out: their likelihood
# is nil, whatever the rule.
_BEYOND = 10.0
# Points and parameters at which they are tried.
_MOST_POINTS, _MOST_VALUES = 16, 200
# Draws of the parameters, and corners of the box that holds these.
_DRAWS, _MOST_CORNERS = 256, 1024


def way_to_integrate(
    wall: WallVariables,
    data: xr.Dataset,
    *,
    mode: Mode,
    known_radii: bool,
    errors: Mapping[str, float | None] = MappingProxyType({}),
    **settings: bool,
) -> Collocated | Direct:
    """The cheapest way that is exact, but for rounding, over the range of the parameters.

    The `errors` are standard deviations of what was measured of the tube.
    """
    if mode not in get_args(Mode):
        raise ValueError(f"mode is {mode!r}; expected one of {get_args(Mode)}")

    def direct(order: int) -> Direct:
        return Direct(order, **settings, errors=tuple(errors.items()))

    if mode == "quadrature":
        return direct(_USUAL_ORDER)
    reason = "layers, a geometry that is inferred or has an error, and an error in the radius"
    with_force = settings["with_force"]
    if wall.known_tube and known_radii:
        values = representative_values(wall.energy.split(wall.parameters))
        if values is not None:
            collocated = _collocated(wall.energy, data, values, **settings)
            if collocated is not None and (mode == "collocation" or _is_cheap(collocated, data)):
                return collocated
        reason = f"the response of {wall.energy.name} over the range of these parameters"
    if mode == "collocation":
        raise ValueError(f"{reason} cannot be collocated: use mode='quadrature'")
    return direct(_order_needed(wall, data, errors, with_force))


def _collocated(
    energy: StrainEnergy, data: xr.Dataset, values: list[Array], **settings: bool
) -> Collocated | None:
    """Constant matrices of as many stretches as are exact; None if none of them are."""
    with_force = settings["with_force"]
    held, varied = groups_of(data, known_tubes(data))
    nodes, grid = (nodes_needed(energy, g, values, with_force=with_force) for g in (held, varied))
    if nodes is None or grid is None:
        return None
    return Collocated(nodes.hoop if held else 0, **settings, grid=grid if varied else None)


def _is_cheap(way: Collocated, data: xr.Dataset) -> bool:
    """Whether a grid of stretches is smaller than the walls of the points that it stands for."""
    if way.grid is None:
        return True
    extended = extension_tests(data)
    grids = extended.sum() if way.by_test else 1
    points = extended[data["test"].values].sum()
    return bool(grids * way.grid.hoop * way.grid.axial <= points * _CHEAP_ORDER)


def _order_needed(
    wall: WallVariables, data: xr.Dataset, errors: Mapping[str, float | None], with_force: bool
) -> int:
    """The order after the least at which curves agree with those of the highest one."""
    # At both ends of every curve; of many curves at some.
    radius, stretch = measured_radius(data).values, at_points(data, "axial_stretch")
    spans = [points_of(data, test) for test in range(data.sizes["test"])]
    ends = [span.start + f(radius[span]) for span in spans for f in (np.argmin, np.argmax)]
    for test in np.flatnonzero(extension_tests(data)):
        ends += [spans[test].start + f(stretch[spans[test]]) for f in (np.argmin, np.argmax)]
    some = _some(np.array(ends), _MOST_POINTS)
    inputs = {k: v[some] for k, v in (tube_inputs(data) | error_inputs(data, errors)).items()}
    tubes = current_tube(inputs, wall).tubes
    unknown = [*(v for tube in tubes for v in tube.entries), *wall.geometry.values()]
    unknown += wall.deviations.values()
    if not isinstance(wall.energy, StrainEnergy):
        unknown += [layer.thickness for layer in wall.energy]
    inferred = (v for v in unknown if isinstance(v, Variable) and not isinstance(v, Constant))
    variables = list(dict.fromkeys(inferred))  # in order, and each once
    values = representative_values(variables) if variables else None
    if values is None:
        return _USUAL_ORDER
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
        return _USUAL_ORDER

    def agree(curve: Array, expected: Array) -> bool:
        error = np.abs(curve[possible] - expected[possible])
        scale = np.abs(expected[possible]).max(axis=1, keepdims=True)
        return bool(np.all(error <= _ORDER_TOLERANCE * scale))

    first = bisect_left(orders, True, key=lambda order: all(map(agree, curves(order), exact)))
    return [*orders, highest, highest][first + 1]


def _some(values: NDArray, count: int) -> NDArray:
    """At most so many of the values, evenly spread, the ends included."""
    return values[np.unique(np.linspace(0, len(values) - 1, count).round().astype(int))]


def representative_values(parameters: list[TensorVariable]) -> list[Array] | None:
    """Draws of the parameters, and the corners of the box that holds them.

    None if they depend on something that is not random, or on a distribution that cannot be drawn
    from, so that nothing is known of their range.
    """
    try:
        draws = pm.draw(parameters, draws=_DRAWS, random_seed=1, mode="FAST_COMPILE")
    except (MissingInputError, NotImplementedError):
        return None
    ends = np.array([[d.min(), d.max()] for d in draws])
    # All corners of the box; of one with many, some.
    count = len(draws)
    corner = np.random.default_rng(1).permutation(2**count)[:_MOST_CORNERS]
    bits = (corner >> np.arange(count)[:, None]) & 1
    corners = np.take_along_axis(ends, bits, axis=1)
    return [np.concatenate([d, c]) for d, c in zip(draws, corners, strict=True)]
