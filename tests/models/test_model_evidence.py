"""Evidences and posteriors of models of tubes against exact quadrature."""

from functools import cache

import arviz as az
import exact
import fits
import numpy as np
import pandas as pd
import pymc as pm
import pytest
from scipy.optimize import brentq
from tiers import tiers

import pymc_hyperelastic as ph

SEED = 1731
# A correct standard error is exceeded threefold once in 370 seeds.
STANDARD_ERRORS = 3
# Nats: odds of classes are then right to a sixth.
EVIDENCE_TOLERANCE = 0.15
# Nats: the error of the quadrature, and of the known number, which is printed to eight digits.
EXACT_TOLERANCE = 1e-6
# The share of a mirrored mode is a half. A lost mode changes it by a half; 1000 particles of which
# one in four is independent leave a standard error of 0.03.
SHARE_TOLERANCE = 0.15
# Means and standard deviations are compared in Monte Carlo standard errors.
MONTE_CARLO_ERRORS = 4


def assert_evidence(value, error, truth):
    assert abs(value - truth) < STANDARD_ERRORS * error
    assert abs(value - truth) < EVIDENCE_TOLERANCE


def assert_moments(draws, truth, nodes):
    """Mean and standard deviation of draws (chain, draw), within their Monte Carlo errors."""
    values = np.asarray(draws)
    mean_error, sd_error = (float(az.mcse(values, method=method)) for method in ("mean", "sd"))
    assert abs(values.mean() - truth.mean(nodes)) < MONTE_CARLO_ERRORS * mean_error
    assert abs(values.std() - truth.sd(nodes)) < MONTE_CARLO_ERRORS * sd_error


# Six simulated experiments of twenty points, whose evidence was computed by other software: Ogden,
# A = 7, B = 9 mm, sigma = 5 mmHg, slope weight 1 mm^2, uniform priors of mu (mmHg) and alpha.
KNOWN_LOG_EVIDENCE = -182.95031244
KNOWN_BOX = ((1.0, 150.0), (-20.0, 20.0))
KNOWN_NOISE = {"sigma": 5.0, "slope_weight": 1.0}


def known_data():
    """Three specimens with a modulus and an exponent each; errors of gain, drift and noise.

    Pressures are in mmHg but called kPa: an evidence holds in any unit that is kept throughout.
    """
    rng, radius, rows = np.random.default_rng(100), np.linspace(7.3, 10.2, 20), []
    for specimen in "PQR":
        modulus = 45.0 * np.exp(0.08 * rng.standard_normal())
        exponent = 7.5 * np.exp(0.05 * rng.standard_normal())
        tube = exact.Curve(radius, np.zeros(20), 7.0, 9.0)
        ideal = modulus * tube.responses("Ogden", exponent)[0][0]
        for experiment in (1, 2):
            gain, drift = rng.standard_normal(2)
            pressure = ideal * (1 + 0.02 * gain) + 1.5 * drift * np.sin(np.linspace(0, 3, 20))
            pressure += 0.5 * rng.standard_normal(20)
            table = {"radius": radius, "pressure": pressure}
            rows.append(pd.DataFrame({"specimen": specimen, "experiment": experiment, **table}))
    tube = {"inner_radius": 7.0, "outer_radius": 9.0}
    return ph.inflation_data(pd.concat(rows), **tube, check="ignore")


def test_quadrature_and_sampler_give_the_evidence_of_other_software():
    data = known_data()
    value = exact.log_evidence_2d(data, "Ogden", box=KNOWN_BOX, **KNOWN_NOISE)
    assert abs(value - KNOWN_LOG_EVIDENCE) < EXACT_TOLERANCE
    names = ("mu", "alpha")
    priors = {n: pm.Uniform.dist(*ends) for n, ends in zip(names, KNOWN_BOX, strict=True)}
    model = ph.ogden_model(data, priors=priors, **KNOWN_NOISE)
    tree = ph.sample_smc(model, 1000, 2, random_seed=SEED, progressbar=False, var_names=names)
    assert_evidence(*ph.log_evidence(tree), KNOWN_LOG_EVIDENCE)


NOISE = {"sigma": 5 * ph.mmHg, "slope_weight": 3.0}
BOX = tuple(p.prior_range for p in ph.Ogden().parameters)


@pytest.mark.parametrize("name", ["C1", "C2"])
def test_classes_have_the_exact_evidence_and_posterior(name):
    """Both signs of the exponent are found, and about half of the particles have either."""
    tree, expected = (
        fits.fit("pooled")[name],
        exact.posterior(exact.curves_of(fits.training()[name]), "Ogden", box=BOX, **NOISE),
    )
    assert_evidence(*ph.log_evidence(tree), expected.log_evidence)
    posterior = tree["posterior"]
    assert_moments(posterior["mu"], expected, expected.modulus)
    assert_moments(np.abs(posterior["alpha"]), expected, np.abs(expected.exponent))
    assert abs(float((posterior["alpha"] > 0).mean()) - 0.5) < SHARE_TOLERANCE


def test_an_evidence_by_curves_that_are_wrong_is_not_to_be_trusted():
    tree = fits.fit("sampled")
    assert tree["evidence"]["curve_error"] < 1e-9
    tree["evidence"]["curve_error"] = 0.1
    del tree["diagnosis"]
    diagnosis = ph.diagnose_evidence(tree)
    assert diagnosis.attrs["verdict"] == "not to be trusted"
    assert np.isinf(ph.log_evidence(tree).standard_error)


# --- a thin ridge --------------------------------------------------------------------------------

RIDGE_BOX = ((0.0, 50.0), (-80.0, 80.0))
RIDGE_NOISE = {"sigma": np.sqrt(2) * 2 * ph.mmHg, "slope_weight": 0.0}


@cache
def ridge():
    """Model and exact posterior of a tube so steep that its modulus is known to a factor only.

    The radii are those at even pressures up to 25 mmHg; the posterior holds a ten-thousandth of the
    prior.
    """
    inner, outer, modulus, exponent = 1.0, 1.3, 0.01, 55.0

    def pressure(radius):
        tube = exact.Curve(np.array([radius]), np.zeros(1), inner, outer)
        return modulus * tube.responses("Ogden", exponent)[0].item()

    ideal = np.linspace(0, 25, 11) * ph.mmHg
    radius = [brentq(lambda r, p=p: pressure(r) - p, 0.9, 1.5) for p in ideal]
    error = 1.4 * ph.mmHg * np.sin(2 * np.arange(11))
    table = {"specimen": "M", "experiment": 1, "radius": radius, "pressure": ideal + error}
    data = ph.inflation_data(pd.DataFrame(table), inner_radius=inner, outer_radius=outer)
    priors = {n: pm.Uniform.dist(*e) for n, e in zip(("mu", "alpha"), RIDGE_BOX, strict=True)}
    expected = exact.posterior(exact.curves_of(data), "Ogden", box=RIDGE_BOX, **RIDGE_NOISE)
    assert expected.mean(expected.modulus) < expected.sd(expected.modulus) < 0.1
    return ph.ogden_model(data, priors=priors, **RIDGE_NOISE), expected.log_evidence


@pytest.mark.parametrize("seed", tiers([1, 2, 3], lambda seed: seed == 1))
def test_two_mirrored_thin_ridges_have_the_exact_evidence(seed):
    model, expected = ridge()
    settings = {"random_seed": seed, "progressbar": False, "var_names": ["mu", "alpha"]}
    assert_evidence(*ph.log_evidence(ph.sample_smc(model, 2000, 2, **settings)), expected)
