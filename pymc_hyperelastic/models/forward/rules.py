"""Which way a wall is integrated: constant matrices of how many stretches, or how many nodes."""

from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import replace
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
from pymc_hyperelastic.mechanics.collocation import Nodes, nodes_needed
from pymc_hyperelastic.mechanics.known_tubes import KnownTubes
from pymc_hyperelastic.mechanics.pressure import PressureIntegral, wall_pressure
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.models.forward.collocated import Collocated, groups_of, known_tubes
from pymc_hyperelastic.models.forward.direct import (
    Direct,
    WallVariables,
    current_tube,
    error_inputs,
    tube_inputs,
)
from pymc_hyperelastic.models.forward.divided import Divided

Array = NDArray[np.float64]
Mode = Literal["auto", "collocation", "quadrature"]

# Orders of Gauss-Legendre quadrature that are tried against the last one, and what they may err,
# relative to the largest value of a curve. With the mode "quadrature" it is the order between.
_ORDERS, _USUAL_ORDER = (4, 6, 8, 12, 16, 24, 32, 64), 32
_ORDER_TOLERANCE = 1e-11
# What quadrature mostly takes, with which constant matrices of extension tests compete.
_CHEAP_ORDER = 12
# Parameters whose pressures exceed the measured ones by this factor are left out: their likelihood
# is nil, whatever the rule.
_BEYOND = 10.0
# The same where constant matrices are to be exact for fewer parameters than all. Coefficients of
# the exponentials of squares, in laws of fibres, have rounding errors of more than usual.
_FAR_BEYOND, _TOLERANCE_OF_POSSIBLE = 1000.0, 1e-13
# At least so many of the representative parameters must be left then.
_FEWEST = 32
# Of logarithms of stretches: a kink at 1 is not beyond 1.
_ROUNDING = 1e-12
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
) -> Collocated | Divided | Direct:
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
    if wall.known_tube and known_radii:
        values = representative_values(wall.energy.split(wall.parameters))
        if values is not None:
            collocated = _collocated(wall.energy, data, values, **settings)
            way = collocated or _divided(wall, data, values, **settings)
            if way is not None and (mode == "collocation" or _is_cheap(way, data)):
                return way
        reason = f"the response of {wall.energy.name} over the range of these parameters"
    if mode == "collocation":
        raise ValueError(f"{reason} cannot be collocated: use mode='quadrature'")
    ends = np.concatenate(_ends(data))
    inputs = tube_inputs(data) | error_inputs(data, errors)
    inputs = {name: v[ends] for name, v in inputs.items()}
    return direct(_order_needed(wall, data, inputs, settings["with_force"]))


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


def _divided(
    wall: WallVariables, data: xr.Dataset, values: list[Array], **settings: bool
) -> Collocated | Divided | None:
    """The same for parameters whose likelihood is not nil, and for walls in which fibres slacken.

    Constant matrices are then for the parts of walls where ``λθ ≥ 1``. None if stress is not smooth
    there.
    """
    tubes = known_tubes(data)
    kinks = _kinks_in(tubes, wall.energy, values)
    if np.any(kinks > _ROUNDING):
        return None
    whole = Collocated(0, **settings, grid=None, taut=kinks.size > 0)
    nodes = _nodes_for_possible(wall.energy, data, values, whole)
    if nodes is None:
        return None
    held, varied = nodes
    collocated = replace(whole, nodes=held.hoop, grid=varied)
    if not kinks.size:
        return collocated
    slack = tubes.divided()[1]
    points = np.flatnonzero(slack.outer_radius > slack.inner_radius)
    inputs = {n: getattr(slack, n)[points] for n in ("radius", *GEOMETRY)}
    order = _order_needed(wall, data, inputs, settings["with_force"])
    return Divided(collocated, Direct(order, settings["with_force"], settings["by_test"]))


def _kinks_in(tubes: KnownTubes, energy: StrainEnergy, values: list[Array]) -> Array:
    """Values of ``ln λθ`` in the walls at which stress is not smooth for some of the parameters."""
    log_axial = pt.col("log_axial", dtype="float64")
    entries = [pt.row(name, dtype="float64") for name in energy.entry_names]
    kinks = energy.kinks(log_axial, **energy.join(entries))
    if not kinks:
        return np.empty(0)
    function = pytensor.function(
        [log_axial, *entries], list(kinks), mode="FAST_COMPILE", on_unused_input="ignore"
    )
    stretches = _some(np.unique(tubes.axial_stretch), _MOST_POINTS)
    with np.errstate(all="ignore"):
        found = function(np.log(stretches)[:, None], *(v[None] for v in values))
    all_kinks = np.concatenate([np.ravel(kink) for kink in found])
    faces = np.array(tubes.log_hoop)
    return all_kinks[(all_kinks > faces.min()) & (all_kinks < faces.max())]


def _nodes_for_possible(
    energy: StrainEnergy, data: xr.Dataset, values: list[Array], way: Collocated
) -> tuple[Nodes, Nodes | None] | None:
    """Nodes of inflation tests and of extension tests for parameters that are possible there.

    Any of the tests may come to stand alone: what is impossible in another one still counts in it.
    """
    possible = _possible(energy, data, values)
    tubes, with_force = way.tubes(data), way.with_force
    needed: list[list[Nodes]] = [[], []]
    for by_test in (False, True):
        for kind, groups in zip(needed, groups_of(data, tubes, by_test=by_test), strict=True):
            for group in groups:
                own = possible[np.unique(data["test"].values[group.points])].all(axis=0)
                if own.sum() < _FEWEST:
                    return None
                nodes = nodes_needed(
                    energy,
                    [group],
                    [v[own] for v in values],
                    with_force=with_force,
                    tolerance=_TOLERANCE_OF_POSSIBLE,
                )
                if nodes is None:
                    return None
                kind.append(nodes)
    held, varied = ([max(n) for n in zip(*kind, strict=True)] for kind in needed)
    return Nodes(*held) if held else Nodes(0), Nodes(*varied) if varied else None


def _possible(energy: StrainEnergy, data: xr.Dataset, values: list[Array]) -> NDArray[np.bool_]:
    """Which parameters (test, value) have pressures that are not far beyond all measured ones."""
    inputs = [pt.row(dtype="float64") for _ in range(5)]
    inputs += [pt.col(name, dtype="float64") for name in energy.entry_names]
    pressure = PressureIntegral(strain_energy=energy, order=_CHEAP_ORDER)(*inputs)[0]
    function = pytensor.function(inputs, pressure, mode="FAST_COMPILE")
    tubes, ends = known_tubes(data), _ends(data)
    limit = _FAR_BEYOND * np.abs(data["pressure"].values).max()
    entries = [v[:, None] for v in values]
    with np.errstate(all="ignore"):
        return np.array(
            [
                np.all(np.abs(function(*(x.T for x in tubes.at(rows).walls), *entries)) < limit, 1)
                for rows in ends
            ]
        )


def _ends(data: xr.Dataset) -> list[NDArray[np.intp]]:
    """Points at both ends of every test: of its radii, and of its axial stretches if they vary."""
    along = [measured_radius(data).values, at_points(data, "axial_stretch")]
    spans = [points_of(data, test) for test in range(data.sizes["test"])]
    return [
        np.unique([s.start + f(x[s]) for x in along for f in (np.argmin, np.argmax)]) for s in spans
    ]


def _is_cheap(way: Collocated | Divided, data: xr.Dataset) -> bool:
    """Whether a grid of stretches is smaller than the walls of the points that it stands for."""
    way = way.taut if isinstance(way, Divided) else way
    if way.grid is None:
        return True
    extended = extension_tests(data)
    grids = extended.sum() if way.by_test else 1
    points = extended[data["test"].values].sum()
    return bool(grids * way.grid.hoop * way.grid.axial <= points * _CHEAP_ORDER)


def _order_needed(
    wall: WallVariables, data: xr.Dataset, inputs: dict[str, NDArray], with_force: bool
) -> int:
    """The order after the least at which curves agree with those of the highest one.

    They are those of walls of these `inputs`, of many at some.
    """
    some = _some(np.arange(len(inputs["axial_stretch"])), _MOST_POINTS)
    inputs = {name: v[some] for name, v in inputs.items()}
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
