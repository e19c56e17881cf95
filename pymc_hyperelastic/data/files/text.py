"""Text files of cells: encoding, separator, and the line on which each row stands."""

import csv
import io
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

SEPARATORS = {"\t": "tabs", ";": "semicolons", ",": "commas"}

# The first bytes of what is no text: the files of spreadsheets are archives.
_SPREADSHEETS = {b"PK\x03\x04": ".xlsx or .ods", b"\xd0\xcf\x11\xe0": ".xls"}
_MARKS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
_ENCODINGS = {"utf-8": "UTF-8", "utf-8-sig": "UTF-8", "utf-16": "UTF-16", "cp1252": "Latin-1"}
_CONTROL = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")
# A sign alone before a separator is the name of a column of numbers.
_COMMENT = re.compile(r"\s*#(?![,;\t])")
_LONGEST_SHOWN = 40
_LONGEST_CELL = csv.field_size_limit()
_LINE_BREAK = re.compile(r"\r\n|\r|\n")


@dataclass(frozen=True)
class Sheet:
    r"""Cells of a file, without blank lines and comments: names, and rows with their lines.

    Examples
    --------
    >>> sheet = sheet_of("# a comment\nid; p\nS1; 2,5\n", "curves.csv", "UTF-8")
    >>> sheet.names, sheet.rows, sheet.place(0)
    (['id', 'p'], [['S1', '2,5']], 'curves.csv, line 3')
    """

    file: str
    encoding: str
    separator: str
    names: list[str]
    name_line: int
    rows: list[list[str]]
    lines: list[int]

    def place(self, i: int) -> str:
        """File and line of a row, as messages name them."""
        return f"{self.file}, line {self.lines[i]}"

    def column(self, position: int) -> list[str]:
        """Cells of a column."""
        return [row[position] for row in self.rows]


def quoted(cell: str) -> str:
    """Cell as messages show it.

    Examples
    --------
    >>> quoted("a" * 100)
    "'aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa…'"
    """
    return repr(cell if len(cell) <= _LONGEST_SHOWN else cell[:_LONGEST_SHOWN] + "…")


def lines_in_words(lines: Sequence[int]) -> str:
    """Lines of a file, as messages name them.

    Examples
    --------
    >>> lines_in_words([2, 3, 4, 7]), lines_in_words([5])
    ('lines 2 to 4, 7', 'line 5')
    """
    runs: list[list[int]] = []
    for line in lines:
        if not runs or line != runs[-1][-1] + 1:
            runs.append([])
        runs[-1].append(line)
    words = [f"{run[0]} to {run[-1]}" if len(run) > 2 else ", ".join(map(str, run)) for run in runs]
    return f"line{'s' * (len(lines) > 1)} {', '.join(words)}"


def read_sheet(path: Path, file: str, separator: str | None = None) -> Sheet:
    """Cells of a file, which messages call `file`; its separator is found unless it is given."""
    text, encoding = _decoded(path.read_bytes(), file)
    return sheet_of(text, file, encoding, separator)


def sheet_of(text: str, file: str, encoding: str, separator: str | None = None) -> Sheet:
    """Cells of a text. Raises ValueError without rows, or where rows do not fit the names."""
    lines = _LINE_BREAK.split(unicodedata.normalize("NFC", text))
    # A spreadsheet writes the separator into a first line of its own, sep=;
    if stated := re.fullmatch(r"sep=([;,\t])", lines[0]):
        separator, lines[0] = separator or stated[1], ""
    lines = ["" if _COMMENT.match(line) else line for line in lines]
    first = next((line for line in lines if line.strip(" ,;\t")), "")
    separator = separator or max(SEPARATORS, key=lambda mark: _count(first, mark))
    found = _records(lines, separator, file)
    if not found:
        raise ValueError(
            f"{file} is empty; expected a line with the names of columns, and one line a measured "
            "point"
        )
    (name_line, names), records = found[0], found[1:]
    if not records:
        raise no_rows(file, name_line)
    too_long = {line: len(cells) for line, cells in records if any(cells[len(names) :])}
    if too_long:
        raise ValueError(
            f"{file}, {lines_in_words(list(too_long))}: there are {max(too_long.values())} cells, "
            f"and {len(names)} names of columns in line {name_line}, separated by "
            f"{SEPARATORS[separator]}: is there a decimal comma between commas, or a separator "
            "inside a cell? Put the cell in quotation marks, or separate by semicolons"
        )
    width = len(names)
    rows = [(cells + [""] * width)[:width] for _, cells in records]
    return Sheet(file, encoding, separator, names, name_line, rows, [line for line, _ in records])


def no_rows(file: str, line: int) -> ValueError:
    """What is said of a file that ends with its names, in a `line`."""
    return ValueError(
        f"{file} ends with the names of columns, in line {line}; expected one line a measured "
        "point below them"
    )


def _decoded(content: bytes, file: str) -> tuple[str, str]:
    """Text of a file, and its encoding in words."""
    for start, kind in _SPREADSHEETS.items():
        if content.startswith(start):
            raise ValueError(
                f"{file} is a spreadsheet ({kind}), not a text file: open it, export each sheet as "
                "CSV (File, Save as, CSV UTF-8), and give the CSV files"
            )
    marked = next((name for start, name in _MARKS.items() if content.startswith(start)), None)
    # Each byte is a letter of Latin-1, so that it comes last; Windows writes its superset.
    for encoding in [marked] if marked else ["utf-8", "cp1252"]:
        try:
            text = content.decode(encoding)
        except UnicodeDecodeError:
            continue
        if not _CONTROL.search(text):
            return text, _ENCODINGS[encoding]
    raise ValueError(
        f"{file} is not a text file: it holds bytes that are no letters. Export the table as CSV, "
        "in UTF-8"
    )


def _records(lines: list[str], separator: str, file: str) -> list[tuple[int, list[str]]]:
    """Rows that are not blank, with the line on which each begins."""
    reader = csv.reader(
        io.StringIO("\n".join(lines), newline=""), delimiter=separator, skipinitialspace=True
    )
    records: list[tuple[int, list[str]]] = []
    line = 1
    try:
        for cells in reader:
            start, line = line, reader.line_num + 1
            if records and any("\n" in cell for cell in cells):
                raise ValueError(
                    f"{file}, line {start}: a quotation mark opens here that is closed in line "
                    f"{reader.line_num}, if at all: remove it, or close the cell in its own line"
                )
            cells = [cell.strip() for cell in cells]
            if any(cells):
                records.append((start, cells))
    except csv.Error as error:
        raise ValueError(f"{file}, line {line}: this line cannot be read, {error}") from None
    return records


def _count(line: str, separator: str) -> int:
    """How many cells the beginning of a line has."""
    beginning = [line[:_LONGEST_CELL]]
    return len(next(csv.reader(beginning, delimiter=separator, skipinitialspace=True), []))
