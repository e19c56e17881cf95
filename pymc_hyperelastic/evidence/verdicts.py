"""Verdicts on an evidence, and the checks that other parts of the package register."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import xarray as xr

# Verdicts from good to bad.
GOOD, DOUBTFUL, BAD = VERDICTS = ("good", "doubtful", "not to be trusted")


class Check(NamedTuple):
    """A number, its limit, and the verdict that follows."""

    name: str
    value: float
    limit: float
    verdict: str
    words: str
    """The fault, if the verdict is not good."""


@dataclass(frozen=True)
class ModelChecks:
    """Checks of results of a kind of model, such as of the curves that it describes."""

    checks: Callable[[xr.DataTree, xr.Dataset], list[Check]]
    """Function of a result and of its group ``evidence``."""
    variables: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Dimensions of the variables of ``evidence`` that the checks read."""
    together: Mapping[str, str] = field(default_factory=dict)
    """Variables that are needed if another variable, or a group of the result, is there."""
    about_fit: tuple[str, ...] = ()
    """Names of checks that compare the model with its data: the evidence may be right."""
    with_advice: tuple[str, ...] = ()
    """Names of checks whose words say all that can be done."""


# Checks that are made wherever an evidence is diagnosed; whoever knows a kind of model appends its.
registered_checks: list[ModelChecks] = []


def check_small(name: str, value: float, good: float, doubtful: float, words: str) -> Check:
    """Return the check of a value that is good, or doubtful, up to a limit; NaN is bad."""
    verdict = GOOD if value <= good else DOUBTFUL if value <= doubtful else BAD
    return Check(name, value, good, verdict, words)


def worst_of(verdicts: Iterable[str]) -> str:
    """Return the worst of some verdicts; an empty one says nothing."""
    return max(verdicts, key=("", *VERDICTS).index)
