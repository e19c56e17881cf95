"""Specimens that cannot be sampled, or are given up after long, and their classes."""

import json
from functools import partial

import numpy as np
import pytest
import xarray as xr
from variable_classes import TRAINING, classify, curves, fit

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes import specimens
from pymc_hyperelastic.classes.specimens import SpecimenSampler
from pymc_hyperelastic.evidence import integral
from pymc_hyperelastic.evidence.importance import Integral
from pymc_hyperelastic.evidence.tempering import Settings, TemperedSMC

GIVEN_UP = "B2"
STANDARD_ERRORS = 3


def change(patch, method, name, instead):
    """Change how one specimen is sampled."""
    sample = getattr(SpecimenSampler, method)

    def changed(self, data, *args):
        chosen = instead if name in data["specimen"].values else lambda take: take()
        return chosen(lambda: sample(self, data, *args))

    patch.setattr(SpecimenSampler, method, changed)


def fail(_):
    raise np.linalg.LinAlgError("singular")


def give_up(take):
    """Let importance sampling fail, and tempering stop before its particles move."""

    def unknown(sample):
        def sampled(*args, **settings):
            found = sample(*args, **settings)
            return Integral(found.log_value, np.inf, "importance", found.particles)

        return sampled

    with pytest.MonkeyPatch.context() as patch:
        hasty = Settings(most_capped=0)
        patch.setattr(integral, "TemperedSMC", partial(TemperedSMC, settings=hasty))
        for module in (integral, specimens):
            patch.setattr(module, "importance_sampling", unknown(module.importance_sampling))
        return take()


def test_failed_specimen_cannot_be_judged_and_the_others_are_classified(classes, monkeypatch):
    new_data = curves({"N1": [42.0], "N2": [90.0]}, 3)
    alone = classify(new_data, classes)
    change(monkeypatch, "__call__", "N2", fail)
    with pytest.warns(UserWarning, match=r"specimen 'N2', .* cannot be judged: singular"):
        found = classify(new_data, classes)
    assert found["decision"].values.tolist() == ["soft", "cannot be judged"]
    assert found["error"].values.tolist() == ["", "singular"]
    assert np.isnan(found["class_probability"].values[1]).all()
    assert np.isinf(found["log_evidence_se"].values[1]).all()
    xr.testing.assert_equal(found["log_evidence"][0], alone["log_evidence"][0])


@pytest.mark.filterwarnings("ignore:class .* evidence")
def test_class_with_a_failed_specimen_is_not_fitted_and_the_others_are(monkeypatch):
    """A training specimen is not left out silently: its class is not fitted."""
    change(monkeypatch, "__call__", "B2", fail)
    said = "class 'stiff' is not fitted: specimen 'B2' .*singular"
    with pytest.warns(UserWarning, match=said):
        classes = fit(draws=100, chains=1)
    assert list(classes.children) == ["soft"]
    assert json.loads(classes.attrs["missing_classes"]) == {
        "stiff": "specimen 'B2' cannot be sampled: singular"
    }
    new = curves({"N1": [42.0]}, 3)
    with pytest.raises(ValueError, match=r"class 'stiff' was not fitted .*singular.* class_prior"):
        classify(new, classes)
    assert classify(new, classes, class_prior={"soft": 1.0})["decision"].item() == "soft"
    with pytest.raises(ValueError, match=said):
        fit(training={"stiff": TRAINING["stiff"]})


@pytest.mark.filterwarnings("ignore:class .* evidence")
def test_class_with_a_specimen_given_up_has_an_infinite_evidence_error(classes, monkeypatch):
    """Results of such a class warn, and classify makes no decision."""
    classes = classes.copy()
    change(monkeypatch, "__call__", GIVEN_UP, give_up)
    change(monkeypatch, "near", GIVEN_UP, give_up)
    with pytest.warns(UserWarning, match=f"'{GIVEN_UP}' was given up, because"):
        classes["stiff"] = stiff = fit(training={"stiff": TRAINING["stiff"]}, chains=1)["stiff"]
    error = stiff["specimens"]["standard_error"]
    assert error["specimen"].values[np.isinf(error.values)].tolist() == [GIVEN_UP]
    assert np.isinf(ph.log_evidence(stiff).standard_error)
    found = ph.diagnose_evidence(stiff)
    assert found.attrs["verdict"] == "not to be trusted" and "given up" in found.attrs["words"]
    with pytest.warns(UserWarning, match=f"{GIVEN_UP}' was given up during the fit"):
        found = ph.predict_pressure(stiff, [8.0, 8.5], specimen=GIVEN_UP)
    assert np.isfinite(found["pressure"]).all()
    ph.predict_pressure(stiff, [8.0, 8.5], specimen="B1")
    with pytest.warns(UserWarning, match="class 'stiff' .* is not to be trusted"):
        ph.compare_classes(classes, "mu", specimens=20, draws=100, effect_prior=None)
    with pytest.warns(UserWarning, match="1 of 1 cannot be judged"):
        found = classify(curves({"N1": [80.0]}, 3), classes)
    assert found["decision"].item() == "cannot be judged"


def test_specimen_given_up_is_sampled_again_near_its_class(classes, monkeypatch):
    known = ph.log_evidence(classes["stiff"])
    change(monkeypatch, "__call__", GIVEN_UP, give_up)
    found = fit(training={"stiff": TRAINING["stiff"]}, chains=1)["stiff"]
    assert np.isfinite(found["specimens"]["standard_error"]).all()
    value, error = ph.log_evidence(found)
    assert abs(value - known.value) < STANDARD_ERRORS * np.hypot(error, known.standard_error)
    assert error < 0.1  # nats
