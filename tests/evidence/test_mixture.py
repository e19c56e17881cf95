"""The mixture that moves are drawn from: its density, its draws, and how large it is."""

import numpy as np
import pytest
from scipy import stats
from scipy.special import logsumexp

from pymc_hyperelastic.evidence.mixture import GaussianMixture, components_for, log_sum_exp

SEED = 20250
# A test of honesty fails for this fraction of honest mixtures.
SIGNIFICANCE = 0.001
# Sums and logarithms of a few numbers of order one.
ROUNDING = 1e-12


def mixture(dimension: int) -> GaussianMixture:
    """Three components of unlike weights, with correlated coordinates."""
    rng = np.random.default_rng(SEED)
    factors = np.tril(rng.normal(size=(3, dimension, dimension)))
    factors[:, range(dimension), range(dimension)] = rng.uniform(0.5, 2, (3, dimension))
    return GaussianMixture(np.log([0.2, 0.5, 0.3]), rng.normal(0, 3, (3, dimension)), factors)


@pytest.mark.parametrize("dimension", [1, 2, 5])
def test_density_of_the_mixture_is_that_of_scipy(dimension):
    """Normal components, and the same with the heavy tails of proposals.

    These are wider by ``1 + 0.6/d`` and of Student's t with ``max(1, d/2)`` degrees of freedom.
    """
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
    freedom = max(1.0, dimension / 2)
    expected = density(stats.multivariate_t, freedom, widening=1 + 0.6 / dimension)
    heavy = normal.heavy_tailed()
    np.testing.assert_allclose(np.exp(heavy.log_density(points)), expected, rtol=1e-10)


def test_draws_of_the_mixture_have_its_density():
    """Heavy-tailed draws in one dimension against the distribution function of Student's t."""
    heavy = mixture(1).heavy_tailed()
    draws = heavy.draw(5000, np.random.default_rng(SEED))[:, 0]
    components = [
        (w, stats.t(heavy.freedom, m[0], f[0, 0]))
        for w, m, f in zip(np.exp(heavy.log_weights), heavy.means, heavy.factors, strict=True)
    ]
    result = stats.kstest(draws, lambda x: sum(w * t.cdf(x) for w, t in components))
    assert result.pvalue > SIGNIFICANCE


def test_components_are_as_many_as_the_points_can_tell():
    """Ten points for each of ``(d + 1)(d + 2)/2`` parameters, five if there are but two."""
    assert components_for(59, 2) == 1  # 6 parameters
    assert components_for(60, 2) == 2
    assert components_for(179, 2) == 2
    assert components_for(359, 2) == 5
    assert components_for(1e9, 2) == 6
    assert components_for(5, 20) == 1


def test_log_sum_exp_is_that_of_scipy():
    """Of terms far below and above where their exponentials would be lost."""
    terms = np.random.default_rng(SEED).normal(0, 50, (4, 3, 5)) + np.array([-1e4, 0, 1e4])[:, None]
    np.testing.assert_allclose(log_sum_exp(terms), logsumexp(terms, axis=-1), rtol=ROUNDING)


def test_few_points_leave_a_component_what_is_known_of_it():
    """A component of hardly more points than unknowns keeps its width; one of many learns it."""
    rng = np.random.default_rng(SEED)
    means, factors = np.array([[0.0] * 4, [50.0] * 4]), 3 * np.array([np.eye(4)] * 2)
    known = GaussianMixture(np.log([0.5, 0.5]), means, factors)
    few, many = 0.1 * rng.normal(size=(8, 4)), 50 + 0.1 * rng.normal(size=(4000, 4))
    points = np.concatenate([few, many])
    fitted = GaussianMixture.fit(points, 2, rng, start=known, worth=1.0)
    widths = np.sqrt(np.diagonal(fitted.covariances, axis1=1, axis2=2)).mean(axis=1)
    alone = GaussianMixture.fit(points, 2, rng, start=known)
    assert widths[0] == pytest.approx(3 * np.sqrt(10 / 18), rel=0.01)
    assert widths[1] == pytest.approx(0.18, rel=0.05)
    assert np.sqrt(np.linalg.eigvalsh(alone.covariances[0])).max() < 0.3
