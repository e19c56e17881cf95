"""Find the modes of a density, and approximate each by a normal distribution (Laplace)."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import cycle
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from pymc_hyperelastic.evidence.mixture import Array, GaussianMixture
from pymc_hyperelastic.evidence.optimise import Maxima, maximize_batch
from pymc_hyperelastic.evidence.target import Derivatives, LogDensityGradient, width_of

# Nats below the largest log mass from which modes are dropped.
_NEGLIGIBLE = 20.0
# Step of central differences of gradients, in widths of the mode.
_STEP = 0.03
# Step of second differences of a log density, in widths of the mode: larger, since they lose twice
# as many digits.
_SECOND_STEP = 0.05
# Largest width of a mode, in widths of the prior.
_WIDEST = 5.0
# Nats by which the end of an optimisation may be below its maximum: else it has none. The density
# of a hierarchy may grow without bound where a spread goes to zero.
_BELOW_MAXIMUM = 1.0
# Step over the edge of a support, in widths of the mode.
_EDGE = 1e-6
# No optimisation starts within this number of sds of a known mode: it would lead there.
_BASIN = 1.5
# Nats by which the density of a point may differ from that of a mode near it. If it differs more,
# the point belongs to another regime of the prior, or to another mode.
_SAME_MODE = 5.0
# Curvature in sds of a nearby density below which there is no mode.
_FLATTEST = 1e-4
# Gradient in sds of the mode from which an optimisation has not converged, in nats.
_STEEPEST = 0.3
# Numbers of starting points by group.
STARTS = (16, 16, 16, 16)


class Modes(NamedTuple):
    """Modes of a density, as a mixture of normal distributions."""

    mixture: GaussianMixture
    """One component for each mode, with the curvature of the density there."""
    log_masses: Array
    """Logarithm of the integral of each, by Laplace's approximation."""


def find_modes(
    derivatives: LogDensityGradient,
    groups: Sequence[Array],
    width: Array,
    more: Iterable[Array] = (),
) -> Modes | None:
    """Find modes by optimisation from groups of starting points; None if the density has none.

    If the noise is unknown, a tempered likelihood prefers large noise up to a certain power, and
    then suddenly the small noise of the true curve: a population that follows it misses that mode.
    Optimisation from draws of the prior, of the given `width`, finds it.

    The fraction of modes that were found by exactly one optimisation estimates the probability that
    the next one finds a new mode (Good and Turing). Points of `more` groups are therefore used as
    long as a mode that counts was found by one optimisation alone.

    References
    ----------
    I. J. Good, The population frequencies of species and the estimation of population parameters,
    Biometrika 40 (1953) 237.
    """
    found = _Found(derivatives, width)
    for group in groups:
        found.maximize_from(group)
    for group in more:
        if found.settled:
            break
        found.maximize_from(group)
    return found.modes


class _Found:
    """Modes so far, and how many optimisations have led to each."""

    def __init__(self, derivatives: LogDensityGradient, width: Array) -> None:
        self._derivatives, self._width = derivatives, width
        self._means: list[Array] = []
        self._log_densities: list[float] = []
        self._factors: list[Array] = []
        self._masses: list[float] = []
        self._reached: list[int] = []

    def maximize_from(self, group: Array) -> None:
        """Optimise from all points of a group that are not at a known mode."""
        values = self._derivatives(group, self._width).log_density
        starts = [x for x, v in zip(group, values, strict=True) if self._at(x, v, _BASIN) is None]
        if not starts:
            return
        maxima = maximize_batch(self._derivatives, np.array(starts), self._width)
        for i in np.argsort(-maxima.log_densities):
            if not np.isfinite(maxima.log_densities[i]):
                continue
            known = self._at(maxima.points[i], maxima.log_densities[i])
            if known is not None:
                self._reached[known] += 1
                continue
            factor = self._factor_of(maxima, int(i))
            if factor is None:
                continue
            self._means.append(maxima.points[i])
            self._log_densities.append(maxima.log_densities[i])
            self._factors.append(factor)
            self._masses.append(np.log(np.diagonal(factor)).sum() + maxima.log_densities[i])
            self._reached.append(1)

    def _factor_of(self, maxima: Maxima, i: int) -> Array | None:
        """Return a Cholesky factor of the covariance at one end; None if it is no mode."""
        point, value, gradient, widths, _ = (values[i] for values in maxima)
        factor = factor_at(self._derivatives, point, widths, self._width)
        if factor is None or np.sum((factor.T @ gradient) ** 2) < 2 * _BELOW_MAXIMUM:
            return factor
        # At the edge of a regime the density rises up to a cliff. An end beside impossible points
        # is left to the particles.
        up = widths**2 * gradient
        beyond = point + _EDGE * up / np.linalg.norm(up / widths)
        over = self._derivatives(beyond[None], widths).log_density[0]
        if not -np.inf < over < value - _BELOW_MAXIMUM:
            return None
        return factor_at(self._derivatives, point, widths, self._width, gradient)

    @property
    def settled(self) -> bool:
        """True if each mode that counts was found by at least two optimisations."""
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

    def _at(self, point: Array, value: float, distance: float = 1.0) -> int | None:
        """Return the index of the first known mode near a point that explains its log density.

        The mode is at most `distance` sds away in each direction.
        """
        squares, peaks = self._squares(point), np.array(self._log_densities)
        near = squares < distance**2 * point.size
        same = (value > peaks - squares / 2 - _SAME_MODE) & (value < peaks + _SAME_MODE)
        found = np.flatnonzero(near & same)
        return int(found[0]) if found.size else None

    def _squares(self, point: Array) -> Array:
        """Return squared distances from the known modes, in sds."""
        if not self._means:
            return np.empty(0)
        away = (point - np.array(self._means))[..., None]
        return np.square(np.linalg.solve(np.array(self._factors), away)).sum(axis=(1, 2))


def factor_at(
    derivatives: LogDensityGradient,
    point: Array,
    local: Array,
    width: Array,
    slope: Array | float = 0.0,
) -> Array | None:
    """Return a Cholesky factor of the inverse curvature at a mode; None if there is no curvature.

    The curvature is that of the target, if it has one; else it is by differences of gradients, on a
    `local` scale.

    A mode at the edge of a regime falls off along its `slope` ``s`` on one side only, as an
    exponential density with the variance of a normal one of the curvature ``s²``.
    """
    known = derivatives(point[None], local).curvature
    curvature = _curvature_at(derivatives, point, local) if known is None else known[0]
    curvature = curvature + np.outer(slope, slope)
    # In units of the width of the prior, which no mode exceeds by much.
    curvature = curvature * np.outer(width, width)
    if not np.isfinite(curvature).all():
        return None
    eigenvalues, vectors = np.linalg.eigh((curvature + curvature.T) / 2)
    inverse = (vectors / eigenvalues.clip(_WIDEST**-2, None)) @ vectors.T
    try:
        return width[:, None] * np.linalg.cholesky((inverse + inverse.T) / 2)
    except np.linalg.LinAlgError:
        return None


def _curvature_at(derivatives: LogDensityGradient, point: Array, local: Array) -> Array:
    step = np.diag(_STEP * local)
    around = point + np.concatenate([step, -step])
    up, down = np.split(-derivatives(around, local).gradient, 2)
    return (up - down) / (2 * _STEP * local[:, None])


def second_differences(
    log_density: Callable[[Array], Array], points: Array, width: Array
) -> Derivatives:
    """Return a log density, its gradient and its curvature by central differences.

    The curvature is the negative Hessian; its negative eigenvalues are replaced by 0.
    """
    count, size = points.shape
    first, second = np.triu_indices(size, 1)
    unit = np.eye(size)
    stencil = _SECOND_STEP * np.concatenate([0 * unit[:1], unit, -unit, unit[first] + unit[second]])
    step = np.broadcast_to(_SECOND_STEP * width, points.shape)
    around = points[:, None] + stencil / _SECOND_STEP * step[:, None]
    values = log_density(around.reshape(-1, size)).reshape(count, -1)
    centre, up, down, both = np.split(values, [1, 1 + size, 1 + 2 * size], axis=1)
    curvature = np.zeros((count, size, size))
    with np.errstate(invalid="ignore"):
        crossed = (up[:, first] + up[:, second] - centre - both) / (
            step[:, first] * step[:, second]
        )
        curvature[:, first, second] = curvature[:, second, first] = crossed
        straight = range(size), range(size)
        curvature[:, *straight] = (2 * centre - up - down) / step**2
        gradient = (up - down) / (2 * step)
    finite = np.isfinite(curvature).all(axis=(1, 2))
    scale = step[:, :, None] * step[:, None]
    eigenvalues, vectors = np.linalg.eigh(np.where(finite[:, None, None], curvature * scale, 0.0))
    positive = (vectors * eigenvalues.clip(0)[:, None]) @ vectors.mT / scale
    curvature = np.where(finite[:, None, None], positive, np.nan)
    return Derivatives(centre[:, 0], gradient, curvature)


def modes_near(
    log_density: Callable[[Array], Array], known: GaussianMixture
) -> GaussianMixture | None:
    """Find the modes of a density that differs little from one whose modes are known.

    Each mode is the end of an optimisation from a component of the `known` mixture, in units of its
    sds. None if one of these optimisations finds no mode. Two may find the same mode.
    """
    means, factors, log_masses = [], [], []
    for mean, factor in zip(known.means, known.factors, strict=True):

        def derivatives(z: Array, width: Array, mean: Array = mean, by: Array = factor) -> Any:
            return second_differences(lambda x: log_density(mean + x @ by.T), z, width)

        size = len(mean)
        (z,), (value,), (gradient,), _, (curvature,) = maximize_batch(
            derivatives, np.zeros((1, size)), np.ones(size)
        )
        if not np.isfinite(curvature).all() or np.linalg.eigvalsh(curvature).min() < _FLATTEST:
            return None
        # One more step of Newton's method, without another evaluation.
        step = np.linalg.solve(curvature, gradient)
        if not step @ gradient < _STEEPEST**2:
            return None
        covariance = factor @ np.linalg.inv(curvature) @ factor.T
        root = np.linalg.cholesky((covariance + covariance.T) / 2)
        means.append(mean + factor @ (z + step))
        factors.append(root)
        log_masses.append(value + step @ gradient / 2 + np.log(np.diagonal(root)).sum())
    masses = np.array(log_masses)
    return GaussianMixture(masses - logsumexp(masses), np.array(means), np.array(factors))


def starting_points(points: Array, score: Array) -> Iterator[Array]:
    """Yield groups of points, in turn from the better half and from all, far from each other.

    The first is the best. The best points are mostly close to each other, and lead to one mode: one
    of more mass may lie beyond the tail of the prior, and is found only from that tail, or in a
    part of the prior where every draw is worse than all others, because its likelihood is narrow.
    """
    places = points / width_of(points)
    better = score >= np.median(score)
    chosen, distance = [int(np.argmax(score))], np.full(len(points), np.inf)
    start = 0
    for of_better, size in zip(cycle([True, False]), STARTS, strict=False):
        pool = better if of_better else np.ones(len(points), bool)
        while len(chosen) < min(start + size, pool.sum()):
            distance = np.minimum(distance, np.sum((places - places[chosen[-1]]) ** 2, axis=1))
            chosen.append(int(np.where(pool, distance, -1.0).argmax()))
        if chosen[start:]:
            yield points[chosen[start:]]
        start = len(chosen)
