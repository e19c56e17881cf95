"""Write a result as the bytes of a netCDF file, or name what a file would not give back."""

import io
import json
import sys
from collections.abc import Hashable
from contextlib import AbstractContextManager, nullcontext
from datetime import date
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import xarray as xr

from pymc_hyperelastic.evidence.stored import Result
from pymc_hyperelastic.io.checksum import CHECKSUM, digest_of, groups_of
from pymc_hyperelastic.messages import in_one_line, shown

# Types of real numbers that every reader of netCDF files knows.
_FLOATS = ("float32", "float64")


def netcdf_bytes(result: Result) -> bytes:
    """Return the netCDF file of a result, with its checksum.

    The file is read again, and compared. TypeError names the group, and the variable or attribute,
    that a file cannot hold or would change. HDF5 writes to memory: it may end the process when a
    disk is full.
    """
    with _without_cluster():
        result = _prepared(result)
        content, why = _round_trip(result)
        if not why:
            return content
        groups: dict[str, xr.Dataset] = {}
        for path, table in groups_of(result):
            groups["/" if path == "." else f"/{path}"] = table
            place = f" of group {shown([*groups][-1])}" if isinstance(result, xr.DataTree) else ""
            for name in table.variables:
                _check_variable(table, name, f"the variable {shown(name)}{place}")
            for key, value in table.attrs.items():
                _check(xr.Dataset(attrs={key: value}), f"the attribute {shown(key)}{place}")
            together = f"the variables{place or ' of the result'} together, and with groups above,"
            _check(xr.DataTree.from_dict(groups), together)
        raise TypeError(f"the result {why}")


def _check_variable(table: xr.Dataset, name: Hashable, what: str) -> None:
    """Raise TypeError if a file would not give back a variable; look for the reason."""
    variable = table.variables[name]
    along = [f"dimension_{i}" for i in range(variable.ndim)]
    if _round_trip(xr.Dataset({"values": (along, variable.values)}))[1]:
        _refuse_type(variable, what)
    for own in (name, *variable.dims):
        if _round_trip(xr.Dataset({own: 1.0}))[1]:
            _refuse_name(what if own is name else f"the dimension {shown(own)} of {what}")
    _check(xr.Dataset({name: (variable.dims, variable.values)}), what)
    for key, value in variable.attrs.items():
        part = xr.Dataset({name: (variable.dims, variable.values, {key: value})})
        _check(part, f"the attribute {shown(key)} of {what}")


def _refuse_type(variable: xr.Variable, what: str) -> NoReturn:
    raise TypeError(
        f"{what} holds {variable.dtype}, which a file does not give back: make it numbers, dates "
        "from 1678 to 2262 or text without special characters, such as by .astype(float) or "
        ".astype(str)"
    )


def _refuse_name(what: str) -> NoReturn:
    raise TypeError(f"{what} cannot be written under this name: rename it, to text without '/'")


def _check(part: Result, what: str) -> None:
    if why := _round_trip(part)[1]:
        raise TypeError(f"{what} {why}: rename it, remove it or make it text")


def _round_trip(result: Result) -> tuple[bytes, str]:
    """Return the file of a result, and the fault if it is not read as it was written."""
    tree = result.copy() if isinstance(result, xr.DataTree) else xr.DataTree(result)
    try:
        tree.attrs[CHECKSUM] = digest = digest_of(tree)
        content = bytes(tree.to_netcdf(engine="h5netcdf"))
        again = in_memory(xr.open_datatree(io.BytesIO(content), engine="h5netcdf"))
        again.name = tree.name
        same = again.identical(tree) and digest_of(again) == digest
    except MemoryError:
        raise
    except Exception as error:  # of every kind, where a file cannot hold something
        return b"", f"cannot be written ({in_one_line(error)})"
    return content, "" if same else "would not be read as it was written"


def in_memory[Opened: (xr.DataTree, xr.Dataset)](result: Opened) -> Opened:
    """Read all of a file, and close it. DataTree.load skips variables that a coordinate hides."""
    for _, table in groups_of(result):
        table.load()
    result.close()
    return result


def _without_cluster() -> AbstractContextManager[Any]:
    """Let xarray take a lock of this process: a lock of a Dask cluster needs the name of a file."""
    if "distributed" not in sys.modules:
        return nullcontext()
    import dask

    return dask.config.set(scheduler="synchronous")


def _prepared[Stored: (xr.Dataset, xr.DataTree)](result: Stored) -> Stored:
    """Return a copy whose attributes are plain; TypeError for names and types that no file has.

    The `encoding` that xarray keeps of an earlier file, such as a smaller type, is removed: it
    would round the numbers.
    """
    result = result.copy()
    for table in result.subtree if isinstance(result, xr.DataTree) else [result]:
        place = f" of group {table.path!r}" if isinstance(table, xr.DataTree) else ""
        table.attrs = {k: _plain(k, v, place) for k, v in table.attrs.items()}
        table.encoding = {}
        for name in table.variables:
            variable: xr.Variable = table.variables[name]
            what = f"the variable {shown(name)}{place}"
            for own in (name, *variable.dims):
                if not isinstance(own, str) or "/" in own:
                    _refuse_name(what if own is name else f"the dimension {shown(own)} of {what}")
            if isinstance(table.xindexes.get(name), xr.indexes.PandasMultiIndex):
                raise TypeError(
                    f"{what} is part of a MultiIndex, which a file cannot hold: unstack it"
                )
            dtype = variable.dtype
            is_text = dtype == np.dtype("O") and all(
                isinstance(x, str) for x in variable.values.flat
            )
            known = isinstance(dtype, np.dtype) and (dtype in _FLOATS or dtype.kind in "biuUmM")
            if not (is_text or known):
                _refuse_type(variable, what)
            variable.attrs = {k: _plain(k, v, f" of {what}") for k, v in variable.attrs.items()}
            # NaN marks missing values; no other number is needed.
            variable.encoding = {"_FillValue": None} if dtype.kind == "f" else {}
    return result


def _plain(name: Hashable, value: Any, place: str) -> Any:
    """Return an attribute as text, a number or a list of numbers or texts."""
    if isinstance(value, dict):
        try:
            value = json.dumps(value)
        except (TypeError, ValueError, RecursionError):
            pass
    if isinstance(value, date | Path):
        value = str(value)
    entries = value.tolist() if isinstance(value, np.ndarray) else value
    entries = list(entries) if isinstance(entries, list | tuple) else [entries]
    if entries and all(isinstance(entry, str) for entry in entries):
        return entries[0] if len(entries) == 1 else entries
    numbers = np.asarray(entries if all(map(np.isscalar, entries)) else None)
    if numbers.size and numbers.dtype.kind in "biuf":
        numbers = numbers.astype(int) if numbers.dtype.kind == "b" else numbers
        return numbers[0].item() if len(entries) == 1 else numbers
    raise TypeError(
        f"the attribute {shown(name)}{place} is {shown(value)}, which a netCDF file cannot hold: "
        "make it text, a number or a list of one of them"
    )
