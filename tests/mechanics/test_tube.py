"""Kinematics of the tube: nothing here depends on a material."""

import mpmath as mp
import numpy as np
import pytensor.tensor as pt
import pytest

from pymc_hyperelastic.mechanics import tube

# A dozen operations in double precision, each right to 1.1e-16.
ROUNDING = 3e-15

INNER, OUTER = 3.0, 4.5
WALL = np.linspace(INNER, OUTER, 7)
STATES = {
    "at rest": (3.0, 1.0, 0.0),
    "inflated": (4.8, 1.0, 0.0),
    "deflated": (2.1, 1.0, 0.0),
    "stretched": (3.3, 1.9, 0.0),
    "shortened": (3.3, 0.8, 0.0),
    "opened": (2.9, 1.0, np.deg2rad(160)),
    "all": (5.1, 1.5, np.deg2rad(90)),
}


@pytest.fixture(params=STATES.values(), ids=STATES.keys())
def state(request):
    radius, axial, angle = request.param
    return radius, {"inner_radius": INNER, "axial_stretch": axial, "opening_angle": angle}


def test_opening_factor_closes_the_ring():
    """A sector that spans 2π − Φ is stretched to the full circle; without a cut nothing changes."""
    angle = np.deg2rad([0.0, 60.0, 160.0])
    np.testing.assert_allclose(
        tube.opening_factor(angle) * (2 * np.pi - angle), 2 * np.pi, rtol=ROUNDING
    )
    assert tube.opening_factor(0.0) == 1


def test_volume_is_preserved(state):
    """Between any two material circles the wall keeps its volume, cut or closed."""
    internal_radius, tube_state = state
    current = tube.current_radius(WALL, internal_radius, **tube_state)
    sector = 2 * np.pi - tube_state["opening_angle"]
    reference_volume = sector / 2 * np.diff(WALL**2)
    current_volume = np.pi * np.diff(current**2) * tube_state["axial_stretch"]
    # A difference of squares loses a digit in walls as thin as a sixth of this one.
    np.testing.assert_allclose(current_volume, reference_volume, rtol=10 * ROUNDING)


def test_inner_surface_moves_to_the_internal_radius(state):
    """The wall map takes A to a: that is what a means."""
    internal_radius, tube_state = state
    np.testing.assert_allclose(
        tube.current_radius(INNER, internal_radius, **tube_state), internal_radius, rtol=ROUNDING
    )


def test_product_of_stretches_is_one(state):
    """The material is incompressible, to the last digits."""
    internal_radius, tube_state = state
    radial, hoop, axial = tube.stretches(WALL, internal_radius, **tube_state)
    np.testing.assert_allclose(radial * hoop * axial, 1, rtol=ROUNDING)
    assert axial == tube_state["axial_stretch"]


def test_radial_stretch_is_the_slope_of_the_wall_map(state):
    """``λr = dr/dR``: the stretches belong to the map, and not only to each other."""
    internal_radius, tube_state = state
    radial, hoop, _ = tube.stretches(WALL, internal_radius, **tube_state)
    step = 1e-5
    difference = (
        tube.current_radius(WALL + step, internal_radius, **tube_state)
        - tube.current_radius(WALL - step, internal_radius, **tube_state)
    ) / (2 * step)
    # The central difference errs by step**2 and by rounding over step, some 1e-10 each.
    np.testing.assert_allclose(difference, radial, rtol=1e-9)
    current = tube.current_radius(WALL, internal_radius, **tube_state)
    k = tube.opening_factor(tube_state["opening_angle"])
    np.testing.assert_allclose(hoop, k * current / WALL, rtol=ROUNDING)


def test_hoop_elongation_is_the_excess_of_the_squared_stretch(state):
    """``λθ² = (k/λz)(1 + δ)`` through the whole wall."""
    internal_radius, tube_state = state
    _, hoop, axial = tube.stretches(WALL, internal_radius, **tube_state)
    k = tube.opening_factor(tube_state["opening_angle"])
    delta = tube.hoop_elongation(internal_radius, WALL, **tube_state)
    np.testing.assert_allclose(k / axial * (1 + delta), hoop**2, rtol=ROUNDING)


@pytest.mark.parametrize("excess", [1e-9, -1e-9, 1e-15, -1e-15, 0.0])
def test_hoop_elongation_keeps_its_digits_near_zero_pressure(excess):
    """At ``a = A(1 ± 1e-9)`` the excess has all its digits, where squares would lose nine."""
    internal_radius = INNER * (1 + excess)
    delta = tube.hoop_elongation(internal_radius, OUTER, inner_radius=INNER)
    with mp.workdps(50):
        exact = (mp.mpf(internal_radius) ** 2 - mp.mpf(INNER) ** 2) / mp.mpf(OUTER) ** 2
    np.testing.assert_allclose(delta, float(exact), rtol=ROUNDING, atol=0)


def test_outer_radius_gives_the_internal_radius_back(state):
    """A measured outer radius leads to the internal radius that produced it."""
    internal_radius, tube_state = state
    outer = tube.current_radius(OUTER, internal_radius, **tube_state)
    back = tube.internal_radius_from_outer_radius(outer, outer_radius=OUTER, **tube_state)
    # ro² − wall cancels, at most to a fifth here.
    np.testing.assert_allclose(back, internal_radius, rtol=5 * ROUNDING)


def test_invariants():
    """I₁ and I₂ are 3 at rest, symmetric, and swap when an isochoric stretch is inverted."""
    rng = np.random.default_rng(20)  # any stretches will do
    hoop, axial = rng.uniform(0.6, 1.9, (2, 10))
    radial = 1 / (hoop * axial)
    assert tube.first_invariant(1, 1, 1) == tube.second_invariant(1, 1, 1) == 3
    for invariant in (tube.first_invariant, tube.second_invariant):
        np.testing.assert_allclose(
            invariant(radial, hoop, axial), invariant(axial, radial, hoop), rtol=ROUNDING
        )
    np.testing.assert_allclose(
        tube.second_invariant(radial, hoop, axial),
        tube.first_invariant(1 / radial, 1 / hoop, 1 / axial),
        rtol=ROUNDING,
    )
    np.testing.assert_allclose(
        tube.first_invariant(radial, hoop, axial), radial**2 + hoop**2 + axial**2, rtol=ROUNDING
    )


def test_kinematics_take_symbolic_variables():
    """PyTensor variables pass through and give the numbers that NumPy gives."""
    internal_radius, angle = pt.dscalars("a", "angle")
    stretches = tube.stretches(
        WALL, internal_radius, inner_radius=INNER, axial_stretch=1.3, opening_angle=angle
    )
    expected = tube.stretches(WALL, 3.6, inner_radius=INNER, axial_stretch=1.3, opening_angle=1.0)
    for symbolic, number in zip(stretches[:2], expected[:2], strict=True):
        value = symbolic.eval({internal_radius: 3.6, angle: 1.0}, mode="FAST_COMPILE")
        np.testing.assert_allclose(value, number, rtol=ROUNDING)
