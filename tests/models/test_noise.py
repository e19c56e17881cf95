"""A standard deviation says what the paper's σ = √2 standard deviations says, everywhere."""

import json

import numpy as np
import pandas as pd
import pymc as pm
import pytest
from bad_input import assert_refused, curves, table, unknown_curves
from problems import AS_WRITTEN
from scipy import stats

import pymc_hyperelastic as ph
from pymc_hyperelastic.evidence.results import sampling_tree
from pymc_hyperelastic.models.study import model_settings_of

OGDEN = ph.Ogden()
POINT = {"mu": 6.0, "alpha": 8.0}
SD, FORCE_SD = 0.4, 3.0
ROUNDING = 1e-12
FORCES = [30.0, 40.0, np.nan, 55.0]


def specimens():
    """Two specimens of one tube, one of them tested twice."""
    frame = pd.DataFrame({"specimen": np.repeat(["S1", "S2", "S2"], 4)})
    frame["experiment"] = np.repeat([1, 1, 2], 4)
    frame["radius"] = np.tile([7.2, 7.6, 8.0, 8.4], 3)
    frame["pressure"] = np.outer([1.0, 1.2, 1.3], [2.0, 4.0, 7.0, 12.0]).ravel()
    return ph.inflation_data(frame, inner_radius=7.0, outer_radius=9.0)


def density(model, **point):
    """Log-density of a model's data where the values on the scale of its variables are these."""
    inputs = [model[name] for name in point]
    terms = [*model.observed_RVs, *model.potentials]
    outputs = model.replace_rvs_by_values([model.logp(terms)])
    function = model.compile_fn(
        outputs, inputs=model.value_vars, mode=AS_WRITTEN, on_unused_input="ignore"
    )
    assert len(inputs) == len(model.free_RVs)
    values = {}
    for variable in inputs:
        value = np.asarray(point[variable.name], float)
        transform = model.rvs_to_transforms[variable]
        if transform is not None:
            value = transform.forward(value, *variable.owner.inputs).eval(mode=AS_WRITTEN)
        values[model.rvs_to_values[variable].name] = value
    return float(np.sum(function(values)))


FORMS = {
    "pressures": {"slope_weight": 0},
    "slopes": {"slope_weight": 2.0},
    "radius": {"slope_weight": 0, "error_in": "radius"},
    "generative": {"slope_weight": 0, "likelihood": "generative"},
    "generative with slopes": {"slope_weight": 2.0, "likelihood": "generative"},
}


@pytest.mark.parametrize("form", FORMS)
def test_the_model_is_that_of_the_papers_sigma(form):
    """Every likelihood is the same for a standard deviation and for √2 of it as ``sigma``."""
    one = ph.inflation_model(OGDEN, curves(), noise_sd=SD, **FORMS[form])
    other = ph.inflation_model(OGDEN, curves(), sigma=np.sqrt(2) * SD, **FORMS[form])
    found, expected = (density(model, **POINT) for model in (one, other))
    assert np.isfinite(expected)
    assert found == pytest.approx(expected, rel=ROUNDING)


@pytest.mark.parametrize("likelihood", ["paper", "generative"])
def test_pressures_and_forces_have_that_standard_deviation(likelihood):
    """Without slopes the density is that of independent normal errors, by SciPy."""
    data = unknown_curves(FORCES)
    noise = {"noise_sd": SD, "force_noise_sd": FORCE_SD}
    model = ph.inflation_model(OGDEN, data, slope_weight=0, likelihood=likelihood, **noise)
    inputs = [model[name] for name in POINT]
    means = [model["pressure"], model["axial_force"]]
    mean = dict(zip(inputs, POINT.values(), strict=True))
    pressure, force = (
        curve.eval({v: np.float64(x) for v, x in mean.items()}, mode=AS_WRITTEN) for curve in means
    )
    expected = stats.norm(pressure, SD).logpdf(data["pressure"]).sum()
    expected += np.nansum(stats.norm(force, FORCE_SD).logpdf(data["axial_force"]))
    assert density(model, **POINT) == pytest.approx(expected, rel=1e-9)


def test_a_prior_is_one_of_the_standard_deviation():
    """What is inferred carries the name by which it was given, and is a standard deviation."""
    priors = {"noise_sd": pm.HalfNormal.dist(1), "force_noise_sd": pm.HalfNormal.dist(5)}
    data = unknown_curves(FORCES)
    inferred = ph.inflation_model(OGDEN, data, slope_weight=1.0, **priors)
    assert [rv.name for rv in inferred.free_RVs] == ["mu", "alpha", *priors]
    found = density(inferred, **POINT, noise_sd=SD, force_noise_sd=FORCE_SD)
    known = ph.inflation_model(
        OGDEN, data, slope_weight=1.0, sigma=2**0.5 * SD, force_sigma=2**0.5 * FORCE_SD
    )
    assert found == pytest.approx(density(known, **POINT), rel=ROUNDING)


def test_the_likelihood_in_a_model_of_ones_own_takes_it():
    """It may be a number, or a random variable of that model."""
    with pm.Model() as model:
        sd = pm.HalfNormal("sd")
        settings = {"slope_weight": 1.0}
        ph.inflation_likelihood("curves", OGDEN, curves(), POINT, noise_sd=sd, **settings)
    with pm.Model() as known:
        ph.inflation_likelihood("curves", OGDEN, curves(), POINT, sigma=2**0.5 * SD, **settings)
    assert density(model, sd=SD) == pytest.approx(density(known), rel=ROUNDING)


def test_specimens_of_a_population_have_standard_deviations():
    """A known one is that of every specimen; an inferred one is the median of theirs."""
    data = specimens()
    one = ph.population_model(OGDEN, data, noise_sd=SD)
    other = ph.population_model(OGDEN, data, sigma=2**0.5 * SD)
    assert [rv.name for rv in one.free_RVs] == [rv.name for rv in other.free_RVs]
    point = one.initial_point()
    found, expected = (m.compile_logp(mode=AS_WRITTEN)(point) for m in (one, other))
    assert found == pytest.approx(expected, rel=ROUNDING)

    inferred = ph.population_model(OGDEN, data, noise_sd=pm.LogNormal.dist(-1, 0.5))
    assert {"noise_sd", "noise_spread", "log_specimen_sigma"} <= set(inferred.named_vars)
    assert inferred.named_vars_to_dims["specimen_noise_sd"] == ("specimen",)
    names = ["specimen_noise_sd", "log_specimen_sigma", "noise_sd", "noise_spread"]
    of_specimens, logs, sd, spread = pm.draw(
        [inferred[name] for name in names], 4000, random_seed=1, mode=AS_WRITTEN
    )
    np.testing.assert_allclose(of_specimens, np.exp(logs) / np.sqrt(2))
    standard = np.log(of_specimens / sd[:, None]) / spread[:, None]
    assert abs(standard.mean()) < 5 / np.sqrt(4000)
    # With a sigma nothing is added to what was there before.
    inferred = ph.population_model(OGDEN, data, sigma=pm.LogNormal.dist(-1, 0.5))
    assert "specimen_noise_sd" not in inferred.named_vars


def result_of(model):
    """Result of a model as it would be after sampling, with three draws."""
    names = ("beta", "log_marginal_likelihood", "log_evidence_variance")
    posterior = {rv.name: np.ones((1, 3)) for rv in model.free_RVs}
    return sampling_tree(model, posterior, {}, [{name: [1.0] for name in names}], {}, 1)


def test_results_say_both():
    """A number is stored as the paper's σ, as it always was, and said in words as both."""
    first, second = (
        result_of(ph.ogden_model(curves(), slope_weight=0, **noise)).attrs
        for noise in ({"noise_sd": SD}, {"sigma": SD * np.sqrt(2)})
    )
    assert first == second
    assert json.loads(first["noise"]) == {"sigma": SD * np.sqrt(2), "slope_weight": 0.0}
    assert "sigma = 0.565685 kPa (a standard deviation of 0.4 kPa)" in first["noise_in_words"]


@pytest.mark.parametrize(
    ("name", "words"),
    [("noise_sd", "one standard deviation"), ("sigma", "√2 standard deviations")],
)
def test_a_stored_prior_is_read_back_as_what_it_was(name, words):
    """A distribution is stored by the name by which it was given, and makes the same model."""
    model = ph.ogden_model(curves(), slope_weight=0, **{name: pm.Gamma.dist(2, 1)})
    tree = result_of(model)
    assert words in tree.attrs["noise_in_words"]
    assert json.loads(tree.attrs["units"])[name] == "kPa"
    again = ph.inflation_model(data=curves(), **model_settings_of(tree))
    point = POINT | {name: SD}
    assert density(again, **point) == pytest.approx(density(model, **point), rel=ROUNDING)


def both(call, **settings):
    return lambda: call(**{"noise_sd": 1.0, "sigma": 1.0} | settings)


def pooled(**settings):
    return ph.fit_classes(OGDEN, {"C": curves()}, **{"slope_weight": 0.0} | settings)


def variable(**settings):
    return pooled(variability="specimen", **settings)


def report(**settings):
    data = {name: specimens() for name in ("one",)}
    return ph.calibration_report(OGDEN, data, **settings)


def population(**settings):
    return ph.population_model(OGDEN, curves(), **settings)


def model(**settings):
    return ph.ogden_model(curves(), slope_weight=0.0, **settings)


def likelihood(**settings):
    with pm.Model():
        ph.inflation_likelihood("curves", OGDEN, curves(), POINT, slope_weight=0.0, **settings)


CALLS = (pooled, variable, report, population, model, likelihood)
NEITHER, BOTH = ["noise_sd", "sigma is None", "√2"], ["both noise_sd and sigma", "√2"]
BAD_INPUT = [
    *((f"no noise: {call.__name__}", call, TypeError, NEITHER) for call in CALLS),
    *((f"noise twice: {call.__name__}", both(call), TypeError, BOTH) for call in CALLS),
    (
        "no standard deviation",
        lambda: model(noise_sd=0),
        ValueError,
        ["noise_sd is 0", "positive", "standard deviation"],
    ),
    ("unit", lambda: model(noise_sd="2 mmHg"), TypeError, ["noise_sd is '2 mmHg'", "2 * ph.mmHg"]),
    (
        "forces twice",
        lambda: model(noise_sd=1.0, force_sigma=1.0, force_noise_sd=1.0),
        TypeError,
        ["both force_noise_sd and force_sigma"],
    ),
    (
        "no forces",
        lambda: model(noise_sd=1.0, force_noise_sd=1.0),
        ValueError,
        ["force_noise_sd is given", "no axial forces"],
    ),
    (
        "a normal distribution of a standard deviation",
        lambda: population(noise_sd=pm.Normal.dist(0.5, 0.3)),
        ValueError,
        ["prior of 'noise_sd' holds numbers such as -", "positive numbers"],
    ),
    (
        "forces of classes whose specimens differ",
        lambda: variable(noise_sd=1.0, force_noise_sd=1.0),
        ValueError,
        ["force_noise_sd", "hold no axial forces"],
    ),
]


@pytest.mark.parametrize(("call", "error", "fragments"), table(BAD_INPUT))
def test_bad_input(call, error, fragments):
    """The noise is given once; whoever says it twice, or not at all, is told of both names."""
    assert_refused(call, error, fragments)
