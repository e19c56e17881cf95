"""Metropolis-Hastings moves of a population of particles, with steps of the shape of a mixture."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymc_hyperelastic.evidence.mixture import Array, GaussianMixture, log_sum_exp


class Proposed(NamedTuple):
    """Where particles may move."""

    points: Array
    terms: Array
    """Log densities of the components of the mixture at these points, (n, K)."""
    log_ratio: Array
    """Log density of the proposal of the way back, less that of the way there."""


class Move:
    """A reversible move: independent draws of the mixture, or steps from where a particle is."""

    def propose(
        self, points: Array, terms: Array, mixture: GaussianMixture, rng: np.random.Generator
    ) -> Proposed:
        """Propose a new place for each point, at which the mixture has these `terms`."""
        proposal = mixture.draw(len(points), rng)
        there = mixture.log_density_of_components(proposal)
        return Proposed(proposal, there, log_sum_exp(terms) - log_sum_exp(there))

    def adapt(self, rate: float) -> None:
        """Adapt the length of steps, if there are any, to the acceptance rate of the last move."""


class RandomWalkMove(Move):
    """Random steps with the covariance of the component that a particle is drawn to belong to.

    Lengths are log-normal: one that suits the bulk is too long in the neck of a funnel.
    """

    # Between the optimal acceptance rate of 0.23 in many dimensions and that of 0.44 in one
    # (Roberts and Rosenthal 2001).
    best_rate = 0.3

    def __init__(self, dimension: int) -> None:
        self._length = 1 / np.sqrt(dimension)

    def propose(
        self, points: Array, terms: Array, mixture: GaussianMixture, rng: np.random.Generator
    ) -> Proposed:
        """Propose a new place for each point."""
        component, here = _draw_components(terms, rng)
        steps = mixture.draw_steps(component, rng)
        lengths = self._length * rng.lognormal(size=(len(points), 1))
        return _proposed(points + lengths * steps, component, here, mixture)

    def adapt(self, rate: float) -> None:
        """Lengthen steps that are accepted too often, shorten others."""
        self._length *= np.exp(rate - self.best_rate)


class HamiltonianMove(Move):
    """Hamiltonian Monte Carlo with the covariance of a component, and log-normal lengths of steps.

    The gradient may be that of another, cheaper density: it decides where a move ends, and not
    whether it is accepted.
    """

    best_rate = 0.65  # the optimal acceptance rate (Beskos et al. 2013)
    most_steps = 10  # leapfrog steps of one move

    def __init__(self, dimension: int, gradient: Callable[[Array], Array]) -> None:
        self._length, self._gradient = dimension**-0.25, gradient

    def propose(
        self, points: Array, terms: Array, mixture: GaussianMixture, rng: np.random.Generator
    ) -> Proposed:
        """Propose a new place for each point, by leapfrog steps."""
        component, here = _draw_components(terms, rng)
        lengths = self._length * rng.lognormal(size=(len(points), 1))
        momentum = rng.standard_normal(points.shape)
        energy = (momentum**2).sum(axis=1) / 2
        place, step = points, mixture.steps
        kick = lengths / 2 * step(component, self._gradient(place), transposed=True)
        for _ in range(rng.integers(1, self.most_steps, endpoint=True)):
            momentum = momentum + kick
            place = place + lengths * step(component, momentum)
            kick = lengths / 2 * step(component, self._gradient(place), transposed=True)
            momentum = momentum + kick
        energy -= (momentum**2).sum(axis=1) / 2
        diverged = ~np.isfinite(energy)
        place = np.where(diverged[:, None], points, place)
        return _proposed(place, component, here + np.where(diverged, np.inf, -energy), mixture)

    def adapt(self, rate: float) -> None:
        """Lengthen steps that are accepted too often, shorten others."""
        self._length *= np.exp((rate - self.best_rate) / 2)


def _draw_components(terms: Array, rng: np.random.Generator) -> tuple[NDArray[np.intp], Array]:
    """Draw a component for each particle by its responsibility, and return the log of that.

    Steps of its shape follow a bent ridge; the ratio of responsibilities makes them reversible.
    """
    here = terms - log_sum_exp(terms)[:, None]
    component = (np.exp(here).cumsum(axis=1) < rng.random((len(terms), 1))).sum(axis=1)
    component = component.clip(max=here.shape[1] - 1)
    return component, here[np.arange(len(terms)), component]


def _proposed(
    points: Array, component: NDArray[np.intp], here: Array, mixture: GaussianMixture
) -> Proposed:
    """Return steps of components whose log responsibility was `here`."""
    terms = mixture.log_density_of_components(points)
    there = terms[np.arange(len(points)), component] - log_sum_exp(terms)
    return Proposed(points, terms, there - here)
