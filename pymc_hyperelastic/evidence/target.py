"""What is sampled: the prior and the likelihood of a model, with their slopes, for many points."""

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

Array = NDArray[np.float64]

# Log prior and log likelihood of points, shape (n, d).
Score = Callable[[Array], tuple[Array, Array]]
# So many draws of the prior, shape (n, d).
DrawPrior = Callable[[int, np.random.Generator], Array]


class Rise(NamedTuple):
    """How a density rises at points."""

    height: Array
    """Its logarithm, (n)."""
    slope: Array
    """Of that, (n, d)."""
    curvature: Array | None = None
    """About what it would be at a summit, if that is known, (n, d, d): positive definite."""


Slope = Callable[[Array], Rise]
# The same for variables of a given width, (d) or (n, d), on whose scale differences are taken.
Ascent = Callable[[Array], Slope]

# So few unknowns are climbed by differences, in less time than slopes take to compile.
_FEW = 4
# Logarithm of the smallest number there is.
_LOG_SMALLEST = np.log(np.nextafter(0.0, 1.0))
# About the logarithm of the largest number there is.
_FARTHEST = 700.0
# Bytes of intermediate results that are one unit of effort.
_UNIT = 2**21
# Slopes take so many times as long as a score.
_COST_OF_SLOPES = 3
# Step of a difference, as a fraction of a variable's width.
_STEP = 1e-4


class Target:
    """Prior and likelihood of a PyMC model on its unconstrained scale, for many points at once.

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

    # Whether ascents know the curvature wherever they are.
    knows_curvature = False

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
        self.nan_scores = 0
        self.effort, self.most_effort = 0.0, np.inf
        self._hot = _tempered(model, tempered)
        self._compile_kwargs = compile_kwargs

    def columns(self, points: Mapping[str, Array]) -> Array:
        """Points by the name of the value variable as a matrix, in which each has a row."""
        return side_by_side([points[name] for name in self.var_info]).astype(float)

    def draw_prior(self, count: int, rng: np.random.Generator) -> Array:
        """Draw points from the prior, shape (count, d)."""
        return self.columns(self.draw_prior_by_name(count, rng))

    def draw_prior_by_name(self, count: int, rng: np.random.Generator) -> dict[str, Array]:
        """Draw points from the prior, by the name of the value variable."""
        try:
            with np.errstate(all="ignore"):
                points = self._draw(count, rng)
            return {name: _finite(values) for name, values in points.items()}
        except NotImplementedError as error:
            raise ValueError(
                f"particles cannot be drawn from the prior ({error}): give every variable a proper "
                f"prior, with a density that integrates to 1; here are {list(self.var_info)}"
            ) from error

    def by_name(self, points: Array) -> dict[str, Array]:
        """Unconstrained variables of points (..., d), each with its own shape at the end."""
        ends = np.cumsum([size for _, size in self.var_info.values()])
        columns = np.split(points, ends[:-1], axis=-1)
        shapes = [shape for shape, _ in self.var_info.values()]
        return {
            name: column.reshape(*points.shape[:-1], *shape)
            for name, column, shape in zip(self.var_info, columns, shapes, strict=True)
        }

    def log_evidence_at_bounds(self, count: int, rng: np.random.Generator) -> float:
        """Logarithm of what the prior's draws at a bound contribute to the evidence.

        A number that rounds to 0, or a probability that rounds to 1, is infinitely far on the
        unconstrained scale, where no sampler arrives. Such draws are rare, unless a prior has most
        of its mass at a bound.
        """
        with np.errstate(divide="ignore"):
            points = self.columns(self._draw(count, rng))
        points = points[np.isinf(points).any(axis=1)]
        if not len(points):
            return -np.inf
        _, likelihood = self.score(_finite(points))
        likelihood = likelihood[~np.isnan(likelihood)]
        return float(logsumexp(likelihood) - np.log(count)) if len(likelihood) else -np.inf

    @cached_property
    def _draw(self) -> Callable[[int, np.random.Generator], dict[str, Array]]:
        return prior_sampler(self.model)

    def score(self, points: Array) -> tuple[Array, Array]:
        """Log prior and log likelihood of every point; NaN and ``+inf`` count as ``−inf``."""
        self.effort += len(points) / self.at_once
        # A Potential of plain numbers may come in single precision.
        prior, likelihood = (np.asarray(logp, float) for logp in self._score(points))
        return self._possible(prior, likelihood)

    @property
    def at_once(self) -> int:
        """How many points are one unit of effort: few if each takes long."""
        return self._score.filling(_UNIT)

    @property
    def exhausted(self) -> bool:
        """Whether more was done than allowed, in units of so many points."""
        return self.effort > self.most_effort

    @cached_property
    def has_slopes(self) -> bool:
        """Whether there are slopes of the prior and the likelihood, at little cost."""
        return self.dimension > _FEW and self._with_slopes is not None

    def slopes(self, points: Array) -> tuple[Array, Array, Array, Array]:
        """Log prior and log likelihood, and the slope of each, which is 0 where it is not known."""
        assert self._with_slopes is not None
        self.effort += _COST_OF_SLOPES * len(points) / self.at_once
        prior, likelihood, *slopes = self._with_slopes(points)
        return *self._possible(prior, likelihood), *(
            np.nan_to_num(s, posinf=0, neginf=0) for s in slopes
        )

    def ascent(self, width: Array) -> Slope:
        """Log density of the posterior and its slope, for variables of such a width."""
        if not self.has_slopes:
            return by_differences(self.score, width)

        def slope(points: Array) -> Rise:
            prior, likelihood, of_prior, of_likelihood = self.slopes(points)
            return Rise(prior + likelihood, of_prior + of_likelihood)

        return slope

    def check_possible(self, possible: NDArray[np.bool_], points: str) -> None:
        """Raise, naming the points, unless one of those that were scored is possible."""
        if not possible.any():
            raise ValueError(
                f"none of {points} has a finite likelihood ({self.nan_scores} are NaN): is the "
                "prior far from what the data allow, or is a unit wrong? If little of the prior is "
                "possible, give the model a prior of that part alone, such as pm.Truncated, or "
                "sample it with pm.sample and take ph.log_evidence_by_bridge"
            )

    def _possible(self, prior: Array, likelihood: Array) -> tuple[Array, Array]:
        # What overflows is no number either.
        bad = ~(prior < np.inf) | ~(likelihood < np.inf)
        self.nan_scores += int(bad.sum())
        return np.where(bad, -np.inf, prior), np.where(bad, -np.inf, likelihood)

    @cached_property
    @without_traces
    def _terms(self) -> list[TensorVariable]:
        """Log density of all that counts as prior, and of all that is tempered."""
        model, hot = self.model, self._hot
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
    def _with_slopes(self) -> BatchedFunction | None:
        variables = self.model.value_vars
        try:
            slopes = [
                pt.concatenate(
                    [pt.flatten(s) for s in pt.grad(term, variables, disconnected_inputs="ignore")]
                )
                for term in self._terms
            ]
        except (NotImplementedError, NullTypeGradError):
            return None
        return BatchedFunction.of_model(self.model, [*self._terms, *slopes], self._compile_kwargs)


def in_one_period(model: pm.Model) -> TensorVariable:
    """Return 0 where every angle of a model is between −π and π, else −inf.

    On its unconstrained scale an angle repeats itself, and would be counted again and again.
    """
    angles = [
        model.rvs_to_values[rv]
        for rv, transform in model.rvs_to_transforms.items()
        if isinstance(transform, CircularTransform)
    ]
    outside = [pt.any(pt.abs(angle) > np.pi) for angle in angles]
    return pt.switch(pt.any(pt.stack(outside)), -np.inf, 0.0) if outside else pt.constant(0.0)


def by_differences(score: Score, width: Array) -> Slope:
    """Log density and its slope from a score alone, by differences of so wide variables."""

    def slope(points: Array) -> Rise:
        around, change = differences(points, width)
        values = np.add(*score(around.reshape(-1, points.shape[1])))
        values = values.reshape(len(points), -1)
        return Rise(values[:, 0], np.nan_to_num(change(values), posinf=0, neginf=0))

    return slope


def differences(points: Array, width: Array) -> tuple[Array, Callable[[Array], Array]]:
    """Points and others beside each of them, (n, d + 1, d); slopes of what is known at these.

    Slopes are along the second axis, of values whose first two are those of the points. They are
    one-sided: of a mode as wide as it is said to be they are wrong by half a step's worth of nats.
    """
    step = np.broadcast_to(_STEP * width, points.shape)
    beside = step[:, None] * np.eye(points.shape[1])
    around = points[:, None] + np.concatenate([0 * beside[:, :1], beside], axis=1)

    def change(values: Array) -> Array:
        with np.errstate(invalid="ignore"):
            return (values[:, 1:] - values[:, :1]) / step.reshape(
                *step.shape, *(1,) * (values.ndim - 2)
            )

    return around, change


def _finite(points: Array) -> Array:
    """Move draws that were rounded to a bound to the last place whose exponential is a number."""
    return np.nan_to_num(points, nan=np.nan, posinf=_FARTHEST, neginf=_LOG_SMALLEST)


def _tempered(model: pm.Model, names: Sequence[str] | None) -> list[TensorVariable]:
    """Observed variables and Potentials of these names; all when missing."""
    terms = [*model.observed_RVs, *model.potentials]
    known = [term.name for term in terms]
    unknown = sorted(set(names or ()) - set(known))
    if unknown or not terms:
        raise ValueError(
            f"nothing to temper: the model has the observed variables and Potentials {known}"
            + (f", not {unknown}" if unknown else "")
        )
    return [term for term in terms if names is None or term.name in names]
