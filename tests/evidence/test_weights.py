"""Importance weights: effective sample size, tempering step, Pareto shape and resampling."""

import numpy as np
import pytest
from agreement import ROUNDING
from arviz_stats.base import array_stats

from pymc_hyperelastic.evidence.weights import (
    effective_sample_size,
    largest_step,
    pareto_shape,
    systematic,
)

SEED = 20250


def test_effective_sample_size_is_the_squared_sum_over_the_sum_of_squared_weights():
    assert effective_sample_size(np.full(7, -1e5)) == pytest.approx(7, rel=ROUNDING)
    assert effective_sample_size(np.array([2.0, -np.inf, 2.0])) == pytest.approx(2, rel=ROUNDING)
    # (1 + 3)^2/(1 + 9)
    assert effective_sample_size(np.log([1.0, 3.0])) == pytest.approx(1.6, rel=ROUNDING)
    assert effective_sample_size(np.full(4, -np.inf)) == 0


def test_pareto_shape_of_pareto_weights_equals_arviz():
    """The logarithm of a Pareto variable is exponential; ArviZ fits the same tail."""
    rng = np.random.default_rng(SEED)
    for shape in (0.3, 0.6):
        log_weights = shape * rng.exponential(size=20_000)
        found = pareto_shape(np.append(log_weights, -np.inf))
        assert found == pytest.approx(array_stats.psislw(-log_weights)[1], rel=ROUNDING)
        # The standard deviation of the estimate was 0.06 over twenty seeds.
        assert found == pytest.approx(shape, abs=0.2)


def test_bound_of_the_weights_limits_their_pareto_shape():
    """If the largest weight is below ten times the mean, its logarithm limits the shape."""
    draws = 2.0 * np.random.default_rng(SEED).exponential(size=2000)
    above_mean = {}
    for bound in (1.5, 3.0):
        bounded = np.minimum(draws, bound - 1e-3 * np.arange(2000) / 2000)
        above_mean[bound] = bounded.max() - np.log(np.mean(np.exp(bounded)))
        assert above_mean[bound] < np.log(10)
        fitted = array_stats.psislw(-bounded)[1]
        expected = min(fitted, above_mean[bound] / np.log(2000))
        assert pareto_shape(bounded) == pytest.approx(expected, rel=ROUNDING)
    # Two of a hundred weights are far above the others, and equal to 40 times the mean.
    heavy = np.append(np.linspace(-5, -4, 100), [0.0, 0.0])
    assert pareto_shape(heavy) == pytest.approx(array_stats.psislw(-heavy)[1], rel=ROUNDING)


def test_pareto_shape_of_equal_weights_is_minus_infinity_and_of_no_weights_infinity():
    assert pareto_shape(np.array([-3.0, -np.inf, -3.0])) == -np.inf
    assert pareto_shape(np.full(4, -np.inf)) == np.inf
    assert pareto_shape(np.array([])) == np.inf


def test_largest_step_keeps_the_requested_fraction_of_particles_effective():
    """The fraction refers to the particles of nonzero weight.

    The step is found to one per cent, and the logarithm of the effective size of normal log weights
    falls with the square of the step.
    """
    rng = np.random.default_rng(SEED)
    for width in (1e-3, 1.0, 1e13):
        logp = width * rng.standard_normal(1000)
        logp[:100] = -np.inf
        for fraction in (0.1, 0.5, 0.9):
            step = largest_step(logp, fraction, 1e9)
            effective = effective_sample_size(step * logp)
            assert np.log(effective / 900) == pytest.approx(np.log(fraction), rel=4e-3)


def test_largest_step_is_the_remaining_step_if_enough_particles_stay_effective():
    logp = np.array([0.0, 0.1, -0.1, 0.05])
    assert largest_step(logp, 0.5, 0.37) == 0.37
    assert largest_step(np.full(5, -3.0), 0.99, 1.0) == 1.0


def test_largest_step_includes_the_previous_weights():
    """If the previous weights are too uneven already, the step is 0."""
    logp = np.linspace(-1, 1, 10)
    before = np.where(np.arange(10) == 9, 0.0, -20.0)
    assert largest_step(logp, 0.5, 1.0, before) == 0.0
    mild = np.linspace(0.0, -0.5, 10)
    step = largest_step(20 * logp, 0.5, 1.0, mild)
    assert effective_sample_size(mild + step * 20 * logp) == pytest.approx(5, rel=4e-3)


def test_systematic_resampling_rounds_expected_counts_up_or_down():
    weights = np.array([0.0, 0.5, 1.7, 0.0, 3.1, 0.7, 0.0])
    rng = np.random.default_rng(SEED)
    expected = 11 * weights / weights.sum()
    runs = 4000
    counts = np.array([np.bincount(systematic(weights, 11, rng), minlength=7) for _ in range(runs)])
    assert np.all((counts == np.floor(expected)) | (counts == np.ceil(expected)))
    # A count rounded up with probability p has the variance p (1 - p), which is at most 1/4.
    assert np.all(np.abs(counts.mean(axis=0) - expected) < 4 * 0.5 / np.sqrt(runs))
