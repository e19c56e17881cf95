"""Labels as text: without invisible characters, and without characters that files cannot hold."""

import re
from typing import Any

from pymc_hyperelastic.messages import LONGEST_TEXT, shown

# Spaces of one width, which a word processor puts between words that must stay on one line.
_SPACES = dict.fromkeys(map(ord, "\u00a0\u2007\u202f"), " ")
# Characters without width: spaces, joiners, a soft hyphen, the mark at the beginning of a file.
_UNSEEN = dict.fromkeys(map(ord, "\u200b\u200c\u200d\u2060\ufeff\u00ad"))
# Characters that XML forbids, so that no report can hold them: control characters and halves of
# characters.
_FORBIDDEN = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f\ud800-\udfff\ufffe\uffff]")


def plain_text(text: str) -> str:
    """Return a text with plain spaces and without characters that have no width.

    Two labels that look alike are then the same label.
    """
    return text.translate(_SPACES | _UNSEEN)


def plain_label(label: Any) -> str:
    """Return a label as plain text without spaces around it.

    Raises ValueError for a character that cannot be written to a report, and for a long text.
    """
    text = plain_text(str(label)).strip()
    if len(text) > LONGEST_TEXT:
        raise ValueError(
            f"the label {shown(text)} has {len(text)} characters; expected at most "
            f"{LONGEST_TEXT}: shorten it"
        )
    if found := forbidden_character(text):
        raise ValueError(
            f"the label {shown(text)} has the character {found!a}, which cannot be shown: remove it"
        )
    return text


def forbidden_character(text: str) -> str | None:
    """Return the first character that no label and no report may hold, or None."""
    found = _FORBIDDEN.search(text)
    return found[0] if found else None
