"""Posteriors of curves, and of radii at a pressure, are those of each draw."""

import numpy as np
import oracles
import pytest
import xarray as xr
from drawn import (
    SHEEP,
    SOFTENING,
    TUBES,
    curve,
    every_law,
    every_tube,
    fitted_tree,
    maximum_of_softening,
    one_draw,
    radii_of,
    result,
)
from problems import AS_WRITTEN, OGDEN_1972_RUBBER
from scipy.optimize import brentq

import pymc_hyperelastic as ph

pytestmark = pytest.mark.compiled  # predictions are compiled for each law

# What the package promises of its inverse: some digits less than the pressure it inverts.
INVERSE = 1e-10
# The same quantity by another compiled function, or from another formula of the same digits.
ROUNDING = 1e-12


# --- pressure and force at given radii -----------------------------------------------------------


@pytest.mark.parametrize(
    ("predict", "name", "function"),
    [
        (ph.predict_pressure, "pressure", ph.inflation_pressure),
        (ph.predict_pressure, "stiffness", ph.inflation_stiffness),
        (ph.predict_axial_force, "axial_force", ph.axial_force),
    ],
    ids=["pressure", "stiffness", "axial force"],
)
def test_curves_are_those_of_each_draw(predict, name, function):
    """Each draw has the pressure, stiffness and axial force of its parameters."""
    tree = result(mu=[4.0, 6.0, 5.0], alpha=[8.0, 12.0, -3.0])
    tube, radius = TUBES["in vivo"], [0.3, 0.5]
    found = predict(tree, radius, energy=ph.Ogden(), **tube)[name]
    assert found.dims == ("chain", "draw", "radius")
    assert found.attrs["units"] == {"pressure": "kPa", "stiffness": "kPa/mm"}.get(name, "mN")
    for draw in range(3):
        at = {n: float(tree["posterior"][n][0, draw]) for n in ("mu", "alpha")}
        expected = function(ph.Ogden(), radius, **tube, **at).eval(mode=AS_WRITTEN)
        np.testing.assert_allclose(found[0, draw], expected, rtol=ROUNDING)


@pytest.mark.parametrize("predict", [ph.predict_pressure, ph.predict_axial_force])
def test_vector_parameters(predict):
    """The series ``(2μ/α, α), (−2μ/α, −α)`` is the Ogden solid: vectors are read by entry."""
    mu, alpha = np.array([4.0, 6.0, 5.0]), np.array([8.0, 12.0, 3.0])
    signs = np.array([1.0, -1.0])
    series = result(mu=(2 * mu / alpha)[:, None] * signs, alpha=alpha[:, None] * signs)
    tube = TUBES["in vivo"]
    expected = predict(result(mu=mu, alpha=alpha), [0.3, 0.5], energy=ph.Ogden(), **tube)
    found = predict(series, [0.3, 0.5], energy=ph.OgdenSeries(2), **tube)
    xr.testing.assert_allclose(found, expected, rtol=1e-10)  # the series cancels some digits


def test_order_of_dimensions_does_not_matter():
    """A posterior by (draw, chain) gives what one by (chain, draw) gives."""
    tree = result(mu=[4.0, 6.0, 5.0], alpha=[8.0, 12.0, 3.0])
    turned = xr.DataTree.from_dict({"posterior": tree["posterior"].to_dataset().transpose()})
    found, expected = (
        ph.predict_pressure(t, [7.0, 8.0], energy=ph.Ogden(), **SHEEP) for t in (turned, tree)
    )
    xr.testing.assert_identical(found, expected)


# --- the tube of each draw -----------------------------------------------------------------------

INNER, THICKNESS = np.array([6.8, 7.0, 7.2]), np.array([1.9, 2.0, 2.2])
INFERRED = {
    "outer radius": {"outer_radius": INNER + THICKNESS},
    "thickness": {"thickness": THICKNESS},
    # What is cut open is a sector of the ring, and has its area.
    "wall area": {"wall_area": (1 - 0.3 / np.pi) * np.pi * ((INNER + THICKNESS) ** 2 - INNER**2)},
}


@pytest.mark.parametrize("wall", INFERRED.values(), ids=INFERRED)
def test_inferred_geometry_is_that_of_each_draw(wall):
    """Variables named like the geometry are the draw's own tube, in every function."""
    axial, angle = np.array([1.1, 1.2, 1.3]), np.full(3, 0.6)
    tree = result(
        mu=np.full(3, 20.0), inner_radius=INNER, axial_stretch=axial, opening_angle=angle, **wall
    )
    functions = (ph.predict_pressure, ph.predict_axial_force, ph.radius_at_pressure, ph.wall_stress)
    arguments = ([7.5, 8.0], [7.5, 8.0], [1.0, 2.0], [1.0, 2.0])
    for function, argument in zip(functions, arguments, strict=True):
        found = function(tree, argument, energy=ph.NeoHookean())
        for draw in range(3):
            tube = {
                "inner_radius": INNER[draw],
                "outer_radius": INNER[draw] + THICKNESS[draw],
                "axial_stretch": axial[draw],
                "opening_angle": angle[draw],
            }
            alone = function(result(mu=[20.0]), argument, energy=ph.NeoHookean(), **tube)
            for name in alone:
                np.testing.assert_allclose(
                    found[name][:, [draw]], alone[name], rtol=1e-10, atol=1e-12
                )


@pytest.mark.parametrize(
    ("given", "inferred", "outer"),
    [
        ({}, {}, 9.0),
        ({}, {"outer_radius": [8.5]}, 8.5),
        ({}, {"thickness": [1.0]}, 8.0),
        ({}, {"outer_radius": [8.5], "thickness": [1.0]}, 8.5),
        ({"outer_radius": 8.2}, {"thickness": [1.0]}, 8.2),
        ({"outer_radius": 8.2}, {"outer_radius": [8.5]}, 8.2),
    ],
)
def test_keyword_precedes_posterior_precedes_data(given, inferred, outer):
    """The caller's tube comes first, then that of the draw, then that of the data."""
    found = ph.predict_pressure(fitted_tree(mu=[20.0], **inferred), [8.0], **given)
    expected = oracles.neo_hookean_pressure(20.0, 8.0, 7.0, outer)
    np.testing.assert_allclose(found["pressure"].item(), expected, rtol=ROUNDING)


# --- the radius at a pressure --------------------------------------------------------------------


@every_tube
@every_law
def test_radius_is_the_inverse_of_pressure(energy, parameters, tube):
    """Pressures that were predicted at some radii give these radii back, deflated or inflated."""
    radius = radii_of(tube)
    pressure = curve(energy, parameters, radius, tube)
    tube = {**tube, "energy": energy, "check": "ignore"}
    found = ph.radius_at_pressure(one_draw(parameters), pressure, **tube)["radius"]
    assert found.dims == ("chain", "draw", "pressure")
    np.testing.assert_allclose(found[0, 0], radius, rtol=INVERSE)


@every_tube
def test_radius_against_the_closed_form(tube):
    """The radius of a neo-Hookean tube solves its closed form."""
    geometry = tuple(tube.values())
    tree = result(mu=[20.0, 35.0])
    top = min(oracles.neo_hookean_pressure(20.0, radii_of(tube)[-1], *geometry), 4.0)
    pressure = np.array([0.1, 0.5, 1.0]) * top
    found = ph.radius_at_pressure(tree, pressure, energy=ph.NeoHookean(), **tube)["radius"]
    for draw, mu in enumerate((20.0, 35.0)):
        for p, a in zip(pressure, found[0, draw].values, strict=True):

            def excess(x, mu=mu, p=p):
                return oracles.neo_hookean_pressure(mu, x, *geometry) - p

            expected = brentq(excess, a * 0.9, a * 1.1, xtol=1e-14, rtol=1e-14)
            np.testing.assert_allclose(a, expected, rtol=INVERSE)


def test_radius_at_rest_is_exact():
    """An isotropic tube without opening angle carries nothing at ``A/√λz``."""
    a = ph.radius_at_pressure(result(mu=[20.0]), 0.0, energy=ph.NeoHookean(), **SHEEP)
    assert a["radius"].item() == 7.0


def test_softening_curve_is_inverted_on_its_rising_branch():
    """Up to its maximum pressure a softening tube has the smaller one of two radii."""
    top_radius, top = maximum_of_softening()
    share = np.array([0.1, 0.5, 0.9, 0.999, 1 - 1e-8])
    found = ph.radius_at_pressure(
        one_draw(SOFTENING), share * top, energy=ph.PowerLawNeoHookean(), **SHEEP
    )["radius"][0, 0]
    assert np.all(np.diff(found) > 0)
    assert float(found[-1]) < top_radius
    again = curve(ph.PowerLawNeoHookean(), SOFTENING, found.values, SHEEP)
    np.testing.assert_allclose(again, share * top, rtol=INVERSE)


def test_pressure_that_is_not_reached():
    """It is NaN, a warning counts the draws, and an error says it if there is no other."""
    _, top = maximum_of_softening()
    tree = result(mu=[20.0, 40.0, 10.0], n=[0.3, 0.3, 0.3])
    settings = {"energy": ph.PowerLawNeoHookean(), **SHEEP}
    with pytest.warns(
        UserWarning, match=r"of 3 draws 1 do not reach .* mmHg.*, 2 do not"
    ) as caught:
        found = ph.radius_at_pressure(tree, [0.1, 0.9 * top, 1.1 * top], **settings)["radius"][0]
    assert caught[0].filename == __file__
    np.testing.assert_array_equal(
        np.isnan(found), [[False, False, True], [False] * 3, [False, True, True]]
    )
    with pytest.raises(ValueError, match=r"no draw reaches .* 100 kPa \(750.1 mmHg\), 200 kPa"):
        ph.radius_at_pressure(tree, [100.0, 200.0], check="ignore", **settings)
    with pytest.warns(UserWarning, match="2 do not reach"):
        properties = ph.tube_properties(tree, [1.1 * top], **settings)
    with pytest.warns(UserWarning, match="2 do not reach"):
        stress = ph.wall_stress(tree, [1.1 * top], **settings)
    for values in (*properties.values(), *stress.values()):
        np.testing.assert_array_equal(
            np.isnan(values[0]).any(axis=(1, 2)[: values.ndim - 2]), [True, False, True]
        )


def test_pressure_beyond_an_asymptote_is_not_reached():
    """A neo-Hookean tube carries ``μ k/λz ln(B/A)`` when it is infinitely wide, and no more."""
    limit = 20.0 * np.log(9 / 7)
    settings = {"energy": ph.NeoHookean(), **SHEEP}
    with pytest.warns(UserWarning, match="1 do not reach"):
        found = ph.radius_at_pressure(result(mu=[20.0]), [0.999 * limit, limit], **settings)
    assert np.isfinite(found["radius"][0, 0, 0])


def test_second_rising_branch_is_not_taken():
    """Rubber's pressure rises, falls and rises again: beyond the first maximum is no radius."""
    tube = {"inner_radius": 1.0, "outer_radius": 1.05}
    energy = ph.OgdenSeries(3)
    radius = np.linspace(1.0, 8.0, 1000)
    pressure = curve(energy, OGDEN_1972_RUBBER, radius, tube)
    top = int(np.argmax(np.diff(pressure) < 0))
    assert pressure.max() > 1.2 * pressure[top] > 1.2 * pressure[top + 50], "it is no such curve"
    with pytest.warns(UserWarning, match="1 do not reach"):
        found = ph.radius_at_pressure(
            one_draw(OGDEN_1972_RUBBER),
            float(pressure[top]) * np.array([0.99, 1.1]),
            energy=energy,
            **tube,
        )["radius"][0, 0]
    assert found[0] < radius[top]
    assert np.isnan(found[1])


def test_stresses_that_overflow_are_beyond_the_radius():
    """Gent's solid ends at a radius: pressures of any size are reached before, without warning."""
    tree = result(mu=[20.0], limit=[0.5])
    settings = {"energy": ph.Gent(), "check": "ignore", **SHEEP}
    found = ph.radius_at_pressure(tree, [1.0, 10.0, 1000.0], **settings)["radius"][0, 0]
    assert np.all(np.diff(found) > 0)
    back = curve(ph.Gent(), {"mu": 20.0, "limit": 0.5}, found.values, SHEEP)
    np.testing.assert_allclose(back, [1.0, 10.0, 1000.0], rtol=1e-6)  # ill-conditioned near the end
