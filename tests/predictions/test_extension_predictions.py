"""Predictions at an axial stretch that varies, and from results of extension tests."""

from functools import cache

import numpy as np
import pandas as pd
import pytensor
import pytensor.tensor as pt
import pytest
import xarray as xr
from problems import AS_WRITTEN
from scipy.optimize import brentq
from tube_posteriors import result

import pymc_hyperelastic as ph

TUBE = {"inner_radius": 1.0, "outer_radius": 1.5}
STRETCHES = np.array([1.1, 1.25, 1.4])
# The same sums, of arrays of another length; Newton's method has converged to rounding.
ROUNDING = 1e-12
MU = [18.0, 20.0, 23.0]
INFLATED = [0.5, 2.0, 3.5]


def tree() -> xr.DataTree:
    found = result(mu=MU)
    found.attrs["strain_energy"] = "NeoHookean"
    return found


def data(pressures=(1.0, 3.0)) -> xr.Dataset:
    """Extension tests at held pressures, and an inflation test, of a tube of the middle modulus."""
    tests = []
    for held in pressures:
        radius = [radius_of(held, stretch) for stretch in STRETCHES]
        test = pd.DataFrame({"radius": radius, "pressure": held, "stretch": STRETCHES})
        tests.append(test.assign(experiment=f"at {held:g} kPa"))
    radius = [radius_of(p, 1.25) for p in INFLATED]
    inflation = {"radius": radius, "pressure": INFLATED, "stretch": 1.25}
    tests.append(pd.DataFrame(inflation).assign(experiment="inflation"))
    frame = pd.concat(tests, ignore_index=True).assign(specimen="S")
    frame["axial_force"] = [force_of(row.radius, row.stretch) for row in frame.itertuples()]
    return ph.inflation_data(frame, **TUBE, axial_stretch="stretch", check="ignore")


@cache
def compiled(quantity):
    inputs = radius, stretch, mu = pt.dscalars(3)
    law = quantity(ph.NeoHookean(), radius, **TUBE, axial_stretch=stretch, mu=mu)
    return pytensor.function(inputs, law, mode=AS_WRITTEN)


def pressure_of(radius, stretch, mu=20.0):
    return float(compiled(ph.inflation_pressure)(radius, stretch, mu))


def force_of(radius, stretch, mu=20.0):
    return float(compiled(ph.axial_force)(radius, stretch, mu))


def radius_of(pressure, stretch, mu=20.0):
    return brentq(lambda a: pressure_of(a, stretch, mu) - pressure, 0.6, 1.9, xtol=1e-13)


def each(function, points, stretches, **settings):
    """Return the results of single calls, one for each axial stretch."""
    found = [
        function(tree(), point, **TUBE, axial_stretch=stretch, **settings)
        for point, stretch in zip(points, stretches, strict=True)
    ]
    return {
        name: np.concatenate([one[name].values for one in found], axis=2)
        for name in found[0].data_vars
    }


RADII, PRESSURES = [1.1, 1.2, 1.3], [1.0, 2.0, 3.0]


def force_at(tree, pressure, **settings):
    return ph.predict_axial_force(tree, pressure=pressure, **settings)


@pytest.mark.parametrize(
    ("function", "points"),
    [
        (ph.predict_pressure, RADII),
        (ph.predict_axial_force, RADII),
        (ph.radius_at_pressure, PRESSURES),
        (force_at, PRESSURES),
        (ph.tube_properties, PRESSURES),
        (ph.wall_stress, PRESSURES),
    ],
)
def test_one_stretch_per_point_equals_single_calls(function, points):
    found = function(tree(), points, **TUBE, axial_stretch=STRETCHES)
    assert found["axial_stretch"].dims == (found["axial_stretch"].dims[0],)
    np.testing.assert_array_equal(found["axial_stretch"], STRETCHES)
    assert found["axial_stretch"].attrs["units"] == "1"
    for name, expected in each(function, points, STRETCHES).items():
        np.testing.assert_allclose(found[name].values, expected, rtol=ROUNDING, err_msg=name)


@pytest.mark.parametrize("function", [ph.radius_at_pressure, force_at])
def test_scalar_pressure_applies_to_all_stretches(function):
    found = function(tree(), 2.0, **TUBE, axial_stretch=STRETCHES)
    for name, expected in each(function, [2.0] * 3, STRETCHES).items():
        np.testing.assert_allclose(found[name].values, expected, rtol=ROUNDING, err_msg=name)
    np.testing.assert_array_equal(found["pressure"], 2.0)


def test_force_at_a_pressure_is_the_force_at_its_radius():
    found = force_at(tree(), 2.0, **TUBE, axial_stretch=STRETCHES)
    expected = [
        [force_of(radius_of(2.0, stretch, mu), stretch, mu) for stretch in STRETCHES] for mu in MU
    ]
    np.testing.assert_allclose(found["axial_force"].values[0], expected, rtol=1e-10)


@pytest.mark.parametrize(
    ("call", "error", "expected"),
    [
        (
            lambda: ph.predict_pressure(tree(), [1.1, 1.2], **TUBE, axial_stretch=STRETCHES),
            ValueError,
            "axial_stretch has 3 values, and there are 2 radii or pressures",
        ),
        (
            lambda: ph.tube_properties(tree(), 2.0, **TUBE, axial_stretch=STRETCHES),
            ValueError,
            "axial_stretch has 3 values, and there are 1 radii",
        ),
        (
            lambda: ph.predict_pressure(tree(), 1.1, **TUBE, axial_stretch=[1.2, -1.0]),
            ValueError,
            "axial_stretch must be positive",
        ),
        (
            lambda: ph.predict_pressure(tree(), 1.1, **TUBE, axial_stretch=["long"]),
            ValueError,
            "axial_stretch must be a list of axial stretches",
        ),
        (
            lambda: ph.predict_pressure(tree(), 1.1, inner_radius=[1.0, 1.1], outer_radius=1.5),
            TypeError,
            r"inner_radius is \[1.0, 1.1\]; expected a number",
        ),
        (lambda: ph.predict_axial_force(tree(), **TUBE), TypeError, "give internal_radius, or"),
        (
            lambda: ph.predict_axial_force(tree(), 1.1, pressure=1.0, **TUBE),
            TypeError,
            "give internal_radius, or pressure",
        ),
    ],
)
def test_inconsistent_stretches_and_pressures_are_refused(call, error, expected):
    with pytest.raises(error, match=expected):
        call()


# --- results of extension tests ------------------------------------------------------------------


def fitted(points=None) -> xr.DataTree:
    """Return a fitted result with draws around the true modulus."""
    found = tree()
    found["constant_data"] = xr.DataTree(data() if points is None else points)
    return found


def test_varying_stretch_of_the_data_must_be_given():
    said = r"do not have one axial_stretch \(1\.1, .*\): say which, such as axial_stretch=1\.1"
    with pytest.raises(ValueError, match=said):
        ph.predict_pressure(fitted(), 1.1)


def test_nothing_is_extrapolated_between_measured_stretches():
    stretches = [1.1, 1.2, 1.33, 1.4]
    found = ph.radius_at_pressure(fitted(), [1.0, 2.0, 2.7, 3.0], axial_stretch=stretches)
    assert not found["extrapolated"].any()
    curve = ph.predict_pressure(fitted(), 1.1, axial_stretch=[1.15, 1.35])
    assert not curve["extrapolated"].any()
    # A radius that was measured at one end of an extension test was not measured at the other.
    widest = ph.select(data(), experiment="at 3 kPa")["radius"].values[0]
    with pytest.warns(UserWarning, match=r"1 of 2 points.*hoop stretch"):
        curve = ph.predict_pressure(fitted(), widest, axial_stretch=STRETCHES[[0, 2]])
    assert curve["extrapolated"].values.tolist() == [False, True]


def test_warning_names_points_beyond_measured_stretches():
    with pytest.warns(UserWarning, match=r"2 of 3 points.*axial stretch 1.05 to 1.5, measured"):
        found = ph.predict_pressure(fitted(), 1.1, axial_stretch=[1.05, 1.2, 1.5])
    assert found["extrapolated"].values.tolist() == [True, False, True]
    with pytest.warns(UserWarning, match=r"1 of 2 points.*pressure 3.8 kPa"):
        found = ph.radius_at_pressure(fitted(), [2.0, 3.8], axial_stretch=[1.2, 1.3])
    assert found["extrapolated"].values.tolist() == [False, True]
    # An inflation test at this stretch alone went as far.
    ph.radius_at_pressure(fitted(), 3.5, axial_stretch=1.25)
    with pytest.warns(UserWarning, match="axial stretch 1.5, measured 1.1 to 1.4"):
        ph.radius_at_pressure(fitted(), 2.0, axial_stretch=1.5)
