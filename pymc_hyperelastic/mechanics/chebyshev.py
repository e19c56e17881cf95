"""Chebyshev points, and the coefficients of a function from its values at these points."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@cache
def chebyshev_nodes(count: int) -> Array:
    """Chebyshev points of the first kind in (-1, 1)."""
    return np.cos(np.pi * (np.arange(count) + 0.5) / count)


@cache
def value_to_coefficient(count: int) -> Array:
    """Matrix from values at the Chebyshev nodes to Chebyshev coefficients."""
    cosines = np.cos(np.pi / count * np.outer(np.arange(count), np.arange(count) + 0.5))
    cosines[0] /= 2
    return 2 / count * cosines
