"""Weights of particles: how many they are worth, how far a step may go, and how they resample."""

import numpy as np
import pytest

from pymc_hyperelastic.evidence.weights import (
    effective_sample_size,
    largest_step,
    pareto_shape,
    systematic,
)

SEED = 20250
# Sums and logarithms of a few numbers of order one.
ROUNDING = 1e-12


def test_effective_sample_size_counts_equal_weights():
    """As many as have equal weights, whatever their size; none where nothing is possible."""
    assert effective_sample_size(np.full(7, -1e5)) == pytest.approx(7, rel=ROUNDING)
    assert effective_sample_size(np.array([2.0, -np.inf, 2.0])) == pytest.approx(2, rel=ROUNDING)
    # (1 + 3)^2/(1 + 9)
    assert effective_sample_size(np.log([1.0, 3.0])) == pytest.approx(1.6, rel=ROUNDING)
    assert effective_sample_size(np.full(4, -np.inf)) == 0


def test_pareto_shape_of_weights():
    """That of Pareto variables is known; equal weights have no tail, and no weights any."""
    rng = np.random.default_rng(SEED)
    for shape in (0.3, 0.6):
        # The logarithm of a Pareto variable is exponential. From so many the shape has an sd of
        # 0.06, over twenty seeds.
        assert pareto_shape(shape * rng.exponential(size=20_000)) == pytest.approx(shape, abs=0.2)
    bounded = 2.0 * rng.exponential(size=2000)
    bounded = np.minimum(bounded, 3.0 + 1e-3 * rng.random(2000))
    assert pareto_shape(bounded) < 0.3
    assert pareto_shape(np.minimum(bounded, 3.0)) < 0.3
    assert pareto_shape(np.array([-3.0, -np.inf, -3.0])) == -np.inf
    assert pareto_shape(np.full(4, -np.inf)) == np.inf
    assert pareto_shape(np.array([])) == np.inf


def test_largest_step_keeps_the_fraction_effective():
    """Normal scores of any width, some of them impossible: the fraction is of the possible ones.

    The step is found to a thousandth of itself. The logarithm of the effective size falls as the
    square of the step, ``-(step sd)^2`` for many normal scores, and thus by two thousandths of
    what it fell in all.
    """
    rng = np.random.default_rng(SEED)
    for width in (1e-3, 1.0, 1e13):
        logp = width * rng.standard_normal(1000)
        logp[:100] = -np.inf
        for fraction in (0.1, 0.5, 0.9):
            step = largest_step(logp, fraction, 1e9)
            effective = effective_sample_size(step * logp)
            assert np.log(effective / 900) == pytest.approx(np.log(fraction), rel=4e-3)


def test_largest_step_is_all_that_remains_where_that_is_good_enough():
    """Exactly, so that the last stage ends at a temperature of one."""
    logp = np.array([0.0, 0.1, -0.1, 0.05])
    assert largest_step(logp, 0.5, 0.37) == 0.37
    assert largest_step(np.full(5, -3.0), 0.99, 1.0) == 1.0


def test_largest_step_is_nothing_where_weights_are_too_bad_already():
    """Weights from before count, and no step makes up for them that only spreads them further."""
    logp = np.linspace(-1, 1, 10)
    before = np.where(np.arange(10) == 9, 0.0, -20.0)
    assert largest_step(logp, 0.5, 1.0, before) == 0.0
    mild = np.linspace(0.0, -0.5, 10)
    step = largest_step(20 * logp, 0.5, 1.0, mild)
    assert effective_sample_size(mild + step * 20 * logp) == pytest.approx(5, rel=4e-3)


def test_systematic_resampling_is_even():
    """Each is chosen as often as it weighs, rounded up or down, and on average exactly so."""
    weights = np.array([0.0, 0.5, 1.7, 0.0, 3.1, 0.7, 0.0])
    rng = np.random.default_rng(SEED)
    expected = 11 * weights / weights.sum()
    runs = 4000
    counts = np.array([np.bincount(systematic(weights, 11, rng), minlength=7) for _ in range(runs)])
    assert np.all((counts == np.floor(expected)) | (counts == np.ceil(expected)))
    # A count that is rounded up with probability p has the variance p (1 - p), 1/4 at most.
    assert np.all(np.abs(counts.mean(axis=0) - expected) < 4 * 0.5 / np.sqrt(runs))
