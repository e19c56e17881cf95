"""Impossible predictions: each error names the problem and the expected input."""

import numpy as np
import pytest
import xarray as xr
from bad_input import assert_refused, fitted, plain_model, table, without
from tube_posteriors import SHEEP, result

import pymc_hyperelastic as ph

TREE = result(mu=[20.0])
NEO = {"energy": ph.NeoHookean(), **SHEEP}
ERRORS = {
    "layers with constants only": (
        lambda: ph.radius_at_pressure(
            TREE, 1.0, energy=[ph.Layer(ph.NeoHookean(), 1.0, mu=2.0)], inner_radius=7.0
        ),
        ValueError,
        "nothing is taken from the posterior",
    ),
    "no tube": (
        lambda: ph.wall_stress(TREE, 1.0, energy=ph.NeoHookean()),
        ValueError,
        "inner_radius=...",
    ),
    "no parameter": (
        lambda: ph.radius_at_pressure(result(nu=[1.0]), 1.0, **NEO),
        ValueError,
        r"lacks \['mu'\]",
    ),
    "many parameters": (
        lambda: ph.predict_pressure(result(mu=[[20.0, 30.0]]), 8.0, **NEO),
        ValueError,
        "'mu' of the posterior has the dimensions .*'mu_entry'.*select one",
    ),
    "short vector": (
        lambda: ph.predict_pressure(
            result(mu=[[2.0, 3.0]], alpha=[[2.0, 3.0]]), 8.0, energy=ph.OgdenSeries(3), **SHEEP
        ),
        TypeError,
        "'mu' of OgdenSeries.* has 3 entries",
    ),
    "scalar for a vector": (
        lambda: ph.predict_pressure(
            result(mu=[2.0], alpha=[2.0]), 8.0, energy=ph.OgdenSeries(3), **SHEEP
        ),
        ValueError,
        "its 3 entries",
    ),
    "many tubes": (
        lambda: ph.predict_pressure(
            result(mu=[20.0], inner_radius=[[7.0, 8.0]]),
            8.0,
            energy=ph.NeoHookean(),
            outer_radius=9.0,
        ),
        ValueError,
        "'inner_radius' of the posterior has the dimensions",
    ),
    "negative wall": (
        lambda: ph.predict_pressure(
            result(mu=[20.0], thickness=[-1.0]), 8.0, energy=ph.NeoHookean(), inner_radius=7.0
        ),
        ValueError,
        "thickness must be positive",
    ),
    "pressure in text": (
        lambda: ph.radius_at_pressure(TREE, "high", **NEO),
        ValueError,
        "pressure must be a list of pressures in kPa; got 'high'",
    ),
    "no pressure": (lambda: ph.wall_stress(TREE, [], **NEO), ValueError, "pressure must be"),
    "density": (lambda: ph.tube_properties(TREE, 1.0, density=0, **NEO), ValueError, "density.*0"),
    "place outside": (
        lambda: ph.wall_stress(TREE, 1.0, points=[0.5, 1.5], **NEO),
        ValueError,
        "points must be places in the wall, from 0 to 1",
    ),
    "radius": (lambda: ph.admissible(TREE, [0.0], **NEO), ValueError, "positive radii in mm"),
    "nowhere": (lambda: ph.admissible(TREE, **NEO), ValueError, "internal_radius=..."),
}


@pytest.mark.parametrize(("call", "error", "message"), ERRORS.values(), ids=ERRORS)
def test_impossible_prediction_is_refused(call, error, message):
    with pytest.raises(error, match=message):
        call()


def predict(tree=None, radius=(8.0, 9.0), **settings) -> xr.Dataset:
    return ph.predict_pressure(fitted()["C1"] if tree is None else tree, radius, **settings)


# Name of the mistake, a call that makes it, the error, and parts of its message.
BAD_INPUT = [
    (
        "result without a law",
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
        "prediction on a grid",
        lambda: predict(radius=np.ones((2, 2))),
        ValueError,
        ["internal_radius", "list"],
    ),
]


@pytest.fixture(scope="module")
def _fitted_before():
    """Fit the classes before `assert_refused` forbids sampling."""
    fitted()


@pytest.mark.usefixtures("_fitted_before")
@pytest.mark.parametrize(("call", "error", "fragments"), table(BAD_INPUT))
def test_prediction_of_a_wrong_result_is_refused(call, error, fragments):
    assert_refused(call, error, fragments)
