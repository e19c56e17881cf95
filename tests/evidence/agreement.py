"""Tolerances and checks that the tests of evidences share."""

import numpy as np
from scipy.optimize import approx_fprime

# An honest standard error is exceeded fourfold once in 16,000 runs; seeds are fixed.
STANDARD_ERRORS = 4
# Rounding of sums and logarithms of a few numbers of order one.
ROUNDING = 1e-12
# Finite differences with a step of 1e-6, for gradients of order one.
DIFFERENCE_TOLERANCE = 1e-4


def assert_agrees(estimate, exact, at_most):
    """Check that the stated standard error is small, and explains the error of the value."""
    assert estimate.standard_error < at_most
    assert abs(estimate.value - exact) < STANDARD_ERRORS * estimate.standard_error


def assert_gradients(found, log_density, points):
    """Compare the gradient of a log density at each point with finite differences."""
    for point, gradient in zip(points, found, strict=True):
        expected = approx_fprime(point, lambda x: log_density(x[None])[0], 1e-6)
        np.testing.assert_allclose(gradient, expected, atol=DIFFERENCE_TOLERANCE)
