"""Reports of cohorts, small and large."""

import numpy as np
import pytest
import xarray as xr
from stored_results import DATA, classified

import pymc_hyperelastic as ph

NAMES = ["S1", "S2", "S3", "S4", "S5"]


@pytest.fixture
def cohort():
    """Return a cohort of five specimens as ph.fit_cohort gives it, without sampling."""
    rng = np.random.default_rng(20261127)
    evidence = {"error": np.array([""] * 5, dtype="<U40"), "log_evidence": np.full(5, -20.0)}
    evidence |= {"log_evidence_se": np.full(5, 0.1), "pareto_k": np.full(5, 0.2)}
    evidence["method"] = np.array(["importance"] * 4 + ["smc"])
    specimen, dims = {"specimen": NAMES}, ("specimen", "chain", "draw")
    compliance = rng.random((5, 2, 3)).cumsum(axis=2), {"units": "mm2/kPa"}
    dims_of_properties = ("specimen", "pressure", "interval")
    properties = {"compliance": (dims_of_properties, *compliance)}
    properties["peterson_modulus"] = (dims_of_properties, compliance[0], {"units": "kPa"})
    return xr.DataTree.from_dict(
        {
            "posterior": xr.Dataset({"mu": (dims, rng.lognormal(size=(5, 1, 40)))}, specimen),
            "evidence": xr.Dataset({k: ("specimen", v) for k, v in evidence.items()}, specimen),
            "properties": xr.Dataset(properties, {"pressure": [80, 120]}),
        }
    )


def test_cohort_tables_summarise_its_specimens(write_words, cohort):
    page = write_words({"Cohort": cohort})
    _, rows = page.table("Sampling methods of the specimens: Cohort")
    assert rows == [["importance", 4], ["smc", 1]]
    _, (row,) = page.table("Posterior medians of the parameters")
    draws, ends = cohort["posterior"]["mu"], [0.025, 0.5, 0.975]
    medians, sd = (f(["chain", "draw"]).values for f in (draws.median, draws.std))
    np.testing.assert_allclose(row[1:], [*np.quantile(medians, ends), np.median(sd)])
    assert "The law was fitted to 5 specimens, one by one." in page.summary
    _, (_, row, other, _) = page.table("Posterior medians of the elastic properties")
    assert other[:2] == ["Peterson's modulus", "kPa"]
    assert row[:3] == ["compliance", "mm²/kPa", 120]
    low, middle, high = cohort["properties"]["compliance"].values[:, 1].T
    np.testing.assert_allclose(row[3:], [*np.quantile(middle, ends), np.median(high - low)])
    assert "The posteriors of 5 specimens were sampled one by one." in page.methods
    cohort.attrs = {"law": "Ogden", "simulated": 1}
    page = write_words({"Cohort": cohort})
    assert "Ogden was fitted to 5 specimens, one by one." in page.summary
    assert "these data are simulated, not measured" in page.warnings


def test_failed_specimens_of_a_cohort_are_named_with_their_messages(write_words, cohort):
    own = cohort["posterior"]["mu"].median(["chain", "draw"]).values[2:]
    evidence = cohort["evidence"]
    evidence["error"].values[:2] = "the wall has no strength"
    evidence["pareto_k"].values[2:4] = 0.49, 0.5
    evidence["log_evidence_se"].values[4] = np.inf
    cohort["posterior"]["mu"].values[:2] = np.nan
    page = write_words({"Cohort": cohort})
    assert "Cohort: S1 and S2: the wall has no strength." in page.warnings
    assert "a few weights dominate a posterior (Pareto shape of 0.5 or more): S4." in page.warnings
    assert "the error of an evidence is infinite: S5." in page.warnings
    _, rows = page.table("Posterior medians of the parameters")
    np.testing.assert_allclose(rows[0][2], np.median(own))
    assert "3 specimens were sampled one by one; 2 others could not be sampled." in page.methods


@pytest.mark.deep
def test_report_of_a_fitted_cohort_shows_parameters_and_properties(write, tmp_path):
    settings = {"random_seed": 1, "draws": 100, "store": ph.Store(tmp_path / "s", cores=1)}
    at = ph.Conditions([80, 120], pressure_unit="mmHg")
    fitted = ph.fit_cohort(ph.Ogden(), DATA, 0.4, at=at, **settings)
    page = write({"Cohort": fitted.load()})
    assert page.column("Posterior medians of the parameters", "parameter") == ["mu", "alpha"]
    assert "compliance" in page.column("Posterior medians of the elastic", "property")
    assert "cannot be shown" not in page.text


def many(clear, unclear, failed, why=("no convergence.",)):
    """Return a classification with given numbers of clear, unclear and failed specimens."""
    probability = [(0.95, 0.05)] * clear + [(0.94, 0.06)] * unclear + [(np.nan, np.nan)] * failed
    decision = ["C1"] * (clear + unclear) + [""] * failed
    error = [""] * (clear + unclear) + [*np.resize(why, failed)]
    names = [f"N{i}" for i in range(len(probability))]
    return classified(names, probability, decision=np.array(decision), error=np.array(error))


def test_only_unclear_specimens_of_a_large_cohort_are_shown_one_by_one(write_words):
    page = write_words({"New": many(300, 20, 3)})
    assert page.table("Decisions: New")[1] == [["C1", 320, 300], ["not classified", 3, 0]]
    assert (
        "A class is clear if its probability is at least 0.95: that of 300 of 323 specimens."
        in page.text
    )
    assert "Shown below: 23 of 23 without a clear class, those with the lowest" in page.text
    names = set(page.column("Decisions and probabilities", "specimen"))
    assert names == {f"N{i}" for i in range(300, 323)}
    assert "New: N320, N321 and N322: no convergence." in page.warnings
    assert "New: the classes have no variability" in page.warnings
    page = write_words({"New": many(10, 500, 0)})
    assert "Shown below: 200 of 500 without a clear class, those with the lowest" in page.text


def test_only_the_first_twenty_failure_messages_are_shown(write_words):
    page = write_words({"New": many(0, 2, 25, [f"reason {i:02}" for i in range(25)])})
    assert "N21: reason 19." in page.warnings and "reason 20" not in page.warnings
    assert "N22, N23, N24, N25 and N26: other messages in the variable error." in page.warnings
