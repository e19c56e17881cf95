"""Distributions of very many small groups, of specimens known with normal errors of one size."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymc_hyperelastic.models.class_distribution import CONCENTRATION
from pymc_hyperelastic.models.natural_scale import NaturalScale

Array = NDArray[np.float64]

# Sweeps before any draw is kept, in which steps are fitted; sweeps for each draw.
_WARM_UP, _SWEEPS = 200, 3
# Share of the steps of one variable that are taken where it moves best, and the first steps.
_TAKEN, _STEP = 0.44, 0.5


class NormalGroups(NamedTuple):
    """Draws of the distributions of groups."""

    location: Array
    """(group, draw, coordinate)."""
    root: Array
    """Lower Cholesky factors of covariances, (group, draw, coordinate, coordinate)."""


class _Sums(NamedTuple):
    """All that a group's specimens say, if their errors are alike."""

    specimens: Array
    mean: Array
    scatter: Array


def draw_groups(
    scale: NaturalScale,
    groups: list[Array],
    error: Array,
    start: tuple[Array, Array],
    draws: int,
    rng: np.random.Generator,
) -> NormalGroups:
    r"""Draw from the posteriors of the distributions of groups, all at once.

    Of ``n`` specimens, found at ``x_i`` with errors of the covariance ``V``, with the prior
    ``N(m₀, T)`` of the location,

    .. math:: x_i \sim N(m, C), \qquad C = Σ + V, \qquad
        p(x \mid Σ) ∝ |C|^{-(n-1)/2} e^{-\frac12 \mathrm{tr}(C^{-1} S)} \,
        N(\bar x; m_0, T + C/n).

    Spreads and partial correlations are changed one after the other, as Metropolis has it; the
    location given these is normal. Priors are those of a class.

    Parameters
    ----------
    scale : NaturalScale
        Coordinates of the specimens, and priors of their location and spreads.
    groups : list of array, shape (specimen, coordinate)
        What was found of the specimens of each group.
    error : array, shape (coordinate, coordinate)
        Covariance of the errors.
    start : pair of array, shapes (group, coordinate) and (group, pair of coordinates)
        Logarithms of spreads and partial correlations from which to start, near the posteriors.
    """
    size = len(scale.names)
    sums = _Sums(
        np.array([float(len(x)) for x in groups]),
        np.stack([x.mean(axis=0) for x in groups]),
        np.stack([(x - x.mean(axis=0)).T @ (x - x.mean(axis=0)) for x in groups]),
    )
    logs, partial = start
    state = np.concatenate([logs, np.arctanh(partial)], axis=1)
    steps = np.full(state.shape, _STEP)
    height = _log_posterior(scale, state, sums, error)
    kept = []
    for sweep in range(_WARM_UP + draws * _SWEEPS):
        for i in range(state.shape[1]):
            moved = state.copy()
            moved[:, i] += steps[:, i] * rng.standard_normal(len(state))
            other = _log_posterior(scale, moved, sums, error)
            taken = np.log(rng.random(len(state))) < other - height
            state[taken, i], height[taken] = moved[taken, i], other[taken]
            if sweep < _WARM_UP:
                steps[:, i] *= np.exp((taken - _TAKEN) / (1 + sweep) ** 0.6)
        if sweep >= _WARM_UP and (sweep - _WARM_UP) % _SWEEPS == 0:
            kept.append(state.copy())
    roots = np.stack([_root(x, size) for x in kept], axis=1)
    covariance = roots @ roots.mT + error
    mean, sd = scale.location_prior
    # The location of each, given its covariance.
    precision = sums.specimens[:, None, None, None] * np.linalg.inv(covariance)
    variance = np.linalg.inv(precision + np.diag(sd**-2.0))
    pull = precision @ sums.mean[:, None, :, None] + (mean / sd**2)[:, None]
    middle = (variance @ pull)[..., 0]
    noise = rng.standard_normal((*middle.shape, 1))
    return NormalGroups(middle + (np.linalg.cholesky(variance) @ noise)[..., 0], roots)


def partial_correlations(root: Array) -> Array:
    """Partial correlations (group, pair) of covariances with these Cholesky factors."""
    factor = root / np.linalg.norm(root, axis=-1, keepdims=True)
    left = np.sqrt(np.cumsum(factor[:, :, ::-1] ** 2, axis=2)[:, :, ::-1])
    pairs = [(i, j) for i in range(1, factor.shape[1]) for j in range(i)]
    rows, columns = np.array(pairs, dtype=int).reshape(-1, 2).T
    return factor[:, rows, columns] / left[:, rows, columns]


def _root(state: Array, size: int) -> Array:
    """Cholesky factors of covariances, by logarithms of spreads and partial correlations."""
    spread, partial = np.exp(state[:, :size]), np.tanh(state[:, size:])
    root = np.zeros((len(state), size, size))
    place = 0
    for i in range(size):
        left = np.ones(len(state))
        for j in range(i):
            root[:, i, j] = partial[:, place] * left
            left = left * np.sqrt(1 - partial[:, place] ** 2)
            place += 1
        root[:, i, i] = left
    return root * spread[:, :, None]


def _log_posterior(scale: NaturalScale, state: Array, sums: _Sums, error: Array) -> Array:
    """Log density of logarithms of spreads and arctangents of partial correlations."""
    size = len(scale.names)
    logs, sd_of_logs = scale.spread_prior
    column = np.array([j for i in range(1, size) for j in range(i)])
    shape = CONCENTRATION + (size - 2 - column) / 2
    prior = -0.5 * np.sum(((state[:, :size] - logs) / sd_of_logs) ** 2, axis=1)
    prior -= 2 * np.log(np.cosh(state[:, size:])) @ shape
    root = _root(state, size)
    covariance = root @ root.mT + error
    mean, sd = scale.location_prior
    of_mean = np.diag(sd**2) + covariance / sums.specimens[:, None, None]
    log_volume = np.linalg.slogdet(covariance)[1]
    log_volume_of_mean = np.linalg.slogdet(of_mean)[1]
    squares = np.trace(np.linalg.solve(covariance, sums.scatter), axis1=1, axis2=2)
    away = (sums.mean - mean)[..., None]
    squares += (away.mT @ np.linalg.solve(of_mean, away))[:, 0, 0]
    return prior - ((sums.specimens - 1) * log_volume + log_volume_of_mean + squares) / 2
