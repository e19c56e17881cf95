"""What tests of one specimen say of its classes, by few draws: for very many specimens."""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import stats
from scipy.special import log_softmax, logsumexp

from pymc_hyperelastic.classes.specimen_evidence import near_class
from pymc_hyperelastic.classes.specimen_target import SpecimenTarget
from pymc_hyperelastic.classes.specimens import SpecimenSampler, fresh_specimens
from pymc_hyperelastic.evidence.climbs import Summits, climb_together
from pymc_hyperelastic.evidence.mixture import GaussianMixture, components_for
from pymc_hyperelastic.evidence.weights import effective_sample_size, largest_step, systematic
from pymc_hyperelastic.models.class_distribution import ClassDistribution
from pymc_hyperelastic.models.specimen_draws import mean_density

Array = NDArray[np.float64]

# Share of the first draws that are from the classes themselves, and how many components a mixture
# around the best specimen has, how much wider than they are, with Student's tails.
_OF_CLASSES, _COMPONENTS, _WIDER, _FREEDOM = 0.25, 60, 1.2, 6.0
# Share of the draws of a class that are to be effective, where it has at least such a probability;
# and how often it gets as many once more for that.
_EFFECTIVE, _IMPROBABLE, _MOST_ROUNDS = 0.25, 1e-3, 8
# For each dimension, effective draws of which a shape is learned; and draws it is learned from.
_FOR_SHAPE, _LEARNED_FROM = 4, 1000
# Steps of differences, in widths of the posterior.
_STEP = 1e-2


class KnownClass(NamedTuple):
    """A class, and its specimens with so many tests as a mixture of normal distributions."""

    distributions: ClassDistribution
    near: ClassDistribution
    """One distribution like it, and wider."""
    means: Array
    """Of points of the target, (draw, entry)."""
    precisions: Array
    """Inverses of the covariances."""


def known_class(distributions: ClassDistribution, tests: int, measures: int) -> KnownClass:
    """A class of specimens with so many tests, and measures of the tube that are not known."""
    means, covariances = _moments(distributions, tests)
    # The deviations of the tube come last, and are standard normal.
    tube = np.ones((len(means), measures))
    precisions = _and_independent(np.linalg.inv(covariances), tube)
    means = np.pad(means, [(0, 0), (0, measures)])
    return KnownClass(distributions, near_class(distributions), means, precisions)


class FewDraws:
    """Draws of what a specimen may be, and what they weigh under each class.

    They are from a mixture of

    - the classes themselves, where its tests tell little;
    - for each class, what it would be if the tests' standard errors were linear around the best
      specimen; the class being a mixture of normal distributions, so is that;
    - where that is not like it, as many draws again, from a mixture learned from all before.

    Attributes
    ----------
    points : array, shape (draw, entry)
        Points of the sampler's target.
    log_terms : array, shape (class, draw)
        Logarithms of likelihood and density under the class, by the density of the draws: their
        means are the evidences.
    effective : array, shape (class)
        Effective draws of each class; infinite where it is too improbable to matter.

    References
    ----------
    J.-M. Cornuet, J.-M. Marin, A. Mira and C. P. Robert, Adaptive multiple importance sampling,
    Scandinavian Journal of Statistics 39 (2012) 798.
    """

    def __init__(
        self,
        sampler: SpecimenSampler,
        classes: Sequence[KnownClass],
        log_prior: Array,
        data: xr.Dataset,
        start: Array | None,
        count: int,
        rng: np.random.Generator,
    ) -> None:
        self._sampler, self._data = sampler, data
        self._classes = [known.distributions for known in classes]
        self._target = sampler.target(data)
        self._mixtures: list[tuple[GaussianMixture, int]] = []
        self._log_likelihood, self._of_classes = np.empty(0), np.empty((len(classes), 0))
        self.points = np.empty((0, self._target.dimension))
        self._wide = round(_OF_CLASSES * count)
        for known in classes:
            target = sampler.target(data, partial(sampler.log_density, distribution=known.near))
            starts = _best_of_prior(target, 20 * count, rng) if start is None else start
            top = climb_together(target.ascent, starts, target.prior_width)
            around = _around(target, top, known)
            self._add(around, count - self._wide, known.distributions, rng)
        self._weigh(log_prior)
        for _ in range(_MOST_ROUNDS):
            lacking = np.flatnonzero(self.effective < _EFFECTIVE * count)
            if not lacking.size:
                break
            for learned in [self._learned(self.log_terms[k], rng) for k in lacking]:
                self._add(learned, count, None, rng)
            self._weigh(log_prior)

    def _add(
        self,
        mixture: GaussianMixture,
        count: int,
        fresh_of: ClassDistribution | None,
        rng: np.random.Generator,
    ) -> None:
        """Draw so many points, and some more fresh ones of a class."""
        drawn = [mixture.draw(count, rng)]
        self._mixtures.append((mixture, count))
        if fresh_of is not None:
            chosen = fresh_of.at(rng.integers(len(fresh_of.location[0]), size=self._wide))
            tests = self._data.sizes["test"]
            fresh = fresh_specimens(self._sampler.population, chosen, tests, rng)
            drawn.append(self._sampler.points_of(fresh))
        x = np.concatenate(drawn)
        self.points = np.concatenate([self.points, x])
        likelihood = self._target.score(x)[1]
        self._log_likelihood = np.concatenate([self._log_likelihood, likelihood])
        draws = self._sampler.draws_at(x)
        log_tube = stats.norm.logpdf(draws.deviations).sum(axis=0)
        of_classes = [mean_density(draws, d) + log_tube for d in self._classes]
        self._of_classes = np.concatenate([self._of_classes, of_classes], axis=1)

    def _weigh(self, log_prior: Array) -> None:
        """Weights of all draws so far, as if from the mixture of all that they are from."""
        density = [np.log(n) + m.log_density(self.points) for m, n in self._mixtures]
        density += [np.log(self._wide) + row for row in self._of_classes]
        log_density = logsumexp(density, axis=0) - np.log(len(self.points))
        self.log_terms = self._log_likelihood + self._of_classes - log_density
        probability = np.exp(log_softmax(log_prior + logsumexp(self.log_terms, axis=1)))
        effective = [effective_sample_size(terms) for terms in self.log_terms]
        self.effective = np.where(probability < _IMPROBABLE, np.inf, effective)

    def _learned(self, log_terms: Array, rng: np.random.Generator) -> GaussianMixture:
        """A mixture like weighted draws, of which so few may count that they are evened out."""
        possible = np.isfinite(log_terms)
        points, log_terms = self.points[possible], log_terms[possible]
        dimension = points.shape[1]
        fraction = min(_FOR_SHAPE * dimension / len(points), 0.5)
        evened = largest_step(log_terms, fraction, 1.0) * log_terms
        weights = np.exp(evened - evened.max())
        chosen = points[systematic(weights, _LEARNED_FROM, rng)]
        components = components_for(effective_sample_size(evened), dimension)
        return GaussianMixture.fit(chosen, components, rng).widened(_WIDER, _FREEDOM)


def _best_of_prior(target: SpecimenTarget, count: int, rng: np.random.Generator) -> Array:
    """The best of so many points of the prior."""
    points = target.draw_prior(count, rng)
    return points[[np.argmax(np.add(*target.score(points)))]]


def _moments(distributions: ClassDistribution, tests: int) -> tuple[Array, Array]:
    """Means (draw, entry) and covariances of the specimens of each distribution, as points."""
    location = np.asarray(distributions.location)[..., 0].T
    covariance = distributions.covariance()
    if distributions.experiment_spread is not None:
        location = np.repeat(location, tests, axis=1)
        within = distributions.variance_of_tests()
        alike, own = np.ones((tests, tests)), np.eye(tests)
        of_tests = within[:, :, None] * np.eye(within.shape[1])
        covariance = np.kron(covariance, alike) + np.kron(of_tests, own)
    if distributions.log_size is None:
        return location, covariance
    noise, spread = (
        np.stack([np.ravel(x) for x in values], axis=1)
        for values in (distributions.log_size, distributions.noise_spread)
    )
    return np.concatenate([location, noise], axis=1), _and_independent(covariance, spread**2)


def _and_independent(matrices: Array, more: Array) -> Array:
    """Matrices (draw, entry, entry), continued by so much (draw, entry) on their diagonals."""
    size = matrices.shape[1]
    continued = np.pad(matrices, [(0, 0), (0, more.shape[1]), (0, more.shape[1])])
    places = np.arange(size, size + more.shape[1])
    continued[:, places, places] = more
    return continued


def _around(target: SpecimenTarget, top: Summits, known: KnownClass) -> GaussianMixture:
    """A specimen of normal distributions, whose standard errors are linear around a point.

    Of a distribution ``N(m, P⁻¹)`` and a log likelihood with the slope ``g`` and the curvature
    ``H`` at ``x`` it is ``N(V (P m + H x + g), V)`` with ``V = (P + H)⁻¹``.
    """
    (x,), (width,) = top.points, top.widths
    rise = target.ascent(top.widths)(top.points)
    curvature = np.asarray(rise.curvature)[0] - np.diag(target.prior_width**-2.0)
    steps = np.diag(_STEP * width)
    of_prior = (target.log_prior(x + steps) - target.log_prior(x - steps)) / (2 * _STEP * width)
    pull = curvature @ x + rise.slope[0] - of_prior
    means, precisions = known.means, known.precisions
    after = np.linalg.inv(precisions + curvature)
    pulled = (precisions @ means[..., None])[..., 0]
    middle = (after @ (pulled + pull)[..., None])[..., 0]
    log_volume = (np.linalg.slogdet(precisions)[1] + np.linalg.slogdet(after)[1]) / 2
    log_weight = (
        log_volume
        + np.sum(middle * (pulled + pull), axis=1) / 2
        - np.sum(means * pulled, axis=1) / 2
    )
    most = np.argsort(-log_weight)[:_COMPONENTS]
    roots = np.linalg.cholesky(after[most])
    mixture = GaussianMixture(log_softmax(log_weight[most]), middle[most], roots)
    return mixture.widened(_WIDER, _FREEDOM)
