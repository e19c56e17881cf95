"""Settings of read_tests complete the tables, or are refused with the expected form."""

import numpy as np
import pytest
from written import HEAD, KPA_10, KPA_45, ROUNDING, ROWS, message_of

TUBE = ("inner_radius", "outer_radius", "axial_stretch", "group")


def test_missing_units_are_refused_unless_settings_state_them(written):
    bare = "specimen,experiment,radius,pressure\nS1,1,7.2,10\nS1,1,8.0,45\n"
    lines = message_of(written, bare).splitlines()
    assert lines[0] == "2 problems:" and len(lines) == 3
    assert "'radius' has no unit: " in lines[1] and "radius_unit in the settings" in lines[1]
    assert "'pressure [kPa]', or say pressure_unit" in lines[2]
    for settings in ({"pressure_unit": "mmHg"}, {"units": {"pressure": "mmhg"}}):
        data = written(bare, settings={"radius_unit": "mm"} | settings)
        np.testing.assert_allclose(data["pressure"], [KPA_10, KPA_45], rtol=ROUNDING)
    # A unit in the name of a column comes first.
    data = written(f"{HEAD}\n{ROWS}", settings={"pressure_unit": "mmHg"})
    assert data["pressure"].values.tolist() == [1.0, 6.5]


def test_constants_replace_missing_columns_only_and_need_units(written):
    toml = """
measured = "radius"
[units]
inner_radius = "um"
thickness = "mm"
[constants]
inner_radius = 7000
thickness_um = 2000
class = "C1"
[files."a.csv"]
"axial stretch [%]" = 120
"""
    table = f"{HEAD}\n{ROWS}"
    data = written(table, toml=toml)
    assert [data[name].item() for name in TUBE] == [7.0, 9.0, 1.2, "C1"]
    assert (
        "the same in all rows of all files: inner_radius 7 mm, thickness 2 mm, group 'C1'\n"
        "the same in all rows of a.csv: axial_stretch 1.2\n"
    ) in data.attrs["understood"]
    halved = written(table, settings={"constants": {"unloaded inner diameter (mm)": 14}})
    assert halved["inner_radius"].item() == 7.0
    message = message_of(written, table, settings={"constants": {"inner_radius": 7}})
    assert message.startswith(
        "settings: constants.inner_radius is 7, without a unit: state its unit"
    )
    message = message_of(written, table, settings={"constants": {"specimen": "S9"}})
    assert message.startswith("specimen is 'S9' in the settings, and a.csv has a column of it, 'sp")


def test_opening_angle_without_convention_and_reference_is_refused(written):
    table, angle = f"{HEAD}\n{ROWS}", {"constants": {"opening_angle_deg": 60}}
    message = message_of(written, table, settings=angle)
    assert 'say which is meant: opening_angle_convention="whole" if it is' in message
    assert 'say which are given: radii_of="ring"' in message and "Tube" not in message
    settings = angle | {"opening_angle_convention": "fung", "radii_of": "sector"}
    data = written(table, settings=settings)
    np.testing.assert_allclose(data["opening_angle"], 2 * np.pi / 3, rtol=ROUNDING)


def test_labels_can_be_constants_of_each_file(written):
    table = "radius_mm,pressure_kPa\n7.2,1.0\n8.4,6.5\n"
    specimens = {"a.csv": {"specimen": "01"}, "b.csv": {"specimen": "02"}}
    settings = {"constants": {"experiment": 1}, "files": specimens}
    data = written(table, table.replace("8.4", "8.5"), settings=settings)
    assert data["specimen"].values.tolist() == ["01", "02"]
    assert data["experiment"].values.tolist() == [1, 1]
    message = message_of(written, table, settings=settings)
    assert message.startswith("files.'b.csv' of the settings is not among the files, 'a.csv'")


# TOML, and the beginning of its message.
BAD = {
    "invalid TOML": ("a = ", "study.toml is not a TOML file in UTF-8: "),
    "likelihood": ("likelihood = '2 mmHg'", "study.toml: likelihood is '2 mmHg'; expected"),
    "size of an error": (
        "likelihood = {sigma = [1]}", "study.toml: likelihood.sigma is [1]; expected",
    ),
    "unknown key": (
        "presure_unit = 'kPa'", "study.toml: 'presure_unit' is not known; expected some of",
    ),
    "unit of another quantity": (
        "pressure_unit = 'mm'", "study.toml: pressure_unit is 'mm', which is not a known",
    ),
    "unknown column": (
        "columns = {druck = 'P'}", "study.toml: columns has 'druck', which is not known",
    ),
    "constants": ("files = {'a.csv' = 1}", "study.toml: files.'a.csv': constants is 1; exp"),
    "number for a name": ("columns = {pressure = 1}", "study.toml: columns.pressure is 1; exp"),
    "column of no file": ("columns = {pressure = 'P'}", "2 problems:\n- columns.pressure of"),
    "number as text": (
        "constants = {thickness = '1 mm'}", "study.toml: constants.thickness is '1 mm'; exp",
    ),
    "two names": ("constants = {thickness_um = 62, thickness_mm = 1}", "study.toml: constants has"),
    "infinity": ("constants = {thickness = inf}", "study.toml: constants.thickness is inf; expec"),
    "not a list": ("ignore = 'P'", "study.toml: ignore is 'P'; expected a list of column names"),
    "unknown choice of cycles": (
        "cycles = 'first'", "study.toml: cycles is 'first'; expected one of ('last', '",
    ),
}  # fmt: skip


@pytest.mark.parametrize("toml, expected", BAD.values(), ids=BAD)
def test_wrong_settings_are_refused_with_what_was_expected(toml, expected, written):
    assert message_of(written, f"{HEAD}\n{ROWS}", toml=toml).startswith(expected)
