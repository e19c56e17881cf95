"""An integral: by importance sampling where that can be trusted, else by tempering."""

import numpy as np

from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.importance import (
    DRAWS,
    FIRST_DRAWS,
    MOST_UNKNOWNS,
    PRIOR_SHARE,
    Integral,
    at_modes,
    by_importance,
    weighted_draws,
)
from pymc_hyperelastic.evidence.laplace import by_curvature
from pymc_hyperelastic.evidence.mixture import GaussianMixture
from pymc_hyperelastic.evidence.modes import modes_from
from pymc_hyperelastic.evidence.reference import Reference
from pymc_hyperelastic.evidence.ridges import along_ridges
from pymc_hyperelastic.evidence.search import find_reference, places_to_climb_from, width_of
from pymc_hyperelastic.evidence.target import Target
from pymc_hyperelastic.evidence.tempering import Tempering
from pymc_hyperelastic.evidence.weights import effective_sample_size

# Tempering scores so many times as many points as fit into cache at most: about a minute, and with
# many unknowns more, in proportion to their square.
_MOST_EFFORT, _FEW = 20_000, 8
# Share of the modes in the mixture from which importance sampling starts; draws by which it is seen
# whether they are like the posterior, and the effective share of these at which they are.
_SHARE_OF_MODES, _SEEN_BY, _ALIKE = 0.8, 400, 0.4
# Draws of modes that are alike, for each particle.
_FOR_EACH = 2
# Draws of the prior, some of which are climbed from.
_PRIOR_DRAWS = 2000


def _alike(target: Target, mixture: GaussianMixture, rng: np.random.Generator) -> bool:
    """Whether a mixture is so much like the posterior that nothing has to be learned of it."""
    proposal = mixture.heavy_tailed()
    _, log_weights = weighted_draws(target.score, proposal, _SEEN_BY, rng)
    return effective_sample_size(log_weights) > _ALIKE * _SEEN_BY


def _draws_of(modes: GaussianMixture, size: int) -> list[tuple[Reference, int]]:
    """Draws of modes and the prior, so many that hardly one is among the particles twice."""
    draws = max(FIRST_DRAWS, _FOR_EACH * size)
    return [(Reference(at_modes(modes), PRIOR_SHARE), draws)] if draws <= DRAWS else []


@np.errstate(all="ignore")  # a climb may be so wild that it overflows
def integrate(target: Target, size: int, rng: np.random.Generator) -> Integral:
    """Evidence of a model, with so many particles of its posterior.

    Posteriors here have few variables and mostly one mode: importance sampling from a mixture that
    starts at the modes and the prior gives them in a tenth of the time of tempering, which is left
    the others. Where that takes too long, or its particles are stuck, the error is infinite.
    """
    prior = target.draw_prior(_PRIOR_DRAWS, rng)
    # A posterior that is hardly narrower than the prior is not like its mode.
    like, first = GaussianMixture.fit(prior, 1, rng), []
    few = target.dimension <= MOST_UNKNOWNS
    by_curvatures = few and target.knows_curvature
    if few:
        width = width_of(prior)
        places = places_to_climb_from(prior, np.add(*target.score(prior)))
        modes = modes_from(target.ascent, [next(places)], width, places)
        if modes is not None:
            joined = like.joined(modes.mixture, _SHARE_OF_MODES)
            if _alike(target, joined, rng):
                first = _draws_of(modes.mixture, size)
            elif not by_curvatures:
                ridges = along_ridges(target.ascent, modes, width)
                joined = like.joined(ridges, _SHARE_OF_MODES)
            like = joined
    if by_curvatures:
        quick = by_curvature(target, like, size, rng, first)
    else:
        quick = by_importance(target.score, like, size, rng, target.draw_prior, alike=first)
    if quick.known:
        return quick
    allowed = _MOST_EFFORT * max(1.0, target.dimension / _FEW) ** 2
    target.most_effort = target.effort + allowed
    reference = find_reference(target, rng, probed=False).reference
    particles = reference.draw(target.draw_prior, size, rng)
    sampled = Tempering(target, particles, rng, reference=reference).run()
    # Particles that do not move lack what they have not met, and know nothing of it.
    unknown = target.exhausted or sampled.stuck
    error = np.inf if unknown else float(np.sqrt(sampled.variance))
    if np.isfinite(quick.log_value.standard_error):
        # Two estimates that share nothing: what lies between them is not known.
        error = float(np.hypot(error, sampled.log_evidence - quick.log_value.value))
    return Integral(
        Estimate(sampled.log_evidence, error),
        np.nan,
        "tempering",
        rng.permutation(sampled.particles),
    )
