"""Specimens that differ, with forces, offsets and tubes that have errors, against brute force.

The brute force draws specimens of a class, and their tubes, and averages their likelihoods, by
importance where they are narrow. It is NumPy and SciPy, and shares nothing with the package but the
class's distribution.
"""

from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.specimen_evidence import specimen_evidence
from pymc_hyperelastic.classes.specimens import SpecimenSampler, reference_of
from pymc_hyperelastic.models.class_distribution import ClassDistribution
from pymc_hyperelastic.models.geometry import Measured
from pymc_hyperelastic.models.observation import Observation
from pymc_hyperelastic.models.population import Population

SEED = 20
INNER, OUTER, ANGLE = 1.0, 1.4, 0.8
PRESSURE_SD, FORCE_SD, OFFSET_SD = 1.2, 12.0, 30.0
THICKNESS_SD, ANGLE_SD = 0.04, 0.3
# Nats: what is asked of the package, and the most that the brute force itself may err.
TOLERANCE, OWN_ERROR = 0.1, 0.02
NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)


class Law(NamedTuple):
    """A law and two classes' worth of its natural coordinates, about which specimens differ."""

    energy: ph.StrainEnergy
    location: tuple
    parameters: object
    """Of coordinates."""
    stresses: object
    """Hoop and axial stress less the radial one, of the logarithms of the stretches."""


def neo_hookean_stresses(hoop, axial, mu):
    radial = np.exp(-2 * (hoop + axial))
    return mu * (np.exp(2 * hoop) - radial), mu * (np.exp(2 * axial) - radial)


def ogden_stresses(hoop, axial, mu, alpha):
    def power(x):
        return 4 * mu / alpha * np.sinh(alpha * x)

    radial = power(-hoop - axial)
    return power(hoop) - radial, power(axial) - radial


def moduli(stresses, *shapes):
    """Parameters of a law from the strain at which it bears 20 kPa at a held length."""

    def parameters(log_strain, *logs):
        rest = [np.exp(x) for x in logs]
        return 20 / stresses(np.exp(log_strain), 0.0, 1.0, *rest)[0], *rest

    return parameters


LAWS = {
    "NeoHookean": Law(ph.NeoHookean(), (-1.2,), moduli(neo_hookean_stresses), neo_hookean_stresses),
    "Ogden": Law(ph.Ogden(), (-1.5, 1.6), moduli(ogden_stresses), ogden_stresses),
}
SPREAD = 0.25

# Tests: internal radii and axial stretches. The last is an extension test.
TESTS = [
    (np.linspace(1.05, 1.45, 5), np.full(5, 1.2)),
    (np.linspace(1.05, 1.40, 5), np.full(5, 1.4)),
    (np.linspace(1.30, 1.20, 5), np.linspace(1.2, 1.5, 5)),
]
RADIUS, STRETCH = np.concatenate(TESTS, axis=1)
TEST = np.repeat(np.arange(len(TESTS)), 5)


def curves(law, parameters, thickness, angle):
    """Pressure and force at all points; parameters and tubes may be columns of draws.

    The ring that was measured opens by another angle: it keeps its middle line and thickness.
    """
    middle = (INNER + OUTER) / 2 * (2 * np.pi - ANGLE) / (2 * np.pi - angle)
    inner = INNER + middle - (INNER + OUTER) / 2
    k = 2 * np.pi / (2 * np.pi - angle)
    radius, stretch = RADIUS, STRETCH
    pressure = force = 0.0
    for node, weight in zip(NODES, WEIGHTS, strict=True):
        place = inner + thickness * (1 + node) / 2
        square = radius**2 + (place**2 - inner**2) / (k * stretch)
        hoop = np.log(k * np.sqrt(square) / place)
        of_hoop, of_axial = law.stresses(hoop, np.log(stretch), *parameters)
        of_radius = weight * thickness / 2 * place / (k * stretch)
        pressure = pressure + of_radius * of_hoop / square
        force = force + np.pi * of_radius * (2 * of_axial - of_hoop)
    return pressure, force


def simulated(law, coordinates, rng):
    """Data of one specimen."""
    thickness = (OUTER - INNER) * np.exp(rng.normal() * THICKNESS_SD / (OUTER - INNER))
    angle = ANGLE + ANGLE_SD * rng.normal()
    pressure, force = curves(law, law.parameters(*coordinates), thickness, angle)
    offset = OFFSET_SD * rng.standard_normal(len(TESTS))[TEST]
    points = {
        "pressure": pressure + PRESSURE_SD * rng.standard_normal(TEST.size),
        "axial_force": force + offset + FORCE_SD * rng.standard_normal(TEST.size),
    }
    labels = {"specimen": "S", "experiment": TEST, "radius": RADIUS, "stretch": STRETCH}
    return ph.inflation_data(
        pd.DataFrame(labels | points),
        inner_radius=INNER,
        outer_radius=OUTER,
        axial_stretch="stretch",
        opening_angle=ANGLE,
        opening_angle_convention="whole",
        radii_of="sector",
        geometry_sd={"thickness": THICKNESS_SD},
        check="ignore",
    )


def log_likelihood_of(law, data, distribution):
    """Of a specimen, as a function of standard normal numbers: its coordinates and its tube."""
    precision = np.linalg.inv(FORCE_SD**2 * np.eye(5) + OFFSET_SD**2)
    log_volume = np.linalg.slogdet(2 * np.pi * np.linalg.inv(precision))[1] * len(TESTS)
    log_volume += TEST.size * np.log(2 * np.pi * PRESSURE_SD**2)

    def log_likelihood(z):
        *x, of_thickness, of_angle = z.T[..., None]
        coordinates = [m + SPREAD * y for m, y in zip(distribution.location, x, strict=True)]
        thickness = (OUTER - INNER) * np.exp(of_thickness * THICKNESS_SD / (OUTER - INNER))
        angle = ANGLE + ANGLE_SD * of_angle
        with np.errstate(over="ignore", invalid="ignore"):
            pressure, force = curves(law, law.parameters(*coordinates), thickness, angle)
            squares = np.sum((data["pressure"].values - pressure) ** 2, axis=1) / PRESSURE_SD**2
            error = (data["axial_force"].values - force).reshape(len(z), len(TESTS), 5)
            squares += np.einsum("btj,jk,btk->b", error, precision, error)
        return -(np.nan_to_num(squares, nan=np.inf) + log_volume) / 2

    return log_likelihood


def brute_force(law, data, distribution, rng, block=20_000):
    """Log evidence of a specimen of a class with independent coordinates, known well enough.

    The class itself would give one draw in some 10,000 that counts. Nine of ten are of a normal
    distribution twice as wide as the posterior, found by ever less tempered weights, and one is of
    the class: no weight is more than ten times the likelihood.
    """
    size = len(distribution.location) + 2
    log_likelihood = log_likelihood_of(law, data, distribution)
    near = prior = multivariate_normal(np.zeros(size))

    def draws():
        of_class = rng.random(block) < 0.1
        z = np.where(of_class[:, None], prior.rvs(block, rng), near.rvs(block, rng))
        proposed = np.logaddexp(np.log(0.9) + near.logpdf(z), np.log(0.1) + prior.logpdf(z))
        return z, log_likelihood(z) + prior.logpdf(z) - proposed

    for _ in range(12):
        z, log_weight = draws()

        def tempered(power, log_weight=log_weight):
            return np.exp(power * log_weight - logsumexp(power * log_weight))

        power = next(p for p in 2.0 ** -np.arange(60) if 1 / np.sum(tempered(p) ** 2) > 500)
        weight = tempered(power)
        near = multivariate_normal(weight @ z, 2 * np.cov(z.T, aweights=weight))
    logs, own_error = np.empty(0), np.inf
    while own_error > OWN_ERROR:
        logs = np.append(logs, draws()[1])
        weight = np.exp(logs - logsumexp(logs))
        own_error = np.sqrt(weight @ weight)
    return logsumexp(logs) - np.log(len(logs)), own_error


def predictive_errors(law, count):
    """Evidences of specimens under a class less the brute force's, and errors that are stated."""
    rng = np.random.default_rng(SEED)
    noise = {"noise_sd": PRESSURE_SD, "force_noise_sd": FORCE_SD, "force_offset_sd": OFFSET_SD}
    geometry = {"thickness": Measured(), "opening_angle": Measured(ANGLE_SD)}
    observation = Observation(**noise, likelihood="generative")
    population = Population(law.energy, observation, geometry=geometry)
    size = len(law.location)
    unit = np.ones((3, 1))
    distribution = ClassDistribution(
        [m * unit for m in law.location],
        [SPREAD * unit for _ in law.location],
        np.eye(size),
    )
    differences, stated = [], []
    plain = ClassDistribution(law.location, [SPREAD] * size, None)
    for _ in range(count):
        coordinates = [m + SPREAD * rng.standard_normal() for m in law.location]
        data = simulated(law, coordinates, rng)
        population.check(data)
        sampler = SpecimenSampler(
            population, population.forward_model(data), reference_of(population)
        )
        found = specimen_evidence(sampler(data, rng), distribution).log_evidence
        expected, own_error = brute_force(law, data, plain, rng)
        differences.append(found.value - expected)
        stated.append(np.hypot(found.standard_error, own_error))
    return np.array(differences), np.array(stated)


@pytest.mark.deep
@pytest.mark.parametrize("name", LAWS)
def test_class_predictives_are_those_of_brute_force(name):
    """Forces with offsets, an extension test, uncertain thickness and angle: ten specimens."""
    differences, stated = predictive_errors(LAWS[name], 10)
    assert np.abs(differences).max() < TOLERANCE
    # Ten standard normal numbers have such a mean square once in a hundred times.
    assert np.mean((differences / stated) ** 2) < 2.3


def test_a_class_predictive_is_that_of_brute_force():
    """Of one specimen."""
    differences, _ = predictive_errors(LAWS["NeoHookean"], 1)
    assert np.abs(differences).max() < TOLERANCE


def test_brute_force_is_the_mean_over_the_class():
    """Of one specimen, which its prior tells enough of for draws of the class alone."""
    law, rng = LAWS["NeoHookean"], np.random.default_rng(SEED)
    distribution = ClassDistribution(law.location, [SPREAD], None)
    data = simulated(law, law.location, rng)
    found, own_error = brute_force(law, data, distribution, rng)
    z = rng.standard_normal((200_000, 3))
    logs = np.concatenate([log_likelihood_of(law, data, distribution)(x) for x in np.split(z, 20)])
    weight = np.exp(logs - logsumexp(logs))
    error = np.hypot(own_error, np.sqrt(weight @ weight))
    assert abs(logsumexp(logs) - np.log(len(logs)) - found) < 3 * error < 0.05
