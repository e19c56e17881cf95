"""A Gaussian mixture fitted to a population of particles, from which SMC proposes moves."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

__all__ = ["GaussianMixture"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GaussianMixture:
    """Mixture of ``K`` normal distributions in ``d`` dimensions.

    Attributes
    ----------
    log_weights : array, shape (K,)
        Logarithms of the weights.
    means : array, shape (K, d)
        Means.
    factors : array, shape (K, d, d)
        Lower Cholesky factors of the covariances.
    """

    log_weights: Array
    means: Array
    factors: Array

    @classmethod
    def fit(
        cls, points: Array, components: int, rng: np.random.Generator, iterations: int = 10
    ) -> "GaussianMixture":
        """Fit by expectation maximisation, from distinct points drawn far apart (k-means++).

        Examples
        --------
        >>> import numpy as np
        >>> from pymc_hyperelastic.mixture import GaussianMixture
        >>> rng = np.random.default_rng(1)
        >>> points = np.concatenate([rng.normal(-5, 1, (500, 1)), rng.normal(5, 1, (500, 1))])
        >>> GaussianMixture.fit(points, 2, rng).means.round().ravel().tolist()
        [-5.0, 5.0]
        """
        # The floor keeps every component a proper distribution when particles coincide.
        floor = 1e-6 * points.var(axis=0) + np.finfo(float).tiny
        scale = np.sqrt(points.var(axis=0) + np.finfo(float).tiny)
        scaled = points / scale
        centres = scaled[rng.integers(len(points), size=1)]
        for _ in range(components - 1):
            distance = _squared_distances(scaled, centres).min(axis=1)
            if not distance.any():
                break
            chosen = rng.choice(len(points), p=distance / distance.sum())
            centres = np.concatenate([centres, scaled[[chosen]]])
        nearest = _squared_distances(scaled, centres).argmin(axis=1)
        responsibilities = np.eye(len(centres))[nearest]
        for _ in range(iterations if len(centres) > 1 else 1):
            # A component with fewer points than dimensions has no covariance of its own.
            keep = responsibilities.sum(axis=0) > points.shape[1] + 1
            mixture = cls._from_responsibilities(points, responsibilities[:, keep], floor)
            responsibilities = mixture.responsibilities(points)
        return mixture

    @classmethod
    def _from_responsibilities(
        cls, points: Array, responsibilities: Array, floor: Array
    ) -> "GaussianMixture":
        counts = responsibilities.sum(axis=0)
        means = responsibilities.T @ points / counts[:, None]
        factors = []
        for k, mean in enumerate(means):
            centred = points - mean
            covariance = (responsibilities[:, k, None] * centred).T @ centred / counts[k]
            factors.append(np.linalg.cholesky(covariance + np.diag(floor)))
        return cls(np.log(counts / counts.sum()), means, np.array(factors))

    def log_density_of_components(self, points: Array) -> Array:
        """Logarithm of weight times density of each component, shape (n, K)."""
        terms = np.empty((len(points), len(self.means)))
        for k, (mean, factor) in enumerate(zip(self.means, self.factors, strict=True)):
            z = (points - mean) @ np.linalg.inv(factor).T
            log_volume = np.log(np.diag(factor)).sum() + len(mean) / 2 * np.log(2 * np.pi)
            terms[:, k] = self.log_weights[k] - log_volume - np.einsum("ni,ni->n", z, z) / 2
        return terms

    def log_density(self, points: Array) -> Array:
        """Logarithm of the density at each point, shape (n,)."""
        return logsumexp(self.log_density_of_components(points), axis=1)

    def responsibilities(self, points: Array) -> Array:
        """Probability with which each component made each point, shape (n, K)."""
        terms = self.log_density_of_components(points)
        return np.exp(terms - logsumexp(terms, axis=1, keepdims=True))

    def draw(self, size: int, rng: np.random.Generator) -> Array:
        """Independent points, shape (size, d)."""
        component = rng.choice(len(self.means), size=size, p=np.exp(self.log_weights))
        return self.means[component] + self.draw_steps(component, rng)

    def draw_steps(self, component: NDArray[np.intp], rng: np.random.Generator) -> Array:
        """Centred normal steps with the covariance of the given component each, shape (n, d)."""
        noise = rng.standard_normal((len(component), self.means.shape[1]))
        return np.einsum("nij,nj->ni", self.factors[component], noise)

    def widened(self, factor: float) -> "GaussianMixture":
        """The mixture with every covariance multiplied by `factor`."""
        return GaussianMixture(self.log_weights, self.means, self.factors * np.sqrt(factor))


def _squared_distances(points: Array, centres: Array) -> Array:
    return ((points[:, None, :] - centres[None, :, :]) ** 2).sum(axis=-1)
