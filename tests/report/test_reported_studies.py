"""Results of sampling, of every kind together, are reported whole."""

import numpy as np
import pymc as pm
import pytest
import xarray as xr
from pages import Page, assert_sound
from variable_classes import TRAINING, classify, curves, fit

import pymc_hyperelastic as ph

QUICK = {"draws": 100, "chains": 2, "random_seed": 1, "progressbar": False}
NEW = curves({"N1": [60.0], "N2": [300.0]}, 5)


@pytest.fixture(scope="module")
def variable():
    """Classes whose specimens differ."""
    return fit(draws=100)


@pytest.fixture(scope="module")
def results(variable):
    """A whole study: classes, what was classified, left out, and compared at several pressures."""
    at = {"pressure": [5.0, 10.0, 15.0, 20.0], "bayes_factor": False, "random_seed": 1}
    return {
        "Classes": variable,
        "New": classify(NEW, variable),
        "Compared": ph.compare_classes(variable, "mu", draws=100, random_seed=1),
        "Curves": ph.compare_classes(variable, "compliance", draws=100, **at),
        "Left out": left_out(),
    }


@pytest.fixture(scope="module")
def page(results, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    return Page(ph.report(results, folder / "report.html", data=NEW))


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
    from pymc_hyperelastic.report.blocks import Found
    from pymc_hyperelastic.report.methods import fit_sentences

    said = " ".join(fit_sentences(Found("Fit", variable)))
    assert "Specimens of a class differed: the parameters of each were a draw from a normal" in said
    assert "over the coordinate log_reference_strain (reference stress 20 kPa)." in said
    assert "LogNormal(−0.9163, 0.7) for spread[log_reference_strain]" in said
    assert "parameters of each specimen were integrated by importance sampling" in said
    assert "7 experiments with 49 points" in said


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


def test_posteriors_are_of_the_typical_specimen_and_the_class(page, variable):
    """Parameters of the typical specimen stand beside location and spread of the class."""
    headings, rows = page.table("Posterior of the parameters")
    spread = variable["soft"]["posterior"]["spread"].values[..., 0]
    (row,) = [r for r in rows if r[:2] == ["spread[log_reference_strain]", "soft"]]
    assert row[headings.index("mean")] == spread.mean()
    assert [r[0] for r in rows[:3]] == [
        "mu",
        *(f"{n}[log_reference_strain]" for n in ("location", "spread")),
    ]


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
    curves = page.column("Differences of the typical specimens: Curves", "pressure (kPa)")
    assert curves[0] == 5.0 and curves[-1] == 20.0


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
        "compliance at pressures from 5 to 20 kPa",
        "each of 3 specimens, in 2 groups that belong together, was left out",
        "All was computed with pymc_hyperelastic",
    )
    places = [page.methods.index(step) for step in steps]
    assert places == sorted(places)


def sampled(energy, data, **settings):
    settings = {"noise_sd": 0.4, "slope_weight": 0.0} | settings
    model = ph.inflation_model(energy, data, **settings)
    with pytest.warns() if settings.get("warns") else _silence():
        return ph.sample_smc(model, **QUICK)


class _silence:
    """Few draws are doubtful, which is not what is tested."""

    def __enter__(self):
        import warnings

        self.caught = warnings.catch_warnings()
        self.caught.__enter__()
        warnings.simplefilter("ignore", UserWarning)

    def __exit__(self, *args):
        self.caught.__exit__(*args)


def test_sampled_model_with_unknown_noise(write):
    """A model that was sampled by itself is reported, its error among the parameters."""
    data = TRAINING["soft"]
    tree = sampled(ph.NeoHookean(), data, noise_sd=pm.HalfNormal.dist(1.0))
    page = write({"Model": tree})
    assert_sound(page)
    assert "cannot be shown" not in page.text
    headings, rows = page.table("Posterior of the parameters")
    (row,) = [row for row in rows if row[0] == "noise_sd"]
    assert row[2:4] == ["kPa", tree["posterior"]["noise_sd"].values.mean()]
    assert "inferred, with the prior HalfNormal(0, 1) kPa" in page.methods
    assert not [heading for heading, _ in zip(headings, rows[0], strict=True) if heading == ""]
