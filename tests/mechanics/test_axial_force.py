"""The reduced axial force and its derivative by the internal radius."""

import numpy as np
import oracles
import pytest
from problems import LAWS
from tiers import tiers
from wall_integrals import (
    assert_gradients_equal_difference_quotients,
    columns_of,
    compiled,
    problems_of,
)

# The documented accuracy, against adaptive quadrature.
FORCE_TOLERANCE = 1e-9
# Force is that in the wall less the thrust of the pressure on the ends, and may be far smaller than
# either: rounding is relative to the thrust.
ROUNDING = 1e-13


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
def test_axial_force_equals_adaptive_quadrature(law):
    tubes = ("at rest", "slackening, shortened")
    assert_equals_quadrature(law, problems_of(law, *tubes, ordinary=True))


@pytest.mark.deep
@pytest.mark.parametrize("law", LAWS)
def test_axial_force_of_all_problems_equals_adaptive_quadrature(law):
    assert_equals_quadrature(law, problems_of(law))


@pytest.mark.parametrize("law", tiers(LAWS, first=lambda law: law == "HolzapfelGasserOgden"))
def test_gradients_of_the_axial_force_equal_difference_quotients(law):
    """Forces of steeper materials lose digits to cancellation."""
    columns = columns_of(problems_of(law))
    pressure, stiffness = np.abs(compiled(law, "pressure")(*columns))
    thrust = np.pi * columns[0] ** 2 * (pressure + stiffness * columns[0])
    scales = [thrust, thrust / columns[0]]
    assert_gradients_equal_difference_quotients(law, "force", scales, ordinary=True)
