"""Workbooks and compressed tables are read like text files, up to a limit of their size."""

import bz2
import gzip
import io
import lzma
import zipfile

import numpy as np
import pandas as pd
import pytest
from written import HEAD, ROWS, message_of

import pymc_hyperelastic as ph

POINTS = [
    ["measured by hand", None, None, None],
    ["id", "test", "radius [mm]", "p (kPa)"],
    ["S1", 1, 7.25, 1.5],
    ["S1", 1, 8.125, 6],
]
TUBES = [["id", "inner_radius_um", "group"], ["S1", 7000, "C1"]]


def workbook(path, **sheets):
    pytest.importorskip("openpyxl")
    with pd.ExcelWriter(path) as writer:
        for name, rows in sheets.items():
            pd.DataFrame(rows).to_excel(writer, sheet_name=name, header=False, index=False)
    return path


def test_sheets_of_a_workbook_are_read_as_tables_with_line_numbers(tmp_path):
    path = workbook(tmp_path / "a.xlsx", points=POINTS[1:], tubes=TUBES, empty=[])
    data = ph.read_tests(path)
    assert data["radius"].values.tolist() == [7.25, 8.125] and data["experiment"].item() == 1
    assert data["inner_radius"].item() == 7.0 and data["group"].item() == "C1"
    assert data["row"].values[1].item() == "a.xlsx, sheet 'points', line 3"
    assert "a.xlsx, sheet 'tubes': Excel, decimal points, 1 row\n" in data.attrs["understood"]


def test_sheet_of_notes_is_refused_with_what_to_do(tmp_path):
    path = workbook(tmp_path / "a.xlsx", points=POINTS[1:], tubes=TUBES, notes=[["by hand"]])
    with pytest.raises(ValueError, match=r"sheet 'notes' ends with .* leave it out"):
        ph.read_tests(path)


def test_cells_of_a_workbook_that_are_not_numbers_are_refused_with_their_line(tmp_path):
    rows = [*POINTS[1:], ["S1", 1, pd.Timestamp("2024-02-07"), True]]
    message = message_of(ph.read_tests, workbook(tmp_path / "a.xlsx", points=rows))
    assert "a.xlsx, line 4: 'radius [mm]' is '2024-02-07 00:00:00', a date" in message
    assert "a.xlsx, line 4: 'p (kPa)' is 'True', not a number" in message
    message = message_of(ph.read_tests, workbook(tmp_path / "b.xlsx", points=POINTS))
    assert message.startswith("b.xlsx: line 1 stands above the names of the columns, which are in")


def test_texts_with_commas_among_numbers_of_a_workbook_are_refused(tmp_path):
    """Excel shows the numbers with commas, too, so that a message about them would mislead."""
    rows = [POINTS[1], ["S1", 1, "7,25", "1,5"], ["S1", 1, 8.125, "6,25"]]
    message = message_of(ph.read_tests, workbook(tmp_path / "a.xlsx", points=rows))
    assert "'8.125'" not in message
    for cell in ("line 2: 'radius [mm]' is '7,25'", "line 2: 'p (kPa)' is '1,5'"):
        assert f"{cell}, not a number with decimal points" in message
    texts = [POINTS[1], ["S1", 1, "7,25", "1,5"], ["S1", 1, "8,125", 6]]
    path = workbook(tmp_path / "b.xlsx", points=texts, tubes=TUBES)
    assert ph.read_tests(path)["radius"].values.tolist() == [7.25, 8.125]


def test_damaged_or_too_large_workbook_is_refused(tmp_path):
    path = workbook(tmp_path / "a.xlsx", points=POINTS[1:])
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("xl/more.xml", b" " * 2**28)
    assert "it is larger than 268 million bytes" in message_of(ph.read_tests, path)
    path.write_bytes(path.read_bytes()[:1000])
    assert "that cannot be read" in message_of(ph.read_tests, path)


@pytest.mark.parametrize("suffix, module", [("gz", gzip), ("bz2", bz2), ("xz", lzma)])
def test_compressed_tables_are_read_and_damaged_or_endless_ones_refused(suffix, module, tmp_path):
    path = tmp_path / f"a.csv.{suffix}"
    path.write_bytes(module.compress(f"{HEAD}\n{ROWS}".encode()))
    data = ph.read_tests(path)
    np.testing.assert_array_equal(data["radius"], [7.2, 8.4])
    assert data["row"].values[0].item() == f"a.csv.{suffix}, line 2"
    path.write_bytes(module.compress(b"\n" * 100)[:-4])
    assert "cannot be decompressed" in message_of(ph.read_tests, path)
    path.write_bytes(module.compress(b"0" * 2**22))
    assert "has a line of more than 131072 bytes" in message_of(ph.read_tests, path)


def test_compressed_table_of_blank_lines_is_refused_before_it_fills_the_memory(tmp_path):
    path, block = tmp_path / "a.csv.gz", gzip.compress(b"\n" * 2**22)
    with path.open("wb") as file:
        for _ in range(2**6 + 1):
            file.write(block)
    assert "has more than 268 million bytes" in message_of(ph.read_tests, path)


def test_workbook_without_openpyxl_is_refused_with_what_to_install(tmp_path, monkeypatch):
    path = tmp_path / "a.xlsx"
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        archive.writestr("xl/workbook.xml", "")
    path.write_bytes(content.getvalue())

    def without_openpyxl(*arguments, **settings):
        raise ImportError("no openpyxl")

    monkeypatch.setattr(pd, "read_excel", without_openpyxl)
    assert "install openpyxl, which reads it, or export" in message_of(ph.read_tests, path)
