"""Errors that several measurements share: a diameter error and an offset of the transducer."""

import numpy as np
import pymc as pm
import pytensor
import pytest
import xarray as xr
from problems import AS_WRITTEN
from scipy import optimize, stats
from shared_errors import (
    EXTENDED,
    Dense,
    assert_predicted,
    dataset,
    extended,
    neo_hookean,
    ogden,
    pressure_and_force,
)

import pymc_hyperelastic as ph

SEED = 7
# Both sides are exact to about 1e-12 of the largest misfit, which enters as a square.
LIKELIHOOD_TOLERANCE = 1e-9
# The largest of 100 numbers exceeds 4.5 standard errors once in 1400 seeds.
STANDARD_ERRORS = 4.5

OGDEN, POINT = ph.Ogden(), {"mu": 6.0, "alpha": 5.0}
LAYERS = [(ogden(**POINT), 2.0)]
SDS = {"pressure_sd": 0.4, "force_sd": 3.0, "force_offset_sd": 25.0, "diameter_sd": 0.1}
OFFSET = {name: SDS[name] for name in ("pressure_sd", "force_sd", "force_offset_sd")}
DIAMETER = {name: sd for name, sd in SDS.items() if name != "force_offset_sd"}
PLAIN = {name: SDS[name] for name in ("pressure_sd", "force_sd")}
ERRORS = {"none": PLAIN, "offset": OFFSET, "diameter": DIAMETER, "both": SDS}


def model_of(data, energy=OGDEN, *, errors, observed=False, **settings):
    likelihood = ph.Gaussian(**errors, observed=observed)
    return ph.inflation_model(energy, data, likelihood, **settings)


def free(*names):
    """Priors without a transform, for variables that are given as numbers."""
    return {name: pm.Flat.dist() for name in names}


def unknown(noise):
    """Settings of a model in which material and errors are inferred."""
    return {"priors": free(*POINT), "errors": free(*noise), "mode": "quadrature"}


def function_of(model, outputs=None, gradient=False):
    """The log density of the measurements, or other outputs, by the free variables."""
    if outputs is None:
        outputs = [model.logp([*model.observed_RVs, *model.potentials])]
        if gradient:
            outputs += pytensor.grad(outputs[0], model.value_vars)
    else:
        outputs = model.replace_rvs_by_values(outputs)
    settings = {"mode": AS_WRITTEN, "on_unused_input": "ignore"}
    function = pytensor.function(model.value_vars, outputs, **settings)
    return lambda **point: function(*(point[rv.name] for rv in model.free_RVs))


@pytest.mark.parametrize(
    ("errors", "observed", "measured", "data_of"),
    [
        ("none", False, "radius", extended),
        ("none", True, "outer_diameter", extended),
        ("offset", False, "outer_diameter", extended),
        ("offset", True, "radius", dataset),
        ("diameter", False, "radius", dataset),
        ("diameter", True, "outer_diameter", extended),
        ("both", False, "outer_diameter", dataset),
        ("both", True, "outer_diameter", extended),
    ],
)
def test_log_likelihood_equals_the_multivariate_normal(errors, observed, measured, data_of):
    """For errors of any size that are inferred; tests have from none to all of their forces."""
    data, noise = data_of(measured=measured), ERRORS[errors]
    model = model_of(data, observed=observed, **unknown(noise))
    assert set(noise) <= {rv.name for rv in model.free_RVs}
    value = function_of(model)
    for scale in (1.0, 0.1, 30.0):
        sds = {name: sd * (scale if "force" in name else 1.0) for name, sd in noise.items()}
        expected = Dense(data, LAYERS, **sds).log_density()
        assert value(**POINT, **sds)[0] == pytest.approx(expected, rel=LIKELIHOOD_TOLERANCE)


@pytest.mark.parametrize(("errors", "observed"), [("offset", True), ("both", False)])
def test_offset_mean_and_error_equal_the_conditional_normal(errors, observed):
    """The offset of a test without a measured force has its prior."""
    data, noise = extended(), ERRORS[errors]
    model = model_of(data, observed=observed, **unknown(noise))
    assert model.named_vars_to_dims["force_offset_mean"] == ("test",)
    outputs = [model["force_offset_mean"], model["force_offset_error"]]
    mean, sd = function_of(model, outputs)(**POINT, **noise)
    expected = Dense(data, LAYERS, **noise).offsets()
    np.testing.assert_allclose(mean, expected[0], rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(sd, expected[1], rtol=1e-8)
    assert (mean[1], sd[1]) == (0.0, noise["force_offset_sd"])


def test_radius_error_compares_radii_and_forces_at_the_measured_pressure():
    """Radii and forces are those of the tube at the measured pressure and stretch.

    A warning says that flat priors cannot be drawn from. The radius is found here by bisection,
    and the offset follows by Bayes' rule for normals.
    """
    data = extended()
    axial, measured = data["axial_stretch"].values, data["radius"].values
    true = measured + np.random.default_rng(2).normal(0, 0.1, data.sizes["obs"])
    data["pressure"].values[:], _ = pressure_and_force(LAYERS, true, 7.0, axial)

    def excess(radius, axial, pressure):
        of_wall = LAYERS, np.array([radius]), 7.0, np.array([axial])
        return pressure_and_force(*of_wall)[0].item() - pressure

    each = zip(axial, data["pressure"].values, strict=True)
    radius = np.array([optimize.brentq(excess, 6, 10, args=a, xtol=1e-13) for a in each])
    force = pressure_and_force(LAYERS, radius, 7.0, axial)[1]
    errors = {"radius_sd": 0.1, "force_sd": 3.0, "force_offset_sd": 25.0}
    with pytest.warns(UserWarning, match=r"cannot be drawn from.*32 nodes"):
        model = model_of(data, errors=errors, priors=free(*POINT))
    outputs = [*model.potentials, model["force_offset_mean"], model["force_offset_error"]]
    found, mean, error = function_of(model, outputs)(**POINT)
    expected = stats.norm.logpdf(measured, radius, 0.1).sum()
    for test in range(data.sizes["test"]):
        own = (data["test"].values == test) & np.isfinite(data["axial_force"].values)
        errors, number = (data["axial_force"].values - force)[own], own.sum()
        if number:
            covariance = 3.0**2 * np.eye(number) + 25.0**2
            expected += stats.multivariate_normal(cov=covariance).logpdf(errors)
        precision = 1 / 25.0**2 + number / 3.0**2
        assert mean[test] == pytest.approx(errors.sum() / 3.0**2 / precision, rel=1e-6)
        assert error[test] == pytest.approx(precision**-0.5, rel=1e-9)
    assert found == pytest.approx(expected, rel=1e-7)


def test_likelihood_of_layers_of_unknown_geometry_has_shared_errors():
    data = dataset(measured="outer_diameter", outer_radius=None)
    media = ph.Layer(ph.NeoHookean(), 1.2, mu=pm.Flat.dist())
    adventitia = ph.Layer(OGDEN, pm.Flat.dist(), mu=4.0, alpha=5.0)
    settings = {"priors": free("inner_radius"), "observed": True, "mode": "quadrature"}
    model = model_of(data, [media, adventitia], errors=SDS, **settings)
    function = function_of(model)
    (found,) = function(mu_1=20.0, thickness_2=0.7, inner_radius=7.1)
    layers = [(neo_hookean(20.0), 1.2), (ogden(4.0, 5.0), 0.7)]
    expected = Dense(data, layers, 7.1, **SDS).log_density()
    assert found == pytest.approx(expected, rel=LIKELIHOOD_TOLERANCE)
    # A layer without thickness, and a wall that does not fit into the measured diameter.
    for thickness in (-0.1, 0.0, 9.0):
        assert function(mu_1=20.0, thickness_2=thickness, inner_radius=7.1) == [-np.inf]


@pytest.mark.parametrize("errors", ["none", "offset", "both"])
def test_each_signal_alone_has_its_marginal_density(errors):
    """Forces alone have the full variance of the errors that they share with pressures."""
    data, sds = extended(), ERRORS[errors]
    likelihood = ph.Gaussian(**sds)
    priors = {"mu": pm.Uniform.dist(3, 9), "alpha": pm.Uniform.dist(4, 6)}
    forward = likelihood.forward_model(OGDEN, data, priors, mode="collocation")
    normal, points = Dense(data, LAYERS, **sds), data.sizes["obs"]
    rows = {("pressure",): slice(points), ("force",): slice(points, None)}
    for signals, own in (rows | {("pressure", "force"): slice(None)}).items():
        log_likelihood = likelihood.log_likelihood(forward.with_variables(POINT), signals=signals)
        function = pytensor.function([], log_likelihood, mode=AS_WRITTEN)
        expected = normal.log_density(own)
        assert function() == pytest.approx(expected, rel=LIKELIHOOD_TOLERANCE)


def test_gradient_equals_differences_and_is_zero_where_curves_overflow():
    """The gradient is taken by material and errors; variances depend on both."""
    model = model_of(extended("outer_diameter"), observed=True, **unknown(SDS))
    function, point = function_of(model, gradient=True), POINT | SDS
    _, *gradient = function(**point)
    for rv, found in zip(model.free_RVs, gradient, strict=True):
        ends = (point | {rv.name: point[rv.name] * factor} for factor in (1 + 1e-5, 1 - 1e-5))
        up, down = (function(**end)[0] for end in ends)
        assert found == pytest.approx((up - down) / (2e-5 * point[rv.name]), rel=1e-5)
    with np.errstate(all="ignore"):
        value, *gradient = function(**point | {"alpha": 4900.0})
    material = [g for rv, g in zip(model.free_RVs, gradient, strict=True) if rv.name in POINT]
    assert value == -np.inf and not np.any(material)


def test_force_offsets_draws_normals_with_the_stored_mean_and_error():
    of_test, shape = ("chain", "draw", "test"), (1, 4000, 2)
    stored = {"force_offset_mean": [3.0, -8.0], "force_offset_error": [0.1, 2.0]}
    posterior = {name: (of_test, np.broadcast_to(v, shape)) for name, v in stored.items()}
    tree = xr.DataTree.from_dict({"posterior": xr.Dataset(posterior)})
    drawn = ph.force_offsets(tree)["force_offset"].values[0]
    mean, error = stored.values()
    standard = (drawn - mean) / error
    assert np.abs(standard.mean(axis=0)).max() < STANDARD_ERRORS / np.sqrt(4000)
    assert np.abs(standard.std(axis=0) - 1).max() < STANDARD_ERRORS / np.sqrt(2 * 4000)


def test_predictions_share_offsets_and_errors_of_diameters():
    model = model_of(extended(), observed=True, mode="quadrature", errors=SDS)
    normal = Dense(extended(), LAYERS, **SDS)
    assert_predicted(model, POINT, normal.mean, normal.covariance, 600, SEED)


def test_extension_tests_contribute_no_slopes_to_the_likelihood():
    """Extension tests add the same term to a likelihood with and without slopes."""
    tests = {"both": [0, 1, 2, 3], "inflation": [1, 2], "extension": list(EXTENDED)}
    data = {name: ph.select(extended(), experiment=own) for name, own in tests.items()}
    weights = [ph.balanced_slope_weight(data[name]) for name in ("both", "inflation")]
    assert weights[0] == weights[1]
    priors = {"mu": pm.Uniform.dist(1, 20), "alpha": pm.Uniform.dist(2, 8)}
    for mode in ("quadrature", "collocation"):
        found = {}
        for name, slope_weight in (("both", 2.0), ("inflation", 2.0), ("extension", 0.0)):
            likelihood = ph.SlopeAugmented(sigma=0.5, slope_weight=slope_weight)
            forward = likelihood.forward_model(OGDEN, data[name], priors, mode=mode)
            log_likelihood = likelihood.log_likelihood(forward.with_variables(POINT))
            found[name] = log_likelihood.eval(mode=AS_WRITTEN)
        together = found["inflation"] + found["extension"]
        assert found["both"] == pytest.approx(together, rel=LIKELIHOOD_TOLERANCE)
