"""Draws of the prior as numeric walls, for which an integrator is chosen."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import pymc as pm
import pytensor
import xarray as xr
from numpy.typing import NDArray
from pymc.distributions.shape_utils import change_dist_size
from pytensor.graph.basic import Constant, Variable
from pytensor.graph.fg import FrozenFunctionGraph
from pytensor.graph.replace import vectorize_graph
from pytensor.graph.traversal import ancestors, graph_inputs
from pytensor.tensor.random.type import RandomType

from pymc_hyperelastic.evidence.batched import is_random
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.wall import WALL_ORDER
from pymc_hyperelastic.models.forward.integrator import ends_of_tests
from pymc_hyperelastic.models.forward.numbers import numeric_curves
from pymc_hyperelastic.models.forward.tube_variables import Array, WallVariables

# Draws of the prior for which an integrator must be accurate, with as many points of their box.
DRAWS = 1000
# Materials whose pressures exceed the largest measured one by this factor do not count, because
# their likelihood is nil.
_BEYOND = 10.0


def walls_of_prior(wall: WallVariables, data: xr.Dataset) -> WallVariables:
    """Return the wall with draws of the prior, as numbers, in place of all that is unknown.

    Raises MissingInputError or NotImplementedError if a prior depends on a variable that is not
    random, or cannot be drawn from.
    """
    wall, rng = wall.mapped(lambda value: value), np.random.default_rng(1)  # by entries of vectors
    values = {v: _with_box(d, rng) for v, d in zip(wall.unknown, _drawn(wall.unknown), strict=True)}
    if not isinstance(wall.energy, StrainEnergy):
        # Draws of an impossible layer are left out.
        thick = [values[x.thickness] > 0 for x in wall.energy if x.thickness in values]
        if thick:
            values = {name: v[np.all(thick, axis=0)] for name, v in values.items()}
    return wall.with_values(values, data.sizes["test"])


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
    curves = numeric_curves(data, walls, np.concatenate(ends), WALL_ORDER, **settings)
    starts = np.cumsum([0, *map(len, ends)])[:-1]
    largest = np.maximum.reduceat(np.abs(curves["pressure"]), starts, axis=1)
    return largest.T < _BEYOND * np.abs(data["pressure"].values).max()


def _drawn(unknown: Sequence[Variable]) -> list[Array]:
    """Return draws of all that is unknown.

    Draws of the same distributions are cached: they take longer to compile than to draw.
    """
    inputs = [v for v in graph_inputs(unknown) if not isinstance(v, Constant)]
    if not unknown or not all(isinstance(v.type, RandomType) for v in inputs):
        return _drawn_anew(unknown)
    return _drawn_from(FrozenFunctionGraph.from_io(inputs, unknown))


@lru_cache(maxsize=64)
def _drawn_from(graph: FrozenFunctionGraph) -> list[Array]:
    """Return draws of the outputs of a graph, whose inputs are random generators."""
    generators = [pytensor.shared(np.random.default_rng()) for _ in graph.inputs]
    return _drawn_anew(graph.bind(dict(zip(graph.inputs, generators, strict=True))))


def _drawn_anew(unknown: Sequence[Variable]) -> list[Array]:
    if not unknown:
        return []
    randoms = [v for v in ancestors(unknown) if is_random(v)]
    if any(is_random(v) for rv in randoms for v in ancestors(rv.owner.inputs)):
        # One distribution depends on another: draw them one after the other.
        return pm.draw(unknown, draws=DRAWS, random_seed=1, mode="FAST_COMPILE")
    batches = {rv: change_dist_size(rv, (DRAWS,), expand=True) for rv in randoms}
    outputs = vectorize_graph(unknown, batches)
    draws = pm.draw(outputs, random_seed=1, mode="FAST_COMPILE")
    # A parameter without a distribution is one number for all draws.
    return [
        np.broadcast_to(d, (DRAWS, *np.shape(d)[np.ndim(d) - v.type.ndim :]))
        for d, v in zip(draws, unknown, strict=True)
    ]
