"""The problem that every peer solves: the evidence of six inflation curves, stated in NumPy alone.

A peer that needs only NumPy or JAX then does not pay for importing PyMC.
"""

from types import SimpleNamespace

import numpy as np

INNER_RADIUS, OUTER_RADIUS = 7.0, 9.0
SIGMA, SLOPE_WEIGHT = 5.0, 1.0
# Ranges of the uniform priors.
MU, ALPHA = (1.0, 150.0), (-20.0, 20.0)
# By quadrature, right in all its digits.
LOG_EVIDENCE = -182.95031243

WALL_ORDER = 32


def simulate(rng, mu, alpha, *, specimens, experiments, points=20, noise=0.5):
    """Radii and pressures of each experiment, specimen by specimen."""
    radius = np.linspace(7.3, 10.2, points)
    log_hoop, weight = wall(radius)
    curves = []
    for _ in range(specimens):
        modulus = mu * np.exp(0.08 * rng.standard_normal())
        exponent = alpha * np.exp(0.05 * rng.standard_normal())
        ideal = 8 * modulus / exponent * (np.sinh(exponent * log_hoop) * weight).sum(axis=-1)
        for _ in range(experiments):
            gain, drift = rng.standard_normal(2)
            pressure = ideal * (1 + 0.02 * gain) + 1.5 * drift * np.sin(np.linspace(0, 3, points))
            curves.append((radius, pressure + noise * rng.standard_normal(points)))
    return curves


def known_curves():
    """Six experiments of twenty points."""
    return simulate(np.random.default_rng(100), 45.0, 7.5, specimens=3, experiments=2)


def wall(radius):
    """Logarithms of the hoop stretch, and weights, (point, node), of the integral over the wall.

    The pressure is the sum over the nodes of ``8 mu / alpha sinh(alpha log_hoop) weight``.
    """
    node, weight = np.polynomial.legendre.leggauss(WALL_ORDER)
    half = np.log(OUTER_RADIUS / INNER_RADIUS) / 2
    reference = INNER_RADIUS * np.exp(half * (node + 1))
    squared_hoop = 1 + (radius[:, None] ** 2 - INNER_RADIUS**2) / reference**2
    return np.log(squared_hoop) / 2, half * weight / squared_hoop


def constants(curves, *, one_grid=False):
    """Return the constants of the data that the likelihood needs.

    With `one_grid` the response is taken once for all experiments, which then must have the same
    radii: measured ones do not.
    """
    join = np.stack if one_grid else np.concatenate
    slopes, log_normaliser = [], 0.0
    for radius, pressure in curves:
        size = len(radius)
        rows = np.arange(size - 2)
        difference = np.zeros((size - 2, size))
        difference[rows, rows + 2] = 1 / (radius[2:] - radius[:-2])
        difference[rows, rows] = -difference[rows, rows + 2]
        slopes.append(difference @ pressure)
        gram = np.eye(size) + SLOPE_WEIGHT * difference.T @ difference
        log_normaliser += np.linalg.slogdet(gram)[1] / 2 - size / 2 * np.log(np.pi * SIGMA**2)

    grids = [radius for radius, _ in curves[: 1 if one_grid else None]]
    log_hoop, weight = wall(np.concatenate(grids))
    # As an integral over the stretch, the pressure has the integrand T / (l (l^2 - 1)), which does
    # not depend on the radius: the stiffness is the difference of its values at the two faces.
    inner = np.concatenate([radius[1:-1] for radius in grids])
    outer = np.sqrt(inner**2 + OUTER_RADIUS**2 - INNER_RADIUS**2)
    first, last = inner / INNER_RADIUS, outer / OUTER_RADIUS
    faces = [
        1 / (first * (first**2 - 1) * INNER_RADIUS),
        -inner / (last * (last**2 - 1) * outer * OUTER_RADIUS),
    ]
    return SimpleNamespace(
        pressure=join([pressure for _, pressure in curves]),
        slope=join(slopes),
        log_normaliser=log_normaliser,
        log_hoop=log_hoop,
        weight=weight,
        log_hoop_of_faces=np.log([first, last]),
        weight_of_faces=np.array(faces),
    )


def log_likelihood(data, mu, alpha, sinh):
    """Log-likelihood at one point; `sinh` is that of NumPy, of JAX or of PyTensor."""
    modulus = 8 * mu / alpha
    pressure = modulus * (sinh(alpha * data.log_hoop) * data.weight).sum(axis=-1)
    stiffness = modulus * (sinh(alpha * data.log_hoop_of_faces) * data.weight_of_faces).sum(axis=0)
    misfit = ((pressure - data.pressure) ** 2).sum()
    misfit += SLOPE_WEIGHT * ((stiffness - data.slope) ** 2).sum()
    return data.log_normaliser - misfit / SIGMA**2
