"""Reports of studies that hold results of every kind."""

import fits
import numpy as np
import pymc as pm
import pytest
import xarray as xr
from report_pages import Page, assert_sound
from shared_errors import extended
from stored_results import classified, fitted_class, fitted_classes
from variable_classes import TRAINING, classify, curves

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.hierarchical import HierarchicalClass
from pymc_hyperelastic.reports.settings import priors_of_class

QUICK = {"draws": 100, "chains": 2, "random_seed": 1, "progressbar": False}
NEW = curves({"N1": [60.0], "N2": [300.0]}, 5)
# One pressure, at which elastic properties are shown, is quicker than the default three.
AT = {"at": [2.0]}


def left_out():
    """Return a stored result of ph.cross_validate."""
    of_specimens = {"true_class": ["soft", "stiff", "stiff"], "left_out": ["A", "B", "B"]}
    probability = [[[0.9, 0.1], [0.2, 0.8], [np.nan, np.nan]]]
    of_law = ("strain_energy", "specimen")
    return xr.Dataset(
        {
            "class_probability": ((*of_law, "class_label"), probability),
            "verdict": (of_law, [["good", "not to be trusted", ""]]),
            "log_score": (of_law, np.log([[0.9, 0.8, np.nan]])),
            "brier_score": (of_law, [[0.02, 0.08, np.nan]]),
        },
        {"strain_energy": ["NeoHookean"], "specimen": ["A1", "B1", "B2"]}
        | {"class_label": ["soft", "stiff"]}
        | {name: ("specimen", values) for name, values in of_specimens.items()},
    )


def few_draws():
    """Return the stored classes with a fifth of their draws, whose properties are quick."""
    classes = fits.fit("neo_hookean_classes").isel(draw=slice(100))
    return classes


@pytest.fixture(scope="module")
def results():
    """Return all results of a study: classes, classification, comparisons, cross-validation."""
    variable, few = few_draws(), {"draws": 100, "random_seed": 1}
    at = {"at": [1.0, 4.0], "effect_prior": None}
    lacking = pytest.warns(UserWarning, match="have no compliance there")
    with pytest.warns(UserWarning, match="extrapolated"), lacking:
        compliance = ph.compare_classes(variable, "compliance", **at, **few)
    compared = ph.compare_classes(variable, "mu", **few)
    results = {"Classes": variable, "New": classify(NEW, variable), "Left out": left_out()}
    return results | {"Compared": compared, "Curves": compliance}


@pytest.fixture(scope="module")
def page(results, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    return Page(ph.report(results, path, data=NEW, **AT))


def test_report_of_a_study_has_all_chapters(page):
    assert_sound(page)
    assert page.chapters[3:-4] == [
        "Data",
        "Fit of the model to the data",
        "Parameters",
        "Elastic properties",
        "Differences between groups",
        "Decisions on specimens",
    ]
    assert "cannot be shown" not in page.text
    assert len(page.figures) == 9
    assert "Left out: the score with NeoHookean is unknown: B2." in page.warnings
    warned = "the fit of NeoHookean without it, or its own evidence, is not to be trusted: B1."
    assert f"Left out: {warned}" in page.warnings
    assert "compliance is compared at a pressure that was not measured in every" in page.warnings
    headings, rows = page.table("Specimens that were left out")
    assert headings[1] == "true group"  # the law is the same in all rows
    assert rows[1][1:6] == ["stiff", 0.2, 0.8, np.log(0.8), 0.08]
    assert "the classes have no variability" not in page.warnings
    assert page.methods.strip().startswith("The inflation curves of 6 specimens")
    for words in (
        "inflation curves of 6 specimens (3 in soft and 3 in stiff) were analysed",
        "The curves of 2 specimens were compared with the classes soft and stiff",
        "each of 3 specimens, in 2 groups that belong together, was left out",
        "Bayes factors compare different distributions",
        "compliance at pressures from 1 to 4 kPa",
    ):
        assert words in page.methods


def test_fit_tables_equal_the_results_of_specimens_and_classes(page, results):
    variable = results["Classes"]
    headings, rows = page.table("Parameters: Classes")
    spread = variable["soft"]["posterior"]["spread"].values[..., 0]
    assert rows[2][0] == "spread[log_reference_strain]"
    assert rows[2][1].startswith("standard deviation between specimens of the log of the strain")
    expected = np.quantile(spread, [0.5, 0.025, 0.975])
    np.testing.assert_allclose(rows[2][headings.index("class soft")], expected)
    assert "The parameters of the material are those of the typical specimen" in page.text
    assert set(page.column("Elastic properties", "pressure (kPa)")) == {2.0}
    for table, names in {
        "Best curve of each specimen": ["misfit", "freedom"],
        "Integral over the parameters of each specimen": ["pareto_k", "standard_error"],
    }.items():
        _, rows = page.table(table)
        assert [row[:2] for row in rows[:3]] == [["A1", "soft"], ["A2", "soft"], ["A3", "soft"]]
        for place, name in enumerate(names, start=2):
            values = [t["specimens"][name].values for t in variable.children.values()]
            np.testing.assert_array_equal([row[place] for row in rows], np.concatenate(values))


def test_a_single_difference_needs_no_correction_for_multiple_comparisons(page, results):
    assert results["Compared"].attrs["compared"] == 1
    assert "multiple comparisons" not in page.warnings
    low, high = results["Compared"]["difference_interval"].sel(statistic="typical").values.ravel()
    assert low * high > 0 and "its 95 % interval excludes 0. The probability that" in page.text


def test_difference_table_equals_compare_classes(page, results):
    result = results["Compared"].sel(quantity="mu").isel(comparison=0)
    headings, (row,) = page.table("Differences of the typical specimens: Compared")
    typical = result.sel(statistic="typical")
    for name, heading in {"difference": "difference", "effect_size": "effect size"}.items():
        numbers = (float(typical[name]), *typical[f"{name}_interval"].values.tolist())
        assert row[headings.index(f"{heading} (95 % interval)")] == numbers
    assert row[headings.index("probability of a rise")] == float(typical["probability_of_rise"])
    assert row[headings.index("best accuracy")] == float(result["best_accuracy"])
    _, (row,) = page.table("Bayes factors of different")
    factor = (float(result["log_bayes_factor"]), float(result["log_bayes_factor_se"]))
    assert row[1:] == [factor, float(result["probability_of_difference"])]
    headings, rows = page.table("Values of the groups: Compared")
    of_one = result.sel(group="stiff", statistic="mean")
    (row,) = [r for r in rows if r[1] == "mean"]
    numbers = (float(of_one["value"]), *of_one["value_interval"].values.tolist())
    assert row[headings.index("group stiff")] == numbers
    assert page.column("Differences of the typical specimens: Curves", "pressure") == [1, 4]


# The random numbers decide if a soft specimen is simulated.
@pytest.mark.filterwarnings("ignore:design .* of the specimens cannot bear it")
def test_planned_tests_are_ranked_by_information(write, write_words):
    planned = {"point": {"pressure": 0.5, "points": 1}, "curve": {"pressure": (1, 6)}}
    settings = {"specimens": 20, "draws": 64, "stop_below": 0.1, "random_seed": 1}
    designs = ph.expected_information(fits.fit("neo_hookean_classes"), planned, **settings)
    near = designs.assign(difference_se=("design", [0.0, 10.0]), lacking=("design", [0.0, 0.07]))
    page = write({"Tests": near})
    assert "cannot be shown" not in page.text
    assert page.chapters[3:-3] == ["What to measure next"]
    _, rows = page.table("Expected information of planned tests about the class")
    assert [row[0] for row in rows] == ["curve", "point"]
    names = ("information", "difference", "change_by_half")
    expected = [np.stack([near[name], near[f"{name}_se"]], axis=-1) for name in names]
    np.testing.assert_array_equal([row[2:] for row in rows], np.stack(expected, axis=1))
    assert f"Tests: {designs.attrs['words']}." in page.warnings
    assert "Tests: point may be as good as curve: the difference is within" in page.warnings
    assert "Tests, point: 7.0% of the specimens cannot be tested in this way" in page.warnings
    far = designs.assign(difference=("design", [0.0, -1.0]), difference_se=("design", [0.0, 0.49]))
    assert "may be as good as curve" not in write_words(far).warnings


def test_table_of_planned_studies_equals_plan_study(write_words):
    settings = {"studies": 20, "draws": 50, "random_seed": 1}
    plan = ph.plan_study(fits.fit("neo_hookean_classes"), ["mu", "log mu"], (4, 12), **settings)
    page = write_words({"Plan": plan})
    _, rows = page.table("Expected results for differences: Plan")
    assert [row[0] for row in rows] == ["mu", "mu", "log mu", "log mu"]
    assert page.column("Expected results", "specimens") == [4, 12] * 2
    own = plan.isel(comparison=0).transpose("quantity", "specimens", ...)
    for name, place in (
        ("width", 0),
        ("width_se", 1),
        ("decided", 0),
        ("wrong", 0),
        ("covered_se", 1),
    ):
        cells = page.column("Expected results", name.removesuffix("_se"))
        np.testing.assert_array_equal([cell[place] for cell in cells], own[name].values.ravel())
    _, rows = page.table("Expected classification of new specimens: Plan")
    np.testing.assert_array_equal([row[1][0] for row in rows], plan["log_score"])
    assert "20 simulated studies" in page.warnings
    assert "simulated studies of 4 and 12 specimens per group" in page.methods


def test_report_counts_extension_tests_and_says_if_forces_were_used(write):
    data = extended()
    data["pressure"] *= 0.1
    page = write({"Model": fitted_class(data, "NeoHookean", 20)}, **AT)
    assert "cannot be shown" not in page.text
    assert {"Fit of the pressure: Model", "Fit of the radius in extension tests: Model"} <= {
        *page.figures
    }
    assert "Fit of the axial force: Model" not in page.figures  # the likelihood has none
    outer = data.assign(outer_diameter=2 * data["radius"] + 1.0)
    page = write({"Model": fitted_class(outer, "NeoHookean", 20)}, **AT)
    assert "Fit of the outer diameter in extension tests: Model" in page.figures
    page = write({"Model": fitted_class(data, "NeoHookean", 20)}, **AT)
    assert "1 specimen, 5 tests (including 2 extension tests), 19 points" in page.text
    assert "inflation and extension curves of 1 specimen" in page.methods
    left_out = "Axial forces were measured too. The likelihood does not include them."
    assert left_out in page.methods and "were not used in the fit" in page.text
    fitted = ph.Gaussian(pressure_sd=0.5, force_sd=1.0)
    page = write({"Model": fitted_class(data, "NeoHookean", 20, likelihood=fitted)}, **AT)
    assert "Axial forces were measured too." in page.methods and left_out not in page.methods
    assert "Fit of the axial force: Model" in page.figures
    assert "Fit of the axial force in extension tests: Model" in page.figures
    slopes = ph.SlopeAugmented(sigma=0.5, force_sigma=1.0, slope_weight=0.0)
    page = write({"Model": fitted_class(data, "NeoHookean", 20, likelihood=slopes)}, **AT)
    assert left_out not in page.methods and "were not used in the fit" not in page.text


def test_report_lists_the_laws_of_an_average_and_describes_data_once(write_words):
    laws = ("NeoHookean", "Demiray")
    fitted = [fitted_classes(energy=law, draws=20) for law in laws]
    expected = [["NeoHookean", (0.25, 0.05), (-30.0, 0.1)], ["Demiray", (0.75, 0.06), (-3.0, 0.2)]]
    result = classified().assign_coords(strain_energy=list(laws))
    for name, place in (("probability", 1), ("log_evidence", 2)):
        values, errors = zip(*(row[place] for row in expected), strict=True)
        result[f"strain_energy_{name}"] = "strain_energy", list(values)
        result[f"strain_energy_{name}_se"] = "strain_energy", list(errors)
    page = write_words([*fitted, result], **AT)
    assert page.table("Strain energies in the average")[1] == expected
    assert "averaged over the strain energies NeoHookean and Demiray" in page.methods
    assert page.column("Probability of each law", "law") == list(laws)
    assert "explains the data best, of the laws NeoHookean and Demiray: " in page.summary
    # The data of both fits are described once.
    assert page.methods.count("10 tests with 200 points") == 1
    _, second = page.methods.split("Each vessel was also modelled as")
    assert "tube with the strain energy Demiray, W" in second


def test_explanation_table_equals_the_parts_of_the_log_ratio(write_words):
    parts = np.array([[[1.0, 0.5], [-1.0, -0.5]], [[-2.0, 0.25], [2.0, -0.25]]])
    of_class = ("specimen", "class_label")
    explained = xr.Dataset(
        {
            "rival": (of_class, [["stiff", "soft"]] * 2),
            "log_ratio_part": ((*of_class, "part"), parts),
        },
        {
            "specimen": ["N1", "N2"],
            "class_label": ["soft", "stiff"],
            "part": ["material", "noise"],
        },
    )
    headings, rows = write_words({"Why": explained}).table("Support for each class, in nats: Why")
    assert headings == ["specimen", "class", "compared with", "material", "noise"]
    assert rows[2] == ["N2", "soft", "stiff", -2.0, 0.25]


def test_settings_list_the_priors_of_hierarchical_classes():
    noise, priors = pm.LogNormal.dist(0.0, 1.0), {"effect_spread": pm.LogNormal.dist(-1.0, 0.25)}
    variability = ph.Variability(experiment_effect=True)
    kind = HierarchicalClass.of_settings(ph.Ogden(), noise, priors, variability)
    found = priors_of_class(kind)
    assert found["location[log_alpha]"] == "Normal(1.897, 1.2)"
    assert found["effect_spread"] == "LogNormal(−1, 0.25)"
    assert found["pressure_sd"] == "LogNormal(0, 1) kPa"
    assert found["noise_spread"] == "LogNormal(−1.204, 0.5)"
    assert found["the correlations"].startswith("LKJ(2)")
    assert "experiment_spread[log_reference_strain]" in found


def test_specimens_with_a_large_pareto_shape_are_named(write_words):
    classes = fits.fit("neo_hookean_classes").filter(lambda node: "stiff" not in node.path)
    specimens = classes["soft"]["specimens"]
    specimens["pareto_k"].values[:] = 0.1, 0.49, 0.5
    warnings = write_words(classes, **AT).warnings
    assert "a few weights dominate an integral (Pareto k of 0.5 or more): A3." in warnings


@pytest.mark.deep
@pytest.mark.filterwarnings("ignore::UserWarning")  # draws are few
def test_reports_describe_layers_populations_and_own_pymc_models(write_words):
    data, noise = TRAINING["soft"], ph.Gaussian(0.4)
    layers = [ph.Layer(ph.NeoHookean(), 1.2, mu=20.0), ph.Layer(ph.Demiray(), 0.8, b=0.5)]
    layered = data.assign(outer_radius=data["outer_radius"].where(False))
    with pm.Model() as own:
        pm.Normal("y", pm.Normal("x", 0, 1), 1, observed=[1.0, 2.0])
    models = [
        ph.inflation_model(layers, layered, noise),
        ph.population_model(ph.NeoHookean(), data, noise),
        own,
    ]
    pages = [write_words(ph.sample_smc(model, **QUICK)) for model in models]
    of_layers, of_population, of_own = pages
    assert not any("cannot be shown" in page.text for page in pages)
    assert "strain energy of layer 2, from inside" in of_layers.column("Settings", "setting")
    assert (
        "of 2 layers with, from the inside out, the strain energy NeoHookean" in of_layers.methods
    )
    assert "mu_2" in of_layers.column("Parameters", "parameter")
    assert "Each specimen had parameters of its own" in of_population.methods
    assert "log_reference_strain[A2]" in of_population.column("Parameters", "parameter")
    assert "The result does not say which model was fitted." in of_own.methods
