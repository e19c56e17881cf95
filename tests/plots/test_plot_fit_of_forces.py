"""plot_fit of axial forces: bands, measured forces, offsets of the transducer."""

import numpy as np
import pytest
import xarray as xr
from figures import STRETCHES, assert_band, elements, fitted, legend_texts, straight_lines, texts
from shared_errors import EXTENDED, dataset, extended

import pymc_hyperelastic as ph

FORCE = {"signal": "axial_force"}

OFFSETS = np.array([10.0, 0.0, -30.0, 5.0, 50.0])


def with_offsets(data):
    """Return a fitted model with force offsets of five tests."""
    tree = fitted(data, mu=np.full((2, 50), 20.0))
    mean = np.broadcast_to(OFFSETS, (2, 50, 5)) + np.linspace(-1, 1, 50)[:, None]
    offsets = {"force_offset_mean": mean, "force_offset_error": np.full((2, 50, 5), 0.5)}
    posterior = tree["posterior"].to_dataset()
    posterior = posterior.assign({n: (("chain", "draw", "test"), v) for n, v in offsets.items()})
    labels = [f"specimen 'S', experiment {i}" for i in range(5)]
    tree["posterior"] = xr.DataTree(posterior.assign_coords(test=labels))
    return tree


def assert_shown(figure, expected, variable="axial_force"):
    """Check that the known ones of these forces are drawn."""
    values = np.concatenate([np.ravel(e["y"]) for e in elements(figure, "scatter", variable)])
    expected = expected[np.isfinite(expected)]
    np.testing.assert_allclose(np.sort(values[np.isfinite(values)]), np.sort(expected))


def test_measured_forces_are_drawn_beside_the_predicted_median():
    data = straight_lines(2, STRETCHES)
    tree = fitted(data)
    assert "data (of that colour)" not in legend_texts(ph.plot_fit(tree, **FORCE))
    force = np.arange(data.sizes["obs"], dtype=float)
    force[3] = np.nan
    data["axial_force"] = ("obs", force, {"units": "mN"})
    figure = ph.plot_fit(tree, data, **FORCE, ci_prob=0.8, backend="none")
    where = {"axial_stretch": "1.2", "class_label": "posterior", "specimen": "S1"}
    median = figure.get_viz("median", "axial_force", curve=0, **where)
    predicted = ph.predict_axial_force(tree, median["x"], tube=ph.Tube(axial_stretch=1.2))
    assert_band(figure, "axial_force", predicted["axial_force"], 0.8, curve=0, **where)
    assert figure.get_viz("points", **where)["facecolor"] == median["color"]
    assert_shown(figure, force)
    assert texts(figure, "ylabel") == ["reduced axial force\n(mN)"]


def test_mean_offset_is_subtracted_from_the_forces_of_its_test():
    data = extended()
    data["pressure"] *= 0.1
    tree, force = with_offsets(data), data["axial_force"].values
    less = force - OFFSETS[data["test"].values]
    of_extension = np.isin(data["test"].values, EXTENDED)
    figure = ph.plot_fit(tree, **FORCE)
    assert "data (of that colour), less its test's offset" in legend_texts(figure)
    figure = ph.plot_fit(tree, **FORCE, backend="none")
    assert_shown(figure, less[~of_extension])
    figure = ph.plot_fit(tree, signal="extension_force", backend="none")
    assert_shown(figure, less[of_extension], "extension_force")
    tree["posterior"] = xr.DataTree(tree["posterior"].to_dataset()[["mu"]])
    assert_shown(ph.plot_fit(tree, **FORCE, backend="none"), force[~of_extension])


def test_warning_names_experiments_of_unknown_offset():
    data = dataset()
    others = data.assign_coords(specimen=data["specimen"].astype("<U3"))
    others["specimen"][[0, 3]] = "new"
    with pytest.warns(UserWarning, match="specimen 'new', experiment 0 and 1 more.*offset"):
        figure = ph.plot_fit(with_offsets(data), others, **FORCE, backend="none")
    offsets = np.where(np.isin(range(5), [0, 3]), 0.0, OFFSETS)
    assert_shown(figure, data["axial_force"].values - offsets[data["test"].values])
