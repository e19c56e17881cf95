"""Find a reference for tempering: a distribution like the posterior."""

from dataclasses import dataclass

import numpy as np
import xarray as xr

from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.importance import LARGEST_PARETO_K, mean_weight, weighted_draws
from pymc_hyperelastic.evidence.mixture import Array, GaussianMixture, components_for
from pymc_hyperelastic.evidence.modes import Modes, find_modes, starting_points
from pymc_hyperelastic.evidence.path import GeometricPath
from pymc_hyperelastic.evidence.reference import Reference
from pymc_hyperelastic.evidence.target import Target, check_possible, width_of
from pymc_hyperelastic.evidence.tempering import TemperedSMC

# Particles of the search for each unknown.
_DRAWS_PER_UNKNOWN = 200
# Particles of the search, at least.
_FEWEST_DRAWS = 1000
# Particles of the search, at most.
_MOST_DRAWS = 4000
# Particles of tempering from the prior for each unknown.
_FORWARD_PER_UNKNOWN = 20
# Particles of tempering from the prior, at least: fewer do not find modes of small mass.
_FEWEST_FORWARD = 500
# Particles of tempering from the prior, at most.
_MOST_FORWARD = 2000
# Starting points of optimisation among tempered particles.
_TEMPERED_STARTS = 8
# Points whose density is computed twice.
_SCORED_TWICE = 10
# Relative difference of two computations of a density that rounding may make.
_SCORES_DIFFER = 1e-6
# Draws of the prior, in numbers of particles, of which enough must be possible.
_MOST_TRIED = 50
# Probes at each stage of tempering from the prior for each pair of unknowns: a narrow mode is met
# by one point in many thousands, and given away by its weight.
_PROBES = 5_000
# Probes times unknowns, at most: in many dimensions points meet nothing narrow.
_MOST_PROBES = 320_000
# Numbers that are computed for the probes of a stage, for each pair of unknowns, at most: some
# seconds for all stages of one search.
_PROBED_NUMBERS = 800_000
# Unknowns of which these pairs are counted, at most.
_PAIRED = 4
# Starting points among the probes of a stage.
_PROBED_STARTS = 2
# Moves of a stage of tempering from the prior, which need not be exact, at most.
_FORWARD_MOVES = 10
# Moves of a stage of the search, at most.
_MOVES = 20
# Unknowns up to which probes and starting points of optimisation meet every mode, so that other
# particles are not needed to check that: chosen by experiment, tests/evidence has 27 such models.
_FEW_UNKNOWNS = 2
# Nats by which a reference's density is below that of the posterior where it has too few draws.
_LACKING = 5.0
# Share of the prior in the first reference, while little is known.
_FIRST_SHARE = 0.2
# Share of the prior in the final reference.
_LAST_SHARE = 0.1
# Share of the modes in the final reference, if there are several.
_SHARE_OF_MODES = 0.2
# Independent points to which one place visited by a particle is equivalent: chosen by experiment.
_WORTH_OF_PLACE = 1 / 3
# Places to which a mixture is fitted, for each pair of unknowns, at most.
_PLACES = 1_000
# Places to which a mixture is fitted, at most.
_MOST_PLACES = 20_000


@dataclass(frozen=True)
class Search:
    """A reference, and estimates of the evidence that are compared with the final one."""

    reference: Reference
    forward: Estimate
    """Evidence by tempering from the prior alone; without an error if the particles moved too
    little."""
    at_modes: Estimate
    """Evidence by importance sampling from the modes; without an error if that is not enough."""
    at_modes_k: float
    """Pareto shape of its weights; infinite if there are too few effective weights."""
    log_masses: Array
    """Log integrals of the modes, by Laplace's approximation."""
    at_bounds: float
    """Log evidence of what lies at bounds of the prior, where no particle arrives."""
    unmet: float
    """Share of other particles, tempered from the prior, where the reference has too few draws; NaN
    where that was not checked."""

    def as_dataset(self) -> xr.Dataset:
        """Return the variables that are stored with the evidence."""
        stored = xr.Dataset(
            {
                "forward": self.forward.value,
                "forward_se": self.forward.standard_error,
                "at_modes": self.at_modes.value,
                "at_modes_se": self.at_modes.standard_error,
                "at_modes_k": self.at_modes_k,
                "log_masses": ("mode", self.log_masses),
                "at_bounds": self.at_bounds,
            }
        )
        return stored if np.isnan(self.unmet) else stored.assign(unmet=self.unmet)


@np.errstate(all="ignore")  # an optimisation or a proposal may be so wild that it overflows
def find_reference(target: Target, rng: np.random.Generator, *, checked: bool = True) -> Search:
    """Find a reference from both ends: the prior, and the modes.

    Particles that are tempered from the prior find mass, but miss narrow modes. Optimisation finds
    those, but neither skewed densities nor those without a mode. From a mixture of both and of the
    prior particles are tempered once more; the reference is fitted to these. If it is to be
    `checked`, it is compared with the places of other particles, and with draws of the prior at its
    bounds.
    """
    draws = int(np.clip(_DRAWS_PER_UNKNOWN * target.dimension, _FEWEST_DRAWS, _MOST_DRAWS))
    few = int(np.clip(_FORWARD_PER_UNKNOWN * target.dimension, _FEWEST_FORWARD, _MOST_FORWARD))
    prior, score, share = _possible_draws(target, draws, few, rng)
    # If hardly any draw is possible, each stands for several particles.
    particles = np.resize(prior, (few, target.dimension))
    forward = TemperedSMC(GeometricPath(target), particles, rng, max_moves=_FORWARD_MOVES).run()
    trusted = not forward.capped and len(prior) >= few
    forward_error = float(np.hypot(np.sqrt(forward.variance), share.standard_error))
    modes = _modes(target, prior, score, forward, rng)

    mixture, at_modes, at_modes_k = _fitted(forward, rng), Estimate(-np.inf, np.inf), np.inf
    if modes is not None:
        mixture = mixture.joined(modes.mixture)
        _, log_weights = weighted_draws(target.score, modes.mixture.heavy_tailed(), draws, rng)
        at_modes, at_modes_k = mean_weight(log_weights)
        if not at_modes_k < LARGEST_PARETO_K:
            at_modes = Estimate(at_modes.value, np.inf)
    first = Reference(mixture.heavy_tailed(), _FIRST_SHARE)
    particles = first.draw(target.draw_prior, draws, rng)
    found = TemperedSMC(GeometricPath(target, first), particles, rng, max_moves=_MOVES).run()
    mixture = _fitted(found, rng)
    if modes is not None and len(modes.log_masses) > 1:
        # There may be more modes than a mixture has components.
        mixture = mixture.joined(modes.mixture, _SHARE_OF_MODES)
    reference = Reference(mixture.heavy_tailed(), _LAST_SHARE)
    unmet, at_bounds = np.nan, -np.inf
    if checked and target.dimension > _FEW_UNKNOWNS:
        others = np.resize(prior[::-1], (few, target.dimension))
        unmet = _unmet(target, reference, found.log_evidence, others, rng)
    if checked:
        at_bounds = target.log_evidence_at_bounds(draws, rng)
    return Search(
        reference,
        Estimate(forward.log_evidence + share.value, forward_error if trusted else np.inf),
        at_modes,
        at_modes_k,
        modes.log_masses if modes is not None else np.array([]),
        at_bounds,
        unmet,
    )


def _modes(
    target: Target, prior: Array, score: Array, forward: TemperedSMC, rng: np.random.Generator
) -> Modes | None:
    """Find modes from draws of the prior, from tempered particles and from probes."""
    spread = [*starting_points(prior, score)]
    starts = [
        *spread[:2],
        forward.particles[rng.integers(len(forward.particles), size=_TEMPERED_STARTS)],
        *(_best_probes(target, mixture, rng) for mixture in forward.mixtures),
    ]
    return find_modes(target.derivatives, starts, width_of(prior), spread[2:])


def _unmet(
    target: Target,
    reference: Reference,
    log_evidence: float,
    particles: Array,
    rng: np.random.Generator,
) -> float:
    """Return the share of other particles, tempered from the prior, that the reference lacks.

    All chains start from one reference: if it lacks a mode, they agree with each other all the
    same. Other particles may find this mode.
    """
    other = TemperedSMC(GeometricPath(target), particles, rng, max_moves=_FORWARD_MOVES).run()
    prior, likelihood = target.score(other.particles)
    lacking = prior + likelihood - log_evidence - reference.log_density(other.particles, prior)
    return float(np.mean(lacking > _LACKING))


def _possible_draws(
    target: Target, draws: int, few: int, rng: np.random.Generator
) -> tuple[Array, Array, Estimate]:
    """Return possible draws of the prior, their log density, and the log of their share.

    If few are possible, because the model excludes what its prior does not, more are drawn.
    """
    points, scores, drawn = np.empty((0, target.dimension)), np.empty(0), 0
    nan_count = 0
    while len(points) < few and drawn < _MOST_TRIED * draws:
        prior = target.draw_prior(draws, rng)
        log_prior, log_likelihood, bad = target.evaluate(prior)
        score = log_prior + log_likelihood
        possible = np.isfinite(score)
        points, scores = np.append(points, prior[possible], 0), np.append(scores, score[possible])
        drawn += draws
        nan_count += bad
    check_possible(np.isfinite(scores), nan_count, f"{drawn} draws of the prior")
    again = np.add(*target.score(points[:_SCORED_TWICE]))
    if not np.allclose(again, scores[:_SCORED_TWICE], rtol=_SCORES_DIFFER):
        raise ValueError(
            "the density of the model is random: the same point had another one when it was "
            "computed again. Such a model has no evidence"
        )
    share = len(points) / drawn
    return points, scores, Estimate(float(np.log(share)), np.sqrt((1 - share) / len(points)))


def _fitted(smc: TemperedSMC, rng: np.random.Generator) -> GaussianMixture:
    """Fit a mixture to all places that particles visited at their last stage."""
    visited = smc.visited
    components = components_for(len(visited) * _WORTH_OF_PLACE, smc.dimension)
    enough = min(_PLACES * smc.dimension**2, _MOST_PLACES)
    visited = visited[:: -(-len(visited) // enough)]
    return GaussianMixture.fit(visited, components, rng)


def _best_probes(target: Target, mixture: GaussianMixture, rng: np.random.Generator) -> Array:
    """Return draws of a mixture with the largest weights: they may lie in a narrow mode."""
    size = target.dimension
    affordable = _PROBED_NUMBERS * min(size, _PAIRED) ** 2 // target.cost()
    probes = min(_PROBES * size**2, _MOST_PROBES // size, affordable)
    points, log_weights = weighted_draws(target.score, mixture, max(probes, _PROBED_STARTS), rng)
    return points[np.argpartition(-log_weights, _PROBED_STARTS - 1)[:_PROBED_STARTS]]
