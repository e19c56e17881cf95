"""Tubes of the literature and of another package: pressure, stiffness, axial force, stresses."""

from math import log, pi, radians

import numpy as np
import oracles
import pytensor
import pytest
from problems import AS_WRITTEN
from published import (
    ADVENTITIA,
    CAROTID,
    CAROTID_DIGITS,
    CYLINDERS,
    MEDIA,
    OGDEN_RUBBER,
    PHYSIOLOGICAL_PRESSURE,
    PYMECHT,
    RUBBER_TUBES,
)
from scipy.integrate import quad

import pymc_hyperelastic as ph
from pymc_hyperelastic.mechanics.tube import current_radius, opening_factor, stretches

# Two different integrals of the same tube, each asked for eleven digits.
INDEPENDENT_TOLERANCE = 1e-8
QUADRATURE_TOLERANCE = 1e-11
# A derivative by a complex step has no error of cancellation, so that the step may be this small.
COMPLEX_STEP = 1e-30
# Radii are stored to 5e-11 mm. Pressure and axial force move by some 300 kPa and 400 mN a mm there:
# by 2e-8 at most, a relative 2e-9. Two independent integrals are asked for no more than 1e-8.
STORED_DIGITS = 1e-8
# pymecht's digits are stored as fifteen; it asks its own quadrature for eight, which reaches more.
PYMECHT_TOLERANCE = 1e-9
# Closed forms in other variables: rounding, and differences of logarithms of a few per cent.
CLOSED_FORM_TOLERANCE = 1e-12
# Rounding of a number computed from an exact radius, relative.
ROUNDING = 1e-12
# Beyond a = 10^4 A the pressure of a neo-Hookean cylinder is within (A/a)^2 of its limit.
INFLATED_FAR, FAR_TOLERANCE = 1e4, 1e-7


# --- the package's answers -----------------------------------------------------------------------


def layers_of(case):
    """The wall as the package takes it."""
    return [
        ph.Layer(
            ph.StrainEnergy.from_name(layer.law),
            layer.thickness,
            **{name: np.array(value) for name, value in layer.parameters.items()},
        )
        for layer in case.layers
    ]


def geometry_of(case):
    return {
        "inner_radius": case.inner_radius,
        "axial_stretch": case.axial_stretch,
        "opening_angle": radians(case.opening_angle),
    }


def answers(case, radii):
    """Pressures and axial forces at the internal radii."""
    wall, radii = layers_of(case), np.array(radii, float)
    outputs = [
        function(wall, radii, **geometry_of(case))
        for function in (ph.inflation_pressure, ph.axial_force)
    ]
    return pytensor.function([], outputs, mode=AS_WRITTEN)()


def stiffness(case, radius):
    return float(
        ph.inflation_stiffness(layers_of(case), radius, **geometry_of(case)).eval(mode=AS_WRITTEN)
    )


def stress_differences(layer, case, reference, radius):
    """Hoop and axial stress less the radial one, in a layer at a reference radius."""
    _, hoop, axial = stretches(reference, radius, **geometry_of(case))
    energy = ph.StrainEnergy.from_name(layer.law)
    logs = [pytensor.tensor.as_tensor_variable(log(x)) for x in (hoop, axial)]
    differences = [
        function(*logs, **layer.parameters)
        for function in (energy.stress_difference, energy.axial_stress_difference)
    ]
    return [float(x) for x in pytensor.function([], differences, mode=AS_WRITTEN)()]


def reading_of(case, quantity, radius):
    """What the package says of a published quantity of a tube of one layer."""
    (layer,) = case.layers
    pressure = float(answers(case, radius)[0])
    if quantity == "pressure":
        return pressure
    stress, place = quantity.rsplit(" ", 1)
    reference = case.inner_radius + (layer.thickness if place == "outside" else 0.0)
    hoop, axial = stress_differences(layer, case, reference, radius)
    radial = -pressure if place == "inside" else 0.0
    return {
        "stress difference": hoop,
        "hoop stress": hoop + radial,
        "axial stress": axial + radial,
    }[stress]


# --- an independent answer -----------------------------------------------------------------------


def holzapfel_gasser_ogden(radial, hoop, axial, *, c, k1, k2, beta):
    """``c/2 (I1 - 3) + k1/k2 (exp(k2 E^2) - 1)``, fibres in tension only."""
    angle = radians(beta)
    strain = hoop**2 * np.cos(angle) ** 2 + axial**2 * np.sin(angle) ** 2 - 1
    fibres = k1 / k2 * (np.exp(k2 * strain**2) - 1) if strain.real > 0 else 0.0
    return c / 2 * (radial**2 + hoop**2 + axial**2 - 3) + fibres


def ogden_series(radial, hoop, axial, *, mu, alpha):
    """``sum mu_p/alpha_p (l1^alpha_p + l2^alpha_p + l3^alpha_p - 3)``."""
    return sum(m / a * (radial**a + hoop**a + axial**a - 3) for m, a in zip(mu, alpha, strict=True))


ENERGIES = {"HolzapfelGasserOgden": holzapfel_gasser_ogden, "OgdenSeries": ogden_series}


def stored_energy_slope(case, radius, axial_stretch):
    """Derivative of the energy of a unit of length, along the imaginary part of the arguments."""
    k = 2 * pi / (2 * pi - radians(case.opening_angle))
    inner = low = case.inner_radius
    total = 0.0
    for layer in case.layers:

        def integrand(reference, energy=ENERGIES[layer.law], parameters=layer.parameters):
            current = np.sqrt(radius**2 + (reference**2 - inner**2) / (k * axial_stretch))
            hoop = k * current / reference
            value = energy(1 / (hoop * axial_stretch), hoop, axial_stretch, **parameters)
            return value.imag / COMPLEX_STEP * reference

        value, error = quad(
            integrand, low, low + layer.thickness, epsabs=0, epsrel=QUADRATURE_TOLERANCE, limit=200
        )
        assert error <= QUADRATURE_TOLERANCE * abs(value)
        total += value
        low += layer.thickness
    return 2 * pi / k * total


def by_virtual_work(case, radius):
    """Pressure and axial force from the energy of the wall alone: no stress, no equilibrium.

    The pressure does work on the lumen ``pi a^2 l_z`` of a unit of length, and the axial force on
    its stretch: ``dE = p d(pi a^2 l_z) + F dl_z``. Both are therefore derivatives of the energy.
    """
    axial = case.axial_stretch
    by_radius = stored_energy_slope(case, radius + 1j * COMPLEX_STEP, axial + 0j)
    by_stretch = stored_energy_slope(case, radius + 0j, axial + 1j * COMPLEX_STEP)
    pressure = by_radius / (2 * pi * radius * axial)
    return pressure, by_stretch - pi * radius**2 * pressure


# --- published numbers ---------------------------------------------------------------------------


READINGS = [
    pytest.param(case, reading, id=f"{case.name}, {reading.quantity} at {reading.internal_radius}")
    for case in CYLINDERS
    for reading in case.readings
]


@pytest.mark.parametrize(("case", "reading"), READINGS)
def test_published_number(case, reading):
    """A published number lies within its printed digits, or what the source allows itself."""
    shifts = (-reading.radius_error, reading.radius_error)
    values = [reading_of(case, reading.quantity, reading.internal_radius + x) for x in shifts]
    allowed = reading.value_error + ROUNDING * abs(reading.value)
    assert min(values) - allowed <= reading.value <= max(values) + allowed


def test_every_case_has_a_source():
    """Nothing is in the table without saying who published it."""
    cases = [*CYLINDERS, *CAROTID, *RUBBER_TUBES, *(computed.tube for computed in PYMECHT)]
    assert len({case.name for case in cases}) == len(cases)
    assert all(case.source for case in cases)


@pytest.mark.parametrize(
    ("law", "parameters", "modulus"),
    [
        ("NeoHookean", {"mu": 200000 / 3}, 200000 / 3),
        ("MooneyRivlin", {"c10": 80.0, "c01": 20.0}, 200.0),
        # The modulus is the one that the 1972 paper's constants amount to, 4.225 kgf/cm².
        ("OgdenSeries", {k: np.array(v) for k, v in OGDEN_RUBBER.items()}, 4.225),
    ],
)
def test_stiffness_at_rest_is_that_of_lame(law, parameters, modulus):
    """An unloaded tube yields as the incompressible linear cylinder in plane strain.

    Lamé's displacement ``u = p A B^2/(2 mu (B^2 - A^2))`` is the reference of code_aster's SSLV130
    (Manuel de validation V3.04.130): A = 0.1, B = 0.2, E = 200000 and p = 60 give 6e-5.
    """
    inner, outer = 0.1, 0.2
    value = ph.inflation_stiffness(
        ph.StrainEnergy.from_name(law),
        inner,
        inner_radius=inner,
        outer_radius=outer,
        **parameters,
    )
    exact = 2 * modulus * (outer**2 - inner**2) / (inner * outer**2)
    assert float(value.eval(mode=AS_WRITTEN)) == pytest.approx(exact, rel=CLOSED_FORM_TOLERANCE)
    if law == "NeoHookean":
        assert exact == pytest.approx(60 / 6e-5, rel=ROUNDING)


def test_neo_hookean_cylinder_cannot_resist_more_than_its_limit():
    """The pressure of a cylinder of fixed length tends to ``mu ln(B/A)`` as it is inflated.

    Source: M. M. Carroll, Quarterly of Applied Mathematics 45 (1987) 141-154.
    """
    inner, outer, mu = 1.0, 2.5, 20.0
    radii = inner * np.array([2.0, 10.0, INFLATED_FAR])
    pressure = ph.inflation_pressure(
        ph.NeoHookean(), radii, inner_radius=inner, outer_radius=outer, mu=mu
    ).eval(mode=AS_WRITTEN)
    limit = mu * log(outer / inner)
    assert (np.diff(pressure) > 0).all()
    assert (pressure < limit).all()
    assert pressure[-1] == pytest.approx(limit, rel=FAR_TOLERANCE)


@pytest.mark.parametrize("axial_stretch", [0.8, 1.0, 1.5])
def test_mooney_rivlin_tube_has_its_closed_forms(axial_stretch):
    r"""Pressure and axial force of an extended, inflated Mooney-Rivlin tube are Rivlin's.

    With ``g = a^2 - A^2/l_z`` the pressure is that of a neo-Hookean tube of the modulus
    ``2 (c10 + c01 l_z^2)``, and

        F = (2 pi/l_z) {c10 [l_z^2 (B^2 - A^2) - S] + c01 [l_z^2 S - (B^2 - A^2)/l_z^2]},
        S = (B^2 - A^2)/l_z + g ln(B a/(A b)),

    where ``S`` is the integral of ``(l_theta^2 + l_r^2) R dR``.

    Source: R. S. Rivlin, Large elastic deformations of isotropic materials VI, Philosophical
    Transactions of the Royal Society A 242 (1949) 173-195.
    """
    a, inner, outer, z, c10, c01 = 1.4, 1.0, 1.8, axial_stretch, 80.0, 20.0
    tube = {"inner_radius": inner, "outer_radius": outer, "axial_stretch": z}
    pressure, force = (
        float(function(ph.MooneyRivlin(), a, **tube, c10=c10, c01=c01).eval(mode=AS_WRITTEN))
        for function in (ph.inflation_pressure, ph.axial_force)
    )
    modulus = 2 * (c10 + c01 * z**2)
    exact_pressure = oracles.neo_hookean_pressure(modulus, a, inner, outer, z)
    wall = outer**2 - inner**2
    b = (a**2 + wall / z) ** 0.5
    s = wall / z + (a**2 - inner**2 / z) * log(outer * a / (inner * b))
    exact_force = 2 * pi / z * (c10 * (z**2 * wall - s) + c01 * (z**2 * s - wall / z**2))
    assert pressure == pytest.approx(exact_pressure, rel=CLOSED_FORM_TOLERANCE)
    assert force == pytest.approx(exact_force, rel=CLOSED_FORM_TOLERANCE)


# --- published curves ----------------------------------------------------------------------------


# Radii from where the published curves start, some fibres slack, to beyond the physiological ones.
CAROTID_RADII = (0.6, 0.9, 1.2, 1.35)
# Below and above the greatest pressure of each tube, and beyond the least one that follows.
RUBBER_RADII = (1.2, 2.0, 4.0, 6.0)
CURVES = [
    *(pytest.param(case, CAROTID_RADII, id=case.name) for case in CAROTID),
    *(pytest.param(case, RUBBER_RADII, id=case.name) for case in RUBBER_TUBES),
]


@pytest.mark.parametrize(("case", "radii"), CURVES)
def test_published_curve_follows_from_virtual_work(case, radii):
    """Pressure and axial force are the derivatives of the energy that the wall stores."""
    exact = np.array([by_virtual_work(case, radius) for radius in radii]).T
    for ours, theirs in zip(answers(case, radii), exact, strict=True):
        scale = INDEPENDENT_TOLERANCE * np.abs(theirs).max()
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=scale)


@pytest.mark.parametrize("case", CAROTID, ids=lambda case: case.name)
def test_carotid_artery_at_physiological_pressure_keeps_its_digits(case):
    """Internal radius and axial force at 13.33 kPa are those on record, by both ways."""
    radius, force = CAROTID_DIGITS[case.opening_angle, case.axial_stretch]
    for ours in (answers(case, radius), by_virtual_work(case, radius)):
        assert ours[0] == pytest.approx(PHYSIOLOGICAL_PRESSURE, rel=STORED_DIGITS)
        assert ours[1] == pytest.approx(force, rel=STORED_DIGITS)


def test_residual_stress_evens_the_stress_in_the_media():
    """At 13.33 kPa and axial stretch 1.7 the opened artery's hoop stress falls less outwards.

    The 2000 paper shows it as curves: without residual stress the hoop stress is highest at the
    inner surface of the media and falls steeply, with it the peak is lower and the fall less.
    """
    stress = {}
    for case in CAROTID:
        if case.axial_stretch != 1.7:
            continue
        radius, _ = CAROTID_DIGITS[case.opening_angle, case.axial_stretch]
        boundary = case.inner_radius + MEDIA.thickness
        inside, _ = stress_differences(MEDIA, case, case.inner_radius, radius)
        outside, _ = stress_differences(MEDIA, case, boundary, radius)
        # The adventitia, a tube of its own, holds the pressure between the layers.
        adventitia = ph.inflation_pressure(
            layers_of(case)[1:],
            current_radius(boundary, radius, **geometry_of(case)),
            **geometry_of(case) | {"inner_radius": boundary},
        )
        stress[case.opening_angle] = (
            inside - PHYSIOLOGICAL_PRESSURE,
            outside - float(adventitia.eval(mode=AS_WRITTEN)),
        )
    assert stress[160.0][0] < stress[0.0][0]
    opened, closed = (stress[angle][0] / stress[angle][1] for angle in (160.0, 0.0))
    assert abs(opened - 1) < abs(closed - 1)


def test_closed_and_opened_carotid_artery_are_one():
    """The two published tubes agree in the length of the middle of the wall, to printed digits.

    That holds only if the angle is the one missing from the circle: ``k = 2 pi/(2 pi - 160°)``.
    """
    thickness = MEDIA.thickness + ADVENTITIA.thickness
    opened, closed = CAROTID[0].inner_radius, CAROTID[-1].inner_radius
    middle = (opened + thickness / 2) / opening_factor(radians(160.0))
    assert middle - thickness / 2 == pytest.approx(closed, abs=0.005)


@pytest.mark.parametrize("case", RUBBER_TUBES, ids=lambda case: case.name)
def test_pressure_of_a_rubber_tube_has_a_greatest_and_a_least_value(case):
    """At fixed axial stretch a tube of this rubber softens, and then stiffens for good.

    Haughton and Ogden (1979) show it as curves, without digits.
    """
    slopes = [stiffness(case, radius) > 0 for radius in (1.2, 3.0, 6.0)]
    assert slopes == [True, False, True]


@pytest.mark.parametrize("case", RUBBER_TUBES, ids=lambda case: case.name)
def test_pressure_of_a_rubber_tube_is_haughton_and_ogdens_integral(case):
    """The integral over the hoop stretch, which the paper writes, is that over the wall."""
    (layer,) = case.layers

    def energy(*stretches):
        return ogden_series(*stretches, **layer.parameters)

    outer = case.inner_radius + layer.thickness
    exact = [
        oracles.pressure_by_stretch_integral(
            energy, radius, case.inner_radius, outer, case.axial_stretch
        )
        for radius in RUBBER_RADII
    ]
    pressure, _ = answers(case, RUBBER_RADII)
    np.testing.assert_allclose(pressure, exact, rtol=INDEPENDENT_TOLERANCE, atol=0)


# --- another package -----------------------------------------------------------------------------


@pytest.mark.parametrize("computed", PYMECHT, ids=lambda computed: computed.tube.name)
def test_pymecht_agrees(computed):
    """Pressure and axial force are those that pymecht computes."""
    radii, pressure, force = np.array(computed.rows).T
    ours = answers(computed.tube, radii)
    np.testing.assert_allclose(ours[0], pressure, rtol=PYMECHT_TOLERANCE, atol=0)
    np.testing.assert_allclose(ours[1], force, rtol=PYMECHT_TOLERANCE, atol=0)
