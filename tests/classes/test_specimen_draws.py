"""Densities of the draws of specimens under class distributions, against SciPy."""

from dataclasses import replace

import numpy as np
import pymc as pm
import pytest
from scipy import stats
from scipy.special import logsumexp

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.distribution import ClassModel, units_of
from pymc_hyperelastic.evidence.batched import BatchedFunction
from pymc_hyperelastic.models import specimen_draws
from pymc_hyperelastic.models.class_distribution import ClassDistribution
from pymc_hyperelastic.models.population import Population
from pymc_hyperelastic.models.specimen_draws import SpecimenDraws, log_densities, log_density

SEED = 911
# Relative rounding error of sums of some hundred densities.
ROUNDING = 1e-9
# Nats: the stated error of five quadrature nodes, for several tests and for a single test.
QUADRATURE_TOLERANCE, SINGLE_TEST_TOLERANCE = 0.01, 0.1


def random_draws(rng, size, tests, count):
    """Draws of a specimen, and the coordinates of its tests, shape (draw, test, coordinate)."""
    x = 0.3 * rng.standard_normal((count, tests, size))
    centre = x.mean(axis=1)
    scatter = ((x - centre[:, None]) ** 2).sum(axis=1)
    noise, weight = rng.normal(-0.5, 0.3, (1, count)), rng.normal(0, 1, count)
    points, none = x.reshape(count, -1), np.empty((0, count))
    return SpecimenDraws(centre.T, scatter.T, noise, weight, tests, 0.01, points, none), x


def normal_factor(rng, size):
    """Lower Cholesky factor of a random correlation matrix."""
    root = rng.standard_normal((size, 2 * size))
    sd = np.linalg.norm(root, axis=1)
    return np.linalg.cholesky(root @ root.T / np.outer(sd, sd))


def dense_density(x, location, spread, factor, within=None, effect=None):
    """Return the log density of each draw: normal, and summed over the experiment effect."""
    tests, root = x.shape[1], np.diag(spread) @ factor
    between = np.kron(np.ones((tests, tests)), root @ root.T)
    mean, rows = np.tile(location, tests), x.reshape(len(x), -1)
    if within is None:
        return stats.multivariate_normal(mean, between).logpdf(rows)
    grid, own = np.linspace(-4, 4, 161), np.kron(np.eye(tests), np.diag(within**2))
    weight = stats.norm(0, effect).pdf(grid)[:, None] * (grid[1] - grid[0])
    covariances = [between + np.exp(2 * u) * own for u in grid]
    terms = [stats.multivariate_normal(mean, c).logpdf(rows) for c in covariances]
    return logsumexp(terms, axis=0, b=weight)


@pytest.mark.parametrize(("size", "tests"), [(1, 4), (3, 1), (3, 4)])
def test_density_of_several_tests_equals_the_joint_normal_density(size, tests):
    """Experiments differ, and the specimen's own coordinates are integrated out."""
    rng = np.random.default_rng(SEED)
    draws, x = random_draws(rng, size, tests, 5)
    location, spread = rng.normal(0, 0.3, size), rng.uniform(0.2, 0.6, size)
    within, factor = rng.uniform(0.1, 0.3, size), normal_factor(rng, size)
    noise = {"log_size": [-0.4], "noise_spread": [0.3]}
    distribution = ClassDistribution(location, spread, factor, within, 0.7, **noise)
    expected = dense_density(x, location, spread, factor, within, 0.7)
    expected += stats.norm(-0.4, 0.3).logpdf(draws.log_size[0])
    tolerance = QUADRATURE_TOLERANCE if tests > 1 else SINGLE_TEST_TOLERANCE
    found = log_density(np, vars(draws), distribution)
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance)


def test_density_without_experiment_effect_is_normal():
    """Cases: several distributions, their mean, one for each draw, and a covariate effect."""
    rng, count = np.random.default_rng(SEED), 6
    draws, x = random_draws(rng, 3, 1, 5)
    m, s = rng.normal(0, 0.3, (3, count)), rng.uniform(0.2, 0.6, (3, count))
    factor = np.array([normal_factor(rng, 3) for _ in range(count)])
    many = ClassDistribution(m[..., None], s[..., None], factor)
    expected = np.array([dense_density(x, *args) for args in zip(m.T, s.T, factor, strict=True)])
    np.testing.assert_allclose(log_densities(draws, many), expected, rtol=ROUNDING)
    mean = logsumexp(expected, axis=0) - np.log(count)
    np.testing.assert_allclose(specimen_draws.mean_density(draws, many), mean, rtol=ROUNDING)
    each = specimen_draws.density_of_each(np.repeat(draws.centre[:, None], count, axis=1), many)
    np.testing.assert_allclose(each, expected, rtol=ROUNDING)
    effect = rng.normal(0, 0.3, 3)
    one = ClassDistribution(m[:, 0], s[:, 0], factor[0], effects=[effect])
    moved = specimen_draws.stacked([replace(draws, covariates=np.array([0.7]))])
    found = log_density(np, moved, one)[0]
    expected = dense_density(x, m[:, 0] + 0.7 * effect, s[:, 0], factor[0])
    np.testing.assert_allclose(found, expected, rtol=ROUNDING)


def test_potential_of_a_class_equals_the_weighted_sum_over_draws():
    """The compiled model of a class, at one point, against weighted sums of SciPy's densities."""
    rng = np.random.default_rng(SEED)
    noise = ph.Gaussian(pm.LogNormal.dist(0.0, 1.0), observed=True)
    population = Population(ph.Ogden(), noise, ph.Variability(experiment_effect=True))
    specimens = [random_draws(rng, 2, tests, 20) for tests in (2, 3)]
    units = units_of({f"{i}": draws for i, (draws, _) in enumerate(specimens)})
    model = ClassModel(population).kernel(units, 1).model
    location, spread, within = rng.normal(0, 0.3, 2), np.array([0.3, 0.5]), np.array([0.1, 0.2])
    point = {
        "location": location,
        "spread_log__": np.log(spread),
        "correlation_unit_logodds__": np.log(0.7 / 0.3),
        "experiment_spread_log__": np.log(within),
        "effect_spread_log__": np.log(0.6),
        "pressure_sd_log__": np.log(0.8),
        "noise_spread_log__": np.log(0.4),
    }
    outputs = model.replace_rvs_by_values([model["specimens_class"], model["correlation"]])
    function = BatchedFunction.of_model(model, outputs)
    joined = np.concatenate([np.ravel(point[v.name]) for v in model.value_vars])
    potential, correlation = (values[0] for values in function(joined[None]))
    np.testing.assert_allclose(correlation, [[1, 0.4], [0.4, 1]])
    factor, expected = np.linalg.cholesky(correlation), 0.0
    for draws, x in specimens:
        density = dense_density(x, location, spread, factor, within, 0.6)
        density += stats.norm(np.log(0.8), 0.4).logpdf(draws.log_size[0])
        expected += logsumexp(draws.log_weight + density)
    np.testing.assert_allclose(potential, expected, rtol=0, atol=2 * QUADRATURE_TOLERANCE)


def test_first_draws_keep_the_total_weight_and_survive_a_dataset():
    draws, _ = random_draws(np.random.default_rng(SEED), 2, 3, 40)
    half = draws.first(20)
    np.testing.assert_allclose(half.log_weight, draws.log_weight[:20] + np.log(2))
    np.testing.assert_array_equal(half.scatter, draws.scatter[:, :20])
    again = SpecimenDraws.from_dataset(draws.as_dataset())
    for name, value in vars(draws).items():
        np.testing.assert_array_equal(getattr(again, name), value)
