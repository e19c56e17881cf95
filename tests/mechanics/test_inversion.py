"""The radius at a pressure: the inverse of the pressure, its gradient, and as the error of data."""

from contextlib import nullcontext

import numpy as np
import pandas as pd
import pymc as pm
import pytensor
import pytensor.tensor as pt
import pytest
from problems import AS_WRITTEN
from pytensor.graph.replace import vectorize_graph
from scipy.optimize import brentq
from tables import SECTOR
from tiers import deep

import pymc_hyperelastic as ph
from pymc_hyperelastic.mechanics.inversion import RadiusAtPressure

# Newton's method has converged to rounding of the pressure, by the slope of a stiff tube.
ROUNDING = 1e-12
# A sum of squares of radii that two methods find to that.
LIKELIHOOD_TOLERANCE = 1e-10
# Central differences with this step, relative to the largest derivative in comparable units.
STEP, DIFFERENCE_TOLERANCE = 1e-5, 1e-6

INNER, THICKNESS, AXIAL, ANGLE = 1.0, 0.4, 1.1, 0.8
OGDEN = {"mu": 6.0, "alpha": 8.0}
# Thickness, and the entries of the parameters, of each layer from the inside out.
WALLS = {
    "one material": ((ph.Ogden(), THICKNESS, (6.0, 8.0)),),
    "two layers": (
        (ph.NeoHookean(), 0.25, (20.0,)),
        (ph.OgdenSeries(terms=2), 0.15, (4.0, 1.0, 6.0, 10.0)),
    ),
}
# From some way inside the tube at rest to far inflated.
RADII = np.array([0.85, 1.0, 1.2, 1.5])


def overflows(mode):
    """A graph that is not simplified may overflow, and say so, where its value is turned down."""
    return np.errstate(all="ignore") if mode is AS_WRITTEN else nullcontext()


def op_and_inputs(wall):
    """The inverse of a wall, and its inputs but for pressure and the radius to start from."""
    layers = WALLS[wall]
    inputs = [INNER, AXIAL, ANGLE]
    for _, thickness, entries in layers:
        inputs += [thickness, *entries]
    return RadiusAtPressure(strain_energies=tuple(energy for energy, *_ in layers)), inputs


def pressure_at(wall, radius, inputs):
    """Pressure of the wall by the public function."""
    inner, axial, angle, *rest = inputs
    layers = []
    for energy, *_ in WALLS[wall]:
        thickness, *entries = rest[: 1 + len(energy.entry_names)]
        rest = rest[1 + len(entries) :]
        joined = energy.join(entries)
        named = {k: np.array(v) if isinstance(v, tuple) else v for k, v in joined.items()}
        layers.append(ph.Layer(energy, thickness, **named))
    tube = {"inner_radius": inner, "axial_stretch": axial, "opening_angle": angle}
    return ph.inflation_pressure(layers, radius, **tube).eval(mode=AS_WRITTEN)


@pytest.fixture(params=[AS_WRITTEN, *deep(["FAST_COMPILE"])], ids=["as written", "simplified"])
def mode(request):
    """How a graph is evaluated a few times: it takes long to simplify twenty steps of Newton's."""
    return request.param


@pytest.mark.parametrize("wall", WALLS)
def test_it_is_the_inverse_of_the_pressure(wall, mode):
    """From a start some way off it finds the radius that has the pressure, and says so."""
    op, inputs = op_and_inputs(wall)
    pressure = pressure_at(wall, RADII, inputs)
    radius, last_step = (x.eval(mode=mode) for x in op(pressure, RADII * 1.08, *inputs))
    np.testing.assert_allclose(radius, RADII, rtol=ROUNDING)
    assert np.all(last_step < ROUNDING)


@pytest.mark.parametrize("wall", WALLS)
def test_gradient_is_that_of_the_exact_radius(wall, mode):
    """By every input but the start, which has none, it is a difference of exact radii."""
    op, numbers = op_and_inputs(wall)
    pressure = float(pressure_at(wall, 1.3, numbers))
    numbers = np.array([pressure, 1.3, *numbers])
    symbols = [pt.dscalar() for _ in numbers]
    radius, _ = op(*symbols)
    function = pytensor.function(symbols, [radius, *pytensor.grad(radius, symbols)], mode=mode)
    found = np.array(function(*numbers)[1:]) * numbers
    expected = np.zeros(len(numbers))
    for i in range(len(numbers)):
        step = np.zeros(len(numbers))
        step[i] = STEP * numbers[i]
        expected[i] = (function(*numbers + step)[0] - function(*numbers - step)[0]) / (2 * STEP)
    assert found[1] == 0
    np.testing.assert_allclose(
        found, expected, rtol=0, atol=DIFFERENCE_TOLERANCE * np.abs(expected).max()
    )


def test_a_batch_is_a_loop(mode):
    """Vectorised over parameters and tubes, every row is what it is alone."""
    op, numbers = op_and_inputs("one material")
    pressure, start = pressure_at("one material", RADII, numbers), RADII * 1.05
    mu, inner = pt.dscalar(), pt.dscalar()
    inputs = [inner, *numbers[1:4], mu, numbers[5]]
    outputs = list(op(pressure, start, *inputs))
    batch = {mu: pt.dvector(), inner: pt.dvector()}
    values = np.array([6.0, 9.0, 5.0]), np.array([1.0, 0.9, 1.1])
    alone = pytensor.function([mu, inner], outputs, mode=mode)
    together = pytensor.function([*batch.values()], vectorize_graph(outputs, batch), mode=mode)
    rows = [alone(*row) for row in zip(*values, strict=True)]
    for found, expected in zip(together(*values), zip(*rows, strict=True), strict=True):
        # The length of the last step is rounding itself.
        np.testing.assert_allclose(found, np.stack(expected), rtol=ROUNDING, atol=ROUNDING)


def test_a_pressure_that_is_never_reached_says_so(mode):
    """A tube that softens has a highest pressure; beyond it the last step is not small."""
    op = RadiusAtPressure(strain_energies=(ph.NeoHookean(),))
    _, last_step = op(np.array([1.0, 100.0]), 1.2, INNER, 1.0, 0.0, THICKNESS, 10.0)
    reached, beyond = last_step.eval(mode=mode)
    assert reached < ROUNDING
    assert beyond > 1


# --- the error in the radius ---------------------------------------------------------------------

SIGMA = 0.03
RADIUS = np.array([1.05, 1.2, 1.3, 1.38])
PRESSURE = np.array([1.2, 5.0, 9.0, 14.0])
K = 2 * np.pi / (2 * np.pi - ANGLE)


def outer_of(radius, inner=INNER, outer=INNER + THICKNESS):
    return np.sqrt(radius**2 + (outer**2 - inner**2) / (K * AXIAL))


def data(measured, *, pressure=PRESSURE, **geometry) -> ph.inflation_data:
    frame = pd.DataFrame({"specimen": "S", "experiment": 1, "radius": RADIUS})
    frame["pressure"], frame["outer_diameter"] = pressure, 2 * outer_of(RADIUS)
    known = {"inner_radius": INNER, "outer_radius": INNER + THICKNESS}
    known |= {"axial_stretch": AXIAL, "opening_angle": ANGLE, "measured": measured}
    return ph.inflation_data(frame, **known | geometry, **SECTOR)


def function_of(model, mode, *, gradient=True):
    """Likelihood, and its gradient, as a function of variables without bounds."""
    (value,) = model.replace_rvs_by_values([model["likelihood"]])
    inputs = model.value_vars
    outputs = [value, *(pytensor.grad(value, inputs) if gradient else ())]
    return pytensor.function(inputs, outputs, mode=mode)


def priors_of(energy):
    return {p.name: pm.Normal.dist(0, 50) for p in energy.parameters}


def exact_likelihood(measured, inner, outer):
    """By bisection of the pressure of each point."""
    tube = {"inner_radius": inner, "outer_radius": outer}
    tube |= {"axial_stretch": AXIAL, "opening_angle": ANGLE}
    symbol = pt.dscalar()
    curve = pytensor.function(
        [symbol], ph.inflation_pressure(ph.Ogden(), symbol, **tube, **OGDEN), mode=AS_WRITTEN
    )
    radius = np.array(
        [brentq(lambda a, p=p: float(curve(a)) - p, 0.7, 2.0, xtol=1e-14) for p in PRESSURE]
    )
    if measured == "radius":
        error = radius - RADIUS
    else:
        error = outer_of(radius, inner, outer) - outer_of(RADIUS)
    normaliser = -len(error) / 2 * np.log(np.pi * SIGMA**2)
    return normaliser - np.sum(error**2) / SIGMA**2


@pytest.mark.parametrize("measured", ["radius", *deep(["outer_diameter"])])
def test_likelihood_of_radii(measured, mode):
    """Differences of the radius that was measured, normalised; geometry is known or inferred."""
    settings = {"sigma": SIGMA, "slope_weight": 0, "error_in": "radius"}
    known = ph.inflation_model(ph.Ogden(), data(measured), priors=priors_of(ph.Ogden()), **settings)
    (value,) = function_of(known, mode, gradient=False)(*OGDEN.values())
    np.testing.assert_allclose(
        value, exact_likelihood(measured, INNER, INNER + THICKNESS), rtol=LIKELIHOOD_TOLERANCE
    )

    geometry = {"inner_radius": pm.Normal.dist(1, 1), "thickness": pm.Normal.dist(1, 1)}
    unknown = data(measured, inner_radius=None, outer_radius=None)
    inferred = ph.inflation_model(
        ph.Ogden(), unknown, priors=priors_of(ph.Ogden()), geometry=geometry, **settings
    )
    function = function_of(inferred, mode)
    point = np.array([*OGDEN.values(), 0.97, 0.43])
    value, *gradient = function(*point)
    np.testing.assert_allclose(
        value, exact_likelihood(measured, 0.97, 0.97 + 0.43), rtol=LIKELIHOOD_TOLERANCE
    )
    expected = []
    for step in np.diag(STEP * point):
        expected.append((function(*point + step)[0] - function(*point - step)[0]) / (2 * STEP))
    np.testing.assert_allclose(
        gradient * point, expected, rtol=0, atol=DIFFERENCE_TOLERANCE * np.abs(expected).max()
    )

    # Walls that are not there, or have no room, are impossible, and a sampler turns back.
    for inner, thickness in ((-1.0, 0.4), (1.0, -0.4), (0.0, 0.4), (1e3, 1e3), (1e-9, 50.0)):
        with overflows(mode):
            value, *gradient = function(*OGDEN.values(), inner, thickness)
        assert value == -np.inf, (inner, thickness)
        assert np.all(np.isfinite(gradient)), (inner, thickness)


def test_pressures_out_of_reach_are_impossible(mode):
    """The neo-Hookean tube bursts below the measured pressures: minus infinity, gradient zero."""
    model = ph.inflation_model(
        ph.NeoHookean(),
        data("outer_diameter"),
        sigma=SIGMA,
        slope_weight=0,
        error_in="radius",
        priors=priors_of(ph.NeoHookean()),
    )
    function = function_of(model, mode)
    assert np.isfinite(function(100.0)[0])
    for mu in (5.0, 0.0, -20.0, 1e308):
        with overflows(mode):
            value, gradient = function(mu)
        assert value == -np.inf, mu
        assert gradient == 0, mu
