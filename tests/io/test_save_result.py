"""Saved results: unchanged after opening, complete or absent, and verified by a checksum."""

import errno
import os
import random
import re
import subprocess
import sys
from datetime import date
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
import xarray as xr

import pymc_hyperelastic as ph
from pymc_hyperelastic.io.atomic import atomic_write
from pymc_hyperelastic.io.checksum import digest_of

# Bytes that are damaged, one at a time, and the seed that chooses them.
DAMAGED_BYTES = 25
SEED = 3


def every_type() -> xr.Dataset:
    """Return numbers, text, booleans, NaN and attributes of every type that a result may hold."""
    return xr.Dataset(
        {
            "real": ("x", [1.5, np.nan, -0.0]),
            "integer": ("x", [1, 2, 3]),
            "short": ("x", np.array([1, 2, 3], "float32")),
            "flag": ("x", [True, False, True]),
            "text": ("x", ["a", "", "µ<b>"]),
            "scalar": 3.0,
            "empty": ("none", np.empty(0)),
        },
        {"x": ["S1", "S2", "S3"], "group": ("x", ["A", "A", "B"])},
        {"one": [1], "two": [1, 2], "text": "ü", "flag": 1, "real": np.float64(0.1)},
    )


def every_group() -> xr.DataTree:
    inner = every_type()
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs={"a": "b"}), "C1/p": inner, "C2": inner})


@pytest.mark.parametrize("make", [every_type, every_group])
def test_result_is_unchanged_after_saving_and_opening(make, tmp_path):
    result = make()
    ph.save_result(result, tmp_path / "result.nc")
    again = ph.open_result(tmp_path / "result.nc")
    assert type(again) is type(result)
    assert again.equals(result)
    assert digest_of(again) == digest_of(result)
    assert "checksum" not in again.attrs and "checksum" not in result.attrs
    assert os.listdir(tmp_path) == ["result.nc"]


def test_checksum_differs_after_every_kind_of_change():
    result = every_type()
    number, text = result.copy(deep=True), result.copy(deep=True)
    number["real"].values[0] = np.nextafter(1.5, 2)
    text["text"].values[0] = "b"
    changes = [
        number,
        text,
        result.assign(flag=~result["flag"]),
        result.assign_attrs(text="u"),
        result.drop_vars("integer"),
        result.rename_vars(integer="number"),
        result.isel(x=[1, 0, 2]),
        result.assign_coords(x=["S1", "S2", "S4"]),
        result.drop_attrs(),
        xr.DataTree.from_dict({"C1": result}),
    ]
    assert len({digest_of(changed) for changed in [result, *changes]}) == 1 + len(changes)
    assert digest_of(result.assign_attrs(created_at="today")) == digest_of(result)


def test_file_changed_after_saving_is_refused_by_its_checksum(tmp_path):
    path = tmp_path / "result.nc"
    for change in (
        lambda file: file["C1/p/real"].__setitem__(0, 1.25),
        lambda file: file["C1/p"].attrs.__setitem__("text", "u"),
        lambda file: file.attrs.__setitem__("more", "u"),
        lambda file: file.move("C1", "C3"),
        lambda file: file.attrs.__setitem__("checksum", "0"),
        lambda file: file.attrs.__setitem__("checksum", "[" * 60_000),
        lambda file: file.attrs.__setitem__("checksum", h5py.Empty("f8")),
        lambda file: file.attrs.__setitem__("checksum", np.arange(3)),
    ):
        ph.save_result(every_group(), path)
        with h5py.File(path, "a") as file:
            change(file)
        with pytest.raises(ValueError, match=r"result\.nc is not what was written"):
            ph.open_result(path)


def test_opened_result_can_be_changed_and_saved_again(tmp_path):
    path = tmp_path / "result.nc"
    ph.save_result(every_group(), path)
    tree = ph.open_result(path)
    tree["more"] = xr.Dataset({"y": 1.0})
    ph.save_result(tree, path)
    assert ph.open_result(path)["more/y"].item() == 1.0
    tree["more"] = xr.Dataset({"y": 2.0})
    tree.to_netcdf(path, engine="h5netcdf")
    assert ph.open_result(path)["more/y"].item() == 2.0


def test_file_of_an_older_format_is_refused_with_the_version_it_needs(tmp_path):
    old = every_type().assign_attrs(checksum='{"groups": {}, "sha256": "0"}')
    old.to_netcdf(tmp_path / "old.nc", engine="h5netcdf")
    with pytest.raises(ValueError, match=r"old\.nc was written in an older format: it needs py"):
        ph.open_result(tmp_path / "old.nc")


def unreadable(error):
    def read_bytes(path):
        raise error

    return read_bytes


ERRORS_OF_THE_DISK = {
    "permission": PermissionError(errno.EACCES, "Permission denied", "result.nc"),
    "network disk": OSError(errno.ESTALE, "Stale file handle", "result.nc"),
    "memory": MemoryError("no memory"),
}


@pytest.mark.parametrize("error", ERRORS_OF_THE_DISK.values(), ids=ERRORS_OF_THE_DISK)
def test_error_of_the_disk_is_raised_unchanged(error, tmp_path, monkeypatch):
    """The file may be intact, so that the error must not call it damaged."""
    ph.save_result(every_type(), tmp_path / "result.nc")
    monkeypatch.setattr(Path, "read_bytes", unreadable(error))
    with pytest.raises(type(error)) as raised:
        ph.open_result(tmp_path / "result.nc")
    assert raised.value is error


def test_memory_error_while_reading_is_raised_unchanged(tmp_path, monkeypatch):
    ph.save_result(every_type(), tmp_path / "result.nc")

    def load(*_):
        raise MemoryError("no memory")

    monkeypatch.setattr(xr.Dataset, "load", load)
    with pytest.raises(MemoryError, match="no memory"):
        ph.open_result(tmp_path / "result.nc")


def test_file_without_a_checksum_is_opened(tmp_path):
    every_type().to_netcdf(tmp_path / "plain.nc", engine="h5netcdf")
    assert ph.open_result(tmp_path / "plain.nc").equals(every_type())


# h5netcdf cannot close a file that it could not open, and warns where no test can catch it.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_damaged_file_is_refused_with_its_name(tmp_path):
    """After a flip of any bit the numbers are the same, or an error names the file."""
    path = tmp_path / "result.nc"
    ph.save_result(every_group(), path)
    intact, rng = path.read_bytes(), random.Random(SEED)
    noticed = 0
    for _ in range(DAMAGED_BYTES):
        damaged = bytearray(intact)
        damaged[rng.randrange(len(intact))] ^= 1 << rng.randrange(8)
        path.write_bytes(damaged)
        try:
            assert ph.open_result(path).equals(every_group())
        except ValueError as error:
            noticed += 1
            assert str(path) in str(error)
    assert noticed > DAMAGED_BYTES / 4
    for share in (0.0, 0.3, 0.999):
        path.write_bytes(intact[: int(share * len(intact))])
        with pytest.raises(ValueError, match=r"result.nc is no netCDF file of a result"):
            ph.open_result(path)


def test_refused_file_is_closed(tmp_path):
    path = tmp_path / "result.nc"
    ph.save_result(every_type(), path)
    with h5py.File(path, "a") as file:
        file["real"].attrs["units"] = "days since noon"
    with pytest.raises(ValueError, match="days since noon"):
        ph.open_result(path)
    with h5py.File(path, "a") as file:
        assert "real" in file


def heap(path: Path, size: int) -> None:
    """State the size of the free space in the heap of texts of an HDF5 file."""
    content = bytearray(path.read_bytes())
    place = content.index(b"GCOL") + 16
    while int.from_bytes(content[place : place + 2], "little"):
        place += 16 + -(-int.from_bytes(content[place + 8 : place + 16], "little") // 8) * 8
    content[place + 8 : place + 16] = size.to_bytes(8, "little")
    path.write_bytes(content)


def test_file_that_hdf5_would_read_endlessly_is_refused(tmp_path):
    path = tmp_path / "result.nc"
    ph.save_result(every_type(), path)
    heap(path, 0)
    with pytest.raises(ValueError, match=r"its heap at byte .* has an object without a size"):
        ph.open_result(path)


def test_wrong_types_and_paths_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"there is no file .*nothing"):
        ph.open_result(tmp_path / "nothing")
    with pytest.raises(TypeError, match=r"a result is a DataTree or a Dataset, not dict"):
        ph.save_result({}, tmp_path / "result.nc")
    with pytest.raises(OSError, match=r"result.nc cannot be written: .*left as it was"):
        ph.save_result(every_type(), tmp_path / "no folder" / "result.nc")


def test_interrupted_write_leaves_the_old_file_unchanged(tmp_path):
    path = tmp_path / "file"
    path.write_text("before")
    with pytest.raises(KeyboardInterrupt), atomic_write(path) as beside:
        beside.write_text("half")
        raise KeyboardInterrupt
    assert path.read_text() == "before"
    assert os.listdir(tmp_path) == ["file"]


KILLED = """
import os, signal, sys
from pathlib import Path
from pymc_hyperelastic.io.atomic import atomic_write
with atomic_write(Path(sys.argv[1])) as beside:
    beside.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_next_writer_removes_the_unfinished_file_of_a_killed_writer(tmp_path):
    pytest.importorskip("fcntl", reason="only Unix has locks of files")
    for name in ("one", "other"):
        subprocess.run([sys.executable, "-c", KILLED, str(tmp_path / name)], check=False)
    assert len(os.listdir(tmp_path)) == 2
    with atomic_write(tmp_path / "one") as beside:
        beside.write_text("all")
        with atomic_write(tmp_path / "one") as again:  # the first writer lives
            again.write_text("all of another")
    assert (tmp_path / "one").read_text() == "all"
    (left,) = {*os.listdir(tmp_path)} - {"one"}
    assert left.endswith(".unfinished") and (tmp_path / left).read_text() == "half"


def test_attributes_are_stored_as_text_or_numbers_or_refused_by_name(tmp_path):
    result = every_group()
    settings = {"yes": True, "settings": {"a": [1]}, "day": date(2024, 5, 1), "file": Path("x")}
    result["C2"].attrs |= settings
    ph.save_result(result, tmp_path / "result.nc")
    found = ph.open_result(tmp_path / "result.nc")["C2"].attrs
    assert [found[name] for name in settings] == [1, '{"a": [1]}', "2024-05-01", "x"]
    for value in (None, 10**30, (1, "a"), [[1], [2, 3]], [], b"a", {"a": object()}):
        result["C2"].attrs["note"] = value
        with pytest.raises(TypeError, match=r"attribute 'note' of group '/C2'"):
            ph.save_result(result, tmp_path / "other.nc")
    assert os.listdir(tmp_path) == ["result.nc"]


UNSTORABLE = {
    "None": (np.array(["a", None], object), "the variable 'odd' of group '/C2' holds object, wh"),
    "NaN in text": (
        np.array(["a", np.nan], object),
        "'odd' of group '/C2' holds object, which a f",
    ),
    "integers": (np.array([1, 2], object), "the variable 'odd' of group '/C2' holds object, which"),
    "complex": (np.array([1j, 2]), "the variable 'odd' of group '/C2' holds complex128, which"),
    "year": (np.array(["0001-01-01"] * 2, "datetime64[D]"), "'odd' of group '/C2' .* 1678 to 2262"),
    "category": (pd.Categorical(["a", "b"]), "the variable 'odd' of group '/C2' holds category"),
    "units": (
        xr.Variable("k", [1.0, 2.0], {"units": "days since 2020-01-01"}),
        "the attribute 'units' of the variable 'odd' of group '/C2' would not be read as it was",
    ),
    "factor": (
        xr.Variable("k", [1.0, 2.0], {"scale_factor": 2.0}),
        "the attribute 'scale_factor' of the variable 'odd' of group '/C2' would not be read",
    ),
    "fill value": (
        xr.Variable("k", [1.0, 2.0], {"_FillValue": 0.0}),
        "the attribute '_FillValue' of the variable 'odd' of group '/C2' would not be read",
    ),
}


@pytest.mark.parametrize("values, message", UNSTORABLE.values(), ids=UNSTORABLE)
def test_values_that_a_file_would_change_are_refused_by_name(values, message, tmp_path):
    result = every_group()
    changed = values if isinstance(values, xr.Variable) else ("k", values)
    result["C2"] = xr.DataTree(every_type().assign(odd=changed))
    with pytest.raises(TypeError, match=message):
        ph.save_result(result, tmp_path / "result.nc")
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("name", ["a/b", "", 3, "a\0b", "\ud800"])
def test_variable_with_a_name_that_a_file_cannot_hold_is_refused(name, tmp_path):
    with pytest.raises(
        TypeError, match=re.escape(f"the variable {name!r} cannot be written under")
    ):
        ph.save_result(xr.Dataset({name: 1.0}), tmp_path / "result.nc")


def test_multiindex_is_refused(tmp_path):
    stacked = xr.Dataset({"x": (("a", "b"), np.eye(2))}, {"a": [1, 2], "b": [1, 2]}).stack(
        s=["a", "b"]
    )
    with pytest.raises(TypeError, match=r"'s' is part of a MultiIndex, .*: unstack it"):
        ph.save_result(stacked, tmp_path / "result.nc")


def test_earlier_encoding_of_a_variable_does_not_round_its_values(tmp_path):
    result = xr.Dataset({"x": ("k", [0.123, 4.567])})
    result["x"].encoding = {"dtype": "i2", "scale_factor": 0.1}
    ph.save_result(result, tmp_path / "result.nc")
    assert ph.open_result(tmp_path / "result.nc").equals(result)


@pytest.mark.parametrize("room", [1, 4096, 20_000])
def test_full_disk_raises_an_error_and_leaves_the_old_file_unchanged(room, tmp_path):
    """A limit on the size of files stops a write in the middle, as a full disk does."""
    resource = pytest.importorskip("resource", reason="only Unix limits the size of files")
    path = tmp_path / "result.nc"
    ph.save_result(every_type(), path)
    before = path.read_bytes()
    large = xr.Dataset({"x": ("draw", np.random.default_rng(SEED).normal(size=10_000))})
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, limits[1]))
    try:
        with pytest.raises(
            OSError, match=r"result.nc cannot be written: .*left as it was"
        ) as raised:
            ph.save_result(large, path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert raised.value.errno == errno.EFBIG
    assert os.listdir(tmp_path) == ["result.nc"] and path.read_bytes() == before


def test_dates_are_unchanged_after_saving_and_opening(tmp_path):
    day = np.array(["2024-05-01T10:00", "2024-05-02T11:30"], "datetime64[s]")
    ph.save_result(xr.Dataset({"day": ("test", day)}), tmp_path / "result.nc")
    np.testing.assert_array_equal(ph.open_result(tmp_path / "result.nc")["day"], day)


def external_storage(file, folder):
    (folder / "private").write_bytes(bytes(24))
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plist.set_external(str(folder / "private").encode(), 0, 24)
    space = h5py.h5s.create_simple((3,))
    h5py.h5d.create(file.id, b"odd", h5py.h5t.NATIVE_DOUBLE, space, plist)


def virtual(file, folder):
    layout = h5py.VirtualLayout((3,), "f8")
    layout[:] = h5py.VirtualSource(str(folder / "other.nc"), "real", (3,))
    file.create_virtual_dataset("odd", layout)


def dimension_list(file, folder):
    """Replace a list that HDF5 reads into memory of the size it should have."""
    del file["C2/real"].attrs["DIMENSION_LIST"]
    file["C2/real"].attrs["DIMENSION_LIST"] = np.zeros((2, 2))


UNTRUSTED = {
    "list of dimensions": dimension_list,
    "external link": lambda f, at: f.__setitem__("odd", h5py.ExternalLink(str(at / "a.nc"), "/x")),
    "soft link": lambda f, at: f.__setitem__("odd", h5py.SoftLink("/real")),
    "external storage": external_storage,
    "virtual dataset": virtual,
    "cycle": lambda f, at: f["C1"].__setitem__("odd", f["/"]),
    "deep": lambda f, at: f.create_group("/".join(["odd"] * 30)),
    "large": lambda f, at: f.create_dataset("odd", (10**12,), "f8", chunks=(1000,)),
}


@pytest.mark.parametrize("change", UNTRUSTED.values(), ids=UNTRUSTED)
def test_file_with_links_cycles_or_excessive_size_is_refused(change, tmp_path):
    path = tmp_path / "result.nc"
    ph.save_result(every_group(), path)
    with h5py.File(path, "a") as file:
        change(file, tmp_path)
    message = (
        "list of dimensions|another file|also another one|deeper than 10|would take .* GB of memory"
    )
    with pytest.raises(ValueError, match=message):
        ph.open_result(path)
