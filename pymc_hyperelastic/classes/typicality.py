"""Whether a specimen could be one of a class at all: how typical it is, and how well curves fit."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f

from pymc_hyperelastic.classes.specimens import fresh_specimens
from pymc_hyperelastic.models.class_distribution import ClassDistribution
from pymc_hyperelastic.models.population import Population
from pymc_hyperelastic.models.specimen_draws import SpecimenDraws

Array = NDArray[np.float64]

# Specimens by which it is known what the reference leaves open.
_REFERENCE = 4000
# A direction is told of by the curves if they leave less than this of the reference's variance.
_TOLD = 0.5
_SMALLEST = 1e-12


def typical_p_value(
    draws: SpecimenDraws,
    population: Population,
    reference: ClassDistribution,
    distributions: ClassDistribution,
    rng: np.random.Generator,
) -> float:
    r"""Share of the specimens of a class that are as far from its middle as this one, or further.

    Specimens are compared by the natural coordinates of their walls, in which half as stiff is as
    far as twice as stiff, and, where experiments differ, by how much theirs do. Under the reference
    `r`, of which the `draws` are, this specimen has the posterior mean ``μ`` and covariance ``S``;
    one of the class with the coordinates ``x`` would have had, from curves that tell as much,

    .. math:: μ' = m_r + A (x - m_r) + e, \qquad A = 1 - S Σ_r^{-1}, \quad e \sim N(0, S A^T)

    and the p-value is the share of Mahalanobis distances of such ``μ'`` that are not below that of
    ``μ``. Directions of which the curves tell next to nothing do not count; NaN if that is all of
    the wall's.
    """
    tests = max(draws.tests, 1)
    references = _fresh(population, reference, tests, rng)
    others = _fresh(population, distributions, tests, rng)
    wall = _share_as_far(draws.centre, references[0], others[0], rng)
    if draws.tests < 2 or np.isnan(wall):
        return wall
    scatters = draws.scatter, references[1], others[1]
    here, usual, apart = (np.log(scatter + _SMALLEST) for scatter in scatters)
    between = _share_as_far(here, usual, apart, rng)
    # What is not told of is no second question.
    return wall if np.isnan(between) else either(wall, between)


def _share_as_far(here: Array, reference: Array, others: Array, rng: np.random.Generator) -> float:
    """Share of others whose mean would be as far from theirs; NaN if draws tell next to nothing.

    All have the shape (coordinate, draw): draws of the specimen, of the reference, and others.
    """
    middle, whiten = _whitening(reference.T)
    here, others = (here.T - middle) @ whiten, (others.T - middle) @ whiten
    left, directions = np.linalg.eigh(np.atleast_2d(np.cov(here.T)))
    told = left < _TOLD
    if not told.any():
        return np.nan
    left, directions = left[told], directions[:, told]
    mean, others = here.mean(axis=0) @ directions, others @ directions * (1 - left)
    # Drawn in all coordinates: the sign of an eigenvector then does not change the p-value.
    noise = rng.standard_normal((len(others), len(directions))) @ directions
    others = others + np.sqrt(left * (1 - left)) * noise
    origin, whiten = _whitening(others)
    distance = np.sum(((mean - origin) @ whiten) ** 2)
    return _rank(np.sum(((others - origin) @ whiten) ** 2, axis=1), distance)


def noise_p_value(
    draws: SpecimenDraws,
    reference: ClassDistribution,
    distributions: ClassDistribution,
    rng: np.random.Generator,
) -> float:
    """Share of the specimens of a class whose curves are fitted as badly as this one's, or worse.

    That is, whose noise is as large: what no curve of the law follows is noise. Of several noises,
    each is held against its own.
    """
    count = len(distributions.location[0])
    p_values = []
    for i, (prior, spread) in enumerate(
        zip(reference.log_size, reference.noise_spread, strict=True)
    ):
        here = (draws.log_size[i] - prior) / spread
        left = min(float(here.var()), 1.0)
        members = distributions.log_size[i][:, 0]
        members = members + distributions.noise_spread[i][:, 0] * rng.standard_normal(count)
        members = (1 - left) * (members - prior) / spread
        members += np.sqrt(left * (1 - left)) * rng.standard_normal(count)
        p_values.append(_rank(members, float(here.mean())))
    return either(*p_values)


def misfit_p_value(draws: SpecimenDraws, misfit: Array, freedom: Array) -> float:
    r"""Chance that a specimen of a class is fitted as badly as this one, or worse.

    The squared misfits per degree of freedom of this specimen and of those of the class, `misfit`
    and `freedom`, have the ratio of a Fisher distribution. A misfit that is the law's, and no
    stranger to the class, says nothing against a specimen. NaN if the misfit is no number.
    """
    # Specimens that were measured better than the noise says do not make others strange.
    usual = max(misfit.sum() / freedom.sum(), 1.0)
    return float(f.sf(draws.misfit / draws.freedom / usual, draws.freedom, freedom.sum()))


def either(*p_values: float) -> float:
    """P-value of the smallest of independent ones."""
    return float(1 - (1 - np.min(p_values)) ** len(p_values))


def _fresh(
    population: Population, distributions: ClassDistribution, tests: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Mean of the tests' coordinates, and the sum of their squared deviations, of new specimens."""
    if np.ndim(distributions.location[0]) == 0:
        distributions = repeated(distributions, _REFERENCE)
    draws: Mapping[str, Array] = fresh_specimens(population, distributions, tests, rng)
    names = population.scale.names
    of_tests = np.stack([draws.get(f"{name}_of_test", draws[name]) for name in names])
    centre = of_tests.mean(axis=2)
    return centre, ((of_tests - centre[..., None]) ** 2).sum(axis=2)


def repeated(d: ClassDistribution, count: int) -> ClassDistribution:
    """The same distribution so many times, along the first of two axes."""

    def vector(values: Array | None) -> Array | None:
        return None if values is None else np.multiply.outer(values, np.ones((count, 1)))

    return ClassDistribution(
        vector(d.location),
        vector(d.spread),
        d.factor,
        vector(d.experiment_spread),
        d.effect_spread,
        d.log_size,
        d.noise_spread,
    )


def _whitening(points: Array) -> tuple[Array, Array]:
    """Mean of points, and the matrix that makes their covariance one."""
    covariance = np.atleast_2d(np.cov(points.T))
    return points.mean(axis=0), np.linalg.inv(np.linalg.cholesky(covariance)).T


def _rank(others: Array, value: float) -> float:
    """Share of the values that are as large, or larger, this one counted among them."""
    return float((1 + np.sum(others >= value)) / (1 + len(others)))
