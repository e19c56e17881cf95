"""The choice of an integrator: the cheapest one that is accurate over the range of the prior."""

import warnings
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import Any, Literal, get_args

import numpy as np
import xarray as xr
from pytensor.graph.utils import MissingInputError

from pymc_hyperelastic.data.inflation import extension_tests
from pymc_hyperelastic.files.place import PACKAGE
from pymc_hyperelastic.mechanics.interpolation import ChebyshevNodes, evenly, nodes_needed
from pymc_hyperelastic.mechanics.wall import WALL_ORDER
from pymc_hyperelastic.models.forward.integrator import (
    REFERENCE_ORDER,
    Integrator,
    ends_of_tests,
)
from pymc_hyperelastic.models.forward.pointwise import PointwiseQuadrature
from pymc_hyperelastic.models.forward.prior_draws import (
    BEYOND,
    FEWEST,
    in_numbers,
    largest_measured,
    largest_pressures,
    representative_values,
)
from pymc_hyperelastic.models.forward.selection import select_nodes
from pymc_hyperelastic.models.forward.tabulated import (
    TabulatedQuadrature,
    groups_of,
    known_tubes,
)
from pymc_hyperelastic.models.forward.tube_variables import Array, WallVariables

Mode = Literal["auto", "collocation", "quadrature"]

# Orders of quadrature that are compared with the reference order.
_ORDERS = (4, 6, 8, 12, 16, 24, 32)
# Largest error of an order, relative to the largest value of a curve: a hundredth of the usual
# tolerance of matrices, so that pointwise quadrature is the more accurate integrator.
_ORDER_TOLERANCE = 1e-11
# Largest pressures of the materials for which Chebyshev nodes are chosen, in largest measured ones:
# 100 times as large as for the other integrators; chosen by experiment.
_FAR_BEYOND = 1000.0
# Tolerance of Chebyshev coefficients of these materials, relative to the largest coefficient: ten
# times the usual one, because exponentials of squares have larger rounding errors.
_COEFFICIENT_TOLERANCE = 1e-13
# Points and materials for which orders are compared.
_MOST_POINTS = 16
_MOST_MATERIALS = 200
# Points of the data from which on it pays to select nodes: quadrature of fewer takes less time.
_MANY_POINTS = 50


def choose_integrator(
    wall: WallVariables,
    data: xr.Dataset,
    *,
    mode: Mode,
    known_radii: bool,
    geometry_sd: Mapping[str, float | None] = MappingProxyType({}),
    with_force: bool = False,
    by_test: bool = False,
    tolerance: float = 1e-9,
    inaccurate: float = 1 / 200,
) -> Integrator:
    """Return the cheapest integrator that is accurate over the range of the wall's distributions.

    These are Chebyshev nodes if the stretch of each test is held and the response is smooth; nodes
    that are selected in the walls, for many points; else quadrature of the least order that will
    do. Curves by selected nodes may err by the `tolerance`; a fraction of the materials of the
    prior may be `inaccurate`. `geometry_sd` are the errors of a measured geometry.
    """
    if mode not in get_args(Mode):
        raise ValueError(f"mode is {mode!r}; expected one of {get_args(Mode)}")
    sd = tuple(geometry_sd.items())
    quadrature = partial(
        PointwiseQuadrature, with_force=with_force, by_test=by_test, geometry_sd=sd
    )
    if mode == "quadrature":
        return quadrature(WALL_ORDER)
    wall = wall.by_entries()
    try:
        draws = representative_values(wall.unknown) if wall.unknown else []
    except (MissingInputError, NotImplementedError) as error:
        unknown = f"the prior cannot be drawn from ({str(error).splitlines()[0]})"
        if mode == "collocation":
            raise ValueError(f"{unknown}: use mode='quadrature'") from error
        warnings.warn(
            f"{unknown}, so that its range is not known: walls are integrated with {WALL_ORDER} "
            "nodes. mode='quadrature' asks for this without a warning",
            skip_file_prefixes=(PACKAGE,),
        )
        return quadrature(WALL_ORDER)
    reason = "layers, a geometry that is inferred or has an error, and an error in the radius"
    if wall.known_tube and known_radii:
        tabulated = TabulatedQuadrature(ChebyshevNodes(2), with_force, by_test, tolerance)
        found = None
        if not extension_tests(data).any():
            found = _chebyshev(tabulated, wall, data, draws)
        if found is None and (mode == "collocation" or data.sizes["obs"] >= _MANY_POINTS):
            found = select_nodes(tabulated, wall, data, inaccurate)
        if found is not None:
            return found
        reason = f"the response of {wall.energy.name} over the range of these parameters"
    if mode == "collocation":
        raise ValueError(f"{reason} cannot be collocated: use mode='quadrature'")
    return quadrature(_least_order(quadrature, wall, data, draws))


def _chebyshev(
    tabulated: TabulatedQuadrature, wall: WallVariables, data: xr.Dataset, draws: Sequence[Array]
) -> TabulatedQuadrature | None:
    """Chebyshev nodes for all draws, or for all possible ones; None if they are too many.

    The model may be used for one test alone: materials that are impossible in another test count.
    """
    energy, tubes = wall.energy, known_tubes(data)
    numbers = in_numbers(wall, data, draws).materials
    settings: dict[str, Any] = {"with_force": tabulated.with_force}
    groups = groups_of(data, tubes, by_test=False, by_stretch=True)
    count = nodes_needed(energy, tubes, groups, numbers, **settings)
    if count is None:
        possible = largest_pressures(wall, data, draws) < largest_measured(data, _FAR_BEYOND)
        settings["tolerance"] = _COEFFICIENT_TOLERANCE
        counts: list[int | None] = []
        for group in groups + groups_of(data, tubes, by_test=True, by_stretch=True):
            own = possible[np.unique(data["test"].values[group.points])].all(axis=0)
            if own.sum() < FEWEST:
                return None
            some = [values[own] for values in numbers]
            counts.append(nodes_needed(energy, tubes, [group], some, **settings))
            if counts[-1] is None:
                return None
        count = max(c for c in counts if c is not None)
    return replace(tabulated, basis=ChebyshevNodes(count))


def _least_order(
    quadrature: Any, wall: WallVariables, data: xr.Dataset, draws: Sequence[Array]
) -> int:
    """The order after the least at which curves agree with those of the reference order."""
    points = np.unique(np.concatenate(ends_of_tests(data)))
    points = points[evenly(len(points), _MOST_POINTS)]
    some = [values[evenly(len(values), _MOST_MATERIALS)] for values in draws]
    numbers = in_numbers(wall, data, some)

    def curves(order: int) -> list[Array]:
        return [*quadrature(order).values(data, numbers, points).values()]

    exact = curves(REFERENCE_ORDER)
    possible = np.abs(exact[0]).max(axis=1) < largest_measured(data, BEYOND)
    if not possible.any():
        return WALL_ORDER

    def enough(order: int) -> bool:
        return all(
            np.all(
                np.abs(curve - expected)[possible]
                <= _ORDER_TOLERANCE * np.abs(expected[possible]).max(axis=1, keepdims=True)
            )
            for curve, expected in zip(curves(order), exact, strict=True)
        )

    least = bisect_left(_ORDERS, True, key=enough)
    return [*_ORDERS, REFERENCE_ORDER, REFERENCE_ORDER][least + 1]
