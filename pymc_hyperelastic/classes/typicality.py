"""How typical a specimen is of a class: its predictive p-value."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

__all__ = ["predictive_p_value"]

Array = NDArray[np.float64]

# kPa: curves beyond these are not of tubes. With fewer than so many of them at the radii of a
# specimen there is no telling how unlikely it is.
_SMALLEST_PRESSURE, _LARGEST_PRESSURE, _FEWEST_CURVES = 1e-6, 1e6, 100
# Curves of a class differ along directions in which they differ by this fraction, or more, of how
# they do along the first.
_LEAST_SHARE = 0.003


def predictive_p_value(
    measured: Array, curves: Array, sd: Array, rng: np.random.Generator
) -> float:
    """Share of the specimens of a class that are as unlikely as this one, or more.

    The class brings forth specimens, measured as this one was. Each, and the new one, is held
    against all the others: how likely it is depends on how far it is from its neighbours. What no
    combination of the class's curves could follow is noise, and says nothing here: else specimens
    measured better than usual would be of every class, and others of none.

    Parameters
    ----------
    measured : array, shape (obs)
        Pressures of the specimen, kPa.
    curves : array, shape (draw, obs)
        Pressures of specimens of the class at the same radii.
    sd : array, shape (draw, 1)
        Standard deviations of their noise.
    rng : numpy.random.Generator
        For the noise.

    Returns
    -------
    float
        NaN if the class brings forth too few tubes that could be inflated to these radii.
    """
    sizes = np.abs(curves).max(axis=1)
    # No comparison with NaN is true.
    possible = (sizes < _LARGEST_PRESSURE) & (sizes > _SMALLEST_PRESSURE)
    if possible.sum() < _FEWEST_CURVES:
        return np.nan
    curves, sd = curves[possible], sd[possible]
    alike = curves / np.linalg.norm(curves, axis=1, keepdims=True)
    _, shares, directions = np.linalg.svd(alike, full_matrices=False)
    directions = directions[shares > _LEAST_SHARE * shares[0]].T
    curves = curves @ directions
    projected = np.concatenate(
        [
            measured[None] @ directions,
            curves + sd * rng.standard_normal(curves.shape),
        ]
    )
    scaled = curves / sd**2
    squares = (projected**2).sum(axis=1, keepdims=True)
    misfit = squares / (sd**2).T - 2 * projected @ scaled.T + (scaled * curves).sum(axis=1)
    log_likelihood = -misfit / 2 - curves.shape[1] * np.log(sd).T
    # Not against itself.
    np.fill_diagonal(log_likelihood[1:], -np.inf)
    likely = logsumexp(log_likelihood, axis=1)
    likely[0] += np.log((len(curves) - 1) / len(curves))
    return float((1 + np.sum(likely[1:] <= likely[0])) / len(likely))
