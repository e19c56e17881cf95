"""A checksum that a result carries, by which it is known again."""

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import xarray as xr

_SEAL = "checksum"
#: Attribute of a part of a store: the hash of its manifest.
STORE = "store"
# When it was made, by which version of ArviZ and for which store, is no part of a result.
_NO_PART = {_SEAL, STORE, "created_at", "creation_library", "creation_library_version"}


class NotAsComputed(ValueError):
    """A result is not what its checksum is of."""


def sealed[Result: (xr.Dataset, xr.DataTree)](result: Result) -> Result:
    """The result with its checksum among its attributes.

    It covers all variables and attributes that there are: what is added later is no part of it.
    """
    groups = _all_of(result)
    result.attrs[_SEAL] = json.dumps({"groups": groups, "sha256": _digest(result, groups)})
    return result


def check_seal(result: xr.Dataset | xr.DataTree, what: str) -> None:
    """Raise ValueError if a result that carries a checksum is not what it was.

    Parameters
    ----------
    result : Dataset or DataTree
        Any result. One without a checksum, of an earlier version, passes.
    what : str
        What to call it, such as ``class 'C1'``.
    """
    if _SEAL not in result.attrs:
        return
    try:
        seal = json.loads(result.attrs[_SEAL])
        intact = _digest(result, seal["groups"]) == seal["sha256"]
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError):
        intact = False
    if not intact:
        raise NotAsComputed(
            f"{what}{source_of(result)} is not what was computed: numbers, settings or groups of "
            "it were changed or damaged since. Compute it again, or take a copy. If you changed it "
            f"on purpose, say so by removing its attribute {_SEAL!r}"
        )


def unsealed(attrs: Mapping[Any, Any]) -> dict[Any, Any]:
    """Attributes without the checksum and the store, for what is made of a result."""
    return {name: value for name, value in attrs.items() if name not in (_SEAL, STORE)}


def digest_of(result: xr.Dataset | xr.DataTree) -> str:
    """SHA-256 of all values, names and attributes of a result, but not of its seal."""
    return _digest(result, _all_of(result))


def digests_of(results: Mapping[str, Any]) -> dict[str, dict[str, str]]:
    """The same of several results, by name, as a manifest says it."""
    return {name: {"sha256": digest_of(result)} for name, result in results.items()}


def _all_of(result: xr.Dataset | xr.DataTree) -> dict[str, list[Any]]:
    """Names of variables and attributes of every group."""
    return {
        path: [sorted(map(str, data.variables)), sorted(set(map(str, data.attrs)) - _NO_PART)]
        for path, data in groups_of(result)
    }


def groups_of(result: xr.Dataset | xr.DataTree) -> Iterator[tuple[str, xr.Dataset]]:
    """Yield the groups of a result, each by its path and with what is in itself."""
    if isinstance(result, xr.Dataset):
        yield ".", result
        return
    for node in result.subtree:
        yield node.relative_to(result), node.to_dataset(inherit=False)


def source_of(result: xr.Dataset | xr.DataTree) -> str:
    """Of which file it was read, if that is known: that stands at the root of a tree alone."""
    encodings = [data.encoding for _, data in groups_of(result)]
    if isinstance(result, xr.DataTree):
        encodings += [node.encoding for node in result.parents]
    sources = {str(known["source"]) for known in encodings if known.get("source")}
    return f" of {sources.pop()}" if len(sources) == 1 else ""


def _digest(result: xr.Dataset | xr.DataTree, groups: Mapping[str, Iterable[Any]]) -> str:
    found, total = dict(groups_of(result)), hashlib.sha256()

    def add(*values: Any) -> None:
        total.update(json.dumps(values, sort_keys=True).encode())

    for path, (variables, attrs) in sorted(groups.items()):
        data = found[path]
        for name in variables:
            variable = data.variables[name]
            add(path, name, variable.dims, variable.shape)
            total.update(_bytes_of(variable.values))
        for name in attrs:
            add(path, name, _plain(data.attrs[name]))
    return total.hexdigest()


def _bytes_of(values: np.ndarray) -> bytes:
    """Values as bytes that a file gives back: text has other types there, and NaN other bits."""
    if values.dtype.kind in "fc":
        values = np.where(np.isnan(values), np.nan, values)
        return np.ascontiguousarray(values, values.dtype.newbyteorder("<")).tobytes()
    if values.dtype.kind in "mM":  # read back in nanoseconds, or not
        values = values.astype(f"{values.dtype.kind}8[ns]").view("i8")
    if values.dtype.kind in "iub":
        return values.astype("<i8").tobytes()
    return json.dumps(values.astype(str).tolist()).encode()


def _plain(value: Any) -> Any:
    """An attribute as JSON has it; files make a number of a list of one."""
    plain = np.asarray(value).tolist() if isinstance(value, np.ndarray | np.generic) else value
    if isinstance(plain, list | tuple):
        return _plain(plain[0]) if len(plain) == 1 else [_plain(entry) for entry in plain]
    return int(plain) if isinstance(plain, bool) else plain
