"""Importance sampling from a mixture that is adapted to the posterior."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.mixture import (
    Array,
    GaussianMixture,
    components_for,
    log_sum_exp,
)
from pymc_hyperelastic.evidence.proposal import normal_of_halves
from pymc_hyperelastic.evidence.reference import Reference
from pymc_hyperelastic.evidence.target import DrawPrior, Score
from pymc_hyperelastic.evidence.weights import (
    effective_sample_size,
    largest_step,
    pareto_shape,
    systematic,
)

# Below this Pareto shape of the largest weights, weights have a variance, and their mean an error
# that is known.
LARGEST_PARETO_K = 0.5
# Below this one the mean is still known, by many draws: what the next one may add to it is part of
# its error.
LARGEST_KNOWN_K = 0.7
# Effective draws without which nothing is known of a mean: its error is then a twentieth at most.
ENOUGH = 400
# With more unknowns no mixture is learned from draws of itself: it loses more of them by what it
# does not know of correlations than it gains. A class of five coordinates has 20.
MOST_UNKNOWNS = 24
# Draws from the final mixture. Where they are not like the posterior another one is made of them,
# from which twice as many are drawn, and so on, so many at most. If that is not enough, the last is
# adapted once more.
DRAWS, _MOST_DRAWS, _MOST_ADAPTED = 8000, 64000, 2
# Share of the prior in them.
PRIOR_SHARE = 0.1
# Draws of what may be like the posterior already, and the error of a logarithm with which they are
# enough.
FIRST_DRAWS, LARGEST_ERROR = 1500, 0.03
# By how much modes are widened for these, and degrees of freedom of their tails.
_WIDER, _FREEDOM = 1.1, 4.0
# Draws of a step of adaptation, for each number that a component has, at least and at most; it goes
# so far that this fraction of them is effective.
_STEP_DRAWS, _FEWEST_DRAWS, _LARGEST_STEP = 80, 1000, 12_000
# So many times as many are made where these are too few for the components that there are.
_MORE_DRAWS = 4
_STEP_EFFECTIVE, _MOST_STEPS = 0.13, 60
# Effective fraction at which a mixture is like the posterior, and steps after which it is as like
# as it becomes.
_ALIKE, _LAST_STEPS = 0.3, 6


class Integral(NamedTuple):
    """The logarithm of an integral, with what it rests on."""

    log_value: Estimate
    pareto_k: float
    """Shape of the largest weights; NaN where there are none."""
    method: str
    """``"importance"``, ``"tempering"`` or ``"bridge"``."""
    particles: Array
    """Draws from the density, in random order."""

    @property
    def trusted(self) -> bool:
        """Whether the error is known."""
        return not self.pareto_k >= LARGEST_PARETO_K

    @property
    def known(self) -> bool:
        """Whether the value is, by many draws of a mixture."""
        return self.pareto_k < LARGEST_KNOWN_K


def by_importance(
    score: Score,
    like: GaussianMixture,
    size: int,
    rng: np.random.Generator,
    draw_prior: DrawPrior | None = None,
    first_draws: int = DRAWS,
    alike: Sequence[tuple[Reference, int]] = (),
) -> Integral:
    """Integral by importance sampling from a mixture, adapted from one that it is somehow like.

    Where the prior can be drawn from it has a share: where the likelihood is bounded, so are then
    the weights, and what the mixture has missed shows.

    So many draws of each of some distributions that may be `alike` already are tried first. If they
    are enough, no mixture is adapted; if not, they count among the others.

    References
    ----------
    A share of the prior: A. Owen and Y. Zhou, Safe and effective importance sampling, Journal of
    the American Statistical Association 95 (2000) 135. All draws are kept: J.-M. Cornuet,
    J.-M. Marin, A. Mira and C. P. Robert, Adaptive multiple importance sampling, Scandinavian
    Journal of Statistics 39 (2012) 798.
    """
    if like.means.shape[1] > MOST_UNKNOWNS:
        unknown = Estimate(-np.inf, np.inf)
        return Integral(unknown, np.inf, "importance", like.draw(size, rng))
    drawn = Drawn(score, draw_prior)
    if alike and (at_once := by_alike(drawn, alike, size, rng)):
        return at_once
    mixture, share = like, PRIOR_SHARE if draw_prior else 0.0
    first_draws = min(first_draws, _MOST_DRAWS)
    for _ in range(_MOST_ADAPTED):
        mixture = adapted_mixture(score, mixture, rng)
        for draws in (first_draws << i for i in range((_MOST_DRAWS // first_draws).bit_length())):
            drawn.add([(Reference(mixture.heavy_tailed(), share), draws)], rng)
            points, log_weights = drawn.weighted()
            mean = _, pareto_k = mean_weight(log_weights)
            effective = effective_sample_size(log_weights)
            if pareto_k < LARGEST_PARETO_K or not effective:
                break
            # So many draws tell more of the posterior's shape than those of a step.
            if effective > 2 * points.shape[1]:
                mixture = _fitted(points, log_weights, effective, DRAWS, rng, start=mixture)
        if pareto_k < LARGEST_KNOWN_K or not effective:
            break
    return integral_of(mean, points, log_weights, size, rng)


def by_alike(
    drawn: "Drawn", alike: Sequence[tuple[Reference, int]], size: int, rng: np.random.Generator
) -> Integral | None:
    """The integral by draws of what may be alike; None where they are not worth the particles."""
    drawn.add(alike, rng)
    points, log_weights = drawn.weighted()
    mean = log_value, pareto_k = mean_weight(log_weights)
    sure = pareto_k < LARGEST_PARETO_K and log_value.standard_error < LARGEST_ERROR
    if sure and effective_sample_size(log_weights) > size:
        return integral_of(mean, points, log_weights, size, rng)
    return None


def integral_of(
    mean: tuple[Estimate, float],
    points: Array,
    log_weights: Array,
    size: int,
    rng: np.random.Generator,
) -> Integral:
    """An integral that is a mean weight, with so many particles of the density."""
    log_value, pareto_k = mean
    particles = points
    if np.isfinite(log_value.value):
        weights = np.exp(log_weights - log_weights.max())
        particles = rng.permutation(points[systematic(weights, size, rng)])
    return Integral(log_value, pareto_k, "importance", particles)


def at_modes(modes: GaussianMixture) -> GaussianMixture:
    """Distribution to draw from where modes are what there is, with tails for what is skewed."""
    return modes.widened(_WIDER, freedom=_FREEDOM)


class Drawn:
    """All draws so far, from one proposal after another, as if from the mixture of these.

    To keep the last draws alone would choose those whose weights look good: the ones that have
    missed what the others have met.
    """

    points: Array
    """Shape (n, d)."""
    prior: Array
    """Log prior of each, shape (n,)."""
    likelihood: Array
    log_density: Array
    """Of the mixture, times `n`."""

    def __init__(self, score: Score, draw_prior: DrawPrior | None) -> None:
        self._score, self._draw_prior = score, draw_prior
        self._proposals: list[tuple[Reference, int]] = []

    def add(self, proposals: Sequence[tuple[Reference, int]], rng: np.random.Generator) -> None:
        """Draw so many from each of other proposals; all of them are scored together."""
        drawn = [proposal.draw(self._draw_prior, draws, rng) for proposal, draws in proposals]
        points = np.concatenate(drawn)
        prior, likelihood = self._score(points)
        before, self._proposals = self._proposals, [*self._proposals, *proposals]
        log_density = _log_density(self._proposals, points, prior)
        if before:
            known = np.logaddexp(self.log_density, _log_density(proposals, self.points, self.prior))
            points = np.concatenate([self.points, points])
            prior = np.concatenate([self.prior, prior])
            likelihood = np.concatenate([self.likelihood, likelihood])
            log_density = np.concatenate([known, log_density])
        self.points, self.prior, self.likelihood = points, prior, likelihood
        self.log_density = log_density

    def weighted(self) -> tuple[Array, Array]:
        """All points, and the logarithms of their weights."""
        log_weights = self.prior + self.likelihood - self.log_density + np.log(len(self.points))
        return self.points, np.nan_to_num(log_weights, nan=-np.inf, neginf=-np.inf)


def _log_density(
    proposals: Sequence[tuple[Reference, int]], points: Array, log_prior: Array
) -> Array:
    """Of so many draws of each proposal, all together."""
    return np.logaddexp.reduce([np.log(n) + q.log_density(points, log_prior) for q, n in proposals])


def adapted_mixture(
    score: Score, like: GaussianMixture, rng: np.random.Generator
) -> GaussianMixture:
    """Mixture like the posterior ``p``, along ``q^(1-β) p^β`` from the mixture ``q`` that is given.

    References
    ----------
    O. Cappé, R. Douc, A. Guillin, J.-M. Marin and C. P. Robert, Adaptive importance sampling in
    general mixture classes, Statistics and Computing 18 (2008) 447.
    """
    dimension = like.means.shape[1]
    numbers = (dimension + 1) * (dimension + 2) // 2
    draws = min(max(_FEWEST_DRAWS, _STEP_DRAWS * numbers), _LARGEST_STEP)
    most = min(_MORE_DRAWS * draws, _LARGEST_STEP)
    beta, last, mixture = 0.0, 0, like
    start = like.heavy_tailed()
    for _ in range(_MOST_STEPS):
        points, log_density = draw_heavy_tailed(mixture, draws, rng)
        posterior = np.add(*score(points))
        possible = np.isfinite(posterior)
        if not possible.any():
            break
        points, posterior = points[possible], posterior[possible]
        before = start.log_density(points)
        log_weights = before - log_density[possible] + beta * (posterior - before)
        step = largest_step(posterior - before, _STEP_EFFECTIVE, 1.0 - beta, log_weights)
        beta = 1.0 if step == 1.0 - beta else beta + step
        log_weights += step * (posterior - before)
        effective = effective_sample_size(log_weights)
        last += beta == 1
        # From hardly more draws than there are unknowns no shape is learned.
        if (last and effective > _ALIKE * draws) or effective < 2 * dimension:
            break
        # Of too few a ridge would be fitted by one normal distribution, and lost.
        if len(mixture.means) > 1 == components_for(effective, dimension) and draws < most:
            draws, last = min(2 * draws, most), 0
            continue
        mixture = _fitted(points, log_weights, effective, draws, rng, start=mixture)
        if last == _LAST_STEPS:
            break
    return mixture


def _fitted(
    points: Array,
    log_weights: Array,
    effective: float,
    size: int,
    rng: np.random.Generator,
    start: GaussianMixture | None = None,
) -> GaussianMixture:
    """Mixture fitted to so many of the weighted points, of which some are effective.

    Where there are too few for several components, correlations may be those of chance: in many
    dimensions a normal distribution that keeps them is thinner than the posterior somewhere.
    """
    weights = np.exp(log_weights - log_weights.max())
    # A ridge needs more components than it has modes, which many draws can tell apart.
    components = components_for(effective, points.shape[1])
    if components == 1 and (start is None or len(start.means) == 1):
        # A half in which one point has all the weight has no spread.
        parts = [slice(half, None, 2) for half in range(2)]
        if all(np.ptp(weights[part]) < weights[part].sum() for part in parts):
            early, late = (points[p][systematic(weights[p], size // 2, rng)] for p in parts)
            return normal_of_halves(early, late)
    learn_from = points[systematic(weights, size, rng)]
    if start is None:
        return GaussianMixture.fit(learn_from, components, rng)
    known = start if len(start.means) >= components else None
    return GaussianMixture.fit(
        learn_from, components, rng, start=known, iterations=6, worth=effective / size
    )


def weighted_draws(
    score: Score, proposal: GaussianMixture, draws: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Points from a proposal, and the logarithms of their weights."""
    points = proposal.draw(draws, rng)
    log_weights = sum(score(points)) - proposal.log_density(points)
    return points, np.nan_to_num(log_weights, nan=-np.inf, neginf=-np.inf)


def draw_heavy_tailed(
    mixture: GaussianMixture, draws: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Points from the mixture with heavy tails, and its log density there."""
    proposal = mixture.heavy_tailed()
    points = proposal.draw(draws, rng)
    return points, proposal.log_density(points)


def mean_weight(log_weights: Array) -> tuple[Estimate, float]:
    """Mean of independent weights, as its logarithm with a standard error; their Pareto shape.

    With fewer effective weights than are enough nothing is known of it. As many more may well have
    one that is larger than all of these: in a tail of shape ``k`` it is ``1 / (1 - k)`` times as
    large as the largest, on average, which counts as an error, too.
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
