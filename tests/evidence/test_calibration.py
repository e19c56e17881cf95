"""Calibration: ranks of true parameters, scores of class probabilities, and their figures."""

import json

import matplotlib as mpl
import numpy as np
import pymc as pm
import pytensor
import pytest
import xarray as xr
from scipy.stats import chi2, norm

import pymc_hyperelastic as ph
from pymc_hyperelastic.evidence.calibration import _number_of_bins, _rank, _uniformity
from pymc_hyperelastic.plots.calibration import _p_value, _simultaneous_band

mpl.use("Agg")

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


@pytest.fixture(scope="module")
def right():
    return calibrate(conjugate(), 300, draws=500)


# --- ranks of true parameters --------------------------------------------------------------------


def test_right_model_passes(right):
    """The posterior of a right model is neither too wide nor too narrow nor biased."""
    assert right["p_value"].item() > PASSES
    assert right.attrs["bins"] == 20
    assert right["rank"].min() >= 0 and right["rank"].max() <= 99


@pytest.mark.parametrize(("simulated", "fitted", "simulations"), [(1.5, 1.0, 300), (1.0, 1.5, 600)])
def test_wrong_noise_fails(simulated, fitted, simulations):
    """A standard deviation that is wrong by a factor of 1.5 is found out, on either side.

    Posteriors that are too wide are harder to see: it takes more simulations.
    """
    sbc = calibrate(conjugate(fitted), simulations, simulator=conjugate(simulated))
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


def test_inflation_models_need_the_generative_likelihood():
    """Pressures are simulated from observed variables; a Potential says what to do instead."""
    data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1", experiment=1)
    settings = {"sigma": 5 * ph.mmHg, "slope_weight": 1.0}
    model = ph.power_law_neo_hookean_model(data, likelihood="generative", **settings)
    sbc = calibrate(model)
    assert sbc["parameter"].values.tolist() == ["mu", "n"]
    # Pressures tell much of mu: posteriors are narrower than the prior.
    assert sbc["posterior_sd"].sel(parameter="mu").max() < sbc["truth"].sel(parameter="mu").std()
    with pytest.raises(ValueError, match='likelihood="generative"'):
        calibrate(ph.power_law_neo_hookean_model(data, **settings))


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
    with pytest.raises(ValueError, match="simulation 0: none of the 200 initial particles"):
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


# --- scores of class probabilities ---------------------------------------------------------------


def classified(probability, **attrs):
    """What classify returns, as far as it is scored."""
    probability = np.array(probability, dtype=float)
    classes = [f"C{i + 1}" for i in range(probability.shape[1])]
    return xr.Dataset(
        {"class_probability": (("test", "class_label"), probability)},
        {
            "class_label": classes,
            "specimen": ("test", [f"S{i + 1}" for i in range(len(probability))]),
            "experiment": ("test", [3] * len(probability)),
        },
        attrs,
    )


def test_scores_by_hand():
    """Of two units the log scores are ln 0.7 and ln 0.2, the Brier scores 0.14 and 1.04.

    (0.7, 0.1, 0.2) against (1, 0, 0): 0.09 + 0.01 + 0.04. (0.2, 0.2, 0.6) against (0, 1, 0):
    0.04 + 0.64 + 0.36 = 1.04.
    """
    result = classified([[0.7, 0.1, 0.2], [0.2, 0.2, 0.6]], simulated=1, class_prior="equal")
    scores = ph.score_probabilities(result, ["C1", "C2"])
    np.testing.assert_allclose(scores["log_score"], np.log([0.7, 0.2]), rtol=ROUNDING)
    np.testing.assert_allclose(scores["brier_score"], [0.14, 1.04], rtol=ROUNDING)
    assert scores["correct"].values.tolist() == [True, False]
    assert scores["accuracy"].item() == 0.5
    assert scores["mean_brier_score"].item() == pytest.approx(0.59, rel=ROUNDING)
    # Of two values the standard error is half their difference.
    assert scores["mean_brier_score_se"].item() == pytest.approx(0.45, rel=ROUNDING)
    assert scores["accuracy_se"].item() == pytest.approx(0.5, rel=ROUNDING)
    assert scores["specimen"].values.tolist() == ["S1", "S2"]
    assert scores["truth"].values.tolist() == ["C1", "C2"]
    assert scores.attrs == {"simulated": 1, "prob": 0.94}


def test_impossible_truth_scores_minus_infinity():
    """Nothing is clipped: the mean is −inf too, and has no standard error."""
    scores = ph.score_probabilities(classified([[1.0, 0.0], [0.5, 0.5]]), ["C2", "C1"])
    assert scores["log_score"].values.tolist() == [-np.inf, np.log(0.5)]
    assert scores["mean_log_score"].item() == -np.inf
    assert np.isnan(scores["mean_log_score_se"].item())
    assert scores["brier_score"].values.tolist() == [2.0, 0.5]
    one = ph.score_probabilities(classified([[0.9, 0.1]]), ["C1"])
    assert one["accuracy"].item() == 1 and np.isnan(one["accuracy_se"].item())


def test_calibration_error_by_hand():
    """Two bins: confidences 0.6, 0.8, 0.9, of which two are right, and 0.5, which is not.

    The upper bin has the mean 23/30 and the frequency 2/3, an error of 0.1; the lower one 0.5 and
    0: together 3/4 · 0.1 + 1/4 · 0.5 = 0.2. Of class C1 the lower bin holds 0.2, 0.1 and 0.5, of
    which the second is C1, and the upper one 0.6, which is.
    """
    result = classified([[0.6, 0.4], [0.2, 0.8], [0.1, 0.9], [0.5, 0.5]])
    scores = ph.score_probabilities(result, ["C1", "C2", "C1", "C2"], bins=2)
    top = scores.sel(forecast="most probable class")
    assert top["count"].values.tolist() == [1, 3]
    np.testing.assert_allclose(top["predicted_probability"], [0.5, 23 / 30], rtol=ROUNDING)
    np.testing.assert_allclose(top["observed_frequency"], [0, 2 / 3], rtol=ROUNDING)
    assert top["expected_calibration_error"].item() == pytest.approx(0.2, rel=ROUNDING)
    first = scores.sel(forecast="C1")
    assert first["count"].values.tolist() == [3, 1]
    np.testing.assert_allclose(first["predicted_probability"], [0.8 / 3, 0.6], rtol=ROUNDING)
    np.testing.assert_allclose(first["observed_frequency"], [1 / 3, 1], rtol=ROUNDING)
    error = 3 / 4 * (1 / 3 - 0.8 / 3) + 1 / 4 * 0.4
    assert first["expected_calibration_error"].item() == pytest.approx(error, rel=ROUNDING)


def test_empty_bins_are_nan_and_do_not_count():
    """A bin without units has no frequency, and takes no part in the calibration error."""
    scores = ph.score_probabilities(classified([[1.0, 0.0]] * 3), ["C1"] * 3)
    of_top = scores.sel(forecast="most probable class")
    assert of_top["count"].values.tolist() == [0] * 9 + [3]
    assert np.isnan(of_top["observed_frequency"][:9]).all()
    assert scores["expected_calibration_error"].values.tolist() == [0, 0, 0]
    assert scores.sel(forecast="C2")["count"].values.tolist() == [3] + [0] * 9


def test_interval_is_that_of_wilson():
    """8 of 10 with 95 %: from 0.4902 to 0.9433 (Wilson 1927)."""
    truth = ["C1"] * 8 + ["C2"] * 2
    scores = ph.score_probabilities(classified([[0.75, 0.25]] * 10), truth, prob=0.95)
    top = scores.sel(forecast="most probable class").isel(bin=7)
    assert top["frequency_lower"].item() == pytest.approx(0.4902, abs=1e-4)
    assert top["frequency_upper"].item() == pytest.approx(0.9433, abs=1e-4)


def test_reliable_probabilities_are_on_the_diagonal():
    """Truths drawn from the probabilities themselves: most intervals hold the diagonal."""
    rng = np.random.default_rng(SEED)
    p = rng.dirichlet([0.7, 0.7, 0.7], size=3000)
    truth = [f"C{1 + rng.choice(3, p=row)}" for row in p]
    scores = ph.score_probabilities(classified(p), truth, prob=0.99)
    known = scores["count"] > 0
    inside = (scores["frequency_lower"] <= scores["predicted_probability"]) & (
        scores["predicted_probability"] <= scores["frequency_upper"]
    )
    assert inside.where(known).sum() >= known.sum() - 2  # of 37, each with 99 %
    assert (scores["expected_calibration_error"] < 0.04).all()
    certain = ph.score_probabilities(classified(np.eye(3)[p.argmax(axis=1)]), truth)
    error = certain["expected_calibration_error"].sel(forecast="most probable class").item()
    assert error == pytest.approx(1 - scores["accuracy"].item(), rel=1e-9)


def test_dimensions_may_come_in_any_order():
    """Units are the dimension that is not the class, and keep their coordinate."""
    p = xr.DataArray(
        [[0.9, 0.2], [0.1, 0.8]],
        {"class_label": ["C1", "C2"], "specimen": ["S1", "S2"]},
    )
    truth = xr.DataArray(["C1", "C2"], {"specimen": ["S1", "S2"]}, name="group")
    scores = ph.score_probabilities(p, truth)
    np.testing.assert_allclose(scores["log_score"], np.log([0.9, 0.8]), rtol=ROUNDING)
    assert scores["log_score"].sel(specimen="S2").item() == pytest.approx(np.log(0.8))
    with pytest.raises(ValueError, match="probabilities and truth differ in 'specimen'"):
        ph.score_probabilities(p, truth[::-1])


def test_scores_of_classify():
    """The result of classify is scored as it is, its groups are the truth."""
    data = ph.load_dataset("simulated_sheep_aorta")
    classes = ph.fit_classes(
        ph.PowerLawNeoHookean(),
        {name: ph.select(data, group=name, experiment=[1, 2]) for name in ("C1", "C2")},
        sigma=5 * ph.mmHg,
        slope_weight=3.0,
        draws=200,
        chains=2,
        random_seed=SEED,
        progressbar=False,
    )
    new = ph.select(data, experiment=3)
    result = ph.classify(new, classes, random_seed=SEED, progressbar=False)
    scores = ph.score_probabilities(result, result["group"])
    assert scores.sizes["test"] == 5
    assert scores["accuracy"].item() == np.mean(
        result["class_probability"].idxmax("class_label").values == result["group"].values
    )
    assert scores.attrs["simulated"] == 1


@pytest.mark.parametrize(
    ("probability", "truth", "settings", "error", "message"),
    [
        ([[0.9, 0.1]], ["C1"], {}, TypeError, "DataArray of probabilities, not list"),
        (classified([[0.9, 0.2]]), ["C1"], {}, ValueError, "specimen 'S1', experiment 3: .*0.2"),
        (classified([[1.1, -0.1]]), ["C1"], {}, ValueError, "between 0 and 1 that add up to 1"),
        (
            classified([[0.5, 0.5], [np.nan, np.nan]]),
            ["C1", "C1"],
            {},
            ValueError,
            "specimen 'S2', experiment 3: .*not classified: leave the unit out",
        ),
        (
            classified([[0.5, 0.5]]),
            ["control"],
            {},
            ValueError,
            r"specimen 'S1', .*true class 'control' is not among the classes \['C1', 'C2'\]",
        ),
        (classified([[0.5, 0.5]]), ["C1", "C2"], {}, ValueError, r"for each of 1 unit\(s\)"),
        (classified([[0.5, 0.5]]), "C1", {}, ValueError, r"for each of 1 unit\(s\); got 'C1'"),
        (
            classified([[0.5, 0.5]])["class_probability"][0],
            ["C1"],
            {},
            ValueError,
            r"two dimensions.*here are \['class_label'\]",
        ),
        (
            xr.DataArray([[0.5, 0.5]], dims=["unit", "class_label"]),
            ["C1"],
            {},
            ValueError,
            "names of the classes",
        ),
        (
            xr.DataArray([[0.4, 0.5]], {"class_label": ["A", "B"]}, ["unit", "class_label"]),
            ["A"],
            {},
            ValueError,
            "unit 0: the probabilities",
        ),
        (
            xr.DataArray([[0.5, 0.5]], {"class_label": ["A", "A"]}, ["unit", "class_label"]),
            ["A"],
            {},
            ValueError,
            "each class once",
        ),
        (classified(np.empty((0, 2))), [], {}, ValueError, r"of 0 unit\(s\)"),
        (classified([[0.5, 0.5]]), ["C1"], {"bins": 0}, ValueError, "bins is 0"),
        (classified([[0.5, 0.5]]), ["C1"], {"prob": 94}, ValueError, "prob must be a probability"),
    ],
)
def test_wrong_input_of_scores(probability, truth, settings, error, message):
    """Wrong input raises one error, which names the unit."""
    with pytest.raises(error, match=message):
        ph.score_probabilities(probability, truth, **settings)


# --- figures -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def ranks():
    """Five parameters, of which one is ranked at 0 and 99 only."""
    rng = np.random.default_rng(SEED)
    rank = rng.integers(0, 100, (200, 5))
    rank[:, 2] = 99 * (rank[:, 2] > 49)
    return xr.Dataset(
        {"rank": (("simulation", "parameter"), rank), "p_value": ("parameter", [0.5] * 5)},
        {"parameter": [f"k[{i}]" for i in range(5)]},
        {"ranked_draws": 99, "bins": 20},
    )


@pytest.fixture(scope="module")
def scores():
    result = classified([[0.95, 0.05], [0.15, 0.85], [0.9, 0.1], [0.35, 0.65]], simulated=1)
    return ph.score_probabilities(result, ["C1", "C2", "C2", "C2"])


def panels_of(figure):
    """Panels of the backend "none", as lists of what was drawn in each."""
    return list(figure.viz["plot"].values.ravel())


def texts(figure, function):
    return [e["string"] for panel in panels_of(figure) for e in panel if e["function"] == function]


def test_line_is_the_ecdf(ranks):
    """The line is the share of ranks below each value, less the share that is due."""
    figure = ph.plot_calibration_ranks(ranks, backend="none")
    for i, name in enumerate(ranks["parameter"].values):
        line = figure.get_viz("line", parameter=name)
        np.testing.assert_allclose(line["x"], np.arange(101) / 100, rtol=ROUNDING)
        below = [np.mean(ranks["rank"].values[:, i] < k) - k / 100 for k in range(101)]
        np.testing.assert_allclose(line["y"], below, atol=ROUNDING)
    assert texts(figure, "title") == [f"k[{i}]\n($p$ = 0.500)" for i in range(5)]
    assert texts(figure, "xlabel") == ["rank / $(L+1)$"] * 4
    assert "200 simulations, 94 % simultaneous" in figure.get_viz("figure_title")["string"]


def test_band_holds_whole_lines():
    """Of uniform ranks, a share of `prob` is inside the band throughout."""
    x, low, high = _simultaneous_band(200, 100, 0.9)
    assert x[0] == low[0] == high[0] == low[-1] == high[-1] == 0 and x[-1] == 1
    rank = np.random.default_rng(SEED).integers(0, 100, (1000, 200))
    below = np.stack([np.bincount(r, minlength=100).cumsum() for r in rank])[:, :-1] / 200
    line = below - x[1:-1]
    inside = ((line >= low[1:-1] - ROUNDING) & (line <= high[1:-1] + ROUNDING)).all(axis=1)
    # A thousand lines and a thousand for the band have standard errors of 1 % each.
    assert abs(inside.mean() - 0.9) < 0.04


def test_histogram_counts_simulations(ranks):
    """Bars are the counts that were tested; a band says how many are due."""
    figure = ph.plot_calibration_ranks(ranks, kind="histogram", prob=0.5, backend="none")
    bar = figure.get_viz("bar", parameter="k[2]")
    high = int((ranks["rank"].values[:, 2] == 99).sum())
    assert np.asarray(bar["y"]).tolist() == [200 - high] + [0] * 18 + [high]
    assert texts(figure, "ylabel") == ["simulations"] * 2
    band = figure.get_viz("band", parameter="k[0]")
    assert band["y_bottom"][0] < 200 / 20 < band["y_top"][0]


def test_one_parameter_of_several(ranks, right):
    """One panel may be chosen, whether its dimension is kept or not."""
    for chosen in (ranks.sel(parameter=["k[1]"]), ranks.sel(parameter="k[1]"), right):
        figure = ph.plot_calibration_ranks(chosen, backend="none")
        assert dict(figure.viz["plot"].sizes) == {"parameter": 1}


@pytest.mark.parametrize(
    ("p_value", "text"),
    [(np.nan, "not tested"), (1e-9, "$p$ < 0.001"), (0.25, "$p$ = 0.250")],
)
def test_printed_p_values(p_value, text):
    """No p-value is printed as zero."""
    assert _p_value(p_value) == text


def test_reliability_shows_the_table(scores):
    """Points, intervals and bars are those of the table; columns name the forecasts."""
    figure = ph.plot_reliability(scores, backend="none")
    assert dict(figure.viz["plot"].sizes) == {"part": 2, "forecast": 3}
    for name in ("most probable class", "C1", "C2"):
        table = scores.sel(forecast=name)
        points, bars = (figure.get_viz(v, forecast=name) for v in ("points", "bar"))
        np.testing.assert_array_equal(points["x"], table["predicted_probability"])
        np.testing.assert_array_equal(points["y"], table["observed_frequency"])
        np.testing.assert_array_equal(bars["y"], table["count"])
        interval = figure.get_viz("interval", forecast=name)
        np.testing.assert_array_equal(interval["y_bottom"], table["frequency_lower"])
        np.testing.assert_array_equal(interval["y_top"], table["frequency_upper"])
    error = scores["expected_calibration_error"].values[0]
    assert texts(figure, "title")[0] == f"most probable class\n(ECE = {error:.3f})"
    assert texts(figure, "ylabel") == ["observed frequency", "count"]
    title = figure.get_viz("figure_title")["string"]
    assert title == "reliability of class probabilities, 94 % intervals, SIMULATED data"
    one = ph.plot_reliability(scores.sel(forecast="C1"), backend="none")
    assert one.viz["plot"].sizes["forecast"] == 1


def test_every_interval_is_drawn(scores):
    """Matplotlib draws one line for each bin that is not empty."""
    figure = ph.plot_reliability(scores)
    axes = figure.get_viz("plot", part="diagram", forecast="C1")
    drawn = [line.get_xydata() for line in axes.lines if len(line.get_xydata()) == 2]
    upright = [line for line in drawn if line[0, 0] == line[1, 0]]
    known = (scores["count"].sel(forecast="C1") > 0).sum().item()
    assert len(upright) == known


def test_figures_can_be_saved_and_edited(ranks, scores, tmp_path):
    """Each figure is a PlotCollection that saves itself, takes settings and leaves visuals out."""
    figures = [
        ph.plot_calibration_ranks(ranks),
        ph.plot_calibration_ranks(ranks, kind="histogram"),
        ph.plot_reliability(scores),
    ]
    for i, figure in enumerate(figures):
        figure.savefig(tmp_path / f"{i}.png")
        assert (tmp_path / f"{i}.png").stat().st_size > 5000
        mpl.pyplot.close(figure.get_viz("figure"))
    figure = ph.plot_calibration_ranks(
        ranks, backend="none", visuals={"band": False, "line": {"width": 3}}, color=["k"]
    )
    assert "band" not in figure.viz.children
    line = figure.get_viz("line", parameter="k[0]")
    assert (line["width"], line["color"]) == (3, "k")


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda r, s: ph.plot_calibration_ranks(3), TypeError, "an xarray.Dataset, not int"),
        (lambda r, s: ph.plot_calibration_ranks(s), ValueError, "lacks 'rank'"),
        (lambda r, s: ph.plot_calibration_ranks(r, kind="bar"), ValueError, "kind must be"),
        (lambda r, s: ph.plot_calibration_ranks(r, prob=94), ValueError, "prob must be"),
        (lambda r, s: ph.plot_calibration_ranks(r, backend="tv"), ValueError, "backend must be"),
        (
            lambda r, s: ph.plot_calibration_ranks(r.assign_attrs(bins=1), kind="histogram"),
            ValueError,
            "too few for a histogram",
        ),
        (lambda r, s: ph.plot_reliability(3), TypeError, "an xarray.Dataset, not int"),
        (lambda r, s: ph.plot_reliability(r), ValueError, "lacks 'observed_frequency'"),
        (lambda r, s: ph.plot_reliability(s, visuals={"dot": {}}), ValueError, "no visual.*'dot'"),
    ],
)
def test_wrong_input_of_figures(ranks, scores, call, error, message):
    """Wrong input raises one error that says what is wrong."""
    with pytest.raises(error, match=message):
        call(ranks, scores)
