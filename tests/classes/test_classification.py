"""Classes, the probabilities of new experiments, divergences, and what survives a file."""

from functools import cache

import exact
import numpy as np
import pandas as pd
import pymc as pm
import pytensor.tensor as pt
import pytest
import xarray as xr
from interrupts import interrupt
from scipy.special import logsumexp, softmax

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes import pooled

SEED = 411
DRAWS, CHAINS = 1000, 4
# An honest standard error is exceeded threefold once in 370 runs; seeds are fixed.
STANDARD_ERRORS = 3
# Nats. Odds of classes are then right to a sixth, where they decide anything.
EVIDENCE_TOLERANCE = 0.15
# What is only stored and read, or added in another order.
ROUNDING = 1e-12
# Package and test integrate the wall by different rules, both exact to 1e-12 of the largest.
PRESSURE_TOLERANCE = 1e-9
NAMES = ("C1", "C2")


@cache
def study():
    return ph.load_dataset("simulated_sheep_aorta")


def noise():
    return {"sigma": 15 * ph.mmHg, "slope_weight": ph.balanced_slope_weight(study())}


def training():
    return {name: ph.select(study(), group=name, experiment=1) for name in NAMES}


def fit(energy=None, **settings):
    settings = {"draws": DRAWS, "chains": CHAINS, "random_seed": SEED} | noise() | settings
    return ph.fit_classes(energy or ph.Ogden(), training(), progressbar=False, **settings)


def classify(data, classes, **settings):
    return ph.classify(data, classes, **{"random_seed": SEED, "progressbar": False} | settings)


@cache
def new_data(backwards=False):
    """Four experiments of two specimens, one of either class, which take turns."""
    order = [("S4", 2), ("S2", 2), ("S4", 3), ("S2", 3)]
    tables = []
    for specimen, experiment in reversed(order) if backwards else order:
        one = ph.select(study(), specimen=specimen, experiment=experiment)
        labels = {name: one[name].values[0] for name in ("specimen", "experiment", "group")}
        points = {name: one[name].values for name in ("radius", "pressure")}
        tables.append(pd.DataFrame(labels | points))
    return ph.inflation_data(
        pd.concat(tables, ignore_index=True), inner_radius=7.0, outer_radius=9.0
    )


@pytest.fixture(scope="module")
def classes():
    return fit()


@pytest.fixture(scope="module")
def by_test(classes):
    return classify(new_data(), classes)


@pytest.fixture(scope="module")
def by_specimen(classes):
    return classify(new_data(), classes, by="specimen")


OGDEN_BOX = ((0.0, 100.0), (-40.0, 40.0))


@cache
def exact_posterior(name, tests=()):
    """Posterior of a class, perhaps together with some of the new experiments."""
    new = exact.curves_of(new_data())
    curves = [*exact.curves_of(training()[name]), *(new[i] for i in tests)]
    return exact.posterior(curves, "Ogden", box=OGDEN_BOX, **noise())


def exact_predictives(units):
    return np.array(
        [
            [exact_posterior(n, unit).log_evidence - exact_posterior(n).log_evidence for n in NAMES]
            for unit in units
        ]
    )


def assert_exact(result, truth):
    """Evidences within their error bars, and the probabilities of classes that follow."""
    error = np.abs(result["log_evidence"].values - truth)
    assert np.all(error < STANDARD_ERRORS * result["log_evidence_se"].values), error
    assert np.all(error < EVIDENCE_TOLERANCE), error
    np.testing.assert_allclose(
        result["class_probability"], softmax(truth, axis=1), atol=2 * EVIDENCE_TOLERANCE, rtol=0
    )


# --- classify ------------------------------------------------------------------------------------


def test_experiments_are_classified_one_by_one(by_test):
    """Each new experiment has the exact evidence under each class, in the order of the data."""
    assert by_test["log_evidence"].dims == ("test", "class_label")
    assert by_test["specimen"].values.tolist() == ["S4", "S2", "S4", "S2"]
    assert by_test["experiment"].values.tolist() == [2, 2, 3, 3]
    assert by_test["class_label"].values.tolist() == list(NAMES)
    assert_exact(by_test, exact_predictives([(0,), (1,), (2,), (3,)]))
    chosen = by_test["class_probability"].idxmax("class_label").values
    assert chosen.tolist() == by_test["group"].values.tolist() == ["C2", "C1", "C2", "C1"]


def test_experiments_of_a_specimen_are_joined(by_specimen, by_test):
    """A specimen's experiments share one material: their joint evidence, not their product."""
    assert by_specimen["log_evidence"].dims == ("specimen", "class_label")
    assert by_specimen["specimen"].values.tolist() == ["S4", "S2"]
    truth = exact_predictives([(0, 2), (1, 3)])
    assert_exact(by_specimen, truth)
    product = by_test["log_evidence"].values[:2] + by_test["log_evidence"].values[2:]
    # Under the class of the other specimen, both experiments teach the same lesson twice over.
    assert np.all(np.abs(product - truth).max(axis=1) > 10)


def test_probabilities_follow_from_evidences(by_test):
    """Bayes' rule with equal priors; rows add up to one, and errors are propagated."""
    probability = by_test["class_probability"].values
    np.testing.assert_allclose(probability.sum(axis=1), 1, atol=ROUNDING)
    np.testing.assert_allclose(probability, softmax(by_test["log_evidence"].values, axis=1))
    spread = np.sqrt((by_test["log_evidence_se"].values ** 2).sum(axis=1))
    expected = probability[:, 0] * probability[:, 1] * spread
    for error in by_test["class_probability_se"].values.T:
        np.testing.assert_allclose(error, expected, rtol=1e-9, atol=ROUNDING)


def test_class_prior_multiplies_the_odds(classes, by_specimen):
    """Evidences know nothing of the class prior, and odds are multiplied by its odds."""
    prior = {"C2": 0.9, "C1": 0.1}
    result = classify(new_data(), classes, by="specimen", class_prior=prior)
    np.testing.assert_array_equal(result["log_evidence"], by_specimen["log_evidence"])
    log_odds = by_specimen["log_evidence"].values + np.log([0.1, 0.9])
    np.testing.assert_allclose(result["class_probability"], softmax(log_odds, axis=1))


def test_a_class_may_be_impossible_beforehand(classes, by_specimen):
    """It stays so, without a warning, and its evidence is still told."""
    result = classify(new_data(), classes, by="specimen", class_prior={"C1": 1.0, "C2": 0.0})
    np.testing.assert_array_equal(result["class_probability"], [[1, 0], [1, 0]])
    np.testing.assert_array_equal(result["log_evidence"], by_specimen["log_evidence"])


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"class_prior": {"C1": 1.0}}, r"class_prior names \['C1'\].* \['C1', 'C2'\]"),
        ({"class_prior": {"C1": 0.5, "C2": 0.6}}, "add up to 1"),
        ({"class_prior": {"C1": -0.5, "C2": 1.5}}, "class_prior"),
        ({"by": "experiment"}, "'test' or 'specimen'"),
    ],
)
def test_impossible_settings_say_why(classes, settings, message):
    """One error each, which names the setting."""
    with pytest.raises(ValueError, match=message):
        classify(new_data(), classes, **settings)


def test_order_of_the_data_is_the_order_of_the_answers(classes, by_test):
    """Turning the data round turns the answers round, within their error bars."""
    result = classify(new_data(backwards=True), classes)
    assert result["specimen"].values.tolist() == by_test["specimen"].values.tolist()[::-1]
    spread = np.hypot(result["log_evidence_se"].values, by_test["log_evidence_se"].values[::-1])
    moved = result["log_evidence"].values - by_test["log_evidence"].values[::-1]
    assert np.all(np.abs(moved) < STANDARD_ERRORS * spread)


def test_one_seed_gives_one_answer(classes, by_specimen):
    """The same seed gives the same numbers."""
    again = classify(new_data(), classes, by="specimen")
    xr.testing.assert_identical(again, by_specimen)


def test_classes_read_from_a_file_give_the_same_probabilities(classes, by_specimen, tmp_path):
    """Saved as netCDF and read again, classes classify alike to rounding; nothing is pickled."""
    classes.to_netcdf(tmp_path / "classes.nc", engine="h5netcdf")
    with xr.open_datatree(tmp_path / "classes.nc", engine="h5netcdf") as loaded:
        again = classify(new_data(), loaded, by="specimen")
    for name in ("class_probability", "log_evidence", "log_evidence_se"):
        np.testing.assert_allclose(again[name], by_specimen[name], rtol=ROUNDING, atol=ROUNDING)


def test_interrupt_leaves_nan_and_keeps_the_rest(classes, by_test, monkeypatch):
    """Ctrl-C in the second experiment keeps the first and says that the others are unknown."""
    interrupt(monkeypatch, pooled.ClassPredictive, "__call__", 4)
    with pytest.warns(UserWarning, match="NaN"):
        result = classify(new_data(), classes)
    assert result.sizes == by_test.sizes
    first, expected = (x.isel(test=[0]).drop_attrs(deep=False) for x in (result, by_test))
    xr.testing.assert_identical(first, expected)
    assert np.isnan(result["class_probability"].values[1:]).all()
    assert np.isnan(result["log_evidence"].values[2:]).all()


# --- fit_classes ---------------------------------------------------------------------------------


def test_interrupt_keeps_the_classes_already_fitted(monkeypatch):
    """Ctrl-C in the second class returns the first; in the first class there is nothing yet."""
    interrupt(monkeypatch, pooled, "run_smc", 2)
    with pytest.warns(UserWarning, match=r"only \['C1'\]"):
        kept = fit(draws=100, chains=1)
    assert list(kept.children) == ["C1"]
    interrupt(monkeypatch, pooled, "run_smc", 1)
    with pytest.raises(KeyboardInterrupt):
        fit(draws=100, chains=1)


def test_a_class_keeps_what_it_was_made_from(classes):
    """Training data come back as they were, and every class has a seed of its own."""
    for name, data in training().items():
        fitted = classes[name]
        np.testing.assert_array_equal(fitted["observed_data"]["pressure"], data["pressure"])
        np.testing.assert_array_equal(fitted["constant_data"]["radius"], data["radius"])
        assert fitted["posterior"].sizes == {"chain": CHAINS, "draw": DRAWS}
        assert list(fitted["posterior"].data_vars) == ["mu", "alpha"]
    assert len({classes[name].attrs["random_seed"] for name in NAMES}) == 2


@pytest.mark.parametrize("other", ["energy", "sigma", "slope_weight", "prior"])
def test_classes_of_different_models_are_refused(classes, other):
    """Evidences under two likelihoods or priors cannot be compared, and the message says so."""
    energy, settings = {
        "energy": (ph.CriscioneType(), {}),
        "sigma": (ph.Ogden(), {"sigma": 10 * ph.mmHg}),
        "slope_weight": (ph.Ogden(), {"slope_weight": 1.0}),
        "prior": (ph.Ogden(), {"priors": {"mu": pm.Uniform.dist(0, 90)}}),
    }[other]
    stranger = fit(energy, draws=50, chains=1, **settings)["C2"]
    mixed = xr.DataTree.from_dict({"C1": classes["C1"], "C2": stranger})
    for act in (
        lambda: classify(new_data(), mixed),
        lambda: ph.kl_divergence(mixed, "C1", "C2"),
    ):
        with pytest.raises(ValueError, match="class 'C2' was fitted with"):
            act()


@pytest.mark.parametrize("other", [{"slope_weight": 0.0}, {"sigma": 10 * ph.mmHg}, "variability"])
def test_laws_of_other_noise_are_refused(classes, other):
    """Evidences of laws under two likelihoods do not compare, and the message names both."""
    if other == "variability":
        message = "average_over holds NeoHookean with variability='specimen', of pressures, but "
        differing = {"variability": "specimen", "slope_weight": 0.0, "sigma": 1.0}
        stranger = fit(ph.NeoHookean(), draws=100, chains=1, **differing)
    else:
        stranger = fit(ph.NeoHookean(), draws=50, chains=1, **other)
        message = f"average_over holds NeoHookean with the noise .*{next(iter(other))}.*, but "
    with pytest.raises(ValueError, match=message + "Ogden has the noise .*do not compare"):
        classify(new_data(), classes, average_over=[stranger])


@pytest.mark.deep
def test_laws_of_one_name_are_told_apart(classes):
    """Two laws that differ in a setting are labelled with it; others by their names.

    Priors keep the terms apart: with equal ones evidences are doubtful.
    """
    priors = {
        "mu": pm.LogNormal.dist(np.log([10.0, 2.0]), 0.5),
        "alpha": pm.Normal.dist([6.0, 2.0], [1.5, 0.3]),
    }
    few = {"draws": 200, "chains": 2}
    one, two = fit(ph.OgdenSeries(1), **few), fit(ph.OgdenSeries(2), priors=priors, **few)
    new = ph.select(new_data(), specimen="S2", experiment=2)
    result = classify(new, classes, average_over=[one, two])
    labels = ["Ogden", "OgdenSeries(terms=1)", "OgdenSeries(terms=2)"]
    assert result["strain_energy_probability"]["strain_energy"].values.tolist() == labels


def test_classes_are_fitted_in_the_context_of_a_model():
    """The models of the classes neither meet nor become part of the user's own."""
    with pm.Model() as own:
        pm.Normal("mu")
        classes = fit(draws=50, chains=1)
        classify(ph.select(new_data(), specimen="S2", experiment=2), classes)
        ph.kl_divergence(classes, *NAMES)
    assert list(own.named_vars) == ["mu"]


def test_what_is_not_a_result_is_refused(classes):
    """An empty tree and a bare posterior each have a message of their own."""
    with pytest.raises(ValueError, match="no classes"):
        classify(new_data(), xr.DataTree())
    bare = xr.DataTree.from_dict({"C1/posterior": classes["C1"]["posterior"].to_dataset()})
    with pytest.raises(ValueError, match=r"ph\.fit_classes"):
        classify(new_data(), bare)


# --- divergence ----------------------------------------------------------------------------------


def exact_divergence(first, second):
    """Mean of the log ratio of two posteriors over the nodes of the first."""
    fitted = exact_posterior(first)
    log_ratio = 0.0
    for sign, name in ((1, first), (-1, second)):
        curves = exact.curves_of(training()[name])
        exponent, row = np.unique(fitted.exponent, return_inverse=True)
        top, curvature, peak = (
            x[row] for x in exact.parabola(curves, "Ogden", exponent, **noise())
        )
        log_density = top - curvature * (fitted.modulus - peak) ** 2
        log_ratio += sign * (log_density - exact_posterior(name).log_evidence)
    return fitted.mean(log_ratio)


@pytest.mark.parametrize(("first", "second"), [NAMES, NAMES[::-1]])
def test_divergence_is_the_exact_one(classes, first, second):
    """Kullback-Leibler divergence against quadrature; it is not symmetric."""
    value, error = ph.kl_divergence(classes, first, second)
    truth = exact_divergence(first, second)
    assert abs(value - truth) < STANDARD_ERRORS * error
    assert error < 0.05 * truth


def test_divergence_of_a_class_from_itself_is_zero(classes):
    """Exactly, without error."""
    assert ph.kl_divergence(classes, "C1", "C1") == (0.0, 0.0)


def test_divergence_names_an_unknown_class(classes):
    """The message lists the classes that there are."""
    with pytest.raises(ValueError, match=r"no class 'C3'; there are \['C1', 'C2'\]"):
        ph.kl_divergence(classes, "C1", "C3")


# --- predictions ---------------------------------------------------------------------------------


@pytest.mark.compiled
def test_predicted_pressure_is_that_of_each_draw(classes):
    """Pressure and stiffness of single draws, against the other way of integrating the wall."""
    radius = np.array([6.5, 7.0, 8.3, 10.0])
    fitted = classes["C2"]
    with pytest.warns(UserWarning, match="internal radius 6.5 to 10 mm"):
        curve = ph.predict_pressure(fitted, radius)
    assert curve["pressure"].dims == ("chain", "draw", "radius")
    assert curve["pressure"].shape == (CHAINS, DRAWS, 4)
    with pytest.warns(UserWarning, match="axial stretch 1.2, measured 1"):
        other = ph.predict_pressure(
            fitted, radius, inner_radius=6.0, axial_stretch=1.2, opening_angle=0.5
        )
    for result, tube in ((curve, (7.0, 9.0, 1.0, 0.0)), (other, (6.0, 9.0, 1.2, 0.5))):
        for chain, draw in ((0, 0), (1, 17), (CHAINS - 1, DRAWS - 1)):
            at = {"chain": chain, "draw": draw}
            mu, alpha = (float(fitted["posterior"][name][at]) for name in ("mu", "alpha"))
            units = exact.Curve(radius, np.zeros(4), *tube).responses("Ogden", alpha)
            for name, unit in zip(("pressure", "stiffness"), units, strict=True):
                scale = np.max(np.abs(unit))
                np.testing.assert_allclose(
                    result[name][at], mu * unit[0], atol=mu * scale * PRESSURE_TOLERANCE, rtol=0
                )


# --- a material of one's own, and inferred noise --------------------------------------------------


class IsotropicExponential(ph.StrainEnergy):
    """``W = (c/(2 k)) (exp(k (I1 - 3)) - 1)``, as a user would write it."""

    parameters = (
        ph.Parameter("c", "c", "kPa", (0.0, 200.0), "small-strain shear modulus"),
        ph.Parameter("k", "k", "", (0.05, 10.0), "stiffening"),
    )

    def energy(self, radial, hoop, axial, *, c, k):
        excess = radial**2 + hoop**2 + axial**2 - 3
        return c / (2 * k) * (pt.exp(k * excess) - 1)


def isotropic_exponential_response(hoop, axial, k):
    excess = (hoop * axial) ** -2 + hoop**2 + axial**2 - 3
    return (hoop - 1 / (hoop**3 * axial**2)) * np.exp(k * excess)


def test_energy_of_ones_own_is_fitted_and_classifies(monkeypatch, tmp_path):
    """Nothing but an energy is written; evidence, file, classes and predictives follow exactly."""
    monkeypatch.setitem(exact.RESPONSES, "IsotropicExponential", isotropic_exponential_response)
    fit(IsotropicExponential()).to_netcdf(tmp_path / "own.nc", engine="h5netcdf")
    box = tuple(p.prior_range for p in IsotropicExponential.parameters)
    new = ph.select(study(), specimen="S5", experiment=3)

    def exact_evidence(name, *more):
        curves = [curve for data in (training()[name], *more) for curve in exact.curves_of(data)]
        return exact.posterior(curves, "IsotropicExponential", box=box, **noise()).log_evidence

    with xr.open_datatree(tmp_path / "own.nc", engine="h5netcdf") as classes:
        for name in NAMES:
            value, error = ph.log_evidence(classes[name])
            assert abs(value - exact_evidence(name)) < STANDARD_ERRORS * error
        result = classify(new, classes)
        assert ph.kl_divergence(classes, *NAMES).value > 0
    assert result["class_probability"].idxmax("class_label").item() == "C2"
    truth = np.array([[exact_evidence(name, new) - exact_evidence(name) for name in NAMES]])
    assert_exact(result, truth)


@pytest.mark.deep
def test_inferred_noise_has_the_exact_evidence(tmp_path):
    """With a prior of sigma the evidence is the mean, over that prior, of evidences at known sigma.

    The prior survives the file, and new experiments are classified under the sigma of each class.
    """
    scale = 2.0
    half = OGDEN_BOX[0], (0.0, 40.0)  # by symmetry, the evidence of both signs
    classes = fit(sigma=pm.HalfNormal.dist(scale))
    classes.to_netcdf(tmp_path / "classes.nc", engine="h5netcdf")
    new = ph.select(study(), specimen="S2", experiment=2)

    def exact_evidence(name, *more):
        # In log sigma, where the posterior has an sd of a tenth and vanishes at the ends: the
        # trapezoidal rule is then exact to exp(-2 (pi sd/step)^2), far below what is compared.
        curves = [curve for data in (training()[name], *more) for curve in exact.curves_of(data)]
        step = 0.1
        log_sigma = np.arange(-0.3, 2.2, step)
        terms = []
        for s in np.exp(log_sigma):
            fitted = exact.posterior(
                curves, "Ogden", box=half, sigma=s, slope_weight=noise()["slope_weight"]
            )
            log_prior = np.log(2 / (scale * np.sqrt(2 * np.pi))) - (s / scale) ** 2 / 2
            terms.append(fitted.log_evidence + log_prior + np.log(s * step))
        assert max(terms[0], terms[-1]) < max(terms) - 12
        return float(logsumexp(terms))

    truth = {name: exact_evidence(name) for name in NAMES}
    with xr.open_datatree(tmp_path / "classes.nc", engine="h5netcdf") as loaded:
        for name in NAMES:
            value, error = ph.log_evidence(loaded[name])
            assert abs(value - truth[name]) < min(STANDARD_ERRORS * error, EVIDENCE_TOLERANCE)
        result = classify(new, loaded)
    assert_exact(result, np.array([[exact_evidence(n, new) - truth[n] for n in NAMES]]))
