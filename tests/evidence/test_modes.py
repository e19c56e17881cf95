"""Modes of a posterior: maximisation of many points together, Laplace masses, and the search."""

import numpy as np
import pymc as pm
import pytest
from agreement import assert_agrees
from scipy import stats
from scipy.optimize import least_squares, minimize
from scipy.special import logsumexp, softmax

from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.mixture import GaussianMixture
from pymc_hyperelastic.evidence.modes import (
    find_modes,
    starting_points,
)
from pymc_hyperelastic.evidence.optimise import maximize_batch
from pymc_hyperelastic.evidence.search import find_reference
from pymc_hyperelastic.evidence.target import (
    Derivatives,
    Target,
    finite_differences,
    gradient_by_differences,
    width_of,
    with_curvature,
)

SEED = 20261124
# Maximisation ends a twentieth of a posterior sd from the maximum: errors of a density, in nats.
NATS = 0.01


def residuals(points):
    """Return standardised errors whose squares make Rosenbrock's valley in six variables."""
    x, y = points[:, ::2], points[:, 1::2]
    return np.concatenate([20 * (y - x**2), 2 * (1 - x), points / 10], axis=1)


def height_of(points):
    return -np.square(residuals(points)).sum(axis=1) / 2


def without_prior(log_density):
    """Return a score, whose likelihood is 1."""
    return lambda points: (log_density(points), np.zeros(len(points)))


def valley(units=1.0, *, curvature):
    """Return the gradient of the valley, with Gauss-Newton curvatures or without curvatures."""

    def derivatives(points, width):
        score = without_prior(height_of)
        plain = gradient_by_differences(score)(points / units, width / units)
        stencil, difference = finite_differences(points / units, width / units)
        errors = difference(residuals(stencil.reshape(-1, 6)).reshape(*stencil.shape[:2], -1))
        known = errors @ errors.mT / np.outer(units, units) if curvature else None
        return Derivatives(plain.log_density, plain.gradient / units, known)

    return derivatives


@pytest.mark.parametrize("curvature", [True, False])
def test_every_start_reaches_the_maximum_of_a_bent_valley(curvature):
    """SciPy finds the same maximum; the result does not depend on units or on other starts."""
    starts = np.random.default_rng(SEED).normal(0, 1, (6, 6))
    exact = least_squares(lambda x: residuals(x[None])[0], np.ones(6), xtol=1e-12)
    found = maximize_batch(valley(curvature=curvature), starts, np.ones(6))
    np.testing.assert_allclose(found.log_densities, height_of(exact.x[None])[0], atol=NATS)
    np.testing.assert_allclose(found.log_densities, height_of(found.points))
    alone = maximize_batch(valley(curvature=curvature), starts[:1], np.ones(6))
    np.testing.assert_allclose(alone.points, found.points[:1], rtol=1e-6)
    sds = np.sqrt(np.diagonal(np.linalg.inv(exact.jac.T @ exact.jac + np.eye(6))))
    # Curvatures that are learned from gradients are rough.
    assert curvature or np.all(np.abs(np.log(np.median(found.widths, axis=0) / sds)) < 0.5)
    if curvature:
        np.testing.assert_allclose(found.widths, np.broadcast_to(sds, (6, 6)), rtol=0.02)
        units = 10.0 ** np.arange(-3, 3)
        scaled = maximize_batch(valley(units, curvature=True), starts * units, units)
        np.testing.assert_allclose(scaled.log_densities, found.log_densities, atol=NATS)
        np.testing.assert_allclose(scaled.widths / units, found.widths, rtol=0.02)


def test_start_in_a_heavy_tail_reaches_the_maximum():
    """The curvature of a Student density is negative there."""

    def log_density(points):
        return -2 * np.log1p(np.square(points - 3).sum(axis=1) / 4)

    starts = np.array([[-9.0, 4.0, 0.0], [30.0, 20.0, -40.0], [3.0, 3.0, 3.0]])
    score = without_prior(log_density)
    found = maximize_batch(gradient_by_differences(score), starts, np.ones(3))
    exact = minimize(lambda x: -log_density(x[None])[0], np.zeros(3)).x
    # The sd at the maximum is 1; maximisation ends within a twentieth of it.
    np.testing.assert_allclose(found.points, np.tile(exact, (3, 1)), atol=0.1)


def test_start_of_zero_density_stays_and_steps_to_zero_density_are_shortened():
    def log_density(points):
        x = points[:, 0]
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(x > 0, np.log(x) - 5 * x, -np.inf)

    starts = np.array([[-1.0], [2.0], [1e-3]])
    score = without_prior(log_density)
    found = maximize_batch(gradient_by_differences(score), starts, np.ones(1))
    assert found.log_densities[0] == -np.inf and found.points[0] == -1.0
    np.testing.assert_allclose(found.points[1:], 0.2, atol=0.02)


def normal_modes(shares, centres, covariances):
    """Return a score of normal modes under a wide normal prior, and the posterior mixture."""
    prior = 4.0**2 * np.eye(len(centres[0]))
    parts = [stats.multivariate_normal(*of) for of in zip(centres, covariances, strict=True)]

    def score(points):
        terms = [
            np.log(w) + np.atleast_1d(p.logpdf(points)) for w, p in zip(shares, parts, strict=True)
        ]
        return stats.norm(0, 4).logpdf(points).sum(axis=1), logsumexp(terms, axis=0)

    inverses = np.linalg.inv(covariances)
    posterior = np.linalg.inv(inverses + np.linalg.inv(prior))
    means = (posterior @ inverses @ np.array(centres)[..., None])[..., 0]
    marginals = (stats.multivariate_normal(cov=prior + c).logpdf for c in covariances)
    masses = np.log(shares) + [logpdf(c) for logpdf, c in zip(marginals, centres, strict=True)]
    return score, means, posterior, masses


@pytest.mark.parametrize(
    ("shares", "centres", "covariances"),
    [
        ([1.0], [[1.0, -2.0, 0.5]], [[[0.04, 0.03, 0], [0.03, 0.09, -0.02], [0, -0.02, 0.01]]]),
        ([0.002, 0.998], [[-3.0, 2.0], [4.0, 1.0]], [0.09 * np.eye(2), 1e-4 * np.eye(2)]),
        ([1.0], [[0.3, -0.2]], [1e-12 * np.eye(2)]),
    ],
    ids=["correlated mode", "modes of different mass", "very narrow mode"],
)
def test_modes_of_normal_densities_have_exact_means_covariances_and_masses(
    shares, centres, covariances
):
    """Cases include a mode a millionth as wide as the prior, with starts a thousand sds away."""
    score, means, posterior, masses = normal_modes(shares, centres, covariances)
    rng = np.random.default_rng(SEED)
    starts = np.concatenate([rng.normal(centre, 1e-3, (4, len(centre))) for centre in centres])
    width = np.full(len(means[0]), 4.0)
    found = find_modes(gradient_by_differences(score), [starts], width)
    order = np.argsort(found.mixture.means[:, 0])
    sds = np.sqrt(np.diagonal(posterior, axis1=1, axis2=2))
    assert len(found.log_masses) == len(means)
    np.testing.assert_array_less(np.abs(found.mixture.means[order] - means) / sds, 0.06)
    np.testing.assert_allclose(found.log_masses[order], masses, atol=0.03)
    np.testing.assert_allclose(np.exp(found.mixture.log_weights[order]), softmax(masses), rtol=0.03)
    np.testing.assert_allclose(found.mixture.covariances[order], posterior, rtol=0.02, atol=1e-4)


def test_unbounded_density_has_no_mode():
    """The density of a hierarchy grows without bound where the spread goes to zero."""

    def log_density(points):
        log_spread, x = points[:, :1], points[:, 1:]
        likelihood = stats.norm.logpdf(x, np.linspace(-1, 1, 3), 2.0).sum(axis=1)
        of_spread = stats.halfnorm.logpdf(np.exp(log_spread[:, 0])) + log_spread[:, 0]
        return stats.norm.logpdf(x, 0, np.exp(log_spread)).sum(axis=1) + of_spread + likelihood

    starts, score = np.random.default_rng(SEED).normal(size=(8, 4)), without_prior(log_density)
    with np.errstate(all="ignore"):
        assert find_modes(gradient_by_differences(score), [starts], np.ones(4)) is None


def test_narrow_mode_at_a_discontinuity_is_found_beside_a_wide_mode():
    """A narrow peak where the first coordinate is below -1, up to which the density rises."""
    mean, sd, rise = np.array([0.0, 0.5, -0.3, 0.8, 0.1]), np.array([1.0] + 4 * [0.02]), 2.0
    narrow_log_norm = stats.norm(0, sd[1:]).logpdf(0).sum()

    def derivatives(points, width):
        inside, z = points[:, :1] < -1, (points - mean) / sd
        z[:, 0] = 0
        value = np.where(
            inside[:, 0],
            narrow_log_norm - (z**2).sum(axis=1) / 2 + rise * (points[:, 0] + 1),
            stats.norm.logpdf(points).sum(axis=1),
        )
        return Derivatives(value, np.where(inside, rise * np.eye(5)[0] - z / sd, -points))

    starts = np.random.default_rng(SEED).normal(size=(20, 5))
    found = find_modes(derivatives, [starts[:10], starts[10:]], np.ones(5))
    exact = np.array([-np.log(rise), 0.0])
    # At an edge the normal density of Laplace's approximation has the tail of an exponential one.
    np.testing.assert_allclose(np.sort(found.log_masses), np.sort(exact), atol=1.0)
    edge = found.mixture.means[np.argmin(found.mixture.means[:, 0])]
    np.testing.assert_allclose(edge, [-1.0, *mean[1:]], atol=sd[1] / 10)


def test_starting_points_are_far_apart_in_the_better_half_and_in_all_draws():
    """The first start is the best draw; each later start is the farthest from all before it."""
    rng = np.random.default_rng(SEED)
    points = rng.normal(0, [1.0, 100.0], (400, 2))
    score = stats.norm(0, [1.0, 100.0]).logpdf(points).sum(axis=1)
    groups = list(starting_points(points, score))
    assert [len(group) for group in groups] == [16, 16, 16, 16]
    chosen, width = np.concatenate(groups), width_of(points)
    # The quartiles of 400 points give an sd with a relative standard error of 6 %.
    np.testing.assert_allclose(width, [1.0, 100.0], rtol=0.15)
    better = points[score > np.median(score)]
    np.testing.assert_array_equal(chosen[0], points[score.argmax()])
    for count, pool in ((1, better), (20, points), (33, better), (63, points)):
        apart = ((pool[:, None] - chosen[:count]) / width) ** 2
        farthest = pool[apart.sum(axis=2).min(axis=1).argmax()]
        np.testing.assert_array_equal(chosen[count], farthest)


def test_modes_of_a_product_are_found_from_modes_of_one_factor():
    """Two normal modes, each times a narrow one some sds away."""
    rng = np.random.default_rng(SEED)
    factors = np.tril(rng.standard_normal((2, 3, 3))) + 2 * np.eye(3)
    means = np.array([[-40.0, 0.0, 5.0], [40.0, 1.0, -5.0]])
    known = GaussianMixture(np.log([0.5, 0.5]), means, factors)
    moved = means + 3 * rng.standard_normal((2, 3))
    narrow = GaussianMixture(np.log([0.2, 0.8]), moved, 0.3 * factors[::-1])

    def score(points):
        return known.log_density(points), narrow.log_density(points)

    width = np.sqrt(known.covariances[0].diagonal())
    found = find_modes(gradient_by_differences(score), [means], width).mixture
    precisions = np.linalg.inv(known.covariances), np.linalg.inv(narrow.covariances)
    covariances = np.linalg.inv(sum(precisions))
    pulled = sum(p @ m[..., None] for p, m in zip(precisions, (means, moved), strict=True))
    order = np.argsort(found.means[:, 0])
    np.testing.assert_allclose(found.means[order], (covariances @ pulled)[..., 0], atol=0.02)
    np.testing.assert_allclose(found.covariances[order], covariances, rtol=0.01, atol=1e-3)
    heights = np.add(*score(found.means[order])) + np.linalg.slogdet(covariances)[1] / 2
    np.testing.assert_allclose(np.exp(found.log_weights[order]), softmax(heights), atol=0.01)
    impossible = gradient_by_differences(lambda points: np.full((2, len(points)), -np.inf))
    assert find_modes(impossible, [means], width) is None


@pytest.mark.parametrize("gradients", [True, False])
def test_curvature_by_differences_of_gradients_is_exact_for_a_normal_density(gradients):
    """The normal density has a saddle; the curvature is exact up to rounding."""
    rng = np.random.default_rng(SEED)
    root = np.tril(rng.standard_normal((4, 4))) + 2 * np.eye(4)
    precision = np.linalg.inv(root @ root.T) - np.diag([0, 0, 0, 1.0])
    points, width = rng.standard_normal((3, 4)), np.array([1.0, 2.0, 0.5, 1.0])

    def log_density(x):
        return -np.einsum("ni,ij,nj->n", x, precision, x) / 2

    derivatives = gradient_by_differences(without_prior(log_density))
    if gradients:

        def derivatives(x, width):
            return Derivatives(log_density(x), -x @ precision)

    value, gradient, curvature = with_curvature(derivatives)(points, width)
    np.testing.assert_allclose(value, log_density(points))
    np.testing.assert_allclose(gradient, -points @ precision, atol=1e-9 if gradients else 1e-3)
    np.testing.assert_allclose(curvature, np.tile(precision, (3, 1, 1)), atol=1e-6)


def test_search_estimates_the_evidence_from_the_prior_and_from_the_modes():
    """A quarter of the prior is impossible; the posterior is normal, and lies in the other part."""
    with pm.Model() as model:
        x = pm.Normal("x", 0, 1, shape=2)
        pm.Normal("y", x, 0.1, observed=[1.0, -0.5])
        pm.Potential("cut", pm.math.switch(x[0] > -0.6745, 0.0, -np.inf))
    exact = stats.norm(0, np.hypot(1, 0.1)).logpdf([1.0, -0.5]).sum()
    found = find_reference(Target(model), np.random.default_rng(SEED))
    for name in ("forward", "at_modes"):
        estimate = Estimate(*(float(found.evidence[n]) for n in (name, f"{name}_se")))
        assert_agrees(estimate, exact, 0.125)
    np.testing.assert_allclose(found.evidence["log_masses"], [exact], atol=NATS)
    assert found.reference.prior_share == 0.1
