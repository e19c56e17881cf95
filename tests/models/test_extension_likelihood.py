"""Axial extension in the likelihood: pressures and forces at stretches that vary within a test."""

from functools import cache

import numpy as np
import oracles
import pandas as pd
import pymc as pm
import pytensor
import pytensor.tensor as pt
import pytest
from problems import AS_WRITTEN, LAWS, entries
from pytensor.gradient import verify_grad
from scipy.optimize import brentq
from tables import SECTOR

import pymc_hyperelastic as ph
from pymc_hyperelastic.data.inflation import at_points
from pymc_hyperelastic.models.forward import ForwardModel
from pymc_hyperelastic.models.forward.collocated import Collocated
from pymc_hyperelastic.models.forward.direct import Direct
from pymc_hyperelastic.models.observation import Observation
from pymc_hyperelastic.models.observation.slopes import measured_slopes
from pymc_hyperelastic.models.priors import complete_priors

# Of the largest pressure, or force, of a law's curves.
CURVE_TOLERANCE = 1e-8
# Constant matrices leave out what is below rounding, of the largest response.
COLLOCATION_TOLERANCE = 1e-9
# Sums of squares of such curves, and sums of the same terms in another order.
LIKELIHOOD_TOLERANCE, ROUNDING = 1e-9, 1e-12

INNER, OUTER, ANGLE = 1.0, 1.3, 0.8
NOISE = {"sigma": 0.8, "force_sigma": 2.0}
OGDEN = {"mu": 6.0, "alpha": 8.0}
SLOPE_WEIGHT = 2.5


def frame(points=5) -> pd.DataFrame:
    """Made-up readings of two inflation tests and two extension tests of one tube."""
    rng = np.random.default_rng(3)
    tests = []
    for number, stretch in enumerate((1.2, 1.4)):
        radius = np.linspace(1.08, 1.3, points)
        test = pd.DataFrame({"radius": radius, "stretch": stretch})
        tests.append(test.assign(experiment=f"inflation {number}"))
    for number, radius in enumerate((1.18, 1.26)):
        stretch = np.linspace(1.5, 1.15, points)
        test = pd.DataFrame({"radius": radius - 0.2 * (stretch - 1.2), "stretch": stretch})
        tests.append(test.assign(experiment=f"extension {number}"))
    table = pd.concat(tests, ignore_index=True).assign(specimen="S")
    table["pressure"] = 40 * (table["radius"] - 1) + rng.normal(0, 0.3, len(table))
    table["axial_force"] = 60 * (table["stretch"] - 1) + rng.normal(0, 1.0, len(table))
    return table


def data(table=None, **arguments):
    tube = {"inner_radius": INNER, "outer_radius": OUTER, "opening_angle": ANGLE}
    settings = {"axial_stretch": "stretch", "check": "ignore", **SECTOR}
    return ph.inflation_data(frame() if table is None else table, **tube | settings | arguments)


def kinds(points=5):
    """All tests, the inflation tests alone, and the extension tests alone."""
    both = data(frame(points))
    names = dict.fromkeys(both["experiment"].values.tolist())
    parts = [[n for n in names if n.startswith(kind)] for kind in ("inflation", "extension")]
    return both, *(ph.select(both, experiment=part) for part in parts)


def around(parameters):
    """Priors that hold some of the ordinary parameters of a law, half as large and half more."""
    priors = {}
    for name, value in parameters.items():
        ends = np.sort(np.multiply.outer([0.5, 1.5], value), axis=0)
        priors[name] = pm.Uniform.dist(*ends, shape=np.shape(value) or None)
    return priors


def numbers(parameters):
    return {name: np.array(value, float) for name, value in parameters.items()}


def evaluated(outputs):
    return pytensor.function([], outputs, mode=AS_WRITTEN)()


# --- curves --------------------------------------------------------------------------------------


@cache
def exact_curves(name, layered):
    """Pressure and force at every row of the table, by adaptive quadrature of each wall."""
    law = LAWS[name]
    layers = [oracles.Layer(law.energy, entries(law.parameters[0][0]), OUTER, law.switches)]
    if layered:
        stiff = LAWS["NeoHookean"]
        layers.append(oracles.Layer(stiff.energy, {"mu": 12.0}, OUTER + 0.1))
    return np.array(
        [
            [
                float(quantity(layers, row.radius, INNER, row.stretch, ANGLE))
                for row in frame(3).itertuples()
            ]
            for quantity in (oracles.layered_pressure, oracles.layered_force)
        ]
    )


def assert_close(curves, name, tolerance, layered=False):
    pressure, _, force = evaluated([curves[n] for n in ("pressure", "stiffness", "axial_force")])
    expected = exact_curves(name, layered)
    # The force of a law that says nothing of it is 0.
    scale = np.maximum(np.abs(expected).max(axis=1, keepdims=True), 1e-6)
    np.testing.assert_allclose(
        np.array([pressure, force]) / scale, expected / scale, atol=tolerance
    )


@pytest.mark.parametrize("name", LAWS)
def test_curves_are_those_of_the_stretch_of_each_point(name):
    """Pressure and force of every law agree with adaptive quadrature, by both ways to integrate."""
    law = LAWS[name]
    parameters, points = law.parameters[0][0], data(frame(3))
    found = {}
    for mode in ("quadrature", "collocation"):
        settings = {"mode": mode, "with_force": True}
        forward = ForwardModel(law.strain_energy, points, around(parameters), **settings)
        assert isinstance(forward.way, Collocated if mode == "collocation" else Direct)
        curves = forward.tube(numbers(parameters)).curves()
        assert_close(curves, name, CURVE_TOLERANCE)
        found[mode] = evaluated([*curves.values()])
    for direct, collocated in zip(*found.values(), strict=True):
        scale = max(np.abs(direct).max(), 1e-6)
        np.testing.assert_allclose(collocated / scale, direct / scale, atol=COLLOCATION_TOLERANCE)


@pytest.mark.parametrize("name", LAWS)
def test_curves_of_layers_are_those_of_the_stretch_of_each_point(name):
    """A wall of two layers as well, of which the inner one is of the law."""
    law, points = LAWS[name], data(frame(3), outer_radius=None)
    wall = [
        ph.Layer(law.strain_energy, OUTER - INNER, **numbers(law.parameters[0][0])),
        ph.Layer(ph.NeoHookean(), 0.1, mu=12.0),
    ]
    forward = ForwardModel(wall, points, {}, with_force=True)
    assert_close(forward.tube({}).curves(), name, CURVE_TOLERANCE, layered=True)


def test_grids_that_do_not_pay_are_not_taken():
    """Many points share a grid; of few each costs less by itself; fibres have other nodes."""
    energy, priors = ph.Ogden(), around(OGDEN)
    ways = [ForwardModel(energy, data(frame(n)), priors).way for n in (3, 30)]
    assert isinstance(ways[0], Direct) and isinstance(ways[1], Collocated)
    fibres = ph.HolzapfelGasserOgden()
    way = ForwardModel(fibres, data(), complete_priors(fibres), mode="collocation").way
    assert way.basis and not way.grid


# --- the likelihood ------------------------------------------------------------------------------


def log_likelihood(points, parameters=OGDEN, *, mode="quadrature", **settings):
    observation = Observation(**NOISE | settings)
    forward = observation.forward_model(ph.Ogden(), points, around(OGDEN), mode=mode)
    return observation.log_likelihood(forward.tube(parameters))


def test_likelihood_is_that_of_pressures_and_forces_at_their_stretches():
    """The densities of all points of extension tests, by adaptive quadrature."""
    both, _, extension = kinds(3)
    pressure, force = exact_curves("Ogden", False)
    rows = extension["row"].values
    found = evaluated([log_likelihood(extension, mode=m) for m in ("quadrature", "collocation")])
    expected = 0.0
    for curve, name, sigma in ((pressure, "pressure", 0.8), (force, "axial_force", 2.0)):
        misfit = (curve[rows] - extension[name].values) / sigma
        expected -= np.sum(misfit**2) + len(rows) / 2 * np.log(np.pi * sigma**2)
    np.testing.assert_allclose(found, expected, rtol=LIKELIHOOD_TOLERANCE)
    assert both.sizes["obs"] == 2 * len(rows)


@pytest.mark.parametrize("mode", ["quadrature", "collocation"])
def test_tests_of_both_kinds_are_independent(mode):
    """Together they have the sum of their log-likelihoods; with slopes, those of inflation tests.

    Also where the slope weight is inferred, and its normaliser is a function.
    """
    both, inflation, _ = kinds()
    unknown = pt.as_tensor(SLOPE_WEIGHT) + pt.zeros(())
    together, *apart = evaluated(
        [
            *(log_likelihood(points, mode=mode, slope_weight=0.0) for points in kinds()),
            log_likelihood(both, mode=mode, slope_weight=SLOPE_WEIGHT),
            log_likelihood(inflation, mode=mode, slope_weight=SLOPE_WEIGHT),
            log_likelihood(both, mode=mode, slope_weight=unknown),
        ]
    )
    of_inflation, of_extension, with_slopes, inflation_with_slopes, with_unknown = apart
    np.testing.assert_allclose(together, of_inflation + of_extension, rtol=ROUNDING)
    expected = inflation_with_slopes + of_extension
    np.testing.assert_allclose([with_slopes, with_unknown], expected, rtol=ROUNDING)
    assert abs(with_slopes - together) > 1


def test_more_points_than_stretches_are_compressed():
    """What no curve could follow of many points counts as it does point by point."""
    both, _, extension = kinds(150)
    for points, slope_weight in ((both, SLOPE_WEIGHT), (extension, 0.0)):
        direct, collocated = evaluated(
            [
                log_likelihood(points, mode=mode, slope_weight=slope_weight)
                for mode in ("quadrature", "collocation")
            ]
        )
        np.testing.assert_allclose(collocated, direct, rtol=LIKELIHOOD_TOLERANCE)


def test_balance_of_slopes_is_that_of_the_inflation_tests():
    """Neither their pressures nor their differences are counted."""
    both, inflation, _ = kinds()
    np.testing.assert_array_equal(measured_slopes(both), measured_slopes(inflation))
    assert ph.balanced_slope_weight(both) == ph.balanced_slope_weight(inflation)


FORMS = {
    "matrices": {"mode": "collocation", "slope_weight": SLOPE_WEIGHT},
    "quadrature": {"mode": "quadrature", "slope_weight": SLOPE_WEIGHT},
    "error in the radius": {"error_in": "radius", "sigma": 0.01},
}


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_gradient_of_the_likelihood(form):
    """By the parameters it is what finite differences find, also through the radius at a pressure.

    The error in the radius compares forces at the model's radius, which moves with the parameters.
    """
    points = data(frame(3))

    def function(mu, alpha):
        return log_likelihood(points, {"mu": mu, "alpha": alpha}, **form) / 1e3

    rng = np.random.default_rng(5)
    verify_grad(function, [np.array(6.5), np.array(7.5)], rng=rng, mode=AS_WRITTEN)


def test_error_in_the_radius_controls_the_pressure():
    """Radius and force are those of the tube at the measured pressure and stretch."""
    points = data(frame(3))
    tube = {"inner_radius": INNER, "outer_radius": OUTER, "opening_angle": ANGLE}
    radius, stretch = pt.dscalars(2)
    tube |= {"axial_stretch": stretch}
    curve, force = (
        pytensor.function(
            [radius, stretch], f(ph.Ogden(), radius, **tube, **OGDEN), mode=AS_WRITTEN
        )
        for f in (ph.inflation_pressure, ph.axial_force)
    )
    expected = 0.0
    for row in frame(3).itertuples():
        found = brentq(
            lambda a, row=row: float(curve(a, row.stretch)) - row.pressure, 0.8, 2.0, xtol=1e-14
        )
        error = float(force(found, row.stretch)) - row.axial_force
        expected -= ((found - row.radius) / 0.01) ** 2 + (error / 2.0) ** 2
        expected -= np.log(np.pi * 0.01**2) / 2 + np.log(np.pi * 2.0**2) / 2
    (value,) = evaluated([log_likelihood(points, error_in="radius", sigma=0.01)])
    np.testing.assert_allclose(value, expected, rtol=LIKELIHOOD_TOLERANCE)


@pytest.mark.parametrize("mode", ["quadrature", "collocation"])
def test_measurements_of_extension_tests_are_drawn_independently(mode):
    """Of a generative model pressures and forces of each point are, besides correlated ones."""
    both, _, extension = kinds()
    settings = {**NOISE, "likelihood": "generative", "mode": mode}
    fixed = {n: pm.Uniform.dist(x * (1 - 1e-12), x * (1 + 1e-12)) for n, x in OGDEN.items()}
    logs = []
    for points, weight in ((both, SLOPE_WEIGHT), (extension, 0.0)):
        model = ph.inflation_model(
            ph.Ogden(), points, **settings, slope_weight=weight, priors=fixed
        )
        density = model.compile_logp(model.observed_RVs, sum=False, mode=AS_WRITTEN)
        logs.append(density(model.initial_point()))
    of_both, of_extension = logs
    extended = np.isin(both["row"], extension["row"])
    for found, expected in zip(of_both, of_extension, strict=True):
        np.testing.assert_allclose(found[extended], expected, rtol=1e-8)
    value = sum(x.sum() for x in of_extension)
    (paper,) = evaluated([log_likelihood(extension, slope_weight=0.0)])
    np.testing.assert_allclose(value, paper, rtol=1e-8)


def test_drawn_measurements_have_their_spread():
    """Draws of extension tests are normal about the model's curves, and uncorrelated."""
    both, _, extension = kinds(3)
    fixed = {n: pm.Uniform.dist(x * (1 - 1e-12), x * (1 + 1e-12)) for n, x in OGDEN.items()}
    settings = {"slope_weight": SLOPE_WEIGHT, "likelihood": "generative", "priors": fixed}
    model = ph.inflation_model(ph.Ogden(), both, **NOISE | settings)
    settings = {"random_seed": 1, "mode": "FAST_COMPILE"}
    drawn = pm.draw(model["measured_pressure"], 1000, **settings)
    curve = pm.draw(model["pressure"], **settings)
    extended = np.isin(both["row"], extension["row"])
    errors = ((drawn - curve) / (NOISE["sigma"] / np.sqrt(2)))[:, extended]
    # A standard error of 1000 draws is 0.03.
    np.testing.assert_allclose(np.cov(errors, rowvar=False), np.eye(extended.sum()), atol=0.16)


# --- other data in the place of these -------------------------------------------------------------


@pytest.mark.parametrize("by_test", [False, True], ids=["together", "by test"])
def test_data_of_either_kind_take_the_place_of_both(by_test):
    """Matrices of data with both kinds follow data that hold one, as one made of them does."""
    energy, priors = ph.Ogden(), around(OGDEN)
    settings = {"mode": "collocation", "by_test": by_test, "with_force": True}
    forward = ForwardModel(energy, kinds(6)[0], priors, **settings)
    parameters = {n: pt.as_tensor(x) for n, x in OGDEN.items()}
    factor = pt.dvector("factor")
    if by_test:
        parameters["mu"], parameters["alpha"] = 6.0 * factor, 8.0 * factor**0
    curves = forward.tube(parameters).curves()
    function = pytensor.function(
        [factor], [*curves.values()], mode=AS_WRITTEN, on_unused_input="ignore"
    )
    for points in kinds(4):
        forward.set_data(points)
        factors = 1 + 0.1 * np.arange(points.sizes["test"])
        found = function(factors)
        for i in range(points.sizes["test"]):
            own = np.flatnonzero(points["test"].values == i)
            mu = OGDEN["mu"] * (factors[i] if by_test else 1.0)
            tube = {"inner_radius": INNER, "outer_radius": OUTER, "opening_angle": ANGLE}
            tube |= {"axial_stretch": at_points(points, "axial_stretch")[own]}
            expected = [
                f(energy, points["radius"].values[own], **tube, mu=mu, alpha=8.0)
                for f in (ph.inflation_pressure, ph.inflation_stiffness, ph.axial_force)
            ]
            for curve, exact in zip(found, evaluated(expected), strict=True):
                np.testing.assert_allclose(curve[own], exact, rtol=COLLOCATION_TOLERANCE)


def test_matrices_of_one_kind_refuse_the_other():
    """They would not be exact; the message says of which data the model is to be made."""
    both, *of_one_kind = kinds()
    for points, other in zip(of_one_kind, ("extension", "inflation"), strict=True):
        forward = ForwardModel(ph.Ogden(), points, around(OGDEN), mode="collocation")
        forward.tube(OGDEN).curves()
        expected = rf"hold {other} tests.*make the model of data that hold both"
        with pytest.raises(ValueError, match=expected):
            forward.set_data(both)


def test_a_rising_prior_looks_between_the_points():
    """Of an extension test at the radii and stretches along it, of which there are as many."""
    both, *_ = kinds()
    between = ForwardModel(ph.Ogden(), both, around(OGDEN)).between().data
    for i, kind in enumerate(("inflation", "inflation", "extension", "extension")):
        own, of_test = (np.flatnonzero(d["test"].values == i) for d in (between, both))
        radius, stretch = (at_points(between, n)[own] for n in ("radius", "axial_stretch"))
        measured = both["radius"].values[of_test]
        assert radius.min() == measured.min() and np.isclose(radius.max(), measured.max())
        along = stretch if kind == "extension" else radius
        np.testing.assert_allclose(np.diff(along), np.ptp(along) / (len(own) - 1))


# --- bad input -----------------------------------------------------------------------------------


def model(points, **settings):
    return ph.inflation_model(ph.Ogden(), points, **{"sigma": 1.0, "slope_weight": 0.0, **settings})


BAD = {
    "slopes of extension tests alone": (
        lambda points: model(points, slope_weight=1.0),
        "specimen 'S', experiment 'extension 0': axial_stretch varies within this test and all "
        "others.*slope_weight=0",
    ),
    "balance of no slopes": (ph.balanced_slope_weight, "extension 0.*have no slopes"),
    "inferred slope weight": (
        lambda points: model(points, slope_weight=pm.HalfNormal.dist(1)),
        "extension 0.*have no slopes",
    ),
    "a prior of a stretch that varies": (
        lambda points: model(points, geometry={"axial_stretch": pm.Uniform.dist(1, 2)}),
        "experiment 'extension 0': axial_stretch varies within this test.*leave it out",
    ),
    "no force": (
        lambda points: model(points.drop_vars("axial_force"), force_sigma=1.0),
        "no axial forces",
    ),
}


@pytest.mark.parametrize("case", BAD.values(), ids=BAD)
def test_what_is_refused(case):
    """Each with the test and what to do about it."""
    call, expected = case
    with pytest.raises(ValueError, match=expected):
        call(kinds()[2])
