"""The page of a report: its chapters, tables and figures, and names that contain markup."""

import os
from xml.etree import ElementTree

import numpy as np
import pytest
import xarray as xr
from report_pages import Page, assert_sound
from stored_results import DATA, classified, curves, fitted_class, fitted_classes

import pymc_hyperelastic as ph
from pymc_hyperelastic.reports import page as making

NASTY = [
    "<script>alert(1)</script>",
    '"><img src=x onerror=alert(1)>',
    "动脉 ß “ü” </svg></table>",
    "a" * 200,
    "{{ 7 * 7 }} & co",
    "$\\frac{$ {% raw %}",
]


def text_of(drawing):
    """Return the text of an SVG."""
    return " ".join(ElementTree.fromstring(drawing).itertext())


THIRD = ph.select(DATA, experiment=3)
ANCHORS = (
    "summary warnings data fits parameters properties classes diagnosis settings methods software"
).split()


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """Return the report of two classes and of a classification."""
    results = {"Classes": fitted_classes(), "New": classified()}
    folder = tmp_path_factory.mktemp("report")
    in_mmhg = ph.Conditions(pressure_unit="mmHg")
    return Page(ph.report(results, folder / "report.html", {"Third": THIRD}, at=in_mmhg))


def test_chapters_are_in_order_and_the_page_loads_no_resources(page):
    assert_sound(page)
    links = [a["href"] for tag, a in page.elements if tag == "a"]
    assert links[1:] == [f"#{name}" for name in ANCHORS]
    assert len(page.figures) == 7  # three of data
    assert "cannot be shown" not in page.text


def test_parameter_table_equals_the_result(page):
    headings, rows = page.table("Parameters: Classes")
    assert headings == ["parameter", "meaning", "unit", "class C1", "class C2"]
    assert rows[0][:3] == ["mu", "small-strain shear modulus", "kPa"]
    for found, tree in zip(rows[0][3:], fitted_classes().children.values(), strict=True):
        expected = np.quantile(tree["posterior"]["mu"].values, [0.5, 0.025, 0.975])
        np.testing.assert_allclose(found, expected, rtol=1e-12)
    assert "typical specimen" not in page.text  # all specimens share one set of parameters
    assert max(page.column("Convergence of the chains", "R-hat")) < 1.05


def test_decision_table_equals_the_result(page):
    result = classified()
    headings, rows = page.table("Decisions and probabilities")
    assert headings[1:] == ["decision", "probability of C1", "probability of C2"]
    assert [row[0] + row[1] for row in rows] == ["S1C1", "S2C2"]
    names = "class_probability class_probability_se"
    expected = np.stack([result[name].values for name in names.split()], axis=-1)
    np.testing.assert_array_equal([row[2:4] for row in rows], expected)
    _, rows = page.table("Evidence of each specimen")
    assert [row[0] + row[1] for row in rows] == ["S1C1", "S1C2", "S2C1", "S2C2"]
    expected = np.stack([result[n].values.ravel() for n in ("log_evidence", "log_evidence_se")], 1)
    np.testing.assert_array_equal([row[2] for row in rows], expected)
    np.testing.assert_array_equal([row[3] for row in rows], result["pareto_k"].values.ravel())
    _, rows = page.table("Evidence: Classes")
    for row, (name, tree) in zip(rows, fitted_classes().children.items(), strict=True):
        assert row == [name, tuple(ph.log_evidence(tree))]
    assert "In all rows, verdict: good." in page.text


def test_summary_states_data_result_and_limits(page):
    assert (
        "The simulated data are 15 tests with 300 points on 5 specimens of 2 groups (3 in C1 "
        "and 2 in C2); measured were pressure and internal radius." in page.summary
    )
    assert (
        "Decisions on 2 new specimens: 1 C1 and 1 C2; the most probable classes have probabilities "
        "from 0.750 to 0.900." in page.summary
    )
    assert "The one warning (caution): New: the classes have no variability" in page.summary
    assert "The least certain elastic property is the" in page.summary


def test_each_warning_says_what_to_do(page):
    notices = page.warnings.split("As far as")[0]
    assert notices.count("What to do: ") == notices.count("Caution.") + notices.count("Note.") >= 3


def test_specimen_table_states_number_of_points_and_ranges(page):
    headings, rows = page.table("Specimens: Third")
    assert [row[0] for row in rows] == ["S1", "S2", "S3", "S4", "S5"]
    assert rows[3][1:4] == ["C2", 1.0, 20.0]
    assert "axial force (mN)" not in headings
    pressure = ph.select(THIRD, specimen="S4")["pressure"].values / ph.mmHg
    text = rows[3][headings.index("pressure (mmHg)")].split()
    assert text == [f"{pressure.min():.4g}", "to", f"{pressure.max():.4g}"]
    assert rows[3][headings.index("outer radius without load (mm)")] == 9.0


def test_properties_are_computed_for_the_stated_tube(write_words):
    """A report has the pressures, the unit and the tube of its conditions."""
    tree = fitted_classes()["C2"]
    at = ph.Conditions([4.0, 8.0], tube=ph.Tube(outer_radius=9.5), density=1000.0)
    headings, rows = write_words(tree, at=at).table("Elastic properties")
    assert "pressure (kPa)" in headings
    expected = ph.tube_properties(tree, at)["pulse_wave_velocity"].median(("chain", "draw"))
    found = [row[3][0] for row in rows if row[0] == "pulse wave velocity"]
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_property_table_equals_tube_properties(page):
    _, rows = page.table("Elastic properties")
    tree = fitted_classes()["C2"]
    properties = ph.tube_properties(tree, ph.Conditions(rows[-1][1], pressure_unit="mmHg"))
    for row in rows[-5:]:
        assert row[1] == rows[-1][1]
        (own,) = [v for v in properties.values() if v.attrs.get("long_name") == row[0]]
        values = own.values
        ends = np.quantile(values, [0.025, 0.975]).tolist()
        np.testing.assert_allclose(row[4], [np.median(values), *ends], rtol=1e-12)
    # Every experiment reached these pressures.
    training = ph.select(DATA, experiment=[1, 2])
    tests = [test for _, test in training["pressure"].groupby(training["test"])]
    ends = max(float(t.min()) for t in tests), min(float(t.max()) for t in tests)
    at = np.unique([row[1] for row in rows])
    np.testing.assert_allclose(at * ph.mmHg, np.linspace(*ends, 3))
    assert {row[2] for row in rows} == {"mm²/kPa", "1/kPa", "kPa", "m/s"}


def test_names_with_markup_are_shown_as_text(write):
    data = curves(NASTY, group=NASTY[0])
    data.attrs = {"title": NASTY[0], "description": NASTY[1], "source": NASTY[2]}
    result = classified(NASTY[:2]).assign_coords(class_label=[NASTY[1], NASTY[2]])
    result["decision"] = "specimen", [NASTY[1], "cannot be judged"]
    page = write({NASTY[1]: result, NASTY[2]: data}, title=NASTY[4])
    assert_sound(page)
    assert not [a for _, a in page.elements if "onerror" in a]
    assert "<script>alert" not in page.source and 'x onerror=alert(1)>"' not in page.source
    assert page.headings[0][1] == NASTY[4]
    assert page.column("Decisions", "specimen") == NASTY[:2]
    assert page.column("Specimens", "specimen") == NASTY
    probabilities, curves_of_groups = page.figures.values()
    assert NASTY[0] in text_of(curves_of_groups)
    for name in NASTY[:2]:
        assert f"specimen {name}" in text_of(probabilities)


def test_control_characters_in_names_do_not_damage_page_and_figures(write):
    """XML, and so a drawing, cannot hold them; half of a character cannot be written at all."""
    page = write(classified(["bell \x07", "S2"]), title="half \ud800, null \x00")
    assert_sound(page)
    assert page.column("Decisions", "specimen")[0] == "bell \x07"
    assert "bell \ufffd" in text_of(*page.figures.values())


def test_titles_come_from_dict_keys_or_kinds(write_words):
    page = write_words([THIRD, curves(["A"]), classified()], title="Mine")
    assert [text for tag, text in page.headings if tag == "h3"] == ["Data", "Data 2"]
    assert page.headings[0][1] == "Mine"
    assert "Data (data); Data 2 (data); Classified (classified)" in page.text
    assert write_words(curves(["A"])).headings[0][1] == "Report of a study"
    page = write_words([fitted_class(THIRD), fitted_classes()])
    assert "Fitted model (fitted model); Fitted classes (fitted classes)" in page.text


@pytest.mark.parametrize(
    ("result", "settings", "message"),
    [
        ([], {}, "no results"),
        ([THIRD, xr.Dataset({"x": 1})], {}, r"a Dataset of \['x'\]"),
        (THIRD, {"at": [-1.0]}, "at states the pressure -1; expected at least 0"),
        (THIRD, {"path": os.curdir}, "is a folder: name a file in it"),
        ("report.html", {"path": THIRD}, r"expected results of .*; got 'report.html'"),
    ],
)
def test_wrong_input_is_refused_before_a_file_is_written(tmp_path, result, settings, message):
    with pytest.raises((TypeError, ValueError), match=message):
        ph.report(result, **{"path": tmp_path / "report.html"} | settings)
    assert not list(tmp_path.iterdir())


def test_same_results_give_the_same_file_and_matplotlib_is_unchanged(write, monkeypatch):
    from matplotlib import pyplot as plt

    plt.close("all")
    mine, before, data = plt.figure(), dict(plt.rcParams), curves(["A"])
    first = write(data)
    assert write(data).source == first.source
    assert plt.get_fignums() == [mine.number]
    assert dict(plt.rcParams) == before
    plt.close(mine)
    # Many points become one image.
    monkeypatch.setattr(making, "_MOST_SHAPES", 5)
    page = write(data)
    assert_sound(page)
    (drawing,), (before,) = page.figures.values(), first.figures.values()
    assert "data:image/png;base64," in drawing
    assert drawing.count("<use") < before.count("<use")
