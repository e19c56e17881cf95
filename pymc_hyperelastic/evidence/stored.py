"""What is read of a result: attributes, groups and draws, or one error that says what is wrong.

A result may have been edited, cut, or written by something else. All that is read of it as text,
JSON or numbers passes here: nothing is evaluated, imported or looked up by a name in a file.
"""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from math import isfinite
from typing import Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.messages import shown

type Result = xr.Dataset | xr.DataTree

_REQUIRED = object()

_BLAME = "; it was not written by pymc_hyperelastic, or is damaged"


class Damaged(ValueError):
    """What a result holds is not what it should."""


def damaged(result: Result, what: str, blame: str = _BLAME) -> Damaged:
    """Error that names the result, its file if that is known, and what is wrong."""
    name = result.name if isinstance(result, xr.DataTree) else None
    called = f"class {name!r}" if name else "the result"
    return Damaged(f"{called}{source_of(result)}: {what}{blame}")


def source_of(result: Result) -> str:
    """Return the file from which a result was read, in words; nothing if that is not known."""
    known = [result, *(result.parents if isinstance(result, xr.DataTree) else ())]
    sources = {str(part.encoding["source"]) for part in known if part.encoding.get("source")}
    return f" of {sources.pop()}" if len(sources) == 1 else ""


@contextmanager
def reading(result: Result, blame: str = _BLAME) -> Iterator[None]:
    """Let errors about what was read of a result name it."""
    try:
        yield
    except Damaged:
        raise
    except (TypeError, ValueError) as error:
        raise damaged(result, str(error), blame) from error


def read_text(result: Result, name: str, default: Any = _REQUIRED) -> Any:
    """An attribute that is text; the default if it is missing, and may be."""
    if name not in result.attrs:
        if default is _REQUIRED:
            raise damaged(result, f"its attribute {name!r} is missing")
        return default
    text = result.attrs[name]
    if not isinstance(text, str) or not text:
        raise damaged(result, f"its attribute {name!r} is {shown(text)}; expected text")
    return text


def read_json(result: Result, name: str, default: Any = _REQUIRED) -> Any:
    """An attribute that is JSON: as what it says, of the type of the default if there is one."""
    text = read_text(result, name, None if default is not _REQUIRED else _REQUIRED)
    if text is None:
        return default
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        raise damaged(result, f"its attribute {name!r} is no JSON: {shown(text)}") from None
    if default is not _REQUIRED and not isinstance(value, type(default)):
        raise damaged(
            result, f"its attribute {name!r} is {shown(value)}; expected {_kind_of(default)}"
        )
    return value


def read_dict(result: Result, name: str) -> dict[str, Any]:
    """An attribute that is a JSON object, and must be there."""
    value = read_json(result, name)
    if not isinstance(value, dict):
        raise damaged(result, f"its attribute {name!r} is {shown(value)}; expected a JSON object")
    return value


def read_number(result: Result, name: str, default: Any = _REQUIRED) -> float:
    """An attribute that is a finite number."""
    if name not in result.attrs and default is not _REQUIRED:
        return default
    if name not in result.attrs:
        raise damaged(result, f"its attribute {name!r} is missing")
    value = result.attrs[name]
    plain = (
        value.item() if isinstance(value, np.ndarray | np.generic) and value.size == 1 else value
    )
    if not is_number(plain) or not isfinite(plain):
        raise damaged(result, f"its attribute {name!r} is {shown(value)}; expected a number")
    return float(plain)


def read_group(tree: xr.DataTree, name: str) -> xr.Dataset:
    """A group of a result, which must hold something."""
    if name not in tree.children:
        raise damaged(
            tree, f"it has no group {name!r}; its groups are {sorted(map(str, tree.children))}"
        )
    data = tree[name].to_dataset()
    if not data.data_vars:
        raise damaged(tree, f"its group {name!r} is empty")
    return data


def read_draws(tree: xr.DataTree, group: str) -> xr.Dataset:
    """A group of draws: one of every chain, and none of length 0."""
    data = read_group(tree, group)
    for dim in ("chain", "draw"):
        if not data.sizes.get(dim):
            raise damaged(tree, f"its group {group!r} has no {dim!r}, or none of them")
    return data


def read_numbers(
    tree: xr.DataTree, group: str, name: str, dims: Sequence[str] | None, *, finite: bool = True
) -> xr.DataArray:
    """A variable of a group: finite numbers with these dimensions, in any order, none empty."""
    data = read_group(tree, group)
    check_numbers(tree, data, name, dims, f" of {group!r}", finite=finite)
    return data[name]


def check_numbers(
    result: Result,
    data: xr.Dataset,
    name: str,
    dims: Sequence[str] | None,
    where: str = "",
    *,
    finite: bool = True,
) -> None:
    """Raise unless a variable holds finite numbers with these dimensions, in any order."""
    if name not in data.variables:
        raise damaged(result, f"the variable {name!r}{where} is missing")
    variable = data[name]
    if dims is not None and set(variable.dims) != set(dims):
        raise damaged(
            result, f"{name!r}{where} has the dimensions {variable.dims}; expected {tuple(dims)}"
        )
    if not variable.size:
        raise damaged(result, f"{name!r}{where} is empty: {dict(variable.sizes)}")
    if variable.dtype.kind not in "biuf":
        raise damaged(result, f"{name!r}{where} holds {variable.dtype}; expected numbers")
    bad = int(np.sum(~np.isfinite(variable.values))) if finite else 0
    if bad:
        raise damaged(
            result, f"{bad} of {variable.size} numbers of {name!r}{where} are NaN or infinite"
        )


def is_number(value: Any) -> bool:
    """Whether this is a number as JSON has it, and not one beyond all that can be computed with."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        float(value)
    except OverflowError:
        return False
    return True


def is_said(value: Any) -> bool:
    """Whether an attribute says yes, whatever a file has made of it."""
    return isinstance(value, str | bool | int | float | np.generic) and bool(value)


def _kind_of(default: Any) -> str:
    return "a JSON object" if isinstance(default, dict) else "a JSON list"
