"""Planned studies of classes of known distributions."""

from dataclasses import replace

import numpy as np
import pymc as pm
import pytest
import xarray as xr
from scipy import stats
from variable_classes import fit, known_specimen, with_distribution

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.hierarchical import HierarchicalClass
from pymc_hyperelastic.design.study_size import (
    _error,
    _found,
    _Known,
    _Pilot,
    _result,
    _scores,
    _studied,
)
from pymc_hyperelastic.models.class_distribution import distributions_of

SEED = 915
X = "log_reference_strain"


def plan(pilot, quantity=X, specimens=(4, 12), **settings):
    settings = {"studies": 200, "random_seed": SEED} | settings
    return ph.plan_study(pilot, quantity, specimens, **settings)


def test_measurement_error_of_a_specimen_excludes_the_spread_of_its_class(classes):
    """The error follows from the curves alone; differences between experiments add to it."""
    rng, error, fitted = np.random.default_rng(SEED), 0.6, classes["stiff"]
    draws, distributions = known_specimen(rng, -1.8, error, 20_000), distributions_of(fitted)
    assert _error(draws, distributions)[0, 0] == pytest.approx(error**2, rel=0.1)
    spread = np.full_like(np.asarray(distributions.spread), 0.3)
    effect = np.zeros((1, *spread.shape[1:]))
    differing = replace(distributions, experiment_spread=spread, effect_spread=effect)
    more = _error(replace(draws, tests=2), differing) - _error(draws, distributions)
    assert more[0, 0] == pytest.approx(0.3**2 / 2)


def pilot_of(location=(-0.5, 0.5), spread=(0.3, 0.6), error=0.5, studies=200):
    """Return the true values of equal studies of two groups with one coordinate."""
    location = np.broadcast_to(np.array(location)[:, None, None], (2, studies, 1))
    covariance = np.broadcast_to(np.square(spread)[:, None, None, None], (2, studies, 1, 1))
    return _Pilot(location, covariance, np.full((1, 1, 1), error**2))


def test_log_scores_of_new_specimens_equal_quadrature():
    """New specimens are measured with errors; the classes are known exactly."""
    pilot, wider = pilot_of(), np.array([2.0])
    scale = (pilot.covariance + pilot.errors) / wider
    known = _Known(pilot.location[:, None], scale[:, None], wider, np.array([1e9]))
    found = _scores(pilot, known, 20, np.random.default_rng(SEED))
    x = np.linspace(-6, 6, 4001)
    p = np.array([stats.norm.pdf(x, m, np.hypot(s, 0.5)) for m, s in ((-0.5, 0.3), (0.5, 0.6))])
    expected = np.sum(p * np.log(p / p.sum(axis=0))) * (x[1] - x[0]) / 2
    limit = 4 * found["log_score_se"].item()
    assert limit < 0.1
    for name in ("log_score", "best_log_score"):
        assert abs(found[name].item() - expected) < limit


def test_posterior_of_a_simulated_study_is_the_conjugate_posterior():
    """One coordinate, by sums over the location and the variance of specimens and errors."""
    kind = HierarchicalClass.of_settings(ph.NeoHookean(), 1.0)
    (mean,), (sd,) = kind.scale.location_prior
    (log_spread,), sd_of_log = kind.scale.spread_prior
    pilot = pilot_of((mean - 0.2, mean + 0.2), error=0.1, studies=3)
    known = _studied(kind, pilot, [3, 8], np.random.default_rng(SEED))
    x = _found(pilot, 8, np.random.default_rng(SEED))[0][0, 1, :3, 0]
    freedom = known.freedom[0] - 3
    scatter = freedom * (np.exp(2 * log_spread) + 0.1**2)
    m, variance = np.linspace(mean - 6, mean + 6, 6001), np.geomspace(1e-4, 1e5, 2000)[:, None]
    log_p = stats.invgamma.logpdf(variance, freedom / 2, scale=scatter / 2) + np.log(variance)
    weight = np.exp(2 * log_spread) / sd**2
    log_p = log_p + stats.norm.logpdf(m, mean, np.sqrt(variance / weight))
    log_p = log_p + sum(stats.norm.logpdf(value, m, np.sqrt(variance)) for value in x)
    density = np.exp(log_p - log_p.max()).sum(axis=0)
    cumulative = (np.cumsum(density) - density / 2) / density.sum()
    of_study = known.freedom[0], known.mean[0, 0, 1, 0], np.sqrt(known.scale[0, 0, 1, 0, 0])
    location = stats.t(*of_study)
    # The density of the logarithm of the spread has the curvature of the class's at its mode.
    log_spreads = np.log(scatter / freedom) / 2 + np.array([-1e-3, 0.0, 1e-3])
    prior = stats.invgamma.logpdf(np.exp(2 * log_spreads), freedom / 2, scale=scatter / 2)
    curvature = np.diff(prior + 2 * log_spreads, 2) / 1e-6
    assert curvature == pytest.approx(-(sd_of_log**-2), rel=1e-3)
    np.testing.assert_allclose(location.cdf(m), cumulative, atol=1e-4)


def test_intervals_of_simulated_studies_cover_the_truth(classes):
    found = plan(classes, [X, "log mu"], draws=100).squeeze("comparison")
    # Three binomial standard errors, and the error of quantiles of 100 draws.
    assert (abs(found["covered"] - 0.95) < 3 * np.sqrt(0.95 * 0.05 / 200) + 0.01).all()
    few, many = (found.sel(specimens=n) for n in (4, 12))
    assert (few["width"] > 1.3 * many["width"]).all()
    assert (few["decided"] < many["decided"]).all()
    assert few["log_score"] < many["log_score"] < found["best_log_score"] + 0.01
    assert (found["wrong"] < 0.025).all()
    # The same seed gives the same plan.
    once, again = (plan(classes, studies=10, draws=50) for _ in range(2))
    xr.testing.assert_identical(once, again)


def test_width_with_many_specimens_equals_the_difference_of_two_means(classes):
    places = {"soft": (-1.5, 0.25), "stiff": (-2.0, 0.4)}
    pilot = with_distribution(classes, places)
    found = plan(pilot, specimens=200, studies=40, relevant=0.3, draws=100).squeeze()
    width = 2 * stats.norm.ppf(0.975) * np.sqrt((0.25**2 + 0.4**2) / 200)
    # Widths by quantiles of 100 draws are known to 15 %, their median over 40 studies to 3 %.
    assert found["width"].item() == pytest.approx(width, rel=0.08)
    np.testing.assert_allclose(found["truth"], -0.5)
    middles = found["study_difference"]
    assert abs(middles.mean() + 0.5) < 4 * middles.std() / np.sqrt(40)
    # The relative standard error of an sd of 40 studies is 1/sqrt(80), or 11 %.
    assert middles.std() == pytest.approx(width / (2 * 1.96), rel=0.4)
    assert found["decided"] == 1 and found["wrong"] == 0


def test_few_draws_do_not_narrow_intervals():
    """The median width over 4000 studies with 200 draws each has a standard error of 0.1 %."""
    draws = np.random.default_rng(SEED).standard_normal((1, 1, 1, 4000, 200))
    width = _result(np.zeros((1, 1, 4000)), draws, 0.0, 0.95)["width"].item()
    # Linear interpolation between draws gives 2.6 % less.
    assert width == pytest.approx(2 * stats.norm.ppf(0.975), rel=0.008)


# Intervals of five studies, each from two draws, and their true differences.
ENDS = np.array([[2, 4], [0.5, 3], [-3, -2], [1.5, 2], [-0.5, 0.5]], float)
TRUTH = np.array([3.0, 1.0, 1.0, -1.0, 0.6])


def test_decisions_of_studies_equal_values_computed_by_hand():
    """Differences of 1 or more are relevant."""
    found = _result(TRUTH[None, None], ENDS[None, None, None], 1.0, 1 - 1e-9).squeeze()
    assert found["study_width"].values == pytest.approx([2, 2.5, 1, 0.5, 1], rel=1e-6)
    assert found["study_difference"].values == pytest.approx([3, 1.75, -2.5, 1.75, 0])
    assert found["decided"].item() == pytest.approx(3 / 5)
    assert found["wrong"].item() == pytest.approx(2 / 5)
    assert found["covered"].item() == pytest.approx(2 / 5)
    for name in ("decided_se", "wrong_se", "covered_se"):  # of shares of 3/5 or 2/5
        assert found[name].item() == pytest.approx(np.sqrt(0.6 * 0.4 / 5))
    assert found["width"].item() == pytest.approx(1, rel=1e-6)
    half = 0.5 / np.sqrt(5)
    error = np.diff(np.quantile([0.5, 1, 1, 2, 2.5], [0.5 - half, 0.5 + half]))[0] / 2
    assert found["width_se"].item() == pytest.approx(error, rel=1e-6)
    assert found["width_interval"].values == pytest.approx([0.5, 2.5], rel=1e-6)


def test_studies_without_the_quantity_are_left_out():
    """The material of a typical specimen may not reach the pressure: one truth, one estimate."""
    ends = np.concatenate([ENDS, [[2, 4], [np.nan, np.nan]]])
    truth = np.concatenate([TRUTH, [np.nan, 3.0]])
    found, expected = (
        _result(true[None, None], of[None, None, None], 1.0, 1 - 1e-9).squeeze()
        for true, of in ((truth, ends), (TRUTH, ENDS))
    )
    for name in ("decided", "wrong", "covered"):
        assert found[name].item() == pytest.approx(expected[name].item())
        assert found[f"{name}_se"].item() == pytest.approx(expected[f"{name}_se"].item())


def test_wrong_settings_and_pilots_are_refused(classes):
    for settings, message in (
        ({"quantity": "strength"}, "no quantity is called 'strength'"),
        ({"quantity": "compliance", "at": [1, 2]}, r"pressures \[1.0, 2.0\]; expected one"),
        ({"specimens": (1, 4)}, r"whole numbers, each 2 or more; got \(1, 4\)"),
        ({"relevant": -1.0}, "relevant is -1.0; expected a difference, 0 or more"),
        ({"studies": 2}, "studies is 2; expected at least 10"),
    ):
        with pytest.raises(ValueError, match=message):
            plan(classes, **settings)
    with pytest.raises(TypeError, match=r"expected the DataTree of ph.fit_classes, not list"):
        plan([classes])
    own = {"spread": pm.LogNormal.dist(-1.0, 0.5, shape=1)}
    with pytest.raises(ValueError, match=r"user-defined priors, of \['spread'\]"):
        plan(fit(priors=own, draws=100, chains=1))
