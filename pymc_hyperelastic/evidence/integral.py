"""Compute one integral: by importance sampling if that is reliable, else by tempering."""

from functools import partial

import numpy as np

from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.importance import (
    MOST_UNKNOWNS,
    STEP_DRAWS,
    Integral,
    importance_sampling,
)
from pymc_hyperelastic.evidence.mixture import GaussianMixture
from pymc_hyperelastic.evidence.modes import find_modes, starting_points
from pymc_hyperelastic.evidence.path import GeometricPath
from pymc_hyperelastic.evidence.proposal import laplace_mixture
from pymc_hyperelastic.evidence.search import find_reference
from pymc_hyperelastic.evidence.target import Target, width_of
from pymc_hyperelastic.evidence.tempering import MOST_CAPPED, TemperedSMC


@np.errstate(all="ignore")  # an optimisation may be so wild that it overflows
def integrate(target: Target, size: int, rng: np.random.Generator) -> Integral:
    """Compute the evidence of a target, with particles of its posterior.

    A posterior of few unknowns with mostly one mode is left to importance sampling, which starts at
    the modes and the prior; tempering, which takes ten times as long, does all others. The error is
    infinite if particles have not forgotten their places at most stages of tempering, or at many.
    """
    prior = target.draw_prior(STEP_DRAWS, rng)
    # A posterior that is hardly narrower than the prior is not like its mode.
    initial, candidate = GaussianMixture.fit(prior, 1, rng), None
    if target.dimension <= MOST_UNKNOWNS:
        starts = starting_points(prior, np.add(*target.score(prior)))
        modes = find_modes(target.derivatives, [next(starts)], width_of(prior), starts)
        if modes is not None:
            initial = initial.joined(modes.mixture)
            # Twice as many draws as particles: if the modes are like the posterior, half of them
            # are effective.
            candidate = modes.mixture.heavy_tailed(), 2 * size
    found = importance_sampling(
        target.score,
        initial,
        partial(laplace_mixture, target),
        size,
        rng,
        draw_prior=target.draw_prior,
        candidate=candidate,
    )
    return found if found.reliable else _by_tempering(target, size, rng, found.log_value)


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
