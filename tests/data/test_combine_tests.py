"""combine_tests joins tests of tubes and of sheets in one Dataset."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from sheet_tables import by_hand, joint_by_hand
from tables import build, by_diameter, curve
from written import message_of

import pymc_hyperelastic as ph
from pymc_hyperelastic.data.inflation import at_points, check_data, extension_tests
from pymc_hyperelastic.data.sheets import sheets_of, tubes_of

TUBES = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S4", experiment=[1, 2])
SHEETS = by_hand(specimen=["S3", "S3"])
EXTENDED = curve(np.linspace(7.2, 9.6, 9), axial_stretch=np.linspace(1.1, 1.3, 9))


def test_tubes_and_sheets_give_joint_data_that_come_apart_again(tmp_path):
    data = ph.combine_tests(TUBES, by_hand())
    xr.testing.assert_equal(data, joint_by_hand())
    for name in ("pressure", "inner_radius", "stretch_x", "specimen", "stress_measure"):
        assert data[name].attrs == (TUBES if name in TUBES else by_hand())[name].attrs
    xr.testing.assert_equal(sheets_of(data), by_hand())
    tubes = tubes_of(data).assign_coords(experiment=("test", [1, 2]))
    xr.testing.assert_equal(tubes, TUBES)
    assert data.attrs == TUBES.attrs
    data.to_netcdf(tmp_path / "data.nc", engine="h5netcdf")
    loaded = xr.load_dataset(tmp_path / "data.nc", engine="h5netcdf")
    check_data(loaded)
    xr.testing.assert_identical(loaded, data)
    back = ph.combine_tests(by_hand(), TUBES)
    assert back["stress_measure"].values.tolist() == ["cauchy", "nominal", "", ""]
    xr.testing.assert_equal(ph.select(back, "S4"), ph.select(data, "S4"))


def test_parts_of_data_of_one_kind_are_combined_unchanged():
    for data in (ph.load_dataset("simulated_sheep_aorta"), by_hand()):
        parts = [ph.select(data, None, name) for name in dict.fromkeys(data["experiment"].values)]
        whole = ph.combine_tests(*parts)
        assert set(whole.variables) == set(data.variables)
        for each in parts:
            labels = {name: each[name].values.tolist() for name in ("specimen", "experiment")}
            xr.testing.assert_identical(ph.select(whole, **labels), each)
        xr.testing.assert_identical(ph.combine_tests(data), data)


def test_extension_tests_forces_and_labels_of_some_datasets_are_kept():
    extended = build(EXTENDED.assign(axial_force=2.0, cycle=3), axial_stretch="axial_stretch")
    plain = build(curve(specimen="S2")).assign_coords(age=("test", [7.5]), animal=("test", ["M1"]))
    data = ph.combine_tests(plain, extended, by_hand(specimen=["S3", "S3"], row=None))
    assert data["axial_stretch"].dims == ("obs",) and "row" not in data.variables
    assert extension_tests(data).tolist() == [False, True, False, False]
    stretch = at_points(data, "axial_stretch")
    np.testing.assert_array_equal(stretch[:18], [1.0] * 9 + EXTENDED["axial_stretch"].tolist())
    assert np.isnan(stretch[18:]).all() and np.isnan(data["axial_force"].values[:9]).all()
    assert data["cycle"].values.tolist() == ["", "3", "", ""]
    assert data["animal"].values.tolist() == ["M1", "", "", ""]
    np.testing.assert_array_equal(data["age"], [7.5, np.nan, np.nan, np.nan])
    assert data["test"].values.tolist() == [0] * 9 + [1] * 9 + [2, 2, 3, 3]
    own = ph.select(data, "S2")
    assert own["axial_stretch"].dims == ("test",) and own["axial_stretch"].item() == 1.0


def test_titles_and_sources_are_joined_and_simulated_stays_said():
    measured = ph.load_dataset("murine_pulmonary_artery")
    data = ph.combine_tests(measured, ph.load_dataset("simulated_sheep_aorta"))
    assert data.attrs["simulated"] == 1
    assert data.attrs["title"] == (
        "Mouse left pulmonary artery, control and hypertensive, SIMULATED sheep aorta"
    )
    for part in (measured, ph.load_dataset("simulated_sheep_aorta")):
        assert part.attrs["source"] in data.attrs["source"]
    notes = [by_hand(specimen=[s, s]).assign_attrs(note=n, kind="a") for s, n in ("Ax", "By")]
    assert ph.combine_tests(*notes).attrs == {"kind": "a"}


# A call, and its ValueError.
REFUSED = {
    "none": (
        lambda: ph.combine_tests(),
        "there are no datasets: give one or more, combine_tests(tubes, sheets)",
    ),
    "same labels": (
        lambda: ph.combine_tests(
            build(), by_hand(experiment=["1", "2"], stress_measure=["cauchy", "cauchy"])
        ),
        "datasets 1 and 2 both have specimen 'S1', experiment '1': give the tests of one dataset "
        "other labels, such as data.assign_coords(experiment='sheet ' + "
        "data['experiment'].astype(str))",
    ),
    "two groups": (
        lambda: ph.combine_tests(build(), by_hand()),
        "specimen 'S1' is in group 'C1' in dataset 1 and in group 'all' in dataset 2: a specimen "
        "has one group. Give the tables of both a column 'group', or the specimens different names",
    ),
    "unsound": (
        lambda: ph.combine_tests(build(), by_hand(stretch_x=[-1.0, 1.2, 1.1, 1.3])),
        "dataset 2: specimen 'S1', experiment 'biaxial', row 10: stretch_x is -1; expected a "
        "positive ratio of lengths, 1 for an unstretched sheet: was a strain given?",
    ),
    "diameters of some": (
        lambda: ph.combine_tests(SHEETS, build(curve(specimen="S8")), by_diameter()),
        "the tubes of dataset 3 have 'outer_diameter', and those of dataset 2 do not: combine "
        "tubes that were measured in the same way, or say measured='radius'",
    ),
    "errors of some": (
        lambda: ph.combine_tests(build(sd={"thickness": 0.1}), build(curve(specimen="S9"))),
        "the tubes of dataset 1 have 'thickness_sd', and those of dataset 2 do not: state it for "
        "all tubes, or drop it, data.drop_vars('thickness_sd')",
    ),
    "other dimensions": (
        lambda: ph.combine_tests(by_hand().assign(image=("pixel", [1, 2]))),
        "dataset 1: 'image' has dimensions ('pixel',); expected ('obs',) or ('test',): drop it, "
        "data.drop_vars('image')",
    ),
}  # fmt: skip


@pytest.mark.parametrize("call, message", REFUSED.values(), ids=REFUSED)
def test_datasets_that_do_not_fit_together_are_refused(call, message):
    assert message_of(call) == message


def test_other_objects_than_datasets_are_refused():
    with pytest.raises(TypeError, match=r"in a list: give them by themselves, combine_tests\(\*l"):
        ph.combine_tests([by_hand()])
    with pytest.raises(TypeError, match=r"dataset 1: inflation data are an xarray\.Dataset, not D"):
        ph.combine_tests(pd.DataFrame())


def test_advice_for_equal_labels_works():
    sheets = by_hand(experiment=["1", "2"], group=["C1", "C1"])
    sheets = sheets.assign_coords(experiment="sheet " + sheets["experiment"].astype(str))
    data = ph.combine_tests(build(), sheets)
    assert data["experiment"].values.tolist() == ["1", "2", "1", "sheet 1", "sheet 2"]
