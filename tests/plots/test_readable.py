"""Figures can be read: nothing is cut off, no two things look the same, axes fit what they show."""

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
import xarray as xr

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.natural_scale import NaturalScale

mpl.use("Agg")

SEED = 20261122  # any would do
TUBE = {"inner_radius": 7.0, "outer_radius": 9.0}
STRETCHES = (1.0, 1.2, 1.4)


@pytest.fixture(autouse=True)
def closed():
    yield
    mpl.pyplot.close("all")


def study(specimens=16, stretches=(1.0,), groups=("C1",), of_diameter=False):
    """Curves of specimens, each at these axial stretches: straight lines, which no figure minds."""
    rng = np.random.default_rng(SEED)
    tables = []
    for i in range(specimens):
        for experiment, stretch in enumerate(stretches, start=1):
            radius = np.linspace(7.1, 9.3, 8) / np.sqrt(stretch)
            pressure = 6 * (radius - radius[0] + 0.1) * stretch**3 + 0.1 * rng.random(8)
            labels = {"specimen": f"S{i + 1}", "group": groups[i % len(groups)]}
            labels |= {"experiment": experiment, "stretch": stretch, "pressure": pressure}
            outer = np.sqrt(radius**2 + (9.0**2 - 7.0**2) / stretch)
            read = {"outer_diameter": 2 * outer} if of_diameter else {"radius": radius}
            tables.append(pd.DataFrame(labels | read))
    measured = {"measured": "outer_diameter"} if of_diameter else {}
    frame = pd.concat(tables, ignore_index=True)
    return ph.inflation_data(frame, **TUBE, axial_stretch="stretch", **measured)


def fitted(data):
    """What is stored of a class of a neo-Hookean material."""
    posterior = {"mu": (("chain", "draw"), 30 + np.random.default_rng(SEED).normal(size=(1, 100)))}
    tree = xr.DataTree.from_dict(
        {
            "posterior": xr.Dataset(posterior),
            "observed_data": data[["pressure"]].reset_coords(drop=True),
            "constant_data": data.drop_vars("pressure"),
        }
    )
    tree.attrs = {"strain_energy": "NeoHookean"}
    return tree


def answers(specimens=16, **variables):
    """A result of classify, of specimens that are of the first class."""
    probability = np.tile([0.9, 0.1], (specimens, 1))
    dims = ("specimen", "class_label")
    tables = {"class_probability": probability, "class_probability_se": 0.2 + 0 * probability}
    tables |= variables
    return xr.Dataset(
        {k: (dims[: np.ndim(v)], v) for k, v in tables.items()},
        {"specimen": [f"S{i + 1}" for i in range(specimens)], "class_label": ["C1", "C2"]},
    )


def with_variability(energy, spread):
    """What is stored of a class whose specimens differ so much, and (coordinate, draw) of them."""
    rng = np.random.default_rng(SEED)
    names = NaturalScale(energy).names
    centre = np.array([-2.7, 1.9])[: len(names)]
    location = centre + 0.05 * rng.standard_normal((1, 1000, len(names)))
    ones = np.ones((1, 1000))
    posterior = xr.Dataset(
        {
            "location": (("chain", "draw", "coordinate"), location),
            "spread": (("chain", "draw", "coordinate"), spread * np.ones_like(location)),
            "correlation": (
                ("chain", "draw", "coordinate", "coordinate_2"),
                np.broadcast_to(np.eye(len(names)), (1, 1000, len(names), len(names))),
            ),
            "noise_sd": (("chain", "draw"), 0.1 * ones),
            "noise_spread": (("chain", "draw"), 0.3 * ones),
        },
        {"coordinate": names, "coordinate_2": names},
    )
    tree = xr.DataTree.from_dict({"posterior": posterior})
    tree.attrs = {"strain_energy": energy.name, "reference_stress": "20.0"}
    members = location[0] + spread * rng.standard_normal((1000, len(names)))
    return tree, members.T


def own_tubes(data):
    """The same specimens, each on a tube of its own."""
    outer = data["outer_radius"] + 0.02 * np.arange(data.sizes["test"])
    return data.assign(outer_radius=outer.assign_attrs(data["outer_radius"].attrs))


def drawn(figure, function):
    """What the backend "none" collected of one kind, in all panels."""
    panels = figure.viz["plot"]
    panels = panels.dataset.to_array() if isinstance(panels, xr.DataTree) else panels
    return [e for panel in panels.values.ravel() for e in panel if e["function"] == function]


def legend_texts(figure):
    return [t.get_text() for n in figure.get_viz("figure").legends for t in n.get_texts()]


@pytest.mark.parametrize(
    "draw",
    [
        lambda **s: ph.plot_inflation(study(stretches=STRETCHES), **s),
        lambda **s: ph.plot_inflation(study(groups=("a long name", "C2")), **s),
        lambda **s: ph.plot_inflation(study(), group_by=None, **s),
        lambda **s: ph.plot_pressure_fit(fitted(own_tubes(study())), **s),
        lambda **s: ph.plot_pressure_fit(fitted(study(stretches=STRETCHES)), **s),
        lambda **s: ph.plot_class_probability(
            answers(p_value=np.full((16, 2), 0.5)), undecided_below=0.8, none_below=0.05, **s
        ),
    ],
)
def test_legends_are_inside_the_figure(draw):
    """With 16 specimens the whole legend is in the figure, which gives it room of its own."""
    figure = draw()
    canvas = figure.get_viz("figure")
    canvas.canvas.draw()
    (legend,) = canvas.legends
    box = legend.get_window_extent()
    assert box.x0 >= 0 and box.y0 >= 0
    assert box.x1 <= canvas.bbox.x1 and box.y1 <= canvas.bbox.y1
    for axes in canvas.axes:
        assert not axes.get_window_extent().overlaps(box)
        # An inch, in which the curves can be told from each other, is left of every panel.
        assert axes.get_window_extent().width > canvas.dpi


def test_a_size_that_is_asked_for_is_kept():
    """A legend makes room in a figure, unless its user says how large that is."""
    figure = ph.plot_inflation(study(), figure_kwargs={"figsize": (9, 3)})
    assert figure.get_viz("figure").get_size_inches().tolist() == [9, 3]
    grown = ph.plot_inflation(study()).get_viz("figure").get_size_inches()
    assert grown[0] > 5.2


@pytest.mark.parametrize("specimens", [16, 40])
def test_no_two_specimens_look_the_same(specimens):
    """Each specimen of a panel has its own colour, line style and marker together."""
    figure = ph.plot_inflation(study(specimens), backend="none")
    lines = [(e["color"], e["linestyle"]) for e in drawn(figure, "line")]
    dots = [e["marker"] for e in drawn(figure, "scatter")]
    assert len(set(zip(lines, dots, strict=True))) == specimens
    if specimens <= 21:  # seven colours, three line styles
        assert len(set(lines)) == specimens
    labels = legend_texts(ph.plot_inflation(study(specimens)))
    assert labels == [f"specimen S{i + 1}" for i in range(specimens)]


def test_axial_stretches_are_told_apart_in_the_data():
    """Markers are axial stretches; of a single specimen, colours are."""
    figure = ph.plot_inflation(study(stretches=STRETCHES), backend="none")
    assert len({e["marker"] for e in drawn(figure, "scatter")}) == len(STRETCHES)
    names = [f"axial stretch {s:g}" for s in STRETCHES]
    assert legend_texts(ph.plot_inflation(study(stretches=STRETCHES)))[-3:] == names
    one = study(1, STRETCHES)
    assert len({e["color"] for e in drawn(ph.plot_inflation(one, backend="none"), "line")}) == 3
    assert legend_texts(ph.plot_inflation(one)) == names
    figure = ph.plot_inflation(study(2, STRETCHES), group_by="axial_stretch", backend="none")
    assert [e["string"] for e in drawn(figure, "title")] == names


def test_stretches_of_each_specimen_are_its_experiments():
    """Where each specimen has axial stretches of its own, markers tell their order."""
    data = study(4, STRETCHES)
    data["axial_stretch"] = data["axial_stretch"] + 0.001 * np.arange(12)
    assert legend_texts(ph.plot_inflation(data))[-3:] == [f"experiment {i}" for i in (1, 2, 3)]


def test_cycles_are_all_drawn():
    """Curves that have the same labels do not take each other's place."""
    data = study(1, (1.0, 1.0))
    data["experiment"] = ("test", [1, 1])
    figure = ph.plot_inflation(data, backend="none")
    assert len(drawn(figure, "line")) == 2


def test_band_has_the_colour_of_its_data():
    """Each axial stretch has a colour, that of its band, its median and its data in both panels."""
    tree = fitted(study(3, STRETCHES))
    figure = ph.plot_pressure_fit(tree, backend="none")
    for variable in ("pressure", "stiffness"):
        where = {"class_label": "posterior"}
        colours = []
        for stretch in ("1", "1.2", "1.4"):
            dots = figure.get_viz("points", variable, axial_stretch=stretch, **where)
            median, band = (
                figure.get_viz(name, variable, axial_stretch=stretch, tube=0, **where)
                for name in ("median", "band")
            )
            assert dots["facecolor"] == median["color"] == band["color"]
            colours.append((median["color"], dots["marker"]))
            known = np.isfinite(dots["x"])
            assert known.sum() == 3 * 8 if variable == "pressure" else known.any()
        assert len({colour for colour, _ in colours}) == len({m for _, m in colours}) == 3
    names = [f"axial stretch {s:g}" for s in STRETCHES]
    assert legend_texts(ph.plot_pressure_fit(tree))[:3] == names


def test_bands_of_tubes_are_told_apart():
    """Where each specimen has its own tube, each has its own look, and the legend names it."""
    tree = fitted(own_tubes(study()))
    figure = ph.plot_pressure_fit(tree, backend="none")
    lines = {(e["color"], e["linestyle"]) for e in drawn(figure, "line")}
    assert len(lines) == 16
    names = legend_texts(ph.plot_pressure_fit(tree))
    assert names[:16] == [f"specimen S{i + 1}" for i in range(16)]


def test_an_outlying_slope_does_not_flatten_the_others():
    """The axis of slopes holds bands and nearly all data; arrowheads stand for the rest."""
    data = study(2)
    plain = ph.plot_pressure_fit(fitted(data))
    ends = plain.get_viz("plot", "stiffness", class_label="posterior").get_ylim()
    data["radius"][5] = data["radius"][3] + 1e-5
    data["radius"][4] = data["radius"][3] + 5e-6
    data["radius"][11] = data["radius"][9] - 1e-5
    figure = ph.plot_pressure_fit(fitted(data))
    low, high = figure.get_viz("plot", "stiffness", class_label="posterior").get_ylim()
    assert high - low < 5 * (ends[1] - ends[0])
    counts = [text for text in legend_texts(figure) if "slopes" in text]
    assert counts == ["1 of 12 slopes above the axis", "1 of 12 slopes below the axis"]
    figure = ph.plot_pressure_fit(fitted(data), backend="none")
    for name, end in (("above", high), ("below", low)):
        arrow = figure.get_viz(name, "stiffness", class_label="posterior")
        assert np.nanmax(arrow["y"]) == np.nanmin(arrow["y"]) == pytest.approx(end)
    assert not any("slopes" in text for text in legend_texts(plain))


def test_data_are_seen_beside_wide_bands():
    """A band a thousand times as high as the data goes on beyond the axis; the legend says so."""
    data = study(2)
    tree = fitted(data)
    data["axial_force"] = ("obs", 1e3 * data["pressure"].values, {"units": "mN"})
    stiff = tree.copy()
    stiff["posterior"] = xr.DataTree(tree["posterior"].to_dataset() * 1e3)
    pressure, force = ph.plot_pressure_fit(stiff), ph.plot_axial_force(stiff, data)
    for figure, name, highest in (
        (pressure, "pressure", data["pressure"].max() / ph.mmHg),
        (pressure, "stiffness", 7 / ph.mmHg),  # in the table the pressure rises by 6 kPa/mm
        (force, "axial_force", data["axial_force"].max()),
    ):
        low, high = figure.get_viz("plot", name, class_label="posterior").get_ylim()
        assert max(abs(low), abs(high)) < 4 * highest
        assert "bands go on beyond the axis" in legend_texts(figure)
    # What nobody measured leaves its band the axis.
    whole = [ph.plot_pressure_fit(tree), ph.plot_axial_force(stiff)]
    assert not [f for f in whole if "bands go on beyond the axis" in legend_texts(f)]


def test_decisions_and_p_values_are_shown():
    """Each panel says what was decided; diamonds are the p-values, lines the limits."""
    decided = ["C1", "undecided", "none of these", ""]
    p_value = np.array([[0.5, 0.2], [0.9, 0.4], [0.01, np.nan], [np.nan, np.nan]])
    result = answers(4, p_value=p_value, decision=decided)
    result["class_probability"][3] = np.nan
    limits = {"undecided_below": 0.8, "none_below": 0.05}
    figure = ph.plot_class_probability(result, backend="none", **limits)
    titles = [e["string"] for e in drawn(figure, "title")]
    assert titles == ["S1 → C1", "S2 → undecided", "S3 → none of these", "S4 → not classified"]
    colours = [e["color"] for e in drawn(figure, "title")]
    assert colours[0] not in colours[1:]
    shown = [e["y"].item() for e in drawn(figure, "scatter")]
    assert shown == p_value[np.isfinite(p_value)].tolist()
    assert figure.get_viz("p_number", specimen="S3", class_label="C1")["string"] == "0.010"
    for name, limit in limits.items():
        assert figure.get_viz(name, specimen="S2")["y"] == limit
    texts = legend_texts(ph.plot_class_probability(result, **limits))
    assert texts == ["probability", "p-value", "undecided_below = 0.8", "none_below = 0.05"]
    stored = ph.plot_class_probability(result.assign_attrs(limits), backend="none")
    assert stored.get_viz("none_below", specimen="S2")["y"] == 0.05
    assert "none_below" not in ph.plot_class_probability(answers(4), backend="none").viz.children
    several = ph.plot_class_probability({"A": result, "B": result}, backend="none")
    assert [e["string"] for e in drawn(several, "title")][:2] == ["S1\n→ C1", "\n→ C1"]


def test_a_limit_is_a_probability():
    """A limit that classify would refuse is refused."""
    with pytest.raises(ValueError, match="none_below is 5; expected a number from 0 to 1"):
        ph.plot_class_probability(answers(), none_below=5)


def test_probability_axes_end_at_one():
    """No probability is above 1, and no axis of one is; numbers stand inside."""
    figure = ph.plot_class_probability(answers(16))
    for panel in figure.viz["plot"].values.ravel():
        assert panel.get_ylim() == (0, 1)
        assert all(0 <= text.get_position()[1] <= 1 for text in panel.texts)
    scores = ph.score_probabilities(answers(16), ["C1"] * 16)
    figure = ph.plot_reliability(scores)
    for panel in figure.viz["plot"].sel(part="diagram").values.ravel():
        assert panel.get_xlim() == panel.get_ylim() == (0, 1)


def test_many_answers_fill_a_page():
    """Panels of a single result stand in columns when they are many."""
    height = ph.plot_class_probability(answers(16)).get_viz("figure").get_size_inches()[1]
    assert height < 12


def test_outer_diameters_are_not_called_radii():
    """Measured outer diameters are drawn as such; what was computed from them is called so."""
    data = study(2, STRETCHES, of_diameter=True)
    figure = ph.plot_inflation(data, backend="none")
    assert {e["string"] for e in drawn(figure, "xlabel")} == {"outer diameter $d_o$ (mm)"}
    x = np.concatenate([e["x"] for e in drawn(figure, "scatter")])
    np.testing.assert_array_equal(np.sort(x), np.sort(data["outer_diameter"].values))
    figure = ph.plot_pressure_fit(fitted(data), backend="none")
    (label,) = {e["string"] for e in drawn(figure, "xlabel")}
    assert label == "internal radius $a$ (mm)\nfrom the measured outer diameter"


def test_new_specimens_of_a_class_are_inside_the_dashed_line():
    """The dashed line holds new specimens of the class, which differ more than its location."""
    tree, members = with_variability(ph.Ogden(), 0.2)
    figure = ph.plot_parameter_density(tree, probs=[0.5, 0.8])
    (line,) = figure.viz["new"]["log_density"].values.ravel()
    values = NaturalScale(ph.Ogden()).numbers(list(members))
    points = np.stack([values["mu"], values["alpha"]], axis=1)
    inside = np.logical_or.reduce([path.contains_points(points) for path in line.get_paths()])
    # Of 1000 draws the share has a standard error of 1.3 %; kernels widen the region.
    assert abs(inside.mean() - 0.8) < 0.06
    filled = figure.viz["area"]["log_density"].values.ravel()[0].get_paths()[0]
    assert np.ptp(filled.vertices[:, 0]) < 0.6 * np.ptp(line.get_paths()[0].vertices[:, 0])
    assert legend_texts(figure) == ["posterior", "typical specimen", "new specimen, 80 %"]
    labels = [e["string"] for e in drawn(ph.plot_parameter_density(tree, backend="none"), "xlabel")]
    assert labels == [r"$\mu$ (kPa)"]


@pytest.mark.parametrize("spread", [0.1, 1.5])
def test_regions_of_a_class_fill_their_axes(spread):
    """However wide a class is: its regions are seen, and hold nothing that no material is."""
    tree, _ = with_variability(ph.Ogden(), spread)
    figure = ph.plot_parameter_density(tree)
    axes = figure.get_viz("plot", "log_density")
    (line,) = figure.viz["new"]["log_density"].values.ravel()
    corners = np.concatenate([path.vertices for path in line.get_paths() if len(path.vertices)])
    assert (corners > 0).all()
    for log, ends, place in (
        (axes.get_xscale() == "log", axes.get_xlim(), corners[:, 0]),
        (axes.get_yscale() == "log", axes.get_ylim(), corners[:, 1]),
    ):
        assert log == (spread > 1)
        assert np.ptp(np.log(place)) > 0.5 * np.ptp(np.log(ends))


def test_class_of_one_parameter_shows_location_and_spread():
    """By default nothing that nobody asked for, such as noise, is on an axis."""
    tree, _ = with_variability(ph.NeoHookean(), 0.2)
    figure = ph.plot_parameter_density(tree, backend="none")
    labels = [e["string"] for f in ("xlabel", "ylabel") for e in drawn(figure, f)]
    assert labels == ["location[log_reference_strain]", "spread[log_reference_strain]"]
    assert "new" not in figure.viz.children
    tree, _ = with_variability(ph.Ogden(), 0.2)
    figure = ph.plot_parameter_density(
        tree, var_names=["spread[log_reference_strain]", "noise_sd"], backend="none"
    )
    assert [e["string"] for e in drawn(figure, "ylabel")] == ["noise_sd"]


def test_axial_force_is_beside_its_data():
    """Measured forces lie in the figure, each stretch in the colour of its band."""
    data = study(2, STRETCHES)
    tree = fitted(data)
    bare = ph.plot_axial_force(tree, backend="none")
    assert "points" not in bare.viz.children
    assert "data (of that colour)" not in legend_texts(ph.plot_axial_force(tree))
    force = np.arange(data.sizes["obs"], dtype=float)
    force[3] = np.nan
    data["axial_force"] = ("obs", force, {"units": "mN"})
    figure = ph.plot_axial_force(tree, data, prob=0.8, backend="none")
    where = {"axial_stretch": "1.2", "class_label": "posterior"}
    median = figure.get_viz("median", tube=0, **where)
    predicted = ph.predict_axial_force(tree, median["x"], axial_stretch=1.2)["axial_force"]
    np.testing.assert_allclose(median["y"], predicted.median(["chain", "draw"]), rtol=1e-10)
    dots = figure.get_viz("points", **where)
    assert dots["facecolor"] == median["color"]
    shown = np.concatenate([e["y"] for e in drawn(figure, "scatter")])
    np.testing.assert_array_equal(np.sort(shown[np.isfinite(shown)]), np.delete(force, 3))
    assert [e["string"] for e in drawn(figure, "ylabel")] == ["reduced axial force (mN)"]


def test_properties_and_stresses_are_those_that_are_predicted():
    """Bands are quantiles of the predictions, in panels that name quantity and unit."""
    tree = fitted(study(2))
    pressure, at = [10.0, 20.0], {"pressure_unit": "mmHg"}
    figure = ph.plot_elastic_properties(tree, pressure, prob=0.8, backend="none")
    table = ph.tube_properties(tree, pressure, **at)
    for name in ("compliance", "pulse_wave_velocity"):
        band = figure.get_viz("band", name, class_label="posterior")
        low, high = table[name].quantile([0.1, 0.9], ["chain", "draw"]).values
        np.testing.assert_allclose(band["y_bottom"], low, rtol=1e-10)
        np.testing.assert_allclose(band["y_top"], high, rtol=1e-10)
        np.testing.assert_allclose(band["x"], pressure, rtol=1e-10)
    labels = [e["string"] for e in drawn(figure, "ylabel")]
    assert len(labels) == 5 and all("(" in label for label in labels)
    of_the_wall = ["axial_stress", "circumferential_material_stiffness", "stored_energy"]
    figure = ph.plot_elastic_properties(tree, pressure, var_names=of_the_wall, backend="none")
    for name in of_the_wall:
        median = figure.get_viz("median", name, class_label="posterior")
        np.testing.assert_allclose(median["y"], table[name].median(["chain", "draw"]), rtol=1e-10)
    labels = [e["string"] for e in drawn(figure, "ylabel")]
    assert [label.split("(")[1] for label in labels] == ["kPa)", "kPa)", "kJ/m³)"]
    figure = ph.plot_wall_stress(tree, pressure, backend="none")
    stress = ph.wall_stress(tree, pressure, **at)["sigma_tt"].median(["chain", "draw"])
    for i, label in enumerate(("10 mmHg", "20 mmHg")):
        line = figure.get_viz("median", "sigma_tt", class_label="posterior", pressure=label)
        np.testing.assert_allclose(line["y"], stress[i], rtol=1e-10)
    alone = ph.plot_wall_stress(tree, 20.0, backend="none")
    assert "20 mmHg" in alone.get_viz("figure_title")["string"]
    assert legend_texts(ph.plot_wall_stress(tree, pressure)) == ["10 mmHg", "20 mmHg"]


def test_extrapolated_properties_are_dashed():
    """Below what was measured the median is dashed, in both figures, and the legend says why."""
    data = study(2)
    tree = fitted(data)
    pressure = [0.5 * float(data["pressure"].min()) / ph.mmHg, 10.0, 20.0]
    with pytest.warns(UserWarning, match="1 of 3 points is extrapolated"):
        figure = ph.plot_elastic_properties(tree, pressure, backend="none")
    where = {"class_label": "posterior"}
    solid, dashed = (figure.get_viz(n, "compliance", **where) for n in ("median", "extrapolated"))
    assert np.isfinite(solid["y"]).tolist() == [False, True, True]
    assert np.isfinite(dashed["y"]).tolist() == [True, True, False]
    assert dashed["linestyle"] == "--"
    with pytest.warns(UserWarning, match="extrapolated"):
        figure = ph.plot_wall_stress(tree, pressure, backend="none")
    lines = figure.viz["extrapolated"]["sigma_tt"].sel(where).values
    assert [line is not None for line in lines] == [True, False, False]
    with pytest.warns(UserWarning, match="extrapolated"):
        told = legend_texts(ph.plot_elastic_properties(tree, pressure))
    assert told == ["posterior median", "extrapolated"]
    assert legend_texts(ph.plot_elastic_properties(tree, pressure[1:])) == []


@pytest.mark.parametrize("plot", [ph.plot_elastic_properties, ph.plot_wall_stress])
def test_a_tube_is_given_as_one(plot):
    """Whoever says the tube as predictions take it is told how figures do."""
    with pytest.raises(TypeError, match=r"tube=\{'axial_stretch': 1.2\}"):
        plot(fitted(study(2)), [10.0], axial_stretch=1.2)


def test_pressures_that_nothing_reaches_have_no_band():
    """Where no draw reaches a pressure the line ends, and nobody is told of empty slices."""
    tube = {"energy": ph.NeoHookean(), **TUBE}
    tree = xr.DataTree.from_dict(
        {"posterior": xr.Dataset({"mu": (("chain", "draw"), [[20.0, 30.0]])})}
    )
    with pytest.warns(UserWarning, match="do not reach"):
        figure = ph.plot_elastic_properties(tree, [20.0, 300.0], tube=tube, backend="none")
    line = figure.get_viz("median", "compliance", class_label="posterior")
    assert np.isfinite(line["y"]).tolist() == [True, False]


@pytest.mark.parametrize(
    ("settings", "message"),
    [({"var_names": ["radius"]}, "var_names must be a list"), ({"prob": 94}, "prob must be")],
)
def test_properties_that_cannot_be_drawn(settings, message):
    """What is unknown is named."""
    with pytest.raises(ValueError, match=message):
        ph.plot_elastic_properties(fitted(study(2)), [20.0], **settings)
