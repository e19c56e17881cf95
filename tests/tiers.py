"""Parameters of a test of which some belong to the second tier."""

from collections.abc import Callable, Iterable
from typing import Any

import pytest


def deep(values: Iterable[Any]) -> list:
    """Parameters of the second tier; a tuple holds several."""
    several = (value if isinstance(value, tuple) else (value,) for value in values)
    return [pytest.param(*value, marks=pytest.mark.deep) for value in several]


def long(values: Iterable[Any]) -> list:
    """Parameters that take minutes together, and are run before a release."""
    return [pytest.param(*own.values, marks=[*own.marks, pytest.mark.long]) for own in deep(values)]


def tiers(values: Iterable[Any], first: Callable[[Any], bool]) -> list:
    """Parameters in their order, those of the first tier as they are and all others deep."""
    return [value if first(value) else deep([value])[0] for value in values]
