"""The kernel BatchedSMC: evidences, posteriors and error bars against exact ones."""

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import pytest
from agreement import SEED, Regression, assert_agrees
from scipy import integrate, stats
from scipy.special import logsumexp
from tiers import deep

import pymc_hyperelastic as ph
from pymc_hyperelastic.evidence.target import Target

# Largest standard error in nats: the odds of two models then change by a sixth at most.
LARGEST_ERROR = 0.04
# Largest error of a posterior mean or sd, in posterior sds, for 4000 resampled particles.
PARTICLE_TOLERANCE = 0.15
# Significance level on either side of a test of error bars.
SIGNIFICANCE = 0.001


class TwoModes:
    """Two narrow peaks in the plane, of unequal weight and width, far apart in a wide prior."""

    def __init__(self):
        weight, centre = np.array([0.3, 0.7]), np.array([[-6.0, 2.0], [4.0, -3.0]])
        width, prior = np.array([[0.3], [0.15]]), 10.0
        with pm.Model() as self.model:
            x = pm.Normal("x", 0, prior, shape=2)
            peaks = pm.logp(pm.Normal.dist(centre, width), x).sum(axis=-1)
            pm.Potential("peaks", pt.logsumexp(np.log(weight) + peaks))
        total = np.sqrt(prior**2 + width**2)
        parts = np.log(weight) + stats.norm.logpdf(centre, 0, total).sum(axis=1)
        self.log_evidence = logsumexp(parts)
        share, mean = np.exp(parts - self.log_evidence), centre * (prior / total) ** 2
        self.mean = share @ mean
        self.sd = np.sqrt(share @ ((width * prior / total) ** 2 + (mean - self.mean) ** 2))


PROBLEMS = {"two modes": TwoModes(), "regression": Regression(3)}


def sampled(model, draws=1000, chains=4, **settings):
    settings = {"random_seed": SEED, "progressbar": False} | settings
    return ph.sample_smc(model, draws, chains, **settings)


@pytest.mark.parametrize("name", PROBLEMS)
def test_evidence_and_posterior_moments_equal_exact_values(name):
    problem = PROBLEMS[name]
    tree = sampled(problem.model)
    assert_agrees(ph.log_evidence(tree), problem.log_evidence, LARGEST_ERROR)
    (particles,) = (v.values for v in tree["posterior"].data_vars.values())
    assert particles.shape == (4, 1000, *problem.mean.shape)
    off = np.abs(particles.mean(axis=(0, 1)) - problem.mean)
    np.testing.assert_array_less(off, PARTICLE_TOLERANCE * problem.sd)
    relative = np.abs(particles.std(axis=(0, 1)) / problem.sd - 1)
    np.testing.assert_array_less(relative, PARTICLE_TOLERANCE)


@pytest.mark.parametrize(
    ("name", "from_modes"), [("regression", False), *deep([("two modes", None)])]
)
def test_stated_evidence_errors_are_as_large_as_the_actual_errors(name, from_modes):
    """Squared errors over the squared stated errors of chains have a chi-squared distribution.

    Right errors fail this test at either end once in a thousand times.
    """
    problem, chains = PROBLEMS[name], 24 if from_modes is None else 16
    tree = sampled(problem.model, 300, chains, from_modes=from_modes)
    evidence = tree["evidence"]
    relative = np.exp(evidence["log_evidence"].values - problem.log_evidence) - 1
    squares = np.sum((relative / evidence["log_evidence_se"].values) ** 2)
    low, high = stats.chi2.ppf([SIGNIFICANCE, 1 - SIGNIFICANCE], chains)
    assert low < squares < high


def test_pymc_sample_smc_accepts_the_kernel():
    """Its result gives an evidence with a diagnosis."""
    problem = PROBLEMS["regression"]
    with problem.model:
        settings = {"cores": 1, "random_seed": SEED, "progressbar": False, "threshold": 0.6}
        tree = pm.sample_smc(1000, kernel=ph.BatchedSMC, chains=2, **settings)
    assert_agrees(ph.log_evidence(tree), problem.log_evidence, LARGEST_ERROR)
    off = np.abs(tree["posterior"]["slope"].mean(("chain", "draw")).values - problem.mean)
    np.testing.assert_array_less(off, PARTICLE_TOLERANCE * problem.sd)
    checks = set(ph.diagnose_evidence(tree)["check"].values)
    assert checks == {"chains", "moves", "ancestors"}


def test_threshold_sets_the_effective_fraction_of_the_first_stage():
    for settings, expected in (({"threshold": 0.3}, 0.3), ({}, 0.5)):
        model = PROBLEMS["regression"].model
        kernel = ph.BatchedSMC(500, model=model, from_modes=False, **settings)
        kernel.initialize(None, np.random.default_rng(SEED))
        kernel.update_beta_and_weights()
        # The step is found to one per cent, which changes the fraction by less.
        found = kernel.sample_stats()["effective_sample_size"]
        assert found == pytest.approx(expected * 500, rel=4e-3)


def test_nan_likelihood_counts_as_zero_and_is_reported():
    with pm.Model() as model:
        x = pm.Normal("x", 0, 1)
        pm.Potential("root", -25 * (pt.sqrt(x) - 1) ** 2)
    exact, _ = integrate.quad(
        lambda x: stats.norm.pdf(x) * np.exp(-25 * (np.sqrt(x) - 1) ** 2), 0, 10, points=[1]
    )
    tree = sampled(model)
    assert_agrees(ph.log_evidence(tree), np.log(exact), LARGEST_ERROR)
    assert np.all(tree["posterior"]["x"] > 0) and np.isfinite(tree["posterior"]["x"]).all()
    assert tree["sample_stats"]["nan_scores"].sum() > 0


def test_negative_sd_and_overflow_exclude_their_own_points_only():
    with pm.Model() as model:
        scale = pm.Normal("scale", 0, 1)
        pm.Normal("y", 0, scale, observed=1.3)
        pm.Potential("steep", pt.exp(pt.exp(scale)) - np.e)
    target, points = Target(model), np.array([[-1.0], [1.0], [9.0]])
    prior, likelihood, nan_count = target.evaluate(points)
    assert prior.tolist() == pytest.approx([*stats.norm.logpdf([-1, 1]), -np.inf])
    exact = stats.norm.logpdf(1.3) + np.exp(np.e) - np.e
    assert likelihood.tolist() == pytest.approx([-np.inf, exact, -np.inf])
    assert nan_count == 1
