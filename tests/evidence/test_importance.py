"""Importance sampling from a mixture: as many draws as may be, and a second adaptation."""

import numpy as np
import pytest
from scipy import stats

from pymc_hyperelastic.evidence import importance
from pymc_hyperelastic.evidence.importance import by_importance
from pymc_hyperelastic.evidence.mixture import GaussianMixture

SEED = 911
STANDARD_ERRORS = 4
# Prior and likelihood are normal distributions: their integral is a density of the difference.
SPREAD, PLACE = 0.1, np.array([1.0, -0.5])
EXACT = stats.multivariate_normal(np.zeros(2), (1 + SPREAD**2) * np.eye(2)).logpdf(PLACE)


def score(points):
    prior = stats.norm.logpdf(points).sum(axis=1)
    return prior, stats.norm.logpdf(points, PLACE, SPREAD).sum(axis=1)


def draw_prior(count, rng):
    return rng.standard_normal((count, 2))


def integral(**settings):
    rng = np.random.default_rng(SEED)
    like = GaussianMixture.fit(draw_prior(2000, rng), 1, rng)
    return by_importance(score, like, 500, rng, draw_prior, **settings)


@pytest.mark.parametrize("first_draws", [4000, 100_000])
def test_any_number_of_first_draws(first_draws):
    found = integral(first_draws=first_draws)
    value, error = found.log_value
    assert abs(value - EXACT) < STANDARD_ERRORS * error
    assert found.trusted and len(found.particles) == 500


def test_adapted_once_more(monkeypatch):
    """Where all draws of the first mixture are not enough; all of them count."""
    adapted, drawn = [], []
    adapt, mean_weight = importance.adapted_mixture, importance.mean_weight

    def adapt_again(*args):
        adapted.append(adapt(*args))
        return adapted[-1]

    def as_if_unknown(log_weights):
        drawn.append(len(log_weights))
        value, pareto_k = mean_weight(log_weights)
        return value, pareto_k if len(adapted) > 1 else 0.8

    monkeypatch.setattr(importance, "adapted_mixture", adapt_again)
    monkeypatch.setattr(importance, "mean_weight", as_if_unknown)
    found = integral()
    assert len(adapted) == 2
    assert drawn == [8000, 24_000, 56_000, 120_000, 128_000]
    assert abs(found.log_value.value - EXACT) < STANDARD_ERRORS * found.log_value.standard_error
