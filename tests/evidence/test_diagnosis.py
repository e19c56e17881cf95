"""How far evidences can be trusted, and that this is said where they are read."""

import numpy as np
import pymc as pm
import pytest
import xarray as xr

import pymc_hyperelastic as ph
from pymc_hyperelastic.evidence.diagnosis import (
    warn_of_evidence,
    with_diagnosis,
    worst_of,
    worst_verdict,
)
from pymc_hyperelastic.evidence.estimate import combine_chains
from pymc_hyperelastic.evidence.importance import LARGEST_PARETO_K

SEED = 20250


def result(log_evidence=(-10.0, -10.02, -9.99, -10.01), se=0.02, draws=None, **evidence):
    """What is stored of four chains between which all is well, but for what is given."""
    found = {"moves": 0.0, "ancestors": 0.5, "pareto_k": 0.1} | evidence
    chains = {
        "log_evidence": np.array(log_evidence),
        "log_evidence_se": np.full(len(log_evidence), se),
    } | {name: np.full(len(log_evidence), found.pop(name)) for name in list(found)[:3]}
    if draws is None:
        draws = np.random.default_rng(SEED).standard_normal((len(log_evidence), 500))
    return xr.DataTree.from_dict(
        {
            "evidence": xr.Dataset({k: ("chain", v) for k, v in chains.items()}).assign(found),
            "unconstrained_posterior": xr.Dataset({"x": (("chain", "draw"), draws)}),
        }
    )


def shifted(sds):
    """Draws of four chains, one of which is so many sds away."""
    draws = np.random.default_rng(SEED).standard_normal((4, 500))
    draws[0] += sds
    return draws


def test_a_result_against_which_there_is_nothing_is_good():
    """All is compared, and the error is finite."""
    diagnosis = ph.diagnose_evidence(result(forward=-10.5, forward_se=0.1))
    assert diagnosis.attrs == {"verdict": "good", "words": "nothing is against it"}
    names = ["chains", "R-hat", "moves", "ancestors", "prior's side", "weights"]
    assert diagnosis["check"].values.tolist() == names
    assert np.all(diagnosis["verdict"] == "good")
    value, error = ph.log_evidence(result())
    assert value == pytest.approx(-10.005, abs=1e-3)
    assert error == pytest.approx(0.01, abs=1e-3)


@pytest.mark.parametrize(
    ("check", "changed", "verdict"),
    [
        ("chains", {"log_evidence": (-10.0, -10.3, -10.05, -10.1)}, "doubtful"),
        ("chains", {"log_evidence": (-100.0, -370.0, -370.0, -370.0)}, "not to be trusted"),
        ("chains", {"log_evidence": (-10.0, -np.inf, -10.0, -10.0)}, "not to be trusted"),
        ("chains", {"se": np.nan}, "not to be trusted"),
        ("R-hat", {"draws": shifted(0.8)}, "doubtful"),
        ("R-hat", {"draws": shifted(5.0)}, "not to be trusted"),
        ("moves", {"moves": 0.9, "ancestors": 0.1}, "doubtful"),
        ("ancestors", {"ancestors": 0.02}, "doubtful"),
        ("ancestors", {"ancestors": 0.005}, "not to be trusted"),
        ("prior's side", {"forward": -9.0, "forward_se": 0.05}, "not to be trusted"),
        ("modes", {"at_modes": -9.5, "at_modes_se": 0.05}, "not to be trusted"),
        ("weights", {"pareto_k": 0.9}, "doubtful"),
    ],
)
def test_each_check_alone_decides(check, changed, verdict):
    """One thing is wrong: it is named, the verdict follows, and a bad one has an infinite error."""
    tree = result(**changed)
    diagnosis = ph.diagnose_evidence(tree)
    wrong = diagnosis["check"].values[diagnosis["verdict"] != "good"]
    assert wrong.tolist() == [check]
    assert diagnosis.attrs["verdict"] == verdict
    assert diagnosis["words"].sel(check=check).item() in diagnosis.attrs["words"]
    assert np.isinf(ph.log_evidence(tree).standard_error) == (verdict == "not to be trusted")


@pytest.mark.parametrize(
    "changed",
    [
        {"forward": -300.0, "forward_se": 0.05},  # mass may be missed from there
        {"forward": -9.0, "forward_se": np.inf},  # nothing is known
        {"at_modes": -12.0, "at_modes_se": 0.05},
        {"moves": 1.0, "ancestors": 0.6},  # of little importance where few particles are lost
    ],
)
def test_what_says_nothing_against_an_evidence(changed):
    """The other direction of each comparison is no fault."""
    assert ph.diagnose_evidence(result(**changed)).attrs["verdict"] == "good"


def test_error_of_chains_has_no_ceiling():
    """One chain that found all, of four, leaves an error of tens of nats; a failed one any."""
    assert combine_chains(np.array([-100.0, -370, -370, -370]), np.full(4, 0.3))[1] > 50
    assert combine_chains(np.array([-100.0, -np.inf]), np.full(2, 0.3))[1] == np.inf
    assert combine_chains(np.array([-100.0, -100.0]), np.array([0.3, np.nan]))[1] == np.inf


def test_verdict_is_stored_and_a_warning_says_it(tmp_path):
    """It comes back from a file, and the warning names the class and the number."""
    tree = with_diagnosis(result(ancestors=0.005))
    with pytest.warns(UserWarning, match=r"class 'C1': the evidence is not .* come from 0\.5%"):
        warn_of_evidence(tree, "class 'C1': ")
    tree.to_netcdf(tmp_path / "tree.nc")
    loaded = xr.load_datatree(tmp_path / "tree.nc")
    xr.testing.assert_identical(ph.diagnose_evidence(loaded), ph.diagnose_evidence(tree))
    assert np.isinf(ph.log_evidence(loaded).standard_error)
    assert worst_verdict([result(), tree]) == "not to be trusted"
    assert worst_of(["", "good"]) == "good"


def line(sd=0.5):
    """A line through points of the given, unknown noise."""
    rng = np.random.default_rng(SEED)
    design = rng.normal(size=(30, 6))
    measured = design @ rng.normal(size=6) + sd * rng.standard_normal(30)
    with pm.Model() as model:
        slope = pm.Normal("slope", 0, 1, shape=6)
        sigma = pm.HalfNormal("sigma", 1)
        pm.Normal("y", design @ slope, sigma, observed=measured)
    return model


def test_sampled_evidence_is_diagnosed():
    """A model that is no trouble: nothing is said, and the diagnosis stands in the result."""
    tree = ph.sample_smc(line(), 300, 2, random_seed=SEED, progressbar=False)
    assert tree["diagnosis"].attrs["verdict"] == "good"
    assert {"modes", "ancestors", "weights"} <= set(tree["diagnosis"]["check"].values)
    assert tree["evidence"]["at_modes_k"] < LARGEST_PARETO_K


def test_particles_that_were_left_behind_are_noticed():
    """From the prior alone and with few moves a sudden transition is missed, and not silently."""
    model = line(sd=1e-3)
    right = ph.log_evidence(ph.sample_smc(model, 300, 2, random_seed=SEED, progressbar=False))
    with pytest.warns(UserWarning, match="the evidence is"):
        tree = ph.sample_smc(
            model, 300, 2, random_seed=SEED, progressbar=False, from_modes=False, max_moves=2
        )
    wrong = ph.log_evidence(tree)
    assert wrong.value < right.value - 1
    assert ph.diagnose_evidence(tree).attrs["verdict"] != "good"


def test_result_of_pymc_is_diagnosed_too():
    """What PyMC's own driver returns of the kernel has an evidence, and a verdict."""
    with line():
        tree = pm.sample_smc(
            200, kernel=ph.BatchedSMC, chains=2, cores=1, random_seed=SEED, progressbar=False
        )
    ours = ph.log_evidence(ph.sample_smc(line(), 300, 2, random_seed=SEED, progressbar=False))
    value, error = ph.log_evidence(tree)
    assert abs(value - ours.value) < 4 * np.hypot(error, ours.standard_error)
    assert {"chains", "moves", "ancestors"} <= set(ph.diagnose_evidence(tree)["check"].values)
