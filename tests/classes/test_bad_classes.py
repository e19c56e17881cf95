"""Classes that cannot be fitted or compared: one error says where, before sampling."""

import pandas as pd
import pymc as pm
import pytest
import xarray as xr
from bad_input import PLACE, assert_refused, curves, fit, fitted, table, with_nan, without

import pymc_hyperelastic as ph


def altered(name: str, key: str, value: str) -> xr.DataTree:
    """Fitted classes of which one was fitted with other settings."""
    classes = fitted().copy()
    classes[name].attrs[key] = value
    classes[name].attrs.pop("checksum", None)
    return classes


def classify(data=None, classes=None, **settings) -> xr.Dataset:
    data = curves() if data is None else data
    classes = fitted() if classes is None else classes
    return ph.classify(data, classes, progressbar=False, **settings)


# Each row: what is wrong, a call that does it, the error, and fragments that its message must hold.
BAD_INPUT = [
    # Classes.
    ("no classes", lambda: fit({}), ValueError, ["classes", "dict", "{}"]),
    ("list of classes", lambda: fit([curves()]), TypeError, ["classes", "dict", "list"]),
    ("data for classes", lambda: fit(curves()), TypeError, ["classes", "dict", "Dataset"]),
    ("class without a name", lambda: fit({"": curves()}), ValueError, ["class", "text", "''"]),
    ("numbered class", lambda: fit({1: curves()}), ValueError, ["class", "text", "got 1"]),
    ("class with a slash", lambda: fit({"C/1": curves()}), ValueError, ["'/'", "'C/1'"]),
    (
        "pooled classes of which nothing says how slopes count",
        lambda: fit(slope_weight=None),
        TypeError,
        ["slope_weight is not given", "balanced_slope_weight"],
    ),
    (
        "one bad class",
        lambda: fit({"C1": curves(), "C2": with_nan()}),
        ValueError,
        ["class 'C2'", PLACE, "row 43", "pressure is nan kPa"],
    ),
    (
        "one class without data",
        lambda: fit({"C1": curves(), "C2": None}),
        TypeError,
        ["class 'C2'", "inflation_data("],
    ),
    (
        "one class too short",
        lambda: fit({"C1": curves(), "C2": curves([7.2, 7.6], [2.0, 4.0])}),
        ValueError,
        ["class 'C2'", PLACE, "at least 3"],
    ),
    (
        "prior that cannot be stored",
        lambda: fit(priors={"mu": pm.CustomDist.dist(1.0, logp=lambda x, m: -((x - m) ** 2))}),
        ValueError,
        ["'mu'", "cannot be stored", "pm.Gamma.dist(2, 0.1)"],
    ),
    (
        "error that cannot be stored",
        lambda: fit(sigma=pm.Truncated.dist(pm.HalfNormal.dist(), upper=2)),
        ValueError,
        ["'sigma'", "cannot be stored", "pm.Gamma.dist(2, 0.1)"],
    ),
    (
        "effect of experiments without variability",
        lambda: fit(experiment_effect=True),
        ValueError,
        ["experiment_effect is True", "only with variability='specimen'"],
    ),
    (
        "reference stress without variability",
        lambda: fit(reference_stress=30.0),
        ValueError,
        ["reference_stress is 30.0", "only with variability='specimen'"],
    ),
    ("no draws for classes", lambda: fit(draws=0), ValueError, ["draws is 0", "at least"]),
    ("seed for classes", lambda: fit(random_seed="x"), TypeError, ["random_seed", "'x'"]),
    # What is stored of them.
    (
        "no evidence",
        lambda: ph.log_evidence(without("evidence")),
        ValueError,
        ["no evidence", "'posterior'", "ph.sample_smc"],
    ),
    (
        "evidence of all classes at once",
        lambda: ph.log_evidence(fitted()),
        ValueError,
        ["no evidence", "['C1', 'C2']", "ph.log_evidence(classes['C1'])"],
    ),
    # Classification.
    (
        "dict of fitted classes",
        lambda: classify(classes={"C1": fitted()["C1"]}),
        TypeError,
        ["ph.fit_classes", "dict"],
    ),
    (
        "tree without classes",
        lambda: classify(classes=xr.DataTree()),
        ValueError,
        ["ph.fit_classes", "no classes"],
    ),
    (
        "one class for all",
        lambda: classify(classes=fitted()["C1"]),
        ValueError,
        ["ph.fit_classes", "'observed_data' is no class"],
    ),
    ("classified by group", lambda: classify(by="group"), ValueError, ["'specimen'", "'group'"]),
    (
        "class prior of others",
        lambda: classify(class_prior={"C1": 0.5, "C3": 0.5}),
        ValueError,
        ["['C1', 'C3']", "['C1', 'C2']"],
    ),
    (
        "class prior adds up to two",
        lambda: classify(class_prior={"C1": 1.0, "C2": 1.0}),
        ValueError,
        ["add up to 1", "'C2': 1.0"],
    ),
    (
        "negative class prior",
        lambda: classify(class_prior={"C1": 1.5, "C2": -0.5}),
        ValueError,
        ["probabilities", "'C2': -0.5"],
    ),
    (
        "class prior in words",
        lambda: classify(class_prior={"C1": "half", "C2": "half"}),
        ValueError,
        ["probabilities", "'C1': 'half'"],
    ),
    (
        "list for class prior",
        lambda: classify(class_prior=[0.5, 0.5]),
        TypeError,
        ["class_prior", "dict", "[0.5, 0.5]"],
    ),
    (
        "new data altered",
        lambda: classify(with_nan()),
        ValueError,
        [PLACE, "row 43", "pressure is nan kPa"],
    ),
    (
        "new data too short",
        lambda: classify(curves([7.2, 7.6], [2.0, 4.0])),
        ValueError,
        [PLACE, "at least 3"],
    ),
    ("frame for new data", lambda: classify(pd.DataFrame()), TypeError, ["inflation_data("]),
    (
        "classes under different priors",
        lambda: classify(classes=altered("C2", "priors", "{}")),
        ValueError,
        ["class 'C2'", "priors {}", "one prior"],
    ),
    (
        "classes of different laws",
        lambda: ph.kl_divergence(altered("C2", "strain_energy", "Fung"), "C1", "C2"),
        ValueError,
        ["class 'C2'", "strain_energy Fung", "Ogden"],
    ),
    ("seed for classification", lambda: classify(random_seed=0.5), TypeError, ["random_seed"]),
    (
        "divergence from an unknown class",
        lambda: ph.kl_divergence(fitted(), "C1", "C3"),
        ValueError,
        ["no class 'C3'", "['C1', 'C2']"],
    ),
    (
        "divergence of no classes",
        lambda: ph.kl_divergence({"C1": 1, "C2": 2}, "C1", "C2"),
        TypeError,
        ["ph.fit_classes", "dict"],
    ),
]


@pytest.fixture(scope="module", autouse=True)
def classes_to_begin_with():
    """Fit them before a test forbids to sample."""
    fitted()


@pytest.mark.parametrize(("call", "error", "fragments"), table(BAD_INPUT))
def test_bad_input(call, error, fragments):
    """Each kind of bad input raises one error that names the place and what was expected."""
    assert_refused(call, error, fragments)
