"""Distributions of several groups at once, against sums over grids of spreads."""

import numpy as np
import pytest
from normal_specimens import of_groups, of_pairs
from variable_classes import known_specimen

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.hierarchical import HierarchicalClass
from pymc_hyperelastic.classes.joint import Apart, Joint, unit_of_pair
from pymc_hyperelastic.classes.specimen_evidence import unit_of_specimen

SEED, DRAWS = 912, 1000
# A correct standard error is exceeded threefold once in 370 runs; seeds are fixed. No evidence may
# be less certain than the second number (nats).
STANDARD_ERRORS, NATS = 3, 0.07
# Errors of means, standard deviations and probabilities of the draws: four standard errors, the
# first two in posterior sds.
MEAN_ERROR, SD_ERROR, PROBABILITY_ERROR = 4 / np.sqrt([DRAWS, 2 * DRAWS, 4 * DRAWS])
KIND = HierarchicalClass.of_settings(ph.NeoHookean(), 1.0)
SCALE = KIND.scale
(MEAN,), (MEDIAN,) = SCALE.location_prior[0], np.exp(SCALE.spread_prior[0])
APART = Apart(1.3, 0.6)


def check(found, exact, **draws):
    """Compare the evidence, and draws of the effect and of the difference."""
    value, error = ph.log_evidence(found)
    assert abs(value - exact.log_evidence) < min(STANDARD_ERRORS * error, NATS)
    for name, values in draws.items():
        place = {"effect": 1, "difference": -1}[name]
        assert abs(values.mean() - exact.mean[place]) < MEAN_ERROR * exact.sd[place]
        assert values.std() == pytest.approx(exact.sd[place], rel=SD_ERROR)


@pytest.mark.parametrize(
    ("apart", "covariates"),
    [(None, []), (APART, ["age"])],
    ids=["one distribution", "difference and covariate"],
)
def test_joint_fit_of_two_groups_equals_a_sum_over_spreads(apart, covariates):
    """Groups of different sizes and spreads, with or without a covariate."""
    rng = np.random.default_rng(SEED)
    sign = np.repeat([-0.5, 0.5], [5, 4])
    age = np.linspace(-1.5, 1.5, 9) ** 3 / 2 + 0.3 * sign
    errors = rng.uniform(0.05, 0.2, 9)
    y = MEAN + 0.4 * sign + 0.3 * age + rng.normal(0, np.where(sign < 0, 0.2, 0.5))
    names = ["first", "second"] if apart else ["all"]
    units = {name: {} for name in names}
    for i in range(9):
        own = np.array([age[i]] * len(covariates))
        unit = unit_of_specimen(known_specimen(rng, y[i], errors[i]), own)
        units[names[int(sign[i] > 0)] if apart else "all"][f"{i}"] = unit
    joint = Joint(KIND, names, apart, covariates)
    found = joint.fit(units, DRAWS, 1, np.random.SeedSequence(SEED))
    exact = of_groups(SCALE, y, errors, sign, [age] * len(covariates), apart)
    if not apart:
        return check(found, exact)
    first, second = (d for (d,) in joint.distributions(found, DRAWS).values())
    difference = np.ravel(second.location - first.location)
    check(found, exact, effect=first.effects[0], difference=difference)
    assert abs(np.mean(second.spread > first.spread) - exact.positive) < PROBABILITY_ERROR
    ratio = np.log(np.ravel(second.spread) / np.ravel(first.spread))
    stored = found["posterior"]["spread_difference"].values.ravel()
    np.testing.assert_allclose(abs(ratio), abs(stored))


def test_contrasts_of_any_two_groups_have_a_distance_of_one():
    contrasts = Joint(KIND, [*"abc"], APART).contrasts
    for i, j in ((0, 1), (0, 2), (1, 2)):
        assert np.sum((contrasts[i] - contrasts[j]) ** 2) == pytest.approx(1)


def test_joint_fit_of_pairs_equals_a_sum_over_spreads():
    """Animals differ more than they change; the second value of a pair has larger errors."""
    rng = np.random.default_rng(SEED)
    animals = rng.normal(MEAN, 0.6, 6)
    change = 0.25 + rng.normal(0, 0.1, 6)
    errors = np.stack([rng.uniform(0.02, 0.05, 6), rng.uniform(0.1, 0.2, 6)])
    age = np.stack([np.linspace(-1, 1, 6), np.linspace(-0.5, 1.7, 6) ** 2])
    y = np.stack([animals - change / 2, animals + change / 2]) + 0.2 * age
    units = {}
    for i in range(6):
        halves = (known_specimen(rng, y[k, i], errors[k, i]) for k in range(2))
        units[f"{i}"] = unit_of_pair(*halves, age[:, i, None])
    joint = Joint(KIND, ["pairs"], APART, ["age"], paired=True)
    found = joint.fit({"pairs": units}, DRAWS, 1, np.random.SeedSequence(SEED))
    exact = of_pairs(SCALE, y.ravel(), errors.ravel(), [age.ravel()], APART)
    middle, change = joint.distributions(found, DRAWS)["pairs"]
    check(found, exact, effect=middle.effects[0], difference=np.ravel(change.location))
