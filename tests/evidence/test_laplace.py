"""Laplace approximations about draws, against normal distributions and exact integrals."""

import numpy as np
import pytest
from scipy import stats
from scipy.special import logsumexp

from pymc_hyperelastic.evidence import integral
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.importance import Integral
from pymc_hyperelastic.evidence.integral import integrate
from pymc_hyperelastic.evidence.laplace import laplace_about
from pymc_hyperelastic.evidence.mixture import GaussianMixture
from pymc_hyperelastic.evidence.target import Rise, Target, differences

SEEDS = range(6)
# Of the root mean square of deviations over stated errors.
LARGEST_RMS = 1.6
LARGEST_ERROR = 0.06


class OfErrors(Target):
    """Unknowns of normal priors, and a likelihood that is a sum of squares of standard errors."""

    knows_curvature, has_slopes, at_once = True, False, 1000

    def __init__(self, errors, dimension, axes=None):
        self._errors, self.dimension = errors, dimension
        self._axes = np.eye(dimension) if axes is None else axes
        self.effort, self.most_effort = 0.0, np.inf

    def draw_prior(self, count, rng):
        return rng.standard_normal((count, self.dimension))

    def score(self, points):
        prior = stats.norm.logpdf(points).sum(axis=1)
        return prior, -np.square(self._errors(points @ self._axes)).sum(axis=1) / 2

    def ascent(self, width):
        def slope(points):
            around, change = differences(points, width)
            flat = around.reshape(-1, self.dimension)
            heights = np.add(*self.score(flat)).reshape(len(points), -1)
            errors = change(self._errors(flat @ self._axes).reshape(*around.shape[:2], -1))
            curvature = errors @ errors.mT + np.eye(self.dimension)
            return Rise(heights[:, 0], change(heights), curvature)

        return slope


def sharing(load, error):
    """Of two fibres the sum is known, by logarithms: either may bear nothing."""

    def errors(points):
        pairs = np.exp(points.reshape(len(points), -1, 2)).sum(axis=2)
        return (pairs - load) / error

    return errors


def stiffening(points):
    """A curve that a modulus and an exponent share, which says less the smaller either is."""
    modulus, exponent = np.exp(points[:, :1]), np.exp(points[:, 1:])
    strain = np.linspace(0.1, 0.8, 6)
    return (modulus * strain * np.exp(exponent * strain**2) - 0.8 * strain) / 0.02


def bounded(sign):
    """One unknown is above or below a bound that another one sets, and else free."""

    def errors(points):
        x, y = points.T
        return np.logaddexp(0, sign * 4 * (y - x))[:, None] * 2

    return errors


def exact(errors):
    """Logarithm of the integral over two unknowns, by the trapezoidal rule."""
    x = np.linspace(-7, 7, 5000)
    with np.errstate(over="ignore"):
        parts = []
        for some in np.array_split(x, 100):
            points = np.stack(np.meshgrid(some, x), axis=-1).reshape(-1, 2)
            prior = stats.norm.logpdf(points).sum(axis=1)
            parts.append(logsumexp(prior - np.square(errors(points)).sum(axis=1) / 2))
    return logsumexp(parts) + 2 * np.log(x[1] - x[0])


def check(target, truth):
    """Integrals from several seeds have it, and know their errors."""
    found = [integrate(target, 1000, np.random.default_rng(seed)) for seed in SEEDS]
    values, errors = np.array([f.log_value for f in found]).T
    assert all(f.method == "importance" and f.known for f in found)
    assert errors.max() < LARGEST_ERROR
    assert np.sqrt(np.mean(((values - truth) / errors) ** 2)) < LARGEST_RMS


@pytest.mark.parametrize(
    "errors",
    [
        pytest.param(sharing(2.0, 0.02), id="shared"),
        pytest.param(sharing(0.3, 0.02), id="both small"),
        pytest.param(sharing(8.0, 0.5), id="both large"),
        pytest.param(stiffening, id="stiffening"),
        pytest.param(bounded(1), id="above"),
        pytest.param(bounded(-1), id="below"),
    ],
)
def test_two_unknowns(errors):
    check(OfErrors(errors, 2), exact(errors))


def turned():
    """Axes of eight unknowns, none of which is one of the unknowns."""
    return np.linalg.qr(np.random.default_rng(3).standard_normal((8, 8)))[0]


@pytest.mark.parametrize("load", [0.5, pytest.param(1.0, marks=pytest.mark.deep)])
def test_arms_in_all_directions(load):
    """Of eight unknowns in pairs that are turned: either one of each pair may bear nothing."""
    errors = sharing(load, 0.05)
    check(OfErrors(errors, 8, turned()), 4 * exact(errors))


@pytest.mark.deep
def test_arms_too_thin_to_be_found():
    """What has not been found is not known, by either way: the particles are stuck."""
    target = OfErrors(sharing(3.0, 0.05), 8, turned())
    for seed in SEEDS[:3]:
        found = integrate(target, 1000, np.random.default_rng(seed))
        assert found.log_value.standard_error == np.inf


def test_a_normal_distribution_is_its_own_mixture():
    """At draws whose covariance is that of the distribution the mixture has it as well."""
    rng = np.random.default_rng(1)
    place, root = np.array([1.0, -2.0, 0.5]), np.array([[1, 0, 0], [0.9, 0.1, 0], [0.3, -0.2, 2]])
    covariance = root @ root.T
    draws = rng.standard_normal((50, 3))
    draws -= draws.mean(axis=0)
    standard = np.linalg.solve(np.linalg.cholesky(np.cov(draws.T, ddof=0)), draws.T)
    points = place + (root @ standard).T

    def ascent(width):
        def slope(points):
            pull = -np.linalg.solve(covariance, (points - place).T).T
            curvature = np.broadcast_to(np.linalg.inv(covariance), (len(points), 3, 3))
            return Rise(np.zeros(len(points)), pull, curvature.copy())

        return slope

    mixture = laplace_about(ascent, points, covariance)
    spread = np.cov(mixture.means.T, ddof=0) + mixture.covariances.mean(axis=0)
    np.testing.assert_allclose(mixture.means.mean(axis=0), place, atol=1e-12)
    np.testing.assert_allclose(spread, covariance, rtol=1e-9)


def test_what_overflows_is_as_wide_as_all_draws():
    """A curvature that is no number spoils no other one."""
    points = np.zeros((2, 2))

    def ascent(width):
        def slope(points):
            curvature = np.array([np.eye(2), np.full((2, 2), np.inf)])
            return Rise(np.zeros(2), np.array([[0.0, 0.0], [np.inf, 0.0]]), curvature)

        return slope

    mixture = laplace_about(ascent, points, np.eye(2))
    assert isinstance(mixture, GaussianMixture)
    narrow, wide = mixture.covariances
    np.testing.assert_allclose(narrow, 0.8 * np.eye(2))
    assert np.all(np.diagonal(wide) > 3.9)
    np.testing.assert_array_equal(mixture.means, points)


def test_many_unknowns_are_not_adapted(monkeypatch):
    """Of more than two dozen no draw is like the posterior, however much is known of curvatures."""

    def known(*args, **settings):
        return Integral(Estimate(0.0, 0.1), 0.1, "importance", np.zeros((1, 26)))

    monkeypatch.setattr(integral, "by_importance", known)
    found = integrate(OfErrors(sharing(1.0, 0.1), 26), 10, np.random.default_rng(1))
    assert found.log_value == (0.0, 0.1)
