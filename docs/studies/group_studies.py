"""Simulate studies of two groups: coverage of intervals, and calibration of Bayes factors.

python group_studies.py --studies 300 --out results/group_studies.csv

Each group has six specimens of Ogden's law, inflated once. Half of the studies have no difference.
In the others the groups differ by 0.5 or 1 spread, in a random direction of the two coordinates.
Spreads and correlation are the same in all studies and groups, and smaller than the prior expects.
With ``--spreads prior`` they are drawn from the prior for each group, as in the model. Each study
is fitted, and the groups are compared by the logarithm of the compliance. For comparison, the
program prints the coverage of intervals for normal values without measurement errors, with the same
prior of their spread. Finished studies are stored, and an interrupted run continues.
"""

import argparse
import time
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from scipy import stats
from scipy.special import softmax

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.natural_scale import NaturalScale

options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
options.add_argument("--studies", type=int, default=300, help="of them (%(default)s)")
options.add_argument("--first", type=int, default=0, help="number of the first (%(default)s)")
options.add_argument("--specimens", type=int, default=6, help="of a group (%(default)s)")
options.add_argument("--spreads", choices=["fixed", "prior"], default="fixed")
options.add_argument("--out", type=Path, default=Path("results/group_studies.csv"))
args = options.parse_args()

LAW = ph.Ogden()
TUBE = {"inner_radius": 7.0, "outer_radius": 9.0}
LOCATION, SPREAD, CORRELATION = np.array([-1.8, 1.7]), np.array([0.3, 0.25]), -0.4
PRESSURE, NOISE = np.linspace(1.0, 16.0, 20), 0.3  # kPa
FEWEST = 5  # points of a specimen
# The pressure (kPa) of the compliance: lower for large spreads, because typical specimens may then
# be very soft.
AT = 13.0 if args.spreads == "fixed" else 6.0
DISTANCES = [0.0, 0.5, 0.0, 1.0]
SCALE = NaturalScale(LAW)


class BearsNothingError(ValueError):
    """Raised for a tube that bears no pressure."""


def tree_of(x: np.ndarray) -> xr.DataTree:
    """Return materials (coordinate, draw) as a result with a posterior."""
    values = {n: (("chain", "draw"), v[None]) for n, v in SCALE.numbers([*x]).items()}
    return xr.DataTree.from_dict({"posterior": xr.Dataset(values)})


def log_compliance(x: np.ndarray) -> np.ndarray:
    at = ph.Conditions(AT, tube=ph.Tube(**TUBE))
    found = ph.tube_properties(tree_of(x), at, energy=LAW)
    return np.log(found["compliance"].values.ravel())


def covariances(rng: np.random.Generator) -> list[np.ndarray]:
    """Return the covariance between specimens of each group."""
    found = []
    for _ in range(2):
        spread, correlation = SPREAD, CORRELATION
        if args.spreads == "prior":
            spread, correlation = rng.lognormal(*SCALE.spread_prior, 2), 2 * rng.beta(2, 2) - 1
        found.append(np.outer(spread, spread) * [[1.0, correlation], [correlation, 1.0]])
    return found


def coverage_of_normal_values(rng: np.random.Generator, studies: int = 4000) -> float:
    """Return the fraction of 95 % intervals that contain the true difference of means.

    Groups are normal values without errors. The prior of each spread is that of a class; the
    posterior is computed on a grid of spreads.
    """
    (middle, *_), sd_of_logs = SCALE.spread_prior
    logs = np.linspace(middle - 5 * sd_of_logs, middle + 5 * sd_of_logs, 200)
    inside = 0
    for _ in range(studies):
        means = []
        for _ in range(2):
            spread = SPREAD.mean()
            if args.spreads == "prior":
                spread = rng.lognormal(middle, sd_of_logs)
            x = spread * rng.standard_normal(args.specimens)
            squares = args.specimens * x.var() * np.exp(-2 * logs)
            weight = stats.norm.logpdf(logs, middle, sd_of_logs)
            weight = softmax(weight - (args.specimens - 1) * logs - squares / 2)
            errors = np.exp(rng.choice(logs, 2000, p=weight)) * rng.standard_normal(2000)
            means.append(x.mean() + errors / np.sqrt(args.specimens))
        low, high = np.quantile(means[1] - means[0], [0.025, 0.975])
        inside += low < 0 < high
    return inside / studies


def inflated(material: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the radii of a specimen at the pressures that it bears; soft ones get smaller steps.

    No soft specimen is left out, because this would change the distribution of the group.
    """
    for halvings in range(20):
        pressure = PRESSURE / 2**halvings
        try:
            at = ph.Conditions(pressure, tube=ph.Tube(**TUBE))
            found = ph.radius_at_pressure(tree_of(material[:, None]), at, energy=LAW)
            radius = found["radius"].values.ravel()
        except ValueError:  # the specimen bears none of these pressures
            radius = np.full(len(pressure), np.nan)
        if np.isfinite(radius).sum() >= FEWEST:
            return radius, pressure
    raise BearsNothingError(f"a tube of {material} bears no pressure")


def specimens(
    rng: np.random.Generator, location: np.ndarray, root: np.ndarray, name: str
) -> xr.Dataset:
    """Return the specimens of a group, measured with errors."""
    x = location[:, None] + root @ rng.standard_normal((2, args.specimens))
    errors = NOISE * rng.standard_normal((args.specimens, len(PRESSURE)))
    rows = []
    for i, (material, error) in enumerate(zip(x.T, errors, strict=True)):
        radius, pressure = inflated(material)
        labels = {"specimen": f"{name}{i}", "experiment": 1}
        rows.append(pd.DataFrame(labels | {"radius": radius, "pressure": pressure + error}))
    frame = pd.concat(rows).dropna()
    return ph.inflation_data(frame, ph.Tube(**TUBE), check="ignore")


def study(number: int) -> dict[str, float]:
    rng = np.random.default_rng([number, args.specimens])
    distance = DISTANCES[number % len(DISTANCES)]
    way = rng.standard_normal(2)
    both = covariances(rng)
    step = distance * np.linalg.cholesky(sum(both) / 2) @ (way / np.linalg.norm(way))
    ends = [LOCATION - step / 2, LOCATION + step / 2]
    groups = {
        name: specimens(rng, end, np.linalg.cholesky(covariance), name)
        for name, end, covariance in zip("ab", ends, both, strict=True)
    }
    settings = {"random_seed": number, "draws": 2000}
    classes = ph.fit_classes(
        LAW, groups, NOISE, variability="specimen", chains=1, progressbar=False, **settings
    )
    result = ph.compare_classes(classes, "log compliance", at=AT, specimens=4, **settings).squeeze()
    typical = result.sel(statistic="typical")
    low, high = typical["difference_interval"].values
    first, second = log_compliance(np.stack(ends, axis=1))
    return {
        "study": number,
        "distance": distance,
        "spread": float(np.sqrt([np.diag(covariance) for covariance in both]).mean()),
        "truth": second - first,
        "difference": float(typical["difference"]),
        "low": low,
        "high": high,
        "log_bayes_factor": float(result["log_bayes_factor"]),
        "log_bayes_factor_se": float(result["log_bayes_factor_se"]),
    }


def report(table: pd.DataFrame) -> None:
    # A typical specimen that does not bear this pressure has no compliance there.
    table = table.dropna(subset="truth")
    inside = table["truth"].between(table["low"], table["high"])
    print("\nShare of 95 % intervals that hold the truth, by distance in spreads")
    print(inside.groupby(table["distance"]).agg(["size", "mean"]).round(3).to_string())
    low, high = stats.binomtest(int(inside.sum()), len(inside)).proportion_ci()
    print(f"all: {inside.mean():.3f} ({low:.3f} to {high:.3f} from {len(inside)} studies)")
    known = coverage_of_normal_values(np.random.default_rng(1))
    print(f"of normal values without errors: {known:.3f}")
    if args.spreads == "prior":
        typical = np.exp(SCALE.spread_prior[0]).mean()
        print(inside.groupby(table["spread"] > typical).agg(["size", "sum"]).to_string())
        return  # all these groups differ, by their spreads
    chance = 1 / (1 + np.exp(-table["log_bayes_factor"]))
    bins = pd.cut(chance, [0, 0.1, 0.3, 0.5, 0.7, 0.9, 1])
    differ = table["distance"] > 0
    print("\nProbability of a difference, and the share of studies that have one")
    found = pd.DataFrame({"stated": chance, "true": differ}).groupby(bins, observed=True)
    print(
        found.agg(size=("true", "size"), stated=("stated", "mean"), true=("true", "mean")).round(3)
    )


def main() -> None:
    args.out.parent.mkdir(parents=True, exist_ok=True)
    known = pd.read_csv(args.out) if args.out.exists() else pd.DataFrame({"study": []})
    for number in range(args.first, args.first + args.studies):
        if number in set(known["study"]):
            continue
        start = time.perf_counter()
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=".*(lack|no log compliance|reach)")
            try:
                row = study(number)
            except BearsNothingError as error:
                print(f"{number} is left out: {error}")
                row = {"study": number}
        known = pd.concat([known, pd.DataFrame([row])], ignore_index=True)
        known.to_csv(args.out, index=False)
        print(f"{number}: {time.perf_counter() - start:.1f} s", flush=True)
    report(known)


if __name__ == "__main__":
    main()
