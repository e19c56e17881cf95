"""Columns of a table of measured points: labels and numbers, and an error where they are neither.

A specimen and an experiment, and a cycle and a phase if they have columns, make one test.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from numbers import Real
from typing import Any

import numpy as np
import pandas as pd

from pymc_hyperelastic.data.inflation import file_of, row_text
from pymc_hyperelastic.data.labels import plain_label
from pymc_hyperelastic.data.validation import Problems
from pymc_hyperelastic.data.variables import TEST_LABELS
from pymc_hyperelastic.messages import listed, shown
from pymc_hyperelastic.rounding import ROUNDING


@dataclass(frozen=True)
class Rows:
    """The rows of a frame, and to which test each belongs."""

    frame: pd.DataFrame
    problems: Problems
    labels: dict[str, np.ndarray]
    test: np.ndarray
    first: np.ndarray
    """First row of each test."""
    failed: set[int] = field(default_factory=set)
    """Tests with errors."""

    @property
    def of_files(self) -> bool:
        """True if the index names files and lines."""
        return bool(file_of(self.frame.index[0]))

    def place(self, i: int) -> str:
        """Test and label of a row, as messages name them."""
        return f"{self._labels_of(i)}, {row_text(self.frame.index[i])}"

    def test_of(self, i: int) -> str:
        """Test of a row, as messages name it."""
        file = file_of(self.frame.index[i])
        return f"{file}: {self._labels_of(i)}" if file else self._labels_of(i)

    def _labels_of(self, i: int) -> str:
        return ", ".join(f"{name} {label[i].item()!r}" for name, label in self.labels.items())

    def numbers(self, column: str, *, may_be_missing: bool = False) -> np.ndarray:
        """Read a column as floats, NaN if a cell is wrong; numbers that came as text are fine."""
        numbers = np.full(len(self.frame), np.nan)
        for i, value in enumerate(self.frame[column].tolist()):
            if pd.isna(value):
                if not may_be_missing:
                    self.refuse(i, f"{column} is missing (nan); fill it or drop the row")
                continue
            try:
                if isinstance(value, bool):
                    raise TypeError("bool is a number to Python")
                numbers[i] = float(value)
            except (TypeError, ValueError, OverflowError):
                self.refuse(
                    i,
                    f"{column} is {shown(value)}, not a number; correct it (decimal points, no "
                    "units)",
                )
                continue
            if not np.isfinite(numbers[i]):
                self.refuse(i, f"{column} is {value}; expected a finite number")
        return numbers

    def refuse(self, i: int, what: str) -> None:
        """Record an error of a row."""
        self.failed.add(int(self.test[i]))
        self.problems.add(self.place(i), what)

    def refuse_first(self, bad: np.ndarray, what: Callable[[int], str]) -> None:
        """Record an error of the first bad row of each test that has no error yet."""
        rows = np.flatnonzero(bad & ~np.isin(self.test, list(self.failed)))
        for i in rows[np.unique(self.test[rows], return_index=True)[1]].tolist():
            self.refuse(i, what(i))

    def refuse_test(self, test: int, what: str, dimension: str = "") -> None:
        """Record an error of a test that has none yet."""
        if test not in self.failed:
            self.failed.add(test)
            place = self.test_of(self.first[test])
            self.problems.add(place, what, dimension, of_test=True)

    def of_points(self, name: str, given: float | str) -> np.ndarray:
        """One number a row: the given one, or those of the column of the given name."""
        if isinstance(given, str):
            if given not in self.frame:
                raise ValueError(
                    f"{name}={shown(given)}: the frame has no such column; it has "
                    f"{listed(self.frame.columns)}. Give {name} as a number or as the name of a "
                    "column"
                )
            return self.numbers(given)
        if isinstance(given, bool | np.bool_) or not isinstance(given, Real):
            raise TypeError(
                f"{name} is {shown(given)}; expected a number, the name of a column, or nan if it "
                "is not known"
            )
        return np.full(self.test.size, float(given))

    def of_tests(self, name: str, given: float | str) -> np.ndarray:
        """One number a test, likewise; a column must not change within a test."""
        values = self.of_points(name, given)
        return self.constant(name, values) if isinstance(given, str) else values[self.first]

    def constant(self, name: str, values: np.ndarray) -> np.ndarray:
        """One value a test, and an error at rows that differ from their test's first."""
        of_test = values[self.first]
        expected = of_test[self.test]
        for i in np.flatnonzero(differ(values, expected)).tolist():
            self.refuse(
                i,
                f"{name} is {values[i].item()!r}, but {expected[i].item()!r} in the first row of "
                "this experiment; it must not change within one: correct it, or give the rows "
                "another experiment label",
            )
        return of_test

    def doubt_overlooked(self, name: str, given: float | str) -> None:
        """Doubt a number that is taken though a column of its name says something else."""
        if isinstance(given, str) or np.isnan(given) or name not in self.frame:
            return
        column = pd.to_numeric(self.frame[name], errors="coerce")
        if (column.notna() & (column != given)).any():
            self.problems.doubt(
                f"overlooked {name}",
                "",
                f"the frame has a column {name!r} with values other than {given:g}, which is taken "
                f"for all rows: to take the column, say Tube({name}={name!r})",
            )


def differ(values: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return True where values differ; numbers must differ by more than rounding errors."""
    different = values != others
    if values.dtype.kind == "f" == others.dtype.kind:
        different &= ~np.isclose(values, others, rtol=ROUNDING, atol=0, equal_nan=True)
    return different


def rows_of(frame: pd.DataFrame, problems: Problems) -> Rows:
    """Rows of a frame that has the columns it needs, see :func:`check_frame`."""
    labels = {name: labels_of(frame, name) for name in TEST_LABELS if name in frame}
    test, _ = pd.factorize(pd.MultiIndex.from_arrays(list(labels.values())))
    return Rows(frame, problems, labels, test, np.unique(test, return_index=True)[1])


def groups_of(rows: Rows) -> np.ndarray:
    """Group of each test; it is "all" if the frame has no column of groups."""
    if "group" not in rows.frame:
        return np.full(rows.first.size, "all")
    return rows.constant("group", labels_of(rows.frame, "group"))


def check_frame(frame: pd.DataFrame, needed: Iterable[str]) -> None:
    """Raise unless there is a frame with rows and with the needed columns."""
    if not isinstance(frame, pd.DataFrame):
        raise TypeError(
            f"expected a pandas DataFrame, not {type(frame).__name__}; "
            "read a file with read_tests, or with pandas.read_csv first"
        )
    missing = [name for name in needed if name not in frame]
    if missing:
        hint = ""
        if "radius" in missing and any("diameter" in str(name) for name in frame.columns):
            hint = " (of outer diameters under pressure say measured='outer_diameter')"
        raise ValueError(
            f"the frame has no column {' and no column '.join(map(repr, missing))}; it has "
            f"{listed(frame.columns)}: rename what holds it, "
            f"frame.rename(columns={{'...': {missing[0]!r}}}){hint}"
        )
    twice = frame.columns[frame.columns.duplicated()]
    if twice.size:
        raise ValueError(
            f"the frame has more than one column {shown(twice[0])}; drop or rename one"
        )
    if frame.empty:
        raise ValueError("the frame has no rows; expected one row a measured point")


def labels_of(frame: pd.DataFrame, column: str) -> np.ndarray:
    """Labels of a column, one a row: integers if all are and may be, else text."""
    labels = []
    for row, label in zip(frame.index, frame[column].tolist(), strict=True):
        # A spreadsheet with gaps elsewhere yields 1.0 for experiment 1.
        if isinstance(label, float) and label.is_integer():
            label = int(label)
        try:
            text = "" if pd.isna(label) else plain_label(label)
        except ValueError as error:
            raise ValueError(f"row {row}: {column}: {error}") from None
        if not text:
            raise ValueError(f"row {row}: {column} is missing; give every row a label")
        labels.append(label if isinstance(label, int | np.integer) else text)
    if column in ("experiment", "cycle"):
        return plain_array(labels)
    return np.array([str(label) for label in labels])


def plain_array(labels: list[Any]) -> np.ndarray:
    """Integers if all are, and a file can hold them; else text."""
    whole = all(isinstance(x, int | np.integer) and not isinstance(x, bool) for x in labels)
    if whole and all(-(2**63) <= x < 2**63 for x in labels):
        return np.array(labels, dtype=np.int64)
    return np.array([str(x) for x in labels])
