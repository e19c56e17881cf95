"""Which material stands for a posterior."""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.mechanics.strain_energy import Parameter
from pymc_hyperelastic.models.settings import NamedLayer
from pymc_hyperelastic.predictions.walls import WallDraws

Array = NDArray[np.float64]

Point = Literal["draw", "mean", "median"]

_RULE = (
    "in logarithms of the parameters that are positive or whose sign makes no difference, each "
    "divided by its standard deviation; the first of equally near draws"
)
_WORDS = {
    "draw": f"the draw of the posterior nearest its mean ({_RULE})",
    "mean": "the mean of each parameter by itself, which need not be likely with the others",
    "median": "the median of each parameter by itself, which need not be likely with the others",
}
# Standard deviation of a parameter, or of its logarithm, below which it is constant, relative to
# its largest value or to 1 if that is larger: relative rounding errors of 1e-14 then change no
# distance by more than _EQUALLY_NEAR.
_CONSTANT = 1e-8
# Difference of two distances from the mean, in standard deviations, below which both draws are
# equally near. Distances differ by their rounding errors between computers.
_EQUALLY_NEAR = 1e-6
_THICKNESS = Parameter("thickness", "t", "mm", (0.0, 10.0), "thickness of a layer")


class PointOfWall(NamedTuple):
    """Parameters of each layer of a wall, and which they are."""

    values: list[dict[str, Any]]
    words: str
    suffix: str
    """Of the names of its materials."""


def point_of(draws: WallDraws, point: Point) -> PointOfWall:
    """The one material that stands for the posterior.

    Raises
    ------
    ValueError
        If there is no such point.
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
    """So many draws, evenly along the chains.

    Raises
    ------
    TypeError
        If `count` is no whole number.
    ValueError
        If it is negative, or there are fewer draws.
    """
    if not isinstance(count, int) or isinstance(count, bool):
        raise TypeError(f"draws is {count!r}; expected a whole number of further materials")
    flat = _flat(draws)
    total = _total(draws)
    if not 0 <= count <= total:
        raise ValueError(f"draws is {count}; the posterior has {total}, expected 0 to {total}")
    places = (np.arange(count) + 0.5) * total // max(count, 1)
    return [
        PointOfWall(_at(flat, place), _which(draws.member.posterior, place), f"_draw_{i}")
        for i, place in enumerate(places.astype(int).tolist(), start=1)
    ]


def _total(draws: WallDraws) -> int:
    return draws.member.posterior.sizes["chain"] * draws.member.posterior.sizes["draw"]


def _flat(draws: WallDraws) -> list[dict[str, Array]]:
    """Parameters by draw of all chains, vectors (draw, entry); numbers are the same in all."""
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
    """Chain and draw of a place, by their labels."""
    chain, draw = divmod(place, posterior.sizes["draw"])
    labels = posterior["chain"].values[chain], posterior["draw"].values[draw]
    return f"chain {labels[0]}, draw {labels[1]}"


def _nearest_the_mean(wall: Sequence[NamedLayer], flat: list[dict[str, Array]]) -> int:
    """Index of the draw nearest the mean; the first one of equally near draws.

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
    varies = sd > _CONSTANT * np.abs(x).max(axis=0, initial=1.0)
    standard = (x - x.mean(axis=0))[:, varies] / sd[varies]
    distance = np.sqrt(np.square(standard).sum(axis=1))
    return int(np.argmax(distance <= distance.min() + _EQUALLY_NEAR))


def _parameter(layer: NamedLayer, name: str) -> Parameter:
    return next((p for p in layer.energy.parameters if p.name == name), _THICKNESS)


def _even(parameter: Parameter) -> bool:
    """Whether the sign of a parameter makes no difference: draws of both are of one material."""
    return parameter.natural_scale == "log" and parameter.prior_range[0] < 0


def _coordinate(parameter: Parameter, values: Array) -> Array:
    """Draws where they are spread about normally."""
    size = np.abs(values) if _even(parameter) else values
    return np.log(size) if parameter.natural_scale == "log" and np.all(size > 0) else size
