"""Figures compare forces that were measured with an offset to bands that have none."""

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr
from shared_errors import EXTENDED, dataset, extended

import pymc_hyperelastic as ph

mpl.use("Agg")

OFFSETS = np.array([10.0, 0.0, -30.0, 5.0, 50.0])


def result(data=None):
    """What sampling stores of a model with offsets, of five tests."""
    data = dataset() if data is None else data
    labels = [f"specimen 'S', experiment {i}" for i in range(5)]
    of_test = np.broadcast_to(OFFSETS, (2, 50, 5)) + np.linspace(-1, 1, 50)[:, None]
    posterior = xr.Dataset(
        {
            "mu": (("chain", "draw"), np.full((2, 50), 20.0)),
            "force_offset_mean": (("chain", "draw", "test"), of_test),
            "force_offset_error": (("chain", "draw", "test"), np.full((2, 50, 5), 0.5)),
        },
        {"test": labels},
    )
    groups = {"posterior": posterior, "observed_data": data[["pressure"]].reset_coords(drop=True)}
    tree = xr.DataTree.from_dict(groups | {"constant_data": data.drop_vars("pressure")})
    tree.attrs = {"strain_energy": "NeoHookean"}
    return tree, data


def shown(figure):
    """Measured forces that the backend "none" was to draw."""
    panels = [p for of_variable in figure.viz["plot"].values() for p in of_variable.values.ravel()]
    drawn = [e["y"] for panel in panels for e in panel if e["function"] == "scatter"]
    values = np.concatenate([np.ravel(y) for y in drawn])
    return np.sort(values[np.isfinite(values)])


def legend_of(figure):
    return [t.get_text() for n in figure.get_viz("figure").legends for t in n.get_texts()]


def test_points_are_forces_less_the_mean_offset_of_their_test():
    """And the legend says so; without offsets neither happens."""
    tree, data = result()
    force = data["axial_force"].values
    less = force - OFFSETS[data["test"].values]
    figure = ph.plot_axial_force(tree, backend="none")
    np.testing.assert_allclose(shown(figure), np.sort(less[np.isfinite(less)]))
    said = "data (of that colour), less its test's offset"
    assert said in legend_of(ph.plot_axial_force(tree))
    of_one = ph.select(data, experiment=[2, 3])
    figure = ph.plot_axial_force(tree, of_one, backend="none")
    values = less[np.isin(data["test"].values, [2, 3])]
    np.testing.assert_allclose(shown(figure), np.sort(values[np.isfinite(values)]))
    tree["posterior"] = xr.DataTree(tree["posterior"].to_dataset()[["mu"]])
    figure = ph.plot_axial_force(tree)
    assert said not in legend_of(figure) and "data (of that colour)" in legend_of(figure)
    figure = ph.plot_axial_force(tree, backend="none")
    np.testing.assert_allclose(shown(figure), np.sort(force[np.isfinite(force)]))
    mpl.pyplot.close("all")


def test_forces_of_extension_tests_are_less_their_offset_too():
    """In the panel over the axial stretch, and no others are there."""
    reached = extended()
    reached["pressure"] *= 0.1
    tree, data = result(reached)
    less = data["axial_force"].values - OFFSETS[data["test"].values]
    of_extension = np.isin(data["test"].values, EXTENDED)
    panels = ph.plot_axial_force(tree, backend="none").viz["plot"]
    for name, there in (("axial_force", ~of_extension), ("extension_force", of_extension)):
        (panel,) = panels[name].values.ravel()
        drawn = [np.ravel(e["y"]) for e in panel if e["function"] == "scatter"]
        values = np.concatenate(drawn)
        expected = np.sort(less[there & np.isfinite(less)])
        np.testing.assert_allclose(np.sort(values[np.isfinite(values)]), expected)


def test_tests_of_unknown_offset_are_named():
    """Their forces are shown as they were measured, and nobody takes them for corrected ones."""
    tree, data = result()
    others = data.assign_coords(specimen=data["specimen"].astype("<U3"))
    others["specimen"][[0, 3]] = "new"
    with pytest.warns(UserWarning, match="specimen 'new', experiment 0 and 1 more.*offset"):
        figure = ph.plot_axial_force(tree, others, backend="none")
    offsets = np.where(np.isin(range(5), [0, 3]), 0.0, OFFSETS)
    less = data["axial_force"].values - offsets[data["test"].values]
    np.testing.assert_allclose(shown(figure), np.sort(less[np.isfinite(less)]))


def test_draws_of_offsets_have_the_spread_of_both():
    """That of their means among draws of the posterior, and the error given one."""
    tree, _ = result()
    offsets = ph.force_offsets(tree)["force_offset"]
    np.testing.assert_allclose(offsets.mean(["chain", "draw"]), OFFSETS, atol=0.4)
    spread = np.hypot(np.linspace(-1, 1, 50).std(), 0.5)
    np.testing.assert_allclose(offsets.std(["chain", "draw"]), spread, rtol=0.25)
    assert ph.force_offsets(tree).identical(ph.force_offsets(tree))
