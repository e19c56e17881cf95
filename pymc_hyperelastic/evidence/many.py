"""An integral over many unknowns: particles that are led to the posterior, and a bridge to it."""

import numpy as np

from pymc_hyperelastic.evidence.bridge import bridged
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.importance import Integral
from pymc_hyperelastic.evidence.mixture import Array
from pymc_hyperelastic.evidence.path import GeometricPath
from pymc_hyperelastic.evidence.target import Target
from pymc_hyperelastic.evidence.tempering import TemperedSMC

# Particles, and moves of a stage: on the way from the prior they need not quite follow it.
_PARTICLES, _MOVES_ON_THE_WAY, _MOVES = 256, 5, 20
# Draws on the way of particles of which one is worth a draw of the proposal.
_FOR_ONE = 4
# Stages at the posterior, at most, until an evidence is like that of the stage before: not further
# away than so many of their standard errors.
_MOST_STAGES, _ALIKE = 10, 2.0


class Led:
    """Particles that are led to the posterior of a smooth target, and on from there.

    Of many unknowns no distribution is known so well that its draws would have even weights, and
    tempering has a long way, of which each stage is to be exact. A bridge needs but draws of the
    posterior, and forgives what a distribution fitted to them is not. Particles that are led from
    the prior in haste, or are `known` from a posterior like this one, lag behind; they move on
    until the evidence from where they are is twice the same.
    """

    @np.errstate(all="ignore")  # a leap may be so wild that it overflows
    def __init__(
        self,
        target: Target,
        rng: np.random.Generator,
        known: Array | None = None,
        guide: Target | None = None,
    ) -> None:
        self._target = target
        path = GeometricPath(target, guide=guide)
        if known is None:
            start = target.draw_prior(_PARTICLES, rng)
            led = TemperedSMC(path, start, rng, max_moves=_MOVES_ON_THE_WAY).run()
            known = led.visited
        if len(known) > _PARTICLES:
            known = rng.permutation(known)[:_PARTICLES]
        self._tempering = TemperedSMC(path, known, rng, arrived=True, max_moves=_MOVES)
        self._last = Estimate(-np.inf, np.inf)

    @np.errstate(all="ignore")
    def integral(self, size: int, rng: np.random.Generator) -> Integral:
        """Integral of the target from where the particles go next, and so many draws of these."""
        self._tempering.rng = rng
        for _ in range(_MOST_STAGES):
            self._tempering.stay()
            draws, log_density = self._tempering.trajectories
            proposed = log_density.size // _FOR_ONE
            estimate, doubts = bridged(self._density, draws, log_density, rng, "normal", proposed)
            before, self._last = self._last, estimate
            error = np.hypot(estimate.standard_error, before.standard_error)
            if not doubts and abs(estimate.value - before.value) < _ALIKE * error < np.inf:
                break
        else:
            estimate = Estimate(estimate.value, np.inf)
        particles = draws.reshape(-1, self._target.dimension)
        while len(particles) < size:
            self._tempering.stay()
            more = self._tempering.trajectories[0].reshape(-1, self._target.dimension)
            particles = np.concatenate([particles, more])
        return Integral(estimate, np.nan, "bridge", rng.permutation(particles)[:size])

    def _density(self, points: Array) -> Array:
        flat = np.add(*self._target.score(points.reshape(-1, self._target.dimension)))
        return flat.reshape(points.shape[:-1])
