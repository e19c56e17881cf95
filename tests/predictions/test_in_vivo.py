"""Quantities between two pressures: in vivo axial stretch and change of stored energy."""

import warnings

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from scipy.optimize import brentq
from tube_posteriors import SHEEP, one_draw, result

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.natural_scale import NaturalScale

pytestmark = pytest.mark.compiled  # predictions are compiled for each law

RANGE = (80.0, 120.0)  # mmHg
IN_MMHG = {"pressure_unit": "mmHg", "pressure_range": RANGE}
# Relative error of the search.
FOUND = 1e-8
# Thin walls differ from membranes by their thickness over the radius.
THIN = 1e-3

# About a mouse's ascending aorta: its wall, and a law without kinks, which is quickly compiled.
WALL = {"inner_radius": 0.442, "outer_radius": 0.548}
FUNG = {"c": 20.0, "a1": 0.8, "a2": 0.6, "a4": 0.1}
LAW = {"energy": ph.FungOrthotropic(), **WALL}


def aortas(**changes):
    """Draws of the law, of which some parameters are by draw."""
    count = max((len(v) for v in changes.values()), default=1)
    return result(**{n: changes.get(n, [x] * count) for n, x in FUNG.items()})


def rise_of_force(tree, stretch):
    """Reduced axial force at the higher pressure less that at the lower one, of one draw."""
    at = LAW | {"axial_stretch": stretch}
    a = ph.radius_at_pressure(tree, RANGE, pressure_unit="mmHg", **at)["radius"].values[0, 0]
    force = ph.predict_axial_force(tree, a, **at)["axial_force"].values[0, 0]
    return force[1] - force[0]


def test_force_is_equal_at_both_pressures_at_the_in_vivo_stretch():
    tree = aortas(c=[15.0, 20.0, 30.0], a2=[0.5, 0.6, 1.0])
    found = ph.tube_properties(tree, 100.0, **LAW, **IN_MMHG)
    stretch = found["in_vivo_axial_stretch"]
    assert stretch.dims == ("chain", "draw")
    assert stretch.attrs["draws_without"] == 0
    for i, value in enumerate(stretch.values[0]):
        of_one = tree.isel(draw=[i])
        below, at, above = (rise_of_force(of_one, x * value) for x in (0.98, 1.0, 1.02))
        assert below < 0 < above
        assert abs(at) < 1e-6 * (above - below)
        # And nowhere before.
        assert all(rise_of_force(of_one, x) < 0 for x in np.linspace(0.8, 0.98 * value, 6))


# A mouse's ascending aorta, by a fit to its membrane: repository yale-humphrey-lab/gr-regression,
# single-group/C1041G_ATA_allspec.csv, specimen 2, with c1 = 2 k1 and the angle from the axis.
AORTA = {
    "c": 21.74032326,
    "k1_axial": 5.497466325 / 2,
    "k2_axial": 0.133387834,
    "k1_hoop": 2.47e-5 / 2,
    "k2_hoop": 4.180731332,
    "k1_diagonal": 7.93379463 / 2,
    "k2_diagonal": 0.569275043,
    "beta": 90 - 52.66162805,
}


def membrane(stretch, pressure, radius, thickness):
    """Hoop stretch and reduced force of the aorta as a membrane, from its printed stresses."""

    def stresses(hoop):
        radial = 1 / (hoop * stretch)
        families = [("hoop", 0.0, 1), ("axial", 90.0, 1), ("diagonal", AORTA["beta"], 2)]
        around, along = (AORTA["c"] * (x**2 - radial**2) for x in (hoop, stretch))
        for name, angle, number in families:
            cosine = np.cos(np.deg2rad(angle)) ** 2
            strain = max(cosine * hoop**2 + (1 - cosine) * stretch**2 - 1, 0)
            k1, k2 = AORTA[f"k1_{name}"], AORTA[f"k2_{name}"]
            of_family = number * 2 * k1 * strain * np.exp(k2 * strain**2)
            around += of_family * cosine * hoop**2
            along += of_family * (1 - cosine) * stretch**2
        return around, along

    def excess(hoop):
        h = thickness / (hoop * stretch)
        return stresses(hoop)[0] * h - pressure * hoop * radius

    hoop = brentq(excess, 0.8, 2.2, xtol=1e-13)
    a, h = hoop * radius, thickness / (hoop * stretch)
    return 2 * np.pi * a * h * stresses(hoop)[1] - np.pi * a**2 * pressure


def test_in_vivo_stretch_of_a_thin_wall_is_that_of_a_membrane():
    radius, thickness = 0.495, 0.53e-3
    low, high = (5e-3 * p * ph.mmHg for p in RANGE)  # as thin a wall carries less

    def rise(stretch):
        force = [membrane(stretch, pressure, radius, thickness) for pressure in (low, high)]
        return force[1] - force[0]

    expected = brentq(rise, 1.2, 2.2, xtol=1e-12)
    settings = {"inner_radius": radius, "outer_radius": radius + thickness}
    settings |= {"pressure_range": (low, high), "energy": ph.FourFiber()}
    found = ph.tube_properties(one_draw(AORTA), low, **settings)["in_vivo_axial_stretch"].item()
    np.testing.assert_allclose(found, expected, rtol=THIN)
    assert 1.6 < expected < 1.8  # the source states 1.68


def test_stored_energy_change_is_the_difference_at_both_pressures():
    settings = LAW | {"pressure_unit": "mmHg", "axial_stretch": 1.6}
    found = ph.tube_properties(aortas(c=[15.0, 30.0]), [*RANGE], pressure_range=RANGE, **settings)
    np.testing.assert_allclose(
        found["stored_energy_change"], found["stored_energy"].diff("pressure")[..., 0], rtol=1e-9
    )
    for name in ("stored_energy_change", "in_vivo_axial_stretch"):
        ends = [found[name].attrs[n] for n in ("diastolic_pressure", "systolic_pressure")]
        np.testing.assert_allclose(ends, np.array(RANGE) * ph.mmHg)


# --- laws without ------------------------------------------------------------------------------


def test_neo_hookean_tube_has_no_in_vivo_stretch():
    """Its force falls at every length: ``2 λz² − λθ² − λr²`` does when it is inflated."""
    with pytest.warns(UserWarning, match=r"of 2 draws 2 have no .* 0.8 to 2.5, .* 1 and 2 kPa"):
        found = ph.tube_properties(
            result(mu=[20.0, 30.0]),
            1.0,
            energy=ph.NeoHookean(),
            pressure_range=(1.0, 2.0),
            **SHEEP,
        )
    assert np.isnan(found["in_vivo_axial_stretch"]).all()
    assert found["in_vivo_axial_stretch"].attrs["draws_without"] == 2
    assert np.isfinite(found["stored_energy_change"]).all()


def test_law_without_axial_force_has_no_in_vivo_stretch():

    class Criscione(ph.StrainEnergy):
        """The same law, whose derivatives round differently."""

        parameters = ph.CriscioneType.parameters

        def energy(self, radial, hoop, axial, *, a, b):
            power = (1 / (radial**2 * axial)) ** b
            return a / 2 * (power + 1 / power)

    tree = result(a=[3.0] * 40, b=np.linspace(2.0, 6.0, 40))
    for law in (ph.CriscioneType(), Criscione()):
        with pytest.warns(UserWarning, match="40 have no in vivo"):
            found = ph.tube_properties(tree, 1.0, energy=law, pressure_range=(1.0, 2.0), **SHEEP)
        assert np.isnan(found["in_vivo_axial_stretch"]).all()


def test_draws_without_in_vivo_stretch_are_nan_and_counted():
    # A wall that stiffens around, and not along, is pushed all the more the longer it is.
    settings = LAW | {"pressure_range": (8.0, 12.0)}
    with pytest.warns(UserWarning, match="of 2 draws 1 have no in vivo axial stretch"):
        found = ph.tube_properties(aortas(a2=[0.6, 1e-6], a4=[0.1, 0.0]), 9.0, **settings)
    alone = ph.tube_properties(aortas(), 9.0, **settings)["in_vivo_axial_stretch"]
    found = found["in_vivo_axial_stretch"]
    np.testing.assert_allclose(found[0, 0], alone[0, 0], rtol=FOUND)
    assert np.isnan(found[0, 1])
    assert found.attrs["draws_without"] == 1


# --- results -----------------------------------------------------------------------------------


def data_of(specimens, stretches=(1.4, 1.7, 2.0), with_force=True):
    """Curves of aortas between 60 and 160 mmHg at axial stretches: the law's own, exactly."""
    tables = []
    for name, changes in specimens.items():
        tree = result(**{n: [x] for n, x in (FUNG | changes).items()})
        for experiment, stretch in enumerate(stretches, start=1):
            tube = LAW | {"axial_stretch": stretch}
            pressure = np.linspace(60, 160, 11) * ph.mmHg
            radius = ph.radius_at_pressure(tree, pressure, **tube)["radius"].values[0, 0]
            force = ph.predict_axial_force(tree, radius, **tube)["axial_force"].values[0, 0]
            points = {"radius": radius, "pressure": pressure, "stretch": stretch}
            points |= {"axial_force": force} if with_force else {}
            tables.append(pd.DataFrame({"specimen": name, "experiment": experiment} | points))
    frame = pd.concat(tables, ignore_index=True)
    return ph.inflation_data(frame, **WALL, axial_stretch="stretch")


def fitted(data, tree=None, **variables):
    """Return a fitted result of a model."""
    tree = result(**variables) if tree is None else tree
    tree["constant_data"] = xr.DataTree(data)
    tree.attrs["strain_energy"] = "FungOrthotropic"
    return tree


def test_in_vivo_stretch_beyond_the_data_is_extrapolated():
    tree = fitted(data_of({"S1": {}}, (1.2, 1.4)), aortas(c=[21.0, 22.0]))
    with pytest.warns(UserWarning, match=r"in vivo axial stretch is ext.* 1\.\d+, measured 1.2 to"):
        found = ph.tube_properties(tree, 100.0, axial_stretch=1.4, **IN_MMHG)
    assert found.coords["in_vivo_extrapolated"].item() is True
    assert found.coords["range_extrapolated"].item() is False
    tree = fitted(data_of({"S1": {}}, with_force=False), aortas(c=[21.0, 22.0]))
    with pytest.warns(UserWarning, match="rests on the law: no axial force"):
        found = ph.tube_properties(tree, 100.0, axial_stretch=1.7, **IN_MMHG)
    assert "no axial force" in found["in_vivo_axial_stretch"].attrs["comment"]
    wide = IN_MMHG | {"pressure_range": (80.0, 200.0)}
    tree = fitted(data_of({"S1": {}}), aortas(c=[21.0, 22.0]))
    with pytest.warns(UserWarning, match="extrapolated"):
        found = ph.tube_properties(tree, 100.0, axial_stretch=1.7, **wide)
    assert found.coords["range_extrapolated"].item() is True
    assert not found["extrapolated"].any()


def test_inferred_geometry_gives_a_stretch_per_draw():
    walls = {"inner_radius": [0.44, 0.44, 0.5], "thickness": [0.1, 0.2, 0.1]}
    tree = aortas(c=[FUNG["c"]] * 3)
    posterior = tree["posterior"].to_dataset()
    tree["posterior"] = xr.DataTree(
        posterior.assign({n: (("chain", "draw"), [v]) for n, v in walls.items()})
    )
    name = "in_vivo_axial_stretch"
    found = ph.tube_properties(tree, 100.0, energy=LAW["energy"], **IN_MMHG)[name].values[0]
    for i, (inner, thickness) in enumerate(zip(*walls.values(), strict=True)):
        tube = {"inner_radius": inner, "outer_radius": inner + thickness}
        alone = ph.tube_properties(aortas(), 100.0, **LAW | tube, **IN_MMHG)
        np.testing.assert_allclose(found[i], alone[name].item(), rtol=FOUND)
    assert np.ptp(found) > 0.01


def test_in_vivo_stretch_of_typical_and_named_specimens():
    names = {"S1": {}, "S2": {"c": 24.0, "a2": 0.7}}
    scale = NaturalScale(ph.FungOrthotropic())
    rng = np.random.default_rng(1)
    mean, _ = scale.location_prior
    location = mean + 0.01 * rng.standard_normal((1, 4, mean.size))
    of_typical = scale.numbers(list(np.moveaxis(location, -1, 0)))
    of_specimens = {
        n: (("chain", "draw", "specimen"), np.tile([x, (FUNG | names["S2"])[n]], (1, 4, 1)))
        for n, x in FUNG.items()
    }
    posterior = xr.Dataset(
        of_specimens | {"location": (("chain", "draw", "coordinate"), location)},
        {"specimen": ["S1", "S2"], "coordinate": scale.names, "chain": [0], "draw": range(4)},
    )
    tree = fitted(data_of(names), xr.DataTree.from_dict({"posterior": posterior}))
    tree.attrs["reference_stress"] = "20.0"
    at = {"axial_stretch": 1.7, **IN_MMHG}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = {n: ph.tube_properties(tree, 100.0, specimen=n, **at) for n in (None, "S1", "S2")}
        of_parameters = result(**{n: v[0] for n, v in of_typical.items()})
        alone = {
            whose: ph.tube_properties(by_itself, 100.0, **LAW | at)
            for whose, by_itself in {None: of_parameters, "S1": aortas()}.items()
        }
    assert [found[n].attrs["specimen"] for n in found] == ["typical", "S1", "S2"]
    for whose, expected in alone.items():
        for name in expected:
            np.testing.assert_allclose(
                found[whose][name], np.broadcast_to(expected[name], found[whose][name].shape), 1e-7
            )
    names = ("in_vivo_axial_stretch", "stored_energy_change", "axial_material_stiffness")
    assert all(np.isfinite(found["S2"][name]).all() for name in names)
    assert not np.allclose(found["S1"][names[0]], found["S2"][names[0]], rtol=1e-3)


# --- what is refused -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "pressures", [100.0, [80.0], [120.0, 80.0], [80.0, 80.0], [-5.0, 80.0], [1.0, 2.0, 3.0]]
)
def test_impossible_pressure_range_is_refused(pressures):
    settings = LAW | {"pressure_unit": "mmHg"}
    with pytest.raises(ValueError, match="a diastolic and a higher systolic pressure in mmHg; got"):
        ph.tube_properties(aortas(), 100.0, pressure_range=pressures, **settings)
