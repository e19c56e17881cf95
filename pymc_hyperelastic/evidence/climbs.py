"""Climbs to summits of a density, together: many points are scored almost as fast as one."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymc_hyperelastic.evidence.mixture import Array
from pymc_hyperelastic.evidence.target import Ascent, Rise

# A climb ends where no component of the slope is larger than this, in nats for the width of the
# mode: a twentieth of an sd from the summit at most. A width that was learned may be far too small.
_FLAT, _FLAT_AS_LEARNED = 0.05, 0.005
# A mode is no narrower than so many widths of the prior.
_NARROWEST = 1e-8
# A climb that takes more steps, and so many for each unknown, leads nowhere; nor does one that is
# scored so many times as often.
_FEWEST_STEPS, _STEPS, _TRIES = 100, 5, 2
# A step must gain this share of what it promises; else it is damped so many times as much, then
# twice that, and so on, until it is no step. After one that keeps its promise it is damped less, by
# this factor at most.
_GAIN, _MORE, _NO_STEP, _LESS = 1e-4, 2.0, 1e-12, 1 / 3
# Of the sum of curvatures: rounding leaves no less in a direction that is flat beside the others.
_ROUNDING = 1e-14


class Summits(NamedTuple):
    """Where climbs have ended, in the order of their starts."""

    points: Array
    heights: Array
    """Log density; −inf where a climb began at what is impossible."""
    slopes: Array
    widths: Array
    """Of each variable, as far as the climb has told."""


def climb_together(ascent: Ascent, starts: Array, width: Array) -> Summits:
    """Climb from all of the starts (climb, variable), where the prior has the given width.

    Steps are Newton's, damped as by Levenberg and Marquardt, by curvatures that are known, or
    learned on the way as by Broyden, Fletcher, Goldfarb and Shanno. The first step is one width of
    the prior long at most.

    References
    ----------
    J. Nocedal and S. J. Wright, Numerical Optimization, 2nd edition, Springer 2006, chapters 6 and
    10. Damping: H. B. Nielsen, Damping parameter in Marquardt's method, Technical University of
    Denmark, IMM-REP-1999-05.
    """
    count, size = starts.shape

    def scored(x: Array, local: Array) -> Rise:
        """How some climbs rise, for variables of unit width, on a local scale."""
        height, slope, curvature = ascent(width * local)(x * width)
        if curvature is not None:
            curvature = curvature * np.outer(width, width)
        return Rise(np.where(np.isfinite(height), height, -np.inf), slope * width, curvature)

    x, local = starts / width, np.ones((count, size))
    height, slope, known = scored(x, local)
    flat = _FLAT if known is not None else _FLAT_AS_LEARNED
    curvature = np.zeros((count, size, size)) if known is None else known
    damping, more = np.linalg.norm(slope, axis=1), np.full(count, _MORE)
    length, steps = np.full(count, np.inf), np.zeros(count, int)
    most = _FEWEST_STEPS + _STEPS * size
    for _ in range(_TRIES * most):
        climbing = np.isfinite(height) & (np.abs(slope * local).max(axis=1) > flat)
        own = np.flatnonzero(climbing & (length > _NO_STEP) & (steps < most))
        if not own.size:
            break
        damped = _more_by(curvature[own], damping[own])
        moved = np.linalg.solve(damped, slope[own, :, None])[..., 0]
        length[own] = np.linalg.norm(moved / local[own], axis=1)
        promised = (_dot(moved, slope[own]) + damping[own] * _dot(moved, moved)) / 2
        new_height, new_slope, known = scored(x[own] + moved, local[own])
        kept = (new_height - height[own]) / promised
        enough = kept > _GAIN
        worse, gone = own[~enough], own[enough]
        damping[worse] *= more[worse]
        more[worse] *= 2

        if known is None:
            fall = slope[gone] - new_slope[enough]
            curvature[gone] = _updated(curvature[gone], moved[enough], fall)
        else:
            curvature[gone] = known[enough]
        x[gone] += moved[enough]
        height[gone], slope[gone] = new_height[enough], new_slope[enough]
        damping[gone] *= np.clip(1 - (2 * kept[enough] - 1) ** 3, _LESS, 1.0)
        more[gone], steps[gone] = _MORE, steps[gone] + 1
        inverse = np.linalg.inv(_more_by(curvature[gone], 1.0))
        local[gone] = np.sqrt(np.diagonal(inverse, axis1=1, axis2=2)).clip(_NARROWEST)
    return Summits(x * width, height, slope / width, local * width)


def _more_by(curvature: Array, each: Array | float) -> Array:
    """Curvatures with so much more in each direction, and enough to be regular when rounded."""
    more = each + _ROUNDING * np.trace(curvature, axis1=1, axis2=2)
    return curvature + more[:, None, None] * np.eye(curvature.shape[1])


def _updated(curvature: Array, moved: Array, fall: Array) -> Array:
    """Curvatures after a step of each climb, along which its slope has fallen so much."""
    bend = _dot(moved, fall)
    curved = bend > 0
    bend = np.where(curved, bend, 1.0)
    # Nothing is known before the first update, not even a unit.
    unit = _dot(fall, fall) / bend
    fresh = curved & ~curvature.any(axis=(1, 2))
    curvature = curvature + np.where(fresh, unit, 0.0)[:, None, None] * np.eye(moved.shape[1])
    along = np.einsum("nij,nj->ni", curvature, moved)
    stiffness = np.where(curved, _dot(moved, along), 1.0)
    change = _square(fall, bend) - _square(along, stiffness)
    return curvature + np.where(curved[:, None, None], change, 0.0)


def _square(vectors: Array, by: Array) -> NDArray:
    return np.einsum("ni,nj,n->nij", vectors, vectors, 1 / by)


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("ni,ni->n", a, b)
