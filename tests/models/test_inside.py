"""Models of tubes as a PyMC user meets them: inside other models, observed, set and copied."""

import copy
import json
import warnings

import cloudpickle
import numpy as np
import pymc as pm
import pytest
import xarray as xr
from bad_input import assert_refused, curves, table, unknown_curves
from problems import AS_WRITTEN

import pymc_hyperelastic as ph
from pymc_hyperelastic.evidence.results import data_groups, sampling_tree, study_of
from pymc_hyperelastic.models.study import inflation_data_of, model_settings_of

OGDEN = ph.Ogden()
NOISE = {"noise_sd": 0.5, "slope_weight": 0.0}
ROUNDING = 1e-12


def log_density(model, **point):
    """Log-density of a model where its value variables have these values."""
    return float(model.compile_logp(mode=AS_WRITTEN)(point))


# --- inside a model -------------------------------------------------------------------------------


@pytest.mark.parametrize("likelihood", ["paper", "generative"])
def test_a_model_made_in_a_context_is_a_part_of_it(likelihood):
    """What is made inside `with` is in the model of the context, as everything of PyMC is."""
    settings = NOISE | {"likelihood": likelihood}
    with pm.Model() as own:
        x = pm.Normal("x")
        part = ph.inflation_model(OGDEN, curves(), **settings)
    alone = ph.inflation_model(OGDEN, curves(), **settings)
    assert part.root is own and alone.isroot
    assert [rv.name for rv in own.free_RVs] == ["x", "mu", "alpha"]
    assert set(alone.named_vars) == set(own.named_vars) - {"x"}
    point = alone.initial_point()
    found = log_density(own, **point, x=0.0) - pm.logp(x, 0.0).eval(mode=AS_WRITTEN)
    assert found == pytest.approx(log_density(alone, **point), rel=ROUNDING)


@pytest.mark.parametrize("likelihood", ["paper", "generative"])
def test_two_tubes_have_names_of_their_own(likelihood):
    """Tubes of different data and prefixes stand in one model, dimensions included."""
    short = curves((7.2, 7.6, 8.0), (2.0, 4.0, 7.0))
    forces = unknown_curves([30.0, np.nan, 40.0, 50.0])
    settings = NOISE | {"likelihood": likelihood}
    with pm.Model() as own:
        ph.inflation_model(OGDEN, short, **settings, name="one")
        ph.inflation_model(ph.Demiray(), forces, **settings, force_noise_sd=3.0, name="two")
    assert [rv.name for rv in own.free_RVs] == ["one::mu", "one::alpha", "two::mu", "two::b"]
    assert own.named_vars_to_dims["one::pressure"] == ("one::obs",)
    assert len(own.coords["one::obs"]) == 3 and len(own.coords["two::obs"]) == 4
    if likelihood == "generative":
        assert own.named_vars_to_dims["two::measured_axial_force"] == ("two::force_obs",)
    apart = [
        ph.inflation_model(OGDEN, short, **settings),
        ph.inflation_model(ph.Demiray(), forces, **settings, force_noise_sd=3.0),
    ]
    point, expected = {}, 0.0
    for prefix, model in zip(("one", "two"), apart, strict=True):
        of_part = model.initial_point()
        expected += log_density(model, **of_part)
        point |= {f"{prefix}::{name}": value for name, value in of_part.items()}
    assert log_density(own, **point) == pytest.approx(expected, rel=ROUNDING)


def test_parameters_may_be_variables_of_the_context():
    """A random variable, something computed of one, and a noise: each is registered once."""
    with pm.Model() as own:
        log_mu, alpha = pm.Normal("log_mu", 1, 0.3), pm.Uniform("alpha", 0, 20)
        sd, radius = pm.HalfNormal("sd"), pm.Uniform("unloaded", 6.9, 7.1)
        settings = {"priors": {"mu": pm.math.exp(log_mu), "alpha": alpha}, "slope_weight": 0}
        part = ph.inflation_model(
            OGDEN, curves(), noise_sd=sd, geometry={"inner_radius": radius}, **settings
        )
    assert [rv.name for rv in own.free_RVs] == ["log_mu", "alpha", "sd", "unloaded"]
    assert not list(part.free_RVs)
    values = [np.log(6.0), 8.0, 0.4, 7.0]
    inputs = dict(zip(own.free_RVs, values, strict=True))
    (found,) = (
        term.eval({rv: np.float64(v) for rv, v in inputs.items()}, mode=AS_WRITTEN)
        for term in own.potentials
    )
    with pm.Model() as reference:
        ph.inflation_likelihood(
            "likelihood", OGDEN, curves(), {"mu": 6.0, "alpha": 8.0}, noise_sd=0.4, slope_weight=0
        )
    expected = reference["likelihood"].eval(mode=AS_WRITTEN)
    assert found == pytest.approx(float(expected), rel=1e-9)


def test_layers_share_a_variable_of_the_context():
    """A variable of the context in both layers is one unknown."""
    data = unknown_curves(outer_radius=None)
    with pm.Model() as own:
        b = pm.Uniform("stiffening", 0.1, 5)
        layers = [ph.Layer(ph.Demiray(), 1.0, b=b), ph.Layer(ph.Demiray(), 1.0, b=b)]
        ph.inflation_model(layers, data, **NOISE)
    assert [rv.name for rv in own.free_RVs] == ["stiffening", "mu_1", "mu_2"]


def test_what_is_made_of_classes_minds_no_context():
    """Classes are fitted and classified inside `with` as outside, and leave no traces there."""
    settings = {"draws": 100, "chains": 1, "random_seed": 1, "progressbar": False}

    def study():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a hundred draws are few
            classes = ph.fit_classes(ph.NeoHookean(), {"C": curves()}, **NOISE, **settings)
        new = curves(pressure=(2.1, 3.9, 7.1, 12.1))
        result = ph.classify(new, classes, random_seed=1, progressbar=False)
        return result["log_evidence"]

    with pm.Model() as other:
        found = study()
    assert not other.named_vars and not other.coords
    xr.testing.assert_identical(found, study())


def inside(**settings):
    """A model in the context of one that has an own variable, and dimensions."""
    with pm.Model(coords={"test": ["mine"]}):
        mu = pm.Uniform("mu", 0, 50)
        ph.inflation_model(OGDEN, curves(), **NOISE, **({"priors": {"mu": mu}} | settings))


def foreign():
    with pm.Model():
        mu = pm.Uniform("mu", 0, 50)
    with pm.Model():
        ph.inflation_model(OGDEN, curves(), **NOISE, priors={"mu": mu})


def hierarchical():
    with pm.Model():
        mean = pm.Normal("mean")
        ph.inflation_model(OGDEN, curves(), **NOISE, priors={"mu": pm.LogNormal.dist(mean, 1)})


def of_class():
    with pm.Model():
        mu = pm.Uniform("mu", 0, 50)
        ph.fit_classes(OGDEN, {"C": curves()}, **NOISE, priors={"mu": mu})


def part():
    with pm.Model():
        part = ph.inflation_model(OGDEN, curves(), **NOISE, name="artery")
    ph.sample_smc(part)


def vector():
    with pm.Model():
        mu = pm.Uniform("mu", 0, 50, shape=2)
        ph.inflation_model(OGDEN, curves(), **NOISE, priors={"mu": mu})


BAD_INPUT = [
    ("names are taken", inside, ValueError, ["['test']", "name='artery'", "by itself"]),
    (
        "rising curves of one's own variables",
        lambda: inside(rising=True, name="artery"),
        ValueError,
        ["rising=True", "variables of your own model"],
    ),
    ("variable of another model", foreign, TypeError, ["'mu'", "with model:"]),
    ("unregistered child", hierarchical, TypeError, ["depends on the random variable 'mean'"]),
    ("classes of a variable", of_class, TypeError, ["'mu'", "by itself"]),
    ("part of a model", part, ValueError, ["'artery' is a part", "model.root"]),
    ("vector", vector, TypeError, ["'mu' has the shape (2,)", "scalar"]),
    (
        "name outside a model",
        lambda: ph.inflation_model(OGDEN, curves(), **NOISE, name="artery"),
        ValueError,
        ["'artery'", "no model is in context"],
    ),
    ("nothing to sample", ph.sample_smc, TypeError, ["no model is given", "in context"]),
]


@pytest.mark.parametrize(("call", "error", "fragments"), table(BAD_INPUT))
def test_bad_input(call, error, fragments):
    """What cannot be joined is refused with words that say what to do."""
    assert_refused(call, error, fragments)


# --- sampling -------------------------------------------------------------------------------------


def plain_model():
    """A model with data of every kind, and nothing of tubes."""
    with pm.Model(coords={"point": ["a", "b", "c"]}) as model:
        x = pm.Data("x", [0.0, 1.0, 2.0], dims="point")
        pm.Data("unit", 3.0)
        slope, intercept = pm.Normal("slope"), pm.Normal("intercept")
        pm.Normal("y", intercept + slope * x, 1.0, observed=[0.1, 0.9, 2.2], dims="point")
    return model


SETTINGS = {"draws": 100, "chains": 2, "progressbar": False}


def sample(*model, **settings):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a hundred draws are few
        return ph.sample_smc(*model, **SETTINGS | settings)


def test_tubes_in_a_model_of_ones_own_are_sampled(tmp_path):
    """The whole is sampled, with every name that was given, and its result can be saved."""
    noise = {"slope_weight": 0.0, "likelihood": "generative"}
    with pm.Model():
        mu, sd = pm.Uniform("mu", 1, 50), pm.HalfNormal("sd")
        for name in ("one", "two"):
            settings = {"priors": {"mu": mu}, "noise_sd": sd, "name": name, **noise}
            ph.inflation_model(ph.NeoHookean(), curves(), **settings)
        tree = sample(random_seed=1)
    curve = tree["posterior"]["two::pressure"]
    assert curve.dims == ("chain", "draw", "two::obs")
    xr.testing.assert_equal(
        curve.drop_vars("two::obs"),
        tree["posterior"]["one::pressure"].rename({"one::obs": "two::obs"}).drop_vars("two::obs"),
    )
    measured = tree["observed_data"]["one::measured_pressure"]
    np.testing.assert_array_equal(measured, curves()["pressure"])
    assert "strain_energy" not in tree.attrs
    tree.to_netcdf(tmp_path / "tubes.nc")
    loaded = xr.load_datatree(tmp_path / "tubes.nc")
    xr.testing.assert_equal(loaded["posterior"].to_dataset(), tree["posterior"].to_dataset())


def test_the_model_of_the_context_is_sampled():
    """Inside `with model:` no model need be given, and the result is the same."""
    model = plain_model()
    with model:
        found = sample(random_seed=3)
    expected = sample(model, random_seed=3)
    xr.testing.assert_equal(found["posterior"].to_dataset(), expected["posterior"].to_dataset())


def test_a_generator_is_a_seed():
    """One state gives one result, the next call another, and what was drawn is stored."""
    model = plain_model()
    rng = np.random.default_rng(1)
    first, second = (sample(model, random_seed=rng)["posterior"]["slope"] for _ in range(2))
    tree = sample(model, random_seed=np.random.default_rng(1))
    xr.testing.assert_equal(first, tree["posterior"]["slope"])
    assert not np.any(first.values == second.values)
    again = sample(model, random_seed=json.loads(tree.attrs["random_seed"]))
    xr.testing.assert_equal(first, again["posterior"]["slope"])


def test_data_are_stored_as_pymc_stores_them(tmp_path):
    """Observed and constant data are those that PyMC's own sampler gives, and can be saved."""
    model = plain_model()
    tree = sample(model, random_seed=1)
    with model:
        theirs = pm.sample_prior_predictive(2, random_seed=1, compile_kwargs={"mode": AS_WRITTEN})
    for group in ("observed_data", "constant_data"):
        found, expected = (t[group].to_dataset().drop_attrs() for t in (tree, theirs))
        xr.testing.assert_identical(found, expected)
    tree.to_netcdf(tmp_path / "plain.nc")
    loaded = xr.load_datatree(tmp_path / "plain.nc")
    xr.testing.assert_equal(
        loaded["observed_data"].to_dataset(), tree["observed_data"].to_dataset()
    )


def test_a_model_without_data_has_no_groups_of_them():
    """As with PyMC, there is no group where there is nothing to hold."""
    with pm.Model() as model:
        pm.Normal("x")
    assert data_groups(model) == {}


# --- copies ---------------------------------------------------------------------------------------

WAYS = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "method": lambda model: model.copy(),
    "pickle": lambda model: cloudpickle.loads(cloudpickle.dumps(model)),
    "copy of a copy": lambda model: copy.copy(copy.copy(model)),
}


def result_of(model):
    """Result of a model as it would be after sampling, with three draws."""
    names = ("beta", "log_marginal_likelihood", "log_evidence_variance")
    posterior = {"anything": np.ones((1, 3))}
    return sampling_tree(model, posterior, {}, [{name: [1.0] for name in names}], {}, 1)


FORMS = {
    "paper": lambda: ph.ogden_model(curves(), **NOISE),
    "generative": lambda: ph.ogden_model(curves(), **NOISE, likelihood="generative"),
    "population": lambda: ph.population_model(OGDEN, curves(), noise_sd=0.5),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("way", WAYS)
def test_copies_know_what_they_were_made_from(way, form):
    """The result of a copy holds what that of the model does."""
    model = FORMS[form]()
    found, expected = result_of(WAYS[way](model)), result_of(model)
    assert found.attrs == expected.attrs and "noise_in_words" in found.attrs
    for group in ("observed_data", "constant_data"):
        xr.testing.assert_identical(found[group].to_dataset(), expected[group].to_dataset())


@pytest.mark.parametrize(
    ("change", "group"), [(pm.observe, "observed_data"), (pm.do, "constant_data")]
)
@pytest.mark.parametrize("likelihood", ["paper", "generative"])
def test_a_model_that_was_observed_or_set_knows_its_data(change, group, likelihood):
    """Its result holds data, law and what was set, and does not claim the priors of before."""
    model = ph.ogden_model(curves(), **NOISE, likelihood=likelihood)
    changed = change(model, {"alpha": 8.0})
    assert [rv.name for rv in changed.free_RVs] == ["mu"]
    assert study_of(changed).data is model.study.data
    tree = result_of(changed)
    assert tree[group]["alpha"].item() == 8.0
    xr.testing.assert_equal(inflation_data_of(tree)["pressure"], curves()["pressure"])
    assert tree.attrs["strain_energy"] == "Ogden"
    with pytest.raises(ValueError, match="does not say from which model"):
        model_settings_of(tree)


def test_a_variable_called_study_is_no_study():
    """A model of one's own may have a variable of that name."""
    with pm.Model() as model:
        pm.Normal("study")
    assert study_of(model) is None
    assert "constant_data" not in result_of(model).children
