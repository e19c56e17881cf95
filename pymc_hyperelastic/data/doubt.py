"""What is done about input that may be right, but probably is not."""

import warnings
from collections.abc import Sequence
from typing import Literal, get_args

from pymc_hyperelastic.messages import PACKAGE

Check = Literal["warn", "raise", "ignore"]

# Problems that are told at once.
_MOST_TOLD = 20


def check_known(check: Check) -> None:
    """Raise unless `check` is one of the ways."""
    if check not in get_args(Check):
        raise ValueError(f"check is {check!r}; expected one of {get_args(Check)}")


def doubt(messages: Sequence[str], check: Check) -> None:
    """Warn of the first of some doubts of one kind and count the others, or raise, or be silent.

    Examples
    --------
    >>> doubt(["a pressure of 120 kPa"], "ignore")
    >>> doubt(["a pressure of 120 kPa"], "raise")
    Traceback (most recent call last):
    ValueError: a pressure of 120 kPa
    """
    check_known(check)
    if not messages or check == "ignore":
        return
    message = counted(messages)
    if check == "raise":
        raise ValueError(message)
    warnings.warn(f'{message}; if it is right, say check="ignore"', skip_file_prefixes=(PACKAGE,))


def counted(messages: Sequence[str]) -> str:
    """The first of some messages of one kind, and how many others there are.

    Examples
    --------
    >>> counted(["S1 is doubtful", "S2 is doubtful"])
    'S1 is doubtful (and so is 1 other)'
    """
    message, others = messages[0], len(messages) - 1
    if others:
        message += f" (and so {'is 1 other' if others == 1 else f'are {others} others'})"
    return message


def refuse(problems: Sequence[str]) -> None:
    """Raise with all problems that were found, or with as many as one can take in.

    Examples
    --------
    >>> refuse([])
    >>> refuse(["a.csv, line 2: no number", "a.csv, line 5: no number"])
    Traceback (most recent call last):
    ValueError: 2 problems:
    - a.csv, line 2: no number
    - a.csv, line 5: no number
    """
    problems = list(dict.fromkeys(problems))
    if len(problems) == 1:
        raise ValueError(problems[0])
    if problems:
        told = [f"- {problem}" for problem in problems[:_MOST_TOLD]]
        if len(problems) > _MOST_TOLD:
            told.append(f"- and {len(problems) - _MOST_TOLD} more")
        raise ValueError("\n".join([f"{len(problems)} problems:", *told]))
