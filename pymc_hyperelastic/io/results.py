"""Results as netCDF files."""

import io
from collections.abc import Callable
from functools import partial
from pathlib import Path

import xarray as xr

from pymc_hyperelastic.evidence.stored import Result
from pymc_hyperelastic.io.atomic import atomic_write
from pymc_hyperelastic.io.checksum import CHECKSUM, digest_of
from pymc_hyperelastic.io.storable import in_memory, netcdf_bytes
from pymc_hyperelastic.io.untrusted import check_self_contained
from pymc_hyperelastic.messages import in_one_line
from pymc_hyperelastic.models.settings import OLDER_VERSION, model_settings_of
from pymc_hyperelastic.parallel import one_thread


class DamagedFile(ValueError):
    """The content of a file was changed or damaged after it was written."""


@one_thread
def save_result(result: xr.Dataset | xr.DataTree, path: str | Path) -> None:
    """Write a result to a netCDF file, whole or not at all.

    It is written beside the file, which it replaces when all of it is on the disk, with a checksum,
    which :func:`~pymc_hyperelastic.open_result` compares.

    Parameters
    ----------
    result : xarray.DataTree or xarray.Dataset
        Result of a function of this package; it may have further variables.
    path : str or Path
        The file; its folder must be there.

    Raises
    ------
    TypeError
        If it is no DataTree and no Dataset, or has an attribute or a variable that a file would
        not give back as it is; the message names it. Attributes that are True, a dict, a date or a
        path become a number or text.
    OSError
        If it cannot be written: no such folder, no space left, no permission. An
        existing file remains unchanged.

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
    content = netcdf_bytes(result)
    try:
        with atomic_write(path) as beside:
            beside.write_bytes(content)
    except OSError as error:
        failed = type(error)(
            f"{path} cannot be written: {error.strerror or error}. The file that was there before "
            "is left as it was"
        )
        failed.errno = error.errno
        raise failed from error


def open_file(path: str | Path) -> xr.DataTree | xr.Dataset:
    """Read a result from a netCDF file, and compare its checksum.

    Raises
    ------
    OSError
        If there is no such file, or it cannot be read: no permission, a network disk that fails.
    ValueError
        If it is no netCDF file of a result, cut off or damaged, or was changed since.
    """
    return _loaded(path, xr.open_datatree)


def open_table(path: str | Path) -> xr.Dataset:
    """Read a result that is one Dataset; faster than :func:`open_file`."""
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
        result = in_memory(opener(io.BytesIO(content), engine="h5netcdf"))
        has_checksum, checksum = CHECKSUM in result.attrs, result.attrs.pop(CHECKSUM, None)
        digest = digest_of(result) if has_checksum else None
    except (MemoryError, ImportError):
        raise
    except Exception as error:  # h5py has errors of every kind for files that are cut off
        raise DamagedFile(
            f"{path} is no netCDF file of a result, or it was cut off or damaged: "
            f"{in_one_line(error)}"
        ) from error
    if isinstance(checksum, str) and checksum.startswith("{"):
        raise ValueError(f"{path} was written in an older format: it needs {OLDER_VERSION}")
    if has_checksum and not (isinstance(checksum, str) and checksum == digest):
        raise DamagedFile(
            f"{path} is not what was written: numbers, settings or groups do not have the checksum "
            "of the file. Take a copy, or compute the result again. If you changed the file on "
            f"purpose, remove its attribute {CHECKSUM!r}"
        )
    result.encoding["source"] = str(path)
    if isinstance(result, xr.DataTree):
        for node in result.subtree:
            model_settings_of(node)
    one = isinstance(result, xr.DataTree) and not result.children
    return result.to_dataset() if one else result
