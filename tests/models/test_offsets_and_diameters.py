"""Errors that measurements share, of a diameter and of a force transducer, by dense covariances."""

import json

import numpy as np
import pandas as pd
import pymc as pm
import pytensor
import pytest
import shared_errors
import xarray as xr
from bad_input import assert_refused, curves, table, unknown_curves
from problems import AS_WRITTEN
from scipy import integrate, optimize, stats
from shared_errors import Dense, dataset, neo_hookean, ogden

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.pooled import Pooled
from pymc_hyperelastic.models.study import model_settings_of

SEED = 7  # any would do
# Both sides are exact to about 1e-12 of the largest misfit, which enters as a square.
LIKELIHOOD_TOLERANCE = 1e-9
# Of 100 numbers the largest exceeds 4.5 standard errors once in 1400 seeds.
STANDARD_ERRORS = 4.5
# What is promised of evidences.
EVIDENCE_STANDARD_ERRORS, EVIDENCE_TOLERANCE = 3, 0.05

OGDEN, POINT = ph.Ogden(), {"mu": 6.0, "alpha": 5.0}
LAYERS = [(ogden(**POINT), 2.0)]
SDS = {"noise_sd": 0.4, "force_noise_sd": 3.0, "force_offset_sd": 25.0, "diameter_noise_sd": 0.1}
OFFSET = {name: SDS[name] for name in ("noise_sd", "force_noise_sd", "force_offset_sd")}
# Which errors there are, beside that of the pressure.
ERRORS = {
    "offset": OFFSET,
    "diameter": {name: sd for name, sd in SDS.items() if name != "force_offset_sd"},
    "both": SDS,
}


def dense(data, layers=LAYERS, inner=7.0, **sds):
    names = {"noise_sd": "noise", "force_noise_sd": "force_noise"}
    names |= {"force_offset_sd": "offset", "diameter_noise_sd": "diameter"}
    return Dense(data, layers, inner, **{names[name]: sd for name, sd in sds.items()})


def exact(normal):
    return stats.multivariate_normal(normal.mean, normal.covariance).logpdf(normal.values)


def model_of(data, energy=OGDEN, **settings):
    return ph.inflation_model(energy, data, **{"slope_weight": 0} | settings)


def free(*names):
    """Priors of numbers as they are, without a transform."""
    return {name: pm.Flat.dist() for name in names}


def function_of(model, outputs=None, gradient=False):
    """Log-likelihood as a function of the free variables, or other outputs of a model."""
    if outputs is None:
        outputs = [model.logp([*model.observed_RVs, *model.potentials])]
        if gradient:
            outputs += pytensor.grad(outputs[0], model.value_vars)
    else:
        outputs = model.replace_rvs_by_values(outputs)
    function = pytensor.function(
        model.value_vars, outputs, mode=AS_WRITTEN, on_unused_input="ignore"
    )
    return lambda **point: function(*(point[rv.name] for rv in model.free_RVs))


def unknown(noise, **settings):
    """All errors inferred, and the material: whatever they are, a number may be put in."""
    return {"priors": free(*POINT), **free(*noise), "mode": "quadrature"} | settings


@pytest.mark.parametrize("measured", ["radius", "outer_diameter"])
@pytest.mark.parametrize("likelihood", ["paper", "generative"])
@pytest.mark.parametrize("errors", ERRORS)
def test_log_likelihood_is_that_of_the_multivariate_normal(errors, likelihood, measured):
    """Of all pressures and forces together, whatever the size of the errors that are inferred.

    Tests have five numbers of forces, among them one and none.
    """
    data, noise = dataset(measured=measured), ERRORS[errors]
    model = model_of(data, likelihood=likelihood, **unknown(noise))
    assert set(noise) <= {rv.name for rv in model.free_RVs}
    value = function_of(model)
    for scale in (1.0, 0.1, 30.0):
        sds = {name: sd * (scale if "force" in name else 1.0) for name, sd in noise.items()}
        expected = exact(dense(data, **sds))
        assert value(**POINT, **sds)[0] == pytest.approx(expected, rel=LIKELIHOOD_TOLERANCE)


@pytest.mark.parametrize("errors", ERRORS)
def test_matrices_give_what_quadrature_gives(errors):
    """Compressed sums of offsets, and slopes by matrices, of known errors."""
    data, noise = dataset(measured="outer_diameter"), ERRORS[errors]
    priors = {"mu": pm.Uniform.dist(1, 20), "alpha": pm.Uniform.dist(2, 8)}
    for likelihood in ("paper", "generative"):
        model = model_of(data, likelihood=likelihood, mode="collocation", priors=priors, **noise)
        points = dict(zip([rv.name for rv in model.free_RVs], model.value_vars, strict=True))
        inputs = {
            value.name: model.rvs_to_transforms[model[name]]
            .forward(np.float64(POINT[name]), *model[name].owner.inputs)
            .eval(mode=AS_WRITTEN)
            for name, value in points.items()
        }
        terms = model.logp([*model.observed_RVs, *model.potentials])
        found = model.compile_fn(terms, mode=AS_WRITTEN)(inputs)
        assert found == pytest.approx(exact(dense(data, **noise)), rel=LIKELIHOOD_TOLERANCE)


def test_a_force_is_told_given_those_before_it():
    """Each entry is the difference of the joint densities with and without the point."""
    data = dataset()
    model = model_of(data, likelihood="generative", **unknown(SDS))
    logp = model.logp(model["measured_axial_force"], sum=False)
    (found,) = function_of(model, logp)(**POINT, **SDS)
    normal = dense(data, **SDS)
    mean, covariance, values = normal.mean, normal.covariance, normal.values
    points = data.sizes["obs"]
    joint = [
        stats.multivariate_normal(mean[:n], covariance[:n, :n]).logpdf(values[:n])
        for n in range(points, len(values) + 1)
    ]
    np.testing.assert_allclose(found, np.diff(joint), atol=1e-9 * np.abs(joint).max(), rtol=0)


@pytest.mark.parametrize("errors", ["offset", "both"])
def test_what_is_learned_of_offsets_is_the_conditional_normal(errors):
    """Without a force it is the prior, and given those of a test they say all."""
    data, noise = dataset(), ERRORS[errors]
    model = model_of(data, **unknown(noise))
    assert model.named_vars_to_dims["force_offset_mean"] == ("test",)
    outputs = [model["force_offset_mean"], model["force_offset_error"]]
    found = function_of(model, outputs)(**POINT, **noise)
    mean, error = dense(data, **noise).offsets()
    np.testing.assert_allclose(found[0], mean, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(found[1], error, rtol=1e-8)
    assert (found[0][1], found[1][1]) == (0.0, noise["force_offset_sd"])


def test_an_offset_is_what_its_integral_says():
    """Evidence and posterior of one test's offset, by adaptive quadrature over it."""
    data = ph.select(dataset(), experiment=3)
    normal = dense(data, **OFFSET)
    points = data.sizes["obs"]
    pressures = stats.norm(normal.mean[:points], SDS["noise_sd"]).logpdf(normal.values[:points])
    left = (normal.values - normal.mean)[points:]
    prior = stats.norm(0.0, SDS["force_offset_sd"])
    centre = left.mean()

    def moment(power):
        def integrand(offset):
            of_forces = stats.norm(offset, SDS["force_noise_sd"]).pdf(left).prod()
            return (offset - centre) ** power * of_forces * prior.pdf(offset)

        return integrate.quad(integrand, centre - 40, centre + 40, epsabs=0, epsrel=1e-11)[0]

    mass, first, second = map(moment, range(3))
    model = model_of(data, **unknown(OFFSET))
    outputs = [*model.potentials, model["force_offset_mean"], model["force_offset_error"]]
    value, mean, error = function_of(model, outputs)(**POINT, **OFFSET)
    assert value == pytest.approx(np.log(mass) + pressures.sum(), rel=LIKELIHOOD_TOLERANCE)
    assert mean[0] == pytest.approx(centre + first / mass, rel=1e-8)
    assert error[0] == pytest.approx(np.sqrt(second / mass - (first / mass) ** 2), rel=1e-6)


@pytest.mark.parametrize(
    "settings",
    [
        {"slope_weight": 2.0, "noise_sd": 0.4},
        {"slope_weight": 2.0, "noise_sd": 0.4, "likelihood": "generative"},
        {"error_in": "radius", "noise_sd": 0.05},
    ],
    ids=["slopes", "generative with slopes", "error in the radius"],
)
def test_offsets_leave_the_pressures_as_they_are(settings):
    """With slopes, and with the error in the radius, only the forces' own density is another.

    With the error in the radius forces are those at the radii that have the measured pressures.
    """
    # At these points the curve passes the measured pressures, which the inverse needs.
    frame = shared_errors.table((6, 5, 4, 3))
    law = neo_hookean(30.0)
    pressure, _ = shared_errors.pressure_and_force(
        [(law, 2.0)], frame["radius"].to_numpy(), 7.0, frame["axial"].to_numpy()
    )
    rng = np.random.default_rng(SEED)
    data = dataset(frame.assign(pressure=pressure + rng.normal(0, 0.1, len(frame))))
    settings = {"priors": free("mu"), "mode": "quadrature", **settings}
    forces = {"force_noise_sd": 3.0, "force_offset_sd": 25.0}
    with_forces, without = (
        function_of(model_of(data, ph.NeoHookean(), **settings, **noise))(mu=30.0)[0]
        for noise in (forces, {})
    )
    normal = dense(data, [(law, 2.0)], noise_sd=1.0, **forces)
    points, mean = data.sizes["obs"], normal.mean
    if "error_in" in settings:

        def beyond(radius, axial, pressure):
            of_wall = [(law, 2.0)], np.array([radius]), 7.0, np.array([axial])
            return shared_errors.pressure_and_force(*of_wall)[0].item() - pressure

        axial, pressure = frame["axial"].to_numpy(), data["pressure"].values
        each = zip(axial, pressure, strict=True)
        radius = np.array([optimize.brentq(beyond, 6.5, 9.5, args=of_point) for of_point in each])
        _, force = shared_errors.pressure_and_force([(law, 2.0)], radius, 7.0, axial)
        mean = np.concatenate([pressure, force[normal.rows]])
    of_forces = stats.multivariate_normal(
        mean[points:], normal.covariance[points:, points:]
    ).logpdf(normal.values[points:])
    assert np.isfinite(without)
    assert with_forces - without == pytest.approx(of_forces, rel=1e-8)


@pytest.mark.parametrize("likelihood", ["paper", "generative"])
def test_layers_of_unknown_geometry_share_errors_too(likelihood):
    """Slopes are those of all layers together, by the outer diameter of the tube that is meant."""
    data = dataset(measured="outer_diameter", outer_radius=None)
    media = ph.Layer(ph.NeoHookean(), 1.2, mu=pm.Flat.dist())
    adventitia = ph.Layer(OGDEN, pm.Flat.dist(), mu=4.0, alpha=5.0)
    geometry = {"inner_radius": pm.Flat.dist()}
    model = model_of(
        data,
        [media, adventitia],
        geometry=geometry,
        likelihood=likelihood,
        mode="quadrature",
        **SDS,
    )
    (found,) = function_of(model)(mu_1=20.0, thickness_2=0.7, inner_radius=7.1)
    layers = [(neo_hookean(20.0), 1.2), (ogden(4.0, 5.0), 0.7)]
    expected = exact(dense(data, layers, 7.1, **SDS))
    assert found == pytest.approx(expected, rel=LIKELIHOOD_TOLERANCE)


@pytest.mark.parametrize("likelihood", ["paper", "generative"])
@pytest.mark.parametrize("errors", ["offset", "both"])
def test_gradient_agrees_with_finite_differences(errors, likelihood):
    """By material and errors: variances that depend on the material bring its curvature in."""
    noise = ERRORS[errors]
    model = model_of(dataset(measured="outer_diameter"), likelihood=likelihood, **unknown(noise))
    (logp,) = model.replace_rvs_by_values([model.logp([*model.observed_RVs, *model.potentials])])
    values = [(POINT | noise)[rv.name] for rv in model.free_RVs]

    def of_values(*given):
        return pytensor.graph.clone_replace(
            logp, dict(zip(model.value_vars, given, strict=True)), rebuild_strict=False
        )

    pytensor.gradient.verify_grad(
        of_values,
        [np.array(value) for value in values],
        n_tests=1,
        rng=np.random.default_rng(SEED),
        mode=AS_WRITTEN,
    )


def test_curves_that_overflow_are_impossible():
    """The log-likelihood is −inf, and its gradient 0 and not NaN."""
    of_material = {"priors": free(*POINT), "mode": "quadrature"}
    for settings, sds in (
        (unknown(OFFSET), OFFSET),
        (unknown(SDS), SDS),
        ({"likelihood": "generative"} | of_material | SDS, {}),
    ):
        function = function_of(model_of(dataset(), **settings), gradient=True)
        with np.errstate(all="ignore"):
            value, *gradient = function(mu=6.0, alpha=4900.0, **sds)
        assert value == -np.inf
        assert all(slope == 0 for slope in gradient)


def test_other_data_take_their_place():
    """Classes share a compiled likelihood: other tests, of other lengths, and without forces."""
    first, second = dataset(), dataset(shared_errors.table((3, 7), seed=2))
    second["axial_force"][:] = np.nan
    third = dataset(shared_errors.table((4, 1, 6), seed=3))
    for noise in ERRORS.values():
        kind = Pooled.of_settings(OGDEN, slope_weight=0.0, **noise)
        for mode in ("collocation", "quadrature"):
            priors = {"mu": pm.Uniform.dist(1, 20), "alpha": pm.Uniform.dist(2, 8)}
            forward = kind.observation.forward_model(OGDEN, first, priors, mode=mode)
            inputs = {name: pytensor.tensor.dscalar(name) for name in POINT}
            likelihood = kind.observation.log_likelihood(forward.tube(inputs))
            function = pytensor.function(list(inputs.values()), likelihood, mode=AS_WRITTEN)
            for data in (second, third, first):
                forward.set_data(data)
                expected = exact(dense(data, **noise))
                assert function(**POINT) == pytest.approx(expected, rel=LIKELIHOOD_TOLERANCE)


# --- evidence and posterior of a linear law -------------------------------------------------------


PRIOR = 20.0, 5.0


def linear(noise=OFFSET):
    """A tube whose pressure and force are its modulus times numbers, and its model's settings."""
    frame = shared_errors.table((8, 7, 6, 5))
    data = dataset(frame)
    unit = dense(data, [(neo_hookean(1.0), 2.0)], **noise).mean
    normal = dense(data, [(neo_hookean(23.0), 2.0)], **noise)
    values = np.random.default_rng(SEED).multivariate_normal(normal.mean, normal.covariance)
    points = data.sizes["obs"]
    pressure = data["pressure"].copy(data=values[:points])
    force = data["axial_force"].copy()
    force[normal.rows] = values[points:]
    return data.assign(pressure=pressure, axial_force=force), unit, values


def linear_model(data, **settings):
    priors = {"mu": pm.Normal.dist(*PRIOR)}
    return model_of(data, ph.NeoHookean(), priors=priors, **OFFSET, **settings)


@pytest.fixture(scope="module")
def sampled():
    data, *_ = linear()
    settings = {"draws": 1000, "chains": 2, "random_seed": SEED, "progressbar": False}
    return {
        likelihood: ph.sample_smc(linear_model(data, likelihood=likelihood), **settings)
        for likelihood in ("paper", "generative")
    }


@pytest.mark.parametrize("likelihood", ["paper", "generative"])
def test_evidence_of_a_linear_law_has_its_closed_form(likelihood, sampled):
    """Modulus and offsets integrated out of normal distributions leave one."""
    data, unit, values = linear()
    covariance = dense(data, [(neo_hookean(1.0), 2.0)], **OFFSET).covariance
    mean, sd = PRIOR
    of_data = stats.multivariate_normal(mean * unit, covariance + sd**2 * np.outer(unit, unit))
    found = ph.log_evidence(sampled[likelihood])
    difference = abs(found.value - of_data.logpdf(values))
    assert difference < EVIDENCE_STANDARD_ERRORS * found.standard_error
    assert difference < EVIDENCE_TOLERANCE


@pytest.mark.parametrize("likelihood", ["paper", "generative"])
def test_offsets_have_their_posterior(likelihood, sampled):
    """Draws have mean, spread and correlations of the joint normal of modulus and offsets."""
    data, unit, values = linear()
    normal = dense(data, [(neo_hookean(1.0), 2.0)], **OFFSET)
    tests, points = data.sizes["test"], data.sizes["obs"]
    # Columns: how what was measured depends on the modulus, and on each offset.
    design = np.zeros((len(values), 1 + tests))
    design[:, 0] = unit
    design[points + np.arange(len(normal.rows)), 1 + normal.test] = 1
    sd = np.array([PRIOR[1], *[SDS["force_offset_sd"]] * tests])
    noise = np.diag(normal.with_noise(offset=0.0).covariance)
    precision = np.diag(1 / sd**2) + design.T @ (design / noise[:, None])
    covariance = np.linalg.inv(precision)
    start = np.array([PRIOR[0], *[0.0] * tests])
    mean = covariance @ (start / sd**2 + design.T @ (values / noise))
    offsets = ph.force_offsets(sampled[likelihood])["force_offset"]
    assert offsets.dims == ("chain", "draw", "test") and offsets.attrs["units"] == "mN"
    assert offsets["test"].values[2] == "specimen 'S', experiment 2"
    posterior = sampled[likelihood]["posterior"]
    drawn = np.column_stack([posterior["mu"].values.ravel(), offsets.values.reshape(-1, tests)])
    scale = np.sqrt(np.diag(covariance))
    error = STANDARD_ERRORS / np.sqrt(len(drawn))
    # Particles that stand together count as fewer draws.
    assert np.abs((drawn.mean(axis=0) - mean) / scale).max() < 2 * error
    assert np.abs(drawn.std(axis=0) / scale - 1).max() < 2 * error
    correlation = covariance / np.outer(scale, scale)
    assert np.abs(np.corrcoef(drawn.T) - correlation).max() < 2 * error


def test_predictions_have_offsets_of_their_own():
    """Whitened by the exact covariance, draws of all signals are independent and standard."""
    data, draws = dataset(), 4000
    posterior = {name: (("chain", "draw"), np.full((1, draws), v)) for name, v in POINT.items()}
    model = model_of(data, likelihood="generative", **SDS)
    with model:
        tree = pm.sample_posterior_predictive(
            xr.DataTree.from_dict({"posterior": xr.Dataset(posterior)}),
            random_seed=SEED,
            progressbar=False,
            compile_kwargs={"mode": "FAST_COMPILE"},
        )
    predicted = tree["posterior_predictive"]
    names = ("measured_pressure", "measured_axial_force")
    drawn = np.concatenate([predicted[name].values[0] for name in names], axis=1)
    normal = dense(data, **SDS)
    white = np.linalg.solve(np.linalg.cholesky(normal.covariance), (drawn - normal.mean).T)
    assert np.abs(white.mean(axis=1)).max() < STANDARD_ERRORS / np.sqrt(draws)
    excess = np.cov(white) - np.eye(len(white))
    assert np.abs(np.diag(excess)).max() < STANDARD_ERRORS * np.sqrt(2 / draws)
    assert np.abs(excess - np.diag(np.diag(excess))).max() < 1.2 * STANDARD_ERRORS / np.sqrt(draws)


# --- the true diameter integrated out -------------------------------------------------------------


@pytest.mark.parametrize(("error", "typical", "mean"), [(0.005, 0.03, 3e-3), (0.01, 0.08, 8e-3)])
def test_the_true_diameter_is_integrated_out_to_first_order(error, typical, mean):
    """As far as the docstring says: points of a stiffening tube, by quadrature over diameters.

    The curve grows by a factor of e in 0.25 mm of 1.3 mm: the slope changes by 2 % and by 4 %.
    """
    rng, count = np.random.default_rng(SEED), 400
    axial, tube = 1.4, {"inner_radius": 0.42, "outer_radius": 0.52, "axial_stretch": "axial"}
    law = {"mu": 3.0, "alpha": 8.0}
    sds = {"noise_sd": 1 * ph.mmHg, "force_noise_sd": 0.5, "diameter_noise_sd": error}
    diameter = np.sort(rng.uniform(1.25, 1.45, count))

    def curves_at(diameters):
        radius = np.sqrt(np.ravel(diameters) ** 2 / 4 - (0.52**2 - 0.42**2) / axial)
        found = shared_errors.pressure_and_force(
            [(ogden(**law), 0.1)], radius, 0.42, np.full(radius.shape, axial)
        )
        return [np.reshape(curve, np.shape(diameters)) for curve in found]

    pressure, force = curves_at(diameter + rng.normal(0, error, count))
    frame = pd.DataFrame({"specimen": "S", "experiment": 1, "axial": axial}, range(count))
    frame["outer_diameter"] = diameter
    frame["pressure"] = pressure + rng.normal(0, sds["noise_sd"], count)
    frame["axial_force"] = force + rng.normal(0, sds["force_noise_sd"], count)
    data = dataset(frame, "outer_diameter", **tube)
    model = model_of(data, likelihood="generative", **unknown(sds))
    logp = model.logp(model.observed_RVs, sum=False)
    found = sum(function_of(model, logp)(**law, **sds))

    node, weight = np.polynomial.legendre.leggauss(300)
    true = diameter[:, None] + 8 * error * node
    pressure, force = curves_at(true)
    density = stats.norm(diameter[:, None], error).pdf(true) * 8 * error * weight
    density *= stats.norm(pressure, sds["noise_sd"]).pdf(frame["pressure"].to_numpy()[:, None])
    density *= stats.norm(force, sds["force_noise_sd"]).pdf(
        frame["axial_force"].to_numpy()[:, None]
    )
    difference = found - np.log(density.sum(axis=1))
    assert np.sqrt(np.mean(difference**2)) < typical
    assert abs(difference.mean()) < mean
    # It could fail: without the error of the diameter nothing fits.
    plain = model_of(data, likelihood="generative", **unknown(ERRORS["diameter"]))
    (without,) = function_of(plain)(**law, **sds | {"diameter_noise_sd": 1e-6})
    assert without < found.sum() - 20


# --- what is stored, and what is refused ----------------------------------------------------------


def test_errors_are_stored_and_read_back(tmp_path):
    """Numbers and priors, with their units and in words, through a file."""
    noise = OFFSET | {"force_offset_sd": pm.HalfNormal.dist(30), "diameter_noise_sd": 0.02}
    data = dataset()
    few = {"draws": 100, "chains": 1, "progressbar": False, "random_seed": SEED}
    settings = {"slope_weight": 0.0, "priors": {"mu": pm.Uniform.dist(1, 20)}, **few}
    classes = ph.fit_classes(ph.NeoHookean(), {"A": data}, **noise, **settings)
    classes.to_netcdf(tmp_path / "classes.nc", engine="h5netcdf")
    with xr.open_datatree(tmp_path / "classes.nc", engine="h5netcdf") as read:
        stored = read["A"].load()
    units, words = json.loads(stored.attrs["units"]), stored.attrs["noise_in_words"]
    assert (units["force_offset_sd"], units["diameter_noise_sd"]) == ("mN", "mm")
    assert "diameter_noise_sd = 0.02 mm (one standard deviation of a measured diameter)" in words
    assert "force_offset_sd inferred, in mN" in words
    assert json.loads(stored.attrs["noise"])["diameter_noise_sd"] == 0.02
    again = ph.inflation_model(data=data, **model_settings_of(stored))
    first = Pooled.of_tree(classes["A"]).model(data)
    point = first.initial_point()
    assert again.compile_logp(mode=AS_WRITTEN)(point) == pytest.approx(
        first.compile_logp(mode=AS_WRITTEN)(point), rel=1e-12
    )
    assert {"mu", "force_offset_sd", "force_offset_mean"} <= set(stored["posterior"].data_vars)
    assert ph.force_offsets(stored)["force_offset"].sizes["test"] == data.sizes["test"]


def test_a_result_says_its_errors_where_it_cannot_be_a_class():
    """With layers, and with the error of a radius in mm."""
    data = dataset(measured="outer_diameter", outer_radius=None)
    layer = ph.Layer(ph.NeoHookean(), 2.0)
    settings = {"slope_weight": 0, "force_noise_sd": 3.0, "force_offset_sd": 25.0}
    model = ph.inflation_model([layer], data, noise_sd=0.05, error_in="radius", **settings)
    words = model.study.result_attrs(model)["noise_in_words"]
    assert "a standard deviation of 0.05 mm" in words and "force_offset_sd = 25 mN" in words


def forced(**settings):
    return model_of(unknown_curves([30.0, 40.0, np.nan, 55.0]), **SDS | settings)


def likelihood(**settings):
    with pm.Model():
        data = unknown_curves([30.0, 40.0, np.nan, 55.0])
        ph.inflation_likelihood("curves", OGDEN, data, POINT, **{"slope_weight": 0.0} | settings)


BAD_INPUT = [
    (
        "offset of forces that play no part",
        lambda: model_of(curves(), noise_sd=1.0, force_offset_sd=5.0),
        TypeError,
        ["force_offset_sd is given", "force_noise_sd", "mN"],
    ),
    (
        "no forces",
        lambda: model_of(curves(), **OFFSET),
        ValueError,
        ["force_noise_sd is given", "no axial forces"],
    ),
    (
        "no offset",
        lambda: forced(force_offset_sd=0.0),
        ValueError,
        ["force_offset_sd is 0", "positive number of mN", "leave it away"],
    ),
    (
        "endless offset",
        lambda: forced(force_offset_sd=np.inf),
        ValueError,
        ["force_offset_sd is inf", "mN"],
    ),
    (
        "offset with a unit",
        lambda: forced(force_offset_sd="5 mN"),
        TypeError,
        ["force_offset_sd is '5 mN'", "mN", "distribution"],
    ),
    (
        "an offset a test",
        lambda: forced(force_offset_sd=pm.HalfNormal.dist(5, shape=2)),
        TypeError,
        ["force_offset_sd", "1 dimension"],
    ),
    (
        "negative error of the diameter",
        lambda: forced(diameter_noise_sd=-0.1),
        ValueError,
        ["diameter_noise_sd is -0.1", "positive number of mm"],
    ),
    (
        "slopes with an error of the diameter",
        lambda: forced(slope_weight=1.0),
        ValueError,
        ["slope_weight is 1.0", "diameter_noise_sd", "expected 0"],
    ),
    (
        "inferred slope weight with an error of the diameter",
        lambda: forced(slope_weight=pm.HalfNormal.dist()),
        ValueError,
        ["diameter_noise_sd", "expected 0"],
    ),
    (
        "two errors of the diameter",
        lambda: forced(error_in="radius"),
        ValueError,
        ["error_in='radius'", "leave diameter_noise_sd away"],
    ),
    (
        "offset twice as one of one's own model",
        lambda: likelihood(noise_sd=1.0, force_offset_sd=5.0),
        TypeError,
        ["force_offset_sd is given", "force_noise_sd"],
    ),
    (
        "offsets of classes whose specimens differ",
        lambda: ph.fit_classes(
            OGDEN, {"C": curves()}, slope_weight=0.0, variability="specimen", **OFFSET
        ),
        ValueError,
        ["class 'C'", "hold no axial forces"],
    ),
    (
        "offsets of a result without any",
        lambda: ph.force_offsets(xr.DataTree.from_dict({"posterior": curves()})),
        ValueError,
        ["no offset of a transducer", "force_offset_sd"],
    ),
    ("offsets of a Dataset", lambda: ph.force_offsets(curves()), TypeError, ["DataTree"]),
]


@pytest.mark.parametrize(("call", "error", "fragments"), table(BAD_INPUT))
def test_bad_input(call, error, fragments):
    """What is wrong is said before anything is sampled, with units and what to do."""
    assert_refused(call, error, fragments)
