"""Compare the results that plan_study predicts with the results of simulated studies.

python planned_studies.py --studies 100 --out results/planned_studies.csv

A pilot of two groups of Ogden's law, five specimens each, is fitted. Studies are then simulated,
specimen by specimen and curve by curve, with true distributions drawn from the posterior of the
pilot. Each study is fitted and compared by ``compare_classes``. The table shows planned and
observed results. Finished studies are stored, and an interrupted run continues.
"""

import argparse
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from scipy import stats

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.class_distribution import distributions_of
from pymc_hyperelastic.models.natural_scale import NaturalScale

options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
options.add_argument("--studies", type=int, default=100, help="of each size (%(default)s)")
options.add_argument("--sizes", type=int, nargs="+", default=[6, 12], help="(%(default)s)")
options.add_argument("--out", type=Path, default=Path("results/planned_studies.csv"))
args = options.parse_args()

LAW = ph.Ogden()
TUBE = {"inner_radius": 7.0, "outer_radius": 9.0}
SPREAD, CORRELATION = np.array([0.3, 0.25]), -0.4
ROOT = np.diag(SPREAD) @ np.linalg.cholesky([[1.0, CORRELATION], [CORRELATION, 1.0]])
PLACES = {"a": np.array([-1.8, 1.7]), "b": np.array([-2.0, 1.85])}
PRESSURE, NOISE = np.linspace(1.0, 16.0, 20), 0.3  # kPa
AT, PILOT = 13.0, 5
SCALE = NaturalScale(LAW)
NAMES = ["log_alpha", "log compliance"]
SETTINGS = {"likelihood": NOISE, "variability": "specimen", "chains": 1, "progressbar": False}


def specimens(rng: np.random.Generator, x: np.ndarray, name: str) -> xr.Dataset:
    """Return a group of specimens with coordinates (coordinate, specimen), measured with errors."""
    values = {n: (("chain", "draw"), v[None]) for n, v in SCALE.numbers([*x]).items()}
    tree = xr.DataTree.from_dict({"posterior": xr.Dataset(values)})
    at = ph.Conditions(PRESSURE, tube=ph.Tube(**TUBE))
    radius = ph.radius_at_pressure(tree, at, energy=LAW)["radius"].values[0]
    # A wall is inflated only to the pressures that it bears.
    reached = np.isfinite(radius)
    frame = pd.DataFrame(
        {
            "specimen": np.repeat([f"{name}{i}" for i in range(x.shape[1])], len(PRESSURE)),
            "experiment": 1,
            "radius": radius.ravel(),
            "pressure": np.tile(PRESSURE, x.shape[1]) + NOISE * rng.standard_normal(radius.size),
        }
    )[reached.ravel()]
    return ph.inflation_data(frame, ph.Tube(**TUBE), check="ignore")


def fitted(groups: dict[str, xr.Dataset], seed: int) -> xr.DataTree:
    return ph.fit_classes(LAW, groups, draws=2000, random_seed=seed, **SETTINGS)


def study(pilot: xr.DataTree, number: int, size: int) -> list[dict[str, float]]:
    rng = np.random.default_rng([number, size])
    groups = {}
    for name, tree in pilot.children.items():
        known = distributions_of(tree)
        one = known.at(rng.integers(len(known.location[0]), size=1))
        root = np.linalg.cholesky(one.covariance()[0])
        x = np.asarray(one.location)[:, :, 0] + root @ rng.standard_normal((2, size))
        groups[str(name)] = specimens(rng, x, str(name))
    result = ph.compare_classes(
        fitted(groups, number),
        NAMES,
        at=AT,
        specimens=4,
        effect_prior=None,
        random_seed=number,
    )
    typical = result.sel(statistic="typical").squeeze("comparison")
    return [
        {"study": number, "specimens": size, "quantity": name, "low": low, "high": high}
        for name, (low, high) in zip(NAMES, typical["difference_interval"].values, strict=True)
    ]


def main() -> None:
    args.out.parent.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(1)
    groups = {
        name: specimens(rng, place[:, None] + ROOT @ rng.standard_normal((2, PILOT)), name)
        for name, place in PLACES.items()
    }
    pilot = fitted(groups, 1)
    plan = ph.plan_study(pilot, NAMES, args.sizes, at=AT, studies=400, random_seed=1)
    rows = pd.read_csv(args.out).to_dict("records") if args.out.exists() else []
    done = {(row["study"], row["specimens"]) for row in rows}
    for number in range(args.studies):
        for size in args.sizes:
            if (number, size) in done:
                continue
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", message=".*(lack|no log compliance|reach)")
                rows += study(pilot, number, size)
            pd.DataFrame(rows).to_csv(args.out, index=False)
    table = pd.DataFrame(rows)
    table["width"] = table["high"] - table["low"]
    table["decided"] = (table["low"] > 0) | (table["high"] < 0)
    lines = []
    for (name, size), own in table.groupby(["quantity", "specimens"]):
        planned = plan.sel(quantity=name, specimens=size).squeeze("comparison")
        # The error of the median is computed by the bootstrap.
        median = stats.bootstrap((own["width"].to_numpy(),), np.median, rng=rng)
        lines.append(
            {
                "quantity": name,
                "specimens": size,
                "studies": len(own),
                "width": own["width"].median(),
                "its error": median.standard_error,
                "planned": planned["width"].item(),
                "error of plan": planned["width_se"].item(),
                "decided": own["decided"].mean(),
                "decided, planned": planned["decided"].item(),
            }
        )
    print(pd.DataFrame(lines).round(3).to_string(index=False))


if __name__ == "__main__":
    main()
