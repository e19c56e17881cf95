"""The reduced axial force and its derivative by the internal radius."""

import numpy as np
import oracles
import pytest
from problems import AS_WRITTEN, LAWS
from tiers import tiers
from wall_integrals import (
    assert_gradients_equal_difference_quotients,
    columns_of,
    compiled,
    problems_of,
)

import pymc_hyperelastic as ph

# The documented accuracy, against adaptive quadrature.
FORCE_TOLERANCE = 1e-9
# Force is that in the wall less the thrust of the pressure on the ends, and may be far smaller than
# either: rounding is relative to the thrust.
ROUNDING = 1e-13
# Two formulas for one number: rounding, with exponents up to 60.
IDENTITY_TOLERANCE = 1e-12


def assert_equals_quadrature(law, problems):
    forces, _ = compiled(law, "force")(*columns_of(problems))
    for force, problem in zip(forces, problems, strict=True):
        if problem.tube == "at rest":
            assert force == 0
            continue
        exact = problem.exact(quantity=oracles.layered_force)
        thrust = np.pi * problem.internal_radius**2 * abs(problem.exact())
        allowed = FORCE_TOLERANCE * abs(exact) + ROUNDING * thrust
        assert abs(force - exact) <= allowed, problem.name


@pytest.mark.parametrize("law", LAWS)
def test_force_equals_adaptive_quadrature(law):
    tubes = ("at rest", "slackening, shortened")
    assert_equals_quadrature(law, problems_of(law, *tubes, ordinary=True))


@pytest.mark.deep
@pytest.mark.parametrize("law", LAWS)
def test_force_of_all_problems_equals_adaptive_quadrature(law):
    assert_equals_quadrature(law, problems_of(law))


@pytest.mark.parametrize("law", tiers(LAWS, first=lambda law: law == "HolzapfelGasserOgden"))
def test_gradients_equal_difference_quotients(law):
    """Forces of steeper materials lose digits to cancellation."""
    columns = columns_of(problems_of(law))
    pressure, stiffness = np.abs(compiled(law, "pressure")(*columns))
    thrust = np.pi * columns[0] ** 2 * (pressure + stiffness * columns[0])
    scales = [thrust, thrust / columns[0]]
    assert_gradients_equal_difference_quotients(law, "force", scales, ordinary=True)


@pytest.mark.parametrize("axial_stretch", [0.8, 1.5])
def test_mooney_rivlin_tube_has_its_closed_forms(axial_stretch):
    r"""Pressure and axial force of an extended, inflated Mooney-Rivlin tube are Rivlin's.

    With ``g = a^2 - A^2/l_z`` the pressure is that of a neo-Hookean tube of the modulus
    ``2 (c10 + c01 l_z^2)``, and

        F = (2 pi/l_z) {c10 [l_z^2 (B^2 - A^2) - S] + c01 [l_z^2 S - (B^2 - A^2)/l_z^2]},
        S = (B^2 - A^2)/l_z + g ln(B a/(A b)).

    Source: R. S. Rivlin, Large elastic deformations of isotropic materials VI, Philosophical
    Transactions of the Royal Society A 242 (1949) 173-195.
    """
    a, inner, outer, z, c10, c01 = 1.4, 1.0, 1.8, axial_stretch, 80.0, 20.0
    tube = {"inner_radius": inner, "outer_radius": outer, "axial_stretch": z}
    pressure, force = (
        float(function(ph.MooneyRivlin(), a, **tube, c10=c10, c01=c01).eval(mode=AS_WRITTEN))
        for function in (ph.inflation_pressure, ph.axial_force)
    )
    exact = oracles.neo_hookean_pressure(2 * (c10 + c01 * z**2), a, inner, outer, z)
    assert pressure == pytest.approx(exact, rel=IDENTITY_TOLERANCE)
    wall = outer**2 - inner**2
    b = (a**2 + wall / z) ** 0.5
    s = wall / z + (a**2 - inner**2 / z) * np.log(outer * a / (inner * b))
    exact = 2 * np.pi / z * (c10 * (z**2 * wall - s) + c01 * (z**2 * s - wall / z**2))
    assert force == pytest.approx(exact, rel=IDENTITY_TOLERANCE)
