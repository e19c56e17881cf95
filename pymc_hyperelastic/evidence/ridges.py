"""A mode that is a bent ridge, as a row of normal distributions along it."""

import numpy as np
from scipy.special import logsumexp

from pymc_hyperelastic.evidence.climbs import climb_together
from pymc_hyperelastic.evidence.mixture import Array, GaussianMixture
from pymc_hyperelastic.evidence.modes import Modes, factor_at
from pymc_hyperelastic.evidence.target import Ascent, Rise, Slope

# Between neighbours, in sds of the mode along its longest axis.
_SPACING = 0.7
# A row ends where one has so many nats less than the largest, and has so many members to either
# side at most. Modes that have so much less than the largest are left as they are.
_NATS, _MOST = 10.0, 24


def along_ridges(ascent: Ascent, modes: Modes, width: Array) -> GaussianMixture:
    r"""Mixture of the modes, each of them divided along the longest of its axes.

    Times a normal distribution of a coordinate :math:`t` along this axis, about one of a row of
    places :math:`t_k` a spacing :math:`s` apart, the density has a mode on its ridge; the sum over
    the row is the density once more,

    .. math:: \sum_k p(x) N(t(x); t_k, s^2) \propto p(x) .

    Laplace's approximation of each is thus a mixture that follows the ridge where it bends, and
    ends where it does. One of the mode alone reaches past the bend into what has no mass.
    """
    rows = [
        _row(ascent, mean, factor, width)
        if mass > modes.log_masses.max() - _NATS
        else GaussianMixture(np.zeros(1), mean[None], factor[None])
        for mean, factor, mass in zip(
            modes.mixture.means, modes.mixture.factors, modes.log_masses, strict=True
        )
    ]
    weighted = zip(modes.mixture.log_weights, rows, strict=True)
    return GaussianMixture(
        np.concatenate([weight + row.log_weights for weight, row in weighted]),
        np.concatenate([row.means for row in rows]),
        np.concatenate([row.factors for row in rows]),
    )


def _row(ascent: Ascent, mean: Array, factor: Array, width: Array) -> GaussianMixture:
    """One mode along its longest axis, on the scale of the prior."""
    scaled = factor / width[:, None]
    variances, axes = np.linalg.eigh(scaled @ scaled.T)
    axis, spacing = axes[:, -1], _SPACING * np.sqrt(variances[-1])
    sds = np.sqrt(np.square(factor).sum(axis=1))

    def member(place: float, start: Array) -> tuple[Array, Array, float] | None:
        """Mode, its factor and its log mass at a place along the row."""
        near = _near(ascent, axis / width, place, spacing)
        top = climb_together(near, start[None], width)
        # A climb that ends where it began has learned no widths.
        own = factor_at(near, top.points[0], np.minimum(top.widths[0], sds), width)
        if own is None or not np.isfinite(top.heights[0]):
            return None
        return top.points[0], own, top.heights[0] + np.log(np.diagonal(own)).sum()

    middle = float(axis @ (mean / width))
    first = member(middle, mean)
    if first is None:
        return GaussianMixture(np.zeros(1), mean[None], factor[None])
    members, largest = [first], first[2]
    for step in (spacing, -spacing):
        last, start = first[0], first[0] + step * axis * width
        for count in range(1, _MOST + 1):
            next_one = member(middle + count * step, start)
            if next_one is None:
                break
            members.append(next_one)
            largest = max(largest, next_one[2])
            if next_one[2] < largest - _NATS:
                break
            last, start = next_one[0], 2 * next_one[0] - last
    means, factors, masses = (np.array(x) for x in zip(*members, strict=True))
    return GaussianMixture(masses - logsumexp(masses), means, factors)


def _near(ascent: Ascent, along: Array, place: float, spacing: float) -> Ascent:
    """The density times a normal one of how far a point is along an axis."""

    def near(width: Array) -> Slope:
        slope_of = ascent(width)

        def slope(points: Array) -> Rise:
            height, slope, curvature = slope_of(points)
            distance = (points @ along - place) / spacing
            slope = slope - np.outer(distance / spacing, along)
            if curvature is not None:
                curvature = curvature + np.outer(along, along) / spacing**2
            return Rise(height - np.square(distance) / 2, slope, curvature)

        return slope

    return near
