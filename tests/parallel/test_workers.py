"""Computation in batches gives the same numbers after failures, kills and interrupts."""

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from concurrent.futures import Future
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import simulated_work
import xarray as xr
from simulated_work import SPECIMENS, SimulatedWork, cohort, computed, wait_for
from tiers import deep

import pymc_hyperelastic as ph
from pymc_hyperelastic.io.atomic import UNFINISHED, atomic_write
from pymc_hyperelastic.io.batches import parts_of
from pymc_hyperelastic.io.store import Part, hash_of, manifest_of
from pymc_hyperelastic.parallel.workers import (
    Cluster,
    Processes,
    ThisProcess,
    WorkerDied,
    WorkersLost,
)


def check_others(result, undisturbed, *failed):
    """Check that the failed specimens did not change the results of the others."""
    others = ~result["specimen"].isin(failed)
    assert result.sel(specimen=others).equals(undisturbed.sel(specimen=others))


@pytest.mark.parametrize("batch_size", [3, 64])
def test_store_gives_the_same_result_as_the_work_in_one_call(
    batch_size, data, undisturbed, tmp_path
):
    result = computed(SimulatedWork(), data, tmp_path / "store", batch_size=batch_size)
    assert result.identical(undisturbed)
    assert result.equals(SimulatedWork().run(data))
    assert result.attrs == {"strain_energy": "none"} and result["pair"].attrs == {"units": "kPa"}
    parts = [(i, min(i + batch_size, SPECIMENS)) for i in range(0, SPECIMENS, batch_size)]
    assert parts_of(tmp_path / "store") == parts
    result = computed(SimulatedWork("test"), data, tmp_path / "tests", batch_size=batch_size)
    assert result.equals(SimulatedWork("test").run(data))
    assert result["experiment"].values.tolist() == ["1", "2"] * SPECIMENS


def test_second_call_computes_only_the_missing_parts(data, undisturbed, tmp_path):
    """The second call may use another batch size; existing parts are not changed."""
    folder = tmp_path / "store"
    computed(SimulatedWork(), data, folder, batch_size=4)
    parts = sorted(folder.glob("0*.nc"))
    for part in parts[1:3]:
        part.unlink()
    kept = {part: part.stat().st_mtime_ns for part in parts if part.exists()}
    with pytest.warns(UserWarning, match="store holds 12 of 20"):
        partial = ph.open_result(folder).load()
    assert partial["error"].values.tolist() == [""] * 4 + ["not computed yet"] * 8 + [""] * 8
    assert partial["total"].isnull().sum() == 8
    assert computed(SimulatedWork(), data, folder, batch_size=3).identical(undisturbed)
    assert {part: part.stat().st_mtime_ns for part in kept} == kept


def test_longest_of_overlapping_parts_is_used(tmp_path):
    """A worker that outlived the main process may have written parts that overlap later ones."""
    for first, last in ((0, 2), (0, 4), (2, 4), (4, 6), (5, 8)):
        (tmp_path / f"{first:09d}-{last:09d}.nc").touch()
    assert parts_of(tmp_path) == [(0, 4), (4, 6)]


def test_store_refuses_other_work_or_data(data, tmp_path):
    folder = tmp_path / "store"
    computed(SimulatedWork(), data, folder)
    for work, other, message in (
        (SimulatedWork(factor=2.0), data, r"factor is 1.0 there and 2.0 here\. "),
        (SimulatedWork(), cohort(19), "units is 20 there and 19 here; data"),
        (SimulatedWork(), cohort(seed=2), "data are not the same"),
    ):
        with pytest.raises(ValueError, match=f"holds other work: {message}"):
            computed(work, other, folder)


def test_failed_specimen_has_a_row_with_its_error_message(data, undisturbed, tmp_path):
    """The results of all other specimens, including those of its batch, do not change."""
    with pytest.warns(UserWarning, match="2 of 20 failed.* the first is S3: no curve"):
        work = SimulatedWork(raises=("S3", "S19"))
        result = computed(work, data, tmp_path / "store", batch_size=8)
    failed = result.sel(specimen=["S3", "S19"])
    assert failed["error"].values.tolist() == ["no curve"] * 2
    assert failed["total"].isnull().all() and failed["text"].values.tolist() == ["", ""]
    check_others(result, undisturbed, "S3", "S19")
    everyone = SimulatedWork(raises=tuple(f"S{i}" for i in range(SPECIMENS)))
    with pytest.warns(UserWarning, match="20 of 20 failed"):
        assert set(computed(everyone, data, tmp_path / "all").data_vars) == {"error"}


@pytest.mark.parametrize("cores", [1, 2])
def test_programming_error_ends_the_run(cores, data, tmp_path):
    work = SimulatedWork(factor=None)
    with pytest.raises(TypeError, match="NoneType"):
        computed(work, data, tmp_path / "store", cores=cores, batch_size=5)


def test_failing_batch_is_retried_and_halved_until_one_specimen_remains(
    data, undisturbed, tmp_path, monkeypatch
):
    """A batch is tried three times; the next call tries the specimen at fault again."""
    attempts = []

    class Dying(ThisProcess):
        def submit(self, data, part):
            names = list(dict.fromkeys(data["specimen"].values.tolist()))
            if "S5" not in names:
                return super().submit(data, part)
            attempts.append(names)
            future = Future()
            future.set_exception(WorkerDied("it was killed"))
            return future

    workers = "pymc_hyperelastic.io.batches.workers_for"
    monkeypatch.setattr(workers, lambda work, token, *_: Dying(work, token))
    with pytest.warns(UserWarning, match="1 of 20 failed.* S5: the process that computed it died"):
        result = computed(SimulatedWork(), data, tmp_path / "store", batch_size=4)
    assert attempts == [["S4", "S5", "S6", "S7"]] * 3 + [["S4", "S5"]] * 3 + [["S5"]] * 3
    said = "the process that computed it died 3 times: it was killed"
    assert result["error"].sel(specimen="S5").item() == said
    check_others(result, undisturbed, "S5")
    monkeypatch.undo()
    assert computed(SimulatedWork(), data, tmp_path / "store").identical(undisturbed)


def test_damaged_part_is_named_in_a_warning_and_computed_again(data, undisturbed, tmp_path):
    folder = tmp_path / "store"
    computed(SimulatedWork(), data, folder, batch_size=4)
    part = folder / "000000004-000000008.nc"
    edited = xr.load_dataset(part, engine="h5netcdf")
    edited["total"].values[1] += 1e-9
    edited.to_netcdf(part, engine="h5netcdf")
    with pytest.raises(ValueError, match=part.name):
        ph.open_result(folder)["total"].load()
    with pytest.warns(UserWarning, match=f"{part.name}.* the part is computed again"):
        assert computed(SimulatedWork(), data, folder).identical(undisturbed)


def test_part_of_another_store_is_refused_and_kept(data, undisturbed, tmp_path):
    """The part was copied from a store with other settings."""
    folders = tmp_path / "own", tmp_path / "other"
    for folder, factor in zip(folders, (1.0, 2.0), strict=True):
        computed(SimulatedWork(factor=factor), data, folder, batch_size=4)
    part = "000000004-000000008.nc"
    shutil.copy(folders[1] / part, folders[0] / part)
    own, other = (hash_of(manifest_of(folder))[:12] for folder in folders)
    said = rf"{part} belongs to another store: .*{other}, that of {folders[0]} has {own}"
    with pytest.raises(ValueError, match=said):
        ph.open_result(folders[0])["total"].load()
    with pytest.raises(ValueError, match=said):
        computed(SimulatedWork(), data, folders[0])
    (folders[0] / part).unlink()
    assert computed(SimulatedWork(), data, folders[0]).identical(undisturbed)


def test_reading_a_specimen_opens_only_its_own_part(data, undisturbed, tmp_path):
    """Any lazy selection equals the selection from the result in memory."""
    folder = tmp_path / "store"
    computed(SimulatedWork(), data, folder, batch_size=4)
    lazy = ph.open_result(folder)
    for part in sorted(folder.glob("0*.nc"))[2:]:
        part.unlink()
    for pick in (6, slice(1, 7, 2), slice(7, 0, -3), [6, 0, 6], []):
        for name in ("total", "text", "pair"):
            found = lazy[name].isel(specimen=pick).values
            assert np.array_equal(found, undisturbed[name].isel(specimen=pick).values), pick
    both = {"specimen": [5, 2], "of_two": 1}
    assert np.array_equal(lazy["pair"].isel(both), undisturbed["pair"].isel(both))


def test_open_result_refuses_a_folder_without_a_valid_manifest(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"is no store: it has no manifest\.json"):
        ph.open_result(tmp_path)
    intact = {"format": 2, "by": "specimen", "units": 20}
    for damage in ({"by": "animal"}, {"units": True}, {"units": 0}):
        (tmp_path / "manifest.json").write_text(json.dumps(intact | damage))
        with pytest.raises(ValueError, match=r"the manifest of .* says .* it is damaged"):
            ph.open_result(tmp_path)


def test_wrong_settings_are_refused_before_a_file_is_written(data, tmp_path):
    for wrong in ({"batch_size": 0}, {"batch_size": 2.5}, {"cores": 0}, {"cores": "two"}):
        with pytest.raises((TypeError, ValueError), match=next(iter(wrong))):
            computed(SimulatedWork(), data, tmp_path / "store", **wrong)
    assert not (tmp_path / "store").exists()


def test_full_disk_or_interrupt_keeps_finished_batches(data, undisturbed, tmp_path, monkeypatch):
    class Interrupted(SimulatedWork):
        def run(self, data):
            if "S9" in data["specimen"].values:
                raise KeyboardInterrupt
            return super().run(data)

    replace, count = os.replace, iter(range(100))

    def full(source, target):
        # There is space for the labels and two batches.
        if Path(target).suffix == ".nc" and next(count) > 2:
            raise OSError(28, "No space left on device", str(target))
        replace(source, target)

    folders = tmp_path / "interrupted", tmp_path / "full"
    with pytest.raises(KeyboardInterrupt), pytest.warns(UserWarning, match="same call continues"):
        computed(Interrupted(), data, folders[0], batch_size=4)
    monkeypatch.setattr("pymc_hyperelastic.io.atomic.os.replace", full)
    with pytest.raises(
        OSError, match=r"No space left.*Finished batches are in .*the same call continues"
    ):
        computed(SimulatedWork(), data, folders[1], batch_size=4)
    monkeypatch.undo()
    for folder in folders:
        assert parts_of(folder) == [(0, 4), (4, 8)] and not list(folder.glob(".*"))
        assert computed(SimulatedWork(), data, folder, batch_size=4).identical(undisturbed)


def test_unfinished_files_of_killed_processes_are_removed(data, tmp_path):
    """The unfinished file belongs to no later batch; the file of a living process is kept."""
    pytest.importorskip("fcntl", reason="only Unix has locks of files")
    folder = tmp_path / "store"
    computed(SimulatedWork(), data, folder, batch_size=4)
    (folder / "000000004-000000008.nc").unlink()
    (folder / f".0123{UNFINISHED}").write_text("half")
    with atomic_write(folder / "other.nc") as living:
        computed(SimulatedWork(), data, folder, batch_size=2)
        assert list(folder.glob(".*")) == [living]


@pytest.mark.deep
def test_killed_processes_are_replaced(data, undisturbed, tmp_path, monkeypatch):
    """Two processes die while they compute a batch; S5 kills every process that computes it."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    work = SimulatedWork(kills_once=("S2", "S11"), kills=("S5",), folder=tmp_path)
    with pytest.warns(UserWarning, match="1 of 20 failed.* S5: the process that computed it died"):
        result = computed(work, data, tmp_path / "store", batch_size=1, cores=2)
    assert work.note("S2").exists() and work.note("S11").exists()
    said = result["error"].sel(specimen="S5").item()
    assert "3 times" in said and "SIGKILL" in said
    check_others(result, undisturbed, "S5")
    assert not [*temporary.iterdir(), *(tmp_path / "store").glob(".*")]


DRIVER = """
import sys
sys.path[:0] = {paths!r}
from pathlib import Path
from simulated_work import SimulatedWork, cohort, computed
work = SimulatedWork(waits=("S7",), folder=Path({folder!r}))
computed(work, cohort(), work.folder / "store", cores={cores}, batch_size=2)
"""


@pytest.mark.deep
@pytest.mark.parametrize("cores", [1, 2])
def test_killed_main_process_keeps_finished_batches(cores, data, undisturbed, tmp_path):
    """The kill comes while specimen S7 is computed; with two cores a worker outlives it."""
    here = [str(Path(simulated_work.__file__).parent)]
    code = DRIVER.format(paths=here, folder=str(tmp_path), cores=cores)
    with subprocess.Popen([sys.executable, "-c", code]) as process:
        wait_for(SimulatedWork(folder=tmp_path).note("S7").exists, process)
        process.send_signal(signal.SIGKILL)
    if cores == 1:
        assert parts_of(tmp_path / "store") == [(0, 2), (2, 4), (4, 6)]
    result = computed(SimulatedWork(), data, tmp_path / "store", batch_size=2)
    assert result.identical(undisturbed)


IN_ANOTHER_FOLDER = """
import os
import sys
sys.path[:0] = {paths!r}
from pathlib import Path
from simulated_work import SimulatedWork, cohort
from pymc_hyperelastic.parallel.workers import Processes
from pymc_hyperelastic.io.store import Part
os.chdir({folder!r})
for name in ("scipy", "signal"):
    Path(f"{{name}}.py").write_text("raise SystemExit('executed')")
workers = Processes(SimulatedWork(), 1)
print(workers.submit(cohort(), Part(Path("part.nc"), "hash")).result().failed)
workers.close()
"""


@pytest.mark.parametrize(
    "options", [[], *deep([(["-c", "import sys; exec(open(sys.argv[1]).read())"],)])]
)
def test_processes_prefer_installed_modules_to_those_of_the_current_folder(options, data, tmp_path):
    """Cases: a script in another folder, and a Python that searches the current folder first."""
    script = tmp_path / "scripts" / "run.py"
    script.parent.mkdir()
    here = [str(Path(simulated_work.__file__).parent)]
    script.write_text(IN_ANOTHER_FOLDER.format(paths=here, folder=str(tmp_path)))
    done = subprocess.run([sys.executable, *options, script], capture_output=True, text=True)
    assert done.stdout.strip() == "{}", done.stderr
    assert "executed" not in done.stderr
    total = SimulatedWork().run(data)["total"].values
    assert np.array_equal(ph.open_result(tmp_path / "part.nc")["total"], total)


HOARD = []


class Hoarding(SimulatedWork):
    """Work that keeps memory: loky replaces such a worker after a second or more."""

    def run(self, data):
        HOARD.append(np.ones(50_000_000))
        time.sleep(1.5)
        return super().run(data).assign(process=os.getpid())


@pytest.mark.deep
@pytest.mark.filterwarnings("ignore:A worker was restarted")
def test_replacement_of_a_worker_receives_the_work(data, tmp_path):
    workers, seen = Processes(Hoarding(), 1), set()
    for i in range(3):
        part = tmp_path / f"{i}.nc"
        assert workers.submit(data, Part(part, "hash")).result().failed == {}
        seen.add(ph.open_result(part)["process"].item())
    workers.close()
    assert len(seen) > 1


class Unreadable(SimulatedWork):
    """Work that no other process can receive, as if a package were missing there."""

    def __reduce__(self):
        return exec, ("raise ImportError('no module named pymc')",)


def test_workers_that_cannot_start_raise_one_error(data, undisturbed, tmp_path):
    """No specimen is at fault: once the reason is gone, the same call computes all of them."""
    with pytest.raises(WorkersLost) as lost:
        computed(Unreadable(), data, tmp_path / "store", batch_size=4, cores=2)
    said = "no worker process can start: no module named pymc"
    assert str(lost.value).startswith(said) and "the same call continues" in str(lost.value)
    assert computed(SimulatedWork(), data, tmp_path / "store").identical(undisturbed)


def test_cluster_without_workers_and_events_is_reported_as_lost(monkeypatch):
    """A worker that is killed right after its start is rarely listed, but causes events."""
    monkeypatch.setattr("pymc_hyperelastic.parallel.workers._PATIENCE", -1.0)
    cluster, events, threads = object.__new__(Cluster), ["a worker came"], {}
    client = SimpleNamespace(nthreads=lambda: threads, get_events=lambda topic: tuple(events))
    cluster._client, cluster._seen, cluster._news = client, 0.0, ()
    cluster.check()
    with pytest.raises(WorkersLost, match="no worker for"):
        cluster.check()
    events.append("another one came")
    cluster.check()
    threads["worker"] = 1
    cluster.check()
