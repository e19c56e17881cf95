"""Evidence by adaptive quadrature, against closed forms."""

import numpy as np
import pymc as pm
import pytest
from scipy.integrate import quad
from scipy.special import logsumexp
from scipy.stats import norm

import pymc_hyperelastic as ph

# The tolerance that quadrature works to, and PyMC's constants of single precision, allow this.
CLOSED_FORM_TOLERANCE = 1e-7


def test_gaussian_evidence_in_closed_form():
    """A normal mean with a normal prior has a normal evidence."""
    with pm.Model() as model:
        mean = pm.Normal("mean", 0.0, 3.0)
        pm.Normal("y", mean, 4.0, observed=1.0)
    found = ph.log_evidence_by_quadrature(model)
    assert abs(found.value - norm(0, 5).logpdf(1)) < CLOSED_FORM_TOLERANCE
    assert found.standard_error < CLOSED_FORM_TOLERANCE


def test_narrow_modes_far_apart_are_both_found():
    """Two modes, each ten thousand times narrower than the prior, in two dimensions."""
    with pm.Model() as model:
        x = pm.Uniform("x", -10.0, 10.0)
        y = pm.Uniform("y", -10.0, 10.0)
        sd = 2e-3
        terms = [norm_logp(x, c, sd) + norm_logp(y, -c / 2, sd) for c in (-6.0, 6.0)]
        pm.Potential("modes", pm.math.logsumexp(pm.math.stack(terms)))
    truth = logsumexp([-2 * np.log(20.0)] * 2)
    assert abs(ph.log_evidence_by_quadrature(model).value - truth) < CLOSED_FORM_TOLERANCE


def norm_logp(x, mean, sd):
    return -0.5 * ((x - mean) / sd) ** 2 - np.log(sd) - 0.5 * np.log(2 * np.pi)


def test_mirrored_modes_count_both():
    """A posterior of two signs, of which either alone would halve the evidence."""
    with pm.Model() as model:
        x = pm.Uniform("x", -10.0, 10.0)
        pm.Normal("y", x**2, 0.1, observed=9.0)
    truth, _ = quad(lambda x: norm(x**2, 0.1).pdf(9.0) / 20, 2.0, 4.0, points=[3.0], epsabs=1e-14)
    found = ph.log_evidence_by_quadrature(model)
    assert abs(found.value - np.log(2 * truth)) < CLOSED_FORM_TOLERANCE


def test_posterior_that_touches_the_end_of_the_prior_is_integrated_to_it():
    """What a uniform prior cuts off is missing: the distribution function says how much."""
    with pm.Model() as model:
        x = pm.Uniform("x", 0.0, 10.0)
        y = pm.Uniform("y", 0.0, 10.0)
        pm.Normal("z", [x, y], [0.5, 0.2], observed=[10.2, 9.9])
    truth = norm([10.2, 9.9], [0.5, 0.2]).logcdf(10.0).sum() - 2 * np.log(10)
    found = ph.log_evidence_by_quadrature(model)
    assert abs(found.value - truth) < CLOSED_FORM_TOLERANCE


def test_three_parameters_are_too_many():
    """The message says what to use instead."""
    with pm.Model() as model:
        x = pm.Normal("x", shape=3)
        pm.Normal("y", x.sum(), observed=1.0)
    with pytest.raises(ValueError, match=r"has 3: use ph\.sample_smc"):
        ph.log_evidence_by_quadrature(model)
    with pytest.raises(TypeError, match=r"expected a pm\.Model"):
        ph.log_evidence_by_quadrature("model")
