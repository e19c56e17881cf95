"""radius_at_pressure: the inverse of the pressure, and pressures that no radius has."""

import numpy as np
import pytest
from problems import OGDEN_1972_RUBBER
from tube_posteriors import (
    INVERSE,
    SHEEP,
    SOFTENING,
    curve,
    every_tube_and_law,
    maximum_of_softening,
    one_draw,
    radii_of,
    result,
)

import pymc_hyperelastic as ph

pytestmark = pytest.mark.compiled  # in both tiers: predictions are compiled for each law


def sheep(pressure) -> ph.Conditions:
    return ph.Conditions(pressure, tube=ph.Tube(**SHEEP))


@every_tube_and_law
def test_radius_is_the_inverse_of_pressure(energy, parameters, tube):
    radius = radii_of(tube)
    pressure = curve(energy, parameters, radius, tube)
    at = ph.Conditions(pressure, tube=ph.Tube(**tube))
    found = ph.radius_at_pressure(one_draw(parameters), at, energy=energy, check="ignore")["radius"]
    assert found.dims == ("chain", "draw", "pressure")
    np.testing.assert_allclose(found[0, 0], radius, rtol=INVERSE)


def test_radius_at_zero_pressure_is_exact():
    """An isotropic tube without opening angle carries nothing at ``A/√λz``."""
    a = ph.radius_at_pressure(result(mu=[20.0]), sheep(0.0), energy=ph.NeoHookean())
    assert a["radius"].item() == 7.0


def test_softening_curve_is_inverted_on_its_rising_branch():
    top_radius, top = maximum_of_softening()
    share = np.array([0.1, 0.5, 0.9, 0.999, 1 - 1e-8])
    found = ph.radius_at_pressure(
        one_draw(SOFTENING), sheep(share * top), energy=ph.PowerLawNeoHookean()
    )["radius"][0, 0]
    assert np.all(np.diff(found) > 0)
    assert float(found[-1]) < top_radius
    again = curve(ph.PowerLawNeoHookean(), SOFTENING, found.values, SHEEP)
    np.testing.assert_allclose(again, share * top, rtol=INVERSE)


def test_pressure_that_is_not_reached_is_nan_and_counted():
    _, top = maximum_of_softening()
    tree = result(mu=[20.0, 40.0, 10.0], n=[0.3, 0.3, 0.3])
    settings = {"energy": ph.PowerLawNeoHookean()}
    with pytest.warns(
        UserWarning, match=r"of 3 draws 1 do not reach .* mmHg.*, 2 do not"
    ) as caught:
        found = ph.radius_at_pressure(tree, sheep([0.1, 0.9 * top, 1.1 * top]), **settings)
    found = found["radius"][0]
    assert caught[0].filename == __file__
    np.testing.assert_array_equal(
        np.isnan(found), [[False, False, True], [False] * 3, [False, True, True]]
    )
    with pytest.raises(ValueError, match=r"no draw reaches .* 100 kPa \(750.1 mmHg\), 200 kPa"):
        ph.radius_at_pressure(tree, sheep([100.0, 200.0]), check="ignore", **settings)
    with pytest.warns(UserWarning, match="2 do not reach"):
        properties = ph.tube_properties(tree, sheep([1.1 * top]), **settings)
    with pytest.warns(UserWarning, match="2 do not reach"):
        stress = ph.wall_stress(tree, sheep([1.1 * top]), **settings)
    for values in (*properties.values(), *stress.values()):
        np.testing.assert_array_equal(
            np.isnan(values[0]).any(axis=(1, 2)[: values.ndim - 2]), [True, False, True]
        )


def test_pressure_beyond_the_asymptote_of_a_curve_is_not_reached():
    """A neo-Hookean tube carries ``μ k/λz ln(B/A)`` when it is infinitely wide, and no more."""
    limit = 20.0 * np.log(9 / 7)
    at = sheep([0.999 * limit, limit])
    with pytest.warns(UserWarning, match="1 do not reach"):
        found = ph.radius_at_pressure(result(mu=[20.0]), at, energy=ph.NeoHookean())
    assert np.isfinite(found["radius"][0, 0, 0])


def test_radius_on_a_second_rising_branch_is_not_returned():
    tube = {"inner_radius": 1.0, "outer_radius": 1.05}
    energy = ph.OgdenSeries(3)
    radius = np.linspace(1.0, 8.0, 1000)
    pressure = curve(energy, OGDEN_1972_RUBBER, radius, tube)
    top = int(np.argmax(np.diff(pressure) < 0))
    assert pressure.max() > 1.2 * pressure[top] > 1.2 * pressure[top + 50], "it is no such curve"
    with pytest.warns(UserWarning, match="1 do not reach"):
        at = ph.Conditions(float(pressure[top]) * np.array([0.99, 1.1]), tube=ph.Tube(**tube))
        found = ph.radius_at_pressure(one_draw(OGDEN_1972_RUBBER), at, energy=energy)
    found = found["radius"][0, 0]
    assert found[0] < radius[top]
    assert np.isnan(found[1])


def test_radius_is_found_below_the_radius_where_stress_overflows():
    parameters = {"mu": 20.0, "limit": 0.5}
    settings = {"energy": ph.Gent(), "check": "ignore"}
    found = ph.radius_at_pressure(one_draw(parameters), sheep([1.0, 10.0, 1000.0]), **settings)
    found = found["radius"][0, 0]
    assert np.all(np.diff(found) > 0)
    back = curve(ph.Gent(), parameters, found.values, SHEEP)
    np.testing.assert_allclose(back, [1.0, 10.0, 1000.0], rtol=1e-6)  # ill-conditioned near the end
