"""What speaks against results stands on top of a report; where nothing does, what was checked."""

import numpy as np
import pytest
import xarray as xr
from pages import assert_sound
from stored import DATA, classified, fitted_class, fitted_classes

import pymc_hyperelastic as ph

MEASURED = ph.load_dataset("murine_pulmonary_artery")
NOTHING = "Nothing was found that speaks against the results."


def with_diagnosis(verdict, words):
    """A class of which the diagnosis says this."""
    tree = fitted_class(MEASURED)
    diagnosis = tree["diagnosis"].to_dataset().assign_attrs(verdict=verdict, words=words)
    tree["diagnosis"] = xr.DataTree(diagnosis.assign(verdict=("check", [verdict])))
    return tree


def both(values):
    return np.array(values, float)


def test_nothing_to_warn_of(write_words):
    """A report without warnings says what was checked, and what is only to be known is a note."""
    page = write_words({"Artery": fitted_class(ph.select(MEASURED, group="control"))})
    assert NOTHING in page.warnings
    assert "Caution" not in page.warnings and "Not to be trusted" not in page.warnings
    for checked in ("whether data are simulated", "by ph.diagnose_evidence", "R-hat of each"):
        assert checked in page.warnings
    assert "simulated, and nothing was measured" not in page.warnings


def test_simulated_data_are_said_to_be(write_words):
    """Classes, results and data that were simulated are called so, once."""
    for result in (DATA, fitted_classes(), classified().assign_attrs(simulated=1, title="Mine")):
        page = write_words(result)
        assert page.warnings.count("The data are simulated, and nothing was measured") == 1


@pytest.mark.parametrize(
    ("verdict", "level"), [("doubtful", "Caution."), ("not to be trusted", "Not to be trusted.")]
)
def test_verdicts_of_evidences(write_words, verdict, level):
    """What a diagnosis says of an evidence stands on top, in its words, and in the table."""
    page = write_words({"Artery": with_diagnosis(verdict, "chains are 9 nats apart")})
    assert f"{level} Artery: the evidence is {verdict}: chains are 9 nats apart." in page.warnings
    assert NOTHING not in page.warnings
    assert page.column("Evidence", "verdict") == [verdict]
    if verdict == "not to be trusted":
        assert page.column("Evidence", "standard error") == [np.inf]
        assert "infinite" in page.text


def test_chains_that_disagree(write_words):
    """R-hat above its limit is a caution that names the parameter; one chain cannot be compared."""
    page = write_words({"Artery": fitted_class(MEASURED, shift=20.0)})
    assert "Caution. Artery: chains met different parts of the posterior: R-hat of" in page.warnings
    assert "there is one chain" in write_words(fitted_class(MEASURED, chains=1)).warnings


def test_result_without_evidence(write_words):
    """Draws of another sampler have no verdict, which is said; transitions that diverge are."""
    tree = fitted_class(MEASURED).filter(
        lambda node: node.name in ("posterior", "observed_data", "constant_data")
    )
    diverging = np.zeros((2, 100), bool)
    diverging[0, :50] = True
    tree["sample_stats"] = xr.Dataset({"diverging": (("chain", "draw"), diverging)})
    page = write_words({"NUTS": tree})
    assert "NUTS: the result holds no evidence, so that none was judged." in page.warnings
    assert "50 of 200 transitions diverged" in page.warnings
    assert "Evidence and its diagnosis" not in page.chapters
    assert "sequential Monte Carlo" not in page.methods


def test_draws_that_are_no_numbers(write_words):
    """A posterior with NaN is said to have such; the rest of the page is there."""
    tree = fitted_class(MEASURED)
    tree["posterior"]["mu"][0, 3] = np.nan
    page = write_words(tree)
    assert "some draws of the posterior are no numbers" in page.warnings
    assert "Settings" in page.chapters
    assert_sound(page)


def test_what_was_classified_with_doubt(write_words):
    """Each reason to doubt a decision names the specimens that it is about."""
    result = classified(
        list("ABCDE"),
        [[0.5, 0.5], [0.9, 0.1], [np.nan, np.nan], [0.6, 0.4], [0.8, 0.2]],
        decision=np.array(["cannot be judged", "none of these", "", "undecided", "C1"]),
        class_probability_se=both([[np.inf] * 2, [0.1] * 2, [np.nan] * 2, [0.1] * 2, [0.1] * 2]),
        pareto_k=both([[0.1] * 2, [0.1] * 2, [np.nan] * 2, [0.1] * 2, [0.1, 0.6]]),
        p_value=both([[0.5] * 2, [0.01, 0.02], [np.nan] * 2, [0.5] * 2, [0.5] * 2]),
    ).assign(class_verdict=("class_label", ["good", "doubtful"]))
    page = write_words({"New": result})
    for said in (
        "Not to be trusted. New: cannot be judged: A.",
        "Not to be trusted. New: a probability or an evidence has an infinite error: A.",
        "Caution. New: looks like none of the classes: B.",
        "Caution. New: strange to every class (all p-values below 0.05): B.",
        "Caution. New: not classified, as after an interrupt: C.",
        "Caution. New: undecided: D.",
        "Caution. New: a few weights decide an evidence (Pareto shape from 0.5 on): E.",
        "Caution. New: the fit of class C2 is doubtful.",
    ):
        assert said in page.warnings
    assert page.warnings.index("Caution") > page.warnings.rindex("Not to be trusted")
    assert page.column("Decisions", "decision")[4:6] == ["not classified"] * 2
    assert np.isnan(page.column("Decisions", "probability")[4])
    assert page.column("Decisions", "its standard error")[0] == np.inf
    assert "not known" in page.text
    assert_sound(page)


def test_classes_that_share_one_set_of_parameters(write_words):
    """Of several specimens that were pooled it is said that probabilities are too sure."""
    assert "specimens that were fitted together share" in write_words(fitted_classes()).warnings
    one = fitted_class(ph.select(DATA, specimen="S1"))
    assert "specimens that were fitted together share" not in write_words(one).warnings


def test_unsound_data_are_said_to_be(write_words):
    """Data that ph.select and others would refuse are told of, and nothing else is lost."""
    data = DATA.assign(pressure=DATA["pressure"].where(DATA["pressure"] > 2.0))
    page = write_words([data, classified()])
    assert "pressure is nan kPa; expected a finite number" in page.warnings
    assert "Classes and decisions" in page.chapters
    assert_sound(page)


def test_law_that_is_not_known_here(write_words):
    """A law of the user's own that was not imported is told of; what needs no law is there."""
    tree = fitted_class(MEASURED, strain_energy="Demiray")
    tree.attrs["strain_energy"] = "OfAnotherDay"
    page = write_words({"Artery": tree})
    assert "OfAnotherDay" in page.warnings and "run or import its class first" in page.warnings
    assert "Posterior of the parameters: Artery" in page.text
    assert_sound(page)
