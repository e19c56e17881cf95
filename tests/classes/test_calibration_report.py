"""Specimens that are left out of their classes, and classified by the others."""

import json

import numpy as np
import pytest
import xarray as xr
from interrupts import interrupt
from scipy import stats
from scipy.special import logsumexp, softmax
from tiers import deep
from variable_classes import NAMES, SEED, SIGMA, UNIT_PRESSURE, classify, curves, fit

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes import pooled
from pymc_hyperelastic.evidence import smc

ROUNDING = 1e-12
SPECIMENS = ["A1", "A2", "A3", "B1", "B2", "B3"]
SMALL = {
    "soft": curves({"A1": [30.0], "A2": [38.0], "A3": [50.0]}, 5),
    "stiff": curves({"B1": [95.0], "B2": [120.0], "B3": [150.0]}, 6),
}
ANIMALS = dict(zip(SPECIMENS, ["x", "y", "z", "x", "y", "z"], strict=True))
# Two specimens of each class. Their moduli, as measured, differ by less than twice their errors.
FEW = {
    "soft": curves({"1": [30.0], "2": [30.1]}, 12),
    "stiff": curves({"3": [30.4], "4": [30.5]}, 9),
}


class FixedExponent(ph.StrainEnergy):
    """``W = (mu/a) (λr^a + λθ^a + λz^a - 3)`` with an exponent that is a setting."""

    parameters = (ph.Parameter("mu", r"\mu", "kPa", (0.0, 200.0), "modulus"),)

    def __init__(self, exponent):
        self.exponent = exponent

    def energy(self, radial, hoop, axial, *, mu):
        powers = (stretch**self.exponent for stretch in (radial, hoop, axial))
        return mu / self.exponent * (sum(powers) - 3)


def report_of(energy=None, classes=SMALL, **settings):
    defaults = {"sigma": SIGMA, "draws": 200, "random_seed": SEED, "progressbar": False}
    return ph.calibration_report(energy or ph.NeoHookean(), classes, **defaults | settings)


def report_of_pooled(classes=FEW, **settings):
    settings = {"variability": "none", "draws": 100} | settings
    return report_of(FixedExponent(2.0), classes, **settings)


@pytest.fixture(scope="module")
def report():
    """Return the report of two laws that describe the curves nearly equally well."""
    return report_of([FixedExponent(2.0), FixedExponent(2.02)], leave_out=ANIMALS)


def test_a_report_has_a_row_for_each_law_and_their_average(report):
    labels = ["FixedExponent(exponent=2.0)", "FixedExponent(exponent=2.02)", "average"]
    assert report["strain_energy"].values.tolist() == labels
    assert report["specimen"].values.tolist() == SPECIMENS
    assert report["true_class"].values.tolist() == ["soft"] * 3 + ["stiff"] * 3
    assert report["left_out"].values.tolist() == [*ANIMALS.values()]
    probability = report["class_probability"]
    assert probability.dims == ("strain_energy", "specimen", "class_label")
    np.testing.assert_allclose(probability, softmax(report["log_evidence"], axis=2), rtol=1e-9)
    p_value = report["p_value"].values
    assert np.all((p_value > 0) & (p_value <= 1))
    right = probability.sel(class_label=report["true_class"]).sel(strain_energy=labels[0])
    assert right.mean() > 0.5
    for law in range(3):
        for i, name in enumerate(report["true_class"].values.tolist()):
            p, k = probability.values[law, i], NAMES.index(name)
            np.testing.assert_allclose(report["log_score"].values[law, i], np.log(p[k]))
            brier = (p[k] - 1) ** 2 + p[1 - k] ** 2
            np.testing.assert_allclose(report["brier_score"].values[law, i], brier)


def test_laws_are_averaged_by_the_evidence_of_what_is_not_left_out(report):
    """Specimens that are left out together have the same weights of the laws."""
    laws = report["strain_energy_probability"]
    weights = laws.values[:2]
    assert ((weights > 0.001) & (weights < 0.999)).any()
    np.testing.assert_allclose(weights.sum(axis=0), 1)
    assert np.isnan(laws.sel(strain_energy="average")).all()
    np.testing.assert_array_equal(weights[:, :3], weights[:, 3:])
    # The probabilities of two laws have the same error, at most that of a coin.
    errors = report["strain_energy_probability_se"].values
    np.testing.assert_allclose(errors[0], errors[1], atol=ROUNDING)
    assert np.all((errors[:2] > 0) & (errors[:2] < 0.5)) and np.isnan(errors[2]).all()
    value, p_value = report["log_evidence"].values, report["p_value"].values
    average = logsumexp(value[:2] + np.log(weights)[..., None], axis=0)
    np.testing.assert_allclose(value[2], average)
    np.testing.assert_allclose(p_value[2], (weights[..., None] * p_value[:2]).sum(axis=0))


def test_a_specimen_left_out_is_classified_as_a_new_one(report):
    """A fit to all other animals gives the same evidences and p-values."""
    train = {
        name: ph.select(data, specimen=[s for s in np.unique(data["specimen"]) if s[1] != "2"])
        for name, data in SMALL.items()
    }
    classes = fit(FixedExponent(2.0), train, draws=300)
    for name, specimen in (("soft", "A2"), ("stiff", "B2")):
        result = classify(ph.select(SMALL[name], specimen=specimen), classes)
        mine = report.isel(strain_energy=0).sel(specimen=specimen)
        # The report has 200 draws of the spread of three specimens, the fit has 600.
        np.testing.assert_allclose(mine["log_evidence"], result["log_evidence"].values[0], atol=0.3)
        np.testing.assert_allclose(mine["p_value"], result["p_value"].values[0], atol=0.1)


def test_pooled_classes_equal_quadrature_over_the_modulus():
    """Names that are numbers, in the data and in `leave_out`, are text in the report."""
    numbered = {
        name: data.assign_coords(specimen=data["specimen"].astype(int))
        for name, data in FEW.items()
    }
    pairs = {1: "a", 2: "b", 3: "a", 4: "b"}
    report = report_of_pooled(numbered, leave_out=pairs, draws=500, chains=2)
    assert report["specimen"].values.tolist() == ["1", "2", "3", "4"]
    assert "p_value" not in report and report.sizes["strain_energy"] == 1
    assert report.attrs["variability"] == "none"
    assert json.loads(report.attrs["random_seed"]) == SEED
    mu = np.linspace(25, 36, 20001)

    def log_likelihood(specimen):
        data = next(d for d in FEW.values() if specimen in d["specimen"])
        pressure = ph.select(data, specimen=specimen)["pressure"].values
        # The parameter sigma is √2 times the standard deviation.
        residual = pressure - mu[:, None] * UNIT_PRESSURE
        return stats.norm.logpdf(residual, scale=SIGMA / np.sqrt(2)).sum(axis=1)

    for name, pair in zip("1234", pairs.values(), strict=True):
        expected = []
        for data in FEW.values():
            known = [s for s in data["specimen"].values if pairs[int(s)] != pair]
            training = sum(map(log_likelihood, known))
            expected.append(logsumexp(training + log_likelihood(name)) - logsumexp(training))
        found = report["log_evidence"].sel(specimen=name).values.ravel()
        # Means over 1000 draws of a density that varies by half: four standard errors.
        np.testing.assert_allclose(found, expected, atol=0.06)


# The interrupted function, its call that belongs to the second specimen left out, and chains.
INTERRUPTS = [(pooled, "run_smc", 4, 1), *deep([(smc, "_temper", 6, 2)])]
INTERRUPTS += deep([(pooled.ClassPredictive, "__call__", 3, 1)])


@pytest.mark.parametrize(("module", "name", "call", "chains"), INTERRUPTS)
def test_after_an_interrupt_only_complete_results_are_reported(
    monkeypatch, module, name, call, chains
):
    complete = report_of_pooled(chains=chains)
    interrupt(monkeypatch, module, name, call)
    with pytest.warns(UserWarning, match="interrupted"):
        report = report_of_pooled(chains=chains)
    xr.testing.assert_identical(report.isel(specimen=[0]), complete.isel(specimen=[0]))
    for value in ("class_probability", "log_evidence", "log_score", "brier_score"):
        assert np.isnan(report[value].values[:, 1:]).all()


def test_wrong_input_is_named_before_anything_is_sampled():
    third = {"third": curves({"C1": [30.0]}, 7)}
    for settings, error, message in (
        ({"energy": ph.Ogden}, TypeError, r"such as ph\.Ogden\(\) is needed.*call the class"),
        ({"energy": [ph.Ogden]}, TypeError, "call the class"),
        ({"energy": ()}, ValueError, "energy holds no strain energy"),
        ({"variability": "none", "experiment_effect": True}, ValueError, "variability='specimen'"),
        ({"leave_out": SPECIMENS}, TypeError, "leave_out must be a dict .*not list"),
        ({"leave_out": {"A1": "x"}}, ValueError, "leave_out does not say .* 'A2' belongs"),
        ({"leave_out": dict.fromkeys(SPECIMENS, "x")}, ValueError, "'soft' has no specimen left"),
        ({"classes": SMALL | third}, ValueError, "class 'third' has no specimen left without 'C1'"),
        (
            {"classes": SMALL | {"b": SMALL["soft"]}},
            ValueError,
            "'A1' stands in the classes 'soft'",
        ),
        ({"classes": SMALL["soft"]}, TypeError, "classes must be a dict .* not Dataset"),
        ({"sigma": -1.0}, ValueError, "class 'soft': sigma is -1.0"),
    ):
        arguments = {"energy": ph.NeoHookean(), "classes": SMALL, "sigma": SIGMA} | settings
        with pytest.raises(error, match=message):
            ph.calibration_report(**arguments)
