"""Wrong input of fit_classes, classify and kl_divergence raises one error before sampling."""

import json
from dataclasses import asdict
from typing import Any

import pymc as pm
import pytest
import xarray as xr
from bad_input import PLACE, assert_refused, curves, fit, fitted, with_nan

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.settings import SETTINGS, ModelSettings

UNKNOWN_WEIGHT = ph.SlopeAugmented(1.0, pm.HalfNormal.dist())
WITH_FORCE = ph.Gaussian(1.0, force_sd=3.0)
DEMIRAY = asdict(ModelSettings.of(ph.Demiray()))["layers"]
OTHER_LAW = "layers", DEMIRAY, "C2"
CUSTOM = pm.CustomDist.dist(
    1.0, logp=lambda x, m: -((x - m) ** 2), random=lambda m, rng, size: rng.normal(m, size=size)
)


def altered(key: str, value: Any, *names: str) -> xr.DataTree:
    """Return fitted classes; the named classes state another value of a setting."""
    classes = fitted().copy()
    for name in names:
        stored = json.loads(classes[name].attrs[SETTINGS])
        classes[name].attrs[SETTINGS] = json.dumps(stored | {key: value})
    return classes


def observed() -> xr.DataTree:
    likelihood = ph.SlopeAugmented(sigma=1.0, slope_weight=1.0, observed=True)
    return altered("likelihood", likelihood.to_record(), "C1", "C2")


def other_noise(*names: str) -> xr.DataTree:
    likelihood = ph.SlopeAugmented(sigma=2.0, slope_weight=1.0)
    return altered("likelihood", likelihood.to_record(), *names)


def variable(**settings) -> xr.DataTree:
    """Fit classes whose specimens differ."""
    return fit(**{"variability": "specimen", "draws": 100} | settings)


def classify(data=None, classes=None, **settings) -> xr.Dataset:
    data = curves() if data is None else data
    classes = fitted() if classes is None else classes
    return ph.classify(data, classes, progressbar=False, **settings)


# Each row: a call, the error, and fragments that its message must hold.
BAD_INPUT = [
    (lambda: fit({}), ValueError, "groups", "dict", "{}"),
    (lambda: fit(curves()), TypeError, "groups", "dict", "Dataset"),
    (lambda: fit({"": curves()}), ValueError, "group", "text", "''"),
    (lambda: fit({"C/1": curves()}), ValueError, "'/'", "'C/1'"),
    (lambda: fit({".": curves()}), ValueError, "a group is '.'; expected text"),
    (lambda: fit({"..": curves()}), ValueError, "a group is '..'; expected text"),
    (lambda: fit({"a\0b": curves()}), ValueError, "the group 'a\\x00b'", "remove it"),
    (lambda: fit({"C1": curves(), "C2": with_nan()}), ValueError, "group 'C2'", PLACE, "row 43"),
    (lambda: fit({"C1": curves(), "C2": None}), TypeError, "group 'C2'", "inflation_data("),
    (lambda: fit(priors={"mu": CUSTOM}), ValueError, "'mu'", "cannot be stored"),
    (lambda: fit(draws=0), ValueError, "draws is 0", "at least"),
    (lambda: fit(variability="none"), ValueError, "variability is 'none'", "None: all specimens"),
    (lambda: variable(likelihood=UNKNOWN_WEIGHT), ValueError, "must be a number"),
    (lambda: variable(likelihood=WITH_FORCE), ValueError, "force_sd is", "no axial forces"),
    (lambda: variable(draws=99), ValueError, "draws is 99", "at least 100"),
    (lambda: ph.log_evidence(fitted()), ValueError, "['C1', 'C2']", "(classes['C1'])"),
    (lambda: classify(classes={"C1": 1}), TypeError, "ph.fit_classes", "dict"),
    (lambda: classify(classes=xr.DataTree()), ValueError, "ph.fit_classes", "no classes"),
    (lambda: classify(classes=fitted()["C1"]), ValueError, "'observed_data' is no class"),
    (lambda: classify(by="group"), ValueError, "'specimen'", "'group'"),
    (lambda: classify(class_prior={"C3": 1}), ValueError, "['C3']", "['C1', 'C2']"),
    (lambda: classify(class_prior={"C1": 1, "C2": 1}), ValueError, "add up to 1", "'C2': 1"),
    (lambda: classify(class_prior={"C1": 1.5, "C2": -0.5}), ValueError, "'C2': -0.5"),
    (lambda: classify(class_prior=[0.5, 0.5]), TypeError, "class_prior", "dict", "[0.5, 0.5]"),
    (lambda: classify(with_nan()), ValueError, PLACE, "row 43", "pressure is nan kPa"),
    (lambda: classify(classes=altered("priors", {}, "C2")), ValueError, "'C2'", "priors {}"),
    (lambda: classify(classes=observed()), ValueError, "'C1'", "observed variables", "fit_classes"),
    (lambda: classify(classes=other_noise("C2")), ValueError, "class 'C2'", "one likelihood"),
    (lambda: classify(classes=altered("variability", "x", "C1")), ValueError, "'x'", "['none',"),
    (lambda: classify(average_over=[other_noise("C1", "C2")]), ValueError, "do not compare"),
    (lambda: classify(average_over=fitted()), TypeError, "average_over must be a list"),
    (lambda: classify(none_below=0.05), ValueError, "none_below needs", "variability='specimen'"),
    (lambda: classify(undecided_below=-0.1), ValueError, "undecided_below is -0.1", "from 0 to 1"),
    (lambda: classify(undecided_below=1.0), ValueError, "undecided_below is 1.0", "from 0 to 1"),
    (
        lambda: ph.kl_divergence(altered(*OTHER_LAW), "C1", "C2"),
        ValueError,
        "class 'C2'",
        "Demiray",
    ),
    (lambda: ph.kl_divergence(fitted(), "C1", "C3"), ValueError, "no class 'C3'", "['C1',"),
]


@pytest.fixture(scope="module", autouse=True)
def classes_to_begin_with():
    """Fit the classes before a test forbids sampling."""
    fitted()


@pytest.mark.parametrize("row", BAD_INPUT, ids=lambda row: row[2])
def test_wrong_input_is_refused_before_sampling(row):
    """Each kind of wrong input raises one error that names the place and the expected input."""
    call, error, *fragments = row
    assert_refused(call, error, fragments)


@pytest.mark.parametrize("settings", [{"draws": 99}, {"likelihood": WITH_FORCE}])
def test_refused_fit_makes_no_store_that_would_refuse_the_corrected_call(settings, tmp_path):
    with pytest.raises(ValueError, match=r"draws is 99|no axial forces"):
        variable(store=tmp_path / "store", **settings)
    assert not list(tmp_path.iterdir())
