"""Pressure and stiffness of inflated tubes: `inflation_pressure`, `inflation_stiffness`."""

import numpy as np
import oracles
import pytensor
import pytensor.tensor as pt
import pytest
from problems import AS_WRITTEN, LAWS
from pytensor.graph.replace import vectorize_graph
from pytensor.graph.traversal import ancestors
from pytensor.tensor.blockwise import Blockwise
from tiers import deep
from wall_integrals import (
    SIMPLIFIED,
    columns_of,
    compiled,
    compiled_gradient,
    has_stiffness,
    problems_of,
)

import pymc_hyperelastic as ph
from pymc_hyperelastic import PressureIntegral, inflation_pressure, inflation_stiffness

# The documented accuracy of 32 nodes, against adaptive quadrature: for compressed walls, and for
# inflated ones, with a margin for the rounding of exponents up to 60. Pressures of laws with fibres
# are above a thousand moduli in the extreme tubes, where the documentation promises less.
TOLERANCE = 1e-10
INFLATED_TOLERANCE = 5e-12
EXTREME_TOLERANCE = 1e-9
# At zero pressure a relative error has no meaning. The error allowed there is that of a relative
# error of 1e-12 in the radius. The oracle, with differences of step 1e-15, cannot distinguish a
# pressure below 1e-25 of that scale from 0.
ZERO_PRESSURE_RADIUS_ERROR = 1e-12
ORACLE_RESOLUTION = 1e-25
# Two formulas with the same nodes: rounding, with exponents up to 60.
IDENTITY_TOLERANCE = 1e-12


def assert_equals_quadrature(law, problems, mode=AS_WRITTEN):
    """Compare pressure and stiffness of problems, also where the pressure is almost zero."""
    values = compiled(law, "pressure", mode)(*columns_of(problems))
    for problem, pressure, stiffness in zip(problems, *values, strict=True):
        if problem.tube == "at rest":
            assert pressure == 0
        exact, exact_stiffness = problem.exact(), problem.exact("internal_radius")
        scale = abs(exact_stiffness) * problem.inner_radius
        # At a kink the oracle's difference errs by its step, not by the square of the step.
        at_zero = abs(exact) <= ORACLE_RESOLUTION * scale or not has_stiffness(problem)
        inflated = problem.internal_radius >= problem.inner_radius
        relative = INFLATED_TOLERANCE if inflated else TOLERANCE
        if LAWS[law].slackens and problem.tube.startswith("extreme"):
            relative = EXTREME_TOLERANCE
        allowed = ZERO_PRESSURE_RADIUS_ERROR * scale if at_zero else relative * abs(exact)
        assert abs(pressure - exact) <= allowed, problem.name
        if has_stiffness(problem):
            error = abs(stiffness - exact_stiffness)
            assert error <= relative * abs(exact_stiffness), problem.name


@pytest.mark.parametrize("law", LAWS)
def test_pressure_and_stiffness_equal_adaptive_quadrature(law):
    tubes = ("at rest", "extreme", *(["slackening"] if LAWS[law].slackens else []))
    assert_equals_quadrature(law, problems_of(law, *tubes, ordinary=True))


@pytest.mark.deep
@pytest.mark.parametrize("law", LAWS)
def test_pressure_and_stiffness_of_all_problems_equal_adaptive_quadrature(law):
    assert_equals_quadrature(law, problems_of(law), SIMPLIFIED)


def test_table_of_problems_contains_every_law():
    zoo = {name for name in ph.strain_energy.__all__ if name in ph.list_strain_energies()}
    assert zoo == {law.strain_energy.name for law in LAWS.values()}


def test_pressure_of_the_neo_hookean_tube_equals_its_closed_form():
    """The tubes range from far deflated to far inflated ones."""
    problems = problems_of("NeoHookean")
    values = compiled("NeoHookean", "pressure")(*columns_of(problems))
    for problem, pressure, stiffness in zip(problems, *values, strict=True):
        exact = oracles.neo_hookean_pressure(
            problem.parameters["mu"], *list(problem.inputs.values())[:5]
        )
        rounding = ZERO_PRESSURE_RADIUS_ERROR * abs(stiffness) * problem.inner_radius
        assert abs(pressure - exact) <= TOLERANCE * abs(exact) + rounding


def test_order_two_equals_the_two_point_gauss_rule():
    """The two-point rule in ln R gives the expected pressure, stiffness and force."""
    a, inner, outer, axial, mu = 1.4, 1.0, 2.0, 1.2, 10.0
    log_ratio = np.log(outer / inner)
    reference = inner * np.exp(log_ratio * (1 + np.array([-1, 1]) / np.sqrt(3)) / 2)

    def pressure_of(a):
        current = np.sqrt(a**2 + (reference**2 - inner**2) / axial)
        hoop = current / reference
        stress = mu * (hoop**2 - 1 / (hoop * axial) ** 2)
        return (stress / (hoop**2 * axial)).sum() * log_ratio / 2, hoop

    pressure, hoop = pressure_of(a)
    stiffness = pressure_of(a + 1e-30j)[0].imag / 1e-30
    radial = 1 / (hoop * axial)
    response = mu * (2 * (axial**2 - radial**2) - (hoop**2 - radial**2))
    force = np.pi / axial * (response * reference**2).sum() * log_ratio / 2
    tube = ph.Tube(inner_radius=inner, outer_radius=outer, axial_stretch=axial)
    functions = inflation_pressure, inflation_stiffness, ph.axial_force
    for function, expected in zip(functions, (pressure, stiffness, force), strict=True):
        value = function(ph.NeoHookean(), a, tube, order=2, mu=mu).eval(mode=AS_WRITTEN)
        np.testing.assert_allclose(value, expected, rtol=IDENTITY_TOLERANCE)


# --- shapes and graphs ----------------------------------------------------------------------------


def operations(*variables):
    return [v.owner.op for v in ancestors(variables) if v.owner is not None]


def test_vectorised_value_and_gradient_equal_single_evaluations():
    """The batch varies parameters and radii; its graph has no loop over them."""
    mu, alpha, radius = pt.dscalars("mu", "alpha", "radius")
    op = PressureIntegral(strain_energy=ph.Ogden())
    pressure, stiffness = op(radius, [7.0, 6.5], 9.0, 1.1, 0.3, mu, alpha)
    gradient = pytensor.grad((pressure**2 + stiffness**2).sum(), [mu, alpha, radius])
    outputs = [pressure, stiffness, *gradient]
    symbols = {scalar: pt.dvector(scalar.name) for scalar in (mu, alpha, radius)}
    vectorised = vectorize_graph(outputs, symbols)
    assert any(isinstance(op, PressureIntegral) for op in operations(*vectorised))
    assert not any(isinstance(op, Blockwise) for op in operations(*vectorised))
    batch = np.array([2.0, 6.0, 9.0]), np.array([0.0, 8.0, -15.0]), np.array([6.5, 8.0, 9.9])
    loop = pytensor.function([mu, alpha, radius], outputs, mode=AS_WRITTEN)
    together = pytensor.function([*symbols.values()], vectorised, mode=AS_WRITTEN)
    rows = zip(*(loop(*row) for row in zip(*batch, strict=True)), strict=True)
    for value, expected in zip(together(*batch), rows, strict=True):
        np.testing.assert_allclose(value, np.stack(expected), rtol=IDENTITY_TOLERANCE)


def test_numbers_arrays_and_variables_broadcast_in_double_precision():
    """PyTensor would store integers and short decimals in single precision."""
    mu, alpha = np.array([[2.0], [6.0], [9.1]]), pt.dscalar("alpha")
    radii = np.linspace(6.5, 10.0, 4)
    tube = ph.Tube(inner_radius=7, outer_radius=[8, 9, 9, 10.1])
    pressure = inflation_pressure(ph.Ogden(), radii, tube, mu=mu, alpha=alpha)
    assert pressure.type.shape == (3, 4) and pressure.dtype == "float64"
    value = pressure.eval({alpha: 8.0}, mode=AS_WRITTEN)
    np.testing.assert_allclose(value, mu * value[:1] / mu[0], rtol=IDENTITY_TOLERANCE)
    inputs = dict(zip(oracles.GEOMETRY, (10.0, 7, 10.1, 1.0, 0.0), strict=True))
    exact = LAWS["Ogden"].exact({**inputs, "mu": 9.1, "alpha": 8})
    np.testing.assert_allclose(value[-1, -1], exact, rtol=IDENTITY_TOLERANCE)


def test_equal_integrals_share_an_op_and_merge():
    """Inputs of the same types share an Op; pressure and stiffness share an integral."""
    tube, mu = ph.Tube(inner_radius=7.0, outer_radius=9.0), pt.dscalar()
    functions = inflation_pressure, inflation_stiffness
    outputs = [function(ph.Ogden(), 8.0, tube, mu=mu, alpha=8.0) for function in functions]
    assert outputs[0].owner.op is outputs[1].owner.op
    graph = pytensor.graph.FunctionGraph([mu], outputs, clone=False)
    pytensor.graph.rewriting.basic.MergeOptimizer().rewrite(graph)
    assert sum(isinstance(node.op, PressureIntegral) for node in graph.apply_nodes) == 1
    settings = {"order": 12, "name": "artery", "inline": False}
    op = PressureIntegral(strain_energy=ph.NeoHookean(), **settings)
    op = op(8.0, 7.0, 9.0, 1.0, 0.0, 10.0)[0].owner.op
    assert (op.order, op.name, op.is_inline) == (12, "artery", False)
    assert "PressureIntegral{strain_energy=Ogden(), order=32}" in pytensor.dprint(
        outputs, file="str"
    )


# --- impossible parameters ------------------------------------------------------------------------


GENT = {p.tube: p.inputs for p in problems_of("Gent", ordinary=True)}
# Law, inputs, pressure, and whether all of the wall is beyond the limits of the law.
IMPOSSIBLE = [
    ("Ogden", (11.9, 7.0, 9.0, 1.0, 0.0, 6.0, -1e5), np.inf, True),
    *deep(
        [
            ("CriscioneType", (11.9, 7.0, 9.0, 1.0, 0.0, 3.0, 1e5), np.inf, True),
            ("PowerLawNeoHookean", (240.0, 7.0, 9.0, 1.0, 0.0, 20.0, 1e9), np.inf, True),
        ]
    ),
    ("Gent", {**GENT["inflated far"], "limit": 0.1}.values(), np.inf, True),
    ("Gent", {**GENT["deflated far"], "limit": 0.5}.values(), -np.inf, False),
    # This wall has parts in tension and in compression: the two infinities have no sum.
    ("Gent", {**GENT["slackening, shortened"], "limit": 1e-3}.values(), np.nan, True),
]


@pytest.mark.parametrize(("law", "inputs", "expected", "everywhere"), IMPOSSIBLE)
def test_impossible_wall_has_infinite_or_nan_pressure_and_finite_gradients(
    law, inputs, expected, everywhere
):
    """Gradients are zero if the whole wall is beyond the limits of the law."""
    columns = [np.array([value]) for value in inputs]
    for weights in np.eye(2):
        with np.errstate(all="ignore"):
            results = compiled_gradient(law, "pressure")(*columns, weights)
        pressure, stiffness, gradient = results
        np.testing.assert_array_equal(pressure, [expected])
        assert not np.isfinite(stiffness)
        assert np.isfinite(gradient).all()
        assert (gradient == 0).all() == everywhere
