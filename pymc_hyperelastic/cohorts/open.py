"""Open the results of a store, and read each part when it is needed."""

import warnings
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.core import indexing

from pymc_hyperelastic.cohorts.run import UNITS, Batch, parts_of
from pymc_hyperelastic.cohorts.work import filled
from pymc_hyperelastic.io.results import open_table
from pymc_hyperelastic.io.store import check_store, hash_of, manifest_of
from pymc_hyperelastic.messages import PACKAGE

# Least number of parts that stay in memory after reading, so that reading all variables one by one
# reads each part once. Not tuned.
_KEPT = 16
# Bytes: more parts stay in memory while they take less. Half a gigabyte is little for a computer
# that fits cohorts.
_KEPT_BYTES = 2**29
# Attribute that says of which group of the result a variable is.
GROUP = "group_of_result"


def open_cohort(store: str | Path) -> xr.DataTree | xr.Dataset:
    """Open what :func:`fit_cohort` or :func:`classify_cohort` has computed so far.

    Nothing but the labels is read before it is asked for; then whole parts are, each of which is
    compared with its checksum. To have all of it in one place, write it: ``to_netcdf(path)``, or
    ``to_zarr(path)``.

    Parameters
    ----------
    store : str or Path
        The folder.

    Returns
    -------
    xarray.DataTree or xarray.Dataset
        Of :func:`fit_cohort` a tree with the groups ``posterior``, ``evidence`` and perhaps
        ``properties``, of :func:`classify_cohort` the result of
        :func:`~pymc_hyperelastic.classify`, all with the dimension ``specimen``, or ``test``. What
        failed is NaN and has a message in ``error``; what is not computed yet is NaN too, and its
        message says so. ``doubtful`` says why the fit of a specimen is doubtful, and is empty if it
        is not.

    Raises
    ------
    FileNotFoundError
        If the folder is no store.
    ValueError
        If its manifest, or a part when it is read, is damaged.

    Warns
    -----
    UserWarning
        If not all is computed yet.

    See Also
    --------
    fit_cohort, classify_cohort

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen=["S1", "S2"])
    >>> ph.fit_cohort(
    ...     ph.Ogden(),
    ...     data,
    ...     ph.Gaussian(pressure_sd=0.5),
    ...     "cohort",
    ...     random_seed=1,
    ...     cores=1,
    ...     progressbar=False,
    ... )
    >>> cohort = ph.open_cohort("cohort")
    >>> dict(cohort["posterior"]["mu"].sizes)
    {'chain': 1, 'draw': 500, 'specimen': 2}
    """
    folder = Path(store)
    manifest = manifest_of(folder)
    assert manifest is not None
    by, count = manifest.get("by"), manifest.get("units")
    if by not in ("specimen", "test") or type(count) is not int or count < 1:
        raise ValueError(
            f"the manifest of {folder} says that it holds {count!r} by {by!r}; expected a whole "
            "number by 'specimen' or 'test': it is damaged"
        )
    parts = [Batch(*ends) for ends in parts_of(folder)]
    done = sum(part.last - part.first for part in parts)
    if done < count:
        warnings.warn(
            f"{folder} holds {done} of {count}: the call that made it goes on with the others",
            skip_file_prefixes=(PACKAGE,),
        )
    sizes = [(folder / f"{part.part}.nc").stat().st_size for part in parts[:_KEPT]]
    read = lru_cache(max(_KEPT, _KEPT_BYTES // max(1, *sizes)))(
        partial(_read, folder, hash_of(manifest))
    )
    units = open_table(folder / f"{UNITS}.nc")
    check_store(units, hash_of(manifest), folder / f"{UNITS}.nc")
    template = _template(parts, read)
    variables = {
        name: _lazily(name, variable, by, count, parts, read)
        for name, variable in template.variables.items()
        if name not in units.coords
    }
    result = xr.Dataset(variables, attrs=template.attrs)
    result = result.set_coords([n for n in template.coords if n in variables])
    result = result.assign_coords(units.coords)
    return _in_groups(result) if manifest["work"] == "fit_cohort" else result


def _read(folder: Path, store: str, part: Batch) -> xr.Dataset:
    path = folder / f"{part.part}.nc"
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
        rows = np.atleast_1d(wanted)
        place = np.searchsorted(self._firsts, rows, side="right") - 1
        found = filled(self._like, self._by, len(rows)).values.astype(self.dtype)
        for number in np.unique(place):
            own = place == number
            found[(slice(None),) * self._axis + (own,)] = self._of_part(number, rows[own])
        rest = list(key)
        rest[self._axis] = slice(None) if wanted.ndim else 0
        # One axis after another, from the last, so that none moves before its turn.
        for axis, of_axis in reversed([*enumerate(rest)]):
            found = found[(slice(None),) * axis + (of_axis,)]
        return found

    def _of_part(self, number: int, rows: np.ndarray) -> np.ndarray:
        """Rows that one part has, or would have if it had been computed."""
        part = self._parts[number] if number >= 0 else None
        there = np.zeros(len(rows), bool) if part is None else rows < part.last
        values = filled(self._like, self._by, len(rows)).values.astype(self.dtype)
        if self._name == "error":
            values[...] = "not computed yet"
        if part is not None and there.any():
            known = self._read(part)
            where = (slice(None),) * self._axis
            if self._name in known:
                own = known.variables[self._name].values.astype(self.dtype)
                values[(*where, there)] = own[(*where, rows[there] - part.first)]
            elif self._name != "error":
                values[(*where, there)] = filled(self._like, self._by, int(there.sum())).values
        return values


def _lazily(
    name: Any, like: xr.Variable, by: str, count: int, parts: list[Batch], read: Any
) -> xr.Variable:
    """Return a variable of all units; a variable without units is that of the template."""
    if by not in like.dims:
        return like
    rows = _Rows(name, like, by, count, parts, read)
    return xr.Variable(like.dims, indexing.LazilyIndexedArray(rows), like.attrs)


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
