"""Three ways to one integral: the marginal likelihood of new data under a fitted class."""

from functools import cache

import exact
import numpy as np
import pandas as pd
import pymc as pm
import pytest

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.pooled import ClassPredictive

SEED = 1125
# An honest standard error is exceeded threefold once in 370 runs; seeds are fixed.
STANDARD_ERRORS = 3
# Nats. Odds of classes are then right to a sixth, where they decide anything; importance sampling
# of four thousand draws, of which a fourth is effective, is good to three times 0.03 at worst.
EVIDENCE_TOLERANCE, IMPORTANCE_TOLERANCE = 0.15, 0.1
# The package's own bound for weights whose mean has a variance.
LARGEST_PARETO_K = 0.5
NAMES = ("C1", "C2")
BOX = ((0.0, 100.0), (-40.0, 40.0))
TUBE = {"inner_radius": 7.0, "outer_radius": 9.0}


@cache
def study():
    return ph.load_dataset("simulated_sheep_aorta")


def noise():
    return {"sigma": 15 * ph.mmHg, "slope_weight": ph.balanced_slope_weight(study())}


def training(name):
    return ph.select(study(), group=name, experiment=1)


def near():
    """An experiment on a specimen of the first class."""
    return ph.select(study(), specimen="S2", experiment=2)


def inflated(mu, alpha, axial_stretch=1.0, experiment=1):
    """An experiment on a tube of this material, with an error that is no one's chance."""
    radius = np.linspace(7.3, 10.2, 20)
    tube = exact.Curve(radius, np.zeros(20), *TUBE.values(), axial_stretch)
    pressure = mu * tube.responses("Ogden", alpha)[0][0] + 0.3 * np.sin(3 * np.arange(20))
    return pd.DataFrame(
        {
            "specimen": "new",
            "experiment": experiment,
            "radius": radius,
            "pressure": pressure,
            "axial_stretch": axial_stretch,
        }
    )


def fit(names=NAMES, draws=1000, chains=4, **settings):
    return ph.fit_classes(
        ph.Ogden(),
        {name: training(name) for name in names},
        draws=draws,
        chains=chains,
        random_seed=SEED,
        progressbar=False,
        **noise() | settings,
    )


def classify(data, classes, **settings):
    return ph.classify(data, classes, random_seed=SEED, progressbar=False, **settings)


@cache
def exact_evidence(name, *, new=None):
    curves = exact.curves_of(training(name))
    return exact.posterior(curves + list(new or ()), "Ogden", box=BOX, **noise()).log_evidence


def exact_predictive(name, data):
    return exact_evidence(name, new=tuple(exact.curves_of(data))) - exact_evidence(name)


def assert_exact(result, data, tolerance=EVIDENCE_TOLERANCE):
    """One experiment's evidence under each class, within its error bars of quadrature."""
    truth = [exact_predictive(name, data) for name in result["class_label"].values]
    wrong = np.abs(result["log_evidence"].values[0] - truth)
    assert np.all(wrong < STANDARD_ERRORS * result["log_evidence_se"].values[0]), wrong
    assert np.all(wrong < tolerance), wrong


@pytest.fixture(scope="module")
def classes():
    return fit()


@pytest.fixture(scope="module")
def three_ways(classes):
    """An experiment near the first class; each way is taken once those before it fail."""
    results = {}
    with pytest.MonkeyPatch.context() as patch:
        results["class draws"] = classify(near(), classes)
        patch.setattr(ClassPredictive, "_from_class_draws", lambda *_: None)
        results["adapted draws"] = classify(near(), classes)
        patch.setattr(ClassPredictive, "_from_adapted_draws", lambda *_: None)
        results["tempering"] = classify(near(), classes)
    return results


def test_each_way_is_named_and_trusted(three_ways):
    """The cheapest comes first, weights have a small Pareto shape, and SMC has no weights.

    Far from the second class its draws are of no use, and are passed over at once.
    """
    for method, result in three_ways.items():
        assert result["method"].dims == result["pareto_k"].dims == ("test", "class_label")
        assert result["method"].sel(class_label="C1").item() == method
        other = "tempering" if method == "tempering" else "adapted draws"
        assert result["method"].sel(class_label="C2").item() == other
    for method in ("class draws", "adapted draws"):
        assert np.all(three_ways[method]["pareto_k"] < LARGEST_PARETO_K)
    assert np.all(np.isnan(three_ways["tempering"]["pareto_k"]))


@pytest.mark.parametrize("method", ["class draws", "adapted draws", "tempering"])
def test_each_way_gives_the_exact_evidence(three_ways, method):
    """By two-dimensional quadrature, under the class at hand and under the other one."""
    assert_exact(three_ways[method], near())


@pytest.mark.parametrize("other", ["adapted draws", "tempering"])
def test_all_ways_agree(three_ways, other):
    """Within their error bars of the first of them."""
    results = three_ways["class draws"], three_ways[other]
    apart = results[0]["log_evidence"] - results[1]["log_evidence"]
    errors = np.hypot(*(result["log_evidence_se"] for result in results))
    assert np.all(np.abs(apart) < STANDARD_ERRORS * errors)


@pytest.mark.parametrize(("mu", "alpha"), [(40.0, 2.0), (80.0, -1.0)])
def test_an_experiment_far_from_all_classes_has_the_exact_evidence(classes, mu, alpha):
    """A material unlike either class: both evidences are tiny, and are known all the same."""
    data = ph.inflation_data(inflated(mu, alpha), **TUBE)
    result = classify(data, classes)
    assert np.all(result["log_evidence"] < -150)  # that of a good fit is about 0
    assert_exact(result, data, IMPORTANCE_TOLERANCE)


@pytest.mark.parametrize("chains", [1, 4])
def test_a_few_draws_are_never_averaged_as_they_are(chains):
    """Hundreds of draws of a class cannot be a thousand effective ones; the evidence is exact."""
    result = classify(near(), fit(["C1"], draws=100, chains=chains))
    assert result["method"].item() != "class draws"
    assert_exact(result, near())


def test_inferred_noise_and_two_axial_stretches():
    """A third parameter and a specimen at two stretches: the evidence gained by joint training.

    Three evidences of samplers enter, and the test allows four standard errors of them all.
    """
    settings = {"sigma": pm.HalfNormal.dist(2.0)}
    classes = fit(["C1"], draws=500, **settings)
    new = pd.concat([inflated(34.0, 6.8), inflated(34.0, 6.8, 1.1, experiment=2)])
    new = new.assign(inner=7.0, outer=9.0)
    geometry = {"inner_radius": "inner", "outer_radius": "outer", "axial_stretch": "axial_stretch"}
    result = classify(ph.inflation_data(new, **geometry), classes, by="specimen")

    old = training("C1")
    at = old["test"].values
    labels = {name: old[name].values[at] for name in ("specimen", "experiment", "axial_stretch")}
    table = pd.DataFrame(
        {
            **labels,
            "radius": old["radius"].values,
            "pressure": old["pressure"].values,
            "inner": old["inner_radius"].values[at],
            "outer": old["outer_radius"].values[at],
        }
    )
    joint = ph.inflation_data(pd.concat([table, new]), **geometry)
    model = ph.ogden_model(joint, **noise() | settings)
    together = ph.log_evidence(
        ph.sample_smc(model, 1000, 2, random_seed=SEED, progressbar=False, var_names=["mu"])
    )
    alone = ph.log_evidence(classes["C1"])
    errors = together.standard_error, alone.standard_error, result["log_evidence_se"].item()
    wrong = result["log_evidence"].item() - (together.value - alone.value)
    assert abs(wrong) < 4 * np.linalg.norm(errors)
    assert np.linalg.norm(errors) < EVIDENCE_TOLERANCE
