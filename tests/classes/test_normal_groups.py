"""Distributions of many groups of specimens that are known with normal errors."""

import numpy as np
import pymc as pm
import pytest
from scipy import stats

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.normal_groups import Found, draw_groups, partial_correlations
from pymc_hyperelastic.classes.variable import Variability
from pymc_hyperelastic.models.class_distribution import correlation_factor

SEED = 915
# Errors of means and standard deviations of eight chains of 1000 correlated draws, in posterior
# standard deviations: four standard errors with an effective sample of about 4500.
OF_CHAINS = 0.06


def kind_of(energy):
    return Variability.of_settings(energy, 1.0)


def sampled(scale, groups, draws=1000):
    """Draw from all groups, starting from the medians of the priors."""
    size, count = len(scale.names), len(groups)
    logs = np.tile(scale.spread_prior[0], (count, 1))
    start = logs, np.zeros((count, size * (size - 1) // 2))
    return draw_groups(scale, groups, start, draws, np.random.default_rng(SEED))


def test_partial_correlations_are_those_of_the_factor():
    """Three coordinates: the first with the others, and the others given the first."""
    a, b, c = 0.5, -0.3, 0.4
    root = np.array([[1, 0, 0], [a, np.sqrt(1 - a**2), 0], [b, c * np.sqrt(1 - b**2), 0]])
    root[2, 2] = np.sqrt(1 - root[2] @ root[2])
    spread = np.array([0.1, 3.0, 2.0])
    np.testing.assert_allclose(partial_correlations((spread[:, None] * root)[None]), [[a, b, c]])


def test_one_coordinate_equals_a_sum_over_spreads():
    """Given its spread, the location of a group is normal; errors are of two kinds."""
    scale = kind_of(ph.NeoHookean()).scale
    (mean,), (sd,) = scale.location_prior
    (logs,), sd_of_logs = scale.spread_prior
    rng, errors = np.random.default_rng(SEED), np.array([0.1, 0.6])
    groups = []
    for size in (2, 6, 30):
        kind = np.arange(size) % 2
        x = mean + 0.3 * rng.standard_normal(size) + errors[kind] * rng.standard_normal(size)
        groups.append(Found(x[:, None], kind, np.square(errors)[:, None, None]))
    found = sampled(scale, [group for group in groups for _ in range(8)])
    grid = logs + sd_of_logs * np.linspace(-6, 6, 2001)
    for i, (x, kind, _) in enumerate(groups):
        variance = np.exp(2 * grid)[:, None] + errors[kind] ** 2
        precision = sd**-2 + np.sum(1 / variance, axis=1)
        middle = (mean / sd**2 + np.sum(x.T / variance, axis=1)) / precision
        log_p = stats.norm.logpdf(grid, logs, sd_of_logs)
        log_p += stats.norm.logpdf(x.T, mean, np.sqrt(variance)).sum(axis=1)
        # The specimens share the location.
        log_p += (precision * (middle - mean) ** 2 - np.log(precision)) / 2
        weights = np.exp(log_p - log_p.max())
        weights /= weights.sum()
        location = weights @ middle
        sd_of_location = np.sqrt(weights @ (1 / precision + (middle - location) ** 2))
        sd_of_grid = np.sqrt(weights @ grid**2 - (weights @ grid) ** 2)
        chains = slice(8 * i, 8 * i + 8)
        for values, expected, width in (
            (found.location[chains, :, 0], location, sd_of_location),
            (np.log(found.root[chains, :, 0, 0]), weights @ grid, sd_of_grid),
        ):
            assert abs(values.mean() - expected) < OF_CHAINS * width
            assert values.std() == pytest.approx(width, rel=OF_CHAINS)


def test_without_data_the_draws_are_those_of_the_prior():
    """Two specimens with immense errors say nothing."""
    scale = kind_of(ph.Yeoh()).scale
    size = len(scale.names)
    blank = Found(np.zeros((2, size)), np.zeros(2, int), 1e12 * np.eye(size)[None])
    found = sampled(scale, [blank] * 100, 100)
    mean, sd = scale.location_prior
    location = found.location.reshape(-1, size)
    np.testing.assert_allclose(location.mean(axis=0), mean, atol=0.1 * sd.min())
    np.testing.assert_allclose(location.std(axis=0), sd, rtol=0.1)
    logs = np.log(np.linalg.norm(found.root, axis=-1)).reshape(-1, size)
    np.testing.assert_allclose(logs.mean(axis=0), scale.spread_prior[0], atol=0.1)
    np.testing.assert_allclose(logs.std(axis=0), scale.spread_prior[1], rtol=0.1)
    with pm.Model(coords={"coordinate": scale.names, "coordinate_2": scale.names}):
        factors = pm.draw(correlation_factor(size), 2000, random_seed=SEED)
    partial, expected = map(partial_correlations, (found.root.reshape(-1, size, size), factors))
    np.testing.assert_allclose(partial.std(axis=0), expected.std(axis=0), rtol=0.1)


def test_many_exactly_known_specimens_determine_spreads_and_correlation():
    scale = kind_of(ph.Ogden()).scale
    rng = np.random.default_rng(SEED)
    covariance = np.array([[0.09, 0.036], [0.036, 0.04]])  # a correlation of 0.6
    x = scale.location_prior[0] + rng.multivariate_normal([0, 0], covariance, 400)
    group = Found(x, np.zeros(400, int), 1e-8 * np.eye(2)[None])
    found = sampled(scale, [group] * 4, 200)
    draws = (found.root @ found.root.mT).reshape(-1, 2, 2)
    # The prior has the weight of a few specimens of 400.
    np.testing.assert_allclose(draws.mean(axis=0), np.cov(x.T), rtol=0.05)
    np.testing.assert_allclose(found.location.mean(axis=(0, 1)), x.mean(axis=0), atol=0.005)
