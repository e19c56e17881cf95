"""The sampler with its default settings on the table of models with known evidences."""

import pytest
from difficult_evidences import DIFFICULT
from evidences import PROBLEMS
from tiers import long

import pymc_hyperelastic as ph

SEED = 20250
# Largest error of the mean of four chains, in nats, up to thirty unknowns and for more.
TOLERANCE, TOLERANCE_OF_MANY = 0.1, 0.3
# A correct standard error is exceeded fourfold once in 16,000 runs; seeds are fixed.
STANDARD_ERRORS = 4
# Models of different kinds for which tempering from the prior alone fails: a sudden transition, an
# unbounded density, a prior that is mostly impossible.
FAST = ["sine_frequency", "funnel_4", "half_space"]
# More unknowns than the sampler accepts.
TOO_MANY = ["groups_1000"]
# Models whose stated error is too small, because draws miss part of heavy tails.
TAILS = ["horseshoe"]
# Models of coupled angles, which lose the corners where the end of the period cuts their ridge.
CUT = ["stiff_ring_of_angles"]
# Models with a right evidence for which a second run from the prior says that it may be wrong.
DOUBTED = ["random_walk"]
# Models that take minutes.
SLOW = [
    "correlated_normal_50",
    "groups_100",
    "many_observations",
    "random_walk",
    "regression_50",
]
# Difficult models that take minutes.
SLOW_DIFFICULT = ["change_points_3", "modes_256", "many_rates"]
GREAT_EFFORT = DIFFICULT["great effort"]
FAST_DIFFICULT = [
    p for problems in DIFFICULT.values() for p in problems.values() if p.name not in SLOW_DIFFICULT
]
DEEP = sorted(set(PROBLEMS) - {*FAST, *TOO_MANY, *SLOW})


def assert_right(name, **settings):
    """Check the evidence against the exact one, and the verdict."""
    problem = PROBLEMS[name]
    tree = ph.sample_smc(problem.model(), random_seed=SEED, progressbar=False, **settings)
    value, error = ph.log_evidence(tree)
    off = abs(value - problem.log_evidence())
    assert off < (TOLERANCE if problem.unknowns <= 30 else TOLERANCE_OF_MANY)
    assert name in TAILS or off < STANDARD_ERRORS * error
    trusted = ph.diagnose_evidence(tree).attrs["verdict"] != "not to be trusted"
    assert trusted != (name in DOUBTED)
    return tree


@pytest.mark.parametrize("name", FAST)
def test_evidence_equals_the_exact_value_for_fast_models(name):
    tree = assert_right(name, draws=1000, chains=2)
    assert tree["sample_stats"].attrs["from_modes"] == 1


@pytest.mark.deep
@pytest.mark.filterwarnings("ignore:the evidence is")
@pytest.mark.parametrize("name", [*DEEP, *long(SLOW)])
def test_evidence_equals_the_exact_value_for_all_other_models(name):
    assert_right(name)


def assert_exact_or_not_good(problem):
    """Check that a wrong evidence is not called good, and that its error is known."""
    tree = ph.sample_smc(problem.model(), random_seed=SEED, progressbar=False)
    value, error = ph.log_evidence(tree)
    off = abs(value - problem.log_evidence())
    verdict = ph.diagnose_evidence(tree).attrs["verdict"]
    assert off < TOLERANCE or verdict != "good"
    assert off < STANDARD_ERRORS * error or verdict != "good" or problem.name in CUT
    return verdict


@pytest.mark.deep
@pytest.mark.filterwarnings("ignore:the evidence is")
@pytest.mark.parametrize("problem", FAST_DIFFICULT, ids=lambda problem: problem.name)
def test_evidence_of_a_difficult_model_is_exact_or_not_called_good(problem):
    assert_exact_or_not_good(problem)


@pytest.mark.deep
@pytest.mark.filterwarnings("ignore:the evidence is")
@pytest.mark.parametrize("name", long(SLOW_DIFFICULT))
def test_evidence_of_a_model_that_needs_great_effort_is_not_called_good(name):
    assert assert_exact_or_not_good(GREAT_EFFORT[name]) != "good"
