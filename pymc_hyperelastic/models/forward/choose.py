"""The choice of an integrator: the cheapest one that is accurate over the range of the prior."""

import warnings
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import Literal, get_args

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pytensor.graph.utils import MissingInputError

from pymc_hyperelastic.data.inflation import extension_tests
from pymc_hyperelastic.files.place import PACKAGE
from pymc_hyperelastic.mechanics.interpolation import ChebyshevNodes, evenly, nodes_needed
from pymc_hyperelastic.mechanics.wall import WALL_ORDER
from pymc_hyperelastic.models.forward.integrator import Integrator
from pymc_hyperelastic.models.forward.pointwise import PointwiseQuadrature
from pymc_hyperelastic.models.forward.prior_draws import DRAWS, possible_in_tests, walls_of_prior
from pymc_hyperelastic.models.forward.selection import FINER, select_nodes
from pymc_hyperelastic.models.forward.tabulated import TabulatedQuadrature, groups_of, known_tubes
from pymc_hyperelastic.models.forward.tube_variables import WallVariables

Mode = Literal["auto", "collocation", "quadrature"]

# Fewest possible materials of the prior by which its range is known.
_FEWEST = 32
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
    that are selected in the walls, for many points; else quadrature of 32 nodes, or as few as are
    accurate. Curves may err by the `tolerance`; by selected nodes those of a fraction of the
    materials, `inaccurate`, by more. `geometry_sd` are the errors of a measured geometry.
    """
    if mode not in get_args(Mode):
        raise ValueError(f"mode is {mode!r}; expected one of {get_args(Mode)}")
    sd = tuple(geometry_sd.items())
    quadrature = partial(
        PointwiseQuadrature, with_force=with_force, by_test=by_test, geometry_sd=sd
    )
    if mode == "quadrature":
        return quadrature(WALL_ORDER)
    try:
        walls = walls_of_prior(wall, data)
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
    possible = possible_in_tests(walls, data, geometry_sd=sd)
    in_all = np.flatnonzero(possible.all(axis=0))
    fewest = _FEWEST if wall.unknown else 1
    reason = "layers, a geometry that is inferred or has an error, and an error in the radius"
    if wall.known_tube and known_radii:
        found, reason = None, f"the response of {wall.energy.name} over the range of its parameters"
        tabulated = TabulatedQuadrature(ChebyshevNodes(2), with_force, by_test, tolerance)
        if not extension_tests(data).any():
            found = _chebyshev(tabulated, walls, data, possible, fewest)
        draws, many = in_all[in_all < DRAWS], data.sizes["obs"] >= _MANY_POINTS
        if found is None and len(draws) >= _FEWEST and (many or mode == "collocation"):
            found = select_nodes(tabulated, walls.some(draws), data, inaccurate)
        if found is not None:
            return found
    if mode == "collocation":
        raise ValueError(f"{reason} cannot be collocated: use mode='quadrature'")
    if len(in_all) < fewest:
        return quadrature(WALL_ORDER)
    order, some = WALL_ORDER, walls.some(in_all[evenly(len(in_all), _FEWEST)])
    while quadrature(order // 2).errors(data, some).max() <= FINER * tolerance:
        order //= 2
    return quadrature(order)


def _chebyshev(
    tabulated: TabulatedQuadrature,
    walls: WallVariables,
    data: xr.Dataset,
    possible: NDArray[np.bool_],
    fewest: int,
) -> TabulatedQuadrature | None:
    """Chebyshev nodes for all materials, or else for the possible ones; None if they are too many.

    In each group of points the materials that are possible in all of its tests count, if these are
    not too few.
    """
    tubes, most, with_force = known_tubes(data), 0, tabulated.with_force
    for group in groups_of(data, tubes, by_test=tabulated.by_test, by_stretch=True):
        own = possible[np.unique(data["test"].values[group.points])].all(axis=0)
        if own.sum() < fewest:
            return None
        needed = partial(nodes_needed, walls.energy, tubes, [group], with_force=with_force)
        count = needed(walls.materials)
        if count is None:
            count = needed(walls.some(own).materials)
        if count is None:
            return None
        most = max(most, count)
    return replace(tabulated, basis=ChebyshevNodes(most))
