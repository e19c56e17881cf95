"""A report is one whole file that says what the results say, whatever names a user gives."""

import os
import sys

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from pages import Page, assert_sound
from stored import DATA, classified, fitted_class, fitted_classes

import pymc_hyperelastic as ph
from pymc_hyperelastic.reports import blocks

NASTY = [
    "<script>alert(1)</script>",
    '"><img src=x onerror=alert(1)>',
    "动脉 ß “ü” </svg></table>",
    "a" * 300,
    "{{ 7 * 7 }} & co",
    "$\\alpha$ {% raw %}",
]


def curves(names, group="C1", **columns):
    """Straight lines of these specimens, which no report minds."""
    radius = np.linspace(7.2, 9.0, 6)
    points = {"radius": radius, "pressure": 6 * (radius - 7.0)}
    tables = [
        pd.DataFrame({"specimen": name, "experiment": 1, "group": group} | points | columns)
        for name in names
    ]
    frame = pd.concat(tables, ignore_index=True)
    return ph.inflation_data(frame, inner_radius=7.0, outer_radius=9.0, check="ignore")


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """Report of classes, and of what was classified by them."""
    results = {"Classes": fitted_classes(), "New": classified()}
    folder = tmp_path_factory.mktemp("report")
    return Page(ph.report(results, folder / "report.html", data={"Third": THIRD}))


THIRD = ph.select(DATA, experiment=3)


def test_page_is_whole_and_alone(page):
    """Tags are closed, names are unique, nothing is loaded, and headings are in order."""
    assert_sound(page)


def test_chapters_are_in_order(page):
    """Warnings stand first, then data, fits, posteriors, decisions, properties, settings."""
    assert page.chapters == [
        "Warnings and diagnoses",
        "Contents",
        "Evidence and its diagnosis",
        "Data",
        "Fits",
        "Posteriors",
        "Classes and decisions",
        "Elastic properties",
        "Settings",
        "Methods, to be pasted",
        "Software, and how to cite it",
    ]
    links = [a["href"] for tag, a in page.elements if tag == "a"]
    assert links[1:] == [f"#{name}" for name in ANCHORS]
    assert sum(tag == "svg" for tag, _ in page.elements) == 7  # three of data
    assert "cannot be shown" not in page.text


ANCHORS = "warnings trust data fits posteriors classes properties settings methods software".split()


def test_posterior_table_holds_the_numbers_of_the_result(page):
    """Each number of the table is that of the draws, to the last digit."""
    headings, rows = page.table("Posterior of the parameters")
    assert headings[3:7] == ["mean", "sd", "2.5 %", "97.5 %"]
    for row, tree in zip(rows[::2], fitted_classes().children.values(), strict=True):
        draws = tree["posterior"]["mu"].values
        low, high = np.quantile(draws, [0.025, 0.975])
        assert row[:3] == ["mu", tree.name, "kPa"]
        assert row[3:7] == [draws.mean(), draws.std(ddof=1), low, high]
        assert row[headings.index("R-hat")] < 1.05


def test_tables_of_decisions_hold_the_numbers_of_the_result(page):
    """Probabilities, evidences and their errors are those of the result, class by class."""
    result = classified()
    headings, rows = page.table("Decisions and probabilities")
    assert [row[:4] for row in rows] == [
        ["S1", "C1", "C1", "C1"],
        ["S1", "C1", "C1", "C2"],
        ["S2", "C1", "C2", "C1"],
        ["S2", "C1", "C2", "C2"],
    ]
    names = "class_probability class_probability_se log_evidence log_evidence_se pareto_k"
    expected = np.stack([result[name].values.ravel() for name in names.split()], axis=1)
    assert [row[4:9] for row in rows] == expected.tolist()
    assert headings[4:] == [
        "probability",
        "its standard error",
        "log evidence",
        "its standard error",
        "Pareto shape",
        "integrated by",
    ]


def test_table_of_evidences_holds_those_of_the_result(page):
    """Evidences have the values, errors and verdicts that ph.log_evidence and its diagnosis say."""
    _, rows = page.table("Evidence: Classes")
    for row, (name, tree) in zip(rows, fitted_classes().children.items(), strict=True):
        assert row == [name, *ph.log_evidence(tree), "good"]


def test_table_of_specimens_counts_and_measures_them(page):
    """Specimens stand with their group, experiments, points and the ends of what was measured."""
    headings, rows = page.table("Specimens: Third")
    assert [row[0] for row in rows] == ["S1", "S2", "S3", "S4", "S5"]
    own = ph.select(THIRD, specimen="S4")
    assert rows[3][1:4] == ["C2", 1.0, 20.0]
    ends = [f"{f(own['radius'].values):.4g}" for f in (np.min, np.max)]
    assert rows[3][4].split() == [ends[0], "to", ends[1]]
    ends = [f"{f(own['pressure'].values) / ph.mmHg:.4g}" for f in (np.min, np.max)]
    assert rows[3][headings.index("pressure (mmHg)")].split() == [ends[0], "to", ends[1]]
    assert rows[3][headings.index("outer radius at rest (mm)")] == 9.0


def test_tables_of_properties_hold_those_of_the_result(page):
    """Elastic properties are those of ph.tube_properties, at pressures that all tests reached."""
    _, rows = page.table("Elastic properties")
    tree = fitted_classes()["C2"]
    for row in rows[-5:]:
        properties = ph.tube_properties(tree, row[2], pressure_unit="mmHg")
        values = properties[row[0].replace("Peterson's", "peterson").replace(" ", "_")].values
        ends = np.quantile(values, [0.025, 0.975]).tolist()
        np.testing.assert_allclose(row[4:], [np.median(values), *ends], rtol=1e-12)
    highest = min(test.max() for _, test in DATA["pressure"].groupby(DATA["test"]))
    assert rows[-1][2] * ph.mmHg <= highest * 1.2  # the third experiments train nothing
    assert {row[3] for row in rows} == {"mm²/kPa", "1/kPa", "kPa", "m/s"}


def test_what_is_shown_is_the_number_to_four_digits(page):
    """No number of a table is shown as another than it is."""
    assert len(page.numbers) > 100
    for value, text in page.numbers:
        if text == "not known":
            assert np.isnan(value)
            continue
        if text in ("<0.001", ">0.999"):
            assert value < 0.0005 or value > 0.9995
            continue
        plain = text.replace("−", "-").replace(" × 10", "e")
        plain = plain.translate(str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-"))
        assert float(plain) == pytest.approx(value, rel=1e-3, abs=5e-4 if "e" not in plain else 0)


def test_the_same_results_give_the_same_file(write):
    """Nothing but the results is in a report: neither a time nor a chance name."""
    first, second = (write(THIRD).source for _ in range(2))
    assert first == second


@pytest.mark.parametrize("name", NASTY)
def test_names_are_only_names(write_words, name):
    """Whatever a specimen, group, class or title is called, it is text, whole, and nothing else."""
    data = curves([name, "S2"], group=name)
    data.attrs = {"title": name, "description": name, "source": name}
    tree = fitted_classes({name.replace("/", "|"): data})
    result = classified([name, "S2"]).assign_coords(class_label=[name, "C2"])
    result["decision"] = "specimen", [name, "cannot be judged"]
    page = write_words({name: tree, f"{name}2": result}, title=name, data={name: data})
    assert_names(page)
    assert page.headings[0][1] == name
    assert page.column("Decisions", "specimen")[0] == name
    assert "".join(page.texts).count(name) > 10


def test_names_in_figures_are_only_names(write):
    """What a figure shows of names is text of the drawing, and harmless too."""
    data = curves(NASTY, group=NASTY[0])
    result = classified(NASTY[:2]).assign_coords(class_label=[NASTY[1], NASTY[2]])
    page = write({NASTY[1]: result, NASTY[2]: data})
    assert_names(page)
    drawn = "".join(page.texts)
    assert sum(tag == "svg" for tag, _ in page.elements) == 2
    for name in NASTY[:5]:  # mathematics is drawn as such
        assert f"specimen {name}" in drawn


def assert_names(page):
    assert_sound(page)
    assert not [a for tag, a in page.elements if tag == "img" or "onerror" in a]
    assert "<script>alert" not in page.source and 'x onerror=alert(1)>"' not in page.source


def test_names_may_be_numbers(write):
    """Specimens, groups and experiments that are numbers are shown as they are."""
    data = curves([101, 102], group=7)
    result = classified(["101", "102"]).assign_coords(specimen=[101, 102])
    page = write([data, result])
    assert page.column("Specimens", "specimen") == ["101", "102"]
    assert page.column("Specimens", "group") == ["7", "7"]
    assert page.column("Decisions", "specimen") == ["101", "101", "102", "102"]
    assert_sound(page)


def test_titles(write_words):
    """A dict gives titles, a list the kinds, numbered where there are several; a title is free."""
    page = write_words([THIRD, curves(["A"]), classified()], title="Mine")
    assert [text for tag, text in page.headings if tag == "h3"] == ["Data", "Data 2"]
    assert page.headings[0][1] == "Mine"
    assert "Data (data); Data 2 (data); Classified (classified)" in page.text
    assert write_words(curves(["A"])).headings[0][1] == "Report of a study"


def test_pressures_may_be_chosen(write_words):
    """Elastic properties stand at the pressures that are asked for, in the unit that is given."""
    page = write_words(fitted_classes()["C1"], pressure=[10.0, 12.0], pressure_unit="kPa")
    assert set(page.column("Elastic properties", "pressure (kPa)")) == {10.0, 12.0}
    assert "pressure (kPa)" in page.table("Specimens")[0]


def test_file_is_whole_or_not_there(tmp_path, monkeypatch):
    """The folder is made; when writing fails the old file stays, and no part of a new one."""
    path = tmp_path / "a" / "b" / "report.html"
    assert ph.report(THIRD, str(path)) == path
    before = path.read_bytes()

    def fail(*_):
        raise OSError("no space left")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(OSError, match="no space"):
        ph.report(curves(["A"]), path)
    assert path.read_bytes() == before
    assert [p.name for p in path.parent.iterdir()] == ["report.html"]


def test_without_jinja(monkeypatch, tmp_path):
    """Without Jinja2 the error says what to install."""
    monkeypatch.setitem(sys.modules, "jinja2", None)
    with pytest.raises(ImportError, match="pip install jinja2"):
        ph.report(THIRD, tmp_path / "report.html")


@pytest.mark.parametrize(
    ("result", "settings", "error", "message"),
    [
        (3, {}, TypeError, "results of ph.fit_classes.*here is 3"),
        ("classes.nc", {}, TypeError, "here is 'classes.nc'"),
        (None, {}, TypeError, "here is NoneType"),
        ([], {}, ValueError, "no results"),
        (xr.Dataset({"x": 1}), {}, TypeError, r"a Dataset of \['x'\]"),
        (xr.DataTree(), {}, TypeError, "a DataTree of nothing"),
        ([THIRD, 3], {}, TypeError, "here is 3"),
        (THIRD, {"data": 3}, TypeError, "here is 3"),
        (THIRD, {"pressure_unit": "mm"}, ValueError, "pressure_unit"),
        (THIRD, {"pressure": "high"}, ValueError, "pressure must be a number.*'high'"),
        (THIRD, {"pressure": [-1.0]}, ValueError, "pressure must be a number"),
        (THIRD, {"path": 3}, TypeError, "path must name a file"),
        (THIRD, {"path": os.curdir}, ValueError, "is a folder: name a file in it"),
    ],
)
def test_wrong_input(tmp_path, result, settings, error, message):
    """What is no result, pressure or file raises one error that says what is expected."""
    settings = {"path": tmp_path / "report.html"} | settings
    with pytest.raises(error, match=message):
        ph.report(result, **settings)
    assert not list(tmp_path.iterdir())


def test_figures_are_closed_and_settings_kept(write):
    """A report leaves neither open figures nor other settings of matplotlib behind."""
    from matplotlib import pyplot as plt

    plt.close("all")
    mine, before = plt.figure(), dict(plt.rcParams)
    write(fitted_class(curves(["A"])))
    assert plt.get_fignums() == [mine.number]
    assert dict(plt.rcParams) == before
    plt.close(mine)


def test_very_many_points_are_drawn_as_pixels(write, monkeypatch):
    """Points that are too many to be shapes become one image in the page, which stays whole."""
    monkeypatch.setattr(blocks, "_MOST_SHAPES", 50)
    page = write(THIRD)
    assert_sound(page)
    images = [attrs["href"] for tag, attrs in page.elements if tag == "image"]
    assert images and all(image.startswith("data:image/png;base64,") for image in images)
    assert page.source.count("<use") < 50
