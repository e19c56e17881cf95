"""read_tests reads the files of laboratories, or refuses them with a list of all problems.

The files are in ``messy/``. Their numbers in kPa and mm are written out here by hand.
"""

import io
import os
import re
import tomllib
import zipfile
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from written import HEAD, KPA_10, KPA_45, ROUNDING, ROWS, message_of

import pymc_hyperelastic as ph
from pymc_hyperelastic.data.files.headers import names_of
from pymc_hyperelastic.data.files.settings import settings_of
from pymc_hyperelastic.data.inflation import check_data
from pymc_hyperelastic.quantities import DIAMETERS, IN_TABLES, OF_SHEETS, SHEET_VARIABLES, UNITS

PAGE = Path(__file__).parents[2] / "docs" / "guides" / "file_format.md"
MESSY = Path(__file__).parent / "messy"


def read(files: str, settings: dict | None = None, **arguments) -> xr.Dataset:
    return ph.read_tests([MESSY / name for name in files.split()], settings, **arguments)


NAN = np.nan
# The ring of M1, of radii 0.3875 and 0.45 mm, opens by 180° as a whole: k = 2, and the radii of the
# sector are larger by that of the wall's middle, 0.41875. r² = 0.52525² - (b² - a²) / 1.5
M1_WALL, M2_WALL = 0.05234375 / 1.5, 0.0504 / 1.5
M2_SHIFT = 161 / 199 * 0.42
# Files, settings, and the variables and labels that are in them.
UNDERSTOOD = {
    "units in names": ("units_in_names.csv", {}, {
        "radius": [7.2, 8.0], "pressure": [KPA_10, KPA_45], "inner_radius": [7.0],
        "outer_radius": [9.0], "axial_stretch": [1.2], "opening_angle": [0.0], "group": ["all"],
    }),
    "decimal commas in Latin-1, with settings": ("decimal_comma.csv decimal_comma.toml", None, {
        "specimen": ["M1", "M2"],
        "outer_diameter": [1.0505, 1.16, 1.02, 1.1405],
        "pressure": [KPA_10, 6 * KPA_10, 1.25 * KPA_10, 6.5 * KPA_10],
        "inner_radius": [0.80625, 0.39 + M2_SHIFT], "outer_radius": [0.86875, 0.45 + M2_SHIFT],
        "radius": [
            (0.2758875625 - M1_WALL) ** 0.5, (0.3364 - M1_WALL) ** 0.5,
            (0.2601 - M2_WALL) ** 0.5, (0.3251850625 - M2_WALL) ** 0.5,
        ],
        "axial_stretch": [1.5, 1.5], "opening_angle": [np.pi, 161 / 180 * np.pi],
    }),
    "minus signs": ("negative_pressures.csv", {}, {"pressure": [-0.4, -0.1, 6.5, 11.0]}),
    "labels of integers": ("integer_labels.csv", {}, {"specimen": ["1", "01", "1.0"]}),
    "other units in another file": ("monday.csv tuesday.csv", {}, {
        "specimen": ["S1", "S2"], "radius": [7.2, 8.0, 7.25, 8.05],
        "pressure": [KPA_10, KPA_45, 1.5, 6.25], "inner_radius": [7.0, 7.0],
    }),
    # r² = 5.10025² - (5² - 4²), 5.5² - 9
    "tabs, and commas between thousands": ("thousands.txt", {}, {
        "outer_diameter": [10.2005, 11.0], "radius": [17.0125500625**0.5, 21.25**0.5],
        "pressure": [1.2345, 12.0],
    }),
    "units in a line of their own, a force not measured": ("two_line_header.tsv", {}, {
        "radius": [7.2, 8.0], "pressure": [KPA_10, KPA_45], "axial_force": [NAN, 12.5],
    }),
    "decimal commas": ("commas_either.txt", {"decimal": ","}, {"radius": [7.25, 8.125]}),
    "ignored column": ("column_twice.csv", {"ignore": ["P"]}, {"pressure": [KPA_10]}),
    # (0.45² - 0.5 / 3 / π)^½, (0.44² - 0.45 / 2.9 / π)^½
    "a table of points and one of specimens": ("points.csv specimens.csv", {}, {
        "specimen": ["M1", "M2"], "group": ["control", "treated"], "animal": ["a1", "a2"],
        "outer_radius": [0.45, 0.44], "thickness_sd": [0.0065, 0.006],
        "inner_radius": [(0.2025 - 0.5 / 3 / np.pi) ** 0.5, (0.1936 - 0.45 / 2.9 / np.pi) ** 0.5],
    }),
}  # fmt: skip


@pytest.mark.parametrize("files, settings, expected", UNDERSTOOD.values(), ids=UNDERSTOOD)
def test_files_are_understood_without_a_warning(files, settings, expected):
    data = read(files, settings)
    check_data(data)
    for name, values in expected.items():
        if isinstance(values[0], float):
            np.testing.assert_allclose(data[name], values, rtol=ROUNDING, err_msg=name)
        else:
            assert data[name].values.tolist() == values


COPIED = r"1 \(copied_a.csv, line 2\) and .* 4 \(copied_b.csv, line 2\).* 3 points"
EITHER = r"is '{}', either {} or {}: write it without"
# Files, and for each problem a regular expression of its line in the message.
REFUSED = {
    "missing cells": ("missing_cells.csv", [
        "line 6: 'specimen' is missing", "lines 7, 8: 'group' is missing",
        "line 3: 'radius_mm' is missing: ", r"line 5: 'pressure_kPa' is missing \('n/a'\)",
        r"line 7: 'pressure_kPa' is missing \('-'\)", r"line 8: 'pressure_kPa' is missing \('NaN'",
        "line 8: 'outer_radius_mm' is missing",
    ]),
    "equal points under two names": ("copied_a.csv copied_b.csv", [COPIED]),
    "unknown names": ("unicode.csv", [
        r"^unicode\.csv has 'Probe', .*'λz', and no column specimen, no column experiment, "
        r"no column radius or outer_diameter: .*columns\.specimen .*\(specimen may be called",
    ]),
    "no names": ("no_names.csv", ["line 1: there are numbers where names of columns are expected"]),
    "commas that may be either": ("commas_either.txt", [
        "'7,250', and whatever else has a comma, may have a decimal comma or thousands",
    ]),
    "thousands that may be decimals": ("thousands_either.txt", [
        "line 2: .*" + EITHER.format("1,234", "1234", "1.234"),
        "line 3: .*" + EITHER.format("6,500", "6500", "6.500"),
    ]),
    "names and units only": ("header_only_units.csv", ["ends with the names .* line 2; expected"]),
    "empty file": (
        "empty.csv", [r"^empty\.csv is empty; expected a line with the names of columns"],
    ),
    "binary file": ("binary.csv", [r"^binary\.csv is not a text file"]),
    "a spreadsheet": ("by_mistake.xlsx", [r"is a spreadsheet \(.xlsx, .*\).*export .*CSV"]),
    "pressure column twice": (
        "column_twice.csv", [r"1: 'pressure \[mmHg\]' and 'P \(kPa\)' are both"],
    ),
    "two units in a column": (
        "two_units.csv", ["1: 'pressure' has .* mmHg in lines 2, 3, kPa in lines 4, 5"],
    ),
    "text in columns of numbers": ("text_in_numbers.csv", [
        r"line 3: 'radius_mm' is '8\.0 \?', not a number", "line 4: 'radius_mm' is '#DIV/0!', not",
        "line 2: 'pressure_kPa' is 'low', not a number",
        "line 5: 'pressure_kPa' is '11,0', not a number with decimal points",
        "line 6: 'pressure_kPa' is '1e39', larger than any measurement",
    ]),
    "dates in columns of numbers": ("dates.csv", [
        f"line {i}: 'radius_mm' is '{cell}', a date"
        for i, cell in enumerate(["07. Feb", r"08\.01\.2024", "Sep 03", "2024-03-09"], start=2)
    ]),
    "too many cells in a row": (
        "too_many_cells.csv", ["line 2: there are 6 cells, and 4 names of .* in line 1"],
    ),
    "quotation mark": ("quotation.csv", ["line 2: a quotation mark opens .* closed in line 3, if"]),
}  # fmt: skip


@pytest.mark.parametrize("files, problems", REFUSED.values(), ids=REFUSED)
def test_refusal_lists_every_problem_with_file_line_column_and_cell(files, problems):
    settings = {"radius_unit": "mm"} if files == "no_names.csv" else None
    lines = message_of(read, files, settings).splitlines()
    if len(problems) > 1:
        assert lines.pop(0) == f"{len(problems)} problems:"
    assert len(lines) == len(problems)
    for line, problem in zip(lines, problems, strict=True):
        assert re.search(problem, line), line
        assert any(file in line for file in files.split())


IMPLAUSIBLE = {
    "shuffled rows": (
        "unsorted.csv",
        r"^specimen 'S1', experiment 1, unsorted\.csv, line 4: radius turns back here.*sorted by",
    ),
    "mmHg called kPa": (
        "mmHg_as_kPa.csv",
        r"^mmHg_as_kPa\.csv: specimen 'S1', experiment 1: the highest pressure is 120 kPa; "
        r".*mmHg.*\('pressure_kPa' of mmHg_as_kPa\.csv was taken in kPa\)$",
    ),
}  # fmt: skip


@pytest.mark.parametrize("file, doubt", IMPLAUSIBLE.values(), ids=IMPLAUSIBLE)
def test_check_argument_warns_raises_or_ignores_implausible_data(file, doubt):
    with pytest.warns(UserWarning, match=doubt) as warned:
        data = read(file)
    assert len(warned) == 1 and warned[0].filename == __file__
    assert re.search(doubt, message_of(read, file, check="raise"))
    xr.testing.assert_identical(read(file, check="ignore"), data)


def test_understood_attribute_says_how_each_file_and_column_was_read(tmp_path):
    data = read("points.csv specimens.csv")
    data.to_netcdf(tmp_path / "data.nc", engine="h5netcdf")
    xr.testing.assert_identical(xr.load_dataset(tmp_path / "data.nc", engine="h5netcdf"), data)
    lines = data.attrs["understood"].splitlines()
    # The form of the report is in the docstring of read_tests.
    for line in (
        "points.csv: UTF-8, separated by commas, decimal points, 4 rows",
        "  'outer_diameter_um' is outer_diameter in um (1 um is 0.001 mm): 1020 to 1160",
        "  half of 'unloaded outer diameter [mm]' is outer_radius in mm: 0.44 to 0.455",
        "together: 2 specimens, 2 experiments, 4 points",
        "group 'treated': 1 specimen",
        "no inner_radius: it follows from wall_volume and length",
        "not used, without points: specimen 'M3'",
    ):
        assert line in lines


def test_units_in_some_cells_only_or_unknown_units_are_refused(written):
    table = "specimen,experiment,radius_mm,pressure\nS1,1,7.2,10 mmHg\nS1,1,8.0,45\n"
    expected = "a.csv, line 1: 'pressure' is in mmHg in line 2, and has no unit in line 3: "
    assert message_of(written, table).startswith(expected)
    table = f"{HEAD.replace('pressure_kPa', 'pressure (raw)')}\n{ROWS}"
    expected = "a.csv, line 1: 'pressure (raw)' is pressure, and 'raw' is no unit of pressure"
    assert message_of(written, table).startswith(expected)
    # A balance shows forces in grams.
    table = f"{HEAD},axial_force [g]\n" + "".join(f"{row},1\n" for row in ROWS.split())
    assert "'g' is no unit of force that is known" in message_of(written, table)
    assert "write gf for grams of force" in message_of(written, table)
    # Megapascals and millipascals differ by their first letter alone.
    assert "'MPA' is no unit" in message_of(written, f"{HEAD.replace('kPa', '[MPA]')}\n{ROWS}")


def test_equal_points_are_refused_in_two_experiments_and_accepted_in_two_cycles(written):
    head = "id,test,cycle,radius_mm,p_kPa\n"
    one = "S1,1,{},7.2,1\nS1,1,{},7.8,3\nS1,1,{},8.4,6\n"
    data = written(head + one.format(1, 1, 1) + one.format(2, 2, 2))
    assert data["cycle"].values.tolist() == [2]
    assert data.attrs["understood"].endswith("of these the last cycle of each, 3 points, is taken")
    data = read("copied_a.csv copied_b.csv", check="ignore")
    assert data["specimen"].values.tolist() == ["S1", "S2", "T7"]
    # Two equal points can occur by chance; the third point differs in its last digit.
    rows = [f"S{i},1,7.2,1\nS{i},1,7.8,3\nS{i},1,8.400{i},6\n" for i in (1, 2)]
    assert written(f"{HEAD}\n{''.join(rows)}").sizes["test"] == 2


def test_problems_of_all_experiments_are_reported_in_one_message(written):
    """Equal problems of several tests are counted, and each wrong row is named."""
    head = f"{HEAD},inner_radius_mm,outer_radius_mm,thickness_sd_mm\n"
    up = [(7.2, 1.0), (8.4, 6.5), (9.0, 11.0), (7.8, 3.0)]

    def rows(test, tube, points):
        return "".join(f"S{test},1,{radius},{p},{tube}\n" for radius, p in points)

    tables = rows(1, "7,9,0.1", up) + rows(2, "9,7,0.1", up[:3]) + rows(3, "9,7,0.1", up[1:3])
    tables += rows(4, "7,9,-1", up[:2]) + rows(5, "7,9,0.1", [*up[:2], up[1]])
    lines = message_of(written, head + tables).splitlines()
    assert lines[0] == "4 problems:" and len(lines) == 5
    assert lines[1].startswith(
        "- specimen 'S1', experiment 1, a.csv, line 5: radius turns back here"
    )
    assert lines[2].startswith(
        "- specimen 'S5', experiment 1, a.csv, line 15: repeats a.csv, line 14 "
    )
    assert lines[3].startswith("- a.csv: specimen 'S4', experiment 1: the error of thickness is -1")
    assert lines[4].startswith("- a.csv: specimen 'S2', experiment 1: outer_radius is 7 mm; expect")
    assert lines[4].endswith(" (and so is 1 other)")


def test_message_lists_at_most_thirty_problems(written):
    rows = [f"S1,1,{7 + i / 100},x{i}\n" for i in range(32)]
    lines = message_of(written, f"{HEAD}\n{''.join(rows[:30])}").splitlines()
    assert lines[0] == "30 problems:" and len(lines) == 31 and "x29" in lines[-1]
    lines = message_of(written, f"{HEAD}\n{''.join(rows)}").splitlines()
    assert lines[0] == "32 problems:" and len(lines) == 32 and lines[-1] == "- and 2 more"


def test_experiment_divided_between_files_is_refused(written):
    assert message_of(written, f"{HEAD}\n{ROWS}", f"{HEAD}\nS1,1,9.0,11\n").startswith(
        "a.csv, line 2 and b.csv, line 2: specimen 'S1', experiment 1 begins in several files: "
    )


def test_tables_of_specimens_are_joined_by_equal_labels(written):
    points = "id,test,group,radius_mm,p_kPa\nS1,1,C1,7.2,1\nS1,1,C1,8.4,6.5\n"
    data = written(points, "id,test,stretch\nS1,1,1.2\n", "id,inner_radius_mm\nS1,7\n")
    assert data["axial_stretch"].item() == 1.2 and data["inner_radius"].item() == 7.0
    for expected, *tables in (
        ("^a.csv, line 2: specimen 'S1' has no row .*, which has 's1'", "id,thickness_mm\ns1,2\n"),
        ("^c.csv, line 2: .*'S1' stands here and in b.csv, l", *["id,thickness_mm\nS1,2\n"] * 2),
        ("^2 problems:\n- a.csv, line 2: group is 'C1', and 'C2' in b", "id,group\nS1,C2\n"),
        ("these are no points, with pressures, and no specimens", "thickness_mm,note\n2,x\n"),
    ):
        assert re.search(expected, message_of(written, points, *tables))


def test_redundant_columns_are_refused_until_one_is_ignored(written):
    table = "id,test,radius_mm,p_kPa,inner_radius_mm,outer_radius_mm,thickness_mm,length_mm\n"
    table += "S1,1,7.2,1,7,9,2,30\n"
    expected = "a.csv: the tube without load is stated by inner_radius, outer_radius, thickness, wh"
    assert message_of(written, table).startswith(expected)
    data = written(table, settings={"ignore": ["thickness"]})
    assert data["outer_radius"].item() == 9.0
    assert "not used: length, since of the tube it says nothing" in data.attrs["understood"]
    table = "id,test,radius_mm,outer_diameter_mm,p_kPa\nS1,1,7.2,18.2,1\nS1,1,8.4,19,6.5\n"
    expected = "a.csv: radius and outer_diameter have columns: say which was measured"
    assert message_of(written, table).startswith(expected)
    assert "outer_diameter" in written(table, settings={"measured": "outer_diameter"})
    assert "outer_diameter" not in written(table, settings={"measured": "radius"})


ENCODINGS = ["utf-8", "utf-8-sig", "utf-16", "latin-1", "cp1252"]
FORMS = list(zip(ENCODINGS, ",;\t;,", ["\n", "\r\n", "\r", "\n", "\r\n"], strict=True))


@pytest.mark.parametrize("encoding, separator, end", FORMS, ids=ENCODINGS)
def test_encoding_separator_and_line_ends_do_not_change_the_data(
    encoding, separator, end, tmp_path
):
    lines = ["# 37 °C", "id,test,radius (µm),p [mmHg],Öffnung", "Ü1,1,7200,10,x"]
    lines += ["", "Ü1,1,8e3,45,"]
    path = tmp_path / "a.txt"
    path.write_bytes(end.join(lines).replace(",", separator).encode(encoding))
    data = ph.read_tests(path)
    assert data["specimen"].item() == "Ü1"
    np.testing.assert_allclose(data["radius"], [7.2, 8.0], rtol=ROUNDING)
    assert data["row"].values.tolist() == ["a.txt, line 3", "a.txt, line 5"]


def test_lines_that_spreadsheets_add_are_understood(written):
    data = written("sep=;\nid;test;radius, mm;p, kPa\nS1;1;7,2;1,5\n")
    assert data["radius"].item() == 7.2 and data["row"].item() == "a.csv, line 3"
    # After a leading zero a comma is a decimal comma, and does not separate thousands.
    assert message_of(written, "\n").startswith("a.csv is empty")
    data = written(f"{HEAD}\nS1,1,0.750,1.000\n".replace(",", "\t").replace(".", ","))
    assert data["radius"].item() == 0.75 and data["pressure"].item() == 1.0
    # The sign # before a separator is a name, and a last column without a name is not used.
    data = written(f"#,{HEAD},\n# 37 degrees\n1,S1,1,7.2,1.0,\n2,S1,1,8.4,6.5,leaks\n")
    assert data["row"].values.tolist() == ["a.csv, line 3", "a.csv, line 4"]
    assert "  not used: '#', a column without a name\n" in data.attrs["understood"]


def test_one_path_or_several_are_accepted_and_duplicates_refused(tmp_path):
    table, toml = tmp_path / "a.csv", tmp_path / "study.toml"
    table.write_text(f"{HEAD}\n{ROWS}")
    toml.write_text("")
    for files in (str(table), (table, toml), tmp_path.glob("*.csv")):
        assert dict(ph.read_tests(files).sizes) == {"obs": 2, "test": 1}
    nothing, again = tmp_path / "nothing.csv", tmp_path / "." / "a.csv"
    for error, message, *arguments in (
        (FileNotFoundError, r"nothing\.csv", nothing),
        (TypeError, "files are 3; expected a path or a list of paths", 3),
        (TypeError, "settings are 3; expected a path, a dict or None", table, 3),
        (ValueError, "no tables are given", [toml]),
        (ValueError, r"a\.csv is given twice: its points would count twice", [table, again]),
        (ValueError, r"settings are given twice, in .*study\.toml", [table, toml], {}),
    ):
        with pytest.raises(error, match=message):
            ph.read_tests(*arguments)
    with pytest.raises(ValueError, match="check is 'no'"):
        ph.read_tests(table, check="no")


def test_file_whose_name_is_not_utf8_is_read(tmp_path):
    """Archives from other systems contain such names."""
    path = tmp_path / os.fsdecode(b"\xdc.csv")
    try:
        path.write_text(f"{HEAD}\n{ROWS}")
    except OSError:
        pytest.skip("this disk has no such names")
    assert ph.read_tests(path)["row"].values[0] == r"\udcdc.csv, line 2"


def test_guide_states_all_names_and_units_and_valid_settings():
    page = PAGE.read_text(encoding="utf-8")
    for name in IN_TABLES:
        base, _, axis = name.rpartition("_")
        if axis == "sd" or (
            axis in ("x", "y") and base in OF_SHEETS and name not in SHEET_VARIABLES
        ):
            continue
        halves = [other.replace("_", " ") for other in DIAMETERS.get(name, "").split()]
        others = [o for o in names_of(name)[1:] if o not in halves and o[1:2] != " "]
        assert f"| `{name}` | {', '.join(others)} | {', '.join(halves)} |" in page
    for kind in ("pressure", "stress", "length", "force", "angle", "ratio"):
        assert f"| {kind} | {', '.join(UNITS[kind])} |" in page
    toml, *_ = re.findall(r"```toml\n(.*?)```", page, flags=re.DOTALL)
    settings = settings_of(tomllib.loads(toml), "study.toml")
    assert settings.columns["Di"].scale == 0.5 and settings.constants["outer_radius"] == 0.45


def test_ambiguous_column_name_is_refused_until_settings_say_its_meaning(written):
    """ID is the inner diameter in tables of myographs, and the label in tables of specimens."""
    tube = {"constants": {"inner_radius_um": 45, "outer_radius_um": 65}}
    myograph = "ID,OD,P [mmHg],experiment\n101,140,20,1\n118,152,40,1\n"
    message = message_of(written, myograph, settings={"radius_unit": "um", **tube})
    assert "'ID' may be specimen or inner_diameter: say which in the settings" in message
    settings = {"columns": {"inner_diameter": "ID"}, "measured": "radius", "radius_unit": "um"}
    settings["constants"] = tube["constants"] | {"specimen": "A"}
    data = written(myograph, settings=settings)
    np.testing.assert_allclose(data["radius"], [0.0505, 0.059], rtol=ROUNDING)
    assert "'id' may be" in message_of(written, HEAD.replace("specimen", "id") + "\n7.25,1,7.2,1\n")
    assert written(f"{HEAD}\n{ROWS}".replace("specimen", "ID"))["specimen"].item() == "S1"


def test_number_sign_begins_a_remark_above_the_names_and_a_label_below(written):
    data = written(f"# a remark, with commas\n{HEAD}\n#1,1,7.2,1.0\n# a pause\n#1,1,8.4,6.5\n")
    assert data["specimen"].item() == "#1" and data.sizes["obs"] == 2
    # numpy.savetxt writes the names in this form.
    assert written(f"# {HEAD}\n{ROWS}").equals(written(f"{HEAD}\n{ROWS}"))


def test_labels_that_differ_in_invisible_characters_are_equal(written):
    table = f"{HEAD}\nS\u00a01\u200b,1,7.2,1.0\nS 1,1,8.4,6.5\n"
    assert written(table)["specimen"].item() == "S 1"


@pytest.mark.parametrize("character", ["\x0c", "\x0b", "\x00", "\ufffe", "\uffff"])
def test_control_characters_in_labels_are_refused(character, written):
    message = message_of(written, f"{HEAD}\n{ROWS}".replace("S1,1,8", f"S{character}1,1,8"))
    assert f"a.csv, line 3: there is a character {character!a}" in message


def test_unreadable_input_is_refused_with_what_to_do(written, tmp_path):
    below = "1,2,3\n4,5,6\n"
    for table, words in (
        (f"=== log ===,,\n{below}", "line 1: '=== log ===' stands alone"),
        (f"[HEADER]\n[DATA]\n{HEAD}\n{ROWS}", "a.csv: lines 1 to 2 stand above the names of the "),
        (f"S1,1,7.2,1.0\n{ROWS}", "there are numbers where names of columns are expected"),
    ):
        assert words in message_of(written, table)
    empty = f"{HEAD}\nS1,1,7.2,\n".replace("pressure_kPa", "Avg P (kPa)")
    message = message_of(written, empty, settings={"columns": {"pressure": "Avg P"}})
    assert "'Avg P (kPa)', which is pressure, has no entry in any line" in message
    assert "no column pressure" not in message
    of_sheets = "specimen,test,lambda1,P11 [kPa]\nS1,1,1.1,5\nS1,1,1.2,9\n"
    words = "points of sheets have columns such as stretch_x, and cauchy_stress_x, nominal_stress_x"
    assert words in message_of(written, of_sheets)
    assert words not in message_of(written, f"{HEAD}\n{ROWS}".replace("pressure_kPa", "P11 [kPa]"))
    assert "is an address, not a path" in message_of(ph.read_tests, "https://example.org/a.csv")
    with pytest.raises(TypeError, match="to a file first; a dict of settings is given as"):
        ph.read_tests(io.StringIO(f"{HEAD}\n{ROWS}"))
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("a.csv", f"{HEAD}\n{ROWS}")
    assert "or a zip archive, not a text file" in message_of(ph.read_tests, tmp_path / "a.zip")
