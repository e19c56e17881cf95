"""Figures show what the results say, name units, and call simulated data simulated."""

import subprocess
import sys

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr

import pymc_hyperelastic as ph
from pymc_hyperelastic.plots.style import PALETTE, rounded_probability

mpl.use("Agg")

SEED = 20240501  # any would do; the draws below stand for a sampled posterior

# Of the 500 draws in a mode, a share of one half has a standard error of 2 %; and kernels widen a
# region, so that some more are inside.
SHARE_TOLERANCE = 0.09

DATA = ph.load_dataset("simulated_sheep_aorta")
MEASURED = ph.load_dataset("murine_pulmonary_artery")


def fitted_class(mu, alpha, data, energy="Ogden", draws=500, chains=2):
    """What is stored of a class whose posterior has the modes ``(mu, ±alpha)``."""
    rng = np.random.default_rng(SEED)
    sign = np.where(np.arange(draws) % 2, -1, 1)
    shift = rng.normal(size=(chains, draws))
    posterior = {
        "mu": mu + 0.5 * shift,
        "alpha": sign * (alpha - 0.05 * shift + 0.03 * rng.normal(size=shift.shape)),
    }
    tree = xr.DataTree.from_dict(
        {
            "posterior": xr.Dataset(
                {name: (("chain", "draw"), values) for name, values in posterior.items()},
                {"chain": range(chains), "draw": range(draws)},
            ),
            "observed_data": data[["pressure"]].reset_coords(drop=True),
            "constant_data": data.drop_vars("pressure"),
        }
    )
    tree.attrs = {
        "strain_energy": energy,
        "units": '{"mu": "kPa", "alpha": ""}',
        "priors": '{"mu": ["Uniform", [0.0, 100.0]], "alpha": ["Uniform", [-40.0, 40.0]]}',
    }
    return tree


@pytest.fixture(scope="module")
def classes():
    return xr.DataTree.from_dict(
        {
            name: fitted_class(mu, alpha, ph.select(DATA, group=name, experiment=[1, 2]))
            for name, mu, alpha in (("C1", 34.0, 6.7), ("C2", 44.0, 7.1))
        }
    )


@pytest.fixture
def result():
    probability = np.array([[1.0, 0.0], [0.9, 0.1], [0.25, 0.75]])
    return xr.Dataset(
        {
            "class_probability": (("test", "class_label"), probability),
            "class_probability_se": (("test", "class_label"), [[1e-9] * 2, [0.01] * 2, [0.05] * 2]),
        },
        {
            "class_label": ["C1", "C2"],
            "specimen": ("test", ["S1", "S2", "S4"]),
            "experiment": ("test", [3, 3, 3]),
            "group": ("test", ["C1", "C1", "C2"]),
        },
        {"strain_energy": "Ogden", "simulated": 1},
    )


def drawn(figure, function):
    """All elements of one kind that the backend "none" collected."""
    panels = figure.viz["plot"]
    panels = panels.dataset.to_array() if isinstance(panels, xr.DataTree) else panels
    return [
        element
        for panel in panels.values.ravel()
        for element in panel
        if element["function"] == function
    ]


def texts(figure, function):
    return [element["string"] for element in drawn(figure, function)]


def legend_of(figure):
    figure = figure.get_viz("figure")
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def all_figures(classes, result, **settings):
    return [
        ph.plot_inflation(DATA, **settings),
        ph.plot_parameter_density(classes, **settings),
        ph.plot_pressure_fit(classes, **settings),
        ph.plot_class_probability(result, **settings),
    ]


def test_import_stays_fast():
    """Neither matplotlib nor arviz_plots is imported until a figure is drawn."""
    code = (
        "import sys, pymc_hyperelastic;"
        "print(sorted({'matplotlib', 'arviz_plots'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_simulated_is_named(classes, result):
    """Every figure of simulated data says so in its title, whatever the data are called."""
    for figure in all_figures(classes, result, backend="none"):
        assert "simulated" in figure.get_viz("figure_title")["string"].lower()
    renamed = DATA.assign_attrs(title="Aortas")
    figure = ph.plot_inflation(renamed, backend="none")
    assert figure.get_viz("figure_title")["string"] == "Aortas, SIMULATED data"
    measured = DATA.assign_attrs(title="Aortas", simulated=0)
    figure = ph.plot_pressure_fit(classes, measured, backend="none")  # the posterior is simulated
    assert figure.get_viz("figure_title")["string"] == "Ogden, Aortas, SIMULATED data"


def test_measured_is_not_called_simulated():
    """Figures of measured data do not call them simulated."""
    figure = ph.plot_inflation(MEASURED, backend="none")
    assert "simulated" not in figure.get_viz("figure_title")["string"].lower()


def test_axes_name_quantity_and_unit(classes, result):
    """Each axis is labelled; whatever has a unit names it."""
    inflation, density, fit, probability = all_figures(classes, result, backend="none")
    assert set(texts(inflation, "xlabel")) == {"internal radius $a$ (mm)"}
    assert texts(inflation, "ylabel") == ["pressure (mmHg)"]
    assert texts(density, "xlabel") == [r"$\mu$ (kPa)"]
    assert texts(density, "ylabel") == [r"$\alpha$"] * 2
    assert set(texts(fit, "xlabel")) == {"internal radius $a$ (mm)"}
    assert texts(fit, "ylabel") == ["pressure (mmHg)", "stiffness d$p$/d$a$ (mmHg/mm)"]
    assert texts(probability, "xlabel") == ["class (Ogden)"]
    assert texts(probability, "ylabel") == ["probability"] * 3


@pytest.mark.parametrize("group_by", ["group", "specimen", "experiment", None])
def test_inflation_shows_every_point(group_by):
    """Whatever the panels are, all measured points are drawn once, in the unit asked for."""
    figure = ph.plot_inflation(DATA, group_by=group_by, pressure_unit="kPa", backend="none")
    panels = {"group": 2, "specimen": 5, "experiment": 3, None: 1}[group_by]
    assert figure.viz["plot"].size == panels
    assert len(drawn(figure, "line")) == DATA.sizes["test"]
    points = [np.stack([e["x"], e["y"]]) for e in drawn(figure, "scatter")]
    points = np.concatenate(points, axis=1)
    points = points[:, ~np.isnan(points[0])]
    expected = np.stack([DATA["radius"].values, DATA["pressure"].values])
    np.testing.assert_allclose(
        points[:, np.lexsort(points)], expected[:, np.lexsort(expected)], rtol=1e-12
    )


def test_inflation_legend():
    """The legend tells specimens by colour and experiments by marker."""
    names = [f"specimen S{i}" for i in range(1, 6)] + [f"experiment {i}" for i in range(1, 4)]
    assert legend_of(ph.plot_inflation(DATA)) == names
    assert legend_of(ph.plot_inflation(MEASURED, group_by=None)) == [
        "group control",
        "group hypertensive",
    ]


def test_one_test_needs_no_legend():
    """One curve is drawn without a legend."""
    figure = ph.plot_inflation(ph.select(DATA, specimen="S1", experiment=1))
    assert legend_of(figure) == []


def contains(contours, x, y):
    """Whether points are inside a filled contour."""
    inside = np.zeros(len(x), dtype=bool)
    for path in contours.get_paths():
        inside ^= path.contains_points(np.stack([x, y], axis=1))
    return inside


@pytest.mark.parametrize("mirror", [1, -1])
@pytest.mark.parametrize("name", ["C1", "C2"])
def test_both_modes_are_in_the_contours(classes, name, mirror):
    """Each mode is drawn, narrow as it is, and the regions hold the probability that they claim."""
    figure = ph.plot_parameter_density(classes, probs=[0.5, 0.95])
    part = 0 if mirror > 0 else 1
    areas = figure.viz["area"]["log_density"].sel(class_label=name, y_part=part, x_part=0).values
    posterior = classes[name]["posterior"]
    mu, alpha = posterior["mu"].values.ravel(), posterior["alpha"].values.ravel()
    mode = mirror * alpha > 0
    for area, prob in zip(areas, (0.95, 0.5), strict=True):
        share = contains(area, mu[mode], alpha[mode]).mean()
        assert abs(share - prob) < SHARE_TOLERANCE
    # A bandwidth of the whole sample would be twenty times as wide as a mode.
    (path,) = [p for p in areas[0].get_paths() if len(p.vertices)]
    assert np.ptp(path.vertices[:, 1]) < 6 * alpha[mode].std()


def test_axis_is_broken_only_where_modes_are_apart(classes):
    """Two classes side by side share an axis; mirrored modes of one class do not."""
    figure = ph.plot_parameter_density(classes, backend="none")
    assert dict(figure.viz["plot"].sizes) == {"y_part": 2, "x_part": 1}
    swapped = ph.plot_parameter_density(classes, var_names=["alpha", "mu"], backend="none")
    assert dict(swapped.viz["plot"].sizes) == {"y_part": 1, "x_part": 2}
    onesided = xr.DataTree.from_dict(
        {name: tree.copy(deep=True) for name, tree in classes.children.items()}
    )
    for tree in onesided.children.values():
        tree["posterior"] = abs(tree["posterior"].to_dataset())
    figure = ph.plot_parameter_density(onesided, backend="none")
    assert dict(figure.viz["plot"].sizes) == {"y_part": 1, "x_part": 1}


def test_strays_have_no_panel(classes):
    """Two draws of a thousand in another mode neither break the axis nor blur the regions."""
    tree = classes["C1"].copy(deep=True)
    posterior = abs(tree["posterior"].to_dataset())
    posterior["alpha"][0, :2] *= -1
    tree["posterior"] = posterior
    figure = ph.plot_parameter_density(tree)
    assert dict(figure.viz["plot"].sizes) == {"y_part": 1, "x_part": 1}
    area = figure.viz["area"]["log_density"].values.ravel()[0]
    (path,) = [p for p in area.get_paths() if len(p.vertices)]
    assert np.ptp(path.vertices[:, 1]) < 6 * posterior["alpha"].values[0, 2:].std()


def test_density_stays_inside_the_prior(classes):
    """No contour passes the end of a uniform prior at which draws pile up."""
    tree = classes["C1"].copy(deep=True)
    pile = 40 - np.random.default_rng(SEED).exponential(1.0, size=(2, 500))
    tree["posterior"] = tree["posterior"].to_dataset().assign(alpha=(("chain", "draw"), pile))
    figure = ph.plot_parameter_density(tree)
    area = figure.viz["area"]["log_density"].sel(y_part=0, x_part=0).values.ravel()[0]
    top = max(path.vertices[:, 1].max() for path in area.get_paths())
    assert 39.9 < top <= 40


def test_classes_have_their_own_colours(classes):
    """A class keeps its colour in each of its figures, and the legend says which."""
    figure = ph.plot_parameter_density(classes)
    assert legend_of(figure) == ["C1", "C2"]
    assert figure.aes["color"]["mapping"].values.tolist() == PALETTE[:2]
    figure = ph.plot_pressure_fit(classes, backend="none")
    assert figure.aes["color"]["mapping"].values.tolist() == PALETTE[:2]


@pytest.mark.compiled
def test_band_contains_the_median_and_the_prediction(classes):
    """Median and band are the quantiles of the predicted pressure and stiffness."""
    figure = ph.plot_pressure_fit(classes, prob=0.8, pressure_unit="kPa", backend="none")
    for variable in ("pressure", "stiffness"):
        for name, tree in classes.children.items():
            band = figure.get_viz("band", variable, class_label=name, tube=0)
            median = figure.get_viz("median", variable, class_label=name, tube=0)
            assert np.all(band["y_bottom"] < median["y"])
            assert np.all(median["y"] < band["y_top"])
            curve = ph.predict_pressure(tree, median["x"])[variable]
            bottom, middle, top = curve.quantile([0.1, 0.5, 0.9], ["chain", "draw"]).values
            np.testing.assert_allclose(band["y_bottom"], bottom, rtol=1e-10)
            np.testing.assert_allclose(median["y"], middle, rtol=1e-10)
            np.testing.assert_allclose(band["y_top"], top, rtol=1e-10)


def test_fit_shows_the_training_data_and_their_slopes(classes):
    """Without data of their own, classes show what trained them, slopes inside each test only."""
    figure = ph.plot_pressure_fit(classes, backend="none")
    training = ph.select(DATA, group="C2", experiment=[1, 2])
    points = figure.get_viz("points", "pressure", class_label="C2")
    known = ~np.isnan(points["x"])
    np.testing.assert_allclose(points["y"][known], training["pressure"].values / ph.mmHg, rtol=1e-6)
    slopes = figure.get_viz("points", "stiffness", class_label="C2")
    known = ~np.isnan(slopes["y"])
    assert known.sum() == training.sizes["obs"] - 2 * training.sizes["test"]
    r, p = (training[name].values[:3] for name in ("radius", "pressure"))
    assert np.isclose(slopes["y"][known][0], (p[2] - p[0]) / (r[2] - r[0]) / ph.mmHg)


def test_fit_of_one_class_to_other_data(classes):
    """One class, data given: each distinct tube has a band of its own, over its own radii."""
    new = ph.select(DATA, experiment=3)
    outer = new["outer_radius"].copy()
    outer[0] = 9.5
    figure = ph.plot_pressure_fit(classes["C1"], new.assign(outer_radius=outer), backend="none")
    assert figure.viz["band"]["pressure"]["specimen"].values.tolist() == ["S1", "S2 and 3 more"]
    assert texts(figure, "title") == []
    with_dict = ph.plot_pressure_fit(classes, {"C1": new, "C2": DATA}, backend="none")
    assert with_dict.viz["band"]["pressure"].sizes["class_label"] == 2


def test_fit_is_dashed_where_it_is_extrapolated(classes):
    """Beyond the training data the median is dashed, and the legend says why."""
    low, high = (float(f(classes["C1"]["constant_data"]["radius"])) for f in (np.min, np.max))
    new = ph.select(DATA, group="C1", experiment=3).copy(deep=True)
    new["radius"] = new["radius"] + (high - new["radius"].max()) + 0.5
    figure = ph.plot_pressure_fit(classes["C1"], new, backend="none")
    where = {"class_label": "C1", "tube": 0}
    for variable in ("pressure", "stiffness"):
        solid, dashed = (figure.get_viz(n, variable, **where) for n in ("median", "extrapolated"))
        known = np.isfinite(solid["y"])
        assert np.array_equal(known, (solid["x"] >= low) & (solid["x"] <= high))
        assert known[0] and not known[-1]
        # It begins where the other ends.
        assert np.isfinite(dashed["y"]).sum() == (~known).sum() + 1
        assert dashed["linestyle"] == "--"
    assert "extrapolated" in legend_of(ph.plot_pressure_fit(classes["C1"], new))
    assert "extrapolated" not in legend_of(ph.plot_pressure_fit(classes["C1"]))


def test_repeated_radii_leave_a_slope_out(classes):
    """Data without slopes (fitted with slope_weight=0) can be shown all the same."""
    data = ph.select(DATA, specimen="S1", experiment=1).copy(deep=True)
    data["radius"][2] = data["radius"][0]
    figure = ph.plot_pressure_fit(classes["C1"], data, backend="none")
    slopes = figure.get_viz("points", "stiffness", class_label="C1")
    assert np.isfinite(slopes["y"]).sum() == data.sizes["obs"] - 2 - 1


def test_bars_are_the_numbers(result):
    """Heights, errors and printed numbers are those of the result; rows name the experiments."""
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
            assert figure.get_viz("number", **here)["string"] == rounded_probability(p)


def test_results_of_several_laws_have_columns(result):
    """A dict of results has a column each; what is not yet classified has no bar."""
    unfinished = result.copy(deep=True)
    unfinished["class_probability"][2] = np.nan
    figure = ph.plot_class_probability({"A": result, "B": unfinished}, backend="none")
    assert figure.viz["plot"].sizes["model"] == 2
    assert texts(figure, "xlabel") == ["class (A)", "class (B)"]
    assert len(drawn(figure, "hist")) == 6 + 4


def test_specimens_without_a_known_group(result):
    """Results by specimen are rows too; a group that is no class is not called the truth."""
    by_specimen = result.drop_vars("experiment").swap_dims(test="specimen")
    by_specimen["group"] = ("specimen", ["unknown"] * 3)
    figure = ph.plot_class_probability(by_specimen.set_coords("group"), backend="none")
    assert texts(figure, "title") == ["S1", "S2", "S4"]


@pytest.mark.parametrize(
    ("probability", "text"), [(0.0, "<0.001"), (1e-9, "<0.001"), (0.25, "0.250"), (1.0, ">0.999")]
)
def test_printed_probabilities(probability, text):
    """No probability is printed as exactly zero or one."""
    assert rounded_probability(probability) == text


def test_figures_can_be_saved_and_edited(classes, result, tmp_path):
    """Each figure is a PlotCollection that saves itself, takes settings and leaves visuals out."""
    for i, figure in enumerate(all_figures(classes, result)):
        figure.add_title("mine")
        figure.savefig(tmp_path / f"{i}.png")
        assert (tmp_path / f"{i}.png").stat().st_size > 5000
        mpl.pyplot.close(figure.get_viz("figure"))
    figure = ph.plot_inflation(
        DATA,
        backend="none",
        visuals={"line": False, "points": {"size": 3}},
        color=["k"],
        figure_kwargs={"figsize": (1, 2)},
    )
    assert not drawn(figure, "line")
    assert {e["size"] for e in drawn(figure, "scatter")} == {3}
    assert {e["facecolor"] for e in drawn(figure, "scatter")} == {"k"}
    assert figure.get_viz("figure")["figsize"] == (1, 2)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda c, r: ph.plot_inflation(3), TypeError, "xarray.Dataset, not int"),
        (lambda c, r: ph.plot_inflation(DATA, group_by="sex"), ValueError, "group_by must be one"),
        (lambda c, r: ph.plot_inflation(DATA, pressure_unit="mm"), ValueError, "pressure_unit"),
        (lambda c, r: ph.plot_inflation(DATA, backend="tv"), ValueError, "backend must be"),
        (lambda c, r: ph.plot_inflation(DATA, visuals={"dot": {}}), ValueError, "no visual.*'dot'"),
        (lambda c, r: ph.plot_parameter_density(DATA), TypeError, "expected the DataTree"),
        (lambda c, r: ph.plot_parameter_density(xr.DataTree()), ValueError, "no posterior"),
        (
            lambda c, r: ph.plot_parameter_density(c, var_names=["mu", "nu"]),
            ValueError,
            r"two different variables .*\['mu', 'alpha'\]",
        ),
        (
            lambda c, r: ph.plot_parameter_density(c, var_names=["mu", "mu"]),
            ValueError,
            "two different variables",
        ),
        (lambda c, r: ph.plot_parameter_density(c, probs=[50]), ValueError, "between 0 and 1"),
        (lambda c, r: ph.plot_pressure_fit(DATA), TypeError, "expected the DataTree"),
        (lambda c, r: ph.plot_pressure_fit(c, prob=94), ValueError, "between 0 and 1"),
        (lambda c, r: ph.plot_pressure_fit(c, {"C1": DATA}), ValueError, "nothing for class 'C2'"),
        (
            lambda c, r: ph.plot_pressure_fit(
                c["C1"].filter(lambda node: node.name == "posterior")
            ),
            ValueError,
            "no inflation data",
        ),
        (lambda c, r: ph.plot_class_probability([r]), TypeError, "result of ph.classify"),
        (lambda c, r: ph.plot_class_probability(DATA), ValueError, "lacks 'class_probability'"),
        (
            lambda c, r: ph.plot_class_probability({"A": r, "B": r.isel(test=[0])}),
            ValueError,
            "differ in their experiments",
        ),
    ],
)
def test_wrong_input(classes, result, call, error, message):
    """Wrong input raises one error that says what is wrong."""
    with pytest.raises(error, match=message):
        call(classes, result)
