"""Moments of class distributions, against random specimens, and draws of a fitted class."""

import numpy as np
import pymc as pm
import pytest
import xarray as xr
from normal_specimens import repeated_class

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.reference import fresh_specimens, near_class, reference_of
from pymc_hyperelastic.design.few_draws import known_class
from pymc_hyperelastic.models.class_distribution import ClassDistribution, distributions_of
from pymc_hyperelastic.models.population import Population, log_noise_name

SEED = 912
# Specimens: enough to know a variance to 0.5 %, and covariances are compared to 3 %.
COUNT, TOLERANCE = 100_000, 0.03
NOISE = ph.Gaussian(pm.LogNormal.dist(-0.7, 0.3), observed=True)
POPULATION = Population(ph.Ogden(), NOISE, ph.Variability(experiment_effect=True))
NAME_OF_NOISE, NOISE_MOMENTS = log_noise_name("pressure_sd"), ("log_size", "noise_spread")
CORRELATION = np.array([[1.0, 0.6], [0.6, 1.0]])


def distribution(count):
    return repeated_class(count, np.linalg.cholesky(CORRELATION))


def points_of(specimens):
    """Coordinates of each test, and noise, as points of the target: (draw, entry)."""
    names = [*(f"{name}_of_test" for name in POPULATION.scale.names), NAME_OF_NOISE]
    return np.concatenate([specimens[name] for name in names], axis=1)


def test_moments_of_a_class_equal_moments_of_random_specimens():
    """Two coordinates of two tests each, and noise: all variances and covariances."""
    fresh = fresh_specimens(POPULATION, distribution(COUNT), 2, np.random.default_rng(SEED))
    covariance = np.cov(points_of(fresh).T)
    known = known_class(distribution(3), tests=2, measures=1)
    np.testing.assert_allclose(known.means, [[0.0, 0.0, 1.0, 1.0, -1.0, 0.0]] * 3)
    *_, stated = np.linalg.inv(known.precisions)
    scale = np.sqrt(np.outer(*[np.diagonal(stated)] * 2))[:5, :5]
    assert np.abs(covariance - stated[:5, :5]).max() < TOLERANCE * scale.min()
    np.testing.assert_allclose(stated[5], [0, 0, 0, 0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(points_of(fresh).mean(axis=0), known.means[0, :5], atol=0.01)


def test_with_covariance_replaces_covariance_and_location():
    changed = np.array([[0.3, -0.1], [-0.1, 0.2]]) * np.arange(1, 4)[:, None, None]
    other = distribution(3).with_covariance(changed, np.full((2, 3, 1), [[[1]], [[2]]]))
    np.testing.assert_allclose(other.covariance(), changed)
    np.testing.assert_allclose(other.at(np.array([2])).covariance(), changed[2:])
    np.testing.assert_allclose(other.location[:, 0, 0], [1.0, 2.0])


def test_reference_near_a_class_is_twice_as_wide():
    """All parameters of the class distribution differ between draws."""
    rng = np.random.default_rng(SEED)
    one, varied = distribution(COUNT), {}
    for name in ("location", "spread", "experiment_spread", "effect_spread", *NOISE_MOMENTS):
        change = 0.3 * rng.standard_normal(getattr(one, name).shape)
        moved = name in ("location", "log_size")
        varied[name] = getattr(one, name) + change if moved else getattr(one, name) * np.exp(change)
    of_class = ClassDistribution(factor=one.factor, **varied)
    near = near_class(of_class)
    fresh = fresh_specimens(POPULATION, of_class, 1, rng)
    drawn = [fresh[name] for name in (*POPULATION.scale.names, NAME_OF_NOISE)]
    means, widths = [x.mean() for x in drawn], [2 * x.std() for x in drawn]
    np.testing.assert_allclose([*near.location, *near.log_size], means, atol=0.01)
    np.testing.assert_allclose([*near.spread, *near.noise_spread], widths, rtol=TOLERANCE)
    # The logarithm of a factor is normal with an sd of 0.3: its mean square is exp(2 0.3²).
    grown = np.exp(0.3**2)
    within = 2 * grown * np.array([0.1, 0.3])
    np.testing.assert_allclose(near.experiment_spread, within, rtol=TOLERANCE)
    np.testing.assert_allclose(near.effect_spread, 0.3 * grown, rtol=TOLERANCE)
    np.testing.assert_array_equal(near.factor, np.eye(2))


def test_reference_spread_adds_the_location_sd_and_twice_the_median_spread():
    """The squares of twice the median spread of a class and of the sd of its location add up."""
    reference = reference_of(POPULATION)
    mean, sd = POPULATION.scale.location_prior
    median = np.exp(POPULATION.scale.spread_prior[0])
    np.testing.assert_allclose(reference.location, mean)
    np.testing.assert_allclose(reference.spread, np.sqrt(sd**2 + (2 * median) ** 2))
    np.testing.assert_allclose(reference.experiment_spread, median)
    assert reference.effect_spread == 1.0
    # Estimated from 2000 draws of the prior.
    np.testing.assert_allclose(reference.log_size, -0.7, atol=0.03)
    np.testing.assert_allclose(reference.noise_spread, np.hypot(0.3, 0.6), rtol=TOLERANCE)


def test_draws_of_a_class_are_read_from_its_posterior_and_invalid_draws_refused():
    """The class has two coordinates and an inferred standard deviation."""
    rng, dims = np.random.default_rng(SEED), ("chain", "draw", "coordinate", "coordinate_2")
    values = {
        "location": rng.standard_normal((3, 40, 2)),
        "spread": rng.uniform(1, 2, (3, 40, 2)),
        "correlation": np.tile(CORRELATION, (3, 40, 1, 1)),
        "pressure_sd": rng.uniform(1, 2, (3, 40)),
        "noise_spread": rng.uniform(1, 2, (3, 40)),
    }
    posterior = xr.Dataset({name: (dims[: v.ndim], v) for name, v in values.items()})
    posterior = posterior.assign_coords(coordinate=["a", "b"])
    found = distributions_of(xr.DataTree.from_dict({"posterior": posterior}))
    for name in ("location", "spread"):
        expected = posterior[name].values.reshape(-1, 2).T
        np.testing.assert_array_equal(getattr(found, name)[..., 0], expected)
    np.testing.assert_allclose(found.factor @ found.factor.mT, [CORRELATION] * 120)
    expected = np.log(posterior["pressure_sd"].values.ravel())
    np.testing.assert_allclose(found.log_size[0, :, 0], expected)
    some = distributions_of(xr.DataTree.from_dict({"posterior": posterior}), 4)
    np.testing.assert_array_equal(some.location, found.location[:, [0, 40, 79, 119]])
    for changed, message in (
        (posterior.drop_vars("pressure_sd"), "only one of 'noise_spread' and the size"),
        (posterior.assign(correlation=posterior["correlation"] - 0.9), "is no correlation matrix"),
        (posterior.drop_vars("correlation"), "'correlation' of 'posterior' is missing"),
    ):
        with pytest.raises(ValueError, match=message):
            distributions_of(xr.DataTree.from_dict({"posterior": changed}))
