"""Build proposals: normalised densities like a posterior, fitted to weighted or equal draws."""

from collections.abc import Callable
from functools import partial
from typing import Literal, Protocol

import numpy as np

from pymc_hyperelastic.evidence.mixture import Array, GaussianMixture, components_for
from pymc_hyperelastic.evidence.modes import second_differences
from pymc_hyperelastic.evidence.target import Derivatives, Target
from pymc_hyperelastic.evidence.weights import effective_sample_size, systematic

# Fractions by which correlations may be shrunk.
_SHRINKAGES = np.append(0.0, np.geomspace(1e-3, 1.0, 13))
# Least eigenvalue of a correlation matrix: fewer draws than unknowns leave 0, up to rounding.
_ROUNDING = 1e-12
# Steps of expectation maximisation for one set of draws: more hardly pay.
_ITERATIONS = 30
# The same in each step of adaptation, from the mixture of the step before.
_STEP_ITERATIONS = 6
# Draws of a step of adaptation, for each number that a component has.
_DRAWS_PER_NUMBER = 80
# Draws of a step, at least.
_FEWEST_DRAWS = 1000
# Draws of a step, at most.
_MOST_DRAWS = 12_000
# Fraction of the draws of a step that is to be effective.
_EFFECTIVE = 0.13
# Draws of a step where Laplace approximations are made.
_LAPLACE_DRAWS = 4000
# Laplace approximations on the way to the density.
_ON_THE_WAY = 100
# Laplace approximations at the density.
_AT_DENSITY = 200
# Distance that a Laplace approximation reaches, in sds of all draws.
_REACH = 2.0
# Largest distance of the mean of a Laplace approximation from its draw, in its own sds.
_FARTHEST = 3.0
# Step of differences of a Gauss-Newton curvature, in sds of the draws.
_STEP = 0.1
# Curvature in a direction that the density leaves open, in sds of the draws.
_FLAT = 1e-3
# Largest curvature, in sds of the draws: a covariance with a larger condition number has no
# Cholesky factor when it is rounded.
_SHARP = 1e10
# Variance that is added to that of a few draws, as a fraction, so that it has a Cholesky factor.
_FLOOR = 1e-13

Fit = Callable[[Array], GaussianMixture]


def fitted_proposal(
    draws: Array,
    effective: float,
    kind: Literal["auto", "normal", "mixture"],
    rng: np.random.Generator,
) -> GaussianMixture:
    """Fit a distribution to draws, (chain, draw, unknown), of which some number are effective.

    Candidates are fitted to the first halves of the chains; the one with the largest mean log
    density at the second halves is chosen, and fitted to all draws.
    """
    dimension = draws.shape[2]
    middle = draws.shape[1] // 2
    early, late = (part.reshape(-1, dimension) for part in (draws[:, :middle], draws[:, middle:]))
    normal = partial(_normal, shrinkage=_best_shrinkage(early, late))
    components = components_for(effective, dimension)
    fits: list[Fit] = [normal]
    if kind != "normal" and components > 1:
        several = partial(
            GaussianMixture.fit, components=components, rng=rng, iterations=_ITERATIONS
        )
        fits = [several] if kind == "mixture" else [normal, several]

    candidates = []
    for fit in fits:
        mixture = fit(early)
        candidates.append((mixture.log_density(late).mean(), fit, False))
        if kind != "normal":
            candidates.append((mixture.heavy_tailed().log_density(late).mean(), fit, True))
    _, fit, heavy_tailed = max(candidates, key=lambda candidate: candidate[0])
    mixture = fit(draws.reshape(-1, dimension))
    return mixture.heavy_tailed() if heavy_tailed else mixture


class ProposalBuilder(Protocol):
    """A method that fits a proposal to weighted draws."""

    def step_size(self, dimension: int) -> tuple[int, int]:
        """Return the draws of a step of adaptation, and how many of all draws are effective."""

    def fitted(
        self,
        points: Array,
        log_weights: Array,
        rng: np.random.Generator,
        current: GaussianMixture,
        *,
        final: bool,
    ) -> GaussianMixture:
        """Fit a proposal; `final` is True at the density itself, False on the way."""


class ExpectationMaximisation:
    """Gaussian mixtures, fitted to draws by expectation maximisation from the current mixture.

    References
    ----------
    O. Cappé, R. Douc, A. Guillin, J.-M. Marin and C. P. Robert, Adaptive importance sampling in
    general mixture classes, Statistics and Computing 18 (2008) 447.
    """

    def step_size(self, dimension: int) -> tuple[int, int]:
        """Return the draws of a step of adaptation, and how many of all draws are effective."""
        numbers = (dimension + 1) * (dimension + 2) // 2
        draws = int(np.clip(_DRAWS_PER_NUMBER * numbers, _FEWEST_DRAWS, _MOST_DRAWS))
        return draws, round(_EFFECTIVE * draws)

    def fitted(
        self,
        points: Array,
        log_weights: Array,
        rng: np.random.Generator,
        current: GaussianMixture,
        *,
        final: bool,
    ) -> GaussianMixture:
        """Fit a mixture with as many components as the effective draws determine.

        A single component of few draws may have correlations by chance: they are shrunk.
        """
        weights = np.exp(log_weights - log_weights.max())
        effective, size = effective_sample_size(log_weights), min(len(points), _MOST_DRAWS)
        components = components_for(effective, points.shape[1])
        if components == 1 and len(current.means) == 1:
            parts = [slice(half, None, 2) for half in range(2)]
            # A half in which one draw has all the weight has no spread.
            if all(np.ptp(weights[part]) < weights[part].sum() for part in parts):
                early, late = (points[p][systematic(weights[p], size // 2, rng)] for p in parts)
                return normal_of_halves(early, late)
        start = current if len(current.means) >= components else None
        return GaussianMixture.fit(
            points[systematic(weights, size, rng)],
            components,
            rng,
            start=start,
            iterations=_STEP_ITERATIONS,
            worth=effective / size,
        )


class LaplaceMixture:
    """Mixtures of Laplace approximations about draws.

    If data do not determine a parameter, a posterior has arms, along which its other unknowns
    bend. A mixture that is fitted to draws follows an arm only where there are many draws; the
    curvature shows how the density falls off around each draw.

    Parameters
    ----------
    target : Target
        The density. Its curvatures are taken if it has any, else second differences.
    """

    def __init__(self, target: Target) -> None:
        self._target = target

    def step_size(self, dimension: int) -> tuple[int, int]:
        """Return the draws of a step of adaptation, and how many of all draws are effective."""
        return _LAPLACE_DRAWS, round(_EFFECTIVE * _LAPLACE_DRAWS)

    def fitted(
        self,
        points: Array,
        log_weights: Array,
        rng: np.random.Generator,
        current: GaussianMixture,
        *,
        final: bool,
    ) -> GaussianMixture:
        """Return a mixture with a component for each of some draws, chosen by their weights."""
        weights = np.exp(log_weights - log_weights.max())
        weights /= weights.sum()
        centred = points - weights @ points
        covariance = (weights * centred.T) @ centred
        covariance += np.diag(_FLOOR * np.diagonal(covariance) + np.finfo(float).tiny)
        factor = np.linalg.cholesky(covariance)
        chosen = points[systematic(weights, _AT_DENSITY if final else _ON_THE_WAY, rng)]
        with np.errstate(all="ignore"):
            return laplace_about(self._derivatives(chosen, factor), chosen, factor)

    def _derivatives(self, points: Array, factor: Array) -> Derivatives:
        """Derivatives with respect to ``z``, where ``x = factor z``."""
        target = self._target
        if target.knows_curvature:
            width = _STEP * np.sqrt(np.square(factor).sum(axis=1))
            log_density, gradient, curvature = target.derivatives(points, width)
            assert curvature is not None
            return Derivatives(log_density, gradient @ factor, factor.T @ curvature @ factor)
        z = np.linalg.solve(factor, points.T).T
        unit = np.ones(points.shape[1])
        return second_differences(lambda z: np.add(*target.score(z @ factor.T)), z, unit)


def laplace_about(derivatives: Derivatives, points: Array, factor: Array) -> GaussianMixture:
    r"""Return a mixture of Laplace approximations about points that are draws of a density.

    On axes where the covariance of all draws is 1 and the curvature :math:`\lambda` at one of
    them, :math:`x`, is diagonal, with the gradient :math:`g` there, its component has the variances
    and the means

    .. math:: C = \frac{1}{\lambda + h^{-2}}, \quad
        m = x + \bigl(1 - \sqrt{1 - \lambda C}\bigr) \frac{g}{\lambda} .

    The gradient of a normal distribution is :math:`-\lambda (x - \mu)`, and the means of draws
    have the variance :math:`1/\lambda - C`: the mixture is that distribution again, at any reach
    :math:`h`. For another one it bends as the draws do, and is as thin as the density is at each.

    Parameters
    ----------
    derivatives : Derivatives
        With respect to coordinates ``z``, where ``x = factor z``.
    points : array, shape (n, d)
    factor : array, shape (d, d)
        Cholesky factor of the covariance of all draws.
    """
    _, gradient, curvature = derivatives
    assert curvature is not None
    # A point where a derivative overflows has a component as wide as all draws.
    finite = np.isfinite(curvature).all(axis=(1, 2)) & np.isfinite(gradient).all(axis=1)
    curvature = np.where(finite[:, None, None], curvature, 0.0)
    gradient = np.where(finite[:, None], gradient, 0.0)
    eigenvalues, axes = np.linalg.eigh(curvature)
    eigenvalues = eigenvalues.clip(_FLAT, _SHARP)
    variances = 1 / (eigenvalues + _REACH**-2)
    along = (axes.mT @ gradient[..., None])[..., 0] / eigenvalues
    farthest = _FARTHEST * np.sqrt(variances)
    steps = ((1 - np.sqrt(1 - eigenvalues * variances)) * along).clip(-farthest, farthest)
    means = points + (axes @ steps[..., None])[..., 0] @ factor.T
    roots = factor @ axes * np.sqrt(variances)[:, None]
    weights = np.full(len(points), -np.log(len(points)))
    return GaussianMixture(weights, means, np.linalg.cholesky(roots @ roots.mT))


def normal_of_halves(early: Array, late: Array) -> GaussianMixture:
    """Fit a normal distribution, its correlations shrunk as one half predicts the other best."""
    return _normal(np.concatenate([early, late]), _best_shrinkage(early, late))


def _normal(points: Array, shrinkage: float) -> GaussianMixture:
    """One normal distribution, its correlations multiplied by ``1 − shrinkage``."""
    sd = points.std(axis=0)
    standard = (points - points.mean(axis=0)) / sd
    correlation = (1 - shrinkage) * standard.T @ standard / len(points)
    np.fill_diagonal(correlation, 1.0)
    factor = sd[:, None] * np.linalg.cholesky(correlation)
    return GaussianMixture(np.zeros(1), points.mean(axis=0)[None], factor[None])


def _best_shrinkage(early: Array, late: Array) -> float:
    """Return the shrinkage with which the early draws predict the late ones best.

    All shrunk correlation matrices have the same eigenvectors.
    """
    mean, sd = early.mean(axis=0), early.std(axis=0)
    standard = (early - mean) / sd
    eigenvalues, vectors = np.linalg.eigh(standard.T @ standard / len(early))
    square = np.mean(((late - mean) / sd @ vectors) ** 2, axis=0)
    kept = 1 - _SHRINKAGES[:, None]
    variance = kept * eigenvalues.clip(_ROUNDING) + 1 - kept
    return float(_SHRINKAGES[np.argmin((np.log(variance) + square / variance).sum(axis=1))])
