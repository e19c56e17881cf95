"""Where the pressure integral runs, and what it says at its ends."""

import numpy as np
import oracles
import pandas as pd
import pymc as pm
import pytensor
import pytensor.tensor as pt
import pytest
from pressures import (
    SIMPLIFIED,
    Response,
    columns_of,
    compiled_response,
    has_stiffness,
    problems_of,
    response,
)
from problems import AS_WRITTEN, LAWS, PROBLEMS
from pytensor.graph.replace import vectorize_graph
from pytensor.graph.traversal import ancestors
from pytensor.tensor.blockwise import Blockwise
from tiers import deep, tiers

import pymc_hyperelastic as ph
from pymc_hyperelastic import PressureIntegral, inflation_pressure, inflation_stiffness

# Two formulas for one integral with the same nodes: rounding, with exponents up to 60.
IDENTITY_TOLERANCE = 1e-12
# Linkers call other sinh and exp, which may differ in the last digit. The gradient by an input is a
# sum that may cancel; its rounding is that of the output over the input's size.
BACKEND_TOLERANCE = 1e-12
# What users run is the default mode; it is held to the numbers of plain Python for laws of each
# kind: powers, exponentials, an end, and fibres.
LINKED = (
    "NeoHookean",
    "PowerLawNeoHookean",
    "Ogden",
    "CriscioneType",
    "Gent",
    "HolzapfelGasserOgden",
)
# The one of them whose functions other compilers make in a few seconds.
QUICKLY_LINKED = "NeoHookean"


@pytest.mark.parametrize("law", tiers(LINKED, first=lambda law: law == QUICKLY_LINKED))
@pytest.mark.parametrize("mode", [*deep(["NUMBA"]), "CVM", "JAX"])
def test_linkers_agree(law, mode):
    """Values and gradients of every problem are the same under numba, C, JAX and plain Python."""
    if mode == "JAX":
        pytest.importorskip("jax")
    elif not pytensor.config.cxx:
        pytest.skip("no C compiler")
    table = problems_of(law)
    chosen = [has_stiffness(problem) for problem in table]
    values = Response(*(x[..., chosen] for x in response(law, mode)))
    expected = Response(*(x[..., chosen] for x in response(law, SIMPLIFIED)))
    size = np.abs(columns_of([p.inputs for p, one in zip(table, chosen, strict=True) if one]))
    size[4:] = np.maximum(size[4:], 1)  # an angle or an exponent may be 0
    for output in ("pressure", "stiffness"):
        scale = np.abs(getattr(expected, output))
        difference = np.abs(getattr(values, output) - getattr(expected, output))
        assert (difference <= BACKEND_TOLERANCE * scale).all()
        gradient = getattr(expected, f"{output}_gradient")
        assert np.isfinite(gradient).all()
        difference = np.abs(getattr(values, f"{output}_gradient") - gradient)
        assert (difference <= BACKEND_TOLERANCE * (np.abs(gradient) + scale / size)).all()


def test_numba_agrees_about_one_tube():
    """What users run by default, in the first tier: pressure, stiffness and their gradient."""
    radius, mu = pt.dvector(), pt.dscalar()
    op = PressureIntegral(strain_energy=ph.NeoHookean())
    pressure, stiffness = op(radius, 7.0, 9.0, 1.1, 0.3, mu)
    outputs = [pressure, stiffness, *pytensor.grad((pressure * stiffness).sum(), [radius, mu])]
    numba, python = (
        pytensor.function([radius, mu], outputs, mode=mode) for mode in ("NUMBA", AS_WRITTEN)
    )
    point = np.array([6.5, 7.5, 9.5]), 20.0
    for found, expected in zip(numba(*point), python(*point), strict=True):
        np.testing.assert_allclose(found, expected, rtol=BACKEND_TOLERANCE)


def scalar_tube(internal_radius, **parameters):
    """Ogden tube whose parameters are given, with its pressures and stiffnesses."""
    op = PressureIntegral(strain_energy=ph.Ogden())
    return op(internal_radius, 7.0, 9.0, 1.1, 0.3, parameters["mu"], parameters["alpha"])


def operations(*variables):
    return {v.owner.op for v in ancestors(variables) if v.owner is not None}


@pytest.mark.parametrize("batched", ["parameters", "radius"])
def test_vectorised_graph_is_the_loop(batched):
    """A batch of parameters, or of radii, is one Op that broadcasts: no loop, the same numbers."""
    mu, alpha = pt.dscalars("mu", "alpha")
    radius = pt.dvector("radius") if batched == "parameters" else pt.dscalar("radius")
    outputs = scalar_tube(radius, mu=mu, alpha=alpha)
    radii = np.linspace(6.5, 10.0, 6)
    if batched == "parameters":
        batch = {mu: np.array([2.0, 6.0, 9.0]), alpha: np.array([0.0, 8.0, -15.0])}
        fixed = {radius: radii}
    else:
        batch = {radius: radii}
        fixed = {mu: np.array(6.0), alpha: np.array(8.0)}
    symbols = {scalar: pt.dvector(scalar.name) for scalar in batch}
    vectorised = vectorize_graph(outputs, symbols)

    used = operations(*vectorised)
    assert any(isinstance(op, PressureIntegral) for op in used)
    assert not any(isinstance(op, Blockwise) for op in used)

    loop = pytensor.function([*batch, *fixed], outputs, mode=AS_WRITTEN)
    expected = [loop(*row, *fixed.values()) for row in zip(*batch.values(), strict=True)]
    together = pytensor.function([*symbols.values(), *fixed], vectorised, mode=AS_WRITTEN)
    for value, rows in zip(
        together(*batch.values(), *fixed.values()), zip(*expected, strict=True), strict=True
    ):
        np.testing.assert_allclose(value, np.stack(rows), rtol=IDENTITY_TOLERANCE)


def test_gradient_vectorises_too():
    """A batch of gradients, as a batched sampler takes it, is the loop's and needs no loop."""
    mu, alpha = pt.dscalars("mu", "alpha")
    radii = np.linspace(6.5, 10.0, 6)
    pressure, stiffness = scalar_tube(radii, mu=mu, alpha=alpha)
    gradient = pytensor.grad((pressure**2 + stiffness**2).sum(), [mu, alpha])
    symbols = {mu: pt.dvector("mu"), alpha: pt.dvector("alpha")}
    vectorised = vectorize_graph(gradient, symbols)
    assert not any(isinstance(op, Blockwise) for op in operations(*vectorised))

    batch = np.array([2.0, 6.0, 9.0]), np.array([0.0, 8.0, -15.0])
    loop = pytensor.function([mu, alpha], gradient, mode=AS_WRITTEN)
    together = pytensor.function([*symbols.values()], vectorised, mode=AS_WRITTEN)
    np.testing.assert_allclose(
        together(*batch),
        np.transpose([loop(*row) for row in zip(*batch, strict=True)]),
        rtol=IDENTITY_TOLERANCE,
    )


def test_inputs_broadcast():
    """Numbers, arrays and variables of any shapes meet as in NumPy."""
    mu = np.array([[2.0], [6.0], [9.0]])
    radii = np.linspace(6.5, 10.0, 4)
    alpha = pt.dscalar("alpha")
    pressure = inflation_pressure(
        ph.Ogden(), radii, inner_radius=7, outer_radius=[8, 9, 9, 10], mu=mu, alpha=alpha
    )
    assert pressure.type.shape == (3, 4)
    value = pressure.eval({alpha: 8.0}, mode=AS_WRITTEN)
    np.testing.assert_allclose(value, mu * value[:1] / mu[0], rtol=IDENTITY_TOLERANCE)


def test_python_numbers_are_double_precision():
    """Integers and short decimals, which PyTensor would store in single precision, lose nothing."""
    tube = dict(zip(oracles.GEOMETRY, (8.5, 7, 9.0, 1.0, 0.0), strict=True))
    exact = LAWS["Ogden"].exact({**tube, "mu": 6.0, "alpha": 8})
    radius = tube.pop("internal_radius")
    pressure = inflation_pressure(ph.Ogden(), radius, **tube, mu=6.0, alpha=8)
    assert pressure.dtype == "float64"
    np.testing.assert_allclose(pressure.eval(mode=AS_WRITTEN), exact, rtol=IDENTITY_TOLERANCE)


def test_functions_are_the_outputs_of_the_op():
    """`inflation_pressure` and `inflation_stiffness` say what the Op says, by keyword."""
    problem = next(p for p in PROBLEMS if p.name.endswith("in vivo"))
    index = problems_of(problem.law).index(problem)
    geometry = {name: problem.inputs[name] for name in oracles.GEOMETRY}
    radius = geometry.pop("internal_radius")
    energy = LAWS[problem.law].strain_energy
    values = response(problem.law, AS_WRITTEN)
    for function, expected in (
        (inflation_pressure, values.pressure[index]),
        (inflation_stiffness, values.stiffness[index]),
    ):
        value = function(energy, radius, **geometry, **problem.parameters)
        assert value.ndim == 0
        np.testing.assert_allclose(value.eval(mode=AS_WRITTEN), expected, rtol=IDENTITY_TOLERANCE)


def test_op_is_seen_in_the_graph():
    """A printed graph names the integral and its material, with and without its gradient."""
    mu, alpha = pt.dscalars("mu", "alpha")
    pressure, stiffness = scalar_tube(8.0, mu=mu, alpha=alpha)
    printed = pytensor.dprint([pressure, stiffness], file="str")
    assert "PressureIntegral" in printed
    assert "Ogden" in printed
    gradient = pytensor.grad(pressure, [mu, alpha])
    assert "PressureIntegral" in pytensor.dprint([pressure, *gradient], file="str")


def test_equal_ops_merge():
    """Pressure and stiffness of one tube are one integral, once the graph is compiled."""
    mu = pt.dscalar("mu")
    tube = {"inner_radius": 7.0, "outer_radius": 9.0, "mu": mu, "alpha": 8.0}
    graph = pytensor.graph.FunctionGraph(
        [mu],
        [
            inflation_pressure(ph.Ogden(), 8.0, **tube),
            inflation_stiffness(ph.Ogden(), 8.0, **tube),
        ],
        clone=False,
    )
    pytensor.graph.rewriting.basic.MergeOptimizer().rewrite(graph)
    integrals = [n for n in graph.apply_nodes if isinstance(n.op, PressureIntegral)]
    assert len(integrals) == 1


every_mode = pytest.mark.parametrize("mode", [SIMPLIFIED, *deep(["NUMBA"])])


@every_mode
@pytest.mark.parametrize(
    ("law", "parameters"),
    [
        ("Ogden", {"mu": 6.0, "alpha": 1e5}),
        ("Ogden", {"mu": 6.0, "alpha": -1e5}),
        ("CriscioneType", {"a": 3.0, "b": 1e5}),
        ("PowerLawNeoHookean", {"mu": 20.0, "n": 1e9}),
    ],
)
def test_overflow_is_infinite_and_its_gradient_zero(law, parameters, mode):
    """Where pressure overflows it is inf, so a likelihood rejects it; no gradient is ever NaN."""
    # The exponential limit of the power law overflows only in a tube that is blown up thirtyfold.
    geometry = (240.0 if law == "PowerLawNeoHookean" else 11.9, 7.0, 9.0, 1.0, 0.0)
    columns = [np.array([value]) for value in (*geometry, *parameters.values())]
    function = compiled_response(law, mode)
    with np.errstate(all="ignore"):
        pressure, stiffness, gradient = function(*columns, 1.0, 0.0)
        _, _, gradient_of_stiffness = function(*columns, 0.0, 1.0)
    assert pressure == np.inf
    assert not np.isfinite(stiffness)
    assert (gradient == 0).all()
    assert (gradient_of_stiffness == 0).all()


@every_mode
@pytest.mark.parametrize(
    ("tube", "limit", "pressure", "everywhere"),
    [
        ("inflated far", 0.1, np.inf, True),
        ("deflated far", 0.5, -np.inf, False),
        # Tension and compression meet within this wall: the two infinities have no sum.
        ("slackening, shortened", 1e-3, np.nan, True),
    ],
)
def test_gents_wall_beyond_its_end_carries_no_finite_pressure(
    tube, limit, pressure, everywhere, mode
):
    """No gradient is NaN, and none is left where the whole wall is stretched beyond its limit."""
    geometry = next(p for p in problems_of("Gent") if p.name.endswith(f", {tube}")).inputs
    columns = [np.array([value]) for value in {**geometry, "limit": limit}.values()]
    function = compiled_response("Gent", mode)
    with np.errstate(all="ignore"):
        value, stiffness, *gradients = function(*columns, 1.0, 0.0)
        gradients.append(function(*columns, 0.0, 1.0)[2])
    np.testing.assert_array_equal(value, [pressure])
    assert not np.isfinite(stiffness)
    for gradient in gradients:
        assert np.isfinite(gradient).all()
        assert (gradient == 0).all() == everywhere


def test_gents_impossible_parameters_are_rejected_by_the_likelihood():
    """A sampler that proposes them sees the density 0, and a gradient of 0 and not NaN."""
    radius = np.linspace(7.0, 11.9, 8)
    frame = pd.DataFrame(
        {"specimen": "s", "experiment": 1, "radius": radius, "pressure": radius - 7}
    )
    data = ph.inflation_data(frame, inner_radius=7.0, outer_radius=9.0)
    with pm.Model() as model:
        limit = pm.Uniform("limit", 0.1, 100.0, default_transform=None)
        parameters = {"mu": 15.0, "limit": limit}
        ph.inflation_likelihood(
            "pressure", ph.Gent(), data, parameters, sigma=1.0, slope_weight=1.0
        )
    value = model.rvs_to_values[limit]
    log_density = model.logp(sum=True)
    function = pytensor.function(
        [value], [log_density, pytensor.grad(log_density, value)], mode=AS_WRITTEN
    )
    assert np.isfinite(function(60.0)).all()
    assert function(60.0)[1] != 0
    for impossible in (0.2, 1.0):  # in the whole wall of the last tube, and in its inner part
        assert function(impossible)[0] == -np.inf
        assert function(impossible)[1] == 0
