"""The derivatives of the pressure integral."""

from itertools import product

import numpy as np
import oracles
import pytensor
import pytensor.tensor as pt
import pytest
from pressures import (
    FIBRE_LAWS,
    SLACKENING,
    SMOOTH_LAWS,
    columns_of,
    has_stiffness,
    in_python,
    problems_of,
    response,
)
from problems import AS_WRITTEN, LAWS, entries
from tiers import tiers

import pymc_hyperelastic as ph
from pymc_hyperelastic import PressureIntegral

# The oracle's differences of step 1e-15 do not tell what is smaller from 0.
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


def is_first(case):
    """Whether a law and its tube belong to the first tier: of the largest law none does."""
    law, tube = case
    return tube == ("slackening" if law in FIBRE_LAWS else "in vivo") and law != "FourFiber"


@in_python
@pytest.mark.parametrize(("law", "tube"), tiers(EXACT_GRADIENTS, first=is_first))
def test_gradient_agrees_with_the_oracle(law, tube, mode):
    """The derivative of pressure and of stiffness by every input is the exact one."""
    table = problems_of(law)
    index, problem = next((i, p) for i, p in enumerate(table) if p.name.endswith(f", {tube}"))
    assert problem.slackens == (tube in SLACKENING and law in FIBRE_LAWS)
    values = response(law, mode)
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


@in_python
@pytest.mark.parametrize("law", LAWS)
def test_stiffness_is_the_gradient_of_pressure(law, mode):
    """The second output and the first output's gradient are two computations of one number."""
    values = response(law, mode)
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
