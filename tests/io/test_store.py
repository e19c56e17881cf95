"""The folder that keeps the parts of a long computation."""

import errno
import json
import os
import shutil
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

import pymc_hyperelastic as ph
from pymc_hyperelastic.evidence.keeping import named, remembering
from pymc_hyperelastic.io import store as store_module
from pymc_hyperelastic.io.atomic import atomic_write
from pymc_hyperelastic.io.store import (
    OtherWork,
    Parts,
    differences,
    hash_of,
    seed_in,
)

RESULT = xr.Dataset({"number": ("x", [1.5, 2.5]), "text": ("x", ["a", "ü"])}, attrs={"a": [1, 2]})


def test_part_of_a_store_is_computed_once(tmp_path):
    calls = []

    def compute():
        calls.append(1)
        return RESULT

    for _ in range(2):
        manifest = {"what": "../../etc/passwd", "settings": {"a": 1, "b": (1, 2)}}
        remember = named("law-0", remembering(tmp_path / "store", lambda m=manifest: m))
        assert remember("fold", compute).equals(RESULT)
    assert calls == [1]
    found = sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.*"))
    assert found == ["store/law-0-fold.nc", "store/manifest.json"]
    remembering(None, dict)("fold", compute)
    assert calls == [1, 1]


def test_store_object_or_its_path_can_be_given(tmp_path):
    """A computation without batches uses only the folder of a store."""
    store = ph.Store(tmp_path / "store", cores=2)
    assert store == ph.Store(str(tmp_path / "store"), cores=2) and store.batch_size == 64
    assert remembering(store, lambda: {"what": "fits"})("one", RESULT.copy).equals(RESULT)
    assert sorted(path.name for path in store.folder.iterdir()) == ["manifest.json", "one.nc"]
    for path in (store, store.folder):
        with pytest.raises(ValueError, match=r"holds parts of a computation, and no result: the"):
            ph.open_result(path)


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"cores": 0}, ValueError, "cores is 0; expected at least 1"),
        ({"batch_size": 2.5}, TypeError, "batch_size is 2.5; expected a whole number"),
        ({"client": "tcp://1.2.3.4:8786"}, TypeError, "client is 'tcp.*expected a client of Dask"),
        ({"client": SimpleNamespace(submit=map), "cores": 2}, ValueError, "client or cores"),
    ],
)
def test_invalid_store_settings_are_refused(settings, error, message, tmp_path):
    with pytest.raises(error, match=message):
        ph.Store(tmp_path / "store", **settings)
    assert not (tmp_path / "store").exists()


def test_damaged_part_is_renamed_with_a_warning_and_computed_again(tmp_path):
    store = Parts(tmp_path / "store", {"what": "test"})
    store.remember("one", RESULT.copy)
    for _ in range(2):
        store.part("one").write_bytes(store.part("one").read_bytes()[:-50])
        with pytest.warns(UserWarning, match=r"one\.nc .* was renamed to one\.nc\.damaged"):
            assert store.remember("one", RESULT.copy).equals(RESULT)
    assert store.kept("one").equals(RESULT) and store.kept("two") is None
    found = sorted(path.name for path in store.folder.iterdir())
    assert found == ["manifest.json", "one.nc", "one.nc.damaged-1", "one.nc.damaged-2"]


def test_part_that_cannot_be_read_is_kept_and_the_error_raised(tmp_path, monkeypatch):
    store = Parts(tmp_path / "store", {"what": "test"})
    store.remember("one", RESULT.copy)
    for error in (PermissionError(errno.EACCES, "denied"), OSError(errno.ESTALE, "stale")):

        def read_bytes(path, error=error):
            raise error

        with monkeypatch.context() as patched:
            patched.setattr(Path, "read_bytes", read_bytes)
            with pytest.raises(type(error)) as raised:
                store.remember("one", RESULT.copy)
        assert raised.value is error
    assert store.kept("one").equals(RESULT)


def test_store_is_accepted_after_a_patch_release_but_not_after_a_minor_release(
    tmp_path, monkeypatch
):
    installed = {"pymc": "6.1.0", "pytensor": "3.1.2", "numpy": "2.1.0"}
    monkeypatch.setattr(store_module, "version", installed.__getitem__)
    Parts(tmp_path / "store", {"what": "test"}).remember("one", RESULT.copy)
    installed |= {"pymc": "6.1.9", "pytensor": "3.1.4", "numpy": "2.2.0"}
    assert Parts(tmp_path / "store", {"what": "test"}).kept("one").equals(RESULT)
    installed["pymc"] = "6.2.0"
    with pytest.raises(OtherWork, match=r"versions, pymc is '6\.1' there and '6\.2' here"):
        Parts(tmp_path / "store", {"what": "test"})


def test_folder_of_other_files_or_damaged_manifest_is_refused(tmp_path):
    (tmp_path / "thesis.tex").write_text("")
    for folder, error, message in (
        (tmp_path, ValueError, "is no store, and not empty: it holds thesis.tex"),
        (tmp_path / "thesis.tex", ValueError, "must be a folder, and it is a file"),
        (tmp_path / "thesis.tex" / "store", OSError, "the store .* cannot be made: "),
    ):
        with pytest.raises(error, match=message):
            Parts(folder, {})
    store = Parts(tmp_path / "store", {})
    for text in ("", "null", "[1]", '{"format": 99}', '{"format": []}', "[" * 100_000):
        (store.folder / "manifest.json").write_text(text)
        with pytest.raises(ValueError, match=r"manifest\.json"):
            Parts(store.folder, {})
    for name in ("", "..", "../part", "/etc/passwd", "a/b", "a\\b", ".part"):
        with pytest.raises(ValueError, match="expected letters, and no path"):
            store.remember(name, RESULT.copy)


def test_differences_between_manifests_are_listed_by_entry():
    there = {"layers": [{"fingerprint": [1]}], "classes": [{"A": {"sha256": "0"}, "B": 1}]}
    here = {"layers": [{"fingerprint": [2]}], "classes": [{"A": {"sha256": "1"}, "B": 1}]}
    assert differences(there, there) == []
    assert differences(there, here) == [
        "layers, 1 has another formula there than here: its stresses are [1] there and [2] here",
        "classes, 1, A are not the same",
    ]


def test_random_seed_of_a_store_is_read_from_its_manifest(tmp_path):
    assert seed_in(tmp_path / "store") is None
    for seed in (0, 7, [1, 2], -1, 1.5, "x", [1, "x"]):
        (tmp_path / "manifest.json").write_text(json.dumps({"format": 2, "random_seed": seed}))
        if seed in (0, 7, [1, 2]):
            assert seed_in(tmp_path) == seed
            continue
        with pytest.raises(ValueError, match=r"has the random_seed .*it is damaged"):
            seed_in(tmp_path)


def test_store_can_be_used_after_a_kill_while_its_manifest_was_written(tmp_path):
    folder = tmp_path / "store"
    folder.mkdir()
    with atomic_write(tmp_path / "manifest.json") as beside:
        (folder / beside.name).write_text("{")
    assert Parts(folder, {"what": "test"}).remember("one", RESULT.copy).equals(RESULT)
    assert sorted(path.name for path in folder.iterdir()) == ["manifest.json", "one.nc"]


def test_second_of_two_processes_that_create_a_store_is_refused(tmp_path, monkeypatch):
    """One process writes its manifest after the other found an empty folder."""
    folder, check = tmp_path / "store", store_module._check_empty

    def meanwhile(path):
        check(path)
        monkeypatch.setattr(store_module, "_check_empty", check)
        Parts(folder, {"seed": 2})

    monkeypatch.setattr(store_module, "_check_empty", meanwhile)
    with pytest.raises(OtherWork, match="seed is 2 there and 1 here"):
        Parts(folder, {"seed": 1})
    assert Parts(folder, {"seed": 2}).kept("one") is None


def test_concurrent_creation_of_a_store_refuses_exactly_one_process(tmp_path, monkeypatch):
    """Each waits for a random time before and after each step of the creation."""
    rng = np.random.default_rng(1)

    def waiting(function, *given):
        time.sleep(rng.uniform(0.0, 0.003))
        try:
            function(*given)
        finally:
            time.sleep(rng.uniform(0.0, 0.003))

    link, check = os.link, store_module._check_empty
    monkeypatch.setattr("pymc_hyperelastic.io.atomic.os.link", partial(waiting, link))
    monkeypatch.setattr(store_module, "_check_empty", partial(waiting, check))

    def made(folder, seed):
        try:
            return Parts(folder, {"seed": seed}).hash
        except OtherWork as told:
            return str(told)

    with ThreadPoolExecutor(2) as pool:
        for i in range(25):
            folder = tmp_path / str(i)
            answers = [*pool.map(partial(made, folder), (1, 2))]
            winner = json.loads((folder / "manifest.json").read_text("utf-8"))
            loser = 3 - winner["seed"]
            assert answers[winner["seed"] - 1] == hash_of(winner)
            assert f"seed is {winner['seed']} there and {loser} here" in answers[loser - 1]
            assert not list(folder.glob(".*"))


def test_part_of_another_store_is_refused_and_kept(tmp_path):
    one, two = (Parts(tmp_path / name, {"what": name}) for name in ("one", "two"))
    one.remember("part", RESULT.copy)
    shutil.copy(one.part("part"), two.part("part"))
    said = (
        rf"part\.nc belongs to another store: .* {one.hash[:12]}, that of .*two has {two.hash[:12]}"
    )
    with pytest.raises(ValueError, match=said):
        two.kept("part")
    assert two.part("part").exists()


def test_store_of_an_older_format_is_refused_with_the_version_it_needs(tmp_path):
    (tmp_path / "manifest.json").write_text('{"format": 1}')
    with pytest.raises(ValueError, match=r"it has format 1, and needs pymc_hyperelastic 0\.1"):
        Parts(tmp_path, {})
