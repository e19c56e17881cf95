"""Posteriors of properties and stresses are those of each draw, and balance."""

from contextlib import nullcontext

import numpy as np
import oracles
import pytensor.tensor as pt
import pytest
import xarray as xr
from drawn import (
    LAWS,
    SHEEP,
    SOFTENING,
    TUBES,
    curve,
    every_law,
    every_tube,
    fitted_tree,
    maximum_of_softening,
    one_draw,
    radii_of,
    result,
)
from problems import AS_WRITTEN
from scipy.integrate import quad

import pymc_hyperelastic as ph

pytestmark = pytest.mark.compiled  # predictions are compiled for each law

# The same quantity by another compiled function, or from another formula of the same digits.
ROUNDING = 1e-12
# Central differences of step h err by h² and by rounding over h: with h = 1e-4 of the pressure.
DIFFERENCE = 1e-6
# An integral over the wall from 40 Gauss points of the stress, which varies smoothly.
QUADRATURE = 1e-11


# --- elastic properties --------------------------------------------------------------------------


@every_tube
@pytest.mark.parametrize("law", ["Ogden", "OgdenSeries", "fibres"])
def test_properties_are_slopes_of_the_curves(law, tube):
    """Each property by its definition, from differences of radii at neighbouring pressures."""
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
def test_incremental_modulus_at_rest_is_youngs(outer_radius):
    """Bergel's formula is exact for the linear tube, of any thickness: ``E = 3μ``."""
    settings = {"energy": ph.NeoHookean(), "inner_radius": 7.0, "outer_radius": outer_radius}
    found = ph.tube_properties(result(mu=[20.0, 30.0]), 0.0, **settings)["incremental_modulus"]
    np.testing.assert_allclose(found[0, :, 0], [60.0, 90.0], rtol=1e-10)


def test_pulse_wave_of_a_thin_tube():
    """It tends to Moens and Korteweg's ``√(E h/(2 ρ a (1 − ν²)))`` as the wall gets thin."""
    thickness = 7e-6
    settings = {"energy": ph.NeoHookean(), "inner_radius": 7.0, "outer_radius": 7.0 + thickness}
    found = ph.tube_properties(result(mu=[2e7]), 0.0, **settings)["pulse_wave_velocity"].item()
    youngs = 3 * 2e10  # Pa
    expected = np.sqrt(youngs * thickness / (2 * 1060 * 7.0 * 0.75))
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_pulse_wave_velocity_is_that_of_the_slope():
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


def test_properties_say_what_they_are():
    """Every variable and coordinate has its unit."""
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


# --- stresses through the wall -------------------------------------------------------------------


def wall_integral(integrand: xr.DataArray, stress: xr.Dataset, tube: dict, weight: np.ndarray):
    """``∫ integrand dr`` through the wall, of stresses at the nodes of a rule on [0, 1]."""
    thickness = tube["outer_radius"] - tube["inner_radius"]
    reference = tube["inner_radius"] + thickness * stress["position"]
    k = 2 * np.pi / (2 * np.pi - tube["opening_angle"])
    along = reference / (k * tube["axial_stretch"] * stress["current_radius"])
    return (integrand * along * weight).sum("position").values[0, 0] * thickness


@every_tube
@every_law
def test_stresses_balance_pressure_and_force(energy, parameters, tube):
    """Hoop stress balances the pressure, axial stress the axial force; radial is that on the faces.

    ``∫ σθθ dr = p a`` and ``∫ σzz 2π r dr = F + π a² p``: three results that share no formula.
    """
    node, weight = np.polynomial.legendre.leggauss(40)
    tree = one_draw(parameters)
    if law_has_slack_fibres(energy, tube):
        # The stress has a kink, at which no one rule for the whole wall is exact.
        node, weight = np.linspace(-1, 1, 20001), np.full(20001, 1e-4)
        weight[[0, -1]] /= 2
    pressure = curve(energy, parameters, radii_of(tube)[3:], tube)
    settings = {**tube, "energy": energy, "check": "ignore"}
    stress = ph.wall_stress(tree, pressure, points=(1 + node) / 2, **settings)
    a = ph.radius_at_pressure(tree, pressure, **settings)["radius"].values[0, 0]
    hoop = wall_integral(stress["sigma_tt"], stress, tube, weight / 2)
    tolerance = QUADRATURE if len(node) == 40 else 1e-6
    np.testing.assert_allclose(hoop, pressure * a, rtol=tolerance)
    axial = wall_integral(
        stress["sigma_zz"] * 2 * np.pi * stress["current_radius"], stress, tube, weight / 2
    )
    told = pytest.warns(UserWarning, match="the axial force is 0 .* whatever the parameters")
    with told if law_has_no_force(energy, tube) else nullcontext():
        force = ph.predict_axial_force(tree, a, energy=energy, **tube)["axial_force"].values[0, 0]
    np.testing.assert_allclose(axial, force + np.pi * a**2 * pressure, rtol=tolerance)
    faces = ph.wall_stress(tree, pressure, points=2, **settings)["sigma_rr"][0, 0]
    scale = np.abs(stress["sigma_tt"]).max().item()
    np.testing.assert_allclose(faces[:, 0], -pressure, rtol=1e-10)
    np.testing.assert_allclose(faces[:, 1], 0.0, atol=1e-14 * scale)


def law_has_no_force(energy, tube) -> bool:
    """Where twice the axial stress is the sum of the other two, whatever the parameters."""
    unstretched = tube["axial_stretch"] == 1
    return isinstance(energy, ph.CriscioneType) or (unstretched and isinstance(energy, ph.Ogden))


def law_has_slack_fibres(energy, tube) -> bool:
    return isinstance(energy, ph.HolzapfelGasserOgden) and tube["axial_stretch"] < 1


@every_tube
def test_stresses_are_in_equilibrium_at_each_circle(tube):
    """``dσrr/dr = (σθθ − σrr)/r``, by differences between neighbouring circles."""
    position = np.linspace(0.0, 1.0, 2001)
    energy, parameters = LAWS["Ogden"]
    pressure = curve(energy, parameters, radii_of(tube)[3:4], tube)
    stress = ph.wall_stress(one_draw(parameters), pressure, points=position, energy=energy, **tube)
    r, radial, hoop = (
        stress[name].values[0, 0, 0] for name in ("current_radius", "sigma_rr", "sigma_tt")
    )
    slope = (radial[2:] - radial[:-2]) / (r[2:] - r[:-2])
    expected = (hoop - radial)[1:-1] / r[1:-1]
    np.testing.assert_allclose(slope, expected, atol=1e-5 * np.abs(expected).max(), rtol=0)


@every_tube
def test_stresses_of_the_neo_hookean_tube(tube):
    """``σi − σj = μ (λi² − λj²)`` with stretches from the wall map, and ``σrr`` by quadrature."""
    mu, inner, outer, axial, angle = 20.0, *tube.values()
    k = 2 * np.pi / (2 * np.pi - angle)
    tree = result(mu=[mu])
    a = radii_of(tube)[3]
    pressure = oracles.neo_hookean_pressure(mu, a, *tube.values())
    stress = ph.wall_stress(tree, pressure, points=5, energy=ph.NeoHookean(), **tube).squeeze()

    def stretches(reference):
        r = np.sqrt(a**2 + (reference**2 - inner**2) / (k * axial))
        hoop = k * r / reference
        return r, 1 / (hoop * axial), hoop

    def integrand(reference):
        r, radial, hoop = stretches(reference)
        return mu * (hoop**2 - radial**2) / (hoop * axial * r)

    for i, share in enumerate((0.0, 0.25, 0.5, 0.75, 1.0)):
        reference = inner + share * (outer - inner)
        r, radial, hoop = stretches(reference)
        sigma_rr = -quad(integrand, reference, outer, epsabs=1e-13, epsrel=1e-13)[0]
        at = {name: stress[name].values[i] for name in (*stress, "current_radius")}
        scale = {"rtol": 1e-9, "atol": 1e-12}
        np.testing.assert_allclose(at["current_radius"], r, rtol=1e-10)
        np.testing.assert_allclose(at["sigma_rr"], sigma_rr, **scale)
        np.testing.assert_allclose(at["sigma_tt"], sigma_rr + mu * (hoop**2 - radial**2), **scale)
        np.testing.assert_allclose(at["sigma_zz"], sigma_rr + mu * (axial**2 - radial**2), **scale)


@every_law
def test_stress_differences_are_slopes_of_the_energy(energy, parameters):
    """``σθθ − σrr = ∂Ŵ/∂ln λθ`` and ``σzz − σrr = ∂Ŵ/∂ln λz``, by differences of the energy."""
    tube = TUBES["in vivo"]
    pressure, tree = curve(energy, parameters, [0.45], tube), one_draw(parameters)
    settings = {**tube, "energy": energy, "check": "ignore"}
    stress = ph.wall_stress(tree, pressure, points=3, **settings).squeeze()
    a = ph.radius_at_pressure(tree, pressure, **settings)["radius"].item()
    reference = np.linspace(0.4, 0.52, 3)
    r = np.sqrt(a**2 + (reference**2 - 0.4**2) / (4 / 3 * 1.5))
    log_hoop, log_axial = np.log(4 / 3 * r / reference), np.full(3, np.log(1.5))
    vectors = energy.join(energy.split(parameters))

    def reduced(hoop, axial):
        stretches = (pt.as_tensor(np.exp(x)) for x in (-hoop - axial, hoop, axial))
        return energy.energy(*stretches, **vectors).eval(mode=AS_WRITTEN)

    h = 1e-5
    hoop = (reduced(log_hoop + h, log_axial) - reduced(log_hoop - h, log_axial)) / (2 * h)
    axial = (reduced(log_hoop, log_axial + h) - reduced(log_hoop, log_axial - h)) / (2 * h)
    np.testing.assert_allclose(stress["sigma_tt"] - stress["sigma_rr"], hoop, rtol=DIFFERENCE)
    np.testing.assert_allclose(stress["sigma_zz"] - stress["sigma_rr"], axial, rtol=DIFFERENCE)


def test_mean_hoop_stress_of_a_thin_wall_is_laplaces():
    """Through a thin wall the hoop stress hardly varies: it is ``p a/h``."""
    tube = {"inner_radius": 7.0, "outer_radius": 7.0007}
    stress = ph.wall_stress(result(mu=[2e5]), 3.0, energy=ph.NeoHookean(), **tube).squeeze()
    r = stress["current_radius"].values
    np.testing.assert_allclose(stress["sigma_tt"], 3.0 * r[0] / (r[-1] - r[0]), rtol=1e-3)


def test_places_in_the_wall():
    """A number of circles, or their places; labelled, with the current radius as a coordinate."""
    settings = {"energy": ph.NeoHookean(), **SHEEP}
    few = ph.wall_stress(result(mu=[20.0, 30.0]), [1.0, 2.0], points=3, **settings)
    assert few["sigma_rr"].dims == ("chain", "draw", "pressure", "position")
    assert few.coords["position"].values.tolist() == [0.0, 0.5, 1.0]
    assert few.coords["current_radius"].dims == few["sigma_rr"].dims
    assert {few[name].attrs["units"] for name in few} == {"kPa"}
    middle = ph.wall_stress(result(mu=[20.0, 30.0]), [1.0, 2.0], points=[0.5], **settings)
    xr.testing.assert_allclose(middle, few.sel(position=[0.5]), rtol=ROUNDING)


# --- admissibility -------------------------------------------------------------------------------


def test_admissible_neo_hookean():
    """Pressure and stresses of a positive modulus behave; those of a negative one do not."""
    found = ph.admissible(
        result(mu=[20.0, -1.0, 5.0]), [6.0, 7.0, 9.0], energy=ph.NeoHookean(), **SHEEP
    )
    for name in ("pressure_rises", "baker_ericksen"):
        assert found[name].dims == ("chain", "draw")
        assert found[name].values.tolist() == [[True, False, True]]
        assert found[name].attrs["fraction"] == 2 / 3
    assert found.attrs["summary"] == (
        "From 6 to 9 mm, of 3 draws: pressure rises in 66.7 %, Baker-Ericksen holds in 66.7 %."
    )


def test_conditions_are_independent():
    """A softening tube breaks one condition, a negative second modulus the other."""
    top, _ = maximum_of_softening()
    softening = {"energy": ph.PowerLawNeoHookean(), **SHEEP}
    found = ph.admissible(one_draw(SOFTENING), np.linspace(7, 1.1 * top, 50), **softening)
    assert not found["pressure_rises"].item()
    assert found["baker_ericksen"].item()
    assert ph.admissible(one_draw(SOFTENING), [7, 0.9 * top], **softening)["pressure_rises"].item()
    # Baker and Ericksen ask of Mooney and Rivlin that c10 + λk² c01 > 0 in each direction k: of the
    # pair of hoop and radius 20 − 12 λz² is positive, of axis and radius 20 − 12 λθ² no longer.
    tree = result(c10=[20.0, 20.0], c01=[-12.0, 2.0])
    found = ph.admissible(tree, np.linspace(7.0, 10.0, 20), energy=ph.MooneyRivlin(), **SHEEP)
    assert found["pressure_rises"].values.tolist() == [[True, True]]
    assert found["baker_ericksen"].values.tolist() == [[False, True]]


@pytest.mark.parametrize("axial", [0.8, 1.0, 1.3])
def test_baker_ericksen_of_mooney_rivlin_against_its_closed_form(axial):
    """``c10 + λk² c01 > 0`` for each of the three stretches, at each circle that is looked at."""
    ratio = np.linspace(-1.2, 0.2, 300)
    radius = np.linspace(6.5, 9.0, 7)
    tube = SHEEP | {"axial_stretch": axial}
    tree = result(c10=np.full(300, 10.0), c01=10 * ratio)
    found = ph.admissible(tree, radius, energy=ph.MooneyRivlin(), **tube)["baker_ericksen"][0]
    reference = np.linspace(7.0, 9.0, 11)
    r = np.sqrt(radius[:, None] ** 2 + (reference**2 - 49) / axial)
    hoop = r / reference
    largest = max(np.max(hoop), np.max(1 / (hoop * axial)), axial)
    np.testing.assert_array_equal(found, 1 + largest**2 * ratio > 0)


def test_material_at_its_end_is_not_admissible():
    """Gent's solid beyond its largest stretch has an infinite stress."""
    found = ph.admissible(
        result(mu=[20.0, 20.0], limit=[0.05, 5.0]), [7.0, 9.0], energy=ph.Gent(), **SHEEP
    )
    for name in ("pressure_rises", "baker_ericksen"):
        assert found[name].values.tolist() == [[False, True]]


def test_fibres_are_not_held_to_baker_ericksen():
    """The inequalities are those of isotropic solids: for others there is no such variable."""
    energy, parameters = LAWS["fibres"]
    found = ph.admissible(one_draw(parameters), [7.0, 8.0], energy=energy, **SHEEP)
    assert list(found) == ["pressure_rises"]
    assert "Baker" not in found.attrs["summary"]


def test_admissible_over_the_data():
    """Without radii it is the range of the data, and with them the tube of the data."""
    tree = fitted_tree(mu=[20.0, 30.0])
    measured = tree["constant_data"]["radius"].values
    found = ph.admissible(tree)
    assert found.attrs["summary"].startswith(f"From {measured.min():g} to {measured.max():g} mm")
    assert found["pressure_rises"].all()
