"""Compute one integral: by importance sampling, by tempering, or by a bridge from particles."""

from functools import partial

import numpy as np

from pymc_hyperelastic.evidence.bridge import bridged
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.importance import (
    MOST_UNKNOWNS,
    STEP_DRAWS,
    Integral,
    importance_sampling,
)
from pymc_hyperelastic.evidence.mixture import Array, GaussianMixture
from pymc_hyperelastic.evidence.modes import find_modes, starting_points
from pymc_hyperelastic.evidence.path import GeometricPath
from pymc_hyperelastic.evidence.proposal import laplace_mixture
from pymc_hyperelastic.evidence.search import find_reference
from pymc_hyperelastic.evidence.target import Target, width_of
from pymc_hyperelastic.evidence.tempering import HASTY, TemperedSMC

# Particles of a bridge.
_PARTICLES = 256
# Stages of a bridge at the posterior, at most, until two evidences in a row agree.
_MOST_STAGES = 10
# Standard errors within which two evidences agree.
_AGREEMENT = 2.0


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
    smc = TemperedSMC(path, particles, rng).run()
    # Particles that do not move miss mass, and do not show that they do.
    error = np.inf if smc.capped > smc.stages / 2 else float(np.sqrt(smc.variance))
    if np.isfinite(quick.standard_error):
        # Two estimates that share nothing: their difference is an error of unknown origin.
        error = float(np.hypot(error, smc.log_evidence - quick.value))
    estimate, particles = Estimate(smc.log_evidence, error), rng.permutation(smc.particles)
    return Integral(estimate, np.nan, "tempering", particles)


class BridgeFromParticles:
    """Particles of the posterior of a smooth target, and its integral by bridge sampling.

    With many unknowns no proposal is so accurate that its draws have even weights, and tempering
    takes many stages, each of which must be exact. Bridge sampling needs draws of the posterior
    only, and a rough proposal. Particles that were tempered in haste, or are those of a similar
    posterior, are not there yet; they move until two evidences in a row agree.

    The first `particles` may be draws of a similar posterior; when missing they are tempered from
    the prior. The gradients of a `guide`, a cheaper target, may lead them.
    """

    @np.errstate(all="ignore")  # a trajectory may be so wild that it overflows
    def __init__(
        self,
        target: Target,
        rng: np.random.Generator,
        particles: Array | None = None,
        guide: Target | None = None,
    ) -> None:
        self._target = target
        path = GeometricPath(target, guide=guide)
        if particles is None:
            start = target.draw_prior(_PARTICLES, rng)
            particles = TemperedSMC(path, start, rng, HASTY).run().visited
        if len(particles) > _PARTICLES:
            particles = rng.permutation(particles)[:_PARTICLES]
        self._smc = TemperedSMC(path, particles, rng, HASTY, beta=1.0)
        self._last = Estimate(-np.inf, np.inf)

    @np.errstate(all="ignore")
    def integral(self, size: int, rng: np.random.Generator) -> Integral:
        """Move the particles on, and return the integral with `size` draws of the posterior."""
        self._smc.rng = rng
        for _ in range(_MOST_STAGES):
            self._smc.stay()
            draws, log_density = self._smc.trajectories
            estimate, doubts = bridged(self._density, draws, log_density, rng, "normal")
            before, self._last = self._last, estimate
            error = np.hypot(estimate.standard_error, before.standard_error)
            if not doubts and abs(estimate.value - before.value) < _AGREEMENT * error < np.inf:
                break
        else:
            estimate = Estimate(estimate.value, np.inf)
        particles = draws.reshape(-1, self._target.dimension)
        while len(particles) < size:
            self._smc.stay()
            more = self._smc.trajectories[0].reshape(-1, self._target.dimension)
            particles = np.concatenate([particles, more])
        return Integral(estimate, np.nan, "bridge", rng.permutation(particles)[:size])

    def _density(self, points: Array) -> Array:
        flat = np.add(*self._target.score(points.reshape(-1, self._target.dimension)))
        return flat.reshape(points.shape[:-1])
