"""Results as netCDF files."""

import io
import json
from collections.abc import Callable, Hashable
from datetime import date
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.files.seal import check_seal, sealed
from pymc_hyperelastic.files.stored import shown
from pymc_hyperelastic.files.untrusted import check_self_contained
from pymc_hyperelastic.files.whole import written_whole


def save_result(result: xr.Dataset | xr.DataTree, path: str | Path) -> None:
    """Write a result to a netCDF file, whole or not at all.

    It is written beside the file, which it replaces when all of it is on the disk, and carries a
    checksum, which :func:`open_result` and whatever takes results compare.

    Parameters
    ----------
    result : xarray.DataTree or xarray.Dataset
        What a function of this package returned, perhaps with more in it.
    path : str or Path
        The file; its folder must be there.

    Raises
    ------
    TypeError
        If it is no DataTree and no Dataset, or has an attribute or a variable that a file would
        not give back as it is; the message names it. Attributes that are True, a dict, a date or a
        path become a number or text.
    OSError
        If it cannot be written: no such folder, no space left, no permission. What was there
        before is left as it was.

    See Also
    --------
    open_result

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> ph.save_result(data, "aorta.nc")
    >>> ph.open_result("aorta.nc").equals(data)
    True
    """
    if not isinstance(result, xr.Dataset | xr.DataTree):
        raise TypeError(f"a result is a DataTree or a Dataset, not {type(result).__name__}")
    path = Path(path)
    # What was changed on purpose is sealed as it is now.
    content = _content(_writable(result))
    try:
        # HDF5 itself may end the process when the disk is full, so that it writes to memory.
        with written_whole(path) as beside:
            beside.write_bytes(content)
    except OSError as error:
        raise type(error)(
            f"{path} cannot be written: {error.strerror or error}. What was there before is left "
            "as it was"
        ) from error


def _writable[Result: (xr.Dataset, xr.DataTree)](result: Result) -> Result:
    """Return a copy whose attributes a file can hold; TypeError names one that it cannot."""
    result = result.copy()
    for table in result.subtree if isinstance(result, xr.DataTree) else [result]:
        place = _place(table)
        table.attrs = {k: _attribute(k, v, place) for k, v in table.attrs.items()}
        for name, variable in table.variables.items():
            variable.attrs = {
                k: _attribute(k, v, f"variable {name!r}{place}") for k, v in variable.attrs.items()
            }
            if variable.dtype.kind == "f":  # NaN is what is missing, and needs no other number
                variable.encoding = {"_FillValue": None}
    return result


def _place(table: xr.Dataset | xr.DataTree) -> str:
    """Return the group that a table is, as messages name it."""
    return f" of group {table.path!r}" if isinstance(table, xr.DataTree) else ""


def _attribute(name: Hashable, value: Any, place: str) -> Any:
    """Return an attribute as text, a number or an array of one kind of these."""
    if isinstance(value, bool | np.bool_):
        return int(value)
    if isinstance(value, dict):
        try:
            return json.dumps(value)
        except TypeError:
            pass
    if isinstance(value, date | Path):
        return str(value)
    entries = value if isinstance(value, list | tuple) else [value]
    kinds = {np.asarray(entry).dtype.kind for entry in entries}
    plain = np.asarray(value) if len(kinds) == 1 else None
    if plain is None or plain.dtype.kind not in "iufUS" or plain.ndim > 1:
        raise TypeError(
            f"the attribute {name!r}{place} is {shown(value)}, which a netCDF file cannot hold: "
            "make it text, a number or a list of one of them"
        )
    return value


def _content(result: xr.Dataset | xr.DataTree) -> bytes:
    """Return the file of a result; TypeError names a variable that it would change."""
    try:
        content = bytes(sealed(result).to_netcdf(engine="h5netcdf"))
        check_seal(_in_memory(content, xr.open_datatree), "the result")
    except Exception as error:
        for table in result.subtree if isinstance(result, xr.DataTree) else [result]:
            for name in table.variables:
                if why := _why_not_written(table, name):
                    raise TypeError(
                        f"the variable {name!r}{_place(table)} ({table[name].dtype}) {why}: make "
                        "it numbers or text, without attributes that change their meaning"
                    ) from error
        raise
    return content


def _why_not_written(table: xr.Dataset | xr.DataTree, name: Hashable) -> str:
    """Return what is wrong with a variable that a file does not give back as it was."""
    try:
        alone = sealed(xr.Dataset({f"{name}_alone": table[name].variable.to_base_variable()}))
        check_seal(_in_memory(bytes(alone.to_netcdf(engine="h5netcdf")), xr.open_datatree), "it")
    except Exception as error:
        changed = "not what was computed" in str(error)
        return "would not be read as it was written" if changed else f"cannot be written, {error}"
    return ""


def _in_memory(content: bytes, opener: Callable[..., xr.DataTree]) -> xr.DataTree | xr.Dataset:
    tree = opener(io.BytesIO(content), engine="h5netcdf").load()
    tree.close()
    return tree if tree.children else tree.to_dataset()


def open_result(path: str | Path) -> xr.DataTree | xr.Dataset:
    """Read a result from a netCDF file, and check that it is what was written.

    Parameters
    ----------
    path : str or Path
        A file of :func:`save_result`, or of ``to_netcdf`` of a result.

    Returns
    -------
    xarray.DataTree or xarray.Dataset
        All of it, in memory.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If it is no netCDF file, cut off or damaged, or was changed since.

    See Also
    --------
    save_result

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> ph.save_result(ph.load_dataset("simulated_sheep_aorta"), "aorta.nc")
    >>> ph.open_result("aorta.nc").sizes["test"]
    15
    """
    tree = _loaded(path, xr.open_datatree)
    result = tree if tree.children else tree.to_dataset()
    check_seal(result, "the result")
    return result


def open_table(path: str | Path) -> xr.Dataset:
    """The same of a result that is one Dataset: sooner, since nothing asks for groups."""
    result = _loaded(path, partial(xr.open_dataset, decode_times=False))
    check_seal(result, "the result")
    return result


def _loaded[Result: (xr.DataTree, xr.Dataset)](
    path: str | Path, opener: Callable[..., Result]
) -> Result:
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    try:
        check_self_contained(path)
        result = opener(path, engine="h5netcdf").load()
        result.close()
    except Exception as error:  # h5py has errors of every kind for files that are cut off
        raise ValueError(
            f"{path} is no netCDF file of a result, or it was cut off or damaged: {error}"
        ) from error
    return result
