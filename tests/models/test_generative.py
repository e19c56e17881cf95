"""Measured pressures as an observed variable: its density, its draws and what is made of them."""

from dataclasses import replace

import arviz as az
import exact
import numpy as np
import pandas as pd
import pymc as pm
import pytensor
import pytensor.tensor as pt
import pytest
import xarray as xr
from pytensor.graph.replace import clone_replace
from scipy.stats import multivariate_normal, norm
from tables import SECTOR

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.study import inflation_data_of, model_settings_of

# Compiles in a second; the numbers are those of the default linker to rounding.
FAST = "FAST_COMPILE"
QUICKLY = {"compile_kwargs": {"mode": FAST}, "progressbar": False}
SEED = 515
SIGMA, SLOPE_WEIGHTS = 1.3, (0, 0.5, 3)
POINTS = {"mu": (30.0, 6.0, 80.0), "alpha": (7.0, -8.0, 0.0)}

# The pressures are right to about 1e-12 of the largest, which enters as a square.
DENSITY_TOLERANCE = 1e-9
# Central differences err by the square of the step, relative to the parameter, times a few dozen.
STEP, GRADIENT_TOLERANCE = 1e-4, 1e-5
# Of 100 numbers the largest exceeds 4.5 standard errors once in 1400 seeds.
STANDARD_ERRORS = 4.5
# An honest standard error is exceeded threefold once in 370 seeds.
EVIDENCE_STANDARD_ERRORS = 3


def tube_frame(specimen, inner, outer, axial, angle, points, seed):
    """Made-up points of a stiffening tube, and axial forces at every third of them."""
    rng = np.random.default_rng(seed)
    growth = np.sort(rng.uniform(0.92, 1.5, points))
    internal = inner * growth
    k = 1 / (1 - angle / 360)
    return pd.DataFrame(
        {
            "specimen": specimen,
            "experiment": 1,
            "radius": internal,
            "outer_diameter": 2 * np.sqrt(internal**2 + (outer**2 - inner**2) / (k * axial)),
            "pressure": 12 * (np.exp(2.2 * (growth - 1)) - 1) + 0.2 * rng.standard_normal(points),
            "axial_force": np.where(np.arange(points) % 3, np.nan, 50 * growth),
            "inner": inner,
            "outer": outer,
            "axial": axial,
            "angle": angle,
        }
    )


FRAME = pd.concat(
    [
        tube_frame("plain", 7.0, 9.0, 1.0, 0.0, 9, 1),
        tube_frame("stretched", 0.4, 0.52, 1.5, 90.0, 3, 2),
        tube_frame("shortened", 3.0, 5.1, 0.9, 0.0, 6, 3),
        tube_frame("opened", 3.0, 4.0, 1.0, 140.0, 12, 4),
    ],
    ignore_index=True,
)


def dataset(measured="radius", frame=FRAME):
    other = {"radius": "outer_diameter", "outer_diameter": "radius"}[measured]
    geometry = {"inner_radius": "inner", "outer_radius": "outer", "axial_stretch": "axial"}
    angle = {"opening_angle": "angle", "angle_unit": "deg", **SECTOR}
    return ph.inflation_data(frame.drop(columns=other), measured=measured, **geometry, **angle)


def generative(data, energy=None, **settings):
    settings = {"sigma": SIGMA, "slope_weight": 3, "likelihood": "generative"} | settings
    return ph.inflation_model(energy or ph.Ogden(), data, **settings)


def log_densities(model, name="measured_pressure", gradient=False, **values):
    """Log-density of every measured value at given parameters."""
    variable = model[name]
    logp = pm.logp(variable, model.rvs_to_values[variable])
    inputs = {model[given]: pt.dscalar(given) for given in values}
    logp = clone_replace(logp, inputs)
    inputs = list(inputs.values())
    outputs = [logp, *pytensor.grad(logp.sum(), inputs)] if gradient else logp
    return pytensor.function(inputs, outputs, mode=FAST)(*values.values())


def exact_normals(data, modulus, exponent, slope_weight, law="Ogden", sigma=SIGMA):
    """Mean, covariance and values of each test, and the gap of the paper's form."""
    tests = []
    for test, curve in enumerate(exact.curves_of(data)):
        ours = data["test"].values == test
        measured = curve.radius
        if "outer_diameter" in data:
            measured = data["outer_diameter"].values[ours] / 2
        difference = replace(curve, radius=measured).differences()
        pressure, stiffness = (modulus * unit[0] for unit in curve.responses(law, exponent))
        slope = (stiffness * measured / curve.radius)[1:-1]
        precision = np.eye(len(measured)) + slope_weight * difference.T @ difference
        mean = np.linalg.solve(precision, pressure + slope_weight * difference.T @ slope)
        lack = slope - difference @ pressure
        of_slopes = np.eye(len(slope)) + slope_weight * difference @ difference.T
        gap = slope_weight * lack @ np.linalg.solve(of_slopes, lack)
        tests.append((mean, sigma**2 / 2 * np.linalg.inv(precision), curve.pressure, gap))
    return tests


def exact_log_density(*arguments, **settings):
    normals = exact_normals(*arguments, **settings)
    return sum(multivariate_normal(mean, cov).logpdf(y) for mean, cov, y, _ in normals)


@pytest.mark.parametrize("measured", ["radius", "outer_diameter"])
@pytest.mark.parametrize("mode", ["collocation", "quadrature"])
@pytest.mark.parametrize("slope_weight", SLOPE_WEIGHTS)
def test_density_is_that_of_the_multivariate_normal(slope_weight, mode, measured):
    """Tests of different tubes and of three to twelve points; the noise is inferred."""
    data = dataset(measured)
    noise = {"sigma": pm.HalfNormal.dist(2), "slope_weight": slope_weight}
    model = generative(data, mode=mode, **noise)
    logp = pm.logp(model["measured_pressure"], model["pressure_data"])
    inputs = [model[name] for name in ("mu", "alpha", "sigma")]
    function = pm.compile(inputs, logp, mode=FAST)
    for mu, alpha in zip(*POINTS.values(), strict=True):
        for sigma in (SIGMA, 20.0):
            expected = exact_log_density(data, mu, alpha, slope_weight, sigma=sigma)
            found = function(mu, alpha, sigma)
            assert found.shape == (data.sizes["obs"],)
            np.testing.assert_allclose(found.sum(), expected, rtol=DENSITY_TOLERANCE)


@pytest.mark.parametrize("slope_weight", SLOPE_WEIGHTS)
def test_a_point_is_told_given_those_before_it(slope_weight):
    """Each entry is the difference of the joint densities with and without the point."""
    data = dataset()
    found = log_densities(generative(data, slope_weight=slope_weight), mu=30.0, alpha=7.0)
    expected = []
    for mean, cov, y, _ in exact_normals(data, 30.0, 7.0, slope_weight):
        joint = [
            multivariate_normal(mean[:n], cov[:n, :n]).logpdf(y[:n]) for n in range(1, len(y) + 1)
        ]
        expected += [joint[0], *np.diff(joint)]
    # Differences of sums: relative to the largest of these.
    atol = DENSITY_TOLERANCE * np.abs(np.cumsum(expected)).max()
    np.testing.assert_allclose(found, expected, rtol=0, atol=atol)


@pytest.mark.parametrize("slope_weight", [0.5, 3])
def test_the_paper_adds_the_gap(slope_weight):
    """The paper's form is smaller by ``c/sigma^2``, the misfit that no data could remove."""
    data = dataset()
    noise = {"sigma": SIGMA, "slope_weight": slope_weight}
    paper = ph.ogden_model(data, **noise)
    ours = ph.ogden_model(data, **noise, likelihood="generative")
    assert [v.name for v in paper.potentials] == ["likelihood"]
    assert not paper.observed_RVs and not ours.potentials
    inputs = [paper["mu"], paper["alpha"]]
    potential = pm.compile(inputs, paper["likelihood"], mode=FAST)
    for mu, alpha in zip(*POINTS.values(), strict=True):
        gaps = [gap for *_, gap in exact_normals(data, mu, alpha, slope_weight)]
        assert min(gaps) >= 0
        value = log_densities(ours, mu=mu, alpha=alpha).sum()
        found = value - potential(mu, alpha)
        # The difference of two large numbers.
        np.testing.assert_allclose(
            found, sum(gaps) / SIGMA**2, atol=DENSITY_TOLERANCE * abs(value), rtol=0
        )


@pytest.mark.parametrize("slope_weight", [0, 3])
def test_forces_are_observed_where_they_were_measured(slope_weight):
    """They have a variable of their own, over the points that have a force."""
    data = dataset()
    model = generative(data, slope_weight=slope_weight, force_sigma=pm.HalfNormal.dist(20))
    rows = np.flatnonzero(np.isfinite(data["axial_force"].values))
    assert list(model.coords["force_obs"]) == list(rows)
    (force,) = pm.compile([model["mu"], model["alpha"]], [model["axial_force"]], mode=FAST)(30, 7)
    found = log_densities(model, "measured_axial_force", mu=30.0, alpha=7.0, force_sigma=9.0)
    expected = norm.logpdf(data["axial_force"].values[rows], force[rows], 9 / np.sqrt(2))
    np.testing.assert_allclose(found, expected, rtol=DENSITY_TOLERANCE)
    pressure = log_densities(model, mu=30.0, alpha=7.0).sum()
    expected = exact_log_density(data, 30.0, 7.0, slope_weight)
    np.testing.assert_allclose(pressure, expected, rtol=DENSITY_TOLERANCE)


@pytest.mark.parametrize("slope_weight", [0, 3])
def test_gradient_and_where_there_is_none(slope_weight):
    """NUTS follows the density's own gradient; where pressures overflow the likelihood is zero."""
    priors = {"mu": pm.Uniform.dist(0, 100), "alpha": pm.Uniform.dist(0, 5000)}
    model = generative(dataset(), slope_weight=slope_weight, priors=priors)
    point = {"mu": 30.0, "alpha": 7.0}
    _, *gradient = log_densities(model, gradient=True, **point)
    for name, found in zip(point, gradient, strict=True):
        above, below = (
            log_densities(model, **point | {name: point[name] * factor}).sum()
            for factor in (1 + STEP, 1 - STEP)
        )
        assert abs(found * 2 * STEP * point[name] / (above - below) - 1) < GRADIENT_TOLERANCE
    with np.errstate(all="ignore"):
        value, *gradient = log_densities(model, gradient=True, mu=30.0, alpha=4900.0)
    assert np.all(value == -np.inf)
    np.testing.assert_array_equal(gradient, 0.0)


@pytest.mark.parametrize("slope_weight", [0, 3])
def test_geometry_may_be_inferred(slope_weight):
    """At the known radius the density is that of known geometry; an impossible tube has none."""
    plain = dataset(frame=FRAME[FRAME["specimen"] == "plain"])
    unknown = {"inner_radius": pm.Uniform.dist(6, 12)}
    model = generative(plain, slope_weight=slope_weight, geometry=unknown)
    known = exact_log_density(plain, 30.0, 7.0, slope_weight)
    found = log_densities(model, mu=30.0, alpha=7.0, inner_radius=7.0).sum()
    np.testing.assert_allclose(found, known, rtol=DENSITY_TOLERANCE)
    assert np.all(log_densities(model, mu=30.0, alpha=7.0, inner_radius=9.5) == -np.inf)


@pytest.mark.parametrize("slope_weight", SLOPE_WEIGHTS)
def test_draws_have_the_mean_and_the_covariance(slope_weight):
    """Whitened by the exact covariance, posterior predictive draws are independent and standard."""
    data = dataset()
    draws = 4000
    posterior = xr.Dataset(
        {
            name: (("chain", "draw"), np.full((1, draws), values[0]))
            for name, values in POINTS.items()
        }
    )
    with generative(data, slope_weight=slope_weight):
        tree = pm.sample_posterior_predictive(
            xr.DataTree.from_dict({"posterior": posterior}), random_seed=SEED, **QUICKLY
        )
    assert dict(tree["posterior_predictive"]["measured_pressure"].sizes)["obs"] == data.sizes["obs"]
    drawn = tree["posterior_predictive"]["measured_pressure"].values[0]
    white, start = np.empty_like(drawn), 0
    for mean, cov, y, _ in exact_normals(data, 30.0, 7.0, slope_weight):
        points = slice(start, start := start + len(y))
        white[:, points] = np.linalg.solve(np.linalg.cholesky(cov), (drawn[:, points] - mean).T).T
    assert np.abs(white.mean(axis=0)).max() < STANDARD_ERRORS / np.sqrt(draws)
    excess = np.cov(white.T) - np.eye(len(white.T))
    assert np.abs(np.diag(excess)).max() < STANDARD_ERRORS * np.sqrt(2 / draws)
    assert np.abs(excess - np.diag(np.diag(excess))).max() < STANDARD_ERRORS / np.sqrt(draws)


# --- the simulated study --------------------------------------------------------------------------


LAWS = (ph.PowerLawNeoHookean(), ph.Ogden(), ph.CriscioneType())
STUDY_NOISE = {"sigma": 5 * ph.mmHg, "slope_weight": 0}


def training():
    return ph.select(ph.load_dataset("simulated_sheep_aorta"), group="C1", experiment=[1, 2])


def sample(model, draws=300, **settings):
    settings = {"chains": 2, "random_seed": SEED, "progressbar": False} | settings
    return ph.sample_smc(model, draws, **settings)


@pytest.fixture(scope="module")
def models():
    return {law.name: generative(training(), law, **STUDY_NOISE) for law in LAWS}


@pytest.fixture(scope="module")
def trees(models):
    results = {name: sample(model) for name, model in models.items()}
    for name, model in models.items():
        with model:
            pm.sample_posterior_predictive(
                results[name], extend_inferencedata=True, random_seed=SEED, **QUICKLY
            )
            pm.compute_log_likelihood(results[name], **QUICKLY)
    return results


@pytest.mark.parametrize("slope_weight", [0, 3])
def test_evidence_is_the_integral(slope_weight):
    """Sequential Monte Carlo tempers the observed variable; quadrature gives the exact number."""
    data = ph.select(training(), specimen="S1", experiment=1)
    model = generative(data, slope_weight=slope_weight, sigma=15 * ph.mmHg)
    value, standard_error = ph.log_evidence(sample(model, chains=4))
    integral = ph.log_evidence_by_quadrature(model, rtol=1e-5)
    assert abs(value - integral.value) < EVIDENCE_STANDARD_ERRORS * standard_error


def test_laws_are_compared_by_points(trees):
    """LOO needs no warning, and cannot tell two laws apart that are one pressure model."""
    by_law = {name: az.loo(tree) for name, tree in trees.items()}
    table = az.compare(trees, round_to="none")
    assert list(table.index)[-1] == "PowerLawNeoHookean"
    worst = table.loc["PowerLawNeoHookean"]
    assert worst["elpd_diff"] < -2 * worst["dse"]
    between = by_law["Ogden"].elpd - by_law["CriscioneType"].elpd
    assert abs(between) < 1


def test_evidence_of_one_pressure_model_differs_by_the_prior(trees):
    """With ``a = 8 mu/alpha^2`` and ``b = alpha/2`` the densities of their priors differ."""
    ogden, criscione = (ph.log_evidence(trees[name]) for name in ("Ogden", "CriscioneType"))
    expected = np.log(np.mean(8 / trees["Ogden"]["posterior"]["alpha"].values ** 2))
    error = np.hypot(ogden.standard_error, criscione.standard_error)
    found = criscione.value - ogden.value
    assert abs(found - expected) < EVIDENCE_STANDARD_ERRORS * error


def test_arviz_plots_predictions(trees):
    """Predictions have the name of the measured values, with which they are drawn."""
    tree = trees["Ogden"]
    assert list(tree["posterior_predictive"].data_vars) == ["measured_pressure"]
    plot = az.plot_ppc_dist(tree, backend="none")
    assert "measured_pressure" in plot.viz["observed_dist"].data_vars


def test_result_can_be_stored_and_the_model_rebuilt(trees, models, tmp_path):
    """The data come back, also after PyMC has replaced the observed ones by its own."""
    tree = trees["Ogden"]
    tree.to_netcdf(tmp_path / "result.nc", engine="h5netcdf")
    loaded = xr.load_datatree(tmp_path / "result.nc", engine="h5netcdf")
    xr.testing.assert_identical(loaded, tree)
    xr.testing.assert_identical(inflation_data_of(loaded), training())
    again = ph.inflation_model(data=inflation_data_of(loaded), **model_settings_of(loaded))
    assert again.study.likelihood == "generative"
    assert again.study.attrs() == models["Ogden"].study.attrs()
    assert "likelihood" not in ph.ogden_model(training(), **STUDY_NOISE).study.attrs()


def test_measured_values_can_be_replaced():
    """A compiled model follows what is put in its data, and results hold what they were."""
    data = dataset()
    model = generative(data, force_sigma=20.0)
    logp = model.compile_logp(mode=FAST)
    point = model.initial_point()
    new = data.assign(pressure=data["pressure"] * 1.1 + 0.3, axial_force=data["axial_force"] * 0.9)
    rows = np.isfinite(new["axial_force"].values)
    with model:
        pm.set_data(
            {
                "pressure_data": new["pressure"].values,
                "axial_force_data": new["axial_force"].values[rows],
            }
        )
    expected = generative(new, force_sigma=20.0).compile_logp(mode=FAST)(point)
    assert logp(point) == pytest.approx(expected, rel=DENSITY_TOLERANCE)
    tree = sample(model, 50, chains=1)
    xr.testing.assert_equal(inflation_data_of(tree), new)
    measured = tree["observed_data"]["measured_pressure"].values
    np.testing.assert_array_equal(measured, new["pressure"].values)


def one_experiment():
    """Model of a single curve, with priors from which no pressure overflows."""
    data = ph.select(training(), specimen="S1", experiment=1)
    priors = {"mu": pm.Uniform.dist(20, 50), "alpha": pm.Uniform.dist(3, 10)}
    return data, generative(data, priors=priors, sigma=15 * ph.mmHg)


def test_curves_can_be_drawn_from_the_prior():
    """The measured values have draws, one of each, and all of them are numbers."""
    data, model = one_experiment()
    prior = pm.sample_prior_predictive(
        draws=20, model=model, random_seed=SEED, compile_kwargs={"mode": FAST}
    )
    drawn = prior["prior_predictive"]["measured_pressure"]
    assert dict(drawn.sizes) == {"chain": 1, "draw": 20, "obs": data.sizes["obs"]}
    assert np.isfinite(drawn.values).all()


@pytest.mark.deep
def test_nuts_samples_the_same_model():
    """NUTS and sequential Monte Carlo have the same means."""
    _, model = one_experiment()
    with model:
        posterior = pm.sample(
            tune=100,
            draws=100,
            chains=1,
            cores=1,
            random_seed=SEED,
            compute_convergence_checks=False,
            **QUICKLY,
        )["posterior"]
    ours = sample(model)["posterior"]
    for name in ("mu", "alpha"):
        error = ours[name].std() / np.sqrt(az.ess(posterior[name].values))
        assert abs(posterior[name].mean() - ours[name].mean()) < STANDARD_ERRORS * error


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"likelihood": "exact"}, "expected one of"),
        ({"slope_weight": pm.HalfNormal.dist(1)}, "slope_weight must be a number"),
        ({"error_in": "radius", "slope_weight": 0}, "known radii"),
    ],
    ids=["unknown", "inferred slope weight", "radius"],
)
def test_what_cannot_be_generative_is_said(settings, message):
    """The message says what to do."""
    with pytest.raises(ValueError, match=message):
        generative(dataset(), **settings)
