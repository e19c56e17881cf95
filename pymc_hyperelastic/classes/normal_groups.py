"""Distributions of very many small groups, of specimens that are known with normal errors."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymc_hyperelastic.models.class_distribution import shape_of_partial_correlations
from pymc_hyperelastic.models.natural_scale import NaturalScale

Array = NDArray[np.float64]

# Sweeps before any draw is kept, in which steps are fitted; sweeps for each draw.
_WARM_UP, _SWEEPS = 200, 3
# Share of the steps of one variable that are taken where it moves best, and the first steps.
_TAKEN, _STEP = 0.44, 0.5


class Found(NamedTuple):
    """What was found of the specimens of a group."""

    x: Array
    """(specimen, coordinate)."""
    kind: NDArray[np.intp]
    """Which of the errors of the group a specimen has."""
    errors: Array
    """Covariances of errors, (kind, coordinate, coordinate)."""


class NormalGroups(NamedTuple):
    """Draws of the distributions of groups."""

    location: Array
    """(group, draw, coordinate)."""
    root: Array
    """Lower Cholesky factors of covariances, (group, draw, coordinate, coordinate)."""


def draw_groups(
    scale: NaturalScale,
    groups: Sequence[Found],
    start: tuple[Array, Array],
    draws: int,
    rng: np.random.Generator,
) -> NormalGroups:
    r"""Draw from the posteriors of the distributions of groups, all at once.

    A group has the location ``m`` and the covariance ``Σ``; a specimen ``z ~ N(m, Σ)`` is found at
    ``x ~ N(z, V)``. In turn are drawn

    - ``m`` given ``Σ``, and ``z`` given both, which are normal;
    - spreads and partial correlations given these, one after the other, as Metropolis has it.

    Priors are those of a class.

    Parameters
    ----------
    scale : NaturalScale
        Coordinates of the specimens, and priors of their location and spreads.
    groups : sequence of Found
        Specimens of each group, all with errors of as many kinds.
    start : pair of array, shapes (group, coordinate) and (group, pair of coordinates)
        Logarithms of spreads and partial correlations from which to start, near the posteriors.
    """
    sampler = _Sampler(scale, groups, rng)
    state = np.concatenate([start[0], np.arctanh(start[1])], axis=1)
    steps = np.full(state.shape, _STEP)
    kept = []
    for sweep in range(_WARM_UP + draws * _SWEEPS):
        location, scatter = sampler.specimens(state)
        taken = sampler.move(state, steps, scatter)
        if sweep < _WARM_UP:
            steps *= np.exp((taken - _TAKEN) / (1 + sweep) ** 0.6)
        elif (sweep - _WARM_UP) % _SWEEPS == 0:
            # Of the covariance that the location was drawn with.
            kept.append((location, sampler.root))
    locations, roots = zip(*kept, strict=True)
    return NormalGroups(np.stack(locations, axis=1), np.stack(roots, axis=1))


def partial_correlations(root: Array) -> Array:
    """Partial correlations (group, pair) of covariances with these Cholesky factors."""
    factor = root / np.linalg.norm(root, axis=-1, keepdims=True)
    left = np.sqrt(np.cumsum(factor[:, :, ::-1] ** 2, axis=2)[:, :, ::-1])
    rows, columns = np.tril_indices(factor.shape[1], -1)
    return factor[:, rows, columns] / left[:, rows, columns]


class _Sampler:
    """All groups, side by side; what a group lacks of the largest one is not looked at."""

    def __init__(
        self, scale: NaturalScale, groups: Sequence[Found], rng: np.random.Generator
    ) -> None:
        self._size, self._rng = len(scale.names), rng
        mean, sd = scale.location_prior
        self._precision, self._pull = np.diag(sd**-2.0), mean / sd**2
        self._logs, self._sd_of_logs = scale.spread_prior
        self._shape = shape_of_partial_correlations(self._size)
        self._number = np.array([float(len(g.x)) for g in groups])
        most = int(self._number.max())
        self._there = np.arange(most) < self._number[:, None]
        self._x = np.stack([np.pad(g.x, [(0, most - len(g.x)), (0, 0)]) for g in groups])
        self._kind = np.stack([np.pad(g.kind, (0, most - len(g.x))) for g in groups])
        self._errors = np.stack([g.errors for g in groups])
        self._roots = np.linalg.cholesky(self._errors)
        kinds = np.arange(self._errors.shape[1])
        of_kind = (self._kind[:, None] == kinds[:, None]) & self._there[:, None]
        self._of_kind = of_kind.sum(axis=2).astype(float)
        self._sum_of_kind = of_kind.astype(float) @ self._x

    def specimens(self, state: Array) -> tuple[Array, Array]:
        """Locations, and scatter of the specimens around them, given their covariances."""
        self.root = _root(state, self._size)
        covariance = self.root @ self.root.mT
        inverse = np.linalg.inv(covariance[:, None] + self._errors)
        precision = self._precision + np.einsum("gk,gkij->gij", self._of_kind, inverse)
        pull = self._pull + np.einsum("gkij,gkj->gi", inverse, self._sum_of_kind)
        factor = np.linalg.cholesky(precision)
        noise = self._rng.standard_normal((*pull.shape, 1))
        whitened = np.linalg.solve(factor, pull[..., None]) + noise
        location = np.linalg.solve(factor.mT, whitened)[..., 0]
        # A specimen and its error as they are beforehand, moved by what they lack of what was found
        # (Matheron's way).
        noise = self._rng.standard_normal((2, *self._x.shape))
        z = noise[0] @ self.root.mT
        of_each = np.arange(len(state))[:, None], self._kind
        error = (self._roots[of_each] @ noise[1][..., None])[..., 0]
        lacking = (self._x - location[:, None] - z - error)[..., None]
        z += (covariance[:, None] @ (inverse[of_each] @ lacking))[..., 0]
        z *= self._there[..., None]
        return location, z.mT @ z

    def move(self, state: Array, steps: Array, scatter: Array) -> Array:
        """Move spreads and partial correlations in place; which of the steps were taken."""
        taken = np.empty(state.shape)
        height = self._log_density(state, scatter)
        for i in range(state.shape[1]):
            moved = state.copy()
            moved[:, i] += steps[:, i] * self._rng.standard_normal(len(state))
            other = self._log_density(moved, scatter)
            better = np.log(self._rng.random(len(state))) < other - height
            state[better, i], height[better] = moved[better, i], other[better]
            taken[:, i] = better
        return taken

    def _log_density(self, state: Array, scatter: Array) -> Array:
        """Log density of logarithms of spreads and arctangents of partial correlations."""
        logs = state[:, : self._size]
        height = -0.5 * np.sum(((logs - self._logs) / self._sd_of_logs) ** 2, axis=1)
        height -= 2 * np.log(np.cosh(state[:, self._size :])) @ self._shape
        root = _root(state, self._size)
        inverse = np.linalg.inv(root)
        log_volume = np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
        squares = np.sum((inverse @ scatter) * inverse, axis=(1, 2))
        return height - self._number * log_volume - squares / 2


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
