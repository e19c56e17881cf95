"""Models of populations whose specimens differ: priors, density and prior samples."""

import exact
import numpy as np
import pandas as pd
import pymc as pm
import pytest
from problems import AS_WRITTEN
from scipy import stats
from scipy.special import logit
from shared_errors import Dense, extended, neo_hookean, ogden, pressure_and_force

import pymc_hyperelastic as ph
from pymc_hyperelastic.data.select import specimens_of
from pymc_hyperelastic.models.class_distribution import register_class
from pymc_hyperelastic.models.natural_scale import NaturalScale

SEED = 733
# Sums and logarithms of a few numbers of order one.
ROUNDING = 1e-10
# The wall is integrated by two rules, each exact to about 1e-9 of a pressure.
DENSITY_TOLERANCE = 1e-6
# A correct distribution fails a Kolmogorov-Smirnov test at this level once in a thousand seeds.
CHANCE = 1e-3
MODE = "FAST_COMPILE"
SIGMA = 0.8


@pytest.fixture(scope="module")
def data():
    """Two specimens in alternating rows; one has two tests, at different axial stretches."""
    rng, radius, tables = np.random.default_rng(SEED), np.linspace(7.3, 9.0, 7), []
    for specimen, experiment, axial, mu, alpha in (
        ("S2", 1, 1.0, 10.0, 8.0),
        ("S1", 1, 1.0, 20.0, 5.0),
        ("S2", 2, 1.1, 11.0, 7.0),
    ):
        pressure, _ = pressure_and_force([(ogden(mu, alpha), 2.0)], radius, 7.0, np.full(7, axial))
        pressure = pressure + SIGMA / np.sqrt(2) * rng.standard_normal(radius.size)
        labels = {"specimen": specimen, "experiment": experiment, "axial_stretch": axial}
        tables.append(pd.DataFrame(labels | {"radius": radius, "pressure": pressure}))
    frame = pd.concat(tables, ignore_index=True)
    tube = ph.Tube(inner_radius=7.0, outer_radius=9.0, axial_stretch="axial_stretch")
    return ph.inflation_data(frame, tube)


def test_correlations_have_the_lkj_distribution():
    """For LKJ(2) of three coordinates, entries r have (r + 1)/2 ~ Beta(5/2, 5/2).

    With partial correlations ρ, (ρ + 1)/2 ~ Beta(5/2, 5/2) twice and Beta(2, 2) once, the
    determinant is the product of 1 - ρ², whose mean is 2 a/(2 a + 1) for Beta(a, a).
    """
    with pm.Model(coords={"coordinate": [0, 1, 2], "coordinate_2": [0, 1, 2]}) as model:
        register_class(NaturalScale(ph.Yeoh()), ph.Gaussian(1.0), False)
    drawn = pm.draw(model["correlation"], draws=3000, random_seed=SEED, mode=MODE)
    for i, j in ((1, 0), (2, 0), (2, 1)):
        assert stats.kstest((drawn[:, i, j] + 1) / 2, stats.beta(2.5, 2.5).cdf).pvalue > CHANCE
    determinant = np.linalg.det(drawn)
    error = determinant.std() / np.sqrt(len(determinant))
    assert abs(determinant.mean() - (5 / 6) ** 2 * (4 / 5)) < 4 * error
    np.testing.assert_allclose(np.einsum("nii->ni", drawn), 1, atol=ROUNDING)
    np.testing.assert_allclose(drawn, np.swapaxes(drawn, 1, 2), atol=ROUNDING)


# --- the density of the model ---------------------------------------------------------------------


def ogden_pressure(data, test, x, reference_stress):
    """Pressures of a test, with the modulus that bears the stress at the reference strain."""
    strain, alpha = np.exp(x)
    hoop = np.exp(strain)
    mu = reference_stress / (hoop * exact.ogden_response(hoop, 1.0, alpha))
    curve = exact.curves_of(data)[test]
    return mu * curve.responses("Ogden", alpha)[0][0], curve.pressure


def log_normal(value, median, sd):
    return stats.lognorm(sd, scale=median).logpdf(value).sum()


@pytest.mark.parametrize("differ", [False, True], ids=["simple", "with all effects"])
def test_density_of_a_population_equals_the_stated_distributions(data, differ):
    """Priors, correlated specimens, their experiments, noises and pressures, by SciPy."""
    sigma = pm.LogNormal.dist(np.log(0.7), 0.5) if differ else SIGMA
    variability = ph.Variability(experiment_effect=differ, reference_stress=30.0)
    settings = {"variability": variability}
    if differ:
        settings["priors"] = {"location": pm.Normal.dist([-1.0, 2.0], 0.4, shape=2)}
        settings["priors"] |= {"effect_spread": pm.Exponential.dist(3.0)}
    model = ph.population_model(ph.Ogden(), data, ph.SlopeAugmented(sigma, 0.0), **settings)
    rng = np.random.default_rng(SEED)
    specimens, of_test = specimens_of(data)
    assert specimens == ["S2", "S1"] and of_test.tolist() == [0, 1, 0]
    location, spread = np.array([-1.7, 1.8]), np.array([0.5, 0.3])
    unit, scatter, eta = 0.8, np.array([0.1, 0.2]), 0.6
    x = location + 0.2 * rng.standard_normal((2, 2))  # (specimen, coordinate)
    kappa, of_tests, noise = np.exp(rng.normal(0, 0.3, 2)), x[of_test], np.array([SIGMA, SIGMA])
    point = {
        "location": location,
        "spread_log__": np.log(spread),
        "correlation_unit_logodds__": np.array([logit(unit)]),
        "log_reference_strain": x[:, 0],
        "log_alpha": x[:, 1],
    }
    moments = ([-1.0, 2.0], 0.4) if differ else (np.log([0.2, 40 / 6]), [0.7, 1.2])
    expected = stats.norm(*moments).logpdf(location).sum()
    expected += log_normal(spread, 0.4, 0.7) + stats.beta(2, 2).logpdf(unit)
    r = 2 * unit - 1
    covariance = np.outer(spread, spread) * np.array([[1, r], [r, 1]])
    expected += stats.multivariate_normal(location, covariance).logpdf(x).sum()
    if differ:
        of_tests = of_tests + 0.05 * rng.standard_normal(of_tests.shape)
        noise = np.array([0.9, 0.6])
        point |= {
            "experiment_spread_log__": np.log(scatter),
            "effect_spread_log__": np.log(eta),
            "log_effect": np.log(kappa),
            "log_reference_strain_of_test": of_tests[:, 0],
            "log_alpha_of_test": of_tests[:, 1],
            "sigma_log__": np.log(0.75),
            "noise_spread_log__": np.log(0.35),
            "log_specimen_sigma": np.log(noise),
        }
        expected += log_normal(scatter, 0.15, 0.8) + stats.expon(scale=1 / 3).logpdf(eta)
        expected += stats.norm(0, eta).logpdf(np.log(kappa)).sum()
        within = scatter * kappa[of_test][:, None]
        expected += stats.norm(x[of_test], within).logpdf(of_tests).sum()
        expected += log_normal(0.75, 0.7, 0.5) + log_normal(0.35, 0.3, 0.5)
        expected += stats.norm(np.log(0.75), 0.35).logpdf(np.log(noise)).sum()
    for test, specimen in enumerate(of_test):
        pressure, measured = ogden_pressure(data, test, of_tests[test], 30.0)
        expected += stats.norm(pressure, noise[specimen] / np.sqrt(2)).logpdf(measured).sum()
    assert set(point) == set(model.initial_point())
    found = model.compile_logp(jacobian=False, mode=MODE)(point)
    np.testing.assert_allclose(found, expected, rtol=DENSITY_TOLERANCE)


def test_each_specimen_has_its_own_noise_for_every_signal():
    """Pressures, forces with an offset and diameters: the density of a dense normal."""
    data, sd = extended("outer_diameter"), pm.LogNormal.dist(0, 1)
    likelihood = ph.Gaussian(sd, force_sd=sd, diameter_sd=sd, force_offset_sd=25.0)
    model = ph.population_model(ph.Ogden(), data, likelihood)
    assert model.named_vars_to_dims["specimen_force_sd"] == ("specimen",)
    own = {"pressure_sd": 0.4, "force_sd": 3.0, "diameter_sd": 0.08}
    point = model.initial_point() | {f"log_specimen_{n}": np.log([v]) for n, v in own.items()}
    names = ("mu", "alpha", "specimen_pressure_sd", "specimen_diameter_sd")
    outputs = [model.logp(model.observed_RVs), *(model[name] for name in names)]
    outputs[1:] = model.replace_rvs_by_values(outputs[1:])
    settings = {"inputs": model.value_vars, "on_unused_input": "ignore", "mode": AS_WRITTEN}
    found, mu, alpha, pressure_sd, diameter_sd = model.compile_fn(outputs, **settings)(point)
    np.testing.assert_allclose([*pressure_sd, *diameter_sd], [0.4, 0.08])
    sds = own | {"force_offset_sd": 25.0}
    expected = Dense(data, [(ogden(mu[0], alpha[0]), 2.0)], **sds).log_density()
    np.testing.assert_allclose(found, expected, rtol=DENSITY_TOLERANCE)


def test_each_specimen_of_a_layered_wall_has_its_own_layers():
    """One modulus is known; a thickness that is a distribution differs between specimens."""
    thin = ph.Layer(ph.NeoHookean(), pm.LogNormal.dist(np.log(0.1), 0.2), mu=30.0)
    radius = np.linspace(1.1, 1.4, 4)
    frame = pd.DataFrame({"specimen": np.repeat(["S1", "S2"], 4), "experiment": 1})
    frame = frame.assign(radius=np.tile(radius, 2), pressure=np.tile(np.linspace(2.0, 8.0, 4), 2))
    data = ph.inflation_data(frame, ph.Tube(inner_radius=1.0))
    model = ph.population_model([thin, ph.Layer(ph.Ogden(), 0.1)], data, 0.5)
    point = model.initial_point()
    point |= {"log_thickness_1": np.log([0.08, 0.13]), "log_alpha_2": np.log([4.0, 7.0])}
    outputs = [model[name] for name in ("pressure", "thickness_1", "mu_2", "alpha_2")]
    outputs = model.replace_rvs_by_values(outputs)
    settings = {"inputs": model.value_vars, "on_unused_input": "ignore", "mode": AS_WRITTEN}
    pressure, thickness, mu, alpha = model.compile_fn(outputs, **settings)(point)
    np.testing.assert_allclose(thickness, [0.08, 0.13])
    for i, (h, own) in enumerate(zip(thickness, zip(mu, alpha, strict=True), strict=True)):
        layers = [(neo_hookean(30.0), h), (ogden(*own), 0.1)]
        expected, _ = pressure_and_force(layers, radius, 1.0, np.ones(4))
        np.testing.assert_allclose(pressure[4 * i : 4 * i + 4], expected, rtol=ROUNDING)


def test_population_is_independent_of_the_context_and_can_be_sampled(data):
    """A population model made in the context of another model shares no variables with it."""
    with pm.Model(coords={"obs": [0]}) as other:
        pm.Normal("location")
        with pytest.warns(UserWarning, match="stands by itself.*name="):
            model = ph.population_model(ph.Ogden(), data, SIGMA)
    assert [v.name for v in other.free_RVs] == ["location"]
    settings = {"random_seed": SEED, "compile_kwargs": {"mode": MODE}}
    tree = pm.sample_prior_predictive(20, model=model, **settings)
    prior = tree["prior"]
    assert prior["correlation"].dims == ("chain", "draw", "coordinate", "coordinate_2")
    assert prior["mu"].dims == prior["alpha"].dims == ("chain", "draw", "specimen")
    np.testing.assert_allclose(prior["alpha"], np.exp(prior["log_alpha"]))
    measured = tree["prior_predictive"]["measured_pressure"]
    assert measured.sizes == {"chain": 1, "draw": 20, "obs": data.sizes["obs"]}
