"""Evidence by adaptive quadrature, against closed forms and a second quadrature."""

import exact
import numpy as np
import pymc as pm
import pytest
from scipy.special import logsumexp
from scipy.stats import norm

import pymc_hyperelastic as ph

# The tolerance that quadrature works to, and PyMC's constants of single precision, allow this.
CLOSED_FORM_TOLERANCE = 1e-7
# Two independent quadratures, one of them good to 1e-6.
QUADRATURE_TOLERANCE = 2e-6


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


@pytest.mark.parametrize(
    ("law", "box"),
    [("Ogden", ((0, 100), (-40, 40))), ("PowerLawNeoHookean", ((0, 200), (0.3, 30)))],
)
def test_agrees_with_a_second_quadrature(law, box):
    """Mirrored modes, and a posterior that touches the prior's edge, on the simulated study."""
    data = ph.load_dataset("simulated_sheep_aorta")
    noise = {"sigma": 15 * ph.mmHg, "slope_weight": ph.balanced_slope_weight(data)}
    training = ph.select(data, group="C2", experiment=[1, 2])
    energy = ph.StrainEnergy.from_name(law)
    found = ph.log_evidence_by_quadrature(ph.inflation_model(energy, training, **noise))
    truth = exact.log_evidence_2d(training, law, **noise, box=box)
    assert abs(found.value - truth) < QUADRATURE_TOLERANCE


def test_three_parameters_are_too_many():
    """The message says what to use instead."""
    with pm.Model() as model:
        x = pm.Normal("x", shape=3)
        pm.Normal("y", x.sum(), observed=1.0)
    with pytest.raises(ValueError, match=r"has 3: use ph\.sample_smc"):
        ph.log_evidence_by_quadrature(model)
    with pytest.raises(TypeError, match=r"expected a pm\.Model"):
        ph.log_evidence_by_quadrature("model")
