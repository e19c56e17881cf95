"""Kill stores and reports while they are written, continue, and compare with an undisturbed run.

python killed_stores.py --kills 20

Each of four jobs runs in a child process on a slow disk, where a write takes 0.6 s. A SIGKILL ends
the child at a random fraction of the time of an undisturbed run; a child that ended before it does
not count as killed. The same call then continues in this process. Its numbers must equal those of
the undisturbed run exactly, and a report must be the old page or the complete new one. The exit
code is 1 if one of them differs.
"""

import argparse
import os
import signal
import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np
import xarray as xr

import pymc_hyperelastic as ph
from pymc_hyperelastic.io import atomic
from pymc_hyperelastic.io.store import Parts

options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
options.add_argument("--kills", type=int, default=20, help="of each job (%(default)s)")
options.add_argument("--seed", type=int, default=1, help="of the moments (%(default)s)")
args = options.parse_args()

# Delay (s) of the child process at each step of a write.
LATENCY = 0.2
OLD_PAGE = "the old page"
RESULT = xr.Dataset({"number": ("x", np.arange(50_000.0))})
DATA = ph.load_dataset("simulated_sheep_aorta")
SETTINGS = {"draws": 50, "random_seed": 1}


def create(folder: Path) -> None:
    """Make a store and its first part."""
    Parts(folder / "store", {"random_seed": 1}).remember("part", RESULT.copy)


def write_manifest(folder: Path) -> None:
    """Make a store with a long manifest."""
    Parts(folder / "store", {"settings": list(range(100_000))})


def fit(folder: Path) -> None:
    """Fit specimens, one batch each."""
    ph.fit_cohort(
        ph.Ogden(),
        DATA,
        0.5,
        ph.Store(folder / "store", cores=1, batch_size=1),
        progressbar=False,
        **SETTINGS,
    )


def write_report(folder: Path) -> None:
    """Replace the old page."""
    ph.report(DATA, folder / "report.html")


def files(folder: Path) -> dict[str, bytes]:
    """Return the contents of the finished files of a folder."""
    paths = [path for path in folder.rglob("*") if path.is_file()]
    return {path.name: path.read_bytes() for path in paths if path.suffix != atomic.UNFINISHED}


def posteriors(folder: Path) -> dict[str, xr.Dataset]:
    """Return the groups of a cohort."""
    found = ph.open_result(folder / "store").load()
    return {name: node.to_dataset() for name, node in found.children.items()}


def same(one: dict, two: dict) -> bool:
    """Return True if two results are equal to the last bit."""
    return one.keys() == two.keys() and all(
        value.identical(two[name]) if isinstance(value, xr.Dataset) else value == two[name]
        for name, value in one.items()
    )


def in_child(job, folder: Path) -> int:
    """Start a job on a slow disk in a process of its own."""
    child = os.fork()
    if child:
        return child
    write = Path.write_bytes

    def slow_write(path: Path, content: bytes) -> int:
        half = len(content) // 2
        write(path, content[:half])
        time.sleep(LATENCY)
        return write(path, content)

    def slow(function):
        def waits(source: Path, target: Path) -> None:
            time.sleep(LATENCY)
            function(source, target)
            time.sleep(LATENCY)

        return waits

    os.replace, os.link = slow(os.replace), slow(os.link)
    Path.write_bytes = slow_write
    Path.write_text = lambda path, text, encoding, errors="strict": slow_write(
        path, text.encode(encoding, errors)
    )
    job(folder)
    os._exit(0)


def prepared() -> Path:
    """Return a new folder that holds an old page."""
    folder = Path(tempfile.mkdtemp())
    (folder / "report.html").write_text(OLD_PAGE, encoding="utf-8")
    return folder


def main() -> int:
    """Kill each job repeatedly, and count the differences."""
    rng, failed = np.random.default_rng(args.seed), 0
    print(f"{'job':16}{'killed':>8}{'ended before':>14}{'unfinished files':>18}{'different':>11}")
    for job, read in (
        (create, files),
        (write_manifest, files),
        (fit, posteriors),
        (write_report, files),
    ):
        job(prepared())  # compile in the parent: the child then needs the same time each time
        folder = prepared()
        start = time.monotonic()
        os.waitpid(in_child(job, folder), 0)
        duration, undisturbed = time.monotonic() - start, read(folder)
        killed = ended = unfinished = different = 0
        while killed < args.kills:
            folder = prepared()
            child = in_child(job, folder)
            time.sleep(rng.uniform() * duration)
            os.kill(child, signal.SIGKILL)
            _, status = os.waitpid(child, 0)
            killed, ended = killed + os.WIFSIGNALED(status), ended + os.WIFEXITED(status)
            unfinished += len([*folder.rglob(f"*{atomic.UNFINISHED}")])
            page = (folder / "report.html").read_text(encoding="utf-8")
            complete = page in (OLD_PAGE, undisturbed.get("report.html", b"").decode())
            job(folder)
            different += not (complete and same(read(folder), undisturbed))
        print(f"{job.__name__:16}{killed:8}{ended:14}{unfinished:18}{different:11}", flush=True)
        failed += different
    return int(failed > 0)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    sys.exit(main())
