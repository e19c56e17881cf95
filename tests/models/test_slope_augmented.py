"""The likelihood of pressures and slopes (SlopeAugmented): value, normaliser, gradient, limits."""

from itertools import product

import exact
import numpy as np
import pandas as pd
import pymc as pm
import pytensor
import pytensor.tensor as pt
import pytest
from problems import AS_WRITTEN
from sheet_tables import by_hand, joint_by_hand
from tables import SECTOR
from tiers import deep

import pymc_hyperelastic as ph
from pymc_hyperelastic.data.sheets import tubes_of

# Both sides are exact to about 1e-12 of the largest pressure, which enters as a square.
LIKELIHOOD_TOLERANCE = 1e-9
# Central differences with a step relative to the parameter err by its square, times a few dozen.
STEP, GRADIENT_TOLERANCE = 1e-4, 1e-5
# Sums of the same terms in another order.
ROUNDING = 1e-12
SIGMA, SLOPE_WEIGHT = 15 * ph.mmHg, 3.2


def tube_frame(specimen, inner, outer, axial, angle, *, points=9, seed=1):
    """Invented readings of a stiffening tube, from below its unloaded radius to 1.5 times it."""
    rng = np.random.default_rng(seed)
    growth = np.sort(rng.uniform(0.92, 1.5, points))
    pressure = 12 * (np.exp(2.2 * (growth - 1)) - 1) + 0.2 * rng.standard_normal(points)
    frame = pd.DataFrame({"radius": inner * growth, "pressure": pressure})
    names = {"inner": inner, "outer": outer, "axial": axial, "angle": angle}
    frame = frame.assign(specimen=specimen, experiment=1, **names)
    k = 360 / (360 - angle)
    outside = np.sqrt(frame["radius"] ** 2 + (outer**2 - inner**2) / (k * axial))
    frame["outer_diameter"] = 2 * outside
    frame["axial_force"] = np.where(np.arange(points) % 3, 10 * inner**2 * growth, np.nan)
    return frame


def dataset(*frames, measured="radius"):
    tube = ph.Tube("inner", "outer", axial_stretch="axial", opening_angle="angle", **SECTOR)
    return ph.inflation_data(
        pd.concat(frames, ignore_index=True),
        tube,
        angle_unit="deg",
        measured=measured,
        check="ignore",
    )


FRAMES = (
    tube_frame("plain", 7.0, 9.0, 1.0, 0.0),
    tube_frame("stretched", 0.4, 0.52, 1.5, 90.0, seed=2),
    tube_frame("shortened", 3.0, 5.1, 0.9, 0.0, points=6, seed=3),
    tube_frame("opened", 3.0, 4.0, 1.0, 140.0, points=12, seed=4),
)
MIXED = dataset(*FRAMES)


def likelihood_of(energy, data=MIXED, gradient=False, **settings):
    """Compile the log likelihood as a function of the parameters and of the unknown noise."""
    errors = {"sigma": SIGMA, "slope_weight": SLOPE_WEIGHT}
    errors |= {name: settings.pop(name) for name in errors if name in settings}

    def uniform(name, ends):
        return pm.Uniform(name, *ends, default_transform=None)

    with pm.Model() as model:
        parameters = {p.name: uniform(p.name, p.prior_range) for p in energy.parameters}
        errors = {n: uniform(n, v) if isinstance(v, tuple) else v for n, v in errors.items()}
        likelihood = ph.SlopeAugmented(**errors)
        ph.inflation_likelihood("curves", energy, data, likelihood, parameters, **settings)
    (value,) = model.replace_rvs_by_values([model["curves"]])
    outputs = [value, *(pytensor.grad(value, model.value_vars) if gradient else ())]
    function = pytensor.function(model.value_vars, outputs, mode=AS_WRITTEN)
    return function if gradient else lambda *point: function(*point)[0]


def points_of(energy, count=10):
    """Corners of the default prior, moved inwards by a millionth, and draws from it."""
    low, high = np.array([p.prior_range for p in energy.parameters]).T
    middle, half = (low + high) / 2, (high - low) / 2 * (1 - 1e-6)
    corners = [middle + half * sign for sign in product((-1, 1), repeat=len(middle))]
    draws = np.random.default_rng(5).uniform(low, high, (count, len(low)))
    return np.concatenate([corners, draws])


def exact_likelihood(energy, points, data=MIXED, **noise):
    noise = {"sigma": SIGMA, "slope_weight": SLOPE_WEIGHT} | noise
    return exact.log_likelihood(exact.curves_of(data), energy.name, *np.transpose(points), **noise)


LAWS = {energy.name: energy for energy in (ph.PowerLawNeoHookean(), ph.Ogden(), ph.CriscioneType())}


@pytest.mark.parametrize(
    ("law", "slope_weight", "mode"),
    [
        ("PowerLawNeoHookean", SLOPE_WEIGHT, "collocation"),
        ("Ogden", 0, "collocation"),
        ("CriscioneType", SLOPE_WEIGHT, "quadrature"),
    ],
)
def test_likelihood_is_exact_over_the_whole_prior(law, slope_weight, mode):
    """For tubes of different radii, stretches and angles; at the corners pressures reach 1e10."""
    energy = LAWS[law]
    function = likelihood_of(energy, slope_weight=slope_weight, mode=mode)
    points = points_of(energy)
    expected = exact_likelihood(energy, points, slope_weight=slope_weight)
    found = [function(*point) for point in points]
    np.testing.assert_allclose(found, expected, rtol=LIKELIHOOD_TOLERANCE)


def test_normaliser_of_inferred_noise_is_exact():
    """For noise from far too small to far too large, any slope weight, and many points."""
    step = np.random.default_rng(1).uniform(0.5, 1.5, 400)
    many = tube_frame("many", 7.0, 9.0, 1.0, 0.0, points=400)
    data = dataset(many.assign(radius=np.cumsum(step) / 100 + 6), FRAMES[1])
    energy, point = ph.Ogden(), [30.0, 7.0]
    function = likelihood_of(energy, data, sigma=(0.0, 100.0), slope_weight=(0.0, 1e5))
    for sigma, weight in product((0.01, 2.0, 90.0), (1e-6, 1e-2, 3.2, 1e3)):
        expected = exact_likelihood(energy, [point], data, sigma=sigma, slope_weight=weight)
        found = function(*point, sigma, weight)
        np.testing.assert_allclose(found, expected[0], rtol=LIKELIHOOD_TOLERANCE)


@pytest.mark.parametrize("mode", ["collocation", "quadrature"])
def test_gradient_equals_differences_of_the_exact_likelihood(mode):
    noise = {"sigma": (0.0, 100.0), "slope_weight": (0.0, 1e4)}
    function = likelihood_of(ph.Ogden(), gradient=True, mode=mode, **noise)
    for point in ([6.0, 8.0, SIGMA, SLOPE_WEIGHT], [30.0, -3.0, 1.0, 0.1]):
        _, *gradient = function(*point)
        for i, found in enumerate(gradient):
            ends = np.array([point, point])
            ends[:, i] *= 1 + STEP, 1 - STEP
            up, down = (
                exact_likelihood(ph.Ogden(), [end[:2]], sigma=end[2], slope_weight=end[3])[0]
                for end in ends
            )
            slope = (up - down) / (2 * STEP * point[i])
            assert found == pytest.approx(slope, rel=GRADIENT_TOLERANCE)


def test_likelihood_accepts_numbers_for_parameters_and_geometry():
    """Numbers keep double precision, and a stated measure of the tube replaces the data's."""
    data, likelihood = dataset(FRAMES[0]), ph.SlopeAugmented(SIGMA, SLOPE_WEIGHT)
    parameters = {"mu": 30, "alpha": 6.7, "inner_radius": pt.constant(7.1)}
    with pm.Model() as model:
        ph.inflation_likelihood("curves", ph.Ogden(), data, likelihood, parameters)
    moved = data.assign(inner_radius=("test", [7.1]))
    expected = exact_likelihood(ph.Ogden(), [[30.0, 6.7]], moved)
    found = model["curves"].eval(mode=AS_WRITTEN)
    np.testing.assert_allclose(found, expected[0], rtol=LIKELIHOOD_TOLERANCE)


UNBOUNDED = {"mu": pm.Normal.dist(0, 50), "n": pm.Normal.dist(0, 10), "a": pm.Normal.dist(0, 50)}
UNBOUNDED |= {"alpha": pm.Normal.dist(0, 10), "b": pm.Normal.dist(0, 10)}
EXTREMES = (-1000.0, -710.0, -1.0, -1e-12, 0.0, 1e-12, 1.0, 710.0, 1000.0)


@pytest.mark.parametrize(
    ("law", "mode", "unbounded"),
    [
        ("Ogden", "collocation", False),
        ("CriscioneType", "collocation", True),
        *deep([("PowerLawNeoHookean", "quadrature", True)]),
    ],
)
def test_extreme_parameters_never_give_nan(law, mode, unbounded):
    """The log-likelihood is a number, or minus infinity with a gradient of 0."""
    energy = LAWS[law]
    priors = {n: UNBOUNDED[n] for n in energy.parameter_names} if unbounded else None
    likelihood = ph.SlopeAugmented(SIGMA, SLOPE_WEIGHT)
    model = ph.inflation_model(energy, MIXED, likelihood, priors=priors, mode=mode)
    (likelihood,) = model.replace_rvs_by_values([model["likelihood"]])
    inputs = model.value_vars
    # Simplified, as in a sampler: unconstrained coordinates reach the limits of sigmoids.
    outputs = [likelihood, *pytensor.grad(likelihood, inputs)]
    function = pytensor.function(inputs, outputs, mode="FAST_COMPILE")
    rejected = 0
    with np.errstate(all="ignore"):
        for point in product(EXTREMES, repeat=len(inputs)):
            value, *gradient = function(*point)
            assert not np.isnan(value) and value < np.inf, point
            assert np.all(np.isfinite(gradient)), point
            if value == -np.inf:
                rejected += 1
                assert not np.any(gradient), point
    assert (rejected > 0) == unbounded


def test_balanced_slope_weight_is_the_ratio_of_squared_pressures_and_slopes():
    curves = exact.curves_of(MIXED)
    pressures = sum(np.sum(c.pressure**2) for c in curves)
    slopes = sum(np.sum((c.differences() @ c.pressure) ** 2) for c in curves)
    assert ph.balanced_slope_weight(MIXED) == pytest.approx(pressures / slopes, rel=ROUNDING)


def test_balanced_slope_weight_leaves_out_tests_of_sheets():
    joint, tubes = joint_by_hand(), tubes_of(joint_by_hand())
    assert ph.balanced_slope_weight(joint) == ph.balanced_slope_weight(tubes)
    with pytest.raises(ValueError, match="tests of sheets only, which have no slopes"):
        ph.balanced_slope_weight(by_hand())
