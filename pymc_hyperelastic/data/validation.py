"""Problems of input, collected so that all are reported at once: errors, warnings or nothing."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, get_args

from pymc_hyperelastic.messages import MOST_LISTED, PACKAGE

Check = Literal["warn", "raise", "ignore"]


def check_known(check: Check) -> None:
    """Raise unless `check` is one of the ways."""
    if check not in get_args(Check):
        raise ValueError(f"check is {check!r}; expected one of {get_args(Check)}")


class Problem(NamedTuple):
    """One problem: its place, a description, and the dimension whose unit may be the reason."""

    place: str
    what: str
    dimension: str = ""
    of_test: bool = False
    """True if the place is a whole test: tests with the same problem are counted, not listed."""
    test: int = -1


@dataclass
class Problems:
    """Errors and doubts about one input, until everything has been checked."""

    check: Check
    units: Mapping[tuple[str, str], str] = field(default_factory=dict)
    """In which unit a column was read, in words, by file and dimension."""
    advice: str = '; if it is right, say check="ignore"'
    """How to accept a doubt; empty for functions without an argument `check`."""
    _errors: dict[str, list[Problem]] = field(default_factory=dict)
    _doubts: dict[str, list[Problem]] = field(default_factory=dict)

    def add(self, place: str, what: str, dimension: str = "", of_test: bool = False) -> None:
        """Record an error."""
        key = what if of_test else f"{place}: {what}"
        self._errors.setdefault(key, []).append(Problem(place, what, dimension, of_test))

    def doubt(self, kind: str, place: str, what: str, dimension: str = "") -> None:
        """Record a doubt: possible, but probably wrong. Doubts of a kind are reported as one."""
        if self.check != "ignore":
            self._doubts.setdefault(kind, []).append(Problem(place, what, dimension))

    def stop(self) -> None:
        """Raise if there are errors."""
        refuse([self._message(same) for same in self._errors.values()])

    def report(self) -> None:
        """Raise if there are errors; else raise or warn about doubts, as `check` says."""
        self.stop()
        if self.check == "raise":
            refuse([self._message(same) for same in self._doubts.values()])
        for same in self._doubts.values():
            warnings.warn(self._message(same, self.advice), skip_file_prefixes=(PACKAGE,))

    def _message(self, same: Sequence[Problem], advice: str = "") -> str:
        place, what, dimension, *_ = same[0]
        others = len(same) - 1
        message = f"{place}: {what}" if place else what
        if others:
            message += f" (and so {'is 1 other' if others == 1 else f'are {others} others'})"
        units = [
            words
            for (file, of_dimension), words in self.units.items()
            if of_dimension == dimension and file in place
        ]
        return message + advice + (f" ({'; '.join(units)})" if units else "")


def refuse(problems: Sequence[str]) -> None:
    """Raise ValueError with all problems, or the first of very many, if there are any."""
    problems = list(dict.fromkeys(problems))
    if len(problems) == 1:
        raise ValueError(problems[0])
    if problems:
        lines = [f"- {problem}" for problem in problems[:MOST_LISTED]]
        if len(problems) > MOST_LISTED:
            lines.append(f"- and {len(problems) - MOST_LISTED} more")
        raise ValueError("\n".join([f"{len(problems)} problems:", *lines]))
