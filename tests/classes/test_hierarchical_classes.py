"""Classes whose specimens differ: evidence, posterior and predictions, against sums over grids."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
import variable_classes
import xarray as xr
from scipy import stats
from scipy.special import logsumexp, softmax
from variable_classes import GRID, NAMES, PRESSURE_SD, SEED, SIGMA, TRAINING, classify, curves, fit

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes import hierarchical
from pymc_hyperelastic.classes.kinds import kind_of_classes
from pymc_hyperelastic.evidence.importance import LARGEST_PARETO_K

# A correct standard error is exceeded threefold once in 370 runs; seeds are fixed.
STANDARD_ERRORS = 3
# Nats.
EVIDENCE_TOLERANCE = 0.1
# Grids of the location and of the logarithm of the spread, where the density is relevant.
LOCATION = np.linspace(np.log(0.2) - 4.0, np.log(0.2) + 3.0, 141)
LOG_SPREAD = np.linspace(np.log(0.4) - 4.0, np.log(0.4) + 4.0, 121)


@pytest.fixture(scope="module")
def new_data():
    """A specimen of each class, the second with two tests."""
    return curves({"N1": [42.0], "N2": [90.0, 90.0]}, 3)


@pytest.fixture(scope="module")
def by_specimen(classes, new_data):
    return classify(new_data, classes)


def log_marginals(data):
    """Log likelihood of each specimen by location and spread, its coordinate integrated out."""
    tests, names, tables = variable_classes.log_likelihoods(data), data["specimen"].values, {}
    for name in dict.fromkeys(names.tolist()):
        values = tests[names == name].sum(axis=0)
        seen, peak = values > values.max() - variable_classes.NEGLIGIBLE, values.max()
        weight = np.exp(values[seen] - peak) * variable_classes.STEP
        spread = np.exp(LOG_SPREAD)[:, None]
        rows = [stats.norm.pdf((GRID[seen] - m) / spread) @ weight / spread[:, 0] for m in LOCATION]
        with np.errstate(divide="ignore"):
            tables[name] = np.log(rows) + peak
    return tables


@pytest.fixture(scope="module")
def exact():
    """Joint density of each class and its specimens by location and spread, times the cell."""
    prior = stats.norm(np.log(0.2), 0.7).logpdf(LOCATION)[:, None]
    prior = prior + stats.norm(np.log(0.4), 0.7).logpdf(LOG_SPREAD)
    prior += np.log((LOCATION[1] - LOCATION[0]) * (LOG_SPREAD[1] - LOG_SPREAD[0]))
    return {name: prior + sum(log_marginals(data).values()) for name, data in TRAINING.items()}


@pytest.mark.parametrize("name", NAMES)
def test_evidence_and_posterior_of_a_class_equal_sums_over_grids(classes, exact, name):
    """Over location, spread and the coordinate of every specimen, each on a fine grid."""
    for group, dim in (("evidence", "chain"), ("specimens", "specimen")):
        method, shape = (classes[name][group][v] for v in ("method", "pareto_k"))
        assert method.dims == shape.dims == (dim,) and set(method.values) == {"importance"}
        assert np.all(shape < LARGEST_PARETO_K)
    value, error = ph.log_evidence(classes[name])
    assert error < EVIDENCE_TOLERANCE
    assert abs(value - logsumexp(exact[name])) < STANDARD_ERRORS * error
    density, posterior = softmax(exact[name]), classes[name]["posterior"]
    location, spread = (posterior[name].values.ravel() for name in ("location", "spread"))
    for draws, grid, axis in ((location, LOCATION, 1), (np.log(spread), LOG_SPREAD, 0)):
        marginal = density.sum(axis=axis)
        mean = marginal @ grid
        sd = np.sqrt(marginal @ (grid - mean) ** 2)
        # A thousand draws know a mean to 3 % of the sd.
        assert abs(draws.mean() - mean) < 0.15 * sd
        np.testing.assert_allclose(draws.std(), sd, rtol=0.15)
    # New specimens: the stress of a neo-Hookean solid at the hoop strain e is 2 mu sinh(2e).
    kind = kind_of_classes(classes)
    drawn = kind.new_specimens(classes[name], np.random.default_rng(SEED))["mu"]
    found = np.log(np.arcsinh(variable_classes.STRESS / (2 * drawn)) / 2)
    variance = location.var() + (spread**2).mean()
    assert abs(found.mean() - location.mean()) < 4 * np.sqrt(variance / len(drawn))
    # The variance of a thousand draws is known to 10 %, since spreads differ.
    np.testing.assert_allclose(found.var(), variance, rtol=0.3)


def test_evidence_of_a_new_specimen_is_the_ratio_of_two_integrals(by_specimen, exact, new_data):
    """The integrals are taken with and without the specimen; its tests share one material."""
    tables = log_marginals(new_data)
    assert by_specimen["specimen"].values.tolist() == ["N1", "N2"]
    assert by_specimen["decision"].values.tolist() == ["soft", "stiff"]
    assert np.all(by_specimen["pareto_k"] < LARGEST_PARETO_K)
    for row, specimen in enumerate(("N1", "N2")):
        for column, name in enumerate(NAMES):
            truth = logsumexp(exact[name] + tables[specimen]) - logsumexp(exact[name])
            value = by_specimen["log_evidence"].values[row, column]
            error = by_specimen["log_evidence_se"].values[row, column]
            assert error < EVIDENCE_TOLERANCE
            assert abs(value - truth) < STANDARD_ERRORS * error


def test_specimen_with_few_draws_near_a_class_is_sampled_again_near_it(classes, by_specimen):
    """Its first draws are so wide that the evidence from them cannot be trusted."""
    kind, data = kind_of_classes(classes), curves({"N1": [42.0]}, 3)
    rng = np.random.default_rng(SEED)
    predictive = hierarchical.SpecimenPredictive(kind, classes.children, kind.sampler(data))
    wide = replace(variable_classes.known_specimen(rng, -1.9, 60.0), standard_error=np.inf)
    found = predictive(data, rng, wide)
    for i, prediction in enumerate(found):
        value, error = prediction.log_evidence
        expected, other = (by_specimen[n].values[0, i] for n in ("log_evidence", "log_evidence_se"))
        assert prediction.pareto_k < LARGEST_PARETO_K and prediction.own_error == error
        assert abs(value - expected) < STANDARD_ERRORS * np.hypot(error, other)


@pytest.mark.filterwarnings("ignore:class .* evidence")
def test_same_seed_gives_the_same_result_and_full_progress_bar(classes, by_specimen, monkeypatch):
    """The likelihood states `sigma` or the equal standard deviation; another seed differs."""

    class Bar(nullcontext):
        total, done = 0, 0

        def add_task(self, description, completed, total):
            self.total += total

        def advance(self, task, advance=1):
            self.done += advance

    bar = Bar()
    monkeypatch.setattr(hierarchical, "create_simple_progress", lambda wanted: bar)
    few = {"training": {"soft": TRAINING["soft"]}, "draws": 100, "chains": 2}
    of_sigma = ph.SlopeAugmented(SIGMA, slope_weight=0.0)
    one, two = (fit(**few, likelihood=form)["soft"] for form in (PRESSURE_SD, of_sigma))
    # Three specimens, a first fit and two chains.
    assert bar.done == bar.total == 2 * 6
    assert "a standard deviation of 0.353553 kPa" in two.attrs["likelihood_in_words"]
    for group in ("posterior", "evidence", "specimens"):
        xr.testing.assert_equal(one[group].to_dataset(), two[group].to_dataset())
    settings = {"random_seed": SEED + 1, "undecided_below": 0.999}
    other = classify(curves({"N1": [42.0]}, 3), classes, **settings)
    assert other["decision"].item() == "undecided" and other.attrs["undecided_below"] == 0.999
    assert not np.array_equal(other["log_evidence"], by_specimen["log_evidence"][:1])
