"""A specimen as a target: on what its curves depend, everything else integrated out."""

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pymc_hyperelastic.evidence.batched import BatchedFunction
from pymc_hyperelastic.evidence.search import width_of
from pymc_hyperelastic.evidence.target import Rise, Slope, Target, by_differences, differences

Array = NDArray[np.float64]

# Draws by which it is known how wide the prior is.
_DRAWS = 1000


class SpecimenTarget(Target):
    """The variables of a model on which its curves depend, under a prior of their own.

    Where experiments differ a specimen has, besides the coordinates of each test, its own and an
    effect: a funnel, in which particles get lost. Both can be integrated out of the prior.

    Parameters
    ----------
    whole : Target
        The model with all its variables.
    places : array of int
        Columns of those on which the curves depend.
    log_prior : callable
        Log density of points of these alone.
    log_likelihood : BatchedFunction
        Log likelihood of points of all variables.
    misfits : callable
        Log likelihood of points of all variables, and the size of each of their standard errors.
    """

    knows_curvature = True

    def __init__(
        self,
        whole: Target,
        places: NDArray[np.intp],
        log_prior: Callable[[Array], Array],
        log_likelihood: BatchedFunction,
        misfits: Callable[[Array], Sequence[Array]],
    ) -> None:
        self.whole, self.places, self.log_prior = whole, places, log_prior
        self.misfits = misfits
        self.dimension, self.nan_scores = len(places), 0
        self.effort, self.most_effort = 0.0, np.inf
        self._score = log_likelihood

    def particles(self, points: Array) -> Array:
        """Points among all variables, of which the others do not matter to the curves."""
        particles = np.zeros((len(points), self.whole.dimension))
        particles[:, self.places] = points
        return particles

    def draw_prior(self, count: int, rng: np.random.Generator) -> Array:
        """Draw points from the prior, shape (count, d)."""
        return self.whole.draw_prior(count, rng)[:, self.places]

    def score(self, points: Array) -> tuple[Array, Array]:
        """Log prior and log likelihood of every point; NaN and ``+inf`` count as ``−inf``."""
        self.effort += len(points) / self.at_once
        (likelihood,) = self._score(self.particles(points))
        return self._possible(self.log_prior(points), likelihood)

    def ascent(self, width: Array) -> Slope:
        """Log density of the posterior and its slope, for variables of such a width.

        Of a sum of squares of standard errors the curvature is known from the slopes of these, as
        Gauss and Newton have it.
        """

        def slope(points: Array) -> Rise:
            around, change = differences(points, width)
            flat = around.reshape(-1, self.dimension)
            self.effort += len(flat) / self.at_once
            likelihood, *errors = self.misfits(self.particles(flat))
            heights = np.add(*self._possible(self.log_prior(flat), likelihood))
            of_errors = np.nan_to_num(
                change(errors[0].reshape(*around.shape[:2], -1)), posinf=0, neginf=0
            )
            curvature = of_errors @ of_errors.transpose(0, 2, 1) + np.diag(self.prior_width**-2.0)
            heights = heights.reshape(len(points), -1)
            slopes = np.nan_to_num(change(heights), posinf=0, neginf=0)
            return Rise(heights[:, 0], slopes, curvature)

        return slope

    def squares(self, points: Array) -> Array:
        """Return the sum of squared standardised errors of each point."""
        return np.square(self.misfits(self.particles(points))[1]).sum(axis=1)

    @cached_property
    def prior_width(self) -> Array:
        """How wide the prior of the model is, by variable."""
        return width_of(self.draw_prior(_DRAWS, np.random.default_rng(1)))

    def slopes(self, points: Array) -> tuple[Array, Array, Array, Array]:
        """Log prior and log likelihood, and the slope of each, which is 0 where it is not known."""
        _, likelihood, _, of_likelihood = super().slopes(self.particles(points))
        prior, of_prior, _ = self._prior_slope(points)
        return *self._possible(prior, likelihood), of_prior, of_likelihood[:, self.places]

    @cached_property
    def _with_slopes(self) -> BatchedFunction | None:
        return self.whole._with_slopes

    @cached_property
    def _prior_slope(self) -> Slope:
        def score(points: Array) -> tuple[Array, Array]:
            return self.log_prior(points), np.zeros(len(points))

        return by_differences(score, self.prior_width)
