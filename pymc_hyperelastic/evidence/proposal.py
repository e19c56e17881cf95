"""A normalised density like a posterior, fitted to draws of it."""

from collections.abc import Callable
from functools import partial
from typing import Literal

import numpy as np

from pymc_hyperelastic.evidence.mixture import Array, GaussianMixture, components_for

# Fractions by which correlations are shrunk: not at all, or up to uncorrelated.
_SHRINKAGES = np.append(0.0, np.geomspace(1e-3, 1.0, 13))
# Eigenvalues of a correlation matrix of fewer draws than unknowns are zero but for rounding.
_ROUNDING = 1e-12
# Expectation maximisation on one set of draws, once: more would hardly be worth their time.
_ITERATIONS = 30

Fit = Callable[[Array], GaussianMixture]


def fitted_proposal(
    draws: Array,
    effective: float,
    kind: Literal["auto", "normal", "mixture"],
    rng: np.random.Generator,
) -> GaussianMixture:
    """Distribution fitted to draws, (chain, draw, unknown), of which so many are effective.

    What is to choose is what the first halves of the chains foretell best of the second ones.
    """
    dimension = draws.shape[2]
    middle = draws.shape[1] // 2
    early, late = (part.reshape(-1, dimension) for part in (draws[:, :middle], draws[:, middle:]))
    normal = partial(_normal, shrinkage=_best_shrinkage(early, late))
    components = components_for(effective, dimension)
    fits: list[Fit] = [normal]
    if kind != "normal" and components > 1:
        several = partial(
            GaussianMixture.fit, components=components, rng=rng, iterations=_ITERATIONS
        )
        fits = [several] if kind == "mixture" else [normal, several]

    candidates = []
    for fit in fits:
        mixture = fit(early)
        candidates.append((mixture.log_density(late).mean(), fit, False))
        if kind != "normal":
            candidates.append((mixture.heavy_tailed().log_density(late).mean(), fit, True))
    _, fit, heavy_tailed = max(candidates, key=lambda candidate: candidate[0])
    mixture = fit(draws.reshape(-1, dimension))
    return mixture.heavy_tailed() if heavy_tailed else mixture


def normal_of_halves(early: Array, late: Array) -> GaussianMixture:
    """Normal distribution of both halves, correlations shrunk as one foretells the other best."""
    return _normal(np.concatenate([early, late]), _best_shrinkage(early, late))


def _normal(points: Array, shrinkage: float) -> GaussianMixture:
    """One normal distribution, its correlations multiplied by ``1 − shrinkage``."""
    sd = points.std(axis=0)
    standard = (points - points.mean(axis=0)) / sd
    correlation = (1 - shrinkage) * standard.T @ standard / len(points)
    np.fill_diagonal(correlation, 1.0)
    factor = sd[:, None] * np.linalg.cholesky(correlation)
    return GaussianMixture(np.zeros(1), points.mean(axis=0)[None], factor[None])


def _best_shrinkage(early: Array, late: Array) -> float:
    """Shrinkage with which the early draws foretell the late ones best.

    All shrunk correlation matrices have the same eigenvectors.
    """
    mean, sd = early.mean(axis=0), early.std(axis=0)
    standard = (early - mean) / sd
    eigenvalues, vectors = np.linalg.eigh(standard.T @ standard / len(early))
    square = np.mean(((late - mean) / sd @ vectors) ** 2, axis=0)
    kept = 1 - _SHRINKAGES[:, None]
    variance = kept * eigenvalues.clip(_ROUNDING) + 1 - kept
    return float(_SHRINKAGES[np.argmin((np.log(variance) + square / variance).sum(axis=1))])
