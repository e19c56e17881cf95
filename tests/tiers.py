"""Parameters of a test of which some belong to the second tier."""

from collections.abc import Callable, Iterable
from typing import Any

import pytest


def deep(values: Iterable[Any]) -> list:
    """Parameters of the second tier."""
    return [
        pytest.param(*(value if isinstance(value, tuple) else (value,)), marks=pytest.mark.deep)
        for value in values
    ]


def tiers(values: Iterable[Any], first: Callable[[Any], bool]) -> list:
    """Parameters in their order, those of the first tier as they are and all others deep."""
    return [
        value if first(value) else pytest.param(value, marks=pytest.mark.deep) for value in values
    ]
