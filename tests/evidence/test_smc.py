"""Runs of several chains: seeds, trees, files and interrupts, and the evidence that they give."""

import numpy as np
import pymc as pm
import pytest
import xarray as xr

import pymc_hyperelastic as ph
from pymc_hyperelastic.evidence.estimate import combine_chains

SEED = 20250
# Sums and logarithms of a few numbers of order one.
ROUNDING = 1e-12


# --- what a run returns --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def model():
    """A line through a few points: a scalar and a vector."""
    design = np.array([[0.1, 2.0], [0.9, 1.4], [1.6, 0.3], [2.2, 2.5], [3.1, 1.1]])
    with pm.Model() as model:
        intercept = pm.Normal("intercept", 0, 10)
        slope = pm.Normal("slope", 0, 2, shape=2)
        line = intercept + (design * slope).sum(axis=-1)
        pm.Normal("y", line, 0.5, observed=[0.4, 1.2, 2.9, 1.0, 3.8])
    return model


@pytest.fixture(scope="module")
def tree(model):
    return ph.sample_smc(model, 300, 3, random_seed=SEED, progressbar=False)


def test_one_seed_gives_one_result(model, tree):
    """The same seed gives the same particles, another seed others, no seed a seed to write down."""
    again = ph.sample_smc(model, 300, 3, random_seed=SEED, progressbar=False)
    xr.testing.assert_equal(again["posterior"].to_dataset(), tree["posterior"].to_dataset())
    assert ph.log_evidence(again) == ph.log_evidence(tree)
    other = ph.sample_smc(model, 300, 3, random_seed=SEED + 1, progressbar=False)
    assert ph.log_evidence(other) != ph.log_evidence(tree)
    unseeded = ph.sample_smc(model, 100, 1, progressbar=False)
    seed = int(unseeded.attrs["random_seed"])
    repeated = ph.sample_smc(model, 100, 1, random_seed=seed, progressbar=False)
    assert ph.log_evidence(repeated) == ph.log_evidence(unseeded)


def test_chains_are_independent(tree):
    """No two chains share particles, whatever the single seed."""
    slope = tree["posterior"]["slope"].values
    for i in range(3):
        for j in range(i):
            assert not np.any(np.isin(slope[i], slope[j]))


def test_stages_are_rectangular_and_padded_with_nan(tree):
    """Every statistic is (chain, stage); temperatures of a chain rise to 1, then NaN follows."""
    stats_ = tree["sample_stats"].to_dataset()
    assert {v.dims for v in stats_.data_vars.values()} == {("chain", "stage")}
    for beta in stats_["beta"].values:
        known = beta[np.isfinite(beta)]
        assert known[-1] == 1 and np.all(np.diff(known) > 0) and known[0] > 0
        assert np.isfinite(beta[: len(known)]).all()
    final = [row[np.isfinite(row)][-1] for row in stats_["log_marginal_likelihood"].values]
    np.testing.assert_array_equal(tree["evidence"]["log_evidence"].values, final)


def test_unconstrained_particles_are_stored_beside_the_posterior():
    """Positive variables are stored twice: as they are, and as the logarithms that were moved."""
    with pm.Model() as model:
        x = pm.Gamma("x", 2, 0.5, shape=(2, 3))
        pm.Poisson("counted", x, observed=[[3, 0, 12], [7, 1, 2]])
    tree = ph.sample_smc(model, 100, 2, random_seed=SEED, progressbar=False)
    np.testing.assert_allclose(
        np.log(tree["posterior"]["x"].values), tree["unconstrained_posterior"]["x_log__"].values
    )


def test_netcdf_round_trip(tree, tmp_path):
    """A result is saved and read without loss, padded stages included."""
    tree.to_netcdf(tmp_path / "run.nc", engine="h5netcdf")
    loaded = xr.load_datatree(tmp_path / "run.nc", engine="h5netcdf")
    for group in tree.children:
        xr.testing.assert_equal(loaded[group].to_dataset(), tree[group].to_dataset())
    assert ph.log_evidence(loaded) == ph.log_evidence(tree)
    assert loaded.attrs == tree.attrs


def test_only_wanted_variables_are_kept(model):
    """`var_names` chooses the posterior's variables, and unknown ones are named."""
    tree = ph.sample_smc(model, 50, 1, random_seed=SEED, progressbar=False, var_names=["intercept"])
    assert list(tree["posterior"].data_vars) == ["intercept"]
    with pytest.raises(ValueError, match="no variables \\['curvature'\\]"):
        ph.sample_smc(model, 50, 1, random_seed=SEED, progressbar=False, var_names=["curvature"])


def interrupt_at(monkeypatch, call):
    """Make the kernel's n-th stage of moves meet Ctrl-C."""
    mutate, calls = ph.BatchedSMC.mutate, []

    def interrupted(self):
        calls.append(1)
        if len(calls) == call:
            raise KeyboardInterrupt
        mutate(self)

    monkeypatch.setattr(ph.BatchedSMC, "mutate", interrupted)


def test_interrupt_keeps_complete_chains(model, tree, monkeypatch):
    """Ctrl-C in the second chain leaves the first one as it would have been."""
    stages = int(np.isfinite(tree["sample_stats"]["beta"].values[0]).sum())
    interrupt_at(monkeypatch, stages + 1)
    with pytest.warns(UserWarning, match="1 of 3 chains are complete") as caught:
        kept = ph.sample_smc(model, 300, 3, random_seed=SEED, progressbar=False)
    np.testing.assert_array_equal(kept["posterior"]["slope"], tree["posterior"]["slope"][:1])
    assert kept["evidence"].sizes["chain"] == 1
    assert caught[0].filename == __file__
    assert np.isfinite(ph.log_evidence(kept)).all()


def test_interrupt_before_any_chain_is_complete_is_an_interrupt(model, monkeypatch):
    """There is nothing to return yet."""
    interrupt_at(monkeypatch, 1)
    with pytest.raises(KeyboardInterrupt):
        ph.sample_smc(model, 300, 3, random_seed=SEED, progressbar=False)


# --- evidence of several chains ------------------------------------------------------------------


def test_log_evidence_needs_a_result_with_one(tree):
    """Any other tree is refused, with the names of the groups that it does have."""
    with pytest.raises(ValueError, match=r"no evidence; its groups are \['posterior'\]"):
        ph.log_evidence(xr.DataTree.from_dict({"posterior": tree["posterior"].to_dataset()}))


def test_chains_are_averaged_as_evidences():
    """The mean is of evidences, not of their logarithms."""
    value, _ = combine_chains(np.log([1.0, 3.0]), np.array([0.01, 0.01]))
    assert value == pytest.approx(np.log(2.0), rel=ROUNDING)
    assert combine_chains(np.array([-7.0]), np.array([0.3])) == pytest.approx((-7.0, 0.3))


def test_error_is_that_within_chains_unless_chance_cannot_explain_the_spread():
    """The spread counts from where it is found by chance once in a hundred times.

    Over the variance within ``n`` chains that is ``chi2(0.99; n - 1)/(n - 1)``: 6.6349 for two
    chains, 11.3449/3 for four.

    Two chains with evidences 1 and 3 are 1/2 and 3/2 of their mean, a variance of 1/2; the turn is
    at a standard error of sqrt(0.5/6.6349) = 0.27452. Four with 0.8, 1.2, 0.8, 1.2 of their mean
    have the variance 0.16/3; the turn is at sqrt(0.16/11.3449) = 0.118757.
    """
    two, four = np.log([1.0, 3.0]), np.log([0.8, 1.2, 0.8, 1.2])
    for evidences, turn, spread in ((two, 0.27452, 1 / 2), (four, 0.118757, 0.16 / 3)):
        chains = len(evidences)
        for shift in (0.0, -500.0):
            _, error = combine_chains(evidences + shift, np.full(chains, 0.9999 * turn))
            assert error == pytest.approx(np.sqrt(spread / chains), rel=1e-9)
            _, error = combine_chains(evidences + shift, np.full(chains, 1.0001 * turn))
            assert error == pytest.approx(1.0001 * turn / np.sqrt(chains), rel=1e-9)


def test_errors_of_chains_are_averaged_as_variances():
    """Equal chains of the errors 0.3 and 0.4: half the mean square, 0.125/2, is 1/16."""
    assert combine_chains(np.zeros(2), np.array([0.3, 0.4])) == pytest.approx((0.0, 0.25))
