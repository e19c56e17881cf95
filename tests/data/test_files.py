"""Files of laboratories are understood, or end in one message that says which row and what to do.

The files stand in ``messy/``. What they hold is written out here by hand.
"""

import warnings
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import pymc_hyperelastic as ph
from pymc_hyperelastic.data.inflation import check_inflation_data

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
DATE = (
    "a date, as spreadsheets make of numbers: format the column as numbers, and enter it again"
)
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
            "or correct it"
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
    "commas that may be either": (
        "commas_either.txt",
        None,
        [
            "commas_either.txt: '7,250', and whatever else has a comma, may have a decimal comma or "
            'thousands that are set apart: say decimal = "," or decimal = "." in the settings'
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
            "too_many_cells.csv, line 2: has 6 cells, and there are 4 names of columns in line 1, "
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
