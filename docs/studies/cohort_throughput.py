"""Measure the speed and memory of classifying a cohort, and the time to open its store.

python cohort_throughput.py --specimens 10000 --kind pooled --out results/cohort

The study classifies specimens of Ogden's law, with one curve of 20 points each, with two classes,
using one process and then two. It prints times and sizes, and writes them to a table. A run that
was interrupted continues, but then has no time. docs/guides/cluster.md shows the table.
"""

import argparse
import resource
import time
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.natural_scale import NaturalScale

options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
options.add_argument("--specimens", type=int, default=10_000, help="of them (%(default)s)")
options.add_argument("--kind", choices=["pooled", "variable"], default="pooled")
options.add_argument("--cores", type=int, nargs="+", default=[1, 2])
options.add_argument("--batch-size", type=int, default=64)
options.add_argument("--out", type=Path, default=Path("results/cohort"))
args = options.parse_args()

LAW = ph.Ogden()
TUBE = {"inner_radius": 7.0, "outer_radius": 9.0}
PRESSURE, NOISE = np.linspace(1.0, 16.0, 20), 0.3  # kPa
GROUPS = {"soft": (-1.6, 1.6), "stiff": (-1.8, 1.7)}
SPREAD = np.array([0.3, 0.25])
SCALE = NaturalScale(LAW)
AT_ONCE = 2000


def cohort(count: int, rng: np.random.Generator, prefix: str) -> xr.Dataset:
    """Return specimens of both groups in turn, measured with errors."""
    names = list(GROUPS)
    frames = []
    for first in range(0, count, AT_ONCE):
        number = np.arange(first, min(first + AT_ONCE, count))
        radius = np.full((len(number), len(PRESSURE)), np.nan)
        # One of several hundred specimens has no radius at the highest pressure: draw it again.
        while (lacking := np.isnan(radius).any(axis=1)).any():
            location = np.array([GROUPS[names[i % 2]] for i in number[lacking]]).T
            x = location + SPREAD[:, None] * rng.standard_normal(location.shape)
            values = {n: (("chain", "draw"), v[None]) for n, v in SCALE.numbers([*x]).items()}
            tree = xr.DataTree.from_dict({"posterior": xr.Dataset(values)})
            at = ph.Conditions(PRESSURE, tube=ph.Tube(**TUBE))
            found = ph.radius_at_pressure(tree, at, energy=LAW, check="ignore")
            radius[lacking] = found["radius"].values[0]
        frame = pd.DataFrame({"specimen": np.repeat([f"{prefix}{i}" for i in number], 20)})
        frame["experiment"] = 1
        frame["group"] = np.repeat([names[i % 2] for i in number], 20)
        frame["radius"] = radius.ravel()
        errors = NOISE * rng.standard_normal(radius.size)
        frame["pressure"] = np.tile(PRESSURE, len(number)) + errors
        frames.append(frame)
    return ph.inflation_data(pd.concat(frames), ph.Tube(**TUBE), check="ignore")


def megabytes(who: int) -> float:
    return resource.getrusage(who).ru_maxrss / 1024


def main() -> None:
    rng = np.random.default_rng(1)
    training = cohort(16, rng, "T")
    classes = ph.fit_classes(
        LAW,
        {name: ph.select(training, group=name) for name in GROUPS},
        ph.Gaussian(pressure_sd=NOISE),
        variability="specimen" if args.kind == "variable" else None,
        draws=1000,
        chains=2,
        random_seed=1,
        progressbar=False,
    )
    data = cohort(args.specimens, rng, "N")
    rows, results = [], []
    for cores in args.cores:
        store = args.out / f"{args.kind}-{cores}"
        fresh = not store.exists()
        start = time.perf_counter()
        computed = ph.Store(store, cores=cores, batch_size=args.batch_size)
        ph.classify(data, classes, by="specimen", store=computed, random_seed=1)
        seconds = time.perf_counter() - start
        size = sum(path.stat().st_size for path in store.iterdir())
        start = time.perf_counter()
        opened = ph.open_result(store)
        opening = time.perf_counter() - start
        start = time.perf_counter()
        opened["class_probability"].isel(specimen=args.specimens // 2).load()
        reading = time.perf_counter() - start
        rows.append(
            {
                "kind": args.kind,
                "specimens": args.specimens,
                "cores": cores,
                "seconds": seconds if fresh else np.nan,
                "per second": args.specimens / seconds if fresh else np.nan,
                "opens in s": opening,
                "reads one in s": reading,
                "files": len(list(store.iterdir())),
                "megabytes": size / 1e6,
                "memory here, MB": megabytes(resource.RUSAGE_SELF),
                "memory of a worker, MB": megabytes(resource.RUSAGE_CHILDREN),
            }
        )
        results.append(opened.load())
    table = pd.DataFrame(rows)
    print(table.T.to_string())
    table.to_csv(args.out / f"{args.kind}.csv", index=False)
    print(f"the same numbers: {all(result.identical(results[0]) for result in results)}")


if __name__ == "__main__":
    args.out.mkdir(parents=True, exist_ok=True)
    main()
