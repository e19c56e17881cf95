"""Tolerances, checks and a regression that the tests of evidences share."""

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import xarray as xr
from scipy import stats
from scipy.optimize import approx_fprime

SEED = 20250
CHAINS, DRAWS = 4, 500

# A correct standard error is exceeded fourfold once in 16,000 runs; seeds are fixed.
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


def as_tree(**variables) -> xr.DataTree:
    """Return draws as samplers return them: variables by (chain, draw, ...)."""
    posterior = {
        name: (("chain", "draw", *(f"{name}_{i}" for i in range(np.ndim(values) - 2))), values)
        for name, values in variables.items()
    }
    return xr.DataTree.from_dict({"posterior": xr.Dataset(posterior)})


class Regression:
    """Correlated coefficients with known noise: evidence and posterior in closed form."""

    def __init__(self, coefficients, seed=SEED, shift=0.0):
        rng = np.random.default_rng(seed)
        rows, noise, scale = 2 * coefficients, 0.5, np.linspace(1, 3, coefficients)
        design = rng.normal(size=(rows, coefficients)) + rng.normal(size=(rows, 1))
        y = design @ (scale * rng.normal(size=coefficients)) + noise * rng.normal(size=rows) + shift
        with pm.Model(coords={"column": range(coefficients)}) as self.model:
            slope = pm.Normal("slope", 0, scale, dims="column")
            pm.Normal("y", pt.dot(design, slope), noise, observed=y)
        precision = design.T @ design / noise**2 + np.diag(scale**-2)
        self.mean = np.linalg.solve(precision, design.T @ y / noise**2)
        covariance = np.linalg.inv(precision)
        self.sd, self.factor = np.sqrt(np.diag(covariance)), np.linalg.cholesky(covariance)
        marginal = (design * scale) @ (design * scale).T + noise**2 * np.eye(rows)
        self.log_evidence = stats.multivariate_normal(cov=marginal).logpdf(y)

    def draws(self, rng, chains=CHAINS, draws=DRAWS, phi=0.0, width=1.0):
        """Return autoregressive chains of the posterior; `phi` is the autocorrelation."""
        standard = rng.standard_normal((chains, draws, len(self.mean)))
        standard[:, 1:] *= np.sqrt(1 - phi**2)
        for i in range(1, draws):
            standard[:, i] += phi * standard[:, i - 1]
        return as_tree(slope=self.mean + width * standard @ self.factor.T)
