"""Residuals of fits, in standard deviations of the measurement error, and offsets of forces."""

import fits
import numpy as np
import pytest
import xarray as xr
from figures import DATA, HELD_STRETCHES, MU, both_kinds, elements, fitted

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.likelihoods.errors import Errors
from pymc_hyperelastic.plots.residuals import Points, offsets_of, residuals_of
from pymc_hyperelastic.predictions.draws import draws_of

# Curves of the figure and of the predictions are the same numbers.
ROUNDING = 1e-9


def inflation_points(offsets=(0.0, 0.0)):
    """Return points of the first inflation test of a tube of three moduli, and its draws."""
    data = both_kinds(kinds=("inflation",))
    data["axial_force"] = data["axial_force"] + np.array(offsets)[data["test"].values]
    tests = ph.select(data, experiment=f"at {HELD_STRETCHES[0]:g}")
    tree = fitted(tests, mu=[[0.9 * MU, MU, 1.1 * MU]])
    draws = draws_of(tree)
    radius = tests["radius"].values
    return tree, Points(draws.tube, radius, tests, np.full(radius.size, np.nan))


@pytest.mark.parametrize("signal", ["pressure", "stiffness"])
def test_strips_show_residuals_in_standard_deviations_of_the_noise(few_draws, signal):
    tree = few_draws["C2"]
    figure = ph.plot_fit(tree, signal=signal, specimens=["S4"], residuals=True, backend="none")
    tests = ph.select(DATA, specimen="S4", experiment=[1, 2])
    curves = ph.predict_pressure(tree, tests["radius"].values)
    sigma, weight = fits.SLOPE_AUGMENTED.sigma, fits.SLOPE_AUGMENTED.slope_weight
    if signal == "pressure":
        measured, sd = tests["pressure"].values, sigma / np.sqrt(2)
    else:
        measured, sd = np.full(tests.sizes["obs"], np.nan), sigma / np.sqrt(2 * weight)
        for test in range(2):
            own = np.flatnonzero(tests["test"].values == test)
            r, p = tests["radius"].values[own], tests["pressure"].values[own]
            measured[own[1:-1]] = (p[2:] - p[:-2]) / (r[2:] - r[:-2])
    expected = ((measured - curves[signal]) / sd).median(["chain", "draw"]).values
    (points,) = elements(figure, "scatter", "residual")
    known = np.isfinite(points["y"])
    np.testing.assert_allclose(points["y"][known], expected[np.isfinite(expected)], rtol=ROUNDING)


def test_error_of_the_diameter_adds_to_that_of_the_pressure():
    tree, points = inflation_points()
    errors = Errors(pressure_sd=0.03, diameter_sd=0.02)
    found = residuals_of("pressure", points, errors)
    curves = ph.predict_pressure(tree, points.radius)
    noise = np.hypot(0.03, 0.01 * curves["stiffness"])
    expected = (points.tests["pressure"].values - curves["pressure"]) / noise
    np.testing.assert_allclose(found, expected.median(["chain", "draw"]), rtol=ROUNDING)


@pytest.mark.filterwarnings("ignore:.*extrapolated")
def test_error_of_the_diameter_adds_to_that_of_the_force():
    tree, points = inflation_points(offsets=(3.0, 0.0))
    found = residuals_of("axial_force", points, Errors(0.1, diameter_sd=0.02, force_sd=0.5))
    step = 1e-3
    force, low, high = (
        ph.predict_axial_force(tree, points.radius + shift)["axial_force"].values
        for shift in (0.0, -step, step)
    )
    noise = np.hypot(0.5, 0.01 * (high - low) / (2 * step))
    expected = np.median((points.tests["axial_force"].values - force) / noise, axis=(0, 1))
    np.testing.assert_allclose(found, expected, rtol=1e-5)  # of the difference quotient


def test_a_radius_above_its_curve_has_a_positive_residual():
    _, points = inflation_points()
    errors = Errors(pressure_sd=0.1)
    wider = points._replace(radius=points.radius + 0.05)
    assert np.all(residuals_of("extension_radius", wider, errors) > 0)
    assert np.all(residuals_of("pressure", wider, errors) < 0)


def test_offset_of_a_test_is_found_from_its_forces():
    _, points = inflation_points(offsets=(7.0, 0.0))
    wide, narrow = (Errors(0.1, force_sd=0.5, force_offset_sd=sd) for sd in (1e3, 1e-3))
    # The mean of the moduli is that of the data.
    np.testing.assert_allclose(offsets_of(points, wide), 7.0, atol=0.01)
    assert np.abs(offsets_of(points, narrow)).max() < 0.01


def test_specimen_of_a_class_has_its_own_noise():
    tree = fits.fit("hierarchical")["C1"]
    specimens, posterior = (tree[name].to_dataset() for name in ("specimens", "posterior"))
    particles = specimens.sizes["particle"]
    sizes = np.log([[0.1], [0.2], [0.3]])[:, :, None] * np.ones(particles)
    dims = ("specimen", "noise", "particle")
    specimens = specimens.drop_vars(["log_size", "noise"], errors="ignore")
    tree["specimens"] = xr.DataTree(
        specimens.assign(log_size=(dims, sizes)).assign_coords(noise=["pressure_sd"])
    )
    noise = {"pressure_sd": 0.2, "noise_spread": 0.5}
    draws = posterior["location"].isel(coordinate=0, drop=True)
    tree["posterior"] = xr.DataTree(
        posterior.assign({name: xr.full_like(draws, value) for name, value in noise.items()})
    )
    found = draws_of(tree, specimen="S2").member.posterior["pressure_sd"]
    np.testing.assert_allclose(found, 0.2)


def test_residuals_need_a_likelihood_that_uses_the_signal(few_draws):
    with pytest.raises(ValueError, match="does not state a likelihood that uses 'pressure'"):
        ph.plot_fit(fitted(both_kinds()), residuals=True, backend="none")
    with pytest.raises(ValueError, match="uses 'axial_force'"):
        ph.plot_fit(few_draws, signal="axial_force", residuals=True, backend="none")
