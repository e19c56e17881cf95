"""P-values of the hypothesis that a specimen belongs to a class."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from variable_classes import SEED, classify, curves

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes import typicality
from pymc_hyperelastic.classes.reference import one_draw
from pymc_hyperelastic.models.class_distribution import ClassDistribution
from pymc_hyperelastic.models.population import Population
from pymc_hyperelastic.models.specimen_draws import SpecimenDraws

# Five percent of a class's own specimens are rejected.
NONE_BELOW = 0.05
# P-values are ranks among 20,000 random specimens, whitened by 4000: 4 sd.
COUNT, TOLERANCE = 20_000, 0.03
# Indices that repeat one distribution.
SAME = np.zeros(COUNT, int)
NOISE = ph.Gaussian(0.5, observed=True)
OGDEN = Population(ph.Ogden(), NOISE)


def exactly(mean, covariance, count=4000):
    """Numbers (coordinate, draw) that have exactly this mean and covariance."""
    z = np.random.default_rng(SEED).standard_normal((len(mean), count))
    root = np.linalg.cholesky(np.atleast_2d(np.cov(z)))
    z = np.linalg.solve(root, z - z.mean(axis=1, keepdims=True))
    return np.array(mean)[:, None] + np.linalg.cholesky(covariance) @ z


def drawn(centre, scatter=None, tests=1, log_size=None):
    """Draws of a specimen."""
    scatter = np.zeros_like(centre) if scatter is None else scatter
    noise = centre[:0] if log_size is None else log_size
    return SpecimenDraws(centre, scatter, noise, centre[0], tests, 0.0, centre.T, centre[:0])


@pytest.mark.parametrize(("left", "known"), [((0.05, 0.3), 2), ((0.05, 0.8), 1), ((0.6, 0.7), 0)])
def test_typical_p_value_equals_closed_form_of_normal_distributions(left, known):
    """Directions are left out if the data reduce their variance by less than half.

    The posterior mean of a specimen x of the class is normal: around m + A (x - m) with covariance
    S Aᵀ, where S is the posterior covariance, A = 1 - S Σ⁻¹, and the reference is N(m, Σ).
    """
    middle, width = np.array([0.5, -1.0]), np.array([1.5, 0.8])
    location, spread = np.array([0.2, -0.5]), np.array([0.6, 0.3])
    factor, turned = np.array([[1, 0], [0.6, 0.8]]), np.array([[0.8, -0.6], [0.6, 0.8]])
    posterior = np.diag(width) @ turned @ np.diag(left) @ turned.T @ np.diag(width)
    mean = np.array([1.0, -0.2])
    found = typicality.typical_p_value(
        drawn(exactly(mean, posterior)),
        OGDEN,
        ClassDistribution(middle, width, np.eye(2)),
        one_draw(ClassDistribution(location, spread, factor)).at(SAME),
        np.random.default_rng(SEED),
    )
    gain, root = np.eye(2) - posterior @ np.diag(width**-2.0), np.diag(spread) @ factor
    covariance = gain @ root @ root.T @ gain.T + posterior @ gain.T
    # Only along the directions of the whitened posterior that are kept.
    whiten = (turned.T / width)[:known]
    apart = whiten @ (mean - middle - gain @ (location - middle))
    squared = apart @ np.linalg.solve(whiten @ covariance @ whiten.T, apart)
    expected = stats.chi2(known).sf(squared) if known else np.nan
    assert found == pytest.approx(expected, abs=TOLERANCE, nan_ok=True)
    assert not known or 0.02 < expected < 0.8


@pytest.mark.parametrize("ratio", [12.0, 0.01])
def test_typical_p_value_includes_the_scatter_between_experiments(ratio):
    """Three tests known exactly: their scatter is ω² χ² of two degrees of freedom."""
    tests, within, exact = 3, 0.1, exactly([0.0], [[1e-6]])
    reference = ClassDistribution(np.zeros(1), np.ones(1), np.eye(1), np.full(1, 0.3), 1.0)
    one = ClassDistribution(np.full(1, 0.5), np.full(1, 0.3), np.eye(1), np.full(1, within))
    found = typicality.typical_p_value(
        drawn(1 + exact, within**2 * ratio * np.exp(exact), tests),
        Population(ph.NeoHookean(), NOISE, ph.Variability(experiment_effect=True)),
        reference,
        replace(one_draw(one).at(SAME), effect_spread=np.zeros((COUNT, 1))),
        np.random.default_rng(SEED),
    )
    wall = 2 * stats.norm.sf(0.5 / np.sqrt(0.3**2 + within**2 / tests))
    # The mean of ln χ², and the values at the same distance from it on both sides.
    chi2, middle = stats.chi2(2), np.log(2) - np.euler_gamma
    apart = abs(np.log(ratio) - middle)
    between = chi2.sf(np.exp(middle + apart)) + chi2.cdf(np.exp(middle - apart))
    assert found == pytest.approx(1 - (1 - min(wall, between)) ** 2, abs=TOLERANCE)


def test_noise_p_value_equals_closed_form_of_normal_distributions():
    """The p-value is one-sided; the smaller one of two noises is corrected for the choice."""
    prior, width = np.array([-1.0, 0.5]), np.array([0.8, 0.6])
    means, errors = np.array([-0.9, 0.55]), np.array([0.2, 0.3])
    location, spread = np.array([-1.3, 0.3]), np.array([0.25, 0.2])
    reference = ClassDistribution(None, None, None, log_size=prior, noise_spread=width)
    noise = {"log_size": location, "noise_spread": spread}
    numbers = {name: np.multiply.outer(v, np.ones((COUNT, 1))) for name, v in noise.items()}
    of_class = ClassDistribution(np.zeros((1, COUNT, 1)), None, None, **numbers)
    draws = drawn(np.zeros((1, 4000)), log_size=exactly(means, np.diag(errors**2)))
    left = (errors / width) ** 2
    middle = (1 - left) * (location - prior) / width
    sd = np.sqrt(((1 - left) * spread / width) ** 2 + left * (1 - left))
    expected = typicality.either(*stats.norm.sf(((means - prior) / width - middle) / sd))
    assert 0.02 < expected < 0.8
    found = typicality.noise_p_value(draws, reference, of_class, np.random.default_rng(SEED))
    assert found == pytest.approx(expected, abs=TOLERANCE)
    assert np.isnan([typicality.either(np.nan, 0.01), typicality.either(0.01, np.nan)]).all()


def test_misfit_p_value_is_the_tail_of_a_ratio_of_two_chi_squares():
    """The misfit of the class is the reference, unless it is smaller than the noise predicts."""
    rng = np.random.default_rng(SEED)
    draws = replace(drawn(np.zeros((1, 1))), misfit=25.0, freedom=10.0)
    freedom = np.array([20.0, 30.0])
    ratio = rng.chisquare(10, 200_000) / 10 / (rng.chisquare(50, 200_000) / 50)
    expected = np.mean(ratio > 25 / 10 / 1.4)
    p_value = typicality.misfit_p_value
    assert p_value(draws, 1.4 * freedom, freedom) == pytest.approx(expected, abs=0.005)
    as_noise = p_value(draws, freedom, freedom)
    assert as_noise == p_value(draws, freedom / 2, freedom) < expected / 2
    assert p_value(replace(draws, misfit=np.inf), freedom, freedom) == 0
    assert np.isnan(p_value(replace(draws, misfit=np.nan), freedom, freedom))


# Changes of the pressures of a specimen with a modulus of 38 kPa; classes have 30 to 110 kPa.
CHANGES = {
    "hundred times too soft": lambda p: p / 100,
    "falling": lambda p: p[::-1],
    "twenty times too stiff": lambda p: 20 * p,
    "offset": lambda p: p + 5,
    "usual": lambda p: p,
}


@pytest.mark.filterwarnings("ignore:.* cannot be judged")
def test_implausible_specimens_are_assigned_to_no_class(classes):
    """Walls that are too soft or stiff are not typical; falling or shifted curves do not fit."""
    data = curves({name: [38.0] for name in CHANGES}, 3)
    pressure = data["pressure"].values.reshape(len(CHANGES), -1)
    data["pressure"][:] = np.ravel([f(p) for f, p in zip(CHANGES.values(), pressure, strict=True)])
    result = classify(data, classes, none_below=NONE_BELOW)
    expected = ["none of these"] * (len(CHANGES) - 1) + ["soft"]
    assert result["decision"].values.tolist() == expected
    typical, fit = (result[f"{name}_p_value"].values for name in ("typical", "fit"))
    assert typical[0].max() < NONE_BELOW < fit[0].min()
    assert fit[1].max() < NONE_BELOW
    np.testing.assert_allclose(result["p_value"], 1 - (1 - np.minimum(typical, fit)) ** 2)
