"""Maximise a log density from many starting points together: an evaluation of many costs little."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymc_hyperelastic.evidence.mixture import VARIANCE_FLOOR, Array
from pymc_hyperelastic.evidence.target import Derivatives, LogDensityGradient

# Largest component of the gradient at the end, in nats for the width of the mode, which may be far
# too small where it was learned from the steps.
_GRADIENT_TOLERANCE = 0.005
# Steps of one optimisation for each unknown, at most: a few starts far up a narrow curved valley
# would take longer than all others.
_STEPS_PER_UNKNOWN = 25
# Steps of one optimisation, at most: a density without bound has no maximum.
_MOST_STEPS = 300


class Maxima(NamedTuple):
    """Ends of optimisations, in the order of their starts."""

    points: Array
    log_densities: Array
    """−inf where an optimisation began at an impossible point."""
    gradients: Array
    widths: Array
    """Estimated width of the mode in each variable."""


def maximize_batch(derivatives: LogDensityGradient, starts: Array, width: Array) -> Maxima:
    """Maximise a log density from all starts, shape (n, d), where the prior has the given width.

    Steps are Newton's, damped as by Levenberg and Marquardt. The curvature is that of the target,
    if it has one, or is updated as by Broyden, Fletcher, Goldfarb and Shanno. The first step is at
    most one width of the prior long.

    References
    ----------
    J. Nocedal and S. J. Wright, Numerical Optimization, 2nd edition, Springer 2006, chapters 6 and
    10. D. W. Marquardt, An algorithm for least-squares estimation of nonlinear parameters, Journal
    of the Society for Industrial and Applied Mathematics 11 (1963) 431.
    """
    count, size = starts.shape

    def evaluate(x: Array, local: Array) -> Derivatives:
        """Evaluate points in units of the width of the prior."""
        value, gradient, curvature = derivatives(x * width, width * local)
        if curvature is not None:
            curvature = curvature * np.outer(width, width)
        value = np.where(np.isfinite(value), value, -np.inf)
        return Derivatives(value, gradient * width, curvature)

    x, local = starts / width, np.ones((count, size))
    value, gradient, known = evaluate(x, local)
    curvature = np.zeros((count, size, size)) if known is None else known
    damping, moving = np.linalg.norm(gradient, axis=1), np.isfinite(value)
    for _ in range(min(_STEPS_PER_UNKNOWN * size, _MOST_STEPS)):
        steep = np.abs(gradient * local).max(axis=1) > _GRADIENT_TOLERANCE
        own = np.flatnonzero(moving & steep)
        if not own.size:
            break
        damped = _with_damping(curvature[own], damping[own])
        step = np.linalg.solve(damped, gradient[own, :, None])[..., 0]
        new_value, new_gradient, known = evaluate(x[own] + step, local[own])
        accept = new_value > value[own]
        damping[own] *= np.where(accept, 0.1, 10.0)  # the factors of Marquardt
        # A step that is rounded to nothing ends an optimisation, as at a cliff.
        moving[own] = (x[own] + step != x[own]).any(axis=1)

        accepted = own[accept]
        if known is None:
            fall = gradient[accepted] - new_gradient[accept]
            curvature[accepted] = _bfgs_update(curvature[accepted], step[accept], fall)
        else:
            curvature[accepted] = known[accept]
        x[accepted] += step[accept]
        value[accepted], gradient[accepted] = new_value[accept], new_gradient[accept]
        inverse = np.linalg.inv(_with_damping(curvature[accepted], 1.0))
        # Steps of differences must not be rounded to nothing.
        local[accepted] = np.sqrt(np.diagonal(inverse, axis1=1, axis2=2).clip(VARIANCE_FLOOR))
    return Maxima(x * width, value, gradient / width, local * width)


def _with_damping(curvature: Array, damping: Array | float) -> Array:
    """Add the damping, and enough for the matrices to stay regular when they are rounded."""
    more = damping + VARIANCE_FLOOR * np.trace(curvature, axis1=1, axis2=2)
    return curvature + more[:, None, None] * np.eye(curvature.shape[1])


def _bfgs_update(curvature: Array, step: Array, fall: Array) -> Array:
    """Update curvatures after a step of each point, along which its gradient has fallen."""
    bend = _dot(step, fall)
    curved = bend > 0
    bend = np.where(curved, bend, 1.0)
    # The first update starts from a multiple of the unit matrix (Nocedal and Wright, 6.20).
    scale = _dot(fall, fall) / bend
    first = curved & ~curvature.any(axis=(1, 2))
    curvature = curvature + np.where(first, scale, 0.0)[:, None, None] * np.eye(step.shape[1])
    along = np.einsum("nij,nj->ni", curvature, step)
    stiffness = np.where(curved, _dot(step, along), 1.0)
    change = _square(fall, bend) - _square(along, stiffness)
    return curvature + np.where(curved[:, None, None], change, 0.0)


def _square(vectors: Array, divisor: Array) -> NDArray:
    return np.einsum("ni,nj,n->nij", vectors, vectors, 1 / divisor)


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("ni,ni->n", a, b)
