"""Importance sampling: adapted mixtures, Laplace approximations and mixtures along ridges."""

import numpy as np
import pytest
from agreement import ROUNDING, Regression, assert_agrees
from arviz_stats.base import array_stats
from scipy import stats
from scipy.special import logsumexp
from tiers import deep

from pymc_hyperelastic.evidence import importance, integral
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.importance import Drawn, Integral, by_importance, mean_weight
from pymc_hyperelastic.evidence.integral import integrate
from pymc_hyperelastic.evidence.laplace import laplace_about
from pymc_hyperelastic.evidence.mixture import GaussianMixture
from pymc_hyperelastic.evidence.modes import modes_from
from pymc_hyperelastic.evidence.reference import Reference
from pymc_hyperelastic.evidence.ridges import along_ridges
from pymc_hyperelastic.evidence.target import Rise, Target, by_differences, differences
from pymc_hyperelastic.evidence.weights import effective_sample_size

SEED = 911


def draw_prior(count, rng):
    return rng.standard_normal((count, 2))


def test_mean_weight_and_its_error():
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


def test_no_mixture_of_more_than_24_unknowns_is_adapted():
    like = GaussianMixture(np.zeros(1), np.zeros((1, 25)), np.eye(25)[None])
    found = by_importance(None, like, 10, np.random.default_rng(SEED))
    assert found.log_value == (-np.inf, np.inf) and not found.known


def test_errors_and_values_are_known_up_to_a_pareto_shape():
    """The limits 0.5 for the error and 0.7 for the value are those of Vehtari et al. (2024)."""
    shapes = [0.49, 0.51, 0.69, 0.71, np.nan]
    found = [Integral(Estimate(0.0, 0.1), shape, "", np.empty((0, 1))) for shape in shapes]
    assert [one.trusted for one in found] == [True, False, False, False, True]
    assert [one.known for one in found] == [True, True, True, False, False]


def test_all_draws_are_weighted_as_if_from_the_mixture_of_their_proposals():
    def score(points):
        return stats.norm.logpdf(points).sum(axis=1), -np.abs(points).sum(axis=1)

    rng = np.random.default_rng(SEED)
    drawn, components = Drawn(score, draw_prior), []
    for centre, share, count in ((0.0, 0.2, 50), (1.0, 0.0, 30), (-2.0, 0.5, 20)):
        mixture = GaussianMixture(np.zeros(1), np.full((1, 2), centre), np.eye(2)[None])
        drawn.add([(Reference(mixture, share), count)], rng)
        components.append((centre, share, count))
    points, log_weights = drawn.weighted()
    prior = stats.norm.pdf(points).prod(axis=1)
    density = sum(
        n / 100 * (share * prior + (1 - share) * stats.norm.pdf(points, c).prod(axis=1))
        for c, share, n in components
    )
    np.testing.assert_allclose(np.exp(log_weights), np.exp(sum(score(points))) / density)


@pytest.mark.parametrize("first_draws", [4000, 100_000])
def test_integral_of_a_normal_prior_and_likelihood(first_draws):
    spread, place = 0.1, np.array([1.0, -0.5])
    exact = stats.norm(0, np.hypot(1, spread)).logpdf(place).sum()

    def score(points):
        likelihood = stats.norm.logpdf(points, place, spread).sum(axis=1)
        return stats.norm.logpdf(points).sum(axis=1), likelihood

    rng = np.random.default_rng(SEED)
    like = GaussianMixture.fit(draw_prior(2000, rng), 1, rng)
    found = by_importance(score, like, 500, rng, draw_prior, first_draws)
    assert_agrees(found.log_value, exact, 0.025)
    assert found.trusted and found.known
    mean, sd = place / (1 + spread**2), spread / np.hypot(1, spread)
    assert np.all(np.abs(found.particles.mean(axis=0) - mean) < 4 * sd / np.sqrt(500))
    np.testing.assert_allclose(found.particles.std(axis=0), sd, rtol=4 / np.sqrt(1000))


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


class OfErrors(Target):
    """Standard normal priors, a likelihood of squared errors, and Gauss-Newton curvatures."""

    knows_curvature, has_slopes, at_once = True, False, 1000

    def __init__(self, errors, dimension, axes=None):
        self._errors, self.dimension = errors, dimension
        self._axes = np.eye(dimension) if axes is None else axes
        self.effort, self.most_effort = 0.0, np.inf

    def draw_prior(self, count, rng):
        return rng.standard_normal((count, self.dimension))

    def score(self, points):
        prior = stats.norm.logpdf(points).sum(axis=1)
        return prior, -np.square(self._errors(points @ self._axes)).sum(axis=1) / 2

    def ascent(self, width):
        def slope(points):
            around, change = differences(points, width)
            flat = around.reshape(-1, self.dimension)
            heights = np.add(*self.score(flat)).reshape(len(points), -1)
            errors = change(self._errors(flat @ self._axes).reshape(*around.shape[:2], -1))
            return Rise(heights[:, 0], change(heights), errors @ errors.mT + np.eye(self.dimension))

        return slope


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
    assert all(f.method == "importance" and f.known for f in found)
    assert errors.max() < 0.06
    assert np.sqrt(np.mean(((values - exact) / errors) ** 2)) < 1.8


@pytest.mark.parametrize(
    "errors", [linear, sharing(2.0, 0.02), *deep([sharing(0.3, 0.02), sharing(8.0, 0.5)])]
)
def test_integral_of_a_normal_or_bent_posterior_of_two_unknowns(errors):
    assert_integral(OfErrors(errors, 2), integral_over_two(errors))


@pytest.mark.deep
def test_integral_over_bent_arms_in_all_directions():
    """Four pairs of unknowns on rotated axes; arms that are too thin have an infinite error."""
    axes = np.linalg.qr(np.random.default_rng(3).standard_normal((8, 8)))[0]
    wide, thin = sharing(0.5, 0.05), sharing(3.0, 0.05)
    assert_integral(OfErrors(wide, 8, axes), 4 * integral_over_two(wide))
    found = integrate(OfErrors(thin, 8, axes), 1000, np.random.default_rng(0))
    assert found.log_value.standard_error == np.inf


def test_laplace_approximations_about_normal_draws_are_the_normal_density():
    rng = np.random.default_rng(1)
    place, root = np.array([1.0, -2.0, 0.5]), np.array([[1, 0, 0], [0.9, 0.1, 0], [0.3, -0.2, 2]])
    covariance = root @ root.T
    draws = rng.standard_normal((50, 3))
    draws -= draws.mean(axis=0)
    standard = np.linalg.solve(np.linalg.cholesky(np.cov(draws.T, ddof=0)), draws.T)
    points = place + (root @ standard).T
    curvature = np.repeat(np.linalg.inv(covariance)[None], 50, axis=0)
    rise = Rise(np.zeros(50), -np.linalg.solve(covariance, (points - place).T).T, curvature)
    widths = []
    mixture = laplace_about(lambda x: widths.append(x) or (lambda _: rise), points, covariance)
    # Differences are taken on the scale of each variable.
    np.testing.assert_allclose(widths[0] / widths[0][0], np.sqrt(np.diagonal(covariance)))
    spread = np.cov(mixture.means.T, ddof=0) + mixture.covariances.mean(axis=0)
    np.testing.assert_allclose(mixture.means.mean(axis=0), place, atol=1e-12)
    np.testing.assert_allclose(spread, covariance, rtol=1e-9)
    # The covariances are 1/(1 + 1/4) of those of the draws: they reach two sds.
    np.testing.assert_allclose(mixture.covariances[0], 0.8 * covariance, rtol=1e-9)


def test_infinite_curvature_gives_a_component_as_wide_as_all_draws():
    curvature = np.array([np.eye(2), np.full((2, 2), np.inf)])
    rise = Rise(np.zeros(2), np.array([[0.0, 0.0], [np.inf, 0.0]]), curvature)
    mixture = laplace_about(lambda width: lambda points: rise, np.zeros((2, 2)), np.eye(2))
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


@pytest.mark.parametrize(
    ("density", "least", "most_of_modes"),
    [(normal, 0.999, 1.0), (two, 0.4, 0.2)],
)
def test_mixture_along_a_ridge_resembles_the_density(density, least, most_of_modes):
    """The Laplace approximation at the mode resembles only the normal density."""
    width = np.array([2.0, 5.0, 2.0])

    def ascent(width):
        return by_differences(lambda points: (density(points), np.zeros(len(points))), width)

    starts = np.array([[0.1, 0.0, 0.0], [0.1, -6.0, 4.0]][: 1 + (density is two)])
    modes = modes_from(ascent, [starts], width)
    assert len(modes.log_masses) == len(starts)
    rows = along_ridges(ascent, modes, width)
    assert effective_fraction(density, modes.mixture) <= most_of_modes
    assert effective_fraction(density, rows) > least
    if density is two:
        beside = rows.means[:, 2] > 2
        np.testing.assert_allclose(np.exp(rows.log_weights[beside]).sum(), 0.25, atol=0.02)
