"""Evidences of specimens as means over draws, and their stated errors."""

from dataclasses import replace

import numpy as np
from scipy import stats
from scipy.special import logsumexp
from variable_classes import known_specimen

from pymc_hyperelastic.classes.specimen_evidence import (
    specimen_evidence,
    unit_of_specimen,
    variance_of_shares,
)
from pymc_hyperelastic.models.class_distribution import ClassDistribution
from pymc_hyperelastic.models.specimen_draws import log_densities

SEED = 911
# Repetitions: the standard deviation of 300 numbers is known to 4 %, and compared to 4 times that.
REPEATED, SPREAD_TOLERANCE = 300, 0.16
STANDARD_ERRORS = 4


def normal_classes(location, spread):
    """Distributions of one coordinate, along the first of two axes."""
    location, spread = np.broadcast_arrays(location, spread)
    return ClassDistribution(location[None, :, None], spread[None, :, None], np.eye(1))


def assert_spread(values, stated, truth):
    """Compare the spread of values with the stated errors, and their mean with the truth.

    A logarithm is biased by half of its variance.
    """
    np.testing.assert_allclose(
        np.sqrt(np.mean(np.square(stated))), np.std(values), rtol=SPREAD_TOLERANCE
    )
    error = np.std(values) / np.sqrt(len(values))
    assert abs(np.mean(values) - truth) < STANDARD_ERRORS * error + np.var(values) / 2


def test_stated_evidence_error_equals_the_spread_over_repetitions():
    """A specimen with 2000 draws, and a class with 60 normal distributions."""
    rng = np.random.default_rng(SEED)
    values, stated = [], []
    for _ in range(REPEATED):
        of_class = normal_classes(0.5 * rng.standard_normal(60), 0.2)
        found = specimen_evidence(known_specimen(rng, 0.3, 0.4), of_class)
        values.append(found.log_evidence.value)
        stated.append(found.own_error)
    truth = stats.norm(0.3, np.sqrt(0.4**2 + 0.5**2 + 0.2**2)).logpdf(0)
    assert_spread(values, stated, truth)


def test_error_of_a_precise_specimen_is_that_of_the_class():
    """Its 2000 draws have equal weights, under 1000 distributions."""
    rng = np.random.default_rng(SEED)
    location = rng.normal(0, 0.3, 1000)
    equal = np.full(2000, -np.log(2000))
    draws = replace(known_specimen(rng, 0.3, 0.05), log_weight=equal)
    found = specimen_evidence(draws, normal_classes(location, 0.4))
    by_class = stats.norm(location, np.hypot(0.4, 0.1)).pdf(0.3)
    of_class = by_class.std() / by_class.mean() / np.sqrt(1000)
    # Its draws add little: the density of each distribution is nearly equal at all of them.
    assert of_class < found.own_error < 1.1 * of_class
    error = STANDARD_ERRORS * found.own_error
    assert abs(found.log_evidence.value - np.log(by_class.mean())) < error


def test_evidence_states_its_method_and_the_larger_pareto_shape():
    draws = known_specimen(np.random.default_rng(SEED), 0.0, 1.0)
    of_class = normal_classes([0.0], 0.9)
    alone = specimen_evidence(draws, of_class)
    assert -3 < alone.pareto_k < 0.4
    for method, shape, expected in (
        ("importance", 0.4, "specimen draws"),
        ("tempering", np.nan, "specimen draws by tempering"),
    ):
        one = replace(draws, method=method, pareto_k=shape, standard_error=0.2)
        evidence = specimen_evidence(one, of_class)
        assert evidence.method == expected
        assert evidence.pareto_k == np.fmax(shape, alone.pareto_k)
        error = np.hypot(evidence.own_error, 0.2)
        np.testing.assert_allclose(evidence.log_evidence.standard_error, error)
    # Fewer than 400 effective draws cannot be trusted.
    assert specimen_evidence(draws, normal_classes([5.0], 0.1)).pareto_k == np.inf


def test_stated_variance_of_a_class_evidence_equals_the_spread_over_repetitions():
    """The evidence uses 128 draws of a specimen; all 2000 draws estimate its variance."""
    rng, values, stated = np.random.default_rng(SEED), [], []
    locations = np.linspace(-1, 1, 21)
    for _ in range(REPEATED):
        draws = known_specimen(rng, 0.5, 1.0)
        few = draws.first(128)
        terms = few.log_weight + log_densities(few, normal_classes(locations, 0.7))
        by_class = logsumexp(terms, axis=1)
        values.append(logsumexp(by_class) - np.log(len(locations)))
        weights = np.exp(by_class - logsumexp(by_class))
        posterior = normal_classes(rng.choice(locations, size=50, p=weights), 0.7)
        log_shares = unit_of_specimen(draws).log_terms([posterior])
        stated.append(float(np.sqrt(variance_of_shares(log_shares, 0.0, np.array(128)))))
    truth = np.log(np.mean(stats.norm(locations, np.hypot(0.7, 1.0)).pdf(0.5)))
    assert_spread(values, stated, truth)


def test_errors_of_weights_add_to_the_variance():
    """Half of the draws have a weight under the first distribution, and all under the second."""
    half = np.where(np.arange(100) < 50, 0.0, -np.inf)
    shares = np.where(np.arange(100) < 50, 0.015, 0.005)
    expected = 0.1**2 + (100 * np.sum(shares**2) - 1) * (1 / 20 + 0.1**2)
    found = variance_of_shares(np.array([half, np.full(100, 3.0)]), 0.1, np.array(20))
    np.testing.assert_allclose(found, expected)
    assert variance_of_shares(np.zeros((1, 100)), np.inf, np.array(20)) == np.inf
