"""Files and values of any length are refused with a message of a few lines."""

import numpy as np
import pytest
from written import HEAD, ROWS, message_of

import pymc_hyperelastic as ph

# Letters of the message of one problem at most.
LONGEST = 2000
LONG = "y" * 100_000
SETTINGS = {
    "key": {LONG: 1},
    "unit": {"radius_unit": LONG},
    "column": {"columns": {"pressure": LONG}},
    "column of another name": {"columns": {LONG: "p"}},
    "list": {"ignore": LONG},
    "file": {"files": {LONG: {"group": "a"}}},
    "number": {"constants": {"inner_radius": LONG}},
    "label": {"constants": {"group": LONG}},
    "unit of one": {"units": {"radius": LONG}},
}


@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS)
def test_long_values_of_settings_are_shortened_in_messages(settings, written):
    message = message_of(written, f"{HEAD}\n{ROWS}", settings=settings)
    assert "yyy…'" in message and len(message) < LONGEST


TOML = {
    "key of many parts": ".".join("a" * 50_000) + " = 1\n",
    "nested": "a = " + "[" * 990,
}


@pytest.mark.parametrize("toml", TOML.values(), ids=TOML)
def test_settings_with_too_long_or_nested_keys_are_refused_in_few_letters(toml, written):
    message = message_of(written, f"{HEAD}\n{ROWS}", toml=toml)
    assert message.startswith("study.toml is no") and len(message) < LONGEST


TABLES = {
    "label": (f"{HEAD}\n{LONG},1,7,1\n", "line 2: 'specimen' is unusable: the label 'yyy.* has 1"),
    "cell": (f"{HEAD}\nS,1,{LONG},1\n", "line 2: 'radius_mm' is 'yyy.*…', not a number"),
    "name": (f"{HEAD},{LONG} [mm]\n", "ends with the names of columns"),
    "names": (
        ",".join(f"n{i}" for i in range(15_000)) + "\nS,2\n", "'n29' and 14970 others, and no",
    ),
    "lines": (
        f"{HEAD}\n" + "S,1,7,x\nS,1,7,1\n" * 500, "lines 2, 4, .*, 60 and 470 more: 'pressure_kPa'",
    ),
    "quotation mark": (f'{HEAD}\n"S' + "\n,1" * 100_000, "is there a quotation mark that is not"),
}  # fmt: skip


@pytest.mark.parametrize("table, expected", TABLES.values(), ids=TABLES)
def test_long_cells_names_and_line_numbers_are_shortened_in_messages(table, expected, written):
    with pytest.raises(ValueError, match=expected) as error:
        written(table)
    # The note of the error describes the columns, of which it lists at most 30 unused ones.
    for text in (str(error.value), *getattr(error.value, "__notes__", ())):
        assert len(text) < LONGEST


def test_endless_file_is_refused_without_reading_it_all(tmp_path):
    path = tmp_path / "a.csv"
    with path.open("wb") as file:
        file.truncate(10**12)  # takes no space on the disk
    message = message_of(ph.read_tests, path)
    assert message.startswith("a.csv has more than 268 million bytes")


def test_message_counts_specimens_without_points_beyond_thirty(written):
    points = f"{HEAD}\n" + "".join(f"S{i},1,7.2,1\nS{i},1,8.4,{6 + i / 9}\n" for i in range(3))
    tubes = "specimen,inner_radius_mm\n" + "".join(f"T{i},7\n" for i in range(50))
    message = message_of(written, points, tubes)
    assert "'T29' and 20 others: write labels in the same way" in message
    data = written(points, tubes + "S0,7\nS1,7\nS2,7\n")
    assert "specimen 'T29' and 20 others" in data.attrs["understood"]


def test_contradictory_numbers_of_two_tables_are_shown_in_the_message(written):
    tubes = "specimen,experiment,inner_radius_mm\nS1,1,7.5\n"
    head = f"{HEAD},inner_radius_mm\n"
    message = message_of(written, head + "S1,1,7.2,1,7\nS1,1,8.4,6,7\n", tubes)
    assert "inner_radius is 7.0, and 7.5 in b.csv, line 2" in message
    assert np.isclose(written(head + "S1,1,7.2,1,7\nS1,1,8.4,6,7\n")["inner_radius"].item(), 7)
