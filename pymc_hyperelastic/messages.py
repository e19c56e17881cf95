"""Texts in messages: values, errors of other libraries, and the line that called the package."""

import os.path
import warnings
from collections.abc import Iterable
from typing import Any

#: A warning that skips files under this path names the line that called the package.
PACKAGE = os.path.join(os.path.dirname(__file__), "")
#: Characters of a label, of the name of a column, and of a value that a message shows: some lines
#: of a terminal.
LONGEST_TEXT = 200
#: Number of labels, columns, lines or problems that a message lists.
MOST_LISTED = 30


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
        return repr(_shortened(value))
    return _shortened(" ".join(repr(value).split()))


def listed(labels: Iterable[Any]) -> str:
    """Return labels as messages list them, see :func:`enumerated`."""
    return enumerated(map(shown, labels))


def enumerated(texts: Iterable[str]) -> str:
    """Return texts separated by commas; of many, the first and the number of the others.

    Examples
    --------
    >>> enumerated(["a", "b"]), enumerated(map(str, range(50)))[-20:]
    ('a, b', '28, 29 and 20 others')
    """
    texts = list(texts)
    others = len(texts) - MOST_LISTED
    named = ", ".join(texts[:MOST_LISTED])
    return f"{named} and {others} others" if others > 0 else named


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
    return _shortened(text)


def _shortened(text: str) -> str:
    return text if len(text) <= LONGEST_TEXT else text[: LONGEST_TEXT - 1] + "…"
