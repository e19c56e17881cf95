"""plot_class_probability: bars, errors, decisions, p-values."""

import numpy as np
import pytest
import xarray as xr
from figures import elements, legend_texts, texts

import pymc_hyperelastic as ph
from pymc_hyperelastic.plots.style import rounded_probability

LIMITS = {"undecided_below": 0.8, "none_below": 0.05}


def test_printed_probabilities_are_never_zero_or_one():
    printed = map(rounded_probability, (0.0004, 0.0006, 0.9994, 0.9995, 1.0))
    assert [*printed] == ["<0.001", "0.001", "0.999", ">0.999", ">0.999"]


def test_printed_errors_have_two_digits():
    printed = [rounded_probability(0.87654, error) for error in (0.000499, 0.0312, 0.0999)]
    assert printed == ["0.877", "0.877 ± 0.031", "0.88 ± 0.10"]


def test_bars_errors_and_numbers_equal_the_result(result):
    figure = ph.plot_class_probability(result, backend="none")
    rows = [f"{specimen}, experiment 3" for specimen in ("S1", "S2", "S4")]
    (ticks,) = {tuple(e["labels"]) for e in elements(figure, "yticks")}
    assert list(ticks) == rows
    words = ["C1 >0.999", "C1 0.900 ± 0.010", "C2 0.750 ± 0.050"]
    for i, row in enumerate(rows):
        for j, name in enumerate(["C1", "C2"]):
            p = float(result["class_probability"][i, j])
            se = float(result["class_probability_se"][i, j])
            here = {"test": row, "class_label": name}
            bar, error = figure.get_viz("bar", **here), figure.get_viz("error", **here)
            assert bar["x"].tolist() == [0, p]
            assert error["x"].tolist() == [max(p - se, 0), min(p + se, 1)]
            # Bars are about the middle of the row, the first class on top.
            assert (bar["y"] + i > 0).all() == (j == 0)
        assert figure.get_viz("decision", test=row)["string"] == words[i]
    marked = figure.viz["true"]["classes"].notnull().squeeze()
    true = [[label == name for name in ("C1", "C2")] for label in result["group"].values]
    assert marked.sel(test=rows, class_label=["C1", "C2"]).values.tolist() == true


def test_each_result_has_panels(result):
    unfinished = result.copy(deep=True)
    unfinished["class_probability"][2] = np.nan
    figure = ph.plot_class_probability({"A": result, "B": unfinished}, backend="none")
    assert figure.viz["plot"].sizes["model"] == 2
    assert texts(figure, "title") == ["A", "B"]
    assert figure.viz["bar"]["classes"].notnull().sum("test").sum(
        "class_label"
    ).values.tolist() == [6, 4]


@pytest.fixture
def decided(result):
    """Return one specimen for each kind of answer."""
    answers = ["C1", "undecided", "none of these", "cannot be judged", ""]
    p_value = np.array([[0.5, 0.2], [0.9, 0.4], [0.01, np.nan], [0.5, 0.5], [np.nan] * 2])
    dims, probability = ("specimen", "class_label"), np.tile([0.9, 0.1], (5, 1))
    error = np.full((5, 2), 0.2)
    error[3], probability[4] = np.inf, np.nan
    tables = {"class_probability": probability, "class_probability_se": error, "p_value": p_value}
    return xr.Dataset(
        {name: (dims, table) for name, table in tables.items()},
        {"specimen": [f"S{i}" for i in range(5)], "class_label": ["C1", "C2"]},
    ).assign(decision=("specimen", answers))


def test_each_kind_of_answer_is_visible(decided):
    figure = ph.plot_class_probability(decided, backend="none")
    written = [figure.get_viz("decision", specimen=name) for name in decided["specimen"].values]
    words = ["C1 0.90 ± 0.20", "undecided", "none of these", "cannot be judged", "not classified"]
    assert [text["string"] for text in written] == words
    colours = [text["color"] for text in written]
    assert colours[0] not in colours[1:]
    # Unknown probabilities and probabilities with an infinite error have no bar.
    for name, rows in {"bar": ["S0"], "doubtful": ["S1", "S2"]}.items():
        drawn = figure.viz[name]["classes"].notnull().any("class_label").squeeze()
        assert drawn["specimen"].values[drawn.values].tolist() == rows


def test_p_values_have_a_panel_and_limits_are_lines(decided):
    figure = ph.plot_class_probability(decided, backend="none", **LIMITS)
    shown = [float(np.ravel(e["x"])[0]) for e in elements(figure, "scatter")]
    p_value = decided["p_value"].values
    assert sorted(shown) == sorted(p_value[np.isfinite(p_value)])
    for panel, (name, limit) in zip(("probability", "p_value"), LIMITS.items(), strict=True):
        assert figure.get_viz(name, panel=panel)["x"] == limit
    shown = legend_texts(ph.plot_class_probability(decided, **LIMITS))
    assert shown[:2] == ["C1", "C2"]
    assert shown[-2:] == ["undecided below 0.8", "none below 0.05"]
    stored = ph.plot_class_probability(decided.assign_attrs(LIMITS), backend="none")
    assert stored.get_viz("none_below", panel="p_value")["x"] == 0.05


@pytest.mark.parametrize("p_value", [None, np.nan])
def test_there_is_no_panel_without_p_values(decided, p_value):
    result = decided.drop_vars("p_value")
    if p_value is not None:
        result["p_value"] = xr.full_like(decided["p_value"], p_value)
    figure = ph.plot_class_probability(result, backend="none", **LIMITS)
    assert figure.viz["plot"]["panel"].values.tolist() == ["probability"]


def test_left_out_specimens_of_a_cross_validation_are_shown(result):
    left_out = result.drop_vars(["class_probability_se", "experiment", "group"])
    left_out = left_out.swap_dims(test="specimen")
    left_out = left_out.assign_coords(true_class=("specimen", ["C1", "C2", "C2"]))
    figure = ph.plot_class_probability(left_out, backend="none")
    words = [e["string"] for e in elements(figure, "text")]
    assert words == ["C1 >0.999", "C1 0.900", "C2 0.750"]
    marked = figure.viz["true"]["classes"].notnull().squeeze()
    assert marked.sel(class_label="C2").values.tolist() == [False, True, True]


def test_sixteen_specimens_fit_one_readable_figure(decided):
    many = xr.concat([decided] * 4, "specimen").isel(specimen=slice(16))
    figure = ph.plot_class_probability(many).get_viz("figure")
    width, height = figure.get_size_inches()
    assert width < 8
    assert height < 8
    names = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert len(set(names)) == 16  # equal names are numbered
