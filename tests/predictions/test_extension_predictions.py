"""Predictions at an axial stretch that varies, and from results of extension tests."""

import numpy as np
import oracles
import pytest
import xarray as xr
from problems import AS_WRITTEN
from scipy.optimize import brentq
from tube_posteriors import INVERSE, ROUNDING, ask, exact_points, fitted_to, result

import pymc_hyperelastic as ph

TUBE = {"inner_radius": 1.0, "outer_radius": 1.5}
STRETCHES = np.array([1.1, 1.25, 1.4])
MU = [18.0, 20.0, 23.0]
INFLATED = [0.5, 2.0, 3.5]


def tree() -> xr.DataTree:
    found = result(mu=MU)
    found.attrs["strain_energy"] = "NeoHookean"
    return found


def data() -> xr.Dataset:
    """Extension tests at held pressures, and an inflation test, of a tube of the middle modulus."""
    tests = {f"at {held:g} kPa": (held, STRETCHES) for held in (1.0, 3.0)}
    tests["inflation"] = INFLATED, 1.25
    frame = exact_points(ph.NeoHookean(), {"mu": 20.0}, tests, TUBE)
    return ph.inflation_data(frame, ph.Tube(**TUBE, axial_stretch="stretch"), check="ignore")


def each(function, points, stretches, **settings):
    """Return the results of single calls, one for each axial stretch."""
    found = [
        ask(function, tree(), point, TUBE | {"axial_stretch": stretch}, **settings)
        for point, stretch in zip(points, stretches, strict=True)
    ]
    return {
        name: np.concatenate([one[name].values for one in found], axis=2)
        for name in found[0].data_vars
    }


RADII, PRESSURES = [1.1, 1.2, 1.3], [1.0, 2.0, 3.0]
THREE = {**TUBE, "axial_stretch": STRETCHES}


@pytest.mark.parametrize(
    ("function", "points"),
    [
        (ph.predict_pressure, RADII),
        (ph.predict_axial_force, RADII),
        (ph.radius_at_pressure, PRESSURES),
        (ph.tube_properties, PRESSURES),
        (ph.wall_stress, PRESSURES),
    ],
)
def test_one_stretch_for_each_point_equals_single_calls(function, points):
    found = ask(function, tree(), points, THREE)
    assert found["axial_stretch"].dims == (found["axial_stretch"].dims[0],)
    np.testing.assert_array_equal(found["axial_stretch"], STRETCHES)
    assert found["axial_stretch"].attrs["units"] == "1"
    for name, expected in each(function, points, STRETCHES).items():
        np.testing.assert_allclose(found[name].values, expected, rtol=ROUNDING, err_msg=name)


def test_force_at_a_pressure_is_the_force_at_its_radius():
    found = ask(ph.tube_properties, tree(), 2.0, THREE)["axial_force"].values[0]
    for force, mu in zip(found, MU, strict=True):

        def excess(a, stretch, mu=mu):
            return oracles.neo_hookean_pressure(mu, a, *TUBE.values(), stretch) - 2.0

        radius = [brentq(excess, 0.6, 1.9, args=(stretch,), xtol=1e-13) for stretch in STRETCHES]
        tube = ph.Tube(**TUBE, axial_stretch=STRETCHES)
        expected = ph.axial_force(ph.NeoHookean(), radius, tube, mu=mu).eval(mode=AS_WRITTEN)
        np.testing.assert_allclose(force, expected, rtol=INVERSE)


@pytest.mark.parametrize(
    ("function", "at", "tube", "message"),
    [
        (ph.predict_pressure, [1.1, 1.2], THREE, "has 3 values, and there are 2 radii or press"),
        (ph.predict_pressure, 1.1, THREE | {"axial_stretch": [1.2, -1.0]}, "must be positive"),
        (ph.predict_pressure, 1.1, THREE | {"axial_stretch": ["long"]}, "a list of axial stretch"),
        (ph.predict_pressure, 1.1, TUBE | {"inner_radius": [1.0, 1.1]}, r"\[1.0, 1.1\]; .*number"),
    ],
)
def test_inconsistent_stretches_and_pressures_are_refused(function, at, tube, message):
    with pytest.raises((TypeError, ValueError), match=message):
        ask(function, tree(), at, tube)


# --- results of extension tests ------------------------------------------------------------------


def fitted() -> xr.DataTree:
    """Return a fitted result with draws around the true modulus."""
    return fitted_to(data(), "NeoHookean", tree())


def at_stretches(function, points, stretches) -> xr.Dataset:
    return ask(function, fitted(), points, {"axial_stretch": stretches})


def test_points_between_measured_stretches_are_not_extrapolated():
    stretches = [1.1, 1.2, 1.33, 1.4]
    found = at_stretches(ph.radius_at_pressure, [1.0, 2.0, 2.7, 3.0], stretches)
    assert not found["extrapolated"].any()
    curve = at_stretches(ph.predict_pressure, 1.1, [1.15, 1.35])
    assert not curve["extrapolated"].any()
    # A radius that was measured at one end of an extension test was not measured at the other.
    widest = ph.select(data(), experiment="at 3 kPa")["radius"].values[0]
    with pytest.warns(UserWarning, match=r"1 of 2 points.*hoop stretch"):
        curve = at_stretches(ph.predict_pressure, widest, STRETCHES[[0, 2]])
    assert curve["extrapolated"].values.tolist() == [False, True]


def test_points_beyond_measured_stretches_are_extrapolated_with_a_warning():
    with pytest.warns(UserWarning, match=r"2 of 3 points.*axial stretch 1.05 to 1.5, measured"):
        found = at_stretches(ph.predict_pressure, 1.1, [1.05, 1.2, 1.5])
    assert found["extrapolated"].values.tolist() == [True, False, True]
    with pytest.warns(UserWarning, match=r"1 of 2 points.*pressure 3.8 kPa"):
        found = at_stretches(ph.radius_at_pressure, [2.0, 3.8], [1.2, 1.3])
    assert found["extrapolated"].values.tolist() == [False, True]
    # At this stretch an inflation test reached the pressure.
    at_stretches(ph.radius_at_pressure, 3.5, 1.25)
    with pytest.warns(UserWarning, match="axial stretch 1.5, measured 1.1 to 1.4"):
        at_stretches(ph.radius_at_pressure, 2.0, 1.5)
