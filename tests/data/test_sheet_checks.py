"""Data of sheets, and of sheets and tubes, are checked and selected."""

import numpy as np
import pytest
import xarray as xr
from sheet_tables import NAN, by_hand, joint_by_hand

from pymc_hyperelastic.data.datasets import load_dataset
from pymc_hyperelastic.data.inflation import check_data
from pymc_hyperelastic.data.select import select, specimens_apart, units_of, without_specimens
from pymc_hyperelastic.data.sheets import sheet_tests, sheets_of, tubes_of
from pymc_hyperelastic.quantities import SHEET_VARIABLES

S1B, S1U = "specimen 'S1', experiment 'biaxial'", "specimen 'S1', experiment 'uniaxial'"


def of_both(**changed: dict[int, float]) -> xr.Dataset:
    """Build joint data with values replaced at positions."""
    data = joint_by_hand()
    for name, at in changed.items():
        values = data[name].values.copy()
        for position, value in at.items():
            values[position] = value
        data[name] = (data[name].dims, values)
    return data


def test_sheets_alone_and_joint_data_are_accepted():
    check_data(by_hand())
    check_data(by_hand(row=None, stress_measure=["nominal", "nominal"]))
    check_data(joint_by_hand())
    check_data(joint_by_hand(inner_radius=[NAN, 7.0, NAN, NAN]))


# Data of sheets, and the ValueError.
BAD_SHEETS = {
    "zero stretch": (
        by_hand(stretch_x=[0.0, 1.2, 1.1, 1.3]),
        f"{S1B}, row 10: stretch_x is 0; expected a positive ratio of lengths, 1 for an "
        "unstretched sheet: was a strain given?",
    ),
    "infinite stretch": (
        by_hand(stretch_y=[1.0, np.inf, NAN, NAN]),
        f"{S1B}, row 11: stretch_y is inf; expected a positive ratio of lengths, 1 for an "
        "unstretched sheet: was a strain given?",
    ),
    "both stretches missing": (
        by_hand(stretch_x=[1.0, 1.2, 1.1, NAN], stress_x=[0.0, 9.0, 4.0, NAN]),
        f"{S1U}, row 13: stretch_x is nan; expected a number: both stretches are missing",
    ),
    "stress in a free direction": (
        by_hand(stress_y=[0.1, NAN, NAN, 0.0]),
        f"{S1U}, row 13: stress_y is 0 kPa; expected nan, as the sheet is free along y: stretch_y "
        "is nan",
    ),
    "no stress": (
        by_hand(stress_x=[0.0, NAN, 4.0, 12.0]),
        f"{S1B}, row 11: stress_x is nan kPa; expected a number: both stresses are missing; drop "
        "the row",
    ),
    "infinite stress": (
        by_hand(stress_x=[0.0, np.inf, 4.0, 12.0]),
        f"{S1B}, row 11: stress_x is inf kPa; expected a finite number, or nan if it was not "
        "measured",
    ),
    "stretch of tests": (
        by_hand(stretch_x=("test", [1.0, 1.2])),
        "'stretch_x' has dimensions ('test',); expected ('obs',). If points were selected by "
        "`where`, select them by data.isel(obs=condition)",
    ),
    "measure of points": (
        by_hand(stress_measure=("obs", ["cauchy"] * 4)),
        "'stress_measure' has dimensions ('obs',); expected ('test',)",
    ),
    "unknown measure": (
        by_hand(stress_measure=["cauchy", "kirchhoff"]),
        "stress_measure of test 1 is 'kirchhoff'; expected one of ('cauchy', 'nominal'), or '' "
        "for a test of a tube",
    ),
    "no measure": (
        by_hand(stress_measure=None),
        "the data hold 'stretch_x' of sheets, and lack 'stress_measure' (dimension 'test'), "
        "'cauchy' or 'nominal' for tests of sheets and '' for tests of tubes: make data of sheets "
        "with sheet_data(frame, ...)",
    ),
    "no stress of y": (
        by_hand(stress_y=None), "the data of sheets lack 'stress_y' (dimension 'obs')",
    ),
    "other unit": (
        by_hand(stress_x=("obs", [0.0, 9.0, 4.0, 12.0], {"units": "MPa"})),
        "'stress_x' is in 'MPa'; expected 'kPa': convert it",
    ),
    "text": (by_hand(stretch_x=["1", "2", "3", "4"]), "'stretch_x' must hold numbers, not <U1"),
    "pressure of sheets": (
        by_hand(pressure=("obs", [NAN] * 4)),
        "the data are of sheets alone, and hold 'pressure' of tubes: drop it, "
        "data.drop_vars('pressure')",
    ),
    "test twice": (
        by_hand(experiment=["a", "a"]),
        "tests 0 and 1 have the same labels (specimen 'S1', experiment 'a', row 10 and specimen "
        "'S1', experiment 'a', row 12): give one of them another experiment or specimen, "
        "data.assign_coords(experiment=('test', [...]))",
    ),
    "specimen in two groups": (
        by_hand(group=["A", "B"]),
        f"specimen 'S1' is in group 'A' ({S1B}) and in group 'B' ({S1U}): a specimen has one "
        "group. Give the specimens of the two groups different names",
    ),
    "stress of a tube": (
        of_both(stress_x={1: 3.0}),
        "specimen 'S4', experiment '1', row 181: stress_x is 3 kPa; expected nan, as the test is "
        "of a tube",
    ),
    "pressure of a sheet": (
        of_both(pressure={41: 3.0}),
        f"{S1B}, row 11: pressure is 3 kPa; expected nan, as the test is of a sheet",
    ),
    "no pressure of a tube": (
        of_both(pressure={1: NAN}),
        "specimen 'S4', experiment '1', row 181: pressure is nan kPa; expected a finite number",
    ),
    "radii of a tube": (
        of_both(outer_radius={1: 6.0}),
        "specimen 'S4', experiment '2': outer_radius is 6 mm; expected more than inner_radius: "
        "were the two exchanged, or is one a diameter?",
    ),
    "no sheet": (
        joint_by_hand().drop_vars("stretch_x"),
        "the data of tubes and sheets lack 'stretch_x' (dimension 'obs')",
    ),
}  # fmt: skip


@pytest.mark.parametrize("data, message", BAD_SHEETS.values(), ids=BAD_SHEETS)
def test_unsound_data_of_sheets_are_refused_with_place_and_value(data, message):
    with pytest.raises(ValueError) as error:
        check_data(data)
    assert str(error.value) == message


def test_parts_of_joint_data_have_the_variables_of_their_kind():
    joint, tubes = joint_by_hand(), load_dataset("simulated_sheep_aorta")
    assert sheet_tests(joint).tolist() == [False, False, True, True]
    assert not sheet_tests(tubes).any() and sheet_tests(by_hand()).all()
    own = select(joint, "S4")
    assert set(own.variables) == set(tubes.variables)
    np.testing.assert_array_equal(own["pressure"], select(tubes, "S4", [1, 2])["pressure"])
    xr.testing.assert_equal(tubes_of(joint), own)
    sheets = select(joint, "S1")
    xr.testing.assert_equal(sheets, by_hand())
    xr.testing.assert_equal(sheets_of(joint), by_hand())
    xr.testing.assert_equal(
        select(joint, stress_measure="cauchy"), select(by_hand(), None, "biaxial")
    )
    apart = specimens_apart(joint)
    xr.testing.assert_equal(apart["S1"], sheets)
    xr.testing.assert_equal(without_specimens(joint, ["S1"]), own)
    for part in (own, *apart.values(), select(joint, None, ["1", "biaxial"])):
        check_data(part)
    assert units_of(joint, "specimen") == {"S4": [0, 1], "S1": [2, 3]}
    assert [*units_of(joint, "test")][2:] == [S1B, S1U]
    assert tubes_of(by_hand()) is None and sheets_of(tubes) is None
    assert tubes_of(tubes) is tubes
    mixed = select(joint, None, ["1", "biaxial"])
    assert {*SHEET_VARIABLES, "pressure", "stress_measure"} < set(mixed.variables)
