"""Impossible predictions: each error names the problem and the expected input."""

import numpy as np
import pytest
import xarray as xr
from bad_input import plain_model, two_tubes
from tube_posteriors import SHEEP, fitted_to, fitted_tree, result

import pymc_hyperelastic as ph

TREE = result(mu=[20.0])
TUBE = ph.Tube(**SHEEP)
NEO = {"energy": ph.NeoHookean(), "tube": TUBE}
THREE_TERMS = {"energy": ph.OgdenSeries(3), "tube": TUBE}
CONSTANTS = [ph.Layer(ph.NeoHookean(), 1.0, mu=2.0)]
OGDEN = {"mu": [30.0, 31.0], "alpha": [7.0, 7.1]}


def classes() -> xr.DataTree:
    """Return a fitted class of one tube, and one of several."""
    other = fitted_to(two_tubes(), "Ogden", result(**OGDEN))
    return xr.DataTree.from_dict({"C1": fitted_tree("Ogden", **OGDEN), "C2": other})


def predict(tree=None, radius=8.0, **settings) -> xr.Dataset:
    return ph.predict_pressure(classes()["C1"] if tree is None else tree, radius, **settings)


def in_tube(inner=7.0, **variables) -> xr.Dataset:
    """Predict a wall whose thickness the posterior holds, or does not."""
    tree = result(mu=[20.0], **variables)
    return predict(tree, energy=ph.NeoHookean(), tube=ph.Tube(inner_radius=inner))


def conditions(pressure, **settings) -> ph.Conditions:
    return ph.Conditions(pressure, tube=TUBE, **settings)


VALUE_ERRORS = [
    # The material.
    (lambda: predict(TREE, energy=CONSTANTS, tube=ph.Tube(7.0)), "taken from the posterior"),
    (lambda: predict(xr.DataTree.from_dict({"posterior": xr.Dataset()})), "energy=ph.Ogden()"),
    (lambda: predict(classes()), r"no posterior.*\['C1', 'C2'\].*classes\['C1'\]"),
    (lambda: predict(energy=ph.CriscioneType()), r"\['a', 'b'\].*CriscioneType"),
    (lambda: predict(result(nu=[1.0]), **NEO), r"lacks \['mu'\]"),
    (lambda: predict(result(mu=[[20.0, 30.0]]), **NEO), "dimensions .*'mu_entry'.*select one"),
    (lambda: predict(result(mu=[2.0], alpha=[2.0]), **THREE_TERMS), "its 3 entries"),
    # The tube.
    (lambda: ph.wall_stress(TREE, 1.0, energy=ph.NeoHookean()), "inner_radius=..."),
    (lambda: in_tube(), "outer_radius"),
    (lambda: in_tube(thickness=[[1.0, 2.0]]), "'thickness' of the posterior has the dimensions"),
    (lambda: in_tube(thickness=[-1.0]), "thickness must be positive"),
    (lambda: predict(tube=ph.Tube(outer_radius=6.0)), "outer_radius must exceed inner_radius.*6.0"),
    (
        lambda: predict(classes()["C2"]),
        r"do not have one inner_radius.*such as tube=ph\.Tube\(.*\), in ph\.Conditions if",
    ),
    # Where.
    (lambda: predict(radius=[8.0, 0.0]), "internal_radius.*positive.*0."),
    (lambda: predict(radius=np.ones((2, 2))), "internal_radius.*list"),
    (lambda: ph.is_admissible(TREE, [0.0], **NEO), "positive radii in mm"),
    (lambda: ph.is_admissible(TREE, **NEO), "internal_radius=..."),
    (lambda: ph.radius_at_pressure(TREE, "high"), "a list of pressures in kPa; got 'high'"),
    (lambda: ph.wall_stress(TREE, []), "pressure must be"),
    (
        lambda: ph.wall_stress(TREE, conditions(1.0), [0.5, 1.5], energy=ph.NeoHookean()),
        "places in the wall, from 0 to",
    ),
    (lambda: conditions(1.0, density=0), "density.*0"),
]
TYPE_ERRORS = [
    (lambda: predict(plain_model()), "ph.sample_smc.*Model"),
    (lambda: predict(energy=ph.Ogden), r"ph.Ogden\(\).*call the class"),
    (lambda: predict(tube=ph.Tube("7 mm")), "inner_radius is '7 mm'.*number"),
    (
        lambda: predict(result(mu=[[2.0, 3.0]], alpha=[[2.0, 3.0]]), **THREE_TERMS),
        "'mu' of OgdenSeries.*; expected 3 entries",
    ),
]


@pytest.mark.parametrize(
    ("error", "call", "message"),
    [(ValueError, *row) for row in VALUE_ERRORS] + [(TypeError, *row) for row in TYPE_ERRORS],
)
def test_impossible_prediction_is_refused(error, call, message):
    with pytest.raises(error, match=message):
        call()
