"""Comparison of groups, against closed forms for the distributions of two classes."""

import json

import arviz_stats
import fits
import numpy as np
import pytest
import xarray as xr
from normal_specimens import of_groups, of_pairs
from scipy import special, stats
from tube_posteriors import result as posterior
from variable_classes import SIGMA, STRESS, TRAINING, TUBE, UNIT_PRESSURE, fit, modulus

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes import groups, quantities
from pymc_hyperelastic.classes.compare_classes import _bayes_factors
from pymc_hyperelastic.classes.joint import Apart, Joint
from pymc_hyperelastic.classes.kinds import kind_of_classes
from pymc_hyperelastic.classes.quantities import (
    complete_conditions,
    standard_specimens,
    values_of,
)

SEED = 913
X = "log_reference_strain"
DRAWS = 400
# Errors of means and standard deviations of the draws: four standard errors, in posterior sds.
MEAN_ERROR, SD_ERROR = 4 / np.sqrt([DRAWS, 2 * DRAWS])
# Errors of the medians and standard deviations of specimens, in standard deviations: 400 draws of
# about 2000 weighted ones, and the least squares of curves that are not quite linear.
SPECIMEN_ERROR = 0.3
# The specimens of a draw are evenly spread in probability: means over 128 of them have this error.
MANY, PRECISE = 128, 0.01
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(41)
WEIGHTS = WEIGHTS / WEIGHTS.sum()
# Relative rounding errors of closed forms.
ROUNDING = 1e-8


def compare(classes, quantity, **settings):
    settings = {"random_seed": SEED, "effect_prior": None} | settings
    return ph.compare_classes(classes, quantity, **settings)


def measured():
    """Return the coordinate of each specimen by least squares, and its standard error."""
    found = []
    for data in TRAINING.values():
        for specimen in dict.fromkeys(data["specimen"].values):
            own = ph.select(data, specimen=specimen)["pressure"].values.reshape(-1, 7)
            mu = own.mean(axis=0) @ UNIT_PRESSURE / (UNIT_PRESSURE @ UNIT_PRESSURE)
            # The error of ln μ is nearly that of the coordinate.
            error = SIGMA / np.sqrt(2 * len(own) * (UNIT_PRESSURE @ UNIT_PRESSURE)) / mu
            found.append((np.log(np.arcsinh(STRESS / (2 * mu)) / 2), error))
    return np.array(found).T


SPECIMENS, SIGN = measured(), np.repeat([-0.5, 0.5], 3)
# Ages that explain how the specimens of a group differ: by 0.1 per year.
AGE = 10 * (SPECIMENS[0] - np.repeat(SPECIMENS[0].reshape(2, 3).mean(axis=1), 3))
# The specimens of both groups in pairs.
ANIMALS = {"A1": 1, "A2": 2, "A3": 3, "B1": 1, "B2": 2, "B3": 3}


@pytest.fixture(scope="module")
def scale(classes):
    return kind_of_classes(classes).scale


@pytest.fixture(scope="module")
def result(classes):
    return compare(classes, [X, "mu"], specimens=MANY, draws=DRAWS)


@pytest.fixture(scope="module")
def distributions(classes):
    """Return the location and the spread of each group by draw: DRAWS of 1000, evenly spaced."""
    chosen = np.linspace(0, 999, DRAWS).round().astype(int)
    found = {}
    for name in TRAINING:
        posterior = classes[name]["posterior"].to_dataset()
        found[name] = [posterior[k].values.ravel()[chosen] for k in ("location", "spread")]
    return found


@np.errstate(over="ignore")
def test_typical_specimen_mean_and_spread_equal_quadrature(result, distributions):
    for group, (location, spread) in distributions.items():
        of_nodes = modulus(location[:, None] + spread[:, None] * NODES)
        mean = of_nodes @ WEIGHTS
        expected = {
            "typical": modulus(location),
            "mean": mean,
            "spread": np.sqrt((of_nodes - mean[:, None]) ** 2 @ WEIGHTS),
        }
        # The moments of wider distributions depend on a few specimens in a million.
        narrow = spread < 0.4
        assert narrow.mean() > 0.5
        for statistic, values in expected.items():
            found = result["draws"].sel(group=group, statistic=statistic, quantity="mu")
            rtol = {"typical": ROUNDING, "mean": PRECISE, "spread": 5 * PRECISE}[statistic]
            np.testing.assert_allclose(found[narrow], values[narrow], rtol=rtol)
        own = result["draws"].sel(group=group, quantity=X)
        np.testing.assert_allclose(own.sel(statistic="typical"), location, rtol=ROUNDING)
        np.testing.assert_allclose(own.sel(statistic="spread"), spread, rtol=ROUNDING)
    assert float(result["lacking"].max()) == 0
    assert result["unit"].values.tolist() == ["1", "kPa"]


def test_statistics_of_a_difference_are_computed_from_the_draws(result, distributions):
    found = result.sel(comparison="stiff − soft", statistic="typical")
    (m1, s1), (m2, s2) = distributions.values()
    difference = modulus(m2) - modulus(m1)
    mu, x = found.sel(quantity="mu"), found.sel(quantity=X)
    assert mu["difference"].item() == pytest.approx(np.median(difference))
    assert mu["difference_sd"].item() == pytest.approx(np.std(difference, ddof=1))
    ends = np.quantile(difference, [0.025, 0.975])
    np.testing.assert_allclose(mu["difference_interval"], ends)
    assert mu["ratio"].item() == pytest.approx(np.median(modulus(m2) / modulus(m1)))
    assert mu["probability_of_rise"].item() == np.mean(difference > 0)
    assert x["probability_of_rise"].item() == np.mean(m2 > m1) < 0.5
    assert x["probability_of_direction"].item() == np.mean(m2 < m1)
    assert np.isnan(x["ratio"].item())
    effect = np.median((m2 - m1) / np.sqrt((s1**2 + s2**2) / 2))
    assert x["effect_size"].item() == pytest.approx(effect)
    assert result.attrs["compared"] == 2
    assert "0.1 of their 95 % intervals are expected to exclude 0" in result.attrs["words"]


def test_specimens_are_near_their_curves_and_pulled_to_their_group(result, distributions):
    own = result.sel(quantity=X)
    np.testing.assert_array_equal(own["specimen_group"], np.repeat(["soft", "stiff"], 3))
    curves, error = SPECIMENS
    location, spread = (
        np.repeat([distributions[name][i] for name in TRAINING], 3, axis=0) for i in (0, 1)
    )
    # Given the distribution, the posterior of a normal coordinate is normal.
    weight = spread**2 / (spread**2 + error[:, None] ** 2)
    mean = weight * curves[:, None] + (1 - weight) * location
    variance = (weight * error[:, None] ** 2).mean(axis=1) + mean.var(axis=1)
    sd = np.sqrt(variance)
    found = own["specimen_value_sd"].values
    np.testing.assert_allclose(found, sd, rtol=SPECIMEN_ERROR)
    median = own["specimen_value"].values
    np.testing.assert_array_less(np.abs(median - mean.mean(axis=1)), SPECIMEN_ERROR * sd)


def test_overlap_of_one_coordinate_equals_the_overlap_of_normal_densities(result, distributions):
    """For one coordinate the overlap of the quantity is that of the specimens."""
    found = result.sel(comparison="stiff − soft")
    grid = np.linspace(-6, 3, 4001)
    both = [stats.norm.pdf(grid, m[:, None], s[:, None]) for m, s in distributions.values()]
    exact = np.median(np.trapezoid(np.minimum(*both), grid, axis=1))
    for quantity in (X, "mu"):
        assert found["overlap"].sel(quantity=quantity).item() == pytest.approx(exact, abs=0.015)
    assert found["overlap_of_specimens"].item() == pytest.approx(exact, abs=0.01)
    np.testing.assert_allclose(found["best_accuracy"], 1 - found["overlap"] / 2)


def test_coordinate_spread_is_reported_with_its_prior(scale, result, distributions):
    found = result.isel(coordinate=0)
    spread = distributions["soft"][1]
    assert found["coordinate_spread"].sel(group="soft") == pytest.approx(np.median(spread))
    (logs,), sd = scale.spread_prior
    assert found["prior_coordinate_spread"] == pytest.approx(np.exp(logs), rel=0.01)
    ends = np.exp(logs + sd * stats.norm.ppf([0.025, 0.975]))
    np.testing.assert_allclose(found["prior_coordinate_spread_interval"], ends, rtol=0.01)


def test_sensitivities_equal_psense_of_the_closed_form_of_the_model(scale, result, distributions):
    """The model is normal: the coordinate of each specimen is measured with a small error."""
    logs = {"log_prior": 0.0, "log_likelihood": 0.0}
    specimens = np.transpose(SPECIMENS).reshape(2, 3, 2)
    for own, (location, spread) in zip(specimens, distributions.values(), strict=True):
        logs["log_prior"] += stats.norm.logpdf(location, *np.ravel(scale.location_prior))
        median, sd = np.exp(scale.spread_prior[0][0]), scale.spread_prior[1]
        logs["log_prior"] += stats.lognorm.logpdf(spread, sd, scale=median)
        for x, error in own:
            logs["log_likelihood"] += stats.norm.logpdf(x, location, np.hypot(spread, error))
    logs["posterior"] = distributions["stiff"][0] - distributions["soft"][0]
    groups = {k: xr.Dataset({"value": (("chain", "draw"), v[None])}) for k, v in logs.items()}
    tree = xr.DataTree.from_dict(groups)
    found = result.sel(statistic="typical", quantity=X).squeeze()
    for group in ("prior", "likelihood"):
        expected = float(arviz_stats.psense(tree, group=group)["value"])
        assert found[f"{group}_sensitivity"].item() == pytest.approx(expected, rel=0.05)


def test_properties_equal_tube_properties_and_burst_tubes_are_counted(classes):
    """Some soft tubes burst below 6 kPa and have no compliance."""
    pressure = [2.5, 6.0]
    quantities = ["compliance", "log compliance"]
    with pytest.warns(UserWarning, match="have no") as warned:
        result = compare(classes, quantities, at=pressure, draws=100, specimens=16)
    lacking = result["lacking"].sel(quantity="compliance", pressure=6.0)
    assert lacking.sel(group="soft") > lacking.sel(group="stiff")
    words = f"class 'soft': {float(lacking.sel(group='soft')):.1%} of its specimens have no compl"
    assert str(warned[0].message).startswith(words)
    assert json.loads(result.attrs["tube"]) == TUBE | {"axial_stretch": 1.0, "opening_angle": 0.0}
    draws = result["draws"].sel(group="stiff", statistic="typical", pressure=2.5)
    location = classes["stiff"]["posterior"]["location"].values.ravel()
    mu = modulus(location[np.linspace(0, 999, 100).round().astype(int)])
    at = ph.Conditions(2.5, tube=ph.Tube(**TUBE))
    tube = ph.tube_properties(posterior(mu=mu), at, energy=ph.NeoHookean())
    found = draws.sel(quantity="compliance").values.ravel()
    np.testing.assert_allclose(found, tube["compliance"].values.ravel(), rtol=1e-6)
    logs = draws.sel(quantity="log compliance")
    np.testing.assert_allclose(np.exp(logs), draws.sel(quantity="compliance"))


@pytest.mark.filterwarnings("ignore:.* of its specimens have no radius")
def test_properties_beyond_the_measured_pressures_are_flagged_and_warned_of(classes):
    """The lowest pressure of the soft group is 1.06 kPa, that of the stiff one 2.26 kPa."""
    with pytest.warns(UserWarning, match="extrapolated") as warned:
        result = compare(classes, ["radius", "mu"], at=[0.9, 2.0], draws=100, specimens=16)
    soft, stiff = (text for w in warned if "extrapolated" in (text := str(w.message)))
    assert soft.startswith("class 'soft': 1 of 2 points is extrapolated: pressure 0.9 kPa (6.75")
    assert stiff.startswith("class 'stiff': 2 of 2 points are extrapolated: pressure 0.9 to 2 kPa")
    flags = result["extrapolated"].transpose("group", "quantity", "pressure")
    assert flags.values.tolist() == [
        [[True, False], [False, False]],
        [[True, True], [False, False]],
    ]


def test_logarithm_of_a_property_needs_a_pressure_as_the_property_does(classes):
    with pytest.raises(ValueError, match="compliance depends on the pressure"):
        compare(classes, "log compliance")
    with pytest.raises(ValueError, match="stored_energy_change depends on two pressures"):
        compare(classes, "log stored_energy_change", at=1.0)


@pytest.fixture
def joint_models(monkeypatch):
    """Give joint models fixed evidences; test_joint compares evidences with closed forms."""
    real, seen = Joint.fit, []

    def fitted(joint, units, *args):
        if joint.apart == Apart(3.0, 1.0):  # estimates of a difference
            return real(joint, units, *args)
        seen.append((joint.apart, {group: [*own] for group, own in units.items()}))
        return joint

    def log_evidence(joint):
        return ph.Estimate(-3.0, 0.3) if joint.apart else ph.Estimate(-5.0, 0.4)

    monkeypatch.setattr(Joint, "fit", fitted)
    monkeypatch.setattr(groups, "log_evidence", log_evidence)
    return seen


def check_difference(found, exact):
    """Compare the draws of the difference, and the Bayes factor of evidences by hand."""
    difference = found["draws"].sel(group="stiff") - found["draws"].sel(group="soft")
    assert abs(difference.mean() - exact.mean[-1]) < MEAN_ERROR * exact.sd[-1]
    assert found["difference_sd"].item() == pytest.approx(exact.sd[-1], rel=SD_ERROR)
    assert found["log_bayes_factor"].item() == pytest.approx(2.0)
    assert found["log_bayes_factor_se"].item() == pytest.approx(0.5)
    assert found["probability_of_difference"].item() == pytest.approx(special.expit(2.0))


def test_covariate_effect_and_difference_equal_closed_forms(classes, scale, joint_models):
    settings = {"covariates": {"age": dict(zip(ANIMALS, AGE, strict=True))}, "draws": DRAWS}
    found = compare(classes, X, effect_prior=2.0, **settings)
    found = found.sel(statistic="typical").squeeze()
    exact = of_groups(scale, *SPECIMENS, SIGN, [AGE / AGE.std()], Apart(3.0, 1.0))
    check_difference(found, exact)
    apart = {"soft": ["A1", "A2", "A3"], "stiff": ["B1", "B2", "B3"]}
    together = [f"{group}: {name}" for group, names in apart.items() for name in names]
    assert joint_models == [(Apart(2.0, 1.0), apart), (None, {"all": together})]
    # A median has 1.25 times the standard error of a mean.
    error = abs(found["covariate_effect"] * AGE.std() - exact.mean[1])
    assert error < 1.25 * MEAN_ERROR * exact.sd[1]
    sd = found["covariate_effect_sd"].item() * AGE.std()
    assert sd == pytest.approx(exact.sd[1], rel=SD_ERROR)
    low, high = found["covariate_effect_interval"].values
    assert 0 < low < 0.1 < high < 0.2


def test_default_tube_has_the_median_measures_of_the_specimens(classes):
    """A specimen counts once, however many tests it has; a given value replaces the median."""
    changed = classes.copy(deep=True)
    for name, radii in (("soft", [6.0, 6.5, 7]), ("stiff", [7.5, 8, 8, 8.9])):
        data = changed[name]["constant_data"].to_dataset().assign(inner_radius=("test", radii))
        changed[name]["constant_data"] = xr.DataTree(data)
    stated = ph.Conditions(tube=ph.Tube(axial_stretch=1.5))
    tube = complete_conditions(changed, [X], stated).tube
    assert tube == ph.Tube(7.25, 9.0, axial_stretch=1.5, opening_angle=0.0)
    with pytest.raises(ValueError, match="expected one axial stretch, at which all are compared"):
        compare(classes, X, at=ph.Conditions(tube=ph.Tube(axial_stretch=[1.0, 1.5])))


@pytest.mark.parametrize(
    "quantity, at",
    [
        ("compliance", 100),
        ("stored_energy_change", ph.Conditions(10, pressure_range=(10, 100))),
    ],
)
def test_pressures_in_mmhg_that_are_stated_as_kilopascals_give_one_warning(classes, quantity, at):
    in_mmhg = pytest.warns(UserWarning, match="is 100 kPa, 750 mmHg; .*='mmHg'$")
    with pytest.warns(UserWarning, match="extrapolated"), in_mmhg as said:
        complete_conditions(classes, [quantity, X], at)
    assert sum("expected at most" in str(one.message) for one in said) == 1


def test_stored_energy_change_needs_only_a_pressure_range(classes):
    """The change of the stored energy is the difference of the energies at both pressures."""
    few = {"draws": 100, "specimens": 8}
    between = ph.Conditions(pressure_range=(0.2, 0.4))
    with pytest.warns(UserWarning, match="extrapolated"):
        ends = compare(classes, "stored_energy", at=[0.2, 0.4], **few)["draws"]
        compared = compare(classes, "stored_energy_change", at=between, **few)
    assert compared.attrs["words"] == (
        "differences compared, without a correction for multiple comparisons: 1. If no groups "
        "differ, 0.05 of their 95 % intervals are expected to exclude 0"
    )
    found = compared["draws"]
    typical = {"statistic": "typical"}
    change = ends.sel(typical).diff("pressure").squeeze(["pressure", "quantity"])
    np.testing.assert_allclose(found.sel(typical).squeeze("quantity"), change, rtol=1e-6)


def test_difference_between_paired_specimens_equals_closed_form(classes, scale, joint_models):
    """Moduli of animals differ by half, and all rise by about as much."""
    settings = {"pair": ANIMALS, "effect_prior": 1.0, "draws": DRAWS}
    found = compare(classes, X, **settings).squeeze()
    # The specimens of a draw have exactly the variance of their distribution.
    spread = found["value"].sel(statistic="spread").values
    np.testing.assert_allclose(found["coordinate_spread"].values, spread, rtol=1e-6)
    found = found.sel(statistic="typical")
    check_difference(found, of_pairs(scale, *SPECIMENS, [], Apart(3.0, 1.0)))
    assert joint_models == [(each, {"pairs": ["1", "2", "3"]}) for each in (Apart(1, 0.5), None)]
    # The reference strain falls if the modulus rises.
    assert found["probability_of_rise"] < 0.02
    assert found["share_rising"] < 0.2
    # Three changes hardly determine their spread, whose prior has a median of about 0.3.
    changes = SPECIMENS[0][3:] - SPECIMENS[0][:3]
    assert np.std(changes) < found["spread_of_change"] < 0.3
    assert found["effect_size_of_change"] < found["effect_size"] < 0
    middle = found["value"].mean().item()
    assert middle == pytest.approx(SPECIMENS[0].mean(), abs=found["difference_sd"].item())


@pytest.mark.filterwarnings("ignore:.*have no compliance there", "ignore:.*extrapolated")
def test_share_of_rising_animals_is_that_of_those_with_the_quantity(classes):
    """Soft specimens are more compliant; some burst, which is no fall of their compliance."""
    groups = xr.DataTree.from_dict({name: classes[name] for name in ("stiff", "soft")})
    found = compare(groups, "compliance", at=6.0, pair=ANIMALS, draws=100).squeeze()
    assert found["lacking"].max() > 0.1
    assert found["share_rising"] > 0.98


def test_overlap_of_a_quantity_does_not_depend_on_others(classes):
    """Moduli are positive, and compared by their logarithms; the logarithms are negative."""
    alone, beside = (
        compare(classes, names, draws=100, specimens=32)["overlap"].sel(quantity="mu")
        for names in ("mu", ["mu", X])
    )
    np.testing.assert_allclose(alone, beside)


def test_bayes_factors_of_laws_are_averaged_by_their_evidence():
    """The evidence of each hypothesis is the mean over two laws."""
    different, same = [(-3.0, 0.1), (-2.0, 0.3)], [(-5.0, 0.2), (-1.0, 0.4)]
    laws = zip(different, same, strict=True)
    found = _bayes_factors([[tuple(ph.Estimate(*e) for e in law)] for law in laws])
    means, errors = [], []
    for evidences in (different, same):
        values = np.exp([value for value, _ in evidences])
        means.append(values.mean())
        own = values * [error for _, error in evidences]
        errors.append(np.linalg.norm(own) / values.sum())
    assert found["log_bayes_factor"][1] == pytest.approx([np.log(means[0] / means[1])])
    assert found["log_bayes_factor_se"][1] == pytest.approx([np.hypot(*errors)])
    assert found["probability_of_difference"][1] == pytest.approx([means[0] / sum(means)])


@pytest.mark.parametrize("size", [1, 2, 5])
def test_properties_do_not_depend_on_the_size_of_batches(classes, size, monkeypatch):
    """There may be more batches than draws, each with many specimens."""
    kind, at = kind_of_classes(classes), complete_conditions(classes, ["stiffness"], 2.5)
    coordinates = np.log(0.2) + 0.1 * np.arange(6.0).reshape(1, 2, 3)
    for draws in (coordinates, coordinates[:, :1]):
        whole = values_of(kind, draws, ["stiffness"], at)["stiffness"]
        with monkeypatch.context() as patch:
            patch.setattr(quantities, "_BATCH_SIZE", size)
            found = values_of(kind, draws, ["stiffness"], at)["stiffness"]
        np.testing.assert_allclose(found, whole, rtol=1e-12)
        assert np.isfinite(whole).all() and np.ptp(whole) > 0


def test_standard_specimens_have_zero_mean_and_unit_covariance():
    for size, count in ((1, 128), (3, 32)):
        z = standard_specimens(size, count)
        assert z.shape == (count + 1, size) and not z[0].any()
        np.testing.assert_allclose(z[1:].mean(axis=0), 0, atol=1e-12)
        covariance = np.cov(z[1:].T, ddof=0).reshape(size, size)
        np.testing.assert_allclose(covariance, np.eye(size), atol=1e-9)


@pytest.mark.deep
@pytest.mark.filterwarnings("ignore:.*have no compliance there", "ignore:.*extrapolated")
def test_draws_of_each_law_are_in_proportion_to_its_probability(classes):
    """The fixture is compared with Demiray's law, of two parameters."""
    other = fit(ph.Demiray(), draws=500, chains=1)
    laws = {"NeoHookean": classes, "Demiray": other}
    result = compare(laws, "compliance", at=1.0, draws=500)
    alone = [compare(t, "compliance", at=1.0, draws=500)["draws"] for t in laws.values()]
    evidences = [sum(ph.log_evidence(t[g]).value for g in TRAINING) for t in laws.values()]
    share = special.expit(evidences[1] - evidences[0])
    chosen = [np.isin(result["draws"].values, d.values).mean() for d in alone]
    assert chosen[1] == pytest.approx(share, abs=0.09)  # four standard errors
    assert sum(chosen) == pytest.approx(1.0)
    assert result.attrs["strain_energy"] == "NeoHookean, Demiray"


def test_wrong_quantities_and_settings_are_refused(classes):
    for quantity, settings, message in (
        ("stiffnes", {}, "no quantity is called 'stiffnes'; NeoHookean has the .*'stiffness'"),
        ([], {}, "one or several different names"),
        ("compliance", {}, "compliance depends on the pressure: give at="),
        ("in_vivo_axial_stretch", {"at": 2}, "depends on two pressures: give .*pressure_ran"),
        (X, {"draws": 10}, "draws is 10"),
    ):
        with pytest.raises(ValueError, match=message):
            compare(classes, quantity, **settings)


def test_groups_that_cannot_be_compared_are_refused(classes):
    one = xr.DataTree.from_dict({"soft": classes["soft"]})
    with pytest.raises(ValueError, match=r"needs at least two classes; got \['soft'"):
        compare(one, X)
    with pytest.raises(ValueError, match="variability='specimen'"):
        compare(fits.fit("pooled"), X)
    first = classes["stiff"]["specimens"].to_dataset().isel(specimen=[0])
    classes = classes.copy()
    classes["stiff"]["specimens"] = xr.DataTree(first)
    with pytest.raises(ValueError, match="class 'stiff' has one specimen, 'B1': a comparison"):
        compare(classes, X)
