"""Modes of a posterior, climbed to from draws of the prior, and the mixture that they make."""

from collections.abc import Callable

import numpy as np
from scipy.optimize import OptimizeResult, minimize
from scipy.special import logsumexp

from pymc_hyperelastic.evidence.mixture import Array, GaussianMixture

# Log prior and log likelihood of points, shape (n, d).
Score = Callable[[Array], tuple[Array, Array]]

# Starting points of a search for modes; modes that are less likely by so many nats are nothing.
_SEARCHES, _NEGLIGIBLE = 8, 20.0
# Steps of numerical derivatives: of a slope, as a fraction of the prior's width, and of a
# curvature, as one of the mode's.
_SLOPE_STEP, _CURVATURE_STEP = 1e-4, 0.1
# Finite, and never accepted.
_IMPOSSIBLE = 1e12


def mixture_at_modes(score: Score, prior: Array) -> GaussianMixture:
    """Mixture like the posterior, from its modes and the curvature of the density there.

    Where the noise is unknown, a tempered likelihood prefers large noise up to a certain power, and
    then all of a sudden the small noise of the true curve: a population that follows it misses
    that. Climbing from draws of the prior, shape (n, d), does not.
    """
    width = prior.std(axis=0)

    def energy(points: Array) -> Array:
        value = -sum(score(points * width))
        return np.where(np.isfinite(value), value, _IMPOSSIBLE)

    def with_slope(point: Array) -> tuple[float, Array]:
        step = _SLOPE_STEP * np.eye(len(point))
        values = energy(np.concatenate([point[None], point + step, point - step]))
        up, down = np.split(values[1:].clip(max=_IMPOSSIBLE), 2)
        return min(values[0], _IMPOSSIBLE), (up - down) / (2 * _SLOPE_STEP)

    starts = prior / width
    order = np.argsort(energy(starts))
    # The best of them, and others down to the middle.
    ranks = np.geomspace(1, len(order) / 2, _SEARCHES).round().astype(int) - 1
    found = [minimize(with_slope, starts[i], jac=True, method="BFGS") for i in order[ranks]]
    modes: list[tuple[float, Array, Array]] = []
    for result in sorted(found, key=lambda r: r.fun):
        if any(np.sum(np.linalg.solve(f, result.x - m) ** 2) < result.x.size for _, m, f in modes):
            continue  # the same
        factor = _factor_at(energy, result)
        modes.append((np.log(np.diagonal(factor)).sum() - result.fun, result.x, factor))
    largest = max(weight for weight, *_ in modes)
    modes = [mode for mode in modes if mode[0] > largest - _NEGLIGIBLE]
    log_weights, means, factors = (np.array(x) for x in zip(*modes, strict=True))
    return GaussianMixture(
        log_weights - logsumexp(log_weights), means * width, factors * width[:, None]
    )


def _factor_at(energy: Callable[[Array], Array], result: OptimizeResult) -> Array:
    """Cholesky factor of the inverse curvature at a mode, no wider than the prior."""
    size = result.x.size
    step = np.diag(_CURVATURE_STEP * np.sqrt(np.diagonal(result.hess_inv).clip(1e-8, 1.0)))
    pairs = [(i, j) for i in range(size) for j in range(i + 1)]
    signs = np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)])
    points = [result.x + a * step[i] + b * step[j] for i, j in pairs for a, b in signs]
    values = energy(np.array(points)).reshape(-1, 4) @ np.prod(signs, axis=1) / 4
    curvature = np.zeros((size, size))
    for (i, j), value in zip(pairs, values, strict=True):
        curvature[i, j] = curvature[j, i] = value / (step[i, i] * step[j, j])
    eigenvalues, vectors = np.linalg.eigh(curvature)
    inverse = (vectors / eigenvalues.clip(1.0, None)) @ vectors.T
    return np.linalg.cholesky((inverse + inverse.T) / 2)
