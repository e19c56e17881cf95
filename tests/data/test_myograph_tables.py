"""Tables of pressure myographs and loggers are read, or refused with what to do."""

import re
from pathlib import Path

import numpy as np
import pytest
from written import HEAD, ROUNDING, ROWS, message_of

PAGE = Path(__file__).parents[2] / "docs" / "guides" / "file_format.md"
# A trace in the format of VasoTracker, with invented numbers; diameters are in micrometres.
TRACE = """Time (s),Time (hh:mm:ss),Outer Diameter,Inner Diameter,Table Marker,Temperature (oC),\
Pressure 1 (mmHg),Pressure 2 (mmHg),Avg Pressure (mmHg),Set Pressure (mmHg),Caliper length
0.0,00:00:00,142.1,103.5,,36.9,20.2,19.8,20.0,20,0
0.1,00:00:00,155.7,121.4,,36.9,40.1,39.9,40.0,40,0
0.2,00:00:00,163.2,131.6,1,37.0,60.2,59.8,60.0,60,0
"""
# A table of markers in the format of VasoTracker.
TABLE = "#,Time,Label,OD,ID,Pavg\n1,0.2,20 mmHg,142.1,103.5,20\n2,9.8,40 mmHg,155.7,121.4,40\n"
TUBE = {"specimen": "A1", "experiment": "1", "inner_radius": 45, "outer_radius": 65}
UNITS = {"radius_unit": "um", "pressure_unit": "mmHg"}
MMHG = 0.133322387415


def test_trace_of_a_myograph_is_refused_with_all_missing_settings(written):
    lines = message_of(written, TRACE).splitlines()
    assert lines[0] == f"{len(lines) - 1} problems:"
    for lacking in (
        "'Outer Diameter' has no unit: write it into the name, such as 'Outer Diameter [mm]', or "
        "say radius_unit in the settings",
        "'Inner Diameter' has no unit",
        "no column specimen, no column experiment: rename the one that holds it, or say what it is "
        "called, columns.specimen in the settings, or what it is in all rows, constants.specimen",
    ):
        assert any(lacking in line for line in lines), lacking
    message = message_of(written, TRACE, settings=UNITS | {"constants": TUBE})
    assert "say which was measured" in message


def test_trace_of_a_myograph_is_read_with_settings(written):
    settings = UNITS | {"constants": TUBE, "measured": "outer_diameter"}
    data = written(TRACE, settings=settings)
    np.testing.assert_allclose(data["outer_diameter"], [0.1421, 0.1557, 0.1632], rtol=ROUNDING)
    np.testing.assert_allclose(data["pressure"], [20 * MMHG, 40 * MMHG, 60 * MMHG], rtol=ROUNDING)
    data = written(TRACE, settings=settings | {"measured": "radius"})
    np.testing.assert_allclose(data["radius"], [0.05175, 0.0607, 0.0658], rtol=ROUNDING)


def test_outer_diameter_required_by_settings_but_in_no_column_is_refused(written):
    settings = {"measured": "outer_diameter"}
    message = message_of(written, f"{HEAD}\n{ROWS}", settings=settings)
    assert "'pressure_kPa', and no column outer_diameter: rename the one that holds it" in message


def test_settings_of_the_guide_read_a_trace_of_a_myograph(written):
    *_, toml = re.findall(r"```toml\n(.*?)```", PAGE.read_text("utf-8"), flags=re.DOTALL)
    data = written(TRACE, toml=toml)
    np.testing.assert_allclose(data["outer_diameter"], [0.1421, 0.1557, 0.1632], rtol=ROUNDING)
    assert data["inner_radius"].item() == 0.045


def test_table_of_markers_is_read_if_settings_name_its_columns(written):
    constants = {name: value for name, value in TUBE.items() if name != "specimen"}
    settings = UNITS | {"constants": constants, "measured": "outer_diameter"}
    message = message_of(written, TABLE, settings=settings)
    assert "'ID' may be specimen or inner_diameter: say which in the settings" in message
    settings |= {"constants": TUBE, "columns": {"inner_diameter": "ID"}}
    assert written(TABLE, settings=settings)["outer_diameter"].values.tolist() == [0.1421, 0.1557]


PREAMBLE = "Interval=\t0.1 s\nExcelDateTime=\t45292.4\nChannelTitle=\tPressure\tDiameter\n"
ABOVE = {
    "of a channel recorder": (PREAMBLE, "\t", "a.csv: lines 1 to 3 stand above the names of"),
    "with as many cells as the table": ("a,b,c,d\n" * 2, ",", "a.csv: lines 1 to 2 stand above"),
    "of one line": ("Log of 2024-05-01\n", ";", "a.csv: line 1 stands above the names of the"),
    "below a blank line": ("\n\nlog\nby hand\n", ",", "a.csv: lines 3 to 4 stand above the names"),
    "in sections": ("[HEADER]\n01-02-2024 10:00\n[DATA]\n", "\t", "a.csv: lines 1 to 3 stand"),
}


@pytest.mark.parametrize("above, separator, message", ABOVE.values(), ids=ABOVE)
def test_lines_above_the_column_names_are_refused_unless_marked_as_remarks(
    above, separator, message, written
):
    table = f"{HEAD}\n{ROWS}".replace(",", separator)
    found = message_of(written, above + table)
    assert found.startswith(message) and "begin each line above the names with #" in found
    remarks = "".join(f"# {line}\n" if line else "\n" for line in above.splitlines())
    assert written(remarks + table).drop_vars("row").equals(written(table).drop_vars("row"))


def test_column_names_stated_in_settings_are_found_below_a_preamble(written):
    table = "Probe;Versuch;Ri;Druck\nS1;1;7,2;1,0\nS1;1;8,4;6,5\n"
    settings = {"columns": {"specimen": "Probe", "experiment": "Versuch"}}
    settings["columns"] |= {"radius": "Ri", "pressure": "Druck"}
    settings |= {"radius_unit": "mm", "pressure_unit": "kPa"}
    assert written(table, settings=settings).sizes["obs"] == 2
    message = message_of(written, f"Protokoll\n{table}", settings=settings)
    assert message.startswith("a.csv: line 1 stands above the names of the columns, which are in")
