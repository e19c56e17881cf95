"""Evidences of one specimen under several classes from few draws, for very many specimens."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.special import log_softmax, logsumexp

from pymc_hyperelastic.classes.specimen_evidence import near_class
from pymc_hyperelastic.classes.specimen_target import SpecimenTarget
from pymc_hyperelastic.classes.specimens import SpecimenSampler, one_draw
from pymc_hyperelastic.evidence.mixture import GaussianMixture
from pymc_hyperelastic.evidence.optimise import Maxima, maximize_batch
from pymc_hyperelastic.evidence.path import Reference
from pymc_hyperelastic.evidence.proposal import expectation_maximisation
from pymc_hyperelastic.evidence.weights import effective_sample_size, largest_step
from pymc_hyperelastic.models.class_distribution import ClassDistribution

Array = NDArray[np.float64]

# Share of the draws of a class's proposal that are from the class itself.
_OF_CLASS = 0.25
# Components of a proposal, at most.
_COMPONENTS = 60
# Factor by which the variances of a fitted proposal are enlarged.
_WIDER = 1.2
# Degrees of freedom of a proposal.
_FREEDOM = 6.0
# Fraction of the draws of a class that are to be effective.
_EFFECTIVE = 0.25
# Probability of a class below which it does not matter how many are.
_IMPROBABLE = 1e-3
# Rounds of fresh draws, at most; a proposal that was not good enough gets twice as many draws.
_MOST_ROUNDS = 3
# Effective draws to which a proposal is fitted, for each dimension.
_FOR_SHAPE = 4
# Largest fraction of the draws that is to be effective for such a fit.
_MOST_FOR_SHAPE = 0.5
# Draws of the prior for each draw of a proposal, of which the best is a starting point.
_DRAWS_OF_PRIOR = 20
# Step of central differences of a prior, in widths of the posterior.
_STEP = 1e-2


class KnownClass(NamedTuple):
    """A class, and its specimens with some number of tests as a mixture of normal distributions."""

    distributions: ClassDistribution
    near: ClassDistribution
    """A single distribution like those of the class, and wider."""
    means: Array
    """Means of points of the target, (draw, entry)."""
    precisions: Array
    """Inverses of the covariances."""


def known_class(distributions: ClassDistribution, tests: int, measures: int) -> KnownClass:
    """Return a class of specimens with a number of tests and of inferred measures of the tube."""
    means, covariances = _moments(distributions, tests)
    # The deviations of the tube come last, and are standard normal.
    tube = np.ones((len(means), measures))
    precisions = _and_independent(np.linalg.inv(covariances), tube)
    means = np.pad(means, [(0, 0), (0, measures)])
    return KnownClass(distributions, near_class(distributions), means, precisions)


class FewDraws:
    """Draws of what a specimen may be, and their weights under each class.

    The proposal of a class is a mixture of the class itself and of its posterior under the
    assumption that the tests' standard errors are linear around the best specimen. The class is a
    mixture of normal distributions, and so is this posterior. All draws count for all classes, as
    draws of the mixture of all proposals. For classes of which too few are effective, proposals are
    fitted to the draws; these are then dropped, and fresh ones are made of all proposals.

    Attributes
    ----------
    points : array, shape (draw, entry)
        Points of the sampler's target.
    log_terms : array, shape (class, draw)
        Logarithms of likelihood and density under the class, by the density of the draws: their
        means are the evidences.
    effective : array, shape (class)
        Effective draws of each class; infinite where it is too improbable to matter.
    proposals : list of Reference
        Of the classes.

    References
    ----------
    E. Veach and L. J. Guibas, Optimally combining sampling techniques for Monte Carlo rendering,
    SIGGRAPH 95 (1995) 419.
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
        tests = data.sizes["test"]
        self._target, self._log_prior = sampler.target(data), log_prior
        self._priors = [sampler.prior(known.distributions, tests) for known in classes]
        self.proposals, counts = [], np.full(len(classes), count)
        for known in classes:
            target = sampler.target(data, sampler.prior(one_draw(known.near), tests))
            starts = start
            if starts is None:
                starts = _best_of_prior(target, _DRAWS_OF_PRIOR * count, rng)
            top = maximize_batch(target.derivatives, starts, target.prior_width)
            self.proposals.append(Reference(_around(target, top, known), _OF_CLASS))
        for _ in range(1 + _MOST_ROUNDS):
            self._draw(counts, rng)
            lacking = np.flatnonzero(self.effective < _EFFECTIVE * count)
            if not lacking.size:
                break
            counts[lacking] *= 2
            for k in lacking.tolist():
                self.proposals[k] = Reference(self._fitted(k, rng), _OF_CLASS)

    def _draw(self, counts: Array, rng: np.random.Generator) -> None:
        """Draw points of all proposals, and weight them for each class."""
        drawn = zip(self.proposals, self._priors, counts, strict=True)
        self.points = np.concatenate([q.draw(prior.draw, n, rng) for q, prior, n in drawn])
        of_classes = np.stack([prior.log_density(self.points) for prior in self._priors])
        density = [
            np.log(n) + q.log_density(self.points, own)
            for q, own, n in zip(self.proposals, of_classes, counts, strict=True)
        ]
        log_proposal = logsumexp(density, axis=0) - np.log(len(self.points))
        self.log_terms = self._target.score(self.points)[1] + of_classes - log_proposal
        probability = np.exp(log_softmax(self._log_prior + logsumexp(self.log_terms, axis=1)))
        effective = [effective_sample_size(terms) for terms in self.log_terms]
        self.effective = np.where(probability < _IMPROBABLE, np.inf, effective)

    def _fitted(self, k: int, rng: np.random.Generator) -> GaussianMixture:
        """Fit a mixture to draws weighted for one class, tempered until enough are effective."""
        possible = np.isfinite(self.log_terms[k])
        points, log_terms = self.points[possible], self.log_terms[k, possible]
        fraction = min(_FOR_SHAPE * points.shape[1] / len(points), _MOST_FOR_SHAPE)
        tempered = largest_step(log_terms, fraction, 1.0) * log_terms
        current = self.proposals[k].mixture
        fitted = expectation_maximisation(points, tempered, rng, current)
        return fitted.widened(_WIDER, _FREEDOM)


def _best_of_prior(target: SpecimenTarget, count: int, rng: np.random.Generator) -> Array:
    """Return the best of `count` points of the prior."""
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
    """Return matrices (draw, entry, entry) with more entries (draw, entry) on their diagonals."""
    size = matrices.shape[1]
    continued = np.pad(matrices, [(0, 0), (0, more.shape[1]), (0, more.shape[1])])
    places = np.arange(size, size + more.shape[1])
    continued[:, places, places] = more
    return continued


def _around(target: SpecimenTarget, top: Maxima, known: KnownClass) -> GaussianMixture:
    """Return the posterior of a specimen whose standard errors are linear around a point.

    For a prior ``N(m, P⁻¹)`` and a log likelihood with the gradient ``g`` and the curvature ``H``
    at ``x`` the posterior is ``N(V (P m + H x + g), V)`` with ``V = (P + H)⁻¹``.
    """
    (x,), (width,) = top.points, top.widths
    _, (gradient,), curvatures = target.derivatives(top.points, top.widths)
    curvature = np.asarray(curvatures)[0] - np.diag(target.prior_width**-2.0)
    steps, log_prior = np.diag(_STEP * width), target.prior.log_density
    of_prior = (log_prior(x + steps) - log_prior(x - steps)) / (2 * _STEP * width)
    pull = curvature @ x + gradient - of_prior
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
