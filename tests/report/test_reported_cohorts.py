"""Cohorts, however large, are reported as they were found."""

import numpy as np
import pytest
from pages import assert_sound
from stored import classified

import pymc_hyperelastic as ph


@pytest.fixture(scope="module")
def cohort(tmp_path_factory):
    data = ph.load_dataset("simulated_sheep_aorta")
    store = tmp_path_factory.mktemp("cohort") / "store"
    settings = {"noise_sd": 0.4, "slope_weight": 0.0, "random_seed": 1, "cores": 1, "draws": 100}
    properties = {"pressure": [80, 120], "pressure_unit": "mmHg"}
    ph.fit_cohort(ph.Ogden(), data, store, properties=properties, progressbar=False, **settings)
    return ph.open_cohort(store).load()


def test_fitted_cohort_is_told_over_its_specimens(write, cohort):
    """How many were sampled, and medians over the specimens with what lies around them."""
    page = write({"Cohort": cohort})
    assert_sound(page)
    _, rows = page.table("How specimens were sampled: Cohort")
    assert rows[0] == ["not sampled", 0.0]
    assert sum(row[1] for row in rows[1:]) == 5
    _, rows = page.table("Posterior medians of the parameters")
    each = cohort["posterior"]["mu"].median(["chain", "draw"]).values
    assert [row[0] for row in rows] == ["mu", "alpha"]
    np.testing.assert_allclose(rows[0][1:4], np.quantile(each, [0.025, 0.5, 0.975]))
    _, rows = page.table("Elastic properties (posterior medians)")
    compliance = cohort["properties"]["compliance"].sel(interval="50 %").values
    shown = [row[4] for row in rows if row[0] == "compliance"]
    np.testing.assert_allclose(shown, np.median(compliance, axis=0))
    assert "The posteriors of 5 specimens were sampled, each by itself." in page.methods


def test_what_failed_of_a_cohort_is_named_with_its_message(write_words, cohort):
    """Those that failed, of whom nothing is counted, and those that are not to be trusted."""
    broken = cohort.copy(deep=True)
    evidence = broken["evidence"]
    evidence["error"].values[:2] = "the wall has no strength"
    for name in ("log_evidence", "log_evidence_se", "pareto_k"):
        evidence[name].values[:2] = np.nan
    evidence["pareto_k"].values[3] = 0.9
    evidence["log_evidence_se"].values[4] = np.inf
    for name in ("mu", "alpha"):
        broken["posterior"][name].loc[{"specimen": ["S1", "S2"]}] = np.nan
    page = write_words({"Cohort": broken})
    assert "Cohort: S1 and S2: the wall has no strength." in page.warnings
    assert "a few weights decide a posterior (Pareto shape from 0.5 on): S4." in page.warnings
    assert "an evidence has an infinite error: S5." in page.warnings
    _, rows = page.table("How specimens were sampled: Cohort")
    assert rows[0] == ["not sampled", 2.0]
    _, rows = page.table("Posterior medians of the parameters")
    own = cohort["posterior"]["mu"].sel(specimen=["S3", "S4", "S5"]).median(["chain", "draw"])
    np.testing.assert_allclose(rows[0][2], np.median(own))
    assert "3 specimens were sampled, each by itself; 2 others could not be." in page.methods


def test_cohort_of_which_all_failed(write_words, cohort):
    """Messages and counts are left, and no table is empty."""
    nothing = cohort.copy(deep=True)
    nothing["evidence"]["error"].values[:] = "no"
    nothing["posterior"] = nothing["posterior"].to_dataset().map(lambda v: v.where(False))
    del nothing["properties"]
    page = write_words({"Cohort": nothing})
    assert_sound(page)
    assert "Cohort: S1, S2, S3, S4 and S5: no." in page.warnings
    assert not any("medians" in caption for caption in page.tables)


def many(clear, unclear, failed):
    """So many specimens of which the class is clear, is not, and could not be found."""
    probability = [(0.999, 0.001)] * clear + [(0.6, 0.4)] * unclear + [(np.nan, np.nan)] * failed
    names = [f"N{i}" for i in range(len(probability))]
    found = classified(names, probability)
    sane = np.arange(len(names)) < clear + unclear
    decision = np.where(sane, found["decision"].values, "")
    errors = np.where(sane, "", "no convergence.")
    return found.assign(decision=("specimen", decision), error=("specimen", errors))


def test_of_very_many_specimens_the_unclear_are_shown(write):
    """Decisions are counted; nobody is shown alone of whom all is clear, and nobody is lost."""
    page = write({"New": many(300, 20, 3)})
    assert_sound(page)
    assert page.table("Decisions: New")[1] == [["not classified", 3, 0], ["C1", 320, 300]]
    assert "Of 323 specimens 300 have a class with a probability from 0.95 on." in page.text
    assert "Of the other 23, the 23 whose class is least clear are shown" in page.text
    names = {row[0] for row in page.table("Decisions and probabilities")[1]}
    assert names == {f"N{i}" for i in range(300, 323)}
    assert "New: N320, N321 and N322: no convergence." in page.warnings
    assert "New: the classes have no variability" in page.warnings
    assert sum(tag == "svg" for tag, _ in page.elements) == 1


def test_tables_of_very_many_have_an_end(write_words):
    """At most 200 are shown alone, or none where there is nothing to be seen."""
    page = write_words({"New": many(10, 500, 0)})
    assert "Of the other 500, the 200 whose class is least clear are shown" in page.text
    page = write_words({"New": many(400, 0, 0)})
    assert_sound(page)
    assert not [c for c in page.tables if c.startswith("Decisions and probabilities")]


def test_failures_of_many_kinds_are_not_a_page_of_warnings(write_words):
    """The first ten messages are told, and how many failed for other reasons."""
    found = many(0, 2, 15)
    errors = ["", "", *(f"reason {i:02}" for i in range(15))]
    page = write_words({"New": found.assign(error=("specimen", errors))})
    assert "N11: reason 09." in page.warnings and "reason 10" not in page.warnings
    assert "N12, N13, N14, N15 and N16 failed for other reasons." in page.warnings
    assert "interrupt" not in page.warnings
