"""Runs of sample_smc: seeds, stored groups, files, interrupts and settings."""

import json

import numpy as np
import pymc as pm
import pytest
import xarray as xr
from agreement import assert_agrees
from interrupts import interrupt
from scipy.stats import norm

import pymc_hyperelastic as ph

SEED = 20250
RUN = {"draws": 300, "chains": 3, "random_seed": SEED, "progressbar": False}
# One small chain; without a reference, the search for which takes most of the time.
FEW = RUN | {"draws": 50, "chains": 1, "from_modes": False}


@pytest.fixture(scope="module")
def model():
    """A regression with a vector, a positive variable and a deterministic."""
    design = np.array([[0.1, 2.0], [0.9, 1.4], [1.6, 0.3], [2.2, 2.5], [3.1, 1.1]])
    with pm.Model() as model:
        scale = pm.Gamma("scale", 2, 2)
        slope = pm.Normal("slope", 0, 2, shape=2)
        pm.Deterministic("steepness", (slope**2).sum())
        pm.Normal("y", scale + (design * slope).sum(axis=-1), 0.5, observed=[0.4, 1.2, 2.9, 1, 3.8])
    return model


@pytest.fixture(scope="module")
def tree(model):
    return ph.sample_smc(model, **RUN)


def test_recorded_seed_repeats_the_result(model):
    """Without a seed one is chosen; a generator gives another seed for each call."""
    rng = np.random.default_rng(SEED)
    runs = [ph.sample_smc(model, **FEW | {"random_seed": seed}) for seed in (None, rng, rng)]
    for run in runs[:2]:
        seed = json.loads(run.attrs["random_seed"])
        again = ph.sample_smc(model, **FEW | {"random_seed": seed})
        xr.testing.assert_equal(again["posterior"].to_dataset(), run["posterior"].to_dataset())
        assert ph.log_evidence(again) == ph.log_evidence(run)
    assert len({run.attrs["random_seed"] for run in runs}) == 3
    assert len({ph.log_evidence(run) for run in runs}) == 3


def test_chains_share_no_particles(tree):
    slope = tree["posterior"]["slope"].values
    assert not any(np.isin(slope[i], slope[j]).any() for i in range(3) for j in range(i))


def test_stages_are_padded_with_nan_and_end_at_the_posterior(tree):
    stages = tree["sample_stats"].to_dataset()
    assert {v.dims for v in stages.data_vars.values()} == {("chain", "stage")}
    for beta in stages["beta"].values:
        known = beta[np.isfinite(beta)]
        assert known[-1] == 1 and np.all(np.diff(known) > 0) and known[0] > 0
        assert np.isfinite(beta[: len(known)]).all()


def test_evidence_group_summarises_the_stages(tree):
    stages, evidence = tree["sample_stats"], tree["evidence"]

    def last(name):
        return [row[np.isfinite(row)][-1] for row in stages[name].values]

    np.testing.assert_array_equal(evidence["log_evidence"], last("log_marginal_likelihood"))
    np.testing.assert_allclose(evidence["log_evidence_se"], np.sqrt(last("log_evidence_variance")))
    np.testing.assert_allclose(evidence["ancestor_fraction"], np.array(last("ancestors")) / 300)
    np.testing.assert_array_equal(evidence["pareto_k"], last("pareto_k"))
    capped = [row[np.isfinite(row)].mean() for row in stages["capped"].values]
    np.testing.assert_array_equal(evidence["stages_capped"], capped)
    assert tree["diagnosis"].attrs["verdict"] == "good"
    checks = {"chains", "R-hat", "moves", "ancestors", "weights"}
    assert checks <= set(tree["diagnosis"]["check"].values)


def test_variables_are_stored_constrained_and_unconstrained(tree):
    posterior, unconstrained = tree["posterior"], tree["unconstrained_posterior"]
    np.testing.assert_allclose(np.log(posterior["scale"]), unconstrained["scale_log__"])
    np.testing.assert_array_equal(posterior["slope"].values, unconstrained["slope"].values)
    np.testing.assert_allclose(
        posterior["steepness"].values, (posterior["slope"].values ** 2).sum(axis=-1)
    )
    assert tree["observed_data"]["y"].values.tolist() == [0.4, 1.2, 2.9, 1.0, 3.8]


def test_var_names_selects_the_stored_variables(model):
    kept = ph.sample_smc(model, **FEW, var_names=["steepness"])
    assert list(kept["posterior"].data_vars) == ["steepness"]


def test_only_tempered_terms_enter_the_evidence():
    """Other terms belong to the prior; the particles of `start` are drawn from it."""
    noise, first, second = 0.5, 0.8, -0.4
    with pm.Model() as model:
        x = pm.Normal("x", 0, 1)
        pm.Normal("first", x, noise, observed=first)
        pm.Normal("second", x, noise, observed=second)
    variance = 1 / (1 + noise**-2)
    mean = variance * first / noise**2
    rng = np.random.default_rng(SEED)
    start = [{"x": rng.normal(mean, np.sqrt(variance), 2000)} for _ in range(2)]
    settings = RUN | {"draws": 2000, "chains": 2}
    tree = ph.sample_smc(model, **settings, start=start, tempered=["second"])
    exact = norm(mean, np.sqrt(variance + noise**2)).logpdf(second)
    assert_agrees(ph.log_evidence(tree), exact, 0.033)


def test_interrupt_keeps_complete_chains(model, tree, monkeypatch):
    """An interrupt of the first chain is raised."""
    stages = int(np.isfinite(tree["sample_stats"]["beta"].values[0]).sum())
    interrupt(monkeypatch, ph.BatchedSMC, "sample_stats", stages + 1)
    with pytest.warns(UserWarning, match="1 of 3 chains are complete") as caught:
        kept = ph.sample_smc(model, **RUN)
    np.testing.assert_array_equal(kept["posterior"]["slope"], tree["posterior"]["slope"][:1])
    assert kept["evidence"].sizes["chain"] == 1
    assert caught[0].filename == __file__
    assert np.isfinite(ph.log_evidence(kept)).all()
    interrupt(monkeypatch, ph.BatchedSMC, "sample_stats", 1)
    with pytest.raises(KeyboardInterrupt):
        ph.sample_smc(model, **FEW)
