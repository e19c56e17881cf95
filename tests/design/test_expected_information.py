"""Expected information of planned tests, against sums over coordinates and moduli."""

from dataclasses import replace
from functools import partial

import numpy as np
import pymc as pm
import pytest
import xarray as xr
from problems import AS_WRITTEN
from scipy import stats
from scipy.special import entr, logsumexp, softmax
from variable_classes import (
    INFORMATION_ERRORS,
    SIGMA,
    TRAINING,
    TUBE,
    check_information,
    curves,
    fit,
    information_by_few,
    unit_pressure,
    with_distribution,
)

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.kinds import kind_of_classes
from pymc_hyperelastic.design import information as module
from pymc_hyperelastic.design import trials
from pymc_hyperelastic.design.planned_tests import Defaults, as_design, data_of, radii_of
from pymc_hyperelastic.models.settings import inflation_data_of

SEED = 914
X = "log_reference_strain"
NOISE = SIGMA / np.sqrt(2)  # kPa
ENDS = (7.1, 7.2)
FEW = {"radius": ENDS, "points": 2}
MANY = {"radius": ENDS, "points": 12}
# Locations and spreads of classes.
FAR = {"soft": (-0.9, 0.25), "stiff": (-2.0, 0.4)}
NEAR = {"soft": (-1.5, 0.25), "stiff": (-1.7, 0.4)}
information = partial(information_by_few, random_seed=SEED)


def precision(*tests):
    """Return the precision of the least-squares modulus by tests at these radii."""
    radii = [np.linspace(*test["radius"], test["points"]) for test in tests]
    return sum(np.sum(unit_pressure(radius) ** 2) for radius in radii) / NOISE**2


class Plane:
    """Grids of coordinates, and of least-squares moduli, which are a sufficient statistic."""

    def __init__(self, classes, places, precision, chance=None):
        scale = kind_of_classes(classes).scale
        places = {n: np.broadcast_arrays(*np.atleast_1d(*p)) for n, p in places.items()}
        low = min(np.min(m - 7 * s) for m, s in places.values())
        high = max(np.max(m + 7 * s) for m, s in places.values())
        self.x = np.linspace(max(low, -6), min(high, 3), 600)
        self.mu = scale.numbers([self.x])["mu"]
        logs = [stats.norm.logpdf(self.x[:, None], m, s) for m, s in places.values()]
        self.of_class = softmax([logsumexp(log_p, axis=1) for log_p in logs], axis=1)
        self.chance = np.full(len(places), 1 / len(places)) if chance is None else np.array(chance)
        self.error = precision**-0.5
        # The grid of estimates is as fine as their error, and covers all moduli.
        ends = self.mu.min() - 8 * self.error, self.mu.max() + 8 * self.error
        fine = np.sort(self.mu[:, None] + self.error * np.linspace(-8, 8, 9), axis=None)
        self.found = np.unique(np.clip(fine, *ends))
        self.weight = np.gradient(self.found)
        self.density = stats.norm.pdf(self.found, self.mu[:, None], self.error)

    def about_class(self):
        by_class = self.of_class @ self.density
        both = self.chance[:, None] * by_class
        there = both.min(axis=0) > 1e-300  # avoid 0/0
        ratio = np.log(by_class[:, there] / both.sum(axis=0)[there])
        return np.sum(both[:, there] * ratio * self.weight[there])

    def about_specimen(self):
        found = entr(self.chance @ self.of_class @ self.density) @ self.weight
        return found - 0.5 * np.log(2 * np.pi * np.e * self.error**2)

    def after(self, modulus, precision):
        """Update the classes by a modulus that was measured with this precision."""
        likelihood = stats.norm.pdf(modulus, self.mu, precision**-0.5)
        joint = self.chance[:, None] * self.of_class * likelihood
        self.chance = joint.sum(axis=1) / joint.sum()
        self.of_class = joint / joint.sum(axis=1, keepdims=True)
        return self


def test_information_about_the_class_equals_a_sum_over_a_plane(classes):
    """The distributions of the classes are uncertain, as they are fitted to few specimens."""
    names, chance = ("location", "spread"), [0.8, 0.2]
    prior = dict(zip(TRAINING, chance, strict=True))
    found = information(classes, {"few": FEW, "both": [FEW, MANY]}, class_prior=prior)
    places = {n: [t["posterior"][k].values.ravel() for k in names] for n, t in classes.items()}
    for name, tests in (("few", [FEW]), ("both", [FEW, MANY])):
        plane = Plane(classes, places, precision(*tests), chance)
        check_information(found.sel(design=name), plane.about_class())
    assert found.attrs["entropy"] == pytest.approx(entr(chance).sum())
    shares = [found["weight"][found["true_class"] == name].sum() for name in TRAINING]
    np.testing.assert_allclose(shares, chance)
    # Half of the specimens are of equally many classes.
    counts = [np.sum(found["true_class"] == name) for name in TRAINING]
    assert counts == [26, 14]


def test_tests_give_no_information_about_identical_classes(classes):
    """The same seed gives the same numbers."""
    known = with_distribution(classes, dict.fromkeys(TRAINING, (-1.5, 0.3)))
    settings = {"designs": {"few": FEW}, "specimens": 10, "stop_below": 0.01}
    found, again = (information(known, **settings) for _ in range(2))
    np.testing.assert_allclose(found["information"], 0.0, atol=1e-9)
    assert found.attrs["stop"] == 1
    assert found.attrs["words"] == (
        "no design is expected to give more than 0.01 nats of information: stop"
    )
    xr.testing.assert_identical(found, again)


def test_information_about_a_modulus_equals_a_sum_over_a_plane(classes):
    places = dict.fromkeys(TRAINING, (-1.7, 0.4))
    known = with_distribution(classes, places)
    designs = {"few": FEW, "nothing": {"radius": 7.0001, "points": 1}}
    found = information(known, designs, about="mu")
    expected = Plane(known, places, precision(FEW)).about_specimen()
    # The densities of kernels are somewhat too wide.
    check_information(found.sel(design="few"), expected, bias=0.02)
    # Both kernel densities have errors.
    nothing = found.sel(design="nothing")
    allowed = INFORMATION_ERRORS * nothing["information_se"].item() + 0.03
    assert abs(nothing["information"].item()) < allowed < 0.2


def test_information_after_earlier_tests_of_a_specimen_equals_a_sum_over_a_plane(classes):
    known = with_distribution(classes, NEAR)
    data = curves({"new": [42.0]}, SEED)
    unit = unit_pressure(data["radius"].values)
    modulus = unit @ data["pressure"].values / (unit @ unit)
    found = information(known, {"many": MANY}, given=data)
    plane = Plane(known, NEAR, precision(MANY)).after(modulus, unit @ unit / NOISE**2)
    assert found.attrs["entropy"] == pytest.approx(entr(plane.chance).sum(), abs=0.01)
    check_information(found.squeeze(), plane.about_class())


def unit_force(radius):
    return ph.axial_force(ph.NeoHookean(), radius, ph.Tube(**TUBE), mu=1.0).eval(mode=AS_WRITTEN)


@pytest.mark.deep
# Forces of a class follow from one modulus, and its pressures from three.
@pytest.mark.filterwarnings("ignore:class .* the fit is doubtful")
def test_information_from_axial_forces_and_experiment_effects_equals_a_sum_over_a_plane():
    """Forces are linear in the modulus too; each test of a specimen has its own material."""
    training = {
        name: data.assign(axial_force=("obs", mu * unit_force(data["radius"].values)))
        for (name, data), mu in zip(TRAINING.items(), (40.0, 80.0), strict=True)
    }
    force_sd, effect = 1.0, 0.3
    likelihood = ph.Gaussian(NOISE, force_sd=force_sd)
    variability = ph.Variability(experiment_effect=True)
    settings = {"draws": 100, "chains": 1, "variability": variability}
    fitted = fit(training=training, likelihood=likelihood, **settings)
    known = {"experiment_spread": effect, "effect_spread": 1e-6}
    classes = with_distribution(fitted, FAR, **known)
    found = information(classes, {"with": FEW, "without": FEW | {"force": False}})
    assert found["tests"].sel(design="with").item().endswith(", with force")
    by_force = np.sum(unit_force(np.linspace(*ENDS, FEW["points"])) ** 2) / force_sd**2
    assert by_force > precision(FEW)
    places = {name: (m, np.hypot(s, effect)) for name, (m, s) in FAR.items()}
    for name, more in (("with", by_force), ("without", 0.0)):
        plane = Plane(classes, places, precision(FEW) + more)
        check_information(found.sel(design=name), plane.about_class())


def test_means_errors_and_warnings_equal_values_computed_by_hand(classes):
    defaults = Defaults.of(kind_of_classes(classes), classes, None)
    planned = {n: as_design(n, {"pressure": 1.0, "points": 1}, defaults) for n in "abc"}
    gain = np.array(
        [[0.1, 0.3, 0.2, 0.2, 0.2], [0.5, 0.7, np.nan, 0.9, 0.7], [0.0, 0.4, 0.0, 0.0, 0.0]]
    )
    gains = np.stack([gain, gain - np.array([[0.0], [0.3], [0.01]])])
    effective = np.array([[60.0] * 5, [40, 40, np.nan, 40, 40], [39, 60, 60, 60, 60]])
    tried = trials.Specimens({}, np.array([0, 0, 1, 1, 1]), np.log([0.25, 0.75]))
    np.testing.assert_allclose(tried.weights, [0.125, 0.125, 0.25, 0.25, 0.25])
    with pytest.warns(UserWarning) as warned:
        found = module._result(planned, gains, effective, tried, [*TRAINING], "class", 0.7)
    assert found["design"].values.tolist() == ["b", "a", "c"]
    # One specimen with a quarter of the weight cannot bear design b; errors are those of classes.
    information = 0.55 / 0.75
    error = np.sqrt((0.125**2 + 0.25**2) * 2 * 0.02) / 0.75
    np.testing.assert_allclose(found["information"], [information, 0.2, 0.05])
    np.testing.assert_allclose(found["information_se"], [error, 0.025, 0.05])
    np.testing.assert_allclose(found["difference"], [0, -0.4 / 0.75, -0.5 / 0.75])
    np.testing.assert_allclose(found["difference_se"][0], 0)
    np.testing.assert_allclose(found["change_by_half"], [0.3, 0, 0.01], atol=1e-12)
    np.testing.assert_allclose(found["unsure"], [0, 0, 0.2])
    np.testing.assert_allclose(found["lacking"], [0.25, 0, 0])
    assert found["true_class"].values.tolist() == ["soft"] * 2 + ["stiff"] * 3
    assert found.attrs["entropy"] == pytest.approx(entr([0.25, 0.75]).sum())
    assert found.attrs["words"] == "'b' may give more than 0.7 nats of information"
    assert not found.attrs["stop"]
    with pytest.warns(UserWarning):
        found = module._result(planned, gains, effective, tried, [*TRAINING], "class", None)
    assert "stop" not in found.attrs
    words = f"'b' is expected to give the most information, {information:.3f} ± {error:.3f} nats"
    assert found.attrs["words"] == words
    messages = [str(each.message) for each in warned]
    assert len(messages) == 2
    assert messages[0].startswith("design 'c': 20% of the specimens have fewer than 40 effective")
    assert messages[1].startswith("design 'b': the information changes by 0.300 nats")
    # The density of a normal distribution by its quantiles.
    draws = stats.norm.ppf((np.arange(400) + 0.5) / 400)
    for at in (0.0, 1.0):
        assert trials._log_density(draws, at) == pytest.approx(stats.norm.logpdf(at), abs=0.02)


def test_information_about_an_improbable_class_equals_a_sum_over_a_plane(classes):
    """One of 70 specimens is soft: a test that finds it gains most of the information."""
    chance = {"soft": 0.015, "stiff": 0.985}
    known = with_distribution(classes, FAR)
    found = information(known, {"a": MANY}, class_prior=chance, stop_below=0.01)
    expected = Plane(known, FAR, precision(MANY), [*chance.values()]).about_class()
    check_information(found, expected)
    assert found.attrs["stop"] == 0


def test_radii_of_planned_tests_follow_from_pressure_and_tube_of_each_specimen(classes):
    """Each specimen has its own radius at a pressure; radii below the unloaded one are NaN."""
    kind = kind_of_classes(classes)
    defaults = Defaults.of(kind, classes, None)
    x = np.array([[-1.5], [-2.0]])
    mu = kind.scale.numbers([x])["mu"][:, 0]
    planned = {"pressure": (10, 30), "pressure_unit": "mmHg", "points": 3}
    design = as_design("a", [planned, {"radius": (6.9, 7.5)}], defaults)
    assert design[0].words == "10 to 30 mmHg at a stretch of 1"
    assert len(design[1].held) == 20
    assert defaults.tube == TUBE | {"axial_stretch": 1.0, "opening_angle": 0.0}
    radii = radii_of(kind, design, {X: x})
    # A test may state its own tube: here the same tube, twice as large.
    larger = ph.Tube(**{name: 2 * value for name, value in TUBE.items()})
    design = as_design("a", [planned, planned | {"tube": larger}], defaults)
    own, twice = np.split(radii_of(kind, design, {X: x}), 2, axis=1)
    np.testing.assert_allclose(twice, 2 * own)
    np.testing.assert_array_equal(own, radii[:, :3])
    data = data_of(kind, None, design)
    np.testing.assert_array_equal(data["outer_radius"], np.array([1, 2]) * TUBE["outer_radius"])
    for own, modulus in zip(radii[:, :3], mu, strict=True):
        expected = np.array([10, 20, 30]) * ph.mmHg
        np.testing.assert_allclose(modulus * unit_pressure(own), expected, rtol=1e-6)
    held = np.linspace(6.9, 7.5, 20)
    np.testing.assert_allclose(radii[0, 3:], np.where(held > 7.0, held, np.nan))


def test_planned_tests_have_the_stretch_of_the_classes_and_doubt_pressures_in_kilopascals(classes):
    stretched = classes.copy()
    for name in stretched.children:
        held = classes[name]["constant_data"].to_dataset()
        held = held.assign(axial_stretch=1.5 * xr.ones_like(held["axial_stretch"]))
        stretched[name]["constant_data"] = xr.DataTree(held)
    defaults = Defaults.of(kind_of_classes(classes), stretched, None)
    with pytest.warns(UserWarning, match="is 100 kPa, 750 mmHg; .*='mmHg'$") as said:
        design = as_design("a", {"pressure": (10, 100), "points": 3}, defaults)
    assert len(said) == 1
    assert design[0].words == "10 to 100 kPa at a stretch of 1.5"
    np.testing.assert_array_equal(design[0].axial_stretch, 1.5)


@pytest.mark.parametrize("kept", [0.0, 1.0])
def test_planned_tests_keep_the_radius_of_a_thicker_wall_that_the_given_data_keep(kept, classes):
    """The radius at a pressure is that of a tube with the other wall."""
    kind = replace(kind_of_classes(classes), geometry={"thickness": ph.MeasuredValue(sd=0.2)})
    given = inflation_data_of(classes["soft"])
    given = given.assign(kept_circle=("test", np.full(given.sizes["test"], kept)))
    design = as_design("a", {"pressure": 1.0, "points": 1}, Defaults.of(kind, classes, given))
    found = radii_of(kind, design, {X: np.array([[-1.5]]), "thickness_deviation": np.ones((1, 1))})
    inner, outer = TUBE.values()
    change = (outer - inner) * np.expm1(0.2 / (outer - inner))
    tube = ph.Tube(inner - kept * change, outer + (1 - kept) * change)
    design = as_design(
        "a", {"pressure": 1.0, "points": 1, "tube": tube}, Defaults.of(kind, classes, given)
    )
    exact = radii_of(kind, design, {X: np.array([[-1.5]]), "thickness_deviation": np.zeros((1, 1))})
    np.testing.assert_allclose(found, exact, rtol=1e-9)
    assert data_of(kind, given, design)["kept_circle"].values.tolist()[-1] == kept


@pytest.mark.deep
def test_predicted_probabilities_after_planned_tests_are_calibrated():
    """The mean log probability of the true class equals its expectation under the probabilities."""
    noise = pm.LogNormal.dist(np.log(NOISE), 0.3)
    fitted = fit(
        draws=200, chains=1, priors={"thickness": ph.MeasuredValue(sd=0.3)}, likelihood=noise
    )
    classes = with_distribution(fitted, NEAR)
    found = information(classes, {"one": {"radius": (7.3, 8.2), "points": 6}}, specimens=200)
    chance = np.exp(found["gain"].squeeze("design").values) / 2
    expected = -entr(chance) - entr(np.maximum(1 - chance, 1e-300))
    difference = np.log(chance) - expected
    assert chance.mean() < 0.95
    error = difference.std(ddof=1) / np.sqrt(len(difference))
    assert abs(difference.mean()) < INFORMATION_ERRORS * error


def test_impossible_designs_and_wrong_settings_are_refused(classes):
    for design, message in (
        ([], "design 'a' has no tests"),
        ([(1, 2)], r"design 'a': a test is a dict such as .* not \(1, 2\)"),
        ({"pressures": 1}, "design 'a': 'pressures' is unknown; a test of a tube has"),
        ({"points": 3}, r"either a 'pressure' or a 'radius', and .*or both; got \[\]"),
        ({"pressure": (9, 1)}, r"pressure is \(9, 1\); expected a number, or a pair"),
        ({"pressure": 1, "points": 0}, "design 'a': points is 0; expected at least 1"),
        ({"pressure": -1}, "design 'a': pressures must be 0 or more"),
        ({"radius": 0}, "radii and stretches more than 0"),
        (FEW | {"tube": ph.Tube(axial_stretch=1.2)}, "give the axial stretch of a test as 'axial"),
        ({"pressure": 1, "pressure_unit": "mm"}, "pressure_unit='mm' does not measure pressure"),
        (MANY | {"force": True}, "classes were fitted without its error"),
        (MANY | {"axial_stretch": (1, 1.2)}, "either the radius or the axial stretch"),
        (
            {"pressure": (1, 40)},
            r"design 'a' \(1 to 40 kPa at a .*cannot bear it: choose a smaller",
        ),
    ):
        with pytest.raises((TypeError, ValueError), match=message):
            information(classes, {"a": design})
    for settings, message in (
        ({"designs": {}}, "designs must be a dict from names to planned tests"),
        ({"about": "strength"}, "about is 'strength'; expected 'class' or one of"),
        ({"class_prior": {"soft": 1.0}}, r"class_prior names \['soft'\], but the classes are"),
        ({"class_prior": {"soft": 1.0, "stiff": 0.0}}, "class_prior must be positive for each"),
        ({"class_prior": {"soft": np.inf, "stiff": 1.0}}, "probabilities that add up to 1"),
        ({"given": TRAINING["soft"]}, r"given must hold tests of one specimen; it has \['A1',"),
        ({"draws": 8}, "draws is 8; expected at least 32"),
        ({"about": "compliance"}, "compliance depends on the pressure: give at="),
        ({"about": "compliance", "at": [1, 2]}, r"pressures \[1.0, 2.0\]; expected one"),
    ):
        with pytest.raises(ValueError, match=message):
            information(**{"classes": classes, "designs": {"few": FEW}} | settings)
