"""Importance sampling from Laplace approximations about many draws, where curvatures are known."""

from collections.abc import Sequence

import numpy as np

from pymc_hyperelastic.evidence.importance import (
    LARGEST_ERROR,
    LARGEST_PARETO_K,
    PRIOR_SHARE,
    Drawn,
    Integral,
    by_alike,
    integral_of,
    mean_weight,
)
from pymc_hyperelastic.evidence.mixture import Array, GaussianMixture
from pymc_hyperelastic.evidence.reference import Reference
from pymc_hyperelastic.evidence.target import Ascent, Target
from pymc_hyperelastic.evidence.weights import effective_sample_size, largest_step, systematic

# Draws that each step of adaptation adds, how many of all it leaves effective, and steps at most.
_DRAWS, _EFFECTIVE, _MOST_STEPS = 4000, 520, 40
# Draws about which approximations are made, on the way to the posterior and there, and steps there.
_ON_THE_WAY, _THERE, _LAST_STEPS = 100, 200, 2
# Draws of the last mixture. Where these are not enough one is made of them about twice as many, of
# which twice as many are drawn, and so on; so many such mixtures at most.
_FIRST_DRAWS, _MOST_MIXTURES = 16_000, 3
# How far an approximation reaches, in sds of the draws, and goes from where it was begun, in its
# own; differences that make its curvature, in sds of the draws.
_REACH, _FARTHEST, _STEP = 2.0, 3.0, 0.1
# Of a direction that the density leaves open: its curvature on the scale of the draws.
_FLAT = 1e-3
# Added to variances of draws, as a fraction, so that those of a few have a factor.
_FLOOR = 1e-13


def by_curvature(
    target: Target,
    like: GaussianMixture,
    size: int,
    rng: np.random.Generator,
    alike: Sequence[tuple[Reference, int]] = (),
) -> Integral:
    """Integral by importance sampling from Laplace approximations about draws of the posterior.

    Where curves say nothing of a fibre that bears little, a posterior has arms, along which its
    other unknowns bend. Mixtures fitted to draws follow them only where many draws are; curvatures
    say how the density falls wherever one is. Draws are led from the mixture that is given along
    ``q^(1-β) p^β``, all of them weighted as if from the mixture of all proposals. The integral is
    the mean of fresh ones, on which no proposal depends: of those that it was made from the weights
    are too small.

    So many draws of each of some distributions that may be `alike` already are tried first.
    """
    pool = Drawn(target.score, target.draw_prior)
    if alike and (at_once := by_alike(pool, alike, size, rng)):
        return at_once
    mixture = _adapted(target, pool, like, rng)
    for i in range(_MOST_MIXTURES):
        fresh = Drawn(target.score, target.draw_prior)
        fresh.add([(_proposal(mixture), _FIRST_DRAWS << i)], rng)
        points, log_weights = fresh.weighted()
        found = integral_of(mean_weight(log_weights), points, log_weights, size, rng)
        error_known = found.pareto_k < LARGEST_PARETO_K
        if error_known and found.log_value.standard_error < LARGEST_ERROR:
            break
        if effective_sample_size(log_weights) < 2 * target.dimension:
            break
        mixture = _about(target.ascent, points, log_weights, _THERE << i + 1, rng)
    return found


def _proposal(mixture: GaussianMixture) -> Reference:
    return Reference(mixture.heavy_tailed(), PRIOR_SHARE)


def _adapted(
    target: Target, pool: Drawn, like: GaussianMixture, rng: np.random.Generator
) -> GaussianMixture:
    """Approximations about draws that are like the posterior's, from a mixture somehow like it."""
    start, mixture, last = _proposal(like), like, 0
    for _ in range(_MOST_STEPS):
        pool.add([(_proposal(mixture), _DRAWS)], rng)
        posterior = pool.prior + pool.likelihood
        possible = np.isfinite(posterior)
        if possible.sum() < _EFFECTIVE:
            break
        points = pool.points[possible]
        before = start.log_density(points, pool.prior[possible])
        rise, log_weights = posterior[possible] - before, before - pool.log_density[possible]
        beta = largest_step(rise, _EFFECTIVE / len(points), 1.0, log_weights)
        arrived = beta == 1
        last += arrived
        count = _THERE if arrived else _ON_THE_WAY
        mixture = _about(target.ascent, points, log_weights + beta * rise, count, rng)
        if last == _LAST_STEPS:
            break
    return mixture


def _about(
    ascent: Ascent, points: Array, log_weights: Array, count: int, rng: np.random.Generator
) -> GaussianMixture:
    """Laplace approximations about so many of the weighted points, which spread as all of them."""
    weights = np.exp(log_weights - log_weights.max())
    weights /= weights.sum()
    centred = points - weights @ points
    covariance = (weights * centred.T) @ centred
    variances = np.diagonal(covariance)
    covariance += np.diag(_FLOOR * variances + np.finfo(float).tiny)
    return laplace_about(ascent, points[systematic(weights, count, rng)], covariance)


def laplace_about(ascent: Ascent, points: Array, covariance: Array) -> GaussianMixture:
    r"""Mixture of Laplace approximations about points that are draws of a density.

    On the axes where the covariance :math:`\Sigma` of all draws is 1 and the curvature
    :math:`\lambda` at one of them, :math:`x`, is diagonal, with the slope :math:`g` there, it is
    of the variances and the means

    .. math:: C = \frac{1}{\lambda + h^{-2}}, \quad
        m = x + \bigl(1 - \sqrt{1 - \lambda C}\bigr) \frac{g}{\lambda} .

    Of draws of a normal distribution, whose slope is :math:`-\lambda (x - \mu)`, the means have
    the variance :math:`1/\lambda - C`: the mixture is that distribution again, at any reach
    :math:`h`. Of another one it is as bent as the draws are, and along its thin axes as thin as the
    density is where each of them lies.
    """
    scale = np.linalg.cholesky(covariance)
    rise = ascent(_STEP * np.sqrt(np.diagonal(covariance)))(points)
    assert rise.curvature is not None
    with np.errstate(all="ignore"):
        curvature = scale.T @ rise.curvature @ scale
        slope = rise.slope @ scale
    # What overflows is as wide as all draws are.
    known = np.isfinite(curvature).all(axis=(1, 2)) & np.isfinite(slope).all(axis=1)
    curvature[~known], slope[~known] = 0.0, 0.0
    of_axes, axes = np.linalg.eigh(curvature)
    of_axes = of_axes.clip(_FLAT, None)
    variances = 1 / (of_axes + _REACH**-2)
    along = (axes.mT @ slope[..., None])[..., 0] / of_axes
    farthest = _FARTHEST * np.sqrt(variances)
    steps = ((1 - np.sqrt(1 - of_axes * variances)) * along).clip(-farthest, farthest)
    means = points + (axes @ steps[..., None])[..., 0] @ scale.T
    roots = scale @ axes * np.sqrt(variances)[:, None]
    weights = np.full(len(points), -np.log(len(points)))
    return GaussianMixture(weights, means, np.linalg.cholesky(roots @ roots.mT))
