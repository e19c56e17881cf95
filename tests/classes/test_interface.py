"""The interface of classes: a third kind is fitted, stored, classified and left out as both are."""

import json
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest
import xarray as xr
from scipy import stats
from variable_classes import NAMES, SEED, TRAINING, curves, fit

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes import kinds
from pymc_hyperelastic.classes.interface import ClassKind, Fold, Prediction, training_evidence
from pymc_hyperelastic.data.select import specimens_apart, without_specimens
from pymc_hyperelastic.files.store import compute_now
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy

# Standard errors of a thousand draws of a mean; seeds are fixed.
STANDARD_ERRORS = 4


@dataclass(frozen=True)
class Scattered(ClassKind):
    """Classes by the mean pressure of a test alone, which is normal with a known deviation."""

    variability: ClassVar[str] = "scattered"
    has_p_value: ClassVar[bool] = False
    common_attrs: ClassVar[tuple[str, ...]] = ("scattered_settings",)

    energy: StrainEnergy
    sd: float

    @classmethod
    def of_settings(cls, energy, *, sigma, **settings):
        return cls(energy, sigma)

    @classmethod
    def of_tree(cls, fitted):
        return cls(ph.NeoHookean(), json.loads(fitted.attrs["scattered_settings"]))

    def attrs(self):
        return {"variability": "scattered", "scattered_settings": json.dumps(self.sd)}

    def check(self, data):
        if data["pressure"].values.min() < 0:
            raise ValueError("pressure falls below zero")

    def fit(self, classes, draws, chains, seed, progressbar=False, remember=compute_now):
        self.check_classes(classes)
        for name, data in classes.items():
            means = self.means(data)
            value = stats.norm.logpdf(means, np.mean(means), self.sd).sum()
            tree = xr.DataTree.from_dict(
                {
                    "posterior": xr.Dataset({"mean": (("chain", "draw"), [[np.mean(means)]])}),
                    "evidence": xr.Dataset(
                        {"log_evidence": ("chain", [value]), "log_evidence_se": ("chain", [0.0])}
                    ),
                    "constant_data": data,
                }
            )
            tree.attrs |= self.attrs()
            yield name, tree

    def predictor(self, classes, like, seed):
        def predict(data, seed):
            return [self.prediction(fitted, data) for fitted in classes.values()]

        return predict

    def leave_out(self, classes, seed, remember=compute_now):
        def fold(left_out, draws, chains):
            train = {name: without_specimens(data, left_out) for name, data in classes.items()}
            fitted = dict(self.fit(train, draws, chains, seed))
            predictions = {
                name: [self.prediction(of_class, part) for of_class in fitted.values()]
                for data in classes.values()
                for name, part in specimens_apart(data, left_out).items()
            }
            return Fold(training_evidence(fitted), "good", predictions)

        return fold

    def new_specimens(self, fitted, rng):
        return {}

    @staticmethod
    def means(data):
        test, pressure = data["test"].values, data["pressure"].values
        return [pressure[test == i].mean() for i in range(data.sizes["test"])]

    def prediction(self, fitted, data) -> Prediction:
        mean = fitted["posterior"]["mean"].item()
        value = float(stats.norm.logpdf(self.means(data), mean, self.sd).sum())
        return Prediction(ph.Estimate(value, 0.0), 0.0, "by hand", 0.0)


@pytest.fixture
def third_kind(monkeypatch):
    monkeypatch.setitem(kinds._KINDS, Scattered.variability, Scattered)


SETTINGS: dict[str, Any] = {"variability": "scattered", "sigma": 2.0, "progressbar": False}


def test_a_third_kind_is_fitted_stored_and_classifies(third_kind, tmp_path):
    """Its classes come back from a file, and probabilities are those of its own evidences."""
    classes = ph.fit_classes(ph.NeoHookean(), TRAINING, slope_weight=0.0, **SETTINGS)
    classes.to_netcdf(tmp_path / "classes.nc")
    stored = xr.open_datatree(tmp_path / "classes.nc")
    new = curves({"N1": [40.0], "N2": [90.0]}, 5)
    result = ph.classify(new, stored, by="specimen", progressbar=False)
    assert result["decision"].values.tolist() == ["soft", "stiff"]
    assert set(result["method"].values.ravel()) == {"by hand"}
    assert "p_value" not in result
    with pytest.raises(ValueError, match="divergence"):
        ph.kl_divergence(stored, *NAMES)
    with pytest.raises(ValueError, match="none_below"):
        ph.classify(new, stored, none_below=0.05, progressbar=False)


def test_a_third_kind_is_left_out(third_kind):
    """Cross-validation knows no kinds: each specimen is classified by all others."""
    report = ph.calibration_report(ph.NeoHookean(), TRAINING, **SETTINGS)
    assert np.isfinite(report["log_score"].values).all()
    assert "p_value" not in report
    chosen = report["class_probability"].idxmax("class_label").values.ravel()
    assert (chosen == report["true_class"].values).mean() > 0.5


def test_data_that_a_third_kind_cannot_take_are_named(third_kind):
    """The class at fault, by the checks that all kinds share."""
    low = TRAINING["stiff"].assign(pressure=-TRAINING["stiff"]["pressure"])
    with pytest.raises(ValueError, match=r"class 'stiff': pressure falls below zero"):
        ph.fit_classes(ph.NeoHookean(), TRAINING | {"stiff": low}, slope_weight=0.0, **SETTINGS)


def test_a_kind_that_is_not_known_is_named(third_kind, monkeypatch):
    """Where a file was written by a kind that is not there, it says which there are."""
    classes = ph.fit_classes(ph.NeoHookean(), TRAINING, slope_weight=0.0, **SETTINGS)
    monkeypatch.delitem(kinds._KINDS, Scattered.variability)
    with pytest.raises(ValueError, match=r"'scattered' .*\['none', 'specimen'\]"):
        ph.classify(TRAINING["soft"], classes, progressbar=False)


@pytest.mark.parametrize("variability", ["none", "specimen"])
def test_new_specimens_are_those_of_the_class(variability):
    """Pooled ones have the parameters of the class; others are spread about it as it says."""
    classes = fit(variability=variability)
    kind = kinds.kind_of_classes(classes)
    fitted = classes["stiff"]
    drawn = kind.new_specimens(fitted, np.random.default_rng(SEED))["mu"]
    posterior = fitted["posterior"]
    if variability == "none":
        np.testing.assert_array_equal(np.sort(drawn), np.sort(posterior["mu"].values.ravel()))
        return
    # Of one modulus: its reference strain is spread normally on the logarithmic scale.
    location, spread = (posterior[name].values.ravel() for name in ("location", "spread"))
    expected, variance = location.mean(), location.var() + (spread**2).mean()
    # Of a neo-Hookean solid T = μ (e^{2e} − e^{−2e}).
    found = np.log(np.arcsinh(kind.reference_stress / (2 * drawn)) / 2)
    assert abs(found.mean() - expected) < STANDARD_ERRORS * np.sqrt(variance / len(drawn))
