"""Files of cells: encoding, separator, and the line on which each row stands."""

import bz2
import csv
import gzip
import io
import lzma
import re
import unicodedata
import zipfile
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from pymc_hyperelastic.data.files.headers import heading
from pymc_hyperelastic.data.labels import forbidden_character, plain_text
from pymc_hyperelastic.messages import MOST_LISTED, in_one_line, shown

SEPARATORS = {"\t": "tabs", ";": "semicolons", ",": "commas"}

# The first bytes of zip archives, such as the spreadsheets of today are, and of old spreadsheets.
_ZIP, _BINARY = b"PK\x03\x04", (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")
_COMPRESSED: dict[str, Callable[..., Any]] = {
    ".gz": gzip.open,
    ".bz2": bz2.open,
    ".xz": lzma.open,
}
_MARKS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
_ENCODINGS = {"utf-8": "UTF-8", "utf-8-sig": "UTF-8", "utf-16": "UTF-16", "cp1252": "Latin-1"}
# A sign alone before a separator is the name of a column of numbers.
_COMMENT = re.compile(r"\s*#(?![,;\t])")
# A cell that is a number cannot be the name of a column. No number has as many digits.
_NUMBER = re.compile(r"(?=[+-]?[.,]*[0-9])[+-]?[0-9.,]{1,60}([eE][+-]?[0-9]{1,4})?")
#: Bytes of a file, once it is decompressed: some million measured points.
LARGEST_FILE = 2**28
# Lines in which the names of columns, and a separator if the first line has none, are looked for.
_LINES_LOOKED_AT = 100
# Bytes of a line: no table has as many columns, and a file without line breaks is no table.
_LONGEST_LINE = csv.field_size_limit()
_LINE_BREAK = re.compile(r"\r\n|\r|\n")
_EXPORT = "export each sheet as CSV (File, Save as, CSV UTF-8), and give the CSV files"


@dataclass(frozen=True)
class Sheet:
    """Cells of a file, as text without spaces around it, without blank lines and comments."""

    file: str
    form: str
    """Encoding and separator in words."""
    separator: str
    names: list[str]
    name_line: int
    cells: list[list[str]]
    """Rows below the names, each with as many cells as there are names."""
    lines: list[int]
    """The line of each row."""

    def place(self, line: int) -> str:
        """File and line, as messages name them."""
        return f"{self.file}, line {line}"


def lines_in_words(lines: Sequence[int]) -> str:
    """Lines of a file, as messages name them."""
    runs: list[list[int]] = []
    for line in lines:
        if not runs or line != runs[-1][-1] + 1:
            runs.append([])
        runs[-1].append(line)
    named = runs[:MOST_LISTED]
    words = [
        f"{run[0]} to {run[-1]}" if len(run) > 2 else ", ".join(map(str, run)) for run in named
    ]
    others = len(lines) - sum(map(len, named))
    more = f" and {others} more" if others else ""
    return f"line{'s' * (len(lines) > 1)} {', '.join(words)}{more}"


def read_sheets(
    path: Path, file: str, separator: str | None = None, columns: Collection[str] = ()
) -> list[Sheet]:
    """Cells of a file, which messages call `file`; its separator is found unless it is given.

    The `columns` are names that the settings give to columns. A workbook has several sheets.
    """
    content = _content(path, file)
    if path.suffix.lower() == ".xlsx" and content.startswith(_ZIP):
        return list(_sheets_of_workbook(content, file, columns))
    return [sheet_of(*_decoded(content, file), file, separator, columns)]


def _content(path: Path, file: str) -> bytes:
    """Bytes of a file; one that is too long is refused before all of it is in memory."""
    unpacked = _COMPRESSED.get(path.suffix.lower(), open)
    try:
        with unpacked(path, "rb") as opened:
            content = opened.read(LARGEST_FILE + 1)
    except (EOFError, gzip.BadGzipFile, lzma.LZMAError) as error:
        raise ValueError(f"{file} cannot be decompressed: {in_one_line(error)}") from None
    if len(content) > LARGEST_FILE:
        raise ValueError(
            f"{file} has more than {LARGEST_FILE / 1e6:.0f} million bytes: divide it, or leave "
            "out points"
        )
    return content


def _sheets_of_workbook(content: bytes, file: str, columns: Collection[str]) -> Iterator[Sheet]:
    """Sheets of an Excel workbook that are not empty."""
    try:
        # The sizes that the archive states are those to which it may be decompressed.
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            if sum(part.file_size for part in archive.infolist()) > LARGEST_FILE:
                raise ValueError(f"it is larger than {LARGEST_FILE / 1e6:.0f} million bytes")
        workbook = pd.read_excel(
            io.BytesIO(content), sheet_name=None, header=None, dtype=str, na_filter=False
        )
    except ImportError:
        raise ValueError(
            f"{file} is a spreadsheet (.xlsx): install openpyxl, which reads it, or {_EXPORT}"
        ) from None
    # A damaged workbook makes openpyxl raise almost anything.
    except Exception as error:
        raise ValueError(
            f"{file} is a spreadsheet (.xlsx, or another archive) that cannot be read "
            f"({in_one_line(error)}): {_EXPORT}"
        ) from None
    filled = {name: cells for name, cells in workbook.items() if not cells.empty}
    for name, frame in (filled or workbook).items():
        of_sheet = f"{file}, sheet {shown(name)}" if len(filled) > 1 else file
        rows = frame.fillna("").astype(str).to_numpy().tolist()
        records = {
            line: cells
            for line, row in enumerate(rows, 1)
            if any(cells := [_plain(cell).strip() for cell in row])
            and not (cells[0].startswith("#") and not any(cells[1:]))
        }
        for line, cells in records.items():
            if forbidden := forbidden_character("".join(cells)):
                raise _forbidden(of_sheet, line, forbidden)
        looked_at = list(records.values())[:_LINES_LOOKED_AT]
        _check_preamble([_are_names(row, columns) for row in looked_at], [*records], of_sheet)
        yield _sheet(records, of_sheet, "Excel", "")


def sheet_of(
    text: str,
    encoding: str,
    file: str,
    separator: str | None = None,
    columns: Collection[str] = (),
) -> Sheet:
    """Cells of a text. Raises ValueError without rows, or if rows do not fit the names.

    Lines that begin with # are remarks above the names, and below them if they have no separator.
    Names may stand behind a #, as ``numpy.savetxt`` writes them.
    """
    lines = _LINE_BREAK.split(_plain(text))
    # A spreadsheet writes the separator into a first line of its own, sep=;
    if stated := re.fullmatch(r"sep=([;,\t])", lines[0]):
        separator, lines[0] = separator or stated[1], ""
    top = next((i for i, line in enumerate(lines) if _is_content(line)), 0)
    looked_at = lines[top : top + _LINES_LOOKED_AT]
    are_names = [any(_are_names(line.split(m), columns) for m in SEPARATORS) for line in looked_at]
    _check_preamble(are_names, range(top + 1, len(lines) + 1), file)
    if separator is None:
        # The lines below decide if the first has no separator.
        counts = {m: [_count(line, m) for line in looked_at] for m in SEPARATORS}
        separator = max(SEPARATORS, key=lambda mark: (counts[mark][0], max(counts[mark])))
    lines = [*_without_remarks(lines[: top + 1], separator), *lines[top + 1 :]]
    lines = [
        "" if i > top and _COMMENT.match(line) and separator not in line else line
        for i, line in enumerate(lines)
    ]
    form = f"{encoding}, separated by {SEPARATORS[separator]}"
    return _sheet(_records(lines, separator, file), file, form, separator)


def _records(lines: list[str], separator: str, file: str) -> dict[int, list[str]]:
    """Cells of the lines, by the number of the line.

    Not by pandas: it takes half a minute for a line of 20,000 cells, and drops cells beyond the
    names without a word.
    """
    reader = csv.reader(
        io.StringIO("\n".join(lines), newline=""), delimiter=separator, skipinitialspace=True
    )
    records: dict[int, list[str]] = {}
    line = 1
    try:
        for cells in reader:
            if records and any("\n" in cell for cell in cells):
                raise ValueError(
                    f"{file}, line {line}: a quotation mark opens here that is closed in line "
                    f"{reader.line_num}, if at all: remove it, or close the cell in its own line"
                )
            records[line] = [cell.strip() for cell in cells]
            line = reader.line_num + 1
    except csv.Error as error:
        raise ValueError(
            f"{file}, line {line}: this line cannot be read ({in_one_line(error)}): is there a "
            "quotation mark that is not closed?"
        ) from None
    return records


def _sheet(records: dict[int, list[str]], file: str, form: str, separator: str) -> Sheet:
    """Sheet of rows of cells by line, of which the first that is not blank holds the names."""
    records = {line: cells for line, cells in records.items() if any(cells)}
    if not records:
        raise ValueError(
            f"{file} is empty; expected a line with the names of columns, and one line a measured "
            "point"
        )
    (name_line, names), *rows = records.items()
    _check_names(names, [cells for _, cells in rows], f"{file}, line {name_line}")
    if not rows:
        raise no_rows(file, name_line)
    width = len(names)
    too_long = {line: len(cells) for line, cells in rows if any(cells[width:])}
    if too_long:
        raise ValueError(
            f"{file}, {lines_in_words(list(too_long))}: there are {max(too_long.values())} cells, "
            f"and {width} names of columns in line {name_line}, separated by "
            f"{SEPARATORS[separator]}: is there a decimal comma between commas, or a separator "
            "inside a cell? Put the cell in quotation marks, or separate by semicolons"
        )
    cells = [(cells + [""] * width)[:width] for _, cells in rows]
    return Sheet(file, form, separator, names, name_line, cells, [line for line, _ in rows])


def _check_preamble(are_names: list[bool], lines: Sequence[int], file: str) -> None:
    """Raise ValueError if lines stand above the names that are neither blank nor remarks."""
    below = next((i for i, are in enumerate(are_names) if are), 0)
    if below:
        # The last of several lines of names stands above the numbers.
        while are_names[below + 1 : below + 2] == [True]:
            below += 1
        first, last, names = lines[0], lines[below] - 1, lines[below]
        where = f"lines {first} to {last} stand" if last > first else f"line {first} stands"
        raise ValueError(
            f"{file}: {where} above the names of the columns, which are in line {names}: begin "
            "each line above the names with #, or delete it"
        )


def _are_names(cells: list[str], columns: Collection[str]) -> bool:
    """Return True for several cells, one of them the name of a column of numbers."""
    cells = [cell.strip(' "') for cell in cells]
    if len(cells) < 2 or any(map(_NUMBER.fullmatch, cells)):
        return False
    known = filter(None, map(heading, cells))
    return any(cell in columns for cell in cells) or any(not each.is_label for each in known)


def _check_names(names: list[str], rows: list[list[str]], where: str) -> None:
    """Raise ValueError if a line does not hold names, but one above it or below."""
    filled = [name for name in names if name]
    widest = max((sum(map(bool, cells)) for cells in rows), default=0)
    fix = "write the names of the columns into one line above the numbers"
    if sum(bool(_NUMBER.fullmatch(name)) for name in filled) > len(filled) / 2:
        raise ValueError(f"{where}: there are numbers where names of columns are expected: {fix}")
    if len(filled) == 1 and widest > 1:
        raise ValueError(
            f"{where}: {shown(filled[0])} stands alone where names of columns are expected, above "
            f"{widest} columns: {fix}, and begin each line above the names with #"
        )


def no_rows(file: str, line: int) -> ValueError:
    """Error of a file that ends with its names, in a `line`."""
    return ValueError(
        f"{file} ends with the names of columns, in line {line}; expected one line a measured "
        "point below them. If it is no table of the study, leave it out"
    )


def _decoded(content: bytes, file: str) -> tuple[str, str]:
    """Text of a file, and its encoding in words."""
    if content.startswith(_BINARY):
        raise ValueError(
            f"{file} is a spreadsheet (.ods, .xls) or a zip archive, not a text file: open it, "
            f"{_EXPORT}; or save it as a workbook, .xlsx"
        )
    if max(map(len, content.splitlines()), default=0) > _LONGEST_LINE:
        raise ValueError(
            f"{file} has a line of more than {_LONGEST_LINE} bytes: is it a table, with one line "
            "a measured point?"
        )
    marked = next((name for start, name in _MARKS.items() if content.startswith(start)), None)
    # Each byte is a letter of Latin-1, so that it comes last; Windows writes its superset.
    for encoding in [marked] if marked else ["utf-8", "cp1252"]:
        try:
            text = content.decode(encoding)
        except UnicodeDecodeError:
            continue
        if forbidden := forbidden_character(text):
            line = len(_LINE_BREAK.findall(text[: text.index(forbidden)])) + 1
            raise _forbidden(file, line, forbidden)
        return text, _ENCODINGS[encoding]
    raise ValueError(
        f"{file} is not a text file: it holds bytes that are no letters. Export the table as CSV, "
        "in UTF-8"
    )


def _forbidden(file: str, line: int, character: str) -> ValueError:
    return ValueError(
        f"{file}, line {line}: there is a character {character!a}, which no text has: export the "
        "table as CSV, in UTF-8, or remove the character"
    )


def _plain(text: str) -> str:
    return unicodedata.normalize("NFC", plain_text(text))


def _is_content(line: str) -> bool:
    """Return True for a line that is neither a remark nor blank."""
    return bool(line.strip(" ,;\t")) and not _COMMENT.match(line)


def _without_remarks(lines: list[str], separator: str) -> list[str]:
    """Return the lines down to the names with remarks made blank.

    If the last line is one of numbers, the names are those behind the # above it.
    """
    *above, last = lines
    remarks = [i for i, line in enumerate(above) if _COMMENT.match(line)]
    plain = ["" if _COMMENT.match(line) else line for line in above]
    if remarks and any(_NUMBER.fullmatch(cell.strip()) for cell in last.split(separator)):
        names = _COMMENT.sub("", above[remarks[-1]])
        if names.count(separator) == last.count(separator) > 0:
            plain[remarks[-1]] = names
    return [*plain, last]


def _count(line: str, separator: str) -> int:
    """How many cells a line has."""
    return len(next(csv.reader([line], delimiter=separator, skipinitialspace=True), []))
