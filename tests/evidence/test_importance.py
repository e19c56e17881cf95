"""Importance sampling: adapted proposals, fresh draws, and Laplace approximations about draws."""

import numpy as np
import pytest
from agreement import ROUNDING, Regression, assert_agrees
from arviz_stats.base import array_stats
from scipy import stats
from scipy.special import logsumexp
from tiers import deep

from pymc_hyperelastic.evidence import importance, integral
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.importance import (
    Integral,
    importance_sampling,
    mean_weight,
    weighted_draws,
)
from pymc_hyperelastic.evidence.integral import integrate
from pymc_hyperelastic.evidence.mixture import GaussianMixture
from pymc_hyperelastic.evidence.proposal import (
    expectation_maximisation,
    laplace_about,
    laplace_mixture,
)
from pymc_hyperelastic.evidence.target import Derivatives, Target, evaluation, finite_differences
from pymc_hyperelastic.evidence.weights import effective_sample_size

SEED = 911


def draw_prior(count, rng):
    return rng.standard_normal((count, 2))


def test_error_of_the_mean_weight_includes_an_unseen_large_weight():
    """The error includes an unseen draw with ``1/(1 - k)`` times the largest weight."""
    log_weights = np.random.default_rng(SEED).exponential(0.3, 1000)
    (value, error), shape = mean_weight(log_weights)
    weights = np.exp(log_weights)
    assert value == pytest.approx(np.log(weights.mean()), rel=ROUNDING)
    bound = np.log(weights.max() / weights.mean()) / np.log(1000)
    assert shape == pytest.approx(min(array_stats.psislw(-log_weights)[1], bound))
    within = np.sqrt(np.sum(weights**2) / weights.sum() ** 2 - 1 / 1000)
    unseen = weights.max() / weights.sum() / (1 - shape)
    assert error == pytest.approx(np.hypot(within, unseen), rel=1e-9)


def test_mean_weight_of_fewer_than_400_effective_draws_is_unknown():
    assert np.isfinite(mean_weight(np.zeros(400))[0].standard_error)
    for log_weights in (np.zeros(399), np.full(2000, -np.inf)):
        assert mean_weight(log_weights) == ((-np.inf, np.inf), np.inf)


def test_proposal_of_more_than_24_unknowns_is_not_adapted():
    initial = GaussianMixture(np.zeros(1), np.zeros((1, 25)), np.eye(25)[None])
    rng = np.random.default_rng(SEED)
    found = importance_sampling(None, initial, expectation_maximisation, 10, rng)
    assert found.log_value == (-np.inf, np.inf) and not found.reliable


def test_integral_is_reliable_and_accurate_up_to_limits_of_the_pareto_shape():
    """The limits are 0.5 and 0.7 (Vehtari et al. 2024); a NaN shape is not reliable.

    Accurate values also have a small error.
    """
    shapes = [0.49, 0.51, 0.69, 0.71, np.nan]
    found = [Integral(Estimate(0.0, 0.02), shape, "", np.empty((0, 1))) for shape in shapes]
    assert [one.accurate for one in found] == [True, False, False, False, False]
    assert [one.reliable for one in found] == [True, True, True, False, False]
    assert not Integral(Estimate(0.0, 0.04), 0.1, "", np.empty((0, 1))).accurate


def test_weights_use_the_mixture_of_proposal_and_a_tenth_of_the_prior():
    def score(points):
        return stats.norm.logpdf(points).sum(axis=1), -np.abs(points).sum(axis=1)

    rng = np.random.default_rng(SEED)
    proposal = GaussianMixture(np.zeros(1), np.ones((1, 2)), np.eye(2)[None])
    for prior, share in ((draw_prior, 0.1), (None, 0.0)):
        points, log_weights = weighted_draws(score, proposal, 50, rng, prior)
        of_prior, of_proposal = (stats.norm.pdf(points, at).prod(axis=1) for at in (0, 1))
        density = share * of_prior + (1 - share) * of_proposal
        np.testing.assert_allclose(np.exp(log_weights), np.exp(sum(score(points))) / density)


def normal_problem(spread=0.1, place=(1.0, -0.5)):
    """Return the score of a normal prior and likelihood, and its log integral."""
    exact = stats.norm(0, np.hypot(1, spread)).logpdf(place).sum()

    def score(points):
        likelihood = stats.norm.logpdf(points, place, spread).sum(axis=1)
        return stats.norm.logpdf(points).sum(axis=1), likelihood

    return score, exact


@pytest.mark.parametrize("draws", [4000, 100_000])
def test_integral_of_a_normal_prior_and_likelihood_is_exact(draws):
    spread, place = 0.1, np.array([1.0, -0.5])
    score, exact = normal_problem(spread, place)
    rng = np.random.default_rng(SEED)
    initial, builder = GaussianMixture.fit(draw_prior(2000, rng), 1, rng), expectation_maximisation
    found = importance_sampling(
        score, initial, builder, 500, rng, draw_prior=draw_prior, draws=draws
    )
    assert_agrees(found.log_value, exact, 0.025)
    assert found.accurate and found.reliable
    mean, sd = place / (1 + spread**2), spread / np.hypot(1, spread)
    assert np.all(np.abs(found.particles.mean(axis=0) - mean) < 4 * sd / np.sqrt(500))
    np.testing.assert_allclose(found.particles.std(axis=0), sd, rtol=4 / np.sqrt(1000))


def test_particles_exclude_draws_to_which_the_proposal_was_fitted():
    """The proposal of the first round is useless: only later rounds are averaged."""
    score, exact = normal_problem()
    seen, fitted = [], []

    def builder(points, log_weights, rng, current):
        fitted.append(points)
        good = expectation_maximisation(points, log_weights, rng, current)
        # The proposal is too wide after adaptation, so that another round is needed.
        first_rounds = len([p for p in seen if len(p) >= 8000]) < 2
        return good.widened(12.0) if first_rounds else good

    def recorded(points):
        seen.append(points)
        return score(points)

    rng = np.random.default_rng(SEED)
    initial = GaussianMixture(np.zeros(1), np.zeros((1, 2)), np.eye(2)[None])
    found = importance_sampling(recorded, initial, builder, 500, rng)
    assert len(seen[-1]) > 8000
    averaged = {tuple(x) for x in seen[-1]}
    assert {tuple(x) for x in found.particles} <= averaged
    assert not averaged & {tuple(x) for points in fitted for x in points}
    assert_agrees(found.log_value, exact, 0.03)


@pytest.mark.parametrize(
    ("unknowns", "limit", "method"),
    [
        (3, 3, "importance"),
        (5, 4, "tempering"),
        *deep([(12, 24, "importance"), (25, 24, "tempering")]),
    ],
)
def test_method_of_an_integral_depends_on_the_number_of_unknowns(
    unknowns, limit, method, monkeypatch
):
    monkeypatch.setattr(integral, "MOST_UNKNOWNS", limit)
    monkeypatch.setattr(importance, "MOST_UNKNOWNS", limit)
    problem = Regression(unknowns)
    found = integrate(Target(problem.model), 500, np.random.default_rng(SEED))
    assert found.method == method and found.particles.shape == (500, unknowns)
    assert np.isnan(found.pareto_k) == (method == "tempering")
    assert_agrees(found.log_value, problem.log_evidence, 0.15)


class SquaredErrors(Target):
    """Standard normal priors, a likelihood of squared errors, and Gauss-Newton curvatures."""

    has_gradients = False

    def __init__(self, errors, dimension, axes=None):
        self._errors, self.dimension = errors, dimension
        self._axes = np.eye(dimension) if axes is None else axes

    def draw_prior(self, count, rng):
        return rng.standard_normal((count, self.dimension))

    def evaluate(self, points):
        prior = stats.norm.logpdf(points).sum(axis=1)
        squares = np.square(self._errors(points @ self._axes)).sum(axis=1)
        return evaluation(prior, -squares / 2)

    def cost(self):
        return 1000

    def derivatives(self, points, width):
        stencil, difference = finite_differences(points, width)
        flat = stencil.reshape(-1, self.dimension)
        values = np.add(*self.score(flat)).reshape(len(points), -1)
        errors = difference(self._errors(flat @ self._axes).reshape(*stencil.shape[:2], -1))
        curvature = errors @ errors.mT + np.eye(self.dimension)
        return Derivatives(values[:, 0], difference(values), curvature)


def sharing(load, error):
    """Return errors of the summed load of two fibres, whose moduli are on logarithmic scales."""
    return lambda points: (np.exp(points.reshape(len(points), -1, 2)).sum(axis=2) - load) / error


def linear(points):
    """Return errors of two linear equations: the posterior is normal."""
    return (points @ np.array([[1.0, 0.3], [0.5, -1.0]]) - [1.0, 0.5]) / 0.2


def integral_over_two(errors):
    """Integrate by the trapezoidal rule; the narrowest ridge has an sd of one step of the grid."""
    x = np.linspace(-6.5, 6.5, 1301)
    points = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    prior = stats.norm.logpdf(points).sum(axis=1)
    with np.errstate(over="ignore"):
        density = prior - np.square(errors(points)).sum(axis=1) / 2
    return logsumexp(density) + 2 * np.log(x[1] - x[0])


def assert_integral(target, exact, seeds=4):
    """Compare integrals with several seeds with the exact one; their errors are small."""
    found = [integrate(target, 1000, np.random.default_rng(seed)) for seed in range(seeds)]
    values, errors = np.array([f.log_value for f in found]).T
    assert all(f.method == "importance" and f.reliable for f in found)
    assert errors.max() < 0.06
    assert np.sqrt(np.mean(((values - exact) / errors) ** 2)) < 1.8


@pytest.mark.parametrize(
    "errors",
    [linear, sharing(2.0, 0.02), *deep([sharing(0.3, 0.02), sharing(8.0, 0.5)])],
    ids=["normal", "load 2", "load 0.3", "load 8"],
)
def test_integral_of_a_normal_or_bent_posterior_equals_a_sum_over_a_grid(errors):
    assert_integral(SquaredErrors(errors, 2), integral_over_two(errors))


@pytest.mark.deep
def test_integral_over_bent_ridges_in_several_directions_is_exact_or_not_reliable():
    """Four pairs of unknowns on rotated axes; ridges that are too thin give an infinite error."""
    axes = np.linalg.qr(np.random.default_rng(3).standard_normal((8, 8)))[0]
    wide, thin = sharing(0.5, 0.05), sharing(3.0, 0.05)
    assert_integral(SquaredErrors(wide, 8, axes), 4 * integral_over_two(wide))
    found = integrate(SquaredErrors(thin, 8, axes), 1000, np.random.default_rng(0))
    assert found.log_value.standard_error == np.inf


def test_laplace_approximations_about_normal_draws_have_the_normal_moments():
    rng = np.random.default_rng(1)
    place, root = np.array([1.0, -2.0, 0.5]), np.array([[1, 0, 0], [0.9, 0.1, 0], [0.3, -0.2, 2]])
    covariance = root @ root.T
    draws = rng.standard_normal((50, 3))
    draws -= draws.mean(axis=0)
    standard = np.linalg.solve(np.linalg.cholesky(np.cov(draws.T, ddof=0)), draws.T).T
    points, factor = place + standard @ root.T, np.linalg.cholesky(covariance)
    # In the coordinates of the factor the density is standard normal.
    z = np.linalg.solve(factor, (points - place).T).T
    derivatives = Derivatives(np.zeros(50), -z, np.repeat(np.eye(3)[None], 50, axis=0))
    mixture = laplace_about(derivatives, points, factor)
    spread = np.cov(mixture.means.T, ddof=0) + mixture.covariances.mean(axis=0)
    np.testing.assert_allclose(mixture.means.mean(axis=0), place, atol=1e-12)
    np.testing.assert_allclose(spread, covariance, rtol=1e-9)
    # The covariances are 1/(1 + 1/4) of those of the draws: they reach two sds.
    np.testing.assert_allclose(mixture.covariances[0], 0.8 * covariance, rtol=1e-9)


def test_infinite_curvature_gives_a_component_as_wide_as_all_draws():
    curvature = np.array([np.eye(2), np.full((2, 2), np.inf)])
    derivatives = Derivatives(np.zeros(2), np.array([[0.0, 0.0], [np.inf, 0.0]]), curvature)
    mixture = laplace_about(derivatives, np.zeros((2, 2)), np.eye(2))
    narrow, wide = mixture.covariances
    np.testing.assert_allclose(narrow, 0.8 * np.eye(2))
    assert np.all(np.diagonal(wide) > 3.9)
    np.testing.assert_array_equal(mixture.means, np.zeros((2, 2)))


def bent(points):
    """Return a normalised log density whose second and third unknowns bend with the first."""
    x, y, z = points.T
    bend = stats.norm.logpdf(y, 0.8 * x**2, 0.1) + stats.norm.logpdf(z, -0.5 * x, 0.2)
    return stats.norm.logpdf(x) + bend


def normal(points):
    covariance = np.array([[1.0, 0.6, 0.0], [0.6, 0.5, 0.02], [0.0, 0.02, 0.01]])
    return stats.multivariate_normal([0.5, -1.0, 0.2], covariance).logpdf(points)


def two(points):
    return logsumexp(
        [np.log(0.75) + bent(points), np.log(0.25) + bent(points - [0.0, -6.0, 4.0])], axis=0
    )


def effective_fraction(density, mixture):
    """Return the effective fraction of draws, after a check of their mean weight, which is 1."""
    points = mixture.draw(4000, np.random.default_rng(7))
    log_weights = density(points) - mixture.log_density(points)
    fraction = effective_sample_size(log_weights) / 4000
    mean = logsumexp(log_weights) - np.log(4000)
    assert fraction < 0.2 or abs(mean) < 4 * np.sqrt((1 / fraction - 1) / 4000) + 1e-3
    return fraction


class KnownDensity(Target):
    """A density whose curvature is unknown, under a prior that is part of it."""

    has_gradients = False

    def __init__(self, density, dimension):
        self._density, self.dimension = density, dimension

    def evaluate(self, points):
        return evaluation(self._density(points), np.zeros(len(points)))


@pytest.mark.parametrize(
    ("density", "smallest_fraction"), [(normal, 0.97), (bent, 0.4), (two, 0.3)]
)
def test_laplace_approximations_about_draws_follow_a_bent_ridge(density, smallest_fraction):
    """Curvatures are second differences; the draws follow the density itself."""
    rng = np.random.default_rng(SEED)
    x = rng.standard_normal((4000, 3))
    draws = np.stack([x[:, 0], 0.8 * x[:, 0] ** 2 + 0.1 * x[:, 1], -0.5 * x[:, 0] + 0.2 * x[:, 2]])
    draws = draws.T + np.array([0.0, -6.0, 4.0]) * (rng.random((4000, 1)) < 0.25) * (density is two)
    if density is normal:
        covariance = np.array([[1.0, 0.6, 0.0], [0.6, 0.5, 0.02], [0.0, 0.02, 0.01]])
        draws = rng.multivariate_normal([0.5, -1.0, 0.2], covariance, 4000)
    target, unweighted = KnownDensity(density, 3), np.zeros(4000)
    start = GaussianMixture.fit(draws, 1, rng)
    mixture = laplace_mixture(target, draws, unweighted, rng, start)
    assert density is normal or effective_fraction(density, start) < 0.2
    assert effective_fraction(density, mixture) > smallest_fraction
