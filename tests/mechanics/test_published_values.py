"""Tubes of the literature and of another package: pressure, axial force, stresses."""

from math import radians

import numpy as np
import pytensor
import pytensor.tensor as pt
import pytest
from problems import AS_WRITTEN

import pymc_hyperelastic as ph
from pymc_hyperelastic.mechanics.tube import opened_sector, stretches

# The numbers of pymecht have fifteen digits; its quadrature reaches ten.
PYMECHT_TOLERANCE = 1e-9
# Rounding of closed forms with differences of logarithms of a few per cent.
ROUNDING = 1e-12


# Thick cylinders in plane strain: strain energy, parameters, inner and outer radius, and readings,
# in the units of the source. A reading is the internal radius and its error, the pressure and the
# hoop stress at the outer surface, and their errors: half a unit of the last printed digit, or the
# accuracy that the source states.
CYLINDERS = {
    # solids4foam, tutorial hyperelasticity/cylindricalPressureVessel, tables of the analytical
    # solution, github.com/solids4foam/solids4foam; E = 1000 MPa and ν = 1/2, so μ = E/3.
    "solids4foam": (
        (ph.NeoHookean(), {"mu": 1e9 / 3}, 8.0, 16.0),
        (
            ((8.1645428945, 5e-11), (1e7, 0.0), None),
            ((10.252601910, 5e-10), (1e8, 0.0), (9.966399596e7, 5e-3)),
        ),
    ),
    # code_aster, Manuel de validation V6.04.112, SSNV112, ssnv112a.comm; E = 200000 MPa and
    # ν = 1/2. The manual states an accuracy of 2 %; its pressure is wrong by 0.07 %.
    "code_aster": (
        (ph.NeoHookean(), {"mu": 200000 / 3}, 0.1, 0.2),
        (((0.10006, 0.0), (59.9955, 0.02 * 59.9955), (2 * 20.003, 2 * 5e-4)),),
    ),
    # ANSYS Mechanical APDL Verification Manual, VM56, after J. T. Oden, Finite elements of
    # nonlinear continua, McGraw-Hill 1972, pp. 325-331; the displacement 7.180 agrees to 5e-4.
    "Oden": (
        (ph.MooneyRivlin(), {"c10": 80.0, "c01": 20.0}, 7.0, 18.625),
        (((7.0 + 7.18, 5e-4 * 7.18), (150.0, 0.0), None),),
    ),
}


@pytest.mark.parametrize("name", CYLINDERS)
def test_published_pressures_and_stresses_are_reproduced(name):
    (energy, parameters, inner, outer), readings = CYLINDERS[name]
    for (radius, radius_error), *published in readings:
        shifted = np.array([radius - radius_error, radius + radius_error])
        pressure = ph.inflation_pressure(energy, shifted, ph.Tube(inner, outer), **parameters)
        # The radial stress at the outer surface is zero.
        _, hoop, _ = stretches(
            outer, shifted, inner_radius=inner, axial_stretch=1.0, opening_angle=0.0
        )
        stress = energy.stress_difference(pt.log(hoop), pt.zeros(2), **parameters)
        for values, reading in zip((pressure, stress), published, strict=True):
            if reading is not None:
                found, (value, error) = values.eval(mode=AS_WRITTEN), reading
                allowed = error + ROUNDING * value
                assert found.min() - allowed <= value <= found.max() + allowed, value


# Layers, inner radius, axial stretch, opening angle, and rows of internal radius, pressure and
# axial force. Source: pymecht 1.1.2 (pypi.org/project/pymecht) with numpy 2.5.5 and scipy 1.18.1:
# pressure of TubeInflation and LayeredTube, axial force 2π ∫ σzz r dr − π a² p of its Cauchy stress
# by Romberg's rule.
PYMECHT = {
    "dispersed fibres": (
        [ph.Layer(ph.GasserOgdenHolzapfel(), 2.0, c=10.0, k1=20.0, k2=1.5, kappa=0.1, beta=40.0)],
        (7.0, 1.2, 60.0),
        (
            (7.0, 4.81101431480596, 718.935435269367),
            (9.0, 15.1984416363984, 210.774008433984),
        ),
    ),
    "carotid artery of two layers": (
        [
            ph.Layer(ph.HolzapfelGasserOgden(), 0.26, c=3.0, k1=2.3632, k2=0.8393, beta=29.0),
            ph.Layer(ph.HolzapfelGasserOgden(), 0.13, c=0.3, k1=0.5620, k2=0.7112, beta=62.0),
        ],
        (1.43, 1.7, 160.0),
        (
            (0.8, 1.34626704818922, 22.9104210585059),
            (1.3, 16.4975560621339, 10.2737812816723),
        ),
    ),
}


@pytest.mark.parametrize("name", PYMECHT)
def test_pressure_and_force_equal_those_of_pymecht(name):
    layers, (inner, axial, angle), rows = PYMECHT[name]
    radii, *expected = np.array(rows).T
    tube = ph.Tube(inner_radius=inner, axial_stretch=axial, opening_angle=radians(angle))
    functions = ph.inflation_pressure, ph.axial_force
    outputs = [function(layers, radii, tube) for function in functions]
    found = pytensor.function([], outputs, mode=AS_WRITTEN)()
    np.testing.assert_allclose(found, expected, rtol=PYMECHT_TOLERANCE)


def test_opened_ring_of_a_carotid_artery_has_the_published_sector_radii():
    """The opening angle is the one missing from the circle: ``k = 2 pi/(2 pi - 160°)``.

    Source: G. A. Holzapfel, T. C. Gasser and R. W. Ogden, Journal of Elasticity 61 (2000) 1-48,
    section 5: inner radii 1.43 mm (opened) and 0.71 mm (closed), thickness 0.39 mm.
    """
    sector = opened_sector(0.71, 1.10, opening_angle=radians(160.0))
    assert sector == pytest.approx((1.43, 1.82), abs=0.01)  # twice the error of the printed 0.71
