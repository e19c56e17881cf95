"""Errors that measurements share, where the axial stretch varies within some tests."""

import numpy as np
import pymc as pm
import pytensor
import pytest
from problems import AS_WRITTEN
from scipy import stats
from shared_errors import EXTENDED, Dense, extended, ogden, pressure_and_force

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.forward.collocated import Collocated
from pymc_hyperelastic.models.observation import Observation

# Both sides are exact to about 1e-12 of the largest misfit, which enters as a square.
LIKELIHOOD_TOLERANCE = 1e-9

POINT = {"mu": 6.0, "alpha": 5.0}
LAYERS = [(ogden(**POINT), 2.0)]
SDS = {"noise_sd": 0.4, "force_noise_sd": 3.0, "force_offset_sd": 25.0, "diameter_noise_sd": 0.1}
# Which of the shared errors there are.
ERRORS = {
    "offset": {name: sd for name, sd in SDS.items() if name != "diameter_noise_sd"},
    "diameter": {name: sd for name, sd in SDS.items() if name != "force_offset_sd"},
    "both": SDS,
}


def parts(measured="radius"):
    """All tests, the extension tests alone, and the inflation tests alone."""
    both = extended(measured)
    held = [test for test in range(both.sizes["test"]) if test not in EXTENDED]
    return both, *(ph.select(both, experiment=list(part)) for part in (EXTENDED, held))


def dense(data, sds):
    names = {"noise_sd": "noise", "force_noise_sd": "force_noise"}
    names |= {"force_offset_sd": "offset", "diameter_noise_sd": "diameter"}
    return Dense(data, LAYERS, **{names[name]: sd for name, sd in sds.items()})


def exact(normal, rows=slice(None)):
    mean, covariance = normal.mean[rows], normal.covariance[rows, rows]
    return stats.multivariate_normal(mean, covariance).logpdf(normal.values[rows])


def forward_of(data, sds, mode, **settings):
    """What is observed with these errors, and the forward model of such data."""
    observation = Observation(**sds, **settings)
    priors = {"mu": pm.Uniform.dist(3, 9), "alpha": pm.Uniform.dist(4, 6)}
    return observation, observation.forward_model(ph.Ogden(), data, priors, mode=mode)


def evaluated(*outputs):
    return pytensor.function([], outputs, mode=AS_WRITTEN)()


@pytest.mark.parametrize("measured", ["radius", "outer_diameter"])
@pytest.mark.parametrize("mode", ["quadrature", "collocation"])
@pytest.mark.parametrize("errors", ERRORS)
def test_log_likelihood_is_that_of_the_multivariate_normal(errors, mode, measured):
    """Of tests of both kinds, and of extension tests alone, at the stretch of each point."""
    for data in parts(measured)[:2]:
        observation, forward = forward_of(data, ERRORS[errors], mode)
        assert isinstance(forward.way, Collocated) == (mode == "collocation")
        (found,) = evaluated(observation.log_likelihood(forward.tube(POINT)))
        expected = exact(dense(data, ERRORS[errors]))
        assert found == pytest.approx(expected, rel=LIKELIHOOD_TOLERANCE)


@pytest.mark.parametrize("errors", ERRORS)
def test_tests_of_one_kind_may_take_the_place_of_both(errors):
    """The same compiled function, where none is of the other kind."""
    data, *apart = parts()
    observation, forward = forward_of(data, ERRORS[errors], "collocation")
    log_likelihood = observation.log_likelihood(forward.tube(POINT))
    function = pytensor.function([], log_likelihood, mode=AS_WRITTEN)
    for part in (*apart, data):
        forward.set_data(part)
        expected = exact(dense(part, ERRORS[errors]))
        assert function() == pytest.approx(expected, rel=LIKELIHOOD_TOLERANCE)


def flat_model(data, **settings):
    priors = {name: pm.Flat.dist() for name in POINT}
    return ph.inflation_model(ph.Ogden(), data, slope_weight=0, priors=priors, **settings)


def function_of(model, outputs):
    """Outputs of a model as a function of what is inferred."""
    outputs = model.replace_rvs_by_values(outputs)
    settings = {"mode": AS_WRITTEN, "on_unused_input": "ignore"}
    return pytensor.function(model.value_vars, outputs, **settings)


@pytest.mark.parametrize("errors", ERRORS)
def test_generative_densities_and_offsets_are_those_of_the_multivariate_normal(errors):
    """An extension test has an offset of its own as others do."""
    data, sds = extended(), ERRORS[errors]
    model = flat_model(data, likelihood="generative", mode="quadrature", **sds)
    known = [model[n] for n in ("force_offset_mean", "force_offset_error") if n in model.named_vars]
    outputs = [model.logp([*model.observed_RVs, *model.potentials]), *known]
    found, *known = function_of(model, outputs)(*POINT.values())
    normal = dense(data, sds)
    assert found == pytest.approx(exact(normal), rel=LIKELIHOOD_TOLERANCE)
    assert bool(known) == ("force_offset_sd" in sds)
    for values, expected in zip(known, normal.offsets(), strict=False):
        np.testing.assert_allclose(values, expected, rtol=1e-8, atol=1e-8)


def test_offsets_with_the_error_in_the_radius_are_those_at_the_radius_of_the_model():
    """The likelihood compares forces there, and what is learned of offsets says the same."""
    data = extended()
    radius = data["radius"].values + np.random.default_rng(2).normal(0, 0.1, data.sizes["obs"])
    axial = data["axial_stretch"].values
    data["pressure"].values[:], force = pressure_and_force(LAYERS, radius, 7.0, axial)
    sds = {"noise_sd": 0.1, "force_noise_sd": 3.0, "force_offset_sd": 25.0}
    model = flat_model(data, error_in="radius", **sds)
    outputs = [*model.potentials, model["force_offset_mean"], model["force_offset_error"]]
    found, mean, error = function_of(model, outputs)(*POINT.values())
    expected = stats.norm.logpdf(data["radius"].values, radius, sds["noise_sd"]).sum()
    for test in range(data.sizes["test"]):
        own = (data["test"].values == test) & np.isfinite(data["axial_force"].values)
        errors, number = (data["axial_force"].values - force)[own], own.sum()
        precision = 1 / 25.0**2 + number / 3.0**2
        assert mean[test] == pytest.approx(errors.sum() / 3.0**2 / precision, rel=1e-6)
        assert error[test] == pytest.approx(precision**-0.5, rel=1e-9)
        if number:
            covariance = 3.0**2 * np.eye(number) + 25.0**2
            expected += stats.multivariate_normal(cov=covariance).logpdf(errors)
    assert found == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("errors", ERRORS)
def test_signals_by_themselves_have_their_marginal_density(errors):
    """Switched off, pressures say nothing of the forces that share an error with them."""
    data, sds = extended(), ERRORS[errors]
    observation, forward = forward_of(data, sds, "collocation")
    switches = {name: pytensor.shared(1.0) for name in observation.signals}
    log_likelihood = observation.log_likelihood(forward.tube(POINT), switches)
    function = pytensor.function([], log_likelihood, mode=AS_WRITTEN)
    normal, points = dense(data, sds), data.sizes["obs"]
    rows = {("pressure",): slice(points), ("force",): slice(points, None)}
    for on, own in (rows | {("pressure", "force"): slice(None)}).items():
        for name, switch in switches.items():
            switch.set_value(float(name in on))
        assert function() == pytest.approx(exact(normal, own), rel=LIKELIHOOD_TOLERANCE)
