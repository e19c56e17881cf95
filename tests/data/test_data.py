"""A table becomes inflation data, and these are selected and written down."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from tables import SECTOR, build, by_diameter, good_frame, with_diameters

from pymc_hyperelastic.data import select as selecting
from pymc_hyperelastic.data.inflation import (
    COORDINATES,
    OPTIONAL,
    VARIABLES,
    check_inflation_data,
    describe_test,
    measured_radius,
    points_of,
)
from pymc_hyperelastic.data.select import select
from pymc_hyperelastic.data.units import mmHg

# Pint's factor for a unit may differ from ours in the last bit.
ROUNDING = 1e-15

GEOMETRY_NAMES = ("inner_radius", "outer_radius", "axial_stretch", "opening_angle")

FORCES = (1.0, np.nan, 3.0, "4.5", None, 6.0)


def test_layout():
    """The Dataset has the documented variables, each with its dimension, unit and name."""
    data = build(pressure_unit="mmHg")
    assert dict(data.sizes) == {"obs": 6, "test": 3}
    assert set(data.data_vars) == set(VARIABLES)
    assert set(data.coords) == set(COORDINATES)
    for name, (dimension, units, long_name) in {**VARIABLES, **COORDINATES}.items():
        assert data[name].dims == (dimension,)
        assert data[name].attrs == {"units": units, "long_name": long_name}
    assert data["specimen"].values.tolist() == ["S1", "S1", "S2"]
    assert data["experiment"].values.tolist() == [1, 2, 1]
    assert data["group"].values.tolist() == ["C1", "C1", "C2"]
    assert data["row"].values.tolist() == list(range(10, 16))
    np.testing.assert_allclose(data["pressure"], good_frame()["pressure"] * mmHg, rtol=ROUNDING)


def test_units_and_columns_reach_the_geometry():
    """Lengths follow radius_unit, angles angle_unit, and a column serves as well as a number."""
    lengths = ["radius", "A", "B"]
    frame = good_frame()
    frame[lengths] *= 1000
    from_columns = build(
        frame,
        inner_radius="A",
        outer_radius="B",
        axial_stretch="stretch",
        opening_angle="angle",
        radius_unit="um",
        angle_unit="deg",
        **SECTOR,
    )
    from_numbers = build(axial_stretch=1.2, opening_angle=np.pi / 3, **SECTOR)
    xr.testing.assert_allclose(from_columns, from_numbers, rtol=ROUNDING)


def test_scattered_rows_are_gathered():
    """Tests come in order of first appearance, their points together and in the frame's order."""
    frame = good_frame().loc[[14, 10, 12, 11, 15, 13]]
    data = build(frame)
    assert data["specimen"].values.tolist() == ["S2", "S1", "S1"]
    assert data["row"].values.tolist() == [14, 15, 10, 11, 12, 13]
    assert data["test"].values.tolist() == [0, 0, 1, 1, 2, 2]
    assert data["radius"].values.tolist() == [7.1, 7.6, 7.2, 8.0, 7.3, 8.1]


def test_labels_are_plain():
    """Integers stay integers in experiment, what a spreadsheet made float too; the rest is text."""
    frame = good_frame().drop(columns="group")
    frame["specimen"] = [7, 7, 7, 7, 8, 8]
    frame["experiment"] = frame["experiment"].astype(float)
    data = build(frame)
    assert data["specimen"].values.tolist() == ["7", "7", "8"]
    assert data["experiment"].dtype.kind == "i"
    assert data["group"].values.tolist() == ["all"] * 3
    assert select(data, specimen=7).sizes["test"] == 2

    frame["experiment"] = ["low", "low", "high", "high", "low", "low"]
    data = build(frame.set_index(pd.Index(list("abcdef"))))
    assert data["experiment"].values.tolist() == ["low", "high", "low"]
    assert data["row"].values.tolist() == list("abcdef")


def test_numbers_may_come_as_text():
    """A column that was read as text because of its neighbours is still numbers."""
    frame = good_frame()
    frame["pressure"] = frame["pressure"].astype(str)
    xr.testing.assert_identical(build(frame), build())


def test_frame_is_left_alone():
    """Building data changes nothing in the user's frame."""
    frame = good_frame()
    build(frame, inner_radius="A")
    pd.testing.assert_frame_equal(frame, good_frame())


def test_select_keeps_order_and_renumbers():
    """Selected tests keep the data's order, and their points follow them."""
    data = build()
    chosen = select(data, specimen=["S2", "S1"], experiment=1)
    check_inflation_data(chosen)
    assert chosen["specimen"].values.tolist() == ["S1", "S2"]
    assert chosen["row"].values.tolist() == [10, 11, 14, 15]
    assert chosen["test"].values.tolist() == [0, 0, 1, 1]
    assert chosen["test"].attrs == data["test"].attrs
    xr.testing.assert_identical(select(data), data)
    xr.testing.assert_identical(select(data, experiment=np.int64(2)), select(data, experiment="2"))


@pytest.mark.parametrize("positions", [[0, 2], [1], [0, 1, 2]])
def test_tests_of_many_are_those_tests(positions):
    """A few are found among very many as among few."""
    data = build()
    xr.testing.assert_identical(
        selecting.tests_of_many(data, positions), selecting.tests_at(data, positions)
    )


def test_names_and_points_of_a_test():
    """A test's name and its points can be found from its position."""
    data = build()
    assert describe_test(data, 2) == "specimen 'S2', experiment 1"
    assert [points_of(data, i) for i in range(3)] == [slice(0, 2), slice(2, 4), slice(4, 6)]
    with pytest.raises(IndexError, match="no test 3"):
        points_of(data, 3)


def test_outer_diameters():
    """The diameter is kept, and the internal radius is that which leaves the wall its volume."""
    frame = with_diameters(np.array([20.0, 22.0, 20.4, 22.4, 19.8, 21.0]) * 1000)
    lengths = {"inner_radius": 7000.0, "outer_radius": 9000.0, "radius_unit": "um"}
    data = by_diameter(
        frame,
        **lengths,
        axial_stretch="stretch",
        opening_angle="angle",
        angle_unit="deg",
        **SECTOR,
    )
    assert set(data.data_vars) == {*VARIABLES, "outer_diameter"}
    dimension, units, long_name = OPTIONAL["outer_diameter"]
    assert data["outer_diameter"].dims == (dimension,)
    assert data["outer_diameter"].attrs == {"units": units, "long_name": long_name}
    np.testing.assert_allclose(data["outer_diameter"], frame["outer_diameter"] / 1000)
    np.testing.assert_array_equal(measured_radius(data), data["outer_diameter"] / 2)
    # Area of the wall, stretched by 1.2, and of the ring that was cut open by 60 degrees.
    wall = data["outer_diameter"] ** 2 / 4 - data["radius"] ** 2
    np.testing.assert_allclose(1.2 * wall, 300 / 360 * (9.0**2 - 7.0**2), rtol=ROUNDING * 10)
    radius = build(good_frame().assign(outer_diameter="ignored"))
    assert "outer_diameter" not in radius
    np.testing.assert_array_equal(measured_radius(radius), radius["radius"])


@pytest.mark.parametrize("name", GEOMETRY_NAMES)
def test_unknown_geometry(name):
    """What is not known is NaN, as are internal radii that would need it; those measured stay."""
    data = by_diameter(**{name: None})
    check_inflation_data(data)
    assert np.isnan(data[name]).all() and np.isnan(data["radius"]).all()
    assert np.isfinite(data["outer_diameter"]).all()
    others = [other for other in GEOMETRY_NAMES if other != name]
    assert all(np.isfinite(data[other]).all() for other in others)
    radius = build(**{name: None})
    check_inflation_data(radius)
    np.testing.assert_array_equal(radius["radius"], good_frame()["radius"])


def test_axial_forces():
    """Forces may be missing, come as text and in any unit; without a column there are none."""
    data = build(good_frame().assign(axial_force=FORCES), force_unit="uN")
    dimension, units, long_name = OPTIONAL["axial_force"]
    assert data["axial_force"].dims == (dimension,)
    assert data["axial_force"].attrs == {"units": units, "long_name": long_name}
    expected = [0.001, np.nan, 0.003, 0.0045, np.nan, 0.006]
    np.testing.assert_allclose(data["axial_force"], expected, rtol=ROUNDING * 10)
    assert "axial_force" not in build()


def test_scattered_rows_keep_their_forces_and_diameters():
    """Every point keeps what was measured at it, also when tests are gathered or selected."""
    frame = with_diameters(axial_force=FORCES).loc[[14, 10, 12, 11, 15, 13]]
    data = by_diameter(frame)
    assert data["row"].values.tolist() == [14, 15, 10, 11, 12, 13]
    assert data["outer_diameter"].values.tolist() == [19.8, 21.0, 20.0, 22.0, 20.4, 22.4]
    np.testing.assert_array_equal(data["axial_force"], [np.nan, 6.0, 1.0, np.nan, 3.0, 4.5])
    chosen = select(data, specimen="S1", experiment=2)
    check_inflation_data(chosen)
    assert chosen["outer_diameter"].values.tolist() == [20.4, 22.4]
    assert chosen["axial_force"].values.tolist() == [3.0, 4.5]
    assert chosen["axial_force"].attrs == data["axial_force"].attrs


@pytest.mark.parametrize("unknown", [{}, {"inner_radius": None}], ids=["known", "unknown"])
def test_all_that_was_measured_survives_a_file(tmp_path, unknown):
    """Diameters, forces with gaps, and an unknown geometry come back identical."""
    data = by_diameter(with_diameters(axial_force=FORCES), **unknown)
    data.to_netcdf(tmp_path / "data.nc", engine="h5netcdf")
    loaded = xr.load_dataset(tmp_path / "data.nc", engine="h5netcdf")
    check_inflation_data(loaded)
    xr.testing.assert_identical(loaded, data)


def test_netcdf_round_trip(tmp_path):
    """A saved Dataset comes back identical and passes the check: labels, integers, attributes."""
    data = build(pressure_unit="mmHg")
    data.to_netcdf(tmp_path / "data.nc", engine="h5netcdf")
    loaded = xr.load_dataset(tmp_path / "data.nc", engine="h5netcdf")
    check_inflation_data(loaded)
    xr.testing.assert_identical(loaded, data)
    assert loaded["experiment"].dtype.kind == "i"
    assert select(loaded, specimen="S2").sizes == {"obs": 2, "test": 1}


def test_datatree_round_trip(tmp_path):
    """Data inside a tree of results survive the file too."""
    data = build()
    tree = xr.DataTree.from_dict({"/C1/inflation_data": data})
    tree.to_netcdf(tmp_path / "tree.nc", engine="h5netcdf")
    loaded = xr.load_datatree(tmp_path / "tree.nc", engine="h5netcdf")
    xr.testing.assert_identical(loaded["C1/inflation_data"].to_dataset(), data)
