"""Weights of particles: effective sample size, Pareto shape, tempering step and resampling."""

from typing import Any

import numpy as np
from arviz_stats.base import array_stats
from numpy.typing import NDArray
from scipy.optimize import brentq

from pymc_hyperelastic.evidence.mixture import Array

# Range of the largest log weights up to which they count as equal: log densities have rounding
# errors up to about 1e-9, to which no distribution must be fitted.
_EQUAL = 1e-6


def largest_step(logp: Array, fraction: float, largest: float, log_weights: Any = 0.0) -> float:
    """Step of ``β`` after which this fraction of the particles is effective, `largest` at most.

    Particles weigh ``exp(step logp)``, times weights that they may have before. The step is 0 if
    fewer are effective without it.
    """
    possible = np.isfinite(logp + log_weights)
    target = fraction * possible.sum()

    def excess(step: float) -> float:
        return effective_sample_size(log_weights + step * logp) - target

    if excess(largest) >= 0:
        return largest
    # Searched on a logarithmic scale: the first steps may be 1e-13.
    least = 1e-6 / np.ptp(logp[possible])
    if excess(least) <= 0:
        return 0.0
    log_step = brentq(lambda x: excess(np.exp(x)), np.log(least), np.log(largest), xtol=0.01)
    return float(np.exp(log_step))


def effective_sample_size(log_weights: Array) -> float:
    """``(Σ w)² / Σ w²``; 0 if no weight is finite."""
    largest = log_weights.max()
    if largest == -np.inf:
        return 0.0
    weights = np.exp(log_weights - largest)
    return float(weights.sum() ** 2 / np.sum(weights**2))


def pareto_shape(log_weights: Array) -> float:
    """Shape of the generalised Pareto distribution of the largest weights; infinite without any.

    The largest of `n` weights with such a tail is about ``n^k`` times their mean. If it is less
    than ten times their mean, the shape is bounded accordingly: a fit to weights with a common
    bound, which do not matter, may give any shape.

    References
    ----------
    A. Vehtari, D. Simpson, A. Gelman, Y. Yao and J. Gabry, Pareto smoothed importance sampling,
    Journal of Machine Learning Research 25 (2024) 72.
    """
    finite = log_weights[np.isfinite(log_weights)]
    if finite.size == 0:
        return np.inf
    # As many as ArviZ fits. Equal weights have no tail.
    in_tail = int(np.ceil(min(finite.size / 5, 3 * np.sqrt(finite.size))))
    if np.ptp(np.sort(finite)[-in_tail:]) <= _EQUAL:
        return -np.inf
    # The weights that it smooths on the way, which are not needed, may overflow.
    with np.errstate(over="ignore"):
        # ArviZ takes the logarithms of what divides.
        shape = float(array_stats.psislw(-finite)[1])
    above_mean = -np.log(np.mean(np.exp(finite - finite.max())))
    if above_mean < np.log(10):
        shape = min(shape, above_mean / np.log(finite.size))
    return shape


def systematic(weights: Array, size: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Indices drawn by their weights, as evenly as possible."""
    cumulative = np.cumsum(weights)
    positions = (rng.random() + np.arange(size)) / size
    return np.searchsorted(cumulative / cumulative[-1], positions)
