"""Evidences and posteriors of models of tubes against exact quadrature."""

import arviz as az
import exact
import fits
import numpy as np
import pandas as pd
import pymc as pm
import pytest
from benchmarks import known_problem as known
from tiers import deep

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


KNOWN_BOX = known.MU, known.ALPHA
KNOWN_NOISE = {"sigma": known.SIGMA, "slope_weight": known.SLOPE_WEIGHT}


def test_quadrature_and_sampler_give_the_known_evidence():
    """Pressures are in mmHg but called kPa: any unit can be used consistently.

    The benchmarks compute the answer without the package and without `exact`.
    """
    frames = [
        pd.DataFrame({"specimen": i // 2, "experiment": i, "radius": radius, "pressure": pressure})
        for i, (radius, pressure) in enumerate(known.known_curves())
    ]
    tube = ph.Tube(inner_radius=known.INNER_RADIUS, outer_radius=known.OUTER_RADIUS)
    data = ph.inflation_data(pd.concat(frames), tube, check="ignore")
    value = exact.log_evidence_2d(data, "Ogden", box=KNOWN_BOX, **KNOWN_NOISE)
    assert abs(value - known.LOG_EVIDENCE) < EXACT_TOLERANCE
    names = ("mu", "alpha")
    priors = {n: pm.Uniform.dist(*ends) for n, ends in zip(names, KNOWN_BOX, strict=True)}
    model = ph.ogden_model(data, ph.SlopeAugmented(**KNOWN_NOISE), priors=priors)
    tree = ph.sample_smc(model, 500, 2, random_seed=SEED, progressbar=False, var_names=names)
    assert_evidence(*ph.log_evidence(tree), known.LOG_EVIDENCE)


NOISE = {"sigma": 5 * ph.mmHg, "slope_weight": 3.0}
BOX = tuple(p.prior_range for p in ph.Ogden().parameters)


@pytest.mark.parametrize("name", ["C1", *deep(["C2"])])
def test_evidence_and_posterior_of_a_class_are_exact(name):
    """Both signs of the exponent are found, and about half of the particles have either."""
    tree, curves = fits.fit("pooled")[name], exact.curves_of(fits.training()[name])
    expected = exact.posterior(curves, "Ogden", box=BOX, **NOISE)
    assert_evidence(*ph.log_evidence(tree), expected.log_evidence)
    posterior = tree["posterior"]
    assert_moments(posterior["mu"], expected, expected.modulus)
    assert_moments(np.abs(posterior["alpha"]), expected, np.abs(expected.exponent))
    assert abs(float((posterior["alpha"] > 0).mean()) - 0.5) < SHARE_TOLERANCE


def test_evidence_from_inaccurate_curves_is_not_to_be_trusted():
    tree = fits.fit("sampled")
    assert tree["evidence"]["curve_error"] < 1e-9
    tree["evidence"]["curve_error"] = 0.1
    del tree["diagnosis"]
    diagnosis = ph.diagnose_evidence(tree)
    assert diagnosis.attrs["verdict"] == "not to be trusted"
    assert np.isinf(ph.log_evidence(tree).standard_error)
