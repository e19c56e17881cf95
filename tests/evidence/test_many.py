"""Evidences of models of many unknowns: a bridge from particles that were led to the posterior."""

import numpy as np
import pymc as pm
import pytest
from scipy import stats
from scipy.integrate import quad

from pymc_hyperelastic.evidence.many import Led
from pymc_hyperelastic.evidence.target import Target


def hierarchy():
    """Thirty normal means of a common, unknown spread, and their evidence by quadrature."""
    y = np.random.default_rng(7).normal(0.0, 1.5, 30)
    with pm.Model() as model:
        spread = pm.LogNormal("spread", 0.0, 1.0)
        mean = pm.Normal("mean", 0.0, spread, shape=30)
        pm.Normal("y", mean, 1.0, observed=y)

    def density(log_spread):
        sd = np.sqrt(1 + np.exp(2 * log_spread))
        return np.exp(stats.norm(0, sd).logpdf(y).sum() + 60) * stats.norm.pdf(log_spread)

    return model, np.log(quad(density, -8, 4, epsabs=0, epsrel=1e-10)[0]) - 60


def correlated():
    """A normal posterior of strongly correlated unknowns; closed form."""
    size = 40
    design = np.random.default_rng(8).normal(size=(25, size))
    y = np.random.default_rng(9).normal(size=25)
    with pm.Model() as model:
        slopes = pm.Normal("slopes", 0.0, 2.0, shape=size)
        pm.Normal("y", design @ slopes, 0.3, observed=y)
    covariance = 4 * design @ design.T + 0.09 * np.eye(25)
    return model, stats.multivariate_normal(np.zeros(25), covariance).logpdf(y)


def skewed():
    """Rates of counts, whose posteriors are skewed: a gamma and Poisson distribution each."""
    counts = np.random.default_rng(10).poisson(1.0, 26)
    with pm.Model() as model:
        rate = pm.Gamma("rate", 1.5, 1.0, shape=26)
        pm.Poisson("counts", rate, observed=counts)
    return model, stats.nbinom(1.5, 0.5).logpmf(counts).sum()


@pytest.mark.parametrize("case", [hierarchy, correlated, skewed])
def test_evidence(case):
    """By particles where the evidence is twice the same, and by where they go from there."""
    model, exact = case()
    rng = np.random.default_rng(1)
    led = Led(Target(model), rng)
    # More than particles go through at a stage, too.
    sizes = 1000, 1000, 6000
    integrals = [led.integral(size, rng) for size in sizes]
    unknowns = sum(v.size for v in model.initial_point().values())
    for size, found in zip(sizes, integrals, strict=True):
        value, error = found.log_value
        assert found.particles.shape == (size, unknowns)
        assert error < 0.1
        assert value == pytest.approx(exact, abs=3 * error + 0.05)
    assert len({found.log_value.value for found in integrals}) == 3


@pytest.mark.parametrize("wrong", [1.0, 1.5, -1.0])
def test_a_guide_leads_but_does_not_decide(wrong):
    """Particles are those of the target, also if the slopes are too steep, or of another sign."""

    class Steeper(Target):
        def slopes(self, points):
            return tuple(wrong * values for values in super().slopes(points))

    model, exact = correlated()
    guide, rng = Steeper(model), np.random.default_rng(2)
    found = Led(Target(model), rng, guide=guide).integral(2000, rng)
    value, error = found.log_value
    if wrong < 0:
        assert error > 0.1 or value == pytest.approx(exact, abs=3 * error + 0.05)
        return
    assert value == pytest.approx(exact, abs=3 * error + 0.05) and error < 0.1
    # Means of a normal posterior, against the closed form.
    design = np.random.default_rng(8).normal(size=(25, 40))
    y = np.random.default_rng(9).normal(size=25)
    covariance = np.linalg.inv(design.T @ design / 0.09 + np.eye(40) / 4)
    mean, sd = covariance @ design.T @ y / 0.09, np.sqrt(np.diag(covariance))
    assert np.abs((found.particles.mean(axis=0) - mean) / sd).max() < 0.2
    assert found.particles.std(axis=0) == pytest.approx(sd, rel=0.12)
