"""Evidence by adaptive quadrature, against closed forms."""

import numpy as np
import pymc as pm
import pytest
from scipy.stats import norm

import pymc_hyperelastic as ph

# The tolerance of the quadrature is 1e-8; PyMC's constants have single precision.
CLOSED_FORM_TOLERANCE = 1e-7


def assert_evidence(model, exact):
    found = ph.log_evidence_by_quadrature(model)
    assert abs(found.value - exact) < CLOSED_FORM_TOLERANCE
    assert found.standard_error < CLOSED_FORM_TOLERANCE


def test_evidence_of_two_narrow_modes_far_apart_is_exact():
    """Each of the two modes is ten thousand times narrower than the prior."""
    sd, centres = 2e-3, np.array([[-6.0, 3.0], [6.0, -3.0]])
    with pm.Model() as model:
        x = pm.Uniform("x", -10.0, 10.0, shape=2)
        peaks = pm.logp(pm.Normal.dist(centres, sd), x).sum(axis=-1)
        pm.Potential("modes", pm.math.logsumexp(peaks))
    assert_evidence(model, np.log(2) - 2 * np.log(20.0))


def test_evidence_of_a_posterior_at_the_bound_of_a_prior_is_exact():
    """The distribution function gives the share within the bounds of the uniform prior."""
    with pm.Model() as model:
        x = pm.Uniform("x", 0.0, 10.0)
        pm.Normal("y", x, 0.5, observed=10.2)
    assert_evidence(model, norm(10.2, 0.5).logcdf(10.0) - np.log(10))


def test_more_than_two_unknowns_or_no_model_are_refused():
    with pm.Model() as model:
        x = pm.Normal("x", shape=3)
        pm.Normal("y", x.sum(), observed=1.0)
    with pytest.raises(ValueError, match=r"has 3: use ph\.sample_smc"):
        ph.log_evidence_by_quadrature(model)
    with pytest.raises(TypeError, match=r"expected a pm\.Model"):
        ph.log_evidence_by_quadrature("model")
