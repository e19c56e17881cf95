"""Draws of the prior, by which an integrator is chosen."""

from collections.abc import Iterator, Sequence
from itertools import count as numbers

import numpy as np
import pymc as pm
import xarray as xr
from numpy.typing import NDArray
from pymc.distributions.shape_utils import change_dist_size
from pytensor.graph.basic import Constant
from pytensor.graph.fg import FrozenFunctionGraph
from pytensor.graph.replace import vectorize_graph
from pytensor.graph.traversal import ancestors, graph_inputs
from pytensor.tensor.random.type import RandomType
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.evidence.batched import is_random
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.models.forward.integrator import ends_of_tests
from pymc_hyperelastic.models.forward.pointwise import PointwiseQuadrature
from pymc_hyperelastic.models.forward.tube_variables import WallVariables

Array = NDArray[np.float64]

# Draws of the prior for which an integrator must be accurate; chosen by experiment.
_DRAWS = 256
# Largest number of corners of the box that holds the draws: all corners of ten parameters.
_MOST_CORNERS = 1024
# Draws from which materials of the prior are taken one batch after the other.
_POOL = 18_000
# Draws of a batch.
_BATCH = 500
# For each draw, how many points are spread evenly over the box that holds the draws: few draws are
# near its corners. Chosen by experiment.
_EVENLY = 2
# Order by which the size of pressures is known: enough for the wall of an artery.
_CHEAP_ORDER = 12
# Materials whose pressures exceed the largest measured one by this factor do not count, because
# their likelihood is nil.
BEYOND = 10.0
# Fewest materials by which a range is known.
FEWEST = 32
# Cached draws: more than the priors of a session.
_CACHED = 64
_draws: dict[tuple, list[Array]] = {}


def batches(parameters: Sequence[TensorVariable]) -> Iterator[list[Array]]:
    """Yield batches of fresh draws of the parameters, from the first again after the last one."""
    pool = drawn(parameters, _POOL, 2)
    for number in numbers():
        start = number * _BATCH % _POOL
        yield [values[start : start + _BATCH] for values in pool]


def spread(materials: Sequence[Array]) -> list[Array]:
    """Return the materials, and points spread evenly over the box that holds them."""
    rng, found = np.random.default_rng(1), []
    for values in materials:
        low, high, size = values.min(), values.max(), _EVENLY * len(values)
        # A parameter that is always positive may be of any order of magnitude.
        even = (
            np.exp(rng.uniform(np.log(low), np.log(high), size))
            if low > 0
            else rng.uniform(low, high, size)
        )
        found.append(np.concatenate([values, even]))
    return found


def in_numbers(wall: WallVariables, data: xr.Dataset, draws: Sequence[Array]) -> WallVariables:
    """Return the wall with these draws of all that is unknown."""
    values = dict(zip(wall.unknown, draws, strict=True))
    if not isinstance(wall.energy, StrainEnergy):
        # Draws of an impossible layer are left out.
        thick = [values[x.thickness] > 0 for x in wall.energy if x.thickness in values]
        if thick:
            values = {name: v[np.all(thick, axis=0)] for name, v in values.items()}
    return wall.with_values(values, data.sizes["test"])


def largest_pressures(wall: WallVariables, data: xr.Dataset, draws: Sequence[Array]) -> Array:
    """Return the largest pressure (test, material) at the ends of each test, kPa."""
    numbers, ends = in_numbers(wall, data, draws), ends_of_tests(data)
    curves = PointwiseQuadrature(_CHEAP_ORDER).values(data, numbers, np.concatenate(ends))
    starts = np.cumsum([0, *map(len, ends)])[:-1]
    return np.maximum.reduceat(np.abs(curves["pressure"]), starts, axis=1).T


def largest_measured(data: xr.Dataset, beyond: float) -> float:
    """Return a multiple of the largest measured pressure, kPa."""
    return beyond * np.abs(data["pressure"].values).max()


def representative_values(parameters: Sequence[TensorVariable]) -> list[Array]:
    """Return draws of the parameters, and corners of the box that holds them.

    Raises MissingInputError or NotImplementedError if the parameters depend on something that is
    not random, or on a distribution that cannot be drawn from.
    """
    draws = drawn(parameters, _DRAWS, 1)
    ends = np.array([[d.min(), d.max()] for d in draws])
    # All corners of the box, or some of them if there are many.
    count = len(draws)
    corner = np.random.default_rng(1).permutation(2**count)[:_MOST_CORNERS]
    bits = (corner >> np.arange(count)[:, None]) & 1
    corners = np.take_along_axis(ends, bits, axis=1)
    return [np.concatenate([d, c]) for d, c in zip(draws, corners, strict=True)]


def drawn(parameters: Sequence[TensorVariable], count: int, seed: int) -> list[Array]:
    """Return draws of the parameters.

    Draws of the same distributions are cached: they take longer to compile than to draw.
    """
    inputs = [v for v in graph_inputs(parameters) if not isinstance(v, Constant)]
    if not all(isinstance(v.type, RandomType) for v in inputs):
        return _drawn_anew(parameters, count, seed)
    key = FrozenFunctionGraph.from_io(inputs, parameters), count, seed
    draws = _draws.get(key)
    if draws is None:
        if len(_draws) >= _CACHED:
            _draws.pop(next(iter(_draws)))
        draws = _draws[key] = _drawn_anew(parameters, count, seed)
    return draws


def _drawn_anew(parameters: Sequence[TensorVariable], count: int, seed: int) -> list[Array]:
    randoms = [v for v in ancestors(parameters) if is_random(v)]
    if any(is_random(v) for rv in randoms for v in ancestors(rv.owner.inputs)):
        # One distribution depends on another: draw them one after the other.
        return pm.draw(parameters, draws=count, random_seed=seed, mode="FAST_COMPILE")
    batches = {rv: change_dist_size(rv, (count,), expand=True) for rv in randoms}
    outputs = vectorize_graph(parameters, batches)
    draws = pm.draw(outputs, random_seed=seed, mode="FAST_COMPILE")
    # A parameter without a distribution is one number for all draws.
    return [
        np.broadcast_to(d, (count, *np.shape(d)[np.ndim(d) - p.type.ndim :]))
        for d, p in zip(draws, parameters, strict=True)
    ]
