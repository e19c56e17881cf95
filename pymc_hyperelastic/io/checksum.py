"""SHA-256 of what a result holds: a file carries it, and manifests name data and classes by it."""

import hashlib
import json
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import xarray as xr

#: Attribute of a file: the checksum of everything else in the file.
CHECKSUM = "checksum"
# ArviZ writes the time and its version, which are different each time the same result is computed.
_IGNORED = {CHECKSUM, "created_at", "creation_library", "creation_library_version"}


def digest_of(result: xr.Dataset | xr.DataTree) -> str:
    """Return the SHA-256 of all values, names and attributes of groups of a result."""
    total = hashlib.sha256()

    def add(*values: Any) -> None:
        total.update(json.dumps(values, sort_keys=True).encode())

    for path, data in sorted(groups_of(result), key=lambda group: group[0]):
        add(path)
        for name, variable in sorted(data.variables.items(), key=lambda item: str(item[0])):
            add(str(name), variable.dims, variable.shape)
            total.update(_bytes_of(variable.values))
        add({str(k): _plain(v) for k, v in data.attrs.items() if k not in _IGNORED})
    return total.hexdigest()


def digests_of(results: Mapping[str, Any]) -> dict[str, dict[str, str]]:
    """Return the digests of several results by name, as a manifest holds them."""
    return {name: {"sha256": digest_of(result)} for name, result in results.items()}


def groups_of(result: xr.Dataset | xr.DataTree) -> Iterator[tuple[str, xr.Dataset]]:
    """Yield the path and the own content of each group of a result."""
    if isinstance(result, xr.Dataset):
        yield ".", result
        return
    for node in result.subtree:
        yield node.relative_to(result), node.to_dataset(inherit=False)


def _bytes_of(values: np.ndarray) -> bytes:
    """Return bytes that a file does not change; it changes types of text, and bits of NaN."""
    if values.dtype.kind in "fc":
        values = np.where(np.isnan(values), np.nan, values)
        return np.ascontiguousarray(values, values.dtype.newbyteorder("<")).tobytes()
    if values.dtype.kind in "mM":  # read back in nanoseconds, or not
        values = values.astype(f"{values.dtype.kind}8[ns]").view("i8")
    if values.dtype.kind in "iub":
        return values.astype("<i8").tobytes()
    return json.dumps(values.astype(str).tolist()).encode()


def _plain(value: Any) -> Any:
    """Return an attribute as JSON holds it; a file turns a list of one number into a number."""
    plain = np.asarray(value).tolist() if isinstance(value, np.ndarray | np.generic) else value
    if isinstance(plain, list | tuple):
        return _plain(plain[0]) if len(plain) == 1 else [_plain(entry) for entry in plain]
    return int(plain) if isinstance(plain, bool) else plain
