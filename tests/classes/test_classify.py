"""Probabilities of new experiments, against quadrature and direct calculations."""

import exact
import fits
import numpy as np
import pytest
import xarray as xr
from interrupts import interrupt
from pooled_classes import NAMES, SEED, assert_exact, new_data
from scipy.special import softmax

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.classification import _decide, tabulate
from pymc_hyperelastic.classes.interface import Prediction
from pymc_hyperelastic.classes.pooled_prediction import ClassPredictive


@pytest.fixture(scope="module")
def classes():
    return fits.fit("pooled")


def classify(data, classes, **settings):
    return ph.classify(data, classes, **{"random_seed": SEED, "progressbar": False} | settings)


@pytest.fixture(scope="module")
def by_test(classes):
    return classify(ph.select(new_data(), experiment=1), classes)


def test_evidence_of_each_experiment_equals_quadrature(by_test):
    assert by_test["log_evidence"].dims == ("test", "class_label")
    assert by_test["specimen"].values.tolist() == ["B", "A"]
    assert by_test["experiment"].values.tolist() == [1, 1]
    assert by_test["class_label"].values.tolist() == [*NAMES]
    assert_exact(by_test[{"test": [0]}], [exact.curves_of(new_data())[:1]])
    assert by_test["decision"].values.tolist() == ["C2", "C1"]


def test_experiments_share_one_material_if_classified_by_specimen(classes):
    by_specimen = classify(new_data(), classes, by="specimen")
    assert by_specimen["log_evidence"].dims == ("specimen", "class_label")
    assert by_specimen["specimen"].values.tolist() == ["B", "A"]
    curves = exact.curves_of(new_data())
    assert_exact(by_specimen[{"specimen": [0]}], [curves[::2]])


def test_phases_are_doubted_if_they_are_classified_as_one_specimen(classes):
    """The numbers are those of the same tests without a phase."""
    data = ph.select(new_data(), specimen="B")
    phases = [f"phase {i}" for i in range(data.sizes["test"])]
    with_phases = data.assign_coords(phase=("test", phases))
    with pytest.warns(UserWarning, match="specimen 'B' has the phases 'phase 0', 'phase 1'"):
        found = classify(with_phases, classes, by="specimen")
    xr.testing.assert_equal(found["decision"], classify(data, classes, by="specimen")["decision"])
    classify(with_phases, classes)


def test_evidence_by_each_sampling_method_equals_quadrature(classes, monkeypatch):
    """A short experiment near the first class has no useful draws from the second class."""
    one = ph.select(fits.training()["C1"], specimen="S1", experiment=1)
    one = one.isel(obs=slice(3, None, 5))
    rng = np.random.default_rng(SEED)
    pressure = one["pressure"] + 0.3 * rng.standard_normal(one.sizes["obs"])
    data = one.assign(pressure=pressure.assign_attrs(one["pressure"].attrs))
    data = data.assign_coords(specimen=("test", ["new"]))
    for methods in (["class draws", "adapted draws"], ["tempering"] * 2):
        result = classify(data, classes)
        assert result["method"].values.tolist() == [methods]
        shape = result["pareto_k"].values
        assert np.all(np.isnan(shape) if methods[0] == "tempering" else shape < 0.5)
        assert_exact(result, [exact.curves_of(data)])
        # Each method is used only where those before it fail.
        for name in ("_from_class_draws", "_from_adapted_draws"):
            monkeypatch.setattr(ClassPredictive, name, lambda *_: None)


def test_class_prior_multiplies_the_odds_and_keeps_the_evidences(classes, by_test):
    """Evidences do not change, since the same seed gives the same draws."""
    one = ph.select(new_data(), specimen="A", experiment=1)
    result = classify(one, classes, class_prior={"C2": 0.9, "C1": 0.1})
    np.testing.assert_allclose(result["log_evidence"][0], by_test["log_evidence"][1])
    log_odds = result["log_evidence"].values + np.log([0.1, 0.9])
    np.testing.assert_allclose(result["class_probability"], softmax(log_odds, axis=1))
    result = classify(one, classes, class_prior={"C1": 0.0, "C2": 1.0})
    np.testing.assert_array_equal(result["class_probability"], [[0, 1]])
    assert result["decision"].item() == "C2"


def test_errors_of_probabilities_are_propagated_from_errors_of_evidences():
    """To first order, with the part that all classes have in common left out."""
    values, errors = np.array([-3.0, -4.0, -3.5]), np.array([0.01, 0.02, 0.015])
    prior = np.array([0.2, 0.5, 0.3])
    row = [
        Prediction(ph.Estimate(v, 0.5), e, "by hand", 0.1, probability_error=0.004)
        for v, e in zip(values, errors, strict=True)
    ]
    result = tabulate([row], prior, "specimen", ["a", "b", "c"])
    probability = prior * np.exp(values) / np.sum(prior * np.exp(values))
    np.testing.assert_allclose(result["class_probability"][0], probability)
    rng = np.random.default_rng(SEED)
    drawn = values + errors * rng.standard_normal((100_000, 3))
    spread = softmax(drawn + np.log(prior), axis=1).std(axis=0)
    found = result["class_probability_se"].values[0]
    np.testing.assert_allclose(found, np.hypot(spread, 0.004), rtol=0.01)
    np.testing.assert_array_equal(result["log_evidence_se"], 0.5)


def decided(undecided_below=0.0, none_below=0.0, **changes):
    """Return the decision for a result with two classes, some of whose values are changed."""
    values = {
        "log_evidence": [0.0, -5.0],
        "log_evidence_se": [0.01, 0.01],
        "class_probability": [0.99, 0.01],
        "pareto_k": [0.1, np.nan],
        "p_value": [0.5, 0.5],
    } | changes
    result = xr.Dataset(
        {name: (("specimen", "class_label"), [value]) for name, value in values.items()},
        {"class_label": list(NAMES)},
    )
    result["class_verdict"] = "class_label", ["good", "good"]
    return _decide(result, np.array([0.5, 0.5]), undecided_below, none_below).item()


@pytest.mark.parametrize(
    ("settings", "decision"),
    [
        ({"undecided_below": 0.99}, "C1"),
        ({"undecided_below": 0.991}, "undecided"),
        # Pareto shapes from 0.5 on are not to be trusted.
        ({"pareto_k": [0.499, 0.1]}, "C1"),
        ({"pareto_k": [0.5, 0.1]}, "cannot be judged"),
        ({"pareto_k": [0.1, np.inf]}, "cannot be judged"),
        # The evidence of a class does not matter if its probability is below 1e-4, exp(-9.21).
        ({"pareto_k": [0.1, np.inf], "log_evidence": [0.0, -9.1]}, "cannot be judged"),
        ({"pareto_k": [0.1, np.inf], "log_evidence": [0.0, -9.3]}, "C1"),
        ({"log_evidence_se": [np.inf, 0.1]}, "cannot be judged"),
        ({"p_value": [np.nan, 0.5]}, "C1"),
        ({"p_value": [np.nan, 0.5], "none_below": 0.05}, "cannot be judged"),
        ({"p_value": [0.049, 0.02], "none_below": 0.05}, "none of these"),
        ({"p_value": [0.049, 0.05], "none_below": 0.05}, "C1"),
        ({"log_evidence": [np.nan] * 2, "log_evidence_se": [np.nan] * 2}, ""),
        ({"log_evidence": [np.nan] * 2, "log_evidence_se": [np.inf] * 2}, "cannot be judged"),
    ],
)
def test_decision_is_the_most_probable_class_unless_a_limit_forbids_it(settings, decision):
    """An unreliable evidence forbids a decision only if it is near the largest evidence."""
    assert decided(**settings) == decision


def test_interrupt_keeps_finished_experiments_and_sets_others_to_nan(classes, by_test, monkeypatch):
    """The interrupt comes while the second experiment is classified."""
    interrupt(monkeypatch, ClassPredictive, "__call__", 4)
    with pytest.warns(UserWarning, match="NaN"):
        result = classify(ph.select(new_data(), experiment=1), classes)
    assert result.sizes == by_test.sizes
    first, expected = (x.isel(test=[0]).drop_attrs(deep=False) for x in (result, by_test))
    xr.testing.assert_identical(first, expected)
    assert np.isnan(result["log_evidence"].values[1:]).all()
    assert set(result["decision"].values[1:]) == {""}
