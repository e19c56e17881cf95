"""Reports of sheets alone, and of sheets and tubes together."""

import numpy as np
import pytest
import xarray as xr
from report_pages import Page
from sheet_tables import by_hand, joint_by_hand
from tube_posteriors import result

import pymc_hyperelastic as ph


def fitted(data: xr.Dataset, **errors: float) -> xr.DataTree:
    """Return a result of `sample_smc` with other draws."""
    model = ph.material_model(ph.NeoHookean(), data, ph.Gaussian(**errors))
    draws = 20 + np.random.default_rng(1).normal(size=50)
    groups = {name: xr.DataTree(each) for name, each in model.study.result_groups(model).items()}
    tree = result(mu=draws).assign(groups)
    tree.attrs = model.study.result_attrs(model)
    return tree


@pytest.fixture(scope="module")
def pages(tmp_path_factory) -> dict[str, Page]:
    """Return the pages of sheets, of sheets and tubes, and of data."""
    folder = tmp_path_factory.mktemp("reports")
    results = {
        "sheets": fitted(by_hand(), stress_sd=2.0),
        "joint": fitted(joint_by_hand(), stress_sd=2.0, pressure_sd=1.0),
        "data": by_hand(),
    }
    return {n: Page(ph.report(each, folder / f"{n}.html")) for n, each in results.items()}


def captions(page: Page) -> list[str]:
    return [caption.split(":")[0] for caption in page.tables]


def test_sheets_have_their_tests_stresses_and_fits(pages):
    page = pages["sheets"]
    text = " ".join(page.texts)
    assert not page.wrong
    assert "Tests of sheets" in captions(page)
    titles = " ".join(page.figures)
    assert "Measured stresses" in titles and "Fit of the stress of sheets" in titles
    assert "A report on the mechanics of stretched sheets" in text
    assert "measured were stretches and stresses of sheets" in text
    assert "Each sheet was modelled as a thin, incompressible, hyperelastic sheet" in text


def test_sections_on_tubes_are_left_out_for_sheets_alone(pages):
    page = pages["sheets"]
    headings = [words for _, words in page.headings]
    assert "Parameters" in headings and "Elastic properties" not in headings
    text = " ".join(page.texts)
    assert "could not" not in text and "vessel" not in text
    # The summary has a parameter in place of a property.
    assert "(mu) is 20" in text


def test_joint_results_have_sections_of_both_kinds(pages):
    page = pages["joint"]
    titles = " ".join(page.figures)
    for words in (
        "Measured curves of tubes",
        "Measured stresses of sheets",
        "Fit of the pressure",
        "Fit of the stress of sheets",
    ):
        assert words in titles
    assert "Tests of sheets" in captions(page) and "Elastic properties" in captions(page)
    text = " ".join(page.texts)
    assert "A report on the mechanics of inflated tubes and stretched sheets" in text
    assert "inflation curves and stresses of sheets" in text


def test_data_of_sheets_are_reported_without_a_result(pages):
    page = pages["data"]
    ((caption, rows),) = [(c, r) for c, r in page.tables.items() if c.startswith("Tests of sheets")]
    assert len(rows) == 3  # a heading, and two tests
    assert "group: all" in caption
