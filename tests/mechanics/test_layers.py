"""Walls of several layers: each a tube within the tube, and together one wall."""

from functools import cache
from itertools import product

import numpy as np
import oracles
import pytensor
import pytensor.tensor as pt
import pytest
from problems import AS_WRITTEN, LAWS, entries
from tiers import tiers

import pymc_hyperelastic as ph

# What the package promises against adaptive quadrature, and of gradients.
TOLERANCE = 1e-9
GRADIENT_TOLERANCE = 1e-8
# Force is that in the wall less the thrust of the pressure on the ends: rounding is relative to it.
ROUNDING = 1e-13
# Two rules for one integral; they err by rounding where a tube is inflated.
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
SLACKENING = (-2, -1)
# The wall of which hundred digits of all derivatives do not take long.
FIRST = "a rubber tube in another"
CASES = [pytest.param(wall, tube, id=f"{wall}, {tube}") for wall, tube in product(WALLS, TUBES)]


def inputs_of(wall, tube):
    """All numbers of a layered tube by name, angles in radians."""
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
    """Quantity of a wall by the package, of numbers or variables by name."""
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
    return function(layers, inputs["internal_radius"], **{name: inputs[name] for name in geometry})


def exact(wall, inputs, *by, quantity=oracles.layered_pressure):
    """The same by one integral over the whole wall, or its derivative by the named inputs."""

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
def response(wall):
    """Pressure, stiffness and force of a wall in all tubes."""
    points = [inputs_of(wall, tube) for tube in TUBES]
    symbols = {name: pt.dvector(name) for name in points[0]}
    outputs = [package(wall, function, symbols) for function in FUNCTIONS]
    function = pytensor.function([*symbols.values()], outputs, mode=AS_WRITTEN)
    return np.array(function(*columns_of(points)))


@pytest.mark.parametrize(("wall", "tube"), CASES)
def test_layers_agree_with_one_integral_over_the_wall(wall, tube):
    """Pressure, stiffness and force of a wall are those of its material at each radius."""
    inputs = inputs_of(wall, tube)
    pressure, stiffness, force = response(wall)[:, TUBES.index(tube)]
    exact_pressure = exact(wall, inputs)
    np.testing.assert_allclose(pressure, exact_pressure, rtol=TOLERANCE, atol=0)
    np.testing.assert_allclose(
        stiffness, exact(wall, inputs, "internal_radius"), rtol=TOLERANCE, atol=0
    )
    np.testing.assert_allclose(
        force,
        exact(wall, inputs, quantity=oracles.layered_force),
        rtol=TOLERANCE,
        atol=ROUNDING * np.pi * tube[0] ** 2 * abs(exact_pressure),
    )


def test_fibres_slacken_within_each_layer():
    """Two of the tubes above have a layer with a place where its fibres slacken."""
    found = set()
    for tube in (TUBES[i] for i in SLACKENING):
        inputs = inputs_of("media and adventitia", tube)
        geometry = [inputs[n] for n in ("internal_radius", "axial_stretch", "opening_angle")]
        inner = 1.0
        for i, (law, thickness, parameters) in enumerate(WALLS["media and adventitia"]):
            radius = oracles.mp.sqrt(
                geometry[0] ** 2
                + (inner**2 - 1) / (geometry[1] * 2 * np.pi / (2 * np.pi - geometry[2]))
            )
            layer = dict(
                zip(
                    oracles.GEOMETRY,
                    (radius, inner, inner + thickness, *geometry[1:]),
                    strict=True,
                )
            )
            if oracles.slackening_radii(
                LAWS[law].energy, {**layer, **parameters}, LAWS[law].switches
            ):
                found.add(i)
            inner += thickness
    assert found == {0, 1}


@pytest.mark.parametrize("law", ["PowerLawNeoHookean", "OgdenSeries(terms=3)", "FourFiber"])
def test_layers_of_one_material_are_one_tube(law):
    """A wall that is cut into two layers of the same material stays what it is."""
    energy, parameters = LAWS[law].strain_energy, LAWS[law].parameters[0][0]
    tube = {"inner_radius": 1.0, "axial_stretch": 1.2, "opening_angle": np.deg2rad(90)}
    radius = np.array([1.0, 1.2, 1.6])
    layers = [ph.Layer(energy, 0.2, **parameters), ph.Layer(energy, 0.4, **parameters)]
    for function in FUNCTIONS:
        graphs = (
            function(energy, radius, **tube, outer_radius=1.6, **parameters),
            function([ph.Layer(energy, 0.6, **parameters)], radius, **tube),
            function(layers, radius, **tube),
        )
        whole, alone, divided = pytensor.function([], graphs, mode=AS_WRITTEN)()
        np.testing.assert_allclose(divided, whole, rtol=IDENTITY_TOLERANCE, atol=0)
        np.testing.assert_allclose(alone, whole, rtol=IDENTITY_TOLERANCE, atol=0)


@pytest.mark.parametrize("function", FUNCTIONS)
@pytest.mark.parametrize("wall", ["a rubber tube in another", "media and adventitia"])
def test_gradient_agrees_with_finite_differences(wall, function):
    """PyTensor's own check holds in all inputs, thicknesses too."""
    points = [inputs_of(wall, tube) for tube in (TUBES[0], TUBES[4], TUBES[-2], TUBES[-1])]
    pytensor.gradient.verify_grad(
        lambda *values: package(wall, function, dict(zip(points[0], values, strict=True))),
        columns_of(points),
        n_tests=1,
        rng=np.random.default_rng(7),  # weights of the sum that is differentiated; any will do
        mode=AS_WRITTEN,
    )


@pytest.mark.parametrize("wall", tiers(WALLS, first=lambda wall: wall == FIRST))
def test_gradient_agrees_with_the_oracle(wall):
    """The derivative of each quantity by each input is the exact one."""
    inputs = inputs_of(wall, TUBES[-2])
    symbols = {name: pt.dscalar(name) for name in inputs}
    gradients = [
        pytensor.grad(package(wall, function, symbols), list(symbols.values()))
        for function in FUNCTIONS
    ]
    compiled = pytensor.function(
        list(symbols.values()), [pt.stack(gradient) for gradient in gradients], mode=AS_WRITTEN
    )
    pressure, stiffness, force = compiled(*inputs.values())
    scale = ROUNDING * abs(exact(wall, inputs, "internal_radius"))
    for i, name in enumerate(inputs):
        for value, expected in (
            (pressure[i], exact(wall, inputs, name)),
            (stiffness[i], exact(wall, inputs, "internal_radius", name)),
            (force[i], exact(wall, inputs, name, quantity=oracles.layered_force)),
        ):
            np.testing.assert_allclose(
                value, expected, rtol=GRADIENT_TOLERANCE, atol=scale, err_msg=name
            )


def test_numbers_arrays_and_variables_meet():
    """Thickness and parameters may be arrays or variables, and broadcast with the radii."""
    thickness, mu = pt.dscalars("thickness", "mu")
    layers = [
        ph.Layer(ph.NeoHookean(), thickness, mu=mu),
        ph.Layer(ph.NeoHookean(), [[0.1], [0.2]], mu=5),
    ]
    pressure = ph.inflation_pressure(layers, [1.1, 1.2, 1.3], inner_radius=1)
    value = pressure.eval({thickness: 0.3, mu: 5.0}, mode=AS_WRITTEN)
    expected = ph.inflation_pressure(
        ph.NeoHookean(),
        [1.1, 1.2, 1.3],
        inner_radius=1.0,
        outer_radius=[[1.4], [1.5]],
        mu=5.0,
    )
    np.testing.assert_allclose(value, expected.eval(mode=AS_WRITTEN), rtol=IDENTITY_TOLERANCE)


def test_layer_shows_what_it_is():
    """The representation is the call that makes it."""
    assert repr(ph.Layer(ph.NeoHookean(), 0.3, mu=20.0)) == "Layer(NeoHookean(), 0.3, mu=20.0)"


LAYER = ph.Layer(ph.NeoHookean(), 0.3, mu=20.0)


@pytest.mark.parametrize("function", FUNCTIONS)
@pytest.mark.parametrize(
    ("wall", "arguments", "message"),
    [
        ([], {}, "holds 'nothing'"),
        ([ph.NeoHookean()], {}, r"list of layers.*holds NeoHookean\(\)"),
        ([LAYER, 0.3], {}, "holds 0.3"),
        ([LAYER], {"outer_radius": 1.3}, r"\['outer_radius'\] cannot be given with layers"),
        ([LAYER], {"mu": 20.0}, r"\['mu'\] cannot be given with layers"),
        ("NeoHookean", {"outer_radius": 1.3, "mu": 20.0}, "call the class|'NeoHookean'"),
        (LAYER, {}, "a strain energy such as"),
        ([LAYER, ph.Layer(ph.NeoHookean(), 0.3)], {}, r"\['mu'\], but \[\] were given"),
        ([ph.Layer(ph.OgdenSeries(2), 0.3, mu=[1.0], alpha=[2.0, 3.0])], {}, "2 entries"),
        (ph.NeoHookean(), {"mu": 20.0}, "outer_radius is missing"),
    ],
)
def test_what_is_no_wall_is_refused_with_a_clear_message(function, wall, arguments, message):
    """Each mistake has one error, which names what was given."""
    with pytest.raises(TypeError, match=message):
        function(wall, 1.2, inner_radius=1.0, **arguments)


@pytest.mark.parametrize(
    ("energy", "thickness", "parameters", "error", "message"),
    [
        (ph.NeoHookean, 0.3, {"mu": 20.0}, TypeError, "call the class"),
        (ph.NeoHookean(), 0.3, {"mu": 20.0, "n": 1.0}, TypeError, r"NeoHookean.*'n'"),
        (ph.NeoHookean(), 0.0, {"mu": 20.0}, ValueError, "thickness must be positive; got 0.0"),
        (ph.NeoHookean(), -0.1, {"mu": 20.0}, ValueError, "thickness must be positive; got -0.1"),
        (ph.NeoHookean(), [0.1, np.nan], {"mu": 20.0}, ValueError, "thickness must be positive"),
    ],
)
def test_what_is_no_layer_is_refused_with_a_clear_message(
    energy, thickness, parameters, error, message
):
    """Each mistake has one error, where the layer is made."""
    with pytest.raises(error, match=message):
        ph.Layer(energy, thickness, **parameters)


def test_impossible_geometry_of_layers_is_refused():
    """What is asked of a tube is asked of layers."""
    with pytest.raises(ValueError, match="internal_radius must be positive"):
        ph.inflation_pressure([LAYER], 0.0, inner_radius=1.0)
