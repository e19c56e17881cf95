"""What the pressure integral says of every problem of the table: compiled once, for all tests."""

from functools import cache
from typing import NamedTuple

import numpy as np
import pytensor
import pytensor.tensor as pt
import pytest
from problems import AS_WRITTEN, LAWS, PROBLEMS
from tiers import deep

from pymc_hyperelastic import PressureIntegral

SIMPLIFIED = "FAST_COMPILE"

in_python = pytest.mark.parametrize(
    "mode", [AS_WRITTEN, *deep([SIMPLIFIED])], ids=["as written", "simplified"]
)
"""The graph of a law as it is, and simplified, which takes ten times as long to compile."""

FIBRE_LAWS = [name for name, law in LAWS.items() if law.slackens]
SMOOTH_LAWS = [name for name in LAWS if name not in FIBRE_LAWS]
SLACKENING = ("slackening", "slackening, shortened")


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
def response(law, mode):
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


def columns_of(points):
    return [np.array([point[name] for point in points]) for name in points[0]]
