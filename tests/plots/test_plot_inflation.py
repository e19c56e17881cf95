"""plot_inflation: every measured point, its colour, marker and label."""

import numpy as np
import pytest
from figures import (
    DATA,
    LABELS,
    STRETCHES,
    both_kinds,
    elements,
    fitted,
    legend_texts,
    measured,
    points_of,
    straight_lines,
    texts,
)
from matplotlib.text import Text

import pymc_hyperelastic as ph


@pytest.mark.parametrize(
    ("group_by", "panels"), [("group", 2), ("specimen", 5), ("experiment", 3), (None, 1)]
)
def test_every_measured_point_is_drawn_once(group_by, panels):
    figure = ph.plot_inflation(DATA, group_by=group_by, pressure_unit="mmHg", backend="none")
    assert figure.viz["plot"].size == panels
    assert len(elements(figure, "line")) == DATA.sizes["test"]
    expected = np.stack([DATA["radius"].values, DATA["pressure"].values / ph.mmHg])
    expected = expected[:, np.lexsort(expected)]
    np.testing.assert_allclose(points_of(figure), expected, rtol=1e-12)


def test_only_some_of_many_specimens_are_drawn_and_the_title_counts_them():
    many = straight_lines(150)
    many["group"] = ("test", np.where(np.arange(150) < 100, "A", "B"))
    figure = ph.plot_inflation(many, backend="none")
    assert len(elements(figure, "line")) == 60 and figure.viz["plot"].size == 2
    assert figure.get_viz("figure_title")["string"] == "60 of 150 specimens"
    repeated = straight_lines(2, stretches=(1.0,) * 150)
    figure = ph.plot_inflation(repeated, group_by=None, backend="none")
    assert len(elements(figure, "line")) == 240
    assert figure.get_viz("figure_title")["string"] == "240 of 300 tests"


def test_labels_with_dollar_signs_are_not_shown_as_formulas():
    data = straight_lines(3).assign_attrs(title=r"$\frac{$ and $5")
    data["specimen"] = ("test", ["a$b$", r"$\frac{$", "$"])
    data["group"] = ("test", ["$x_1$", "$x_1$", r"\$y$"])
    figure = ph.plot_inflation(data).get_viz("figure")
    figure.canvas.draw()
    # Text that matplotlib writes: without formulas \\$ becomes $.
    written = figure.findobj(lambda artist: isinstance(artist, Text) and artist.get_text())
    shown = {each._preprocess_math(each.get_text()) for each in written}
    labels = {"specimen a$b$", r"specimen $\frac{$", r"group \$y$", r"$\frac{$ and $5"}
    assert {(label, False) for label in labels} <= shown


def test_specimens_differ_in_colour_line_style_and_marker():
    data = straight_lines(40)
    # Two cycles of an experiment are both drawn.
    data["specimen"][1] = data["specimen"][0]
    data = data.assign_coords(cycle=("test", [1, 2, *[1] * 38]))
    figure = ph.plot_inflation(data, backend="none")
    lines = [(e["color"], e["linestyle"]) for e in elements(figure, "line")]
    dots = [e["marker"] for e in elements(figure, "scatter")]
    assert len(lines) == 40
    assert len(set(zip(lines, dots, strict=True))) == 39
    assert len(set(lines[:22])) == 21  # seven colours, three line styles


def test_axial_stretches_differ_by_marker_or_colour():
    names, data = [f"axial stretch {s:g}" for s in STRETCHES], straight_lines(4, STRETCHES)
    figure = ph.plot_inflation(data, backend="none")
    assert len({e["marker"] for e in elements(figure, "scatter")}) == len(STRETCHES)
    specimens = [f"specimen S{i}" for i in (1, 2, 3, 4)]
    assert legend_texts(ph.plot_inflation(data)) == specimens + names
    one = straight_lines(1, STRETCHES)
    assert len({e["color"] for e in elements(ph.plot_inflation(one, backend="none"), "line")}) == 3
    assert legend_texts(ph.plot_inflation(one)) == names
    figure = ph.plot_inflation(data, group_by="axial_stretch", backend="none")
    assert texts(figure, "title") == names
    # Each specimen has its own stretches.
    data["axial_stretch"] = data["axial_stretch"] + 0.001 * np.arange(12)
    experiments = [f"experiment {i}" for i in (1, 2, 3)]
    assert legend_texts(ph.plot_inflation(data)) == specimens + experiments
    assert legend_texts(ph.plot_inflation(straight_lines(1))) == []


def test_measured_outer_diameters_are_labelled_as_diameters():
    data = straight_lines(2, STRETCHES, of_diameter=True)
    figure = ph.plot_inflation(data, backend="none")
    assert set(texts(figure, "xlabel")) == {"outer diameter $d_o$ (mm)"}
    x = np.concatenate([e["x"] for e in elements(figure, "scatter")])
    np.testing.assert_array_equal(np.sort(x), np.sort(data["outer_diameter"].values))
    (label,) = set(texts(ph.plot_fit(fitted(data), backend="none"), "xlabel"))
    assert label == "outer diameter $d_o$ (mm)"


def test_inflation_and_extension_points_are_drawn_in_their_own_panels():
    data = both_kinds()
    figure = ph.plot_inflation(data, group_by="axial_stretch", backend="none")
    for variable, x, y, kind in (
        ("pressure", "radius", "pressure", "at"),
        ("axial_force", "axial_stretch", "axial_force", "held"),
    ):
        expected = measured(data, x, y, kind)
        np.testing.assert_array_equal(points_of(figure, variable), expected)
    assert len(elements(figure, "line")) == 4
    labels = {e["string"] for e in elements(figure, "xlabel", "axial_force")}
    assert labels == {"axial stretch $\\lambda_z$"}
    # Each panel has the name of its group once.
    assert len(elements(figure, "title")) == 4


def test_extension_tests_without_forces_show_radii():
    data = both_kinds(force=False)
    assert legend_texts(ph.plot_inflation(data)) == LABELS
    points = points_of(ph.plot_inflation(data, backend="none"), "radius")
    np.testing.assert_array_equal(points, measured(data, "axial_stretch", "radius", "held"))
