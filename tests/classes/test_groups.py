"""Comparison of groups: what follows from the distributions of two classes, by other ways."""

import json
import warnings

import numpy as np
import pymc as pm
import pytest
import xarray as xr
from scipy import optimize, stats
from variable_classes import SIGMA, TRAINING, TUBE, curves, fit, unit_pressure

import pymc_hyperelastic as ph

SEED = 913
X = "log_reference_strain"
STRESS = 20.0
# Specimens of a draw are evenly spread in probability: with so many of them means are that precise.
MANY, PRECISE = 128, 0.01
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(41)
WEIGHTS = WEIGHTS / WEIGHTS.sum()
ROUNDING = 1e-8


@pytest.fixture(scope="module")
def classes():
    return fit()


def compare(classes, quantity, **settings):
    settings = {"random_seed": SEED, "bayes_factor": False} | settings
    return ph.compare_classes(classes, quantity, **settings)


def modulus(x):
    """Of a neo-Hookean wall that bears the stress of reference at this coordinate."""
    with np.errstate(over="ignore"):
        return STRESS / (2 * np.sinh(2 * np.exp(x)))


def class_draws(classes, name):
    """Location and spread by draw."""
    posterior = classes[name]["posterior"].to_dataset()
    return (posterior[k].values[..., 0].ravel() for k in ("location", "spread"))


def test_parameters_are_those_of_the_distributions(classes):
    """The modulus of the typical specimen, its mean and its spread, by quadrature over a normal."""
    result = compare(classes, [X, "mu"], specimens=MANY, draws=1000)
    for group in TRAINING:
        location, spread = class_draws(classes, group)
        of_nodes = modulus(location[:, None] + spread[:, None] * NODES)
        mean = of_nodes @ WEIGHTS
        expected = {
            "typical": modulus(location),
            "mean": mean,
            "spread": np.sqrt((of_nodes - mean[:, None]) ** 2 @ WEIGHTS),
        }
        # Of wider distributions of moduli a few specimens in a million decide.
        narrow = spread < 0.4
        assert narrow.mean() > 0.5
        for statistic, values in expected.items():
            found = result["draws"].sel(group=group, statistic=statistic, quantity="mu")
            rtol = {"typical": ROUNDING, "mean": PRECISE, "spread": 5 * PRECISE}[statistic]
            np.testing.assert_allclose(found[narrow], values[narrow], rtol=rtol)
        of_x = result["draws"].sel(group=group, quantity=X)
        np.testing.assert_allclose(of_x.sel(statistic="typical"), location, rtol=ROUNDING)
        np.testing.assert_allclose(of_x.sel(statistic="spread"), spread, rtol=ROUNDING)
        assert float(result["lacking"].sel(group=group).max()) == 0


def test_spreads_stand_beside_their_prior(classes):
    result = compare(classes, X).isel(coordinate=0)
    _, spread = class_draws(classes, "soft")
    # The comparison takes 1000 of the draws, in order.
    found = result["coordinate_spread"].sel(group="soft")
    assert found == pytest.approx(np.median(spread), rel=0.05)
    (logs,), sd = ph.classes.kinds.kind_of_classes(classes).scale.spread_prior
    assert result["prior_coordinate_spread"] == pytest.approx(np.exp(logs), rel=0.01)
    ends = np.exp(logs + sd * stats.norm.ppf([0.025, 0.975]))
    np.testing.assert_allclose(result["prior_coordinate_spread_interval"], ends, rtol=0.01)


def test_a_prior_of_spreads_that_is_given():
    classes = fit(priors={"spread": pm.HalfNormal.dist(0.2, shape=1)}, draws=200)
    found = compare(classes, X, draws=200)["prior_coordinate_spread"]
    assert found.item() == pytest.approx(stats.halfnorm.median(scale=0.2), rel=0.05)


def test_differences_follow_from_draws(classes):
    """Medians, intervals, probabilities and effect sizes, from draws of both groups."""
    result = compare(classes, [X, "mu"], draws=1000).sel(comparison="stiff − soft")
    (m1, s1), (m2, s2) = (class_draws(classes, name) for name in ("soft", "stiff"))
    typical = result.sel(statistic="typical")
    difference = modulus(m2) - modulus(m1)
    of_mu = typical.sel(quantity="mu")
    assert of_mu["difference"].item() == pytest.approx(np.median(difference))
    np.testing.assert_allclose(
        of_mu["difference_interval"], np.quantile(difference, [0.025, 0.975])
    )
    assert of_mu["ratio"].item() == pytest.approx(np.median(modulus(m2) / modulus(m1)))
    assert of_mu["probability_of_rise"].item() == np.mean(difference > 0)
    of_x = typical.sel(quantity=X)
    assert of_x["probability_of_rise"].item() == np.mean(m2 > m1) < 0.5
    assert of_x["probability_of_direction"].item() == np.mean(m2 < m1)
    assert np.isnan(of_x["ratio"].item())
    effect = np.median((m2 - m1) / np.sqrt((s1**2 + s2**2) / 2))
    assert of_x["effect_size"].item() == pytest.approx(effect)


def test_overlaps_are_those_of_normal_distributions(classes):
    """Of one coordinate the overlap of the quantity is that of the specimens."""
    result = compare(classes, X, draws=400, specimens=MANY).sel(
        comparison="stiff − soft", quantity=X
    )
    location, spread = (
        result["draws"].sel(statistic=name).transpose("group", "draw").values
        for name in ("typical", "spread")
    )
    grid = np.linspace(-6, 3, 4001)
    both = stats.norm.pdf(grid, location[..., None], spread[..., None])
    exact = np.trapezoid(both.min(axis=0), grid, axis=1)
    assert result["overlap"].item() == pytest.approx(np.median(exact), abs=0.01)
    assert result["overlap_of_specimens"].item() == pytest.approx(np.median(exact), abs=0.01)
    assert result["best_accuracy"].item() == 1 - result["overlap"].item() / 2


def test_properties_are_those_of_a_tube(classes):
    """Compliance of a neo-Hookean tube, whose pressure is proportional to its modulus."""
    pressure = [1.0, 2.0]
    with warnings.catch_warnings():
        # Of three specimens little is known of the spread: some would burst.
        warnings.filterwarnings("ignore", message=".*have no (log )?compliance there")
        result = compare(classes, ["compliance", "log compliance"], pressure=pressure, draws=100)
    assert json.loads(result.attrs["tube"]) == TUBE | {"axial_stretch": 1.0, "opening_angle": 0.0}
    draws = result["draws"].sel(group="stiff", statistic="typical", quantity="compliance")
    posterior = classes["stiff"]["posterior"].to_dataset().stack(sample=("chain", "draw"))
    chosen = np.linspace(0, posterior.sizes["sample"] - 1, 100).round().astype(int)
    mu = modulus(posterior["location"].values.ravel()[chosen])
    for place in (0, 57):
        for p in pressure:
            a = optimize.brentq(lambda r: mu[place] * unit_pressure(np.array([r]))[0] - p, 6.9, 12)
            slope = mu[place] * np.diff(unit_pressure(np.array([a - 1e-4, a + 1e-4])))[0] / 2e-4
            found = draws.sel(pressure=p).values[place]
            assert found == pytest.approx(2 * np.pi * a / slope, rel=1e-6)
    # Of a logarithm the typical value is that of the quantity.
    typical = result["value"].sel(statistic="typical")
    logs = np.log(typical.sel(quantity="compliance"))
    # A median of an even number of draws is between two of them.
    np.testing.assert_allclose(typical.sel(quantity="log compliance"), logs, rtol=1e-3)


def test_specimens_that_lack_a_quantity_are_told(classes):
    """Soft tubes do not reach a high pressure: they are left out, and that is said."""
    with pytest.warns(UserWarning) as told:
        result = compare(classes, "compliance", pressure=6.0, draws=200)
    lacking = result["lacking"].sel(quantity="compliance")
    assert lacking.sel(group="soft") > lacking.sel(group="stiff")
    words = f"class 'soft': {float(lacking.sel(group='soft')):.1%} of its specimens have no compl"
    assert str(told[0].message).startswith(words)


def test_groups_in_one_model_are_what_they_are_by_themselves(classes):
    """A covariate that says nothing changes little; the Bayes factor sees two groups."""
    rng = np.random.default_rng(SEED)
    noise = {name: rng.normal() for name in ("A1", "A2", "A3", "B1", "B2", "B3")}
    alone = compare(classes, X, draws=1000)
    together = compare(classes, X, draws=1000, covariates={"noise": noise}, bayes_factor=True)
    a, b = (r.sel(statistic="typical").squeeze() for r in (alone, together))
    assert abs(a["difference"] - b["difference"]) < 0.5 * a["difference_sd"]
    assert b["probability_of_difference"] > 0.6
    assert np.isfinite(b["log_bayes_factor_se"])
    low, high = b["covariate_effect_interval"].values.ravel()
    assert low < 0 < high


@pytest.fixture(scope="module")
def before_and_after():
    """Animals that differ threefold, whose moduli all rise by a fifth or so."""
    rng = np.random.default_rng(SEED)
    moduli = {f"m{i}": np.exp(rng.normal(np.log(60.0), 0.5)) for i in range(6)}
    rise = {name: np.exp(rng.normal(0.2, 0.05)) for name in moduli}
    before = curves({name: [mu] for name, mu in moduli.items()}, 5)
    after = curves({name: [mu * rise[name]] for name, mu in moduli.items()}, 6)
    return fit(training={"before": before, "after": after})


def test_pairs_are_known_better_than_groups(before_and_after):
    """A change that all animals have is lost among them unless each is its own control."""
    pairs = compare(before_and_after, X, pair="specimen", bayes_factor=True, draws=1000)
    apart = compare(before_and_after, X, bayes_factor=True, draws=1000)
    of_pairs, of_groups = (r.sel(statistic="typical").squeeze() for r in (pairs, apart))
    assert of_pairs["difference_sd"] < of_groups["difference_sd"] / 2
    # A modulus that rises makes the strain of reference fall.
    assert of_pairs["probability_of_rise"] < 0.01 < of_groups["probability_of_rise"]
    assert of_pairs["log_bayes_factor"] > of_groups["log_bayes_factor"]
    assert of_pairs["share_rising"] < 0.2
    assert of_pairs["effect_size_of_change"] < of_pairs["effect_size"] < 0


@pytest.mark.long
@pytest.mark.deep
def test_laws_are_averaged(classes):
    """Draws are those of the laws, in proportion to their probabilities."""
    other = fit(ph.Demiray())
    laws = {"NeoHookean": classes, "Demiray": other}
    result = compare(laws, "compliance", pressure=1.0, draws=1000)
    evidences = [sum(ph.log_evidence(t[g]).value for g in TRAINING) for t in laws.values()]
    share = 1 / (1 + np.exp(evidences[0] - evidences[1]))
    alone = [compare(t, "compliance", pressure=1.0, draws=1000)["draws"] for t in laws.values()]
    chosen = [np.isin(result["draws"].values, d.values).mean() for d in alone]
    assert chosen[1] == pytest.approx(share, abs=0.06)
    assert sum(chosen) == pytest.approx(1.0)
    assert result.attrs["strain_energy"] == "NeoHookean, Demiray"
    with pytest.raises(ValueError, match="no quantity is called 'b'; of NeoHookean"):
        compare(laws, "b")


def _only(classes, *names):
    return xr.DataTree.from_dict({name: classes[name] for name in names})


@pytest.mark.parametrize(
    ("quantity", "settings", "message"),
    [
        ("stiffnes", {}, "no quantity is called 'stiffnes'; of NeoHookean there are .*'stiffness'"),
        ([], {}, "one or several different names"),
        ("compliance", {}, "compliance is that of a tube at a pressure: say pressure="),
        ("in_vivo_axial_stretch", {"pressure": 2}, "follows from two pressures: say pressure_ran"),
        (X, {"pair": "specimen"}, "animal 'A1', specimen 'A1', has no other half in class 'stiff'"),
        (X, {"pair": "animal"}, "the data of class 'soft' have no variable 'animal' by test"),
        (X, {"pair": dict.fromkeys(["A1", "A2", "A3"], 1)}, "'A1', 'A2', 'A3'|specimen 'B1'"),
        (
            X,
            {"covariates": {"age": {"A1": 3.0}}},
            "age: specimen 'A2' of class 'soft' has no value",
        ),
        (X, {"covariates": ["age"]}, "the data of class 'soft' have no variable 'age' by test"),
        (X, {"prob": 95}, "prob must be a probability"),
        (X, {"draws": 10}, "draws is 10"),
    ],
)
def test_bad_input_is_named(classes, quantity, settings, message):
    with pytest.raises(ValueError, match=message):
        compare(classes, quantity, **settings)


def test_groups_that_cannot_be_compared(classes):
    with pytest.raises(
        ValueError, match=r"two classes or more can be compared; here is \['soft'\]"
    ):
        compare(_only(classes, "soft"), X)
    alone = fit(training=TRAINING | {"stiff": ph.select(TRAINING["stiff"], specimen="B1")})
    with pytest.raises(ValueError, match="class 'stiff' has one specimen, 'B1': how far"):
        compare(alone, X)
    with pytest.raises(ValueError, match="variability='specimen'"):
        compare(fit(variability="none"), X)
    batch = dict.fromkeys(["A1", "A2", "A3"], "old") | dict.fromkeys(["B1", "B2", "B3"], "new")
    with pytest.warns(UserWarning, match="the groups, and the covariates .* cannot be told apart"):
        compare(classes, X, covariates={"batch": batch}, draws=100)


@pytest.mark.long
@pytest.mark.deep
def test_the_population_sampled_as_a_whole(classes):
    """NUTS of both populations, with all specimens as unknowns, says the same of the difference."""
    result = compare(fit(draws=4000), X, draws=4000).squeeze()
    of_groups = {}
    for name, data in TRAINING.items():
        with ph.population_model(ph.NeoHookean(), data, sigma=SIGMA, slope_weight=0.0):
            tree = pm.sample(
                4000,
                tune=1500,
                chains=2,
                cores=2,
                random_seed=SEED,
                progressbar=False,
                target_accept=0.97,
            )
        of_groups[name] = tree["posterior"].to_dataset()
    whole = {n: p["location"].values.ravel() for n, p in of_groups.items()}
    difference = whole["stiff"] - whole["soft"]
    found = result.sel(statistic="typical")
    sd = difference.std()
    assert abs(found["draws"].sel(group="stiff").mean() - whole["stiff"].mean()) < 0.05 * sd
    assert abs(found["difference"] - np.median(difference)) < 0.05 * sd
    low, high = np.quantile(difference, [0.025, 0.975])
    assert float(np.diff(found["difference_interval"])[0]) == pytest.approx(high - low, rel=0.05)
