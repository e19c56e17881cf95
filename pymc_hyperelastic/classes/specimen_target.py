"""Target density of a specimen: the variables that its curves depend on, without all others.

``SpecimenSampler`` samples it.
"""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pymc_hyperelastic.classes.interface import DRAWS
from pymc_hyperelastic.evidence.batched import BatchedFunction
from pymc_hyperelastic.evidence.target import (
    Derivatives,
    Evaluation,
    Target,
    evaluation,
    finite_differences,
    gradient_by_differences,
    width_of,
)
from pymc_hyperelastic.predictions.members import SEED

Array = NDArray[np.float64]


class SpecimenPrior(Protocol):
    """A prior of points of a :class:`SpecimenTarget`."""

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """Draw points, shape (count, d)."""

    def log_density(self, points: Array) -> Array:
        """Return the log density of points."""


class SpecimenTarget(Target):
    """Posterior of those variables of a model that the curves depend on, under a given prior.

    If experiments differ, a specimen has coordinates of each test, and in addition coordinates of
    its own and an experiment effect. The posterior of all of them is a funnel, which is hard to
    sample. The curves depend only on the coordinates of the tests, so the other variables can be
    integrated out of the prior.

    Parameters
    ----------
    model : Target
        The model with all its variables.
    places : array of int
        Columns of the variables that the curves depend on, among all variables.
    prior : SpecimenPrior
        Prior of the variables that the curves depend on.
    log_likelihood : BatchedFunction
        Log likelihood of points of all variables.
    misfits : callable
        Log likelihood of points of all variables, and the absolute standardised residual of each
        measurement.
    """

    def __init__(
        self,
        model: Target,
        places: NDArray[np.intp],
        prior: SpecimenPrior,
        log_likelihood: BatchedFunction,
        misfits: Callable[[Array], Sequence[Array]],
    ) -> None:
        # The constructor of the base class is not called: it would compile the model again.
        self.whole, self.places, self.prior = model, places, prior
        self.misfits, self.log_likelihood = misfits, log_likelihood
        self.dimension = len(places)

    def particles(self, points: Array) -> Array:
        """Return points of all variables; variables that the curves do not depend on are 0."""
        particles = np.zeros((len(points), self.whole.dimension))
        particles[:, self.places] = points
        return particles

    def draw_prior(self, count: int, rng: np.random.Generator) -> Array:
        """Draw points from the prior, shape (count, d)."""
        return self.prior.draw(count, rng)

    def evaluate(self, points: Array) -> Evaluation:
        """Return the log prior and the log likelihood of every point."""
        (likelihood,) = self.log_likelihood(self.particles(points))
        return evaluation(self.prior.log_density(points), likelihood)

    def cost(self) -> int:
        """Return how many numbers are computed for one point."""
        return self.log_likelihood.cost()

    def derivatives(self, points: Array, width: Array) -> Derivatives:
        """Return the log density of the posterior, its gradient and its curvature.

        The curvature is the Gauss-Newton approximation: the log likelihood is a sum of squared
        standardised residuals, whose gradients are finite differences.
        """
        stencil, difference = finite_differences(points, width)
        flat = stencil.reshape(-1, self.dimension)
        likelihood, residuals = self.misfits(self.particles(flat))
        prior, likelihood, _ = evaluation(self.prior.log_density(flat), likelihood)
        jacobian = difference(residuals.reshape(*stencil.shape[:2], -1))
        jacobian = np.nan_to_num(jacobian, posinf=0, neginf=0)
        curvature = jacobian @ jacobian.mT + np.diag(self.prior_width**-2.0)
        values = (prior + likelihood).reshape(len(points), -1)
        gradient = np.nan_to_num(difference(values), posinf=0, neginf=0)
        return Derivatives(values[:, 0], gradient, curvature)

    def squares(self, points: Array) -> Array:
        """Return the sum of squared standardised residuals of each point."""
        return np.square(self.misfits(self.particles(points))[1]).sum(axis=1)

    @cached_property
    def prior_width(self) -> Array:
        """Width of the prior in each variable."""
        return width_of(self.draw_prior(DRAWS, np.random.default_rng(SEED)))

    def gradients(self, points: Array) -> tuple[Evaluation, Array, Array]:
        """Return log prior and log likelihood, and the gradient of each, shape (n, d).

        The gradient of the prior is a finite difference.
        """
        (_, likelihood, _), _, of_likelihood = self.whole.gradients(self.particles(points))

        def score(points: Array) -> tuple[Array, Array]:
            return self.prior.log_density(points), np.zeros(len(points))

        prior, of_prior, _ = gradient_by_differences(score)(points, self.prior_width)
        return evaluation(prior, likelihood), of_prior, of_likelihood[:, self.places]

    @cached_property
    def has_gradients(self) -> bool:
        """True if PyTensor gives gradients of the whole model."""
        return self.whole.has_gradients
