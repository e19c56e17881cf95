"""A cohort is done batch by batch; whatever happens meanwhile, the numbers are the same."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from chores import SPECIMENS, Chore, cohort

import pymc_hyperelastic as ph
from pymc_hyperelastic.cohorts.run import parts_of, run_cohort
from pymc_hyperelastic.cohorts.workers import Processes

SETTINGS = {"cores": 1, "progressbar": False}


def done(work, data, folder, **settings) -> xr.Dataset:
    """The result of a cohort, all of it in memory."""
    run_cohort(work, data, folder, **SETTINGS | settings)
    return ph.open_cohort(folder).load()


def expected(data, by: str = "specimen") -> xr.Dataset:
    """What the chore gives without any store."""
    return Chore(by).of(data)


@pytest.fixture(scope="module")
def undisturbed(data, tmp_path_factory):
    return done(Chore(), data, tmp_path_factory.mktemp("undisturbed") / "store")


def test_result_is_that_of_the_work_itself(data, undisturbed):
    """A store adds nothing and takes nothing away."""
    assert undisturbed.equals(expected(data))
    assert undisturbed.attrs == {"strain_energy": "none"}
    assert undisturbed["pair"].attrs == {"units": "kPa"}


@pytest.mark.parametrize("batch_size", [1, 3, 7, 64])
def test_batches_do_not_matter(batch_size, data, undisturbed, tmp_path):
    """Of every size, the last one smaller than the others."""
    result = done(Chore(), data, tmp_path / "store", batch_size=batch_size)
    assert result.identical(undisturbed)
    parts = parts_of(tmp_path / "store")
    assert parts[0] == (0, min(batch_size, SPECIMENS))
    assert sum(last - first for first, last in parts) == SPECIMENS


def test_each_experiment_may_stand_alone(data, tmp_path):
    result = done(Chore("test"), data, tmp_path / "store", batch_size=6)
    assert result.equals(expected(data, "test"))
    assert result.sizes["test"] == 2 * SPECIMENS
    assert result["experiment"].values.tolist() == ["1", "2"] * SPECIMENS


@pytest.mark.deep
@pytest.mark.parametrize("cores", [2, 3])
def test_processes_do_not_matter(cores, data, undisturbed, tmp_path):
    result = done(Chore(), data, tmp_path / "store", batch_size=3, cores=cores)
    assert result.identical(undisturbed)


def test_a_second_call_does_what_is_missing(data, undisturbed, tmp_path):
    """With other batches too; what is there is not touched."""
    folder = tmp_path / "store"
    done(Chore(), data, folder, batch_size=4)
    parts = sorted(folder.glob("0*.nc"))
    for part in parts[1:3]:
        part.unlink()
    kept = {part: part.stat().st_mtime_ns for part in parts if part.exists()}
    with pytest.warns(UserWarning, match="store holds 12 of 20"):
        partial = ph.open_cohort(folder).load()
    assert partial["error"].values.tolist() == [""] * 4 + ["not computed yet"] * 8 + [""] * 8
    assert partial["total"].isnull().sum() == 8
    assert done(Chore(), data, folder, batch_size=3).identical(undisturbed)
    assert {part: part.stat().st_mtime_ns for part in kept} == kept


def test_other_work_or_data_are_refused(data, tmp_path):
    """The message says what is asked for that is not there."""
    folder = tmp_path / "store"
    done(Chore(), data, folder)
    with pytest.raises(ValueError, match=r"holds other work: factor is 1.0 there and 2.0 here\. "):
        done(Chore(factor=2.0), data, folder)
    with pytest.raises(ValueError, match="holds other work: units is 20 there and 19 here; data"):
        done(Chore(), cohort(19), folder)
    with pytest.raises(ValueError, match="holds other work: data are not the same"):
        done(Chore(), cohort(seed=2), folder)


def test_a_specimen_that_raises_is_a_row_with_its_message(data, undisturbed, tmp_path):
    """The others, in the same batch too, are as they were."""
    with pytest.warns(UserWarning, match="2 of 20 failed.* the first is S3: KeyError: 'S3'"):
        result = done(Chore(raises=("S3", "S19")), data, tmp_path / "store", batch_size=8)
    failed = result["specimen"].isin(["S3", "S19"])
    assert result["error"].values[failed].tolist() == ["KeyError: 'S3'", "KeyError: 'S19'"]
    assert np.isnan(result["total"].values[failed]).all()
    assert result["text"].values[failed].tolist() == ["", ""]
    assert result.sel(specimen=~failed).equals(undisturbed.sel(specimen=~failed))


def test_if_all_fail_nothing_else_is_there(data, tmp_path):
    everyone = tuple(f"S{i}" for i in range(SPECIMENS))
    with pytest.warns(UserWarning, match="20 of 20 failed"):
        result = done(Chore(raises=everyone), data, tmp_path / "store", batch_size=8)
    assert set(result.data_vars) == {"error"}
    assert result["error"].values[7] == "KeyError: 'S7'"


@pytest.mark.deep
def test_a_specimen_that_kills_its_process_stands_alone(data, undisturbed, tmp_path):
    """Its batch is tried again, halved and halved again; all others are done.

    Somebody else may have killed its process: the next call tries it again.
    """
    with pytest.warns(UserWarning, match="1 of 20 failed.* S5: the process that computed it died"):
        result = done(Chore(kills=("S5",)), data, tmp_path / "store", batch_size=4, cores=2)
    assert result["error"].sel(specimen="S5").item() == (
        "the process that computed it died 3 times: it was killed by signal 9, perhaps for its "
        "memory"
    )
    others = result["specimen"] != "S5"
    assert result.sel(specimen=others).equals(undisturbed.sel(specimen=others))
    assert done(Chore(), data, tmp_path / "store", batch_size=4).identical(undisturbed)


@pytest.mark.parametrize("damage", ["cut", "empty", "edited", "text"])
def test_a_damaged_part_is_named_and_computed_again(damage, data, undisturbed, tmp_path):
    """What a power cut leaves is never taken for whole."""
    folder = tmp_path / "store"
    done(Chore(), data, folder, batch_size=4)
    part = folder / "000000004-000000008.nc"
    if damage == "edited":
        edited = xr.load_dataset(part, engine="h5netcdf")
        edited["total"].values[1] += 1e-9
        edited.to_netcdf(part, engine="h5netcdf")
    else:
        whole = part.read_bytes()
        part.write_bytes({"cut": whole[:-100], "empty": b"", "text": b"total\n1\n"}[damage])
    with pytest.raises(ValueError, match=part.name):
        ph.open_cohort(folder)["total"].load()
    with pytest.warns(UserWarning, match=f"{part.name}.* It is computed again"):
        run_cohort(Chore(), data, folder, **SETTINGS)
    assert ph.open_cohort(folder).load().identical(undisturbed)


def test_one_specimen_is_read_without_the_others(data, undisturbed, tmp_path):
    """By position, by name, by several, backwards: as in memory."""
    folder = tmp_path / "store"
    done(Chore(), data, folder, batch_size=4)
    lazy = ph.open_cohort(folder)
    for part in sorted(folder.glob("0*.nc"))[2:]:
        part.unlink()  # nobody needs it
    assert lazy["total"].sel(specimen="S6").item() == undisturbed["total"][6].item()
    picks = [3, slice(1, 7, 2), slice(7, 0, -3), [6, 0, 6], np.arange(8) % 2 == 0, []]
    for pick in picks:
        if isinstance(pick, np.ndarray):
            pick = np.flatnonzero(pick)
        for name in ("total", "text", "pair"):
            found = lazy[name].isel(specimen=pick).values
            assert np.array_equal(found, undisturbed[name].isel(specimen=pick).values), pick
    for both in ({"specimen": [5, 2], "of_two": 1}, {"specimen": 3, "of_two": [1, 0]}):
        assert np.array_equal(lazy["pair"].isel(both), undisturbed["pair"].isel(both))


def test_what_is_no_store_is_an_error(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"is no store: it has no manifest\.json"):
        ph.open_cohort(tmp_path)
    with pytest.raises(FileNotFoundError, match="is no store"):
        ph.open_cohort(tmp_path / "nowhere")


@pytest.mark.parametrize(
    "damage", [{"by": "animal"}, {"units": "20"}, {"units": True}, {"units": None}, {"units": -1}]
)
def test_a_damaged_manifest_is_an_error_that_names_it(damage, tmp_path):
    """What it says of units is looked at before anything is read by it."""
    folder = tmp_path / "store"
    folder.mkdir()
    manifest = {"format": 1, "by": "specimen", "units": 20} | damage
    (folder / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(ValueError, match=r"the manifest of .*store says .* it is damaged"):
        ph.open_cohort(folder)


def test_a_damaged_seed_is_an_error_that_names_it(data, tmp_path):
    folder = tmp_path / "store"
    folder.mkdir()
    (folder / "manifest.json").write_text('{"format": 1, "random_seed": "x"}')
    with pytest.raises(ValueError, match=r"the manifest of .*store has the random_seed 'x'"):
        ph.fit_cohort(ph.Ogden(), data, folder, noise_sd=0.5, slope_weight=0.0, **SETTINGS)


def test_names_of_specimens_become_no_paths(tmp_path):
    """A specimen may have any name."""
    names = ["../../S0", "/etc/passwd", "S 2", "ü\n", "a:b", "NUL"]
    data = cohort(6)
    odd = np.array(names)[[int(s[1:]) for s in data["specimen"].values]]
    data = data.assign_coords(specimen=("test", odd))
    result = done(Chore(), data, tmp_path / "store", batch_size=2)
    assert result["specimen"].values.tolist() == names
    assert sorted(p.name for p in tmp_path.iterdir()) == ["store"]
    assert all(p.name[0] in "0mu" for p in (tmp_path / "store").iterdir())


def test_wrong_numbers_are_refused_before_anything_is_done(data, tmp_path):
    for wrong in ({"batch_size": 0}, {"batch_size": 2.5}, {"cores": 0}, {"cores": "two"}):
        with pytest.raises((TypeError, ValueError), match=next(iter(wrong))):
            done(Chore(), data, tmp_path / "store", **wrong)
    assert not (tmp_path / "store").exists()


@pytest.mark.skipif(os.getuid() == 0, reason="the superuser may write anywhere")
def test_a_folder_that_cannot_be_written_is_an_error(data, tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(PermissionError, match=r"the store .* cannot be made: Permission denied"):
        done(Chore(), data, tmp_path / "store")


def test_a_full_disk_is_an_error_and_nothing_is_lost(data, undisturbed, tmp_path, monkeypatch):
    """As a disk on which nothing can be written any more."""
    folder = tmp_path / "store"
    replace, count = os.replace, iter(range(100))

    def full(source, target):
        if next(count) > 3:
            raise OSError(28, "No space left on device", str(target))
        replace(source, target)

    monkeypatch.setattr("pymc_hyperelastic.files.whole.os.replace", full)
    with pytest.raises(OSError, match=r"No space left.*What was computed is in .*goes on from"):
        done(Chore(), data, folder, batch_size=4)
    monkeypatch.undo()
    assert len(parts_of(folder)) == 2
    assert not list(folder.glob(".*"))
    assert done(Chore(), data, folder, batch_size=4).identical(undisturbed)


def test_an_interrupt_is_raised_and_says_where_the_rest_is(data, undisturbed, tmp_path):
    class Interrupted(Chore):
        def of(self, data):
            if "S9" in data["specimen"].values:
                raise KeyboardInterrupt
            return super().of(data)

    folder = tmp_path / "store"
    with pytest.raises(KeyboardInterrupt), pytest.warns(UserWarning, match="goes on from there"):
        done(Interrupted(), data, folder, batch_size=4)
    assert parts_of(folder) == [(0, 4), (4, 8)]
    assert done(Chore(), data, folder, batch_size=4).identical(undisturbed)


DRIVER = """
import sys
sys.path[:0] = {paths!r}
from chores import Chore, cohort
from pymc_hyperelastic.cohorts.run import run_cohort
print("ready", flush=True)
settings = {{"cores": {cores}, "batch_size": 2, "progressbar": False}}
run_cohort(Chore(seconds=0.02), cohort(), {folder!r}, **settings)
"""


def driver(folder: Path, cores: int) -> subprocess.Popen:
    """A process that does a cohort, once it is ready."""
    here = [str(Path(__file__).parent)]
    code = DRIVER.format(paths=here, folder=str(folder), cores=cores)
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "ready\n"
    return process


@pytest.mark.deep
@pytest.mark.parametrize("cores", [1, 2])
def test_killed_drivers_lose_nothing(cores, data, undisturbed, tmp_path):
    """Killed at some moment, and at another one; then undisturbed."""
    rng = np.random.default_rng(cores)
    for _ in range(2):
        with driver(tmp_path / "store", cores) as process:
            time.sleep(rng.uniform(0.05, 0.5) if cores == 1 else rng.uniform(2.0, 6.0))
            process.send_signal(signal.SIGKILL)
    assert done(Chore(), data, tmp_path / "store", batch_size=2).identical(undisturbed)


@pytest.mark.deep
def test_killed_workers_are_replaced(data, undisturbed, tmp_path, monkeypatch):
    """Two that are killed at some moment while they do a batch."""
    rng, killed = np.random.default_rng(1), []

    class Mortal(Processes):
        def submit(self, data, part):
            if len(killed) < 2 and self._all and rng.random() < 0.5:
                killed.append(next(iter(self._all)))
                killed[-1].kill()
            return super().submit(data, part)

    monkeypatch.setattr("pymc_hyperelastic.cohorts.workers.Processes", Mortal)
    result = done(Chore(seconds=0.01), data, tmp_path / "store", batch_size=1, cores=2)
    assert len(killed) == 2
    assert result.identical(undisturbed)


def test_manifest_says_what_decides_the_numbers(data, tmp_path):
    done(Chore(), data, tmp_path / "store")
    manifest = json.loads((tmp_path / "store" / "manifest.json").read_text())
    assert manifest.keys() >= {"work", "by", "units", "factor", "random_seed", "data", "versions"}
    assert manifest["versions"]["pymc-hyperelastic"] == ph.__version__
