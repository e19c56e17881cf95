"""Models of tubes for users of PyMC: alone, in another model, after observe or do, and copied."""

import copy
import json

import cloudpickle
import fits
import numpy as np
import pandas as pd
import pymc as pm
import pytest
import xarray as xr
from bad_input import curves
from problems import AS_WRITTEN

import pymc_hyperelastic as ph
from pymc_hyperelastic.data.inflation import at_points
from pymc_hyperelastic.evidence.batched import BatchedFunction
from pymc_hyperelastic.evidence.results import sampling_tree, study_of
from pymc_hyperelastic.models.settings import inflation_data_of, model_settings_of

OGDEN, POINT = ph.Ogden(), {"mu": 6.0, "alpha": 8.0}
NOISE, OBSERVED = ph.Gaussian(0.5), ph.Gaussian(0.5, observed=True)
# Relative errors: of one expression evaluated twice, and of sums of squares by two rules.
ROUNDING, SAME_LIKELIHOOD = 1e-12, 1e-9
GEOMETRY = ("inner_radius", "outer_radius", "axial_stretch", "opening_angle")


@pytest.fixture(scope="module")
def data():
    return ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen=["S1", "S4"], experiment=1)


def at(model, names, values):
    """Variables of a model at values of its free random variables."""
    inputs, outputs = [model[name] for name in values], [model[name] for name in names]
    settings = {"mode": AS_WRITTEN, "on_unused_input": "ignore"}
    return pm.compile(inputs, outputs, **settings)(*values.values())


def log_density(model, **point):
    return float(model.compile_logp(mode=AS_WRITTEN)(point))


def test_variables_have_the_documented_names_and_the_curves_of_the_tube(data):
    model = ph.ogden_model(data, ph.SlopeAugmented(sigma=5 * ph.mmHg, slope_weight=1.0))
    assert [rv.name for rv in model.free_RVs] == ["mu", "alpha"]
    assert [v.name for v in model.deterministics] == ["pressure", "stiffness"]
    assert [v.name for v in model.potentials] == ["likelihood"]
    assert model.named_vars_to_dims == {"pressure": ("obs",), "stiffness": ("obs",)}
    tests = ["specimen 'S1', experiment 1", "specimen 'S4', experiment 1"]
    assert list(model.coords["test"]) == tests
    assert len(model.coords["obs"]) == data.sizes["obs"]
    tube = ph.Tube(**{name: at_points(data, name) for name in GEOMETRY})
    found = at(model, ["pressure", "stiffness"], POINT)
    exact = (ph.inflation_pressure, ph.inflation_stiffness)
    for values, function in zip(found, exact, strict=True):
        expected = function(OGDEN, data["radius"].values, tube, **POINT)
        np.testing.assert_allclose(values, expected.eval(mode=AS_WRITTEN), rtol=1e-10)


def test_factories_pass_their_law_and_all_settings(data):
    for factory, energy in (
        (ph.power_law_neo_hookean_model, ph.PowerLawNeoHookean()),
        (ph.ogden_model, ph.Ogden()),
        (ph.criscione_model, ph.CriscioneType()),
    ):
        last = energy.parameter_names[-1]
        settings = {"priors": {last: pm.Uniform.dist(1, 9)}, "mode": "quadrature"}
        special = factory(data, NOISE, **settings)
        general = ph.inflation_model(energy, data, NOISE, **settings)
        assert special.study.energy == energy
        assert special.study.settings() == general.study.settings()


def test_prior_restricted_to_rising_pressures_integrates_to_one():
    """The density is 0 where pressures fall, and elsewhere divided by the share of other curves."""
    radius = np.linspace(7.2, 12.0, 6)
    frame = {"specimen": "A", "experiment": 1, "radius": radius, "pressure": radius - 7}
    tube = ph.Tube(inner_radius=7.0, outer_radius=9.0)
    data = ph.inflation_data(pd.DataFrame(frame), tube)
    settings = {"priors": {"n": pm.Uniform.dist(0.3, 5.0)}, "rising": True}
    model = ph.power_law_neo_hookean_model(data, NOISE, **settings)
    # The modulus is a factor, and does not change the sign of the stiffness.
    exponents, between = np.linspace(0.3, 5.0, 401), np.linspace(*radius[[0, -1]], 200)[:, None]
    material = {"mu": 1.0, "n": exponents}
    stiffness = ph.inflation_stiffness(ph.PowerLawNeoHookean(), between, tube, **material)
    share = np.mean(np.all(stiffness.eval(mode=AS_WRITTEN) > 0, axis=0))
    assert 0.5 < share < 0.99
    assert at(model, ["rising"], {"mu": 20.0, "n": 0.35}) == [-np.inf]
    (found,) = at(model, ["rising"], {"mu": 20.0, "n": 4.0})
    assert np.abs(found + np.log(share)) < 0.02  # the share among 20000 draws from the prior
    with pytest.raises(ValueError, match=r"have a pressure that rises.*do not contradict"):
        ph.power_law_neo_hookean_model(
            data, NOISE, **settings | {"priors": {"n": pm.Uniform.dist(0.3, 0.31)}}
        )


# --- in the context of another model -------------------------------------------------------------


@pytest.mark.parametrize(
    "likelihood",
    [ph.SlopeAugmented(0.6, 1.0), ph.Gaussian(0.6), ph.Gaussian(0.6, force_sd=5.0)],
    ids=lambda likelihood: repr(likelihood),
)
def test_a_density_computes_no_more_numbers_if_there_are_more_points(likelihood):
    """With a known tube and known radii, a few nodes stand for all points of a test."""

    def cost(points):
        radius = np.linspace(7.3, 10.2, points)
        frame = pd.DataFrame({"specimen": "S", "experiment": 1, "radius": radius})
        frame = frame.assign(pressure=50 * np.log(radius / 7), axial_force=100.0)
        data = ph.inflation_data(frame, ph.Tube(7.0, 9.0, axial_stretch=1.2), check="ignore")
        model = ph.ogden_model(data, likelihood)
        return BatchedFunction.of_model(model, [model.logp()]).cost()

    assert cost(1000) == cost(100)


def test_log_densities_of_two_tubes_in_one_model_add_up():
    """The tubes differ in data, law and dimensions; only the second one has a prefix."""
    short = curves((7.2, 7.6, 8.0), (2.0, 4.0, 7.0))
    forces = curves(forces=[30.0, np.nan, 40.0, 50.0])
    with_forces = ph.Gaussian(0.5, force_sd=3.0, force_offset_sd=2.0, observed=True)
    with pm.Model() as own:
        x = pm.Normal("x")
        part = ph.inflation_model(OGDEN, short, OBSERVED)
        ph.inflation_model(ph.Demiray(), forces, with_forces, name="two")
    assert part.root is own
    assert [rv.name for rv in own.free_RVs] == ["x", "mu", "alpha", "two::mu", "two::b"]
    assert own.named_vars_to_dims["two::pressure"] == ("two::obs",)
    assert len(own.coords["obs"]) == 3 and len(own.coords["two::obs"]) == 4
    assert own.named_vars_to_dims["two::measured_axial_force"] == ("two::force_obs",)
    assert own.named_vars_to_dims["two::force_offset_mean"] == ("two::test",)
    one = ph.inflation_model(OGDEN, short, OBSERVED)
    two = ph.inflation_model(ph.Demiray(), forces, with_forces)
    points = one.initial_point(), two.initial_point()
    expected = log_density(one, **points[0]) + log_density(two, **points[1])
    expected += pm.logp(x, 0.0).eval(mode=AS_WRITTEN)
    point = points[0] | {f"two::{name}": value for name, value in points[1].items()}
    assert log_density(own, **point, x=0.0) == pytest.approx(expected, rel=ROUNDING)


def test_parameters_noise_and_geometry_can_be_variables_of_the_own_model():
    """Random variables, and expressions of them, are registered once."""
    with pm.Model() as own:
        log_mu, alpha = pm.Normal("log_mu", 1, 0.3), pm.Uniform("alpha", 0, 20)
        sd, radius = pm.HalfNormal("sd"), pm.Uniform("unloaded", 6.9, 7.1)
        priors = {"mu": pm.math.exp(log_mu), "alpha": alpha, "inner_radius": radius}
        part = ph.inflation_model(OGDEN, curves(), sd, priors=priors, mode="quadrature")
        layers = [ph.Layer(ph.Demiray(), 1.0, b=alpha), ph.Layer(ph.Demiray(), 1.0, b=alpha)]
        thick = curves(outer_radius=None)
        ph.inflation_model(layers, thick, NOISE, name="wall", mode="quadrature")
    names = ["log_mu", "alpha", "sd", "unloaded", "wall::mu_1", "wall::mu_2"]
    assert [rv.name for rv in own.free_RVs] == names and not list(part.free_RVs)
    values = {"log_mu": np.log(6.0), "alpha": 8.0, "sd": 0.4, "unloaded": 7.0}
    (found,) = at(own, ["likelihood"], values)
    known = ph.inflation_model(OGDEN, curves(), 0.4)
    (expected,) = at(known, ["likelihood"], POINT)
    assert found == pytest.approx(float(expected), rel=SAME_LIKELIHOOD)


# --- results and copies ---------------------------------------------------------------------------


def result_of(model):
    """Return a result of a model with three draws, as it is after sampling."""
    names = ("beta", "log_marginal_likelihood", "log_evidence_variance")
    posterior = {"anything": np.ones((1, 3))}
    point = model.initial_point()
    unconstrained = {name: np.asarray(value)[None, None] for name, value in point.items()}
    return sampling_tree(model, posterior, unconstrained, [[dict.fromkeys(names, 1.0)]], {}, 1)


def test_model_can_be_rebuilt_from_its_stored_result(tmp_path):
    """Data, law, priors and likelihood survive a file, with their units."""
    tree = fits.fit("sampled")
    tree.to_netcdf(tmp_path / "result.nc", engine="h5netcdf")
    tree = xr.load_datatree(tmp_path / "result.nc", engine="h5netcdf")
    data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1")
    xr.testing.assert_identical(inflation_data_of(tree), data)
    first = ph.ogden_model(data, ph.SlopeAugmented(sigma=5 * ph.mmHg, slope_weight=3.0))
    settings = model_settings_of(tree)
    parts = settings.make_wall(), inflation_data_of(tree), settings.make_likelihood()
    again = ph.inflation_model(*parts, priors=settings.make_priors())
    assert again.study.settings() == first.study.settings()
    for draw in (0, 250):
        particles = tree["unconstrained_posterior"].to_dataset().isel(chain=0, draw=draw)
        point = {name: value.values for name, value in particles.data_vars.items()}
        assert log_density(again, **point) == pytest.approx(log_density(first, **point), ROUNDING)
    units = {"sigma": "kPa", "slope_weight": "mm²", "mu": "kPa", "alpha": ""}
    assert json.loads(tree.attrs["units"]) == units
    assert json.loads(tree.attrs["versions"])["pymc"] == pm.__version__
    assert tree["posterior"]["pressure"].dims == ("chain", "draw", "obs")


@pytest.mark.parametrize("likelihood", [NOISE, OBSERVED])
def test_result_keeps_the_data_of_its_model_if_the_users_data_change(likelihood):
    data = curves()
    original = data.copy(deep=True)
    model = ph.ogden_model(data, likelihood)
    data["pressure"][:], data["inner_radius"][:] = 99.0, 6.0
    xr.testing.assert_identical(inflation_data_of(result_of(model)), original)


def test_copied_and_pickled_models_keep_their_study():
    generative = ph.ogden_model(curves(), OBSERVED)
    for model in (generative, ph.population_model(OGDEN, curves(), 0.5)):
        expected = result_of(model)
        for other in (copy.copy(copy.deepcopy(model)), cloudpickle.loads(cloudpickle.dumps(model))):
            found = result_of(other)
            assert found.attrs == expected.attrs
            for group in ("observed_data", "constant_data"):
                xr.testing.assert_identical(found[group].to_dataset(), expected[group].to_dataset())


@pytest.mark.parametrize(
    ("change", "group", "likelihood"),
    [(pm.observe, "observed_data", NOISE), (pm.do, "constant_data", OBSERVED)],
)
def test_model_after_observe_or_do_keeps_its_data_but_no_stored_priors(change, group, likelihood):
    model = ph.ogden_model(curves(), likelihood)
    changed = change(model, {"alpha": 8.0})
    assert [rv.name for rv in changed.free_RVs] == ["mu"]
    assert study_of(changed).data is model.study.data
    tree = result_of(changed)
    assert tree[group]["alpha"].item() == 8.0 and tree.attrs["strain_energy"] == "Ogden"
    xr.testing.assert_equal(inflation_data_of(tree)["pressure"], curves()["pressure"])
    assert model_settings_of(tree).laws == ["Ogden"] and model_settings_of(tree).priors is None
