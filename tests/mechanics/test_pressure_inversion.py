"""The radius at a given pressure, its gradient, and likelihoods of the error of the radius."""

import numpy as np
import pandas as pd
import pymc as pm
import pytensor
import pytensor.tensor as pt
from problems import AS_WRITTEN
from pytensor.graph.replace import vectorize_graph
from pytensor.graph.traversal import ancestors
from pytensor.tensor.blockwise import Blockwise
from scipy.optimize import brentq
from tables import SECTOR
from wall_integrals import DIFFERENCE_TOLERANCE, difference_quotients

import pymc_hyperelastic as ph
from pymc_hyperelastic.mechanics.integrals import RadiusAtPressure

# Newton's method converges to the rounding of the pressure over the slope of a stiff tube.
ROUNDING = 1e-12
# A sum of squares of radii of that accuracy.
LIKELIHOOD_TOLERANCE = 1e-10

INNER, AXIAL, ANGLE = 1.0, 1.1, 0.8
# Thickness, and the entries of the parameters, of each layer from the inside out.
LAYERS = (
    (ph.NeoHookean(), 0.25, (20.0,)),
    (ph.OgdenSeries(terms=2), 0.15, (4.0, 1.0, 6.0, 10.0)),
)
WALL, OUTER_RADII = [INNER, AXIAL, ANGLE], (INNER + 0.25, INNER + 0.4)
for outer_radius, (*_, layer_entries) in zip(OUTER_RADII, LAYERS, strict=True):
    WALL += [outer_radius, *layer_entries]
# From a compressed tube to a far inflated one.
RADII = np.array([0.85, 1.0, 1.2, 1.5])


def pressure_at(radius):
    """Return the pressure of the wall by the public function."""
    layers = []
    for energy, thickness, entries in LAYERS:
        parameters = energy.join(entries)
        layers.append(ph.Layer(energy, thickness, **parameters))
    tube = ph.Tube(inner_radius=INNER, axial_stretch=AXIAL, opening_angle=ANGLE)
    return ph.inflation_pressure(layers, radius, tube).eval(mode=AS_WRITTEN)


def test_radius_at_pressure_and_its_gradient_invert_the_pressure():
    """The results do not depend on the start, even one from which Newton needs four full steps."""
    op = RadiusAtPressure(strain_energies=tuple(energy for energy, *_ in LAYERS), order=32)
    symbols = pt.dvectors(2 + len(WALL))
    radius, last_step = op(*symbols)
    gradient = pt.stack(pytensor.grad(radius.sum(), symbols))
    function = pytensor.function(symbols, [radius, last_step, gradient], mode=AS_WRITTEN)
    starts = RADII * np.array([1.45, 1.08, 0.95, 0.7])
    columns = np.array([pressure_at(RADII), starts, *(np.full(4, x) for x in WALL)])
    found, last_step, gradient = function(*columns)
    np.testing.assert_allclose(found, RADII, rtol=ROUNDING)
    assert (last_step < ROUNDING).all()
    columns[1] = RADII
    expected = difference_quotients(lambda *x: function(*x)[:1], columns)[0]
    assert (gradient[1] == 0).all()
    scale = np.abs(expected).max(axis=1, keepdims=True) + ROUNDING / DIFFERENCE_TOLERANCE
    assert (np.abs(gradient - expected) <= DIFFERENCE_TOLERANCE * scale).all()


def test_unreachable_pressure_ends_with_a_large_last_step():
    """The softer of two tubes bursts; a batch of moduli is evaluated without a loop."""
    mu = pt.dscalar()
    op = RadiusAtPressure(strain_energies=(ph.NeoHookean(),), order=32)
    outputs = list(op(np.array([1.0, 100.0]), 1.2, INNER, 1.0, 0.0, INNER + 0.4, mu))
    batch = pt.dvector()
    vectorised = vectorize_graph(outputs, {mu: batch})
    nodes = [v.owner.op for v in ancestors(vectorised) if v.owner is not None]
    assert not any(isinstance(node, Blockwise) for node in nodes)
    radius, last_step = pytensor.function([batch], vectorised, mode=AS_WRITTEN)([10.0, 1000.0])
    assert (last_step[[0, 1, 1], [0, 0, 1]] < ROUNDING).all()
    assert last_step[0, 1] > 1
    tube = ph.Tube(inner_radius=INNER, outer_radius=INNER + 0.4)
    pressure = ph.inflation_pressure(ph.NeoHookean(), radius[1], tube, mu=1000.0)
    np.testing.assert_allclose(pressure.eval(mode=AS_WRITTEN), [1.0, 100.0], rtol=ROUNDING * 100)


# --- the error of the radius ---------------------------------------------------------------------

SIGMA, THICKNESS = 0.03, 0.4
OGDEN = {"mu": 6.0, "alpha": 8.0}
RADIUS = np.array([1.05, 1.2, 1.3, 1.38])
PRESSURE = np.array([1.2, 5.0, 9.0, 14.0])
K = 2 * np.pi / (2 * np.pi - ANGLE)


def outer_of(radius, inner=INNER, thickness=THICKNESS):
    return np.sqrt(radius**2 + ((inner + thickness) ** 2 - inner**2) / (K * AXIAL))


def model_of(energy):
    """Return a model of a measured outer diameter; inner radius and thickness are inferred."""
    frame = pd.DataFrame({"specimen": "S", "experiment": 1, "radius": RADIUS})
    frame["pressure"], frame["outer_diameter"] = PRESSURE, 2 * outer_of(RADIUS)
    tube = ph.Tube(axial_stretch=AXIAL, opening_angle=ANGLE, **SECTOR)
    data = ph.inflation_data(frame, tube, measured="outer_diameter")
    priors = {p.name: pm.Normal.dist(0, 50) for p in energy.parameters}
    priors |= {"inner_radius": pm.Normal.dist(1, 1), "thickness": pm.Normal.dist(1, 1)}
    likelihood = ph.Gaussian(radius_sd=SIGMA / np.sqrt(2))
    return ph.inflation_model(energy, data, likelihood, priors=priors)


def function_of(model):
    """Compile the likelihood and its gradient, as a function of variables without bounds."""
    (value,) = model.replace_rvs_by_values([model["likelihood"]])
    gradient = pytensor.grad(value, model.value_vars)
    return pytensor.function(model.value_vars, [value, *gradient], mode=AS_WRITTEN)


def exact_likelihood(inner, thickness):
    """Return the log likelihood by bisection of the pressure of each point."""
    tube = ph.Tube(inner, inner + thickness, axial_stretch=AXIAL, opening_angle=ANGLE)
    symbol = pt.dscalar()
    pressure = ph.inflation_pressure(ph.Ogden(), symbol, tube, **OGDEN)
    curve = pytensor.function([symbol], pressure, mode=AS_WRITTEN)
    roots = [brentq(lambda a, p=p: float(curve(a)) - p, 0.7, 2.0, xtol=1e-14) for p in PRESSURE]
    error = outer_of(np.array(roots), inner, thickness) - outer_of(RADIUS)
    return -len(error) / 2 * np.log(np.pi * SIGMA**2) - np.sum(error**2) / SIGMA**2


def test_likelihood_of_a_radius_error_equals_bisection():
    """The error is that of the radius that was measured; impossible tubes have likelihood zero."""
    function = function_of(model_of(ph.Ogden()))
    point = np.array([*OGDEN.values(), 0.97, 0.43])
    value, *gradient = function(*point)
    exact = exact_likelihood(0.97, 0.43)
    np.testing.assert_allclose(value, exact, rtol=LIKELIHOOD_TOLERANCE)
    rows = 1e-5 * np.diag(point)
    expected = [(function(*point + x)[0] - function(*point - x)[0]) / 2e-5 for x in rows]
    scale = np.abs(expected).max()
    np.testing.assert_allclose(gradient * point, expected, rtol=0, atol=1e-6 * scale)
    # No wall, no room for a wall, and pressures that a wall does not reach.
    impossible = [(-1.0, 0.4), (1.0, -0.4), (0.0, 0.4), (1e3, 1e3), (1e-9, 50.0)]
    impossible = [(*OGDEN.values(), *wall) for wall in impossible]
    for values in (*impossible, (0.0, 8.0, 1.0, 0.4), (-20.0, 8.0, 1.0, 0.4)):
        with np.errstate(all="ignore"):  # rejected values may overflow
            value, *gradient = function(*values)
        assert value == -np.inf, values
        assert np.isfinite(gradient).all(), values
