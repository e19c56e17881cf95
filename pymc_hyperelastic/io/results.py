"""Results as netCDF files."""

import io
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path
from typing import Any

import xarray as xr

from pymc_hyperelastic.evidence.stored import Result
from pymc_hyperelastic.io.atomic import atomic_write
from pymc_hyperelastic.io.checksum import CHECKSUM, digest_of, groups_of
from pymc_hyperelastic.io.storable import storable
from pymc_hyperelastic.io.untrusted import check_self_contained
from pymc_hyperelastic.messages import in_one_line, shown
from pymc_hyperelastic.models.settings import OLDER_VERSION, model_settings_of
from pymc_hyperelastic.parallel import one_thread


class DamagedFile(ValueError):
    """A file is there, and is not what was written."""


@one_thread
def save_result(result: xr.Dataset | xr.DataTree, path: str | Path) -> None:
    """Write a result to a netCDF file, whole or not at all.

    It is written beside the file, which it replaces when all of it is on the disk, with a checksum,
    which :func:`open_result` compares.

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
    # HDF5 itself may end the process when the disk is full, so that it writes to memory.
    with _without_cluster():
        content = _content(storable(result))
    try:
        with atomic_write(path) as beside:
            beside.write_bytes(content)
    except OSError as error:
        failed = type(error)(
            f"{path} cannot be written: {error.strerror or error}. What was there before is left "
            "as it was"
        )
        failed.errno = error.errno
        raise failed from error


def _content(result: Result) -> bytes:
    """Return the file of a result; TypeError names what it would not give back as it was."""
    content, why = _round_trip(result)
    if not why:
        return content
    groups: dict[str, xr.Dataset] = {}
    for path, table in groups_of(result):
        groups["/" if path == "." else f"/{path}"] = table
        place = f" of group {shown([*groups][-1])}" if isinstance(result, xr.DataTree) else ""
        for what, part in _parts(table, place):
            if why_part := _round_trip(part)[1]:
                raise TypeError(f"{what} {why_part}: rename it, remove it or make it text")
        if why_together := _round_trip(xr.DataTree.from_dict(groups))[1]:
            raise TypeError(
                f"the variables{place or ' of the result'} together, and with groups above, "
                f"{why_together}: give each of them a name and dimensions of its own"
            )
    raise TypeError(f"the result {why}")


def _parts(table: xr.Dataset, place: str) -> Iterator[tuple[str, xr.Dataset]]:
    """Yield each variable and each attribute of a group by itself."""
    for name, variable in table.variables.items():
        what = f"the variable {shown(name)}{place}"
        yield what, xr.Dataset({name: (variable.dims, variable.values)})
        for key, value in variable.attrs.items():
            part = xr.Dataset({name: (variable.dims, variable.values, {key: value})})
            yield f"the attribute {shown(key)} of {what}", part
    for key, value in table.attrs.items():
        yield f"the attribute {shown(key)}{place}", xr.Dataset(attrs={key: value})


def _round_trip(result: Result) -> tuple[bytes, str]:
    """Return the file of a result; and what is wrong if it is not read as it was written."""
    tree = result.copy() if isinstance(result, xr.DataTree) else xr.DataTree(result)
    tree.attrs[CHECKSUM] = digest = digest_of(tree)
    try:
        content = bytes(tree.to_netcdf(engine="h5netcdf"))
        again = _in_memory(xr.open_datatree(io.BytesIO(content), engine="h5netcdf"))
        again.name = tree.name
        same = again.identical(tree) and digest_of(again) == digest
    except MemoryError:
        raise
    except Exception as error:  # of every kind, where a file cannot hold something
        return b"", f"cannot be written ({in_one_line(error)})"
    return content, "" if same else "would not be read as it was written"


def _without_cluster() -> AbstractContextManager[Any]:
    """Let xarray take a lock of this process: a lock of a Dask cluster needs the name of a file."""
    if "distributed" not in sys.modules:
        return nullcontext()
    import dask

    return dask.config.set(scheduler="synchronous")


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
    OSError
        If there is no such file, or it cannot be read: no permission, a network disk that fails.
    ValueError
        If it is no netCDF file of a result, cut off or damaged, or was changed since.

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
    return _loaded(path, xr.open_datatree)


def open_table(path: str | Path) -> xr.Dataset:
    """The same of a result that is one Dataset: sooner, since nothing asks for groups."""
    table = _loaded(path, partial(xr.open_dataset, decode_times=False))
    assert isinstance(table, xr.Dataset)
    return table


def _loaded(path: str | Path, opener: Callable[..., Result]) -> Result:
    path = Path(path)
    try:
        # An error of the disk, such as a lack of permission, is raised here, as it is.
        content = path.read_bytes()
    except FileNotFoundError:
        raise FileNotFoundError(f"there is no file {path}") from None
    try:
        check_self_contained(content)
        result = _in_memory(opener(io.BytesIO(content), engine="h5netcdf"))
    except (MemoryError, ImportError):
        raise
    except Exception as error:  # h5py has errors of every kind for files that are cut off
        raise DamagedFile(
            f"{path} is no netCDF file of a result, or it was cut off or damaged: "
            f"{in_one_line(error)}"
        ) from error
    checksum = result.attrs.pop(CHECKSUM, None)
    if isinstance(checksum, str) and checksum.startswith("{"):
        raise ValueError(f"{path} was written in an older format: it needs {OLDER_VERSION}")
    if checksum is not None and checksum != digest_of(result):
        raise DamagedFile(
            f"{path} is not what was written: numbers, settings or groups were changed or damaged "
            f"since, and no longer have the checksum of the file. Take a copy, or compute the "
            f"result again. If it was changed on purpose, remove the attribute {CHECKSUM!r}"
        )
    result.encoding["source"] = str(path)
    if isinstance(result, xr.DataTree):
        for node in result.subtree:
            model_settings_of(node)
    one = isinstance(result, xr.DataTree) and not result.children
    return result.to_dataset() if one else result


def _in_memory[Opened: (xr.DataTree, xr.Dataset)](result: Opened) -> Opened:
    """Read all of a file, and close it. DataTree.load skips variables that a coordinate hides."""
    for _, table in groups_of(result):
        table.load()
    result.close()
    return result
