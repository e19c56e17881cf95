"""A reference: a distribution like the posterior, from which its particles start."""

from dataclasses import dataclass

import numpy as np

from pymc_hyperelastic.evidence.mixture import Array, GaussianMixture
from pymc_hyperelastic.evidence.target import DrawPrior


@dataclass(frozen=True)
class Reference:
    """The prior and a mixture, in given shares."""

    mixture: GaussianMixture
    """With heavy tails."""
    prior_share: float
    """Share of the prior: weights are bounded if the likelihood is, also where the mixture has no
    mass."""

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
        return np.logaddexp(
            np.log(self.prior_share) + log_prior,
            np.log1p(-self.prior_share) + self.mixture.log_density(points),
        )

    def gradient(
        self, points: Array, log_prior: Array, prior_gradient: Array
    ) -> tuple[Array, Array]:
        """Log density and its gradient at points where those of the prior are given."""
        of_mixture, mixture_gradient = self.mixture.gradient(points)
        of_prior = np.log(self.prior_share) + log_prior
        total = np.logaddexp(of_prior, np.log1p(-self.prior_share) + of_mixture)
        share = np.exp(of_prior - total)[:, None]
        return total, share * prior_gradient + (1 - share) * mixture_gradient
