"""Covariates of specimens, and pairs of specimens of the same animal."""

import math

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from pymc_hyperelastic.classes.covariates import Covariates, pairs_of

NAMES = ("A1", "A2", "A3", "B1", "B2", "B3")


def by_name(*values):
    return dict(zip(NAMES, values, strict=True))


def with_animals(classes, soft, stiff):
    """Add a variable "animal" by test; B2 has two tests."""
    changed = classes.copy(deep=True)
    for name, animals in (("soft", soft), ("stiff", stiff)):
        data = changed[name]["constant_data"].to_dataset()
        changed[name]["constant_data"] = xr.DataTree(data.assign(animal=("test", animals)))
    return changed


def test_numeric_covariates_are_standardised_and_categories_become_indicators(classes):
    age, sex = (1, 2, 6, 2, 4, 9), ("f", "m", "f", "o", "m", "f")
    covariates = Covariates(classes, {"age": by_name(*age), "sex": by_name(*sex)})
    assert covariates.names == ["age", "sex=m", "sex=o"]
    table = np.array([age, [s == "m" for s in sex], [s == "o" for s in sex]], float)
    np.testing.assert_allclose(covariates.scale, table.std(axis=1))
    standard = (table - table.mean(axis=1, keepdims=True)) / table.std(axis=1, keepdims=True)
    for i, name in enumerate(NAMES):
        group = "soft" if name[0] == "A" else "stiff"
        np.testing.assert_allclose(covariates.of(group, name), standard[:, i])
    assert Covariates(classes, None).of("soft", "A1").size == 0


def test_covariates_and_pairs_can_be_variables_of_the_data(classes):
    data = with_animals(classes, [3, 1, 2], [1, 2, 2, 3])
    covariates = Covariates(data, "animal")
    assert covariates.names == Covariates(data, ["animal"]).names
    assert covariates.of("soft", "A2")[0] == covariates.of("stiff", "B1")[0] < 0
    assert pairs_of(data, "animal") == [(3, "A1", "B3"), (1, "A2", "B1"), (2, "A3", "B2")]
    pairs = pairs_of(classes, by_name("x", "y", "z", "y", "x", "z"))
    assert pairs == [("x", "A1", "B2"), ("y", "A2", "B1"), ("z", "A3", "B3")]


def test_covariate_collinear_with_the_groups_warns_and_constant_one_is_refused(classes):
    with pytest.warns(
        UserWarning, match=r"groups and the covariates \['batch=old'\] are collinear"
    ):
        Covariates(classes, {"batch": by_name(*["old"] * 3, *["new"] * 3)})
    # Constant but for rounding errors.
    with pytest.raises(ValueError, match="covariate 'age' is the same for all specimens"):
        Covariates(classes, {"age": by_name(0.3, 0.1 + 0.2, 0.3, 0.3, 0.3, 0.3)})


def test_wrong_covariates_are_refused_with_the_specimen(classes):
    for given, message in (
        ({"age": {"A1": 3.0}}, "age: specimen 'A2' of class 'soft' has no value"),
        (
            {"age": by_name(1, 2, np.nan, 1, 2, 3)},
            "'age' of specimen 'A3' of class 'soft' is missing",
        ),
        (
            {"sex": by_name("f", "m", None, *"fmf")},
            "'sex' of specimen 'A3' of class 'soft' is miss",
        ),
        (
            {"sex": by_name("f", "m", "", *"fmf")},
            "'sex' of specimen 'A3' of class 'soft' is missing",
        ),
        ({"age": by_name(1, 2, math.inf, 1, 2, 3)}, "'age' of specimen 'A3' .* is inf; expected"),
        (
            {"day": by_name(*pd.to_datetime(["2020-01-01"] * 3 + ["2020-01-02"] * 3))},
            "'day' of specimen 'A1' of class 'soft' is the date 2020-01-01",
        ),
        (
            pd.DataFrame({"age": range(12)}, index=[*NAMES, *NAMES]),
            "'age' of specimen 'A1' of class 'soft' has several values",
        ),
        ({"age": by_name(1, 2, "old", 1, 2, 3)}, "'age' is a number for some specimens"),
        (["age"], "the data of class 'soft' have no variable 'age' by test"),
    ):
        with pytest.raises(ValueError, match=message):
            Covariates(classes, given)


def test_wrong_pairs_are_refused_with_the_animal(classes):
    for pair, message in (
        (by_name(*range(6)), r"animal 0, specimen 'A1', has no specimen in class 'stiff'"),
        (by_name(1, 2, 3, 1, 2, 2), "animal 2 has several specimens in class 'stiff': 'B2', 'B3'"),
        ("animal", "the data of class 'soft' have no variable 'animal' by test"),
    ):
        with pytest.raises(ValueError, match=message):
            pairs_of(classes, pair)
    data = with_animals(classes, [1, 2, 3], [1, 2, 4, 3])
    with pytest.raises(ValueError, match="specimen 'B2' of class 'stiff' has several values"):
        pairs_of(data, "animal")
    third = xr.DataTree.from_dict({n: classes["soft"] for n in ("a", "b", "c")})
    with pytest.raises(ValueError, match=r"pair needs two groups; got \['a', 'b'"):
        pairs_of(third, by_name(*range(6)))
