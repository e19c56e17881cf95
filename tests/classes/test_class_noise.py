"""Classes whose noise was given as a standard deviation."""

import json

import numpy as np
import pymc as pm
import pytest
import xarray as xr
from variable_classes import SIGMA, classify, curves, fit

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.kinds import kind_of_classes

SD = SIGMA / np.sqrt(2)
# Standard errors by which two runs of one class may differ.
STANDARD_ERRORS = 4.5


@pytest.mark.parametrize("variability", ["none", "specimen"])
def test_classes_of_a_number_are_those_of_the_papers_sigma(variability):
    """Draw for draw, and as they are stored: the two can be compared with each other."""
    settings = {"draws": 100, "chains": 1, "variability": variability}
    with pytest.MonkeyPatch.context() as patch:
        # A hundred draws are few, and doubted.
        patch.setattr("pymc_hyperelastic.classes.fit.warn_of_evidence", lambda *_: None)
        one = fit(**settings, sigma=None, noise_sd=SD)
        other = fit(**settings, sigma=SD * np.sqrt(2))
    for name, fitted in one.children.items():
        xr.testing.assert_equal(fitted.to_dataset(), other[name].to_dataset())
        for group in fitted.children:
            xr.testing.assert_equal(fitted[group].to_dataset(), other[name][group].to_dataset())
        assert "a standard deviation of 0.353553 kPa" in fitted.attrs["noise_in_words"]
        assert fitted.attrs == other[name].attrs


def test_an_inferred_one_is_read_back(tmp_path):
    """A class with a prior of it is that with the prior of √2 of it, also from a file."""
    prior = pm.LogNormal.dist(np.log(SD), 0.4)
    classes = fit(sigma=None, noise_sd=prior)
    classes.to_netcdf(tmp_path / "classes.nc")
    classes = xr.load_datatree(tmp_path / "classes.nc")
    of_sigma = fit(sigma=pm.LogNormal.dist(np.log(SIGMA), 0.4))
    for name in classes.children:
        posterior = classes[name]["posterior"]
        assert "noise_sd" in posterior and "sigma" not in posterior
        assert "one standard deviation" in classes[name].attrs["noise_in_words"]
        sigma = of_sigma[name]["posterior"]["sigma"]
        assert float(posterior["noise_sd"].median()) == pytest.approx(
            float(sigma.median()) / 2**0.5, rel=0.2
        )
        found, expected = (ph.log_evidence(tree[name]) for tree in (classes, of_sigma))
        error = np.hypot(found.standard_error, expected.standard_error)
        assert abs(found.value - expected.value) < STANDARD_ERRORS * error
    kind = kind_of_classes(classes)
    assert json.loads(kind.attrs()["variability_settings"])["noise_sd"][0].lower() == "lognormal"
    new = curves({"N1": [30.0], "N2": [38.0], "N3": [50.0]}, 3)
    results = [classify(new, tree) for tree in (classes, of_sigma)]
    values, errors = (
        [result[name].values for result in results] for name in ("log_evidence", "log_evidence_se")
    )
    assert np.all(np.abs(values[0] - values[1]) < STANDARD_ERRORS * np.hypot(*errors))


def test_pooled_classes_infer_it():
    """The variable carries the name, and new specimens are classified by it."""
    settings = {"variability": "none", "sigma": None, "noise_sd": pm.HalfNormal.dist(5.0)}
    classes = fit(draws=500, chains=2, **settings)
    for fitted in classes.children.values():
        assert set(fitted["posterior"].data_vars) == {"mu", "noise_sd"}
    new = curves({"N": [85.0, 85.0]}, 3)
    result = classify(new, classes)
    of_sigma = fit(
        draws=500, chains=2, variability="none", sigma=pm.HalfNormal.dist(5.0 * np.sqrt(2))
    )
    expected = classify(new, of_sigma)
    error = np.hypot(result["log_evidence_se"].values, expected["log_evidence_se"].values)
    gap = result["log_evidence"].values - expected["log_evidence"].values
    assert np.all(np.abs(gap) < STANDARD_ERRORS * error)
