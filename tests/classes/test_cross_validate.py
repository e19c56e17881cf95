"""Cross-validation: each specimen is left out of its class and classified by the others."""

import json

import numpy as np
import pytest
import xarray as xr
from interrupts import interrupt
from scipy import stats
from scipy.special import logsumexp, softmax
from variable_classes import PRESSURE_SD, SEED, UNIT_PRESSURE, classify, curves, fit

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes import pooled
from pymc_hyperelastic.classes.interface import Fold, Prediction
from pymc_hyperelastic.evidence.estimate import Estimate

ROUNDING = 1e-12
SPECIMENS = ["A1", "A2", "A3", "B1", "B2", "B3"]
SMALL = {
    "soft": curves({"A1": [30.0], "A2": [38.0], "A3": [50.0]}, 5),
    "stiff": curves({"B1": [95.0], "B2": [120.0], "B3": [150.0]}, 6),
}
ANIMALS = dict(zip(SPECIMENS, "xyyxyy", strict=True))
FEW = {
    "soft": curves({"1": [30.0], "2": [30.1]}, 5),
    "stiff": curves({"3": [30.4], "4": [30.5]}, 6),
}
# These are left out together; the report has two folds of two specimens and two classes.
PAIRS, POOLED_DRAWS = {1: "a", 2: "b", 3: "a", 4: "b"}, 1000


def report_of(energy=None, groups=SMALL, **settings):
    defaults = {"likelihood": PRESSURE_SD, "draws": 200, "random_seed": SEED, "progressbar": False}
    return ph.cross_validate(energy or ph.NeoHookean(), groups, **defaults | settings)


def report_of_pooled():
    """Return a report; names that are numbers in data and `leave_out` are text in the report."""
    numbered = {k: v.assign_coords(specimen=v["specimen"].astype(int)) for k, v in FEW.items()}
    settings = {"variability": None, "draws": POOLED_DRAWS}
    return report_of(None, numbered, leave_out=PAIRS, **settings)


@pytest.fixture(scope="module")
def pooled_report():
    return report_of_pooled()


@pytest.fixture(scope="module")
def report():
    """Return the report of two laws that describe the curves nearly equally well."""
    return report_of([ph.NeoHookean(), ph.MooneyRivlin()], leave_out=ANIMALS)


def test_report_has_a_row_for_each_law_and_their_average(report):
    labels = ["NeoHookean", "MooneyRivlin", "average"]
    assert report["strain_energy"].values.tolist() == labels
    assert report["specimen"].values.tolist() == SPECIMENS
    assert report["true_class"].values.tolist() == ["soft"] * 3 + ["stiff"] * 3
    assert report["left_out"].values.tolist() == [*ANIMALS.values()]
    probability = report["class_probability"]
    assert probability.dims == ("strain_energy", "specimen", "class_label")
    np.testing.assert_allclose(probability, softmax(report["log_evidence"], axis=2), rtol=1e-9)
    p_value = report["p_value"].values
    assert np.all((p_value > 0) & (p_value <= 1))
    right = probability.sel(class_label=report["true_class"])
    np.testing.assert_allclose(report["log_score"], np.log(right))
    # The errors of the probabilities of two classes are equal.
    np.testing.assert_allclose(report["brier_score"], 2 * (1 - right) ** 2)
    assert right[0].mean() > 0.5


def test_laws_are_weighted_by_the_evidence_of_the_remaining_specimens(report):
    """Specimens that are left out together have the same weights of the laws."""
    laws = report["strain_energy_probability"]
    weights = laws.values[:2]
    assert ((weights > 0.001) & (weights < 0.999)).any()
    np.testing.assert_allclose(weights.sum(axis=0), 1)
    assert np.isnan(laws.sel(strain_energy="average")).all()
    np.testing.assert_array_equal(weights[:, :3], weights[:, 3:])
    # The probabilities of two laws have the same error, which is at most 0.5.
    errors = report["strain_energy_probability_se"].values
    np.testing.assert_allclose(errors[0], errors[1], atol=ROUNDING)
    assert np.all((errors[:2] > 0) & (errors[:2] < 0.5)) and np.isnan(errors[2]).all()
    value, p_value = report["log_evidence"].values, report["p_value"].values
    average = logsumexp(value[:2] + np.log(weights)[..., None], axis=0)
    np.testing.assert_allclose(value[2], average)
    error, shares = report["log_evidence_se"].values, np.exp(value[:2] - average)
    variance = ((shares * weights[..., None] * error[:2]) ** 2).sum(axis=0)
    np.testing.assert_allclose(error[2] ** 2, variance)
    np.testing.assert_allclose(p_value[2], (weights[..., None] * p_value[:2]).sum(axis=0))


def test_left_out_specimen_has_the_evidence_of_a_fit_without_it(report):
    """A fit to all other animals gives the same evidences and p-values."""
    train = {
        name: ph.select(data, specimen=[s for s in np.unique(data["specimen"]) if s[1] != "1"])
        for name, data in SMALL.items()
    }
    classes = fit(None, train, draws=300)
    for name, specimen in (("soft", "A1"), ("stiff", "B1")):
        result = classify(ph.select(SMALL[name], specimen=specimen), classes).squeeze()
        mine = report.isel(strain_energy=0).sel(specimen=specimen)
        error = np.abs(mine["log_evidence"] - result["log_evidence"])
        assert np.all(error < 3 * np.hypot(mine["log_evidence_se"], result["log_evidence_se"]))
        # P-values are 1 - (1 - s)², where s is the share of one random specimen for each draw:
        # three binomial standard errors.
        share = 1 - np.sqrt(1 - result["p_value"])
        error = 2 * (1 - share) * np.sqrt(share * (1 - share) * (1 / 200 + 1 / 600))
        assert np.all(np.abs(mine["p_value"] - result["p_value"]) < 3 * error)


def test_evidence_under_pooled_classes_equals_quadrature_over_the_modulus(pooled_report):
    assert pooled_report["specimen"].values.tolist() == ["1", "2", "3", "4"]
    assert "p_value" not in pooled_report and pooled_report.sizes["strain_energy"] == 1
    assert pooled_report.attrs["variability"] == "none"
    assert json.loads(pooled_report.attrs["random_seed"]) == SEED
    mu, likelihoods, of_class = np.linspace(25, 36, 20001), {}, {}
    for name, data in FEW.items():
        for specimen in data["specimen"].values.tolist():
            pressure = ph.select(data, specimen=specimen)["pressure"].values
            normal = stats.norm(mu[:, None] * UNIT_PRESSURE, PRESSURE_SD)
            likelihoods[specimen] = normal.logpdf(pressure).sum(axis=1)
            of_class[specimen] = name
    for specimen, likelihood in likelihoods.items():
        found = pooled_report["log_evidence"].isel(strain_energy=0).sel(specimen=specimen)
        pair = PAIRS[int(specimen)]
        for name in FEW:
            # One specimen of each class is not left out.
            (other,) = (s for s in of_class if of_class[s] == name and PAIRS[int(s)] != pair)
            posterior = likelihoods[other] - logsumexp(likelihoods[other])
            expected = logsumexp(posterior + likelihood)
            # Four standard errors of a mean over 1000 draws of the posterior.
            variance = np.exp(logsumexp(posterior + 2 * likelihood) - 2 * expected) - 1
            error = abs(found.sel(class_label=name).item() - expected)
            assert error < 4 * np.sqrt(variance / POOLED_DRAWS) < 0.15
            stated = pooled_report["log_evidence_se"].sel(specimen=specimen, class_label=name)
            assert error < 4 * stated.item() < 0.15


def test_unreliable_evidence_of_a_left_out_specimen_is_not_to_be_trusted(monkeypatch):
    """An evidence that is smaller by a hundred nats could not change the probability."""
    known = Estimate(-3.0, 0.1)
    predictions = {
        "1": [Prediction(known, 0.1, "", 0.1), Prediction(known, 0.1, "", 0.1)],
        "3": [Prediction(known, 0.1, "", 0.9), Prediction(known, 0.1, "", 0.1)],
        "2": [Prediction(known, 0.1, "", 0.1), Prediction(Estimate(-4.0, np.inf), 0.1, "", 0.1)],
        "4": [Prediction(known, 0.1, "", 0.1), Prediction(Estimate(-103.0, 0.1), 0.1, "", 0.9)],
    }

    def leave_out(*_):
        return lambda names, _: Fold(known, "good", {name: predictions[name] for name in names})

    monkeypatch.setattr(pooled.PooledClass, "leave_out", leave_out)
    report = report_of_pooled().squeeze("strain_energy").sel(specimen=["1", "2", "3", "4"])
    bad = "not to be trusted"
    assert report["verdict"].values.tolist() == ["good", bad, bad, "good"]
    assert np.isinf(report["log_evidence_se"].sel(specimen="2", class_label="stiff"))


def test_interrupt_keeps_complete_folds_and_sets_others_to_nan(pooled_report, monkeypatch):
    interrupt(monkeypatch, pooled, "run_smc", 4)  # a fit of the second fold
    with pytest.warns(UserWarning, match="interrupted"):
        report = report_of_pooled()
    first = {"specimen": [0, 2]}
    xr.testing.assert_identical(report.isel(first), pooled_report.isel(first))
    for value in ("class_probability", "log_evidence", "log_score", "brier_score"):
        assert np.isnan(report[value].values[:, [1, 3]]).all()


def test_wrong_input_is_refused_before_sampling():
    third = {"third": curves({"C1": [30.0]}, 7)}
    for settings, error, message in (
        ({"energy": ph.Ogden}, TypeError, r"such as ph\.Ogden\(\).*call the class"),
        ({"energy": ()}, ValueError, "energy holds no strain energy"),
        ({"energy": "Demiray"}, TypeError, r"such as ph\.Ogden\(\), got 'Demiray'"),
        ({"leave_out": SPECIMENS}, TypeError, "leave_out must be a dict .*not list"),
        ({"leave_out": {"A1": "x"}}, ValueError, "leave_out has no label for specimen 'A2'"),
        ({"leave_out": dict.fromkeys(SPECIMENS, np.nan)}, ValueError, "no label for specimen 'A1'"),
        ({"leave_out": dict.fromkeys(SPECIMENS, "x")}, ValueError, "'soft' has no specimen left"),
        ({"groups": SMALL | third}, ValueError, "'third' has no specimen left without 'C1'"),
        (
            {"groups": SMALL | {"b": SMALL["soft"]}},
            ValueError,
            "'A1' is in the groups 'soft' and 'b'",
        ),
        ({"likelihood": -1.0}, ValueError, "pressure_sd is -1.0"),
    ):
        arguments = {"energy": ph.NeoHookean(), "groups": SMALL, "likelihood": 1.0} | settings
        with pytest.raises(error, match=message):
            ph.cross_validate(**arguments)
