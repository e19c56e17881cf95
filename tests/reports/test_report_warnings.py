"""Warnings and checks at the top of a report."""

import json

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from stored_results import DATA, classified, fitted_class, fitted_classes

import pymc_hyperelastic as ph
from pymc_hyperelastic.io.checksum import digests_of

MEASURED = ph.load_dataset("murine_pulmonary_artery")
NOTHING = "No problem was found."


def test_report_without_warnings_states_the_checks_that_were_made(write_words):
    page = write_words({"Artery": fitted_class(ph.select(MEASURED, group="control"))})
    assert NOTHING in page.warnings
    assert "Caution" not in page.warnings and "Not to be trusted" not in page.warnings
    assert "the report checks the evidence of each class" in page.warnings
    assert "The checks found no problem. The least certain elastic property is" in page.summary


def test_missing_check_of_the_fit_is_reported_as_not_made(write_words):
    tree = fitted_class(ph.select(MEASURED, group="control"))
    tree["diagnosis"] = tree["diagnosis"].to_dataset().sel(check=["chains"])
    page = write_words({"Artery": tree})
    assert NOTHING not in page.warnings and "by the checks that were possible" in page.warnings
    assert "cannot test whether the curves fit the data" in page.warnings
    assert "The checks that were possible found no problem." in page.summary


@pytest.mark.parametrize(
    ("verdict", "level"), [("doubtful", "Caution."), ("not to be trusted", "Not to be trusted.")]
)
def test_bad_verdict_of_an_evidence_is_a_warning(write_words, verdict, level):
    tree, words = fitted_class(MEASURED), "chains are 9 nats apart"
    diagnosis = tree["diagnosis"].to_dataset().assign_attrs(verdict=verdict, words=words)
    tree["diagnosis"] = diagnosis.assign(verdict=("check", [verdict, "good"]))
    page = write_words({"Artery": tree})
    assert f"{level} Artery: the evidence is {verdict}: {words}." in page.warnings
    assert f"Artery: the evidence is {verdict}: {words}" in page.summary
    assert page.column("Evidence", "verdict") == [verdict]
    if verdict == "not to be trusted":
        assert page.column("Evidence", "log evidence (nats)")[0][1] == np.inf


def test_warning_of_a_doubtful_fit_differs_from_a_doubtful_evidence(write_words):
    tree, words = fitted_class(MEASURED), "the best curve is far from the data"
    diagnosis = tree["diagnosis"].to_dataset().assign_attrs(verdict="doubtful", words=words)
    tree["diagnosis"] = diagnosis.assign(verdict=("check", ["good", "doubtful"]))
    page = write_words({"Artery": tree})
    assert f"Caution. Artery: the fit is doubtful: {words}." in page.warnings
    assert NOTHING not in page.warnings


def test_large_rhat_is_a_warning(write_words):
    page = write_words({"Artery": fitted_class(MEASURED, shift=20.0)})
    assert (
        "Caution. Artery: the chains have met different parts of the posterior: R-hat of"
        in page.warnings
    )
    assert "there is only one chain" in write_words(fitted_class(MEASURED, chains=1)).warnings


def test_result_without_evidence_is_reported_with_its_divergences(write_words):
    """Draws of another sampler have no verdict, which is said; transitions that diverge are."""
    tree = fitted_class(MEASURED).filter(
        lambda node: node.name in ("posterior", "observed_data", "constant_data")
    )
    diverging = np.arange(200).reshape(2, 100) < 50
    tree["sample_stats"] = xr.Dataset({"diverging": (("chain", "draw"), diverging)})
    page = write_words({"NUTS": tree})
    assert "NUTS: the result holds no evidence, and no diagnosis of it." in page.warnings
    assert "50 of 200 transitions diverged" in page.warnings
    assert not any(caption.startswith("Evidence") for caption in page.tables)
    assert "sequential Monte Carlo" not in page.methods


def test_decisions_made_with_other_classes_are_marked(write_words):
    """As after a fit with other settings; of two laws both must be those of the decisions."""
    classes, refitted = fitted_classes(), fitted_classes(shift=1.0)
    other_law = fitted_classes(energy="NeoHookean")
    said = "Not to be trusted. New: the decisions were made with other classes than {} on this page"
    for made_with, shown, marked in (
        ([classes], {"Classes": classes}, ""),
        ([classes], {"Classes": refitted}, "Classes"),
        ([classes, other_law], {"One": refitted, "Two": other_law}, "One and Two"),
    ):
        identity = json.dumps([digests_of(tree.children) for tree in made_with])
        page = write_words({**shown, "New": classified().assign_attrs(classes=identity)})
        assert (said.format(marked) in page.warnings) == bool(marked)
        assert ("other classes" in page.text) == bool(marked)


def test_each_warning_about_decisions_names_its_specimens(write_words):
    result = classified(
        list("ABCDE"),
        [[0.5, 0.5], [0.9, 0.1], [np.nan, np.nan], [0.6, 0.4], [0.8, 0.2]],
        decision=np.array(["cannot be judged", "none of these", "", "undecided", "C1"]),
        class_probability_se=np.repeat([[np.inf], [0.1], [np.nan], [0.1], [0.1]], 2, axis=1),
        pareto_k=np.array([[0.1] * 2, [0.1] * 2, [np.nan] * 2, [0.49] * 2, [0.1, 0.5]]),
        p_value=np.array([[0.5] * 2, [0.01, 0.049], [np.nan] * 2, [0.5] * 2, [0.05, 0.01]]),
    ).assign(class_verdict=("class_label", ["good", "doubtful"]))
    page = write_words({"New": result})
    for said in (
        "Not to be trusted. New: cannot be judged: A.",
        "Not to be trusted. New: the error of a probability or evidence is infinite: A.",
        "Caution. New: looks like none of the classes: B.",
        "Caution. New: atypical of all classes (p-values below 0.05): B.",
        "Caution. New: not classified, for example after an interrupt: C.",
        "Caution. New: undecided: D.",
        "Caution. New: a few weights dominate an evidence (Pareto shape of 0.5 or more): E.",
        "Caution. New: the fit of class C2 is doubtful.",
    ):
        assert said in page.warnings
    assert page.warnings.index("Caution") > page.warnings.rindex("Not to be trusted")
    assert page.column("Decisions", "decision")[2] == "not classified"
    assert page.column("Decisions", "probability of C1")[0] == (0.5, np.inf)


def test_pooled_specimens_give_a_warning(write_words):
    assert "all specimens of a class share one set" in write_words(fitted_classes()).warnings
    warnings = write_words([fitted_class(ph.select(DATA, specimen="S1")), DATA]).warnings
    assert "all specimens of a class share one set" not in warnings
    assert warnings.count("these data are simulated, not measured") == 1


def test_a_fit_to_several_phases_gives_a_warning_and_each_phase_counts_as_a_test(write_words):
    curve = ph.select(DATA, specimen="S1", experiment=1).to_dataframe().reset_index(drop=True)
    phases = [curve.assign(phase=phase) for phase in ("loading", "unloading")]
    page = write_words(fitted_class(ph.inflation_data(pd.concat(phases), ph.Tube(7.0, 9.0))))
    assert "specimen 'S1' has the phases 'loading', 'unloading'" in page.warnings
    assert "2 tests with 40 points on 1 specimen" in page.summary
    assert "2 tests with 40 points" in page.methods


def test_unknown_law_and_invalid_data_give_warnings(write_words):
    tree = fitted_class(MEASURED)
    tree.attrs = {"strain_energy": "OfAnotherDay"}
    data = DATA.assign(pressure=DATA["pressure"].where(DATA["pressure"] > 2.0))
    page = write_words({"Artery": tree, "Data": data})
    assert "OfAnotherDay" in page.warnings and "Run or import its class first" in page.warnings
    # The model was fitted, but nothing can be computed from it.
    assert "no elastic property, no difference" in page.text and "No model" not in page.text
    assert "pressure is nan kPa; expected a finite number" in page.warnings


def test_missing_classes_and_doubtful_specimens_give_warnings(write_words):
    """Warnings that a result carries are warnings of its report."""
    tree = fitted_classes()
    tree.attrs["missing_classes"] = json.dumps({"C3": "the sampler was interrupted"})
    doubtful = np.array(["", "the pressure is extrapolated"])
    page = write_words({"Classes": tree, "New": classified(doubtful=doubtful)})
    assert (
        "Not to be trusted. Classes: class C3 is missing: the sampler was interrupted."
        in page.warnings
    )
    assert "Caution. New: S2: the pressure is extrapolated." in page.warnings
