"""The evidence of a specimen under classes whose specimens differ."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.importance import ENOUGH, LARGEST_PARETO_K
from pymc_hyperelastic.evidence.weights import effective_sample_size, pareto_shape
from pymc_hyperelastic.mechanics.interpolation import evenly
from pymc_hyperelastic.models.class_distribution import ClassDistribution
from pymc_hyperelastic.models.specimen_draws import (
    SpecimenDraws,
    log_densities,
    log_density_of_noise,
    mean_density,
)

Array = NDArray[np.float64]

PARTS: dict[str, tuple[str, ...]] = {
    "material": ("location", "spread", "factor"),
    "experiments": ("experiment_spread", "effect_spread"),
    "noise": ("log_size", "noise_spread"),
}
"""Parts of a class's distribution, and of what each consists."""

# Distributions of a class for which all draws of a specimen are weighted.
_DISTRIBUTIONS = 100
# Error of a log evidence, in nats, that a smaller number of draws may add.
_ERROR_OF_DRAWS = 0.01
# Draws of a specimen, at least.
_FEWEST_DRAWS = 200
# Draws of two distributions whose parts are exchanged.
_EXCHANGED = 250


def variance_of_specimen(
    draws: SpecimenDraws, distributions: ClassDistribution, count: int
) -> float:
    r"""Variance of a class's log evidence if `count` of the draws stand for one of its specimens.

    The evidence is a mean over the class's distributions ``φ`` of products of sums over draws. To
    first order each draw changes its logarithm by its share of the sum, averaged over ``φ``:
    effects under different distributions may cancel.

    The variance is estimated from all draws. An estimate from `count` of them would be too small
    if the most important draws are missing.
    """
    log_shares = draws.log_weight + log_densities(draws, distributions)
    return variance_of_shares(log_shares, draws.standard_error, count)


def variance_of_shares(log_shares: Array, standard_error: float, count: int) -> float:
    """The same by the logarithms of the terms of the sum, (distribution, draw)."""
    if np.isinf(standard_error):
        return np.inf
    log_shares = log_shares - logsumexp(log_shares, axis=1, keepdims=True)
    shares = np.exp(log_shares).mean(axis=0)
    known, common = len(shares), standard_error**2
    # Draws were themselves chosen among weighted ones: what these do not know adds to both terms.
    return float(common + (known * np.sum(shares**2) - 1) * (1 / count + common))


class SpecimenEvidence(NamedTuple):
    """Log evidence of a specimen under a class, and how far it can be trusted.

    The second standard error leaves out what the evidences of all classes have in common, the
    draws of the specimen. The Pareto shape is the larger of two: of the weights of these draws
    under the class, and of those from which the draws were chosen.
    """

    log_evidence: Estimate
    own_error: float
    method: str
    pareto_k: float


def specimen_evidence(draws: SpecimenDraws, distributions: ClassDistribution) -> SpecimenEvidence:
    """Evidence of a specimen that is a fresh draw from a class, its distribution averaged over.

    The evidence mostly varies with the distribution of the class, and hardly with the draws of a
    specimen, which its curves determine. From all draws under a few distributions the number of
    draws that are needed is computed, and their Pareto shape; the evidence is the mean over this
    number of draws under all distributions.
    """
    size = known = len(draws.log_weight)
    count = len(distributions.location[0])
    if count > _DISTRIBUTIONS:
        few = distributions.at(evenly(count, _DISTRIBUTIONS))
        effective, pareto_k = _trust(draws.log_weight + mean_density(draws, few), draws)
        needed = max(known / max(effective, 1.0) - 1, 0.0) / _ERROR_OF_DRAWS**2
        size = int(np.clip(needed, min(_FEWEST_DRAWS, known), known))

    some = draws.first(size)
    density = log_densities(some, distributions)
    # A draw so far away that a class knows nothing of it has no density at all.
    largest = np.maximum(density.max(axis=0), -np.finfo(float).max)
    # Exponentials are most of the work: they are taken once.
    density -= largest
    np.exp(density, out=density)
    with np.errstate(divide="ignore"):
        log_weights = some.log_weight + largest + np.log(density.mean(axis=0))
    value = float(logsumexp(log_weights))
    if size == known:
        effective, pareto_k = _trust(log_weights, draws)
    of_draws = max(known / effective - 1, 0.0) / size
    each = density @ np.exp(some.log_weight + largest - value)
    own = float(np.sqrt(of_draws + np.var(each) / count))
    estimate = Estimate(value, float(np.hypot(own, draws.standard_error)))
    method = "specimen draws by tempering" if draws.method == "tempering" else "specimen draws"
    return SpecimenEvidence(estimate, own, method, pareto_k)


def _trust(log_weights: Array, draws: SpecimenDraws) -> tuple[float, float]:
    """Effective number of weighted draws, and the larger Pareto shape of these and of the draws."""
    effective = effective_sample_size(log_weights)
    pareto_k = np.inf if effective < ENOUGH else pareto_shape(log_weights)
    # Tempering has no weights, and no shape.
    return effective, float(np.fmax(pareto_k, draws.pareto_k))


def hybrid_evidences(
    samples: Sequence[SpecimenDraws],
    own: ClassDistribution,
    other: ClassDistribution,
    parts: Sequence[str],
    ends: tuple[float, float],
) -> Array:
    """Log evidences of a specimen under a class of which some `parts` are those of another one.

    One axis a part, two entries long: `own` part, and the `other`'s. Parts are exchanged draw by
    draw of the two distributions, of which some are enough: what these few make the evidences under
    the classes themselves differ from the `ends`, which are known from more, is divided evenly. The
    result is that of the sample in `samples` whose weights have the smallest Pareto shape, and NaN
    if no shape is small enough; the first sample is tried first.
    """
    shape = (2,) * len(parts)
    if len(parts) == 1:
        return np.array(ends)
    count = min(len(own.location[0]), len(other.location[0]), _EXCHANGED)
    pair = tuple(d.at(evenly(len(d.location[0]), count)) for d in (own, other))
    values, shapes = np.full(shape, np.nan), np.full(shape, np.inf)
    for draws in samples:
        densities = _densities_of_parts(draws, pair, parts)
        for place in np.ndindex(shape):
            density = densities(dict(zip(parts, place, strict=True)))
            largest = density.max(axis=0)
            log_weights = draws.log_weight + largest
            log_weights += np.log(np.exp(density - largest).mean(axis=0))
            pareto_k = _trust(log_weights, draws)[1]
            if pareto_k < shapes[place]:
                values[place], shapes[place] = logsumexp(log_weights), pareto_k
        if shapes.max() < LARGEST_PARETO_K:
            break
    values[shapes >= LARGEST_PARETO_K] = np.nan
    exchanged = np.indices(shape).mean(axis=0)
    first, last = np.array(ends) - values.flat[[0, -1]]
    return values + (1 - exchanged) * first + exchanged * last


def _densities_of_parts(
    draws: SpecimenDraws, pair: Sequence[ClassDistribution], parts: Sequence[str]
) -> Callable[[Mapping[str, int]], Array]:
    """Log densities of draws by whose part is taken; noise is independent of all else."""
    known: dict[tuple[int, int], Array] = {}

    def densities(whose: Mapping[str, int]) -> Array:
        wall = whose["material"], whose.get("experiments", 0)
        if wall not in known:
            changes: dict[str, Any] = dict.fromkeys(PARTS["noise"])
            changes |= {name: getattr(pair[wall[1]], name) for name in PARTS["experiments"]}
            known[wall] = log_densities(draws, replace(pair[wall[0]], **changes))
        if "noise" not in parts:
            return known[wall]
        return known[wall] + log_density_of_noise(np, draws.log_size, pair[whose["noise"]])

    return densities


def near_class(distributions: ClassDistribution) -> ClassDistribution:
    """One distribution like those of a class, and wider: a reference for a specimen of it."""
    d = distributions
    location, spread = np.asarray(d.location)[..., 0], np.asarray(d.spread)[..., 0]
    mean = location.mean(axis=1)
    wide = 1.5 * np.sqrt(location.var(axis=1) + (spread**2).mean(axis=1))
    optional: dict[str, Any] = {}
    if d.experiment_spread is not None:
        within = np.asarray(d.experiment_spread)[..., 0]
        optional |= {
            "experiment_spread": 1.5 * np.sqrt((within**2).mean(axis=1)),
            "effect_spread": np.sqrt(np.mean(np.square(d.effect_spread))),
        }
    if d.log_size is not None:
        logs, spreads = (np.asarray(v)[..., 0] for v in (d.log_size, d.noise_spread))
        spread_of = logs.var(axis=1) + (spreads**2).mean(axis=1)
        optional |= {"log_size": logs.mean(axis=1), "noise_spread": 1.5 * np.sqrt(spread_of)}
    return ClassDistribution(mean, wide, np.eye(len(mean)), **optional)
