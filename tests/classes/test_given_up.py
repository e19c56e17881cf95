"""A specimen that was given up after long: what is said by it says so."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from variable_classes import classify, curves, fit

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.specimens import SpecimenSampler
from pymc_hyperelastic.data.select import specimens_of

GIVEN_UP = "B2"
STANDARD_ERRORS = 3


def give_up(patch):
    """Let one of the specimens be given up under the reference."""
    sampled = SpecimenSampler.__call__

    def sample(self, data, rng):
        draws = sampled(self, data, rng)
        given_up = specimens_of(data)[0] == [GIVEN_UP]
        return replace(draws, standard_error=np.inf) if given_up else draws

    patch.setattr(SpecimenSampler, "__call__", sample)


@pytest.fixture(scope="module")
def classes():
    with pytest.MonkeyPatch.context() as patch:
        give_up(patch)
        patch.setattr(SpecimenSampler, "near", lambda self, data, draws, *_: draws)
        with pytest.warns(UserWarning) as said:
            fitted = fit(chains=1)
    assert any(f"{GIVEN_UP!r} was given up after long" in str(w.message) for w in said)
    return fitted


def test_class_has_no_evidence(classes):
    assert np.isinf(ph.log_evidence(classes["stiff"]).standard_error)
    assert np.isfinite(ph.log_evidence(classes["soft"]).standard_error)


def test_its_predictions_warn(classes):
    with pytest.warns(UserWarning, match=f"{GIVEN_UP}' was given up after long"):
        found = ph.predict_pressure(classes["stiff"], [8.0, 8.5], specimen=GIVEN_UP)
    assert np.isfinite(found["pressure"]).all()


def test_other_predictions_do_not(classes):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ph.predict_pressure(classes["stiff"], [8.0, 8.5], specimen="B1")
        ph.predict_pressure(classes["soft"], [8.0, 8.5])


@pytest.mark.parametrize(
    "said",
    [
        lambda classes: ph.compare_classes(classes, "mu", specimens=20),
        lambda classes: ph.plan_study(classes, "mu", [4], studies=20, random_seed=1),
        lambda classes: ph.expected_information(
            classes, {"one": {"pressure": [4.0], "points": 1}}, specimens=20, random_seed=1
        ),
    ],
    ids=["compare_classes", "plan_study", "expected_information"],
)
def test_what_is_said_by_its_class_warns(classes, said):
    with pytest.warns(UserWarning, match="class 'stiff' .* is not to be trusted"):
        said(classes)


def test_nothing_is_decided_by_its_class(classes):
    said = ph.diagnose_evidence(classes["stiff"])
    assert said.attrs["verdict"] == "not to be trusted" and "given up" in said.attrs["words"]
    new = curves({"N1": [80.0]}, 3)
    with pytest.warns(UserWarning, match="1 of 1 cannot be judged"):
        found = classify(new, classes)
    assert found["decision"].item() == "cannot be judged"


def test_report_says_so(classes, tmp_path):
    ph.report(classes, tmp_path / "report.html")
    assert f"specimen {GIVEN_UP} was given up" in (tmp_path / "report.html").read_text()


def test_its_class_may_find_it(monkeypatch):
    """Sampled again, as one of its class, it is known."""
    expected = fit(chains=1)
    give_up(monkeypatch)
    found = fit(chains=1)
    assert np.isfinite(found["stiff"]["specimens"]["standard_error"]).all()
    value, error = ph.log_evidence(found["stiff"])
    known = ph.log_evidence(expected["stiff"])
    assert abs(value - known.value) < STANDARD_ERRORS * np.hypot(error, known.standard_error)
    assert error < 0.1  # nats


def test_older_classes_are_judged_anew(classes):
    """What they say of their evidence knows nothing of specimens."""
    fitted = classes["stiff"].copy(deep=True)
    del fitted.attrs["checksum"]
    said = fitted["diagnosis"].to_dataset()
    good = said.sel(check=said["check"] != "specimens").assign_attrs(verdict="good", words="")
    fitted["diagnosis"] = xr.DataTree(good)
    assert ph.diagnose_evidence(fitted).attrs["verdict"] == "not to be trusted"
