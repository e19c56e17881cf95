"""Labels as text: without characters that nobody sees, or that no file may hold."""

import re
from typing import Any

from pymc_hyperelastic.messages import shown

# Spaces of one width that a word processor puts between words which shall stay on one line.
_SPACES = dict.fromkeys(map(ord, "\u00a0\u2007\u202f"), " ")
# Characters without width: spaces, joiners, a soft hyphen, the mark at the beginning of a file.
_UNSEEN = dict.fromkeys(map(ord, "\u200b\u200c\u200d\u2060\ufeff\u00ad"))
# Characters of a label, which stands in tables, figures and names of files.
_LONGEST_LABEL = 200
# What XML forbids, and so what a report cannot hold: control characters, halves of characters.
_FORBIDDEN = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f\ud800-\udfff\ufffe\uffff]")


def plain_text(text: str) -> str:
    r"""Return a text with plain spaces and without characters that have no width.

    Two labels that look alike are then the same label.

    Examples
    --------
    >>> plain_text("S\u00a01\u200b")
    'S 1'
    """
    return text.translate(_SPACES | _UNSEEN)


def plain_label(label: Any) -> str:
    r"""Return a label as text, without spaces around it and as :func:`plain_text` has it.

    Raises ValueError for a character that cannot be written to a report, and for a long text.

    Examples
    --------
    >>> plain_label(" S\u00a01 "), plain_label(7)
    ('S 1', '7')
    """
    text = plain_text(str(label)).strip()
    if len(text) > _LONGEST_LABEL:
        raise ValueError(
            f"the label {shown(text)} has {len(text)} characters; expected at most "
            f"{_LONGEST_LABEL}: shorten it"
        )
    if found := forbidden_character(text):
        raise ValueError(
            f"the label {shown(text)} has the character {found!a}, which cannot be shown: remove it"
        )
    return text


def forbidden_character(text: str) -> str | None:
    r"""Return the first character that no label and no report may hold, or None.

    Examples
    --------
    >>> forbidden_character("S\x0c1"), forbidden_character("S 1")
    ('\x0c', None)
    """
    found = _FORBIDDEN.search(text)
    return found[0] if found else None
