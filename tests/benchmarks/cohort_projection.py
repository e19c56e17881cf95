"""What a million specimens would take on a hundred workers, from parts that are measured here.

python cohort_projection.py --per-second 60 --bytes 700

The work of a specimen, and what the store needs for one, come from cohort_throughput.py. Measured
here is what happens once for a batch, one after another: in the process that asks, of a million
specimens of 20 points, and at the scheduler of a cluster of this machine, for batches in which
there is nearly nothing to do. A worker writes the part of a batch; that is measured as well.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import cloudpickle
import numpy as np
import pandas as pd
import xarray as xr

sys.path.insert(0, str(Path(__file__).parents[1] / "cohorts"))

from chores import Chore, cohort

import pymc_hyperelastic as ph
from pymc_hyperelastic.cohorts.run import run_cohort
from pymc_hyperelastic.data.select import tests_of_many, units_of
from pymc_hyperelastic.files.results import save_result

options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
options.add_argument("--specimens", type=int, default=1_000_000)
options.add_argument("--workers", type=int, default=100)
options.add_argument("--per-second", type=float, default=60.0, help="of a core (%(default)s)")
options.add_argument("--bytes", type=float, default=700.0, help="of the store (%(default)s)")
options.add_argument("--start", type=float, default=20.0, help="s until a worker is compiled")
options.add_argument("--batches", type=int, default=400, help="that are timed (%(default)s)")
args = options.parse_args()

POINTS, SIZES = 20, (64, 512)


def registry(count: int) -> xr.Dataset:
    """So many specimens with one test each."""
    rng = np.random.default_rng(1)
    of_points = {name: ("obs", rng.random(POINTS * count)) for name in ("radius", "pressure")}
    measures = ("inner_radius", "outer_radius", "axial_stretch", "opening_angle")
    names = [f"N{i}" for i in range(count)]
    return xr.Dataset(
        of_points | {name: ("test", np.ones(count)) for name in measures},
        {
            "test": ("obs", np.repeat(np.arange(count), POINTS)),
            "row": ("obs", np.arange(POINTS * count)),
            "specimen": ("test", names),
            "experiment": ("test", np.ones(count, int)),
            "group": ("test", names),
        },
    )


def seconds_of(call, times: int) -> float:
    start = time.perf_counter()
    for i in range(times):
        call(i)
    return (time.perf_counter() - start) / times


def asking(data: xr.Dataset, size: int) -> float:
    """Seconds by which a batch is made, and made ready to be sent."""
    starts = np.random.default_rng(2).integers(args.specimens - size, size=args.batches)
    return seconds_of(
        lambda i: cloudpickle.dumps(tests_of_many(data, starts[i] + np.arange(size))), args.batches
    )


def at_the_cluster(folder: Path) -> float:
    """Seconds of a batch of one specimen, whose work is nothing, on two workers."""
    import distributed

    data = cohort(args.batches)
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        settings = {"client": client, "batch_size": 1, "progressbar": False}
        run_cohort(Chore(), cohort(), folder / "first", **settings)
        start = time.perf_counter()
        run_cohort(Chore(), data, folder / "store", **settings)
        return (time.perf_counter() - start) / args.batches


def main() -> None:
    rows = {}
    with tempfile.TemporaryDirectory() as where:
        folder = Path(where)
        scheduler = at_the_cluster(folder)
        start = time.perf_counter()
        opened = ph.open_cohort(folder / "store")
        opening = time.perf_counter() - start
        part = xr.Dataset({"value": ("specimen", np.zeros(int(args.bytes * SIZES[0] / 8)))})
        writing = seconds_of(lambda i: save_result(part, folder / f"{i}.nc"), 50)
    start = time.perf_counter()
    data = registry(args.specimens)
    units_of(data, "specimen")
    once = time.perf_counter() - start
    print(f"a batch at the scheduler and two workers: {1e3 * scheduler:.1f} ms")
    print(f"a part of {SIZES[0]} specimens is written in {1e3 * writing:.1f} ms")
    print(f"a store of {opened.sizes['specimen']} parts opens in {opening:.2f} s")
    print(f"labels of {args.specimens} specimens: {once:.1f} s, once")
    for size in SIZES:
        batches = -(-args.specimens // size)
        each = asking(data, size)
        serial = batches * (each + scheduler)
        work = args.specimens / args.per_second / args.workers
        rows[f"batches of {size}"] = {
            "batches": batches,
            "made ready, ms each": 1e3 * each,
            "one after another, min": serial / 60,
            "work of a worker, min": work / 60,
            "all, min": (once + args.start + max(serial, work)) / 60,
            "store, GB": args.specimens * args.bytes / 1e9,
        }
    print(pd.DataFrame(rows).round(2).to_string())


if __name__ == "__main__":
    main()
