"""Stresses, stiffness and energy of the wall are those of each draw, and balance."""

import warnings

import numpy as np
import oracles
import pymc as pm
import pytensor.tensor as pt
import pytest
import xarray as xr
from drawn import LAWS, SHEEP, TUBES, curve, every_tube, fitted_tree, one_draw, radii_of, result
from problems import LAWS as PRINTED

import pymc_hyperelastic as ph

pytestmark = pytest.mark.compiled  # predictions are compiled for each law

# Two results that share no formula, through the inverse of a curve.
BALANCE = 1e-10
# Of adaptive quadrature and differences in a hundred digits.
EXACT = 1e-9
# Central differences with a step of 1e-4.
DIFFERENCE = 1e-6
NEW = (
    "circumferential_stress",
    "axial_stress",
    "circumferential_material_stiffness",
    "axial_material_stiffness",
    "stored_energy",
)

SMOOTH = {name: LAWS[name] for name in ("Ogden", "CriscioneType")}
SMOOTH["Fung"] = ph.FungOrthotropic(), PRINTED["FungOrthotropic"].parameters[0][0]
some_laws = pytest.mark.parametrize("law", SMOOTH)


def properties(law, tube, at, **settings):
    energy, parameters = SMOOTH[law]
    pressure = curve(energy, parameters, radii_of(tube)[3:4], tube) * at
    tree = one_draw(parameters)
    return pressure, ph.tube_properties(tree, pressure, energy=energy, **tube, **settings)


@every_tube
@some_laws
def test_means_are_those_of_the_stresses_through_the_wall(law, tube):
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


@every_tube
@some_laws
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
def test_means_are_those_of_differences_of_stress(law):
    """Each draw has the stiffness and energy of adaptive quadrature, at its radius."""
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
            names = (NEW[4], NEW[2], NEW[3])
            np.testing.assert_allclose([at[n] for n in names], list(map(float, exact)), rtol=EXACT)


REFERENCE = ("inner_radius", "axial_stretch", "opening_angle")


def test_wall_of_two_layers():
    """Means over both layers, of which each has its own law and its part of the area."""
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
        names = (NEW[4], NEW[2], NEW[3])
        np.testing.assert_allclose([at[n] for n in names], list(map(float, exact)), rtol=EXACT)


def test_thin_tube_is_laplaces():
    """Of a thin wall the hoop stress is ``σθθ − σrr``, and the closed end pulls half as much."""
    tube = {"inner_radius": 7.0, "outer_radius": 7.0007}
    found = ph.tube_properties(result(mu=[2e5]), 3.0, energy=ph.NeoHookean(), **tube).squeeze()
    hoop = found["radius"] / 7.0
    expected = 2e5 * (hoop**2 - 1 / hoop**2)
    np.testing.assert_allclose(found["circumferential_stress"], expected, rtol=1e-3)
    axial = 2e5 * (1 - 1 / hoop**2)
    np.testing.assert_allclose(found["axial_stress"], axial, rtol=1e-3)


def test_no_radius_no_properties():
    """Where a draw does not reach a pressure, all is NaN."""
    tree = result(mu=[20.0, 40.0])
    with pytest.warns(UserWarning, match="of 2 draws 1 do not reach 6 kPa"):
        found = ph.tube_properties(tree, [4.0, 6.0], energy=ph.NeoHookean(), **SHEEP)
    for name in found:
        assert np.isnan(found[name][0]).values.tolist() == [[False, True], [False, False]], name


def test_no_radius_no_energy_of_any_law():
    """Also of one that compares stretches, of which a comparison with NaN is false."""

    class Onesided(ph.StrainEnergy):
        """The neo-Hookean solid, where it is stretched."""

        parameters = ph.NeoHookean.parameters

        def energy(self, radial, hoop, axial, *, mu):
            return pt.where(hoop > 0, mu / 2 * (radial**2 + hoop**2 + axial**2 - 3), 0.0)

    with pytest.warns(UserWarning, match="of 2 draws 1 do not reach 6 kPa"):
        found = ph.tube_properties(result(mu=[20.0, 40.0]), 6.0, energy=Onesided(), **SHEEP)
    assert np.isnan(found["stored_energy"][0, :, 0]).values.tolist() == [True, False]


def test_axial_properties_say_that_no_force_was_measured():
    """A remark stands with them where the data hold no force, and only there."""
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
    """They have the one flag of a pressure; a stretch that was not measured counts too."""
    tree = fitted_tree(mu=[30.0, 32.0])
    with pytest.warns(UserWarning, match="axial stretch 1.2, measured 1"):
        found = ph.tube_properties(tree, [1.0, 2.0], axial_stretch=1.2)
    assert found["stored_energy"].coords["extrapolated"].all()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not ph.tube_properties(tree, [1.0, 2.0])["extrapolated"].any()
