"""The path of densities between a reference, or the prior, and the posterior."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pymc_hyperelastic.evidence.mixture import Array, GaussianMixture
from pymc_hyperelastic.evidence.target import DrawPrior, Target


@dataclass(frozen=True)
class Reference:
    """A distribution like the posterior: the prior and a mixture, in given shares."""

    mixture: GaussianMixture
    """With heavy tails."""
    prior_share: float = 0.1
    """Share of the prior: weights are bounded if the likelihood is, also where the mixture has no
    mass (Owen and Zhou 2000)."""

    def draw(self, draw_prior: DrawPrior | None, size: int, rng: np.random.Generator) -> Array:
        """Points, shape (size, d), in exact shares."""
        if not self.prior_share or draw_prior is None:
            return self.mixture.draw(size, rng)
        of_prior = round(self.prior_share * size)
        prior = draw_prior(of_prior, rng)
        return np.concatenate([prior, self.mixture.draw(size - of_prior, rng)])

    def log_density(self, points: Array, log_prior: Array) -> Array:
        """Log density at points of the given log prior density."""
        if not self.prior_share:
            return self.mixture.log_density(points)
        of_mixture = np.log1p(-self.prior_share) + self.mixture.log_density(points)
        return np.logaddexp(np.log(self.prior_share) + log_prior, of_mixture)

    def gradient(
        self, points: Array, log_prior: Array, prior_gradient: Array
    ) -> tuple[Array, Array]:
        """Log density and its gradient at points where those of the prior are given."""
        of_mixture, mixture_gradient = self.mixture.gradient(points)
        of_prior = np.log(self.prior_share) + log_prior
        total = np.logaddexp(of_prior, np.log1p(-self.prior_share) + of_mixture)
        share = np.exp(of_prior - total)[:, None]
        return total, share * prior_gradient + (1 - share) * mixture_gradient


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
