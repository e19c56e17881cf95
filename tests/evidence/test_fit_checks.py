"""Diagnosis of a fit: draws at limits of priors, and residuals in units of the noise."""

import numpy as np
import pandas as pd
import pymc as pm
import pytest
from scipy import stats
from scipy.optimize import minimize_scalar

import pymc_hyperelastic as ph
from pymc_hyperelastic.evidence.limits import mass_at_limits

SEED = 1
TUBE = ph.Tube(inner_radius=2.5, outer_radius=3.0)
RADIUS, MU = np.linspace(2.55, 2.7, 8), 40.0
AS_WRITTEN = "FAST_COMPILE"
# Pressure, slope and force for a modulus of 1 kPa; all three are proportional to the modulus.
PRESSURE, SLOPE, FORCE = (
    curve(ph.NeoHookean(), RADIUS, TUBE, mu=1.0).eval(mode=AS_WRITTEN)
    for curve in (ph.inflation_pressure, ph.inflation_stiffness, ph.axial_force)
)
SD, FORCE_SD, OFFSET_SD, DIAMETER_SD = 0.1, 2.0, 50.0, 0.01
# Sum of squares of the best of 200 draws of one parameter, minus the smallest possible one.
BEST_DRAW = 0.02


def errors(seed):
    return np.random.default_rng(seed).standard_normal((2, 8))


def two_tests(shift=0.0):
    """Two tests of one tube; the pressure of the second is shifted."""
    frames = []
    for experiment, error in enumerate([errors(1), errors(2)]):
        frame = {"radius": RADIUS, "pressure": MU * PRESSURE + SD * error[0] + shift * experiment}
        frame["axial_force"] = MU * FORCE + FORCE_SD * error[1] + 30.0 * experiment
        frames.append(pd.DataFrame(frame).assign(specimen="A", experiment=experiment + 1))
    return ph.inflation_data(pd.concat(frames, ignore_index=True), TUBE)


def sampled(data, priors=None, **noise):
    model = ph.inflation_model(ph.NeoHookean(), data, ph.Gaussian(SD, **noise), priors=priors)
    return ph.sample_smc(model, draws=300, chains=2, random_seed=SEED, progressbar=False)


def residuals_of(tree):
    of_signal = tree["evidence"]["chi_square"].to_series().unstack()
    return of_signal, tree["evidence"]["points"].to_series().unstack()


def measured(data, name):
    return data[name].values.reshape(2, 8)


def test_squared_residuals_equal_least_squares():
    data = two_tests()
    squares, points = residuals_of(sampled(data.drop_vars("axial_force")))
    pressure = measured(data, "pressure")
    mu = (pressure @ PRESSURE).sum() / (2 * PRESSURE @ PRESSURE)
    expected = np.square((pressure - mu * PRESSURE) / SD).sum(axis=1)
    np.testing.assert_allclose(squares["pressure"], expected, atol=BEST_DRAW)
    assert (points["pressure"] == 8).all()


def test_residuals_of_forces_exclude_their_offset():
    data = two_tests()
    tree = sampled(data, force_sd=FORCE_SD, force_offset_sd=OFFSET_SD)
    squares, points = residuals_of(tree)

    def of_signals(mu):
        pressure = (measured(data, "pressure") - mu * PRESSURE) / SD
        force = (measured(data, "axial_force") - mu * FORCE) / FORCE_SD
        force = force - force.mean(axis=1, keepdims=True)
        return [np.square(error).sum(axis=1) for error in (pressure, force)]

    best = minimize_scalar(lambda mu: np.sum(of_signals(mu)), bounds=(35, 45), method="bounded")
    expected = of_signals(best.x)
    for signal, value in zip(["pressure", "axial_force"], expected, strict=True):
        np.testing.assert_allclose(squares[signal], value, atol=3 * BEST_DRAW)
    assert points.loc[:, "axial_force"].tolist() == [7, 7]
    assert tree["diagnosis"].attrs["verdict"] == "good"


def test_diameter_error_enters_pressure_residuals_through_the_slope():
    data = two_tests().drop_vars("axial_force")
    squares, _ = residuals_of(sampled(data, diameter_sd=DIAMETER_SD))

    def sum_of_squares(mu):
        variance = SD**2 + (mu * SLOPE * DIAMETER_SD / 2) ** 2
        return np.sum((measured(data, "pressure") - mu * PRESSURE) ** 2 / variance)

    best = minimize_scalar(sum_of_squares, bounds=(30, 50), method="bounded").fun
    assert squares["pressure"].sum() == pytest.approx(best, abs=BEST_DRAW)


def test_experiment_with_large_residuals_is_named_in_the_warning():
    """The pressure of the second test is shifted: after the fit each test has half of the shift."""
    data = two_tests(shift=1.0).drop_vars("axial_force")
    with pytest.warns(UserWarning, match=r"the fit is doubtful: .* specimen 'A', experiment [12]"):
        tree = sampled(data)
    said = ph.diagnose_evidence(tree).sel(check="residuals")
    squares, points = residuals_of(tree)
    smallest = stats.chi2.sf(squares["pressure"], points["pressure"]).min()
    assert said["value"] == pytest.approx(2 * smallest) and said["verdict"] == "doubtful"
    assert "NUTS" not in ph.diagnose_evidence(tree).attrs["words"]


def test_prior_that_excludes_the_data_is_named_as_a_reason():
    """A narrow prior without limits is far from the modulus of the data, which is about 40 kPa."""
    data = two_tests().drop_vars("axial_force")
    with pytest.warns(UserWarning, match="the prior excludes better curves"):
        sampled(data, priors={"mu": pm.Normal.dist(60.0, 0.1)})


@pytest.mark.parametrize("count", [1, 2])
def test_fewer_measured_values_than_parameters_make_a_fit_doubtful(count):
    data = two_tests().isel(obs=slice(count), test=[0]).drop_vars("axial_force")
    model = ph.inflation_model(ph.Ogden(), data, SD)
    settings = {"draws": 100, "chains": 1, "random_seed": SEED, "progressbar": False}
    if count == 2:
        assert ph.sample_smc(model, **settings)["diagnosis"].attrs["verdict"] == "good"
        return
    with pytest.warns(UserWarning, match="the fit is doubtful: .* 2 material parameters, .*, 1: "):
        tree = ph.sample_smc(model, **settings)
    said = ph.diagnose_evidence(tree).sel(check="parameters")
    assert said["value"] == 2 and said["limit"] == 1 and said["verdict"] == "doubtful"
    assert "the prior decides" in ph.diagnose_evidence(tree).attrs["words"]


@pytest.mark.parametrize(
    ("noise", "expected"),
    [
        ({}, 16),
        ({"force_sd": FORCE_SD}, 32),
        ({"force_sd": FORCE_SD, "diameter_sd": DIAMETER_SD}, 32),
        ({"force_sd": FORCE_SD, "force_offset_sd": OFFSET_SD}, 30),
    ],
)
def test_measured_values_are_those_that_the_likelihood_uses(noise, expected):
    data = two_tests() if noise else two_tests().drop_vars("axial_force")
    model = ph.inflation_model(ph.OgdenSeries(3), data, ph.Gaussian(SD, **noise))
    found = model.study.chi_squares_of(model)(data, np.zeros((2, 6)))
    assert found["measured_values"] == expected and found["parameters"] == 6


def beside_limit(place, sd, ends=(1.0, 2.0)):
    """A number whose likelihood is normal, with a uniform prior between two ends."""
    with pm.Model() as model:
        x = pm.Uniform("x", *ends)
        pm.Potential("likelihood", pm.logp(pm.Normal.dist(place, sd), x))
    return ph.sample_smc(model, draws=1000, chains=2, random_seed=SEED, progressbar=False)


@pytest.mark.parametrize(
    ("place", "sd", "end"),
    [(0.9, 0.02, "lower limit 1 of x"), (2.1, 0.04, "upper limit 2 of x"), (2.0, 0.01, None)],
)
@pytest.mark.filterwarnings("ignore:the fit is doubtful")
def test_share_of_draws_at_a_prior_limit_equals_a_truncated_normal(place, sd, end):
    tree = beside_limit(place, sd)
    posterior = stats.truncnorm((1 - place) / sd, (2 - place) / sd, place, sd)
    shares = tree["evidence"]["at_limit"].to_series()
    exact = posterior.cdf(1.01), posterior.sf(1.99)
    for share, value in zip(
        exact, [shares["lower limit 1 of x"], shares["upper limit 2 of x"]], strict=True
    ):
        # Two chains of 1000 draws; those of moved particles are nearly independent.
        assert value == pytest.approx(share, abs=4 * np.sqrt(share * (1 - share) / 1000) + 1e-9)
    assert end is None or end in tree["diagnosis"].attrs["words"]


def test_posterior_that_ends_before_a_prior_limit_passes_the_check():
    tree = beside_limit(1.995, 0.0008)
    assert (tree["evidence"]["at_limit"] == 0).all()
    assert tree["diagnosis"].attrs["verdict"] == "good"


def test_ends_of_a_fraction_are_no_limits_that_a_wider_prior_could_move():
    tree = beside_limit(1.1, 0.1, ends=(0.0, 1.0))
    assert "at_limit" not in tree["evidence"] and tree["diagnosis"].attrs["verdict"] == "good"


def limits_of(model):
    """Limits at which a posterior is pressed that lies at both ends of all variables."""
    ends = np.tile(np.repeat([-8.0, 8.0], 50), (2, 1))
    at_ends = {model.rvs_to_values[rv].name: ends for rv in model.free_RVs}
    shares = mass_at_limits(model, at_ends, model.study.physical_ends)
    assert (shares["at_limit"] == 0.5).all()
    return shares["limit"].values.tolist()


def test_ends_of_physical_ranges_of_parameters_are_no_limits_of_a_prior():
    data = two_tests().drop_vars("axial_force")
    law = ph.GasserOgdenHolzapfel()
    of_moduli = [f"upper limit {end} of {name}" for end, name in ((100, "c"), (500, "k1"))]
    of_moduli.append("upper limit 50 of k2")
    assert limits_of(ph.inflation_model(law, data, SD)) == of_moduli
    narrow = {"beta": pm.Uniform.dist(30, 90), "kappa": pm.Uniform.dist(0, 0.2)}
    of_narrow = ["lower limit 30 of beta", "upper limit 0.2 of kappa"]
    found = limits_of(ph.inflation_model(law, data, SD, priors=narrow))
    assert sorted(found) == sorted([*of_moduli, *of_narrow])
    # An end of an angle is a limit of a modulus.
    wide = {"c": pm.Uniform.dist(0, 90)}
    assert "upper limit 90 of c" in limits_of(ph.inflation_model(law, data, SD, priors=wide))
    wall = [ph.Layer(law, 0.2, c=10.0, k1=10.0, k2=1.0), ph.Layer(ph.NeoHookean(), 0.3)]
    open_tube = data.assign(outer_radius=data["outer_radius"] * np.nan)
    assert limits_of(ph.inflation_model(wall, open_tube, SD)) == ["upper limit 200 of mu_2"]


@pytest.mark.parametrize(
    ("place", "sd", "verdict"),
    [
        (2.3, 0.1, "doubtful"),  # 99.9 % of the likelihood is beyond the limit
        (2.1, 0.1, "doubtful"),  # 84 %
        (2.0, 0.03, "doubtful"),  # half
        (1.7, 0.1, "good"),  # 0.1 %
        (1.99, 0.005, "good"),  # 2 %
        (1.5, 0.1, "good"),
        (1.5, 100.0, "good"),  # data that do not determine the number
    ],
)
@pytest.mark.filterwarnings("ignore:the fit is doubtful")
def test_verdict_is_doubtful_if_a_limit_cuts_off_much_of_the_likelihood(place, sd, verdict):
    found = ph.diagnose_evidence(beside_limit(place, sd)).sel(check="limits")
    assert found["verdict"] == verdict
