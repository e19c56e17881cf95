"""Importance sampling: adapt a proposal to a density, then average the weights of fresh draws."""

from typing import NamedTuple

import numpy as np

from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.mixture import Array, GaussianMixture, log_sum_exp
from pymc_hyperelastic.evidence.path import Reference
from pymc_hyperelastic.evidence.proposal import ProposalBuilder
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
# Draws of a step of adaptation: chosen by experiment. A round of fresh draws has twice as many as
# the one before it; the first, twice as many as a step of adaptation.
STEP_DRAWS = 4000
# Draws of all steps of adaptation together, and of one round, at most.
_MOST_DRAWS = 100_000
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
    draws: int = 2 * STEP_DRAWS,
    candidate: tuple[GaussianMixture, int] | None = None,
) -> Integral:
    """Integrate a density by importance sampling, and draw particles from it.

    1. Draws of the `candidate` are weighted. If their mean is accurate, it is the result.
    2. The initial proposal is adapted to the density, see :func:`adapted_proposal`.
    3. Fresh draws of the final proposal are weighted. If their mean is not accurate, a proposal is
       fitted to them, they are dropped, and twice as many fresh draws are made of this proposal.

    Draws to which a proposal was fitted are never averaged: their weights are too small.

    The initial proposal is roughly like the density, or wider. With `draw_prior` the prior has a
    share in each proposal: weights are bounded if the likelihood is, and mass that the mixture has
    missed shows. `size` is the number of particles, `draws` that of the first fresh draws, and
    `candidate` a proposal that may be like the density, with the number of its draws.

    References
    ----------
    A. Owen and Y. Zhou, Safe and effective importance sampling, Journal of the American Statistical
    Association 95 (2000) 135.
    """
    dimension = initial_proposal.means.shape[1]
    if dimension > MOST_UNKNOWNS:
        unknown = Estimate(-np.inf, np.inf)
        return Integral(unknown, np.inf, "importance", initial_proposal.draw(size, rng))
    if candidate is not None:
        points, log_weights = weighted_draws(score, *candidate, rng, draw_prior)
        found = integral_of(points, log_weights, size, rng)
        if found.accurate and effective_sample_size(log_weights) > size:
            return found
    mixture = adapted_proposal(score, initial_proposal, builder, rng, draw_prior)
    while True:
        proposal = mixture.heavy_tailed()
        points, log_weights = weighted_draws(score, proposal, draws, rng, draw_prior)
        found = integral_of(points, log_weights, size, rng)
        draws *= 2
        # Fewer effective draws than unknowns have no covariance.
        few = effective_sample_size(log_weights) <= dimension
        if found.accurate or few or draws > _MOST_DRAWS:
            return found
        mixture = builder(points, log_weights, rng, mixture)


def adapted_proposal(
    score: Score,
    initial_proposal: GaussianMixture,
    builder: ProposalBuilder,
    rng: np.random.Generator,
    draw_prior: DrawPrior | None = None,
) -> GaussianMixture:
    r"""Adapt a proposal to a density :math:`p`: population Monte Carlo with tempered weights.

    Each step fits the next proposal to draws of the last one, :math:`q`, weighted as draws of
    :math:`q^{1-\beta} p^\beta`. The exponent :math:`\beta` is the largest one at which enough draws
    are effective. The last step is the first at which that is 1.

    References
    ----------
    E. Koblents and J. Míguez, A population Monte Carlo scheme with transformed weights and its
    application to stochastic kinetic models, Statistics and Computing 25 (2015) 407.
    """
    mixture = initial_proposal
    for _ in range(_MOST_DRAWS // STEP_DRAWS):
        proposal = mixture.heavy_tailed()
        points, log_weights = weighted_draws(score, proposal, STEP_DRAWS, rng, draw_prior)
        possible = np.isfinite(log_weights)
        if possible.sum() < ENOUGH:
            break
        points, log_weights = points[possible], log_weights[possible]
        beta = largest_step(log_weights, ENOUGH / len(points), 1.0)
        mixture = builder(points, beta * log_weights, rng, mixture)
        if beta == 1:
            break
    return mixture


def integral_of(points: Array, log_weights: Array, size: int, rng: np.random.Generator) -> Integral:
    """Return the integral that is the mean weight, with particles of the density."""
    log_value, pareto_k = mean_weight(log_weights)
    particles = points
    if np.isfinite(log_value.value):
        weights = np.exp(log_weights - log_weights.max())
        particles = rng.permutation(points[systematic(weights, size, rng)])
    return Integral(log_value, pareto_k, "importance", particles)


def weighted_draws(
    score: Score,
    proposal: GaussianMixture,
    draws: int,
    rng: np.random.Generator,
    draw_prior: DrawPrior | None = None,
) -> tuple[Array, Array]:
    """Return draws of a proposal, some of the prior if it can be drawn from, and log weights."""
    reference = Reference(proposal) if draw_prior else Reference(proposal, 0.0)
    points = reference.draw(draw_prior, draws, rng)
    prior, likelihood = score(points)
    log_weights = prior + likelihood - reference.log_density(points, prior)
    return points, np.nan_to_num(log_weights, nan=-np.inf, neginf=-np.inf)


def mean_weight(log_weights: Array) -> tuple[Estimate, float]:
    """Return the log mean of independent weights with its standard error, and their Pareto shape.

    Twice as many draws may have a weight larger than all of these: in a tail of shape ``k`` it is
    on average ``1 / (1 - k)`` times the largest, which is added to the error.
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
