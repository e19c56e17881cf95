"""Properties of all figures: titles, labels, colours, legends, settings, errors."""

import pytest
import xarray as xr
from figures import DATA, STRETCHES, elements, legend_texts, straight_lines, texts

import pymc_hyperelastic as ph
from pymc_hyperelastic.plots.style import PALETTE, Canvas


def test_titles_name_the_data_and_say_whether_they_are_simulated(few_draws):
    simulated = DATA.assign_attrs(title="Aortas")
    measured = simulated.assign_attrs(simulated=0)
    titles = {
        "Aortas, SIMULATED data": ph.plot_inflation(simulated, backend="none"),
        "Aortas": ph.plot_inflation(measured, backend="none"),
        DATA.attrs["title"]: ph.plot_inflation(DATA, backend="none"),  # "SIMULATED sheep aorta"
    }
    # The posterior of simulated data is simulated, too.
    fit = ph.plot_fit(few_draws["C1"], measured, backend="none")
    titles["Ogden, Aortas, SIMULATED data"] = fit
    for title, figure in titles.items():
        assert figure.get_viz("figure_title")["string"] == title


def test_axis_labels_name_quantity_and_unit(classes, few_draws):
    inflation = ph.plot_inflation(DATA, backend="none")
    assert set(texts(inflation, "xlabel")) == {"internal radius $a$ (mm)"}
    assert texts(inflation, "ylabel") == ["pressure (kPa)"]
    density = ph.plot_parameter_density(classes, backend="none")
    assert texts(density, "xlabel") == [r"$\mu$ (kPa)"]
    assert texts(density, "ylabel") == [r"$\alpha$"] * 2
    fit = ph.plot_fit(few_draws, backend="none", pressure_unit="mmHg")
    slopes = ph.plot_fit(few_draws, signal="stiffness", backend="none", pressure_unit="mmHg")
    assert set(texts(fit, "ylabel")) == {"pressure (mmHg)"}
    assert set(texts(slopes, "ylabel")) == {"stiffness $\\mathrm{d}p/\\mathrm{d}a$\n(mmHg/mm)"}
    assert texts(fit, "title") == DATA["specimen"].values[::3].tolist()
    # A class has the same colour in each figure.
    for figure in (density, fit):
        assert figure.aes["color"]["mapping"].values.tolist() == PALETTE[:2]


def test_sizes_colours_and_visuals_can_be_set():
    figure = ph.plot_inflation(straight_lines(), figure_kwargs={"figsize": (9, 3)})
    assert figure.get_viz("figure").get_size_inches().tolist() == [9, 3]
    visuals, data = {"line": False, "points": {"size": 3}}, straight_lines(2, STRETCHES)
    figure = ph.plot_inflation(data, backend="none", visuals=visuals, color=["k"])
    assert not elements(figure, "line")
    assert {(e["size"], e["facecolor"]) for e in elements(figure, "scatter")} == {(3, "k")}
    assert not legend_texts(ph.plot_inflation(data, visuals={"legend": False}))


@pytest.mark.parametrize("high", [0.9, 2.3, 40.0, 5e3, 1e9])
def test_logarithmic_axes_have_a_few_round_numbers(high):
    data, wishes = xr.Dataset({"x": ("n", [1.0])}, {"n": ["a"]}), ("matplotlib", None, {})
    canvas = Canvas("wrap", data, "", wishes, (4, 3), {}, aes={"color": ["n"]})
    canvas.limit("y", (0.45, high), log=True)
    axes = canvas.collection.get_viz("plot", "x")
    assert axes.get_yscale() == "log" and axes.get_ylim() == (0.45, high)
    axes.figure.canvas.draw()
    shown = [
        label.get_text()
        for label in axes.get_yticklabels()
        if 0.45 <= label.get_position()[1] <= high
    ]
    assert 3 <= len(shown) <= 12
    assert all(len(number) < 6 for number in shown)


def without_data(tree):
    return tree.filter(lambda node: node.name == "posterior")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda c, r: ph.plot_inflation(DATA, group_by="sex"), "group_by must be one"),
        (lambda c, r: ph.plot_inflation(DATA, backend="tv"), "backend must be"),
        (lambda c, r: ph.plot_inflation(DATA, visuals={"dot": {}}), "no visual.*'dot'"),
        (lambda c, r: ph.plot_parameter_density(xr.DataTree()), "no posterior"),
        (lambda c, r: ph.plot_parameter_density(c, var_names=["mu", "mu"]), "two different"),
        (lambda c, r: ph.plot_parameter_density(c, ci_probs=[1.0]), "between 0 and 1"),
        (lambda c, r: ph.plot_fit(c, {"C1": DATA}), "nothing for class 'C2'"),
        (lambda c, r: ph.plot_fit(without_data(c["C1"])), "holds no data of tests"),
        (lambda c, r: ph.plot_class_probability(DATA), "lacks 'class_probability'"),
        (lambda c, r: ph.plot_class_probability({"A": r, "B": r.head(1)}), "differ in their"),
        (lambda c, r: ph.plot_class_probability(r, none_below=1), "none_below is 1; expected"),
    ],
)
def test_wrong_input_of_figures_is_refused(classes, result, call, message):
    with pytest.raises(ValueError, match=message):
        call(classes, result)
