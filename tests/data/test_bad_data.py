"""A table that is not inflation data is refused with one error that says where and why not."""

import numpy as np
import pandas as pd
import pytest
from tables import SECTOR, build, by_diameter, changed, good_frame, with_diameters, with_values

from pymc_hyperelastic.data.inflation import check_inflation_data
from pymc_hyperelastic.data.select import select

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
        "several columns missing",
        lambda: build(good_frame().drop(columns=["experiment", "pressure"])),
        ValueError,
        ["no column 'experiment' and no column 'pressure'", "rename(columns="],
    ),
    (
        "a diameter in place of the radius",
        lambda: build(with_diameters()),
        ValueError,
        ["no column 'radius'", "measured='outer_diameter'"],
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
        lambda: build(opening_angle="angle", **SECTOR),
        ValueError,
        ["opening_angle is 60 rad", 'angle_unit="deg"'],
    ),
    (
        "a full turn",
        lambda: build(opening_angle=360.0, angle_unit="deg", **SECTOR),
        ValueError,
        ["opening_angle is 6.28319 rad"],
    ),
    (
        "a full turn back",
        lambda: build(opening_angle=-360.0, angle_unit="deg", **SECTOR),
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
