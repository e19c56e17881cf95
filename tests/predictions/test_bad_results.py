"""Evidence and predictions of what is no result of one class: one error says what is."""

import numpy as np
import pytest
import xarray as xr
from bad_input import assert_refused, fitted, plain_model, table, without

import pymc_hyperelastic as ph


def predict(tree=None, radius=(8.0, 9.0), **settings) -> xr.Dataset:
    return ph.predict_pressure(fitted()["C1"] if tree is None else tree, radius, **settings)


# Each row: what is wrong, a call that does it, the error, and fragments that its message must hold.
BAD_INPUT = [
    (
        "prediction of nobody knows what",
        lambda: predict(xr.DataTree.from_dict({"posterior": xr.Dataset()})),
        ValueError,
        ["strain energy", "energy=ph.Ogden()"],
    ),
    (
        "prediction of all classes at once",
        lambda: predict(fitted()),
        ValueError,
        ["no posterior", "['C1', 'C2']", "classes['C1']"],
    ),
    (
        "prediction of a model",
        lambda: predict(plain_model()),
        TypeError,
        ["ph.sample_smc", "Model"],
    ),
    (
        "prediction by a class",
        lambda: predict(energy=ph.Ogden),
        TypeError,
        ["ph.Ogden()", "call the class"],
    ),
    (
        "prediction by another law",
        lambda: predict(energy=ph.CriscioneType()),
        ValueError,
        ["['a', 'b']", "CriscioneType"],
    ),
    (
        "prediction without a tube",
        lambda: predict(without("constant_data"), inner_radius=7.0),
        ValueError,
        ["outer_radius"],
    ),
    (
        "prediction for many tubes",
        lambda: predict(fitted()["C2"]),
        ValueError,
        ["inner_radius", "do not have one"],
    ),
    (
        "prediction without wall",
        lambda: predict(outer_radius=6.0),
        ValueError,
        ["outer_radius must exceed inner_radius", "6.0"],
    ),
    (
        "prediction in a tube of text",
        lambda: predict(inner_radius="7 mm"),
        TypeError,
        ["inner_radius is '7 mm'", "number"],
    ),
    (
        "prediction at no radius",
        lambda: predict(radius=[8.0, 0.0]),
        ValueError,
        ["internal_radius", "positive", "0."],
    ),
    (
        "prediction at an unknown radius",
        lambda: predict(radius=[np.nan]),
        ValueError,
        ["internal_radius", "positive", "nan"],
    ),
    (
        "prediction at text",
        lambda: predict(radius="wide"),
        ValueError,
        ["internal_radius", "wide"],
    ),
    (
        "prediction on a grid",
        lambda: predict(radius=np.ones((2, 2))),
        ValueError,
        ["internal_radius", "list"],
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
