"""Build proposals: normalised densities like a posterior, fitted to weighted or equal draws."""

from collections.abc import Callable
from functools import partial

import numpy as np

from pymc_hyperelastic.evidence.mixture import (
    VARIANCE_FLOOR,
    Array,
    GaussianMixture,
    components_for,
    variance_floor,
)
from pymc_hyperelastic.evidence.target import Derivatives, Target, with_curvature
from pymc_hyperelastic.evidence.weights import effective_sample_size, systematic

# Fractions by which correlations may be shrunk.
_SHRINKAGES = np.append(0.0, np.geomspace(1e-3, 1.0, 13))
# Laplace approximations of a mixture: chosen by experiment.
_APPROXIMATIONS = 100
# Distance that a Laplace approximation reaches, in sds of all draws.
_REACH = 2.0

# A method that fits a distribution to points, (n, d).
Fit = Callable[[Array], GaussianMixture]
# A method that fits a proposal to points, (n, d), with log weights, (n), from the current proposal.
ProposalBuilder = Callable[[Array, Array, np.random.Generator, GaussianMixture], GaussianMixture]


def fitted_proposal(
    draws: Array, effective: float, mixtures: bool, rng: np.random.Generator
) -> GaussianMixture:
    """Fit a distribution to draws, (chain, draw, unknown), of which some number are effective.

    Candidates are a normal distribution and, if `mixtures` is True, a mixture, and both with heavy
    tails. They are fitted to the first halves of the chains; the one with the largest mean log
    density at the second halves is chosen, and fitted to all draws.
    """
    dimension = draws.shape[2]
    middle = draws.shape[1] // 2
    early, late = (part.reshape(-1, dimension) for part in (draws[:, :middle], draws[:, middle:]))
    fits: list[Fit] = [partial(_normal, shrinkage=_best_shrinkage(early, late))]
    if mixtures:
        components = components_for(effective, dimension)
        if components > 1:
            fits.append(partial(GaussianMixture.fit, components=components, rng=rng))
        fits += [partial(_heavy_tailed, fit) for fit in fits]
    best = max(fits, key=lambda fit: fit(early).log_density(late).mean())
    return best(draws.reshape(-1, dimension))


def _heavy_tailed(fit: Fit, points: Array) -> GaussianMixture:
    return fit(points).heavy_tailed()


def expectation_maximisation(
    points: Array, log_weights: Array, rng: np.random.Generator, current: GaussianMixture
) -> GaussianMixture:
    """Fit a mixture with as many components as the effective draws determine.

    References
    ----------
    O. Cappé, R. Douc, A. Guillin, J.-M. Marin and C. P. Robert, Adaptive importance sampling in
    general mixture classes, Statistics and Computing 18 (2008) 447.
    """
    components = components_for(effective_sample_size(log_weights), points.shape[1])
    weights = np.exp(log_weights - log_weights.max())
    resampled = points[systematic(weights, len(points), rng)]
    start = current if len(current.means) >= components else None
    return GaussianMixture.fit(resampled, components, rng, start=start)


def laplace_mixture(
    target: Target,
    points: Array,
    log_weights: Array,
    rng: np.random.Generator,
    current: GaussianMixture,
) -> GaussianMixture:
    """Return a Laplace approximation of a target about each of some draws, chosen by weight.

    If data do not determine a parameter, a posterior has arms, along which its other unknowns
    bend. A mixture that is fitted to draws follows an arm only where there are many draws; the
    curvature shows how the density falls off around each draw.
    """
    weights = np.exp(log_weights - log_weights.max())
    covariance = np.cov(points.T, ddof=0, aweights=weights).reshape(2 * points.shape[1:])
    variances = np.diagonal(covariance)
    factor = np.linalg.cholesky(covariance + np.diag(variance_floor(variances)))

    def derivatives(z: Array, width: Array) -> Derivatives:
        """Derivatives with respect to ``z``, where ``x = factor z``."""
        found = target.derivatives(z @ factor.T, width * np.sqrt(variances))
        _, gradient, curvature = found
        if curvature is not None:
            curvature = factor.T @ curvature @ factor
        return found._replace(gradient=gradient @ factor, curvature=curvature)

    chosen = points[systematic(weights, _APPROXIMATIONS, rng)]
    z = np.linalg.solve(factor, chosen.T).T
    with np.errstate(all="ignore"):
        return laplace_about(with_curvature(derivatives)(z, np.ones(z.shape)), chosen, factor)


def laplace_about(derivatives: Derivatives, points: Array, factor: Array) -> GaussianMixture:
    r"""Return a mixture of Laplace approximations about points that are draws of a density.

    On axes where the covariance of all draws is 1 and the curvature :math:`\lambda` at one of
    them, :math:`x`, is diagonal, with the gradient :math:`g` there, its component has the variances
    and the means

    .. math:: C = \frac{1}{\lambda + h^{-2}}, \quad
        m = x + \frac{C g}{1 + \sqrt{C} / h}
        = x + \bigl(1 - \sqrt{1 - \lambda C}\bigr) \frac{g}{\lambda} .

    The gradient of a normal distribution is :math:`-\lambda (x - \mu)`, and the means of draws
    have the variance :math:`1/\lambda - C`: the mixture is that distribution again, at any reach
    :math:`h`. For another one it bends as the draws do, and is as thin as the density is at each.

    Derivatives are those with respect to ``z``, where ``x = factor z`` and `factor` is a Cholesky
    factor of the covariance of all draws.
    """
    _, gradient, curvature = derivatives
    assert curvature is not None
    # A point where a derivative overflows has a component as wide as all draws.
    finite = np.isfinite(curvature).all(axis=(1, 2)) & np.isfinite(gradient).all(axis=1)
    curvature = np.where(finite[:, None, None], curvature, 0.0)
    gradient = np.where(finite[:, None], gradient, 0.0)
    eigenvalues, axes = np.linalg.eigh(curvature)
    variances = 1 / (eigenvalues.clip(0) + _REACH**-2)
    sds = np.sqrt(variances)
    steps = variances / (1 + sds / _REACH) * (axes.mT @ gradient[..., None])[..., 0]
    means = points + (axes @ steps[..., None])[..., 0] @ factor.T
    # The triangular factor of a QR decomposition: the product of the roots may be singular if it is
    # rounded.
    lower = np.linalg.qr((factor @ axes * sds[:, None]).mT, mode="r").mT
    lower = lower * np.sign(np.diagonal(lower, axis1=1, axis2=2))[:, None]
    return GaussianMixture(np.full(len(points), -np.log(len(points))), means, lower)


def _normal(points: Array, shrinkage: float) -> GaussianMixture:
    """One normal distribution, its correlations multiplied by ``1 − shrinkage``."""
    sd = points.std(axis=0)
    standard = (points - points.mean(axis=0)) / sd
    correlation = (1 - shrinkage) * standard.T @ standard / len(points)
    np.fill_diagonal(correlation, 1.0)
    factor = sd[:, None] * np.linalg.cholesky(correlation)
    return GaussianMixture(np.zeros(1), points.mean(axis=0)[None], factor[None])


def _best_shrinkage(early: Array, late: Array) -> float:
    """Return the shrinkage with which the early draws predict the late ones best."""
    mean, sd = early.mean(axis=0), early.std(axis=0)
    standard = (early - mean) / sd
    # All shrunk correlation matrices have the same eigenvectors.
    eigenvalues, vectors = np.linalg.eigh(standard.T @ standard / len(early))
    square = np.mean(((late - mean) / sd @ vectors) ** 2, axis=0)
    kept = 1 - _SHRINKAGES[:, None]
    variance = kept * eigenvalues.clip(VARIANCE_FLOOR) + 1 - kept
    return float(_SHRINKAGES[np.argmin((np.log(variance) + square / variance).sum(axis=1))])
