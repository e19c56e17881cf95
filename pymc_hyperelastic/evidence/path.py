"""The path of densities between a reference, or the prior, and the posterior."""

from typing import NamedTuple

import numpy as np

from pymc_hyperelastic.evidence.mixture import Array
from pymc_hyperelastic.evidence.reference import Reference
from pymc_hyperelastic.evidence.target import Target


class PathPoints(NamedTuple):
    """Points, and the two log densities that a path joins."""

    points: Array
    log_start: Array
    """Log density of the reference or the prior."""
    log_ratio: Array
    """Log density of the posterior, less `log_start`."""

    def log_density(self, beta: float) -> Array:
        """Return the log density on the path; −inf where a point is impossible at its start."""
        # Avoid 0 times infinity.
        return self.log_start + beta * self.log_ratio if beta else self.log_start


class GeometricPath:
    """Densities ``a^(1-β) p^β`` between a density ``a`` and the posterior ``p``.

    ``a`` is the prior, or a reference if there is one. The gradient may be that of a `guide`, a
    cheaper target like the first one.

    Attributes
    ----------
    nan_count : int
        Points so far whose density was NaN or ``+inf``.
    """

    def __init__(
        self, target: Target, reference: Reference | None = None, guide: Target | None = None
    ) -> None:
        self.target, self.reference = target, reference
        self.guide = guide or target
        self.nan_count = 0

    def at(self, points: Array) -> PathPoints:
        """Evaluate points."""
        prior, likelihood, nan_count = self.target.evaluate(points)
        self.nan_count += nan_count
        if self.reference is None:
            return PathPoints(points, prior, likelihood)
        # A step may be so wild that it overflows, and a transform may refuse draws of the prior.
        with np.errstate(over="ignore", invalid="ignore"):
            start = self.reference.log_density(points, prior)
            ratio = prior + likelihood - start
        return PathPoints(points, start, np.where(np.isfinite(start), ratio, -np.inf))

    def gradient(self, points: Array, beta: float) -> Array:
        """Return the gradient of the log density at one place of the path, (n, d)."""
        (prior, _, _), of_prior, of_likelihood = self.guide.gradients(points)
        if self.reference is None:
            return of_prior + beta * of_likelihood
        _, of_start = self.reference.gradient(points, prior, of_prior)
        return (1 - beta) * of_start + beta * (of_prior + of_likelihood)
