"""Compute an integral over many unknowns: temper particles, then bridge sampling from them."""

import numpy as np

from pymc_hyperelastic.evidence.bridge import bridged
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.importance import Integral
from pymc_hyperelastic.evidence.mixture import Array
from pymc_hyperelastic.evidence.path import GeometricPath
from pymc_hyperelastic.evidence.target import Target
from pymc_hyperelastic.evidence.tempering import HASTY_MOVES, TemperedSMC

# Number of particles.
_PARTICLES = 256
# Stages at the posterior, at most, until two evidences in a row agree.
_MOST_STAGES = 10
# Standard errors within which two evidences agree.
_AGREEMENT = 2.0


class BridgeFromParticles:
    """Particles of the posterior of a smooth target, and its integral by bridge sampling.

    With many unknowns no proposal is so accurate that its draws have even weights, and tempering
    takes many stages, each of which must be exact. Bridge sampling needs draws of the posterior
    only, and a rough proposal. Particles that were tempered in haste, or are those of a similar
    posterior, are not there yet; they move until two evidences in a row agree.

    Parameters
    ----------
    target : Target
    rng : numpy.random.Generator
    particles : array, optional
        Draws of a similar posterior; tempered from the prior when missing.
    guide : Target, optional
        A cheaper target whose gradients lead the particles.
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
            smc = TemperedSMC(path, start, rng, max_moves=HASTY_MOVES)
            particles = smc.run().visited
        if len(particles) > _PARTICLES:
            particles = rng.permutation(particles)[:_PARTICLES]
        self._smc = TemperedSMC(path, particles, rng, beta=1.0, max_moves=HASTY_MOVES)
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
