"""Points as a table with a row for each test, all padded to one length, and products with it."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.tensor.variable import TensorVariable as Tensor

Array = NDArray[np.float64]


def identity_of_tests(data: xr.Dataset) -> Array:
    """Rows (obs, column) of the identity matrix of each test."""
    position, size = positions(data["test"].values)
    return np.eye(size)[position]


def block_arrays(data: xr.Dataset, rows: Array) -> dict[str, Array]:
    """Rows (obs, column) as ``blocks`` (test, row, column), with the places of points in them."""
    table = table_arrays(data["test"].values, data.sizes["test"])
    blocks = np.where(table["there"][..., None], rows[table["points"]], 0.0)
    return {"blocks": blocks, "points": table["points"].ravel(), "place": table["place"]}


def block_product(blocks: Tensor, inputs: Mapping[str, Any], vector: Tensor) -> Tensor:
    """Product of the blocks with a vector over ``obs``; `inputs` hold the places of its points."""
    columns = vector[inputs["points"]].reshape((blocks.shape[0], blocks.shape[1], 1))
    return (blocks @ columns).flatten()[inputs["place"]]


def table_arrays(test: NDArray, tests: int) -> dict[str, NDArray]:
    """Table with a row for each test, of points whose `test` never falls; a test may have none.

    The result holds the numbers of the ``points`` in the table (test, column), a mask ``there`` of
    the entries that are points, and the ``place`` of each point in the flattened table.
    """
    position, size = positions(test)
    place = test * size + position
    points, there = np.zeros((tests, size), int), np.zeros((tests, size), bool)
    points.flat[place], there.flat[place] = np.arange(len(place)), True
    return {"points": points, "there": there, "place": place}


def table_of(vector: Tensor, inputs: Mapping[str, Any]) -> Tensor:
    """Return a vector over points as a table by test, padded with 0."""
    return pt.where(inputs["there"], vector[inputs["points"]], 0.0)


def positions(test: NDArray) -> tuple[NDArray[np.intp], int]:
    """Place of each point within its test, which never falls, and how many the longest has."""
    position = np.arange(len(test)) - np.searchsorted(test, test)
    return position, int(position.max(initial=-1)) + 1
