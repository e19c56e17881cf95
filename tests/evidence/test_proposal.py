"""Proposals that are fitted to draws of a posterior."""

import numpy as np

from pymc_hyperelastic.evidence.proposal import fitted_proposal

SEED = 20250
# Rounding of variances of some hundred numbers.
ROUNDING = 1e-9


def test_normal_proposal_keeps_only_significant_correlations():
    """Forty independent unknowns have no correlation, unknowns with a common factor keep theirs."""
    rng = np.random.default_rng(SEED)
    independent = rng.normal(size=(2, 100, 40))
    common = 0.1 * independent + rng.normal(size=(2, 100, 1))
    for draws, least, most in ((independent, -0.01, 0.01), (common, 0.97, 1.0)):
        factor = fitted_proposal(draws, 200.0, False, rng).factors[0]
        covariance = factor @ factor.T
        correlation = covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1])
        assert least < correlation < most
        variances = draws.reshape(-1, 40).var(axis=0)
        np.testing.assert_allclose(np.diagonal(covariance), variances, rtol=ROUNDING)


def test_fitted_proposal_is_the_one_that_predicts_held_out_draws_best():
    """The cases need one normal density, one Student density, and a mixture."""
    rng = np.random.default_rng(SEED)
    normal = rng.normal(size=(4, 500, 3))
    student = rng.standard_normal((4, 500, 8)) / rng.gamma(2, 0.5, (4, 500, 1))
    two_modes = rng.normal(size=(4, 500, 2)) + rng.choice([-9, 9], (4, 500, 1))
    found = [fitted_proposal(draws, 2000.0, True, rng) for draws in (normal, student, two_modes)]
    assert len(found[0].means) == 1 < len(found[2].means)
    assert [np.isfinite(mixture.freedom) for mixture in found] == [False, True, False]
