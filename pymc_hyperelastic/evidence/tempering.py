"""Waste-free sequential Monte Carlo: lead particles along a path of densities to the posterior."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from pymc_hyperelastic.evidence.mixture import Array, GaussianMixture, components_for
from pymc_hyperelastic.evidence.moves import HamiltonianMove, Move, RandomWalkMove
from pymc_hyperelastic.evidence.path import GeometricPath, PathPoints
from pymc_hyperelastic.evidence.weights import (
    effective_sample_size,
    largest_step,
    pareto_shape,
    systematic,
)

# Moves of a stage, at least: after fewer a correlation cannot show how fast particles move.
_FEWEST_MOVES = 4


@dataclass(frozen=True)
class Settings:
    """How exactly particles follow the path."""

    threshold: float = 0.5
    """Fraction of the effective sample size that stages keep: the usual value."""
    forget: float = 0.1
    """Correlation of a variable with its value before below which particles have forgotten it."""
    max_moves: int = 50
    """Moves of a stage, at most."""
    most_capped: float = 6
    """Stages whose particles have not forgotten their places; then they move once a stage.
    Posteriors that come out right have had six such stages at most."""
    most_stages: float = np.inf
    """Stages after which :meth:`TemperedSMC.run` gives up."""
    fitted_places: int = 2000
    """Places to which a mixture is fitted, at least, unless particles have visited fewer: with a
    few hundred it would often have a single component."""


# For particles that need not be exact, but lead to others.
HASTY = Settings(max_moves=10, most_capped=np.inf)


class TemperedSMC:
    """Particles on the path ``a^(1-β) p^β`` from a density ``a`` to that of the posterior ``p``.

    The particles, (n, d), are draws of the density at `beta`, or near it. The variance is infinite
    if particles have not forgotten their places at more stages than the settings allow.

    Attributes
    ----------
    log_evidence : float
        Log evidence of the stages so far.
    pareto_k : float
        Shape of the largest weights of a reference's particles, as draws of the posterior.
    stages, capped : int
        Number of stages so far, and of those whose particles had not forgotten their places.
    mixtures : list of GaussianMixture
        The mixtures that proposed moves; the last one is in use.
    """

    def __init__(
        self,
        path: GeometricPath,
        particles: Array,
        rng: np.random.Generator,
        settings: Settings | None = None,
        beta: float = 0.0,
    ) -> None:
        self.path, self.rng, self.settings = path, rng, settings or Settings()
        self.draws, self.dimension = particles.shape
        self.beta, self.log_evidence = beta, 0.0
        self.stages = self.capped = self.moves = 0
        self.stage_capped = False
        self.effective_sample_size, self.acceptance = float(self.draws), 0.0
        self._now = path.at(particles)
        self.pareto_k = pareto_shape(self._now.log_ratio) if path.reference else np.nan
        self.eve = np.arange(self.draws)
        self._influence = np.zeros(self.draws)
        self._last_beta, self._places = beta, self._now
        self._before: tuple[PathPoints, float] | None = None
        self.mixtures: list[GaussianMixture] = [path.reference.mixture] if path.reference else []
        self.independent_move = Move()
        self.local_move: Move = (
            HamiltonianMove(self.dimension, lambda points: path.gradient(points, self.beta))
            if path.target.has_gradients
            else RandomWalkMove(self.dimension)
        )

    def run(self) -> "TemperedSMC":
        """Lead the particles to the posterior, or as far as the largest number of stages allows."""
        while self.beta < 1 and self.stages < self.settings.most_stages:
            self.reweight()
            self.resample()
            self.adapt()
            self.move()
        return self

    def stay(self) -> None:
        """Move the particles once more where they are."""
        self._last_beta = self.beta
        self.adapt()
        self.move()

    @property
    def particles(self) -> Array:
        """Current particles, shape (n, d)."""
        return self._now.points

    @property
    def variance(self) -> float:
        """Relative variance of the evidence so far."""
        if self.capped > self.settings.most_capped:
            return np.inf
        return float(np.sum(self._influence**2)) / self.draws**2

    @property
    def ancestors(self) -> int:
        """Number of the first particles that have descendants."""
        return len(np.unique(self.eve))

    @property
    def visited(self) -> Array:
        """All places visited at this stage: where particles began, then after each move."""
        return self._places.points

    @property
    def trajectories(self) -> tuple[Array, Array]:
        """Places of each particle at this stage, (n, move, d), and the log density there."""
        points = self.visited.reshape(-1, self.draws, self.dimension)
        log_density = self._places.log_density(self.beta).reshape(-1, self.draws)
        return points[1:].swapaxes(0, 1), log_density[1:].T

    @property
    def possible(self) -> NDArray[np.bool_]:
        """True for particles with a posterior density."""
        return np.isfinite(self._now.log_density(1.0))

    def reweight(self) -> None:
        """Raise ``β`` as far as the effective sample size allows, and update the evidence."""
        ratio = self._places.log_ratio
        remaining = 1.0 - self.beta
        threshold = max(self.settings.threshold, self.moves / (self.moves + 5))
        step = largest_step(ratio, threshold, remaining)
        self._last_beta = self.beta
        self.beta = 1.0 if step == remaining else self.beta + step
        log_weights = step * ratio
        total = logsumexp(log_weights)
        self.weights = np.exp(log_weights - total)
        self.effective_sample_size = effective_sample_size(log_weights)
        self.log_evidence += float(total - np.log(ratio.size))

        of_particle = self.weights.reshape(-1, self.draws).sum(axis=0) * self.draws
        self._influence += np.bincount(self.eve, of_particle - 1, self.draws)

    def resample(self) -> None:
        """Resample the particles systematically from all places visited."""
        chosen = systematic(self.weights, self.draws, self.rng)
        self.eve = self.eve[chosen % self.draws]
        self._now = PathPoints(*(values[chosen] for values in self._places))

    def adapt(self) -> None:
        """Fit the mixture that proposes moves to the places of the stage before the last one.

        Fitted to the particles that it then moves, it would draw them back to their places. The
        first stage has the mixture of the reference, or without one fits its own particles. At
        later stages half of the mixture is that of the reference, which has more components, and
        reaches where no particle has been.
        """
        before, self._before = self._before, (self._places, self._last_beta)
        if before is None and self.path.reference is not None:
            return
        (points, _, ratio), beta = before or self._before
        # Avoid 0 times infinity.
        power, possible = self.beta - beta, ratio > -np.inf
        log_weights = np.where(possible, power * np.where(possible, ratio, 0.0), -np.inf)
        weights = np.exp(log_weights - logsumexp(log_weights))
        count = min(len(points), max(self.draws, self.settings.fitted_places))
        to_fit = points[systematic(weights, count, self.rng)]
        components = components_for(count, self.dimension)
        mixture = GaussianMixture.fit(to_fit, components, self.rng).heavy_tailed()
        if self.path.reference is not None:
            mixture = mixture.joined(self.path.reference.mixture)
        self.mixtures.append(mixture)

    @np.errstate(all="ignore")  # a proposal may be so wild that it overflows
    def move(self) -> None:
        """Move the particles until they have forgotten their places."""
        origin = self.particles
        visited = [self._now]
        self._terms = self.mixtures[-1].log_density_of_components(origin)
        rates: list[float] = []
        settings = self.settings
        most = 1 if self.capped >= settings.most_capped else settings.max_moves
        forgotten = False
        while len(rates) < most and not forgotten:
            rates.append(self._step(self.local_move if len(rates) % 2 else self.independent_move))
            visited.append(self._now)
            enough = len(rates) >= _FEWEST_MOVES
            forgotten = enough and _largest_correlation(origin, self.particles) < settings.forget
        self._places = PathPoints(*(np.concatenate(x) for x in zip(*visited, strict=True)))
        self.stages += 1
        self.stage_capped = not forgotten
        self.capped += self.stage_capped
        self.moves = len(rates)
        self.acceptance = float(np.mean(rates))

    def _step(self, move: Move) -> float:
        """Metropolis-Hastings step of all particles; return the acceptance rate."""
        mixture = self.mixtures[-1]
        points, terms, log_ratio = move.propose(self.particles, self._terms, mixture, self.rng)
        proposed = self.path.at(points)
        change = proposed.log_density(self.beta) - self._now.log_density(self.beta)
        accepted = -self.rng.exponential(size=self.draws) < change + log_ratio
        self._terms = np.where(accepted[:, None], terms, self._terms)
        self._now = PathPoints(
            np.where(accepted[:, None], points, self.particles),
            np.where(accepted, proposed.log_start, self._now.log_start),
            np.where(accepted, proposed.log_ratio, self._now.log_ratio),
        )
        rate = float(accepted.mean())
        move.adapt(rate)
        return rate


def _largest_correlation(before: Array, after: Array) -> float:
    """Return the largest correlation of a variable with its own value before."""
    before, after = before - before.mean(axis=0), after - after.mean(axis=0)
    norm = np.sqrt((before**2).sum(axis=0) * (after**2).sum(axis=0))
    return float(np.max(np.abs((before * after).sum(axis=0)) / np.maximum(norm, 1e-300)))
