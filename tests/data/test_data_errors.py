"""Invalid tables and Datasets are refused with one error that says where and why.

See also ``test_tube_statements.py``, ``test_row_order.py`` and ``test_plausible_ranges.py``.
"""

import numpy as np
import pandas as pd
import pytest
from tables import SECTOR, build, by_diameter, changed, good_frame, with_diameters, with_values

from pymc_hyperelastic.data.inflation import check_data

S1E1 = "specimen 'S1', experiment 1"
S1E2 = "specimen 'S1', experiment 2"
DIAMETERS = [20.0, 22.0, 20.4, 22.4, 19.8, 21.0]


def diameters(row: int, value: float):
    return by_diameter(with_diameters([*DIAMETERS[:row], value, *DIAMETERS[row + 1 :]]))


def renamed(**names: str):
    return build(good_frame().rename(columns=names))


def cell(column: str, row: int, value: object, **arguments):
    """Build data of the good frame with one value replaced."""
    return build(changed(column, row, value, cycle=1, phase="up", axial_force=1.0), **arguments)


# A call, and a regular expression of its ValueError.
BAD_TABLE = {
    # Columns.
    "no radius column": (lambda: renamed(radius="r"), "no column 'radius'; it has .*'r', 'pres"),
    "two columns missing": (
        lambda: renamed(experiment="x", pressure="y"), "'experiment' and no column",
    ),
    "diameter column without measured=": (
        lambda: build(with_diameters()), "'radius'.*measured='outer_diameter'",
    ),
    "column twice": (lambda: renamed(A="pressure"), "more than one column 'pressure'"),
    "no rows": (lambda: build(good_frame().iloc[:0]), "no rows"),
    "unknown measured quantity": (
        lambda: build(measured="diameter"), "'diameter'.*'radius', 'outer_diameter'",
    ),
    # Labels.
    "no specimen": (lambda: cell("specimen", 12, pd.NA), "row 12: specimen is missing"),
    "form feed": (lambda: cell("specimen", 12, "S\x0c1"), r"12: .*the label 'S\\x0c1' has the cha"),
    "group changes within a test": (
        lambda: cell("group", 13, "C2"), f"{S1E2}.* 13: group is 'C2', but 'C1'",
    ),
    # Numbers.
    "missing radius": (lambda: cell("radius", 13, pd.NA), f"{S1E2}.*, row 13: radius is missing"),
    "minus infinity": (lambda: cell("pressure", 12, -np.inf), "row 12: pressure is -inf"),
    "decimal comma": (lambda: cell("pressure", 12, "12,5"), "'12,5', not a number.*decimal points"),
    "truth value": (lambda: cell("radius", 10, True), "row 10: radius is True, not a number"),
    "date": (lambda: cell("pressure", 10, pd.Timestamp(0)), "row 10: pressure is Timestamp.*not a"),
    "too large for a float": (
        lambda: cell("pressure", 12, 10**400), "row 12: pressure is 1000*…, not a",
    ),
    "zero radius": (lambda: cell("radius", 13, 0.0), f"{S1E2}.*, row 13: radius is 0 mm.*positive"),
    "infinite force": (lambda: cell("axial_force", 12, np.inf), "axial_force is inf.*finite"),
    "negative diameter": (lambda: diameters(2, -20.4), f"{S1E2}, row 12: .*-20.4 mm.*positive"),
    # The wall without a lumen has a diameter of 2 (9² − 7²)^½ = 11.314 mm.
    "no room for the wall": (
        lambda: diameters(3, 11.31),
        f"{S1E2}, row 13: outer_diameter is 11.31 mm; .*the wall has room.*inner diameter",
    ),
    # The tube.
    "no inner radius": (lambda: build(inner_radius=0), f"{S1E1}: inner_radius is 0 mm.*positive"),
    "radii exchanged in one test": (
        lambda: build(good_frame().assign(B=[9.0, 9.0, 6.0, 6.0, 9.0, 9.0]), outer_radius="B"),
        f"{S1E2}: outer_radius is 6 mm.*more than inner_radius.*exchanged",
    ),
    "no stretch": (lambda: build(axial_stretch=0.0), "axial_stretch is 0;.*positive"),
    "angle in degrees": (
        lambda: build(opening_angle="angle", **SECTOR), '60 rad.*angle_unit="deg"',
    ),
    "no such column": (lambda: build(inner_radius="a0"), "='a0'.*no such column.*'A', 'B'"),
    "gap in a column": (lambda: cell("A", 13, None, inner_radius="A"), "row 13: A is missing"),
    "inner radius changes within a test": (
        lambda: cell("A", 13, 7.5, inner_radius="A"), "row 13: .* 7.5, but 7.0",
    ),
    "unknown measure in sd": (lambda: build(sd={"weight": 1.0}), "'weight'; expected some of"),
    "negative error": (lambda: build(sd={"thickness": -1.0}), f"{S1E1}: .*is -1; exp"),
    # Units.
    "radius in kPa": (lambda: build(radius_unit="kPa"), "radius_unit='kPa' does not measure le"),
}  # fmt: skip


@pytest.mark.parametrize("call, message", BAD_TABLE.values(), ids=BAD_TABLE)
def test_bad_table_is_refused_with_place_and_value(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_all_wrong_cells_of_a_table_are_reported_at_once():
    frame = changed("radius", 11, "8,0", axial_force=1.0).astype({"pressure": object})
    frame.loc[14, "pressure"] = None
    with pytest.raises(ValueError) as error:
        build(frame)
    assert str(error.value).splitlines() == [
        "2 problems:",
        f"- {S1E1}, row 11: radius is '8,0', not a number; correct it (decimal points, no units)",
        "- specimen 'S2', experiment 1, row 14: pressure is missing (nan); fill it or drop the row",
    ]


def test_arguments_of_a_wrong_type_are_refused():
    for call, message in (
        (lambda: build([1, 2]), "pandas DataFrame, not list"),
        (lambda: build(axial_stretch=True), "axial_stretch is True.*a number"),
        (lambda: build(sd=0.1), "sd must be a dict.*not float"),
        (lambda: check_data(good_frame()), r"inflation_data\(frame"),
    ):
        with pytest.raises(TypeError, match=message):
            call()


NAN = np.nan
IN_MMHG = build()["pressure"].assign_attrs(units="mmHg")
# A Dataset that was changed by hand, and a regular expression of its ValueError.
BAD_DATASET = {
    "variable dropped": (build().drop_vars("opening_angle"), "lack 'opening_angle'.*'test'"),
    "dimension": (build().assign(inner_radius=("obs", [7.0] * 6)), "'inner_radius' has dimensions"),
    "where() on all variables": (
        build().where(build()["pressure"] > 0, drop=True),
        r"has dimensions.*select them by data\.isel\(obs=condition\)",
    ),
    "other unit": (build().assign(pressure=IN_MMHG), "'pressure' is in 'mmHg'; expected 'kPa'"),
    "text": (with_values("radius", ["7"] * 6), "'radius' must hold numbers, not <U"),
    "nan": (with_values("pressure", [1, 2, 3, NAN, 5, 6]), f"{S1E2}, row 13: pressure is nan kPa"),
    "radius unknown": (with_values("radius", [7, 8, NAN, 8, 7, 8]), "row 12: radius is nan mm"),
    "points of a test apart": (
        with_values("test", [0, 0, 1, 2, 1, 2]), f"{S1E2}, row 14: .*stand together",
    ),
    "empty test": (with_values("test", [0, 0, 0, 0, 2, 2]), rf"{S1E2} has no points.*select\(\)"),
    "test -1": (with_values("test", [-1, 0, 1, 1, 2, 2]), "from -1 to 2"),
    "test twice": (
        build().assign_coords(experiment=("test", [1, 1, 1])),
        rf"tests 0 and 1 have the same labels \({S1E1}, row 10 and {S1E1}, row 12\): give one",
    ),
    "specimen in two groups": (
        build().assign_coords(specimen=("test", ["S1"] * 3), experiment=("test", [1, 2, 3])),
        rf"specimen 'S1' is in group 'C1' \({S1E1}\) and in group 'C2' .*experiment 3\): .*names",
    ),
    "no points": (build().isel(obs=slice(0, 0)), "no points"),
    "negative error": (
        build(sd={"wall_area": 0.0}).assign(wall_area_sd=("test", [0.0, -1e-9, 0.0])),
        f"{S1E2}: wall_area_sd is -1e-09 mm2; expected a standard deviation",
    ),
}  # fmt: skip


@pytest.mark.parametrize("data, message", BAD_DATASET.values(), ids=BAD_DATASET)
def test_dataset_changed_by_hand_is_refused(data, message):
    with pytest.raises(ValueError, match=message):
        check_data(data)
