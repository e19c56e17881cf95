"""Products with a matrix that has one block for each test, all padded to one size."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.data.inflation import points_of

Array = NDArray[np.float64]


def identity_of_tests(data: xr.Dataset) -> Array:
    """Rows (obs, column) of the identity matrix of each test."""
    position, size = _positions(data)
    return np.eye(size)[position]


def block_arrays(data: xr.Dataset, rows: Array) -> dict[str, Array]:
    """Rows (obs, column) as ``blocks`` (test, row, column), with the places of points in them."""
    position, size = _positions(data)
    tests = data.sizes["test"]
    place = data["test"].values * size + position
    points = np.zeros(tests * size, int)
    points[place] = np.arange(len(place))
    padded = np.zeros((points.size, size))
    padded[place] = rows
    return {"blocks": padded.reshape(tests, size, size), "points": points, "place": place}


def block_product(
    blocks: TensorVariable, inputs: Mapping[str, Any], vector: TensorVariable
) -> TensorVariable:
    """Product of the blocks with a vector over ``obs``; `inputs` hold the places of its points."""
    columns = vector[inputs["points"]].reshape((blocks.shape[0], blocks.shape[1], 1))
    return (blocks @ columns).flatten()[inputs["place"]]


def _positions(data: xr.Dataset) -> tuple[NDArray[np.intp], int]:
    """Place of each point within its test, and the number of points of the longest."""
    test = data["test"].values
    spans = [points_of(data, i) for i in range(data.sizes["test"])]
    position = np.arange(data.sizes["obs"]) - np.array([span.start for span in spans])[test]
    return position, max(span.stop - span.start for span in spans)
