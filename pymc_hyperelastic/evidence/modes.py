"""Modes of a posterior, climbed to from many places, and the mixture that they make."""

from typing import NamedTuple

import numpy as np
from scipy.optimize import OptimizeResult, minimize
from scipy.special import logsumexp

from pymc_hyperelastic.evidence.mixture import Array, GaussianMixture
from pymc_hyperelastic.evidence.target import Ascent

# Modes that are less likely by so many nats are nothing.
_NEGLIGIBLE = 20.0
# Step of the differences of slopes that make a curvature, as a fraction of the mode's width.
_STEP = 0.03
# A mode is no wider than so many widths of the prior, and no narrower than this many.
_WIDEST, _NARROWEST = 5.0, 1e-8
# Nats by which a climb may still be below its summit: else it has not found one. The density of a
# hierarchy may grow without bound where a spread goes to zero.
_BELOW = 1.0
# A climb ends where the slope is this, in nats for the width of a variable: a twentieth of an sd
# from the summit at most. From within so many sds it is not begun: it would lead there.
_FLAT, _BASIN = 0.05, 1.5
# A climb that takes more steps, and so many for each unknown, leads nowhere.
_FEWEST_STEPS, _STEPS = 50, 5
# Finite, and never accepted.
_IMPOSSIBLE = 1e12


class Modes(NamedTuple):
    """Modes of a density, as a mixture of normal distributions."""

    mixture: GaussianMixture
    """One component a mode, with the curvature of the density there."""
    log_masses: Array
    """Logarithm of the integral of each, by Laplace's approximation."""


def modes_from(ascent: Ascent, starts: Array, width: Array) -> Modes | None:
    """Modes of a density, from climbs from each of the starts, shape (n, d); None if it has none.

    Where the noise is unknown, a tempered likelihood prefers large noise up to a certain power, and
    then all of a sudden the small noise of the true curve: a population that follows it misses
    that. Climbing from draws of the prior, of the given `width`, does not.
    """
    means: list[Array] = []
    factors: list[Array] = []
    masses: list[float] = []
    for start in starts:
        if _is_among(start, means, factors, _BASIN):
            continue
        climb = _climb(ascent, start, width)
        if climb.fun >= _IMPOSSIBLE or _is_among(climb.x * width, means, factors):
            continue
        # Again on the scale of the mode, on which differences are right.
        local = width * np.sqrt(np.diagonal(climb.hess_inv).clip(_NARROWEST**2, 1.0))
        result = _climb(ascent, climb.x * width, local)
        factor = _factor_at(ascent, result.x, local, width)
        if factor is None or np.sum((factor.T @ (result.jac / local)) ** 2) > 2 * _BELOW:
            continue
        if not _is_among(result.x * local, means, factors):
            means.append(result.x * local)
            factors.append(factor)
            masses.append(np.log(np.diagonal(factor)).sum() - result.fun)
    if not masses:
        return None
    log_masses = np.array(masses) + np.log(2 * np.pi) * width.size / 2
    keep = log_masses > log_masses.max() - _NEGLIGIBLE
    log_masses = log_masses[keep]
    log_weights = log_masses - logsumexp(log_masses)
    mixture = GaussianMixture(log_weights, np.array(means)[keep], np.array(factors)[keep])
    return Modes(mixture, log_masses)


def _climb(ascent: Ascent, start: Array, width: Array) -> OptimizeResult:
    slope = ascent(width)

    def energy(point: Array) -> tuple[float, Array]:
        value, slopes = slope((point * width)[None])
        if not np.isfinite(value[0]):
            return _IMPOSSIBLE, np.zeros(point.size)
        return -value[0], -slopes[0] * width

    options = {"gtol": _FLAT, "maxiter": _FEWEST_STEPS + _STEPS * start.size}
    return minimize(energy, start / width, jac=True, method="BFGS", options=options)


def _is_among(
    point: Array, means: list[Array], factors: list[Array], distance: float = 1.0
) -> bool:
    """Whether a point is within so many sds, in each direction, of a mode found before."""
    return any(
        np.sum(np.linalg.solve(factor, point - mean) ** 2) < distance**2 * point.size
        for mean, factor in zip(means, factors, strict=True)
    )


def _factor_at(ascent: Ascent, point: Array, local: Array, width: Array) -> Array | None:
    """Cholesky factor of the inverse curvature at a mode; None if there is no curvature."""
    step = np.diag(_STEP * local)
    around = point * local + np.concatenate([step, -step])
    up, down = np.split(-ascent(local)(around)[1], 2)
    curvature = (up - down) / (2 * _STEP * local[:, None])
    # On the scale of the prior, which no mode is much wider than.
    curvature *= np.outer(width, width)
    if not np.isfinite(curvature).all():
        return None
    eigenvalues, vectors = np.linalg.eigh((curvature + curvature.T) / 2)
    inverse = (vectors / eigenvalues.clip(_WIDEST**-2, None)) @ vectors.T
    try:
        return width[:, None] * np.linalg.cholesky((inverse + inverse.T) / 2)
    except np.linalg.LinAlgError:
        return None
