"""Predictions take pressures in any unit, and answer in kPa and mm."""

import pytest
import xarray as xr
from tube_posteriors import AT_PRESSURES, INVERSE, SHEEP, fitted_tree, result

import pymc_hyperelastic as ph


@pytest.mark.parametrize("function", AT_PRESSURES)
def test_pressures_in_mmhg_give_the_same_prediction_as_in_kpa(function):
    """The pressure coordinate keeps the given unit; all other numbers are in internal units."""
    tree, neo, tube = result(mu=[20.0, 30.0]), {"energy": ph.NeoHookean()}, ph.Tube(**SHEEP)
    expected = function(tree, ph.Conditions([1.0, 2.0], tube=tube), **neo)
    assert expected["pressure"].attrs["units"] == "kPa"
    in_mmhg = [1.0 / ph.mmHg, 2.0 / ph.mmHg]
    found = function(tree, ph.Conditions(in_mmhg, pressure_unit="mmHg", tube=tube), **neo)
    assert found["pressure"].attrs["units"] == "mmHg"
    assert found["pressure"].values.tolist() == in_mmhg
    found = found.assign_coords(pressure=expected["pressure"])
    xr.testing.assert_allclose(found, expected, rtol=INVERSE)


def test_extrapolation_warning_suggests_mmhg_for_a_high_pressure():
    tree = fitted_tree("Ogden", mu=[30.0], alpha=[7.0])
    with pytest.warns(UserWarning, match=r"100 kPa \(750.1 mmHg\).*pressure_unit='mmHg'"):
        ph.tube_properties(tree, 100, check="ignore")
    in_mmhg = ph.Conditions(100, pressure_unit="mmHg")
    assert not ph.tube_properties(tree, in_mmhg)["extrapolated"].any()
