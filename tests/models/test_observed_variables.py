"""Measured pressures and forces as observed variables: their density, draws and predictions."""

from dataclasses import replace

import arviz as az
import exact
import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
import pytest
import xarray as xr
from problems import AS_WRITTEN
from pytensor.graph.replace import clone_replace
from scipy.linalg import block_diag
from scipy.stats import multivariate_normal
from shared_errors import assert_predicted
from test_slope_augmented import FRAMES, dataset

import pymc_hyperelastic as ph

FAST = "FAST_COMPILE"
SEED = 515
SIGMA = 1.3
POINT = {"mu": 30.0, "alpha": 7.0}
# The pressures are exact to about 1e-12 of the largest, which enters as a square.
DENSITY_TOLERANCE = 1e-9
# Central differences with a step relative to the parameter err by its square, times a few dozen.
STEP, GRADIENT_TOLERANCE = 1e-4, 1e-5


def generative(data, **settings):
    errors = {"sigma": SIGMA, "slope_weight": 3, "observed": True}
    errors |= {name: settings.pop(name) for name in ("sigma", "slope_weight") if name in settings}
    errors |= {"force_sigma": settings.pop("force_sigma", None)}
    return ph.inflation_model(ph.Ogden(), data, ph.SlopeAugmented(**errors), **settings)


def density_of(model, *names, gradient=False):
    """Log density of every measured value, perhaps with the gradient of the sum, as a function."""
    variable = model["measured_pressure"]
    logp = pm.logp(variable, model.rvs_to_values[variable])
    inputs = {model[name]: pt.dscalar(name) for name in names}
    logp = clone_replace(logp, inputs)
    inputs = list(inputs.values())
    outputs = [logp, *pytensor.grad(logp.sum(), inputs)] if gradient else logp
    return pytensor.function(inputs, outputs, mode=AS_WRITTEN)


def exact_normals(data, mu, alpha, slope_weight, sigma=SIGMA):
    """Mean, covariance and values of each test."""
    tests = []
    for test, curve in enumerate(exact.curves_of(data)):
        own, measured = data["test"].values == test, curve.radius
        if "outer_diameter" in data:
            measured = data["outer_diameter"].values[own] / 2
        difference = replace(curve, radius=measured).differences()
        pressure, stiffness = (mu * unit[0] for unit in curve.responses("Ogden", alpha))
        slope = (stiffness * measured / curve.radius)[1:-1]
        precision = np.eye(len(measured)) + slope_weight * difference.T @ difference
        mean = np.linalg.solve(precision, pressure + slope_weight * difference.T @ slope)
        tests.append((mean, sigma**2 / 2 * np.linalg.inv(precision), curve.pressure))
    return tests


def exact_log_densities(*arguments, **settings):
    """Log density of each point, given those before it in its test."""
    values = []
    for mean, cov, y in exact_normals(*arguments, **settings):
        ends = range(1, len(y) + 1)
        joint = [multivariate_normal(mean[:n], cov[:n, :n]).logpdf(y[:n]) for n in ends]
        values += [joint[0], *np.diff(joint)]
    return np.array(values)


@pytest.mark.parametrize(
    ("slope_weight", "mode", "measured"),
    [
        (0, "quadrature", "radius"),
        (0.5, "collocation", "outer_diameter"),
        (3, "collocation", "radius"),
        (3, "quadrature", "outer_diameter"),
    ],
)
def test_density_of_observed_pressures_equals_the_multivariate_normal(slope_weight, mode, measured):
    """For tests of different tubes with 6 to 12 points, and inferred noise of any size."""
    data = dataset(*FRAMES, measured=measured)
    noise = {"sigma": pm.HalfNormal.dist(2), "slope_weight": slope_weight}
    function = density_of(generative(data, mode=mode, **noise), "mu", "alpha", "sigma")
    for mu, alpha, sigma in ((30.0, 7.0, SIGMA), (6.0, -8.0, 20.0), (80.0, 0.0, SIGMA)):
        expected = exact_log_densities(data, mu, alpha, slope_weight, sigma=sigma)
        found = function(mu, alpha, sigma)
        # The densities are differences of cumulative sums: rounding is relative to the largest sum.
        atol = DENSITY_TOLERANCE * np.abs(np.cumsum(expected)).max()
        np.testing.assert_allclose(found, expected, rtol=0, atol=atol)


def test_gradient_equals_differences_and_is_zero_where_pressures_overflow():
    priors = {"mu": pm.Uniform.dist(0, 100), "alpha": pm.Uniform.dist(0, 5000)}
    settings = {"sigma": pm.HalfNormal.dist(2), "mode": "quadrature"}
    model = generative(dataset(*FRAMES), priors=priors, **settings)
    point = POINT | {"sigma": SIGMA}
    function = density_of(model, *point, gradient=True)
    _, *gradient = function(**point)
    for name, found in zip(point, gradient, strict=True):
        ends = (point | {name: point[name] * factor} for factor in (1 + STEP, 1 - STEP))
        above, below = (function(**end)[0].sum() for end in ends)
        slope = (above - below) / (2 * STEP * point[name])
        assert found == pytest.approx(slope, rel=GRADIENT_TOLERANCE)
    with np.errstate(all="ignore"):
        value, *gradient = function(mu=30.0, alpha=4900.0, sigma=1.0)
    assert np.all(value == -np.inf)
    np.testing.assert_array_equal(gradient, 0.0)


def test_posterior_predictions_have_the_exact_mean_and_covariance():
    data = dataset(*FRAMES)
    means, covariances, _ = zip(*exact_normals(data, *POINT.values(), 3), strict=True)
    normal = np.concatenate(means), block_diag(*covariances)
    assert_predicted(generative(data), POINT, *normal, 1000, SEED)


def test_arviz_computes_loo_and_predictive_checks_of_a_result():
    """`az.loo` leaves out single points, and `az.plot_ppc_dist` shows drawn predictions."""
    data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1", experiment=1)
    model = generative(data, sigma=15 * ph.mmHg)
    rng = np.random.default_rng(SEED)
    draws = {"mu": rng.normal(30.0, 0.05, (1, 300)), "alpha": rng.normal(7.0, 0.01, (1, 300))}
    posterior = xr.Dataset({name: (("chain", "draw"), x) for name, x in draws.items()})
    tree = xr.DataTree.from_dict({"posterior": posterior})
    tree["observed_data"] = model.study.result_groups(model)["observed_data"]
    quickly = {"compile_kwargs": {"mode": FAST}, "progressbar": False}
    with model:
        pm.sample_posterior_predictive(tree, extend_inferencedata=True, random_seed=1, **quickly)
        pm.compute_log_likelihood(tree, **quickly)
    assert az.loo(tree).n_data_points == data.sizes["obs"]
    plot = az.plot_ppc_dist(tree, backend="none")
    assert "measured_pressure" in plot.viz["observed_dist"].data_vars


def test_set_data_replaces_measured_values_in_density_and_results():
    """A compiled model follows its `pm.Data`, and results hold the values that were used."""
    data = dataset(*FRAMES)
    model = generative(data, force_sigma=20.0)
    logp, point = model.compile_logp(mode=FAST), model.initial_point()
    new = data.assign(pressure=data["pressure"] * 1.1 + 0.3, axial_force=data["axial_force"] * 0.9)
    rows = np.isfinite(new["axial_force"].values)
    with model:
        values = new["pressure"].values, new["axial_force"].values[rows]
        pm.set_data(dict(zip(("pressure_data", "axial_force_data"), values, strict=True)))
    expected = generative(new, force_sigma=20.0).compile_logp(mode=FAST)(point)
    assert logp(point) == pytest.approx(expected, rel=DENSITY_TOLERANCE)
    groups = model.study.result_groups(model)
    xr.testing.assert_equal(groups["constant_data"], new)
    measured = groups["observed_data"]["measured_pressure"].values
    np.testing.assert_array_equal(measured, new["pressure"].values)
