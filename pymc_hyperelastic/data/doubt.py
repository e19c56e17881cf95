"""What is done about input that may be right, but probably is not."""

import warnings
from collections.abc import Sequence
from typing import Literal, get_args

Check = Literal["warn", "raise", "ignore"]


def check_known(check: Check) -> None:
    """Raise unless `check` is one of the ways."""
    if check not in get_args(Check):
        raise ValueError(f"check is {check!r}; expected one of {get_args(Check)}")


def doubt(messages: Sequence[str], check: Check, *, stacklevel: int) -> None:
    """Warn of the first of some doubts of one kind and count the others, or raise, or be silent.

    Examples
    --------
    >>> doubt(["a pressure of 120 kPa"], "ignore", stacklevel=1)
    >>> doubt(["a pressure of 120 kPa"], "raise", stacklevel=1)
    Traceback (most recent call last):
    ValueError: a pressure of 120 kPa
    """
    check_known(check)
    if not messages or check == "ignore":
        return
    message, others = messages[0], len(messages) - 1
    if others:
        message += f" (and so {'is 1 other' if others == 1 else f'are {others} others'})"
    if check == "raise":
        raise ValueError(message)
    warnings.warn(f'{message}; if it is right, say check="ignore"', stacklevel=stacklevel + 1)
