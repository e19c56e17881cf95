"""Importance sampling: adapt a proposal to a density, then average the weights of fresh draws."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.mixture import Array, GaussianMixture, log_sum_exp
from pymc_hyperelastic.evidence.proposal import ProposalBuilder
from pymc_hyperelastic.evidence.reference import Reference
from pymc_hyperelastic.evidence.target import DrawPrior, Score
from pymc_hyperelastic.evidence.weights import (
    effective_sample_size,
    largest_step,
    pareto_shape,
    systematic,
)

# Pareto shape of the weights from which their variance is infinite, and with it the error unknown.
LARGEST_PARETO_K = 0.5
# Pareto shape up to which the mean of Pareto-smoothed weights is reliable (Vehtari et al. 2024).
LARGEST_RELIABLE_K = 0.7
# Fewest effective draws by which a mean is known, or a proposal is fitted: a relative error of a
# mean is then at most 1/20.
ENOUGH = 400
# Unknowns up to which proposals are adapted. More cannot be: a mixture that is fitted to draws of
# itself loses more by errors of its correlations than it gains. A class of five coordinates has 20.
MOST_UNKNOWNS = 24
# Draws of a step of adaptation: chosen by experiment.
STEP_DRAWS = 4000
# Fresh draws of the first round; each further round has twice as many.
DRAWS = 8000
# Draws of all steps of adaptation together, and of one round, at most.
_MOST_DRAWS = 100_000
# Share of the prior in a proposal: weights are then bounded if the likelihood is (Owen and Zhou).
PRIOR_SHARE = 0.1
# Standard error, in nats, with which a log integral is accurate enough.
LARGEST_ERROR = 0.03


class Integral(NamedTuple):
    """The logarithm of an integral, and how it was computed."""

    log_value: Estimate
    pareto_k: float
    """Shape of the largest weights; NaN for other methods than importance sampling."""
    method: str
    """``"importance"``, ``"tempering"`` or ``"bridge"``."""
    particles: Array
    """Draws from the density, in random order."""

    @property
    def reliable(self) -> bool:
        """True if the Pareto shape shows that the value is right; False if it is NaN."""
        return self.pareto_k < LARGEST_RELIABLE_K

    @property
    def accurate(self) -> bool:
        """True if the error is known, and small."""
        return self.pareto_k < LARGEST_PARETO_K and self.log_value.standard_error < LARGEST_ERROR


def importance_sampling(
    score: Score,
    initial_proposal: GaussianMixture,
    builder: ProposalBuilder,
    size: int,
    rng: np.random.Generator,
    *,
    draw_prior: DrawPrior | None = None,
    draws: int = DRAWS,
    candidate_proposals: Sequence[tuple[Reference, int]] = (),
) -> Integral:
    """Integrate a density by importance sampling, and draw particles from it.

    1. Numbers of draws of `candidate_proposals` are weighted. If their mean is accurate, it is the
       result: no proposal was fitted.
    2. The initial proposal is adapted to the density, see :func:`adapted_proposal`.
    3. Fresh draws of the final proposal are weighted. If their mean is not accurate, a proposal is
       fitted to them, they are dropped, and twice as many fresh draws are made of this proposal.

    Draws to which a proposal was fitted are never averaged: their weights are too small.

    If the prior can be drawn from it has a share in each proposal: weights are then bounded if the
    likelihood is, and mass that the mixture has missed shows.

    Parameters
    ----------
    score : callable
        Log prior and log likelihood of points, (n, d); their sum is the log density.
    initial_proposal : GaussianMixture
        Roughly like the density, or wider.
    builder : callable
        Fits a proposal to weighted draws.
    size : int
        Number of particles.
    draw_prior : callable, optional
        Draws of the prior.
    draws : int
        Number of fresh draws of the first round.

    References
    ----------
    A. Owen and Y. Zhou, Safe and effective importance sampling, Journal of the American Statistical
    Association 95 (2000) 135.
    """
    dimension = initial_proposal.means.shape[1]
    if dimension > MOST_UNKNOWNS:
        unknown = Estimate(-np.inf, np.inf)
        return Integral(unknown, np.inf, "importance", initial_proposal.draw(size, rng))
    if candidate_proposals:
        points, log_weights = _weighted(score, draw_prior, candidate_proposals, rng)
        found = integral_of(points, log_weights, size, rng)
        if found.accurate and effective_sample_size(log_weights) > size:
            return found
    share = PRIOR_SHARE if draw_prior else 0.0
    mixture = adapted_proposal(score, initial_proposal, builder, rng, draw_prior)
    while True:
        proposal = Reference(mixture.heavy_tailed(), share)
        points, log_weights = _weighted(score, draw_prior, [(proposal, draws)], rng)
        found = integral_of(points, log_weights, size, rng)
        draws *= 2
        # Fewer effective draws than unknowns have no covariance.
        few = effective_sample_size(log_weights) <= dimension
        if found.accurate or few or draws > _MOST_DRAWS:
            return found
        mixture = builder(points, log_weights, rng, mixture)


def _weighted(
    score: Score,
    draw_prior: DrawPrior | None,
    proposals: Sequence[tuple[Reference, int]],
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """Return draws of proposals, and their log weights."""
    pool = Pool(score, draw_prior)
    pool.add(proposals, rng)
    return pool.weighted()


def adapted_proposal(
    score: Score,
    initial_proposal: GaussianMixture,
    builder: ProposalBuilder,
    rng: np.random.Generator,
    draw_prior: DrawPrior | None = None,
) -> GaussianMixture:
    r"""Adapt a proposal :math:`q` to a density :math:`p`: adaptive multiple importance sampling.

    Each step adds draws of the last proposal to all draws before, weights all of them as if from
    the mixture of their proposals, and fits the next proposal to the tempered density
    :math:`q^{1-\beta} p^\beta`. The exponent :math:`\beta` is the largest one at which enough draws
    are effective.

    References
    ----------
    J.-M. Cornuet, J.-M. Marin, A. Mira and C. P. Robert, Adaptive multiple importance sampling,
    Scandinavian Journal of Statistics 39 (2012) 798.
    """
    share = PRIOR_SHARE if draw_prior else 0.0
    start = Reference(initial_proposal.heavy_tailed(), share)
    mixture, pool = initial_proposal, Pool(score, draw_prior)
    for _ in range(_MOST_DRAWS // STEP_DRAWS):
        pool.add([(Reference(mixture.heavy_tailed(), share), STEP_DRAWS)], rng)
        log_density = pool.prior + pool.likelihood
        possible = np.isfinite(log_density)
        if possible.sum() < ENOUGH:
            break
        points = pool.points[possible]
        log_start = start.log_density(points, pool.prior[possible])
        ratio = log_density[possible] - log_start
        log_weights = log_start - pool.log_proposal[possible]
        beta = largest_step(ratio, ENOUGH / len(points), 1.0, log_weights)
        mixture = builder(points, log_weights + beta * ratio, rng, mixture)
        if beta == 1:
            break
    return mixture


class Pool:
    """Draws of several proposals, weighted as if each were from the mixture of all proposals."""

    points: Array
    """Shape (n, d)."""
    prior: Array
    """Log prior of each, shape (n,)."""
    likelihood: Array
    log_proposal: Array
    """Log density of the mixture of proposals, plus ``ln n``."""

    def __init__(self, score: Score, draw_prior: DrawPrior | None) -> None:
        self._score, self._draw_prior = score, draw_prior
        self._proposals: list[tuple[Reference, int]] = []

    def add(self, proposals: Sequence[tuple[Reference, int]], rng: np.random.Generator) -> None:
        """Draw numbers of points from proposals; the points are evaluated together."""
        drawn = [proposal.draw(self._draw_prior, draws, rng) for proposal, draws in proposals]
        points = np.concatenate(drawn)
        prior, likelihood = self._score(points)
        before, self._proposals = self._proposals, [*self._proposals, *proposals]
        log_proposal = _log_density(self._proposals, points, prior)
        if before:
            of_new = _log_density(proposals, self.points, self.prior)
            known = np.logaddexp(self.log_proposal, of_new)
            points = np.concatenate([self.points, points])
            prior = np.concatenate([self.prior, prior])
            likelihood = np.concatenate([self.likelihood, likelihood])
            log_proposal = np.concatenate([known, log_proposal])
        self.points, self.prior, self.likelihood = points, prior, likelihood
        self.log_proposal = log_proposal

    def weighted(self) -> tuple[Array, Array]:
        """Return all points, and their log weights, whose mean is the integral."""
        log_weights = self.prior + self.likelihood - self.log_proposal + np.log(len(self.points))
        return self.points, np.nan_to_num(log_weights, nan=-np.inf, neginf=-np.inf)


def _log_density(
    proposals: Sequence[tuple[Reference, int]], points: Array, log_prior: Array
) -> Array:
    """Return the log of the sum of the densities of proposals times their numbers of draws."""
    return np.logaddexp.reduce([np.log(n) + q.log_density(points, log_prior) for q, n in proposals])


def integral_of(points: Array, log_weights: Array, size: int, rng: np.random.Generator) -> Integral:
    """Return the integral that is the mean weight, with particles of the density."""
    log_value, pareto_k = mean_weight(log_weights)
    particles = points
    if np.isfinite(log_value.value):
        weights = np.exp(log_weights - log_weights.max())
        particles = rng.permutation(points[systematic(weights, size, rng)])
    return Integral(log_value, pareto_k, "importance", particles)


def weighted_draws(
    score: Score, proposal: GaussianMixture, draws: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Return draws of a proposal, and their log weights."""
    return _weighted(score, None, [(Reference(proposal, 0.0), draws)], rng)


def mean_weight(log_weights: Array) -> tuple[Estimate, float]:
    """Return the log mean of independent weights with its standard error, and their Pareto shape.

    With fewer than 400 effective weights the mean is unknown. Twice as many draws may well have a
    weight that is larger than all of these: in a tail of shape ``k`` it is ``1 / (1 - k)`` times
    the largest, on average, which is added to the error.
    """
    effective = effective_sample_size(log_weights)
    if effective < ENOUGH:
        return Estimate(-np.inf, np.inf), np.inf
    total, pareto_k = float(log_sum_exp(log_weights)), pareto_shape(log_weights)
    variance = max(1 / effective - 1 / log_weights.size, 0.0)
    largest = np.exp(log_weights.max() - total)
    unseen = largest / (1 - max(pareto_k, 0.0)) if pareto_k < 1 else np.inf
    value = total - float(np.log(log_weights.size))
    return Estimate(value, float(np.hypot(np.sqrt(variance), unseen))), pareto_k
