"""Estimate the evidences of one specimen under several classes by cheap importance sampling.

:mod:`~pymc_hyperelastic.design.trials` needs them for thousands of simulated specimens. The method
is multiple importance sampling with the balance heuristic (Veach and Guibas 1995).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.special import log_softmax, logsumexp, softmax

from pymc_hyperelastic.classes.interface import NEGLIGIBLE
from pymc_hyperelastic.classes.reference import near_class, one_draw
from pymc_hyperelastic.classes.specimen_target import SpecimenTarget
from pymc_hyperelastic.classes.specimens import SpecimenSampler
from pymc_hyperelastic.evidence.mixture import GaussianMixture
from pymc_hyperelastic.evidence.optimise import Maxima, maximize_batch
from pymc_hyperelastic.evidence.path import Reference
from pymc_hyperelastic.evidence.proposal import expectation_maximisation
from pymc_hyperelastic.evidence.target import gradient_by_differences
from pymc_hyperelastic.evidence.weights import effective_sample_size, largest_step
from pymc_hyperelastic.models.class_distribution import ClassDistribution

Array = NDArray[np.float64]

# Fraction of a class's draws that must be effective, and to which a proposal is fitted.
_EFFECTIVE = 0.25


class KnownClass(NamedTuple):
    """A class, and the normal mixture of its specimens, with one component per draw."""

    distributions: ClassDistribution
    near: ClassDistribution
    """Single distribution that is similar to those of the class, but wider."""
    means: Array
    """Means of the components in the coordinates of the target, (draw, entry)."""
    precisions: Array
    """Inverse covariances of the components, (draw, entry, entry)."""


def known_class(distributions: ClassDistribution, tests: int, measures: int) -> KnownClass:
    """Return a class as a normal mixture of its specimens.

    `tests` is the number of tests of each specimen, and `measures` the number of inferred measures
    of its tube.
    """
    means, covariances = _moments(distributions, tests)
    # The last entries are the deviations of the tube, which are standard normal.
    tube = np.ones((len(means), measures))
    precisions = _and_independent(np.linalg.inv(covariances), tube)
    means = np.pad(means, [(0, 0), (0, measures)])
    return KnownClass(distributions, near_class(distributions), means, precisions)


class FewDraws:
    """Draws of a specimen's coordinates, and their importance weights under each class.

    The proposal of a class mixes the class with its posterior for a linearised model: the
    standardised residuals of the tests are linear around the best specimen. The class is a mixture
    of normal distributions, and so is this posterior. The evidence of each class uses the draws of
    all proposals, weighted by the density of the mixture of the proposals. If a class has too few
    effective draws, its proposal is fitted to the weighted draws, and the number of its draws is
    doubled; then all draws are replaced by new ones. This is repeated at most three times.

    Attributes
    ----------
    points : array, shape (draw, entry)
        Draws in the coordinates of the sampler's target.
    log_terms : array, shape (class, draw)
        Log importance weights: log likelihood, plus log density under the class, minus log density
        of the mixture of proposals. The mean of the weights is the evidence of the class.
    effective : array, shape (class,)
        Effective draws of each class; infinite if the class is too improbable to matter.
    proposals : list of Reference
        Proposals of the classes.

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
                starts = _best_of_prior(target, count, rng)
            top = maximize_batch(target.derivatives, starts, target.prior_width)
            self.proposals.append(Reference(_around(target, top, known)))
        for _ in range(1 + 3):
            self._draw(counts, rng)
            lacking = np.flatnonzero(self.effective < _EFFECTIVE * count)
            if not lacking.size:
                break
            counts[lacking] *= 2
            for k in lacking.tolist():
                self.proposals[k] = Reference(self._fitted(k, rng))

    def _draw(self, counts: Array, rng: np.random.Generator) -> None:
        """Draw points from all proposals, and compute their weights for each class."""
        drawn = zip(self.proposals, self._priors, counts, strict=True)
        self.points = np.concatenate([q.draw(prior.draw, n, rng) for q, prior, n in drawn])
        of_classes = np.stack([prior.log_density(self.points) for prior in self._priors])
        density = [
            np.log(n) + q.log_density(self.points, of_class)
            for q, of_class, n in zip(self.proposals, of_classes, counts, strict=True)
        ]
        log_proposal = logsumexp(density, axis=0) - np.log(len(self.points))
        self.log_terms = self._target.score(self.points)[1] + of_classes - log_proposal
        probability = np.exp(log_softmax(self._log_prior + logsumexp(self.log_terms, axis=1)))
        effective = [effective_sample_size(terms) for terms in self.log_terms]
        self.effective = np.where(probability < NEGLIGIBLE, np.inf, effective)

    def _fitted(self, k: int, rng: np.random.Generator) -> GaussianMixture:
        """Fit a mixture to the draws weighted for class `k`, tempered for enough effective ones."""
        possible = np.isfinite(self.log_terms[k])
        points, log_terms = self.points[possible], self.log_terms[k, possible]
        tempered = largest_step(log_terms, _EFFECTIVE, 1.0) * log_terms
        current = self.proposals[k].mixture
        return expectation_maximisation(points, tempered, rng, current).heavy_tailed()


def _best_of_prior(target: SpecimenTarget, count: int, rng: np.random.Generator) -> Array:
    """Return the draw with the largest posterior density of `count` draws of the prior."""
    points = target.draw_prior(count, rng)
    return points[[np.argmax(np.add(*target.score(points)))]]


def _moments(distributions: ClassDistribution, tests: int) -> tuple[Array, Array]:
    """Return means (draw, entry) and covariances of specimens for each draw of a distribution.

    The entries are the coordinates of the target: material, by test if tests differ, and noise.
    """
    location = np.asarray(distributions.location)[..., 0].T
    covariance = distributions.covariance()
    if distributions.experiment_spread is not None:
        location = np.repeat(location, tests, axis=1)
        within = distributions.variance_of_tests()
        shared, separate = np.ones((tests, tests)), np.eye(tests)
        of_tests = within[:, :, None] * np.eye(within.shape[1])
        covariance = np.kron(covariance, shared) + np.kron(of_tests, separate)
    if distributions.log_size is None:
        return location, covariance
    noise, spread = (
        np.stack([np.ravel(x) for x in values], axis=1)
        for values in (distributions.log_size, distributions.noise_spread)
    )
    return np.concatenate([location, noise], axis=1), _and_independent(covariance, spread**2)


def _and_independent(matrices: Array, more: Array) -> Array:
    """Extend matrices (draw, entry, entry) by further diagonal entries (draw, entry)."""
    size = matrices.shape[1]
    continued = np.pad(matrices, [(0, 0), (0, more.shape[1]), (0, more.shape[1])])
    places = np.arange(size, size + more.shape[1])
    continued[:, places, places] = more
    return continued


def _around(target: SpecimenTarget, top: Maxima, known: KnownClass) -> GaussianMixture:
    """Return the posterior of a specimen, for a log likelihood that is quadratic around a point.

    For a component ``N(m, P⁻¹)`` of the class, and a log likelihood with the gradient ``g`` and the
    negative Hessian ``H`` at ``x``, the posterior is ``N(V (P m + H x + g), V)`` with
    ``V = (P + H)⁻¹``. The result is a distribution with the mean and the covariance of the mixture
    of these posteriors.
    """

    def log_prior(points: Array) -> tuple[Array, Array]:
        return target.prior.log_density(points), np.zeros(len(points))

    _, (gradient,), curvatures = target.derivatives(top.points, top.widths)
    curvature = np.asarray(curvatures)[0] - np.diag(target.prior_width**-2.0)
    (of_prior,) = gradient_by_differences(log_prior)(top.points, top.widths).gradient
    pull = curvature @ top.points[0] + gradient - of_prior
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
    weight = softmax(log_weight)
    mean = weight @ middle
    covariance = np.tensordot(weight, after, 1) + (weight * (middle - mean).T) @ (middle - mean)
    root = np.linalg.cholesky(covariance)
    return GaussianMixture(np.zeros(1), mean[None], root[None]).heavy_tailed()
