"""plot_elastic_properties and plot_wall_stress."""

import numpy as np
import pytest
import xarray as xr
from figures import assert_band, fitted, legend_texts, straight_lines, texts

import pymc_hyperelastic as ph

HERE = {"class_label": "posterior"}
PRESSURE = [10.0, 20.0]
AT = ph.Conditions(PRESSURE, pressure_unit="mmHg")


@pytest.fixture(scope="module")
def tree():
    return fitted(straight_lines(2))


def test_bands_are_quantiles_of_the_predictions(tree):
    table = ph.tube_properties(tree, AT)
    names = ["axial_stress", "compliance", "pulse_wave_velocity", "stored_energy"]
    figure = ph.plot_elastic_properties(tree, AT, ci_prob=0.8, var_names=names, backend="none")
    for name in names:
        assert_band(figure, name, table[name], 0.8, **HERE)
        np.testing.assert_allclose(figure.get_viz("band", name, **HERE)["x"], PRESSURE)
    labels = texts(figure, "ylabel")
    assert [label.split("(")[1] for label in labels] == ["kPa)", "mm²/kPa)", "m/s)", "kPa)"]


def test_wall_stresses_have_a_line_for_each_pressure(tree):
    figure = ph.plot_wall_stress(tree, AT, backend="none")
    table = ph.wall_stress(tree, AT)
    for name in ("sigma_rr", "sigma_tt", "sigma_zz"):
        for i, label in enumerate(("10 mmHg", "20 mmHg")):
            assert_band(figure, name, table[name].isel(pressure=i), 0.95, pressure=label, **HERE)
    x = figure.get_viz("median", name, pressure=label)["x"]
    np.testing.assert_allclose(x, table["position"])
    assert texts(figure, "title") == ["radial stress", "hoop stress", "axial stress"]
    alone = ph.Conditions(20.0, pressure_unit="mmHg")
    alone = ph.plot_wall_stress(tree, alone, points=3, backend="none")
    assert alone.get_viz("median", "sigma_tt")["x"].tolist() == [0.0, 0.5, 1.0]
    assert "20 mmHg" in alone.get_viz("figure_title")["string"]
    shown = legend_texts(ph.plot_wall_stress(tree, AT))
    assert shown == ["10 mmHg", "20 mmHg", "posterior median", "95 % of the posterior"]


def test_figures_and_predictions_read_plain_pressures_in_kilopascal(tree):
    pressure = [2.0, 3.0]
    figure = ph.plot_elastic_properties(tree, pressure, backend="none")
    assert_band(
        figure, "compliance", ph.tube_properties(tree, pressure)["compliance"], 0.95, **HERE
    )
    assert texts(figure, "xlabel")[0] == "pressure (kPa)"
    figure, stress = (
        ph.plot_wall_stress(tree, pressure, backend="none"),
        ph.wall_stress(tree, pressure),
    )
    at_first = stress["sigma_tt"].isel(pressure=0)
    assert_band(figure, "sigma_tt", at_first, 0.95, pressure="2 kPa", **HERE)


def test_extrapolated_values_are_dashed(tree):
    pressure = [0.5 * float(tree["observed_data"]["pressure"].min()) / ph.mmHg, *PRESSURE]
    with pytest.warns(UserWarning, match="1 of 3 points is extrapolated"):
        at = ph.Conditions(pressure, pressure_unit="mmHg")
        figure = ph.plot_elastic_properties(tree, at, backend="none")
    assert len(figure.viz["plot"].data_vars) == 5
    solid, dashed = (figure.get_viz(n, "compliance", **HERE) for n in ("median", "extrapolated"))
    assert np.isfinite(solid["y"]).tolist() == [False, True, True]
    assert np.isfinite(dashed["y"]).tolist() == [True, True, False]
    assert dashed["linestyle"] == "--"


def test_axial_stretch_argument_is_refused_with_what_to_write(tree):
    with pytest.raises(TypeError, match=r"at=ph.Conditions\(..., tube=ph.Tube\(axial_stretch=1.2"):
        ph.plot_wall_stress(tree, [10.0], axial_stretch=1.2)


def test_classes_differ_by_line_style_for_prints_in_grey(tree):
    classes = xr.DataTree.from_dict({name: tree.copy() for name in ("A", "B", "C")})
    figure = ph.plot_elastic_properties(classes, AT, backend="none")
    medians = [figure.get_viz("median", "compliance", class_label=name) for name in "ABC"]
    assert len({median["linestyle"] for median in medians}) == 3


def test_pressure_given_twice_is_drawn_once(tree):
    at = ph.Conditions([20.0, 20.0], pressure_unit="mmHg")
    figure = ph.plot_wall_stress(tree, at, backend="none")
    assert figure.viz["median"]["sigma_tt"].sizes["pressure"] == 1
