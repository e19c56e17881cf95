"""Stored energy and material stiffness of a wall, against differences of its stresses."""

from math import radians

import mpmath as mp
import numpy as np
import oracles
import pytensor
import pytensor.tensor as pt
import pytest
from pressures import in_python
from problems import AS_WRITTEN, LAWS, PROBLEMS
from tiers import deep

import pymc_hyperelastic as ph
from pymc_hyperelastic.mechanics.material import MaterialIntegral

# Against adaptive quadrature of differences in a hundred digits: the rule's own error, with
# exponents up to 60.
TOLERANCE = 1e-9
# An energy is the difference of sums of squares from those at rest, in parts of its moduli.
ENERGY_ROUNDING = 1e-13
# Of a closed form, and of two formulas for one number.
ROUNDING = 1e-12

# Not where an axial stretch of exactly 1 leaves fibres along the tube at the point of slackening.
TUBES = ("in vivo", "slackening, stretched")
MORE_TUBES = ("stretched", "shortened", "extreme", "slackening, shortened")


def means_of(law, mode=AS_WRITTEN):
    """A function of the inputs of the integral: the three means."""
    inputs = pt.dvectors(5 + len(LAWS[law].entry_names))
    sums = MaterialIntegral(strain_energy=LAWS[law].strain_energy)(*inputs, return_list=True)
    _, inner, outer, axial, angle, *_ = inputs
    area = np.pi * (outer**2 - inner**2) * (2 * np.pi - angle) / (2 * np.pi * axial)
    return pytensor.function(inputs, [x / area for x in sums], mode=mode)


def problems_of(law, tubes):
    return [p for p in PROBLEMS if p.law == law and p.name.split(", ", 1)[1].endswith(tubes)]


def exact_means(problem):
    law = LAWS[problem.law]
    entries = dict(list(problem.inputs.items())[5:])
    layer = oracles.Layer(law.energy, entries, problem.outer_radius, law.switches)
    angle = radians(problem.opening_angle)
    of_tube = problem.internal_radius, problem.inner_radius, problem.axial_stretch, angle
    return [float(x) for x in oracles.layered_material([layer], *of_tube)]


@in_python
@pytest.mark.parametrize("tubes", [TUBES, *deep([(MORE_TUBES,)])], ids=["usual", "more"])
@pytest.mark.parametrize("law", LAWS)
def test_means_agree_with_adaptive_quadrature(law, tubes, mode):
    """Both moduli are differences of stress between two close states, for every law of the zoo."""
    problems = problems_of(law, tubes)
    assert len(problems) >= len(tubes)
    columns = zip(*(p.inputs.values() for p in problems), strict=True)
    found = np.transpose(means_of(law, mode)(*map(np.array, columns)))
    for values, problem in zip(found, problems, strict=True):
        largest = max(abs(x) for x in list(problem.inputs.values())[5:])
        allowed = [ENERGY_ROUNDING * largest, 0.0, 0.0]
        for value, exact, extra in zip(values, exact_means(problem), allowed, strict=True):
            assert abs(value - exact) <= TOLERANCE * abs(exact) + extra, problem.name


@pytest.mark.parametrize("law", LAWS)
def test_wall_at_rest_stores_nothing(law):
    """At rest the energy is 0, also of laws whose W is not, and isotropic moduli are 4 G."""
    parameters = list(next(p for p in PROBLEMS if p.law == law).inputs.values())[5:]
    at_rest = [np.array([x]) for x in (7.0, 7.0, 9.0, 1.0, 0.0, *parameters)]
    energy, around, along = (x.item() for x in means_of(law)(*at_rest))
    assert abs(energy) <= ENERGY_ROUNDING * max(map(abs, parameters))
    by_name = dict(zip(LAWS[law].entry_names, parameters, strict=True))
    shear = {"NeoHookean": "mu", "Gent": "mu", "Demiray": "mu", "PowerLawNeoHookean": "mu"}
    if law in shear:
        np.testing.assert_allclose([around, along], 4 * by_name[shear[law]], rtol=ROUNDING)
    if law == "Ogden":  # of which the shear modulus is 2 μ
        np.testing.assert_allclose([around, along], 8 * by_name["mu"], rtol=ROUNDING)


def test_thin_neo_hookean_wall():
    """``W = μ/2 (I₁ − 3)`` and ``C = 2 μ (λ² + λr²)`` where all of the wall is stretched alike."""
    mu, a, radius, axial = 20.0, 1.4, 1.0, 1.3
    inputs = (a, radius, radius * (1 + 1e-9), axial, 0.0, mu)
    found = [x.item() for x in means_of("NeoHookean")(*(np.array([x]) for x in inputs))]
    hoop, radial = a / radius, radius / (a * axial)
    expected = (
        mu / 2 * (radial**2 + hoop**2 + axial**2 - 3),
        2 * mu * (hoop**2 + radial**2),
        2 * mu * (axial**2 + radial**2),
    )
    np.testing.assert_allclose(found, expected, rtol=1e-8)  # of the thickness


def components(law, radial, hoop, axial, **parameters):
    """Baek's ``C_iijj = d²W/(d ln li d ln lj)`` of three independent stretches, by differences."""
    step = mp.mpf("1e-15")
    with mp.workdps(100):
        stretches = [mp.mpf(x) for x in (radial, hoop, axial)]

        def energy(*logs):
            return law.energy(
                *(x * mp.exp(e) for x, e in zip(stretches, logs, strict=True)), **parameters
            )

        found = np.empty((3, 3))
        for i in range(3):
            for j in range(3):
                total = mp.mpf(0)
                for s in (1, -1):
                    for t in (1, -1):
                        logs = [mp.mpf(0)] * 3
                        logs[i] += s * step
                        logs[j] += t * step
                        total += s * t * energy(*logs)
                found[i, j] = total / (4 * step**2)
        return found


@pytest.mark.parametrize("law", LAWS)
def test_moduli_combine_the_components_of_small_on_large(law):
    """``C_tttt − 2 C_ttrr + C_rrrr``: what eliminates the Lagrange multiplier at fixed ``s_rr``."""
    problem = problems_of(law, ("in vivo",))[0]
    a, axial = 0.58, 1.5
    entries = dict(list(problem.inputs.items())[5:])
    thin = (a, 0.4, 0.4 * (1 + 1e-9), axial, 0.0, *entries.values())
    _, around, along = (x.item() for x in means_of(law)(*(np.array([x]) for x in thin)))
    parts = components(LAWS[law], 0.4 / (a * axial), a / 0.4, axial, **entries)
    expected = [parts[i, i] - 2 * parts[i, 0] + parts[0, 0] for i in (1, 2)]
    np.testing.assert_allclose([around, along], expected, rtol=1e-6)  # of the thickness


def test_four_fibers_as_laboratories_report_them():
    """The published ``C_tttt`` of fibres in a neo-Hookean matrix is smaller by ``2 c lr²``.

    ``C_tttt = 2 (s_t − s_r + c lr²) + sum of 4 k1 lt⁴ cos⁴ (1 + 2 k2 E²) exp(k2 E²)`` over the
    families, after Baek et al. (2007), here with ``k1`` of our law.
    """
    parameters = LAWS["FourFiber"].parameters[0][0]
    hoop, axial = 1.5, 1.6
    radial = 1 / (hoop * axial)
    c = parameters["c"]
    families = [("hoop", 0.0, 1), ("axial", 90.0, 1), ("diagonal", parameters["beta"], 2)]
    stress, published = np.array([c * (x**2 - radial**2) for x in (hoop, axial)]), np.zeros(2)
    for name, angle, number in families:
        k1, k2 = parameters[f"k1_{name}"], parameters[f"k2_{name}"]
        along = np.array([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))]) ** 2
        squared = along * np.array([hoop, axial]) ** 2
        strain = squared.sum() - 1
        stress += number * 2 * k1 * strain * np.exp(k2 * strain**2) * squared
        published += (
            number * 4 * k1 * (1 + 2 * k2 * strain**2) * np.exp(k2 * strain**2) * squared**2
        )
    published += 2 * (stress + c * radial**2)
    thin = (hoop, 1.0, 1 + 1e-9, axial, 0.0, *parameters.values())
    _, *found = (x.item() for x in means_of("FourFiber")(*(np.array([x]) for x in thin)))
    np.testing.assert_allclose(found, published + 2 * c * radial**2, rtol=1e-7)  # of the thickness


def test_a_law_of_the_user_has_them_too():
    """Energy alone states a law: its moduli are those of the same law of the zoo."""

    class Fungs(ph.StrainEnergy):
        """Fung's law, by its energy."""

        parameters = ph.FungOrthotropic.parameters

        def energy(self, radial, hoop, axial, *, c, a1, a2, a4):
            around, along = (hoop**2 - 1) / 2, (axial**2 - 1) / 2
            exponent = a1 * around**2 + a2 * along**2 + 2 * a4 * around * along
            return c / 2 * (pt.exp(exponent) - 1)

    inputs = [np.array([x]) for x in (0.5, 0.4, 0.5, 1.5, 0.5, 25.0, 1.0, 0.5, 0.1)]
    symbols = pt.dvectors(len(inputs))
    own, zoo = (
        pytensor.function(
            symbols,
            MaterialIntegral(strain_energy=law)(*symbols, return_list=True),
            mode=AS_WRITTEN,
        )(*inputs)
        for law in (Fungs(), ph.FungOrthotropic())
    )
    np.testing.assert_allclose(own, zoo, rtol=ROUNDING)
