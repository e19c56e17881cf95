"""Modes of a posterior, climbed to from many places, and the mixture that they make."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from pymc_hyperelastic.evidence.climbs import climb_together
from pymc_hyperelastic.evidence.mixture import Array, GaussianMixture
from pymc_hyperelastic.evidence.target import Ascent

# Modes that are less likely by so many nats are nothing.
_NEGLIGIBLE = 20.0
# Step of the differences of slopes that make a curvature, as a fraction of the mode's width.
_STEP = 0.03
# A mode is no wider than so many widths of the prior.
_WIDEST = 5.0
# Nats by which a climb may still be below its summit: else it has not found one. The density of a
# hierarchy may grow without bound where a spread goes to zero.
_BELOW = 1.0
# From within so many sds of a mode no climb is begun: it would lead there.
_BASIN = 1.5


class Modes(NamedTuple):
    """Modes of a density, as a mixture of normal distributions."""

    mixture: GaussianMixture
    """One component a mode, with the curvature of the density there."""
    log_masses: Array
    """Logarithm of the integral of each, by Laplace's approximation."""


def modes_from(ascent: Ascent, groups: Sequence[Array], width: Array) -> Modes | None:
    """Modes of a density, from climbs from starts in groups, (n, d) each; None if it has none.

    Where the noise is unknown, a tempered likelihood prefers large noise up to a certain power, and
    then all of a sudden the small noise of the true curve: a population that follows it misses
    that. Climbing from draws of the prior, of the given `width`, does not.
    """
    means: list[Array] = []
    factors: list[Array] = []
    masses: list[float] = []
    for group in groups:
        starts = [x for x in group if not _is_among(x, means, factors, _BASIN)]
        if not starts:
            continue
        points, heights, slopes, widths = climb_together(ascent, np.array(starts), width)
        for i in np.argsort(-heights):
            if not np.isfinite(heights[i]) or _is_among(points[i], means, factors):
                continue
            factor = _factor_at(ascent, points[i], widths[i], width)
            if factor is None or np.sum((factor.T @ slopes[i]) ** 2) > 2 * _BELOW:
                continue
            means.append(points[i])
            factors.append(factor)
            masses.append(np.log(np.diagonal(factor)).sum() + heights[i])
    if not masses:
        return None
    log_masses = np.array(masses) + np.log(2 * np.pi) * width.size / 2
    keep = log_masses > log_masses.max() - _NEGLIGIBLE
    log_masses = log_masses[keep]
    log_weights = log_masses - logsumexp(log_masses)
    mixture = GaussianMixture(log_weights, np.array(means)[keep], np.array(factors)[keep])
    return Modes(mixture, log_masses)


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
    around = point + np.concatenate([step, -step])
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
