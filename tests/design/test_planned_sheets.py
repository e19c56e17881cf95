"""Planned tests of sheets, alone and with tubes, against sums over materials and measurements."""

from functools import partial

import numpy as np
import pandas as pd
import pytest
from problems import AS_WRITTEN
from scipy import stats
from scipy.special import entr
from variable_classes import (
    INFORMATION_ERRORS,
    TUBE,
    check_information,
    fit,
    information_by_few,
    unit_pressure,
    with_distribution,
)

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.kinds import kind_of_classes
from pymc_hyperelastic.design.planned_tests import Defaults, PlannedSheet, as_design, data_of

SEED = 916
# Errors with which each test alone separates the classes in part, kPa and relative.
STRESS_SD, PRESSURE_SD = 6.0, 1.0
STRETCH_SD, THICKNESS_SD, GAUGE_SD = 0.05, 0.4, 0.3
# Moduli of the specimens of both classes, kPa.
TRUE = (10.0, 13.0, 25.0, 30.0)
# Locations and spreads of classes.
PLACES = {"soft": (-0.9, 0.15), "stiff": (-1.7, 0.2)}
STRIP = {"stretch_x": (1, 1.2), "points": 3}
SQUARE = {"stretch_x": (1.0, 1.1), "stretch_y": (1.0, 1.3), "points": 2}
RING = {"radius": (7.3, 8.0), "points": 2}
information = partial(information_by_few, random_seed=SEED)
# The overlap of classes is found from few specimens.
FEW = "ignore:class .* the fit is doubtful"


def unit_stress(stretch, other=None, **settings):
    """Stress of a neo-Hookean sheet of unit modulus along x, by hand."""
    lateral = stretch**-0.5 if other is None else other
    return stretch**2 - (stretch * lateral) ** -2.0


def specimen(name, mu, with_tube, stress="cauchy"):
    """Return a strip, and perhaps a ring, of one specimen, without noise."""
    stretch = np.linspace(1.05, 1.3, 5)
    frame = {"specimen": name, "experiment": "strip", "stretch": stretch}
    strip = ph.sheet_data(
        pd.DataFrame(frame | {"stress": mu * unit_stress(stretch)}), stress=stress, kind="uniaxial"
    )
    if not with_tube:
        return strip
    radius = np.linspace(7.3, 8.5, 5)
    frame = {"specimen": name, "experiment": "ring", "radius": radius}
    frame |= {"pressure": mu * unit_pressure(radius)}
    ring = ph.inflation_data(pd.DataFrame(frame), ph.Tube(**TUBE), check="ignore")
    return ph.combine_tests(ring, strip)


def fitted(with_tube, likelihood, **settings):
    """Fit two classes of two specimens."""
    training = {
        name: ph.combine_tests(*(specimen(f"{name}{mu}", mu, with_tube) for mu in moduli))
        for name, moduli in (("soft", TRUE[:2]), ("stiff", TRUE[2:]))
    }
    return fit(None, training, likelihood, draws=100, chains=1, **settings)


@pytest.fixture(scope="module")
def sheets():
    """Classes of sheets alone, whose stretches, thickness and gauge length have errors."""
    likelihood = ph.Gaussian(stress_sd=STRESS_SD, stretch_sd=STRETCH_SD)
    errors = {"sheet_thickness": THICKNESS_SD, "gauge_length": GAUGE_SD}
    priors = {name: ph.MeasuredValue(sd=sd) for name, sd in errors.items()}
    return with_distribution(fitted(False, likelihood, priors=priors), PLACES)


@pytest.fixture(scope="module")
def both():
    """Classes of sheets and tubes."""
    likelihood = ph.Gaussian(stress_sd=STRESS_SD, pressure_sd=PRESSURE_SD)
    return with_distribution(fitted(True, likelihood), PLACES)


def check(found, expected, bias=0.0):
    check_information(found, expected, bias)
    assert found["information_se"].item() < 0.25


def nodes(count):
    """Return nodes and weights of a standard normal distribution up to 5 standard deviations."""
    x = np.linspace(-5, 5, count)
    return x, stats.norm.pdf(x) / stats.norm.pdf(x).sum()


def moduli(classes, x):
    return kind_of_classes(classes).scale.numbers([np.ravel(x)])["mu"].reshape(np.shape(x))


def densities(y, means, sds, weights):
    """Return the density of a measurement y by class, for nodes (class, node)."""
    return np.stack(
        [
            stats.norm.pdf(y[:, None], mean, sd) @ weight
            for mean, sd, weight in zip(means, sds, weights, strict=True)
        ]
    )


def about_class(means, sds, weights, chance=(0.5, 0.5)):
    """Return the information about the class of one measured number, by a sum over the number."""
    y = np.linspace(np.min(means - 7 * sds), np.max(means + 7 * sds), 6001)
    joint = np.array(chance)[:, None] * densities(y, means, sds, weights)
    posterior = joint / joint.sum(axis=0).clip(1e-300)
    return (joint * np.log((posterior / np.array(chance)[:, None]).clip(1e-300))).sum() * (
        y[1] - y[0]
    )


def by_modulus(classes, precision, count=120):
    """Return moduli and weights (class, node), and the errors of their least-squares estimate."""
    z, weight = nodes(count)
    mu = moduli(classes, np.stack([m + s * z for m, s in PLACES.values()]))
    return mu, np.full_like(mu, precision**-0.5), np.stack([weight, weight])


def precision_of_sheets(classes_sd=STRESS_SD, strip=True, square=False):
    """Return the precision of the least-squares modulus by the strip, the square, or both."""
    units = []
    if strip:
        units.append(unit_stress(np.linspace(1, 1.2, 3)))
    if square:
        x, y = np.linspace(1, 1.1, 2), np.linspace(1, 1.3, 2)
        units += [unit_stress(x, y), unit_stress(y, x)]
    return np.sum(np.concatenate(units) ** 2) / classes_sd**2


PRECISION_OF_RING = np.sum(unit_pressure(np.linspace(7.3, 8.0, 2)) ** 2) / PRESSURE_SD**2


def test_information_from_sheets_and_tubes_equals_a_sum_over_moduli(both):
    """Stresses and pressures are linear in the modulus: their precisions add up."""
    designs = {"strip": STRIP, "ring": RING, "both": [STRIP, RING], "other order": [RING, STRIP]}
    found = information(both, designs, specimens=100)
    precisions = {
        "strip": precision_of_sheets(),
        "ring": PRECISION_OF_RING,
        "both": precision_of_sheets() + PRECISION_OF_RING,
        "other order": precision_of_sheets() + PRECISION_OF_RING,
    }
    expected = {n: about_class(*by_modulus(both, p)) for n, p in precisions.items()}
    for name, value in expected.items():
        check(found.sel(design=name), value)
    # All designs have the same specimens, so that the error of a difference is smaller.
    gain = found["gain"]
    for name in ("strip", "ring"):
        more = gain.sel(design="both") - gain.sel(design=name)
        error = more.std(ddof=1).item() / np.sqrt(more.size)
        difference = expected["both"] - expected[name]
        assert abs(more.mean().item() - difference) < INFORMATION_ERRORS * error
        assert 2 * error < difference
    orders = found.sel(design=["both", "other order"])["information"].values
    np.testing.assert_allclose(*orders, rtol=1e-9)
    text = "stretched 1 to 1.2 along x, free along y; 7.3 to 8 mm at a stretch of 1"
    assert found["tests"].sel(design="both").item() == text


def test_information_about_a_modulus_by_sheets_equals_a_sum_over_moduli(both):
    """All specimens are of equal classes; the information is that of measurement and modulus."""
    place = (-1.3, 0.5)
    known = with_distribution(both, dict.fromkeys(PLACES, place))
    found = information(known, {"square": SQUARE}, about="mu")
    z, weight = nodes(120)
    error = precision_of_sheets(strip=False, square=True) ** -0.5
    mu = moduli(both, place[0] + place[1] * z)
    y = np.linspace(mu.min() - 8 * error, mu.max() + 8 * error, 6001)
    entropy = entr(densities(y, [mu], [error], [weight])[0]).sum() * (y[1] - y[0])
    # The densities of kernels are somewhat too wide.
    check(found.squeeze(), entropy - 0.5 * np.log(2 * np.pi * np.e * error**2), bias=0.02)


@pytest.mark.parametrize("earlier", ["strip", "ring"])
def test_information_after_earlier_tests_equals_a_sum_over_moduli(both, earlier):
    """The earlier test, which may be of the other kind, updates classes and moduli."""
    given = ph.select(specimen("new", 16.0, with_tube=True), experiment=earlier)
    given = given.assign_coords(group=("test", ["any"]))
    unit, sd = unit_stress(given["stretch_x"].values) if earlier == "strip" else 0, STRESS_SD
    if earlier == "ring":
        unit, sd = unit_pressure(given["radius"].values), PRESSURE_SD
    found = information(both, {"square": SQUARE, "both": [SQUARE, RING]}, given=given)
    planned = precision_of_sheets(strip=False, square=True)
    for name, precision in (("square", planned), ("both", planned + PRECISION_OF_RING)):
        mu, sds, weights = by_modulus(both, precision, 180)
        weights = weights * stats.norm.pdf(16.0, mu, sd / np.sqrt(unit @ unit))
        chance = weights.sum(axis=1) / weights.sum()
        weights = weights / weights.sum(axis=1, keepdims=True)
        assert found.attrs["entropy"] == pytest.approx(entr(chance).sum(), abs=0.02)
        check(found.sel(design=name), about_class(mu, sds, weights, chance))


def test_errors_of_stretch_thickness_and_gauge_length_lower_the_information_as_a_sum(sheets):
    """One stretch: stress and error are those of the true stretch, times a factor."""
    stretch, design = 1.3, {"stretch_y": 1.3, "points": 1}
    found = information(sheets, {"a": design}, specimens=150)
    (x, weight), (z, of_z) = nodes(41), nodes(15)
    grid = np.meshgrid(x, z, z, indexing="ij")
    all_weights = np.einsum("i,j,k->ijk", weight, of_z, of_z).ravel()
    x, thicker, longer = (values.ravel() for values in grid)
    shorter = np.exp(-GAUGE_SD * longer)
    true = 1 + (stretch - 1) * shorter
    means, sds = [], []
    for location, spread in PLACES.values():
        modulus = moduli(sheets, location + spread * x) * np.exp(THICKNESS_SD * thicker)
        slope = modulus * (2 * true + true**-2.0) * shorter
        means.append(modulus * unit_stress(true))
        sds.append(np.hypot(STRESS_SD, STRETCH_SD * slope))
    means, sds, weights = np.stack(means), np.stack(sds), np.stack([all_weights] * 2)
    expected = about_class(means, sds, weights)
    check(found.squeeze(), expected)
    # Without the errors the information is larger by more than the test allows.
    exact = about_class(*by_modulus(sheets, (unit_stress(stretch) / STRESS_SD) ** 2))
    assert exact - expected > INFORMATION_ERRORS * found["information_se"].item()


@pytest.mark.deep
@pytest.mark.filterwarnings(FEW)
def test_information_after_a_ring_of_unknown_thickness_equals_a_sum_over_moduli_and_errors():
    """The ring has one error of its thickness before and after; the strip has its own error."""
    errors, points = {"thickness": 0.5, "sheet_thickness": THICKNESS_SD}, {"points": 1}
    priors = {name: ph.MeasuredValue(sd=sd) for name, sd in errors.items()}
    likelihood = ph.Gaussian(stress_sd=STRESS_SD, pressure_sd=PRESSURE_SD)
    classes = with_distribution(fitted(True, likelihood, priors=priors), PLACES)
    given = ph.select(specimen("new", 16.0, with_tube=True), experiment="ring")
    designs = {"ring": {"radius": 9.0} | points, "strip": {"stretch_x": 1.3} | points}
    found = information(classes, designs, given=given, specimens=150)
    (x, weight), (z, of_z) = nodes(81), nodes(21)
    modulus = moduli(classes, np.stack([m + s * x for m, s in PLACES.values()]))
    # The measured thickness is 2 mm.
    tubes = [ph.Tube(7.0, 7 + 2 * np.exp(each * 0.5 / 2)) for each in z]
    radii = np.append(given["radius"].values, 9.0)
    unit = np.stack(
        [
            ph.inflation_pressure(ph.NeoHookean(), radii, t, mu=1.0).eval(mode=AS_WRITTEN)
            for t in tubes
        ]
    )
    expected = modulus[:, :, None, None] * unit[:, :-1]
    density = stats.norm.logpdf(given["pressure"].values, expected, PRESSURE_SD).sum(axis=-1)
    weights = weight[:, None] * of_z * np.exp(density)
    chance = weights.sum(axis=(1, 2)) / weights.sum()
    weights = weights / weights.sum(axis=(1, 2), keepdims=True)
    assert found.attrs["entropy"] == pytest.approx(entr(chance).sum(), abs=0.02)
    means = {
        "ring": (modulus[:, :, None] * unit[:, -1], weights),
        "strip": (
            modulus[:, :, None] * np.exp(THICKNESS_SD * z) * unit_stress(1.3),
            weights.sum(axis=2, keepdims=True) * of_z,
        ),
    }
    for (name, (mean, own)), sd in zip(means.items(), (PRESSURE_SD, STRESS_SD), strict=True):
        mean, own = mean.reshape(2, -1), own.reshape(2, -1)
        check(found.sel(design=name), about_class(mean, np.full_like(mean, sd), own, chance))


def test_planned_stresses_are_of_the_measure_of_the_classes(both):
    """If the classes hold both measures, a design states its own."""
    kind, (name, *_) = kind_of_classes(both), both.children
    defaults = Defaults.of(kind, both, None)
    data = data_of(kind, None, as_design("a", [STRIP, RING, {"stretch_y": 1.2}], defaults))
    assert data["stress_measure"].values.tolist() == ["cauchy", "", "cauchy"]
    np.testing.assert_array_equal(data["stretch_x"][:5], [1, 1.1, 1.2, np.nan, np.nan])
    assert np.isnan(data["stress_x"].values).tolist() == [False] * 3 + [True] * 22
    assert np.isnan(data["stress_y"].values).tolist() == [True] * 5 + [False] * 20
    mixed = both.copy(deep=True)
    held = mixed[name]["constant_data"].to_dataset()
    measures = held["stress_measure"].values.astype("U7")
    measures[-1] = "nominal"
    mixed[name]["constant_data"] = held.assign_coords(stress_measure=("test", measures))
    defaults = Defaults.of(kind, mixed, None)
    (test,) = as_design("a", STRIP | {"stress_measure": "nominal"}, defaults)
    assert test.words == "stretched 1 to 1.2 along x, free along y, nominal stress"
    with pytest.raises(ValueError, match=r"stress_measure is missing; expected .*'nominal'\]"):
        as_design("a", STRIP, defaults)
    # Nominal stresses of a strip are λ − λ⁻².
    nominal = STRIP | {"stress_measure": "nominal"}
    stretch = np.linspace(1, 1.2, 3)
    precision = np.sum((stretch - stretch**-2.0) ** 2) / STRESS_SD**2
    check(information(mixed, {"a": nominal}).squeeze(), about_class(*by_modulus(both, precision)))


def test_sheets_without_a_lateral_stretch_cannot_bear_a_test():
    """An anisotropic sheet that is free along one axis may have no solution."""
    law = ph.FungOrthotropic()
    rng = np.random.default_rng(SEED)
    a1, a2 = rng.uniform(0.5, 2.0, (2, 30))
    values = {"c": np.full(30, 20.0), "a1": a1, "a2": a2, "a4": rng.uniform(0, 4, 30)}
    material = {name: values[name] for name in law.parameter_names}
    stretch = np.array([1.0, 1.4])
    column = {name: value[:, None] for name, value in material.items()}
    lateral = ph.free_stretch(law, stretch, along="y", **column).eval(mode=AS_WRITTEN)
    test = PlannedSheet({"x": np.full(2, np.nan), "y": stretch}, "cauchy", 0.0, "")
    np.testing.assert_array_equal(np.isnan(test.radii(law, material, {})), np.isnan(lateral))
    assert 0 < np.isnan(lateral).mean() < 1


@pytest.mark.deep
@pytest.mark.filterwarnings(FEW)
def test_tests_of_both_kinds_with_experiment_effects_equal_a_sum_over_two_measurements():
    """Strip and ring have materials of their own around that of the specimen."""
    effect, likelihood = 0.3, ph.Gaussian(stress_sd=STRESS_SD, pressure_sd=PRESSURE_SD)
    variability = ph.Variability(experiment_effect=True)
    known = {"experiment_spread": effect, "effect_spread": 1e-6}
    fitted_classes = fitted(True, likelihood, variability=variability)
    classes = with_distribution(fitted_classes, PLACES, **known)
    found = information(classes, {"both": [STRIP, RING]}, specimens=100)
    z, weight = nodes(60)
    grid = np.linspace(-60, 400, 800)  # kPa: moduli up to 4 standard deviations, with their errors
    joint = []
    for location, spread in PLACES.values():
        own = moduli(classes, (location + spread * z)[:, None] + effect * z)
        by_test = [
            np.stack([stats.norm.pdf(grid[:, None], mu, p**-0.5) @ weight for mu in own])
            for p in (precision_of_sheets(), PRECISION_OF_RING)
        ]
        joint.append(np.einsum("s,si,sj->ij", weight, *by_test))
    joint = np.stack(joint) / 2
    assert joint.sum() * (grid[1] - grid[0]) ** 2 == pytest.approx(1, abs=1e-3)
    ratio = 2 * joint / joint.sum(axis=0).clip(1e-300)
    expected = (joint * np.log(ratio.clip(1e-300))).sum() * (grid[1] - grid[0]) ** 2
    check(found.squeeze(), expected)


def test_study_of_both_kinds_is_planned_by_the_spread_of_classes_and_the_errors_of_specimens(both):
    """With many specimens the width of the interval is that of a difference of two means."""
    planned = ph.plan_study(
        both, "log_reference_strain", 200, studies=40, draws=100, random_seed=SEED
    ).squeeze()
    np.testing.assert_allclose(planned["truth"], PLACES["stiff"][0] - PLACES["soft"][0])
    # Curves without noise: the least-squares moduli are the true ones.
    x = np.linspace(-3, 0, 3001)
    log_mu = np.log(moduli(both, x))
    unit = unit_stress(np.linspace(1.05, 1.3, 5)), unit_pressure(np.linspace(7.3, 8.5, 5))
    precision = np.sum(unit[0] ** 2) / STRESS_SD**2 + np.sum(unit[1] ** 2) / PRESSURE_SD**2
    slope = np.interp(np.log(TRUE), log_mu[::-1], np.gradient(log_mu, x)[::-1])
    errors = 1 / (np.array(TRUE) * slope) ** 2 / precision
    variance = sum(spread**2 + errors.mean() for _, spread in PLACES.values()) / 200
    width = 2 * stats.norm.ppf(0.975) * np.sqrt(variance)
    # Widths by quantiles of 100 draws are known to 15 %, their median over 40 studies to 3 %.
    assert planned["width"].item() == pytest.approx(width, rel=0.08)
    assert planned["decided"] == 1 and planned["wrong"] == 0


def test_wrong_settings_of_sheets_are_refused(classes, sheets, both):
    for where, design, message in (
        (classes, STRIP, "design 'a' has a test of a sheet, but .* fitted to tubes alone, so"),
        (sheets, [STRIP, RING], "design 'a' has a test of a tube, but .* fitted to sheets alone"),
        (sheets, STRIP | {"pressure": 1}, "'pressure' is unknown; a test of a sheet has"),
        (sheets, {"stretch": 1.1}, "'stretch' is unknown; .* and one of a sheet has .'stretch_x'"),
        (sheets, {"stretch_x": (1, 1.1, 1.2)}, r"stretch_x is \(1, 1.1, 1.2\); expected a number"),
        (sheets, {"stretch_x": -0.1}, "stretch_x is -0.1; expected deformed over unloaded length"),
        (sheets, {"stretch_y": 1.1, "points": 0}, "points is 0; expected at least 1"),
        (sheets, STRIP | {"stress_measure": "nominal"}, r"'nominal'; expected one of \['cauchy'\]"),
        (both, {}, "one of a sheet a 'stretch_x', a 'stretch_y' or both"),
        (both, {"stretch_x": 1e200}, r"'a' \(stretched 1e\+200 along x, .* 100.0% of the specim"),
    ):
        with pytest.raises(ValueError, match=message):
            information(where, {"a": design})
    with pytest.raises(ValueError, match=r"inner_radius \(unknown\).*state the tube"):
        information(sheets, {"a": STRIP}, about="radius", at=2.0)
