"""Importance sampling from mixtures that are like the posterior: at its modes, or adapted to it."""

import numpy as np
from arviz_stats.base import array_stats
from scipy.special import logsumexp

from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.kernel import BatchedSMC
from pymc_hyperelastic.evidence.mixture import Array, GaussianMixture, components_for
from pymc_hyperelastic.evidence.modes import modes_from
from pymc_hyperelastic.evidence.search import places_to_climb_from, width_of
from pymc_hyperelastic.evidence.target import Score
from pymc_hyperelastic.evidence.weights import effective_sample_size, largest_step, systematic

# Pareto shapes of the largest weights. Below the first, weights have a variance, and their mean an
# error that is known. From the second on the mean itself is not to be trusted: it exists up to a
# shape of 1, but the few largest weights decide it.
LARGEST_PARETO_K, UNTRUSTED_PARETO_K = 0.5, 0.7
# Effective draws that a mean of weights needs: its relative error is then a thirtieth at most.
_ENOUGH = 1000
# A step of adaptation goes so far that this fraction of its draws is effective.
_STEP_EFFECTIVE, _MOST_STEPS = 0.1, 60
# Effective fraction at which a mixture is like the posterior, and steps after which it is as like
# as it becomes.
_ALIKE, _LAST_STEPS = 0.4, 5
# Fits of a mixture to weighted draws.
_MOST_FITS = 8
# Draws from the mixture at the modes, and effective ones without which nothing is known of a mean.
_DRAWS_FROM_MODES, _ENOUGH_FROM_MODES = 8000, 300


def adapted_mixture(
    score: Score, mixture: GaussianMixture, rng: np.random.Generator, draws: int = 1000
) -> GaussianMixture | None:
    """Mixture like the posterior, from one like the prior; None if it gets stuck.

    Each step learns from so many draws.

    References
    ----------
    O. Cappé, R. Douc, A. Guillin, J.-M. Marin and C. P. Robert, Adaptive importance sampling in
    general mixture classes, Statistics and Computing 18 (2008) 447.
    """
    beta, last = 0.0, 0
    for _ in range(_MOST_STEPS):
        points, log_density = draw_heavy_tailed(mixture, draws, rng)
        prior, likelihood = score(points)
        possible = np.isfinite(prior + likelihood)
        if not possible.any():
            return None
        points, likelihood = points[possible], likelihood[possible]
        log_weights = (prior - log_density)[possible] + beta * likelihood
        step = largest_step(likelihood, _STEP_EFFECTIVE, 1.0 - beta, log_weights)
        beta = 1.0 if step == 1.0 - beta else beta + step
        log_weights += step * likelihood
        weights = np.exp(log_weights - log_weights.max())
        learn_from = points[systematic(weights, draws, rng)]
        mixture = GaussianMixture.fit(
            learn_from, len(mixture.means), rng, start=mixture, iterations=4
        )
        last += beta == 1
        if last == _LAST_STEPS or (last and effective_sample_size(log_weights) > _ALIKE * draws):
            return mixture
    return None


def fitted_mixture(
    score: Score, mixture: GaussianMixture, rng: np.random.Generator, draws: int
) -> GaussianMixture:
    """Mixture fitted to the posterior by importance sampling from one that is near it."""
    for _ in range(_MOST_FITS):
        points, log_weights = weighted_draws(score, mixture, draws, rng)
        effective = effective_sample_size(log_weights)
        # There is nothing to learn from draws that are all impossible.
        if effective == 0 or effective > _ALIKE * draws:
            break
        weights = np.exp(log_weights - log_weights.max())
        learn_from = points[systematic(weights, draws, rng)]
        # A ridge needs more components than it has modes, which many draws can tell apart.
        components = components_for(effective, points.shape[1])
        start = mixture if len(mixture.means) >= components else None
        mixture = GaussianMixture.fit(learn_from, components, rng, start=start, iterations=6)
    return mixture


def weighted_draws(
    score: Score, mixture: GaussianMixture, draws: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Points from the mixture with heavy tails, and the logarithms of their weights."""
    points, log_density = draw_heavy_tailed(mixture, draws, rng)
    log_weights = sum(score(points)) - log_density
    return points, np.nan_to_num(log_weights, nan=-np.inf, neginf=-np.inf)


def draw_heavy_tailed(
    mixture: GaussianMixture, draws: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Points from the mixture with heavy tails, and its log density there."""
    proposal = mixture.heavy_tailed()
    points = proposal.draw(draws, rng)
    return points, proposal.log_density(points)


def mean_weight(log_weights: Array, enough: int = _ENOUGH) -> tuple[Estimate, float]:
    """Mean of independent weights, as its logarithm with a standard error; their Pareto shape.

    With fewer effective weights than are enough nothing is known of it.
    """
    effective = effective_sample_size(log_weights)
    if effective < enough:
        return Estimate(-np.inf, np.inf), np.inf
    finite = log_weights[np.isfinite(log_weights)]
    # ArviZ takes the logarithms of what divides. Equal weights have no tail.
    pareto_k = float(array_stats.psislw(-finite)[1]) if np.ptp(finite) > 0 else -np.inf
    value = float(logsumexp(log_weights) - np.log(log_weights.size))
    variance = max(1 / effective - 1 / log_weights.size, 0.0)
    return Estimate(value, float(np.sqrt(variance))), pareto_k


def sample_from_modes(kernel: BatchedSMC, rng: np.random.Generator) -> tuple[Array, Estimate]:
    """Particles of the posterior in random order, and the evidence.

    Posteriors here have few variables and mostly one mode: importance sampling from a mixture gives
    them in a tenth of the time of SMC, which is left the others.
    """
    kernel.set_rng(rng)
    steps = max(1000, 250 * kernel.dimension)
    prior = kernel.columns(kernel.initialize_population())
    wide = GaussianMixture.fit(prior, components_for(steps, kernel.dimension), rng)
    starts = places_to_climb_from(prior, sum(kernel.score(prior)))
    found = modes_from(kernel.target.ascent, starts, width_of(prior))
    modes = found.mixture if found else wide
    best, found = Estimate(-np.inf, np.inf), prior
    for broad in (False, True):
        mixture = modes
        if broad:
            # A posterior that is hardly narrower than the prior is not like its mode.
            followed = adapted_mixture(kernel.score, wide, rng, steps)
            mixture = modes.joined(followed or wide)
        mixture = fitted_mixture(kernel.score, mixture, rng, steps)
        points, log_weights = weighted_draws(kernel.score, mixture, _DRAWS_FROM_MODES, rng)
        evidence, pareto_k = mean_weight(log_weights, enough=_ENOUGH_FROM_MODES)
        if evidence.value > best.value:
            weights = np.exp(log_weights - log_weights.max())
            best, found = evidence, points[systematic(weights, kernel.draws, rng)]
        if pareto_k < UNTRUSTED_PARETO_K:
            return rng.permutation(found), best
    kernel.temper(None, rng)
    # Both are unbiased, and miss modes rather than invent them: the larger is the better one.
    if kernel.log_marginal_likelihood > best.value:
        best = Estimate(
            kernel.log_marginal_likelihood, float(np.sqrt(kernel.log_evidence_variance))
        )
        found = kernel.tempered_posterior
    return rng.permutation(found), best
