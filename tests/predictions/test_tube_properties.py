"""tube_properties."""

import numpy as np
import oracles
import pymc as pm
import pytest
import xarray as xr
from problems import LAWS
from tube_posteriors import (
    DIFFERENCE,
    INVERSE,
    SHEEP,
    TUBES,
    ask,
    closing,
    curve,
    fitted_tree,
    one_draw,
    radii_of,
    result,
)

import pymc_hyperelastic as ph

pytestmark = pytest.mark.compiled  # in both tiers: predictions are compiled for each law

# Adaptive quadrature and differences with a hundred digits.
EXACT = 1e-9
STIFFNESSES = ("circumferential_material_stiffness", "axial_material_stiffness")
REFERENCE = ("inner_radius", "axial_stretch", "opening_angle")

# Smooth laws, each in another tube.
some_laws_and_tubes = pytest.mark.parametrize(
    ("law", "tube"),
    [
        ("Ogden", TUBES["in vivo"]),
        ("CriscioneType", TUBES["sheep aorta"]),
        ("FungOrthotropic", TUBES["thick, opened the other way"]),
    ],
)


def inflated(law, tube):
    """Return a function for the properties of one draw at pressures, and two pressures."""
    energy, parameters = LAWS[law].strain_energy, LAWS[law].parameters[0][0]
    pressure = curve(energy, parameters, radii_of(tube)[3:4], tube) * [0.3, 1.0]

    def properties(pressure, density=1060.0, **settings):
        at = ph.Conditions(pressure, tube=ph.Tube(**tube), density=density)
        return ph.tube_properties(one_draw(parameters), at, energy=energy, **settings)

    return properties, pressure


def wall_volume(tube):
    """Return the volume of the wall per length of the unloaded tube."""
    return np.pi * (tube["outer_radius"] ** 2 - tube["inner_radius"] ** 2) / closing(tube)


@some_laws_and_tubes
def test_properties_equal_differences_of_radii_at_neighbouring_pressures(law, tube):
    properties, pressure = inflated(law, tube)
    step = 1e-4 * pressure
    found = properties(pressure, density=1050.0)
    below, above = (properties(pressure + sign * step).drop_vars("pressure") for sign in (-1, 1))

    def slope(of):
        return (of(above) - of(below)).values / (2 * step)

    a, b = found["radius"].values, found["outer_radius"].values
    volume = np.pi * (b**2 - a**2) * tube["axial_stretch"]
    np.testing.assert_allclose(volume, wall_volume(tube), rtol=INVERSE)
    area, growth = np.pi * a**2, slope(lambda x: np.pi * x["radius"] ** 2)
    factor = 2 * (1 - 0.5**2) * a**2 * b / (b**2 - a**2)
    expected = {
        "stiffness": 1 / slope(lambda x: x["radius"]),
        "compliance": growth,
        "distensibility": growth / area,
        "peterson_modulus": 1 / slope(lambda x: np.log(2 * x["radius"])),
        "incremental_modulus": factor / slope(lambda x: x["outer_radius"]),
        # In SI units: m², m²/Pa, kg/m³.
        "pulse_wave_velocity": np.sqrt(area * 1e-6 / (1050.0 * growth * 1e-6 / 1e3)),
        # By equilibrium the mean of the hoop stress, which test_wall_stress integrates.
        "circumferential_stress": pressure * a / (b - a),
    }
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, rtol=DIFFERENCE, err_msg=name)


def test_every_property_has_a_unit():
    found = ask(ph.tube_properties, result(mu=[20.0]), [1.0], SHEEP, energy=ph.NeoHookean())
    units = {name: found[name].attrs["units"] for name in (*found, "pressure")}
    stresses = ["pressure", "circumferential_stress", "axial_stress", "stored_energy", *STIFFNESSES]
    stresses += ["peterson_modulus", "incremental_modulus"]
    assert units == dict.fromkeys(stresses, "kPa") | {
        "radius": "mm",
        "outer_radius": "mm",
        "axial_force": "mN",
        "stiffness": "kPa/mm",
        "compliance": "mm2/kPa",
        "distensibility": "1/kPa",
        "pulse_wave_velocity": "m/s",
    }


@some_laws_and_tubes
def test_stored_energy_equals_the_work_done(law, tube):
    """``∫ p dV`` at constant length, and against ``F + π a² p`` at constant radius."""
    properties, pressure = inflated(law, tube)
    energy, parameters = LAWS[law].strain_energy, LAWS[law].parameters[0][0]
    found, volume = properties(pressure), wall_volume(tube)
    low, high = found["radius"].values.ravel()
    node, weight = np.polynomial.legendre.leggauss(40)
    a = (low + high) / 2 + (high - low) / 2 * node
    work = curve(energy, parameters, a, tube) * 2 * np.pi * a * tube["axial_stretch"]
    expected = (work * weight).sum() * (high - low) / 2
    change = np.diff(found["stored_energy"].values.ravel())
    np.testing.assert_allclose(change * volume, expected, rtol=INVERSE)
    # Stretched by a little along the axis, at the same radius, by that radius' own pressure.
    step, ends = 1e-4, []
    for sign in (-1, 1):
        longer = tube | {"axial_stretch": tube["axial_stretch"] + sign * step}
        own = curve(energy, parameters, [high], longer).item()
        at = inflated(law, longer)[0](own, check="ignore")
        ends.append(at["stored_energy"].item() * volume)
    force = found["axial_stress"].values.ravel()[1] * volume / tube["axial_stretch"]
    np.testing.assert_allclose(np.diff(ends) / (2 * step), force, rtol=1e-5)


MEDIA, ADVENTITIA = LAWS["HolzapfelGasserOgden"], LAWS["Demiray"]


def test_stiffness_and_energy_of_two_layers_equal_adaptive_quadrature():
    inside, outside = (law.parameters[0][0] for law in (MEDIA, ADVENTITIA))
    wall = [
        ph.Layer(MEDIA.strain_energy, 0.08, **inside),
        ph.Layer(ADVENTITIA.strain_energy, pm.Uniform.dist(0.02, 0.1), **outside),
    ]
    tube, draws = {n: TUBES["in vivo"][n] for n in REFERENCE}, (0.03, 0.05)
    found = ask(ph.tube_properties, result(thickness_2=draws), 6.0, tube, energy=wall)
    for draw, thickness in enumerate(draws):
        layers = [
            oracles.Layer(MEDIA.energy, inside, 0.48, MEDIA.switches),
            oracles.Layer(ADVENTITIA.energy, outside, 0.48 + thickness, ADVENTITIA.switches),
        ]
        at = found.isel(chain=0, draw=draw, pressure=0)
        exact = oracles.layered_material(layers, at["radius"].item(), *tube.values())
        values = [at[name] for name in ("stored_energy", *STIFFNESSES)]
        np.testing.assert_allclose(values, list(map(float, exact)), rtol=EXACT)


def test_axial_properties_have_a_comment_if_no_force_was_measured():
    tree = fitted_tree(mu=[20.0, 30.0])
    data = tree["constant_data"].to_dataset()

    def commented():
        found = ph.tube_properties(tree, [2.0])
        return {name for name in found if "comment" in found[name].attrs}

    assert commented() == {"axial_force", "axial_stress", "axial_material_stiffness"}
    force = np.full(data.sizes["obs"], np.nan)
    tree["constant_data"] = xr.DataTree(data.assign(axial_force=("obs", force)))
    assert commented()
    force[2] = 3.0
    tree["constant_data"] = xr.DataTree(data.assign(axial_force=("obs", force)))
    assert not commented()
    unknown = ask(ph.tube_properties, result(mu=[20.0]), [2.0], SHEEP, energy=ph.NeoHookean())
    assert "comment" not in unknown["axial_stress"].attrs
