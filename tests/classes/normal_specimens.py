"""Exact posteriors of groups of specimens that are jointly normal, given their spreads."""

from itertools import product
from typing import NamedTuple

import numpy as np
from scipy import stats
from scipy.special import logsumexp

from pymc_hyperelastic.models.class_distribution import ClassDistribution

# Nodes over the logarithms of spreads, in standard deviations of their priors.
NODES = np.linspace(-4, 4, 25)


def repeated_class(count, factor, **changes):
    """Return `count` times one class of two coordinates whose experiments and noises differ."""
    numbers = {
        "location": [0.0, 1.0],
        "spread": [0.3, 0.4],
        "experiment_spread": [0.1, 0.3],
        "effect_spread": 0.3,
        "log_size": [-1.0],
        "noise_spread": [0.3],
    } | changes
    repeated = {name: np.multiply.outer(v, np.ones((count, 1))) for name, v in numbers.items()}
    return ClassDistribution(factor=factor, **repeated)


class Exact(NamedTuple):
    """Moments of the location, of the covariate effects, and of the difference between groups."""

    log_evidence: float
    mean: np.ndarray
    sd: np.ndarray
    positive: float
    """Probability that the last unknown of the spreads is positive."""


def mixture(scale, y, errors, sign, ages, apart, noise_of, dimension):
    """Sum closed forms over a grid of spreads, which determine the covariance of the specimens."""
    (middle,), (sd,) = scale.location_prior
    (median,), sd_of_logs = scale.spread_prior
    columns = np.stack([np.ones(len(y)), *ages, *([sign] if apart else [])], axis=1)
    terms, means, variances = [], [], []
    grid = np.array([*product(NODES, repeat=dimension)])
    for z in grid:
        spread = np.exp(median + sd_of_logs * z)
        # The prior sd of the difference is `apart.location` times the first spread.
        sds = [sd, *[np.exp(median)] * len(ages), *([apart.location * spread[0]] if apart else [])]
        scaled = columns * sds
        covariance = noise_of(spread, z) + np.diag(np.square(errors)) + scaled @ scaled.T
        terms.append(stats.multivariate_normal.logpdf(y - middle, cov=covariance))
        gain = np.linalg.solve(covariance, scaled * sds).T
        means.append(gain @ (y - middle))
        variances.append(np.square(sds) - np.sum(gain * (scaled * sds).T, axis=1))
    terms += stats.norm.logpdf(grid).sum(axis=1) + dimension * np.log(NODES[1] - NODES[0])
    weights = np.exp(terms - logsumexp(terms))
    mean = weights @ means
    variance = weights @ (variances + (means - mean) ** 2)
    positive = weights @ (np.sign(grid[:, -1]) + 1) / 2
    return Exact(logsumexp(terms), mean, np.sqrt(variance), positive)


def of_groups(scale, y, errors, sign, ages, apart):
    """Return the posterior of two groups, or of one group of all specimens."""

    def noise_of(spread, z):
        ratio = np.exp(apart.log_spread * z[1] * sign) if apart else np.ones(len(y))
        return np.diag((spread[0] * ratio) ** 2)

    return mixture(scale, y, errors, sign, ages, apart, noise_of, 2 if apart else 1)


def of_pairs(scale, y, errors, ages, apart):
    """Return the posterior of pairs: all first halves, then all second ones."""
    count = len(y) // 2

    def noise_of(spread, z):
        middle, half = spread[0] ** 2, spread[1] ** 2 / 4
        of_pair = np.array([[middle + half, middle - half], [middle - half, middle + half]])
        return np.kron(of_pair, np.eye(count))

    return mixture(scale, y, errors, np.repeat([-0.5, 0.5], count), ages, apart, noise_of, 2)
