"""Stored energy and material stiffness of a wall: `mechanics/material.py`."""

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
FIRST_TUBES = ("slackening, stretched",)
# Laws differ in their energies and stresses alone, see test_strain_energy.py.
FIRST_LAWS = ("NeoHookean", "OgdenSeries(terms=2)", "FungOrthotropic", "HolzapfelGasserOgden")
MORE_TUBES = ("in vivo", "stretched", "shortened", "extreme", "slackening, shortened")


def means_of(law, *columns):
    """Return the means over the wall of the stored energy, the hoop and the axial modulus."""
    _, inner, outer, axial, angle, *_ = columns
    area = np.pi * (outer**2 - inner**2) * (2 * np.pi - angle) / (2 * np.pi * axial)
    return np.array(compiled(law, "material")(*columns)) / area


def assert_equals_quadrature(law, tubes):
    problems = problems_of(law, *tubes)
    found = means_of(law, *columns_of(problems))
    for values, problem in zip(found.T, problems, strict=True):
        entries = dict(list(problem.inputs.items())[5:])
        layer = oracles.Layer(LAWS[law].energy, entries, problem.outer_radius, LAWS[law].switches)
        angle = radians(problem.opening_angle)
        tube = problem.internal_radius, problem.inner_radius, problem.axial_stretch, angle
        exact = np.array([float(x) for x in oracles.layered_material([layer], *tube)])
        allowed = TOLERANCE * np.abs(exact)
        allowed[0] += ENERGY_ROUNDING * max(abs(x) for x in entries.values())
        assert (np.abs(values - exact) <= allowed).all(), problem.name


@pytest.mark.parametrize("law", tiers(LAWS, first=lambda law: law in FIRST_LAWS))
def test_means_equal_adaptive_quadrature(law):
    """The oracle's moduli are differences of stress between two close states."""
    assert_equals_quadrature(law, FIRST_TUBES)


@pytest.mark.deep
@pytest.mark.parametrize("law", LAWS)
def test_means_of_more_tubes_equal_adaptive_quadrature(law):
    assert_equals_quadrature(law, MORE_TUBES)


def test_wall_at_rest_stores_no_energy():
    """Also of laws whose energy at rest is not zero."""
    for law in (*FIRST_LAWS, "CriscioneType"):
        at_rest = columns_of(problems_of(law, "at rest"))
        energy, *_ = means_of(law, *at_rest)
        assert abs(energy) <= ENERGY_ROUNDING * max(np.abs(at_rest[5:]).max(), 1), law


def test_thin_neo_hookean_wall_has_its_closed_form():
    """``W = μ/2 (I₁ − 3)`` and ``C = 2 μ (λ² + λr²)``."""
    mu, a, radius, axial = 20.0, 1.4, 1.0, 1.3
    inputs = (a, radius, radius * (1 + 1e-9), axial, 0.0, mu)
    found = means_of("NeoHookean", *(np.array([x]) for x in inputs))[:, 0]
    hoop, radial = a / radius, radius / (a * axial)
    expected = (
        mu / 2 * (radial**2 + hoop**2 + axial**2 - 3),
        2 * mu * (hoop**2 + radial**2),
        2 * mu * (axial**2 + radial**2),
    )
    np.testing.assert_allclose(found, expected, rtol=1e-8)  # the relative thickness is 1e-9
