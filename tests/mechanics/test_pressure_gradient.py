"""Gradients of pressure and stiffness by every input, and their values by every compiler."""

from itertools import product

import numpy as np
import oracles
import pytensor
import pytensor.tensor as pt
import pytest
from problems import AS_WRITTEN, LAWS
from tiers import deep, long, tiers
from wall_integrals import (
    SIMPLIFIED,
    assert_gradients_equal_difference_quotients,
    columns_of,
    compiled,
    has_stiffness,
    problems_of,
    response,
)

import pymc_hyperelastic as ph
from pymc_hyperelastic import PressureIntegral

# The oracle, with differences of step 1e-15, cannot distinguish a smaller number from 0.
ORACLE_RESOLUTION = 1e-25
# Second derivatives of the energy divide by small numbers once more than first derivatives.
GRADIENT_TOLERANCE = 1e-7
# Rounding of a derivative that is a sum of terms of its dimension's size.
DERIVATIVE_ROUNDING = 1e-14
# Compilers use different sinh and exp, which may differ in the last digit.
BACKEND_TOLERANCE = 1e-12


# A law with a series near 0, and one whose fibres slacken at two places of a wall.
FIRST = ("Ogden", "GasserOgdenHolzapfel")


@pytest.mark.parametrize("law", tiers(LAWS, first=lambda law: law in FIRST))
def test_gradients_of_pressure_and_stiffness_equal_difference_quotients(law):
    """By all inputs, also at zero pressure and where fibres slacken."""
    columns = columns_of(problems_of(law))
    stiffness = np.abs(compiled(law, "pressure")(*columns)[1])
    scales = [stiffness * columns[0], stiffness]
    assert_gradients_equal_difference_quotients(law, "pressure", scales)


# Laws that have a 0/0 of their own. The pressure of laws with fibres has no second derivative at
# rest, where fibres slacken.
@pytest.mark.parametrize(
    "law", ["Ogden", *deep(["PowerLawNeoHookean", "CriscioneType", "Demiray"])]
)
def test_second_derivatives_are_exact_at_zero_pressure_and_exponent_zero(law):
    """Laplace approximations use second derivatives."""
    energy = LAWS[law].strain_energy
    inputs = pt.dvectors(5 + len(energy.parameters))
    pressure, _ = PressureIntegral(strain_energy=energy)(*inputs)
    by = ["internal_radius", *energy.parameter_names]
    chosen = [inputs[[*oracles.GEOMETRY, *energy.parameter_names].index(name)] for name in by]
    hessian = [
        # The gradient by a modulus does not depend on the modulus.
        pt.stack(pytensor.grad(gradient.sum(), chosen, disconnected_inputs="ignore"))
        for gradient in pytensor.grad(pressure.sum(), chosen)
    ]
    function = pytensor.function(inputs, pt.stack(hessian), mode=AS_WRITTEN)
    problems = problems_of(law, "in vivo", ordinary=True)
    for p in problems_of(law, "just inflated"):
        if p.ordinary or min(map(abs, p.parameters.values())) < 1e-6:
            problems.append(p)
    value = function(*columns_of(problems))
    sizes = dict(zip(problems[0].inputs, np.abs(columns_of(problems)), strict=True))
    scale = sizes["internal_radius"] * np.abs([p.exact("internal_radius") for p in problems])
    for i, first in enumerate(by):
        for j, second in enumerate(by[: i + 1]):
            expected = np.array([p.exact(first, second) for p in problems])
            size = np.maximum(sizes[first], 1) * np.maximum(sizes[second], 1)
            rounding = DERIVATIVE_ROUNDING * scale / size + ORACLE_RESOLUTION
            allowed = GRADIENT_TOLERANCE * np.abs(expected) + rounding
            assert (np.abs(value[i, j] - expected) <= allowed).all(), (first, second)


# Each compiler with a law of another kind; all other combinations before a release.
EACH_COMPILER = [("Ogden", "JAX"), ("Gent", "CVM"), ("HolzapfelGasserOgden", "NUMBA")]
OF_COMPILERS = product(("Ogden", "Gent", "HolzapfelGasserOgden"), ("NUMBA", "CVM", "JAX"))


@pytest.mark.parametrize(
    ("law", "mode"),
    [*deep(EACH_COMPILER), *long(pair for pair in OF_COMPILERS if pair not in EACH_COMPILER)],
)
def test_all_compilers_give_the_values_and_gradients_of_plain_python(law, mode):
    if mode == "JAX":
        pytest.importorskip("jax")
    elif not pytensor.config.cxx:
        pytest.skip("no C compiler")
    chosen = [has_stiffness(problem) for problem in problems_of(law)]
    values, gradients = (x[..., chosen] for x in response(law, mode=mode))
    expected, expected_gradients = (x[..., chosen] for x in response(law, mode=SIMPLIFIED))
    assert np.isfinite(expected_gradients).all()
    size = np.abs(columns_of([p for p in problems_of(law) if has_stiffness(p)]))
    size[4:] = np.maximum(size[4:], 1)  # an angle or an exponent may be 0
    assert (np.abs(values - expected) <= BACKEND_TOLERANCE * np.abs(expected)).all()
    # The gradient by an input is a sum that may cancel: its rounding is that of output over input.
    allowed = np.abs(expected_gradients) + np.abs(expected)[:, None] / size
    assert (np.abs(gradients - expected_gradients) <= BACKEND_TOLERANCE * allowed).all()


class Root(ph.StrainEnergy):
    """A law whose stress is 0 at ``m = 0``, and has no derivative there."""

    parameters = (ph.Parameter("m", "m", "kPa", (0.0, 50.0), "modulus"),)

    def energy(self, radial, hoop, axial, *, m):
        return pt.sqrt(m) * 0 * (radial**2 + hoop**2 + axial**2 - 3)


@pytest.mark.parametrize(
    ("law", "value", "expected"), [(Root(), 0.0, np.nan), (ph.Demiray(), 1e4, 0)]
)
def test_gradient_is_replaced_by_zero_only_where_the_pressure_overflows(law, value, expected):
    """A NaN gradient at a finite pressure stays NaN."""
    parameters = {name: pt.dscalar(name) for name in law.parameter_names}
    pressure = ph.inflation_pressure(law, [8.0, 12.0], ph.Tube(7.0, 9.0), **parameters)
    outputs = [pressure.sum(), *pytensor.grad(pressure.sum(), [*parameters.values()])]
    found, *gradients = pytensor.function([*parameters.values()], outputs, mode=AS_WRITTEN)(
        *[value] * len(parameters)
    )
    assert np.isfinite(found) == np.isnan(expected)
    np.testing.assert_array_equal(gradients, expected)
