"""Check that the test with the largest expected information classifies new specimens best.

python ranked_designs.py --new 200 --out results/ranked_designs.csv

Two classes of Ogden's law are fitted to eight specimens each, inflated once. Designs are ranked by
``expected_information``. New specimens are then tested in every design and classified. The table
compares the expected and observed differences of the log scores.
"""

import argparse
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.natural_scale import NaturalScale

options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
options.add_argument("--new", type=int, default=200, help="new specimens (%(default)s)")
options.add_argument("--train", type=int, default=8, help="of each group (%(default)s)")
options.add_argument("--seed", type=int, default=1)
options.add_argument("--out", type=Path, default=Path("results/ranked_designs.csv"))
args = options.parse_args()

LAW = ph.Ogden()
TUBE = {"inner_radius": 7.0, "outer_radius": 9.0}
ROOT = np.diag([0.3, 0.25]) @ np.linalg.cholesky([[1.0, -0.4], [-0.4, 1.0]])
PLACES = {"a": np.array([-1.8, 1.6]), "b": np.array([-1.8, 2.0])}
NOISE = 0.3  # kPa
SCALE = NaturalScale(LAW)
DESIGNS = {
    "few, low": {"pressure": (1.0, 4.0), "points": 5},
    "one, middle": {"pressure": 8.0, "points": 1},
    "many, high": {"pressure": (12.0, 16.0), "points": 20},
    "many, all": {"pressure": (1.0, 16.0), "points": 20},
}
rng = np.random.default_rng(args.seed)


def specimens(count: int, name: str, design: dict) -> tuple[dict[str, xr.Dataset], np.ndarray]:
    """Return specimens of a group, tested in one design, and their coordinates."""
    x = PLACES[name][:, None] + ROOT @ rng.standard_normal((2, count))
    return tested(x, name, design), x


def tested(x: np.ndarray, prefix: str, design: dict) -> xr.Dataset:
    """Return materials (coordinate, specimen), tested in a design with errors."""
    values = {n: (("chain", "draw"), v[None]) for n, v in SCALE.numbers([*x]).items()}
    tree = xr.DataTree.from_dict({"posterior": xr.Dataset(values)})
    ends = np.atleast_1d(design["pressure"])
    pressure = np.linspace(ends[0], ends[-1], design["points"])
    at = ph.Conditions(pressure, tube=ph.Tube(**TUBE))
    radius = ph.radius_at_pressure(tree, at, energy=LAW)["radius"].values[0]
    frame = pd.DataFrame(
        {
            "specimen": np.repeat([f"{prefix}{i}" for i in range(x.shape[1])], len(pressure)),
            "experiment": 1,
            "radius": radius.ravel(),
            "pressure": np.tile(pressure, x.shape[1]) + NOISE * rng.standard_normal(radius.size),
        }
    )
    return ph.inflation_data(frame[np.isfinite(radius).ravel()], ph.Tube(**TUBE), check="ignore")


def main() -> None:
    warnings.filterwarnings("ignore", message=".*(lack|reach|cannot bear it)")
    args.out.parent.mkdir(parents=True, exist_ok=True)
    settings = {"random_seed": args.seed, "progressbar": False}
    groups = {name: specimens(args.train, name, DESIGNS["many, all"])[0] for name in PLACES}
    classes = ph.fit_classes(
        LAW, groups, NOISE, variability="specimen", draws=2000, chains=2, **settings
    )
    planned = ph.expected_information(classes, DESIGNS, specimens=400, random_seed=args.seed)
    first = planned["design"].values[0]
    new = {name: specimens(args.new // 2, name, DESIGNS["many, all"])[1] for name in PLACES}
    scores = {}
    for design, test in DESIGNS.items():
        of_design = []
        for name, x in new.items():
            result = ph.classify(tested(x, f"new {name}", test), classes, by="specimen", **settings)
            evidence = result["log_evidence"].sel(class_label=name)
            both = np.logaddexp.reduce(result["log_evidence"].values, axis=1)
            of_design.append(evidence.values - both + np.log(2))
        scores[design] = np.concatenate(of_design)
    rows = []
    for design, values in scores.items():
        expected = planned.sel(design=design)
        less = values - scores[first]
        rows.append(
            {
                "design": design,
                "expected": expected["information"].item(),
                "error": expected["information_se"].item(),
                "found": values.mean(),
                "its error": values.std(ddof=1) / np.sqrt(len(values)),
                "difference expected": expected["difference"].item(),
                "of error": expected["difference_se"].item(),
                "difference found": less.mean(),
                "of its error": less.std(ddof=1) / np.sqrt(len(values)),
            }
        )
    table = pd.DataFrame(rows).sort_values("expected", ascending=False)
    table.to_csv(args.out, index=False)
    pd.options.display.width = 200
    print(table.round(3).to_string(index=False))
    others = table[table["design"] != first]
    more = -others[["difference expected", "difference found"]].mean()
    print("\nMore than one of the others at random:", *(f"{v:.3f} nats" for v in more))


if __name__ == "__main__":
    main()
