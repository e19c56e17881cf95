"""Mixtures of normal or Student-t distributions, fitted by expectation maximisation."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

Array = NDArray[np.float64]

# Steps of expectation maximisation: more hardly pay.
_ITERATIONS = 10
# Components times points whose densities are computed together: they stay in the cache.
_AT_ONCE = 20_000
# Added to each variance, as a fraction of the population's: it keeps a component of coinciding
# particles a proper distribution, and is too small to blur a mode a millionth as wide as the prior.
VARIANCE_FLOOR = 1e-13


@dataclass(frozen=True)
class GaussianMixture:
    """Mixture of ``K`` normal, or Student-t, distributions in ``d`` dimensions."""

    log_weights: Array
    """Logarithms of the weights, shape (K,)."""
    means: Array
    """Shape (K, d)."""
    factors: Array
    """Lower Cholesky factors of covariances, or of Student's scale matrices, shape (K, d, d)."""
    freedom: float = np.inf
    """Degrees of freedom; infinite for normal distributions."""

    @classmethod
    def fit(
        cls,
        points: Array,
        components: int,
        rng: np.random.Generator,
        *,
        start: "GaussianMixture | None" = None,
        iterations: int = _ITERATIONS,
    ) -> "GaussianMixture":
        """Fit by expectation maximisation, from `start` or from distinct points drawn far apart."""
        mixture = start
        floor = np.diag(variance_floor(points.var(axis=0)))
        for _ in range(iterations if components > 1 else 1):
            if mixture is None:
                responsibilities = _nearest_of_far_apart(points, components, rng)
            else:
                responsibilities = mixture.responsibilities(points)
            # A component with fewer points than dimensions has no covariance of its own.
            keep = responsibilities.sum(axis=0) > points.shape[1] + 1
            if not keep.any():
                responsibilities, keep = np.ones((len(points), 1)), np.array([True])
            responsibilities = responsibilities[:, keep]
            counts = responsibilities.sum(axis=0)
            means = responsibilities.T @ points / counts[:, None]
            centred = points.T - means[..., None]
            weighted = responsibilities.T[:, None] * centred
            covariances = weighted @ centred.mT / counts[:, None, None]
            factors = np.linalg.cholesky(covariances + floor)
            mixture = cls(np.log(counts / counts.sum()), means, factors)
        assert mixture is not None
        return mixture

    @property
    def covariances(self) -> Array:
        """Covariances, or Student's scale matrices, shape (K, d, d)."""
        return self.factors @ self.factors.mT

    @cached_property
    def _inverse_factors(self) -> Array:
        return np.linalg.inv(self.factors)

    @cached_property
    def _log_peaks(self) -> Array:
        """Logarithm of weight times density of each component at its mean."""
        log_volumes = np.log(np.diagonal(self.factors, axis1=1, axis2=2)).sum(axis=1)
        dimension, freedom = self.means.shape[1], self.freedom
        if np.isinf(freedom):
            log_norm = dimension / 2 * np.log(2 * np.pi)
        else:
            log_norm = dimension / 2 * np.log(freedom * np.pi)
            log_norm += gammaln(freedom / 2) - gammaln((freedom + dimension) / 2)
        return self.log_weights - log_volumes - log_norm

    def log_density_of_components(self, points: Array) -> Array:
        """Logarithm of weight times density of each component, shape (n, K)."""
        z = self._standardised(points)
        with np.errstate(over="ignore"):
            z *= z
            return self._terms_at(z.sum(axis=1).T)

    def _standardised(self, points: Array) -> Array:
        """Points in standard deviations from the mean of each component, shape (K, d, n)."""
        components, dimension = self.means.shape
        # One product for all components. Points run along the last axis, where NumPy sums over the
        # others are fast.
        z = self._inverse_factors.reshape(-1, dimension) @ points.T
        z -= (self._inverse_factors @ self.means[..., None]).reshape(-1, 1)
        return z.reshape(components, dimension, -1)

    def _terms_at(self, distance: Array) -> Array:
        """Logarithm of weight times density at squared distances, shape (n, K)."""
        if np.isinf(self.freedom):
            return self._log_peaks - distance / 2
        power = (self.freedom + self.means.shape[1]) / 2
        return self._log_peaks - power * np.log1p(distance / self.freedom)

    def log_density(self, points: Array) -> Array:
        """Logarithm of the density at each point, shape (n,)."""
        at_once = max(1, _AT_ONCE // len(self.means))
        parts = [points[i : i + at_once] for i in range(0, len(points), at_once)] or [points]
        return np.concatenate([log_sum_exp(self.log_density_of_components(p)) for p in parts])

    def responsibilities(self, points: Array) -> Array:
        """Probability with which each component made each point, shape (n, K)."""
        terms = self.log_density_of_components(points)
        terms = np.exp(terms - terms.max(axis=1, keepdims=True))
        return terms / terms.sum(axis=1, keepdims=True)

    def draw(self, size: int, rng: np.random.Generator) -> Array:
        """Independent points, shape (size, d)."""
        component = rng.choice(len(self.means), size=size, p=np.exp(self.log_weights))
        return self.means[component] + self.draw_steps(component, rng)

    def draw_steps(self, component: NDArray[np.intp], rng: np.random.Generator) -> Array:
        """Centred steps, distributed as the given component each, shape (n, d)."""
        noise = rng.standard_normal((len(component), self.means.shape[1]))
        if np.isfinite(self.freedom):
            noise /= np.sqrt(rng.chisquare(self.freedom, (len(component), 1)) / self.freedom)
        return self.steps(component, noise)

    def steps(
        self, component: NDArray[np.intp], standard: Array, *, transposed: bool = False
    ) -> Array:
        """Standard vectors by the factor, or its transpose, of the given component each."""
        steps = np.empty_like(standard)
        # One after the other: a factor for each point would not fit into memory.
        for k, factor in enumerate(self.factors):
            chosen = component == k
            steps[chosen] = standard[chosen] @ (factor if transposed else factor.T)
        return steps

    def gradient(self, points: Array) -> tuple[Array, Array]:
        """Log density and its gradient at each point, shapes (n,) and (n, d)."""
        z = self._standardised(points)
        distance = (z**2).sum(axis=1).T
        terms = self._terms_at(distance)
        total = log_sum_exp(terms)
        pull = np.exp(terms - total[:, None])
        if np.isfinite(self.freedom):
            pull *= (self.freedom + self.means.shape[1]) / (self.freedom + distance)
        z *= pull.T[:, None]
        slopes = z.reshape(-1, len(points)).T @ self._inverse_factors.reshape(z[..., 0].size, -1)
        return total, -slopes

    def joined(self, other: "GaussianMixture", share: float = 0.5) -> "GaussianMixture":
        """Mixture of itself and another, which has the given share."""
        log_weights = self.log_weights + np.log1p(-share), other.log_weights + np.log(share)
        means = np.concatenate([self.means, other.means])
        factors = np.concatenate([self.factors, other.factors])
        return GaussianMixture(np.concatenate(log_weights), means, factors, self.freedom)

    def heavy_tailed(self) -> "GaussianMixture":
        """The mixture as a proposal: its tails reach along a ridge far beyond the points fitted.

        In many dimensions so heavy ones would go astray, and are lighter.
        """
        dimension = self.means.shape[1]
        return self.widened(1 + 0.6 / dimension, freedom=max(1.0, dimension / 2))

    def widened(self, factor: float, freedom: float = np.inf) -> "GaussianMixture":
        """The mixture with every covariance multiplied by `factor`, and tails of Student's t."""
        factors = self.factors * np.sqrt(factor)
        return GaussianMixture(self.log_weights, self.means, factors, freedom)


def variance_floor(variances: Array) -> Array:
    """Return small variances whose addition gives a covariance a Cholesky factor."""
    return VARIANCE_FLOOR * variances + np.finfo(float).tiny


def components_for(points: float, dimension: int) -> int:
    """Number of components, each known from five to ten times as many points as it has parameters.

    There are six at most, and two as soon as that is possible: for two mirrored modes.
    """
    parameters = (dimension + 1) * (dimension + 2) // 2
    return 1 if points < 10 * parameters else int(np.clip(points / (10 * parameters), 2, 6))


def log_sum_exp(terms: Array) -> Array:
    """``ln Σ exp`` over the last axis of finite terms; a tenth of SciPy's time for few of them."""
    largest = terms.max(axis=-1, keepdims=True)
    return largest[..., 0] + np.log(np.exp(terms - largest).sum(axis=-1))


def _nearest_of_far_apart(points: Array, components: int, rng: np.random.Generator) -> Array:
    """Responsibilities by the nearest of some points, drawn far apart (k-means++)."""
    scaled = points / np.sqrt(points.var(axis=0) + np.finfo(float).tiny)
    centres = scaled[rng.integers(len(points), size=1)]
    distances = ((scaled - centres) ** 2).sum(axis=1, keepdims=True)
    while distances.shape[1] < components and distances.min(axis=1).any():
        nearest = distances.min(axis=1)
        centre = scaled[rng.choice(len(points), p=nearest / nearest.sum())]
        distances = np.column_stack([distances, ((scaled - centre) ** 2).sum(axis=1)])
    return np.eye(distances.shape[1])[distances.argmin(axis=1)]
