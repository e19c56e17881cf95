"""plot_class_probability: bars, errors, decisions, p-values."""

import numpy as np
import pytest
import xarray as xr
from figures import elements, legend_texts, texts

import pymc_hyperelastic as ph
from pymc_hyperelastic.plots.style import rounded_probability


def test_printed_probabilities_are_never_zero_or_one():
    printed = map(rounded_probability, (0.0004, 0.0006, 0.9994, 1.0))
    assert [*printed] == ["<0.001", "0.001", "0.999", ">0.999"]


def test_bars_errors_and_numbers_equal_the_result(result):
    figure = ph.plot_class_probability(result, backend="none")
    rows = ["S1, experiment 3 (true class C1)", "S2, experiment 3 (true class C1)"]
    rows.append("S4, experiment 3 (true class C2)")
    assert texts(figure, "title") == rows
    for i, row in enumerate(rows):
        for j, name in enumerate(["C1", "C2"]):
            p = float(result["class_probability"][i, j])
            se = float(result["class_probability_se"][i, j])
            here = {"test": row, "class_label": name}
            bar, error = figure.get_viz("bar", **here), figure.get_viz("error", **here)
            assert bar["y"].item() == p
            assert error["y_top"].item() == min(p + se, 1)
            assert error["y_bottom"].item() == max(p - se, 0)
            number = figure.get_viz("number", **here)
            assert number["string"] == rounded_probability(p)
            # Numbers are written where the axis has more room.
            place = p + se + 0.07 if p <= 0.5 else p - se - 0.07
            assert number["y"] == pytest.approx(place, abs=1e-8)


def test_each_result_has_a_column(result):
    unfinished = result.copy(deep=True)
    unfinished["class_probability"][2] = np.nan
    figure = ph.plot_class_probability({"A": result, "B": unfinished}, backend="none")
    assert figure.viz["plot"].sizes["model"] == 2
    assert texts(figure, "xlabel") == ["class (A)", "class (B)"]
    assert len(elements(figure, "hist")) == 6 + 4


def test_decisions_p_values_and_limits_are_shown():
    decided = ["C1", "undecided", "none of these", ""]
    p_value = np.array([[0.5, 0.2], [0.9, 0.4], [0.01, np.nan], [np.nan, np.nan]])
    dims, probability = ("specimen", "class_label"), np.tile([0.9, 0.1], (4, 1))
    probability[3] = np.nan
    tables = {"class_probability": probability, "class_probability_se": np.full((4, 2), 0.2)}
    result = xr.Dataset(
        {name: (dims, table) for name, table in (tables | {"p_value": p_value}).items()},
        {"specimen": [f"S{i}" for i in (1, 2, 3, 4)], "class_label": ["C1", "C2"]},
    ).assign(decision=("specimen", decided))
    limits = {"undecided_below": 0.8, "none_below": 0.05}
    figure = ph.plot_class_probability(result, backend="none", **limits)
    titles = ["S1 → C1", "S2 → undecided", "S3 → none of these", "S4 → not classified"]
    assert texts(figure, "title") == titles
    colours = [e["color"] for e in elements(figure, "title")]
    assert colours[0] not in colours[1:]
    shown = [e["y"].item() for e in elements(figure, "scatter")]
    assert shown == p_value[np.isfinite(p_value)].tolist()
    of_one = {"specimen": "S1", "class_label": "C2"}
    number, marker = (figure.get_viz(name, **of_one)["x"] for name in ("p_number", "p_value"))
    np.testing.assert_array_equal(np.ravel(number), np.ravel(marker))
    assert figure.get_viz("p_number", specimen="S3", class_label="C1")["string"] == "0.010"
    for name, limit in limits.items():
        assert figure.get_viz(name, specimen="S2")["y"] == limit
    shown = legend_texts(ph.plot_class_probability(result, **limits))
    assert shown == ["probability", "p-value", "undecided_below = 0.8", "none_below = 0.05"]
    stored = ph.plot_class_probability(result.assign_attrs(limits), backend="none")
    assert stored.get_viz("none_below", specimen="S2")["y"] == 0.05
    several = ph.plot_class_probability({"A": result, "B": result}, backend="none")
    assert texts(several, "title")[:2] == ["S1\n→ C1", "\n→ C1"]


def test_panel_of_an_unclassified_specimen_names_the_classes(result):
    result["class_probability"][0] = np.nan
    figure = ph.plot_class_probability(result).get_viz("figure")
    assert {label.get_text() for label in figure.axes[-1].get_xticklabels()} == {"C1", "C2"}
    wide = ph.plot_class_probability(xr.concat([result] * 3, "test"))
    for axes in wide.get_viz("figure").axes[:9]:
        assert axes.get_xlim() == pytest.approx((-0.6, 1.6))
