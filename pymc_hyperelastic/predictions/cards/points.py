"""Choose the materials of a card: one that represents the posterior, and further draws."""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.evidence.checks import check_count
from pymc_hyperelastic.mechanics.strain_energy import Parameter
from pymc_hyperelastic.models.settings import NamedLayer
from pymc_hyperelastic.predictions.walls import WallDraws
from pymc_hyperelastic.rounding import ROUNDING

Array = NDArray[np.float64]

Point = Literal["draw", "mean", "median"]

# Notes on the chosen point, in the header of the card.
_RULE = (
    "in logarithms of the parameters that are positive or whose sign makes no difference, each "
    "divided by its standard deviation; the first of equally near draws"
)
_WORDS = {
    "draw": f"the draw of the posterior nearest its mean ({_RULE})",
    "mean": "the mean of each parameter separately; together they may fit the data badly",
    "median": "the median of each parameter separately; together they may fit the data badly",
}


class PointOfWall(NamedTuple):
    """Parameters of each layer of a wall at one point of the posterior."""

    values: list[dict[str, Any]]
    """Parameters by name, for each layer."""
    words: str
    """Description of the point, for a comment."""
    suffix: str
    """Suffix of the names of its materials."""


def point_of(draws: WallDraws, point: Point) -> PointOfWall:
    """Return the material that represents the posterior.

    Raises
    ------
    ValueError
        If `point` is unknown.
    """
    if point not in get_args(Point):
        raise ValueError(f"point is {point!r}; expected one of {list(get_args(Point))}")
    flat = _flat(draws)
    if point == "draw":
        place = _nearest_the_mean(draws.wall, flat)
        words = f"{_WORDS[point]}: {_which(draws.member.posterior, place)}"
        return PointOfWall(_at(flat, place), words, "")
    centre = np.mean if point == "mean" else np.median
    values = [
        {
            name: centre(np.abs(v) if _even(_parameter(layer, name)) else v, axis=0)
            for name, v in of_layer.items()
        }
        for layer, of_layer in zip(draws.wall, flat, strict=True)
    ]
    return PointOfWall(values, _WORDS[point], "")


def thinned(draws: WallDraws, count: int) -> list[PointOfWall]:
    """Return `count` draws, evenly spaced along the chains.

    Raises
    ------
    TypeError
        If `count` is no whole number.
    ValueError
        If `count` is negative or exceeds the number of draws.
    """
    check_count("draws", count, 0)
    flat, total = _flat(draws), _total(draws)
    if count > total:
        raise ValueError(f"draws is {count}; the posterior has {total}, expected 0 to {total}")
    places = (np.arange(count) + 0.5) * total // max(count, 1)
    return [
        PointOfWall(_at(flat, place), _which(draws.member.posterior, place), f"_draw_{i}")
        for i, place in enumerate(places.astype(int).tolist(), start=1)
    ]


def _total(draws: WallDraws) -> int:
    return draws.member.posterior.sizes["chain"] * draws.member.posterior.sizes["draw"]


def _flat(draws: WallDraws) -> list[dict[str, Array]]:
    """Return parameters by draw, with the chains joined: scalars (draw,), vectors (draw, entry).

    Parameters that were given as numbers are repeated for each draw.
    """
    total = _total(draws)
    return [
        {
            name: np.broadcast_to(v.reshape(-1, *v.shape[3:]), (total, *v.shape[3:]))
            for name, v in of_layer.items()
        }
        for of_layer in draws.values
    ]


def _at(flat: list[dict[str, Array]], place: int) -> list[dict[str, Any]]:
    return [{name: v[place] for name, v in of_layer.items()} for of_layer in flat]


def _which(posterior: xr.Dataset, place: int) -> str:
    """Return the labels of chain and draw at an index of the joined draws."""
    chain, draw = divmod(place, posterior.sizes["draw"])
    labels = posterior["chain"].values[chain], posterior["draw"].values[draw]
    return f"chain {labels[0]}, draw {labels[1]}"


def _nearest_the_mean(wall: Sequence[NamedLayer], flat: list[dict[str, Array]]) -> int:
    """Return the index of the draw nearest the mean; of equally near draws, the first one.

    Each parameter is divided by its standard deviation. The covariance is not used: with fewer
    draws than parameters, all draws have the same Mahalanobis distance from their mean.
    """
    columns = [
        _coordinate(_parameter(layer, name), column)
        for layer, of_layer in zip(wall, flat, strict=True)
        for name, values in of_layer.items()
        for column in values.reshape(len(values), -1).T
    ]
    x = np.stack(columns, axis=1)
    sd = x.std(axis=0)
    varies = sd > ROUNDING * np.abs(x).max(axis=0, initial=1.0)
    standard = (x - x.mean(axis=0))[:, varies] / sd[varies]
    distance = np.sqrt(np.square(standard).sum(axis=1))
    # Distances differ by their rounding errors between computers. Those that differ by less than a
    # millionth of a standard deviation count as equal.
    return int(np.argmax(distance <= distance.min() + 1e-6))


def _parameter(layer: NamedLayer, name: str) -> Parameter | None:
    """Return a parameter of the law of a layer; None for its thickness."""
    return next((p for p in layer.energy.parameters if p.name == name), None)


def _even(parameter: Parameter | None) -> bool:
    """Return True if the sign of a parameter makes no difference to the material."""
    return bool(parameter and parameter.natural_scale == "log" and parameter.prior_range[0] < 0)


def _coordinate(parameter: Parameter | None, values: Array) -> Array:
    """Return draws on the scale for distances: logarithms, if the natural scale is logarithmic."""
    size = np.abs(values) if _even(parameter) else values
    log = parameter is None or parameter.natural_scale == "log"
    return np.log(size) if log and np.all(size > 0) else size
