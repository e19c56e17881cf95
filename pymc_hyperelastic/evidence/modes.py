"""Modes of a posterior, climbed to from many places, and the mixture that they make."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from pymc_hyperelastic.evidence.climbs import climb_together
from pymc_hyperelastic.evidence.mixture import Array, GaussianMixture
from pymc_hyperelastic.evidence.target import Ascent

# Modes that are less likely by so many nats are nothing.
_NEGLIGIBLE = 20.0
# Step of the differences of slopes that make a curvature, as a fraction of the mode's width.
_STEP = 0.03
# A mode is no wider than so many widths of the prior.
_WIDEST = 5.0
# Nats by which a climb may still be below its summit: else it has not found one. The density of a
# hierarchy may grow without bound where a spread goes to zero.
_BELOW = 1.0
# Step over a cliff, as a fraction of the mode's width: the density falls by that many nats there.
_EDGE = 1e-6
# No climb starts within this number of sds of a known mode: it would lead there.
_BASIN = 1.5
# Nats by which the density of a point may differ from that of a mode near it. If it differs more,
# the point belongs to another regime of the prior, or to another mode.
_UNLIKE = 5.0


class Modes(NamedTuple):
    """Modes of a density, as a mixture of normal distributions."""

    mixture: GaussianMixture
    """One component a mode, with the curvature of the density there."""
    log_masses: Array
    """Logarithm of the integral of each, by Laplace's approximation."""


def modes_from(
    ascent: Ascent, groups: Sequence[Array], width: Array, more: Iterable[Array] = ()
) -> Modes | None:
    """Modes of a density, from climbs from starts in groups, (n, d) each; None if it has none.

    Where the noise is unknown, a tempered likelihood prefers large noise up to a certain power, and
    then all of a sudden the small noise of the true curve: a population that follows it misses
    that. Climbing from draws of the prior, of the given `width`, does not.

    What share of all climbs would lead to modes that are not known yet, the share of those tells
    that led where no other did. `More` groups are therefore climbed from as long as a mode that
    counts was reached by one climb alone.

    References
    ----------
    I. J. Good, The population frequencies of species and the estimation of population parameters,
    Biometrika 40 (1953) 237.
    """
    found = _Found(ascent, width)
    for group in groups:
        found.climb_from(group)
    for group in more:
        if found.settled:
            break
        found.climb_from(group)
    return found.modes


class _Found:
    """Modes so far, and how many climbs have led to each."""

    def __init__(self, ascent: Ascent, width: Array) -> None:
        self._ascent, self._width = ascent, width
        self._means: list[Array] = []
        self._heights: list[float] = []
        self._factors: list[Array] = []
        self._masses: list[float] = []
        self._reached: list[int] = []

    def climb_from(self, group: Array) -> None:
        """Climb from all of a group that are not at a mode yet."""
        heights = self._ascent(self._width)(group).height
        starts = [x for x, h in zip(group, heights, strict=True) if self._at(x, h, _BASIN) is None]
        if not starts:
            return
        climbed = climb_together(self._ascent, np.array(starts), self._width)
        for i in np.argsort(-climbed.heights):
            if not np.isfinite(climbed.heights[i]):
                continue
            known = self._at(climbed.points[i], climbed.heights[i])
            if known is not None:
                self._reached[known] += 1
                continue
            factor = self._factor_of(*(values[i] for values in climbed))
            if factor is None:
                continue
            self._means.append(climbed.points[i])
            self._heights.append(climbed.heights[i])
            self._factors.append(factor)
            self._masses.append(np.log(np.diagonal(factor)).sum() + climbed.heights[i])
            self._reached.append(1)

    def _factor_of(self, point: Array, height: float, slope: Array, widths: Array) -> Array | None:
        """Cholesky factor of the covariance at the end of a climb; None if it is no mode."""
        factor = factor_at(self._ascent, point, widths, self._width)
        if factor is None or np.sum((factor.T @ slope) ** 2) < 2 * _BELOW:
            return factor
        # At the edge of a regime the density rises up to a cliff. What ends where nothing is
        # possible is left to the particles.
        up = widths**2 * slope
        beyond = point + _EDGE * up / np.linalg.norm(up / widths)
        if not -np.inf < self._ascent(widths)(beyond[None]).height[0] < height - _BELOW:
            return None
        return factor_at(self._ascent, point, widths, self._width, slope)

    @property
    def settled(self) -> bool:
        """Whether each mode that counts was reached by two climbs at least."""
        return bool(self._masses) and np.array(self._reached)[self._counts].min() > 1

    @property
    def modes(self) -> Modes | None:
        if not self._masses:
            return None
        keep = self._counts
        log_masses = np.array(self._masses)[keep] + np.log(2 * np.pi) * self._width.size / 2
        log_weights = log_masses - logsumexp(log_masses)
        mixture = GaussianMixture(
            log_weights, np.array(self._means)[keep], np.array(self._factors)[keep]
        )
        return Modes(mixture, log_masses)

    @property
    def _counts(self) -> NDArray[np.bool_]:
        return np.array(self._masses) > max(self._masses) - _NEGLIGIBLE

    def _at(self, point: Array, height: float, distance: float = 1.0) -> int | None:
        """Index of the first known mode near a point that explains its density.

        The mode is at most `distance` sds away in each direction.
        """
        squares, peaks = self._squares(point), np.array(self._heights)
        near = squares < distance**2 * point.size
        alike = (height > peaks - squares / 2 - _UNLIKE) & (height < peaks + _UNLIKE)
        found = np.flatnonzero(near & alike)
        return int(found[0]) if found.size else None

    def _squares(self, point: Array) -> Array:
        """Squared distances from the modes found before, in sds."""
        if not self._means:
            return np.empty(0)
        away = (point - np.array(self._means))[..., None]
        return np.square(np.linalg.solve(np.array(self._factors), away)).sum(axis=(1, 2))


def factor_at(
    ascent: Ascent, point: Array, local: Array, width: Array, slope: Array | float = 0.0
) -> Array | None:
    """Cholesky factor of the inverse curvature at a mode; None if there is no curvature.

    Where the ascent knows it, that is taken; else differences of slopes, on a `local` scale.

    A mode at the edge of a regime falls off along its `slope` ``s`` on one side only, as an
    exponential density with the variance of a normal one of the curvature ``s²``.
    """
    curvature = ascent(local)(point[None]).curvature
    curvature = _curvature_at(ascent, point, local) if curvature is None else curvature[0]
    curvature = curvature + np.outer(slope, slope)
    # On the scale of the prior, which no mode is much wider than.
    curvature = curvature * np.outer(width, width)
    if not np.isfinite(curvature).all():
        return None
    eigenvalues, vectors = np.linalg.eigh((curvature + curvature.T) / 2)
    inverse = (vectors / eigenvalues.clip(_WIDEST**-2, None)) @ vectors.T
    try:
        return width[:, None] * np.linalg.cholesky((inverse + inverse.T) / 2)
    except np.linalg.LinAlgError:
        return None


def _curvature_at(ascent: Ascent, point: Array, local: Array) -> Array:
    step = np.diag(_STEP * local)
    around = point + np.concatenate([step, -step])
    up, down = np.split(-ascent(local)(around).slope, 2)
    return (up - down) / (2 * _STEP * local[:, None])
