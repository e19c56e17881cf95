"""Files of laboratories are understood, or end in one message that says which row and what to do.

The files stand in ``messy/``. What they hold is written out here by hand.
"""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import pymc_hyperelastic as ph
from pymc_hyperelastic.data.files.headers import DIAMETERS, KINDS, LABELS, names_of
from pymc_hyperelastic.data.files.settings import settings_of
from pymc_hyperelastic.data.files.spellings import units_of
from pymc_hyperelastic.data.inflation import check_inflation_data

PAGE = Path(__file__).parents[2] / "docs" / "guides" / "file_format.md"
MESSY = Path(__file__).parent / "messy"
# Conversions are products of a few numbers.
ROUNDING = 1e-12
KPA_10, KPA_45 = 1.33322387415, 5.999507433675  # mmHg
GERMAN = {"specimen": "Probe", "experiment": "Versuch", "group": "Gruppe"}


def read(files: str, settings: dict | None = None, **arguments) -> xr.Dataset:
    return ph.read_tests([MESSY / name for name in files.split()], settings, **arguments)


def said(files: str, settings: dict | None = None, **arguments) -> str:
    """The whole message of the error."""
    with pytest.raises(ValueError) as raised:
        read(files, settings, **arguments)
    return str(raised.value)


# Files, settings, and the variables and labels that are in them.
UNDERSTOOD = {
    "units in names": (
        "units_in_names.csv",
        None,
        {
            "radius": [7.2, 8.0],
            "pressure": [KPA_10, KPA_45],
            "inner_radius": [7.0],
            "outer_radius": [9.0],
            "axial_stretch": [1.2],
            "opening_angle": [0.0],
            "group": ["all"],
        },
    ),
    # The ring of M1, of radii 0.3875 and 0.45 mm, opens by 180° as a whole: k = 2, and the radii of
    # the sector are larger by that of the wall's middle, 0.41875. r² = 0.52525² - (b² - a²) / 1.5
    "decimal commas in Latin-1, with settings": (
        "decimal_comma.csv decimal_comma.toml",
        None,
        {
            "specimen": ["M1", "M2"],
            "outer_diameter": [1.0505, 1.16, 1.02, 1.1405],
            "pressure": [KPA_10, 6 * KPA_10, 1.25 * KPA_10, 6.5 * KPA_10],
            "inner_radius": [0.80625, 0.39 + 161 / 199 * 0.42],
            "outer_radius": [0.86875, 0.45 + 161 / 199 * 0.42],
            "radius": [
                (0.2758875625 - 0.05234375 / 1.5) ** 0.5,
                (0.3364 - 0.05234375 / 1.5) ** 0.5,
                (0.2601 - 0.0504 / 1.5) ** 0.5,
                (0.3251850625 - 0.0504 / 1.5) ** 0.5,
            ],
            "axial_stretch": [1.5, 1.5],
            "opening_angle": [np.pi, 161 / 180 * np.pi],
        },
    ),
    "repeated radii": (
        "repeated_radii.csv",
        None,
        {"radius": [7.2, 7.8, 7.8, 9.0], "pressure": [1.0, 3.4, 3.6, 11.0]},
    ),
    "negative pressures, one with a sign of minus": (
        "negative_pressures.csv",
        None,
        {"pressure": [-0.4, -0.1, 6.5, 11.0]},
    ),
    "labels of integers": (
        "integer_labels.csv",
        None,
        {"specimen": ["1", "01", "1.0"], "experiment": [1, 1, 2]},
    ),
    "letters of other languages": (
        "unicode.csv",
        {"columns": GERMAN | {"inner_diameter": "Innendurchmesser"}},
        {
            "specimen": ["Aorta Müller"],
            "experiment": ["Anfang"],
            "group": ["Kontrolle α"],
            "radius": [0.405, 0.48],
            "pressure": [KPA_10, 6 * KPA_10],
            "axial_stretch": [1.45],
            "inner_radius": [np.nan],
        },
    ),
    "spaces, capitals, blank lines, comments, line ends of Windows": (
        "spaces.csv",
        None,
        {
            "specimen": ["S1"],
            "radius": [7.2, 8.0],
            "pressure": [KPA_10, KPA_45],
            "row": ["spaces.csv, line 4", "spaces.csv, line 7"],
        },
    ),
    "other units in another file": (
        "monday.csv tuesday.csv",
        None,
        {
            "specimen": ["S1", "S2"],
            "radius": [7.2, 8.0, 7.25, 8.05],
            "pressure": [KPA_10, KPA_45, 1.5, 6.25],
            "inner_radius": [7.0, 7.0],
        },
    ),
    # r² = 5.10025² - (5² - 4²), 5.5² - 9
    "tabs, and commas between thousands": (
        "thousands.txt",
        None,
        {
            "outer_diameter": [10.2005, 11.0],
            "radius": [17.0125500625**0.5, 21.25**0.5],
            "pressure": [1.2345, 12.0],
        },
    ),
    "units in a line of their own, a force not measured": (
        "two_line_header.tsv",
        None,
        {"radius": [7.2, 8.0], "pressure": [KPA_10, KPA_45], "axial_force": [np.nan, 12.5]},
    ),
    "units in cells": (
        "units_in_cells.csv",
        None,
        {"radius": [7.2, 8.0], "pressure": [KPA_10, KPA_45], "outer_radius": [np.nan]},
    ),
    "commas that were said to be decimal": (
        "commas_either.txt",
        {"decimal": ","},
        {"radius": [7.25, 8.125], "pressure": [1.234, 6.5]},
    ),
    "a column too many is left out": (
        "column_twice.csv",
        {"ignore": ["P"]},
        {"pressure": [KPA_10]},
    ),
    # (0.45² - 0.5 / 3 / π)^½, (0.44² - 0.45 / 2.9 / π)^½
    "a table of points and one of specimens": (
        "points.csv specimens.csv",
        None,
        {
            "specimen": ["M1", "M2"],
            "group": ["control", "treated"],
            "animal": ["a1", "a2"],
            "outer_radius": [0.45, 0.44],
            "inner_radius": [
                (0.2025 - 0.5 / 3 / np.pi) ** 0.5,
                (0.1936 - 0.45 / 2.9 / np.pi) ** 0.5,
            ],
            "thickness_sd": [0.0065, 0.006],
        },
    ),
}


@pytest.mark.parametrize("row", UNDERSTOOD.values(), ids=UNDERSTOOD)
def test_understood(row, tmp_path):
    """The numbers are those of the file in kPa and mm, and no word is said."""
    files, settings, expected = row
    data = read(files, settings)
    check_inflation_data(data)
    for name, values in expected.items():
        if isinstance(values[0], float):
            np.testing.assert_allclose(data[name], values, rtol=ROUNDING, err_msg=name)
        else:
            assert data[name].values.tolist() == values
    data.to_netcdf(tmp_path / "data.nc", engine="h5netcdf")
    xr.testing.assert_identical(xr.load_dataset(tmp_path / "data.nc", engine="h5netcdf"), data)


TURNS = (
    "radius turns back here, as if this were loading and unloading; slopes are taken between "
    "neighbouring rows: name loading and unloading in a column 'phase', cycles in a column "
    "'cycle', and choose with ph.select(data, phase=...); or, if the rows were only shuffled, sort "
    "them"
)
DATE = "a date, as spreadsheets make of numbers: format the column as numbers, and enter it again"
NO_NUMBER = "not a number: correct it, or delete the line"
NO_LABEL = "is missing: give every line its label, fill the column down"
MISSING = "fill it in, or delete the line"
SYNONYMS = (
    "specimen may be called sample, id, specimen id, sample id; experiment may be called test, "
    "run, experiment id; radius may be called r, current radius, internal radius, current inner "
    "radius, inner diameter, internal diameter, lumen diameter; outer_diameter may be called "
    "external diameter, current outer diameter"
)
REFUSED = {
    "loading and unloading": (
        "up_and_down.csv",
        None,
        [
            f"specimen 'S1', experiment 1, up_and_down.csv, line 6: {TURNS}",
            f"specimen 'S2', experiment 1, up_and_down.csv, line 13: {TURNS}",
        ],
    ),
    "missing cells": (
        "missing_cells.csv",
        None,
        [
            f"missing_cells.csv, line 6: 'specimen' {NO_LABEL}",
            f"missing_cells.csv, lines 7, 8: 'group' {NO_LABEL}",
            f"missing_cells.csv, line 3: 'radius_mm' is missing: {MISSING}",
            f"missing_cells.csv, line 5: 'pressure_kPa' is missing ('n/a'): {MISSING}",
            f"missing_cells.csv, line 7: 'pressure_kPa' is missing ('-'): {MISSING}",
            f"missing_cells.csv, line 8: 'pressure_kPa' is missing ('NaN'): {MISSING}",
            f"missing_cells.csv, line 8: 'outer_radius_mm' is missing: {MISSING}",
        ],
    ),
    "a specimen under two names": (
        "copied_a.csv copied_b.csv",
        None,
        [
            "specimen 'S1', experiment 1 (copied_a.csv, line 2) and specimen 'T7', experiment 4 "
            "(copied_b.csv, line 2) have the same 3 points, as if one had been copied: remove one, "
            'or correct it; if it is right, say check="ignore"'
        ],
    ),
    "names that are not known": (
        "unicode.csv",
        None,
        [
            "unicode.csv has 'Probe', 'Versuch', 'Gruppe', 'Innendurchmesser (µm)', 'P / mmHg', "
            "'λz', and no column specimen, no column experiment, no column radius or "
            "outer_diameter: rename the one that holds it, or say what it is called, "
            f"columns.specimen in the settings ({SYNONYMS})"
        ],
    ),
    "no names": (
        "no_names.csv",
        {"radius_unit": "mm"},
        [
            "no_names.csv has 'S1', '1', '7.2', '1.5', and no column specimen, no column "
            "experiment, no column radius or outer_diameter, no column pressure: rename the one "
            f"that holds it, or say what it is called, columns.specimen in the settings ({SYNONYMS}"
            "; pressure may be called p, transmural pressure, luminal pressure, internal pressure)"
        ],
    ),
    "commas that may be either": (
        "commas_either.txt",
        None,
        [
            "commas_either.txt: '7,250', and whatever else has a comma, may have a decimal comma "
            'or thousands that are set apart: say decimal = "," or decimal = "." in the settings'
        ],
    ),
    "thousands that may be decimals": (
        "thousands_either.txt",
        None,
        [
            "thousands_either.txt, line 2: 'pressure [Pa]' is '1,234', either 1234 or 1.234: write "
            "it without a separator of thousands, as the other numbers have decimal points",
            "thousands_either.txt, line 3: 'pressure [Pa]' is '6,500', either 6500 or 6.500: write "
            "it without a separator of thousands, as the other numbers have decimal points",
        ],
    ),
    "names only": (
        "header_only.csv",
        None,
        [
            "header_only.csv ends with the names of columns, in line 1; expected one line a "
            "measured point below them"
        ],
    ),
    "names and units only": (
        "header_only_units.csv",
        None,
        [
            "header_only_units.csv ends with the names of columns, in line 2; expected one line a "
            "measured point below them"
        ],
    ),
    "nothing": (
        "empty.csv",
        None,
        [
            "empty.csv is empty; expected a line with the names of columns, and one line a "
            "measured point"
        ],
    ),
    "no text": (
        "binary.csv",
        None,
        [
            "binary.csv is not a text file: it holds bytes that are no letters. Export the table "
            "as CSV, in UTF-8"
        ],
    ),
    "a spreadsheet": (
        "by_mistake.xlsx",
        None,
        [
            "by_mistake.xlsx is a spreadsheet (.xlsx or .ods), not a text file: open it, export "
            "each sheet as CSV (File, Save as, CSV UTF-8), and give the CSV files"
        ],
    ),
    "two columns of pressure": (
        "column_twice.csv",
        None,
        [
            "column_twice.csv, line 1: 'pressure [mmHg]' and 'P (kPa)' are both pressure: rename "
            "one, or name it in the list ignore of the settings"
        ],
    ),
    "two units": (
        "two_units.csv",
        None,
        [
            "two_units.csv, line 1: 'pressure' has several units, mmHg in lines 2, 3, kPa in lines "
            "4, 5: convert its numbers to one unit, and write that into the name"
        ],
    ),
    "text": (
        "text_in_numbers.csv",
        None,
        [
            f"text_in_numbers.csv, line 3: 'radius_mm' is '8.0 ?', {NO_NUMBER}",
            f"text_in_numbers.csv, line 4: 'radius_mm' is '#DIV/0!', {NO_NUMBER}",
            f"text_in_numbers.csv, line 2: 'pressure_kPa' is 'low', {NO_NUMBER}",
            "text_in_numbers.csv, line 5: 'pressure_kPa' is '11,0', not a number with decimal "
            "points, as the other numbers have: correct it",
            "text_in_numbers.csv, line 6: 'pressure_kPa' is '1e400', larger than any measurement: "
            "correct it",
        ],
    ),
    "dates": (
        "dates.csv",
        None,
        [
            f"dates.csv, line 2: 'radius_mm' is '07. Feb', {DATE}",
            f"dates.csv, line 3: 'radius_mm' is '08.01.2024', {DATE}",
            f"dates.csv, line 4: 'radius_mm' is 'Sep 03', {DATE}",
            f"dates.csv, line 5: 'radius_mm' is '2024-03-09', {DATE}",
        ],
    ),
    "decimal commas between commas": (
        "too_many_cells.csv",
        None,
        [
            "too_many_cells.csv, line 2: there are 6 cells, and 4 names of columns in line 1, "
            "separated by commas: is there a decimal comma between commas, or a separator inside a "
            "cell? Put the cell in quotation marks, or separate by semicolons"
        ],
    ),
    "a quotation mark that stays open": (
        "quotation.csv",
        None,
        [
            "quotation.csv, line 2: a quotation mark opens here that is closed in line 3, if at "
            "all: remove it, or close the cell in its own line"
        ],
    ),
}


@pytest.mark.parametrize("row", REFUSED.values(), ids=REFUSED)
def test_refused(row):
    """One message has all that is wrong, with file, line, column and cell."""
    files, settings, problems = row
    expected = problems[0]
    if len(problems) > 1:
        expected = "\n- ".join([f"{len(problems)} problems:", *problems])
    assert said(files, settings) == expected


DOUBTED = {
    "shuffled rows": (
        "unsorted.csv",
        "specimen 'S1', experiment 1, unsorted.csv, line 4: radius turns back here; the rows of "
        "the experiment were shuffled, and have been sorted by it",
        "",
    ),
    "mmHg called kPa": (
        "mmHg_as_kPa.csv",
        "mmHg_as_kPa.csv: specimen 'S1', experiment 1: the highest pressure is 120 kPa; expected "
        'at most 40 kPa: was it given in mmHg or Pa, pressure_unit="mmHg"?',
        " ('pressure_kPa' of mmHg_as_kPa.csv was taken in kPa)",
    ),
    "kPa called mmHg": (
        "kPa_as_mmHg.csv",
        "kPa_as_mmHg.csv: specimen 'S1', experiment 1: the highest pressure is 0.0799934 kPa; "
        "expected at least 0.1 kPa: was it given in MPa or bar, pressure_unit=...?",
        " ('pressure_mmHg' of kPa_as_mmHg.csv was taken in mmHg)",
    ),
}


@pytest.mark.parametrize("row", DOUBTED.values(), ids=DOUBTED)
def test_doubted(row):
    """What is probably wrong is warned of where it was asked for, raised, or taken in silence."""
    file, doubt, columns = row
    with pytest.warns(UserWarning) as warned:
        data = read(file)
    assert [str(w.message) for w in warned] == [
        f'{doubt}; if it is right, say check="ignore"{columns}'
    ]
    assert warned[0].filename == __file__
    assert said(file, check="raise") == doubt + columns
    xr.testing.assert_identical(read(file, check="ignore"), data)


HEAD = "specimen,experiment,radius_mm,pressure_kPa"
ROWS = "S1,1,7.2,1.0\nS1,1,8.4,6.5\n"


def test_what_was_understood_is_said():
    """For each file and column, what is not used, what there is in all, and what is assumed."""
    data = read("points.csv specimens.csv")
    assert (
        data.attrs["understood"]
        == """\
points.csv: UTF-8, separated by commas, decimal points, 4 rows
  'id' is specimen: 2 labels
  'group' is group: 2 labels
  'test' is experiment: 1 label
  'outer_diameter_um' is outer_diameter in um (1 um is 0.001 mm): 1020 to 1160
  'pressure_mmHg' is pressure in mmHg (1 mmHg is 0.133322 kPa): 10 to 65
specimens.csv: UTF-8, separated by semicolons, decimal commas, 3 rows
  'id' is specimen: 3 labels
  'animal' is animal: 3 labels
  half of 'unloaded outer diameter [mm]' is outer_radius in mm: 0.44 to 0.455
  'wall_volume (mm³)' is wall_volume in mm³: 0.45 to 0.5
  'length [mm]' is length in mm: 2.9 to 3.1
  'thickness_sd_um' is thickness_sd in um (1 um is 0.001 mm): 6 to 6.5
together: 2 specimens, 2 experiments, 4 points
group 'control': 1 specimen
group 'treated': 1 specimen
no axial_stretch: 1 is taken
no opening_angle: 0 is taken
no inner_radius: it follows from wall_volume and length
not used, without points: specimen 'M3'"""
    )


def test_an_error_notes_what_was_understood():
    """Of the files that could be read."""
    with pytest.raises(ValueError) as raised:
        read("two_units.csv monday.csv")
    (note,) = raised.value.__notes__
    assert note.startswith("What was understood:\ntwo_units.csv: UTF-8, separated by commas")
    assert "\n  'pressure' is pressure: 1.4 to 45\nmonday.csv: UTF-8" in note


@pytest.fixture
def written(tmp_path):
    """Write tables, and read them."""

    def write(*tables: str, settings=None, toml: str | None = None) -> xr.Dataset:
        paths = [tmp_path / f"{'abc'[i]}.csv" for i in range(len(tables))]
        for path, table in zip(paths, tables, strict=True):
            path.write_text(table, encoding="utf-8")
        if toml is not None:
            (tmp_path / "study.toml").write_text(toml, encoding="utf-8")
            settings = tmp_path / "study.toml"
        return ph.read_tests(paths, settings)

    return write


def test_a_tube_of_which_nothing_is_said(written):
    """Nothing can be fitted to it, and what to give is said, until it is given."""
    table = f"{HEAD}\n{ROWS}"
    told = written(table).attrs["understood"]
    assert (
        "no inner_radius: no law can be fitted without; give the tables a column of it, the "
        "settings constants.inner_radius, or a model in Python a prior\nno outer_radius: no law"
    ) in told
    told = written(table, toml="[constants]\ninner_radius_mm = 7").attrs["understood"]
    assert "no inner_radius" not in told and "no outer_radius: no law" in told
    toml = "[constants]\ninner_radius_mm = 7\nthickness_mm = 2"
    assert (
        "no outer_radius: it follows from thickness"
        in written(table, toml=toml).attrs["understood"]
    )


def says(call, *arguments, **settings) -> str:
    with pytest.raises(ValueError) as raised:
        call(*arguments, **settings)
    return str(raised.value)


def test_units_are_asked(written):
    """A number without a unit is not taken in any; settings may say it for all, or for one."""
    bare = "specimen,experiment,radius,pressure\nS1,1,7.2,10\nS1,1,8.0,45\n"
    assert says(written, bare) == (
        "2 problems:\n"
        "- a.csv, line 1: 'radius' has no unit: write it into the name, such as 'radius [mm]', or "
        "say radius_unit in the settings\n"
        "- a.csv, line 1: 'pressure' has no unit: write it into the name, such as 'pressure "
        "[kPa]', or say pressure_unit in the settings"
    )
    for settings in ({"pressure_unit": "mmHg"}, {"units": {"pressure": "mmhg"}}):
        data = written(bare, settings={"radius_unit": "mm"} | settings)
        np.testing.assert_allclose(data["pressure"], [KPA_10, KPA_45], rtol=ROUNDING)
    # What a name says is not overruled.
    data = written(f"{HEAD}\n{ROWS}", settings={"pressure_unit": "mmHg"})
    assert data["pressure"].values.tolist() == [1.0, 6.5]


def test_units_that_are_not_known(written):
    """They are named, with those that are."""
    table = f"{HEAD.replace('pressure_kPa', 'pressure (raw)')}\n{ROWS}"
    assert says(written, table) == (
        "a.csv, line 1: 'pressure (raw)' is pressure, and 'raw' is no unit of pressure that is "
        "known (kPa, Pa, hPa, MPa, mmHg, torr, cmH2O, mbar, bar, psi): correct it, or name the "
        "column in the list ignore of the settings"
    )
    # Megapascals and millipascals differ by their first letter alone.
    assert "'MPA' is no unit" in says(written, f"{HEAD.replace('kPa', '[MPA]')}\n{ROWS}")


def test_unit_in_some_cells_only(written):
    """Nobody knows what the others are in."""
    table = "specimen,experiment,radius_mm,pressure\nS1,1,7.2,10 mmHg\nS1,1,8.0,45\n"
    assert says(written, table) == (
        "a.csv, line 1: 'pressure' is in mmHg in line 2, and has no unit in line 3: write the unit "
        "into the name, and numbers into the cells"
    )


def test_constants(written):
    """They have units, stand for columns that are not there, and do not overrule one."""
    toml = """
measured = "radius"
[units]
inner_radius = "um"
outer_radius = "um"
[constants]
group = "C1"
inner_radius = 7000
outer_radius = 9000.0
axial_stretch = 1.2
"""
    data = written(f"{HEAD}\n{ROWS}", toml=toml)
    assert [data[n].item() for n in ("inner_radius", "outer_radius", "axial_stretch", "group")] == [
        7.0,
        9.0,
        1.2,
        "C1",
    ]
    assert says(written, f"{HEAD}\n{ROWS}", settings={"constants": {"inner_radius": 7}}) == (
        "inner_radius is 7 in the settings, without a unit: say units.inner_radius there, or add "
        "it to the name"
    )
    assert says(written, f"{HEAD}\n{ROWS}", settings={"constants": {"specimen": "S9"}}) == (
        "specimen is 'S9' in the settings, and a.csv has a column of it, 'specimen': "
        "remove one, or name the column in the list ignore"
    )


def test_constants_are_named_as_columns_are(written):
    """Other names are known, diameters among them, and units in names come before those said."""
    toml = """
[units]
thickness = "mm"
[constants]
"unloaded inner diameter (mm)" = 14
thickness_um = 2000
class = "C1"
[files."a.csv"]
"axial stretch [%]" = 120
"""
    data = written(f"{HEAD}\n{ROWS}", toml=toml)
    assert (
        "the same in all rows of all files: inner_radius 7 mm, thickness 2 mm, group 'C1'\n"
        "the same in all rows of a.csv: axial_stretch 1.2\n"
    ) in data.attrs["understood"]
    assert [data[n].item() for n in ("inner_radius", "outer_radius", "axial_stretch", "group")] == [
        7.0,
        9.0,
        1.2,
        "C1",
    ]


def test_files_without_labels(written):
    """Settings say what is the same in all rows of each file, such as its specimen."""
    table = "radius_mm,pressure_kPa\n7.2,1.0\n8.4,6.5\n"
    toml = """
[constants]
experiment = 1
[files."a.csv"]
specimen = "01"
[files."b.csv"]
specimen = "02"
"""
    data = written(table, table.replace("8.4", "8.5"), toml=toml)
    assert data["specimen"].values.tolist() == ["01", "02"]
    assert data["experiment"].values.tolist() == [1, 1]
    assert says(written, table, toml=toml).startswith(
        "files.b.csv of the settings is not among the files, a.csv"
    )


def test_the_same_points_twice(written):
    """One who knows that they are right says so; cycles of an experiment may be the same."""
    head = "id,test,cycle,radius_mm,p_kPa\n"
    one = "S1,1,{},7.2,1\nS1,1,{},7.8,3\nS1,1,{},8.4,6\n"
    data = written(head + one.format(1, 1, 1) + one.format(2, 2, 2))
    assert data["cycle"].values.tolist() == [2]
    assert data.attrs["understood"].endswith("of these the last cycle of each, 3 points, is taken")
    data = read("copied_a.csv copied_b.csv", check="ignore")
    assert data["specimen"].values.tolist() == ["S1", "S2", "T7"]


def test_what_is_the_same_in_all_experiments_is_told_once(written):
    """The first is named, and the others are counted."""
    head = f"{HEAD},inner_radius_mm,outer_radius_mm\n"
    rows = [f"S{i},{j},7.{j},1.{i},9,7\n" for i in (1, 2) for j in (1, 2)]
    assert says(written, head + "".join(rows)) == (
        "a.csv: specimen 'S1', experiment 1: outer_radius is 7 mm; expected more than "
        "inner_radius: were the two exchanged, or is one a diameter? (and so are 3 others)"
    )


def test_labels_with_commas_in_messages(written):
    """What is asked of a test names it alone, though the labels of its rows hold commas."""
    head = f"{HEAD},inner_radius_mm,outer_radius_mm,opening_angle_deg\n"
    message = says(written, head + "S1,1,7.2,1.0,7,9,60\n")
    assert message.startswith("a.csv: specimen 'S1', experiment 1: opening_angle is 1.0472 rad, a")


def test_a_file_of_a_control_mark(written):
    """What looks like a blank line is one."""
    assert says(written, "\x0b").startswith("a.csv is empty")


def test_a_nought_before_a_comma_is_no_thousand(written):
    """A number between tabs such as 0,750 is not asked."""
    table = f"{HEAD}\nS1,1,0.750,1.000\n".replace(",", "\t").replace(".", ",")
    data = written(table)
    assert data["radius"].item() == 0.75 and data["pressure"].item() == 1.0


def test_a_column_of_numbers_is_no_comment(written):
    """The sign # before a separator is a name."""
    data = written(f"#,{HEAD}\n# 37 degrees\n1,S1,1,7.2,1.0\n")
    assert data["row"].item() == "a.csv, line 3" and "not used: '#'" in data.attrs["understood"]


def test_remarks_without_a_name(written):
    """A last column without a name is not used."""
    data = written(f"{HEAD},\nS1,1,7.2,1.0,\nS1,1,8.4,6.5,leaks\n")
    assert data.sizes["obs"] == 2
    assert "  not used: a column without a name\n" in data.attrs["understood"]


BAD_SETTINGS = {
    "no TOML": ("a = ", "study.toml is not a TOML file in UTF-8: "),
    "a key": ("presure_unit = 'kPa'", "study.toml: 'presure_unit' is not known; expected some of"),
    "a unit": ("pressure_unit = 'mm'", "study.toml: pressure_unit is 'mm', which is not a known"),
    "a number for a unit": ("units = {pressure = 1}", "study.toml: units.pressure is 1, which is"),
    "a column": ("columns = {druck = 'P'}", "study.toml: columns has 'druck', which is not known"),
    "a table": ("columns = 'P'", "study.toml: columns is 'P'; expected a table, [columns]"),
    "constants of a file": (
        "files = {'a.csv' = 1}",
        "study.toml: files.a.csv: constants is 1; exp",
    ),
    "no files": ("files = 1", "study.toml: files is 1; expected tables, such as"),
    "a number for a name": ("columns = {pressure = 1}", "study.toml: columns.pressure is 1; exp"),
    "a name that no file has": (
        "columns = {pressure = 'P'}",
        "2 problems:\n- columns.pressure of the settings is 'P', and no file has such a column: "
        "a.csv has 'specimen', 'experiment', 'radius_mm', 'pressure_kPa'\n",
    ),
    "text for a number": (
        "constants = {thickness = '1 mm'}",
        "study.toml: constants.thickness is '1 mm'; expected a number, and its unit in its name, "
        "as in thickness_mm, or in units.thickness",
    ),
    "text for a ratio": (
        "constants = {axial_stretch = 'long'}",
        "study.toml: constants.axial_stretch is 'long'; expected a number",
    ),
    "a unit in a name": (
        "constants = {thickness_kPa = 62}",
        "study.toml: constants.thickness_kPa is 'kPa', which is not a known unit of length",
    ),
    "the same by two names": (
        "constants = {thickness_um = 62, 'wall thickness / mm' = 0.062}",
        "study.toml: constants has two of thickness, the second is 'wall thickness / mm'",
    ),
    "a date": ("constants = {group = 2024-01-01}", "study.toml: constants.group is datetime.date"),
    "infinity": ("constants = {thickness = inf}", "study.toml: constants.thickness is inf; expec"),
    "not a list": ("ignore = 'P'", "study.toml: ignore is 'P'; expected a list of column names"),
    "a mark": ("decimal = ';'", "study.toml: decimal is ';'; expected one of '.', ','"),
    "a separator": ("separator = ' '", "study.toml: separator is ' '; expected one of '\\t', ';'"),
    "not text": ("cycles = 3", "study.toml: cycles is 3; expected text in quotation marks"),
    "a convention": ("cycles = 'first'", "a.csv: cycles is 'first'; expected one of ('last', 'a"),
}


@pytest.mark.parametrize("row", BAD_SETTINGS.values(), ids=BAD_SETTINGS)
def test_settings_that_are_wrong(row, written):
    """They are named with what was expected."""
    toml, expected = row
    assert says(written, f"{HEAD}\n{ROWS}", toml=toml).startswith(expected)


def test_what_is_given(tmp_path):
    """Files that are not there, are no paths, or are given twice."""
    table, toml = tmp_path / "a.csv", tmp_path / "study.toml"
    table.write_text(f"{HEAD}\n{ROWS}")
    toml.write_text("")
    assert dict(ph.read_tests(str(table)).sizes) == {"obs": 2, "test": 1}
    assert dict(ph.read_tests((table, toml)).sizes) == {"obs": 2, "test": 1}
    with pytest.raises(FileNotFoundError, match=r"nothing\.csv"):
        ph.read_tests(tmp_path / "nothing.csv")
    with pytest.raises(TypeError, match="files are 3; expected a path or a list of paths"):
        ph.read_tests(3)
    assert dict(ph.read_tests(tmp_path.glob("*.csv")).sizes) == {"obs": 2, "test": 1}
    with pytest.raises(TypeError, match="settings are 3; expected a path, a dict or None"):
        ph.read_tests(table, 3)
    with pytest.raises(ValueError, match="no tables are given"):
        ph.read_tests([toml])
    with pytest.raises(ValueError, match=r"a\.csv is given twice: its points would count twice"):
        ph.read_tests([table, tmp_path / "." / "a.csv"])
    with pytest.raises(ValueError, match=r"settings are given twice, in .*study\.toml"):
        ph.read_tests([table, toml], {"decimal": "."})
    with pytest.raises(ValueError, match="check is 'no'"):
        ph.read_tests(table, check="no")


def test_files_of_one_name(tmp_path):
    """They are told apart by their folders."""
    for i in (1, 2):
        (tmp_path / str(i)).mkdir()
        (tmp_path / str(i) / "a.csv").write_text(f"{HEAD}\nS{i},1,7.2,{i}\n")
    files = [tmp_path / str(i) / "a.csv" for i in (1, 2)]
    assert ph.read_tests(files)["row"].values.tolist() == [f"{file}, line 2" for file in files]


def test_one_experiment_in_two_files(written):
    """It may be two of one name."""
    message = says(written, f"{HEAD}\n{ROWS}", f"{HEAD}\nS1,1,9.0,11\n")
    assert message == (
        "a.csv, line 2 and b.csv, line 2: specimen 'S1', experiment 1 begins in several files: "
        "give two experiments two labels, or put the rows of one into one file"
    )


def test_tables_of_specimens(written):
    """Labels are the same letter by letter, stand once, and columns of both agree."""
    points = "id,test,group,radius_mm,p_kPa\nS1,1,C1,7.2,1\nS1,1,C1,8.4,6.5\n"
    assert says(written, points, "id,thickness_mm\ns1,2\n") == (
        "a.csv, line 2: specimen 'S1' has no row in the table of specimens, which has 's1': write "
        "labels in the same way, letter by letter"
    )
    assert says(written, points, "id,thickness_mm\nS1,2\n", "id,thickness_mm\nS1,2\n") == (
        "c.csv, line 2: specimen 'S1' stands here and in b.csv, line 2: remove one"
    )
    assert says(written, points, "id,group\nS1,C2\n") == (
        "2 problems:\n"
        "- a.csv, line 2: group is 'C1', and 'C2' in b.csv, line 2: correct one, or name the "
        "column of one in the list ignore of the settings\n"
        "- a.csv, line 3: group is 'C1', and 'C2' in b.csv, line 2: correct one, or name the "
        "column of one in the list ignore of the settings"
    )
    data = written(points, "id,test,stretch\nS1,1,1.2\n", "id,inner_radius_mm\nS1,7\n")
    assert data["axial_stretch"].item() == 1.2 and data["inner_radius"].item() == 7.0
    assert "these are no points, with pressures, and no specimens" in says(
        written, points, "thickness_mm,note\n2,x\n"
    )


def test_a_tube_that_is_stated_twice(written):
    """Which columns to take is asked."""
    table = "id,test,radius_mm,p_kPa,inner_radius_mm,outer_radius_mm,thickness_mm,length_mm\n"
    table += "S1,1,7.2,1,7,9,2,30\n"
    assert says(written, table) == (
        "a.csv: the tube without load is stated by inner_radius, outer_radius, thickness, which is "
        "too much: keep one radius and one measure of the wall, and name the columns of the others "
        "in the list ignore of the settings"
    )
    data = written(table, settings={"ignore": ["thickness"]})
    assert data["outer_radius"].item() == 9.0
    assert "not used: length, since of the tube it says nothing" in data.attrs["understood"]


def test_radius_and_diameter(written):
    """Which was measured is asked."""
    table = "id,test,radius_mm,outer_diameter_mm,p_kPa\nS1,1,7.2,18.2,1\nS1,1,8.4,19,6.5\n"
    assert says(written, table) == (
        "a.csv: radius and outer_diameter have columns: say which was measured, measured = "
        '"radius" or measured = "outer_diameter" in the settings'
    )
    data = written(table, settings={"measured": "outer_diameter"})
    assert data["outer_diameter"].values.tolist() == [18.2, 19.0]
    assert "outer_diameter" not in written(table, settings={"measured": "radius"})


def test_labels_of_tests(written):
    """Animal and split stay with the tests, and do not change within one; cycles are counted."""
    head = "id,test,cycle,animal,split,radius_mm,p_kPa\n"
    table = head + "".join(
        f"S1,a,{cycle},m1,train,{7.2 + cycle / 100},{cycle}\n" for cycle in (2, 10, 9)
    )
    data = written(table)
    assert data["cycle"].values.tolist() == [10] and data["animal"].values.tolist() == ["m1"]
    assert data["split"].values.tolist() == ["train"] and data["row"].values == "a.csv, line 3"
    assert says(written, head + "S1,a,1,m1,new,7,1\nS1,a,1,m2,new,8,2\n") == (
        "specimen 'S1', experiment 'a', cycle 1, a.csv, line 3: animal is 'm2', but 'm1' in the "
        "first row of this experiment; it must not change within one: correct it, or give the rows "
        "another experiment label"
    )


def test_problems_are_counted_where_there_are_many(written):
    """A message has twenty, and says how many more."""
    rows = "".join(f"S1,1,{7 + i / 100},x{i}\n" for i in range(30))
    lines = says(written, f"{HEAD}\n{rows}").splitlines()
    assert lines[0] == "30 problems:" and lines[-1] == "- and 10 more" and len(lines) == 22


ENCODINGS = ["utf-8", "utf-8-sig", "utf-16", "latin-1", "cp1252"]


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_forms_of_a_file(encoding, separator, end, tmp_path):
    """Encoding, separator and line ends change nothing."""
    lines = [
        "# 37 °C",
        "id,test,radius (µm),p [mmHg],Öffnung",
        "Ü1,1,7200,10,x",
        "",
        "Ü1,1,8e3,45,",
    ]
    path = tmp_path / "a.txt"
    path.write_bytes(end.join(lines).replace(",", separator).encode(encoding))
    data = ph.read_tests(path)
    assert data["specimen"].item() == "Ü1"
    np.testing.assert_allclose(data["radius"], [7.2, 8.0], rtol=ROUNDING)
    assert data["row"].values.tolist() == ["a.txt, line 3", "a.txt, line 5"]


def test_separator_that_a_spreadsheet_states(written):
    """The line sep= is no name of a column."""
    data = written("sep=;\nid;test;radius, mm;p, kPa\nS1;1;7,2;1,5\n")
    assert data["radius"].item() == 7.2 and data["row"].item() == "a.csv, line 3"


def test_page_states_names_and_units():
    """The tables of the page are those of the code, and its settings are right."""
    page = PAGE.read_text(encoding="utf-8")
    for name in (*LABELS, *KINDS):
        if name.endswith("_sd"):
            continue
        halves = [other.replace("_", " ") for other in DIAMETERS.get(name, "").split()]
        others = [o for o in names_of(name)[1:] if o not in halves and o != "λ z"]
        assert f"| `{name}` | {', '.join(others)} | {', '.join(halves)} |" in page
    for kind in ("pressure", "length", "force", "angle", "ratio"):
        assert f"| {kind} | {units_of(kind)} |" in page
    (toml,) = re.findall(r"```toml\n(.*?)```", page, flags=re.DOTALL)
    settings = settings_of(tomllib.loads(toml), "study.toml")
    assert settings.columns["Di"].scale == 0.5 and settings.constants["outer_radius"].value == 450.0
