"""Prepare a result for a netCDF file, which gives back only some names, types and attributes.

:func:`~pymc_hyperelastic.save_result` converts attributes, and refuses everything else by its name.
"""

import json
from collections.abc import Hashable
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.messages import shown

# Types of real numbers that every reader of netCDF files knows.
_FLOATS = ("float32", "float64")


def storable[Stored: (xr.Dataset, xr.DataTree)](result: Stored) -> Stored:
    """Return a copy with attributes as a file can hold them; TypeError names what it cannot hold.

    The `encoding` that xarray keeps of an earlier file, such as a smaller type, is removed: it
    would round the numbers.

    Examples
    --------
    >>> storable(xr.Dataset(attrs={"done": True})).attrs
    {'done': 1}
    """
    result = result.copy()
    for table in result.subtree if isinstance(result, xr.DataTree) else [result]:
        place = f" of group {table.path!r}" if isinstance(table, xr.DataTree) else ""
        for name in table.sizes:
            _check_name(name, "dimension", place)
        table.attrs = {k: _attribute(k, v, place) for k, v in table.attrs.items()}
        table.encoding = {k: v for k, v in table.encoding.items() if k == "source"}
        for name, variable in table.variables.items():
            _check_name(name, "variable", place)
            _check_values(table, name, place)
            of = f" of the variable {shown(name)}{place}"
            variable.attrs = {k: _attribute(k, v, of) for k, v in variable.attrs.items()}
            # NaN is what is missing, and needs no other number.
            variable.encoding = {"_FillValue": None} if variable.dtype.kind == "f" else {}
    return result


def _check_name(name: Hashable, what: str, place: str) -> None:
    if not isinstance(name, str) or not name or "/" in name or not _is_storable(name):
        raise TypeError(
            f"the {what} {shown(name)}{place} cannot be written under this name: rename it, to "
            "text without '/'"
        )


def _is_storable(text: str) -> bool:
    """Return True for text without NUL and halves of characters, which HDF5 cannot hold."""
    return "\0" not in text and text.encode("utf-8", "replace") == text.encode("utf-8", "ignore")


def _check_values(table: xr.Dataset | xr.DataTree, name: Hashable, place: str) -> None:
    """Raise TypeError for values of a type that a file would not give back."""
    variable, what = table.variables[name], f"the variable {shown(name)}{place}"
    if isinstance(table.xindexes.get(name), xr.indexes.PandasMultiIndex):
        raise TypeError(f"{what} is part of a MultiIndex, which a file cannot hold: unstack it")
    dtype = variable.dtype
    is_text = dtype == np.dtype("O") and all(isinstance(x, str) for x in variable.values.flat)
    known = isinstance(dtype, np.dtype) and (dtype in _FLOATS or dtype.kind in "biuUmM")
    if not (is_text or known):
        raise TypeError(
            f"{what} holds {dtype}, which a file does not give back: make it numbers, text or "
            "dates, such as by .astype(float) or .astype(str)"
        )
    if dtype.kind in "OU" and not all(map(_is_storable, variable.values.flat)):
        raise TypeError(f"{what} holds text with a character that a file cannot hold: remove it")
    if dtype.kind in "mM" and not _in_nanoseconds(variable.values):
        raise TypeError(
            f"{what} holds dates or times that nanoseconds cannot state: expected 1678 to 2262"
        )


def _in_nanoseconds(times: np.ndarray) -> bool:
    """Return True for times that a file gives back: it counts nanoseconds."""
    try:
        exact = times.astype(f"{times.dtype.kind}8[ns]").astype(times.dtype)
    except OverflowError:
        return False
    return np.array_equal(exact, times, equal_nan=True)


def _attribute(name: Hashable, value: Any, place: str) -> Any:
    """Return an attribute as text, a number or a list of numbers or texts."""
    if not isinstance(name, str) or not name or not _is_storable(name):
        raise TypeError(f"the attribute {shown(name)}{place} must be named by text: rename it")
    if isinstance(value, dict):
        try:
            value = json.dumps(value)
        except (TypeError, ValueError, RecursionError):
            pass
    if isinstance(value, date | Path):
        value = str(value)
    entries = value.tolist() if isinstance(value, np.ndarray) else value
    entries = list(entries) if isinstance(entries, list | tuple) else [entries]
    if entries and all(isinstance(entry, str) and _is_storable(entry) for entry in entries):
        return entries[0] if len(entries) == 1 else entries
    numbers = np.asarray(entries if all(map(np.isscalar, entries)) else None)
    if numbers.size and numbers.dtype.kind in "biuf":
        numbers = numbers.astype(int) if numbers.dtype.kind == "b" else numbers
        return numbers[0].item() if len(entries) == 1 else numbers
    raise TypeError(
        f"the attribute {shown(name)}{place} is {shown(value)}, which a netCDF file cannot hold: "
        "make it text, a number or a list of one of them"
    )
