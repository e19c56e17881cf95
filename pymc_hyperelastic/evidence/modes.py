"""Find the modes of a density, and approximate each by a normal distribution (Laplace)."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from pymc_hyperelastic.evidence.mixture import Array, GaussianMixture
from pymc_hyperelastic.evidence.optimise import maximize_batch
from pymc_hyperelastic.evidence.target import LogDensityGradient, width_of, with_curvature

# Nats below the largest log mass from which modes are dropped.
_NEGLIGIBLE = 20.0
# Nats by which the end of an optimisation may be below its maximum, and the density of a point may
# differ from that of a mode near it. If it differs more, there is no maximum, as for the density of
# a hierarchy where a spread goes to zero; or the point belongs to another mode or regime.
_CLOSE = 1.0
# Step over the edge of a regime of the prior, in widths of the mode.
_EDGE = 1e-6
# Starting points of a group.
_STARTS = 16


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
    modes: list[_Mode] = []
    for group in groups:
        _search(derivatives, group, width, modes)
    for group in more:
        if modes and min(mode.found for mode in _that_count(modes)) > 1:
            break
        _search(derivatives, group, width, modes)
    if not modes:
        return None
    modes = _that_count(modes)
    log_masses = np.array([mode.log_mass for mode in modes])
    means, factors = (np.array([getattr(m, name) for m in modes]) for name in ("mean", "factor"))
    return Modes(GaussianMixture(log_masses - logsumexp(log_masses), means, factors), log_masses)


@dataclass
class _Mode:
    """A mode of a density."""

    mean: Array
    log_density: float
    factor: Array
    """Cholesky factor of the inverse curvature."""
    found: int = 1
    """How many optimisations have led to it."""

    @property
    def log_mass(self) -> float:
        """Logarithm of the integral, by Laplace's approximation."""
        log_volume = np.log(np.diagonal(self.factor)).sum() + np.log(2 * np.pi) * self.mean.size / 2
        return float(self.log_density + log_volume)

    def explains(self, point: Array, log_density: float) -> bool:
        """Return True if a point is at most about one sd away, with a density like the mode's."""
        square = np.sum(np.linalg.solve(self.factor, point - self.mean) ** 2)
        below = self.log_density - log_density
        return bool(square < point.size and -_CLOSE < below < _CLOSE + square / 2)


def _that_count(modes: list[_Mode]) -> list[_Mode]:
    """Return the modes whose mass is not negligible."""
    largest = max(mode.log_mass for mode in modes)
    return [mode for mode in modes if mode.log_mass > largest - _NEGLIGIBLE]


def _search(
    derivatives: LogDensityGradient, group: Array, width: Array, modes: list[_Mode]
) -> None:
    """Optimise from all points of a group that are not at a known mode; new modes are appended."""
    values = derivatives(group, width).log_density
    known = [any(m.explains(x, v) for m in modes) for x, v in zip(group, values, strict=True)]
    if all(known):
        return
    maxima = maximize_batch(derivatives, group[~np.array(known)], width)
    for i in np.argsort(-maxima.log_densities):
        point, value, gradient, widths = (values[i] for values in maxima)
        if not np.isfinite(value):
            continue
        mode = next((m for m in modes if m.explains(point, value)), None)
        if mode is not None:
            mode.found += 1
            continue
        factor = _factor_at(derivatives, point, widths, width)
        if factor is None:
            continue
        # Half of the square of the gradient, in sds, is the distance to the maximum in nats. At the
        # edge of a regime the density rises up to a cliff; an end beside impossible points is left
        # to the particles.
        if np.sum((factor.T @ gradient) ** 2) >= 2 * _CLOSE:
            up = widths**2 * gradient
            beyond = point + _EDGE * up / np.linalg.norm(up / widths)
            over = derivatives(beyond[None], widths[None]).log_density[0]
            if not -np.inf < over < value - _CLOSE:
                continue
        modes.append(_Mode(point, value, factor))


def _factor_at(
    derivatives: LogDensityGradient, point: Array, local: Array, width: Array
) -> Array | None:
    """Return a Cholesky factor of the inverse curvature at a point; None without curvature.

    No mode is wider than the prior. The step of differences is in proportion to `local`.
    """
    (curvature,) = np.asarray(with_curvature(derivatives)(point[None], local[None]).curvature)
    curvature = curvature * np.outer(width, width)
    if not np.isfinite(curvature).all():
        return None
    eigenvalues, vectors = np.linalg.eigh(curvature)
    inverse = (vectors / eigenvalues.clip(1.0)) @ vectors.T
    try:
        return width[:, None] * np.linalg.cholesky((inverse + inverse.T) / 2)
    except np.linalg.LinAlgError:
        return None


def starting_points(points: Array, score: Array) -> Iterator[Array]:
    """Yield groups of points, in turn from the better half and from all, far from each other.

    The first is the best. The best points are mostly close to each other, and lead to one mode: one
    of more mass may lie beyond the tail of the prior, and is found only from that tail, or in a
    part of the prior where every draw is worse than all others, because its likelihood is narrow.
    """
    places = points / width_of(points)
    better, every = score >= np.median(score), np.ones(len(points), bool)
    chosen, distance = [int(np.argmax(score))], np.full(len(points), np.inf)
    start = 0
    for pool in (better, every, better, every):
        while len(chosen) < min(start + _STARTS, pool.sum()):
            distance = np.minimum(distance, np.sum((places - places[chosen[-1]]) ** 2, axis=1))
            chosen.append(int(np.where(pool, distance, -1.0).argmax()))
        if chosen[start:]:
            yield points[chosen[start:]]
        start = len(chosen)
