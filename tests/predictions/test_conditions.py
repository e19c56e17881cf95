"""Conditions: pressures, tube and fluid for which properties are computed."""

import numpy as np
import pytest
import xarray as xr
from tube_posteriors import INVERSE, SHEEP, fitted_tree, result

import pymc_hyperelastic as ph
from pymc_hyperelastic.predictions.conditions import as_conditions

NEO = {"energy": ph.NeoHookean()}
# The opening angle of a result may differ from 0.
RING, BY_AREA = ph.Tube(1.0, 1.5, radii_of="ring"), ph.Tube(1.0, wall_area=3.0)


def test_conditions_with_equal_numbers_are_equal():
    """Lists and arrays of pressures become tuples."""
    stated = ph.Conditions(np.array([1, 2]), pressure_range=[1, 2])
    assert stated == ph.Conditions([1.0, 2.0], pressure_range=(1.0, 2.0))
    assert stated.pressure == stated.pressure_range == (1.0, 2.0)
    assert ph.Conditions(3).pressure == 3.0
    assert ph.Conditions([3]).pressure == (3.0,)
    assert repr(ph.Conditions()) == "Conditions()"
    assert repr(ph.Conditions(3, density=1000.0)) == "Conditions(pressure=3.0, density=1000.0)"


def test_plain_pressures_become_conditions_in_kilopascal():
    at = ph.Conditions(3, pressure_unit="mmHg")
    assert as_conditions(at) is at
    assert as_conditions(None) == ph.Conditions()
    assert as_conditions([1, 2]) == ph.Conditions([1, 2])


@pytest.mark.parametrize(
    ("error", "call", "message"),
    [
        (ValueError, lambda: ph.Conditions("high"), "a list of pressures in kPa; got 'high'"),
        (ValueError, lambda: ph.Conditions([1.0, np.nan]), "pressure must be a list"),
        (ValueError, lambda: ph.Conditions("x", pressure_unit="psi"), "pressures in psi"),
        (ValueError, lambda: ph.Conditions(1.0, pressure_unit="mm"), "pressure_unit='mm' does not"),
        (ValueError, lambda: ph.Conditions(1.0, density=-1.0), "density must be a positive number"),
        (TypeError, lambda: ph.Conditions(1.0, tube=SHEEP), r"tube is \{.*expected ph.Tube\("),
        (TypeError, lambda: ph.Conditions(1.0, tube=ph.Tube("a")), "inner_radius is 'a'; expected"),
        (
            ValueError,
            lambda: ph.Conditions(1.0, tube=ph.Tube(thickness=1.0)),
            "neither inner_radius nor outer_radius",
        ),
        (ValueError, lambda: ph.Conditions(tube=ph.Tube(sd={"thickness": 1})), "leave sd out"),
        (ValueError, lambda: ph.Conditions(tube=RING), "radii depend on the opening angle; state"),
        (ValueError, lambda: ph.Conditions(tube=BY_AREA), "radii depend on the opening angle; sta"),
        (TypeError, lambda: as_conditions(ph.Tube(1.0)), r"Conditions\(pressure, tube=Tube\("),
        (TypeError, lambda: as_conditions({"pressure": 1.0}), "expected pressures in kPa, or ph.C"),
    ],
)
def test_impossible_conditions_are_refused(error, call, message):
    with pytest.raises(error, match=message):
        call()


@pytest.mark.parametrize("function", [ph.radius_at_pressure, ph.tube_properties, ph.wall_stress])
def test_conditions_without_pressure_are_refused_where_one_is_needed(function):
    with pytest.raises(ValueError, match="at states no pressure: give pressures in kPa, such as"):
        function(result(mu=[20.0]), ph.Conditions(tube=ph.Tube(**SHEEP)), **NEO)


def test_tube_by_thickness_or_wall_area_equals_tube_by_radii():
    tree = result(mu=[20.0, 30.0])
    expected = ph.predict_pressure(tree, [8.0], tube=ph.Tube(7.0, 9.0), **NEO)
    area = np.pi * (9.0**2 - 7.0**2)
    for tube in (
        ph.Tube(7.0, thickness=2.0),
        ph.Tube(outer_radius=9.0, wall_area=area, opening_angle=0.0),
    ):
        found = ph.predict_pressure(tree, [8.0], tube=tube, **NEO)
        xr.testing.assert_allclose(found, expected, rtol=INVERSE)


def test_tube_stated_as_a_ring_equals_its_opened_sector():
    tree = result(mu=[20.0])
    ring = ph.Tube(1.0, 1.5, opening_angle=0.3, convention="fung", radii_of="ring")
    sector = ph.Tube(**ring.geometry())
    assert sector.opening_angle == 0.6 and sector.inner_radius > 1.0
    found, expected = (ph.predict_pressure(tree, [1.1], tube=t, **NEO) for t in (ring, sector))
    xr.testing.assert_identical(found, expected)


def test_measures_missing_in_the_tube_are_taken_from_the_specimen():
    tree = fitted_tree(mu=[20.0])
    at = ph.Conditions(1.0, tube=ph.Tube(outer_radius=9.5))
    own = tree["constant_data"].to_dataset().isel(test=0)
    whole = ph.Tube(own["inner_radius"].item(), 9.5, axial_stretch=1.0, opening_angle=0.0)
    found, expected = (
        ph.radius_at_pressure(tree, each)["radius"] for each in (at, ph.Conditions(1.0, tube=whole))
    )
    xr.testing.assert_identical(found, expected)
