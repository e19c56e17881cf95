"""Checks of the numbers that a user chooses."""

from numbers import Integral, Real
from typing import Any


def check_count(name: str, value: Any, least: int) -> None:
    """Raise unless `value` is a whole number, `least` at least."""
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise TypeError(f"{name} is {value!r}; expected a whole number")
    if value < least:
        raise ValueError(f"{name} is {value}; expected at least {least}")


def check_fraction(name: str, value: Any) -> None:
    """Raise unless `value` is a number between 0 and 1, neither of them included."""
    if not isinstance(value, Real) or not 0 < float(value) < 1:
        raise ValueError(f"{name} is {value!r}; expected a number between 0 and 1")
