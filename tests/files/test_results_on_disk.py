"""Results on disk are whole or not there, known again by their checksum, and parts are kept."""

import json
import os
import random

import numpy as np
import pytest
import xarray as xr

import pymc_hyperelastic as ph
from pymc_hyperelastic.files.seal import check_seal, digest_of, sealed
from pymc_hyperelastic.files.store import Store
from pymc_hyperelastic.files.whole import written_whole

# Bytes of a file that are damaged, one at a time.
FLIPS = 60
RANDOM_SEED = 3


def every_type() -> xr.Dataset:
    """All that a result may hold: numbers, text, yes and no, NaN, and attributes of every type."""
    return xr.Dataset(
        {
            "real": ("x", [1.5, np.nan, -0.0]),
            "whole": ("x", [1, 2, 3]),
            "short": ("x", np.array([1, 2, 3], "float32")),
            "yes": ("x", [True, False, True]),
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
def test_result_comes_back_as_it_was_written(make, tmp_path):
    """Values, names and the checksum are the same after a file."""
    result = make()
    ph.save_result(result, tmp_path / "result.nc")
    again = ph.open_result(tmp_path / "result.nc")
    assert again.equals(result)
    assert digest_of(again) == digest_of(result)
    assert [path.name for path in tmp_path.iterdir()] == ["result.nc"]


def test_written_by_xarray_it_is_known_too(tmp_path):
    """Users write results with xarray's own functions, with other engines."""
    tree = sealed(every_group())
    tree.to_netcdf(tmp_path / "tree.nc")
    check_seal(xr.open_datatree(tmp_path / "tree.nc").load(), "it")


def test_every_change_is_noticed():
    """A value, a name, an attribute, a dimension: each is part of the checksum."""
    result = sealed(every_type())
    check_seal(result, "it")
    flipped = result.copy(deep=True)
    flipped["real"].values[0] = np.nextafter(1.5, 2)
    text = result.copy(deep=True)
    text["text"].values[0] = "b"
    changes = {
        "value": flipped,
        "text": text,
        "attribute": result.assign_attrs(text="u"),
        "missing": result.drop_vars("whole"),
        "renamed": result.rename_vars(whole="hole"),
        "order": result.isel(x=[1, 0, 2]),
        "coordinate": result.assign_coords(x=["S1", "S2", "S4"]),
        "no attribute": result.drop_attrs().assign_attrs(checksum=result.attrs["checksum"]),
        "null": result.assign_attrs(checksum="null"),
        "cut": result.assign_attrs(checksum=result.attrs["checksum"][:-9]),
    }
    for name, changed in changes.items():
        with pytest.raises(ValueError, match=r"the class is not what was computed"):
            check_seal(changed, "the class")
            pytest.fail(name)


def test_what_is_added_is_no_change():
    """More variables, attributes and groups may join: those there were are the same."""
    tree = sealed(every_group())
    tree["more"] = xr.Dataset({"y": 1.0})
    tree.attrs["note"] = "looked at"
    tree["C1/p"] = tree["C1/p"].to_dataset().assign(z=2.0)
    check_seal(tree, "it")
    with pytest.raises(ValueError, match=r"it is not what"):
        check_seal(tree.isel(x=[0]), "it")


# What h5netcdf could not open, it cannot close either, and says so where nobody can catch it.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_damaged_file_is_an_error_that_names_it(tmp_path):
    """Whatever byte is flipped: an error that names the file, or the same numbers."""
    path = tmp_path / "result.nc"
    ph.save_result(every_group(), path)
    whole, rng = path.read_bytes(), random.Random(RANDOM_SEED)
    noticed = 0
    for _ in range(FLIPS):
        damaged = bytearray(whole)
        damaged[rng.randrange(len(whole))] ^= 1 << rng.randrange(8)
        path.write_bytes(damaged)
        try:
            assert ph.open_result(path).equals(every_group())
        except ValueError as error:
            noticed += 1
            assert str(path) in str(error)
    assert noticed > FLIPS / 4


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_a_file_that_was_cut_off_is_an_error_that_names_it(share, tmp_path):
    path = tmp_path / "result.nc"
    ph.save_result(every_group(), path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(ValueError, match=r"result.nc is no netCDF file of a result, or it was cut"):
        ph.open_result(path)


def test_no_file_and_no_result_are_errors(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"there is no file .*nothing"):
        ph.open_result(tmp_path / "nothing")
    (tmp_path / "text.nc").write_text("specimen,pressure")
    with pytest.raises(ValueError, match=r"text.nc is no netCDF file"):
        ph.open_result(tmp_path / "text.nc")
    with pytest.raises(TypeError, match=r"a result is a DataTree or a Dataset, not dict"):
        ph.save_result({}, tmp_path / "result.nc")
    with pytest.raises(OSError, match=r"result.nc cannot be written: .*left as it was"):
        ph.save_result(every_type(), tmp_path / "no folder" / "result.nc")


def test_nothing_is_left_of_what_was_not_finished(tmp_path):
    """What was there before stays, and no half file lies about."""
    path = tmp_path / "file"
    path.write_text("before")
    with pytest.raises(KeyboardInterrupt), written_whole(path) as beside:
        beside.write_text("half")
        raise KeyboardInterrupt
    assert path.read_text() == "before"
    assert os.listdir(tmp_path) == ["file"]


def test_a_part_is_computed_once(tmp_path):
    calls = []

    def compute():
        calls.append(1)
        return every_type()

    for _ in range(2):
        store = Store(tmp_path / "store", {"what": "test", "settings": {"a": 1, "b": [1, 2]}})
        assert store.remember("one", compute).equals(every_type())
    assert calls == [1]


def test_a_damaged_part_is_named_and_computed_again(tmp_path):
    """As that of a cohort: what a power cut leaves is not taken for whole, and ends nothing."""
    store = Store(tmp_path / "store", {"what": "test"})
    store.remember("one", every_type)
    store.part("one").write_bytes(store.part("one").read_bytes()[:-50])
    with pytest.warns(UserWarning, match=r"one\.nc .* It is computed again"):
        assert store.remember("one", every_type).equals(every_type())
    assert store.kept("one").equals(every_type())


def test_other_work_is_refused_and_said_to_differ(tmp_path):
    """The message says what there is and what is asked for."""
    manifest = {"what": "test", "settings": {"a": 1, "b": None}, "data": {"sha256": "0a"}}
    Store(tmp_path / "store", manifest)
    other = {"what": "test", "settings": {"a": 2, "b": None}, "data": {"sha256": "0b"}}
    with pytest.raises(ValueError) as refused:
        Store(tmp_path / "store", other)
    assert str(refused.value) == (
        f"the store {tmp_path / 'store'} holds other work: settings, a is 1 there and 2 here; "
        "data are not the same. Give another folder, or ask for what it holds"
    )


def test_a_folder_of_other_things_is_refused(tmp_path):
    (tmp_path / "thesis.tex").write_text("")
    with pytest.raises(ValueError, match=r"is no store, and not empty: it holds thesis.tex"):
        Store(tmp_path, {})
    with pytest.raises(ValueError, match=r"must be a folder, and it is a file"):
        Store(tmp_path / "thesis.tex", {})


@pytest.mark.parametrize("text", ["", "null", "[1]", '{"format": 99}', "{"])
def test_a_damaged_manifest_is_an_error_that_names_it(text, tmp_path):
    Store(tmp_path / "store", {})
    (tmp_path / "store" / "manifest.json").write_text(text)
    with pytest.raises(ValueError, match=r"manifest\.json"):
        Store(tmp_path / "store", {})


@pytest.mark.parametrize("name", ["", ".", "..", "../part", "/etc/passwd", "a/b", "a\\b", ".part"])
def test_names_of_parts_are_no_paths(name, tmp_path):
    """A part stands in its store, or nowhere."""
    store = Store(tmp_path / "store", {})
    with pytest.raises(ValueError, match="expected letters, and no path"):
        store.remember(name, every_type)


def test_names_in_a_manifest_are_no_paths(tmp_path):
    """Text of a user stands in the manifest, and nowhere else."""
    Store(tmp_path / "store", {"specimen": "../../etc/passwd"})
    assert sorted(os.listdir(tmp_path)) == ["store"]
    manifest = json.loads((tmp_path / "store" / "manifest.json").read_text())
    assert manifest["specimen"] == "../../etc/passwd"
