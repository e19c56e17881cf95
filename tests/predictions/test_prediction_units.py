"""Predictions take pressures and radii in any unit, and answer in kPa and mm."""

import pytest
import xarray as xr
from tube_posteriors import INVERSE, SHEEP, fitted_tree, result

import pymc_hyperelastic as ph

AT_PRESSURES = (ph.radius_at_pressure, ph.tube_properties, ph.pulse_wave_velocity, ph.wall_stress)
AT_RADII = (ph.predict_pressure, ph.predict_axial_force, ph.is_admissible)


@pytest.mark.parametrize("function", AT_PRESSURES + AT_RADII)
def test_pressures_in_mmhg_and_radii_in_micrometres(function):
    """Radii asked for have the unit of those of the tube."""
    tree, neo = result(mu=[20.0, 30.0]), {"energy": ph.NeoHookean()}
    in_um = neo | {"inner_radius": 7000.0, "outer_radius": 9000.0, "radius_unit": "um"}
    if function in AT_RADII:
        expected = function(tree, [7.5, 8.0], **neo, **SHEEP)
        found = function(tree, [7500.0, 8000.0], **in_um)
    else:
        expected = function(tree, [1.0, 2.0], **neo, **SHEEP)
        found = function(tree, [1.0 / ph.mmHg, 2.0 / ph.mmHg], pressure_unit="mmHg", **in_um)
        assert found["pressure"].attrs["units"] == "kPa"
    xr.testing.assert_allclose(found, expected, rtol=INVERSE)


def test_radius_unit_does_not_apply_to_stored_geometry():
    tree = fitted_tree(mu=[20.0], thickness=[2.0])
    found = ph.predict_pressure(tree, [8000.0], radius_unit="um")
    xr.testing.assert_allclose(found, ph.predict_pressure(tree, [8.0]), rtol=INVERSE)


def test_pressure_probably_given_in_mmhg_is_a_warning():
    tree = fitted_tree("Ogden", mu=[30.0], alpha=[7.0])
    with pytest.warns(UserWarning, match=r"100 kPa \(750.1 mmHg\).*pressure_unit='mmHg'"):
        ph.tube_properties(tree, 100, check="ignore")
    assert not ph.tube_properties(tree, 100, pressure_unit="mmHg")["extrapolated"].any()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda tree: ph.tube_properties(tree, 1.0, pressure_unit="mm"), "pressure_unit='mm'"),
        (lambda tree: ph.predict_pressure(tree, 8.0, radius_unit="mmHg"), "radius_unit='mmHg'"),
        (lambda tree: ph.wall_stress(tree, "x", pressure_unit="psi"), "pressures in psi"),
    ],
)
def test_wrong_units_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call(fitted_tree(mu=[20.0]))
