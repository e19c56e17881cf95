"""Stored energy and material stiffness of a wall: `mechanics/integrals.py`."""

from math import radians

import numpy as np
import oracles
import pytest
from problems import LAWS
from tiers import tiers
from wall_integrals import columns_of, compiled, problems_of

# Against adaptive quadrature of differences in a hundred digits: the rule's own error, with
# exponents up to 60.
TOLERANCE = 1e-9
# An energy is a difference from that at rest: rounding is relative to the largest modulus.
ENERGY_ROUNDING = 1e-13

# At an axial stretch of exactly 1 axial fibres slacken, and have no modulus.
FIRST_TUBE = "slackening, stretched"
TUBES = (FIRST_TUBE, "in vivo", "stretched", "shortened", "extreme", "slackening, shortened")
# Laws differ in their energies and stresses alone, see test_strain_energy.py.
FIRST_LAWS = ("NeoHookean", "OgdenSeries(terms=2)", "FungOrthotropic", "HolzapfelGasserOgden")


def means_of(law, *columns):
    """Return the means over the wall of the stored energy, the hoop and the axial modulus."""
    _, inner, outer, axial, angle, *_ = columns
    area = np.pi * (outer**2 - inner**2) * (2 * np.pi - angle) / (2 * np.pi * axial)
    return np.array(compiled(law, "material")(*columns)) / area


@pytest.mark.parametrize("tube", tiers(TUBES, first=lambda tube: tube == FIRST_TUBE))
@pytest.mark.parametrize("law", tiers(LAWS, first=lambda law: law in FIRST_LAWS))
def test_mean_energy_and_moduli_of_a_wall_equal_adaptive_quadrature(law, tube):
    """The oracle's moduli are differences of stress between two close states."""
    problems = problems_of(law, tube)
    found = means_of(law, *columns_of(problems))
    for values, problem in zip(found.T, problems, strict=True):
        entries = dict(list(problem.inputs.items())[5:])
        layer = oracles.Layer(LAWS[law].energy, entries, problem.outer_radius, LAWS[law].switches)
        angle = radians(problem.opening_angle)
        state = problem.internal_radius, problem.inner_radius, problem.axial_stretch, angle
        exact = np.array([float(x) for x in oracles.layered_material([layer], *state)])
        allowed = TOLERANCE * np.abs(exact)
        allowed[0] += ENERGY_ROUNDING * max(abs(x) for x in entries.values())
        assert (np.abs(values - exact) <= allowed).all(), problem.name


def test_wall_at_rest_stores_no_energy():
    """The laws include one whose energy function at rest is not zero."""
    for law in (*FIRST_LAWS, "CriscioneType"):
        at_rest = columns_of(problems_of(law, "at rest"))
        energy, *_ = means_of(law, *at_rest)
        assert abs(energy) <= ENERGY_ROUNDING * max(np.abs(at_rest[5:]).max(), 1), law
