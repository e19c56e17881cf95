"""plot_fit: panels, bands, data, slopes, residuals, axes."""

import fits
import numpy as np
import pytest
from figures import (
    DATA,
    HELD,
    HELD_STRETCHES,
    MU,
    VARIED,
    assert_band,
    both_kinds,
    curve_at,
    drifting,
    elements,
    fitted,
    legend_texts,
    numbers_touch,
    straight_lines,
    texts,
)

import pymc_hyperelastic as ph
from pymc_hyperelastic.plots.style import with_margin

# Medians of the figure and of the predictions are the same numbers.
ROUNDING = 1e-10
HERE = {"class_label": "posterior", "specimen": "S1"}


def drawn(figure, variable="pressure", visual="points", **where):
    """Return the finite y of points in these panels, in the order of the data."""
    points = figure.get_viz(visual, variable, **where)
    parts = [points] if isinstance(points, dict) else [p for p in points.values.ravel() if p]
    y = np.concatenate([np.ravel(part["y"]) for part in parts])
    return y[np.isfinite(y)]


def test_training_data_and_their_slopes_are_shown(few_draws):
    settings = {"backend": "none", "pressure_unit": "mmHg"}
    figure = ph.plot_fit(few_draws, **settings)
    training = ph.select(DATA, group="C2", experiment=[1, 2])
    names = figure.viz["plot"]["specimen"].values.tolist()
    assert names == list(dict.fromkeys(ph.select(DATA, experiment=1)["specimen"].values.tolist()))
    of_c2 = [
        {"class_label": "C2", "specimen": name} for name in names if name in training["specimen"]
    ]
    pressures = np.concatenate([drawn(figure, **where) for where in of_c2])
    np.testing.assert_allclose(pressures, training["pressure"].values / ph.mmHg, rtol=1e-6)
    figure = ph.plot_fit(few_draws, signal="stiffness", **settings)
    slopes = np.concatenate([drawn(figure, "stiffness", **where) for where in of_c2])
    expected = []
    for test in range(training.sizes["test"]):
        r, p = (training[n].values[training["test"].values == test] for n in ("radius", "pressure"))
        expected += ((p[2:] - p[:-2]) / (r[2:] - r[:-2]) / ph.mmHg).tolist()
    np.testing.assert_allclose(slopes, expected)


def test_each_specimen_of_new_data_has_the_band_of_its_tube(few_draws):
    new, tree = ph.select(DATA, experiment=3), few_draws["C1"]
    outer = new["outer_radius"].copy()
    outer[0] = 9.5
    new = new.assign(outer_radius=outer)
    settings = {"ci_prob": 0.8, "backend": "none", "pressure_unit": "mmHg"}
    for variable in ("pressure", "stiffness"):
        figure = ph.plot_fit(tree, new, signal=variable, **settings)
        for test, b in enumerate(outer.values):
            where = {"specimen": new["specimen"].values[test].item(), "curve": 0}
            where["group"] = new["group"].values[test].item()
            x = figure.get_viz("median", variable, **where)["x"]
            radius = new["radius"].values[new["test"].values == test]
            assert x[[0, -1]].tolist() == [radius.min(), radius.max()]
            curves = ph.predict_pressure(tree, x, tube=ph.Tube(outer_radius=b)) / ph.mmHg
            assert_band(figure, variable, curves[variable], 0.8, **where)


def test_median_is_dashed_beyond_the_training_data(few_draws):
    tree, new = few_draws["C1"], ph.select(DATA, group="C1", experiment=3)
    new = new.assign(radius=new["radius"] + 0.5)
    where = {"class_label": "C1", "specimen": "S1", "curve": 0}
    for variable in ("pressure", "stiffness"):
        figure = ph.plot_fit(tree, new, signal=variable, backend="none")
        solid, dashed = (figure.get_viz(n, variable, **where) for n in ("median", "extrapolated"))
        known = solid["x"] <= float(tree["constant_data"]["radius"].max())
        np.testing.assert_array_equal(np.isfinite(solid["y"]), known)
        # The dashed line begins where the solid one ends.
        assert 1 < np.isfinite(dashed["y"]).sum() == (~known).sum() + 1


def test_outlying_slopes_are_diamonds_at_the_axis():
    data = straight_lines(2)
    plain = ph.plot_fit(fitted(data), signal="stiffness")
    ends = plain.get_viz("plot", "stiffness", **HERE).get_ylim()
    radius = data["radius"]
    radius[14] = radius[12]  # no slope
    radius[[4, 5, 11]] = [radius[3] + 5e-6, radius[3] + 1e-5, radius[9] - 1e-5]
    figure = ph.plot_fit(fitted(data), signal="stiffness")
    low, high = figure.get_viz("plot", "stiffness", **HERE).get_ylim()
    assert high - low < 5 * (ends[1] - ends[0])
    counts = [text for text in legend_texts(figure) if "slopes" in text]
    assert counts == ["2 of 11 slopes beyond the axis"]
    figure = ph.plot_fit(fitted(data), signal="stiffness", backend="none")
    beyond = [*drawn(figure, "stiffness", "beyond"), high, low]
    assert sorted(beyond) == pytest.approx([low, low, high, high])


def test_axis_reaches_twice_the_largest_datum_beyond_the_data():
    data = straight_lines(2)
    stiff = fitted(data, mu=np.array([[2.9e4, 3e4, 3.1e4]]))
    data["axial_force"] = ("obs", 1e3 * data["pressure"].values, {"units": "mN"})
    figure = ph.plot_fit(stiff, data)
    pressure = data["pressure"].values
    ends = figure.get_viz("plot", "pressure", **HERE).get_ylim()
    assert ends == pytest.approx(with_margin(pressure.min(), 3 * pressure.max()))
    assert "bands go on beyond the axis" in legend_texts(figure)
    forces = ph.plot_fit(stiff, data, signal="axial_force")
    ends = forces.get_viz("plot", "axial_force", **HERE).get_ylim()
    assert np.abs(ends).max() < 4 * data["axial_force"].max()
    # The axis fits the band if there are no data.
    assert "bands go on beyond the axis" not in legend_texts(
        ph.plot_fit(stiff, signal="axial_force")
    )


@pytest.mark.parametrize(
    ("name", "variable"),
    [("axial_force", "extension_force"), ("radius", "extension_radius")],
)
def test_bands_of_extension_tests_are_medians_of_the_prediction(name, variable):
    data = both_kinds()
    tree = fitted(data, mu=[[0.9 * MU, MU, 1.1 * MU]])
    figure = ph.plot_fit(tree, signal=variable, backend="none")
    for i, held in enumerate(HELD):
        where = {"axial_stretch": VARIED[i], **HERE}
        median = figure.get_viz("median", variable, **where, curve=0)
        known = np.isfinite(median["x"])
        stretch = median["x"][known]
        np.testing.assert_allclose(stretch[[0, -1]], [1.1, 1.4], rtol=ROUNDING)
        exact = curve_at(drifting(held, stretch), stretch, 0.9 * MU, MU, 1.1 * MU)
        expected = exact[name].median(["chain", "draw"])
        np.testing.assert_allclose(median["y"][known], expected, rtol=ROUNDING)
        dots = figure.get_viz("points", variable, **where)
        assert dots["facecolor"] == median["color"]
        known = np.isfinite(dots["x"])
        own = data["experiment"].values[data["test"].values] == f"held {held:g}"
        np.testing.assert_array_equal(dots["x"][known], data["axial_stretch"].values[own])
        np.testing.assert_array_equal(dots["y"][known], data[name].values[own])


def test_extension_tests_have_no_slopes():
    figure = ph.plot_fit(fitted(both_kinds()), signal="stiffness", backend="none")
    slopes = elements(figure, "scatter", "stiffness")
    assert sum(np.isfinite(e["y"]).sum() for e in slopes) == len(HELD_STRETCHES) * 4


def test_draws_that_do_not_reach_a_pressure_are_counted_in_a_warning():
    tree = fitted(both_kinds(kinds=("extension",)), mu=[[0.1 * MU, MU]])
    with pytest.warns(UserWarning, match="1 do not reach the pressure at 50 of 50 axial stretches"):
        figure = ph.plot_fit(tree, signal="extension_force", backend="none")
    median = figure.get_viz("median", "extension_force", axial_stretch=VARIED[1], curve=0, **HERE)
    stretch = median["x"][np.isfinite(median["x"])]
    exact = curve_at(drifting(HELD[1], stretch), stretch)["axial_force"].values[0, 0]
    np.testing.assert_allclose(median["y"][np.isfinite(median["x"])], exact, rtol=ROUNDING)


def test_specimens_that_differ_have_curves_of_their_own():
    tree = fits.fit("hierarchical")["C1"].isel(draw=slice(200))
    figure = ph.plot_fit(tree, backend="none")
    assert "typical" not in figure.get_viz("figure_title")["string"]
    for name in ("S1", "S3"):
        where = {"class_label": "C1", "specimen": name, "curve": 0}
        x = figure.get_viz("median", "pressure", **where)["x"]
        curves = ph.predict_pressure(tree, x, specimen=name)
        assert_band(figure, "pressure", curves["pressure"], 0.95, **where)
    # A specimen that the class does not know has the curve of the typical one.
    new = ph.select(DATA, specimen="S4")
    figure = ph.plot_fit(tree, new, backend="none")
    assert "typical specimen" in figure.get_viz("figure_title")["string"]
    where = {"class_label": "C1", "specimen": "S4", "curve": 0}
    x = figure.get_viz("band", "pressure", **where)["x"]
    with pytest.warns(UserWarning, match="extrapolated"):
        typical = ph.predict_pressure(tree, x)["pressure"]
    low = typical.quantile(0.025, ["chain", "draw"])
    np.testing.assert_allclose(figure.get_viz("band", "pressure", **where)["y_bottom"], low)


def test_panels_are_in_the_order_of_groups_and_at_most_24():
    data = straight_lines(30)
    groups = np.array(["B", "A"])[np.arange(30) % 2]
    figure = ph.plot_fit(fitted(data.assign_coords(group=("test", groups))), backend="none")
    plots = figure.viz["plot"]["pressure"]
    assert plots.dims == ("group", "specimen")
    assert plots["group"].values.tolist() == ["B", "A"]
    shown = plots.notnull().sum("specimen")
    assert shown.values.tolist() == [12, 12]
    assert "24 of 30 specimens" in figure.get_viz("figure_title")["string"]
    figure = ph.plot_fit(fitted(data), specimens=["S30", "S2"], backend="none")
    assert texts(figure, "title") == ["S2", "S30"]
    assert "2 of 30 specimens" in figure.get_viz("figure_title")["string"]


def test_many_stretches_are_named_by_experiment_and_groups_have_a_colour():
    data = straight_lines(4, (1.0, 1.2))
    stretch = data["axial_stretch"] + 0.01 * np.arange(8)
    groups = np.repeat(["A", "B"], 4)
    data = data.assign(axial_stretch=stretch).assign_coords(group=("test", groups))
    figure = ph.plot_fit(fitted(data))
    names = ["experiment 1", "experiment 2", "group A", "group B"]
    assert legend_texts(figure)[:4] == names


def test_axes_are_shared_unless_a_panel_would_be_narrow():
    data = straight_lines(3)
    shared = ph.plot_fit(fitted(data))
    limits = [axes.get_xlim() for axes in shared.get_viz("figure").axes]
    assert len(set(limits)) == 1
    data["radius"][-8:] = data["radius"][-8:] + 10
    apart = ph.plot_fit(fitted(data))
    limits = [axes.get_xlim() for axes in apart.get_viz("figure").axes]
    assert len(set(limits)) == 2  # the first two panels have equal data
    # Numbers stand at each axis that is not shared.
    for axes in apart.get_viz("figure").axes:
        assert axes.xaxis.get_ticklabels()[0].get_visible()


def test_numbers_below_narrow_panels_do_not_touch():
    data = straight_lines(4)
    # The radii of a stiff tube hardly differ, and their numbers have many digits.
    data["radius"] = 7.0755 + (data["radius"] - 7.1) / 220
    figure = ph.plot_fit(fitted(data))
    assert not any(numbers_touch(axes) for axes in figure.get_viz("figure").axes)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"signal": "force"}, "signal is 'force'; expected one of"),
        ({"signal": "extension_force"}, "no extension tests"),
        ({"specimens": ["S9"]}, "no specimen 'S9'"),
        ({"specimens": []}, "specimens is empty"),
    ],
)
def test_impossible_signals_and_specimens_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        ph.plot_fit(fitted(straight_lines(2)), backend="none", **settings)
