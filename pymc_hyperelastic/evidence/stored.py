"""Read attributes, groups and draws of a result, or raise an error that names the damaged part.

A result may have been edited, cut, or written by another program. These functions check text, JSON
and numbers of it. They evaluate no text, and look up no name of a file in a library.
"""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, fields, is_dataclass
from math import isfinite
from types import NoneType, UnionType
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np
import xarray as xr

from pymc_hyperelastic.messages import shown

type Result = xr.Dataset | xr.DataTree

_REQUIRED = object()

# Names of the types of JSON in errors.
_WORDS = {str: "text", float: "a number", bool: "true or false", NoneType: "null"}
_WORDS |= {list: "a JSON list", dict: "a JSON object"}

_BLAME = "; it was not written by pymc_hyperelastic, or is damaged"


class Damaged(ValueError):
    """A part of a result is missing, or of another type or size."""


def damaged(result: Result, what: str, blame: str = _BLAME) -> Damaged:
    """Return an error that names the result, its file if that is known, and the fault."""
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
    """Let errors about the content of a result name the result."""
    try:
        yield
    except Damaged:
        raise
    except (TypeError, ValueError) as error:
        raise damaged(result, str(error), blame) from error


def read_attribute(result: Result, kind: Any, name: str, default: Any = _REQUIRED) -> Any:
    """Return an attribute as a type, see :func:`from_json`; the default if it may be missing."""
    if name not in result.attrs and default is not _REQUIRED:
        return default
    if name not in result.attrs:
        raise damaged(result, f"its attribute {name!r} is missing")
    value, place = result.attrs[name], f"its attribute {name!r}"
    if isinstance(value, np.ndarray | np.generic) and value.size == 1:
        value = value.item()
    with reading(result):
        if kind not in (str, float):
            value = parsed_json(from_json(str, value, place), place)
        return from_json(kind, value, place)


def read_text(result: Result, name: str, default: Any = _REQUIRED) -> Any:
    """Return an attribute that is text."""
    return read_attribute(result, str, name, default)


def read_json(result: Result, name: str, default: Any = _REQUIRED) -> Any:
    """Return what an attribute of JSON says, of the type of the default if there is one."""
    kinds: dict[type, Any] = {dict: dict[str, Any], list: list[Any]}
    return read_attribute(result, kinds.get(type(default), Any), name, default)


def read_number(result: Result, name: str, default: Any = _REQUIRED) -> float:
    """Return an attribute that is a finite number."""
    value = read_attribute(result, float, name, default)
    if not isfinite(value):
        raise damaged(result, f"its attribute {name!r} is {value}; expected a finite number")
    return float(value)


def read_group(tree: xr.DataTree, name: str) -> xr.Dataset:
    """Return a group of a result that holds at least one variable."""
    if name not in tree.children:
        groups = sorted(map(str, tree.children))
        raise damaged(tree, f"it has no group {name!r}; its groups are {groups}")
    data = tree[name].to_dataset()
    if not data.data_vars:
        raise damaged(tree, f"its group {name!r} is empty")
    return data


def read_draws(tree: xr.DataTree, group: str) -> xr.Dataset:
    """Return a group of draws; no dimension may have the length 0."""
    data = read_group(tree, group)
    for dim in ("chain", "draw"):
        if not data.sizes.get(dim):
            raise damaged(tree, f"its group {group!r} has no {dim!r}, or none of them")
    return data


def read_numbers(
    tree: xr.DataTree, group: str, name: str, dims: Sequence[str] | None, *, finite: bool = True
) -> xr.DataArray:
    """Return a variable of finite numbers with these dimensions, in any order."""
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
    called = f"{name!r}{where}"
    if name not in data.variables:
        raise damaged(result, f"the variable {called} is missing")
    variable = data[name]
    if dims is not None and set(variable.dims) != set(dims):
        found = f"has the dimensions {variable.dims}"
        raise damaged(result, f"{called} {found}; expected {tuple(dims)}")
    if not variable.size:
        raise damaged(result, f"{called} is empty: {dict(variable.sizes)}")
    if variable.dtype.kind not in "biuf":
        raise damaged(result, f"{called} holds {variable.dtype}; expected numbers")
    bad = int(np.sum(~np.isfinite(variable.values))) if finite else 0
    if bad:
        raise damaged(result, f"{bad} of {variable.size} numbers of {called} are NaN or infinite")


def is_number(value: Any) -> bool:
    """Return True for an integer or a float that double precision can hold."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        float(value)
    except OverflowError:
        return False
    return True


def is_said(value: Any) -> bool:
    """Return True for an attribute that is true, a number or text: files have no booleans."""
    return isinstance(value, str | bool | int | float | np.generic) and bool(value)


def parsed_json(text: str, place: str) -> Any:
    """Return what JSON says; ValueError names the place."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        raise ValueError(f"{place} is no JSON: {shown(text)}") from None


def from_json(kind: Any, value: Any, place: str) -> Any:
    """Return a value of JSON as a type: a dataclass, list, dict, union, or what JSON has.

    ValueError if the value is of another type, or lacks entries of a dataclass.

    Examples
    --------
    >>> from_json(dict[str, float | None], {"sd": 1, "mean": None}, "the record")
    {'sd': 1, 'mean': None}
    """
    members: tuple[Any, ...] = get_args(kind) if isinstance(kind, UnionType) else (kind,)
    for member in members:
        basic = dict if is_dataclass(member) else get_origin(member) or member
        if basic is Any or (is_number(value) if basic is float else type(value) is basic):
            break
    else:
        basics = [dict if is_dataclass(m) else get_origin(m) or m for m in members]
        expected = " or ".join(_WORDS[basic] for basic in basics)
        raise ValueError(f"{place} is {shown(value)}; expected {expected}")
    if is_dataclass(member):
        types = get_type_hints(member)
        needed = {f.name for f in fields(member) if f.default is f.default_factory is MISSING}
        missing, unknown = sorted(needed - value.keys()), sorted(value.keys() - types.keys())
        if missing or unknown:
            raise ValueError(
                f"{place} lacks the entries {missing} and has the unknown entries "
                f"{shown(unknown)}; expected {[*types]}"
            )
        make: Any = member
        return make(**{k: from_json(types[k], v, f"{place}.{k}") for k, v in value.items()})
    if basic is list and isinstance(value, list):
        return [from_json(get_args(member)[0], v, f"{place}[{i}]") for i, v in enumerate(value)]
    if basic is dict and isinstance(value, dict):
        return {k: from_json(get_args(member)[1], v, f"{place}.{k}") for k, v in value.items()}
    return value
