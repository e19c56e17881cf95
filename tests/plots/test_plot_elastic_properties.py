"""plot_elastic_properties and plot_wall_stress."""

import numpy as np
import pytest
from figures import assert_band, fitted, legend_texts, straight_lines, texts

import pymc_hyperelastic as ph

HERE = {"class_label": "posterior"}
PRESSURE = [10.0, 20.0]


@pytest.fixture(scope="module")
def tree():
    return fitted(straight_lines(2))


def test_bands_are_quantiles_of_the_predictions(tree):
    table = ph.tube_properties(tree, PRESSURE, pressure_unit="mmHg")
    names = ["axial_stress", "compliance", "pulse_wave_velocity", "stored_energy"]
    figure = ph.plot_elastic_properties(tree, PRESSURE, prob=0.8, var_names=names, backend="none")
    for name in names:
        assert_band(figure, name, table[name], 0.8, **HERE)
        np.testing.assert_allclose(figure.get_viz("band", name, **HERE)["x"], PRESSURE)
    labels = texts(figure, "ylabel")
    assert [label.split("(")[1] for label in labels] == ["kPa)", "mm²/kPa)", "m/s)", "kPa)"]


def test_wall_stresses_have_a_line_for_each_pressure(tree):
    figure = ph.plot_wall_stress(tree, PRESSURE, backend="none")
    table = ph.wall_stress(tree, PRESSURE, pressure_unit="mmHg")
    for name in ("sigma_rr", "sigma_tt", "sigma_zz"):
        for i, label in enumerate(("10 mmHg", "20 mmHg")):
            assert_band(figure, name, table[name].isel(pressure=i), 0.95, pressure=label, **HERE)
    x = figure.get_viz("median", name, pressure=label)["x"]
    np.testing.assert_allclose(x, table["position"])
    assert texts(figure, "title") == ["radial stress", "hoop stress", "axial stress"]
    alone = ph.plot_wall_stress(tree, 20.0, backend="none")
    assert "20 mmHg" in alone.get_viz("figure_title")["string"]
    assert legend_texts(ph.plot_wall_stress(tree, PRESSURE)) == ["10 mmHg", "20 mmHg"]


def test_extrapolated_values_are_dashed(tree):
    pressure = [0.5 * float(tree["observed_data"]["pressure"].min()) / ph.mmHg, *PRESSURE]
    with pytest.warns(UserWarning, match="1 of 3 points is extrapolated"):
        figure = ph.plot_elastic_properties(tree, pressure, backend="none")
    assert len(figure.viz["plot"].data_vars) == 5
    solid, dashed = (figure.get_viz(n, "compliance", **HERE) for n in ("median", "extrapolated"))
    assert np.isfinite(solid["y"]).tolist() == [False, True, True]
    assert np.isfinite(dashed["y"]).tolist() == [True, True, False]
    assert dashed["linestyle"] == "--"


def test_wrong_input_is_refused(tree):
    with pytest.raises(TypeError, match=r"tube=\{'axial_stretch': 1.2\}"):
        ph.plot_wall_stress(tree, [10.0], axial_stretch=1.2)
