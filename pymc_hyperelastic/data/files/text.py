"""Text files of cells: encoding, separator, and the line on which each row stands."""

import csv
import io
import re
import unicodedata
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from pymc_hyperelastic.data.files.headers import KINDS, heading
from pymc_hyperelastic.data.labels import forbidden_character, plain_text
from pymc_hyperelastic.messages import in_one_line, shown

SEPARATORS = {"\t": "tabs", ";": "semicolons", ",": "commas"}

# The first bytes of archives, such as the spreadsheets of today are, and of old spreadsheets.
_BINARY = b"PK\x03\x04", b"\xd0\xcf\x11\xe0"
_MARKS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
_ENCODINGS = {"utf-8": "UTF-8", "utf-8-sig": "UTF-8", "utf-16": "UTF-16", "cp1252": "Latin-1"}
# A sign alone before a separator is the name of a column of numbers.
_COMMENT = re.compile(r"\s*#(?![,;\t])")
# A cell that is a number cannot be the name of a column. No number has as many digits.
_NUMBER = re.compile(r"(?=[+-]?[.,]*[0-9])[+-]?[0-9.,]{1,60}([eE][+-]?[0-9]{1,4})?")
# Runs of lines that a message names.
_MOST_LINES = 10
# Bytes of a line: no table has as many columns, and a file without line breaks is no table.
_LONGEST_LINE = 2**20
# Lines by which a separator is found, if the first has none.
_LINES_LOOKED_AT = 100
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


def lines_in_words(lines: Sequence[int]) -> str:
    """Lines of a file, as messages name them.

    Examples
    --------
    >>> lines_in_words([2, 3, 4, 7]), lines_in_words([5])
    ('lines 2 to 4, 7', 'line 5')
    >>> lines_in_words(range(2, 100, 2))
    'lines 2, 4, 6, 8, 10, 12, 14, 16, 18, 20 and 39 more'
    """
    runs: list[list[int]] = []
    for line in lines:
        if not runs or line != runs[-1][-1] + 1:
            runs.append([])
        runs[-1].append(line)
    told = runs[:_MOST_LINES]
    words = [f"{run[0]} to {run[-1]}" if len(run) > 2 else ", ".join(map(str, run)) for run in told]
    others = len(lines) - sum(map(len, told))
    more = f" and {others} more" if others else ""
    return f"line{'s' * (len(lines) > 1)} {', '.join(words)}{more}"


def read_sheet(
    path: Path, file: str, separator: str | None = None, columns: Collection[str] = ()
) -> Sheet:
    """Cells of a file, which messages call `file`; its separator is found unless it is given.

    The `columns` are names that the settings give to columns.
    """
    text, encoding = _decoded(_content(path, file), file)
    return sheet_of(text, file, encoding, separator, columns)


def _content(path: Path, file: str) -> bytes:
    """Bytes of a file; a line that is too long is refused before the whole file is in memory."""
    chunks = []
    with path.open("rb") as opened:
        while chunk := opened.read(_LONGEST_LINE):
            if len(chunk) == _LONGEST_LINE and not re.search(rb"[\r\n]", chunk):
                raise ValueError(
                    f"{file} has a line of more than {_LONGEST_LINE / 1e6:.0f} million bytes: is "
                    "it a table, with one line a measured point?"
                )
            chunks.append(chunk)
    return b"".join(chunks)


def sheet_of(
    text: str,
    file: str,
    encoding: str,
    separator: str | None = None,
    columns: Collection[str] = (),
) -> Sheet:
    r"""Cells of a text. Raises ValueError without rows, or where rows do not fit the names.

    Lines that begin with # are remarks above the names, and below them where they have no
    separator. Names may stand behind a #, as ``numpy.savetxt`` writes them.

    Examples
    --------
    >>> sheet = sheet_of("# id,p\nS1,2\n#2,3\n# a pause\n", "curves.csv", "UTF-8")
    >>> sheet.names, sheet.rows
    (['id', 'p'], [['S1', '2'], ['#2', '3']])
    """
    lines = _LINE_BREAK.split(unicodedata.normalize("NFC", plain_text(text)))
    # A spreadsheet writes the separator into a first line of its own, sep=;
    if stated := re.fullmatch(r"sep=([;,\t])", lines[0]):
        separator, lines[0] = separator or stated[1], ""
    top = next((i for i, line in enumerate(lines) if _is_content(line)), 0)
    _check_preamble(lines, top, file, columns)
    if separator is None:
        # The lines below decide where the first has no separator.
        below = lines[top : top + _LINES_LOOKED_AT]
        cells = {m: [_count(line, m) for line in below] for m in SEPARATORS}
        separator = max(SEPARATORS, key=lambda mark: (cells[mark][0], max(cells[mark])))
    lines = [*_without_remarks(lines[: top + 1], separator), *lines[top + 1 :]]
    lines = [
        "" if i > top and _COMMENT.match(line) and separator not in line else line
        for i, line in enumerate(lines)
    ]
    found = _records(lines, separator, file)
    if not found:
        raise ValueError(
            f"{file} is empty; expected a line with the names of columns, and one line a measured "
            "point"
        )
    (name_line, names), records = found[0], found[1:]
    _check_names(names, records, f"{file}, line {name_line}")
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


def _check_preamble(lines: list[str], top: int, file: str, columns: Collection[str]) -> None:
    """Raise ValueError where lines stand above the names that are neither blank nor remarks."""
    names = [_are_names(line, columns) for line in lines[top : top + _LINES_LOOKED_AT]]
    below = next((i for i, are in enumerate(names) if are), 0)
    if below:
        # The last of several lines of names stands above the numbers.
        while names[below + 1 : below + 2] == [True]:
            below += 1
        first, last = top + 1, top + below
        where = f"lines {first} to {last} stand" if last > first else f"line {first} stands"
        raise ValueError(
            f"{file}: {where} above the names of the columns, which are in line {last + 1}: begin "
            "each line above the names with #, or delete it"
        )


def _are_names(line: str, columns: Collection[str]) -> bool:
    """Return True for a line of several cells, one of them the name of a column of numbers."""
    for separator in SEPARATORS:
        cells = [cell.strip(' "') for cell in line.split(separator)]
        known = [heading(cell) for cell in cells]
        is_known = any(cell in columns for cell in cells) or any(
            k and k.name in KINDS for k in known
        )
        if len(cells) > 1 and is_known and not any(map(_NUMBER.fullmatch, cells)):
            return True
    return False


def _check_names(names: list[str], records: list[tuple[int, list[str]]], where: str) -> None:
    """Raise ValueError where a line is no line of names, but one above it or below."""
    filled = [name for name in names if name]
    widest = max((sum(map(bool, cells)) for _, cells in records), default=0)
    fix = "write the names of the columns into one line above the numbers"
    if sum(bool(_NUMBER.fullmatch(name)) for name in filled) > len(filled) / 2:
        raise ValueError(f"{where}: there are numbers where names of columns are expected: {fix}")
    if len(filled) == 1 and widest > 1:
        raise ValueError(
            f"{where}: {shown(filled[0])} stands alone where names of columns are expected, above "
            f"{widest} columns: {fix}, and begin each line above the names with #"
        )


def no_rows(file: str, line: int) -> ValueError:
    """What is said of a file that ends with its names, in a `line`."""
    return ValueError(
        f"{file} ends with the names of columns, in line {line}; expected one line a measured "
        "point below them"
    )


def _decoded(content: bytes, file: str) -> tuple[str, str]:
    """Text of a file, and its encoding in words."""
    if content.startswith(_BINARY):
        raise ValueError(
            f"{file} is a spreadsheet (.xlsx, .ods, .xls) or a zip archive, not a text file: open "
            "it, export each sheet as CSV (File, Save as, CSV UTF-8), and give the CSV files"
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
            raise ValueError(
                f"{file}, line {line}: there is a character {forbidden!a}, which no text "
                "has: export the table as CSV, in UTF-8, or remove the character"
            )
        return text, _ENCODINGS[encoding]
    raise ValueError(
        f"{file} is not a text file: it holds bytes that are no letters. Export the table as CSV, "
        "in UTF-8"
    )


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
        raise ValueError(
            f"{file}, line {line}: this line cannot be read ({in_one_line(error)}): is there a "
            "quotation mark that is not closed?"
        ) from None
    return records


def _count(line: str, separator: str) -> int:
    """How many cells the beginning of a line has."""
    beginning = [line[:_LONGEST_CELL]]
    return len(next(csv.reader(beginning, delimiter=separator, skipinitialspace=True), []))
