"""tube_properties and pulse_wave_velocity."""

import warnings

import numpy as np
import oracles
import pymc as pm
import pytensor.tensor as pt
import pytest
import xarray as xr
from problems import LAWS as PRINTED
from tube_posteriors import (
    LAWS,
    SHEEP,
    TUBES,
    curve,
    fitted_tree,
    one_draw,
    radii_of,
    result,
)

import pymc_hyperelastic as ph

pytestmark = pytest.mark.compiled  # in both tiers: predictions are compiled for each law

# Another formula for the same number.
ROUNDING = 1e-12
# Two results that share no formula, through the inverse of a curve.
BALANCE = 1e-10
# Adaptive quadrature and differences with a hundred digits.
EXACT = 1e-9
# Central differences with a relative step of 1e-4.
DIFFERENCE = 1e-6
WALL_PROPERTIES = (
    "circumferential_stress",
    "axial_stress",
    "circumferential_material_stiffness",
    "axial_material_stiffness",
    "stored_energy",
)
REFERENCE = ("inner_radius", "axial_stretch", "opening_angle")

SMOOTH = {name: LAWS[name] for name in ("Ogden", "CriscioneType")}
SMOOTH["Fung"] = ph.FungOrthotropic(), PRINTED["FungOrthotropic"].parameters[0][0]
# Each law and each tube once.
some_laws_and_tubes = pytest.mark.parametrize(
    ("law", "tube"),
    [
        ("Ogden", TUBES["in vivo"]),
        ("CriscioneType", TUBES["sheep aorta"]),
        ("Fung", TUBES["thick, opened the other way"]),
        ("Ogden", TUBES["stretched"]),
    ],
)


@pytest.mark.parametrize(
    ("law", "tube"),
    [
        ("Ogden", TUBES["in vivo"]),
        ("OgdenSeries", TUBES["sheep aorta"]),
        ("fibres", TUBES["thick, opened the other way"]),
        ("Ogden", TUBES["stretched"]),
    ],
)
def test_properties_equal_differences_of_radii_at_neighbouring_pressures(law, tube):
    energy, parameters = LAWS[law]
    tree = one_draw(parameters)
    pressure = curve(energy, parameters, radii_of(tube)[3:4], tube) * [0.3, 1.0]
    step = 1e-4 * pressure
    found = ph.tube_properties(tree, pressure, energy=energy, density=1050.0, **tube)
    below, above = (
        ph.tube_properties(tree, pressure + sign * step, energy=energy, **tube).drop_vars(
            "pressure"
        )
        for sign in (-1, 1)
    )

    def slope(of):
        return (of(above) - of(below)).values / (2 * step)

    a, b = found["radius"].values, found["outer_radius"].values
    k = 2 * np.pi / (2 * np.pi - tube["opening_angle"])
    wall = np.pi * (tube["outer_radius"] ** 2 - tube["inner_radius"] ** 2) / k
    np.testing.assert_allclose(np.pi * (b**2 - a**2) * tube["axial_stretch"], wall, rtol=1e-10)
    area, growth = np.pi * a**2, slope(lambda x: np.pi * x["radius"] ** 2)
    expected = {
        "stiffness": 1 / slope(lambda x: x["radius"]),
        "compliance": growth,
        "distensibility": growth / area,
        "peterson_modulus": 1 / slope(lambda x: np.log(2 * x["radius"])),
        "incremental_modulus": 2
        * (1 - 0.5**2)
        * a**2
        * b
        / (b**2 - a**2)
        / slope(lambda x: x["outer_radius"]),
        # In SI units: m², m²/Pa, kg/m³.
        "pulse_wave_velocity": np.sqrt(area * 1e-6 / (1050.0 * growth * 1e-6 / 1e3)),
    }
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, rtol=DIFFERENCE, err_msg=name)


@pytest.mark.parametrize("outer_radius", [7.01, 9.0, 30.0])
def test_incremental_modulus_at_rest_is_youngs_modulus(outer_radius):
    """Bergel's formula is exact for the linear tube, of any thickness: ``E = 3μ``."""
    settings = {"energy": ph.NeoHookean(), "inner_radius": 7.0, "outer_radius": outer_radius}
    found = ph.tube_properties(result(mu=[20.0, 30.0]), 0.0, **settings)["incremental_modulus"]
    np.testing.assert_allclose(found[0, :, 0], [60.0, 90.0], rtol=1e-10)


def test_pulse_wave_velocity_of_a_thin_tube_is_moens_kortewegs():
    """It tends to Moens and Korteweg's ``√(E h/(2 ρ a (1 − ν²)))`` as the wall gets thin."""
    thickness = 7e-6
    settings = {"energy": ph.NeoHookean(), "inner_radius": 7.0, "outer_radius": 7.0 + thickness}
    found = ph.tube_properties(result(mu=[2e7]), 0.0, **settings)["pulse_wave_velocity"].item()
    youngs = 3 * 2e10  # Pa
    expected = np.sqrt(youngs * thickness / (2 * 1060 * 7.0 * 0.75))
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_pulse_wave_velocity_follows_from_the_slope():
    """The speed is ``√(a (dp/da)/(2ρ))`` of the predicted slope, in m/s, for any density."""
    tree, tube = result(mu=[20.0]), {"inner_radius": 7.0, "outer_radius": 9.0}
    settings = {"energy": ph.NeoHookean(), **tube}
    radius = ph.radius_at_pressure(tree, [1.0, 2.0], **settings)["radius"].values.ravel()
    slope = ph.predict_pressure(tree, radius, **settings)["stiffness"].values.ravel()
    speed = ph.pulse_wave_velocity(tree, [1.0, 2.0], density=1000.0, **settings)
    np.testing.assert_allclose(
        speed["pulse_wave_velocity"].values.ravel(),
        np.sqrt(radius * 1e-3 * slope * 1e6 / 2000),
        rtol=1e-10,
    )


def test_every_property_has_a_unit():
    found = ph.tube_properties(result(mu=[20.0]), [1.0], energy=ph.NeoHookean(), **SHEEP)
    units = {name: found[name].attrs["units"] for name in (*found, "pressure")}
    assert units == {
        "radius": "mm",
        "outer_radius": "mm",
        "stiffness": "kPa/mm",
        "compliance": "mm2/kPa",
        "distensibility": "1/kPa",
        "peterson_modulus": "kPa",
        "incremental_modulus": "kPa",
        "pulse_wave_velocity": "m/s",
        "circumferential_stress": "kPa",
        "axial_stress": "kPa",
        "circumferential_material_stiffness": "kPa",
        "axial_material_stiffness": "kPa",
        "stored_energy": "kPa",
        "pressure": "kPa",
    }


def properties(law, tube, at, **settings):
    energy, parameters = SMOOTH[law]
    pressure = curve(energy, parameters, radii_of(tube)[3:4], tube) * at
    tree = one_draw(parameters)
    return pressure, ph.tube_properties(tree, pressure, energy=energy, **tube, **settings)


@some_laws_and_tubes
def test_mean_stresses_are_averages_of_wall_stress(law, tube):
    """Laplace's stress is the mean of ``σθθ`` over the thickness, axial that over the area."""
    energy, parameters = SMOOTH[law]
    pressure, found = properties(law, tube, [0.3, 1.0])
    node, weight = np.polynomial.legendre.leggauss(60)
    points = (1 + node) / 2
    stress = ph.wall_stress(one_draw(parameters), pressure, points=points, energy=energy, **tube)
    stretch = tube["axial_stretch"] * 2 * np.pi / (2 * np.pi - tube["opening_angle"])
    thickness = tube["outer_radius"] - tube["inner_radius"]
    reference = tube["inner_radius"] + thickness * points
    r = stress["current_radius"]
    dr = thickness / 2 * weight * reference / (stretch * r)
    mean = (stress["sigma_tt"] * dr).sum("position") / dr.sum("position")
    np.testing.assert_allclose(found["circumferential_stress"], mean, rtol=BALANCE)
    mean = (stress["sigma_zz"] * r * dr).sum("position") / (r * dr).sum("position")
    np.testing.assert_allclose(found["axial_stress"], mean, rtol=BALANCE)


@some_laws_and_tubes
def test_stored_energy_is_the_work_done(law, tube):
    """``∫ p dV`` at constant length, and against ``F + π a² p`` at constant radius."""
    energy, parameters = SMOOTH[law]
    _, found = properties(law, tube, [0.3, 1.0])
    k = 2 * np.pi / (2 * np.pi - tube["opening_angle"])
    volume = np.pi * (tube["outer_radius"] ** 2 - tube["inner_radius"] ** 2) / k
    low, high = found["radius"].values.ravel()
    node, weight = np.polynomial.legendre.leggauss(40)
    a = (low + high) / 2 + (high - low) / 2 * node
    work = curve(energy, parameters, a, tube) * 2 * np.pi * a * tube["axial_stretch"]
    stored = found["stored_energy"].values.ravel()
    expected = (work * weight).sum() * (high - low) / 2
    np.testing.assert_allclose((stored[1] - stored[0]) * volume, expected, rtol=BALANCE)
    # Stretched by a little along the axis, at the same radius, by that radius' own pressure.
    step, ends = 1e-4, []
    for sign in (-1, 1):
        longer = tube | {"axial_stretch": tube["axial_stretch"] + sign * step}
        own = curve(energy, parameters, [high], longer)
        at = ph.tube_properties(one_draw(parameters), own, energy=energy, check="ignore", **longer)
        ends.append(at["stored_energy"].item() * volume)
    area = volume / tube["axial_stretch"]
    force = found["axial_stress"].values.ravel()[1] * area
    np.testing.assert_allclose(np.diff(ends) / (2 * step), force, rtol=1e-5)


@pytest.mark.parametrize("law", ["Ogden", "FungOrthotropic", "FourFiber"])
def test_stiffness_and_energy_equal_adaptive_quadrature(law):
    printed, tube = PRINTED[law], TUBES["in vivo"]
    parameters = printed.parameters[0][0]
    softer = {n: 0.8 * x if n in ("mu", "c") else x for n, x in parameters.items()}
    tree = result(**{n: [parameters[n], softer[n]] for n in parameters})
    found = ph.tube_properties(tree, [4.0, 9.0], energy=printed.strain_energy, **tube)
    for draw, values in enumerate((parameters, softer)):
        layer = oracles.Layer(printed.energy, values, tube["outer_radius"], printed.switches)
        for i in range(2):
            at = found.isel(chain=0, draw=draw, pressure=i)
            exact = oracles.layered_material(
                [layer], at["radius"].item(), *(tube[n] for n in REFERENCE)
            )
            names = ("stored_energy", *WALL_PROPERTIES[2:4])
            np.testing.assert_allclose([at[n] for n in names], list(map(float, exact)), rtol=EXACT)


def test_properties_of_two_layers_are_means_over_both():
    media, adventitia = PRINTED["HolzapfelGasserOgden"], PRINTED["Demiray"]
    inside, outside = (law.parameters[0][0] for law in (media, adventitia))
    wall = [
        ph.Layer(media.strain_energy, 0.08, **inside),
        ph.Layer(adventitia.strain_energy, pm.Uniform.dist(0.02, 0.1), **outside),
    ]
    tube = {n: TUBES["in vivo"][n] for n in REFERENCE}
    found = ph.tube_properties(result(thickness_2=[0.03, 0.05]), [6.0], energy=wall, **tube)
    for draw, thickness in enumerate((0.03, 0.05)):
        layers = [
            oracles.Layer(media.energy, inside, 0.48, media.switches),
            oracles.Layer(adventitia.energy, outside, 0.48 + thickness, adventitia.switches),
        ]
        at = found.isel(chain=0, draw=draw, pressure=0)
        exact = oracles.layered_material(layers, at["radius"].item(), *tube.values())
        names = ("stored_energy", *WALL_PROPERTIES[2:4])
        np.testing.assert_allclose([at[n] for n in names], list(map(float, exact)), rtol=EXACT)


def test_stresses_of_a_thin_tube_are_laplaces():
    """In a thin wall the hoop stress is ``σθθ − σrr``; the axial stress is half of it."""
    tube = {"inner_radius": 7.0, "outer_radius": 7.0007}
    found = ph.tube_properties(result(mu=[2e5]), 3.0, energy=ph.NeoHookean(), **tube).squeeze()
    hoop = found["radius"] / 7.0
    expected = 2e5 * (hoop**2 - 1 / hoop**2)
    np.testing.assert_allclose(found["circumferential_stress"], expected, rtol=1e-3)
    axial = 2e5 * (1 - 1 / hoop**2)
    np.testing.assert_allclose(found["axial_stress"], axial, rtol=1e-3)


def test_draws_that_do_not_reach_a_pressure_have_no_properties():

    class Onesided(ph.StrainEnergy):
        """The neo-Hookean solid, where it is stretched."""

        parameters = ph.NeoHookean.parameters

        def energy(self, radial, hoop, axial, *, mu):
            return pt.where(hoop > 0, mu / 2 * (radial**2 + hoop**2 + axial**2 - 3), 0.0)

    with pytest.warns(UserWarning, match="of 2 draws 1 do not reach 6 kPa"):
        found = ph.tube_properties(result(mu=[20.0, 40.0]), 6.0, energy=Onesided(), **SHEEP)
    assert np.isnan(found["stored_energy"][0, :, 0]).values.tolist() == [True, False]


def test_axial_properties_have_a_remark_if_no_force_was_measured():
    tree = fitted_tree(mu=[20.0, 30.0])
    found = ph.tube_properties(tree, [2.0])
    told = {name for name in found if "comment" in found[name].attrs}
    assert told == {"axial_stress", "axial_material_stiffness"}
    data = tree["constant_data"].to_dataset()
    force = np.full(data.sizes["obs"], np.nan)
    tree["constant_data"] = xr.DataTree(data.assign(axial_force=("obs", force)))
    assert "comment" in ph.tube_properties(tree, [2.0])["axial_stress"].attrs
    force[2] = 3.0
    tree["constant_data"] = xr.DataTree(data.assign(axial_force=("obs", force)))
    assert "comment" not in ph.tube_properties(tree, [2.0])["axial_stress"].attrs
    unknown = ph.tube_properties(result(mu=[20.0]), [2.0], energy=ph.NeoHookean(), **SHEEP)
    assert "comment" not in unknown["axial_stress"].attrs


def test_properties_are_extrapolated_where_radii_are():
    tree = fitted_tree(mu=[30.0, 32.0])
    with pytest.warns(UserWarning, match="axial stretch 1.2, measured 1"):
        found = ph.tube_properties(tree, [1.0, 2.0], axial_stretch=1.2)
    assert found["stored_energy"].coords["extrapolated"].all()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not ph.tube_properties(tree, [1.0, 2.0])["extrapolated"].any()
