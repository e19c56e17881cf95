"""Every evidence of the table a second time, from PyMC's own density on its unconstrained scale.

What is wrong in a constant, a Jacobian, a datum or a quadrature shows: the first value knows
nothing of PyMC, and the second nothing but PyMC's density.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
import pytest
from evidences import PROBLEMS
from problems import AS_WRITTEN
from pytensor.compile.builders import OpFromGraph
from pytensor.compile.rewriting import inline_ofg_node
from pytensor.graph.fg import FunctionGraph
from pytensor.graph.replace import vectorize_graph
from pytensor.graph.rewriting.basic import in2out, node_rewriter
from scipy import optimize, stats
from scipy.special import gammaln, logsumexp

SEED = 20250
# Two quadratures agree to this; a constant that is left out shows in the first digits.
QUADRATURE_TOLERANCE = 1e-3
# Estimates by draws: their own standard error, and how large it may be, in nats.
STANDARD_ERRORS, LARGEST_ERROR = 4, 0.01
# Numbers that an evaluation in one piece may hold.
PIECE = 300_000

Function = Callable[[np.ndarray], np.ndarray]


@node_rewriter(None)
def without_inner_graphs(fgraph, node):
    """Expand ``logsumexp`` and its like, which would be evaluated point by point."""
    return inline_ofg_node(node) if isinstance(node.op, OpFromGraph) else None


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
        points = pt.matrix("points")
        columns, replaced, places = 0, {}, {}
        for value in values:
            size = int(np.prod(value.type.shape))
            part = points[:, columns : columns + size]
            replaced[value] = part.reshape((-1, *value.type.shape))
            places[model.values_to_rvs[value].name] = list(range(columns, columns + size))
            columns += size
        graph = FunctionGraph(outputs=[model.logp()], clone=False)
        in2out(without_inner_graphs).rewrite(graph)
        logp = graph.outputs[0]
        batched = vectorize_graph([logp, *pt.grad(logp, values)], replace=replaced)
        parts = [part.reshape((points.shape[0], -1)) for part in batched[1:]]
        evaluate = pytensor.function([points], batched[0], mode=AS_WRITTEN)
        gradient = pytensor.function([points], pt.concatenate(parts, axis=1), mode=AS_WRITTEN)
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
    "horseshoe": lambda p: p.normal("standard").factors(71, local=(-13, 9)).grid(35, tau=(-13, 6)),
    "spike_and_slab": lambda p: p.factors(401, slope=(-6, 6)),
    "correlated_normal_10": normal_everywhere,
    "correlated_normal_30": normal_everywhere,
    "correlated_normal_50": normal_everywhere,
    "ridge_sum": normal_everywhere,
    "ridge_product": lambda p: p.normal("offset").grid(81, first=(-5, 3)).grid(81, second=(-9, 2)),
    "banana_2": lambda p: p.normal("second").grid(101, first=(-6, 6)),
    "banana_8": lambda p: p.normal("second", "x").grid(101, first=(-6, 6)),
    "shells": lambda p: p.grid(401, x=(-3.8, 2.2)),
    "logistic_3": lambda p: p.grid(45, slope=(-5, 5)),
    "logistic_6": lambda p: p.factors(61, even=(-7, 7), odd=(-7, 7)),
    "gaussian_process": lambda p: p.grid(
        31, length=(-1.5, 2.5), amplitude=(-2.5, 2.2), noise=(-4, 1)
    ),
    "correlation": lambda p: p.grid(29, factor=(-2.2, 2.4)),
    "label_switching_2": lambda p: p.grid(201, mean=(-15, 15)),
    "label_switching_3": lambda p: p.grid(61, mean=(-9, 9)),
    "many_observations": lambda p: p.normal("mu").grid(15, sigma=(0.68, 0.71)),
    "far_from_the_prior": normal_everywhere,
    "edges": lambda p: (
        p.grid(61, fraction=(-5, 15)).grid(61, size=(-15, 2)).grid(61, chance=(-15, 0))
    ),
    "pumps": lambda p: p.factors(61, rate=(-12, 4)).grid(31, shape=(-4, 4), inverse_scale=(-8, 4)),
    "lifetimes": lambda p: p.grid(101, shape=(-6, 3), scale=(-10, 14)),
    "two_locations": lambda p: p.grid(601, location=(-25, 35)).grid(25, spread=(-6, 1)),
    "two_decays": lambda p: p.normal("amplitude").grid(151, rate=(-4, 5)),
}


@pytest.mark.parametrize("name", CONFIRMED)
def test_density_of_pymc_integrates_to_the_evidence(name):
    """Quadrature of PyMC's own density, exact where it is a parabola, gives the evidence."""
    problem = PROBLEMS[name]
    density = Density.of(problem.model())
    assert density.unknowns == problem.unknowns
    found = CONFIRMED[name](density).log_evidence()
    assert found == pytest.approx(problem.log_evidence(), abs=QUADRATURE_TOLERANCE)


# --- by draws ------------------------------------------------------------------------------------


DRAWS = 100_000

Proposal = Callable[[Density, np.random.Generator], tuple[np.ndarray, np.ndarray]]
"""Draws points on the unconstrained scale, and knows the log density of what it draws from."""


def around_modes(*starts: list[float]) -> Proposal:
    """Student's densities at modes, with their curvatures, in proportion to Laplace's masses."""

    def proposal(density, rng):
        parts, log_mass = [], []
        for start in starts:
            mode = optimize.minimize(
                lambda x: -density.evaluate(x[None])[0],
                np.array(start),
                jac=lambda x: -density.gradient(x[None])[0],
            ).x
            steps = 1e-4 * np.eye(len(mode))
            rise, fall = density.gradient(mode + steps), density.gradient(mode - steps)
            shape = np.linalg.inv((fall - rise) / 2e-4)
            parts.append(stats.multivariate_t(mode, (shape + shape.T) / 2, df=5))
            log_mass.append(density.evaluate(mode[None])[0] + np.linalg.slogdet(shape)[1] / 2)
        share = np.exp(log_mass - logsumexp(log_mass))
        counts = rng.multinomial(DRAWS, share)
        drawn = [part.rvs(n, random_state=rng) for part, n in zip(parts, counts, strict=True)]
        points = np.concatenate(drawn)
        log_density = np.stack([part.logpdf(points) for part in parts], axis=1)
        return points, logsumexp(log_density, axis=1, b=share)

    return proposal


def on_a_sphere(density, rng):
    """Directions of equal chance; radii as they were measured."""
    radius = rng.normal(4.0, 0.05, DRAWS)
    direction = rng.normal(size=(DRAWS, density.unknowns))
    points = radius[:, None] * direction / np.linalg.norm(direction, axis=1)[:, None]
    log_area = np.log(2) + density.unknowns / 2 * np.log(np.pi) - gammaln(density.unknowns / 2)
    log_area += (density.unknowns - 1) * np.log(radius)
    return points, stats.norm.logpdf(radius, 4.0, 0.05) - log_area


def one_for_all(density, rng):
    """All but one of the Cauchy variables from the prior, and the one makes up for what lacks."""
    scale = np.array([0.1, 0.2, 0.3, 0.5, 0.8, 1.0])
    prior, share = stats.cauchy(0, scale), scale / scale.sum()
    points = prior.rvs((DRAWS, 6), random_state=rng)
    chosen = np.arange(DRAWS), rng.choice(6, DRAWS, p=share)
    points[chosen] += rng.normal(10.0, 0.2, DRAWS) - points.sum(axis=1)
    log_density = prior.logpdf(points)
    others = log_density.sum(axis=1)[:, None] - log_density
    measured = stats.norm.logpdf(points.sum(axis=1), 10.0, 0.2)
    return points, logsumexp(others, axis=1, b=share) + measured


def beyond_a_cut(density, rng):
    """Across a plane only what lies beyond it, along it as the prior has it, tilted."""
    across = np.array([1, 0.5, -0.2, 0, 0, 0])
    length = np.linalg.norm(across)
    beyond = stats.truncnorm(3.0 / length, np.inf)
    points = rng.normal(size=(DRAWS, 6))
    height = beyond.rvs(DRAWS, random_state=rng)
    points += np.outer(height - points @ across / length, across / length)
    points[:, 3] += 0.7
    along = stats.norm.logpdf(points - 0.7 * np.eye(6)[3]).sum(axis=1) - stats.norm.logpdf(height)
    return points, along + beyond.logpdf(height)


DRAWN: dict[str, Proposal] = {
    "half_space": beyond_a_cut,
    "narrow_and_wide": around_modes([2.0, -1.5, 1.0, 2.5], [-2.0, 1.0, 0.5, -1.5]),
    "shell_10": on_a_sphere,
    "cauchy_sum": one_for_all,
    "category_shares": around_modes([0.0] * 5),
}


@pytest.mark.parametrize("name", DRAWN)
def test_density_of_pymc_has_the_evidence_for_its_mean_weight(name):
    """The mean ratio of PyMC's own density to that of a proposal gives the evidence."""
    problem = PROBLEMS[name]
    density = Density.of(problem.model())
    assert density.unknowns == problem.unknowns
    points, log_proposal = DRAWN[name](density, np.random.default_rng(SEED))
    log_weight = density.evaluate(points) - log_proposal
    weight = np.exp(log_weight - log_weight.max())
    error = weight.std() / weight.mean() / np.sqrt(len(weight))
    assert error < LARGEST_ERROR
    found = log_weight.max() + np.log(weight.mean())
    assert abs(found - problem.log_evidence()) < STANDARD_ERRORS * error


def test_every_problem_is_confirmed():
    """No value of the table is taken on trust."""
    assert sorted([*CONFIRMED, *DRAWN]) == sorted(PROBLEMS)
