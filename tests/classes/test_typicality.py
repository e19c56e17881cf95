"""Whether a specimen could be one of a class at all."""

import numpy as np
import pytest
import xarray as xr
from scipy import stats
from variable_classes import NAMES, RADIUS, SEED, classify, curves, fit

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.classification import _decide
from pymc_hyperelastic.classes.typicality import either, misfit_p_value
from pymc_hyperelastic.models.specimen_draws import SpecimenDraws

# One in twenty of a class's own is turned away.
NONE_BELOW = 0.05
# Chance by which p-values that are uniform are taken for others.
CHANCE = 1e-3


@pytest.fixture(scope="module")
def classes():
    return fit()


def with_pressures(change):
    """A specimen in the middle of the first class, whose measured pressures are changed."""
    data = curves({"N": [38.0]}, 3).copy(deep=True)
    data["pressure"].values[:] = change(data["pressure"].values)
    return data


NOISE = np.random.default_rng(SEED).random(RADIUS.size)
# The class's moduli lie between 30 and 110 kPa.
STRANGE = {
    "hundred times too soft": lambda p: p / 100,
    "twentieth": lambda p: p / 20,
    "twenty times too stiff": lambda p: 20 * p,
    "falling": lambda p: p[::-1],
    "flat": lambda p: np.full_like(p, p.mean()),
    "random": lambda p: NOISE * p.max(),
    "offset": lambda p: p + 5,
    "mmHg as kPa": lambda p: p / ph.mmHg,
}


@pytest.mark.parametrize("name", STRANGE)
def test_strangers_are_none_of_these(classes, name):
    """Soft strangers as well as stiff ones, and curves that no wall follows."""
    result = classify(with_pressures(STRANGE[name]), classes, none_below=NONE_BELOW)
    assert result["decision"].item() == "none of these"
    assert float(result["p_value"].max()) < NONE_BELOW


@pytest.mark.filterwarnings("ignore:1 of 1 cannot be judged")
def test_what_is_strange_is_told(classes):
    """A soft wall is not typical, but its curves are fitted; falling pressures are not."""
    soft = classify(with_pressures(STRANGE["hundred times too soft"]), classes)
    assert float(soft["typical_p_value"].max()) < NONE_BELOW < float(soft["fit_p_value"].min())
    falling = classify(with_pressures(STRANGE["falling"]), classes)
    assert float(falling["fit_p_value"].max()) < NONE_BELOW


def test_a_misfit_that_the_class_has_too_is_no_stranger():
    """Misfits are held against the class's own, unless those are smaller than noise would have."""
    one = np.zeros(1)
    known = {"misfit": 40.0, "freedom": 10.0}
    draws = SpecimenDraws(
        one[None], one[None], one[None], one, 1, 0.0, one[None], one[None], **known
    )
    as_noise, as_badly = np.array([10.0] * 50), np.array([40.0] * 50)
    freedom = np.full(50, 10.0)
    assert misfit_p_value(draws, as_noise, freedom) < 1e-3
    assert misfit_p_value(draws, as_badly, freedom) == pytest.approx(0.5, abs=0.1)
    assert misfit_p_value(draws, as_noise / 4, freedom) == misfit_p_value(draws, as_noise, freedom)


def test_the_smaller_of_two_p_values_is_uniform_too():
    """Of independent ones; what is not known makes both unknown."""
    p = np.random.default_rng(SEED).random((2000, 2))
    both = [either(*pair) for pair in p]
    assert stats.kstest(both, "uniform").pvalue > CHANCE
    assert np.isnan(either(np.nan, 0.01)) and np.isnan(either(0.01, np.nan))


def decided(none_below=0.0, **changes):
    """Decision where the first class is the more probable one, with something changed."""
    values = {
        "log_evidence": [0.0, -5.0],
        "log_evidence_se": [0.01, 0.01],
        "class_probability": [0.99, 0.01],
        "pareto_k": [0.1, np.nan],
        "p_value": [0.5, 0.5],
    } | changes
    result = xr.Dataset(
        {name: (("specimen", "class_label"), [value]) for name, value in values.items()},
        {"class_label": list(NAMES)},
    )
    result["class_verdict"] = "class_label", ["good", "good"]
    return _decide(result, np.array([0.5, 0.5]), 0.0, none_below).item()


def test_what_cannot_be_judged_is_not_decided():
    """An evidence that might change the decision has to be known, and a p-value if one is asked."""
    assert decided() == decided(none_below=NONE_BELOW) == NAMES[0]
    assert decided(pareto_k=[1.2, 0.1]) == "cannot be judged"
    assert decided(pareto_k=[0.1, np.inf]) == "cannot be judged"
    assert decided(pareto_k=[0.1, np.inf], log_evidence=[0.0, -50.0]) == NAMES[0]
    assert decided(log_evidence_se=[np.inf, 0.1]) == "cannot be judged"
    assert decided(p_value=[np.nan, 0.5]) == NAMES[0]
    assert decided(p_value=[np.nan, 0.5], none_below=NONE_BELOW) == "cannot be judged"
    assert decided(p_value=[0.01, 0.02], none_below=NONE_BELOW) == "none of these"
    nothing = {"log_evidence": [np.nan] * 2, "class_probability": [np.nan] * 2}
    assert decided(**nothing, log_evidence_se=[np.nan, np.nan]) == ""
    assert decided(**nothing, log_evidence_se=[np.inf, np.inf]) == "cannot be judged"


# Moduli of specimens, and by what the second experiment on each differs from the first.
MODULI, APART = (30.0, 38.0, 50.0, 34.0, 44.0), (1.1, 0.92, 1.05, 0.9, 1.2)


@pytest.fixture(scope="module")
def differing():
    """Classes of specimens with two experiments each, which differ."""
    soft = {f"A{i}": [mu, mu * x] for i, (mu, x) in enumerate(zip(MODULI, APART, strict=True))}
    stiff = {f"B{i}": [2 * mu for mu in both] for i, both in enumerate(soft.values())}
    return fit(
        training={"soft": curves(soft, 1), "stiff": curves(stiff, 2)}, experiment_effect=True
    )


# Pressures below the noise tell only that a wall is soft, and of few specimens whose experiments
# differ it is not known how soft they may be.
SEEN = [name for name in STRANGE if name != "hundred times too soft"]


@pytest.mark.deep
@pytest.mark.parametrize("name", SEEN)
def test_strangers_are_found_where_experiments_differ(differing, name):
    """How far the tests are apart is asked only where the curves tell it."""
    data = curves({"N": [38.0, 36.0]}, 3).copy(deep=True)
    both = data["pressure"].values.reshape(2, -1)
    data["pressure"].values[:] = np.concatenate([STRANGE[name](p) for p in both])
    result = classify(data, differing, none_below=NONE_BELOW)
    assert result["decision"].item() == "none of these"


@pytest.mark.long
@pytest.mark.deep
@pytest.mark.filterwarnings("ignore:.* cannot be judged")
def test_p_values_are_uniform_where_experiments_differ(differing):
    """Of a hundred specimens that the fitted class brings forth, each tested twice."""
    rng = np.random.default_rng(SEED)
    posterior = differing["soft"]["posterior"].to_dataset().stack(sample=("chain", "draw"))
    posterior = posterior.isel(sample=rng.choice(posterior.sizes["sample"], size=100))
    location, spread, within = (
        posterior[name].values.ravel() for name in ("location", "spread", "experiment_spread")
    )
    within = within * np.exp(posterior["effect_spread"].values * rng.standard_normal(100))
    own = location + spread * rng.standard_normal(100)
    strain = np.exp(own + within * rng.standard_normal((2, 100)))
    moduli = 20.0 / (np.exp(2 * strain) - np.exp(-2 * strain))
    data = curves({f"N{i}": [*mu] for i, mu in enumerate(moduli.T)}, 5)
    result = classify(data, differing).sel(class_label="soft")
    # One in hundreds has experiments that are apart by orders of magnitude: it cannot be judged.
    judged = result.isel(specimen=np.isfinite(result["typical_p_value"].values))
    assert judged.sizes["specimen"] >= 98
    assert stats.kstest(judged["typical_p_value"].values, "uniform").pvalue > CHANCE
    assert np.mean(result["p_value"].values < NONE_BELOW) < 2 * NONE_BELOW


@pytest.mark.long
@pytest.mark.deep
@pytest.mark.filterwarnings("ignore:.* cannot be judged")
def test_p_values_of_the_class_itself_are_uniform(classes):
    """Of three hundred specimens that the fitted class brings forth."""
    rng = np.random.default_rng(SEED)
    posterior = classes["soft"]["posterior"].to_dataset().stack(sample=("chain", "draw"))
    chosen = rng.choice(posterior.sizes["sample"], size=300)
    location = posterior["location"].values.ravel()[chosen]
    spread = posterior["spread"].values.ravel()[chosen]
    strain = np.exp(location + spread * rng.standard_normal(300))
    # The reference strain is that at which the wall's stress, e^(2e) - e^(-2e) moduli, is 20 kPa.
    moduli = 20.0 / (np.exp(2 * strain) - np.exp(-2 * strain))
    data = curves({f"N{i}": [mu] for i, mu in enumerate(moduli)}, 5)
    result = classify(data, classes).sel(class_label="soft")
    assert stats.kstest(result["typical_p_value"].values, "uniform").pvalue > CHANCE
    # The misfits of its three specimens are what they are, and make those of others look smaller.
    for name in ("p_value", "fit_p_value"):
        assert np.mean(result[name].values < NONE_BELOW) < 2 * NONE_BELOW, name
