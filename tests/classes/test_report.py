"""Specimens left out: how a report of them is made, and what it says."""

import json

import numpy as np
import pytest
from scipy.special import logsumexp
from variable_classes import NAMES, SEED, SIGMA, classify, curves, fit

import pymc_hyperelastic as ph

ROUNDING = 1e-12
SMALL = {
    "soft": curves({"A1": [30.0], "A2": [38.0], "A3": [50.0]}, 5),
    "stiff": curves({"B1": [95.0], "B2": [120.0], "B3": [150.0]}, 6),
}
SPECIMENS = ["A1", "A2", "A3", "B1", "B2", "B3"]


def report_of(energy=None, classes=None, **settings):
    defaults = {"sigma": SIGMA, "draws": 200, "random_seed": SEED, "progressbar": False}
    return ph.calibration_report(energy or ph.NeoHookean(), classes or SMALL, **defaults | settings)


@pytest.fixture(scope="module")
def report():
    """Two laws, and specimens that are left out in pairs."""
    animals = dict(zip(SPECIMENS, ["x", "y", "z", "x", "y", "z"], strict=True))
    return report_of([ph.NeoHookean(), ph.Ogden()], leave_out=animals)


def test_probabilities_of_specimens_left_out(report):
    """Every law and their average give each specimen probabilities that add up to one."""
    assert report["strain_energy"].values.tolist() == ["NeoHookean", "Ogden", "average"]
    assert report["specimen"].values.tolist() == SPECIMENS
    assert report["true_class"].values.tolist() == ["soft"] * 3 + ["stiff"] * 3
    assert report["left_out"].values.tolist() == ["x", "y", "z", "x", "y", "z"]
    probability = report["class_probability"]
    assert probability.dims == ("strain_energy", "specimen", "class_label")
    np.testing.assert_allclose(probability.sum("class_label"), 1, atol=ROUNDING)
    p_value = report["p_value"].values
    assert np.all((p_value > 0) & (p_value <= 1))
    right = probability.sel(class_label=report["true_class"]).sel(strain_energy="NeoHookean")
    assert right.mean() > 0.5


def test_scores_follow_from_probabilities(report):
    """Logarithm of the probability of the true class, and Brier's score."""
    for law in range(3):
        for i, name in enumerate(report["true_class"].values.tolist()):
            p = report["class_probability"].values[law, i]
            right = NAMES.index(name)
            np.testing.assert_allclose(report["log_score"].values[law, i], np.log(p[right]))
            brier = (p[right] - 1) ** 2 + p[1 - right] ** 2
            np.testing.assert_allclose(report["brier_score"].values[law, i], brier)


def test_average_of_a_report_is_weighted_by_what_was_not_left_out(report):
    """Evidences of the laws are averaged; specimens left out together have the same weights."""
    laws = report["strain_energy_probability"]
    np.testing.assert_allclose(laws.isel(strain_energy=slice(2)).sum("strain_energy"), 1)
    assert np.isnan(laws.sel(strain_energy="average")).all()
    np.testing.assert_array_equal(laws.values[:2, :3], laws.values[:2, 3:])
    # Of two laws the error is one and the same, and at most that of a coin.
    errors = report["strain_energy_probability_se"].values
    np.testing.assert_allclose(errors[0], errors[1], atol=ROUNDING)
    assert np.all((errors[:2] > 0) & (errors[:2] < 0.5)) and np.isnan(errors[2]).all()
    value = report["log_evidence"].values
    expected = logsumexp(value[:2] + np.log(laws.values[:2])[..., None], axis=0)
    np.testing.assert_allclose(value[2], expected)


def test_a_specimen_left_out_is_a_new_one(report):
    """Fitted by hand to all other animals, classes say the same of the specimens of one."""
    train = {
        name: ph.select(data, specimen=[s for s in np.unique(data["specimen"]) if s[1] != "2"])
        for name, data in SMALL.items()
    }
    classes = fit(training=train, draws=300)
    for name, specimen in (("soft", "A2"), ("stiff", "B2")):
        result = classify(ph.select(SMALL[name], specimen=specimen), classes)
        mine = report["log_evidence"].sel(strain_energy="NeoHookean", specimen=specimen)
        # The report has a fifth of the draws.
        np.testing.assert_allclose(mine, result["log_evidence"].values[0], atol=0.3)


def test_report_without_variability():
    """Pooled classes are left out likewise; they have no p-values."""
    report = report_of(
        variability="none",
        draws=100,
        leave_out=dict.fromkeys(["A1"], 0) | {s: s[1] for s in SPECIMENS[1:]},
    )
    np.testing.assert_allclose(report["class_probability"].sum("class_label"), 1, atol=ROUNDING)
    assert "p_value" not in report and report.sizes["strain_energy"] == 1
    assert report["log_score"].notnull().all()
    assert report.attrs["variability"] == "none"
    assert json.loads(report.attrs["random_seed"]) == SEED


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"leave_out": {"A1": "x"}}, ValueError, "leave_out does not say .* 'A2' belongs"),
        (
            {"leave_out": dict.fromkeys(SPECIMENS, "x")},
            ValueError,
            "class 'soft' has no specimen left without 'x'",
        ),
        (
            {"classes": SMALL | {"third": curves({"C1": [30.0]}, 7)}},
            ValueError,
            "class 'third' has no specimen left without 'C1'",
        ),
        (
            {"classes": SMALL | {"third": SMALL["soft"]}},
            ValueError,
            "specimen 'A1' stands in the classes 'soft' and 'third'",
        ),
        ({"classes": SMALL["soft"]}, TypeError, "classes must be a dict .* not Dataset"),
        ({"slope_weight": -1.0}, ValueError, "class 'soft': slope_weight is -1.0"),
        ({"sigma": -1.0}, ValueError, "class 'soft': sigma is -1.0"),
    ],
)
def test_a_report_that_cannot_be_made_says_why(settings, error, message):
    """One error each, before anything is sampled."""
    with pytest.raises(error, match=message):
        report_of(**settings)
