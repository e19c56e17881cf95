"""Averages over strain energies, against direct calculations from evidences and their errors."""

from functools import partial

import numpy as np
import pytest
from scipy.special import expit, softmax
from variable_classes import NAMES, classify, curves, fit

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.average import Laws, average, labels_of
from pymc_hyperelastic.classes.hierarchical import HierarchicalClass
from pymc_hyperelastic.classes.interface import Prediction
from pymc_hyperelastic.classes.shapley import log_ratio_parts, parts_of

# Relative rounding error of a sum of a few numbers.
ROUNDING = 1e-10
# Relative error of a root mean square over two thousand draws: 4 sd.
MONTE_CARLO_ERROR = 0.06

# Log evidences of new data under two classes (law, class), without errors of their own.
VALUES = np.array([[-3.0, -5.0], [-4.0, -3.5]])
EQUAL = np.log([0.5, 0.5])
# Probability of the first law where its log evidence is higher by one.
FIRST = expit(1.0)


def laws(*evidences, parts=(("all",), ("all",))):
    return Laws(["one", "two"], [*parts], [ph.Estimate(*e) for e in evidences])


def predictions(errors=0.0, values=VALUES):
    return [
        [Prediction(ph.Estimate(v, errors), errors, "by hand", 0.1) for v in of_law]
        for of_law in values
    ]


def test_laws_are_weighted_by_their_evidence():
    both = laws((-50.0, 0.0), (-51.0, 0.0))
    both.of_classes["soft"] = [ph.Estimate(-20.0, 0.0), ph.Estimate(-18.0, 0.0)]
    weights = softmax([-50.0, -51.0])
    variables = both.as_variables()
    np.testing.assert_allclose(variables["strain_energy_log_evidence"], [-50, -51])
    np.testing.assert_allclose(variables["strain_energy_probability"], weights)
    np.testing.assert_allclose(variables["strain_energy_probability_se"], 0, atol=ROUNDING)
    of_class = variables["strain_energy_class_probability"].sel(class_label="soft")
    np.testing.assert_allclose(of_class, softmax([-20.0, -18.0]))
    known = predictions()
    p_values = [(0.2, 0.3, 0.4), (0.6, 0.8, 0.9)]
    for of_law, k, p in zip(known, (0.1, np.nan), p_values, strict=True):
        of_law[0] = Prediction(*of_law[0][:3], k, *p)
    found = average(both, known, EQUAL)
    for i, prediction in enumerate(found):
        expected = np.log(weights @ np.exp(VALUES[:, i]))
        np.testing.assert_allclose(prediction.log_evidence.value, expected)
        np.testing.assert_allclose(prediction.log_evidence.standard_error, 0, atol=ROUNDING)
        np.testing.assert_allclose(prediction.probability_error, 0, atol=ROUNDING)
    assert found[0].pareto_k == 0.1
    np.testing.assert_allclose(found[0][4:7], weights @ p_values)
    assert average(Laws(["one"], [("all",)], both.evidences[:1]), known[:1], EQUAL) == known[0]


def test_small_errors_of_evidences_are_propagated_linearly():
    """Two laws have dP_1 = P_1 P_2 d(L_1 - L_2), and the chain rule gives all other errors."""
    both = laws((-50.0, 0.03), (-51.0, 0.04))
    error = FIRST * (1 - FIRST) * 0.05
    np.testing.assert_allclose(both.probability_error, [error, error], rtol=MONTE_CARLO_ERROR)
    evidence = np.exp(VALUES)
    averaged = FIRST * evidence[0] + (1 - FIRST) * evidence[1]
    slope = (evidence[0] - evidence[1]) / averaged  # derivative of the log evidence by P_1
    chance = averaged[0] / averaged.sum()
    for i, prediction in enumerate(average(both, predictions(), EQUAL)):
        expected = abs(slope[i]) * error
        np.testing.assert_allclose(
            prediction.log_evidence.standard_error, expected, rtol=MONTE_CARLO_ERROR
        )
        expected = chance * (1 - chance) * abs(slope[0] - slope[1]) * error
        np.testing.assert_allclose(prediction.probability_error, expected, rtol=MONTE_CARLO_ERROR)
    # Errors of the laws' predictions add in squares, each times the share of its law.
    share = np.array([FIRST, 1 - FIRST]) * evidence[:, 0] / averaged[0]
    first = average(both, predictions(0.1), EQUAL)[0]
    np.testing.assert_allclose(first.own_error, 0.1 * np.linalg.norm(share))
    expected = np.hypot(0.1 * np.linalg.norm(share), abs(slope[0]) * error)
    np.testing.assert_allclose(first.log_evidence.standard_error, expected, rtol=MONTE_CARLO_ERROR)


def test_infinite_evidence_error_of_one_law_makes_every_averaged_error_infinite():
    both = laws((-50.0, 0.1), (-90.0, np.inf))
    assert np.isinf(both.probability_error).all()
    for prediction in average(both, predictions(), EQUAL):
        assert np.isinf([*prediction.log_evidence[1:], prediction.probability_error]).all()
    alone = Laws(["one"], [("all",)], [ph.Estimate(-50.0, np.inf)])
    assert alone.probability_error.tolist() == [0.0]
    # New data that one law cannot predict, however small its share seems.
    known = predictions()
    failed = ph.Estimate(-1e5, np.inf)
    known[1] = [p._replace(log_evidence=failed, own_error=np.inf) for p in known[1]]
    for prediction in average(laws((-50.0, 0.1), (-51.0, 0.1)), known, EQUAL):
        assert np.isinf([*prediction.log_evidence[1:], prediction.own_error]).all()


def test_parts_of_the_log_ratio_follow_from_averaged_evidences():
    """One law has two parts; the other law has only the first part."""

    def of_class(own):
        tables = {0: np.array([[-3.0, -4.5], [-3.5, -5.0]]), 1: np.array([-4.0, -3.5])}
        return [np.flip(tables[law]) if own else tables[law] for law in (0, 1)]

    known = [
        [p._replace(hybrids=lambda _, t=of_class(own)[law]: t) for own, p in enumerate(of_law)]
        for law, of_law in enumerate(predictions())
    ]
    both = laws((-50.0, 0.0), (-51.0, 0.0), parts=(("material", "noise"), ("material",)))
    averaged = average(both, known, EQUAL)
    first, second = (log_ratio_parts(both, known, own, 1 - own) for own in (0, 1))
    assert parts_of(both) == ["material", "noise"]
    one, two = (np.exp(table) for table in of_class(0))
    v = np.log(FIRST * one + (1 - FIRST) * two[:, None])
    material = (v[0, 0] - v[1, 0] + v[0, 1] - v[1, 1]) / 2
    noise = (v[0, 0] - v[0, 1] + v[1, 0] - v[1, 1]) / 2
    np.testing.assert_allclose(first, [material, noise])
    np.testing.assert_allclose(second, [-material, -noise])
    log_ratio = averaged[0].log_evidence.value - averaged[1].log_evidence.value
    np.testing.assert_allclose(sum(first), log_ratio)


def of_one_law(between):
    """Predictions of two classes with two parts; one of the mixed evidences is given."""
    table = np.array([[-3.0, between], [-3.5, -5.0]])
    tables = [table, np.flip(table)]
    known = zip(predictions()[0], tables, strict=True)
    return [p._replace(hybrids=lambda _, t=t: t) for p, t in known]


def test_nan_parts_of_a_law_of_negligible_probability_are_ignored():
    """Below a probability and a share of 1e-4 a law is left out; else its NaN makes parts NaN."""
    parts = (("pressure", "slope"),) * 2
    known = [of_one_law(-4.5), of_one_law(np.nan)]
    alone = Laws(["one"], [parts[0]], [ph.Estimate(-50.0, 0.0)])
    expected = log_ratio_parts(alone, known[:1], 0, 1)

    def parts_with(second, known=known):
        both = laws((-50.0, 0.0), (second, 0.0), parts=parts)
        return np.array([log_ratio_parts(both, known, own, 1 - own) for own in (0, 1)])

    for second in (-59.5, -2000.0, -np.inf):  # exp(-9.5) = 0.7e-4
        np.testing.assert_allclose(parts_with(second), [expected, -expected], atol=1e-3)
    assert np.isnan(parts_with(-59.0)).all()  # exp(-9) = 1.2e-4
    # An improbable law that explains the new data best is not negligible.
    likely = [p._replace(log_evidence=ph.Estimate(p.log_evidence.value + 9, 0.0)) for p in known[1]]
    assert np.isnan(parts_with(-61.0, [known[0], likely])).all()


def test_labels_distinguish_laws_of_the_same_name():
    """Labels add the settings of the law, the experiment effect, or otherwise a number."""
    layers = [ph.Layer(ph.NeoHookean(), 1), ph.Layer(ph.Ogden(), 1)]
    kind_of = partial(HierarchicalClass.of_settings, likelihood=1.0)
    effect = ph.Variability(experiment_effect=True)
    labels = {
        "Ogden": kind_of(ph.Ogden()),
        "Ogden with experiment effect": kind_of(ph.Ogden(), variability=effect),
        "OgdenSeries(terms=1)": kind_of(ph.OgdenSeries(1)),
        "OgdenSeries(terms=2)": kind_of(ph.OgdenSeries(2)),
        "NeoHookean": kind_of(ph.NeoHookean(), variability=effect),
        "Ogden (2)": kind_of(ph.Ogden(), likelihood=2.0),
        "NeoHookean in Ogden": kind_of(layers),
    }
    assert labels_of([*labels.values()]) == [*labels]


@pytest.mark.filterwarnings("ignore:class .* the fit is doubtful")  # specimens differ
def test_classify_averages_over_laws_by_the_evidences_of_their_classes():
    """Probabilities of the laws, and their errors, follow from the evidences of the classes."""
    settings = {"variability": None, "draws": 300, "chains": 2}
    classes, other = fit(**settings), fit(ph.Ogden(), **settings)
    result = classify(curves({"N1": [42.0]}, 3), classes, average_over=[other])
    assert result["decision"].item() == "soft"
    evidences = np.array([[ph.log_evidence(tree[n]) for n in NAMES] for tree in (classes, other)])
    probability = softmax(evidences[:, :, 0].sum(axis=1))
    np.testing.assert_allclose(result["strain_energy_probability"], probability)
    expected = np.prod(probability) * np.linalg.norm(evidences[:, :, 1])
    # Errors of half a nat are not quite propagated linearly.
    np.testing.assert_allclose(result["strain_energy_probability_se"], expected, rtol=0.3)
    of_classes = result["strain_energy_class_probability"]
    np.testing.assert_allclose(of_classes, softmax(evidences[:, :, 0], axis=0))
