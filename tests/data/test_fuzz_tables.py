"""Random changes of files give sound data, or one error that names the file or the settings."""

import os
import tempfile
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

import pymc_hyperelastic as ph
from pymc_hyperelastic.data.inflation import check_inflation_data

# FUZZ multiplies the number of cases, which are then new ones at each run.
TIMES = int(os.environ.get("FUZZ", "1"))
SOME = hypothesis_settings(
    max_examples=600 * TIMES,
    deadline=None,
    database=None,
    derandomize=TIMES == 1,
    suppress_health_check=list(HealthCheck),
)
MESSY = Path(__file__).parent / "messy"
TABLES = [p for p in sorted(MESSY.glob("*.*sv")) if p.name not in ("binary.csv", "empty.csv")]
NAMES = "radius [mm];p (kPa);inner_radius_um;stretch;group;cycle;opening angle (°)".split(";")
GAPS = ["", "n/a", "-", "NaN", " ", "#DIV/0!", "?"]
ODD = ["1,234", "1.234,5", "1e400", "1e-300", "-0", "0", "inf", "07. Feb", "12 mmHg", "7 mm", "−1"]
cells = st.one_of(st.sampled_from(GAPS + ODD + NAMES), st.floats().map(str), st.text(max_size=8))
SECTIONS = st.fixed_dictionaries(
    {},
    optional={
        "constants": st.dictionaries(st.sampled_from(NAMES), st.one_of(st.floats(), cells)),
        "radius_unit": st.sampled_from(["mm", "um", "kPa"]),
        "pressure_unit": st.sampled_from(["kPa", "mmHg", "mm"]),
        "measured": st.sampled_from(["radius", "outer_diameter"]),
        "decimal": st.sampled_from([".", ","]),
    },
)


@st.composite
def nearly_right(draw) -> bytes:
    """Draw a file of a laboratory in which up to two cells or lines are changed."""
    text = draw(st.sampled_from(TABLES)).read_bytes().decode("latin-1")
    separator = max(";\t,", key=text.count)
    rows = [line.split(separator) for line in text.splitlines()]
    for _ in range(draw(st.integers(0, 2))):
        i, j = draw(st.integers(0, len(rows) - 1)), draw(st.integers(0, 4))
        match draw(st.sampled_from(["cell", "cell", "repeat", "drop", "swap"])):
            case "cell":
                rows[i] = [*rows[i][:j], draw(cells), *rows[i][j + 1 :]]
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
                return False
        check_inflation_data(data)
        assert np.isfinite(data["pressure"]).all()
        assert all(f"{file}: " in data.attrs["understood"] for file in files)
        for warning in caught:
            assert warning.category is UserWarning
            assert any(file in str(warning.message) for file in files)
        return True


@pytest.mark.deep
def test_nearly_right_tables_give_sound_data_or_an_error_that_names_its_place():
    outcomes = set()

    @given(st.lists(nearly_right(), min_size=1, max_size=2), st.one_of(st.none(), SECTIONS))
    @SOME
    def check(contents, settings):
        outcomes.add(is_sound_or_refused(contents, settings))

    check()
    assert outcomes == {True, False}
