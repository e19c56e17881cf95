"""Likelihood objects: equality, description, validation, and records for files."""

import json

import numpy as np
import pymc as pm
import pytensor
import pytest
from bad_input import curves
from problems import AS_WRITTEN
from scipy import stats
from shared_errors import extended

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.likelihoods import Likelihood, as_likelihood
from pymc_hyperelastic.models.likelihoods.signals import log_density_by_points, normal_log_density

ROUNDING = 1e-12
FORCES = {"force_offset_sd": 25.0, "observed": True}
LIKELIHOODS = [
    ph.Gaussian(0.5),
    ph.Gaussian(radius_sd=0.05, force_sd=2.0),
    ph.Gaussian(pm.HalfNormal.dist(1.0), force_sd=pm.LogNormal.dist(0.0, 1.0), **FORCES),
    ph.Gaussian(0.5, diameter_sd=0.01),
    ph.SlopeAugmented(sigma=0.7, slope_weight=2.0, force_sigma=3.0, **FORCES),
    ph.SlopeAugmented(pm.HalfNormal.dist(1.0), pm.HalfNormal.dist(2.0)),
]


@pytest.mark.parametrize("likelihood", LIKELIHOODS, ids=repr)
def test_likelihood_is_restored_from_its_json_record(likelihood):
    record = json.loads(json.dumps(likelihood.to_record()))
    again = Likelihood.from_record(record)
    assert repr(again) == repr(likelihood)
    assert again.to_record() == likelihood.to_record()
    assert record["units"].keys() == likelihood.sizes.keys()


def test_likelihoods_are_equal_only_if_all_arguments_are_equal():
    assert len({*LIKELIHOODS}) == len(LIKELIHOODS)
    assert ph.Gaussian(0.5) != ph.Gaussian(0.5, observed=True)
    assert ph.Gaussian(0.5) != ph.SlopeAugmented(0.5, 0.0)
    custom = pm.CustomDist.dist(1.0, logp=lambda x, m: -((x - m) ** 2))
    assert ph.Gaussian(custom) == ph.Gaussian(custom) != ph.Gaussian(0.5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"units": {"pressure_sd": "mmHg"}}, r"the units \{'pressure_sd': 'mmHg'\}; expected"),
        ({"sigma": 1.0}, "the argument 'sigma'; expected one of"),
        ({"pressure_sd": -1.0}, "pressure_sd is -1.0"),
        ({"pressure_sd": None}, "'pressure_sd' is None"),
        ({"error_in": "radius"}, "the argument 'error_in'; expected one of"),
        ({"observed": "no"}, "observed is 'no'"),
        ({"name": "Poisson"}, "expected a record with a name of"),
    ],
)
def test_damaged_record_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        Likelihood.from_record(ph.Gaussian(0.5).to_record() | change)


def test_description_states_sizes_units_and_standard_deviations():
    assert ph.SlopeAugmented(sigma=2.0, slope_weight=3.0).in_words == (
        "SlopeAugmented: sigma = 2 kPa (a standard deviation of 1.41421 kPa), slope_weight = 3 mm²"
    )
    inferred = ph.Gaussian(radius_sd=0.05, force_sd=pm.HalfNormal.dist(1.0)).in_words
    assert inferred == "Gaussian: radius_sd = 0.05 mm, force_sd inferred, in mN"
    assert repr(ph.Gaussian(pm.HalfNormal.dist(2), observed=True)) == (
        "Gaussian(pressure_sd=HalfNormal(0, 2), observed=True)"
    )
    with pm.Model():
        assert repr(ph.Gaussian(pm.HalfNormal("sd"))) == "Gaussian(pressure_sd=sd)"


def test_number_or_distribution_becomes_the_error_of_pressures():
    sd = pm.HalfNormal.dist(1.0)
    assert as_likelihood(np.float64(0.5)) == ph.Gaussian(pressure_sd=0.5)
    assert as_likelihood(sd) == ph.Gaussian(pressure_sd=sd)


def log_likelihood_of(likelihood, data, **parameters):
    """Log likelihood of Ogden's law."""
    with pm.Model() as model:
        ph.inflation_likelihood("curves", ph.Ogden(), data, likelihood, parameters)
    return float(model["curves"].eval(mode=AS_WRITTEN))


@pytest.mark.parametrize("weight", [0.0, 0], ids=["float", "int"])
def test_gaussian_and_slope_augmented_agree_without_slopes(weight):
    """The paper's sigma is √2 standard deviations; 7.0 would be rounded in single precision."""
    sds, data = {"pressure_sd": 0.1, "force_sd": 7.0, "force_offset_sd": 25.0}, extended()
    sigmas = {"sigma": np.sqrt(2) * 0.1, "force_sigma": np.sqrt(2) * 7.0, "force_offset_sd": 25.0}
    forms = ph.Gaussian(**sds), ph.SlopeAugmented(slope_weight=weight, **sigmas)
    one, two = (log_likelihood_of(form, data, mu=6.0, alpha=5.0) for form in forms)
    assert one == pytest.approx(two, rel=ROUNDING)


def test_potential_equals_the_density_of_observed_variables():
    """Without slopes, for pressures and forces with an offset."""
    sds = {"pressure_sd": 0.4, "force_sd": 3.0, "force_offset_sd": 25.0}
    point = {"mu": 6.0, "alpha": 5.0}
    priors = {name: pm.Flat.dist() for name in point}
    values = []
    for observed in (False, True):
        likelihood = ph.Gaussian(**sds, observed=observed)
        model = ph.ogden_model(extended(), likelihood, priors=priors, mode="quadrature")
        values.append(model.compile_logp(mode=AS_WRITTEN)(point))
    assert values[0] == pytest.approx(values[1], rel=1e-9)


def test_normal_log_densities_equal_scipy():
    """Cases: sums of squares, and errors that share an offset, as conditional densities."""
    error, variance, sd = np.array([0.3, -1.2, 2.0, 0.1]), np.array([0.5, 0.7, 0.2, 0.9]), 1.5
    found = normal_log_density(error**2, variance).eval(mode=AS_WRITTEN)
    np.testing.assert_allclose(found, stats.norm(0, np.sqrt(variance)).logpdf(error))
    found = normal_log_density(np.sum(error**2), 0.7, 4.0).eval(mode=AS_WRITTEN)
    np.testing.assert_allclose(found, stats.norm(0, np.sqrt(0.7)).logpdf(error).sum())
    inputs = {"points": np.array([[0, 1, 2], [3, 0, 0]]), "place": np.array([0, 1, 2, 3])}
    inputs["there"] = np.array([[True, True, True], [True, False, False]])
    shared = {name: pytensor.shared(value) for name, value in inputs.items()}
    by_point = log_density_by_points(pytensor.shared(error), variance, sd, shared)
    covariance = np.diag(variance)
    covariance[:3, :3] += sd**2
    covariance[3, 3] += sd**2
    expected = stats.multivariate_normal(cov=covariance).logpdf(error)
    np.testing.assert_allclose(by_point.eval(mode=AS_WRITTEN).sum(), expected)


def test_one_likelihood_can_be_used_in_several_models():
    """The distribution of an error is registered anew in each model."""
    likelihood = ph.Gaussian(pm.HalfNormal.dist(1.0))
    for _ in range(2):
        model = ph.ogden_model(curves(), likelihood)
        assert [rv.name for rv in model.free_RVs] == ["mu", "alpha", "pressure_sd"]
