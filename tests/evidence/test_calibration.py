"""Simulation-based calibration of models of which the posterior is known."""

import json

import numpy as np
import pymc as pm
import pytensor
import pytest
import xarray as xr
from scipy.stats import chi2, norm

import pymc_hyperelastic as ph
from pymc_hyperelastic.evidence.calibration import _number_of_bins, _rank, _uniformity

SEED = 20260  # any would do
# What is right is rejected by one seed in a hundred; what is wrong by 1.5 by hardly any is kept.
PASSES, FAILS = 0.01, 1e-6
# Sums and logarithms of a few numbers of order one.
ROUNDING = 1e-12
POINTS = 20


def conjugate(scale=1.0, shift=0.0):
    """A normal mean from a few points: the posterior is known."""
    with pm.Model() as model:
        mean = pm.Normal("mean", 0, 1)
        pm.Normal("y", mean + shift, scale, observed=np.zeros(POINTS))
    return model


def calibrate(model, simulations=4, **settings):
    settings = {"draws": 200, "random_seed": SEED, "progressbar": False} | settings
    return ph.simulation_based_calibration(model, simulations=simulations, **settings)


# Particles of one unknown need no reference, for which each simulation would be searched.
FROM_PRIOR = {"from_modes": False}


@pytest.fixture(scope="module")
def right():
    return calibrate(conjugate(), 300, draws=500, **FROM_PRIOR)


def test_right_model_passes(right):
    """The posterior of a right model is neither too wide nor too narrow nor biased."""
    assert right["p_value"].item() > PASSES
    assert right.attrs["bins"] == 20
    assert right["rank"].min() >= 0 and right["rank"].max() <= 99


@pytest.mark.parametrize(
    ("simulated", "fitted", "simulations"),
    [(1.5, 1.0, 300), pytest.param(1.0, 1.5, 600, marks=pytest.mark.deep)],
)
def test_wrong_noise_fails(simulated, fitted, simulations):
    """A standard deviation that is wrong by a factor of 1.5 is found out, on either side.

    Posteriors that are too wide are harder to see: it takes more simulations.
    """
    sbc = calibrate(conjugate(fitted), simulations, simulator=conjugate(simulated), **FROM_PRIOR)
    assert sbc["p_value"].item() < FAILS
    ends = np.isin(sbc["rank"].values // 10, (0, 9)).mean()
    assert ends > 0.25 if simulated > fitted else ends < 0.15  # a fifth is due


def test_ranks_are_those_of_the_exact_posterior():
    """At a truth with the posterior CDF ``u``, the rank of 99 draws is binomial with mean 99 u.

    The simulator has no noise: all points lie 0.1 above the mean ``m``, and the posterior is
    normal with the mean ``20 (m + 0.1)/21`` and the variance 1/21.
    """
    sbc = calibrate(conjugate(), 100, simulator=conjugate(1e-9, shift=0.1), draws=500)
    truth, rank = sbc["truth"].values[:, 0], sbc["rank"].values[:, 0]
    mean, sd = POINTS / (POINTS + 1) * (truth + 0.1), (POINTS + 1) ** -0.5
    u = norm.cdf(truth, mean, sd)
    scores = (rank - 99 * u) / np.sqrt(99 * u * (1 - u))
    # Ranks vary a little more, for the particles stand for the posterior as 500 draws would.
    assert chi2.sf(np.sum(scores**2) / (1 + 99 / 500), len(u)) > PASSES
    assert abs(scores.mean()) < 4 * (1 + 99 / 500) / np.sqrt(len(u))
    # Of 500 particles: a standard error of 4 % of the posterior's width, and 3 % of the width.
    np.testing.assert_allclose(sbc["posterior_mean"].values[:, 0], mean, atol=0.25 * sd)
    np.testing.assert_allclose(sbc["posterior_sd"].values, sd, rtol=0.2)


def line():
    """Vectors with names, data in the model, a deterministic, two observed variables."""
    with pm.Model(coords={"end": ["a", "b"]}) as model:
        x = pm.Data("x", np.linspace(0, 1, 4))
        ends = pm.Normal("ends", 0, 1, dims="end")
        rates = pm.Gamma("rates", 2, 2, shape=(1, 2))
        pm.Deterministic("middle", ends.mean())
        pm.Normal("y", ends[0] * (1 - x) + ends[1] * x, 0.1, observed=pm.Data("y_data", np.ones(4)))
        pm.Poisson("counted", 5 * rates, observed=[[3, 4]])
    return model


def test_entries_have_names(tmp_path):
    """Each entry of each free variable has a rank of its own, and the result can be stored."""
    model = line()
    sbc = calibrate(model)
    assert sbc["parameter"].values.tolist() == [
        "ends[a]",
        "ends[b]",
        "rates[0, 0]",
        "rates[0, 1]",
    ]
    assert sbc["variable"].values.tolist() == ["ends", "ends", "rates", "rates"]
    assert dict(sbc["rank"].sizes) == {"simulation": 4, "parameter": 4}
    assert sbc["p_value"].isnull().all()  # too few to be tested
    assert model["y_data"].get_value().tolist() == [1, 1, 1, 1]
    sbc.to_netcdf(tmp_path / "sbc.nc", engine="h5netcdf")
    xr.testing.assert_identical(xr.load_dataset(tmp_path / "sbc.nc", engine="h5netcdf"), sbc)


def test_deterministics_can_be_ranked():
    """`var_names` chooses variables, computed ones among them, in its order."""
    sbc = calibrate(line(), var_names=["middle", "ends"])
    assert sbc["parameter"].values.tolist() == ["middle", "ends[a]", "ends[b]"]
    ends = sbc["truth"].sel(parameter=["ends[a]", "ends[b]"])
    np.testing.assert_allclose(sbc["truth"].sel(parameter="middle"), ends.mean("parameter"))


def test_one_seed_gives_one_result():
    """The same seed gives the same ranks; without one, that which was taken is written down."""
    xr.testing.assert_identical(calibrate(conjugate()), calibrate(conjugate()))
    unseeded = calibrate(conjugate(), random_seed=None)
    again = calibrate(conjugate(), random_seed=json.loads(unseeded.attrs["random_seed"]))
    xr.testing.assert_identical(again, unseeded)


def test_all_simulations_share_one_compilation(monkeypatch):
    """More simulations compile nothing more."""
    compiled, function = [], pytensor.function

    def counted(*args, **kwargs):
        compiled.append(1)
        return function(*args, **kwargs)

    monkeypatch.setattr(pytensor, "function", counted)
    model = conjugate(scale=0.77)
    calibrate(model, 2)
    compiled.clear()
    calibrate(model, 2)
    of_two = len(compiled)
    compiled.clear()
    calibrate(model, 6)
    assert len(compiled) == of_two


def interrupt_at(monkeypatch, call):
    """Make the kernel's n-th chain meet Ctrl-C."""
    temper, calls = ph.BatchedSMC.temper, []

    def interrupted(self, *args):
        calls.append(1)
        if len(calls) == call:
            raise KeyboardInterrupt
        temper(self, *args)

    monkeypatch.setattr(ph.BatchedSMC, "temper", interrupted)


def test_interrupt_keeps_complete_simulations(monkeypatch):
    """Ctrl-C in the third simulation leaves the first two as they would have been."""
    whole = calibrate(conjugate())
    interrupt_at(monkeypatch, 3)
    with pytest.warns(UserWarning, match="interrupted: 2 of 4 simulations are complete"):
        kept = calibrate(conjugate())
    xr.testing.assert_identical(kept, whole.isel(simulation=slice(2)))


def test_interrupt_before_any_is_complete_is_an_interrupt(monkeypatch):
    """There is nothing to return yet."""
    interrupt_at(monkeypatch, 1)
    with pytest.raises(KeyboardInterrupt):
        calibrate(conjugate())


def test_ties_are_broken_at_random():
    """Of three draws, one is smaller and one is equal: the rank is 1 or 2, half the time each."""
    rng = np.random.default_rng(SEED)
    posterior = np.array([[0.0], [1.0], [2.0]])
    ranks = np.array([_rank(np.array([1.0]), posterior, rng)[0] for _ in range(400)])
    assert set(ranks) == {1, 2}
    assert abs(np.mean(ranks == 1) - 0.5) < 4 * 0.5 / 20  # standard errors of 400


@pytest.mark.parametrize(
    ("simulations", "ranked_draws", "bins"),
    [(300, 99, 20), (150, 99, 10), (19, 99, 1), (20, 99, 2), (300, 100, 1), (5000, 99, 20)],
)
def test_bins_divide_the_ranks(simulations, ranked_draws, bins):
    """Every bin holds equally many ranks, and ten simulations at least are due in each."""
    assert _number_of_bins(simulations, ranked_draws) == bins


def test_p_value_is_that_of_pearson():
    """Counts of 30 and 10 in place of 20 each: a chi-square of 10 with one degree of freedom."""
    rank = np.repeat([0, 3], [30, 10])[:, None]
    assert _uniformity(rank, 2, 3) == pytest.approx([chi2.sf(10, 1)], rel=ROUNDING)
    assert np.isnan(_uniformity(rank, 1, 3)).all()


def unlike(**changes):
    """A model that differs from the conjugate one in something."""
    with pm.Model() as model:
        mean = pm.Normal(changes.get("parameter", "mean"), 0, 1)
        if changes.get("discrete"):
            mean += pm.Poisson("events", 1)
        sigma = pm.math.log(mean) if changes.get("overflows") else 1
        mu = np.inf * mean if changes.get("infinite") else mean
        if "potential" in changes:
            pm.Potential("soft", -(mean**2))
        if changes.get("data", True):
            pm.Normal("y", mu, sigma, observed=np.zeros(changes.get("points", POINTS)))
    return model


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: calibrate(3), TypeError, "the model must be a pm.Model, not int"),
        (
            lambda: calibrate(conjugate(), simulator=conjugate),
            TypeError,
            "the simulator must be a pm.Model, not function",
        ),
        (lambda: calibrate(unlike(data=False)), ValueError, "no observed variables"),
        (
            lambda: calibrate(unlike(potential=True)),
            ValueError,
            r"the model has the Potentials \['soft'\].*likelihood=\"generative\"",
        ),
        (
            lambda: calibrate(unlike(potential=True, data=False)),
            ValueError,
            r"no observed variables.*\['soft'\] are Potentials",
        ),
        (
            lambda: calibrate(conjugate(), simulator=unlike(potential=True)),
            ValueError,
            "the simulator has the Potentials",
        ),
        (
            lambda: calibrate(conjugate(), simulator=unlike(parameter="mu")),
            ValueError,
            r"the simulator has no variables \['mean'\]",
        ),
        (
            lambda: calibrate(conjugate(), simulator=unlike(points=3)),
            ValueError,
            r"the simulator's 'y' has the shape \(3,\), the model's \(20,\)",
        ),
        (lambda: calibrate(unlike(discrete=True)), ValueError, r"discrete: \['events'\]"),
        (
            lambda: calibrate(unlike(infinite=True)),
            ValueError,
            "4 of 4 simulations have a 'y' that is not finite, the first of them simulation 0, at "
            "mean = ",
        ),
        (lambda: calibrate(conjugate(), var_names=["nu"]), ValueError, r"has .*\['mean'\] to rank"),
        (lambda: calibrate(conjugate(), var_names=[]), ValueError, r"has .*\['mean'\] to rank"),
        (lambda: calibrate(conjugate(), var_names="mean"), TypeError, "a list of names"),
        (lambda: calibrate(conjugate(), 1), ValueError, "simulations is 1; expected at least 2"),
        (lambda: calibrate(conjugate(), 9.0), TypeError, "simulations is 9.0"),
        (lambda: calibrate(conjugate(), draws=50), ValueError, "draws is 50; expected at least 99"),
        (lambda: calibrate(conjugate(), ranked_draws=0), ValueError, "ranked_draws is 0"),
        (lambda: calibrate(conjugate(), random_seed="a"), TypeError, "random_seed is 'a'"),
        (lambda: calibrate(conjugate(), threshold=2), ValueError, "threshold is 2"),
    ],
)
def test_wrong_input_of_calibration(call, error, message):
    """Wrong input raises one error that says what is wrong."""
    with pytest.raises(error, match=message):
        call()


def test_data_that_the_model_excludes_name_their_simulation():
    """What cannot be sampled is told with the number of the simulation."""
    with pm.Model() as model:
        pm.Uniform("y", 0, pm.Uniform("mean", 0, 1), observed=np.zeros(POINTS))
    with pytest.raises(ValueError, match=r"simulation 0: none of \d+ draws of the prior"):
        calibrate(model, simulator=conjugate())


def test_deterministics_that_are_not_finite_have_no_rank():
    """A truth or a draw that is not finite cannot be compared."""
    with pm.Model() as model:
        mean = pm.Normal("mean", 0, 1)
        pm.Deterministic("root", mean**0.5)
        pm.Normal("y", mean, 1, observed=np.zeros(POINTS))
    with pytest.raises(ValueError, match="of 30 simulations have a 'root' that is not finite"):
        with np.errstate(invalid="ignore"):
            calibrate(model, 30, var_names=["root"])
    with pm.Model() as simulator:
        mean = pm.HalfNormal("mean", 1e-3)
        pm.Deterministic("root", mean**0.5)
        pm.Normal("y", mean, 1, observed=np.zeros(POINTS))
    with pytest.raises(ValueError, match="simulation 0: the posterior has draws that are not fin"):
        calibrate(model, simulator=simulator, var_names=["root"])
