"""Log prior and log likelihood of a model, with their gradients, for many points at once."""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from math import prod
from typing import Any, NamedTuple

import numpy as np
import pymc as pm
import pytensor.tensor as pt
from numpy.typing import NDArray
from pymc.logprob.transforms import CircularTransform
from pytensor.gradient import NullTypeGradError
from pytensor.tensor.variable import TensorVariable
from scipy.special import logsumexp

from pymc_hyperelastic.evidence.batched import (
    BatchedFunction,
    prior_sampler,
    side_by_side,
    value_shapes,
    without_traces,
)
from pymc_hyperelastic.evidence.checks import check_continuous
from pymc_hyperelastic.evidence.mixture import Array

# Log prior and log likelihood of points, shape (n, d).
Score = Callable[[Array], tuple[Array, Array]]
# Draws of the prior, shape (count, d).
DrawPrior = Callable[[int, np.random.Generator], Array]


class Evaluation(NamedTuple):
    """Log prior and log likelihood of points; an impossible point has ``−inf``."""

    log_prior: Array
    log_likelihood: Array
    nan_count: int
    """Number of points whose density is NaN or ``+inf``: they count as impossible."""


class Derivatives(NamedTuple):
    """A log density with its derivatives at points."""

    log_density: Array
    """Shape (n)."""
    gradient: Array
    """Shape (n, d)."""
    curvature: Array | None = None
    """Positive definite approximation of the negative Hessian, (n, d, d); None if unknown."""


# Derivatives at points, shape (n, d). The second argument is the width of each variable, (d) or
# (n, d): finite differences have steps in proportion to it.
LogDensityGradient = Callable[[Array, Array], Derivatives]

# Unknowns up to which gradients are finite differences: PyTensor needs longer to compile gradients
# than these differences need in a whole run.
_FEW_UNKNOWNS = 4
# Logarithms of the smallest and the largest positive number.
_LOG_SMALLEST = np.log(np.finfo(float).smallest_subnormal)
_LOG_LARGEST = np.log(np.finfo(float).max)
# Step of differences of gradients, which may be differences themselves.
_CURVATURE_STEP = 0.03


class Target:
    """Log prior and log likelihood of a PyMC model on its unconstrained scale, for many points.

    Parameters
    ----------
    model : pymc.Model
        A model with continuous variables.
    tempered : sequence of str, optional
        Names of the observed variables and Potentials that are the likelihood; all when missing.
        The others count as prior.
    compile_kwargs : dict, optional
        Options of ``pytensor.function``.

    Raises
    ------
    ValueError
        If the model has discrete variables, or no likelihood.
    """

    def __init__(
        self,
        model: pm.Model,
        tempered: Sequence[str] | None = None,
        compile_kwargs: dict[str, Any] | None = None,
    ) -> None:
        check_continuous(model, "SMC needs")
        self.model = model
        self.var_info = {name: (shape, prod(shape)) for name, shape in value_shapes(model).items()}
        self.dimension = sum(size for _, size in self.var_info.values())
        self._likelihood_terms = _tempered(model, tempered)
        self._compile_kwargs = compile_kwargs

    def columns(self, points: Mapping[str, Array]) -> Array:
        """Return points, given by the name of the value variable, as a matrix with a row each."""
        return side_by_side([points[name] for name in self.var_info]).astype(float)

    def draw_prior(self, count: int, rng: np.random.Generator) -> Array:
        """Draw points from the prior, shape (count, d)."""
        try:
            with np.errstate(all="ignore"):
                return _finite(self.columns(self._draw(count, rng)))
        except NotImplementedError as error:
            raise ValueError(
                f"particles cannot be drawn from the prior ({error}): give every variable a proper "
                f"prior, with a density that integrates to 1; here are {list(self.var_info)}"
            ) from error

    def by_name(self, points: Array) -> dict[str, Array]:
        """Return points (..., d) by the name of the variable, each with its own shape."""
        ends = np.cumsum([size for _, size in self.var_info.values()])
        columns = np.split(points, ends[:-1], axis=-1)
        return {
            name: column.reshape(*points.shape[:-1], *shape)
            for (name, (shape, _)), column in zip(self.var_info.items(), columns, strict=True)
        }

    def log_evidence_at_bounds(self, count: int, rng: np.random.Generator) -> float:
        """Return the logarithm of what draws of the prior at a bound contribute to the evidence.

        A number that rounds to 0, or a probability that rounds to 1, is infinitely far on the
        unconstrained scale, where no sampler arrives. Such draws are rare, unless a prior has most
        of its mass at a bound.
        """
        with np.errstate(divide="ignore"):
            points = self.columns(self._draw(count, rng))
        points = points[np.isinf(points).any(axis=1)]
        if not len(points):
            return -np.inf
        return float(logsumexp(self.score(_finite(points))[1]) - np.log(count))

    @cached_property
    def _draw(self) -> Callable[[int, np.random.Generator], dict[str, Array]]:
        return prior_sampler(self.model)

    def evaluate(self, points: Array) -> Evaluation:
        """Return the log prior and the log likelihood of every point."""
        # A Potential of plain numbers may come in single precision.
        prior, likelihood = (np.asarray(logp, float) for logp in self._score(points))
        return evaluation(prior, likelihood)

    def score(self, points: Array) -> tuple[Array, Array]:
        """Return the log prior and the log likelihood of every point."""
        return self.evaluate(points)[:2]

    def cost(self) -> int:
        """Return how many numbers are computed for one point."""
        return self._score.cost()

    @cached_property
    def has_gradients(self) -> bool:
        """True if PyTensor gives gradients, and these are faster than finite differences."""
        return self.dimension > _FEW_UNKNOWNS and self._with_gradients is not None

    def gradients(self, points: Array) -> tuple[Evaluation, Array, Array]:
        """Return densities, and the gradients of log prior and log likelihood, (n, d) each.

        An entry that is not finite is 0: it only leads a proposal astray, which is then rejected.
        """
        assert self._with_gradients is not None
        prior, likelihood, *gradients = self._with_gradients(points)
        of_prior, of_likelihood = (np.nan_to_num(g, posinf=0, neginf=0) for g in gradients)
        return evaluation(prior, likelihood), of_prior, of_likelihood

    def derivatives(self, points: Array, width: Array) -> Derivatives:
        """Return the log density of the posterior and its gradient."""
        if not self.has_gradients:
            return gradient_by_differences(self.score)(points, width)
        (prior, likelihood, _), of_prior, of_likelihood = self.gradients(points)
        return Derivatives(prior + likelihood, of_prior + of_likelihood)

    @cached_property
    @without_traces
    def _terms(self) -> list[TensorVariable]:
        """Log density of all that counts as prior, and of all that is tempered."""
        model, hot = self.model, self._likelihood_terms
        others = (term for term in (*model.observed_RVs, *model.potentials) if term not in hot)
        cold = [*model.free_RVs, *others]
        logp = model.logp([*cold, *hot], sum=False)
        groups = [*logp[: len(cold)], in_one_period(model)], logp[len(cold) :]
        return [sum(pt.sum(term) for term in group) for group in groups]

    @cached_property
    def _score(self) -> BatchedFunction:
        return BatchedFunction.of_model(self.model, self._terms, self._compile_kwargs)

    @cached_property
    @without_traces
    def _with_gradients(self) -> BatchedFunction | None:
        variables = self.model.value_vars
        try:
            each = [pt.grad(t, variables, disconnected_inputs="ignore") for t in self._terms]
        except (NotImplementedError, NullTypeGradError):
            return None
        gradients = [pt.concatenate([pt.flatten(g) for g in gradient]) for gradient in each]
        outputs = [*self._terms, *gradients]
        return BatchedFunction.of_model(self.model, outputs, self._compile_kwargs)


def evaluation(prior: Array, likelihood: Array) -> Evaluation:
    """Return log densities in which NaN and ``+inf`` are replaced by ``−inf``."""
    bad = ~(prior < np.inf) | ~(likelihood < np.inf)
    prior, likelihood = (np.where(bad, -np.inf, values) for values in (prior, likelihood))
    return Evaluation(prior, likelihood, int(bad.sum()))


def check_possible(possible: NDArray[np.bool_], nan_count: int, points: str) -> None:
    """Raise ValueError, naming the `points`, unless one of them is possible."""
    if not possible.any():
        raise ValueError(
            f"none of {points} has a finite likelihood ({nan_count} are NaN): is the "
            "prior far from what the data allow, or is a unit wrong? If little of the prior is "
            "possible, give the model a prior of that part alone, such as pm.Truncated, or "
            "sample it with pm.sample and take ph.bridge_sampling"
        )


def in_one_period(model: pm.Model) -> TensorVariable:
    """Return 0 where every angle of a model is between −π and π, else −inf.

    On its unconstrained scale an angle repeats itself, and would be counted again and again.
    """
    transforms = model.rvs_to_transforms.items()
    angles = [rv for rv, transform in transforms if isinstance(transform, CircularTransform)]
    outside = [pt.any(pt.abs(model.rvs_to_values[angle]) > np.pi) for angle in angles]
    return pt.switch(pt.any(pt.stack(outside)), -np.inf, 0.0) if outside else pt.constant(0.0)


def gradient_by_differences(score: Score) -> LogDensityGradient:
    """Return the log density of a score and its gradient by finite differences."""

    def derivatives(points: Array, width: Array) -> Derivatives:
        stencil, difference = finite_differences(points, width)
        values = np.add(*score(stencil.reshape(-1, points.shape[1])))
        values = values.reshape(len(points), -1)
        gradient = np.nan_to_num(difference(values), posinf=0, neginf=0)
        return Derivatives(values[:, 0], gradient)

    return derivatives


def with_curvature(derivatives: LogDensityGradient) -> LogDensityGradient:
    """Return derivatives with curvatures: by differences of gradients if there are no others."""

    def complete(points: Array, width: Array) -> Derivatives:
        found = derivatives(points, width)
        if found.curvature is not None:
            return found
        size = points.shape[1]
        stencil, difference = finite_differences(points, width, _CURVATURE_STEP)
        width = np.repeat(np.broadcast_to(width, points.shape), size, axis=0)
        beside = derivatives(stencil[:, 1:].reshape(-1, size), width).gradient
        gradients = [found.gradient[:, None], beside.reshape(-1, size, size)]
        hessian = difference(np.concatenate(gradients, axis=1))
        return found._replace(curvature=-(hessian + hessian.mT) / 2)

    return complete


def finite_differences(
    points: Array, width: Array, step: float = 1e-4
) -> tuple[Array, Callable[[Array], Array]]:
    """Return the stencil of forward differences, and a function that takes the differences.

    The stencil, (n, d + 1, d), holds each point and its neighbours, `step` widths away: by default
    about the square root of the rounding error of a log density. The function takes values whose
    first two axes are those of the stencil, and returns derivatives along the second axis.
    """
    steps = np.broadcast_to(step * width, points.shape)
    beside = steps[:, None] * np.eye(points.shape[1])
    stencil = points[:, None] + np.concatenate([0 * beside[:, :1], beside], axis=1)

    def difference(values: Array) -> Array:
        with np.errstate(invalid="ignore"):
            changes = values[:, 1:] - values[:, :1]
            return changes / steps.reshape(*steps.shape, *(1,) * (values.ndim - 2))

    return stencil, difference


def width_of(points: Array) -> Array:
    """Return the sd of each variable as if it were normal, from its quartiles: robust to tails."""
    lower, upper = np.quantile(points, [0.25, 0.75], axis=0)
    # The quartiles of a normal distribution are 1.349 sds apart.
    return np.maximum((upper - lower) / 1.349, np.finfo(float).tiny)


def _finite(points: Array) -> Array:
    """Move draws that were rounded to a bound to the last place whose exponential is a number."""
    return np.nan_to_num(points, nan=np.nan, posinf=_LOG_LARGEST, neginf=_LOG_SMALLEST)


def _tempered(model: pm.Model, names: Sequence[str] | None) -> list[TensorVariable]:
    """Return the observed variables and Potentials of these names; all when missing."""
    terms = [*model.observed_RVs, *model.potentials]
    known = [term.name for term in terms]
    unknown = sorted(set(names or ()) - set(known))
    if unknown or not terms:
        lacking = f", not {unknown}" if unknown else ""
        raise ValueError(
            "nothing to temper: the model has the observed variables and Potentials "
            f"{known}{lacking}"
        )
    return [term for term in terms if names is None or term.name in names]
