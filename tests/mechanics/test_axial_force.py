"""The reduced axial force: its numbers, its gradients, and what ties it to the pressure."""

import numpy as np
import oracles
import pytensor
import pytensor.tensor as pt
import pytest
from pressures import in_python
from problems import AS_WRITTEN, LAWS, PROBLEMS
from pytensor.graph.replace import vectorize_graph
from pytensor.graph.traversal import ancestors
from pytensor.tensor.blockwise import Blockwise
from tiers import tiers

import pymc_hyperelastic as ph
from pymc_hyperelastic.mechanics.axial_force import AxialForceIntegral, AxialForceSlope

# What the package promises against adaptive quadrature.
FORCE_TOLERANCE = 1e-9
GRADIENT_TOLERANCE = 1e-8
# Force is that in the wall less the thrust of the pressure on the ends, and may be far smaller than
# either. Rounding is relative to the thrust, with exponents up to 60.
ROUNDING = 1e-13
# Two formulas for one number: rounding, with exponents up to 60.
IDENTITY_TOLERANCE = 1e-12

TUBES = (
    "just inflated",
    "inflated",
    "deflated",
    "stretched",
    "shortened",
    "opened wide",
    "in vivo",
    "extreme",
    "slackening",
    "slackening, stretched",
    "slackening, shortened",
)
# Where not only the first set of parameters is taken.
HARD_TUBES = ("in vivo", "slackening, stretched", "slackening, shortened")


def tube_of(problem):
    return problem.name.split(f"{problem.law}, ", 1)[1].split(", ", len(problem.inputs) - 5)[-1]


def problems_of(law):
    ordinary = LAWS[law].parameters[0][0]
    return [
        problem
        for problem in PROBLEMS
        if problem.law == law
        and tube_of(problem) in (TUBES if problem.parameters == ordinary else HARD_TUBES)
    ]


def force_of(law):
    """Inputs of the integral of a law, and its output."""
    inputs = pt.dvectors(5 + len(LAWS[law].entry_names))
    return inputs, AxialForceIntegral(strain_energy=LAWS[law].strain_energy)(*inputs)


def columns_of(problems):
    return [np.array(column) for column in zip(*(p.inputs.values() for p in problems), strict=True)]


@in_python
@pytest.mark.parametrize("law", LAWS)
def test_force_agrees_with_adaptive_quadrature(law, mode):
    """Force is exact relative to itself, or to rounding of the thrust that it is the rest of."""
    inputs, force = force_of(law)
    problems = problems_of(law)
    assert {tube_of(p) for p in problems} == set(TUBES)
    values = pytensor.function(inputs, force, mode=mode)(*columns_of(problems))
    for value, problem in zip(values, problems, strict=True):
        exact = problem.exact(quantity=oracles.layered_force)
        thrust = np.pi * problem.internal_radius**2 * abs(problem.exact())
        allowed = FORCE_TOLERANCE * abs(exact) + ROUNDING * thrust
        assert abs(value - exact) <= allowed, problem.name


@pytest.mark.parametrize("law", LAWS)
def test_tube_at_rest_carries_exactly_no_force(law):
    """At a = A, without axial stretch or cut, force is 0 and not merely small."""
    inputs, force = force_of(law)
    at_rest = [p for p in PROBLEMS if p.law == law and tube_of(p) == "at rest"]
    assert len(at_rest) == 1
    assert pytensor.function(inputs, force, mode=AS_WRITTEN)(*columns_of(at_rest)) == 0


# A law of each kind, for which hundred digits of all derivatives do not take long.
FIRST = ("NeoHookean", "Ogden", "FungOrthotropic", "HolzapfelGasserOgden")


@in_python
@pytest.mark.parametrize("law", tiers(LAWS, first=lambda law: law in FIRST))
def test_gradient_agrees_with_the_oracle(law, mode):
    """The derivative by every input is exact, also in walls within which fibres slacken."""
    inputs, force = force_of(law)
    chosen = ("in vivo", "slackening, shortened")
    ordinary = LAWS[law].parameters[0][0]
    problems = [p for p in problems_of(law) if p.parameters == ordinary and tube_of(p) in chosen]
    assert len(problems) == len(chosen)
    assert problems[1].slackens == LAWS[law].slackens
    gradient = pytensor.function(inputs, pytensor.grad(force.sum(), inputs), mode=mode)
    values = gradient(*columns_of(problems))
    thrusts = [np.pi * p.internal_radius**2 * abs(p.exact()) for p in problems]
    for i, (name, size) in enumerate(problems[0].inputs.items()):
        for value, problem, thrust in zip(values[i], problems, thrusts, strict=True):
            exact = problem.exact(name, quantity=oracles.layered_force)
            rounding = ROUNDING * thrust / max(abs(size), 1)
            assert abs(value - exact) <= GRADIENT_TOLERANCE * abs(exact) + rounding, name


@pytest.mark.parametrize("law", LAWS)
def test_gradient_agrees_with_finite_differences(law):
    """PyTensor's own check holds in all inputs, of ordinary materials in tubes of one size.

    Differences of forces that are a million times as large would hide all others.
    """
    ordinary = LAWS[law].parameters[0][0]
    chosen = ("stretched", "shortened", "in vivo", "slackening, shortened")
    op = AxialForceIntegral(strain_energy=LAWS[law].strain_energy)
    pytensor.gradient.verify_grad(
        op,
        columns_of(
            [p for p in problems_of(law) if tube_of(p) in chosen and p.parameters == ordinary]
        ),
        n_tests=1,
        rng=np.random.default_rng(7),  # weights of the sum that is differentiated; any will do
        mode=AS_WRITTEN,
    )


@pytest.mark.parametrize("law", LAWS)
def test_force_and_pressure_have_one_potential(law):
    r"""Work on the tube is stored: ``∂F/∂a = 2 π a λz ∂p/∂λz − π a² ∂p/∂a``.

    With ``U`` the energy stored per reference length, ``p d(π a² λz) + F dλz = dU``.
    """
    inputs, force = force_of(law)
    pressure, stiffness = ph.PressureIntegral(strain_energy=LAWS[law].strain_energy)(*inputs)
    radius, *_, axial, _ = inputs[:5]
    function = pytensor.function(
        inputs,
        [
            pytensor.grad(force.sum(), radius),
            2 * np.pi * radius * axial * pytensor.grad(pressure.sum(), axial),
            np.pi * radius**2 * stiffness,
        ],
        mode=AS_WRITTEN,
    )
    # At an axial stretch of 1 fibres along the tube slacken, and have no derivative by it. In walls
    # that are compressed each rule has an error of its own for the steepest materials.
    ordinary = LAWS[law].parameters[0][0]
    problems = [
        p
        for p in problems_of(law)
        if p.axial_stretch != 1
        and (p.parameters == ordinary or p.internal_radius >= p.inner_radius)
    ]
    slope, by_stretch, by_radius = function(*columns_of(problems))
    allowed = IDENTITY_TOLERANCE * (np.abs(by_stretch) + np.abs(by_radius))
    assert (np.abs(slope - (by_stretch - by_radius)) <= allowed).all()


def test_neo_hookean_tube_under_axial_stretch_has_its_closed_form():
    """A tube that keeps its shape, ``a = A/√λz``, carries ``μ (λz² − 1/λz)`` on its area."""
    inner, outer, mu = 1.0, 1.5, 10.0
    stretch = np.array([0.8, 1.0, 1.2, 1.9])
    force = ph.axial_force(
        ph.NeoHookean(),
        inner / np.sqrt(stretch),
        inner_radius=inner,
        outer_radius=outer,
        axial_stretch=stretch,
        mu=mu,
    )
    expected = mu * (stretch**2 - 1 / stretch) * np.pi * (outer**2 - inner**2) / stretch
    np.testing.assert_allclose(
        force.eval(mode=AS_WRITTEN), expected, rtol=IDENTITY_TOLERANCE, atol=ROUNDING
    )


def test_criscione_type_says_nothing_about_force():
    """Its energy feels inflation alone: what the wall carries is the thrust of the pressure."""
    inputs, force = force_of("CriscioneType")
    values = pytensor.function(inputs, force, mode=AS_WRITTEN)(
        *columns_of(problems_of("CriscioneType"))
    )
    assert (values == 0).all()


def test_vectorised_graph_is_the_loop():
    """A batch of parameters is one Op that broadcasts: no loop, the same numbers."""
    modulus, stiffening = pt.dscalars("k1", "k2")
    radius = np.linspace(0.8, 1.6, 5)
    force = ph.axial_force(
        ph.HolzapfelGasserOgden(),
        radius,
        inner_radius=1.0,
        outer_radius=1.5,
        axial_stretch=1.1,
        opening_angle=0.5,
        c=3.0,
        k1=modulus,
        k2=stiffening,
        beta=40.0,
    )
    batch = np.array([2.0, 5.0, 9.0]), np.array([0.1, 1.0, 3.0])
    symbols = {modulus: pt.dvector("k1"), stiffening: pt.dvector("k2")}
    vectorised = vectorize_graph(force, symbols)
    used = {v.owner.op for v in ancestors([vectorised]) if v.owner is not None}
    assert any(isinstance(op, AxialForceIntegral) for op in used)
    assert not any(isinstance(op, Blockwise) for op in used)
    loop = pytensor.function([modulus, stiffening], force, mode=AS_WRITTEN)
    together = pytensor.function([*symbols.values()], vectorised, mode=AS_WRITTEN)
    np.testing.assert_allclose(
        together(*batch),
        [loop(*row) for row in zip(*batch, strict=True)],
        rtol=IDENTITY_TOLERANCE,
    )


@pytest.mark.parametrize(
    ("energy", "arguments", "error", "message"),
    [
        (ph.Ogden(), {"outer_radius": 9.0, "mu": 6.0}, TypeError, r"'mu', 'alpha'.*\['mu'\]"),
        (ph.NeoHookean, {"outer_radius": 9.0, "mu": 6.0}, TypeError, "call the class"),
        ("NeoHookean", {"outer_radius": 9.0, "mu": 6.0}, TypeError, "'NeoHookean'"),
        (ph.NeoHookean(), {"mu": 6.0}, TypeError, "outer_radius is missing"),
        (
            ph.NeoHookean(),
            {"outer_radius": 6.0, "mu": 6.0},
            ValueError,
            "outer_radius must exceed inner_radius",
        ),
        (
            ph.OgdenSeries(2),
            {"outer_radius": 9.0, "mu": [1.0, 2.0, 3.0], "alpha": [1.0, 2.0]},
            TypeError,
            r"'mu' of OgdenSeries\(terms=2\) has 2 entries.*\(3,\)",
        ),
    ],
)
def test_bad_input_is_refused_with_a_clear_message(energy, arguments, error, message):
    """Each mistake has the error that it has of a pressure."""
    with pytest.raises(error, match=message):
        ph.axial_force(energy, 8.0, inner_radius=7.0, **arguments)


class NeoHookeanByItsEnergy(ph.StrainEnergy):
    """A law of which nothing but the energy is written."""

    parameters = (ph.Parameter("mu", r"\mu", "kPa", (0.0, 200.0), "shear modulus"),)

    def energy(self, radial, hoop, axial, *, mu):
        return mu / 2 * (radial**2 + hoop**2 + axial**2 - 3)


def test_an_energy_is_all_that_an_axial_force_needs():
    """A law without a closed axial response has the force of the same law with one."""
    tube = {"inner_radius": 7.0, "outer_radius": 9.0, "opening_angle": 1.0, "mu": 70.0}
    radius, axial = np.array([6.0, 7.0, 9.0]), np.array([0.9, 1.2, 1.9])
    forces = [
        ph.axial_force(energy, radius, axial_stretch=axial, **tube).eval(mode=AS_WRITTEN)
        for energy in (NeoHookeanByItsEnergy(), ph.NeoHookean())
    ]
    np.testing.assert_allclose(*forces, rtol=1e-11)  # rounding, of energies differentiated


# --- its slope ------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", LAWS)
def test_slope_is_the_derivative_by_the_radius(law):
    """What is written under the integral is PyTensor's derivative of it, which has its own oracle.

    In walls within which fibres slacken both are those of the pieces.
    """
    inputs, force = force_of(law)
    slope = AxialForceSlope(strain_energy=LAWS[law].strain_energy)(*inputs)
    expected = pytensor.grad(force.sum(), inputs[0])
    ordinary = LAWS[law].parameters[0][0]
    problems = [p for p in problems_of(law) if p.parameters == ordinary]
    found, expected = pytensor.function(inputs, [slope, expected], mode=AS_WRITTEN)(
        *columns_of(problems)
    )
    # Just above rest it is a difference of stresses, known to their rounding.
    rounding = IDENTITY_TOLERANCE * np.median(np.abs(expected))
    np.testing.assert_allclose(found, expected, rtol=GRADIENT_TOLERANCE, atol=rounding)


@pytest.mark.parametrize("law", ["NeoHookean", "HolzapfelGasserOgden"])
def test_slope_has_a_gradient(law):
    """By all inputs: likelihoods follow slopes, with an error of the diameter."""
    ordinary = LAWS[law].parameters[0][0]
    chosen = ("in vivo", "slackening, shortened")
    pytensor.gradient.verify_grad(
        AxialForceSlope(strain_energy=LAWS[law].strain_energy),
        columns_of(
            [p for p in problems_of(law) if tube_of(p) in chosen and p.parameters == ordinary]
        ),
        n_tests=1,
        rng=np.random.default_rng(7),  # weights of the sum that is differentiated; any will do
        mode=AS_WRITTEN,
    )
