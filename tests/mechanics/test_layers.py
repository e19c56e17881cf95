"""Walls of several layers."""

from functools import cache

import numpy as np
import oracles
import pytensor
import pytensor.tensor as pt
import pytest
from problems import AS_WRITTEN, LAWS, entries
from tiers import deep
from wall_integrals import DIFFERENCE_TOLERANCE, difference_quotients

import pymc_hyperelastic as ph

# The documented accuracy, against adaptive quadrature.
TOLERANCE = 1e-9
# Force is that in the wall less the thrust of the pressure on the ends: rounding is relative to it.
ROUNDING = 1e-13
# Rounding error between two rules for the same integral over an inflated tube.
IDENTITY_TOLERANCE = 1e-12

FUNCTIONS = (ph.inflation_pressure, ph.inflation_stiffness, ph.axial_force)

# Laws from the inside out, each with its thickness (mm) and parameters.
WALLS = {
    "a rubber tube in another": (
        ("NeoHookean", 0.3, {"mu": 30.0}),
        ("OgdenSeries(terms=2)", 0.2, {"mu": (20.0, -3.0), "alpha": (2.0, -2.0)}),
    ),
    "media and adventitia": (
        ("HolzapfelGasserOgden", 0.26, {"c": 3.0, "k1": 2.3632, "k2": 0.8393, "beta": 29.0}),
        ("HolzapfelGasserOgden", 0.13, {"c": 0.3, "k1": 0.562, "k2": 0.7112, "beta": 62.0}),
    ),
    "three layers": (
        ("Demiray", 0.1, {"mu": 8.0, "b": 2.0}),
        ("FungOrthotropic", 0.3, {"c": 25.0, "a1": 1.0, "a2": 0.5, "a4": 0.1}),
        ("Ogden", 0.2, {"mu": 6.0, "alpha": 8.0}),
    ),
}
# Internal radius (mm), axial stretch and opening angle (degrees), all of inner radius 1 mm.
TUBES = (
    (1.2, 1.0, 0.0),
    (1.7, 1.0, 0.0),
    (0.8, 0.9, 0.0),
    (1.3, 1.9, 0.0),
    (0.8, 1.4, 160.0),
    (1.1, 1.9, 160.0),
    (0.8, 0.9, 60.0),  # fibres slacken in the inner of two layers
    (1.156, 0.9, 60.0),  # and in the outer one
)
# Each wall has its own tubes in the first tier; in the second, all walls have all tubes.
FIRST_TUBES = {
    "a rubber tube in another": TUBES[2:3],
    "media and adventitia": TUBES[-2:],
    "three layers": TUBES[4:5],
}


def inputs_of(wall, tube):
    """Return all numbers of a layered tube by name, angles in radians."""
    radius, axial, angle = tube
    inputs = {
        "internal_radius": radius,
        "inner_radius": 1.0,
        "axial_stretch": axial,
        "opening_angle": np.deg2rad(angle),
    }
    for i, (_, thickness, parameters) in enumerate(WALLS[wall]):
        inputs[f"thickness{i}"] = thickness
        inputs |= {f"{name}, layer {i}": value for name, value in entries(parameters).items()}
    return inputs


def package(wall, function, inputs):
    """Return the quantity by the package; the inputs are numbers or variables by name."""
    layers = []
    for i, (law, _, parameters) in enumerate(WALLS[wall]):
        flat = [inputs[f"{name}, layer {i}"] for name in entries(parameters)]
        by_name = LAWS[law].strain_energy.join(flat)
        by_name = {
            name: pt.stack(value, axis=-1) if isinstance(value, tuple) else value
            for name, value in by_name.items()
        }
        layers.append(ph.Layer(LAWS[law].strain_energy, inputs[f"thickness{i}"], **by_name))
    geometry = ("inner_radius", "axial_stretch", "opening_angle")
    tube = ph.Tube(**{name: inputs[name] for name in geometry})
    return function(layers, inputs["internal_radius"], tube)


def exact(wall, inputs, *by, quantity=oracles.layered_pressure):
    """Return the quantity by one integral over the whole wall, or its derivative by inputs."""

    def function(**values):
        layers, outer = [], values["inner_radius"]
        for i, (law, _, parameters) in enumerate(WALLS[wall]):
            outer = outer + values[f"thickness{i}"]
            flat = {name: values[f"{name}, layer {i}"] for name in entries(parameters)}
            layers.append(oracles.Layer(LAWS[law].energy, flat, outer, LAWS[law].switches))
        names = ("internal_radius", "inner_radius", "axial_stretch", "opening_angle")
        return quantity(layers, *(values[name] for name in names))

    exactly = {name: oracles.mp.mpf(float(value)) for name, value in inputs.items()}
    return float(oracles.derivative(function, exactly, *by))


def columns_of(points):
    return [np.array([point[name] for point in points]) for name in points[0]]


@cache
def compiled(wall, with_gradient=False):
    """Compile pressure, stiffness and force of a wall, and the gradient of their weighted sum."""
    symbols = {name: pt.dvector(name) for name in inputs_of(wall, TUBES[0])}
    outputs = [package(wall, function, symbols) for function in FUNCTIONS]
    if not with_gradient:
        return pytensor.function([*symbols.values()], outputs, mode=AS_WRITTEN)
    weights = pt.dvector()
    cost = sum(weights[i] * output.sum() for i, output in enumerate(outputs))
    gradient = pt.stack(pytensor.grad(cost, list(symbols.values())))
    return pytensor.function([*symbols.values(), weights], [*outputs, gradient], mode=AS_WRITTEN)


def assert_equals_quadrature(wall, tubes):
    points = [inputs_of(wall, tube) for tube in tubes]
    values = compiled(wall)(*columns_of(points))
    for inputs, (pressure, stiffness, force) in zip(points, np.transpose(values), strict=True):
        expected = exact(wall, inputs)
        assert abs(pressure - expected) <= TOLERANCE * abs(expected)
        thrust = np.pi * inputs["internal_radius"] ** 2 * abs(expected)
        expected = exact(wall, inputs, "internal_radius")
        assert abs(stiffness - expected) <= TOLERANCE * abs(expected)
        expected = exact(wall, inputs, quantity=oracles.layered_force)
        assert abs(force - expected) <= TOLERANCE * abs(expected) + ROUNDING * thrust


@pytest.mark.parametrize("wall", WALLS)
def test_layered_wall_equals_one_adaptive_integral(wall):
    """The oracle integrates pressure, stiffness and force over the whole wall at once."""
    assert_equals_quadrature(wall, FIRST_TUBES[wall])


@pytest.mark.deep
@pytest.mark.parametrize("wall", WALLS)
def test_layered_wall_in_all_tubes_equals_one_adaptive_integral(wall):
    assert_equals_quadrature(wall, TUBES)


@pytest.mark.parametrize("wall", ["a rubber tube in another", *deep(["media and adventitia"])])
def test_gradients_of_layered_walls_equal_difference_quotients(wall):
    """Gradients of all three quantities by all inputs, including thicknesses."""
    columns = columns_of([inputs_of(wall, tube) for tube in (TUBES[4], TUBES[-2], TUBES[-1])])
    function = compiled(wall, with_gradient=True)
    gradients = np.array([function(*columns, weights)[3] for weights in np.eye(3)])
    expected = difference_quotients(lambda *x: function(*x, np.ones(3))[:3], columns)
    scale = np.abs(expected).max(axis=1, keepdims=True)
    assert (np.abs(gradients - expected) <= DIFFERENCE_TOLERANCE * scale).all()


def test_arrays_and_variables_of_layers_broadcast():
    thickness, mu = pt.dscalars("thickness", "mu")
    layers = [
        ph.Layer(ph.NeoHookean(), thickness, mu=mu),
        ph.Layer(ph.NeoHookean(), [[0.1], [0.2]], mu=5),
    ]
    pressure = ph.inflation_pressure(layers, [1.1, 1.2, 1.3], ph.Tube(inner_radius=1))
    value = pressure.eval({thickness: 0.3, mu: 5.0}, mode=AS_WRITTEN)
    tube = ph.Tube(inner_radius=1.0, outer_radius=[[1.4], [1.5]])
    expected = ph.inflation_pressure(ph.NeoHookean(), [1.1, 1.2, 1.3], tube, mu=5.0)
    np.testing.assert_allclose(value, expected.eval(mode=AS_WRITTEN), rtol=IDENTITY_TOLERANCE)
    assert repr(ph.Layer(ph.NeoHookean(), 0.3, mu=20.0)) == "Layer(NeoHookean(), 0.3, mu=20.0)"
