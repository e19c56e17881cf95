"""As many draws of specimens as the evidence of their class needs."""

import numpy as np
import pytest
from scipy import stats
from scipy.special import logsumexp
from variable_classes import SIGMA, TRAINING, UNIT_PRESSURE, curves, fit

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.distribution import (
    ClassDraws,
    ClassModel,
    _larger,
    fit_distribution,
)
from pymc_hyperelastic.classes.specimen_evidence import variance_of_specimen
from pymc_hyperelastic.classes.specimens import PARTICLES
from pymc_hyperelastic.classes.variable import Variability
from pymc_hyperelastic.models.class_distribution import ClassDistribution
from pymc_hyperelastic.models.specimen_draws import SpecimenDraws, log_densities

SEED = 911
# An honest standard error is exceeded threefold once in 370 runs; seeds are fixed.
STANDARD_ERRORS = 3
# Nats: draws of a specimen leave no more to the evidence of a class, and beyond it evidences of
# single-parameter specimens are known.
ENOUGH, PRECISE = 0.1, 0.02


def normal_draws(rng, count, width, centre=0.0):
    """Draws from a normal density of this width, of a specimen whose curves say nothing."""
    x = centre + width * rng.standard_normal(count)
    weight = -stats.norm(centre, width).logpdf(x) - np.log(count)
    zero = np.zeros(count)
    return SpecimenDraws(x[None], zero[None], x[None][:0], weight, 1, 0.0, x[:, None], x[None][:0])


def normal_classes(location, spread):
    """Distributions of one coordinate, along the first of two axes."""
    location, spread = np.broadcast_arrays(location, spread)
    return ClassDistribution(location[None, :, None], spread[None, :, None], np.eye(1))


@pytest.mark.parametrize("locations", [np.zeros(1), np.linspace(-1, 1, 21)], ids=["one", "many"])
def test_stated_variance_is_that_of_the_evidence(locations):
    """Over many sets of draws the evidence of a class spreads as each of them says.

    That of an eighth of the draws is told by all of them.
    """
    rng = np.random.default_rng(SEED)
    values, stated = [], []
    for _ in range(400):
        draws = normal_draws(rng, 1024, 2.0)
        few = draws.first(128)
        by_class = logsumexp(
            few.log_weight + log_densities(few, normal_classes(locations, 0.7)), axis=1
        )
        values.append(logsumexp(by_class) - np.log(len(locations)))
        weights = np.exp(by_class - logsumexp(by_class))
        posterior = normal_classes(rng.choice(locations, size=200, p=weights), 0.7)
        stated.append(variance_of_specimen(draws, posterior, 128))
    # A spread of 400 numbers is known to 4 %; the logarithm bends by half a variance.
    np.testing.assert_allclose(np.sqrt(np.mean(stated)), np.std(values), rtol=0.15)
    assert abs(np.mean(values)) < STANDARD_ERRORS * np.std(values) / 20 + np.var(values) / 2


def test_draws_near_a_class_stand_for_it():
    """Sampled as one of a narrow class, a specimen has the evidence of a sum over a grid."""
    data = curves({"S": [42.0]}, 3)
    sampler = Variability.of_settings(ph.NeoHookean(), sigma=SIGMA).sampler(data)
    rng = np.random.default_rng(SEED)
    wide = sampler(data, rng)
    # Far out in what the curves allow, and ten times as narrow.
    centre, width = wide.centre.mean() + 2 * wide.centre.std(), 0.1 * wide.centre.std()
    narrow = normal_classes(np.array([centre]), width)
    near = sampler.near(data, wide, narrow, rng)
    x = np.linspace(centre - 8 * width, centre + 8 * width, 2001)
    modulus = 20.0 / (np.exp(2 * np.exp(x)) - np.exp(-2 * np.exp(x)))
    density = stats.norm(modulus[:, None] * UNIT_PRESSURE, SIGMA / np.sqrt(2))
    log_terms = density.logpdf(data["pressure"].values).sum(axis=1)
    log_terms += stats.norm(centre, width).logpdf(x) + np.log(x[1] - x[0])
    value = logsumexp(near.log_weight + log_densities(near, narrow))
    error = np.sqrt(variance_of_specimen(near, narrow, PARTICLES))
    assert error < PRECISE < ENOUGH < np.sqrt(variance_of_specimen(wide, narrow, PARTICLES))
    assert abs(value - logsumexp(log_terms)) < STANDARD_ERRORS * error


def test_draws_are_added_where_they_are_lacking():
    """Draws are doubled until they are expected to be enough, or none is left."""
    assert _larger(128, 1e-4) == 128
    assert _larger(128, 0.01) == 512
    assert _larger(128, 9.0) == 2000


def test_more_draws_make_the_evidence_of_a_class_precise():
    """A class is fitted to more draws of its specimens until it is as precise as is needed."""
    rng = np.random.default_rng(SEED)
    model = ClassModel(Variability.of_settings(ph.NeoHookean(), sigma=SIGMA))
    draws = {f"{width}": normal_draws(rng, 2000, width, centre=np.log(0.2)) for width in (2.0, 9.0)}
    fitted = fit_distribution(
        model, ClassDraws(draws, 128, None), 500, 1, np.random.SeedSequence(SEED)
    )
    # Curves that say nothing leave the prior, whose evidence is one.
    value, error = ph.log_evidence(fitted)
    assert fitted["evidence"]["specimens_se"] < ENOUGH
    assert abs(value) < STANDARD_ERRORS * error


@pytest.mark.deep
@pytest.mark.parametrize("name", TRAINING)
def test_evidence_of_a_class_whose_curves_leave_a_parameter_open(name):
    """The exponent of the power law is hardly told, yet different seeds agree as they say."""
    one = {name: TRAINING[name]}
    fits = [fit(ph.PowerLawNeoHookean(), one, random_seed=seed)[name] for seed in range(12)]
    values, errors = np.array([ph.log_evidence(fitted) for fitted in fits]).T
    assert errors.max() < ENOUGH
    deviations = (values - values.mean()) / errors
    assert stats.chi2(11).sf(np.sum(deviations**2)) > 1e-3
