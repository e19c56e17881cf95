"""Scores of class probabilities, and how reliable they are, computed by hand."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import pymc_hyperelastic as ph

# Relative rounding errors of sums and logarithms of a few numbers of order one.
ROUNDING = 1e-12


def classified(probability, **attrs):
    """Return probabilities in the form in which `classify` gives them."""
    probability = np.array(probability, dtype=float)
    return xr.Dataset(
        {"class_probability": (("test", "class_label"), probability)},
        {
            "class_label": [f"C{i + 1}" for i in range(probability.shape[1])],
            "specimen": ("test", [f"S{i + 1}" for i in range(len(probability))]),
            "experiment": ("test", [3] * len(probability)),
        },
        attrs,
    )


def test_scores_of_two_units_equal_values_computed_by_hand():
    """Brier scores: 0.09 + 0.01 + 0.04 against (1, 0, 0), 0.04 + 0.64 + 0.36 against (0, 1, 0)."""
    result = classified([[0.7, 0.1, 0.2], [0.2, 0.2, 0.6]], simulated=1, class_prior="equal")
    scores = ph.score_probabilities(result, ["C1", "C2"])
    np.testing.assert_allclose(scores["log_score"], np.log([0.7, 0.2]), rtol=ROUNDING)
    np.testing.assert_allclose(scores["brier_score"], [0.14, 1.04], rtol=ROUNDING)
    assert scores["correct"].values.tolist() == [True, False]
    # The standard error of the mean of two values is half their difference.
    for name, mean, error in (
        ("mean_log_score", np.log(0.14) / 2, np.log(3.5) / 2),
        ("mean_brier_score", 0.59, 0.45),
        ("accuracy", 0.5, 0.5),
    ):
        assert scores[name].item() == pytest.approx(mean, rel=ROUNDING)
        assert scores[f"{name}_se"].item() == pytest.approx(error, rel=ROUNDING)
    assert scores["specimen"].values.tolist() == ["S1", "S2"]
    assert scores["truth"].values.tolist() == ["C1", "C2"]
    assert scores.attrs == {"simulated": 1, "prob": 0.95}


def test_true_class_of_probability_zero_has_log_score_minus_infinity():
    scores = ph.score_probabilities(classified([[1.0, 0.0], [0.5, 0.5]]), ["C2", "C1"])
    assert scores["log_score"].values.tolist() == [-np.inf, np.log(0.5)]
    assert scores["mean_log_score"].item() == -np.inf
    assert np.isnan(scores["mean_log_score_se"].item())
    assert scores["brier_score"].values.tolist() == [2.0, 0.5]
    one = ph.score_probabilities(classified([[0.9, 0.1]]), ["C1"])
    assert one["accuracy"].item() == 1 and np.isnan(one["accuracy_se"].item())


def test_calibration_error_of_two_bins_equals_the_value_computed_by_hand():
    """The upper bin holds 0.6, 0.8, 0.9 (two are right), the lower one 0.5, which is wrong.

    The calibration error is 3/4 · (23/30 - 2/3) + 1/4 · 0.5 = 0.2.
    """
    # A probability that misses the limit between two bins by rounding belongs to the lower bin.
    result = classified([[0.6, 0.4], [0.2, 0.8], [0.1, 0.9], [0.5 + 1e-15, 0.5 - 1e-15]])
    scores = ph.score_probabilities(result, ["C1", "C2", "C1", "C2"], bins=2)
    top = scores.sel(forecast="most probable class")
    assert top["count"].values.tolist() == [1, 3]
    np.testing.assert_allclose(top["predicted_probability"], [0.5, 23 / 30], rtol=ROUNDING)
    np.testing.assert_allclose(top["observed_frequency"], [0, 2 / 3], rtol=ROUNDING)
    assert top["expected_calibration_error"].item() == pytest.approx(0.2, rel=ROUNDING)
    first = scores.sel(forecast="C1")
    assert first["count"].values.tolist() == [3, 1]
    np.testing.assert_allclose(first["predicted_probability"], [0.8 / 3, 0.6], rtol=ROUNDING)
    np.testing.assert_allclose(first["observed_frequency"], [1 / 3, 1], rtol=ROUNDING)
    error = 3 / 4 * (1 / 3 - 0.8 / 3) + 1 / 4 * 0.4
    assert first["expected_calibration_error"].item() == pytest.approx(error, rel=ROUNDING)


def test_empty_bins_are_nan_and_do_not_count():
    scores = ph.score_probabilities(classified([[1.0, 0.0]] * 3), ["C1"] * 3)
    top = scores.sel(forecast="most probable class")
    assert top["count"].values.tolist() == [0] * 9 + [3]
    assert np.isnan(top["observed_frequency"][:9]).all()
    assert scores["expected_calibration_error"].values.tolist() == [0, 0, 0]
    assert scores.sel(forecast="C2")["count"].values.tolist() == [3] + [0] * 9
    assert scores["bin_left"].values[1] == pytest.approx(0.1) == scores["bin_right"].values[0]


def test_frequency_intervals_are_wilson_intervals():
    """8 of 10 with 95 %: from 0.4902 to 0.9433 (Wilson 1927)."""
    truth = ["C1"] * 8 + ["C2"] * 2
    p = classified([[0.75, 0.25]] * 10)["class_probability"].T  # dimensions in any order
    scores = ph.score_probabilities(p, xr.DataArray(truth, dims="test"), ci_prob=0.95)
    top = scores.sel(forecast="most probable class").isel(bin=7)
    assert top["frequency_lower"].item() == pytest.approx(0.4902, abs=1e-4)
    assert top["frequency_upper"].item() == pytest.approx(0.9433, abs=1e-4)


HALVES, TWO = classified([[0.5, 0.5]]), classified([[0.5, 0.5]] * 2)
NAMED = xr.DataArray([[0.5, 0.5]] * 2, {"unit": [1, 2], "class_label": ["A", "B"]})


def test_truth_may_be_a_series_in_the_order_of_the_units():
    for index in (["S1", "S2"], ["row 7", "row 9"], None):
        scores = ph.score_probabilities(TWO, pd.Series(["C1", "C2"], index))
        assert scores["truth"].values.tolist() == ["C1", "C2"]
    default = ph.score_probabilities(NAMED, pd.Series(["A", "B"]))
    assert default["truth"].values.tolist() == ["A", "B"]


def test_wrong_input_is_refused_with_the_unit():
    for probability, truth, message in (
        (classified([[0.9, 0.2]]), ["C1"], "specimen 'S1', experiment 3: .*0.2"),
        (classified([[1.1, -0.1]]), ["C1"], "between 0 and 1 that add up to 1"),
        (classified([[np.nan] * 2]), ["C1"], "not classified: leave the unit out"),
        (HALVES, ["control"], r"'S1', .*'control' is not among .*\['C1', 'C2'\]"),
        (HALVES, ["C1", "C2"], r"for each of 1 unit\(s\)"),
        (HALVES["class_probability"][0], ["C1"], r"here are \['class_label'\]"),
        (NAMED - 0.1, ["A", "A"], "unit 1: the probabilities"),
        (NAMED.assign_coords(class_label=["A", "A"]), ["A", "A"], "each class once"),
        (NAMED, xr.DataArray(["A", "A"], {"unit": [2, 1]}), "and truth differ in 'unit'"),
        (NAMED, pd.Series(["A", "A"], [2, 1]), "and truth differ in 'unit'"),
        (TWO, pd.Series(["C1", "C2"], ["S2", "S1"]), "and truth differ in 'specimen'"),
        # Evenly spaced numbers become a range.
        (NAMED, pd.Series(["A", "A"], pd.RangeIndex(2, 0, -1)), "and truth differ in 'unit'"),
        (NAMED, pd.Series(["A", "A"], ["2", "1"]), "and truth differ in 'unit'"),
        (
            TWO,
            xr.DataArray(["C1", "C2"], {"specimen": ("test", ["S2", "S1"])}, dims="test"),
            "and truth differ in 'specimen'",
        ),
    ):
        with pytest.raises(ValueError, match=message):
            ph.score_probabilities(probability, truth)
    with pytest.raises(TypeError, match="DataArray of probabilities, not list"):
        ph.score_probabilities([[0.9, 0.1]], ["C1"])
    for settings, message in (({"bins": 0}, "bins is 0"), ({"ci_prob": 94}, "ci_prob is 94")):
        with pytest.raises(ValueError, match=message):
            ph.score_probabilities(HALVES, ["C1"], **settings)
