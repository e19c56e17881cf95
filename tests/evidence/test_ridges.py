"""Modes divided along their longest axis, against densities whose integral is 1."""

import numpy as np
import pytest
from scipy import stats
from scipy.special import logsumexp

from pymc_hyperelastic.evidence.modes import modes_from
from pymc_hyperelastic.evidence.ridges import along_ridges
from pymc_hyperelastic.evidence.target import by_differences
from pymc_hyperelastic.evidence.weights import effective_sample_size

SEED = 7
WIDTH = np.array([2.0, 5.0, 2.0])
DRAWS = 4000
# Of draws that are effective: of a proposal that needs no adaptation, and of one that does.
GOOD, POOR = 0.4, 0.2


def normal(points):
    """Three correlated unknowns, one of them known far less than the others."""
    covariance = np.array([[1.0, 0.6, 0.0], [0.6, 0.5, 0.02], [0.0, 0.02, 0.01]])
    return stats.multivariate_normal([0.5, -1.0, 0.2], covariance).logpdf(points)


def bent(points):
    """Along the first unknown the second is bent, and the third less: to both sides."""
    x, y, z = points.T
    bend = stats.norm.logpdf(y, 0.8 * x**2, 0.1) + stats.norm.logpdf(z, -0.5 * x, 0.2)
    return stats.norm.logpdf(x) + bend


def skewed(sign):
    """Long to one side and sharp to the other, and bent as it goes."""

    def density(points):
        x, y, z = points.T
        bend = stats.norm.logpdf(y, np.tanh(x), 0.05) + stats.norm.logpdf(z, 0.1 * x**2, 0.05)
        return stats.gumbel_r.logpdf(sign * x) + bend

    return density


def two(points):
    """A bent ridge, and one beside it of which a quarter of all is."""
    parts = np.log(0.75) + bent(points), np.log(0.25) + bent(points - [0.0, -6.0, 4.0])
    return np.logaddexp(*parts)


def found(density, starts):
    """Modes of a density, and their mixture along the ridges."""

    def score(points):
        return density(points), np.zeros(len(points))

    def ascent(width):
        return by_differences(score, width)

    modes = modes_from(ascent, [starts], WIDTH)
    return modes, along_ridges(ascent, modes, WIDTH)


def effective(density, mixture):
    """Share of draws of a proposal that are effective, and their mean weight's logarithm."""
    points = mixture.draw(DRAWS, np.random.default_rng(SEED))
    log_weights = density(points) - mixture.log_density(points)
    mean = logsumexp(log_weights) - np.log(DRAWS)
    return effective_sample_size(log_weights) / DRAWS, mean


@pytest.mark.parametrize("density", [bent, skewed(1), skewed(-1)], ids=["bent", "right", "left"])
def test_a_row_follows_the_ridge(density):
    """The mode alone is a poor proposal; its row is a good one, and has the integral."""
    starts = np.random.default_rng(SEED).normal(0, 1, (4, 3))
    modes, row = found(density, starts)
    assert len(modes.log_masses) == 1
    share, mean = effective(density, row)
    assert effective(density, modes.mixture)[0] < POOR
    assert share > GOOD
    assert abs(mean) < 4 * np.sqrt((1 / share - 1) / DRAWS)


def test_a_normal_distribution_stays_what_it_is():
    """There the sum over the row is the density itself, up to how finely it is divided."""
    starts = np.random.default_rng(SEED).normal(0, 1, (4, 3))
    _, row = found(normal, starts)
    assert effective(normal, row)[0] > 0.999
    points = row.draw(DRAWS, np.random.default_rng(SEED))
    np.testing.assert_allclose(points.mean(axis=0), [0.5, -1.0, 0.2], atol=0.1)


def test_each_of_two_modes_has_a_row():
    """Rows share what the modes had: a quarter and three quarters."""
    starts = np.array([[0.1, 0.0, 0.0], [0.1, -6.0, 4.0]])
    modes, rows = found(two, starts)
    assert len(modes.log_masses) == 2
    beside = rows.means[:, 2] > 2
    np.testing.assert_allclose(np.exp(rows.log_weights[beside]).sum(), 0.25, atol=0.02)
    assert effective(two, rows)[0] > GOOD
