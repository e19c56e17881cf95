"""Open a result: a file, or a store, of which each part is read when it is needed."""

import warnings
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.core import indexing

from pymc_hyperelastic.io.batches import UNITS, filled, name_of_part, parts_of
from pymc_hyperelastic.io.results import open_file, open_table
from pymc_hyperelastic.io.store import Store, check_store, hash_of, manifest_of
from pymc_hyperelastic.messages import PACKAGE
from pymc_hyperelastic.parallel.run import Batch

# Bytes of the parts that stay in memory after reading, so that reading all variables one by one
# reads each part once. Half a gigabyte is little for a computer that fits many specimens.
_KEPT_BYTES = 2**29
# Attribute that says of which group of the result a variable is.
GROUP = "group_of_result"


def open_result(path: str | Path | Store) -> xr.DataTree | xr.Dataset:
    """Open a result: the file of a result, or the folder of a store.

    A file is read into memory. From a store only the labels are read first; a variable is read when
    its numbers are needed, and then the parts that hold them. To have all of a store in one file,
    write the result: ``to_netcdf(path)``, or ``to_zarr(path)``. Each file is compared with its
    checksum when it is read.

    Parameters
    ----------
    path : str, Path or Store
        A file of :func:`save_result`, or of ``to_netcdf`` of a result; or the folder of
        :func:`fit_cohort` or :func:`classify`.

    Returns
    -------
    xarray.DataTree or xarray.Dataset
        The result that was saved, or the results that the store holds so far.

        A store of :func:`fit_cohort` gives a tree with the groups ``posterior``, ``evidence`` and
        perhaps ``properties``, a store of :func:`classify` gives its Dataset. Both have the
        dimension ``specimen`` or ``test``. Specimens that failed are NaN, with a message in
        ``error``; specimens that are not computed yet are NaN too, and their message says so.
        ``doubtful`` says why the fit of a specimen is doubtful, and is empty if it is not.

    Raises
    ------
    OSError
        If there is no such file, the folder is no store, or the file cannot be read: no permission,
        a network disk that fails.
    ValueError
        If the file is no netCDF file of a result, cut off or damaged, or was changed since; if a
        part of a store is so when it is read, or its manifest; if a store holds parts of a
        computation that :func:`fit_cohort` and :func:`classify` did not make.

    Warns
    -----
    UserWarning
        If a store does not hold all results yet.

    See Also
    --------
    save_result, fit_cohort, classify

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> ph.save_result(data, "aorta.nc")
    >>> ph.open_result("aorta.nc").sizes["test"]
    15
    >>> settings = {"random_seed": 1, "progressbar": False}
    >>> store = ph.Store("cohort", cores=1)
    >>> some = ph.select(data, specimen=["S1", "S2"])
    >>> _ = ph.fit_cohort(ph.Ogden(), some, ph.Gaussian(pressure_sd=0.5), store, **settings)
    >>> dict(ph.open_result("cohort")["posterior"]["mu"].sizes)
    {'chain': 1, 'draw': 500, 'specimen': 2}
    """
    path = Path(path)
    return _open_store(path) if path.is_dir() else open_file(path)


def _open_store(folder: Path) -> xr.DataTree | xr.Dataset:
    """Return the results that a store holds, read when they are needed."""
    manifest = manifest_of(folder)
    assert manifest is not None
    if "units" not in manifest:
        raise ValueError(
            f"the store {folder} holds parts of a computation, and no result: the call that made "
            "it returns the result, and computes no finished part again"
        )
    by, count = manifest.get("by"), manifest["units"]
    if by not in ("specimen", "test") or type(count) is not int or count < 1:
        raise ValueError(
            f"the manifest of {folder} says that it holds {count!r} by {by!r}; expected a whole "
            "number by 'specimen' or 'test': it is damaged"
        )
    parts = [Batch(*ends) for ends in parts_of(folder)]
    done = sum(part.size for part in parts)
    if done < count:
        warnings.warn(
            f"{folder} holds {done} of {count}: the call that made it goes on with the others",
            skip_file_prefixes=(PACKAGE,),
        )
    largest = max((_file(folder, part).stat().st_size for part in parts), default=1)
    kept = max(1, _KEPT_BYTES // largest)
    read = lru_cache(kept)(partial(_read, folder, hash_of(manifest)))
    units = open_table(folder / f"{UNITS}.nc")
    check_store(units, hash_of(manifest), folder / f"{UNITS}.nc")
    template = _template(parts, read)
    # A variable without units is that of the template.
    variables = {
        name: xr.Variable(
            like.dims,
            indexing.LazilyIndexedArray(_Rows(name, like, by, count, parts, read)),
            like.attrs,
        )
        if by in like.dims
        else like
        for name, like in template.variables.items()
        if name not in units.coords
    }
    result = xr.Dataset(variables, attrs=template.attrs)
    result = result.set_coords([n for n in template.coords if n in variables])
    result = result.assign_coords(units.coords)
    return _in_groups(result) if manifest["work"] == "fit_cohort" else result


def _file(folder: Path, part: Batch) -> Path:
    return folder / f"{name_of_part(part.first, part.last)}.nc"


def _read(folder: Path, store: str, part: Batch) -> xr.Dataset:
    path = _file(folder, part)
    table = open_table(path)
    check_store(table, store, path)
    return table


def _template(parts: list[Batch], read: Any) -> xr.Dataset:
    """A part that has all variables: one in which not everything failed."""
    found = xr.Dataset()
    for part in parts:
        own = read(part)
        if len(own.variables) > len(found.variables):
            found = own
        if len(found.variables) > len(own.coords) + 1:
            break
    return found


class _Rows(BackendArray):
    """A variable of all units, each row of which is in some part."""

    def __init__(
        self, name: Any, like: xr.Variable, by: str, count: int, parts: list[Batch], read: Any
    ) -> None:
        self._name, self._like, self._axis = name, like, like.dims.index(by)
        self._by, self._read = by, read
        self._parts = parts
        self._firsts = np.array([part.first for part in parts])
        self.shape = tuple(count if d == by else n for d, n in like.sizes.items())
        self.dtype = np.dtype(object) if like.dtype.kind in "OUST" else like.dtype

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(
            key, self.shape, indexing.IndexingSupport.OUTER, self._rows
        )

    def _rows(self, key: tuple[Any, ...]) -> np.ndarray:
        wanted = np.arange(self.shape[self._axis])[key[self._axis]]
        rows, before = np.atleast_1d(wanted), (slice(None),) * self._axis
        found = filled(self._like, self._by, len(rows)).values.astype(self.dtype)
        if self._name == "error":
            found[...] = "not computed yet"
        place = np.searchsorted(self._firsts, rows, side="right") - 1
        for number in np.unique(place[place >= 0]):
            part = self._parts[number]
            here = (place == number) & (rows < part.last)
            # A part in which everything failed has errors only.
            if here.any() and self._name in (table := self._read(part)).variables:
                own = table.variables[self._name].values.astype(self.dtype)
                found[(*before, here)] = own[(*before, rows[here] - part.first)]
        rest = list(key)
        rest[self._axis] = slice(None) if wanted.ndim else 0
        # One axis after another, from the last, so that none moves before its turn.
        for axis, of_axis in reversed([*enumerate(rest)]):
            found = found[(slice(None),) * axis + (of_axis,)]
        return found


def _in_groups(result: xr.Dataset) -> xr.DataTree:
    """The result by the groups of which its variables say that they are."""
    groups: dict[str, list[Any]] = {"posterior": [], "evidence": []}
    for name, variable in result.data_vars.items():
        groups.setdefault(variable.attrs.get(GROUP, "evidence"), []).append(name)
    attrs = result.attrs
    result = result.drop_attrs(deep=False)
    tree = xr.DataTree.from_dict({group: result[names] for group, names in groups.items()})
    tree.attrs = attrs
    return tree
