"""The choice of an integrator: the cheapest one that is accurate over the range of the prior."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal, get_args

import numpy as np
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.compile.sharedvalue import SharedVariable
from pytensor.graph.basic import Variable
from pytensor.graph.traversal import walk
from pytensor.graph.utils import MissingInputError

from pymc_hyperelastic.data.inflation import extension_tests
from pymc_hyperelastic.evidence.batched import is_random
from pymc_hyperelastic.mechanics.interpolation import ChebyshevNodes, evenly, nodes_needed
from pymc_hyperelastic.mechanics.selected_nodes import SelectedNodes
from pymc_hyperelastic.mechanics.wall import WALL_ORDER
from pymc_hyperelastic.messages import PACKAGE
from pymc_hyperelastic.models.forward.integrator import (
    MOST_ROUNDS,
    Integrator,
    PointwiseQuadrature,
    ends_of_tests,
)
from pymc_hyperelastic.models.forward.numbers import numeric_curves
from pymc_hyperelastic.models.forward.tabulated import TabulatedQuadrature
from pymc_hyperelastic.models.forward.tube_variables import Array, WallVariables
from pymc_hyperelastic.models.moduli import has_additive_stress
from pymc_hyperelastic.models.priors import FEW_DRAWS, RANGE_DRAWS, draws_of

Mode = Literal["auto", "collocation", "quadrature"]

# Materials whose pressures exceed the largest measured one by this factor do not count, because
# their likelihood is nil.
BEYOND = 10.0
# Points of the data from which on it pays to select nodes: quadrature of fewer takes less time.
_MANY_POINTS = 50
# Fraction of the draws whose curves may be inaccurate without more nodes, if the law is smooth. At
# the kinks of laws with fibres, more nodes help little.
_FEW = 1 / 200
# Tolerance of snapshots, and of orders of quadrature, in tolerances of the curves: those of other
# materials err by more than those of the materials for which they are chosen.
FINER = 1e-2


def choose_integrator(
    wall: WallVariables,
    data: xr.Dataset,
    quadrature: PointwiseQuadrature,
    *,
    mode: Mode,
    known_radii: bool,
    tolerance: float,
    inaccurate: float,
) -> Integrator:
    """Return the cheapest integrator that is accurate over the range of the wall's distributions.

    These are Chebyshev nodes if the stretch of each test is held and the response is smooth; nodes
    that are selected in the walls, for many points; else the `quadrature`, or one of fewer nodes.
    Curves may err by the `tolerance`; by selected nodes those of a fraction of the materials,
    `inaccurate`, by more.
    """
    if mode not in get_args(Mode):
        raise ValueError(f"mode is {mode!r}; expected one of {get_args(Mode)}")
    if mode == "quadrature":
        return quadrature
    try:
        walls = draws_of_prior(wall, data.sizes["test"])
    except (MissingInputError, NotImplementedError) as error:
        unknown = f"the prior cannot be drawn from ({str(error).splitlines()[0]})"
        if mode == "collocation":
            raise ValueError(f"{unknown}: use mode='quadrature'") from error
        warnings.warn(
            f"{unknown}, so that its range is not known: walls are integrated with "
            f"{quadrature.order} nodes. mode='quadrature' asks for this without a warning",
            skip_file_prefixes=(PACKAGE,),
        )
        return quadrature
    possible = possible_in_tests(walls, data, geometry_sd=quadrature.geometry_sd)
    in_all = np.flatnonzero(possible.all(axis=0))
    fewest = FEW_DRAWS if wall.unknown else 1
    reason = "layers, a geometry that is inferred or has an error, and an error in the radius"
    if wall.known_tube and known_radii:
        found, reason = None, f"the response of {wall.energy.name} over the range of its parameters"
        tabulated = TabulatedQuadrature(ChebyshevNodes(2), tolerance, **quadrature.settings)
        in_any = np.flatnonzero(possible.any(axis=0))
        if len(in_any) >= fewest and not extension_tests(data).any():
            found = _chebyshev(tabulated, walls, data, walls.some(in_any))
        draws, many = in_all[in_all < RANGE_DRAWS], data.sizes["obs"] >= _MANY_POINTS
        if found is None and len(draws) >= FEW_DRAWS and (many or mode == "collocation"):
            found = _select_nodes(tabulated, walls.some(draws), data, inaccurate)
        if found is not None:
            return found
    if mode == "collocation":
        raise ValueError(f"{reason} cannot be collocated: use mode='quadrature'")
    if len(in_all) < fewest:
        return quadrature
    some = walls.some(in_all[evenly(len(in_all), FEW_DRAWS)])
    limit = FINER * tolerance
    while (fewer := quadrature.quadrature(quadrature.order // 2)).errors(data, some).max() <= limit:
        quadrature = fewer
    return quadrature


def draws_of_prior(wall: WallVariables, tests: int) -> WallVariables:
    """Return the wall with draws of the prior, as numbers, in place of all that is unknown.

    Raises MissingInputError or NotImplementedError if a prior cannot be drawn from, or depends on a
    variable that is not random, such as pm.Data: it may be set to any value later.
    """
    wall, rng = wall.mapped(lambda value: value), np.random.default_rng(1)  # by entries of vectors
    for value in wall.unknown:
        before = list(walk([value], _parents))
        if not any(map(is_random, before)):
            raise NotImplementedError(f"{value} depends on no random variable")
        for other in before:
            if isinstance(other, SharedVariable):
                raise NotImplementedError(f"it depends on {other}, which may be set to any value")
    draws = draws_of(wall.unknown, RANGE_DRAWS) if wall.unknown else []
    values = {v: _with_box(d, rng) for v, d in zip(wall.unknown, draws, strict=True)}
    return wall.with_values(values, tests)


def _parents(variable: Variable) -> Sequence[Variable]:
    """Return the variables of which a variable is computed; of a draw only its parameters."""
    node = variable.owner
    if node is None:
        return ()
    return node.op.dist_params(node) if is_random(variable) else node.inputs


@np.errstate(all="ignore")  # draws may be infinite
def _with_box(draws: Array, rng: np.random.Generator) -> Array:
    """Return draws, and after them as many points evenly spread between their ends.

    Few draws are near the corners of the box that holds them. A parameter that is always positive
    may be of any order of magnitude, and is spread by its logarithm.
    """
    scale, back = (np.log, np.exp) if draws.min() > 0 else (np.positive, np.positive)
    low, high = scale(draws.min()), scale(draws.max())
    return np.concatenate([draws, back(low + (high - low) * rng.random(len(draws)))])


def possible_in_tests(walls: WallVariables, data: xr.Dataset, **settings: Any) -> NDArray[np.bool_]:
    """Return whether pressures at the ends of each test are possible, (test, material).

    The settings are those of :func:`numeric_curves`.
    """
    ends = ends_of_tests(data)
    # A rough pressure says whether it is within a factor of ten.
    curves = numeric_curves(data, walls, np.concatenate(ends), WALL_ORDER // 4, **settings)
    starts = np.cumsum([0, *map(len, ends)])[:-1]
    largest = np.maximum.reduceat(np.abs(curves["pressure"]), starts, axis=1)
    return largest.T < BEYOND * np.abs(data["pressure"].values).max()


def _chebyshev(
    tabulated: TabulatedQuadrature, walls: WallVariables, data: xr.Dataset, some: WallVariables
) -> TabulatedQuadrature | None:
    """Chebyshev nodes for all materials, or else for some of them; None if they are too many."""
    groups, force = tabulated.groups(data), tabulated.with_force
    for materials in (walls.materials, some.materials):
        count = nodes_needed(walls.energy, *groups, materials, with_force=force)
        if count is not None:
            return replace(tabulated, basis=ChebyshevNodes(count))
    return None


def _select_nodes(
    tabulated: TabulatedQuadrature, draws: WallVariables, data: xr.Dataset, inaccurate: float
) -> TabulatedQuadrature | None:
    """Return matrices of nodes that are selected for possible `draws` of the prior, or None.

    Nodes are selected for half of the draws, and others whose curves err by more than the tolerance
    are added, until few of fresh draws are inaccurate. The nodes of the last round, and for a law
    with kinks those of any round, are accepted if no larger fraction is `inaccurate`.
    """
    energy, tolerance = draws.energy, tabulated.tolerance
    split = bool(energy.kinks(pt.zeros(()), **draws.parameters))
    settings = has_additive_stress(energy), FINER * tolerance, split, tabulated.with_force
    found = replace(tabulated, basis=SelectedNodes(energy, *settings))
    first, others = np.array_split(np.arange(len(draws.materials[0])), 2)
    learned = draws.some(first)
    for chosen in np.array_split(others, MOST_ROUNDS):
        found = found.with_materials(data, learned)
        fresh = draws.some(chosen)
        wrong = found.errors(data, fresh) > tolerance
        if wrong.mean() <= (inaccurate if split else _FEW):
            break
        learned = fresh.some(wrong)
    return found if wrong.mean() <= inaccurate else None
