"""Classes whose specimens share one material: evidence and posterior against quadrature."""

import fits
import numpy as np
import pymc as pm
import pytest
import variable_classes
from interrupts import interrupt
from pooled_classes import EVIDENCE_TOLERANCE, NAMES, SEED, STANDARD_ERRORS, exact_posterior
from scipy import stats
from scipy.special import logsumexp
from variable_classes import UNIT_PRESSURE, curves

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes import pooled
from pymc_hyperelastic.classes.kinds import kind_of_classes


@pytest.mark.parametrize("name", NAMES)
def test_evidence_and_posterior_of_a_pooled_class_equal_quadrature(name):
    fitted, truth = fits.fit("pooled")[name], exact_posterior(name)
    value, error = ph.log_evidence(fitted)
    assert abs(value - truth.log_evidence) < min(STANDARD_ERRORS * error, 2 * EVIDENCE_TOLERANCE)
    # The energy is even in alpha, and both signs are equally probable.
    for variable, nodes in (("mu", truth.modulus), ("alpha", np.abs(truth.exponent))):
        draws = np.abs(fitted["posterior"][variable].values)
        # A thousand draws know a mean to 3 % of the sd, and the sd to 2 %.
        assert abs(draws.mean() - truth.mean(nodes)) < 0.15 * truth.sd(nodes)
        np.testing.assert_allclose(draws.std(), truth.sd(nodes), rtol=0.15)


def test_fitted_class_stores_its_data_and_its_own_random_seed():
    """New specimens of a class have the parameters of its posterior."""
    classes = fits.fit("pooled")
    for name, data in fits.training().items():
        fitted, posterior = classes[name], classes[name]["posterior"]
        np.testing.assert_array_equal(fitted["observed_data"]["pressure"], data["pressure"])
        new = kind_of_classes(classes).new_specimens(fitted, np.random.default_rng(SEED))
        assert list(new) == list(posterior.data_vars) == ["mu", "alpha"]
        np.testing.assert_array_equal(new["mu"], posterior["mu"].values.ravel())
    assert len({classes[name].attrs["random_seed"] for name in NAMES}) == 2


@pytest.mark.filterwarnings("ignore:class 'C1'. the fit is doubtful")  # specimens differ
def test_interrupt_keeps_fitted_classes_and_names_the_missing_one(monkeypatch):
    settings = {"draws": 100, "chains": 1, "progressbar": False}
    interrupt(monkeypatch, pooled, "run_smc", 2)
    with pytest.warns(UserWarning, match="class 'C2' is not fitted: interrupted"):
        kept = ph.fit_classes(ph.Ogden(), fits.training(), fits.SLOPE_AUGMENTED, **settings)
    assert list(kept.children) == ["C1"]
    interrupt(monkeypatch, pooled, "run_smc", 1)
    with pytest.raises(KeyboardInterrupt):
        ph.fit_classes(ph.Ogden(), fits.training(), fits.SLOPE_AUGMENTED, **settings)


def test_evidence_of_new_data_averages_the_likelihood_over_modulus_and_noise():
    """The PyMC model in whose context the classes are fitted does not change."""
    with pm.Model() as own:
        pm.Normal("mu")
        # Few draws of a class are near the new data: their mean needs many.
        noise = pm.HalfNormal.dist(5.0)
        classes = variable_classes.fit(likelihood=noise, variability=None, draws=8000)
        new = curves({"N": [50.0]}, 3)
        result = variable_classes.classify(new, classes)
    assert list(own.named_vars) == ["mu"]
    for i, fitted in enumerate(classes.children.values()):
        mu, sd = (fitted["posterior"][n].values.reshape(-1, 1) for n in ("mu", "pressure_sd"))
        each = stats.norm(mu * UNIT_PRESSURE, sd).logpdf(new["pressure"].values).sum(axis=1)
        weights = np.exp(each - logsumexp(each))
        error = np.hypot(np.linalg.norm(weights), result["log_evidence_se"].values[0, i])
        expected = logsumexp(each) - np.log(each.size)
        assert error < 2 * EVIDENCE_TOLERANCE
        assert abs(result["log_evidence"].values[0, i] - expected) < STANDARD_ERRORS * error
