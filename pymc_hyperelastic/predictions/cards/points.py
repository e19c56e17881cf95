"""Which material stands for a posterior."""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.mechanics.strain_energy import Parameter
from pymc_hyperelastic.models.study import NamedLayer
from pymc_hyperelastic.predictions.walls import WallDraws

Array = NDArray[np.float64]

Point = Literal["draw", "mean", "median"]

_SCALES = "(logarithms of parameters without sign, distances by their covariance)"
_WORDS = {
    "draw": f"the draw of the posterior nearest its mean {_SCALES}",
    "mean": "the mean of each parameter by itself, which need not be likely with the others",
    "median": "the median of each parameter by itself, which need not be likely with the others",
}
# Directions in which draws vary by less than rounding have no say.
_VARIES = 1e-10
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
    """Place of the draw with the least Mahalanobis distance from the mean."""
    columns = [
        _coordinate(_parameter(layer, name), column)
        for layer, of_layer in zip(wall, flat, strict=True)
        for name, values in of_layer.items()
        for column in values.reshape(len(values), -1).T
    ]
    x = np.stack(columns, axis=1)
    x = x - x.mean(axis=0)
    spread = x.std(axis=0)
    x /= np.where(spread > 0, spread, 1.0)
    precision = np.linalg.pinv(x.T @ x / len(x), rcond=_VARIES, hermitian=True)
    return int(np.argmin(np.einsum("ni,ij,nj->n", x, precision, x)))


def _parameter(layer: NamedLayer, name: str) -> Parameter:
    return next((p for p in layer.energy.parameters if p.name == name), _THICKNESS)


def _even(parameter: Parameter) -> bool:
    """Whether the sign of a parameter makes no difference: draws of both are of one material."""
    return parameter.natural_scale == "log" and parameter.prior_range[0] < 0


def _coordinate(parameter: Parameter, values: Array) -> Array:
    """Draws where they are spread about normally."""
    size = np.abs(values) if _even(parameter) else values
    return np.log(size) if parameter.natural_scale == "log" and np.all(size > 0) else size
