"""Evidence of several chains with its standard error, against formulas."""

import numpy as np
import pymc as pm
import pytest
import xarray as xr
from agreement import ROUNDING

import pymc_hyperelastic as ph
from pymc_hyperelastic.evidence.estimate import combine_chains


def test_evidences_and_not_their_logarithms_are_averaged():
    value, _ = combine_chains(np.log([1.0, 3.0]), np.array([0.01, 0.01]))
    assert value == pytest.approx(np.log(2.0), rel=ROUNDING)
    assert combine_chains(np.array([-7.0]), np.array([0.3])) == pytest.approx((-7.0, 0.3))


def test_variances_within_chains_are_averaged():
    """Equal chains with the errors 0.3 and 0.4: half of the mean square, 0.125/2, is 1/16."""
    assert combine_chains(np.zeros(2), np.array([0.3, 0.4])) == pytest.approx((0.0, 0.25))


def test_spread_of_chains_is_used_if_it_is_significant_at_one_per_cent():
    """The spread replaces the errors if chance explains it in less than one of a hundred cases.

    The critical ratio of variances of ``n`` chains is ``chi2(0.99; n - 1)/(n - 1)``: 6.6349 for two
    chains, 11.3449/3 for four. Two chains that are one nat apart have the variance 1/2: the
    critical standard error is sqrt(0.5/6.6349) = 0.27452. Four chains of which one has 1.6 times
    the evidence of the others are 1.6/1.15 and 1/1.15 of their mean, a variance of 0.09/1.3225,
    which is larger than that of the logarithms, 0.0552: it is sqrt(0.204159/11.3449) = 0.134148.
    """
    two, four = np.array([0.0, 1.0]), np.log([1.0, 1.0, 1.0, 1.6])
    for evidences, critical, spread in ((two, 0.27452, 1 / 2), (four, 0.134148, 0.09 / 1.3225)):
        chains = len(evidences)
        for shift in (0.0, -500.0):
            _, error = combine_chains(evidences + shift, np.full(chains, 0.9999 * critical))
            assert error == pytest.approx(np.sqrt(spread / chains), rel=1e-9)
            _, error = combine_chains(evidences + shift, np.full(chains, 1.0001 * critical))
            assert error == pytest.approx(1.0001 * critical / np.sqrt(chains), rel=1e-9)


def test_error_of_chains_that_are_far_apart_is_not_bounded():
    assert combine_chains(np.array([-100.0, -370, -370, -370]), np.full(4, 0.3))[1] > 50


def test_error_is_infinite_if_a_chain_failed():
    assert combine_chains(np.array([-100.0, -np.inf]), np.full(2, 0.3))[1] == np.inf
    assert combine_chains(np.array([-100.0, -100.0]), np.array([0.3, np.nan]))[1] == np.inf


def test_error_from_specimens_is_not_divided_by_the_number_of_chains():
    """It is added to the error of the mean over the chains."""
    evidence = {"log_evidence": ("chain", [-3.0, -3.0]), "log_evidence_se": ("chain", [0.3, 0.4])}
    tree = xr.DataTree.from_dict({"evidence": xr.Dataset(evidence).assign(specimens_se=0.6)})
    assert ph.log_evidence(tree) == pytest.approx((-3.0, 0.65))


def test_estimate_converts_to_float_and_text():
    estimate = ph.Estimate(-41.2704, 0.0312)
    assert (float(estimate), str(estimate)) == (-41.2704, "-41.270 ± 0.031")


def test_results_without_evidence_are_refused():
    """The error names the groups, or the type that was expected."""
    draws = xr.Dataset({"x": (("chain", "draw"), np.zeros((2, 3)))})
    with pytest.raises(ValueError, match=r"no evidence; its groups are \['posterior'\]"):
        ph.log_evidence(xr.DataTree.from_dict({"posterior": draws}))
    with pytest.raises(TypeError, match=r"ph\.sample_smc.* not Model"):
        ph.log_evidence(pm.Model())
