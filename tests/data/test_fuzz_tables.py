"""Random changes of files give valid data, or one error that names the file or the settings."""

import os
import tempfile
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from tiers import deep

import pymc_hyperelastic as ph
from pymc_hyperelastic.data.inflation import check_data

# FUZZ multiplies the number of cases of the second tier, which are then new ones at each run.
TIMES = int(os.environ.get("FUZZ", "1"))
FIRST_TIER, SECOND_TIER = 60, 600 * TIMES
SOME = hypothesis_settings(
    deadline=None,
    database=None,
    derandomize=TIMES == 1,
    suppress_health_check=list(HealthCheck),
)
# Letters of one line of a message at most.
LONGEST_LINE = 2000
MESSY = Path(__file__).parent / "messy"
TABLES = [p for p in sorted(MESSY.glob("*.*sv")) if p.name not in ("binary.csv", "empty.csv")]
NAMES = "radius [mm];p (kPa);inner_radius_um;stretch;group;cycle;opening angle (°)".split(";")
GAPS = ["", "n/a", "-", "NaN", " ", "#DIV/0!", "?"]
UNSEEN = ["\u00a0", "\u200b", "\u202f", "\ufeff", "\u00ad", *"\t\n\x00\x0c\x1f\ufffe"]
HEADS = ["ID", "OD", "id", "P1 (mmHg)", "Avg Pressure (mmHg)", "Time (s)", "Label", "#", "pressure"]
UNITS = "mmHg mmhg kPa px point pc cmH2O µm μm um inch in % ° deg mN gf atm mm2 mm³ MPA".split()
ABOVE = ["=== log ===", "[HEADER]", "Date,2024-05-01", "sep=;", "# a remark, of two parts", "By;A."]
ODD = ["1,234", "1.234,5", "1e400", "1e-300", "-0", "0", "inf", "07. Feb", "12 mmHg", "7 mm", "−1"]
cells = st.one_of(st.sampled_from(GAPS + ODD + NAMES), st.floats().map(str), st.text(max_size=8))
firsts, unseen = st.sampled_from(["S", "#", "#S", "-"]), st.sampled_from(["", *UNSEEN])
labels = st.builds("{}{}{}".format, firsts, unseen, cells)
heads = st.builds("{}{} [{}]".format, st.sampled_from(HEADS), unseen, st.sampled_from(UNITS))
SECTIONS = st.fixed_dictionaries(
    {},
    optional={
        "constants": st.dictionaries(st.sampled_from(NAMES), st.one_of(st.floats(), cells)),
        "radius_unit": st.sampled_from(["mm", "um", "kPa"]),
        "pressure_unit": st.sampled_from(["kPa", "mmHg", "mm"]),
        "measured": st.sampled_from(["radius", "outer_diameter"]),
        "decimal": st.sampled_from([".", ","]),
        "columns": st.dictionaries(
            st.sampled_from(["specimen", "inner_diameter", "pressure", "radius"]),
            st.sampled_from(HEADS),
        ),
        "ignore": st.lists(st.sampled_from(HEADS), max_size=2),
    },
)


CHANGES = ["cell", "name", "column", "label", "above", "long", "repeat", "drop", "swap"]


@st.composite
def nearly_right(draw) -> bytes:
    """Draw a file of a laboratory in which up to two cells or lines are changed."""
    text = draw(st.sampled_from(TABLES)).read_bytes().decode("latin-1")
    separator = max(";\t,", key=text.count)
    rows = [line.split(separator) for line in text.splitlines()]
    for _ in range(draw(st.integers(0, 2))):
        i, j = draw(st.integers(0, len(rows) - 1)), draw(st.integers(0, 4))
        match draw(st.sampled_from([*CHANGES, "cell"])):
            case "cell":
                rows[i] = [*rows[i][:j], draw(cells), *rows[i][j + 1 :]]
            case "name":
                new = draw(st.one_of(st.sampled_from(HEADS), heads))
                rows[0] = [*rows[0][:j], new, *rows[0][j + 1 :]]
            case "column":
                values = [str(101.5 + 3 * k) for k in range(len(rows))]
                rows = [[*row, value] for row, value in zip(rows, ["ID", *values[1:]], strict=True)]
            case "label":
                label = draw(labels)
                rows = [[label, *row[1:]] if row[:1] == rows[i][:1] else row for row in rows]
            case "above":
                rows[:0] = [[line] for line in draw(st.lists(st.sampled_from(ABOVE), max_size=3))]
            case "long":
                rows[i] = [*rows[i][:j], draw(st.sampled_from("x7,;")) * 20_000, *rows[i][j + 1 :]]
            case "repeat":
                rows.append(rows[i])
            case "drop" if len(rows) > 1:
                del rows[i]
            case "swap":
                rows[i], rows[-1] = rows[-1], rows[i]
    separator = draw(st.sampled_from([separator, separator, ";", "\t"]))
    end = draw(st.sampled_from(["\n", "\r\n", "\r", "\n\n"]))
    encoding = draw(st.sampled_from(["utf-8", "latin-1", "utf-8-sig", "utf-16", "cp1252"]))
    return end.join(separator.join(row) for row in rows).encode(encoding, "replace")


def is_sound_or_refused(contents: list[bytes], settings: dict | None) -> bool:
    """Check the data or the error of files, and return whether there are data."""
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder, f"{'abc'[i]}.csv") for i in range(len(contents))]
        for path, content in zip(paths, contents, strict=True):
            path.write_bytes(content)
        files = [path.name for path in paths]
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                data = ph.read_tests(paths, settings)
            except ValueError as error:
                places = files if settings is None else [*files, "settings"]
                assert any(place in str(error) for place in places), error
                assert len(max(str(error).splitlines(), key=len)) < LONGEST_LINE, error
                return False
        check_data(data)
        assert np.isfinite(data["pressure"]).all()
        assert all(f"{file}: " in data.attrs["understood"] for file in files)
        for warning in caught:
            assert warning.category is UserWarning
            assert any(file in str(warning.message) for file in files)
            assert len(str(warning.message)) < LONGEST_LINE
        return True


@pytest.mark.parametrize("cases", [FIRST_TIER, *deep([SECOND_TIER])])
def test_randomly_changed_tables_give_valid_data_or_an_error_with_its_place(cases):
    outcomes = set()

    @given(st.lists(nearly_right(), min_size=1, max_size=2), st.one_of(st.none(), SECTIONS))
    @hypothesis_settings(SOME, max_examples=cases)
    def check(contents, settings):
        outcomes.add(is_sound_or_refused(contents, settings))

    check()
    assert outcomes == {True, False}
