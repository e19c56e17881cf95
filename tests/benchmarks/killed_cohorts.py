"""Cohorts whose workers, drivers and schedulers are killed give the numbers of undisturbed ones.

python killed_cohorts.py --kills 20

Each of them is killed at so many random moments, and files are cut off at as many random places, as
by a power cut; then the cohort is done once more, undisturbed, and compared bit for bit with one
that nothing ever happened to. One of them is done on a file system that is full.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "cohorts"))

from simulated_work import SimulatedWork, cohort

import pymc_hyperelastic as ph
from pymc_hyperelastic.cohorts.run import run_cohort

options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
options.add_argument("--kills", type=int, default=20, help="of each (%(default)s)")
args = options.parse_args()

QUIET = {"progressbar": False, "batch_size": 2}
DRIVER = """
import sys
sys.path[:0] = {paths!r}
from simulated_work import SimulatedWork, cohort
from pymc_hyperelastic.cohorts.run import run_cohort
print("ready", flush=True)
work = SimulatedWork(seconds=0.2)
run_cohort(work, cohort(), {folder!r}, cores=2, batch_size=2, progressbar=False)
print("done", flush=True)
"""


def result(folder: Path):
    """The cohort, done to its end in this process."""
    run_cohort(SimulatedWork(), cohort(), folder, cores=1, **QUIET)
    return ph.open_cohort(folder).load()


def driver(folder: Path) -> subprocess.Popen:
    paths = [str(Path(__file__).parents[1] / "cohorts")]
    code = DRIVER.format(paths=paths, folder=str(folder))
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    process.stdout.readline()
    return process


def workers_of(process: subprocess.Popen) -> list[int]:
    threads = Path(f"/proc/{process.pid}/task").iterdir()
    found = []
    for thread in threads:
        children = thread / "children"
        if children.exists():
            found += [int(pid) for pid in children.read_text().split()]
    return found


def killed_workers(folder: Path, rng: np.random.Generator) -> int:
    """One run after another, a worker of which is killed at some moment."""
    kills = 0
    process = driver(folder)
    while kills < args.kills:
        time.sleep(rng.uniform(0.2, 3.0))
        if process.poll() is not None:
            for part in sorted(folder.glob("0*.nc"))[:8]:
                part.unlink()
            process = driver(folder)
            continue
        workers = workers_of(process)
        if workers:
            os.kill(workers[rng.integers(len(workers))], signal.SIGKILL)
            kills += 1
    process.wait()
    return kills


def killed_drivers(folder: Path, rng: np.random.Generator) -> int:
    """One driver after another; some parts are taken away when all are there."""
    for _ in range(args.kills):
        with driver(folder) as process:
            time.sleep(rng.uniform(0.0, 8.0))
            process.send_signal(signal.SIGKILL)
        if len(list(folder.glob("0*.nc"))) > 6:
            for part in sorted(folder.glob("0*.nc"))[::2]:
                part.unlink(missing_ok=True)
    return args.kills


def cut_off(folder: Path, rng: np.random.Generator) -> int:
    """Parts that end somewhere."""
    import warnings

    warnings.simplefilter("ignore")
    for _ in range(args.kills):
        result(folder)
        parts = sorted(folder.glob("0*.nc"))
        part = parts[rng.integers(len(parts))]
        whole = part.read_bytes()
        part.write_bytes(whole[: rng.integers(len(whole))])
    return args.kills


def killed_schedulers(folder: Path, rng: np.random.Generator) -> int:
    """A cluster after another, whose scheduler is killed at some moment."""
    import distributed

    from pymc_hyperelastic.cohorts.workers import ClusterLost

    code = (
        "import distributed, time\n"
        "if __name__ == '__main__':\n"
        "    cluster = distributed.LocalCluster(n_workers=2, threads_per_worker=1,"
        " dashboard_address=None)\n"
        "    print(cluster.scheduler_address, flush=True)\n"
        "    time.sleep(600)\n"
    )
    script = folder.parent / "scheduler.py"
    script.write_text(code)
    here = str(Path(__file__).parents[1] / "cohorts")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([here, *filter(None, sys.path)])}
    for _ in range(args.kills):
        with subprocess.Popen(
            [sys.executable, str(script)],
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
            start_new_session=True,
        ) as scheduler:
            address = scheduler.stdout.readline().strip()
            with distributed.Client(address, timeout=20) as client:
                import threading

                moment = rng.uniform(0.5, 8.0)
                threading.Timer(moment, os.killpg, (scheduler.pid, signal.SIGKILL)).start()
                try:
                    run_cohort(SimulatedWork(seconds=0.3), cohort(), folder, client=client, **QUIET)
                except ClusterLost as lost:
                    print("  ", str(lost)[:90])
        for part in sorted(folder.glob("0*.nc"))[::2]:
            part.unlink(missing_ok=True)
    return args.kills


def full_disk(folder: Path, rng: np.random.Generator) -> int:
    """A small file system in memory, on which not all has room."""
    folder.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(folder)], check=True)
    try:
        result(folder / "store")
    except OSError as error:
        print("  ", error)
        subprocess.run(["mount", "-o", "remount,size=64m", str(folder)], check=True)
    return 1


def main() -> None:
    with tempfile.TemporaryDirectory() as where:
        expected = result(Path(where) / "undisturbed")
        for disturb in (cut_off, killed_workers, killed_drivers, killed_schedulers, full_disk):
            folder = Path(where) / disturb.__name__
            start = time.perf_counter()
            count = disturb(folder, np.random.default_rng(1))
            inside = folder / "store" if disturb is full_disk else folder
            same = result(inside).identical(expected)
            if disturb is full_disk:
                subprocess.run(["umount", str(folder)], check=True)
            seconds = time.perf_counter() - start
            print(f"{disturb.__name__}: {count}, the same numbers: {same} ({seconds:.0f} s)")


if __name__ == "__main__":
    main()
