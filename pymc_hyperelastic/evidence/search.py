"""Find a reference for tempering: a distribution like the posterior."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import xarray as xr

from pymc_hyperelastic.evidence.checks import check_repeatable
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.importance import LARGEST_PARETO_K, mean_weight, weighted_draws
from pymc_hyperelastic.evidence.mixture import Array, GaussianMixture, components_for
from pymc_hyperelastic.evidence.modes import Modes, find_modes, starting_points
from pymc_hyperelastic.evidence.path import GeometricPath, Reference
from pymc_hyperelastic.evidence.target import Target, check_possible, width_of
from pymc_hyperelastic.evidence.tempering import HASTY, TemperedSMC

# Particles of the search for each unknown: tempered from the first reference, and drawn from the
# prior and the modes. Half as many are tempered from the prior.
_PARTICLES_PER_UNKNOWN = 200
# Particles of the search, at least: fewer do not find modes of small mass.
_FEWEST_PARTICLES = 1000
# Particles of the search, at most: their evaluation takes as long as all chains.
_MOST_PARTICLES = 4000
# Draws of the prior, in multiples of the particles, of which enough must be possible.
_MOST_TRIED = 50
# Probes of one stage for each unknown: a narrow mode is met by one point in many thousands, and
# given away by its weight.
_PROBES = 20_000
# Stages of tempering from the prior, at most: 50 unknowns, each known to 0.001 of its prior's
# width, need 90, and 300 unknowns about 250. A posterior that is thousands of prior standard
# deviations away would need thousands, and is found from its modes.
_MOST_STAGES = 500
# Numbers that are computed for the probes of a stage, at most: they take about a second.
_PROBED_NUMBERS = 8_000_000
# Share of the modes in the final reference, if there are several.
_SHARE_OF_MODES = 0.2
# Unknowns up to which optimisation and probes met every mode of the models in tests/evidence, so
# that no other particles are needed to check that.
_FEW_UNKNOWNS = 2
# Nats by which a reference's density is below that of the posterior where it has too few draws.
_LACKING = 5.0


class Search(NamedTuple):
    """A reference, and variables to compare with the evidence of particles that start from it."""

    reference: Reference
    evidence: xr.Dataset
    """Variables of the group ``evidence``, see ``results.py``: standard errors are infinite where
    particles moved too little, or where too few weights are effective."""


@np.errstate(all="ignore")  # an optimisation or a proposal may be so wild that it overflows
def find_reference(target: Target, rng: np.random.Generator, *, checked: bool = True) -> Search:
    """Find a reference from both ends: the prior, and the modes.

    Particles that are tempered from the prior find mass, but miss narrow modes. Optimisation finds
    those, but neither skewed densities nor those without a mode. From a mixture of both and of the
    prior particles are tempered once more; the reference is fitted to these. If `checked`, it is
    compared with draws of the prior at its bounds and, with more than two unknowns, with other
    particles.
    """
    size = _PARTICLES_PER_UNKNOWN * target.dimension
    size = int(np.clip(size, _FEWEST_PARTICLES, _MOST_PARTICLES))
    prior, score, share = _possible_draws(target, size, rng)
    forward = _tempered(prior, size // 2, target, rng)
    far = forward.beta < 1
    trusted = not (forward.capped or far) and len(prior) >= size // 2
    forward_error = float(np.hypot(np.sqrt(forward.variance), share.standard_error))
    modes = _modes(target, prior, score, forward, rng)

    mixture, at_modes, at_modes_k = _fitted(forward, rng), Estimate(-np.inf, np.inf), np.inf
    if modes is not None:
        mixture = mixture.joined(modes.mixture)
        _, log_weights = weighted_draws(target.score, modes.mixture.heavy_tailed(), size, rng)
        at_modes, at_modes_k = mean_weight(log_weights)
    first = Reference(mixture.heavy_tailed())
    particles = first.draw(target.draw_prior, size, rng)
    found = TemperedSMC(GeometricPath(target, first), particles, rng, HASTY).run()
    mixture = _fitted(found, rng)
    if modes is not None and len(modes.log_masses) > 1:
        # There may be more modes than a mixture has components.
        mixture = mixture.joined(modes.mixture, _SHARE_OF_MODES)
    reference = Reference(mixture.heavy_tailed())
    evidence = xr.Dataset(
        {
            "forward": forward.log_evidence + share.value,
            "forward_se": forward_error if trusted else np.inf,
            "forward_beta": forward.beta,
            "at_modes": at_modes.value,
            "at_modes_se": at_modes.standard_error if at_modes_k < LARGEST_PARETO_K else np.inf,
            "at_modes_k": at_modes_k,
            "log_masses": ("mode", modes.log_masses if modes is not None else np.array([])),
        }
    )
    if checked and target.dimension > _FEW_UNKNOWNS and not far:
        # Chains that all start from a reference without some mode agree with each other too.
        others = _tempered(prior[::-1], size // 2, target, rng).particles
        log_prior, log_likelihood = target.score(others)
        log_posterior = log_prior + log_likelihood - found.log_evidence
        lacking = log_posterior - reference.log_density(others, log_prior)
        evidence["unmet"] = float(np.mean(lacking > _LACKING))
    if checked:
        evidence["at_bounds"] = target.log_evidence_at_bounds(size, rng)
    return Search(reference, evidence)


def _possible_draws(
    target: Target, size: int, rng: np.random.Generator
) -> tuple[Array, Array, Estimate]:
    """Return possible draws of the prior, their log density, and the log of their share.

    If few are possible, because the model excludes what its prior does not, more are drawn.
    """
    points, scores = np.empty((0, target.dimension)), np.empty(0)
    drawn = nan_count = 0
    while len(points) < size // 2 and drawn < _MOST_TRIED * size:
        prior = target.draw_prior(size, rng)
        log_prior, log_likelihood, bad = target.evaluate(prior)
        score = log_prior + log_likelihood
        possible = np.isfinite(score)
        points, scores = np.append(points, prior[possible], 0), np.append(scores, score[possible])
        drawn += size
        nan_count += bad
    check_possible(np.isfinite(scores), nan_count, f"{drawn} draws of the prior")
    check_repeatable(scores[: size // 2], np.add(*target.score(points[: size // 2])))
    share = len(points) / drawn
    return points, scores, Estimate(float(np.log(share)), np.sqrt((1 - share) / len(points)))


def _tempered(prior: Array, count: int, target: Target, rng: np.random.Generator) -> TemperedSMC:
    """Temper draws of the prior; if few are possible, each stands for several particles."""
    particles = np.resize(prior, (count, target.dimension))
    # Fitted to few places, mixtures have few components and are wide: their draws are the probes.
    settings = replace(HASTY, most_stages=_MOST_STAGES, fitted_places=count)
    return TemperedSMC(GeometricPath(target), particles, rng, settings).run()


def _modes(
    target: Target, prior: Array, score: Array, forward: TemperedSMC, rng: np.random.Generator
) -> Modes | None:
    """Find modes from draws of the prior, and from probes at each stage of tempering."""
    groups, best = [*starting_points(prior, score)], []
    probes = min(_PROBES * target.dimension, max(_PROBED_NUMBERS // target.cost(), 1))
    for mixture in forward.mixtures:
        points, log_weights = weighted_draws(target.score, mixture, probes, rng)
        best.append(points[np.argmax(log_weights)])
    starts = [np.concatenate(groups[:2]), np.array(best)]
    return find_modes(target.derivatives, starts, width_of(prior), groups[2:])


def _fitted(smc: TemperedSMC, rng: np.random.Generator) -> GaussianMixture:
    """Fit a mixture to all places that particles visited at their last stage."""
    return GaussianMixture.fit(smc.visited, components_for(smc.draws, smc.dimension), rng)
