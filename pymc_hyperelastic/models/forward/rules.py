"""Which way a wall is integrated: constant matrices of how many stretches, or how many nodes."""

from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from itertools import count
from types import MappingProxyType
from typing import Any, Literal, get_args

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pymc.distributions.distribution import SymbolicRandomVariable
from pymc.distributions.shape_utils import change_dist_size
from pytensor.graph.basic import Constant, Variable
from pytensor.graph.fg import FrozenFunctionGraph
from pytensor.graph.replace import vectorize_graph
from pytensor.graph.traversal import ancestors, graph_inputs
from pytensor.graph.utils import MissingInputError
from pytensor.tensor.random.op import RandomVariable
from pytensor.tensor.random.type import RandomType
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.data.inflation import (
    at_points,
    extension_tests,
    measured_radius,
    points_of,
)
from pymc_hyperelastic.mechanics.axial_force import wall_force
from pymc_hyperelastic.mechanics.empirical import empirical_nodes
from pymc_hyperelastic.mechanics.interpolation import Nodes, nodes_needed
from pymc_hyperelastic.mechanics.known_tubes import KnownTubes
from pymc_hyperelastic.mechanics.layers import tubes_of
from pymc_hyperelastic.mechanics.pressure import wall_pressure
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.wall_nodes import WallNodes
from pymc_hyperelastic.models.forward.collocated import (
    Collocated,
    groups_of,
    groups_of_specimens,
    known_tubes,
)
from pymc_hyperelastic.models.forward.direct import (
    Direct,
    WallVariables,
    current_tube,
    error_inputs,
    tube_inputs,
)
from pymc_hyperelastic.models.forward.divided import Divided
from pymc_hyperelastic.models.moduli import has_additive_stress

Array = NDArray[np.float64]
Mode = Literal["auto", "collocation", "quadrature"]

# Orders of Gauss-Legendre quadrature that are tried against the last one, and what they may err,
# relative to the largest value of a curve. With the mode "quadrature" it is the order between.
_ORDERS, _USUAL_ORDER = (4, 6, 8, 12, 16, 24, 32, 64), 32
HIGHEST_ORDER = _ORDERS[-1]
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
# Draws of distributions that were asked for before, by their expressions; so many at most.
_known_draws: dict[tuple, list[Array]] = {}
_MOST_KNOWN = 64
# Points of extension tests from which on nodes that a smooth law asks for are worth looking for:
# quadrature of fewer is soon done.
_MANY_POINTS = 50
# Draws among which materials are found whose responses the others are combined of; so many of them
# are tried at once.
_MATERIALS, _MOST_MATERIALS, _MOST_DRAWS, _AT_ONCE = 3000, 400, 18000, 500


def way_to_integrate(
    wall: WallVariables,
    data: xr.Dataset,
    *,
    mode: Mode,
    known_radii: bool,
    errors: Mapping[str, float | None] = MappingProxyType({}),
    with_force: bool = False,
    by_test: bool = False,
    nearby: bool = False,
    known: Sequence[Array] = (),
) -> Collocated | Divided | Direct:
    """The cheapest way that is exact, but for rounding, over the range of the parameters.

    The `errors` are standard deviations of what was measured of the tube. Of materials that are
    `known` to matter, entry by entry, curves are right as well. If of every specimen those `nearby`
    are told, see :meth:`ForwardModel.nearby`, nodes for all materials are not looked for.
    """
    if mode not in get_args(Mode):
        raise ValueError(f"mode is {mode!r}; expected one of {get_args(Mode)}")

    def direct(order: int) -> Direct:
        return Direct(order, with_force, by_test, errors=tuple(errors.items()))

    if mode == "quadrature":
        return direct(_USUAL_ORDER)
    reason = "layers, a geometry that is inferred or has an error, and an error in the radius"
    if wall.known_tube and known_radii:
        values = representative_values(wall.energy.split(wall.parameters))
        if values is not None:
            whole = Collocated(0, with_force, by_test)
            if known:
                values = [np.concatenate(both) for both in zip(values, known, strict=True)]
            way: Collocated | Divided | None = _collocated(wall.energy, data, values, whole)
            if way is None or not _is_cheap(way, data):
                in_walls = _in_walls(wall.energy, data, values, whole) if nearby else None
                way = in_walls or _divided(wall, data, values, whole, known) or way
            if way is not None and (mode == "collocation" or _is_cheap(way, data)):
                return way
        reason = f"the response of {wall.energy.name} over the range of these parameters"
    if mode == "collocation":
        raise ValueError(f"{reason} cannot be collocated: use mode='quadrature'")
    ends = np.concatenate(_ends(data))
    inputs = tube_inputs(data) | error_inputs(data, errors)
    inputs = {name: v[ends] for name, v in inputs.items()}
    return direct(_order_needed(wall, data, inputs, with_force))


def errors_of(
    way: Collocated | Divided | Direct,
    energy: StrainEnergy,
    data: xr.Dataset,
    materials: Sequence[Array],
) -> Array:
    """Errors of curves of materials, entry by entry, relative to the largest value of each.

    Of a tube that is not quite known they are those of the measured one.
    """
    tubes = known_tubes(data)
    if isinstance(way, Collocated):
        if not isinstance(way.basis, WallNodes):
            return way.errors(energy, data, materials)
        exact = _curves_of(energy, _USUAL_ORDER, way.with_force)(tubes, materials)
        scales = _scales(exact, tubes, way.with_force)
        found = way.basis.curves(energy, tubes, materials, with_force=way.with_force)
        # Of stiffnesses nothing is known.
        return _largest(found, exact[::2], scales[::2])
    direct = way.slack if isinstance(way, Divided) else way
    curves = _curves_of(energy, direct.order, direct.with_force)
    finer = _curves_of(energy, HIGHEST_ORDER, direct.with_force)
    exact = finer(tubes, materials)
    scales = _scales(exact, tubes, direct.with_force)
    if isinstance(way, Direct):
        return _largest(curves(tubes, materials), exact, scales)
    slack = tubes.divided()[1]
    parts = slack.at(np.flatnonzero(slack.outer_radius > slack.inner_radius))
    of_parts = _largest(curves(parts, materials), finer(parts, materials), scales)
    return np.maximum(way.taut.errors(energy, data, materials), of_parts)


def _scales(exact: Sequence[Array], tubes: KnownTubes, with_force: bool) -> list[Array]:
    """The largest value of each curve, with which errors are compared."""
    scales = [np.abs(curve).max(axis=1, keepdims=True) for curve in exact]
    if with_force:
        # Forces may be nil: that of the pressure on the lumen is their measure, too.
        scales[-1] = np.maximum(scales[-1], np.pi * tubes.radius.max() ** 2 * scales[0])
    return scales


@np.errstate(all="ignore")  # some of the materials may be impossible
def _largest(found: Sequence[Array], exact: Sequence[Array], scales: Sequence[Array]) -> Array:
    """The largest error of each material."""
    relative = [np.abs(a - b) / s for a, b, s in zip(found, exact, scales, strict=True)]
    return np.concatenate(relative, axis=1).max(axis=1, initial=0.0)


def like_measured(
    energy: StrainEnergy, data: xr.Dataset, materials: Sequence[Array]
) -> NDArray[np.bool_]:
    """Which materials follow the pressures of some test, to a half of these (root mean square)."""
    measured = data["pressure"].values
    wrong = _curves_of(energy, _CHEAP_ORDER)(known_tubes(data), materials)[0] - measured
    starts = [points_of(data, test).start for test in range(data.sizes["test"])]
    with np.errstate(all="ignore"):
        left = np.add.reduceat(wrong**2, starts, axis=1)
    return np.any(left < np.add.reduceat(measured**2, starts) / 4, axis=1)


def _collocated(
    energy: StrainEnergy, data: xr.Dataset, values: list[Array], whole: Collocated
) -> Collocated | None:
    """Constant matrices of as many stretches as are exact; None if none of them are."""
    held, varied = groups_of(data, known_tubes(data))
    nodes, grid = (
        nodes_needed(energy, groups, values, with_force=whole.with_force)
        for groups in (held, varied)
    )
    if nodes is None or grid is None:
        return None
    return replace(whole, nodes=nodes.hoop if held else 0, grid=grid if varied else None)


def _divided(
    wall: WallVariables,
    data: xr.Dataset,
    values: list[Array],
    whole: Collocated,
    known: Sequence[Array],
) -> Collocated | Divided | None:
    """The same for parameters whose likelihood is not nil, and for walls in which fibres slacken.

    Constant matrices are then for the parts of walls where ``λθ ≥ 1``. None if stress is not smooth
    there.
    """
    tubes = known_tubes(data)
    kinks = _kinks_in(tubes, wall.energy, values)
    if np.any(kinks > _ROUNDING):
        return None
    whole = replace(whole, taut=bool(np.isfinite(kinks).any()))
    nodes = _nodes_for_possible(wall.energy, data, values, whole)
    collocated = whole
    if nodes is not None:
        collocated = replace(whole, nodes=nodes[0].hoop, grid=nodes[1])
    if nodes is None or not _is_cheap(collocated, data):
        empirical = _empirical(wall, data, whole, known)
        if empirical is None and nodes is None:
            return None
        collocated = empirical or collocated
    if not whole.taut:
        return collocated
    slack = tubes.divided()[1]
    some = _some(np.flatnonzero(slack.outer_radius > slack.inner_radius), _MOST_POINTS)
    slack, walls = slack.at(some), tubes.at(some)
    materials = [_some(v, _MOST_VALUES) for v in values]

    def curves(order: int) -> list[Array]:
        return _curves_of(wall.energy, order, whole.with_force)(slack, materials)

    # Beside the curves of whole walls, those of thin parts may be rounding alone.
    of_walls = _curves_of(wall.energy, HIGHEST_ORDER, whole.with_force)(walls, materials)
    order = _least_order(curves, data, of_walls)
    return Divided(collocated, Direct(order, whole.with_force, whole.by_test))


def _in_walls(
    energy: StrainEnergy, data: xr.Dataset, values: list[Array], whole: Collocated
) -> Collocated | None:
    """Constant matrices of all nodes of quadrature; None where stress is not smooth.

    Fibres that slacken elsewhere than where walls are divided may do so between nodes.
    """
    if np.any(_kinks_in(known_tubes(data), energy, values) > _ROUNDING):
        return None
    # Other walls that take the place of these may have slack parts.
    return replace(whole, basis=WallNodes(_CHEAP_ORDER, divided=_kinks_of(energy) is not None))


def _empirical(
    wall: WallVariables, data: xr.Dataset, way: Collocated, known: Sequence[Array]
) -> Collocated | None:
    """The same with nodes that the law asks for.

    None if stress is no sum over its moduli, and for smooth laws if there are few extension tests.
    """
    energy, tubes = wall.energy, way.tubes(data)
    smooth = not energy.kinks(pt.zeros(()), **wall.parameters)
    few = extension_tests(data)[data["test"].values].sum() < _MANY_POINTS
    if (smooth and few) or not has_additive_stress(energy):
        return None
    all_draws, numbers = _drawn(energy.split(wall.parameters), _MOST_DRAWS, 2), count()

    def draw() -> list[Array]:
        start, found = next(numbers) * _MATERIALS, []
        # Mostly the first of them are enough.
        for first in range(start, start + _MATERIALS, _AT_ONCE):
            draws = [v[first : first + _AT_ONCE] for v in all_draws]
            possible = _possible(energy, data, draws, _BEYOND).all(axis=0)
            found.append([v[possible] for v in draws])
            if sum(len(values[0]) for values in found) >= _MOST_MATERIALS:
                break
        return [np.concatenate(values)[:_MOST_MATERIALS] for values in zip(*found, strict=True)]

    if len(draw()[0]) < _FEWEST:
        return None
    groups = groups_of_specimens(data, tubes, by_test=way.by_test)
    settings: dict[str, Any] = {"with_force": way.with_force, "known": known}
    nodes = empirical_nodes(energy, tubes, groups, draw, **settings)
    return replace(way, basis=nodes) if nodes else None


def _kinks_in(tubes: KnownTubes, energy: StrainEnergy, values: list[Array]) -> Array:
    """Values of ``ln λθ`` (kink, material) at which stress is not smooth, NaN beyond the walls."""
    function = _kinks_of(energy)
    if function is None:
        return np.empty((0, len(values[0])))
    stretches = _some(np.unique(tubes.axial_stretch), _MOST_POINTS)
    with np.errstate(all="ignore"):
        found = function(np.log(stretches)[:, None], *(v[None] for v in values))
    shape = len(stretches), len(values[0])
    kinks = np.concatenate([np.broadcast_to(kink, shape) for kink in found])
    faces = np.array(tubes.log_hoop)
    return np.where((kinks > faces.min()) & (kinks < faces.max()), kinks, np.nan)


@cache
def _kinks_of(energy: StrainEnergy) -> Callable[..., list[Array]] | None:
    """Kinks by ``ln λz`` (stretch, 1) and the entries of materials (1, material), if there are."""
    log_axial = pt.col("log_axial", dtype="float64")
    entries = [pt.row(name, dtype="float64") for name in energy.entry_names]
    kinks = energy.kinks(log_axial, **energy.join(entries))
    if not kinks:
        return None
    return pytensor.function(
        [log_axial, *entries], list(kinks), mode="FAST_COMPILE", on_unused_input="ignore"
    )


def _nodes_for_possible(
    energy: StrainEnergy, data: xr.Dataset, values: list[Array], way: Collocated
) -> tuple[Nodes, Nodes | None] | None:
    """Nodes of inflation tests and of extension tests for parameters that are possible there.

    Any of the tests may come to stand alone: what is impossible in another one still counts in it.
    """
    possible = _possible(energy, data, values, _FAR_BEYOND)
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


def _possible(
    energy: StrainEnergy, data: xr.Dataset, values: list[Array], beyond: float
) -> NDArray[np.bool_]:
    """Which parameters (test, value) have pressures that are not far beyond all measured ones."""
    curves = _curves_of(energy, _CHEAP_ORDER)
    tubes, ends = known_tubes(data), _ends(data)
    limit = beyond * np.abs(data["pressure"].values).max()
    return np.array(
        [np.all(np.abs(curves(tubes.at(rows), values)[0]) < limit, axis=1) for rows in ends]
    )


@cache
def _curves_of(
    energy: StrainEnergy, order: int, with_force: bool = False
) -> Callable[[KnownTubes, Sequence[Array]], list[Array]]:
    """Pressures, stiffnesses and axial forces (material, point) of known tubes."""
    tube = [pt.row(dtype="float64") for _ in range(5)]
    entries = [pt.col(name, dtype="float64") for name in energy.entry_names]
    tubes = tubes_of(energy, tube[0], tube[1:], energy.join(entries))
    outputs = list(wall_pressure(tubes, order))
    if with_force:
        outputs.append(wall_force(tubes, order))
    function = pytensor.function([*tube, *entries], outputs, mode="FAST_COMPILE")

    def curves(tubes: KnownTubes, materials: Sequence[Array]) -> list[Array]:
        with np.errstate(all="ignore"):
            return function(*(x.T for x in tubes.walls), *(v[:, None] for v in materials))

    return curves


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
    if way.grid is None or way.basis:
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

    return _least_order(curves, data)


def _least_order(
    curves: Callable[[int], list[Array]], data: xr.Dataset, of_walls: Sequence[Array] | None = None
) -> int:
    """The order after the least at which curves, pressures first, agree with those of the highest.

    They may differ by so much of the largest of the curves of whole walls, of which these may be
    those of parts. Materials whose pressures are far beyond the measured ones do not count.
    """
    *orders, highest = _ORDERS
    exact = curves(highest)
    of_walls = exact if of_walls is None else of_walls
    possible = np.abs(of_walls[0]).max(axis=1) < _BEYOND * np.abs(data["pressure"].values).max()
    if not possible.any():
        return _USUAL_ORDER

    def agree(curve: Array, expected: Array, of_wall: Array) -> bool:
        error = np.abs(curve[possible] - expected[possible])
        scale = np.abs(of_wall[possible]).max(axis=1, keepdims=True)
        return bool(np.all(error <= _ORDER_TOLERANCE * scale))

    def enough(order: int) -> bool:
        return all(map(agree, curves(order), exact, of_walls))

    first = bisect_left(orders, True, key=enough)
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
        draws = _drawn(parameters, _DRAWS, 1)
    except (MissingInputError, NotImplementedError):
        return None
    ends = np.array([[d.min(), d.max()] for d in draws])
    # All corners of the box; of one with many, some.
    count = len(draws)
    corner = np.random.default_rng(1).permutation(2**count)[:_MOST_CORNERS]
    bits = (corner >> np.arange(count)[:, None]) & 1
    corners = np.take_along_axis(ends, bits, axis=1)
    return [np.concatenate([d, c]) for d, c in zip(draws, corners, strict=True)]


def _drawn(parameters: Sequence[TensorVariable], count: int, seed: int) -> list[Array]:
    """Draws of the parameters: all at once, unless a distribution depends on what is drawn.

    Those of the same distributions are remembered: they take longer to compile than to draw.
    """
    inputs = [v for v in graph_inputs(parameters) if not isinstance(v, Constant)]
    if not all(isinstance(v.type, RandomType) for v in inputs):
        return _drawn_anew(parameters, count, seed)
    key = FrozenFunctionGraph.from_io(inputs, parameters), count, seed
    draws = _known_draws.get(key)
    if draws is None:
        if len(_known_draws) >= _MOST_KNOWN:
            _known_draws.pop(next(iter(_known_draws)))
        draws = _known_draws[key] = _drawn_anew(parameters, count, seed)
    return draws


def _drawn_anew(parameters: Sequence[TensorVariable], count: int, seed: int) -> list[Array]:
    randoms = [v for v in ancestors(parameters) if _is_random(v)]
    if any(_is_random(v) for rv in randoms for v in ancestors(rv.owner.inputs)):
        return pm.draw(parameters, draws=count, random_seed=seed, mode="FAST_COMPILE")
    batches = {rv: change_dist_size(rv, (count,), expand=True) for rv in randoms}
    outputs = vectorize_graph(parameters, batches)
    draws = pm.draw(outputs, random_seed=seed, mode="FAST_COMPILE")
    # What no distribution enters is one number for all.
    return [
        np.broadcast_to(d, (count, *np.shape(d)[np.ndim(d) - p.type.ndim :]))
        for d, p in zip(draws, parameters, strict=True)
    ]


def _is_random(variable: Variable) -> bool:
    return variable.owner is not None and isinstance(
        variable.owner.op, RandomVariable | SymbolicRandomVariable
    )
