"""inflation_data builds a checked Dataset from a table of measured points."""

import decimal
import warnings

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from tables import FORCES, SECTOR, build, by_diameter, curve, good_frame, with_diameters

from pymc_hyperelastic.data.inflation import (
    at_points,
    check_data,
    measured_radius,
    points_of,
)
from pymc_hyperelastic.data.units import mmHg
from pymc_hyperelastic.data.variables import LABELS, POINTS, REQUIRED
from pymc_hyperelastic.quantities import QUANTITIES

ROUNDING = 1e-14  # a few products and quotients
SINGLE = 1e-6  # numbers that were stored in single precision
GEOMETRY_NAMES = ("inner_radius", "outer_radius", "axial_stretch", "opening_angle")
SCATTERED = [14, 10, 12, 11, 15, 13]


def test_dataset_has_the_documented_variables_units_and_labels():
    data = build(pressure_unit="mmHg")
    assert dict(data.sizes) == {"obs": 6, "test": 3}
    assert set(data.data_vars) == set(REQUIRED)
    assert set(data.coords) == {*LABELS, *POINTS}
    for name in (*REQUIRED, *LABELS):
        assert data[name].dims == (QUANTITIES[name].lies_on,)
        assert data[name].attrs == QUANTITIES[name].attributes
    assert data["pressure"].attrs == {"units": "kPa", "long_name": "pressure"}
    assert data["test"].dims == data["row"].dims == ("obs",)
    assert data["specimen"].values.tolist() == ["S1", "S1", "S2"]
    assert data["experiment"].values.tolist() == [1, 2, 1]
    assert data["group"].values.tolist() == ["C1", "C1", "C2"]
    assert data["row"].values.tolist() == list(range(10, 16))
    assert data["radius"].values.tolist() == [7.2, 8.0, 7.3, 8.1, 7.1, 7.6]
    np.testing.assert_allclose(data["pressure"], good_frame()["pressure"] * mmHg, rtol=ROUNDING)
    tube = [data[name].values.tolist() for name in GEOMETRY_NAMES]
    assert tube == [[7.0] * 3, [9.0] * 3, [1.0] * 3, [0.0] * 3]


def test_scattered_rows_of_a_test_are_gathered_with_diameters_and_forces():
    frame = with_diameters(axial_force=FORCES).loc[SCATTERED]
    data = by_diameter(frame, force_unit="uN")
    assert data["specimen"].values.tolist() == ["S2", "S1", "S1"]
    assert data["row"].values.tolist() == [14, 15, 10, 11, 12, 13]
    assert data["test"].values.tolist() == [0, 0, 1, 1, 2, 2]
    assert data["pressure"].values.tolist() == [1.1, 9.0, 1.0, 6.0, 1.2, 6.5]
    assert data["outer_diameter"].values.tolist() == [19.8, 21.0, 20.0, 22.0, 20.4, 22.4]
    forces = np.array([np.nan, 6.0, 1.0, np.nan, 3.0, 4.5]) / 1000
    np.testing.assert_allclose(data["axial_force"], forces, rtol=ROUNDING)
    for name in ("outer_diameter", "axial_force"):
        assert data[name].dims == ("obs",) and data[name].attrs == QUANTITIES[name].attributes


def test_integer_labels_of_experiments_stay_integers_and_specimens_become_text():
    frame = good_frame().drop(columns="group")
    frame["specimen"] = [7, 7, 7, 7, 8, 8]
    frame["experiment"] = frame["experiment"].astype(float)
    data = build(frame)
    assert data["specimen"].values.tolist() == ["7", "7", "8"]
    assert data["experiment"].dtype.kind == "i"
    assert data["group"].values.tolist() == ["all"] * 3
    frame["experiment"] = ["low", "low", "high", "high", "low", "low"]
    data = build(frame.set_index(pd.Index(list("abcdef"))))
    assert data["experiment"].values.tolist() == ["low", "high", "low"]
    assert data["row"].values.tolist() == list("abcdef")
    # A file holds integers of 64 bits.
    labels = {-(2**63): "i", 2**63 - 1: "i", 2**63: "U", -(2**63) - 1: "U", True: "U", 1.5: "U"}
    for label, kind in labels.items():
        assert build(curve(experiment=label))["experiment"].dtype.kind == kind


def test_internal_radius_follows_from_outer_diameter_and_wall_volume():
    frame = with_diameters(np.array([20.0, 22.0, 20.4, 22.4, 19.8, 21.0]) * 1000)
    tube = {"inner_radius": 7000.0, "outer_radius": 9000.0, "axial_stretch": "stretch"}
    units = {"radius_unit": "um", "angle_unit": "deg"}
    data = by_diameter(frame, **tube, **units, opening_angle="angle", **SECTOR)
    assert set(data.data_vars) == {*REQUIRED, "outer_diameter"}
    np.testing.assert_allclose(data["outer_diameter"], frame["outer_diameter"] / 1000)
    np.testing.assert_array_equal(measured_radius(data), data["outer_diameter"] / 2)
    # The wall is stretched by 1.2, and the sector lacks 60 degrees of a circle.
    wall = data["outer_diameter"] ** 2 / 4 - data["radius"] ** 2
    np.testing.assert_allclose(1.2 * wall, 300 / 360 * (9.0**2 - 7.0**2), rtol=ROUNDING)
    radius = build(good_frame().assign(outer_diameter="ignored"))
    assert not {"outer_diameter", "axial_force"} & set(radius)
    np.testing.assert_array_equal(measured_radius(radius), radius["radius"])


@pytest.mark.parametrize("name", GEOMETRY_NAMES)
def test_unknown_geometry_gives_nan_radii_under_measured_diameters(name):
    data = by_diameter(with_diameters(axial_force=FORCES), **{name: np.nan})
    check_data(data)
    assert np.isnan(data[name]).all() and np.isnan(data["radius"]).all()
    others = ["outer_diameter", *(other for other in GEOMETRY_NAMES if other != name)]
    assert all(np.isfinite(data[other]).all() for other in others)
    radius = build(**{name: np.nan})
    check_data(radius)
    np.testing.assert_array_equal(radius["radius"], good_frame()["radius"])


def test_errors_of_the_tube_are_converted_to_internal_units():
    frame = good_frame().assign(error=[0.1, 0.1, 0.2, 0.2, 0.3, 0.3])
    frame["radius"] *= 1000
    ring = {"radii_of": "ring", "convention": "fung", "angle_unit": "deg"}
    ring |= {"inner_radius": 7000.0, "outer_radius": 9000.0, "opening_angle": 30.0}
    errors = {"thickness": 50.0, "wall_area": 2e5, "axial_stretch": "error", "opening_angle": 3}
    data = build(frame, **ring, radius_unit="um", sd=errors)
    for name, expected in {
        "thickness_sd": [0.05] * 3,
        "wall_area_sd": [0.2] * 3,
        "axial_stretch_sd": [0.1, 0.2, 0.3],
        "opening_angle_sd": [np.pi / 30] * 3,  # the whole angle is twice Fung's
    }.items():
        np.testing.assert_allclose(data[name], expected, rtol=ROUNDING)
        assert data[name].attrs["units"] == QUANTITIES[name].unit
    data = build(opening_angle=0.5, **SECTOR, sd={"opening_angle": 0.1})
    assert data["opening_angle_sd"].values.tolist() == [0.1] * 3


def test_at_points_repeats_values_of_tests_and_points_of_finds_their_slices():
    frame = good_frame().assign(A=[7.0, 7.0, 6.5, 6.5, 7.1, 7.1])
    data = build(frame, inner_radius="A")
    assert at_points(data, "inner_radius").tolist() == frame["A"].tolist()
    assert points_of(data, 1) == slice(2, 4)
    with pytest.raises(IndexError, match="no test 3 in the data; expected 0 to 2"):
        points_of(data, 3)


RADIUS, PRESSURE = curve()["radius"].to_numpy(), curve()["pressure"].to_numpy()
UNUSUAL = {
    "exponents as text": curve(pressure=[f"{p:e}" for p in PRESSURE]),
    "decimals": curve(pressure=[decimal.Decimal(str(p)) for p in PRESSURE]),
    "single precision": curve(radius=RADIUS.astype(np.float32)),
    "nullable": curve().astype({"pressure": "Float64"}),
    "huge specimen": curve(specimen=10**30),
    "huge row labels": curve().set_index(pd.Index([2**70 + i for i in range(9)], dtype=object)),
    "labels of both kinds": pd.concat([curve(), curve(experiment="b")], ignore_index=True),
    "forces with gaps": curve(axial_force=[1.0, None, np.nan, 4, 5, 6, 7, 8, "9"]),
}  # fmt: skip


@pytest.mark.parametrize("form", UNUSUAL)
def test_unusual_but_valid_tables_are_read_without_a_warning(form, tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        data = build(UNUSUAL[form])
    check_data(data)
    assert data.sizes["obs"] == len(UNUSUAL[form])
    for name, expected in (("radius", RADIUS), ("pressure", PRESSURE)):
        repeated = np.resize(expected, data.sizes["obs"])
        np.testing.assert_allclose(data[name], repeated, rtol=SINGLE, err_msg=name)
    data.to_netcdf(tmp_path / "data.nc", engine="h5netcdf")
    loaded = xr.load_dataset(tmp_path / "data.nc", engine="h5netcdf")
    check_data(loaded)
    xr.testing.assert_identical(loaded, data)
