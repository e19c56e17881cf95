"""A table becomes inflation data, or one error says where and why not."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

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
from pymc_hyperelastic.data.table import inflation_data
from pymc_hyperelastic.data.units import mmHg

# Pint's factor for a unit may differ from ours in the last bit.
ROUNDING = 1e-15

GEOMETRY = {"inner_radius": 7.0, "outer_radius": 9.0}
GEOMETRY_NAMES = ("inner_radius", "outer_radius", "axial_stretch", "opening_angle")


def good_frame() -> pd.DataFrame:
    """Two specimens, three tests of two points, rows labelled 10 to 15."""
    return pd.DataFrame(
        {
            "group": ["C1", "C1", "C1", "C1", "C2", "C2"],
            "specimen": ["S1", "S1", "S1", "S1", "S2", "S2"],
            "experiment": [1, 1, 2, 2, 1, 1],
            "radius": [7.2, 8.0, 7.3, 8.1, 7.1, 7.6],
            "pressure": [10.0, 60.0, 12.0, 65.0, 11.0, 90.0],
            "A": 7.0,
            "B": 9.0,
            "stretch": 1.2,
            "angle": 60.0,
        },
        index=range(10, 16),
    )


def changed(column: str, row: int, value: object) -> pd.DataFrame:
    """Build the good frame with one value replaced."""
    frame = good_frame()
    frame[column] = frame[column].astype(object)
    frame.loc[row, column] = value
    return frame


def build(frame: object = None, **arguments: object) -> xr.Dataset:
    frame = good_frame() if frame is None else frame
    return inflation_data(frame, **{**GEOMETRY, **arguments})


def with_values(name: str, values: object) -> xr.Dataset:
    """Build good data, then replace a variable behind the builder's back."""
    data = build()
    return data.assign({name: (data[name].dims, values, data[name].attrs)})


def with_diameters(diameter=(20.0, 22.0, 20.4, 22.4, 19.8, 21.0), **columns) -> pd.DataFrame:
    """Outer diameters in place of internal radii, and perhaps other columns."""
    return good_frame().drop(columns="radius").assign(outer_diameter=diameter, **columns)


def by_diameter(frame: object = None, **arguments: object) -> xr.Dataset:
    frame = with_diameters() if frame is None else frame
    return build(frame, measured="outer_diameter", **arguments)


FORCES = (1.0, np.nan, 3.0, "4.5", None, 6.0)

# Each row: what is wrong, a call that does it, the error, and fragments that its message must hold.
S1E2 = "specimen 'S1', experiment 2"
BAD_DATA = [
    ("no frame", lambda: build([1, 2]), TypeError, ["pandas DataFrame", "list"]),
    (
        "no radius column",
        lambda: build(good_frame().rename(columns={"radius": "r"})),
        ValueError,
        ["no column 'radius'", "'r'", "'pressure'"],
    ),
    (
        "a column twice",
        lambda: build(good_frame().rename(columns={"A": "pressure"})),
        ValueError,
        ["more than one column 'pressure'"],
    ),
    ("no rows", lambda: build(good_frame().iloc[:0]), ValueError, ["no rows"]),
    (
        "no specimen",
        lambda: build(changed("specimen", 12, None)),
        ValueError,
        ["row 12", "specimen is missing"],
    ),
    (
        "blank experiment",
        lambda: build(changed("experiment", 13, " ")),
        ValueError,
        ["row 13", "experiment is missing"],
    ),
    (
        "no group",
        lambda: build(changed("group", 13, np.nan)),
        ValueError,
        ["row 13", "group is missing"],
    ),
    (
        "nan radius",
        lambda: build(changed("radius", 13, np.nan)),
        ValueError,
        [S1E2, "row 13", "radius is missing"],
    ),
    (
        "infinite radius",
        lambda: build(changed("radius", 13, np.inf)),
        ValueError,
        [S1E2, "row 13", "radius is inf", "finite"],
    ),
    (
        "missing pressure",
        lambda: build(changed("pressure", 12, pd.NA)),
        ValueError,
        [S1E2, "row 12", "pressure is missing"],
    ),
    (
        "infinite pressure",
        lambda: build(changed("pressure", 12, -np.inf)),
        ValueError,
        [S1E2, "row 12", "pressure is -inf"],
    ),
    (
        "decimal comma",
        lambda: build(changed("pressure", 12, "12,5")),
        ValueError,
        [S1E2, "row 12", "pressure is '12,5', not a number"],
    ),
    (
        "text in radius",
        lambda: build(changed("radius", 10, "7.2 mm")),
        ValueError,
        ["specimen 'S1', experiment 1", "row 10", "radius is '7.2 mm', not a number"],
    ),
    (
        "truth value in radius",
        lambda: build(changed("radius", 10, True)),
        ValueError,
        ["row 10", "radius is True, not a number"],
    ),
    (
        "dates for pressures",
        lambda: build(good_frame().assign(pressure=pd.Timestamp("2020-01-01"))),
        ValueError,
        ["row 10", "pressure is Timestamp", "not a number"],
    ),
    (
        "zero radius",
        lambda: build(changed("radius", 13, 0.0)),
        ValueError,
        [S1E2, "row 13", "radius is 0 mm", "positive"],
    ),
    (
        "negative radius",
        lambda: build(changed("radius", 13, -8.1)),
        ValueError,
        [S1E2, "row 13", "radius is -8.1 mm", "positive"],
    ),
    (
        "zero inner radius",
        lambda: build(inner_radius=0),
        ValueError,
        ["specimen 'S1', experiment 1", "inner_radius is 0 mm", "positive"],
    ),
    (
        "nan inner radius",
        lambda: build(inner_radius=np.nan),
        ValueError,
        ["inner_radius is nan", "give None"],
    ),
    (
        "no wall",
        lambda: build(outer_radius=7.0),
        ValueError,
        ["outer_radius is 7 mm", "more than inner_radius"],
    ),
    (
        "inside out in one test",
        lambda: build(good_frame().assign(B=[9.0, 9.0, 6.0, 6.0, 9.0, 9.0]), outer_radius="B"),
        ValueError,
        [S1E2, "outer_radius is 6 mm", "more than inner_radius"],
    ),
    (
        "no axial stretch",
        lambda: build(axial_stretch=0.0),
        ValueError,
        ["axial_stretch is 0;", "positive"],
    ),
    (
        "degrees for radians",
        lambda: build(opening_angle="angle"),
        ValueError,
        ["opening_angle is 60 rad", 'angle_unit="deg"'],
    ),
    (
        "a full turn",
        lambda: build(opening_angle=360.0, angle_unit="deg"),
        ValueError,
        ["opening_angle is 6.28319 rad"],
    ),
    (
        "a full turn back",
        lambda: build(opening_angle=-360.0, angle_unit="deg"),
        ValueError,
        ["opening_angle is -6.28319 rad"],
    ),
    (
        "unknown geometry column",
        lambda: build(inner_radius="a0"),
        ValueError,
        ["inner_radius='a0'", "no such column", "'A', 'B'"],
    ),
    (
        "missing geometry",
        lambda: build(changed("A", 13, np.nan), inner_radius="A"),
        ValueError,
        [S1E2, "row 13", "A is missing"],
    ),
    (
        "text in geometry",
        lambda: build(changed("stretch", 13, "x"), axial_stretch="stretch"),
        ValueError,
        [S1E2, "row 13", "stretch is 'x', not a number"],
    ),
    (
        "geometry changes",
        lambda: build(changed("A", 13, 7.5), inner_radius="A"),
        ValueError,
        [S1E2, "row 13", "inner_radius is 7.5, but 7.0", "experiment label"],
    ),
    (
        "group changes",
        lambda: build(changed("group", 13, "C2")),
        ValueError,
        [S1E2, "row 13", "group is 'C2', but 'C1'"],
    ),
    (
        "truth value for geometry",
        lambda: build(axial_stretch=True),
        TypeError,
        ["axial_stretch is True", "a number, the name of a column, or None"],
    ),
    (
        "list for geometry",
        lambda: build(outer_radius=[9.0]),
        TypeError,
        ["outer_radius is [9.0]", "a number, the name of a column, or None"],
    ),
    (
        "unknown unit",
        lambda: build(pressure_unit="mmhg"),
        ValueError,
        ["pressure_unit='mmhg'", "not a known unit", "'mmHg'"],
    ),
    (
        "pressure in mm",
        lambda: build(pressure_unit="mm"),
        ValueError,
        ["pressure_unit='mm'", "does not measure pressure", "'kPa'"],
    ),
    (
        "radius in kPa",
        lambda: build(radius_unit="kPa"),
        ValueError,
        ["radius_unit='kPa'", "does not measure length", "'um'"],
    ),
    (
        "angle in mm",
        lambda: build(angle_unit="mm"),
        ValueError,
        ["angle_unit='mm'", "does not measure angle", "'deg'"],
    ),
    (
        "unknown specimen",
        lambda: select(build(), specimen="S9"),
        ValueError,
        ["no specimen 'S9'", "'S1', 'S2'"],
    ),
    (
        "unknown experiment",
        lambda: select(build(), experiment=[1, 7]),
        ValueError,
        ["no experiment 7", "1, 2"],
    ),
    (
        "nothing left",
        lambda: select(build(), specimen="S1", group="C2"),
        ValueError,
        [
            "no test with specimen=['S1'], group=['C2']",
            "group 'C1', specimen 'S1', experiment 1, 2",
        ],
    ),
    ("nothing asked for", lambda: select(build(), specimen=[]), ValueError, ["specimen=[]"]),
    ("frame for data", lambda: check_inflation_data(good_frame()), TypeError, ["inflation_data("]),
    (
        "dropped variable",
        lambda: check_inflation_data(build().drop_vars("opening_angle")),
        ValueError,
        ["lack 'opening_angle'", "'test'"],
    ),
    (
        "wrong dimension",
        lambda: check_inflation_data(build().assign(inner_radius=("obs", [7.0] * 6))),
        ValueError,
        ["'inner_radius' has dimensions ('obs',)", "('test',)"],
    ),
    (
        "other unit",
        lambda: check_inflation_data(
            build().assign(pressure=build()["pressure"].assign_attrs(units="mmHg"))
        ),
        ValueError,
        ["'pressure' is in 'mmHg'", "'kPa'"],
    ),
    (
        "text in data",
        lambda: check_inflation_data(with_values("radius", ["a"] * 6)),
        ValueError,
        ["'radius' must hold numbers"],
    ),
    (
        "nan in data",
        lambda: check_inflation_data(with_values("pressure", [1, 2, 3, np.nan, 5, 6])),
        ValueError,
        [S1E2, "row 13", "pressure is nan kPa", "finite"],
    ),
    (
        "nan in data without rows",
        lambda: check_inflation_data(
            with_values("pressure", [1, 2, np.nan, 4, 5, 6]).drop_vars("row")
        ),
        ValueError,
        [S1E2, "point 2", "pressure is nan kPa"],
    ),
    (
        "scattered points",
        lambda: check_inflation_data(with_values("test", [0, 0, 1, 2, 1, 2])),
        ValueError,
        [S1E2, "row 14", "stand together"],
    ),
    (
        "empty test",
        lambda: check_inflation_data(with_values("test", [0, 0, 0, 0, 2, 2])),
        ValueError,
        [S1E2, "no points", "select()"],
    ),
    (
        "test that is not there",
        lambda: check_inflation_data(with_values("test", [0, 0, 1, 1, 2, 3])),
        ValueError,
        ["from 0 to 3", "3 tests"],
    ),
    (
        "tests that are not counted",
        lambda: check_inflation_data(with_values("test", [0.0, 0, 1, 1, 2, 2])),
        ValueError,
        ["'test' must hold integers", "float64"],
    ),
    (
        "something else measured",
        lambda: build(measured="diameter"),
        ValueError,
        ["measured is 'diameter'", "'radius', 'outer_diameter'"],
    ),
    (
        "no diameter column",
        lambda: build(measured="outer_diameter"),
        ValueError,
        ["no column 'outer_diameter'", "'radius'"],
    ),
    (
        "missing diameter",
        lambda: by_diameter(with_diameters([20.0, 22.0, np.nan, 22.4, 19.8, 21.0])),
        ValueError,
        [S1E2, "row 12", "outer_diameter is missing"],
    ),
    (
        "negative diameter",
        lambda: by_diameter(with_diameters([20.0, 22.0, -20.4, 22.4, 19.8, 21.0])),
        ValueError,
        [S1E2, "row 12", "outer_diameter is -20.4 mm", "positive"],
    ),
    (
        "no room for the wall",  # which alone fills a diameter of 2 (9² − 7²)^½ = 11.3
        lambda: by_diameter(with_diameters([20.0, 22.0, 20.4, 11.0, 19.8, 21.0])),
        ValueError,
        [S1E2, "row 13", "radius is nan mm", "in which the wall has room"],
    ),
    (
        "no room for a wall that is known, beside one that is not",
        lambda: check_inflation_data(
            by_diameter().assign(
                inner_radius=("test", [7.0, 7.0, np.nan]),
                radius=("obs", [8.2, 9.3, np.nan, 9.5, np.nan, np.nan]),
            )
        ),
        ValueError,
        [S1E2, "row 12", "in which the wall has room"],
    ),
    (
        "text in force",
        lambda: build(good_frame().assign(axial_force=["1", "2", "3 mN", "4", "5", "6"])),
        ValueError,
        [S1E2, "row 12", "axial_force is '3 mN', not a number"],
    ),
    (
        "infinite force",
        lambda: build(good_frame().assign(axial_force=[1, 2, np.inf, 4, 5, 6])),
        ValueError,
        [S1E2, "row 12", "axial_force is inf", "finite"],
    ),
    (
        "force in kPa",
        lambda: build(good_frame().assign(axial_force=1.0), force_unit="kPa"),
        ValueError,
        ["force_unit='kPa'", "does not measure force"],
    ),
    (
        "nan for an unknown angle",
        lambda: build(opening_angle=np.nan),
        ValueError,
        ["opening_angle is nan", "give None"],
    ),
    (
        "unknown radius by hand",
        lambda: check_inflation_data(with_values("radius", [7.2, 8.0, np.nan, 8.1, 7.1, 7.6])),
        ValueError,
        [S1E2, "row 12", "radius is nan mm", "finite"],
    ),
    (
        "no points",
        lambda: check_inflation_data(build().isel(obs=slice(0, 0))),
        ValueError,
        ["no points"],
    ),
]


@pytest.mark.parametrize(
    ("call", "error", "fragments"), [row[1:] for row in BAD_DATA], ids=[row[0] for row in BAD_DATA]
)
def test_bad_data(call, error, fragments):
    """Each kind of bad input raises one error that names the place and what was expected."""
    with pytest.raises(error) as raised:
        call()
    message = str(raised.value)
    assert not [fragment for fragment in fragments if fragment not in message], message


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
    )
    from_numbers = build(axial_stretch=1.2, opening_angle=np.pi / 3)
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
        frame, **lengths, axial_stretch="stretch", opening_angle="angle", angle_unit="deg"
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
