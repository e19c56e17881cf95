"""Scores of class probabilities, by hand, and how reliable they are."""

import numpy as np
import pytest
import xarray as xr

import pymc_hyperelastic as ph

SEED = 20260  # any would do
# Sums and logarithms of a few numbers of order one.
ROUNDING = 1e-12


def classified(probability, **attrs):
    """What classify returns, as far as it is scored."""
    probability = np.array(probability, dtype=float)
    classes = [f"C{i + 1}" for i in range(probability.shape[1])]
    return xr.Dataset(
        {"class_probability": (("test", "class_label"), probability)},
        {
            "class_label": classes,
            "specimen": ("test", [f"S{i + 1}" for i in range(len(probability))]),
            "experiment": ("test", [3] * len(probability)),
        },
        attrs,
    )


def test_scores_by_hand():
    """Of two units the log scores are ln 0.7 and ln 0.2, the Brier scores 0.14 and 1.04.

    (0.7, 0.1, 0.2) against (1, 0, 0): 0.09 + 0.01 + 0.04. (0.2, 0.2, 0.6) against (0, 1, 0):
    0.04 + 0.64 + 0.36 = 1.04.
    """
    result = classified([[0.7, 0.1, 0.2], [0.2, 0.2, 0.6]], simulated=1, class_prior="equal")
    scores = ph.score_probabilities(result, ["C1", "C2"])
    np.testing.assert_allclose(scores["log_score"], np.log([0.7, 0.2]), rtol=ROUNDING)
    np.testing.assert_allclose(scores["brier_score"], [0.14, 1.04], rtol=ROUNDING)
    assert scores["correct"].values.tolist() == [True, False]
    assert scores["accuracy"].item() == 0.5
    assert scores["mean_brier_score"].item() == pytest.approx(0.59, rel=ROUNDING)
    # Of two values the standard error is half their difference.
    assert scores["mean_brier_score_se"].item() == pytest.approx(0.45, rel=ROUNDING)
    assert scores["accuracy_se"].item() == pytest.approx(0.5, rel=ROUNDING)
    assert scores["specimen"].values.tolist() == ["S1", "S2"]
    assert scores["truth"].values.tolist() == ["C1", "C2"]
    assert scores.attrs == {"simulated": 1, "prob": 0.95}


def test_impossible_truth_scores_minus_infinity():
    """Nothing is clipped: the mean is −inf too, and has no standard error."""
    scores = ph.score_probabilities(classified([[1.0, 0.0], [0.5, 0.5]]), ["C2", "C1"])
    assert scores["log_score"].values.tolist() == [-np.inf, np.log(0.5)]
    assert scores["mean_log_score"].item() == -np.inf
    assert np.isnan(scores["mean_log_score_se"].item())
    assert scores["brier_score"].values.tolist() == [2.0, 0.5]
    one = ph.score_probabilities(classified([[0.9, 0.1]]), ["C1"])
    assert one["accuracy"].item() == 1 and np.isnan(one["accuracy_se"].item())


def test_calibration_error_by_hand():
    """Two bins: confidences 0.6, 0.8, 0.9, of which two are right, and 0.5, which is not.

    The upper bin has the mean 23/30 and the frequency 2/3, an error of 0.1; the lower one 0.5 and
    0: together 3/4 · 0.1 + 1/4 · 0.5 = 0.2. Of class C1 the lower bin holds 0.2, 0.1 and 0.5, of
    which the second is C1, and the upper one 0.6, which is.
    """
    result = classified([[0.6, 0.4], [0.2, 0.8], [0.1, 0.9], [0.5, 0.5]])
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
    """A bin without units has no frequency, and takes no part in the calibration error."""
    scores = ph.score_probabilities(classified([[1.0, 0.0]] * 3), ["C1"] * 3)
    of_top = scores.sel(forecast="most probable class")
    assert of_top["count"].values.tolist() == [0] * 9 + [3]
    assert np.isnan(of_top["observed_frequency"][:9]).all()
    assert scores["expected_calibration_error"].values.tolist() == [0, 0, 0]
    assert scores.sel(forecast="C2")["count"].values.tolist() == [3] + [0] * 9


def test_interval_is_that_of_wilson():
    """8 of 10 with 95 %: from 0.4902 to 0.9433 (Wilson 1927)."""
    truth = ["C1"] * 8 + ["C2"] * 2
    scores = ph.score_probabilities(classified([[0.75, 0.25]] * 10), truth, prob=0.95)
    top = scores.sel(forecast="most probable class").isel(bin=7)
    assert top["frequency_lower"].item() == pytest.approx(0.4902, abs=1e-4)
    assert top["frequency_upper"].item() == pytest.approx(0.9433, abs=1e-4)


def test_reliable_probabilities_are_on_the_diagonal():
    """Truths drawn from the probabilities themselves: most intervals hold the diagonal."""
    rng = np.random.default_rng(SEED)
    p = rng.dirichlet([0.7, 0.7, 0.7], size=3000)
    truth = [f"C{1 + rng.choice(3, p=row)}" for row in p]
    scores = ph.score_probabilities(classified(p), truth, prob=0.99)
    known = scores["count"] > 0
    inside = (scores["frequency_lower"] <= scores["predicted_probability"]) & (
        scores["predicted_probability"] <= scores["frequency_upper"]
    )
    assert inside.where(known).sum() >= known.sum() - 2  # of 37, each with 99 %
    assert (scores["expected_calibration_error"] < 0.04).all()
    certain = ph.score_probabilities(classified(np.eye(3)[p.argmax(axis=1)]), truth)
    error = certain["expected_calibration_error"].sel(forecast="most probable class").item()
    assert error == pytest.approx(1 - scores["accuracy"].item(), rel=1e-9)


def test_dimensions_may_come_in_any_order():
    """Units are the dimension that is not the class, and keep their coordinate."""
    p = xr.DataArray(
        [[0.9, 0.2], [0.1, 0.8]],
        {"class_label": ["C1", "C2"], "specimen": ["S1", "S2"]},
    )
    truth = xr.DataArray(["C1", "C2"], {"specimen": ["S1", "S2"]}, name="group")
    scores = ph.score_probabilities(p, truth)
    np.testing.assert_allclose(scores["log_score"], np.log([0.9, 0.8]), rtol=ROUNDING)
    assert scores["log_score"].sel(specimen="S2").item() == pytest.approx(np.log(0.8))
    with pytest.raises(ValueError, match="probabilities and truth differ in 'specimen'"):
        ph.score_probabilities(p, truth[::-1])


def test_scores_of_classify():
    """The result of classify is scored as it is, its groups are the truth."""
    data = ph.load_dataset("simulated_sheep_aorta")
    classes = ph.fit_classes(
        ph.PowerLawNeoHookean(),
        {name: ph.select(data, group=name, experiment=[1, 2]) for name in ("C1", "C2")},
        sigma=5 * ph.mmHg,
        slope_weight=3.0,
        draws=200,
        chains=2,
        random_seed=SEED,
        progressbar=False,
    )
    new = ph.select(data, experiment=3)
    result = ph.classify(new, classes, random_seed=SEED, progressbar=False)
    scores = ph.score_probabilities(result, result["group"])
    assert scores.sizes["test"] == 5
    assert scores["accuracy"].item() == np.mean(
        result["class_probability"].idxmax("class_label").values == result["group"].values
    )
    assert scores.attrs["simulated"] == 1


@pytest.mark.parametrize(
    ("probability", "truth", "settings", "error", "message"),
    [
        ([[0.9, 0.1]], ["C1"], {}, TypeError, "DataArray of probabilities, not list"),
        (classified([[0.9, 0.2]]), ["C1"], {}, ValueError, "specimen 'S1', experiment 3: .*0.2"),
        (classified([[1.1, -0.1]]), ["C1"], {}, ValueError, "between 0 and 1 that add up to 1"),
        (
            classified([[0.5, 0.5], [np.nan, np.nan]]),
            ["C1", "C1"],
            {},
            ValueError,
            "specimen 'S2', experiment 3: .*not classified: leave the unit out",
        ),
        (
            classified([[0.5, 0.5]]),
            ["control"],
            {},
            ValueError,
            r"specimen 'S1', .*true class 'control' is not among the classes \['C1', 'C2'\]",
        ),
        (classified([[0.5, 0.5]]), ["C1", "C2"], {}, ValueError, r"for each of 1 unit\(s\)"),
        (classified([[0.5, 0.5]]), "C1", {}, ValueError, r"for each of 1 unit\(s\); got 'C1'"),
        (
            classified([[0.5, 0.5]])["class_probability"][0],
            ["C1"],
            {},
            ValueError,
            r"two dimensions.*here are \['class_label'\]",
        ),
        (
            xr.DataArray([[0.5, 0.5]], dims=["unit", "class_label"]),
            ["C1"],
            {},
            ValueError,
            "names of the classes",
        ),
        (
            xr.DataArray([[0.4, 0.5]], {"class_label": ["A", "B"]}, ["unit", "class_label"]),
            ["A"],
            {},
            ValueError,
            "unit 0: the probabilities",
        ),
        (
            xr.DataArray([[0.5, 0.5]], {"class_label": ["A", "A"]}, ["unit", "class_label"]),
            ["A"],
            {},
            ValueError,
            "each class once",
        ),
        (classified(np.empty((0, 2))), [], {}, ValueError, r"of 0 unit\(s\)"),
        (classified([[0.5, 0.5]]), ["C1"], {"bins": 0}, ValueError, "bins is 0"),
        (classified([[0.5, 0.5]]), ["C1"], {"prob": 94}, ValueError, "prob must be a probability"),
    ],
)
def test_wrong_input_of_scores(probability, truth, settings, error, message):
    """Wrong input raises one error, which names the unit."""
    with pytest.raises(error, match=message):
        ph.score_probabilities(probability, truth, **settings)
