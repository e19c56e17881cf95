"""Parameters of tests that belong to different tiers."""

from collections.abc import Callable, Iterable
from typing import Any

import pytest


def deep(values: Iterable[Any]) -> list:
    """Mark parameters as second tier; a tuple holds the values of several arguments."""
    several = (value if isinstance(value, tuple) else (value,) for value in values)
    return [pytest.param(*value, marks=pytest.mark.deep) for value in several]


def long(values: Iterable[Any]) -> list:
    """Mark parameters as second tier and `long`: they run before a release."""
    return [pytest.param(*own.values, marks=[*own.marks, pytest.mark.long]) for own in deep(values)]


def tiers(values: Iterable[Any], first: Callable[[Any], bool]) -> list:
    """Mark all parameters as second tier, except those for which `first` is true."""
    return [value if first(value) else deep([value])[0] for value in values]
