"""Texts in messages: values, errors of other libraries, and the line that called the package."""

import os.path
import warnings
from typing import Any

#: A warning that skips files under this path names the line that called the package.
PACKAGE = os.path.join(os.path.dirname(__file__), "")
# Letters of a value that a message shows: a line of a terminal.
_LONGEST_SHOWN = 80
# Letters of the text of another library's error: some lines.
_LONGEST_REASON = 300


def warn_user(words: str) -> None:
    """Issue a warning that points to the user's line of code, outside the package."""
    warnings.warn(words, skip_file_prefixes=(PACKAGE,))


def shown(value: Any) -> str:
    """Return a value as an error shows it, cut off where it is long.

    Examples
    --------
    >>> shown("a" * 1000)[-5:], shown([1.5])
    ("aaa…'", '[1.5]')
    """
    if isinstance(value, str):
        return repr(value if len(value) <= _LONGEST_SHOWN else value[: _LONGEST_SHOWN - 1] + "…")
    text = " ".join(repr(value).split())
    return text if len(text) <= _LONGEST_SHOWN else text[: _LONGEST_SHOWN - 1] + "…"


def in_one_line(error: Exception) -> str:
    r"""Return the text of another library's error in one line, cut off where it is long.

    Examples
    --------
    >>> in_one_line(KeyError("mu")), in_one_line(ValueError("no\nnumber"))
    ("KeyError: 'mu'", 'no number')
    """
    text = " ".join(str(error).split())
    if isinstance(error, KeyError) or not text:
        text = f"{type(error).__name__}: {text}"
    return text if len(text) <= _LONGEST_REASON else text[: _LONGEST_REASON - 1] + "…"
