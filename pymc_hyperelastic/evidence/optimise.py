"""Maximise a log density from many starting points together: an evaluation of many costs little."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymc_hyperelastic.evidence.mixture import Array
from pymc_hyperelastic.evidence.target import Derivatives, LogDensityGradient

# Largest component of the gradient at the end, in nats for the width of the mode: the maximum is
# then a twentieth of an sd away at most.
_GRADIENT_TOLERANCE = 0.05
# The same where the width was learned from the steps, which may give a far too small one.
_GRADIENT_TOLERANCE_BFGS = 0.005
# Smallest width of a mode, in widths of the prior.
_NARROWEST = 1e-8
# Steps that any optimisation may take.
_FEWEST_STEPS = 100
# Steps that an optimisation may take in addition, for each unknown.
_STEPS_PER_UNKNOWN = 5
# Evaluations for each step, on average, at most: the others are steps that were rejected.
_EVALUATIONS_PER_STEP = 2
# Levenberg-Marquardt gain ratio below which a step is rejected.
_LEAST_GAIN = 1e-4
# Factor of the damping after a rejected step, which doubles with each further one (Nielsen 1999).
_MORE_DAMPING = 2.0
# Least factor of the damping after an accepted step (Nielsen 1999).
_LESS_DAMPING = 1 / 3
# Length of a step that ends an optimisation, in widths of the mode.
_NO_STEP = 1e-12
# Rounding error of a curvature, relative to the sum of all curvatures of the point.
_ROUNDING = 1e-14


class Maxima(NamedTuple):
    """Ends of optimisations, in the order of their starts."""

    points: Array
    log_densities: Array
    """−inf where an optimisation began at an impossible point."""
    gradients: Array
    widths: Array
    """Estimated width of the mode in each variable."""
    curvatures: Array
    """Those of the target, or the last update of them, (n, d, d)."""


def maximize_batch(derivatives: LogDensityGradient, starts: Array, width: Array) -> Maxima:
    """Maximise a log density from all starts, shape (n, d), where the prior has the given width.

    Steps are Newton's, damped as by Levenberg and Marquardt. The curvature is that of the target,
    if it has one, or is updated as by Broyden, Fletcher, Goldfarb and Shanno. The first step is at
    most one width of the prior long.

    References
    ----------
    J. Nocedal and S. J. Wright, Numerical Optimization, 2nd edition, Springer 2006, chapters 6 and
    10. Damping: H. B. Nielsen, Damping parameter in Marquardt's method, Technical University of
    Denmark, IMM-REP-1999-05.
    """
    count, size = starts.shape

    def evaluate(x: Array, local: Array) -> Derivatives:
        """Evaluate points in units of the width of the prior."""
        value, gradient, curvature = derivatives(x * width, width * local)
        if curvature is not None:
            curvature = curvature * np.outer(width, width)
        return Derivatives(
            np.where(np.isfinite(value), value, -np.inf), gradient * width, curvature
        )

    x, local = starts / width, np.ones((count, size))
    value, gradient, known = evaluate(x, local)
    tolerance = _GRADIENT_TOLERANCE if known is not None else _GRADIENT_TOLERANCE_BFGS
    curvature = np.zeros((count, size, size)) if known is None else known
    damping, more = np.linalg.norm(gradient, axis=1), np.full(count, _MORE_DAMPING)
    length, steps = np.full(count, np.inf), np.zeros(count, int)
    most = _FEWEST_STEPS + _STEPS_PER_UNKNOWN * size
    for _ in range(_EVALUATIONS_PER_STEP * most):
        steep = np.abs(gradient * local).max(axis=1) > tolerance
        own = np.flatnonzero(np.isfinite(value) & steep & (length > _NO_STEP) & (steps < most))
        if not own.size:
            break
        damped = _with_damping(curvature[own], damping[own])
        step = np.linalg.solve(damped, gradient[own, :, None])[..., 0]
        length[own] = np.linalg.norm(step / local[own], axis=1)
        expected = (_dot(step, gradient[own]) + damping[own] * _dot(step, step)) / 2
        new_value, new_gradient, known = evaluate(x[own] + step, local[own])
        gain = (new_value - value[own]) / expected
        accept = gain > _LEAST_GAIN
        rejected, accepted = own[~accept], own[accept]
        damping[rejected] *= more[rejected]
        more[rejected] *= 2

        if known is None:
            fall = gradient[accepted] - new_gradient[accept]
            curvature[accepted] = _bfgs_update(curvature[accepted], step[accept], fall)
        else:
            curvature[accepted] = known[accept]
        x[accepted] += step[accept]
        value[accepted], gradient[accepted] = new_value[accept], new_gradient[accept]
        damping[accepted] *= np.clip(1 - (2 * gain[accept] - 1) ** 3, _LESS_DAMPING, 1.0)
        more[accepted], steps[accepted] = _MORE_DAMPING, steps[accepted] + 1
        inverse = np.linalg.inv(_with_damping(curvature[accepted], 1.0))
        local[accepted] = np.sqrt(np.diagonal(inverse, axis1=1, axis2=2)).clip(_NARROWEST)
    curvature = curvature / np.outer(width, width)
    return Maxima(x * width, value, gradient / width, local * width, curvature)


def _with_damping(curvature: Array, damping: Array | float) -> Array:
    """Add the damping, and enough for the matrices to stay regular when they are rounded."""
    more = damping + _ROUNDING * np.trace(curvature, axis1=1, axis2=2)
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
