"""Quantities between two pressures: in vivo axial stretch and change of stored energy."""

import numpy as np
import pytest
import xarray as xr
from tube_posteriors import SHEEP, exact_points, fitted_to, result

import pymc_hyperelastic as ph

pytestmark = pytest.mark.compiled  # predictions are compiled for each law

RANGE = (80.0, 120.0)  # mmHg
IN_MMHG = {"pressure_unit": "mmHg", "pressure_range": RANGE}
# Relative error of the search.
FOUND = 1e-8

# About a mouse's ascending aorta: its wall, and a law without kinks, which is quickly compiled.
WALL = {"inner_radius": 0.442, "outer_radius": 0.548}
FUNG = {"c": 20.0, "a1": 0.8, "a2": 0.6, "a4": 0.1}
LAW = ph.FungOrthotropic()


def aortas(**changes):
    """Return draws of the law; some parameters differ between draws."""
    count = max((len(v) for v in changes.values()), default=1)
    return result(**{n: changes.get(n, [x] * count) for n, x in FUNG.items()})


def rises_of_force(tree, stretches):
    """Reduced axial force at the higher pressure less that at the lower one, of one draw."""
    tube = ph.Tube(axial_stretch=np.repeat(stretches, 2))
    at = ph.Conditions(np.tile(RANGE, len(stretches)) * ph.mmHg, tube=tube)
    force = ph.tube_properties(tree, at, energy=LAW)["axial_force"].values[0, 0]
    return force[1::2] - force[::2]


def test_axial_force_is_equal_at_both_pressures_at_the_in_vivo_stretch():
    tree = aortas(c=[15.0, 30.0], a2=[0.5, 1.0])
    walls = result(inner_radius=[0.44, 0.5], thickness=[0.2, 0.1])["posterior"].to_dataset()
    tree["posterior"] = xr.DataTree(tree["posterior"].to_dataset().merge(walls))
    found = ph.tube_properties(tree, ph.Conditions(100.0, **IN_MMHG), energy=LAW)
    stretch = found["in_vivo_axial_stretch"]
    assert stretch.dims == ("chain", "draw")
    assert stretch.attrs["draws_without"] == 0
    for i, value in enumerate(stretch.values[0]):
        # The rise of the force changes its sign there for the first time.
        stretches = [*np.linspace(0.8, 0.98 * value, 6), value, 1.02 * value]
        *before, at, above = rises_of_force(tree.isel(draw=[i]), stretches)
        assert max(before) < 0 < above
        assert abs(at) < 1e-6 * (above - before[-1])
    for name in ("stored_energy_change", "in_vivo_axial_stretch"):
        ends = [found[name].attrs[n] for n in ("diastolic_pressure", "systolic_pressure")]
        assert (*ends, found[name].attrs["pressure_unit"]) == (*RANGE, "mmHg")
    alone = ph.tube_properties(tree, ph.Conditions(**IN_MMHG), energy=LAW)
    xr.testing.assert_identical(alone, found[list(alone)])


def test_law_without_axial_force_has_no_in_vivo_stretch():

    class Criscione(ph.StrainEnergy):
        """The law of the package, with derivatives that round to forces of either sign."""

        parameters = ph.CriscioneType.parameters

        def energy(self, radial, hoop, axial, *, a, b):
            power = (1 / (radial**2 * axial)) ** b
            return a / 2 * (power + 1 / power)

    tree = result(a=[3.0] * 20, b=np.linspace(2.0, 6.0, 20))
    at = ph.Conditions(1.0, pressure_range=(1.0, 2.0), tube=ph.Tube(**SHEEP))
    with pytest.warns(UserWarning, match="20 have no in vivo"):
        found = ph.tube_properties(tree, at, energy=Criscione())
    assert np.isnan(found["in_vivo_axial_stretch"]).all()


def test_draws_without_in_vivo_stretch_are_nan_and_counted():
    # A wall that stiffens only in the hoop direction has no stretch of equal forces.
    at = ph.Conditions(9.0, pressure_range=(8.0, 12.0), tube=ph.Tube(**WALL))
    said = r"of 2 draws 1 have no in vivo axial stretch from 0.8 to 2.5, .* 8 and 12 kPa"
    with pytest.warns(UserWarning, match=said):
        found = ph.tube_properties(aortas(a2=[0.6, 1e-6], a4=[0.1, 0.0]), at, energy=LAW)
    alone = ph.tube_properties(aortas(), at, energy=LAW)["in_vivo_axial_stretch"]
    stretch = found["in_vivo_axial_stretch"]
    np.testing.assert_allclose(stretch[0], [alone.item(), np.nan], rtol=FOUND)
    assert stretch.attrs["draws_without"] == 1
    assert np.isfinite(found["stored_energy_change"]).all()


def data_of(stretches=(1.4, 1.7, 2.0), *, with_force=True):
    """Curves of an aorta between 60 and 160 mmHg at axial stretches: the law's own, exactly."""
    pressure = np.linspace(60, 160, 11) * ph.mmHg
    tests = {i: (pressure, stretch) for i, stretch in enumerate(stretches, start=1)}
    frame = exact_points(ph.FungOrthotropic(), FUNG, tests, WALL)
    frame = frame if with_force else frame.drop(columns="axial_force")
    return ph.inflation_data(frame, ph.Tube(**WALL, axial_stretch="stretch"))


def extrapolations(data, axial_stretch, **settings):
    """Predict the properties of two draws of a fit to these data."""
    tree = fitted_to(data, "FungOrthotropic", aortas(c=[21.0, 22.0]))
    tube = ph.Tube(axial_stretch=axial_stretch)
    return ph.tube_properties(tree, ph.Conditions(100.0, tube=tube, **IN_MMHG | settings))


def test_in_vivo_stretch_beyond_the_data_is_extrapolated():
    with pytest.warns(UserWarning, match=r"in vivo axial stretch is ext.* 1\.\d+, measured 1.2 to"):
        found = extrapolations(data_of((1.2, 1.4)), axial_stretch=1.4)
    assert found.coords["in_vivo_extrapolated"].item() is True
    assert found.coords["range_extrapolated"].item() is False
    with pytest.warns(UserWarning, match="rests on the strain energy alone: .* no axial force"):
        found = extrapolations(data_of(with_force=False), axial_stretch=1.7)
    assert "no axial force" in found["in_vivo_axial_stretch"].attrs["comment"]
    with pytest.warns(UserWarning, match="extrapolated"):
        found = extrapolations(data_of(), axial_stretch=1.7, pressure_range=(80, 200))
    assert found.coords["range_extrapolated"].item() is True
    assert not found["extrapolated"].any()


@pytest.mark.parametrize("pressures", [100.0, [80.0, 80.0], [-5.0, 80.0]])
def test_impossible_pressure_range_is_refused(pressures):
    with pytest.raises(ValueError, match="a diastolic and a higher systolic pressure in mmHg; got"):
        ph.Conditions(100.0, pressure_range=pressures, pressure_unit="mmHg")
