"""wall_stress: balance, equilibrium, closed forms."""

from contextlib import nullcontext

import numpy as np
import oracles
import pytest
import xarray as xr
from scipy.integrate import quad
from tube_posteriors import (
    TUBES,
    closing,
    curve,
    every_tube_and_law,
    one_draw,
    radii_of,
    result,
)

import pymc_hyperelastic as ph

pytestmark = pytest.mark.compiled  # in both tiers: predictions are compiled for each law

# An integral over the wall from 40 Gauss points of a smooth stress.
QUADRATURE = 1e-11


def wall_integral(integrand: xr.DataArray, stress: xr.Dataset, tube: dict, weight: np.ndarray):
    """``∫ integrand dr`` through the wall, with the weights of a rule on [0, 1]."""
    thickness = tube["outer_radius"] - tube["inner_radius"]
    reference = tube["inner_radius"] + thickness * stress["position"]
    along = reference / (closing(tube) * tube["axial_stretch"] * stress["current_radius"])
    return (integrand * along * weight).sum("position").values[0, 0] * thickness


@every_tube_and_law
def test_stresses_balance_pressure_and_axial_force(energy, parameters, tube):
    """The stresses balance the pressure, the axial force, and the loads on both surfaces.

    ``∫ σθθ dr = p a`` and ``∫ σzz 2π r dr = F + π a² p``: three results that share no formula.
    """
    node, weight = np.polynomial.legendre.leggauss(40)
    tree = one_draw(parameters)
    if law_has_slack_fibres(energy, tube):
        # The stress has a kink, at which no one rule for the whole wall is exact.
        node, weight = np.linspace(-1, 1, 20001), np.full(20001, 1e-4)
        weight[[0, -1]] /= 2
    pressure = curve(energy, parameters, radii_of(tube)[3:], tube)
    at = ph.Conditions(pressure, tube=ph.Tube(**tube))
    settings = {"energy": energy, "check": "ignore"}
    stress = ph.wall_stress(tree, at, points=(1 + node) / 2, **settings)
    a = ph.radius_at_pressure(tree, at, **settings)["radius"].values[0, 0]
    hoop = wall_integral(stress["sigma_tt"], stress, tube, weight / 2)
    tolerance = QUADRATURE if len(node) == 40 else 1e-6
    np.testing.assert_allclose(hoop, pressure * a, rtol=tolerance)
    axial = wall_integral(
        stress["sigma_zz"] * 2 * np.pi * stress["current_radius"], stress, tube, weight / 2
    )
    warning = pytest.warns(UserWarning, match="the axial force is 0 .* whatever the parameters")
    with warning if law_has_no_force(energy, tube) else nullcontext():
        force = ph.predict_axial_force(tree, a, tube=at.tube, energy=energy)
    force = force["axial_force"].values[0, 0]
    np.testing.assert_allclose(axial, force + np.pi * a**2 * pressure, rtol=tolerance)
    faces = ph.wall_stress(tree, at, points=2, **settings)["sigma_rr"][0, 0]
    scale = np.abs(stress["sigma_tt"]).max().item()
    np.testing.assert_allclose(faces[:, 0], -pressure, rtol=1e-10)
    np.testing.assert_allclose(faces[:, 1], 0.0, atol=1e-14 * scale)


def law_has_no_force(energy, tube) -> bool:
    """Return True if twice the axial stress is the sum of the other two."""
    unstretched = tube["axial_stretch"] == 1
    return isinstance(energy, ph.CriscioneType) or (unstretched and isinstance(energy, ph.Ogden))


def law_has_slack_fibres(energy, tube) -> bool:
    return isinstance(energy, ph.HolzapfelGasserOgden) and tube["axial_stretch"] < 1


@pytest.mark.parametrize("tube", [TUBES["in vivo"], TUBES["thick, opened the other way"]])
def test_stresses_of_the_neo_hookean_tube_equal_their_closed_form(tube):
    """``σi − σj = μ (λi² − λj²)`` with stretches from the wall map, and ``σrr`` by quadrature."""
    mu, inner, outer, axial, _ = 20.0, *tube.values()
    k = closing(tube)
    tree = result(mu=[mu])
    a = radii_of(tube)[3]
    pressure = oracles.neo_hookean_pressure(mu, a, *tube.values())
    at = ph.Conditions(pressure, tube=ph.Tube(**tube))
    stress = ph.wall_stress(tree, at, points=5, energy=ph.NeoHookean())
    assert stress["sigma_rr"].dims == ("chain", "draw", "pressure", "position")
    assert {stress[name].attrs["units"] for name in stress} == {"kPa"}
    stress = stress.squeeze()

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
