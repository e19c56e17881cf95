"""
Classify the experiments of a CSV file
======================================

The study of the other examples for data of your own: classes are fitted to the rows marked
``train``, and the experiments in the rows marked ``new`` are classified. Run it as
``python classify_csv.py curves.csv --sigma 15 --pressure-unit mmHg``; ``--help`` says what the file
must hold.

By default all specimens of a class share one set of parameters, as in the paper, and the
probabilities are over-confident where specimens differ. ``--variability specimen`` gives each its
own, and ``--undecided-below`` and ``--none-below`` allow for answers beyond a forced choice.
"""

import argparse
import re
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pint
import pymc as pm
import xarray as xr

import pymc_hyperelastic as ph

FORMAT = """\
format of the CSV file: one row a measured point, one column each for
  group           class of the specimen; may be empty in rows that are new
  specimen        name of the specimen
  experiment      name or number of the inflation experiment on it
  split           'train', or 'new' for what is to be classified
  radius          current internal radius; or in its place
  outer_diameter  current outer diameter
  pressure        pressure
  inner_radius    internal radius of the tube without load, see --radii-of
  outer_radius    external radius of the tube without load, see --radii-of
  axial_stretch   optional: stretched over unstretched length (1 when missing)
  opening_angle   optional: opening angle of the cut ring (0 when missing); then say which angle,
                  --opening-angle-convention, and of what the radii are, --radii-of
  cycle           optional: number of the cycle; the last one of an experiment counts
  phase           optional: loading or unloading; the rows of loading count
Other columns are ignored. The rows of an experiment stand in the order of inflation; the four
columns of the tube do not change within it. Decimal points, no units: give these as options.
"""
GEOMETRY = ["inner_radius", "outer_radius", "axial_stretch", "opening_angle"]
LABELS = ["group", "specimen", "experiment", "split"]
LAWS = ph.list_strain_energies()
POOLED = (
    "All specimens of a class share one set of parameters here: where specimens differ, these\n"
    "probabilities are surer than they may be. --variability specimen gives each its own."
)


def read(path: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Training rows and new rows, numbered as the lines of the file."""
    frame = pd.read_csv(path, skipinitialspace=True)
    frame.index = range(2, len(frame) + 2)  # the first line holds the names
    measured = "outer_diameter" if "outer_diameter" in frame else "radius"
    needed = [*LABELS, measured, "pressure", *GEOMETRY[:2]]
    missing = [name for name in needed if name not in frame]
    if missing:
        raise ValueError(f"{path} has no column {', '.join(missing)}; see --help for the format")
    wrong = frame[~frame["split"].isin(["train", "new"])]
    if len(wrong):
        raise ValueError(
            f"line {wrong.index[0]}: split is {wrong['split'].iloc[0]!r}; expected 'train' or 'new'"
        )
    train, new = (frame[frame["split"] == kind] for kind in ("train", "new"))
    if train.empty or new.empty:
        raise ValueError(
            f"{path} needs rows of both splits; {len(train)} train, {len(new)} are new"
        )
    return train, new.fillna({"group": "unknown"})


def main() -> None:
    """Fit, classify, print and store."""
    options = argparse.ArgumentParser(
        description=__doc__.strip().splitlines()[0],
        epilog=FORMAT,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = options.add_argument
    add("csv", type=Path, help="the file, see below")
    add(
        "--sigma",
        type=float,
        required=True,
        help="σ, √2 standard deviations, in pressure units; with --variability specimen roughly, "
        "give or take a factor of ten: then it is inferred",
    )
    add(
        "--slope-weight",
        type=float,
        help="β in mm² (balanced when missing; 0: no slopes, as with --variability specimen)",
    )
    add("--law", choices=LAWS, default="Ogden", help="strain energy (%(default)s)")
    add(
        "--by",
        choices=["test", "specimen"],
        default="test",
        help="what is classified: each experiment by itself, or a specimen by all of its "
        "experiments (%(default)s)",
    )
    add(
        "--variability",
        choices=["none", "specimen"],
        default="none",
        help="whether specimens of a class differ (%(default)s)",
    )
    add(
        "--experiment-effect",
        action="store_true",
        help="experiments on a specimen differ by more than noise, as at several axial stretches; "
        "takes minutes",
    )
    add("--undecided-below", type=float, default=0.0, help="least probability for a decision")
    add(
        "--none-below",
        type=float,
        default=0.0,
        help="p-value below which a specimen is of no class; with --variability specimen",
    )
    add("--radius-unit", default="mm", help="of all radii and diameters (%(default)s)")
    add("--pressure-unit", default="kPa", help="such as kPa or mmHg (%(default)s)")
    add("--angle-unit", default="rad", help="rad or deg (%(default)s)")
    add(
        "--opening-angle-convention",
        choices=["whole", "fung"],
        help="whole: what the opened sector lacks of a full circle; fung: half of that, the angle "
        "between the lines from the middle of its inner side to its two ends",
    )
    add(
        "--radii-of",
        choices=["sector", "ring"],
        help="of what inner and outer radius are: the closed unloaded ring, or the sector to which "
        "it springs open when cut",
    )
    add("--simulated", action="store_true", help="the data are simulated; figures will say so")
    add("--draws", type=int, default=2000, help="particles of a chain (%(default)s)")
    add("--chains", type=int, default=4, help="independent runs (%(default)s)")
    add("--seed", type=int, default=1, help="the same seed gives the same numbers (%(default)s)")
    add("--out", type=Path, default=Path("results/csv"), help="folder of the results (%(default)s)")
    add("--quiet", action="store_true", help="show no progress bars")
    args = options.parse_args()
    try:
        study(args)
    except (OSError, TypeError, ValueError) as error:
        sys.exit(f"error: {_by_options(str(error))}")


def _by_options(message: str) -> str:
    """The message, with settings of the package written as options of this script."""
    names = "|".join(["slope_weight", "pressure_unit", "radius_unit", "angle_unit", "none_below"])
    names += "|opening_angle_convention|radii_of"
    return re.sub(
        rf"\b({names})=[\"']?([\w.]+)[\"']?",
        lambda found: f"--{found[1].replace('_', '-')} {found[2]}",
        message,
    )


def study(args: argparse.Namespace) -> None:
    """Do what the options ask for."""
    frames = read(args.csv)
    given = {name: name for name in GEOMETRY if name in frames[0]}
    said = ("radius_unit", "pressure_unit", "angle_unit", "opening_angle_convention", "radii_of")
    meant = {name: vars(args)[name] for name in said}
    meant["measured"] = "outer_diameter" if "outer_diameter" in frames[0] else "radius"
    attrs = {"title": args.csv.name, "simulated": int(args.simulated)}
    train, new = (
        ph.inflation_data(frame, **given, **meant).assign_attrs(attrs) for frame in frames
    )
    if "phase" in train.coords:
        train, new = (ph.select(data, phase="loading") for data in (train, new))
    groups = dict.fromkeys(train["group"].values.tolist())
    training = {name: ph.select(train, group=name) for name in groups}
    pooled = args.variability == "none"
    if args.slope_weight is None:
        args.slope_weight = ph.balanced_slope_weight(train) if pooled else 0.0
    if not args.sigma > 0:
        raise ValueError(f"--sigma is {args.sigma:g}; expected a positive number")
    sigma = pint.UnitRegistry().Quantity(args.sigma, args.pressure_unit).m_as("kPa")
    classes = ph.fit_classes(
        ph.StrainEnergy.from_name(args.law),
        training,
        sigma=sigma if pooled else pm.LogNormal.dist(np.log(sigma), np.log(10) / 2),
        slope_weight=args.slope_weight,
        variability=args.variability,
        experiment_effect=args.experiment_effect,
        draws=args.draws,
        chains=args.chains,
        random_seed=args.seed,
        progressbar=not args.quiet,
    )
    args.out.mkdir(parents=True, exist_ok=True)
    classes.to_netcdf(args.out / "classes.nc")
    limits = {"undecided_below": args.undecided_below, "none_below": args.none_below}
    settings = {"by": args.by, "random_seed": args.seed, "progressbar": not args.quiet}
    result = ph.classify(new, classes, **settings, **limits)
    result.to_netcdf(args.out / "class_probability.nc")
    report(args, train, classes, result)


def report(
    args: argparse.Namespace, train: xr.Dataset, classes: xr.DataTree, result: xr.Dataset
) -> None:
    """Print and draw what was found."""
    noise = f"σ = {args.sigma:g} {args.pressure_unit}, β = {args.slope_weight:.3g} mm²"
    print(f"\n{args.law}, {classes.attrs.get('noise_in_words', noise)}")
    for name, fitted in classes.children.items():
        print(f"log evidence of {name}: {ph.log_evidence(fitted)}")
    numbers = ["class_probability", "class_probability_se", "p_value", "decision"]
    numbers = [name for name in numbers if name in result]
    table = result[numbers].to_dataframe().reset_index()
    labels = [name for name in ("specimen", "experiment", "group") if name in table]
    table = table[[*labels, "class_label", *numbers]].sort_values([*labels[:2], "class_label"])
    print(f"\n{table.to_string(index=False, float_format='{:.4f}'.format)}")
    table.to_csv(args.out / "class_probability.csv", index=False)
    if args.variability == "none":
        print(f"\n{POOLED}")

    unit = {"pressure_unit": args.pressure_unit}
    ph.plot_inflation(train, **unit).savefig(args.out / "training.png", dpi=150)
    ph.plot_pressure_fit(classes, **unit).savefig(args.out / "fit.png", dpi=150)
    ph.plot_parameter_density(classes).savefig(args.out / "parameters.png", dpi=150)
    ph.plot_class_probability(result).savefig(args.out / "class_probability.png", dpi=150)
    print(f"\nFigures, a table and netCDF files are in {args.out}/")


if __name__ == "__main__":
    main()
