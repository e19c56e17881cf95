"""Classes whose specimens differ: coordinates of a specimen, priors, and the density of a model."""

import arviz as az
import exact
import matplotlib as mpl
import numpy as np
import pandas as pd
import pymc as pm
import pytest
from scipy import stats
from scipy.special import logit

import pymc_hyperelastic as ph
from pymc_hyperelastic.data.select import specimens_of
from pymc_hyperelastic.models.class_distribution import register_class
from pymc_hyperelastic.models.natural_scale import NaturalScale
from pymc_hyperelastic.models.observation import Observation

mpl.use("Agg")

SEED = 733
# Sums and logarithms of a few numbers of order one.
ROUNDING = 1e-10
# The wall is integrated by two rules, each exact to about 1e-9 of a pressure.
DENSITY_TOLERANCE = 1e-6
# A right distribution fails a test of Kolmogorov and Smirnov at this once in a thousand seeds.
CHANCE = 1e-3
# Compiled sooner than the time that C or Numba would save.
MODE = "FAST_COMPILE"
TUBE = {"inner_radius": 7.0, "outer_radius": 9.0}
SIGMA = 0.8


def inflation(tests, sigma=0.0):
    """Tests of tubes: (specimen, experiment, axial stretch, Ogden parameters) of each."""
    rng = np.random.default_rng(SEED)
    tables = []
    for specimen, experiment, axial, parameters in tests:
        radius = np.linspace(7.3, 9.0, 7)
        pressure = ph.inflation_pressure(
            ph.Ogden(), radius, axial_stretch=axial, **TUBE, **parameters
        ).eval(mode=MODE)
        pressure = pressure + sigma / np.sqrt(2) * rng.standard_normal(radius.size)
        labels = {"specimen": specimen, "experiment": experiment, "axial_stretch": axial}
        tables.append(pd.DataFrame(labels | {"radius": radius, "pressure": pressure}))
    frame = pd.concat(tables, ignore_index=True)
    return ph.inflation_data(frame, axial_stretch="axial_stretch", **TUBE)


@pytest.fixture(scope="module")
def data():
    """Two specimens, which take turns: one has two tests, at different axial stretches."""
    return inflation(
        [
            ("S2", 1, 1.0, {"mu": 10.0, "alpha": 8.0}),
            ("S1", 1, 1.0, {"mu": 20.0, "alpha": 5.0}),
            ("S2", 2, 1.1, {"mu": 11.0, "alpha": 7.0}),
        ],
        SIGMA,
    )


class EitherSign(ph.StrainEnergy):
    """A law with a modulus that may be negative beside one that may not."""

    parameters = (
        ph.Parameter("c1", "c_1", "kPa", (0.0, 100.0), "modulus"),
        ph.Parameter("c2", "c_2", "kPa", (-50.0, 50.0), "modulus of either sign"),
    )

    def energy(self, radial, hoop, axial, *, c1, c2):
        excess = radial**2 + hoop**2 + axial**2 - 3
        return c1 * excess + c2 * excess**2


def test_moduli_have_to_be_positive(data):
    """Else stress at the reference strain would be another than the reference stress."""
    with pytest.raises(ValueError, match=r"'c2' of EitherSign .*'real'.*prior_range above zero"):
        ph.population_model(EitherSign(), data, sigma=SIGMA)


# --- the correlation of a class -------------------------------------------------------------------


@pytest.fixture(scope="module")
def correlations():
    with pm.Model(coords={"coordinate": [0, 1, 2], "coordinate_2": [0, 1, 2]}) as model:
        register_class(NaturalScale(ph.Yeoh()), Observation(1.0), False)
    return pm.draw(model["correlation"], draws=4000, random_seed=SEED, mode=MODE)


@pytest.mark.parametrize(("i", "j"), [(1, 0), (2, 0), (2, 1)])
def test_correlations_have_the_marginals_of_lkj(correlations, i, j):
    """Each entry r of a matrix with density det(R) has (r + 1)/2 ~ Beta(5/2, 5/2) in 3-D."""
    shape = 2 + (3 - 2) / 2
    r = correlations[:, i, j]
    assert stats.kstest((r + 1) / 2, stats.beta(shape, shape).cdf).pvalue > CHANCE


def test_determinant_of_the_correlation_has_the_distribution_of_lkj(correlations):
    """The determinant is that of LKJ(2): a product of independent 1 − r², by expectation."""
    # Lewandowski, Kurowicka and Joe: partial correlations Beta(2 + 1/2) twice and Beta(2) once.
    # E[1 − ρ²] = 4 E[b (1 − b)] = 2 a / (2 a + 1).
    expected = (5 / 6) ** 2 * (4 / 5)
    determinant = np.linalg.det(correlations)
    error = determinant.std() / np.sqrt(len(determinant))
    assert abs(determinant.mean() - expected) < 4 * error
    np.testing.assert_allclose(np.einsum("nii->ni", correlations), 1, atol=ROUNDING)
    np.testing.assert_allclose(correlations, np.swapaxes(correlations, 1, 2), atol=ROUNDING)


# --- the density of the model ---------------------------------------------------------------------


def ogden_pressure(data, test, x, reference_stress):
    """Pressures of a test, the modulus from the reference strain by the closed form of stress."""
    strain, alpha = np.exp(x)
    hoop = np.exp(strain)
    mu = reference_stress / (hoop * exact.ogden_response(hoop, 1.0, alpha))
    points = data["test"].values == test
    return points, ph.inflation_pressure(
        ph.Ogden(),
        data["radius"].values[points],
        axial_stretch=float(data["axial_stretch"][test]),
        mu=mu,
        alpha=alpha,
        **TUBE,
    ).eval(mode=MODE)


def log_normal(value, median, sd):
    return stats.lognorm(sd, scale=median).logpdf(value).sum()


@pytest.mark.parametrize("inferred", [False, True], ids=["known noise", "unknown noise"])
@pytest.mark.parametrize("effect", [False, True], ids=["one material", "experiments differ"])
def test_density_is_that_of_the_stated_model(data, inferred, effect):
    """Priors, correlated specimens, their experiments and the measured pressures, by SciPy."""
    sigma = pm.LogNormal.dist(np.log(0.7), 0.5) if inferred else SIGMA
    model = ph.population_model(
        ph.Ogden(), data, sigma=sigma, experiment_effect=effect, reference_stress=30.0
    )
    rng = np.random.default_rng(SEED)
    specimens, of_test = specimens_of(data)
    assert specimens == ["S2", "S1"] and of_test.tolist() == [0, 1, 0]
    location = np.array([-1.7, 1.8])
    spread = np.array([0.5, 0.3])
    unit, scatter, eta = 0.8, np.array([0.1, 0.2]), 0.6
    x = location + 0.2 * rng.standard_normal((2, 2))  # (specimen, coordinate)
    kappa = np.exp(rng.normal(0, 0.3, 2))
    of_tests = x[of_test]
    point = {
        "location": location,
        "spread_log__": np.log(spread),
        "correlation_unit_logodds__": np.array([logit(unit)]),
        "log_reference_strain": x[:, 0],
        "log_alpha": x[:, 1],
    }
    median = np.log([0.2, 40 / 6])
    expected = stats.norm(median, [0.7, 1.2]).logpdf(location).sum()
    expected += log_normal(spread, 0.4, 0.7) + stats.beta(2, 2).logpdf(unit)
    r = 2 * unit - 1
    covariance = np.outer(spread, spread) * np.array([[1, r], [r, 1]])
    expected += stats.multivariate_normal(location, covariance).logpdf(x).sum()
    if effect:
        of_tests = of_tests + 0.05 * rng.standard_normal(of_tests.shape)
        point |= {
            "experiment_spread_log__": np.log(scatter),
            "effect_spread_log__": np.log(eta),
            "log_effect": np.log(kappa),
            "log_reference_strain_of_test": of_tests[:, 0],
            "log_alpha_of_test": of_tests[:, 1],
        }
        expected += log_normal(scatter, 0.15, 0.8) + log_normal(eta, 0.5, 0.5)
        expected += stats.norm(0, eta).logpdf(np.log(kappa)).sum()
        within = scatter * kappa[of_test][:, None]
        expected += stats.norm(x[of_test], within).logpdf(of_tests).sum()
    noise = np.array([SIGMA, SIGMA])
    if inferred:
        noise = np.array([0.9, 0.6])
        point |= {
            "sigma_log__": np.log(0.75),
            "noise_spread_log__": np.log(0.35),
            "log_specimen_sigma": np.log(noise),
        }
        expected += log_normal(0.75, 0.7, 0.5) + log_normal(0.35, 0.3, 0.5)
        expected += stats.norm(np.log(0.75), 0.35).logpdf(np.log(noise)).sum()
    for test, specimen in enumerate(of_test):
        points, pressure = ogden_pressure(data, test, of_tests[test], 30.0)
        measured = data["pressure"].values[points]
        expected += stats.norm(pressure, noise[specimen] / np.sqrt(2)).logpdf(measured).sum()
    assert set(point) == set(model.initial_point())
    np.testing.assert_allclose(
        model.compile_logp(jacobian=False, mode=MODE)(point), expected, rtol=DENSITY_TOLERANCE
    )


def test_priors_of_a_class_may_be_given(data):
    """Other priors take the place of the default ones, and keep the dimension of coordinates."""
    priors = {
        "location": pm.Normal.dist([-1.0, 2.0], 0.1, shape=2),
        "spread": pm.HalfNormal.dist(0.3, shape=2),
        "experiment_spread": pm.Gamma.dist(2, 10, shape=2),
        "effect_spread": pm.Exponential.dist(3.0),
    }
    model = ph.population_model(
        ph.Ogden(), data, sigma=SIGMA, experiment_effect=True, priors=priors
    )
    value = {"location": [-1.1, 2.1], "spread": [0.2, 0.4], "experiment_spread": [0.1, 0.3]}
    value["effect_spread"] = 0.5
    expected = {
        "location": stats.norm([-1.0, 2.0], 0.1),
        "spread": stats.halfnorm(scale=0.3),
        "experiment_spread": stats.gamma(2, scale=1 / 10),
        "effect_spread": stats.expon(scale=1 / 3),
    }
    for name, distribution in expected.items():
        assert model.named_vars_to_dims.get(name, ()) == (
            () if name == "effect_spread" else ("coordinate",)
        )
        density = pm.logp(model[name], value[name]).eval(mode=MODE)
        np.testing.assert_allclose(density, distribution.logpdf(value[name]), rtol=1e-6)


# --- sampling -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def model(data):
    return ph.population_model(ph.Ogden(), data, sigma=SIGMA)


def test_model_stands_by_itself_in_the_context_of_another(data):
    """Neither model takes over the other's variables, nor minds their names."""
    with pm.Model(coords={"obs": [0]}) as other:
        pm.Normal("location")
        with pytest.warns(UserWarning, match="stands by itself.*name="):
            model = ph.population_model(ph.Ogden(), data, sigma=SIGMA)
    assert [v.name for v in other.free_RVs] == ["location"]
    assert model["location"] in model.free_RVs and not other.observed_RVs


def test_prior_predictive_sampling_runs(model, data):
    """Class, specimens, their material parameters and measurements all have draws."""
    tree = pm.sample_prior_predictive(
        50, model=model, random_seed=SEED, compile_kwargs={"mode": MODE}
    )
    prior = tree["prior"]
    assert prior["location"].dims == ("chain", "draw", "coordinate")
    assert prior["correlation"].dims == ("chain", "draw", "coordinate", "coordinate_2")
    assert prior["mu"].dims == prior["alpha"].dims == ("chain", "draw", "specimen")
    np.testing.assert_allclose(prior["alpha"], np.exp(prior["log_alpha"]))
    measured = tree["prior_predictive"]["measured_pressure"]
    assert measured.sizes == {"chain": 1, "draw": 50, "obs": data.sizes["obs"]}


@pytest.fixture(scope="module")
def tree(model):
    return ph.sample_smc(model, 100, 1, random_seed=SEED, progressbar=False)


@pytest.mark.deep
def test_model_can_be_sampled(tree):
    """Sequential Monte Carlo gives specimens by name, each near the parameters of its curve."""
    posterior = tree["posterior"].to_dataset()
    assert posterior["mu"].dims == ("chain", "draw", "specimen")
    assert posterior["specimen"].values.tolist() == ["S2", "S1"]
    assert posterior["coordinate"].values.tolist() == ["log_reference_strain", "log_alpha"]
    assert posterior["spread"].dims == ("chain", "draw", "coordinate")
    alpha = posterior["alpha"].sel(specimen="S1")
    assert abs(float(alpha.mean()) - 5.0) < 4 * float(alpha.std())
    assert np.isfinite(ph.log_evidence(tree).value)


@pytest.mark.deep
def test_whose_curve_is_predicted(tree):
    """It is that of the typical specimen, or of the one asked for; draws alone tell no scale."""
    assert ph.predict_pressure(tree, [7.5], axial_stretch=1.0).attrs["specimen"] == "typical"
    found = ph.predict_pressure(tree, [7.5], specimen="S1")["pressure"]
    own = tree["posterior"].to_dataset().sel(specimen="S1", drop=True)[["mu", "alpha"]]
    alone = az.convert_to_datatree(own)
    expected = ph.predict_pressure(alone, [7.5], energy=ph.Ogden(), **TUBE)["pressure"]
    np.testing.assert_allclose(found, expected, rtol=ROUNDING)
    bare = tree.copy()
    bare.attrs = {}
    with pytest.raises(ValueError, match="specimen='S1'"):
        ph.predict_pressure(bare, [7.5], energy=ph.Ogden(), **TUBE)


# --- bad input ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"priors": {"mu": pm.Uniform.dist(0, 50)}}, ValueError, "prior is given for 'mu'.*spread"),
        (
            {"priors": {"location": pm.Normal.dist(0, 1)}},
            TypeError,
            "'location' has the shape .*2 entries, as with shape=2",
        ),
        (
            {"priors": {"spread": pm.HalfNormal.dist(1, shape=3)}},
            TypeError,
            "'spread' has the shape .*2 entries",
        ),
        (
            {
                "experiment_effect": True,
                "priors": {"effect_spread": pm.HalfNormal.dist(1, shape=2)},
            },
            TypeError,
            "'effect_spread' has the shape .*a scalar",
        ),
        (
            {"priors": {"effect_spread": pm.HalfNormal.dist(1)}},
            ValueError,
            r"'effect_spread'; this class has the unknowns \['location', 'spread'\]",
        ),
        ({"priors": [1]}, TypeError, "priors must be a dict"),
        ({"reference_stress": "20"}, ValueError, "reference_stress is '20'"),
        ({"priors": {"spread": 0.4}}, TypeError, "'spread' is 0.4; expected a distribution"),
        ({"reference_stress": 0.0}, ValueError, "reference_stress is 0.0; expected a positive"),
        ({"reference_stress": -1.0}, ValueError, "reference_stress is -1.0"),
        ({"reference_stress": np.inf}, ValueError, "reference_stress is inf"),
        ({"sigma": 0.0}, ValueError, "sigma is 0.0; expected a positive number of kPa"),
        ({"sigma": -2.0}, ValueError, "sigma is -2.0"),
        ({"sigma": "5 mmHg"}, TypeError, "sigma is '5 mmHg'"),
        ({"sigma": pm.HalfNormal.dist(1, shape=2)}, TypeError, "sigma.*a scalar"),
        (
            {"sigma": pm.Normal.dist(0.5, 0.3)},
            ValueError,
            "prior of 'sigma' holds numbers such as -.*positive numbers",
        ),
    ],
)
def test_bad_input_is_named(data, settings, error, message):
    """The message names the setting, and what would be right."""
    with pytest.raises(error, match=message):
        ph.population_model(ph.Ogden(), data, **{"sigma": SIGMA} | settings)


def test_material_and_data_have_to_be_what_they_are_called(data):
    """A class in place of an instance, or a table in place of a Dataset, is refused."""
    with pytest.raises(TypeError, match="Ogden"):
        ph.population_model(ph.Ogden, data, sigma=SIGMA)
    with pytest.raises(TypeError, match="Dataset"):
        ph.population_model(ph.Ogden(), pd.DataFrame({"radius": [1.0]}), sigma=SIGMA)


@pytest.mark.long
@pytest.mark.deep
def test_nuts_and_smc_agree():
    """Five specimens with two experiments each, unknown noise; short steps of NUTS.

    Means agree to a fifth of a standard deviation and these to a fifth, several times what chains
    of a thousand effective draws differ by.
    """
    rng = np.random.default_rng(SEED)
    moduli, exponents = 30 * np.exp(0.3 * rng.normal(size=5)), 7 * np.exp(0.2 * rng.normal(size=5))
    tests = [
        (f"S{i}", experiment, 1.0, {"mu": mu, "alpha": alpha})
        for i, (mu, alpha) in enumerate(zip(moduli, exponents, strict=True))
        for experiment in (1, 2)
    ]
    model = ph.population_model(
        ph.Ogden(), inflation(tests, 0.15), sigma=pm.LogNormal.dist(np.log(0.2), 1.0)
    )
    settings = {"cores": 1, "target_accept": 0.95, "random_seed": SEED, "progressbar": False}
    nuts = pm.sample(1500, model=model, **settings)
    assert not nuts["sample_stats"]["diverging"].any()
    names = [rv.name for rv in model.free_RVs]
    posterior = nuts["posterior"].to_dataset()[names]
    assert az.rhat(posterior).to_array().max() < 1.01
    smc = ph.sample_smc(model, 1000, 2, random_seed=SEED, progressbar=False)
    particles = smc["posterior"].to_dataset()[names]
    over = ("chain", "draw")
    for name in names:
        sd = posterior[name].std(over)
        np.testing.assert_array_less(
            abs(particles[name].mean(over) - posterior[name].mean(over)), 0.2 * sd
        )
        np.testing.assert_array_less(abs(particles[name].std(over) / sd - 1), 0.2)


@pytest.mark.deep
def test_arviz_takes_results():
    """Scores by leaving points out, and predictions with their figure, as of any PyMC model."""
    data = ph.select(ph.load_dataset("simulated_sheep_aorta"), group="C1")
    model = ph.population_model(ph.Ogden(), data, sigma=SIGMA)
    tree = ph.sample_smc(model, 1000, 1, random_seed=SEED, progressbar=False)
    quickly = {"progressbar": False, "compile_kwargs": {"mode": MODE}}
    with model:
        pm.compute_log_likelihood(tree, progressbar=False)
        pm.sample_posterior_predictive(tree, extend_inferencedata=True, random_seed=SEED, **quickly)
    assert az.loo(tree).n_data_points == data.sizes["obs"]
    az.plot_ppc_dist(tree)
    # The curve of a specimen is drawn for each of its own points.
    predicted = tree["posterior_predictive"]["measured_pressure"].mean(("chain", "draw"))
    assert abs(predicted - data["pressure"].values).max() < 4 * SIGMA


def test_specimens_of_layers_have_layers_of_their_own():
    """Pressures of each specimen are those of its own layers, one of which has a known modulus."""
    layers = [
        ph.Layer(ph.NeoHookean(), pm.LogNormal.dist(np.log(0.1), 0.2), mu=30.0),
        ph.Layer(ph.Ogden(), 0.1),
    ]
    radius = np.linspace(1.1, 1.4, 4)
    frame = pd.DataFrame(
        {"specimen": np.repeat(["S1", "S2"], 4), "experiment": 1, "radius": np.tile(radius, 2)}
        | {"pressure": np.tile(np.linspace(2.0, 8.0, 4), 2)}
    )
    data = ph.inflation_data(frame, inner_radius=1.0, outer_radius=None)
    model = ph.population_model(layers, data, noise_sd=0.5)
    point = model.initial_point()
    assert {"log_thickness_1", "log_alpha_2"} <= set(point)
    point |= {"log_thickness_1": np.log([0.08, 0.13]), "log_alpha_2": np.log([4.0, 7.0])}
    names = ["pressure", "thickness_1", "mu_2", "alpha_2"]
    outputs = model.replace_rvs_by_values([model[name] for name in names])
    function = model.compile_fn(outputs, inputs=model.value_vars, on_unused_input="ignore")
    pressure, thickness, mu, alpha = function(point)
    np.testing.assert_allclose(thickness, [0.08, 0.13])
    for i in range(2):
        own = [
            ph.Layer(ph.NeoHookean(), thickness[i], mu=30.0),
            ph.Layer(ph.Ogden(), 0.1, mu=mu[i], alpha=alpha[i]),
        ]
        expected = ph.inflation_pressure(own, radius, inner_radius=1.0).eval()
        np.testing.assert_allclose(pressure[4 * i : 4 * i + 4], expected, rtol=1e-10)
