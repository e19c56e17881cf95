"""Compute one integral: by importance sampling if that is reliable, else by tempering."""

import numpy as np

from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.importance import (
    CANDIDATE_DRAWS,
    DRAWS,
    MOST_UNKNOWNS,
    PRIOR_SHARE,
    Integral,
    at_modes,
    importance_sampling,
    weighted_draws,
)
from pymc_hyperelastic.evidence.mixture import GaussianMixture
from pymc_hyperelastic.evidence.modes import find_modes, starting_points
from pymc_hyperelastic.evidence.path import GeometricPath
from pymc_hyperelastic.evidence.proposal import (
    ExpectationMaximisation,
    LaplaceMixture,
    ProposalBuilder,
)
from pymc_hyperelastic.evidence.reference import Reference
from pymc_hyperelastic.evidence.search import find_reference
from pymc_hyperelastic.evidence.target import Target, width_of
from pymc_hyperelastic.evidence.tempering import MOST_CAPPED, TemperedSMC
from pymc_hyperelastic.evidence.weights import effective_sample_size

# Share of the modes in the initial proposal; the rest has the shape of the prior.
_SHARE_OF_MODES = 0.8
# Draws that show whether modes are like the posterior.
_TEST_DRAWS = 400
# Effective fraction of these draws from which modes are like the posterior.
_LIKE_POSTERIOR = 0.4
# Unknowns up to which Laplace approximations are made with second differences: their number grows
# with the square of the unknowns.
_MOST_FOR_DIFFERENCES = 12
# Draws of the modes for each particle: hardly a draw is then a particle twice.
_DRAWS_PER_PARTICLE = 2
# Draws of the prior, some of which are starting points of optimisation.
_PRIOR_DRAWS = 2000


@np.errstate(all="ignore")  # an optimisation may be so wild that it overflows
def integrate(target: Target, size: int, rng: np.random.Generator) -> Integral:
    """Compute the evidence of a target, with particles of its posterior.

    A posterior of few unknowns with mostly one mode is left to importance sampling, which starts at
    the modes and the prior; tempering, which takes ten times as long, does all others. The error is
    infinite if particles have not forgotten their places at most stages of tempering, or at many.
    """
    prior = target.draw_prior(_PRIOR_DRAWS, rng)
    # A posterior that is hardly narrower than the prior is not like its mode.
    initial, candidates = GaussianMixture.fit(prior, 1, rng), []
    if target.dimension <= MOST_UNKNOWNS:
        starts = starting_points(prior, np.add(*target.score(prior)))
        modes = find_modes(target.derivatives, [next(starts)], width_of(prior), starts)
        if modes is not None:
            initial = initial.joined(modes.mixture, _SHARE_OF_MODES)
            draws = max(CANDIDATE_DRAWS, _DRAWS_PER_PARTICLE * size)
            if draws <= DRAWS and _is_like_posterior(target, initial, rng):
                candidates = [(Reference(at_modes(modes.mixture), PRIOR_SHARE), draws)]
    by_laplace = target.knows_curvature or target.dimension <= _MOST_FOR_DIFFERENCES
    builder: ProposalBuilder = LaplaceMixture(target) if by_laplace else ExpectationMaximisation()
    found = importance_sampling(
        target.score,
        initial,
        builder,
        size,
        rng,
        draw_prior=target.draw_prior,
        candidate_proposals=candidates,
    )
    return found if found.reliable else _by_tempering(target, size, rng, found.log_value)


def _is_like_posterior(target: Target, mixture: GaussianMixture, rng: np.random.Generator) -> bool:
    """Return True if a mixture is like the posterior: no proposal has to be adapted then."""
    _, log_weights = weighted_draws(target.score, mixture.heavy_tailed(), _TEST_DRAWS, rng)
    return effective_sample_size(log_weights) > _LIKE_POSTERIOR * _TEST_DRAWS


def _by_tempering(target: Target, size: int, rng: np.random.Generator, quick: Estimate) -> Integral:
    """Compute the integral by tempering from a reference, and compare it with a `quick` value."""
    reference = find_reference(target, rng, checked=False).reference
    particles = reference.draw(target.draw_prior, size, rng)
    path = GeometricPath(target, reference)
    smc = TemperedSMC(path, particles, rng, most_capped=MOST_CAPPED).run()
    # Particles that do not move miss mass, and do not show that they do.
    error = np.inf if smc.capped > smc.stages / 2 else float(np.sqrt(smc.variance))
    if np.isfinite(quick.standard_error):
        # Two estimates that share nothing: their difference is an error of unknown origin.
        error = float(np.hypot(error, smc.log_evidence - quick.value))
    return Integral(
        Estimate(smc.log_evidence, error), np.nan, "tempering", rng.permutation(smc.particles)
    )
