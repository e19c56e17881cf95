"""Averages over laws, against plain calculations of what their evidences and errors say."""

import numpy as np
import pytest
import xarray as xr
from scipy.special import expit, softmax
from variable_classes import NAMES, classify, curves, fit

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.average import Laws, average, labels_of
from pymc_hyperelastic.classes.interface import Prediction
from pymc_hyperelastic.classes.parts import parts_of, with_parts
from pymc_hyperelastic.classes.variable import Variability

ROUNDING = 1e-10
# Of a standard error that is a root mean square over two thousand draws.
OF_DRAWS = 0.06

# Log evidences of two classes by law, all without an error of their own.
VALUES = np.array([[-3.0, -5.0], [-4.0, -3.5]])
EQUAL = np.log([0.5, 0.5])


def laws(*evidences, parts=(("all",), ("all",))):
    return Laws(["one", "two"], [*parts], [ph.Estimate(*e) for e in evidences])


def predictions(errors=0.0, values=VALUES):
    return [
        [Prediction(ph.Estimate(v, errors), errors, "by hand", 0.1) for v in of_law]
        for of_law in values
    ]


def test_laws_count_by_their_evidence():
    """Probabilities and averaged evidences are sums that can be written down."""
    of_laws = laws((-50.0, 0.0), (-51.0, 0.0))
    weights = softmax([-50.0, -51.0])
    variables = of_laws.as_variables()
    np.testing.assert_allclose(variables["strain_energy_probability"], weights)
    np.testing.assert_allclose(variables["strain_energy_probability_se"], 0, atol=ROUNDING)
    found = average(of_laws, predictions(), EQUAL)
    for i, prediction in enumerate(found):
        expected = np.log(weights @ np.exp(VALUES[:, i]))
        np.testing.assert_allclose(prediction.log_evidence.value, expected)
        np.testing.assert_allclose(prediction.log_evidence.standard_error, 0, atol=ROUNDING)
        np.testing.assert_allclose(prediction.probability_error, 0, atol=ROUNDING)


def test_small_errors_of_evidences_are_handed_on_in_proportion():
    r"""Of two laws, ``dP_1 = P_1 P_2 d(L_1 - L_2)``, and what depends on it by the chain rule."""
    errors = 0.03, 0.04
    of_laws = laws((-50.0, errors[0]), (-51.0, errors[1]))
    one = expit(1.0)
    error = one * (1 - one) * 0.05
    np.testing.assert_allclose(of_laws.probability_error, [error, error], rtol=OF_DRAWS)
    evidence = np.exp(VALUES)
    averaged = one * evidence[0] + (1 - one) * evidence[1]
    slope = (evidence[0] - evidence[1]) / averaged  # of the log evidence, by P_1
    chance = averaged[0] / averaged.sum()
    for i, prediction in enumerate(average(of_laws, predictions(), EQUAL)):
        expected = abs(slope[i]) * error
        np.testing.assert_allclose(prediction.log_evidence.standard_error, expected, rtol=OF_DRAWS)
        expected = chance * (1 - chance) * abs(slope[0] - slope[1]) * error
        np.testing.assert_allclose(prediction.probability_error, expected, rtol=OF_DRAWS)
    # Errors of what laws say of the specimen add, each by the law's share.
    share = np.array([one, 1 - one]) * evidence[:, 0] / averaged[0]
    first = average(of_laws, predictions(0.1), EQUAL)[0]
    np.testing.assert_allclose(first.own_error, 0.1 * np.linalg.norm(share))
    both = np.hypot(0.1 * np.linalg.norm(share), abs(slope[0]) * error)
    np.testing.assert_allclose(first.log_evidence.standard_error, both, rtol=OF_DRAWS)


def test_large_errors_stay_within_what_probabilities_can_be():
    """Laws that are told apart by nothing: each draw has one of them, and half is the error."""
    of_laws = laws((-50.0, 300.0), (-50.0, 300.0))
    np.testing.assert_allclose(of_laws.probability_error, [0.5, 0.5], atol=0.01)
    of_one_law = softmax(VALUES, axis=1)[:, 0]
    found = average(of_laws, predictions(), EQUAL)
    stated = softmax([p.log_evidence.value for p in found])[0]
    expected = np.sqrt(np.mean((of_one_law - stated) ** 2))
    np.testing.assert_allclose(found[0].probability_error, expected, rtol=OF_DRAWS)


def test_laws_that_agree_need_not_be_told_apart():
    """Where all say the same, it does not matter which of them it is."""
    of_laws = laws((-50.0, 3.0), (-51.0, 3.0))
    for prediction in average(of_laws, predictions(values=VALUES[[0, 0]]), EQUAL):
        np.testing.assert_allclose(prediction.log_evidence.standard_error, 0, atol=ROUNDING)
        np.testing.assert_allclose(prediction.probability_error, 0, atol=ROUNDING)


def test_an_evidence_that_is_not_known_leaves_all_unknown():
    """An infinite error of one law is one of everything that rests on its probability."""
    of_laws = laws((-50.0, 0.1), (-90.0, np.inf))
    assert np.isinf(of_laws.probability_error).all()
    for prediction in average(of_laws, predictions(), EQUAL):
        assert np.isinf(prediction.log_evidence.standard_error)
        assert np.isinf(prediction.probability_error)
    alone = Laws(["one"], [("all",)], [ph.Estimate(-50.0, np.inf)])
    assert alone.probability_error.tolist() == [0.0]


@pytest.mark.parametrize("value", [-10.0, -1e5, -np.inf])
def test_new_data_that_one_law_cannot_judge_are_judged_by_none(value):
    """What has no known value may have any, be its share as small as it seems."""
    known = predictions()
    failed = ph.Estimate(value, np.inf)
    known[1] = [p._replace(log_evidence=failed, own_error=np.inf) for p in known[1]]
    for prediction in average(laws((-50.0, 0.1), (-51.0, 0.1)), known, EQUAL):
        assert np.isinf(prediction.log_evidence.standard_error)
        assert np.isinf(prediction.own_error)


def test_parts_of_an_average_are_those_of_averaged_evidences():
    """One law knows two parts and the other one of them: it changes by that alone."""

    def of_class(own):
        tables = {0: np.array([[-3.0, -4.5], [-3.5, -5.0]]), 1: np.array([-4.0, -3.5])}
        return [np.flip(tables[law]) if own else tables[law] for law in (0, 1)]

    known = predictions()
    for own in (0, 1):
        for law, table in enumerate(of_class(own)):
            known[law][own] = known[law][own]._replace(hybrids=lambda _, table=table: table)
    parts = (("material", "noise"), ("material",))
    of_laws = laws((-50.0, 0.0), (-51.0, 0.0), parts=parts)
    averaged = average(of_laws, known, EQUAL)
    first, second = with_parts(averaged, of_laws, known, EQUAL)
    assert parts_of(of_laws) == ["material", "noise"]
    one = expit(1.0)
    v = np.log(one * np.exp(of_class(0)[0]) + (1 - one) * np.exp(np.array(of_class(0)[1])[:, None]))
    material = (v[0, 0] - v[1, 0] + v[0, 1] - v[1, 1]) / 2
    noise = (v[0, 0] - v[0, 1] + v[1, 0] - v[1, 1]) / 2
    np.testing.assert_allclose(first.parts, [material, noise])
    np.testing.assert_allclose(second.parts, [-material, -noise])
    log_ratio = averaged[0].log_evidence.value - averaged[1].log_evidence.value
    np.testing.assert_allclose(sum(first.parts), log_ratio)
    assert (first.rival, second.rival) == (1, 0)


def of_one_law(between):
    """Predictions of two classes by a law, and what is told between the two, in two parts."""
    table = np.array([[-3.0, between], [-3.5, -5.0]])
    known = predictions()[0]
    tables = [table, np.flip(table)]
    return [p._replace(hybrids=lambda _, t=t: t) for p, t in zip(known, tables, strict=True)]


@pytest.mark.parametrize("unknown", [np.nan, np.inf, -np.inf])
def test_a_law_that_counts_for_nothing_spoils_no_part(unknown):
    """What it does not tell is not missed; of a law that counts, parts are then unknown."""
    known = [of_one_law(-4.5), of_one_law(unknown)]
    parts = (("pressure", "slope"),) * 2
    alone = laws((-50.0, 0.0), (-51.0, 0.0), parts=parts)
    alone = Laws(["one"], [parts[0]], alone.evidences[:1])
    (expected, _) = with_parts(known[0], alone, known[:1], EQUAL)
    for evidence in (-80.0, -2000.0, -np.inf):
        of_laws = laws((-50.0, 0.0), (evidence, 0.0), parts=parts)
        averaged = average(of_laws, known, EQUAL)
        for prediction, sign in zip(with_parts(averaged, of_laws, known, EQUAL), (1, -1)):
            np.testing.assert_allclose(prediction.parts, sign * np.array(expected.parts))
    for evidence in (-51.0, -58.0):
        of_laws = laws((-50.0, 0.0), (evidence, 0.0), parts=parts)
        averaged = average(of_laws, known, EQUAL)
        with np.errstate(invalid="ignore"):
            (first, _) = with_parts(averaged, of_laws, known, EQUAL)
        assert unknown == -np.inf or not np.isfinite(first.parts).any()


def test_a_law_counts_that_says_all_of_new_data():
    """However improbable it was: what it does not know of them nobody does."""
    known = [of_one_law(-4.5), of_one_law(np.nan)]
    likely = [p._replace(log_evidence=ph.Estimate(p.log_evidence.value + 9, 0.0)) for p in known[1]]
    parts = (("pressure", "slope"),) * 2
    of_laws = laws((-50.0, 0.0), (-61.0, 0.0), parts=parts)
    averaged = average(of_laws, [known[0], likely], EQUAL)
    (first, _) = with_parts(averaged, of_laws, [known[0], likely], EQUAL)
    assert np.isnan(first.parts).all()


def test_labels_tell_kinds_apart():
    """By the law, its settings, the experiment effect, and at last by a number."""
    noise = {"sigma": 1.0}
    kinds = [
        Variability.of_settings(ph.Ogden(), **noise),
        Variability.of_settings(ph.Ogden(), **noise, experiment_effect=True),
        Variability.of_settings(ph.OgdenSeries(1), **noise),
        Variability.of_settings(ph.OgdenSeries(2), **noise),
        Variability.of_settings(ph.OgdenSeries(2), **noise, experiment_effect=True),
        Variability.of_settings(ph.NeoHookean(), **noise, experiment_effect=True),
        Variability.of_settings(ph.Ogden(), sigma=2.0),
    ]
    assert labels_of(kinds) == [
        "Ogden",
        "Ogden with experiment effect",
        "OgdenSeries(terms=1)",
        "OgdenSeries(terms=2)",
        "OgdenSeries(terms=2) with experiment effect",
        "NeoHookean",
        "Ogden (2)",
    ]


def test_a_law_that_is_not_to_be_trusted_cannot_be_averaged():
    """One failed chain of one class, and the decision is that nothing can be judged."""
    settings = {"variability": "none", "draws": 300, "chains": 2}
    classes, other = fit(**settings), fit(ph.Ogden(), **settings)
    new = curves({"N1": [42.0], "N2": [90.0]}, 3)
    result = classify(new, classes, average_over=[other])
    assert result["decision"].values.tolist() == [*NAMES]
    assert np.isfinite(result["class_probability_se"]).all()
    errors = [
        np.linalg.norm([ph.log_evidence(tree[name]).standard_error for name in NAMES])
        for tree in (classes, other)
    ]
    one, two = result["strain_energy_probability"].values
    expected = one * two * np.linalg.norm(errors)
    found = result["strain_energy_probability_se"].values
    np.testing.assert_allclose(found, [expected, expected], rtol=0.3)
    evidence = other["soft"]["evidence"].to_dataset().copy(deep=True)
    evidence["log_evidence_se"].values[0] = np.inf
    failed = xr.DataTree.from_dict({})
    failed.attrs |= other.attrs
    for name in NAMES:
        failed[name] = other[name].copy()
    failed["soft"]["evidence"] = evidence
    del failed["soft"].attrs["checksum"]
    with pytest.warns(UserWarning, match="2 of 2 cannot be judged: .* log_evidence_se"):
        result = classify(new, classes, average_over=[failed])
    assert set(result["decision"].values) == {"cannot be judged"}
    assert np.isinf(result["strain_energy_probability_se"]).all()
    assert np.isinf(result["class_probability_se"]).all()
