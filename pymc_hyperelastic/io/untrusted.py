"""Refuse netCDF files that would read other files, or that have no end."""

import io
import re
import struct
from collections.abc import Iterator

import h5py

from pymc_hyperelastic.messages import shown

# Bytes in memory for each byte of the file; zlib cannot compress further than this.
_LARGEST_RATIO = 1100
# Number, count and size before each object of a heap of HDF5.
_HEAP_HEADER = struct.Struct("<HH4xQ")


def check_self_contained(content: bytes) -> None:
    """Raise ValueError for an HDF5 file that points to other files, or to groups in a circle.

    HDF5 follows external links, external storage and virtual datasets to any file that the reader
    of the result may read.
    """
    if not content:
        raise ValueError("it is empty")
    _check_heaps(content)
    declared = 0
    with h5py.File(io.BytesIO(content), "r") as root:
        for count, (name, entry) in enumerate(_entries(root, "", {_identity(root)})):
            # A cohort's parts have tens, a fit of many classes some hundreds. To open many more
            # takes hours.
            if count >= 20_000:
                raise ValueError("it holds more than 20000 groups and variables")
            if isinstance(entry, h5py.Dataset):
                if entry.external is not None or entry.is_virtual:
                    raise ValueError(f"its variable {shown(name)} points to another file")
                _check_dimensions(name, entry)
                declared += entry.size * entry.dtype.itemsize if entry.size else 0
        if declared > _LARGEST_RATIO * len(content):
            raise ValueError(f"its variables would take {declared / 1e9:.3g} GB of memory")


def _check_heaps(content: bytes) -> None:
    """Raise ValueError for a heap of texts or lists that HDF5 2.0 would never finish reading.

    A heap is a row of objects, each with a number, a size and its bytes; number 0 is the free space
    at its end. HDF5 does not go on from an object that takes no bytes.
    """
    for heap in re.finditer(rb"GCOL\x01\0{3}(.{8})", content, re.DOTALL):
        place, end = heap.end(), heap.start() + int.from_bytes(heap[1], "little")
        while place + _HEAP_HEADER.size <= min(end, len(content)):
            number, _, size = _HEAP_HEADER.unpack_from(content, place)
            if number:
                size = (_HEAP_HEADER.size + size + -size % 8) % 2**64
            if not size:
                raise ValueError(f"its heap at byte {heap.start()} has an object without a size")
            place += size


def _check_dimensions(name: str, variable: h5py.Dataset) -> None:
    """Raise ValueError for lists of dimensions of another type or shape.

    HDF5 2.0 reads these lists into memory of the size that they should have, and ends the process.
    """
    sound = True
    if "DIMENSION_LIST" in variable.attrs:
        found = variable.attrs.get_id("DIMENSION_LIST")
        of = h5py.check_vlen_dtype(found.dtype)
        sound = found.shape == (variable.ndim,) and of is not None and of == h5py.ref_dtype
    if "REFERENCE_LIST" in variable.attrs:
        found = variable.attrs.get_id("REFERENCE_LIST")
        sound &= len(found.shape or ()) == 1 and found.dtype.names == ("dataset", "dimension")
    if not sound:
        raise ValueError(f"the list of dimensions of its variable {shown(name)} is damaged")


def _entries(
    group: h5py.Group, place: str, seen: set[object]
) -> Iterator[tuple[str, h5py.Group | h5py.Dataset]]:
    """Groups and variables below a group, each once."""
    for name in group:
        path = f"{place}/{name}"
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            raise ValueError(f"{shown(path)} is a link, which may lead to another file")
        entry = group[name]
        if isinstance(entry, h5py.Group):
            if _identity(entry) in seen:
                raise ValueError(f"its group {shown(path)} is also another one")
            # A result has a class in a group, and in it groups of draws: two levels.
            if path.count("/") > 10:
                raise ValueError(f"its group {shown(path)} is deeper than 10 levels")
            seen.add(_identity(entry))
        yield path, entry
        if isinstance(entry, h5py.Group):
            yield from _entries(entry, path, seen)


def _identity(group: h5py.Group) -> object:
    """Return what two names of one group have in common: its file and address."""
    info = h5py.h5o.get_info(group.id)
    return info.fileno, info.addr
