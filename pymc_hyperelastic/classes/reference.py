"""Distributions from which single specimens are drawn: the wide reference, and fitted classes.

Specimens are sampled under them, and predictions compare specimens with new ones of a class.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from pymc_hyperelastic.models.class_distribution import SPREADS, ClassDistribution
from pymc_hyperelastic.models.geometry import deviation_name
from pymc_hyperelastic.models.population import Population, log_noise_name
from pymc_hyperelastic.models.priors import RANGE_DRAWS, draws_of
from pymc_hyperelastic.models.specimen_draws import SpecimenDraws, mean_density

Array = NDArray[np.float64]

# Spreads of a reference distribution, in those of a class: its draws also cover specimens that are
# rare in the class.
_WIDER = 2.0


def reference_of(population: Population) -> ClassDistribution:
    """Return the reference: the prior of a specimen of an unknown class, made wider."""
    mean, sd = population.scale.location_prior
    spread = _WIDER * np.exp(population.scale.spread_prior[0])
    wide = {name: _WIDER * median for name, (median, _) in SPREADS.items()}
    optional: dict[str, Any] = {}
    if population.variability.experiment_effect:
        optional |= {"experiment_spread": spread / 2, "effect_spread": wide["effect_spread"]}
    inferred = [population.likelihood.sizes[name] for name in population.noises]
    if inferred:
        logs = np.log(draws_of(inferred, RANGE_DRAWS))
        spreads = np.hypot(logs.std(axis=1), wide["noise_spread"])
        optional |= {"log_size": logs.mean(axis=1), "noise_spread": spreads}
    return ClassDistribution(mean, np.hypot(sd, spread), np.eye(len(mean)), **optional)


def near_class(distributions: ClassDistribution) -> ClassDistribution:
    """Return a reference distribution for specimens of a class, which is twice as wide."""
    d = distributions

    def moments(means: Array, spreads: Array) -> tuple[Array, Array]:
        """Return the mean and the wider spread of new specimens, for each coordinate or noise."""
        means, spreads = np.asarray(means)[..., 0], np.asarray(spreads)[..., 0]
        variance = means.var(axis=1) + np.square(spreads).mean(axis=1)
        return means.mean(axis=1), _WIDER * np.sqrt(variance)

    location, spread = moments(d.location, d.spread)
    optional: dict[str, Any] = {}
    if d.experiment_spread is not None:
        _, within = moments(np.zeros_like(d.experiment_spread), d.experiment_spread)
        effect_spread = np.sqrt(np.mean(np.square(d.effect_spread)))
        optional |= {"experiment_spread": within, "effect_spread": effect_spread}
    if d.log_size is not None:
        optional["log_size"], optional["noise_spread"] = moments(d.log_size, d.noise_spread)
    return ClassDistribution(location, spread, np.eye(len(location)), **optional)


def fresh_specimens(
    population: Population,
    distributions: ClassDistribution,
    tests: int,
    rng: np.random.Generator,
) -> dict[str, Array]:
    """Draw one new specimen of each distribution; return (draw, entry) by variable name."""
    count, names = len(distributions.location[0]), population.scale.names

    def noise(entries: int = 1) -> Array:
        return rng.standard_normal((count, entries))

    standard = np.stack([noise() for _ in names], axis=1)
    draws = dict(zip(names, distributions.coordinates(standard), strict=True))
    if distributions.experiment_spread is not None:
        draws["log_effect"] = distributions.effect_spread * noise()
        for i, name in enumerate(names):
            within = distributions.experiment_spread[i] * np.exp(draws["log_effect"])
            draws[f"{name}_of_test"] = draws[name] + within * noise(tests)
    for i, name in enumerate(population.noises):
        logs = distributions.log_size[i] + distributions.noise_spread[i] * noise()
        draws[log_noise_name(name)] = logs
    return draws | {deviation_name(name): noise() for name in population.geometry}


def one_draw(distribution: ClassDistribution) -> ClassDistribution:
    """Add an axis of length one for draws to the values of a class distribution."""
    d = distribution
    vectors = "location", "spread", "experiment_spread", "log_size", "noise_spread"
    changes: dict[str, Any] = {
        name: np.asarray(getattr(d, name), float)[:, None, None]
        for name in vectors
        if getattr(d, name) is not None
    }
    if d.effect_spread is not None:
        changes["effect_spread"] = np.full((1, 1), float(np.squeeze(d.effect_spread)))
    return replace(d, factor=np.asarray(d.factor)[None], **changes)


class ClassPrior:
    """Prior of a specimen and its tube: the mean density over draws of a class distribution.

    Parameters
    ----------
    population : Population
        Settings of the class.
    distributions : ClassDistribution
        Posterior draws of the class distribution.
    tests : int
        Number of tests of the specimen.
    points_of : callable
        Function that converts specimens, values (draw, entry) by variable name, to points.
    draws_at : callable
        Function that converts points to draws of a specimen.
    """

    def __init__(
        self,
        population: Population,
        distributions: ClassDistribution,
        tests: int,
        points_of: Callable[[Mapping[str, Array]], Array],
        draws_at: Callable[[Array], SpecimenDraws],
    ) -> None:
        self._population, self._distributions, self._tests = population, distributions, tests
        self._points_of, self._draws_at = points_of, draws_at

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """Draw points, shape (count, d)."""
        distributions = self._distributions
        chosen = distributions.at(rng.integers(len(distributions.location[0]), size=count))
        return self._points_of(fresh_specimens(self._population, chosen, self._tests, rng))

    def log_density(self, points: Array) -> Array:
        """Return the log density of points."""
        deviations = points[:, points.shape[1] - len(self._population.geometry) :]
        return self.of_class(points) + stats.norm.logpdf(deviations).sum(axis=1)

    def of_class(self, points: Array) -> Array:
        """Return the log density without the prior of the tube, which all classes share."""
        return mean_density(self._draws_at(points), self._distributions)
