"""Kinematics of the tube: `mechanics/tube.py`."""

import mpmath as mp
import numpy as np
import pytest

from pymc_hyperelastic.mechanics import tube

# A dozen operations in double precision, each exact to 1.1e-16.
ROUNDING = 3e-15

INNER, OUTER = 3.0, 4.5
WALL = np.linspace(INNER, OUTER, 7)
STATES = {
    "at rest": (3.0, 1.0, 0.0),
    "deflated": (2.1, 1.0, 0.0),
    "shortened": (3.3, 0.8, 0.0),
    "opened": (2.9, 1.0, np.deg2rad(160)),
    "opened inwards": (2.9, 1.2, np.deg2rad(-40)),
    "inflated, stretched and opened": (5.1, 1.5, np.deg2rad(90)),
}


@pytest.fixture(params=STATES.values(), ids=STATES.keys())
def state(request):
    radius, axial, angle = request.param
    return radius, {"inner_radius": INNER, "axial_stretch": axial, "opening_angle": angle}


def test_deformed_wall_keeps_its_volume(state):
    """Between any two material circles; the inner one gets the internal radius."""
    internal_radius, geometry = state
    current = tube.current_radius(WALL, internal_radius, **geometry)
    sector = 2 * np.pi - geometry["opening_angle"]
    reference_volume = sector / 2 * np.diff(WALL**2)
    current_volume = np.pi * np.diff(current**2) * geometry["axial_stretch"]
    # A difference of squares loses a digit in walls as thin as a sixth of this one.
    np.testing.assert_allclose(current_volume, reference_volume, rtol=10 * ROUNDING)
    np.testing.assert_allclose(current[0], internal_radius, rtol=ROUNDING)
    closed = tube.opening_factor(geometry["opening_angle"]) * sector
    np.testing.assert_allclose(closed, 2 * np.pi, rtol=ROUNDING)


def test_radial_stretch_is_the_derivative_of_the_deformed_radius(state):
    """The product of the stretches is one; the hoop elongation follows from the hoop stretch."""
    internal_radius, geometry = state
    radial, hoop, axial = tube.stretches(WALL, internal_radius, **geometry)
    np.testing.assert_allclose(radial * hoop * axial, 1, rtol=ROUNDING)
    assert axial == geometry["axial_stretch"]
    step = 1e-5
    above, below = (
        tube.current_radius(WALL + x, internal_radius, **geometry) for x in (step, -step)
    )
    # The central difference errs by step**2 and by rounding over step, some 1e-10 each.
    np.testing.assert_allclose((above - below) / (2 * step), radial, rtol=1e-9)
    current = tube.current_radius(WALL, internal_radius, **geometry)
    # A circle of the sector, of angle 2π − Φ, becomes a full circle.
    length = (2 * np.pi - geometry["opening_angle"]) * WALL
    np.testing.assert_allclose(hoop, 2 * np.pi * current / length, rtol=ROUNDING)
    k = tube.opening_factor(geometry["opening_angle"])
    delta = tube.hoop_elongation(internal_radius, WALL, **geometry)
    np.testing.assert_allclose(k / axial * (1 + delta), hoop**2, rtol=ROUNDING)


@pytest.mark.parametrize("excess", [1e-9, -1e-15, 0.0])
def test_hoop_elongation_is_accurate_near_zero_pressure(excess):
    """A difference of squares would lose nine digits at ``a = A(1 + 1e-9)``."""
    internal_radius = INNER * (1 + excess)
    delta = tube.hoop_elongation(
        internal_radius, OUTER, inner_radius=INNER, axial_stretch=1.0, opening_angle=0.0
    )
    with mp.workdps(50):
        exact = (mp.mpf(internal_radius) ** 2 - mp.mpf(INNER) ** 2) / mp.mpf(OUTER) ** 2
    np.testing.assert_allclose(delta, float(exact), rtol=ROUNDING, atol=0)


def test_internal_radius_follows_from_the_outer_radius(state):
    internal_radius, geometry = state
    outer = tube.current_radius(OUTER, internal_radius, **geometry)
    back = tube.internal_radius_from_outer_radius(outer, outer_radius=OUTER, **geometry)
    # The difference of ro² and the area of the wall cancels, at most to a fifth here.
    np.testing.assert_allclose(back, internal_radius, rtol=5 * ROUNDING)


def test_invariants_equal_those_of_the_cauchy_green_tensor():
    """With eigenvalues ``x`` of the tensor, ``I₁`` is their sum, ``I₂`` that of their products."""
    rng = np.random.default_rng(20)  # any stretches will do
    hoop, axial = rng.uniform(0.6, 1.9, (2, 10))
    stretches = 1 / (hoop * axial), hoop, axial
    x, y, z = (stretch**2 for stretch in stretches)
    np.testing.assert_allclose(tube.first_invariant(*stretches), x + y + z, rtol=ROUNDING)
    second = x * y + y * z + z * x
    np.testing.assert_allclose(tube.second_invariant(*stretches), second, rtol=ROUNDING)


def ring_of(geometry):
    """Return the area and the middle line of the closed ring."""
    inner, outer, angle = (geometry[n] for n in ("inner_radius", "outer_radius", "opening_angle"))
    return (np.pi - angle / 2) * (outer**2 - inner**2), (2 * np.pi - angle) * (inner + outer) / 2


def test_opened_sectors_keep_area_and_middle_line_of_the_ring():
    ring = {"inner_radius": 1.0, "outer_radius": 1.3, "opening_angle": 0.0, "axial_stretch": 1.4}
    inner, outer = tube.opened_sector(1.0, 1.3, opening_angle=2.0)
    sector = ring | {"inner_radius": inner, "outer_radius": outer, "opening_angle": 2.0}
    for opened in (sector, tube.reopened(ring, 2.0), tube.reopened(sector, -0.7)):
        np.testing.assert_allclose(ring_of(opened), ring_of(ring), rtol=ROUNDING)
        assert opened["axial_stretch"] == 1.4
    assert tube.reopened(sector, -0.7)["opening_angle"] == -0.7


def test_outer_radius_follows_from_thickness_or_wall_area():
    """`measure_of` recovers the stated thickness, wall area and axial stretch."""
    stated = {"inner_radius": 1.0, "opening_angle": 1.5, "axial_stretch": 1.2}
    by_thickness = tube.inferred_geometry(stated | {"thickness": 0.25})
    assert by_thickness == stated | {"outer_radius": 1.25}
    area, _ = ring_of(by_thickness)
    by_area = tube.inferred_geometry(stated | {"wall_area": area})
    np.testing.assert_allclose(by_area["outer_radius"], 1.25, rtol=ROUNDING)
    ring = tube.inferred_geometry({"inner_radius": 1.0, "wall_area": np.pi * 0.21})
    np.testing.assert_allclose(ring["outer_radius"], 1.1, rtol=ROUNDING)
    np.testing.assert_allclose(tube.measure_of("wall_area", by_thickness), area, rtol=ROUNDING)
    assert tube.measure_of("thickness", by_thickness) == 0.25
    assert tube.measure_of("axial_stretch", by_thickness) == 1.2
    assert tube.inferred_geometry(stated) == stated
