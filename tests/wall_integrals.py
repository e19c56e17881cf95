"""Outputs and gradients of the integrals over the wall, at the problems of `problems.PROBLEMS`.

Each law, quantity and mode is compiled once for all tests.
"""

from functools import cache

import numpy as np
import pytensor
import pytensor.tensor as pt
from problems import AS_WRITTEN, LAWS, PROBLEMS

from pymc_hyperelastic import PressureIntegral
from pymc_hyperelastic.mechanics.integrals import AxialForceIntegral, MaterialIntegral

SIMPLIFIED = "FAST_COMPILE"
INTEGRALS = {
    "pressure": PressureIntegral,  # pressure, stiffness
    "force": AxialForceIntegral,  # force, slope
    "material": MaterialIntegral,  # stored energy, hoop and axial modulus, each times the area
}
# Tubes at which integrals of fibre laws can be differentiated by every input: at an axial stretch
# of exactly 1 axial fibres slacken. Fibres slacken within the walls of the last two.
SMOOTH_TUBES = ("shortened", "in vivo", "extreme", "slackening, stretched", "slackening, shortened")

# Step of difference quotients, relative to an input, or absolute for inputs below 1. The formula is
# of the fourth order: with exponents up to 200 its error is some (200 STEP)^4/30, or 5e-9.
STEP = 1e-4
DIFFERENCE_TOLERANCE = 1e-7
# Rounding error between two formulas for one integral with the same nodes; exponents reach 60.
IDENTITY_TOLERANCE = 1e-12


def problems_of(law, *tubes, ordinary=False):
    """Return the problems of a law: in the named tubes, with the ordinary parameters."""
    return [
        p
        for p in PROBLEMS
        if p.law == law and (p.tube in tubes or not tubes) and (p.ordinary or not ordinary)
    ]


def columns_of(problems):
    """Return each input of the integrals as an array over the problems."""
    return [np.array(column) for column in zip(*(p.inputs.values() for p in problems), strict=True)]


def outputs_of(law, quantity):
    """Return symbolic inputs, each a vector, and the outputs of the integrals of a quantity."""
    inputs = pt.dvectors(5 + len(LAWS[law].entry_names))
    integral = INTEGRALS[quantity](strain_energy=LAWS[law].strain_energy)
    return inputs, integral(*inputs, return_list=True)


@cache
def compiled(law, quantity, mode=AS_WRITTEN):
    """Compile the outputs as a function of the inputs."""
    inputs, outputs = outputs_of(law, quantity)
    return pytensor.function(inputs, outputs, mode=mode)


@cache
def compiled_gradient(law, quantity, mode=AS_WRITTEN):
    """Compile the outputs and the gradient of their weighted sum; the weights come last."""
    inputs, outputs = outputs_of(law, quantity)
    weights = pt.dvector()
    cost = sum(weights[i] * output.sum() for i, output in enumerate(outputs))
    gradient = pt.stack(pytensor.grad(cost, inputs))
    # The C compiler takes half of the time when it does not optimise.
    with pytensor.config.change_flags(gcc__cxxflags=f"{pytensor.config.gcc__cxxflags} -O0".strip()):
        return pytensor.function([*inputs, weights], [*outputs, gradient], mode=mode)


@cache
def response(law, quantity="pressure", mode=AS_WRITTEN):
    """Return outputs (output, problem) and gradients (output, input, problem) of all problems."""
    columns = columns_of(problems_of(law))
    function, count = compiled_gradient(law, quantity, mode), len(outputs_of(law, quantity)[1])
    results = [function(*columns, weights) for weights in np.eye(count)]
    return np.array(results[0][:count]), np.array([result[-1] for result in results])


def has_stiffness(problem):
    """Return False for a tube at rest with fibres: its pressure has a kink where they slacken."""
    at_rest = problem.internal_radius == problem.inner_radius and problem.axial_stretch == 1
    return not (LAWS[problem.law].slackens and at_rest and problem.opening_angle == 0)


def difference_quotients(function, columns):
    """Return derivatives (output, input, point) of all outputs, from one call of the function."""
    columns = np.array(columns)
    steps = STEP * np.maximum(np.abs(columns), 1)
    steps[:3] = STEP * columns[:3]  # radii may be far below 1 mm, and walls thin
    moved = []
    for number in range(len(columns)):
        for factor in (-2, -1, 1, 2):
            moved.append(columns.copy())
            moved[-1][number] += factor * steps[number]
    values = np.array(function(*np.concatenate(moved, axis=1)))
    far_below, below, above, far_above = np.moveaxis(
        values.reshape(len(values), len(columns), 4, -1), 2, 0
    )
    return (8 * (above - below) - (far_above - far_below)) / (12 * steps)


def assert_gradients_equal_difference_quotients(law, quantity, scales, ordinary=False):
    """Compare all gradients, with `scales` (output, problem): the sizes of the outputs.

    The second output must be the derivative of the first by the internal radius, to rounding.
    A derivative by an input has the size of the output over that of the input. With `ordinary`, or
    if the law has fibres, materials have the ordinary parameters.
    """
    slackens = LAWS[law].slackens
    chosen = [
        i
        for i, p in enumerate(problems_of(law))
        if (p.ordinary or not (ordinary or slackens)) and (p.tube in SMOOTH_TUBES or not slackens)
    ]
    columns = np.array(columns_of(problems_of(law)))[:, chosen]
    function, count = compiled_gradient(law, quantity), len(scales)
    values, found = (x[..., chosen] for x in response(law, quantity))
    rounding = IDENTITY_TOLERANCE * (np.abs(values[1]) + np.asarray(scales)[1, chosen])
    assert (np.abs(values[1] - found[0, 0]) <= rounding).all()
    expected = difference_quotients(lambda *x: function(*x, np.ones(count))[:count], columns)
    sizes = np.maximum(np.abs(columns), 1)
    sizes[:3] = columns[:3]
    allowed = np.abs(expected) + np.asarray(scales)[:, None, chosen] / sizes
    wrong = np.abs(found - expected) > DIFFERENCE_TOLERANCE * allowed
    assert not wrong.any(), np.argwhere(wrong)[:3]
