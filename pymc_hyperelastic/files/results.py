"""Results as netCDF files."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import xarray as xr

from pymc_hyperelastic.files.seal import check_seal, sealed
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
        If it is no DataTree and no Dataset.
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
    result = sealed(result.copy())
    for table in result.subtree if isinstance(result, xr.DataTree) else [result]:
        for variable in table.variables.values():
            if variable.dtype.kind == "f":  # NaN is what is missing, and needs no other number
                variable.encoding = {"_FillValue": None}
    try:
        with written_whole(path) as beside:
            result.to_netcdf(beside, engine="h5netcdf")
    except OSError as error:
        raise type(error)(
            f"{path} cannot be written: {error.strerror or error}. What was there before is left "
            "as it was"
        ) from error


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
        result = opener(path, engine="h5netcdf").load()
        result.close()
    except Exception as error:  # h5py has errors of every kind for files that are cut off
        raise ValueError(
            f"{path} is no netCDF file of a result, or it was cut off or damaged: {error}"
        ) from error
    return result
