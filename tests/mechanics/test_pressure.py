"""The pressure integral: its numbers, its gradients, and the places where it runs."""

from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np
import oracles
import pandas as pd
import pymc as pm
import pytensor
import pytensor.tensor as pt
import pytest
from problems import AS_WRITTEN, LAWS, OGDEN_1972_RUBBER, PROBLEMS, entries
from pytensor.graph.replace import vectorize_graph
from pytensor.graph.traversal import ancestors
from pytensor.tensor.blockwise import Blockwise

import pymc_hyperelastic as ph
from pymc_hyperelastic import PressureIntegral, inflation_pressure, inflation_stiffness

# The graph of every law is simplified, and run in Python. What users run is the default mode; it is
# held to the same numbers for laws of each kind: powers, exponentials, an end, and fibres.
SIMPLIFIED = "FAST_COMPILE"
LINKED = ("PowerLawNeoHookean", "Ogden", "CriscioneType", "Gent", "HolzapfelGasserOgden")

# What the package promises against adaptive quadrature.
PRESSURE_TOLERANCE = 1e-9
STIFFNESS_TOLERANCE = 1e-7
# At zero pressure a relative error has no meaning. There the pressure may be what a relative error
# of 1e-12 of the radius makes of it, a thousandth of what the table's A(1 + 1e-9) resolves; the
# oracle itself, differences of step 1e-15, tells pressures below 1e-25 of that scale not from 0.
ZERO_PRESSURE_RADIUS_ERROR = 1e-12
ORACLE_RESOLUTION = 1e-25
# Second derivatives divide by small numbers where first ones do, once more.
GRADIENT_TOLERANCE = 1e-7
# Rounding of a derivative that is a sum of terms of its dimension's size.
DERIVATIVE_ROUNDING = 1e-14
# The same with exponents up to 60, through which the rounding of their arguments enters multiplied.
STEEP_ROUNDING = 1e-13
# Exponents that count as 0 with noise, at which every energy of the table is all but linear.
SMALL_EXPONENT = 1e-6
# Two formulas for one integral with the same nodes: rounding, with exponents up to 60.
IDENTITY_TOLERANCE = 1e-12
# Linkers call other sinh and exp, which may differ in the last digit. The gradient by an input is a
# sum that may cancel; its rounding is that of the output over the input's size.
BACKEND_TOLERANCE = 1e-12
# Promised accuracy of the rule of default order: anywhere, and where measured curves lie (a >= A).
QUADRATURE_TOLERANCE = 1e-10
QUADRATURE_TOLERANCE_INFLATED = 1e-12
# At the end of their priors and the largest strains these laws have pressures of e^500 moduli.
# Their promise is for those up to a thousand, a hundred times what holds a tube in a body.
EXPONENTIAL = ("Demiray", "FungOrthotropic", *(name for name in LAWS if LAWS[name].slackens))
LARGEST_PRESSURE = 1e3
# Where the corners of the promise are not those of the prior.
CORNERS = {
    # Stress has a pole where I1 - 3, which is 10 in the widest tube, reaches the limit.
    ("Gent", "limit"): (15.0, 100.0),
    # Dispersed fibres are stretched across a wall that is compressed, by a factor of 1/0.6 here.
    ("GasserOgdenHolzapfel", "k2"): (0.0, 2.0),
}


class Response(NamedTuple):
    """Pressure and stiffness of a batch of problems, and the gradient of each by every input."""

    pressure: np.ndarray
    stiffness: np.ndarray
    pressure_gradient: np.ndarray
    stiffness_gradient: np.ndarray


@cache
def compiled_response(law, mode):
    """Compile one function a law and a linker; two weights choose whose gradient comes back."""
    inputs = pt.dvectors(5 + len(LAWS[law].entry_names))
    pressure, stiffness = PressureIntegral(strain_energy=LAWS[law].strain_energy)(*inputs)
    weights = pt.dscalars(2)
    cost = weights[0] * pressure.sum() + weights[1] * stiffness.sum()
    gradient = pt.stack(pytensor.grad(cost, inputs))
    # What matters is that C runs, not how fast: the compiler is done in half the time.
    with pytensor.config.change_flags(gcc__cxxflags=f"{pytensor.config.gcc__cxxflags} -O0".strip()):
        return pytensor.function([*inputs, *weights], [pressure, stiffness, gradient], mode=mode)


@cache
def response(law, mode=SIMPLIFIED):
    """Everything that the Op says about all problems of a law."""
    function = compiled_response(law, mode)
    columns = [
        np.array(column)
        for column in zip(*(p.inputs.values() for p in problems_of(law)), strict=True)
    ]
    pressure, stiffness, pressure_gradient = function(*columns, 1.0, 0.0)
    _, _, stiffness_gradient = function(*columns, 0.0, 1.0)
    return Response(*map(np.asarray, (pressure, stiffness, pressure_gradient, stiffness_gradient)))


def problems_of(law):
    return [problem for problem in PROBLEMS if problem.law == law]


def has_stiffness(problem):
    """False of a fibre-reinforced tube exactly at rest: there all its fibres slacken at once.

    Its pressure has one slope on either side, and no derivative.
    """
    at_rest = problem.internal_radius == problem.inner_radius and problem.axial_stretch == 1
    return not (LAWS[problem.law].slackens and at_rest and problem.opening_angle == 0)


def test_table_covers_what_is_promised():
    """At least 64 problems reach every end of the documented range, for every law."""
    zoo = {name for name in ph.strain_energy.__all__ if name in ph.list_strain_energies()}
    assert zoo == {law.strain_energy.name for law in LAWS.values()}
    assert len(PROBLEMS) >= 64
    assert len({problem.name for problem in PROBLEMS}) == len(PROBLEMS)
    for law in LAWS:
        table = problems_of(law)
        growth = {p.internal_radius / p.inner_radius for p in table}
        assert {1.0, 1 + 1e-9, 1 - 1e-9, 1.7} <= {round(g, 12) for g in growth}
        assert min(growth) <= 0.6
        assert {0.8, 1.0, 1.9} <= {p.axial_stretch for p in table}
        assert {0.0, 160.0} <= {p.opening_angle for p in table}
        assert {1.05, 2.5} <= {round(p.outer_radius / p.inner_radius, 12) for p in table}
    special = {0.0, 1e-12, -1e-12, 25.0, -25.0}
    assert special <= {p.parameters["alpha"] for p in problems_of("Ogden")}
    assert special | {20.0} <= {p.parameters["b"] for p in problems_of("CriscioneType")}
    assert {0.3, 1.0, 30.0} <= {p.parameters["n"] for p in problems_of("PowerLawNeoHookean")}


FIBRE_LAWS = [name for name, law in LAWS.items() if law.slackens]
SMOOTH_LAWS = [name for name in LAWS if name not in FIBRE_LAWS]
SLACKENING = ("slackening", "slackening, shortened")


@pytest.mark.parametrize("law", FIBRE_LAWS)
def test_table_has_walls_in_which_fibres_slacken(law):
    """Each fibre law has such walls; of dispersed or of four families in two places."""
    places = {
        p.name: len(oracles.slackening_radii(LAWS[law].energy, p.inputs, LAWS[law].switches))
        for p in problems_of(law)
    }
    for tube in SLACKENING:
        first = next(name for name in places if name.endswith(f", {tube}"))
        assert places[first] >= 1
    if law == "HolzapfelGasserOgden":
        assert any(n and name.endswith("slackening, stretched") for name, n in places.items())
    else:
        assert max(places.values()) == 2


CASES = [
    pytest.param(problem, index, id=problem.name)
    for law in LAWS
    for index, problem in enumerate(problems_of(law))
]


@pytest.mark.parametrize(("problem", "index"), CASES)
def test_problem_agrees_with_adaptive_quadrature(problem, index):
    """Pressure and stiffness have a small relative error, also where pressure is all but zero."""
    exact_pressure, exact_stiffness = problem.exact(), problem.exact("internal_radius")
    scale = abs(exact_stiffness) * problem.inner_radius
    # Where all fibres slacken the oracle's difference errs by its step, and not by the square.
    at_zero = abs(exact_pressure) <= ORACLE_RESOLUTION * scale or not has_stiffness(problem)
    allowed = (
        ZERO_PRESSURE_RADIUS_ERROR * scale if at_zero else PRESSURE_TOLERANCE * abs(exact_pressure)
    )
    values = response(problem.law)
    assert abs(values.pressure[index] - exact_pressure) <= allowed
    if has_stiffness(problem):
        assert abs(values.stiffness[index] - exact_stiffness) <= STIFFNESS_TOLERANCE * abs(
            exact_stiffness
        )


def test_tube_at_rest_carries_exactly_no_pressure():
    """At a = A, without axial stretch or cut, the pressure is 0 and not merely small."""
    for law in LAWS:
        at_rest = [problem.name.endswith("at rest") for problem in problems_of(law)]
        assert sum(at_rest) == 1
        assert (response(law).pressure[at_rest] == 0).all()


def test_neo_hookean_tube_has_its_closed_form():
    """With n = 1 the pressure is the textbook's, with axial stretch and opening angle too."""
    table = problems_of("PowerLawNeoHookean")
    chosen = [i for i, problem in enumerate(table) if problem.parameters["n"] == 1]
    assert len(chosen) > 4
    exact = [
        oracles.neo_hookean_pressure(table[i].parameters["mu"], *list(table[i].inputs.values())[:5])
        for i in chosen
    ]
    np.testing.assert_allclose(
        response("PowerLawNeoHookean").pressure[chosen], exact, rtol=PRESSURE_TOLERANCE, atol=0
    )
    exact = [
        oracles.neo_hookean_pressure(p.parameters["mu"], *list(p.inputs.values())[:5])
        for p in problems_of("NeoHookean")
    ]
    rounding = ZERO_PRESSURE_RADIUS_ERROR * np.abs(response("NeoHookean").stiffness)
    difference = np.abs(response("NeoHookean").pressure - exact)
    assert (difference <= PRESSURE_TOLERANCE * np.abs(exact) + rounding).all()


def test_ogdens_rubber_agrees_with_the_stretch_integral():
    """The three-term law of 1972 obeys the textbook's other integral."""
    radius = np.array([1.01, 1.2, 1.7, 2.5])
    rubber = LAWS["OgdenSeries(terms=3)"]

    def energy(*stretches):
        return rubber.energy(*stretches, **entries(OGDEN_1972_RUBBER))

    for outer, axial in ((1.5, 1.0), (2.5, 1.0), (2.0, 1.3)):
        pressure = inflation_pressure(
            ph.OgdenSeries(),
            radius,
            inner_radius=1.0,
            outer_radius=outer,
            axial_stretch=axial,
            **OGDEN_1972_RUBBER,
        )
        exact = [oracles.pressure_by_stretch_integral(energy, a, 1.0, outer, axial) for a in radius]
        np.testing.assert_allclose(
            pressure.eval(mode=AS_WRITTEN), exact, rtol=PRESSURE_TOLERANCE, atol=0
        )


ONE_MATERIAL = {
    "the neo-Hookean solid, by the second invariant's modulus": (
        (ph.MooneyRivlin(), {"c10": 10.0, "c01": 0.0}),
        (ph.NeoHookean(), {"mu": 20.0}),
    ),
    "the neo-Hookean solid, by the exponent of the power law": (
        (ph.PowerLawNeoHookean(), {"mu": 20.0, "n": 1.0}),
        (ph.NeoHookean(), {"mu": 20.0}),
    ),
    "the neo-Hookean solid, by the exponent of the exponential": (
        (ph.Demiray(), {"mu": 20.0, "b": 0.0}),
        (ph.NeoHookean(), {"mu": 20.0}),
    ),
    "the neo-Hookean solid, by the first coefficient": (
        (ph.Yeoh(), {"c1": 10.0, "c2": 0.0, "c3": 0.0}),
        (ph.NeoHookean(), {"mu": 20.0}),
    ),
    "the neo-Hookean solid, by fibres along the tube": (
        (ph.HolzapfelGasserOgden(), {"c": 20.0, "k1": 5.0, "k2": 1.0, "beta": 90.0}),
        (ph.NeoHookean(), {"mu": 20.0}),
    ),
    "the Mooney-Rivlin solid": (
        (ph.OgdenSeries(2), {"mu": [20.0, -3.0], "alpha": [2.0, -2.0]}),
        (ph.MooneyRivlin(), {"c10": 10.0, "c01": 1.5}),
    ),
    "Ogden's two powers": (
        (ph.OgdenSeries(2), {"mu": [1.5, -1.5], "alpha": [8.0, -8.0]}),
        (ph.Ogden(), {"mu": 6.0, "alpha": 8.0}),
    ),
    "aligned fibres": (
        (
            ph.GasserOgdenHolzapfel(),
            {"c": 3.0, "k1": 4.0, "k2": 0.5, "kappa": 0.0, "beta": 29.0},
        ),
        (ph.HolzapfelGasserOgden(), {"c": 3.0, "k1": 4.0, "k2": 0.5, "beta": 29.0}),
    ),
    "two families of four": (
        (
            ph.FourFiber(),
            {
                "c": 3.0,
                "k1_axial": 7.0,  # inflation does not feel it
                "k2_axial": 0.5,
                "k1_hoop": 0.0,
                "k2_hoop": 0.5,
                "k1_diagonal": 4.0,
                "k2_diagonal": 0.5,
                "beta": 29.0,
            },
        ),
        (ph.HolzapfelGasserOgden(), {"c": 3.0, "k1": 4.0, "k2": 0.5, "beta": 29.0}),
    ),
}


@pytest.mark.parametrize("pair", ONE_MATERIAL.values(), ids=ONE_MATERIAL)
def test_laws_contain_one_another(pair):
    """A law whose parameters make it another is inflated by the same pressures."""
    tubes = [p.inputs for p in problems_of("NeoHookean") if not p.name.endswith("at rest")]
    geometry = {name: np.array([tube[name] for tube in tubes]) for name in oracles.GEOMETRY}
    radius = geometry.pop("internal_radius")
    (one, parameters), (other, others) = pair
    value = inflation_pressure(one, radius, **geometry, **parameters).eval(mode=AS_WRITTEN)
    expected = inflation_pressure(other, radius, **geometry, **others).eval(mode=AS_WRITTEN)
    np.testing.assert_allclose(value, expected, rtol=IDENTITY_TOLERANCE, atol=0)


def test_ogden_and_criscione_type_are_one_pressure_model():
    """``b = α/2`` and ``a = (8μ/α²) cosh(½ α ln λz)`` give the same pressures and stiffnesses."""
    tubes = problems_of("Ogden")
    tubes = [problem for problem in tubes if abs(problem.parameters["alpha"]) > 1]
    inputs = {name: np.array([p.inputs[name] for p in tubes]) for name in tubes[0].inputs}
    mu, alpha = inputs["mu"], inputs["alpha"]
    mapped = {
        **inputs,
        "a": 8 * mu / alpha**2 * np.cosh(alpha / 2 * np.log(inputs["axial_stretch"])),
        "b": alpha / 2,
    }
    values = compiled_response("CriscioneType", SIMPLIFIED)(
        *(mapped[name] for name in (*oracles.GEOMETRY, "a", "b")), 1.0, 0.0
    )
    chosen = [abs(p.parameters["alpha"]) > 1 for p in problems_of("Ogden")]
    ogden = response("Ogden")
    np.testing.assert_allclose(values[0], ogden.pressure[chosen], rtol=IDENTITY_TOLERANCE, atol=0)
    np.testing.assert_allclose(values[1], ogden.stiffness[chosen], rtol=IDENTITY_TOLERANCE, atol=0)


# --- derivatives ---------------------------------------------------------------------------------

ORDINARY = ("inflated", "deflated", "in vivo", "opened")
SPECIAL = ("at rest", "just inflated")


def coincide(problem):
    """Whether hoop and diagonal fibres slacken in one place, from which axial stretch parts them.

    The derivative of stiffness by the axial stretch is not resolved there.
    """
    return problem.law == "FourFiber" and problem.axial_stretch == 1 and problem.slackens


def gradient_points(law, ordinary_tubes=ORDINARY):
    """Ordinary tubes of ordinary material, and the start of a curve with all parameters.

    Finite differences at the start of a curve cross the place where fibres slacken: instead of it,
    fibre laws have walls with that place within.
    """
    materials = [parameters for parameters, _ in LAWS[law].parameters]
    tubes = {
        p.name.rsplit(", ", 1)[-1]: p for p in problems_of(law) if p.parameters == materials[0]
    }
    points = [tubes[name].inputs for name in ordinary_tubes]
    if LAWS[law].slackens:
        return points + [p.inputs for p in problems_of(law) if p.slackens and not coincide(p)]
    return points + [
        {**tubes[name].inputs, **entries(parameters)}
        for parameters in materials
        for name in SPECIAL
    ]


def columns_of(points):
    return [np.array([point[name] for point in points]) for name in points[0]]


@pytest.mark.parametrize("law", LAWS)
def test_gradient_agrees_with_finite_differences(law):
    """PyTensor's own check holds in all inputs, at ordinary points and where 0/0 threatens."""
    op = PressureIntegral(strain_energy=LAWS[law].strain_energy)
    pytensor.gradient.verify_grad(
        lambda *inputs: pt.concatenate(op(*inputs)),
        columns_of(gradient_points(law)),
        n_tests=1,
        rng=np.random.default_rng(7),  # weights of the sum that is differentiated; any will do
        mode=AS_WRITTEN,
    )


EXACT_GRADIENTS = [
    *product(SMOOTH_LAWS, ["just inflated", "in vivo", "extreme"]),
    *product(FIBRE_LAWS, SLACKENING),
]


@pytest.mark.parametrize(("law", "tube"), EXACT_GRADIENTS)
def test_gradient_agrees_with_the_oracle(law, tube):
    """The derivative of pressure and of stiffness by every input is the exact one."""
    table = problems_of(law)
    index, problem = next((i, p) for i, p in enumerate(table) if p.name.endswith(f", {tube}"))
    assert problem.slackens == (tube in SLACKENING and law in FIBRE_LAWS)
    values = response(law)
    # A derivative that is all but zero is so to the rounding of what its dimension says.
    stiffness = STEEP_ROUNDING * abs(values.stiffness[index])
    for i, (name, size) in enumerate(problem.inputs.items()):
        rounding = stiffness / max(abs(size), 1)
        np.testing.assert_allclose(
            values.pressure_gradient[i, index],
            problem.exact(name),
            rtol=GRADIENT_TOLERANCE,
            atol=rounding * problem.internal_radius,
            err_msg=name,
        )
        if name == "axial_stretch" and coincide(problem):
            continue
        np.testing.assert_allclose(
            values.stiffness_gradient[i, index],
            problem.exact("internal_radius", name),
            rtol=GRADIENT_TOLERANCE,
            atol=rounding,
            err_msg=name,
        )


@pytest.mark.parametrize("law", LAWS)
def test_stiffness_is_the_gradient_of_pressure(law):
    """The second output and the first output's gradient are two computations of one number."""
    values = response(law)
    chosen = [has_stiffness(problem) for problem in problems_of(law)]
    np.testing.assert_allclose(
        values.pressure_gradient[0, chosen],
        values.stiffness[chosen],
        rtol=IDENTITY_TOLERANCE,
        atol=0,
    )


def test_chain_rule_through_inputs_that_depend_on_one_another():
    """A ratio of radii, or one variable in two places, obeys the chain rule, counted once."""
    inner, mu = pt.dscalars("inner", "mu")
    separate = pt.dscalars(7)
    together = [1.2 * inner, inner, 1.3 * inner, 1.1, 0.3, mu, mu]
    slope = [1.2, 1.0, 1.3, 0.0, 0.0]
    op = PressureIntegral(strain_energy=ph.Ogden())
    gradient = pytensor.grad(op(*together)[0], [inner, mu])
    partial = pytensor.function(
        separate, pytensor.grad(op(*separate)[0], separate), mode=AS_WRITTEN
    )
    partial = partial(8.4, 7.0, 9.1, 1.1, 0.3, 6.0, 6.0)
    value = pytensor.function([inner, mu], gradient, mode=AS_WRITTEN)(7.0, 6.0)
    # Pressure depends on ratios of radii alone: the chain rule's sum is 0 by the inner radius.
    scale = np.abs(slope[0] * partial[0])
    assert abs(value[0] - np.dot(slope, partial[:5])) <= IDENTITY_TOLERANCE * scale
    assert abs(value[0]) <= IDENTITY_TOLERANCE * scale
    np.testing.assert_allclose(value[1], partial[5] + partial[6], rtol=IDENTITY_TOLERANCE)


# Laws that have a special point of their own. Pressure of those with fibres has no second
# derivative at rest, where fibres slacken.
@pytest.mark.parametrize("law", ["PowerLawNeoHookean", "Ogden", "CriscioneType", "Demiray"])
def test_second_derivatives_are_right_at_the_special_points(law):
    """At zero pressure and an exponent of 0 curvatures are finite and exact, as Laplace needs."""
    energy = LAWS[law].strain_energy
    inputs = pt.dvectors(5 + len(energy.parameters))
    pressure, _ = PressureIntegral(strain_energy=energy)(*inputs)
    names = [*oracles.GEOMETRY, *energy.parameter_names]
    by = ["internal_radius", *energy.parameter_names]
    chosen = [inputs[names.index(name)] for name in by]
    hessian = [
        # A modulus is a factor: the gradient by it does not know it.
        pt.stack(pytensor.grad(gradient.sum(), chosen, disconnected_inputs="ignore"))
        for gradient in pytensor.grad(pressure.sum(), chosen)
    ]
    function = pytensor.function(inputs, pt.stack(hessian), mode=AS_WRITTEN)
    ordinary, *others = [parameters for parameters, _ in LAWS[law].parameters]
    materials = [ordinary, *(p for p in others if min(map(abs, p.values())) < SMALL_EXPONENT)]
    points = [
        point
        for point in gradient_points(law, ordinary_tubes=["in vivo"])
        if {name: point[name] for name in ordinary} in materials
    ]
    value = function(*columns_of(points))
    assert np.isfinite(value).all()

    def exact(*by):
        return np.array([LAWS[law].exact(point, *by) for point in points])

    # Many of them are 0, or as good as 0, at zero pressure. The size that a derivative has by its
    # dimension is that of stiffness times radius over the sizes of both inputs.
    size = dict(zip(points[0], np.maximum(np.abs(columns_of(points)), 1), strict=True))
    scale = np.abs(exact("internal_radius")) * size["internal_radius"]
    for i, first in enumerate(by):
        for j, second in enumerate(by[: i + 1]):
            expected = exact(first, second)
            rounding = DERIVATIVE_ROUNDING * scale / (size[first] * size[second])
            allowed = GRADIENT_TOLERANCE * np.abs(expected) + rounding + ORACLE_RESOLUTION
            assert (np.abs(value[i, j] - expected) <= allowed).all(), (first, second)


# --- where it runs -------------------------------------------------------------------------------


@pytest.mark.parametrize("law", LINKED)
@pytest.mark.parametrize("mode", ["NUMBA", "CVM", "JAX"])
def test_linkers_agree(law, mode):
    """Values and gradients of every problem are the same under numba, C, JAX and plain Python."""
    if mode == "JAX":
        pytest.importorskip("jax")
    elif not pytensor.config.cxx:
        pytest.skip("no C compiler")
    table = problems_of(law)
    chosen = [has_stiffness(problem) for problem in table]
    values = Response(*(x[..., chosen] for x in response(law, mode)))
    expected = Response(*(x[..., chosen] for x in response(law)))
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
    values = response(problem.law)
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


# --- the ends ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("law", "parameters"),
    [
        ("Ogden", {"mu": 6.0, "alpha": 1e5}),
        ("Ogden", {"mu": 6.0, "alpha": -1e5}),
        ("CriscioneType", {"a": 3.0, "b": 1e5}),
        ("PowerLawNeoHookean", {"mu": 20.0, "n": 1e9}),
    ],
)
def test_overflow_is_infinite_and_its_gradient_zero(law, parameters):
    """Where pressure overflows it is inf, so a likelihood rejects it; no gradient is ever NaN."""
    # The exponential limit of the power law overflows only in a tube that is blown up thirtyfold.
    geometry = (240.0 if law == "PowerLawNeoHookean" else 11.9, 7.0, 9.0, 1.0, 0.0)
    columns = [np.array([value]) for value in (*geometry, *parameters.values())]
    pressure, stiffness, gradient = compiled_response(law, "NUMBA")(*columns, 1.0, 0.0)
    assert pressure == np.inf
    assert not np.isfinite(stiffness)
    assert (gradient == 0).all()
    _, _, gradient = compiled_response(law, "NUMBA")(*columns, 0.0, 1.0)
    assert (gradient == 0).all()


@pytest.mark.parametrize(
    ("tube", "limit", "pressure", "everywhere"),
    [
        ("inflated far", 0.1, np.inf, True),
        ("deflated far", 0.5, -np.inf, False),
        # Tension and compression meet within this wall: the two infinities have no sum.
        ("slackening, shortened", 1e-3, np.nan, True),
    ],
)
def test_gents_wall_beyond_its_end_carries_no_finite_pressure(tube, limit, pressure, everywhere):
    """No gradient is NaN, and none is left where the whole wall is stretched beyond its limit."""
    geometry = next(p for p in problems_of("Gent") if p.name.endswith(f", {tube}")).inputs
    columns = [np.array([value]) for value in {**geometry, "limit": limit}.values()]
    function = compiled_response("Gent", "NUMBA")
    value, stiffness, gradient = function(*columns, 1.0, 0.0)
    np.testing.assert_array_equal(value, [pressure])
    assert not np.isfinite(stiffness)
    for gradient in (gradient, function(*columns, 0.0, 1.0)[2]):
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


TUBE = {"inner_radius": 7.0, "outer_radius": 9.0}
OGDEN = {"mu": 6.0, "alpha": 8.0}


@pytest.mark.parametrize("function", [inflation_pressure, inflation_stiffness])
@pytest.mark.parametrize(
    ("energy", "radius", "arguments", "error", "message"),
    [
        (ph.Ogden(), 8.0, {**TUBE, "mu": 6.0}, TypeError, r"Ogden.*'mu', 'alpha'.*\['mu'\]"),
        (ph.Ogden(), 8.0, {**TUBE, **OGDEN, "n": 1.0}, TypeError, r"Ogden.*'n'"),
        (ph.Ogden(), 8.0, {**TUBE, "mu": 6.0, "n": 1.0}, TypeError, r"'alpha'.*'n'"),
        (ph.Ogden, 8.0, {**TUBE, **OGDEN}, TypeError, "call the class"),
        ("Ogden", 8.0, {**TUBE, **OGDEN}, TypeError, "'Ogden'"),
        (
            ph.Ogden(),
            8.0,
            {**OGDEN, "inner_radius": 9.0, "outer_radius": 7.0},
            ValueError,
            "outer_radius must exceed inner_radius.*7.*9",
        ),
        (
            ph.Ogden(),
            8.0,
            {**OGDEN, "inner_radius": 7.0, "outer_radius": [9.0, 7.0]},
            ValueError,
            "outer_radius must exceed inner_radius",
        ),
        (ph.Ogden(), 8.0, {**TUBE, **OGDEN, "opening_angle": 60.0}, ValueError, "np.deg2rad"),
        (ph.Ogden(), [8.0, 0.0], {**TUBE, **OGDEN}, ValueError, "internal_radius must be positive"),
        (ph.Ogden(), np.nan, {**TUBE, **OGDEN}, ValueError, "internal_radius must be positive"),
        (
            ph.Ogden(),
            8.0,
            {**TUBE, **OGDEN, "inner_radius": -7.0},
            ValueError,
            "inner_radius must be positive.*-7",
        ),
        (
            ph.Ogden(),
            8.0,
            {**TUBE, **OGDEN, "axial_stretch": 0.0},
            ValueError,
            "axial_stretch must be positive",
        ),
    ],
)
def test_bad_input_is_refused_with_a_clear_message(
    function, energy, radius, arguments, error, message
):
    """Each mistake has one error, which names the argument and the value."""
    with pytest.raises(error, match=message):
        function(energy, radius, **arguments)


@pytest.mark.parametrize("law", LAWS)
def test_default_order_suffices_over_the_documented_range(law):
    """At every corner of the documented range the rule of order 32 says what one of 200 says.

    The errors are relative to the pressure and to the stiffness themselves, which is more than to
    the integral of the modulus; the corners are those of the geometry and of the default priors, as
    far as pressures of exponential laws are such as a tube may have.
    """
    energy = LAWS[law].strain_energy
    inputs = pt.dvectors(5 + len(LAWS[law].entry_names))
    function = pytensor.function(
        inputs,
        [
            *PressureIntegral(strain_energy=energy)(*inputs),
            *PressureIntegral(strain_energy=energy, order=200)(*inputs),
        ],
        mode=AS_WRITTEN,
    )
    geometry = [
        (0.6, 0.8, 1.0, 1.3, 1.7),
        (1.0,),
        (1.05, 2.5),
        (0.8, 1.0, 1.9),
        (0.0, np.deg2rad(160)),
    ]
    # A modulus is a factor; from 0 to 1 it is all the same.
    priors = []
    for p in energy.parameters:
        ends = (1.0,) if p.unit == "kPa" else CORNERS.get((energy.name, p.name), p.prior_range)
        priors += [ends] * (p.size or 1)
    corners = np.array(list(product(*geometry, *priors))).T
    if law in EXPONENTIAL:
        with np.errstate(over="ignore", invalid="ignore"):
            better_pressure = function(*corners)[2]
        corners = corners[:, np.abs(better_pressure) <= LARGEST_PRESSURE]
    assert set(corners[0]) == set(geometry[0])
    pressure, stiffness, better_pressure, better_stiffness = function(*corners)
    allowed = np.where(corners[0] >= 1, QUADRATURE_TOLERANCE_INFLATED, QUADRATURE_TOLERANCE)
    assert (abs(pressure - better_pressure) <= allowed * abs(better_pressure)).all()
    assert (abs(stiffness - better_stiffness) <= allowed * abs(better_stiffness)).all()
