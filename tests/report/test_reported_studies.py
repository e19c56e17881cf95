"""Results of sampling, of every kind together, are reported whole."""

import warnings
from contextlib import contextmanager

import numpy as np
import pandas as pd
import pymc as pm
import pytest
import xarray as xr
from pages import Page, assert_sound
from stored import classified, fitted_classes
from variable_classes import TRAINING, TUBE, classify, curves, fit

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.kinds import kind_of_settings
from pymc_hyperelastic.reports.blocks import Found
from pymc_hyperelastic.reports.kinds import kind_of
from pymc_hyperelastic.reports.methods import fit_sentences
from pymc_hyperelastic.reports.settings import priors_of_class

QUICK = {"draws": 100, "chains": 2, "random_seed": 1, "progressbar": False}
NEW = curves({"N1": [60.0], "N2": [300.0]}, 5)


@contextmanager
def unheard():
    """Few draws, and soft materials, are warned of, which is not what is tested."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        yield


@pytest.fixture(scope="module")
def variable():
    """Classes whose specimens differ."""
    return fit(draws=100)


@pytest.fixture(scope="module")
def results(variable):
    """A whole study: classes, what was classified, left out, and compared at several pressures."""
    at = {"pressure": [1.0, 2.0, 3.0, 4.0], "bayes_factor": False, "random_seed": 1}
    with unheard():
        curves = ph.compare_classes(variable, "compliance", draws=100, **at)
    return {
        "Classes": variable,
        "New": classify(NEW, variable),
        "Compared": ph.compare_classes(variable, "mu", draws=100, random_seed=1),
        "Curves": curves,
        "Left out": left_out(),
    }


@pytest.fixture(scope="module")
def page(results, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    return Page(ph.report(results, folder / "report.html", data=NEW))


@pytest.fixture(scope="module")
def designs(variable):
    """A low test, a high one, and one that is no worse than the latter."""
    planned = {"point": {"pressure": 0.5, "points": 1}, "curve": {"pressure": (1, 6)}}
    settings = {"specimens": 20, "draws": 32, "stop_below": 0.1, "random_seed": 1}
    return ph.expected_information(variable, planned, **settings)


def left_out():
    """What ph.calibration_report says of specimens left out, as it is stored."""
    probability = np.array([[[0.9, 0.1], [0.2, 0.8], [np.nan, np.nan]]])
    dims = ("strain_energy", "specimen", "class_label")
    return xr.Dataset(
        {
            "class_probability": (dims, probability),
            "log_evidence": (dims, np.log(probability)),
            "verdict": (dims[:2], [["good", "not to be trusted", ""]]),
            "log_score": (dims[:2], np.log([[0.9, 0.8, np.nan]])),
            "brier_score": (dims[:2], [[0.02, 0.08, np.nan]]),
        },
        {
            "strain_energy": ["NeoHookean"],
            "specimen": ["A1", "B1", "B2"],
            "class_label": ["soft", "stiff"],
            "true_class": ("specimen", ["soft", "stiff", "stiff"]),
            "left_out": ("specimen", ["A", "B", "B"]),
        },
    )


def test_settings_and_methods_of_classes_that_differ(variable):
    """Coordinates, priors of the class, and how specimens were integrated are told."""
    said = " ".join(fit_sentences(Found("Fit", variable)))
    assert "Specimens of a class differed: the parameters of each were a draw from a normal" in said
    assert "over the coordinate log_reference_strain (reference stress 20 kPa)." in said
    assert "LogNormal(−0.9163, 0.7) for spread[log_reference_strain]" in said
    assert "correlations" not in said  # of one coordinate there are none
    assert "parameters of each specimen were integrated by importance sampling" in said
    assert "7 experiments with 49 points" in said


def test_study_has_all_kinds(results):
    """Each result of the study is known as what it is."""
    kinds = [kind_of(result).name for result in results.values()]
    assert kinds == ["Fitted classes", "Classified", *["Comparison of groups"] * 2, "Left out"]


def test_study_is_whole(page):
    """All chapters are there, in order, with the figures and tables of each, and none failed."""
    assert_sound(page)
    assert page.chapters[2:-2] == [
        "Evidence and its diagnosis",
        "Data",
        "Fits",
        "Posteriors",
        "Classes and decisions",
        "Differences between groups",
        "Elastic properties",
        "Settings",
    ]
    assert "cannot be shown" not in page.text
    assert sum(tag == "svg" for tag, _ in page.elements) == 10
    assert "Left out, NeoHookean: not known of B2." in page.warnings
    assert "Left out, NeoHookean: not to be trusted without B1." in page.warnings
    assert "differences were looked at" not in page.warnings.split("Compared: 1")[0]
    assert "the classes have no variability" not in page.warnings


def test_posteriors_are_of_the_typical_specimen_and_the_class(page, variable):
    """Parameters of the typical specimen stand beside location and spread of the class."""
    headings, rows = page.table("Posterior of the parameters")
    spread = variable["soft"]["posterior"]["spread"].values[..., 0]
    (row,) = [r for r in rows if r[:2] == ["spread[log_reference_strain]", "soft"]]
    assert row[headings.index("mean")] == spread.mean()
    of_class = [f"{name}[log_reference_strain]" for name in ("location", "spread")]
    assert [r[0] for r in rows[:3]] == ["mu", *of_class]


def test_specimens_are_told_with_their_fits(page, variable):
    """Misfit, Pareto shape and error of each specimen are those of the class."""
    _headings, rows = page.table("How well the best curve of each specimen")
    assert [row[:2] for row in rows[:3]] == [["A1", "soft"], ["A2", "soft"], ["A3", "soft"]]
    for place, name in ((2, "misfit"), (4, "pareto_k"), (5, "standard_error")):
        expected = np.concatenate([t["specimens"][name].values for t in variable.children.values()])
        np.testing.assert_array_equal([row[place] for row in rows], expected)


def test_differences_are_those_of_the_result(page, results):
    """Differences, intervals, effect sizes and Bayes factors are those of ph.compare_classes."""
    result = results["Compared"].sel(quantity="mu").isel(comparison=0)
    headings, (row,) = page.table("Differences of the typical specimens: Compared")
    typical = result.sel(statistic="typical")
    interval = typical["difference_interval"].values.tolist()
    assert row[2:5] == [float(typical["difference"]), *interval]
    assert row[headings.index("effect size")] == float(result["effect_size"])
    assert row[headings.index("best accuracy")] == float(result["best_accuracy"])
    _, (row,) = page.table("Whether groups differ at all")
    names = ("log_bayes_factor", "log_bayes_factor_se", "probability_of_difference")
    assert row[1:] == [float(result[name]) for name in names]
    pressures = page.column("Differences of the typical specimens: Curves", "pressure (kPa)")
    assert pressures[0] == 1.0 and pressures[-1] == 4.0


def test_strange_specimen_is_told_of(page):
    """A specimen that no class knows is named in the warnings, by its p-values."""
    assert "New: strange to every class (all p-values below 0.05): N2" in page.warnings


def test_methods_of_the_study(page):
    """Each step has its sentences, in order, in one paragraph."""
    steps = (
        "inflation curves of 6 specimens (3 in soft and 3 in stiff) were analysed",
        "The curves of 2 specimens were held against the classes soft and stiff",
        "The groups soft and stiff were compared by the posterior",
        "Bayes factor of different against equal distributions",
        "compliance at pressures from 1 to 4 kPa",
        "each of 3 specimens, in 2 groups that belong together, was left out",
        "All was computed with pymc_hyperelastic",
    )
    places = [page.methods.index(step) for step in steps]
    assert places == sorted(places)


def test_planned_tests_are_ranked(write, designs):
    """The figure, numbers of the result, what they are about, and all that can be told."""
    page = write({"Tests": designs})
    assert_sound(page)
    assert "cannot be shown" not in page.text
    assert page.chapters[2:-2] == ["What to measure next"]
    _, rows = page.table("Expected information of planned tests about the class")
    assert [row[0] for row in rows] == designs["design"].values.tolist() == ["curve", "point"]
    np.testing.assert_array_equal([row[2] for row in rows], designs["information"])
    np.testing.assert_array_equal([row[5] for row in rows], designs["difference_se"])
    assert "All that can be told of the class are 0.6931 nats." in page.text
    assert f"Tests: {designs.attrs['words']}." in page.warnings
    assert "ranked by the information that they are expected to give of the class" in page.methods
    assert sum(tag == "svg" for tag, _ in page.elements) == 1


def test_designs_that_cannot_be_told_apart_are_named(write_words, designs):
    """Within two standard errors of the first, and where specimens are left out or unsure."""
    assert "may be as good as curve" not in write_words(designs).warnings
    near = designs.assign(difference_se=("design", [0.0, 10.0]), lacking=("design", [0.0, 0.07]))
    page = write_words({"Tests": near})
    assert "Tests: point may be as good as curve: the difference is within" in page.warnings
    assert "Tests, point: 7.0% of the specimens cannot be tested so" in page.warnings


def test_planned_studies_are_told(write, variable):
    """Widths, shares and log scores are those of the result."""
    plan = ph.plan_study(variable, ["mu", "log mu"], (4, 12), studies=20, draws=50, random_seed=1)
    page = write({"Plan": plan})
    assert_sound(page)
    _, rows = page.table("What studies would find of differences: Plan")
    assert [row[0] for row in rows] == ["mu", "mu", "log mu", "log mu"]
    assert [row[3] for row in rows] == [4, 12] * 2
    widths = plan["width"].isel(comparison=0).transpose("quantity", "specimens").values.ravel()
    np.testing.assert_array_equal([row[4] for row in rows], widths)
    _, rows = page.table("How well studies would classify new specimens: Plan")
    np.testing.assert_array_equal([row[1] for row in rows], plan["log_score"])
    assert "20 simulated studies" in page.warnings
    assert "simulated studies of 4 and 12 specimens a group" in page.methods


def sampled(energy, data, **settings):
    """A model that was sampled by so few draws that it would be warned of."""
    settings = {"noise_sd": 0.4, "slope_weight": 0.0} | settings
    with unheard():
        return ph.sample_smc(ph.inflation_model(energy, data, **settings), **QUICK)


def test_sampled_model_with_unknown_noise(write):
    """A model that was sampled by itself is reported, its error among the parameters."""
    tree = sampled(ph.NeoHookean(), TRAINING["soft"], noise_sd=pm.HalfNormal.dist(1.0))
    page = write({"Model": tree})
    assert_sound(page)
    assert "cannot be shown" not in page.text
    _, rows = page.table("Posterior of the parameters")
    (row,) = [row for row in rows if row[0] == "noise_sd"]
    assert row[2:4] == ["kPa", tree["posterior"]["noise_sd"].values.mean()]
    assert "inferred, with the prior HalfNormal(0, 1) kPa" in page.methods


def test_layers(write):
    """Of a wall of layers each has its law, equation and parameters, from the inside out."""
    layers = [ph.Layer(ph.NeoHookean(), 1.2, mu=20.0), ph.Layer(ph.Demiray(), 0.8, b=0.5)]
    data = TRAINING["soft"]
    data = data.assign(outer_radius=data["outer_radius"].where(False))
    page = write({"Layers": sampled(layers, data)})
    assert_sound(page)
    assert "cannot be shown" not in page.text
    settings = {row[0]: row[1] for row in page.table("Settings")[1]}
    assert settings["strain energy of layer 1, from inside"] == "NeoHookean"
    assert settings["its equation of layer 2, from inside"].startswith("W = (μ/(2 b))")
    assert "of 2 layers, from the inside out of the strain energies NeoHookean, W" in page.methods
    assert "mu_2" in page.column("Posterior of the parameters", "parameter")


def test_forces_and_extension_tests(write):
    """Measured forces have a figure; extension tests are counted, and no pressure is theirs."""
    radius, stretch = np.linspace(7.3, 9.0, 6), np.linspace(1.1, 1.4, 6)
    tables = [
        pd.DataFrame({"experiment": "inflated", "radius": radius, "stretch": 1.2, "pressure": 2.0}),
        pd.DataFrame({"experiment": "drawn", "radius": 7.5, "stretch": stretch, "pressure": 3.0}),
    ]
    frame = pd.concat(tables, ignore_index=True).assign(specimen="S1", axial_force=900.0)
    frame.loc[:5, "pressure"] = 30.0 * curves_of_unit(radius)
    data = ph.inflation_data(frame, **TUBE, axial_stretch="stretch", check="ignore")
    page = write({"Model": sampled(ph.NeoHookean(), data, force_noise_sd=100.0)})
    assert_sound(page)
    assert "cannot be shown" not in page.text
    labels = [a["aria-label"] for tag, a in page.elements if tag == "svg"]
    assert "Fit of the axial force: Model" in labels
    assert "1 specimen, 2 experiments (1 of them an extension test), 12 points" in page.text
    assert "inflation and extension curves of 1 specimen" in page.methods
    assert "Axial forces were measured too." in page.methods
    assert "Errors of axial forces were taken as normal, with a standard deviation of 100 mN" in (
        page.methods
    )


def curves_of_unit(radius):
    """Rising pressures of a soft tube."""
    return 0.02 + 0.1 * (radius - radius[0])


def test_average_over_laws(write):
    """Laws over which was averaged have a figure, a table and a sentence; data stand once."""
    laws = ("NeoHookean", "Demiray")
    fits = [fitted_classes(energy=law) for law in laws]
    of_laws = {"log_evidence": [-30.0, -3.0], "log_evidence_se": [0.1, 0.2]}
    of_laws |= {"probability": [0.25, 0.75], "probability_se": [0.05, 0.05]}
    result = classified().assign_coords(strain_energy=list(laws))
    for name, values in of_laws.items():
        result[f"strain_energy_{name}"] = "strain_energy", values
    page = write([*fits, result])
    assert_sound(page)
    labels = [a["aria-label"] for tag, a in page.elements if tag == "svg"]
    assert "Probability of each strain energy: Classified" in labels
    _, rows = page.table("Strain energies over which was averaged")
    assert rows == [["NeoHookean", 0.25, 0.05, -30.0, 0.1], ["Demiray", 0.75, 0.05, -3.0, 0.2]]
    assert "averaged over the strain energies NeoHookean and Demiray" in page.methods
    assert page.methods.count("10 experiments with 200 points") == 1
    assert page.methods.count("Each vessel was modelled as") == 1
    assert "tube with the strain energy NeoHookean, W" in page.methods.split("was also modelled")[0]
    assert "tube with the strain energy Demiray, W" in page.methods.split("was also modelled")[1]
    titles = [text for tag, text in page.headings if tag == "h3"]
    assert titles.count("Fitted classes") == titles.count("Fitted classes 2") == 5
    assert page.text.count("Measured curves: class C1.") == 1


def test_priors_of_classes_with_all_that_may_be_unknown():
    """Spreads of experiments and of noise, and correlations, have their priors in the settings."""
    names = ("location", "spread", "experiment_spread")
    priors = {"effect_spread": pm.LogNormal.dist(-1.0, 0.25)}
    kind = kind_of_settings(
        "specimen",
        ph.Ogden(),
        {},
        noise_sd=pm.LogNormal.dist(0.0, 1.0),
        experiment_effect=True,
        priors=priors,
    )
    said = priors_of_class(kind)
    for coordinate in ("log_reference_strain", "log_alpha"):
        assert {f"{name}[{coordinate}]" for name in names} <= set(said)
    assert said["location[log_alpha]"] == "Normal(1.897, 1.2)"
    assert said["effect_spread"] == "LogNormal(−1, 0.25)"
    assert said["noise_sd"] == "LogNormal(0, 1) kPa"
    assert said["noise_spread"] == "LogNormal(−1.204, 0.5)"
    assert said["the correlations"] == "the determinant of their matrix"


def test_population_and_models_that_do_not_say_what_they_are(write_words):
    """Nothing is said of a model that is not known, and of specimens that differ that they do."""
    model = ph.population_model(ph.NeoHookean(), TRAINING["soft"], noise_sd=0.4)
    with unheard():
        tree = ph.sample_smc(model, **QUICK)
    page = write_words({"Population": tree})
    assert_sound(page)
    assert "Each specimen had parameters of its own" in page.methods
    assert "shared one set" not in page.text
    assert "log_reference_strain[A2]" in page.column("Posterior", "parameter")
    with pm.Model() as model:
        x = pm.Normal("x", 0, 1)
        pm.Normal("y", x, 1, observed=[1.0, 2.0])
    with unheard():
        tree = ph.sample_smc(model, **QUICK)
    page = write_words({"My own": tree})
    assert_sound(page)
    assert page.methods.startswith("The result does not say which model it is of. Posteriors were")
    assert "cannot be shown" not in page.text


def test_noise_that_is_too_small(write_words):
    """A specimen whose best curve misses its data by more than the noise is named."""
    with unheard():
        classes = fit(training={"soft": TRAINING["soft"]}, draws=100, sigma=0.05)
    specimens = classes["soft"]["specimens"]
    page = write_words(classes)
    for name, misfit in zip(specimens["specimen"].values, specimens["misfit"].values, strict=True):
        assert f"the best curve of specimen {name} is further from its data" in page.warnings
        assert f"squared misfit {misfit:.4g} with" in page.warnings


def test_one_class(write):
    """Of one class there is nothing to choose from, and the page is whole."""
    classes = fit(training={"soft": TRAINING["soft"]}, draws=100)
    page = write([classes, classify(NEW, classes, none_below=0.05)])
    assert_sound(page)
    assert "cannot be shown" not in page.text
    assert "were held against the class soft by marginal likelihood" in page.methods
    assert "equally probable" not in page.methods
    assert "looks like none of the classes: N2" in page.warnings
