"""Numbers and columns in the tables of a report."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.reports.meanings import meaning_of
from pymc_hyperelastic.reports.page import Interval, Page, frame_of, in_words


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (Estimate(-17.1834, 0.0403), "−17.183 ± 0.040"),
        (Estimate(9.96, 0.0996), "9.96 ± 0.10"),  # the error has two digits after it is rounded
        (Estimate(12345.0, 1234.0), "12300 ± 1200"),
        (Estimate(1.2341e-9, 3.21e-11), "1.234e−09 ± 3.2e−11"),
        (Estimate(2.0, np.inf), "2 ± infinite"),
        (Estimate(np.nan, 0.1), "unknown"),
        (Interval(0.35087, 0.23522, 0.555), "0.35 (0.24 to 0.56)"),
        (Interval(-0.2964, -0.8349, 0.2408), "−0.30 (−0.83 to 0.24)"),
        (Interval(0.13, 0.0011, 0.83), "0.13 (0.001 to 0.83)"),  # not 0.00
        (Interval(620.2, 406.8, 13820.0), "620 (410 to 14000)"),  # the far end by its own distance
        (Interval(3.0, 3.0, 3.0), "3 (3 to 3)"),
        (Interval(np.nan, np.nan, np.nan), "unknown"),
    ],
)
def test_numbers_have_two_digits_of_their_error(value, text):
    assert in_words(value) == text


@pytest.mark.parametrize(
    ("probability", "text"),
    [
        (Estimate(1.0, 1e-5), ">0.999"),
        (Estimate(0.5719, 0.0078), "0.5719 ± 0.0078"),
        (1e-9, "<0.001"),
    ],
)
def test_probabilities_are_never_shown_as_certain(probability, text):
    assert in_words(probability, "probability of C1") == text


def table_of(frame, **settings):
    page = Page(title="Result")
    page.table("Numbers", frame, **settings)
    (block,) = page.blocks
    return block


def test_columns_without_content_are_left_out_and_equal_texts_stand_in_the_note():
    frame = pd.DataFrame(
        {
            "specimen": ["S1", "S2"],
            "group": ["control"] * 2,
            "angle": ["not known"] * 2,
            "misfit": [np.nan] * 2,
            "tests": [1, 1],
            "unit": ["kPa"] * 2,
            "decision": ["undecided"] * 2,
            "method": ["importance", ""],
        }
    )
    block = table_of(frame, note="A note.", keep="decision")
    assert block["columns"] == ["specimen", "tests", "unit", "decision", "method"]
    assert block["note"] == "A note. In all rows, group: control."
    # One row says nothing about other rows.
    assert "group" in table_of(frame[:1])["columns"]


def test_rows_of_a_frame_belong_to_their_labels():
    """Dimensions in another order, and variables without one of them, keep their values."""
    values = xr.DataArray([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], dims=("b", "a"))
    result = xr.Dataset(
        {"x": values, "x_se": values / 10, "unit": ("a", ["kPa", "1", "mm"])},
        {"a": ["p", "q", "r"], "b": ["s", "t"]},
    )
    frame = frame_of(result, "a b x unit", "a", "b")
    assert frame["a"].tolist() == ["p", "p", "q", "q", "r", "r"]
    assert [cell.value for cell in frame["x"]] == [1.0, 4.0, 2.0, 5.0, 3.0, 6.0]
    assert frame["x"][1] == Estimate(4.0, 0.4)
    assert frame["unit"].tolist() == ["kPa", "kPa", "", "", "mm", "mm"]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("location[log_biaxial_strain]", "mean over the specimens of the log of the equibiaxial"),
        ("location[log_reference_strain]", "strain (circumferential, or along x) at a stress of"),
        ("spread[log_stress_k1_over_c]", "log of the stress due to k1 over that due to c"),
        ("experiment_spread[log_b]", "between experiments on one specimen of the log of b"),
        ("location[logit_angle]", "of the logit of angle between its limits"),
        ("|b|", "absolute value of b"),
        ("sigma", "√2 × the standard deviation of the errors of pressures"),
        ("sheet_thickness_deviation[S1]", "error of the measured sheet thickness, in standard"),
        ("thickness", "thickness of the unloaded wall"),
    ],
)
def test_unknowns_are_explained(name, words):
    assert words in meaning_of(name, [], 20.0)


def test_the_same_warning_about_several_results_is_one():
    page = Page(title="A")
    for title in ("A", "B", "A"):
        page.title = title
        page.notice("caution", "few draws", "Sample again")
    page.notice("not to be trusted", "chains failed", "Sample again")
    assert page.warnings == [
        ("not to be trusted", "A: chains failed.", "Sample again"),
        ("caution", "A and B: few draws.", "Sample again"),
    ]
