"""P-values of the hypothesis that a specimen belongs to a class.

One compares the wall of the specimen with those of the class; the others compare how well its
curves are fitted. Predictions of classes with variability use them.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f

from pymc_hyperelastic.classes.interface import DRAWS
from pymc_hyperelastic.classes.reference import fresh_specimens, one_draw
from pymc_hyperelastic.models.class_distribution import ClassDistribution
from pymc_hyperelastic.models.population import Population
from pymc_hyperelastic.models.specimen_draws import SpecimenDraws

Array = NDArray[np.float64]


def typical_p_value(
    draws: SpecimenDraws,
    population: Population,
    reference: ClassDistribution,
    distributions: ClassDistribution,
    rng: np.random.Generator,
) -> float:
    r"""P-value of the specimen's distance from the centre of a class.

    It is the fraction of new specimens of the class whose distance is at least as large. Walls are
    compared by their natural coordinates, which are logarithms: half and twice the stiffness are
    equally far away. If experiments differ, the scatter of the specimen's tests is compared too,
    and the two p-values are combined by :func:`either`.

    The `draws` have the mean ``μ`` and the covariance ``S``, and their prior is the reference
    distribution with the mean ``m_r`` and the covariance ``Σ_r``. If a specimen of the class with
    the coordinates ``x`` had curves as informative as these, its posterior mean would be

    .. math:: μ' = m_r + A (x - m_r) + e, \qquad A = 1 - S Σ_r^{-1}, \quad e \sim N(0, S A^T)

    The p-value is the fraction of draws of ``μ'`` with a Mahalanobis distance, from their mean, not
    below that of ``μ``. Directions that the curves hardly determine are omitted. The p-value is NaN
    if the curves determine no direction of the wall.
    """
    tests = max(draws.tests, 1)
    references = _new_specimens(population, reference, tests, rng)
    others = _new_specimens(population, distributions, tests, rng)
    wall = _share_as_far(draws.centre, references[0], others[0], rng)
    if draws.tests < 2 or np.isnan(wall):
        return wall
    scatters = draws.scatter, references[1], others[1]
    own, of_reference, of_class = (np.log(scatter + np.finfo(float).eps) for scatter in scatters)
    between = _share_as_far(own, of_reference, of_class, rng)
    # If the curves do not determine the scatter, there is only one p-value to combine.
    return wall if np.isnan(between) else either(wall, between)


def _share_as_far(own: Array, reference: Array, others: Array, rng: np.random.Generator) -> float:
    """Return the fraction of other specimens that are as far from their mean as this one.

    All arrays have the shape (coordinate, draw): draws of the specimen, of the reference, and of
    other specimens of the class. See :func:`typical_p_value`; NaN if no direction is determined.
    """
    middle, whiten = _whitening(reference.T)
    own, others = (own.T - middle) @ whiten, (others.T - middle) @ whiten
    variance, directions = np.linalg.eigh(np.atleast_2d(np.cov(own.T)))
    # The curves determine a direction if they reduce the variance of the reference by half.
    determined = variance < 0.5
    if not determined.any():
        return np.nan
    variance, directions = variance[determined], directions[:, determined]
    mean, others = own.mean(axis=0) @ directions, others @ directions * (1 - variance)
    # The noise is drawn in all coordinates, so that the p-value does not depend on the sign of an
    # eigenvector.
    noise = rng.standard_normal((len(others), len(directions))) @ directions
    others = others + np.sqrt(variance * (1 - variance)) * noise
    origin, whiten = _whitening(others)
    distance = np.sum(((mean - origin) @ whiten) ** 2)
    return _rank(np.sum(((others - origin) @ whiten) ** 2, axis=1), distance)


def noise_p_value(
    draws: SpecimenDraws,
    reference: ClassDistribution,
    distributions: ClassDistribution,
    rng: np.random.Generator,
) -> float:
    """P-value of the specimen's inferred noise: fraction of the class with noise at least as large.

    Deviations from the law increase the inferred noise, so this p-value measures how well the
    curves are fitted. If several sizes of errors are inferred, their p-values are combined by
    :func:`either`.
    """
    count = len(distributions.location[0])
    p_values = []
    for i, (prior, spread) in enumerate(
        zip(reference.log_size, reference.noise_spread, strict=True)
    ):
        # The posterior means of the class's specimens, as in typical_p_value.
        own = (draws.log_size[i] - prior) / spread
        variance = min(float(own.var()), 1.0)
        others = distributions.log_size[i][:, 0]
        others = others + distributions.noise_spread[i][:, 0] * rng.standard_normal(count)
        others = (1 - variance) * (others - prior) / spread
        others += np.sqrt(variance * (1 - variance)) * rng.standard_normal(count)
        p_values.append(_rank(others, float(own.mean())))
    return either(*p_values)


def misfit_p_value(draws: SpecimenDraws, misfit: Array, freedom: Array) -> float:
    r"""P-value of the specimen's misfit if the size of the noise is known.

    The misfit per degree of freedom of this specimen is divided by that of the specimens of the
    class, given by `misfit` and `freedom`; the ratio has an F distribution. A deviation from the
    law that all specimens of the class have is therefore no evidence against a specimen. The
    p-value is NaN if the misfit is NaN.
    """
    # The class may have smaller residuals than the known noise: new specimens need not.
    of_class = max(misfit.sum() / freedom.sum(), 1.0)
    return float(f.sf(draws.misfit / draws.freedom / of_class, draws.freedom, freedom.sum()))


def either(*p_values: float) -> float:
    """Combine independent p-values: the p-value of their minimum (Šidák)."""
    return float(1 - (1 - np.min(p_values)) ** len(p_values))


def _new_specimens(
    population: Population, distributions: ClassDistribution, tests: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Draw new specimens; return mean and scatter of the coordinates of each one's tests."""
    if np.ndim(distributions.location[0]) == 0:
        distributions = one_draw(distributions).at(np.zeros(DRAWS, int))
    draws: Mapping[str, Array] = fresh_specimens(population, distributions, tests, rng)
    names = population.scale.names
    of_tests = np.stack([draws.get(f"{name}_of_test", draws[name]) for name in names])
    centre = of_tests.mean(axis=2)
    return centre, ((of_tests - centre[..., None]) ** 2).sum(axis=2)


def _whitening(points: Array) -> tuple[Array, Array]:
    """Return the mean of points, and the matrix that transforms their covariance to unity."""
    covariance = np.atleast_2d(np.cov(points.T))
    return points.mean(axis=0), np.linalg.inv(np.linalg.cholesky(covariance)).T


def _rank(others: Array, value: float) -> float:
    """Return the fraction of values that are at least `value`, which is counted as one of them."""
    return float((1 + np.sum(others >= value)) / (1 + len(others)))
