"""Figures of extension tests: forces and radii over the axial stretch, beside inflation tests."""

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from drawn import result

import pymc_hyperelastic as ph

mpl.use("Agg")

TUBE = {"inner_radius": 1.0, "outer_radius": 1.5}
HELD, STRETCHES = (0.8, 2.0), (1.15, 1.3)
MU = 20.0
# Curves of a figure are those of the functions that predict; medians of one draw are that draw.
ROUNDING = 1e-10


@pytest.fixture(autouse=True)
def closed():
    yield
    mpl.pyplot.close("all")


def tree_of(*mu) -> xr.DataTree:
    tree = result(mu=list(mu))
    tree.attrs["strain_energy"] = "NeoHookean"
    return tree


def curve_at(pressure, stretch):
    return ph.predict_axial_force(tree_of(MU), pressure=pressure, **TUBE, axial_stretch=stretch)


def drifting(held, stretch):
    """A pressure that is not held exactly; its mean is."""
    return held * (1 + 0.2 * (stretch - 1.25))


def study(specimens=("S1",), *, force=True, kinds=("inflation", "extension")) -> xr.Dataset:
    """Tests of both kinds of a neo-Hookean tube, without errors; those by extension let go."""
    tables = []
    for specimen in specimens:
        for stretch in STRETCHES if "inflation" in kinds else ():
            pressure = np.linspace(0.3, 2.5, 6)
            curve = curve_at(pressure, [stretch] * 6)
            tables.append(table(specimen, f"at {stretch:g}", pressure, stretch, curve))
        for held in HELD if "extension" in kinds else ():
            stretch = np.linspace(1.4, 1.1, 7)
            pressure = drifting(held, stretch)
            curve = curve_at(pressure, stretch)
            tables.append(table(specimen, f"held {held:g}", pressure, stretch, curve))
    frame = pd.concat(tables, ignore_index=True)
    frame = frame if force else frame.drop(columns="axial_force")
    return ph.inflation_data(frame, **TUBE, axial_stretch="stretch", check="ignore")


def table(specimen, experiment, pressure, stretch, curve) -> pd.DataFrame:
    numbers = {n: curve[n].values[0, 0] for n in ("radius", "axial_force")}
    labels = {"specimen": specimen, "experiment": experiment}
    return pd.DataFrame({**numbers, "pressure": pressure, "stretch": stretch} | labels)


def fitted(data, *mu) -> xr.DataTree:
    tree = tree_of(*mu)
    tree["constant_data"] = xr.DataTree(data)
    return tree


def drawn(figure, function, variable=None):
    """What the backend "none" collected of one kind, in all panels or those of a variable."""
    panels = figure.viz["plot"]
    panels = panels.dataset if isinstance(panels, xr.DataTree) else panels
    panels = panels.to_array() if variable is None else panels[variable]
    return [e for panel in panels.values.ravel() for e in panel if e["function"] == function]


def points_of(figure, variable):
    dots = drawn(figure, "scatter", variable)
    points = np.concatenate([np.stack([e["x"], e["y"]]) for e in dots], axis=1)
    points = points[:, ~np.isnan(points[0])]
    return points[:, np.lexsort(points)]


def measured(data, x, y, extended):
    """Points of one kind of tests, in an order of their own."""
    of_kind = np.isin(data["test"], np.flatnonzero(data["experiment"].str.startswith(extended)))
    points = np.stack([data[x].values, data[y].values])[:, of_kind]
    return points[:, np.lexsort(points)]


def legend_texts(figure):
    return [t.get_text() for n in figure.get_viz("figure").legends for t in n.get_texts()]


LABELS = [f"axial stretch {s:g}" for s in STRETCHES]
LABELS += [f"axial stretch varied at {p / ph.mmHg:.0f} mmHg" for p in HELD]


@pytest.mark.parametrize("group_by", [None, "group", "specimen", "axial_stretch", "experiment"])
def test_every_point_of_both_kinds_is_drawn(group_by):
    """Pressures over radii, and beside them forces over stretches, whatever the panels are."""
    data = study()
    figure = ph.plot_inflation(data, group_by=group_by, pressure_unit="kPa", backend="none")
    for variable, x, y, kind in (
        ("pressure", "radius", "pressure", "at"),
        ("axial_force", "axial_stretch", "axial_force", "held"),
    ):
        expected = measured(data, x, y, kind)
        np.testing.assert_array_equal(points_of(figure, variable), expected)
    assert len(drawn(figure, "line")) == 4
    labels = {e["string"] for e in drawn(figure, "xlabel", "axial_force")}
    assert labels == {"axial stretch $\\lambda_z$"}
    # Each panel has the name of its group once.
    if group_by in ("axial_stretch", "experiment"):
        assert len(drawn(figure, "title")) == 4


def test_protocols_of_a_specimen_are_told_apart():
    """Its curves have a colour each, and names by the stretch, or by the pressure that was held."""
    figure = ph.plot_inflation(study())
    assert legend_texts(figure) == LABELS
    lines = drawn(ph.plot_inflation(study(), backend="none"), "line")
    assert len({e["color"] for e in lines}) == 4


def test_figure_of_many_specimens():
    """Specimens have colours and protocols markers."""
    names = legend_texts(ph.plot_inflation(study(("S1", "S2", "S3"))))
    assert names == [f"specimen S{i}" for i in (1, 2, 3)] + LABELS


def test_without_forces_there_are_radii():
    """Of extension tests, over their axial stretches."""
    data = study(force=False)
    figure = ph.plot_inflation(data, backend="none")
    expected = measured(data, "axial_stretch", "radius", "held")
    np.testing.assert_array_equal(points_of(figure, "radius"), expected)


def test_extension_tests_alone():
    """Nothing is left blank for inflation tests."""
    data = study(kinds=("extension",))
    figure = ph.plot_inflation(data, backend="none")
    assert figure.viz["plot"].size == 1
    tree = fitted(data, MU, 1.1 * MU)
    for plot, names in (
        (ph.plot_axial_force, ["extension_force"]),
        (ph.plot_pressure_fit, ["extension_radius"]),
    ):
        assert list(plot(tree, backend="none").viz["plot"].data_vars) == names


def test_panels_without_curves_are_blank():
    """Where panels are tests, each has axes for its own kind and none for the other."""
    figure = ph.plot_inflation(study(), group_by="experiment")
    for variable, kind in (("pressure", "at"), ("axial_force", "held")):
        panels = figure.viz["plot"][variable]
        for name in panels["experiment"].values.tolist():
            assert panels.sel(experiment=name).item().axison == name.startswith(kind)


@pytest.mark.parametrize(
    ("plot", "name", "variable"),
    [
        (ph.plot_axial_force, "axial_force", "extension_force"),
        (ph.plot_pressure_fit, "radius", "extension_radius"),
    ],
)
def test_bands_along_extension_tests(plot, name, variable):
    """The median is that of the tube at the measured pressure, and the data are those measured."""
    data = study()
    figure = plot(fitted(data, 0.9 * MU, MU, 1.1 * MU), backend="none")
    for i, held in enumerate(HELD):
        label = LABELS[2 + i].removeprefix("axial stretch ")
        where = {"class_label": "posterior", "axial_stretch": label}
        median = figure.get_viz("median", variable, **where, tube=0)
        known = np.isfinite(median["x"])
        stretch = median["x"][known]
        np.testing.assert_allclose(stretch[[0, -1]], [1.1, 1.4], rtol=ROUNDING)
        exact = ph.predict_axial_force(
            tree_of(0.9 * MU, MU, 1.1 * MU),
            pressure=drifting(held, stretch),
            **TUBE,
            axial_stretch=stretch,
        )
        expected = exact[name].median(["chain", "draw"])
        np.testing.assert_allclose(median["y"][known], expected, rtol=ROUNDING)
        dots = figure.get_viz("points", variable, **where)
        assert dots["facecolor"] == median["color"]
        known = np.isfinite(dots["x"])
        own = data["experiment"].values[data["test"].values] == f"held {held:g}"
        np.testing.assert_array_equal(dots["x"][known], data["axial_stretch"].values[own])
        np.testing.assert_array_equal(dots["y"][known], data[name].values[own])
    radii = "pressure" if plot is ph.plot_pressure_fit else "axial_force"
    assert len(drawn(figure, "scatter", radii)) == len(STRETCHES)
    assert legend_texts(plot(fitted(data, MU)))[:4] == LABELS


def test_slopes_of_extension_tests_are_not_drawn():
    """They have none."""
    data = study()
    figure = ph.plot_pressure_fit(fitted(data, MU), backend="none")
    dots = drawn(figure, "scatter", "stiffness")
    assert sum(np.isfinite(e["y"]).sum() for e in dots) == len(STRETCHES) * 4


def test_classes_of_either_kind_stand_side_by_side():
    """A class without extension tests has no band over the stretch, and one with them has."""
    classes = xr.DataTree.from_dict(
        {
            "/both": fitted(study(), MU, 1.1 * MU),
            "/held": fitted(study(kinds=("inflation",)), MU, 1.1 * MU),
        }
    )
    figure = ph.plot_axial_force(classes, backend="none")
    bands = drawn(figure, "fill_between_y", "extension_force")
    assert len(bands) == len(HELD)
    assert len(drawn(figure, "fill_between_y", "axial_force")) == 2 * len(STRETCHES)
    ph.plot_axial_force(classes)
    ph.plot_pressure_fit(classes)


def test_a_pressure_that_is_not_reached_is_told():
    """Draws that burst before are left out of the band, and counted."""
    data = study(kinds=("extension",))
    with pytest.warns(UserWarning, match="1 do not reach the pressure at 24 of 24 axial stretches"):
        figure = ph.plot_axial_force(fitted(data, 0.1 * MU, MU), backend="none")
    label = LABELS[3].removeprefix("axial stretch ")
    where = {"class_label": "posterior", "axial_stretch": label, "tube": 0}
    median = figure.get_viz("median", "extension_force", **where)
    known = np.isfinite(median["x"])
    stretch = median["x"][known]
    exact = curve_at(drifting(HELD[1], stretch), stretch)["axial_force"].values[0, 0]
    np.testing.assert_allclose(median["y"][known], exact, rtol=ROUNDING)
