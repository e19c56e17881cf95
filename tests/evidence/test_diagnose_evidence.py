"""Diagnosis of evidences: the limit of each check, and the verdict that follows."""

import numpy as np
import pytest
import xarray as xr
from arviz_stats.base import array_stats
from evidences import PROBLEMS
from scipy import stats
from scipy.optimize import brentq

import pymc_hyperelastic as ph
from pymc_hyperelastic.evidence.diagnosis import (
    warn_of_evidence,
    with_diagnosis,
    worst_verdict,
)
from pymc_hyperelastic.evidence.verdicts import worst_of

# Variables of the group ``evidence`` with one value a chain.
OF_CHAINS = ("stages_capped", "ancestor_fraction", "pareto_k")
SEED = 20250
GOOD, DOUBTFUL, BAD = "good", "doubtful", "not to be trusted"
DRAWS = np.random.default_rng(SEED).standard_normal((4, 500))


def result(log_evidence=(-10.0, -10.02, -9.99, -10.01), se=0.02, draws=DRAWS, **evidence):
    """Return the stored evidence of four chains; without changes its verdict is "good"."""
    found = {"stages_capped": 0.0, "ancestor_fraction": 0.5, "pareto_k": 0.1} | evidence
    chains = {"log_evidence": np.array(log_evidence), "log_evidence_se": np.full(4, se)}
    chains |= {name: np.full(4, found.pop(name)) for name in OF_CHAINS}
    return xr.DataTree.from_dict(
        {
            "evidence": xr.Dataset({k: ("chain", v) for k, v in chains.items()}).assign(found),
            "unconstrained_posterior": xr.Dataset({"x": (("chain", "draw"), draws)}),
        }
    )


def draws_of_rhat(value):
    """Return draws of four chains, one of them shifted, whose R-hat has this value."""

    def rhat(shift):
        return float(array_stats.rhat(DRAWS + shift * np.eye(4)[0][:, None]))

    return DRAWS + brentq(lambda shift: rhat(shift) - value, 0.1, 9) * np.eye(4)[0][:, None]


def largest_spread_by_chance(se):
    """Return the sd of four log evidences that chance exceeds once in a hundred times."""
    return se * np.sqrt(stats.chi2.isf(0.01, 3) / 3)


def chains_of_spread(sd):
    """Return four log evidences with this standard deviation."""
    values = np.array([-1.0, 0.5, 0.25, 0.25])
    return -10 + values * sd / values.std(ddof=1)


def test_result_that_passes_all_checks_is_called_good():
    diagnosis = ph.diagnose_evidence(result(forward=-10.5, forward_se=0.1, curve_error=1e-8))
    assert diagnosis.attrs == {"verdict": GOOD, "words": "nothing is against it"}
    names = ["chains", "R-hat", "moves", "ancestors", "weights", "prior's side", "curves"]
    assert diagnosis["check"].values.tolist() == names
    assert np.all(diagnosis["verdict"] == GOOD)
    value, error = ph.log_evidence(result())
    assert value == pytest.approx(-10.005, abs=1e-3)
    assert error == pytest.approx(0.01, abs=1e-3)


# Values on both sides of each limit. Two evidences may differ by 0.3 nats, or four standard errors.
# The standard error of the mean of four chains with 0.02 each is 0.01: 4 hypot(0.2, 0.01) = 0.801.
LIMITS = [
    ("chains", {"log_evidence": chains_of_spread(0.99 * largest_spread_by_chance(0.02))}, GOOD),
    ("chains", {"log_evidence": chains_of_spread(1.01 * largest_spread_by_chance(0.02))}, DOUBTFUL),
    ("chains", {"log_evidence": chains_of_spread(0.299)}, DOUBTFUL),
    ("chains", {"log_evidence": chains_of_spread(0.301)}, BAD),
    ("chains", {"log_evidence": (-10.0, -np.inf, -10.0, -10.0)}, BAD),
    ("chains", {"se": np.nan}, BAD),
    ("R-hat", {"draws": draws_of_rhat(1.049)}, GOOD),
    ("R-hat", {"draws": draws_of_rhat(1.051)}, DOUBTFUL),
    ("R-hat", {"draws": draws_of_rhat(1.199)}, DOUBTFUL),
    ("R-hat", {"draws": draws_of_rhat(1.201)}, BAD),
    ("moves", {"stages_capped": 0.49, "ancestor_fraction": 0.149}, GOOD),
    ("moves", {"stages_capped": 0.51, "ancestor_fraction": 0.149}, DOUBTFUL),
    ("moves", {"stages_capped": 1.0, "ancestor_fraction": 0.151}, GOOD),
    ("ancestors", {"ancestor_fraction": 0.031}, GOOD),
    ("ancestors", {"ancestor_fraction": 0.029}, DOUBTFUL),
    ("ancestors", {"ancestor_fraction": 0.0101}, DOUBTFUL),
    ("ancestors", {"ancestor_fraction": 0.0099}, BAD),
    ("prior's side", {"forward": -10.005 + 0.29, "forward_se": 0.05}, GOOD),
    ("prior's side", {"forward": -10.005 + 0.31, "forward_se": 0.05}, BAD),
    ("prior's side", {"forward": -10.005 + 0.79, "forward_se": 0.2}, GOOD),
    ("prior's side", {"forward": -10.005 + 0.81, "forward_se": 0.2}, BAD),
    ("prior's side", {"forward": -300.0, "forward_se": 0.05}, GOOD),
    ("prior's side", {"forward": -9.0, "forward_se": np.inf}, GOOD),
    ("modes", {"at_modes": -10.005 + 0.31, "at_modes_se": 0.05}, BAD),
    ("modes", {"at_modes": -12.0, "at_modes_se": 0.05}, GOOD),
    ("search", {"unmet": 0.21}, BAD),
    ("search", {"unmet": 0.02}, DOUBTFUL),
    ("search", {"unmet": 0.01}, GOOD),
    ("curves", {"curve_error": 0.9e-6}, GOOD),
    ("curves", {"curve_error": 1.1e-6}, BAD),
    ("specimens", {"specimens_se": 0.5}, GOOD),
    ("specimens", {"specimens_se": np.inf}, BAD),
    ("weights", {"pareto_k": 0.69}, GOOD),
    ("weights", {"pareto_k": 0.71}, DOUBTFUL),
]


@pytest.mark.parametrize(("check", "changed", "verdict"), LIMITS)
def test_verdict_changes_at_the_limit_of_each_check(check, changed, verdict):
    """The failed check is named, and an evidence that cannot be trusted has an infinite error."""
    tree = result(**changed)
    diagnosis = ph.diagnose_evidence(tree)
    wrong = diagnosis["check"].values[diagnosis["verdict"] != GOOD].tolist()
    assert wrong == ([] if verdict == GOOD else [check])
    assert diagnosis.attrs["verdict"] == verdict
    if wrong:
        assert diagnosis["words"].sel(check=check).item() in diagnosis.attrs["words"]
        assert ("NUTS" in diagnosis.attrs["words"]) == (check != "specimens")
    assert np.isinf(ph.log_evidence(tree).standard_error) == (verdict == BAD)


def test_checks_use_the_worst_chain_for_ancestors_and_weights_and_mean_moves():
    tree = result()
    tree["evidence"]["ancestor_fraction"][2] = 0.02
    tree["evidence"]["pareto_k"][1] = 0.8
    tree["evidence"]["stages_capped"][:] = [1.0, 0.2, 0.0, 0.0]
    value = ph.diagnose_evidence(tree)["value"]
    found = [float(value.sel(check=check)) for check in ("ancestors", "weights", "moves")]
    assert found == pytest.approx([0.02, 0.8, 0.3])


def test_stored_verdict_is_kept_and_the_warning_gives_the_reason():
    tree = with_diagnosis(result(ancestor_fraction=0.005))
    with pytest.warns(UserWarning, match=r"class 'C1': the evidence is not .* come from 0\.5%"):
        warn_of_evidence(tree, "class 'C1': ")
    assert np.isinf(ph.log_evidence(tree).standard_error)
    tree["evidence"]["ancestor_fraction"][:] = 0.5
    assert ph.diagnose_evidence(tree).attrs["verdict"] == BAD
    assert worst_verdict([result(), tree]) == BAD
    assert worst_of(["", GOOD]) == GOOD


def test_stored_good_verdict_does_not_hide_a_specimen_given_up():
    tree = with_diagnosis(result())
    tree["evidence"]["specimens_se"] = np.inf
    assert ph.diagnose_evidence(tree).attrs["verdict"] == BAD


def test_result_of_pymc_sample_smc_is_diagnosed_from_its_stages():
    """The last finite number of each chain counts; moves are the share of stages at the maximum."""
    stages = {
        "log_marginal_likelihood": [[-9.0, -4.0], [-8.0, -4.1, np.nan]],
        "log_evidence_variance": [[0.5, 0.09], [0.5, 0.16, np.nan]],
        "ancestors": [[100.0, 50.0], [100.0, 20.0, np.nan]],
        "capped": [[0, 1], [0, 0, 1, np.nan]],
    }
    columns = {}
    for name, chains in stages.items():
        columns[name] = ("chain", np.empty(2, object))
        columns[name][1][:] = chains
    group = xr.Dataset(columns, attrs={"_n_draws": 200})
    tree = xr.DataTree.from_dict({"sample_stats": group})
    value, error = ph.log_evidence(tree)
    assert value == pytest.approx(np.logaddexp(-4.0, -4.1) - np.log(2))
    assert error == pytest.approx(0.25)
    found = ph.diagnose_evidence(tree)["value"]
    assert float(found.sel(check="ancestors")) == pytest.approx(0.1)
    assert float(found.sel(check="moves")) == pytest.approx((1 / 2 + 1 / 3) / 2)


def test_evidence_of_particles_that_miss_a_sudden_transition_is_not_good():
    """Tempering from the prior with few moves prefers a large noise; the true noise is small."""
    problem = PROBLEMS["sine_frequency"]
    settings = {"random_seed": SEED, "progressbar": False, "from_modes": False, "max_moves": 2}
    with pytest.warns(UserWarning, match="the evidence is"):
        tree = ph.sample_smc(problem.model(), 300, 2, **settings)
    assert ph.log_evidence(tree).value < problem.log_evidence() - 1
    assert np.all(tree["evidence"]["stages_capped"] == 1)
    assert ph.diagnose_evidence(tree).attrs["verdict"] != GOOD
