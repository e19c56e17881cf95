"""What classes whose specimens differ say of a specimen: its evidence, and how typical it is."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.importance import ENOUGH
from pymc_hyperelastic.evidence.weights import effective_sample_size, pareto_shape
from pymc_hyperelastic.models.class_distribution import ClassDistribution
from pymc_hyperelastic.models.specimen_draws import SpecimenDraws, independent, log_densities

Array = NDArray[np.float64]

# kPa: curves beyond these are not of tubes. With fewer than so many of them at the radii of a
# specimen there is no telling how unlikely it is.
_SMALLEST_PRESSURE, _LARGEST_PRESSURE, _FEWEST_CURVES = 1e-6, 1e6, 100
# Curves of a class differ along directions in which they differ by this fraction, or more, of how
# they do along the first.
_LEAST_SHARE = 0.003


def variance_of_specimen(draws: SpecimenDraws, distributions: ClassDistribution) -> float:
    r"""Variance of a class's log evidence that comes from the draws of one of its specimens.

    The evidence is a mean over the class's distributions ``φ`` of products of sums over draws. To
    first order each draw changes its logarithm by what it has of its sum, averaged over ``φ``:
    what one distribution makes of it another may undo.
    """
    log_shares = draws.log_weight + log_densities(draws, distributions)
    log_shares -= logsumexp(log_shares, axis=1, keepdims=True)
    shares = np.exp(log_shares).mean(axis=0)
    count, common = len(shares), draws.standard_error**2
    # Draws were themselves chosen among weighted ones: what these do not know adds to both terms.
    return float(common + (np.sum(shares**2) - 1 / count) * (1 + count * common))


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
    """Evidence of a specimen that is a fresh draw from a class, its distribution averaged over."""
    density = log_densities(draws, distributions)
    count = len(density)
    log_weights = draws.log_weight + logsumexp(density, axis=0) - np.log(count)
    value = float(logsumexp(log_weights))
    effective = effective_sample_size(log_weights)
    of_draws = max(1 / effective - 1 / log_weights.size, 0.0)
    each = np.exp(logsumexp(density + draws.log_weight, axis=1) - value)
    own = float(np.sqrt(of_draws + np.var(each) / count))
    estimate = Estimate(value, float(np.hypot(own, draws.standard_error)))
    method = "specimen draws by tempering" if draws.method == "tempering" else "specimen draws"
    pareto_k = np.inf if effective < ENOUGH else pareto_shape(log_weights)
    # Tempering has no weights, and no shape.
    return SpecimenEvidence(estimate, own, method, float(np.fmax(pareto_k, draws.pareto_k)))


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
    if d.log_sigma is not None:
        spread_of = np.var(d.log_sigma) + np.mean(np.square(d.noise_spread))
        optional |= {"log_sigma": np.mean(d.log_sigma), "noise_spread": 1.5 * np.sqrt(spread_of)}
    return ClassDistribution(mean, wide, independent(len(mean)), **optional)


def predictive_p_value(
    measured: Array, curves: Array, sd: Array, rng: np.random.Generator
) -> float:
    """Share of the specimens of a class that are as unlikely as this one, or more.

    The class brings forth specimens, measured as this one was. Each, and the new one, is held
    against all the others: how likely it is depends on how far it is from its neighbours. What no
    combination of the class's curves could follow is noise, and says nothing here: else specimens
    measured better than usual would be of every class, and others of none.

    With its pressures `measured` (obs), `curves` (draw, obs) of specimens of the class at the same
    radii, kPa, and the standard deviations `sd` (draw, 1) of their noise. NaN if the class brings
    forth too few tubes that could be inflated to these radii.
    """
    sizes = np.abs(curves).max(axis=1)
    # No comparison with NaN is true.
    possible = (sizes < _LARGEST_PRESSURE) & (sizes > _SMALLEST_PRESSURE)
    if possible.sum() < _FEWEST_CURVES:
        return np.nan
    curves, sd = curves[possible], sd[possible]
    alike = curves / np.linalg.norm(curves, axis=1, keepdims=True)
    _, shares, directions = np.linalg.svd(alike, full_matrices=False)
    directions = directions[shares > _LEAST_SHARE * shares[0]].T
    curves = curves @ directions
    projected = np.concatenate(
        [measured[None] @ directions, curves + sd * rng.standard_normal(curves.shape)]
    )
    scaled = curves / sd**2
    squares = (projected**2).sum(axis=1, keepdims=True)
    misfit = squares / (sd**2).T - 2 * projected @ scaled.T + (scaled * curves).sum(axis=1)
    log_likelihood = -misfit / 2 - curves.shape[1] * np.log(sd).T
    # Not against itself.
    np.fill_diagonal(log_likelihood[1:], -np.inf)
    likely = logsumexp(log_likelihood, axis=1)
    likely[0] += np.log((len(curves) - 1) / len(curves))
    return float((1 + np.sum(likely[1:] <= likely[0])) / len(likely))
