"""Gaussian and Student-t mixtures: density, gradient, draws and fit."""

import numpy as np
import pytest
from agreement import ROUNDING, assert_gradients
from scipy import stats
from scipy.special import logsumexp

from pymc_hyperelastic.evidence.mixture import GaussianMixture, components_for, log_sum_exp

SEED = 20250
# Significance level of a test of draws; the seed is fixed.
SIGNIFICANCE = 0.001


def mixture(dimension: int) -> GaussianMixture:
    """Three components of unequal weight, with correlated coordinates."""
    rng = np.random.default_rng(SEED)
    factors = np.tril(rng.normal(size=(3, dimension, dimension)))
    factors[:, range(dimension), range(dimension)] = rng.uniform(0.5, 2, (3, dimension))
    return GaussianMixture(np.log([0.2, 0.5, 0.3]), rng.normal(0, 3, (3, dimension)), factors)


@pytest.mark.parametrize("dimension", [1, 5])
def test_mixture_density_equals_scipy(dimension):
    """The heavy-tailed version is ``1 + 0.6/d`` wider, with ``max(1, d/2)`` degrees of freedom."""
    normal = mixture(dimension)
    points = np.random.default_rng(1).normal(0, 10, (50, dimension))
    covariances = normal.factors @ normal.factors.mT
    weights = np.exp(normal.log_weights)

    def density(kind, *args, widening=1.0):
        return sum(
            w * kind(m, widening * c, *args).pdf(points)
            for w, m, c in zip(weights, normal.means, covariances, strict=True)
        )

    expected = density(stats.multivariate_normal)
    np.testing.assert_allclose(np.exp(normal.log_density(points)), expected, rtol=1e-10)
    terms = np.exp(normal.log_density_of_components(points))
    np.testing.assert_allclose(
        normal.responsibilities(points), terms / expected[:, None], atol=ROUNDING
    )
    freedom = max(1.0, dimension / 2)
    expected = density(stats.multivariate_t, freedom, widening=1 + 0.6 / dimension)
    heavy = normal.heavy_tailed()
    np.testing.assert_allclose(np.exp(heavy.log_density(points)), expected, rtol=1e-10)


@pytest.mark.parametrize("heavy", [False, True])
def test_gradient_equals_difference_quotients_of_the_density(heavy):
    of = mixture(5).heavy_tailed() if heavy else mixture(2)
    points = np.random.default_rng(SEED).normal(0, 2, (5, of.means.shape[1]))
    value, gradient = of.gradient(points)
    np.testing.assert_allclose(value, of.log_density(points))
    assert_gradients(gradient, of.log_density, points)


def test_draws_have_the_density_of_the_mixture():
    """Heavy-tailed draws in one dimension, by the Kolmogorov-Smirnov test."""
    heavy = mixture(1).heavy_tailed()
    draws = heavy.draw(5000, np.random.default_rng(SEED))[:, 0]
    components = [
        (w, stats.t(heavy.freedom, m[0], f[0, 0]))
        for w, m, f in zip(np.exp(heavy.log_weights), heavy.means, heavy.factors, strict=True)
    ]
    result = stats.kstest(draws, lambda x: sum(w * t.cdf(x) for w, t in components))
    assert result.pvalue > SIGNIFICANCE


def test_draws_of_a_component_have_its_covariance():
    one = mixture(2)
    steps = one.draw_steps(np.full(20_000, 1), np.random.default_rng(SEED))
    covariance = one.factors[1] @ one.factors[1].T
    # The relative standard error of a variance is sqrt(2/20000) = 1 %.
    np.testing.assert_allclose(np.cov(steps.T), covariance, atol=0.05 * covariance.max())
    standard = np.array([[0.3, -1.2]])
    back = one.steps(np.array([1]), standard, transposed=True)[0]
    np.testing.assert_allclose(back, one.factors[1].T @ standard[0], rtol=ROUNDING)


def test_joined_mixture_weights_both_densities_by_the_given_share():
    first, second = mixture(2), mixture(2).widened(4.0)
    points = np.random.default_rng(1).normal(0, 5, (20, 2))
    expected = np.logaddexp(
        np.log(0.7) + first.log_density(points), np.log(0.3) + second.log_density(points)
    )
    np.testing.assert_allclose(first.joined(second, 0.3).log_density(points), expected)


def test_number_of_components_grows_with_the_number_of_points():
    """Ten points for each of ``(d + 1)(d + 2)/2`` parameters; five if there are two components."""
    assert components_for(59, 2) == 1  # 6 parameters
    assert components_for(60, 2) == 2
    assert components_for(179, 2) == 2
    assert components_for(359, 2) == 5
    assert components_for(1e9, 2) == 6
    assert components_for(5, 20) == 1


def test_log_sum_exp_equals_scipy():
    terms = np.random.default_rng(SEED).normal(0, 50, (4, 3, 5)) + np.array([-1e4, 0, 1e4])[:, None]
    np.testing.assert_allclose(log_sum_exp(terms), logsumexp(terms, axis=-1), rtol=ROUNDING)


def test_fit_finds_the_weights_means_and_covariances_of_clusters():
    rng = np.random.default_rng(SEED)
    covariance = np.array([[1.0, 0.6], [0.6, 0.5]])
    centres, sizes = np.array([[-8.0, 0.0], [8.0, 3.0]]), [1500, 500]
    points = [
        rng.multivariate_normal(*of) for of in zip(centres, [covariance] * 2, sizes, strict=True)
    ]
    fitted = GaussianMixture.fit(np.concatenate(points), 2, rng)
    order = np.argsort(fitted.means[:, 0])
    np.testing.assert_allclose(np.exp(fitted.log_weights[order]), [0.75, 0.25], rtol=1e-6)
    for found, cluster in zip(order, points, strict=True):
        np.testing.assert_allclose(fitted.means[found], cluster.mean(axis=0), rtol=1e-6)
        expected = np.cov(cluster.T, ddof=0)
        np.testing.assert_allclose(fitted.covariances[found], expected, rtol=1e-6)
