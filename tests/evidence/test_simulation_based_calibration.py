"""simulation_based_calibration of models with known posteriors."""

import json

import numpy as np
import pymc as pm
import pytest
import xarray as xr
from agreement import ROUNDING
from interrupts import interrupt
from scipy.stats import chi2, norm
from tiers import deep

import pymc_hyperelastic as ph
from pymc_hyperelastic.evidence.calibration import _number_of_bins, _rank, _uniformity

SEED = 20260
# A right model has a p-value below the first number for one seed in a hundred; a wrong model must
# have a p-value below the second number.
MAY_FAIL, MUST_FAIL = 0.01, 1e-6
POINTS = 20
# One unknown needs no search for a reference, which takes most of the time.
FROM_PRIOR = {"from_modes": False}


def conjugate(scale=1.0, shift=0.0):
    """Return a model of a normal mean, measured at a few points."""
    with pm.Model() as model:
        mean = pm.Normal("mean", 0, 1)
        pm.Normal("y", mean + shift, scale, observed=np.zeros(POINTS))
    return model


def calibrate(model, simulations=4, **settings):
    settings = {"draws": 200, "random_seed": SEED, "progressbar": False} | settings
    return ph.simulation_based_calibration(model, simulations=simulations, **settings)


@pytest.mark.parametrize(
    ("simulated", "fitted", "simulations"),
    [(2.5, 1.0, 100), *deep([(1.0, 1.0, 200), (1.0, 1.5, 600)])],
)
def test_only_a_wrong_standard_deviation_has_a_small_p_value(simulated, fitted, simulations):
    """Posteriors that are too wide are harder to detect than posteriors that are too narrow."""
    sbc = calibrate(conjugate(fitted), simulations, simulator=conjugate(simulated), **FROM_PRIOR)
    assert sbc.attrs["bins"] == min(simulations // 10, 20)
    assert sbc["rank"].min() >= 0 and sbc["rank"].max() <= 99
    if simulated == fitted:
        assert sbc["p_value"].item() > MAY_FAIL
        return
    assert sbc["p_value"].item() < MUST_FAIL
    at_the_ends = np.isin(sbc["rank"].values // 10, (0, 9)).mean()
    # 0.2 for a right model. A posterior 2.5 times too narrow: 2 Φ(-1.28/2.5) = 0.61, and four
    # standard errors of 100 simulations are 0.2.
    assert at_the_ends > 0.4 if simulated > fitted else at_the_ends < 0.15


def test_ranks_agree_with_the_exact_posterior():
    """At a truth with the posterior CDF ``u``, the rank among 99 draws is binomial (99, u).

    The simulator has no noise: all points lie 0.1 above the mean ``m``, and the posterior is
    normal with the mean ``20 (m + 0.1)/21`` and the variance 1/21.
    """
    sbc = calibrate(conjugate(), 100, simulator=conjugate(1e-9, shift=0.1), draws=500, **FROM_PRIOR)
    truth, rank = sbc["truth"].values[:, 0], sbc["rank"].values[:, 0]
    mean, sd = POINTS / (POINTS + 1) * (truth + 0.1), (POINTS + 1) ** -0.5
    u = norm.cdf(truth, mean, sd)
    scores = (rank - 99 * u) / np.sqrt(99 * u * (1 - u))
    # The particles are a sample of about 500 draws themselves, which adds to the variance.
    assert chi2.sf(np.sum(scores**2) / (1 + 99 / 500), len(u)) > MAY_FAIL
    assert abs(scores.mean()) < 4 * (1 + 99 / 500) / np.sqrt(len(u))
    # Standard errors of 500 particles: 4 % of the sd for the mean, and 3 % for the sd.
    np.testing.assert_allclose(sbc["posterior_mean"].values[:, 0], mean, atol=0.25 * sd)
    np.testing.assert_allclose(sbc["posterior_sd"].values, sd, rtol=0.2)


def line():
    """Return a model with named vectors, data, a deterministic and two observed variables."""
    with pm.Model(coords={"end": ["a", "b"]}) as model:
        x = pm.Data("x", np.linspace(0, 1, 4))
        ends = pm.Normal("ends", 0, 1, dims="end")
        rates = pm.Gamma("rates", 2, 2, shape=(1, 2))
        pm.Deterministic("middle", ends.mean())
        pm.Normal("y", ends[0] * (1 - x) + ends[1] * x, 0.1, observed=pm.Data("y_data", np.ones(4)))
        pm.Poisson("counted", 5 * rates, observed=[[3, 4]])
    return model


def test_each_entry_of_each_variable_is_ranked():
    """`var_names` adds deterministics; the model keeps its data."""
    model = line()
    sbc = calibrate(model, draws=100, var_names=["middle", "ends", "rates"], **FROM_PRIOR)
    labels = ["middle", "ends[a]", "ends[b]", "rates[0, 0]", "rates[0, 1]"]
    assert sbc["parameter"].values.tolist() == labels
    assert sbc["variable"].values.tolist() == ["middle", "ends", "ends", "rates", "rates"]
    assert dict(sbc["rank"].sizes) == {"simulation": 4, "parameter": 5}
    assert sbc["p_value"].isnull().all()  # fewer than ten simulations for each of two bins
    ends = sbc["truth"].sel(parameter=["ends[a]", "ends[b]"])
    np.testing.assert_allclose(sbc["truth"].sel(parameter="middle"), ends.mean("parameter"))
    assert model["y_data"].get_value().tolist() == [1, 1, 1, 1]


def test_recorded_seed_repeats_the_result():
    unseeded = calibrate(conjugate(), random_seed=None, **FROM_PRIOR)
    seed = json.loads(unseeded.attrs["random_seed"])
    xr.testing.assert_identical(calibrate(conjugate(), random_seed=seed, **FROM_PRIOR), unseeded)


def test_interrupt_keeps_complete_simulations(monkeypatch):
    """An interrupt of the first simulation is raised."""
    whole = calibrate(conjugate(), 12, draws=100, **FROM_PRIOR)
    with monkeypatch.context() as patch:
        interrupt(patch, ph.BatchedSMC, "temper", 12)
        with pytest.warns(UserWarning, match="interrupted: 11 of 12 simulations"):
            kept = calibrate(conjugate(), 12, draws=100, **FROM_PRIOR)
    xr.testing.assert_identical(kept, whole.isel(simulation=slice(11)))
    interrupt(monkeypatch, ph.BatchedSMC, "temper", 1)
    with pytest.raises(KeyboardInterrupt):
        calibrate(conjugate(), **FROM_PRIOR)


def test_ties_are_broken_at_random():
    """One of three draws is smaller and one is equal: the rank is 1 or 2 with equal chance."""
    rng = np.random.default_rng(SEED)
    posterior = np.array([[0.0], [1.0], [2.0]])
    ranks = np.array([_rank(np.array([1.0]), posterior, rng)[0] for _ in range(400)])
    assert set(ranks) == {1, 2}
    assert abs(np.mean(ranks == 1) - 0.5) < 4 * 0.5 / 20  # four standard errors


@pytest.mark.parametrize(
    ("simulations", "ranked_draws", "bins"),
    [(199, 99, 10), (19, 99, 1), (20, 99, 2), (300, 100, 1), (5000, 99, 20)],
)
def test_number_of_bins_gives_equal_widths_and_ten_ranks_on_average(
    simulations, ranked_draws, bins
):
    assert _number_of_bins(simulations, ranked_draws) == bins


def test_p_value_equals_pearsons_chi_squared_test():
    """Counts of 30 and 10 instead of 20 each: a chi-square of 10 with one degree of freedom."""
    rank = np.repeat([1, 2], [30, 10])[:, None]
    assert _uniformity(rank, 2, 3) == pytest.approx([chi2.sf(10, 1)], rel=ROUNDING)
    assert np.isnan(_uniformity(rank, 1, 3)).all()


def unlike(**changes):
    """Return a model that differs from the conjugate one."""
    with pm.Model() as model:
        mean = pm.Normal(changes.get("parameter", "mean"), 0, 1)
        if changes.get("discrete"):
            mean += pm.Poisson("events", 1)
        pm.Deterministic("root", mean**0.5)
        if "potential" in changes:
            pm.Potential("soft", -(mean**2))
        if changes.get("data", True):
            mu = np.inf * mean if changes.get("infinite") else mean
            pm.Normal("y", mu, 1, observed=np.zeros(changes.get("points", POINTS)))
    return model


@pytest.mark.parametrize(
    ("model", "settings", "message"),
    [
        (3, {}, "the model must be a pm.Model, not int"),
        (unlike(potential=True, data=False), {}, r"has the Potentials \['soft'\]"),
        (unlike(potential=True), {}, r"the model has the Potentials \['soft'\].*observed=True"),
        (conjugate(), {"simulator": unlike(parameter="mu")}, r"no variables \['mean'\]"),
        (conjugate(), {"simulator": unlike(points=3)}, r"shape \(3,\), the model's \(20,\)"),
        (unlike(discrete=True), {}, r"discrete: \['events'\]"),
        (unlike(infinite=True), {}, "4 of 4 simulations have a 'y' .* simulation 0, at mean = "),
        (unlike(), {"simulations": 30, "var_names": ["root"]}, "of 30 simulations have a 'root'"),
        (conjugate(), {"var_names": ["nu"]}, r"no variables \['nu'\]; it has \['mean'\]"),
        (conjugate(), {"var_names": []}, "var_names is empty"),
        (conjugate(), {"var_names": "mean"}, "a list of names"),
        (conjugate(), {"simulations": 1}, "simulations is 1; expected at least 2"),
        (conjugate(), {"draws": 50}, "draws is 50; expected at least 99"),
        (conjugate(), {"ranked_draws": 0}, "ranked_draws is 0"),
    ],
)
def test_wrong_input_of_calibration_is_refused(model, settings, message):
    with pytest.raises((TypeError, ValueError), match=message), np.errstate(invalid="ignore"):
        calibrate(model, **settings)


def test_errors_during_a_fit_name_the_simulation():
    """The data may be impossible for the model, or a deterministic may not be finite."""
    with pm.Model() as model:
        pm.Uniform("y", 0, pm.Uniform("mean", 0, 1), observed=np.zeros(POINTS))
    with pytest.raises(ValueError, match=r"simulation 0: none of \d+ draws of the prior"):
        calibrate(model, simulator=conjugate())
    with pm.Model() as simulator:
        mean = pm.HalfNormal("mean", 1e-3)
        pm.Deterministic("root", mean**0.5)
        pm.Normal("y", mean, 1, observed=np.zeros(POINTS))
    with pytest.raises(ValueError, match="simulation 0: the posterior has draws that are not fin"):
        calibrate(unlike(), simulator=simulator, var_names=["root"])
