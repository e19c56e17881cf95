"""Noise given as standard deviations or as the paper's σ, which is √2 standard deviations."""

import numpy as np
import pymc as pm
import pytest
from bad_input import OGDEN, curves, unknown_curves
from problems import AS_WRITTEN
from scipy import stats

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.observation.noise import noise_in_words

POINT = {"mu": 6.0, "alpha": 8.0}
# Variables without a transform.
FLAT = {"priors": {"mu": pm.Flat.dist(), "alpha": pm.Flat.dist()}, "mode": "quadrature"}
SD, FORCE_SD = 0.4, 3.0
# One expression twice; factors of √2 are multiplied and divided.
ROUNDING = 1e-12
# Sums of squares of numbers that are exact to 1e-12.
DENSITY_TOLERANCE = 1e-9
FORCES = [30.0, 40.0, np.nan, 55.0]


def density(model, **noise):
    """Log density of the measurements at a point of the parameters and of inferred noise."""
    term = model.logp([*model.observed_RVs, *model.potentials])
    return float(model.compile_fn(term, mode=AS_WRITTEN)(POINT | noise))


FORMS = {
    "slopes": {"slope_weight": 2.0},
    "generative": {"slope_weight": 2.0, "likelihood": "generative"},
}


@pytest.mark.parametrize("form", FORMS)
def test_sigma_is_sqrt_2_standard_deviations_in_every_likelihood(form):
    one = ph.inflation_model(OGDEN, curves(), noise_sd=SD, **FORMS[form], **FLAT)
    other = ph.inflation_model(OGDEN, curves(), sigma=np.sqrt(2) * SD, **FORMS[form], **FLAT)
    inferred = ph.inflation_model(OGDEN, curves(), noise_sd=pm.Flat.dist(), **FORMS[form], **FLAT)
    assert [rv.name for rv in inferred.free_RVs] == ["mu", "alpha", "noise_sd"]
    found = density(one), density(inferred, noise_sd=SD)
    assert found == pytest.approx([density(other)] * 2, rel=ROUNDING)


@pytest.mark.parametrize("likelihood", ["paper", "generative"])
def test_pressures_and_forces_are_normal_with_the_given_standard_deviations(likelihood):
    data = unknown_curves(FORCES)
    noise = {"noise_sd": pm.Flat.dist(), "force_noise_sd": pm.Flat.dist(), "slope_weight": 0}
    model = ph.inflation_model(OGDEN, data, likelihood=likelihood, **noise, **FLAT)
    tube = {"inner_radius": 7.0, "outer_radius": 9.0} | POINT
    pressure, force = (
        f(OGDEN, data["radius"].values, **tube).eval(mode=AS_WRITTEN)
        for f in (ph.inflation_pressure, ph.axial_force)
    )
    expected = stats.norm(pressure, SD).logpdf(data["pressure"]).sum()
    expected += np.nansum(stats.norm(force, FORCE_SD).logpdf(data["axial_force"]))
    found = density(model, noise_sd=SD, force_noise_sd=FORCE_SD)
    assert found == pytest.approx(expected, rel=DENSITY_TOLERANCE)


def test_noise_is_reported_as_sigma_and_as_standard_deviations():
    noise = {"noise_sd": 0.5, "slope_weight": 2.0, "force_noise_sd": pm.HalfNormal.dist(1)}
    noise |= {"force_offset_sd": 25.0, "diameter_noise_sd": pm.HalfNormal.dist(1)}
    assert noise_in_words(noise) == (
        "sigma = 0.707107 kPa (a standard deviation of 0.5 kPa), slope_weight = 2 mm2, "
        "force_noise_sd inferred, in mN (one standard deviation), "
        "force_offset_sd = 25 mN (one standard deviation of the transducer's offset, one for each "
        "test), diameter_noise_sd inferred, in mm (one standard deviation of a measured diameter)"
    )
    inferred = {"sigma": pm.HalfNormal.dist(1), "slope_weight": 0.0}
    assert "sigma inferred, in kPa (√2 standard deviations)" in noise_in_words(inferred)
    assert "a standard deviation of 0.05 mm" in noise_in_words({"noise_sd": 0.05}, "radius")
