"""Whatever stands in a file, it is sound data or one error that names the file."""

import tempfile
import warnings
from pathlib import Path

import numpy as np
import pytest
from anything import cases
from hypothesis import given
from hypothesis import strategies as st

import pymc_hyperelastic as ph
from pymc_hyperelastic.data.files.headers import KINDS, LABELS, names_of
from pymc_hyperelastic.data.inflation import check_inflation_data

SOME = cases(1000)

UNITS = {
    "length": ["mm", "um", "µm", "cm"],
    "pressure": ["kPa", "mmHg", "Pa"],
    "force": ["mN", "N"],
    "angle": ["rad", "deg", "°"],
    "area": ["mm2", "µm²"],
    "volume": ["mm³"],
    "ratio": ["-", "1", "%"],
    "label": ["mm"],
}
NAMES = [other for name in (*LABELS, *KINDS) for other in names_of(name)]
FORMS = ["{} [{}]", "{} ({})", "{}_{}", "{} / {}", "{}, {}", "{} in {}"]
GAPS = ["", "n/a", "-", "NaN", " ", "#DIV/0!", "?"]
ODD = ["1,234", "1.234,5", "1e400", "1e-300", "-0", "0", "inf", "07. Feb", "12 mmHg", "7 mm", "−1"]
NEEDED = ["specimen", "experiment", "radius", "pressure"]
any_text = st.text(max_size=8)
odd_cells = st.one_of(st.sampled_from(GAPS + ODD), st.floats().map(str), any_text)
labels = st.sampled_from(["S1", "S1", "S2", "1", "01", "1.0", "Ü µ"])
# Mostly as one would write it, and now and then not.
rarely = st.integers(0, 19).map(lambda i: i == 13)


@st.composite
def headings(draw, name: str) -> str:
    """A name that is known, its unit in one of the forms, or none."""
    other = draw(st.sampled_from(names_of(name)))
    if name in LABELS or draw(rarely):
        return other
    return draw(st.sampled_from(FORMS)).format(other, draw(st.sampled_from(UNITS[KINDS[name]])))


@st.composite
def columns(draw, name: str, count: int, decimal: str) -> list[str]:
    """Cells that a column may have: labels, a curve that rises, or a measure that stays."""
    if name in ("cycle", "experiment", "specimen") and draw(st.booleans()):
        return [draw(labels) for _ in range(count)]
    if name in LABELS:
        return [draw(labels)] * count
    start = draw(st.floats(0.5, 9))
    rises = name in ("radius", "outer_diameter", "pressure", "axial_force", "axial_stretch")
    step = draw(st.floats(0, 0.5)) if rises else 0.0
    digits = draw(st.sampled_from([2, 2, 3]))
    return [f"{start + i * step:.{digits}f}".replace(".", decimal) for i in range(count)]


@st.composite
def tables(draw) -> bytes:
    """A table that is right, or nearly so."""
    needed = draw(st.sampled_from([NEEDED, NEEDED, NEEDED, ["specimen"]]))
    others = st.sampled_from([n for n in (*LABELS, *KINDS) if n not in NEEDED])
    names = [*needed, *draw(st.lists(others, max_size=3, unique=True))]
    count, separator = draw(st.integers(1, 6)), draw(st.sampled_from([",", ";", "\t"]))
    decimal = "." if separator == "," else draw(st.sampled_from([".", ","]))
    head = [draw(headings(name)) for name in names] + ["note"] * draw(rarely)
    cells = [draw(columns(name, count, decimal)) for name in names]
    rows = [list(row) for row in zip(*cells, strict=True)]
    for _ in range(draw(st.sampled_from([0, 0, 0, 1, 2]))):
        row = draw(st.sampled_from([*rows, head]))
        row[draw(st.integers(0, len(names) - 1))] = draw(odd_cells)
    if draw(rarely):
        rows = draw(st.permutations(rows)) + draw(st.lists(st.sampled_from(rows), max_size=2))
    lines = [separator.join(row) for row in [head, *rows]]
    end = draw(st.sampled_from(["\n", "\r\n", "\r", "\n\n"]))
    encoding = draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "cp1252"]))
    return end.join(lines).encode(encoding, "replace")


sections = st.fixed_dictionaries(
    {},
    optional={
        "columns": st.dictionaries(st.sampled_from(NAMES), st.sampled_from(NAMES), max_size=1),
        "constants": st.dictionaries(
            st.sampled_from([*LABELS, *KINDS]).flatmap(headings),
            st.one_of(st.floats(), labels),
            max_size=2,
        ),
        "radius_unit": st.sampled_from(UNITS["length"]),
        "pressure_unit": st.sampled_from(UNITS["pressure"]),
        "angle_unit": st.sampled_from(UNITS["angle"]),
        "force_unit": st.sampled_from(UNITS["force"]),
        "measured": st.sampled_from(["radius", "outer_diameter"]),
        "radii_of": st.sampled_from(["ring", "sector"]),
        "opening_angle_convention": st.sampled_from(["whole", "fung"]),
        "decimal": st.sampled_from([".", ","]),
        "cycles": st.sampled_from(["last", "all"]),
        "ignore": st.lists(st.sampled_from(NAMES), max_size=4),
    },
)


def assert_sound_or_refused(contents: list[bytes], said: dict | None) -> bool:
    """Whether the files were understood."""
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder, f"{'abc'[i]}.csv") for i in range(len(contents))]
        for path, content in zip(paths, contents, strict=True):
            path.write_bytes(content)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                data = ph.read_tests(paths, said)
            except (ValueError, TypeError, OSError) as error:
                assert any(path.name in str(error) for path in paths) or "settings" in str(error)
                return False
        check_inflation_data(data)
        assert np.isfinite(data["pressure"]).all() and data.attrs["understood"]
        for warning in caught:
            assert warning.category is UserWarning
            assert any(path.name in str(warning.message) for path in paths)
        return True


@pytest.mark.deep
@given(st.lists(tables(), min_size=1, max_size=3), st.one_of(st.none(), st.none(), sections))
@SOME
def test_tables_that_are_nearly_right(contents, said):
    """They are sound data, or one error that names a file or the settings."""
    assert_sound_or_refused(contents, said)


@pytest.mark.deep
@given(
    st.one_of(
        st.binary(max_size=200), st.text(max_size=200).map(lambda t: t.encode("utf-8", "replace"))
    )
)
@SOME
def test_any_bytes(content):
    """They are refused, with the file's name."""
    assert not assert_sound_or_refused([content], None)


# Pieces of settings, put together in any way.
WORDS = [
    *"[columns] [units] [constants] [files.'a.csv'] pressure radius specimen".split(),
    *"= = = \" ' # 1 0.5 inf".split(),
    *"pressure_unit decimal ignore true [ ] { } , . 2024-01-01 \n \n \n".split(" "),
    "'mmHg'",
    "'S1'",
]


@pytest.mark.deep
@given(st.one_of(st.text(max_size=60), st.lists(st.sampled_from(WORDS), max_size=12).map(" ".join)))
@SOME
def test_any_settings(text):
    """They are understood, or refused by the name of their file or of a table."""
    with tempfile.TemporaryDirectory() as folder:
        table, toml = Path(folder, "a.csv"), Path(folder, "study.toml")
        table.write_text("specimen,experiment,radius_mm,pressure_kPa\nS1,1,7.2,1.0\n")
        toml.write_bytes(text.encode("utf-8", "replace"))
        try:
            check_inflation_data(ph.read_tests([table, toml]))
        except ValueError as error:
            assert any(name in str(error) for name in ("study.toml", "a.csv", "in the settings"))
