"""Compute the evidence of a specimen under classes with variability, from its weighted draws.

Predictions of new specimens use it, and fits of classes use the variance that the draws cause.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, softmax

from pymc_hyperelastic.classes.interface import Prediction
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.importance import ENOUGH, LARGEST_PARETO_K
from pymc_hyperelastic.evidence.weights import effective_sample_size, pareto_shape
from pymc_hyperelastic.mechanics.interpolation import evenly
from pymc_hyperelastic.models.class_distribution import ClassDistribution
from pymc_hyperelastic.models.population import Population
from pymc_hyperelastic.models.specimen_draws import (
    SpecimenDraws,
    log_densities,
    log_density_of_noise,
)

Array = NDArray[np.float64]

PARTS: dict[str, tuple[str, ...]] = {
    "material": ("location", "spread", "factor"),
    "experiments": ("experiment_spread", "effect_spread"),
    "noise": ("log_size", "noise_spread"),
}
"""Parts of a class distribution, with the attributes of ``ClassDistribution`` in each."""

# Largest number of draws of a class distribution for hybrids of classes, for estimates of an error,
# and for a prior of specimens: their densities under more draws take too long.
DISTRIBUTIONS = 250


class Unit(NamedTuple):
    """Weighted draws of one specimen, or of the mean and the change of a pair of specimens."""

    parts: tuple[SpecimenDraws, ...]
    """Draws of the specimen, or of the mean and of the change of a pair."""
    log_weight: Array
    """Logarithms of the importance weights, shape (draw)."""
    standard_error: float
    """Standard error of the logarithm of the sum of the weights."""

    def first(self, count: int) -> "Unit":
        """Return the first `count` draws, with weights scaled to represent all draws."""
        correction = np.log(len(self.log_weight) / count)
        parts = tuple(part.first(count) for part in self.parts)
        return Unit(parts, self.log_weight[:count] + correction, self.standard_error)

    def log_terms(self, distributions: Sequence[ClassDistribution]) -> Array:
        """Return log weights plus log densities under the distributions, (distribution, draw)."""
        parts = zip(self.parts, distributions, strict=True)
        return self.log_weight + sum(log_densities(part, of_part) for part, of_part in parts)


def unit_of_specimen(draws: SpecimenDraws, covariates: Array | None = None) -> Unit:
    """Return the draws of a specimen, with its covariates, as a unit."""
    part = draws if covariates is None else replace(draws, covariates=covariates)
    return Unit((part,), draws.log_weight, draws.standard_error)


def parts_of(population: Population) -> tuple[str, ...]:
    """Return the parts that the distribution of these specimens has, see ``PARTS``."""
    has = {"experiments": population.variability.experiment_effect, "noise": population.noises}
    return tuple(part for part in PARTS if has.get(part, True))


def variance_of_shares(log_shares: Array, standard_error: float, count: NDArray[np.intp]) -> Array:
    r"""Variance of a class's log evidence, for numbers of draws that represent one specimen.

    There is one variance for each number in `count`. `log_shares` are log weights plus log
    densities of all draws, shape (distribution, draw), and `standard_error` is that of the weights.

    The evidence is a mean over class distributions ``φ`` of products of sums over draws. To first
    order, a draw changes the log evidence by its share of the sum, averaged over ``φ``: the changes
    under different distributions may cancel.

    The variance is estimated from all draws. An estimate from fewer draws would be too small if the
    most important draws were missing.
    """
    if np.isinf(standard_error):
        return np.full(count.shape, np.inf)
    shares = softmax(log_shares, axis=1).mean(axis=0)
    total, common = len(shares), standard_error**2
    # The draws were resampled from weighted draws, whose variance enters both terms.
    return common + (total * np.sum(shares**2) - 1) * (1 / count + common)


def specimen_evidence(draws: SpecimenDraws, distributions: ClassDistribution) -> Prediction:
    """Return the evidence of a new specimen of a class, averaged over the class distribution.

    The Pareto shape is the larger one of two sets of weights: those of the specimen's draws under
    the class, and those of the integral from which these draws were resampled.
    """
    density = log_densities(draws, distributions)
    # Keep the maximum finite if the density underflows to zero under all distributions.
    largest = np.maximum(density.max(axis=0), -np.finfo(float).max)
    # The exponentials take most of the time, so they are computed once and in place.
    density -= largest
    np.exp(density, out=density)
    with np.errstate(divide="ignore"):
        log_weights = draws.log_weight + largest + np.log(density.mean(axis=0))
    value = float(logsumexp(log_weights))
    effective, pareto_k = _reliability(log_weights, draws)
    relative = density @ np.exp(draws.log_weight + largest - value)
    variance_of_draws = max(1 / effective - 1 / len(log_weights), 0.0)
    own_error = float(np.sqrt(variance_of_draws + np.var(relative) / len(relative)))
    estimate = Estimate(value, float(np.hypot(own_error, draws.standard_error)))
    method = "specimen draws by tempering" if draws.method == "tempering" else "specimen draws"
    return Prediction(estimate, own_error, method, pareto_k)


def _reliability(log_weights: Array, draws: SpecimenDraws) -> tuple[float, float]:
    """Return the effective sample size of the weights, and the larger Pareto shape."""
    effective = effective_sample_size(log_weights)
    pareto_k = np.inf if effective < ENOUGH else pareto_shape(log_weights)
    # The Pareto shape of draws from tempering is NaN, which fmax ignores.
    return effective, float(np.fmax(pareto_k, draws.pareto_k))


def hybrid_evidences(
    samples: Sequence[SpecimenDraws],
    own: ClassDistribution,
    other: ClassDistribution,
    parts: Sequence[str],
    ends: tuple[float, float],
) -> Array:
    """Log evidences of a specimen under hybrids of two class distributions.

    A hybrid has each of its `parts` either from the distribution `own` or from the `other`. The
    result has one axis for each part, with the entries 0 (own) and 1 (other). A limited number of
    draws of the two distributions is combined in pairs. The evidences under the two classes
    themselves are known from more draws: they are the `ends`. The difference at each end is added
    to all entries, weighted by the fraction of parts that an entry shares with this end.

    Each entry comes from the sample in `samples` whose weights have the smallest Pareto shape; it
    is NaN if this shape is too large. Later samples are used only if an earlier one leaves such an
    entry.
    """
    shape = (2,) * len(parts)
    if len(parts) == 1:
        return np.array(ends)
    count = min(len(own.location[0]), len(other.location[0]), DISTRIBUTIONS)
    pair = tuple(d.at(evenly(len(d.location[0]), count)) for d in (own, other))
    values, shapes = np.full(shape, np.nan), np.full(shape, np.inf)
    for draws in samples:
        densities = _densities_of_parts(draws, pair, parts)
        for place in np.ndindex(shape):
            density = densities(dict(zip(parts, place, strict=True)))
            largest = density.max(axis=0)
            log_weights = draws.log_weight + largest
            log_weights += np.log(np.exp(density - largest).mean(axis=0))
            pareto_k = _reliability(log_weights, draws)[1]
            if pareto_k < shapes[place]:
                values[place], shapes[place] = logsumexp(log_weights), pareto_k
        if shapes.max() < LARGEST_PARETO_K:
            break
    values[shapes >= LARGEST_PARETO_K] = np.nan
    fraction = np.indices(shape).mean(axis=0)  # of the parts that come from the other class
    first, last = np.array(ends) - values.flat[[0, -1]]
    return values + (1 - fraction) * first + fraction * last


def _densities_of_parts(
    draws: SpecimenDraws, pair: Sequence[ClassDistribution], parts: Sequence[str]
) -> Callable[[Mapping[str, int]], Array]:
    """Return a function that computes the log densities of draws under a hybrid.

    Its argument gives the number in `pair` of the distribution that each part comes from. The
    densities of the wall are cached, as noise is independent of the wall.
    """
    cached: dict[tuple[int, int], Array] = {}

    def densities(source: Mapping[str, int]) -> Array:
        wall = source["material"], source.get("experiments", 0)
        if wall not in cached:
            changes: dict[str, Any] = dict.fromkeys(PARTS["noise"])
            changes |= {name: getattr(pair[wall[1]], name) for name in PARTS["experiments"]}
            cached[wall] = log_densities(draws, replace(pair[wall[0]], **changes))
        if "noise" not in parts:
            return cached[wall]
        return cached[wall] + log_density_of_noise(np, draws.log_size, pair[source["noise"]])

    return densities
