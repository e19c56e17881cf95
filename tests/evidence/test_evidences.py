"""Every evidence of the table a second time, from PyMC's own density on its unconstrained scale.

What is wrong in a constant, a Jacobian, a datum or a quadrature shows: the first value knows nothing
of PyMC, and the second nothing but PyMC's density.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
import pytest
from evidences import PROBLEMS
from pytensor.graph.replace import vectorize_graph
from scipy import optimize, stats
from scipy.special import logsumexp

SEED = 20250
# Two quadratures agree to this; a constant that is left out shows in the first digits.
QUADRATURE_TOLERANCE = 1e-3
# Estimates by draws: their own standard error, and how large it may be, in nats.
STANDARD_ERRORS, LARGEST_ERROR = 4, 0.01
# Numbers that an evaluation in one piece may hold.
PIECE = 300_000

Function = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Density:
    """Log density at many points (point, unknown), some of whose unknowns may be integrated out.

    Each method integrates over some variables by name and returns a density that ignores them.
    """

    evaluate: Function
    gradient: Function
    places: dict[str, list[int]]  # columns of each variable

    @classmethod
    def of(cls, model: pm.Model) -> "Density":
        """PyMC's log density, with the Jacobians of its transforms, and its gradient."""
        values = model.continuous_value_vars
        initial = model.initial_point()
        points = pt.matrix("points")
        columns, replaced, places = 0, {}, {}
        for value in values:
            shape = initial[value.name].shape
            size = int(np.prod(shape))
            part = points[:, columns : columns + size]
            replaced[value] = part.reshape((-1, *shape)).astype(value.dtype)
            places[model.values_to_rvs[value].name] = list(range(columns, columns + size))
            columns += size
        logp = model.logp()
        batched = vectorize_graph([logp, *pt.grad(logp, values)], replace=replaced)
        parts = [part.reshape((points.shape[0], -1)) for part in batched[1:]]
        evaluate = pytensor.function([points], batched[0])
        gradient = pytensor.function([points], pt.concatenate(parts, axis=1))
        observed = sum(model.rvs_to_values[data].data.size for data in model.observed_RVs)
        width = max(columns, observed)
        return cls(in_pieces(evaluate, width), in_pieces(gradient, width), places)

    @property
    def unknowns(self) -> int:
        return sum(len(columns) for columns in self.places.values())

    def log_evidence(self) -> float:
        """The constant that is left when everything is integrated out."""
        return float(self.evaluate(np.zeros((1, self.unknowns)))[0])

    def normal(self, *names: str, independent: bool = False) -> "Density":
        """Integrate over variables in which the log density is a parabola, whatever the others are.

        A parabola's integral is exact from its gradients at two points for each unknown, or at two
        points in all where the unknowns are independent.
        """
        block = [column for name in names for column in self.places[name]]
        steps = np.zeros((1 if independent else len(block), self.unknowns))
        steps[:, block] = 1.0 if independent else np.eye(len(block))

        def integrated(points):
            stacked = np.concatenate([points[:, None], points[:, None] + steps], axis=1)
            gradients = self.gradient(stacked.reshape(-1, self.unknowns))[:, block]
            gradients = gradients.reshape(len(points), len(steps) + 1, len(block))
            first, curvature = gradients[:, 0], gradients[:, :1] - gradients[:, 1:]
            peak = points.copy()
            if independent:
                peak[:, block] += first / curvature[:, 0]
                log_det = np.log(curvature).sum(axis=(1, 2))
            else:
                peak[:, block] += np.linalg.solve(curvature, first[..., None])[..., 0]
                log_det = np.linalg.slogdet(curvature)[1]
            return self.evaluate(peak) + (len(block) * np.log(2 * np.pi) - log_det) / 2

        return replace(self, evaluate=integrated)

    def grid(self, nodes: int, **ranges: tuple[float, float]) -> "Density":
        """Integrate over variables by the trapezoid rule, of high order for a density's bell."""
        columns = {column: ends for name, ends in ranges.items() for column in self.places[name]}
        return replace(self, evaluate=self._trapezoid(columns, nodes))

    def factors(self, nodes: int, **ranges: tuple[float, float]) -> "Density":
        """Integrate over variables of which any one entry leaves the others independent of it.

        The first entries of all variables named are integrated over together, and so on.
        """
        blocks = zip(*(self.places[name] for name in ranges), strict=True)
        rules = [
            self._trapezoid(dict(zip(block, ranges.values(), strict=True)), nodes)
            for block in blocks
        ]

        def integrated(points):
            at = self.evaluate(points)
            return at + sum(rule(points) - at for rule in rules)

        return replace(self, evaluate=integrated)

    def _trapezoid(self, ranges: dict[int, tuple[float, float]], nodes: int) -> Function:
        axes = [np.linspace(*ends, nodes) for ends in ranges.values()]
        mesh = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1)
        log_cell = sum(np.log(axis[1] - axis[0]) for axis in axes)

        def integrated(points):
            stacked = np.repeat(points[:, None], len(mesh), axis=1)
            stacked[..., list(ranges)] = mesh
            values = self.evaluate(stacked.reshape(-1, self.unknowns))
            values = values.reshape(len(points), len(mesh))
            return logsumexp(values, axis=1) + log_cell

        return integrated


def in_pieces(function: Function, width: int) -> Function:
    """Evaluate at many points without holding everything at once."""
    size = max(1, PIECE // width)

    def evaluate(points):
        pieces = [function(points[i : i + size]) for i in range(0, len(points), size)]
        return np.concatenate(pieces)

    return evaluate


def normal_everywhere(density):
    return density.normal(*density.places)


CONFIRMED: dict[str, Callable[[Density], Density]] = {
    "regression_3": normal_everywhere,
    "regression_10": normal_everywhere,
    "regression_10_small_noise": lambda p: p.normal("slope").grid(81, sigma=(-6, 0)),
    "regression_20_small_noise": lambda p: p.normal("slope").grid(81, sigma=(-6, 0)),
    "regression_50": lambda p: p.normal("slope").grid(61, sigma=(-3, 2)),
    "conjugate_regression": lambda p: p.normal("slope").grid(81, variance=(-4, 4)),
    "sine_frequency": lambda p: p.normal("amplitude").grid(
        101, frequency=(-0.731, -0.717), sigma=(-4.5, -1.5)
    ),
    "periodogram": lambda p: p.normal("amplitude").grid(4001, frequency=(-18, 18)),
    "three_peaks": lambda p: p.grid(131, x=(-8.5, 10.5)),
    "eight_schools": lambda p: (
        p.normal("effect", independent=True).grid(41, mu=(-40, 50)).grid(101, tau=(-18, 8))
    ),
    "eight_schools_noncentred": lambda p: p.normal("mu", "standard").grid(201, tau=(-18, 8)),
    "groups_100": lambda p: p.normal("group", independent=True).grid(41, mu=(2, 4), tau=(-4, 1)),
    "groups_1000": lambda p: p.normal("group", independent=True).grid(
        41, mu=(2.7, 3.3), tau=(-0.7, 0.3)
    ),
    "funnel_4": lambda p: p.normal("x", independent=True).grid(101, v=(-25, 25)),
    "funnel_10": lambda p: p.normal("x", independent=True).grid(201, v=(-25, 25)),
    "random_walk": lambda p: p.normal("state").grid(41, noise=(-7, 1.5)).grid(41, step=(-10, 2)),
    "horseshoe": lambda p: (
        p.normal("standard").factors(101, local=(-14, 10)).grid(41, tau=(-14, 7))
    ),
}


@pytest.mark.parametrize("name", CONFIRMED)
def test_density_of_pymc_integrates_to_the_evidence(name):
    """Quadrature of PyMC's own density, exact where it is a parabola, gives the evidence."""
    problem = PROBLEMS[name]
    density = Density.of(problem.model())
    assert density.unknowns == problem.unknowns
    found = CONFIRMED[name](density).log_evidence()
    assert found == pytest.approx(problem.log_evidence(), abs=QUADRATURE_TOLERANCE)
