"""The search for what a posterior is like, from the prior's side and from its modes."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import xarray as xr

from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.importance import LARGEST_PARETO_K, mean_weight, weighted_draws
from pymc_hyperelastic.evidence.mixture import Array, GaussianMixture, components_for
from pymc_hyperelastic.evidence.modes import modes_from
from pymc_hyperelastic.evidence.reference import Reference
from pymc_hyperelastic.evidence.target import Target
from pymc_hyperelastic.evidence.tempering import Tempering

# Particles of the search, and of the first look from the prior: so many for each unknown, and the
# least and the largest number.
_DRAWS, _FORWARD_DRAWS = (200, 1000, 4000), (20, 500, 2000)
# Climbs from draws of the prior, group by group, and from particles that were tempered.
SPREAD_CLIMBS, _TEMPERED_CLIMBS = (16, 16, 16, 16), 8
# Points whose density is computed twice, and the relative difference that rounding may make.
_SCORED_TWICE, _SCORES_DIFFER = 10, 1e-6
# So many times the draws are made, at most, until enough of them are possible.
_MOST_TRIED = 50
# Points drawn at each stage of the first look, for each pair of unknowns; at most, if there are few
# unknowns, since in many dimensions points meet nothing narrow; and at most for each that can be
# scored at once, and for each pair of unknowns, of which two to four count. Climbs from the most
# outstanding of them.
_PROBES, _MOST_PROBES, _COSTLY, _PAIRED, _PROBED = 5_000, 320_000, 1.25, (2, 4), 2
# Moves at a stage of the search, which need not be exact.
_FORWARD_MOVES, _MOVES = 10, 20
# Nats by which a reference's density is below that of the posterior where it has too few draws.
_LACKING = 5.0
# Shares of the prior: while little is known, and in the end.
_FIRST_SHARE, _LAST_SHARE = 0.2, 0.1
# Share of the modes in the end, where there are several.
_SHARE_OF_MODES = 0.2
# Places visited by a particle are like so many independent ones. More of them than this for each
# pair of unknowns, or in all, do not make a mixture better.
_VISITED, _PLACES, _MOST_PLACES = 1 / 3, 1_000, 20_000


@dataclass(frozen=True)
class Search:
    """What is known of a posterior before its evidence is taken."""

    reference: Reference
    forward: Estimate
    """Evidence by tempering from the prior alone; without an error if the particles moved too
    little."""
    at_modes: Estimate
    """Evidence by importance sampling from the modes; without an error if that is not enough."""
    at_modes_k: float
    """Pareto shape of its weights; infinite where nothing is known."""
    log_masses: Array
    """Of the modes, by Laplace's approximation."""
    at_bounds: float
    """Log evidence of what lies at bounds of the prior, where no particle arrives."""
    unmet: float
    """Share of other particles, tempered from the prior, where the reference has too few draws; NaN
    if it was not computed."""

    def as_dataset(self) -> xr.Dataset:
        """What is stored of it."""
        return xr.Dataset(
            {
                "forward": self.forward.value,
                "forward_se": self.forward.standard_error,
                "at_modes": self.at_modes.value,
                "at_modes_se": self.at_modes.standard_error,
                "at_modes_k": self.at_modes_k,
                "log_masses": ("mode", self.log_masses),
                "at_bounds": self.at_bounds,
                "unmet": self.unmet,
            }
        )


@np.errstate(all="ignore")  # a climb or a proposal may be so wild that it overflows
def find_reference(target: Target, rng: np.random.Generator, *, probed: bool = True) -> Search:
    """Find a reference from both ends: the prior, and the modes.

    Particles tempered from the prior find what has mass, but miss what is narrow; climbs find that,
    but not what is skewed or has no mode. A mixture of both, with a share of the prior, is where
    particles are then tempered from again, and those make the reference. If it is `probed`, it is
    compared with the places of other particles, and with draws of the prior at its bounds.
    """
    draws, few = (
        min(max(each * target.dimension, least), largest)
        for each, least, largest in (_DRAWS, _FORWARD_DRAWS)
    )
    prior, score, share = _possible_draws(target, draws, few, rng)
    # Where hardly any is possible, few have to do for many.
    particles = np.resize(prior, (few, target.dimension))
    forward = Tempering(target, particles, rng, max_moves=_FORWARD_MOVES).run()
    told = not forward.capped and len(prior) >= few
    forward_error = float(np.hypot(np.sqrt(forward.variance), share.standard_error))

    spread = [*places_to_climb_from(prior, score)]
    starts = [
        *spread[:2],
        forward.particles[rng.integers(few, size=_TEMPERED_CLIMBS)],
        *(_outstanding(target, mixture, rng) for mixture in forward.mixtures),
    ]
    modes = modes_from(target.ascent, starts, width_of(prior), spread[2:])

    mixture, at_modes, at_modes_k = _fitted(forward, rng), Estimate(-np.inf, np.inf), np.inf
    if modes is not None:
        mixture = mixture.joined(modes.mixture)
        _, log_weights = weighted_draws(target.score, modes.mixture.heavy_tailed(), draws, rng)
        at_modes, at_modes_k = mean_weight(log_weights)
        if at_modes_k >= LARGEST_PARETO_K:
            at_modes = Estimate(at_modes.value, np.inf)
    first = Reference(mixture.heavy_tailed(), _FIRST_SHARE)
    particles = first.draw(target.draw_prior, draws, rng)
    found = Tempering(target, particles, rng, reference=first, max_moves=_MOVES).run()
    mixture = _fitted(found, rng)
    if modes is not None and len(modes.log_masses) > 1:
        # There may be more modes than a mixture has components.
        mixture = mixture.joined(modes.mixture, _SHARE_OF_MODES)
    reference = Reference(mixture.heavy_tailed(), _LAST_SHARE)
    unmet, at_bounds = np.nan, -np.inf
    if probed:
        others = np.resize(prior[::-1], (few, target.dimension))
        unmet = _unmet(target, reference, found.log_evidence, others, rng)
        at_bounds = target.log_evidence_at_bounds(draws, rng)
    return Search(
        reference,
        Estimate(forward.log_evidence + share.value, forward_error if told else np.inf),
        at_modes,
        at_modes_k,
        modes.log_masses if modes is not None else np.array([]),
        at_bounds,
        unmet,
    )


def _unmet(
    target: Target,
    reference: Reference,
    log_evidence: float,
    particles: Array,
    rng: np.random.Generator,
) -> float:
    """Share of other particles, tempered from the prior, where the reference has too few draws.

    All chains start from one reference: if it lacks a mode, they agree with each other all the
    same. Other particles may find this mode.
    """
    places = Tempering(target, particles, rng, max_moves=_FORWARD_MOVES).run().particles
    prior, likelihood = target.score(places)
    lacking = prior + likelihood - log_evidence - reference.log_density(places, prior)
    return float(np.mean(lacking > _LACKING))


def _possible_draws(
    target: Target, draws: int, few: int, rng: np.random.Generator
) -> tuple[Array, Array, Estimate]:
    """Draws of the prior that are possible, their log density, and the logarithm of their share.

    Where few of so many draws are, because the model excludes what its prior does not, more are
    drawn.
    """
    points, scores, drawn = np.empty((0, target.dimension)), np.empty(0), 0
    target.nan_scores = 0
    while len(points) < few and drawn < _MOST_TRIED * draws:
        prior = target.draw_prior(draws, rng)
        score = np.add(*target.score(prior))
        possible = np.isfinite(score)
        points, scores = np.append(points, prior[possible], 0), np.append(scores, score[possible])
        drawn += draws
    target.check_possible(np.isfinite(scores), f"{drawn} draws of the prior")
    again = np.add(*target.score(points[:_SCORED_TWICE]))
    if not np.allclose(again, scores[:_SCORED_TWICE], rtol=_SCORES_DIFFER):
        raise ValueError(
            "the density of the model is random: the same point had another one when it was "
            "computed again. Such a model has no evidence"
        )
    share = len(points) / drawn
    return points, scores, Estimate(float(np.log(share)), np.sqrt((1 - share) / len(points)))


def _fitted(tempering: Tempering, rng: np.random.Generator) -> GaussianMixture:
    visited = tempering.visited
    components = components_for(len(visited) * _VISITED, tempering.dimension)
    enough = min(_PLACES * tempering.dimension**2, _MOST_PLACES)
    visited = visited[:: -(-len(visited) // enough)]
    return GaussianMixture.fit(visited, components, rng)


def _outstanding(target: Target, mixture: GaussianMixture, rng: np.random.Generator) -> Array:
    """Points of a tempered population where the posterior is far larger than by their density.

    A narrow mode is met by one point in many thousands, and given away by its weight.
    """
    size = target.dimension
    affordable = int(_COSTLY * np.clip(size, *_PAIRED) ** 2 * target.at_once)
    probes = min(_PROBES * size**2, _MOST_PROBES // size, affordable)
    points, log_weights = weighted_draws(target.score, mixture, probes, rng)
    return points[np.argpartition(-log_weights, _PROBED - 1)[:_PROBED]]


def places_to_climb_from(points: Array, score: Array) -> Iterator[Array]:
    """Groups of points: in turn of the better half and of all, each as far as can be from others.

    The first is the best. What is best is mostly alike, and leads to one mode: one of more mass may
    lie beyond the tail of the prior, where only what starts in that tail arrives, or in a part of
    the prior where every draw is worse than all others, because its likelihood is narrow.
    """
    places = points / width_of(points)
    better = score >= np.median(score)
    chosen, distance = [int(np.argmax(score))], np.full(len(points), np.inf)
    start = 0
    for of_better, size in zip(itertools.cycle([True, False]), SPREAD_CLIMBS, strict=False):
        pool = better if of_better else np.ones(len(points), bool)
        while len(chosen) < min(start + size, pool.sum()):
            distance = np.minimum(distance, np.sum((places - places[chosen[-1]]) ** 2, axis=1))
            chosen.append(int(np.where(pool, distance, -1.0).argmax()))
        if chosen[start:]:
            yield points[chosen[start:]]
        start = len(chosen)


def width_of(points: Array) -> Array:
    """Sd of each variable as if it were normal, from its quartiles: a few may be far away."""
    lower, upper = np.quantile(points, [0.25, 0.75], axis=0)
    return np.maximum((upper - lower) / 1.349, np.finfo(float).tiny)
