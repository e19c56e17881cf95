"""A population of particles that is led from where it starts to the posterior."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from pymc_hyperelastic.evidence.mixture import Array, GaussianMixture, components_for, log_sum_exp
from pymc_hyperelastic.evidence.reference import Reference
from pymc_hyperelastic.evidence.target import Target
from pymc_hyperelastic.evidence.weights import (
    effective_sample_size,
    largest_step,
    pareto_shape,
    systematic,
)

# Fraction of the effective sample size that stages keep.
THRESHOLD = 0.5
# Correlation cannot show how fast particles move before they had a few moves.
FEWEST_MOVES = 4
# The proposals look ahead as far as this fraction of the particles is effective there, and this
# share of them is drawn for what is seen there.
_AHEAD, _SHARE_AHEAD = 0.02, 0.3
# Points from which a mixture is fitted, if there are so many.
_TO_LEARN_FROM = 1000
# Rate of acceptance below which moves to new places do not pay at the posterior.
_RARELY = 0.1
# Spread of the lengths of steps, as the sd of their logarithm: what suits the bulk is too long in
# the neck of a funnel. Rates of acceptance at which they are right.
_WALKS, _LEAPS = (1.5, 0.3), (1.0, 0.65)
# A leap has so many steps at most.
_LONGEST_LEAP = 10
# Leaps that are too long end anywhere; from there on squares may overflow.
_LOST = 1e100
# Places of the particles, and the two log densities between which they are led.
Visited = list[tuple[Array, Array, Array]]


class Tempering:
    """Particles on the path ``a^(1-β) p^β`` from a density ``a`` to that of the posterior ``p``.

    ``a`` is the prior, or a reference if there is one, from which the particles must be drawn;
    unless they have `arrived` at the posterior, or near it.

    A leap may follow the slopes of a `guide`, a cheaper target like this one: where it ends then
    depends on the guide, and whether it is taken on this one, so that particles are distributed as
    this one says.

    Attributes
    ----------
    particles : array, shape (n, d)
    beta : float
    log_evidence, variance : float
        Of the stages so far; the variance is relative. It is infinite once particles had not
        forgotten their places after `max_moves` at `most_capped` stages: from there on they move
        once a stage.
    pareto_k : float
        Shape of the largest weights of a reference's particles, as draws of the posterior.
    """

    def __init__(
        self,
        target: Target,
        particles: Array,
        rng: np.random.Generator,
        *,
        reference: Reference | None = None,
        guide: Target | None = None,
        arrived: bool = False,
        threshold: float = THRESHOLD,
        forget: float = 0.1,
        max_moves: int = 50,
        most_capped: float = np.inf,
    ) -> None:
        self.target, self.rng, self.reference = target, rng, reference
        self.guide = guide or target
        self.threshold, self.forget, self.max_moves = threshold, forget, max_moves
        self.most_capped = most_capped
        self.particles = particles
        self.draws, self.dimension = particles.shape
        self.beta, self.moves, self.capped, self._arrived = float(arrived), 0, 0, arrived
        self.stages = 0
        self.log_evidence, self.variance = 0.0, 0.0
        self.effective_sample_size, self.acceptance = float(self.draws), 0.0
        self._start, self._rise = self._score(particles)
        self.pareto_k = pareto_shape(self._rise) if reference else np.nan
        self.eve = np.arange(self.draws)
        self._influence = np.zeros(self.draws)
        # Of what is impossible there is no share.
        self._logp = self._start + self._rise if arrived else self._start
        self._last_beta, self._step_ahead = self.beta, 0.0
        self._visited: Visited = [(particles, self._start, self._rise)]
        self._before: tuple[Visited, float] | None = None
        self.mixtures: list[GaussianMixture] = [reference.mixture] if reference else []
        self._walk_length = 2.38 / np.sqrt(self.dimension)
        self._leap_length = self.dimension**-0.25

    def run(self) -> "Tempering":
        """Lead the particles to the posterior."""
        while self.beta < 1:
            self.reweight()
            self.resample()
            self.learn()
            self.move()
        return self

    def stay(self) -> None:
        """Move the particles once more where they are."""
        self._last_beta, self._step_ahead = self.beta, 0.0
        self.learn()
        self.move()

    @property
    def stuck(self) -> bool:
        """Whether particles remembered their places at the end of most stages."""
        return self.capped > self.stages / 2

    @property
    def mixture(self) -> GaussianMixture:
        """From which moves are drawn."""
        return self.mixtures[-1]

    @property
    def ancestors(self) -> int:
        """How many of the first particles have descendants."""
        return len(np.unique(self.eve))

    @property
    def visited(self) -> Array:
        """All places visited at this stage."""
        return np.concatenate([places for places, *_ in self._visited])

    @property
    def paths(self) -> tuple[Array, Array]:
        """Where each particle has moved at this stage, and the log density there on the path."""
        places, start, rise = (
            np.stack(values, axis=1) for values in zip(*self._visited[1:], strict=True)
        )
        return places, start + self.beta * rise

    @property
    def possible(self) -> NDArray[np.bool_]:
        """Which particles have a posterior density."""
        return np.isfinite(self._start + self._rise)

    def reweight(self) -> None:
        """Raise ``β`` as far as the effective sample size allows, and take the evidence's step."""
        rise = np.concatenate([rise for *_, rise in self._visited])
        remaining = 1.0 - self.beta
        threshold = max(self.threshold, self.moves / (self.moves + 5))
        step = largest_step(rise, threshold, remaining)
        self._last_beta = self.beta
        self.beta = 1.0 if step == remaining else self.beta + step
        log_weights = step * rise
        total = logsumexp(log_weights)
        self.weights = np.exp(log_weights - total)
        self.effective_sample_size = effective_sample_size(log_weights)
        self.log_evidence += float(total - np.log(rise.size))

        ways = self.weights.reshape(-1, self.draws).sum(axis=0) * self.draws
        self._influence += np.bincount(self.eve, ways - 1, self.draws)
        self.variance = float(np.sum(self._influence**2)) / self.draws**2
        self._step_ahead = max(largest_step(rise, _AHEAD, remaining) - step, 0.0)

    def resample(self) -> None:
        """Resample the particles systematically from all places visited."""
        places, start, rise = (np.concatenate(x) for x in zip(*self._visited, strict=True))
        chosen = systematic(self.weights, self.draws, self.rng)
        self.eve = self.eve[chosen % self.draws]
        self.particles, self._start, self._rise = places[chosen], start[chosen], rise[chosen]
        self._logp = self._start + self.beta * self._rise

    def learn(self) -> None:
        """Fit the mixture from which moves are drawn.

        It is fitted to the places of the stage before: fitted to particles that it then moves, it
        would draw them back to where they are, and the more so the more variables there are.
        """
        before, self._before = self._before, (self._visited, self._last_beta)
        if before is None and self.reference is not None:
            return
        visited, beta = before or self._before
        places, _, rise = (np.concatenate(x) for x in zip(*visited, strict=True))
        share = (1 - _SHARE_AHEAD) * _weights(rise, self.beta - beta)
        share += _SHARE_AHEAD * _weights(rise, self.beta - beta + self._step_ahead)
        size = max(self.draws // 2, min(len(places), _TO_LEARN_FROM))
        learn_from = places[systematic(share, size, self.rng)]
        components = components_for(size, self.dimension)
        # The mixture of the stage before is nearly right, unless components have died out.
        start = self.mixtures[-1] if self.mixtures else None
        alive = start is not None and len(start.means) == components
        mixture = GaussianMixture.fit(
            learn_from,
            components,
            self.rng,
            start=start if alive else None,
            iterations=4 if alive else 10,
        )
        self.mixtures.append(mixture.heavy_tailed())

    @np.errstate(all="ignore")  # a proposal may be so wild that it overflows
    def move(self) -> None:
        """Move the particles until they have forgotten their places."""
        origin, far = self.particles, self._weight_ahead()
        self._visited = [(origin, self._start, self._rise)]
        self._terms = self.mixture.log_density_of_components(origin)
        rates: list[float] = []
        hurried = self.capped >= self.most_capped
        nearby = self._leap if self.target.has_slopes else self._walk
        alone = False
        for number in range(self.max_moves):
            independent = number % 2 == 0 and not alone
            rates.append(self._move_independently() if independent else nearby())
            # Between modes that are yet to be weighed even rare moves count.
            alone |= self._arrived and independent and rates[-1] < _RARELY
            if hurried or self.target.exhausted:
                self.capped += 1
                break
            # The few particles that stick in the tails are lost in the first correlation, but will
            # carry the weight of later stages.
            if (
                len(rates) >= FEWEST_MOVES
                and _largest_correlation(origin, self.particles) < self.forget
                and _largest_correlation(far, self._weight_ahead()) < self.forget / 2
            ):
                break
        else:
            self.capped += 1
        if hurried:
            self.variance = np.inf
        self.stages += 1
        self.moves = len(rates)
        self.acceptance = float(np.mean(rates))

    def _score(self, points: Array) -> tuple[Array, Array]:
        """Log density at the start of the path, and what is left of the posterior's."""
        prior, likelihood = self.target.score(points)
        if self.reference is None:
            return prior, likelihood
        # A step may be so wild that it overflows, and a transform may refuse draws of the prior.
        with np.errstate(over="ignore", invalid="ignore"):
            start = self.reference.log_density(points, prior)
            rise = prior + likelihood - start
        return start, np.where(np.isfinite(start), rise, -np.inf)

    def _slope(self, points: Array) -> Array:
        """Slope of the log density on the path."""
        prior, _, of_prior, of_likelihood = self.guide.slopes(points)
        if self.reference is None:
            return of_prior + self.beta * of_likelihood
        _, of_start = self.reference.slope(points, prior, of_prior)
        return (1 - self.beta) * of_start + self.beta * (of_prior + of_likelihood)

    def _weight_ahead(self) -> Array:
        # Equal weights, of the last stage, have no correlation, not even that of rounding.
        return _weights(self._rise, self._step_ahead)[:, None] * (self._step_ahead > 0)

    def _move_independently(self) -> float:
        proposal = self.mixture.draw(self.draws, self.rng)
        terms = self.mixture.log_density_of_components(proposal)
        log_ratio = log_sum_exp(self._terms) - log_sum_exp(terms)
        return self._accept(proposal, terms, log_ratio)

    def _components(self) -> tuple[NDArray[np.intp], Array]:
        """A component for each particle, drawn by its responsibility, and the logarithm of that.

        Steps of its shape follow a bent ridge; the ratio of responsibilities makes them reversible.
        """
        here = self._terms - log_sum_exp(self._terms)[:, None]
        component = (np.exp(here).cumsum(axis=1) < self.rng.random((self.draws, 1))).sum(axis=1)
        component = component.clip(max=here.shape[1] - 1)
        return component, here[np.arange(self.draws), component]

    def _lengths(self, typical: float, spread: float) -> Array:
        return typical * self.rng.lognormal(0.0, spread, (self.draws, 1))

    def _walk(self) -> float:
        """Step at random."""
        component, here = self._components()
        spread, good = _WALKS
        steps = self.mixture.draw_steps(component, self.rng)
        proposal = self.particles + self._lengths(self._walk_length, spread) * steps
        rate = self._accept_from(proposal, component, here)
        self._walk_length *= np.exp(rate - good)
        return rate

    def _leap(self) -> float:
        """Follow the slope: Hamiltonian Monte Carlo."""
        component, here = self._components()
        spread, good = _LEAPS
        lengths = self._lengths(self._leap_length, spread)
        momentum = self.rng.standard_normal(self.particles.shape)
        energy = (momentum**2).sum(axis=1) / 2
        place, step = self.particles, self.mixture.steps
        kick = lengths / 2 * step(component, self._slope(place), transposed=True)
        for _ in range(self.rng.integers(1, _LONGEST_LEAP, endpoint=True)):
            momentum = momentum + kick
            place = place + lengths * step(component, momentum)
            kick = lengths / 2 * step(component, self._slope(place), transposed=True)
            momentum = momentum + kick
        energy -= (momentum**2).sum(axis=1) / 2
        lost = ~(np.abs(place) < _LOST).all(axis=1) | np.isnan(energy)
        place = np.where(lost[:, None], self.particles, place)
        rate = self._accept_from(place, component, here + np.where(lost, np.inf, -energy))
        self._leap_length *= np.exp((rate - good) / 2)
        return rate

    def _accept_from(self, proposal: Array, component: NDArray[np.intp], here: Array) -> float:
        """Accept steps that a component has made, whose responsibility was the one `here`."""
        terms = self.mixture.log_density_of_components(proposal)
        there = terms[np.arange(self.draws), component] - log_sum_exp(terms)
        return self._accept(proposal, terms, there - here)

    def _accept(self, proposal: Array, terms: Array, log_ratio: Array) -> float:
        """Metropolis-Hastings step of all particles; the rate of acceptance."""
        start, rise = self._score(proposal)
        logp = start + self.beta * rise
        threshold = -self.rng.exponential(size=self.draws)
        accepted = threshold < logp - self._logp + log_ratio
        moved = accepted[:, None]
        self.particles = np.where(moved, proposal, self.particles)
        self._terms = np.where(moved, terms, self._terms)
        self._start = np.where(accepted, start, self._start)
        self._rise = np.where(accepted, rise, self._rise)
        self._logp = np.where(accepted, logp, self._logp)
        self._visited.append((self.particles, self._start, self._rise))
        return float(accepted.mean())


def _weights(rise: Array, power: float) -> Array:
    """Normalised weights of particles on the way from one ``β`` to another, so much larger one."""
    possible = rise > -np.inf
    log_weights = np.where(possible, power * np.where(possible, rise, 0.0), -np.inf)
    return np.exp(log_weights - logsumexp(log_weights))


def _largest_correlation(before: Array, after: Array) -> float:
    """Largest correlation of a variable with its own value before."""
    before, after = before - before.mean(axis=0), after - after.mean(axis=0)
    norm = np.sqrt((before**2).sum(axis=0) * (after**2).sum(axis=0))
    return float(np.max(np.abs((before * after).sum(axis=0)) / np.maximum(norm, 1e-300)))


def stayed(moves: Array, max_moves: float) -> NDArray[np.bool_]:
    """Return True for stages after which particles had not forgotten their places.

    A stage in haste has fewer moves than are needed to estimate the correlation.
    """
    return (moves >= max_moves) | (moves < FEWEST_MOVES)
