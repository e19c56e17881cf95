"""Modes of a density that has come a little way from another one, whose modes are known."""

from collections.abc import Callable

import numpy as np

from pymc_hyperelastic.evidence.mixture import Array, GaussianMixture, log_sum_exp

# Newton's steps, and the length of the last one, in sds of the mode; steps of differences.
_STEPS, _LAST, _STEP = 12, 0.3, 0.05
# Curvature in a direction, relative to that of the step before, below which there is no mode.
_FLATTEST = 1e-4


def modes_near(
    log_density: Callable[[Array], Array], known: GaussianMixture
) -> GaussianMixture | None:
    """Mixture of the modes of a density (one component each, by Laplace's approximation).

    They are looked for from each component of a `known` mixture, in its coordinates, by Newton's
    method. None where one of these ways leads to no mode within a few steps: it is then to be
    looked for with more care. Two of them may lead to one mode.
    """
    points, factors = known.means, known.factors
    for _ in range(_STEPS):
        height, slope, curvature = _rise(log_density, points, factors)
        if not np.isfinite(curvature).all():
            return None
        eigenvalues, vectors = np.linalg.eigh(curvature)
        if eigenvalues.min() < _FLATTEST:
            return None
        along = np.einsum("kij,ki->kj", vectors, slope) / eigenvalues
        points = points + np.einsum("kij,kjl,kl->ki", factors, vectors, along)
        roots = factors @ vectors / np.sqrt(eigenvalues)[:, None]
        factors = np.linalg.cholesky(roots @ roots.mT)
        rise = np.sum(along**2 * eigenvalues, axis=1)
        if rise.max() < _LAST**2:
            log_volumes = np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)
            log_masses = height + rise / 2 + log_volumes
            return GaussianMixture(log_masses - log_sum_exp(log_masses), points, factors)
    return None


def _rise(
    log_density: Callable[[Array], Array], points: Array, factors: Array
) -> tuple[Array, Array, Array]:
    """Heights of points, and slopes and curvatures there, by coordinates of the factors."""
    count, size = points.shape
    first, second = np.triu_indices(size, 1)
    unit = np.eye(size)
    around = _STEP * np.concatenate([0 * unit[:1], unit, -unit, unit[first] + unit[second]])
    values = log_density((points[:, None] + around @ factors.mT).reshape(-1, size))
    values = values.reshape(count, -1)
    centre, up, down, both = np.split(values, [1, 1 + size, 1 + 2 * size], axis=1)
    curvature = np.zeros((count, size, size))
    with np.errstate(invalid="ignore"):
        crossed = (up[:, first] + up[:, second] - centre - both) / _STEP**2
        curvature[:, first, second] = curvature[:, second, first] = crossed
        straight = range(size), range(size)
        curvature[:, *straight] = (2 * centre - up - down) / _STEP**2
        slope = (up - down) / (2 * _STEP)
    return centre[:, 0], slope, curvature
