"""Slopes that particles follow, and the path on which they are led."""

import numpy as np
import pymc as pm
import pytest
from pytensor.graph.basic import Apply
from pytensor.graph.op import Op
from scipy import stats
from scipy.differentiate import jacobian
from scipy.optimize import approx_fprime

import pymc_hyperelastic as ph
from pymc_hyperelastic.evidence.mixture import GaussianMixture
from pymc_hyperelastic.evidence.modes import modes_from
from pymc_hyperelastic.evidence.reference import Reference
from pymc_hyperelastic.evidence.search import find_reference
from pymc_hyperelastic.evidence.target import Target

SEED = 20250
# Of differences with a step of 1e-6, relative to slopes of order one.
DIFFERENCE_TOLERANCE = 1e-4


class Doubled(Op):
    """Twice a vector, of which nothing else is known."""

    def make_node(self, x):
        return Apply(self, [x], [x.type()])

    def perform(self, node, inputs, outputs):
        outputs[0][0] = 2 * inputs[0]


def mixture(freedom=np.inf):
    """Two components of unequal weight, width and direction."""
    factors = np.array([[[1.0, 0.0], [0.5, 0.3]], [[0.2, 0.0], [-0.4, 0.7]]])
    means = np.array([[0.0, 1.0], [2.0, -1.0]])
    return GaussianMixture(np.log([0.3, 0.7]), means, factors, freedom)


def model(coefficients=6):
    """A regression with positive noise, in six coefficients or as many as are asked for."""
    rng = np.random.default_rng(SEED)
    design = rng.normal(size=(20, coefficients))
    with pm.Model() as model:
        slope = pm.Normal("slope", 0, 2, shape=coefficients)
        sigma = pm.HalfNormal("sigma", 1)
        pm.Normal("y", design @ slope, sigma, observed=design.sum(axis=1) + rng.normal(size=20))
    return model


@pytest.mark.parametrize("freedom", [np.inf, 3.0])
def test_slope_of_a_mixture(freedom):
    """It is that of the log density, by differences."""
    points = np.random.default_rng(SEED).normal(0, 2, (5, 2))
    value, slope = mixture(freedom).slope(points)
    np.testing.assert_allclose(value, mixture(freedom).log_density(points))
    for point, of_point in zip(points, slope, strict=True):
        expected = approx_fprime(point, lambda x: mixture(freedom).log_density(x[None])[0], 1e-6)
        np.testing.assert_allclose(of_point, expected, atol=DIFFERENCE_TOLERANCE)


def test_slopes_of_a_model():
    """Compiled slopes of prior and likelihood are those by differences of their sum."""
    target = Target(model())
    points = np.random.default_rng(SEED).normal(0, 0.5, (4, 7))
    assert target.has_slopes
    value, slope, _ = target.ascent(np.ones(7))(points)
    np.testing.assert_allclose(value, sum(target.score(points)))

    def height(columns):
        return sum(target.score(columns.reshape(7, -1).T)).reshape(columns.shape[1:])

    expected = [jacobian(height, point).df for point in points]
    np.testing.assert_allclose(slope, expected, rtol=1e-5, atol=1e-5)


def test_slope_of_a_reference():
    """It is that of the prior and the mixture in their shares."""
    prior = stats.norm(0, 3)
    reference = Reference(mixture(4.0), 0.2)

    def log_density(points):
        return reference.log_density(points, prior.logpdf(points).sum(axis=1))

    points = np.random.default_rng(SEED).normal(0, 2, (5, 2))
    value, slope = reference.slope(points, prior.logpdf(points).sum(axis=1), -points / 9)
    np.testing.assert_allclose(value, log_density(points))
    for point, of_point in zip(points, slope, strict=True):
        expected = approx_fprime(point, lambda x: log_density(x[None])[0], 1e-6)
        np.testing.assert_allclose(of_point, expected, atol=DIFFERENCE_TOLERANCE)


def test_few_unknowns_are_climbed_by_differences():
    """Slopes would take longer to compile; a mode a millionth as wide is found and measured."""
    with pm.Model() as narrow:
        x = pm.Normal("x", 0, 1, shape=2)
        pm.Normal("y", x, 1e-6, observed=[0.3, -0.2])
    target = Target(narrow)
    assert not target.has_slopes
    starts = np.random.default_rng(SEED).standard_normal((3, 2))
    modes = modes_from(target.ascent, [starts], np.ones(2))
    np.testing.assert_allclose(modes.mixture.means, [[0.3, -0.2]], atol=1e-7)
    exact = stats.norm(0, np.hypot(1, 1e-6)).logpdf([0.3, -0.2]).sum()
    assert modes.log_masses[0] == pytest.approx(exact, abs=0.05)


def test_a_density_without_bound_has_no_mode():
    """Climbs of a hierarchy whose spread goes to zero are given up, and a reference is found."""
    with pm.Model() as hierarchy:
        spread = pm.HalfNormal("spread", 1)
        x = pm.Normal("x", 0, spread, shape=8)
        pm.Normal("y", x, 2.0, observed=np.linspace(-1, 1, 8))
    found = find_reference(Target(hierarchy), np.random.default_rng(SEED))
    assert found.log_masses.size == 0
    assert np.isinf(found.at_modes.standard_error) and np.isinf(found.at_modes_k)
    assert np.all(np.isfinite(found.reference.mixture.means))


def test_a_model_without_slopes_is_sampled_by_walks():
    """Operations without a gradient are no obstacle to an exact evidence."""
    measured = np.arange(6.0)
    with pm.Model() as model:
        x = pm.Normal("x", 0, 1, shape=6)
        pm.Normal("y", Doubled()(x), 1.0, observed=measured)
    assert not Target(model).has_slopes
    value, error = ph.log_evidence(
        ph.sample_smc(model, 500, 2, random_seed=SEED, progressbar=False)
    )
    exact = stats.norm(0, np.sqrt(5)).logpdf(measured).sum()
    assert abs(value - exact) < 3 * error < 0.3


def test_one_unknown_whose_density_is_costly_is_searched():
    """Points can be scored one at a time only, and there are few to stand out."""
    with pm.Model() as model:
        x = pm.Normal("x", 0, 1)
        pm.Normal("y", x, 1.0, observed=np.random.default_rng(SEED).normal(0.3, 1.0, 100_000))
    target = Target(model)
    assert target.at_once <= 2
    found = find_reference(target, np.random.default_rng(SEED))
    assert len(found.log_masses) == 1
