"""Count how often a right model is called doubtful, and which mistakes are found.

python misfits.py --out misfits.csv

Right models: parameters are drawn from the prior, curves are simulated with the stated noise and
fitted by the same model. Mistakes: forty studies of ten kinds, whose data or settings are wrong in
one way. Each row of the table holds the verdict of ``diagnose_evidence`` and the checks that were
not good. An interrupted run continues: rows that are in the file are not computed
again.
"""

import argparse
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pymc as pm
import xarray as xr

import pymc_hyperelastic as ph

TUBE = {"inner_radius": 7.0, "outer_radius": 9.0}  # mm, a sheep's aorta
STRETCHES = (1.2, 1.4, 1.6)  # axial stretches of the three tests of a specimen
POINTS = 15  # number of points in a test
HIGHEST = 20.0  # kPa, pressure at which a test ends
WIDEST = 1.8  # ratio to the unloaded radius at which a test of a soft tube ends
PRESSURE_SD = 0.3  # kPa, about 2 mmHg
FORCE_SD = 10.0  # mN
OFFSET_SD = 100.0  # mN, standard deviation of the zero of the force transducer
RADIUS_SD = 0.02  # mm
# Laws, each with the parameters of a typical tube.
LAWS: dict[str, tuple[ph.StrainEnergy, dict[str, float]]] = {
    "Ogden": (ph.Ogden(), {"mu": 20.0, "alpha": 6.0}),
    "Demiray": (ph.Demiray(), {"mu": 30.0, "b": 1.0}),
    "PowerLawNeoHookean": (ph.PowerLawNeoHookean(), {"mu": 25.0, "n": 2.0}),
    "HGO": (ph.HolzapfelGasserOgden(), {"c": 20.0, "k1": 10.0, "k2": 1.0, "beta": 40.0}),
}
FACTORS = (0.8, 1.0, 1.15, 1.3)  # factors of the first parameter, for the four studies of a kind
SETTINGS = {"draws": 500, "chains": 2, "progressbar": False}


class Outcome(NamedTuple):
    """A study, and the verdict on its fit."""

    kind: str
    number: int
    model: str
    verdict: str
    checks: str
    words: str


def curves(
    law: str, values: dict[str, float], rng: np.random.Generator, specimen: str = "S", **tube: Any
) -> pd.DataFrame:
    """Return the tests of a specimen at each axial stretch, with errors of pressure and force."""
    energy, tests = LAWS[law][0], []
    for number, stretch in enumerate(STRETCHES, start=1):
        known = ph.Tube(**{**TUBE, "axial_stretch": stretch, **tube})
        grid = np.linspace(known.inner_radius * stretch**-0.5, WIDEST * TUBE["inner_radius"], 400)
        with np.errstate(over="ignore", invalid="ignore"):
            pressure = ph.inflation_pressure(energy, grid, known, **values)
            pressure = pressure.eval(mode="FAST_COMPILE")
        inside = (pressure > 0) & (pressure < HIGHEST)
        if inside.sum() < POINTS:
            return pd.DataFrame()
        radius = np.linspace(*grid[inside][[0, -1]], POINTS)
        curves_of = {"pressure": ph.inflation_pressure, "axial_force": ph.axial_force}
        test = {"radius": radius}
        for name, curve in curves_of.items():
            test[name] = curve(energy, radius, known, **values).eval(mode="FAST_COMPILE")
        tests.append(pd.DataFrame(test).assign(experiment=number, axial_stretch=stretch))
    frame = pd.concat(tests, ignore_index=True).assign(specimen=specimen)
    frame["pressure"] += PRESSURE_SD * rng.standard_normal(len(frame))
    frame["axial_force"] += FORCE_SD * rng.standard_normal(len(frame))
    return frame


def data_of(frame: pd.DataFrame, **tube: float) -> xr.Dataset:
    known = ph.Tube(**{**TUBE, "axial_stretch": "axial_stretch", **tube})
    return ph.inflation_data(frame, known, check="ignore")


def from_prior(law: str, rng: np.random.Generator, **settings: Any) -> tuple[dict, pd.DataFrame]:
    """Return parameters drawn from the default prior, and their curves, if they can be measured."""
    energy = LAWS[law][0]
    while True:
        values = {p.name: rng.uniform(*p.prior_range) for p in energy.parameters}
        frame = curves(law, values, rng, **settings)
        if len(frame):
            return values, frame


# --- right models --------------------------------------------------------------------------------


def known_noise(rng: np.random.Generator, seed: int) -> xr.DataTree:
    _, frame = from_prior("Ogden", rng)
    data = data_of(frame.drop(columns="axial_force"))
    model = ph.inflation_model(ph.Ogden(), data, PRESSURE_SD)
    return ph.sample_smc(model, random_seed=seed, **SETTINGS)


def forces_with_offset(rng: np.random.Generator, seed: int) -> xr.DataTree:
    _, frame = from_prior("HGO", rng)
    frame["axial_force"] += (OFFSET_SD * rng.standard_normal(4))[frame["experiment"]]
    likelihood = ph.Gaussian(PRESSURE_SD, force_sd=FORCE_SD, force_offset_sd=OFFSET_SD)
    model = ph.inflation_model(ph.HolzapfelGasserOgden(), data_of(frame), likelihood)
    return ph.sample_smc(model, random_seed=seed, **SETTINGS)


def error_of_diameter(rng: np.random.Generator, seed: int) -> xr.DataTree:
    _, frame = from_prior("Demiray", rng)
    frame["radius"] += RADIUS_SD * rng.standard_normal(len(frame))
    likelihood = ph.Gaussian(PRESSURE_SD, diameter_sd=2 * RADIUS_SD)
    data = data_of(frame.drop(columns="axial_force"))
    model = ph.inflation_model(ph.Demiray(), data, likelihood)
    return ph.sample_smc(model, random_seed=seed, **SETTINGS)


def inferred_noise(rng: np.random.Generator, seed: int) -> xr.DataTree:
    _, frame = from_prior("PowerLawNeoHookean", rng)
    data, noise = data_of(frame.drop(columns="axial_force")), pm.HalfNormal.dist(2 * PRESSURE_SD)
    model = ph.inflation_model(ph.PowerLawNeoHookean(), data, noise)
    return ph.sample_smc(model, random_seed=seed, **SETTINGS)


def specimens_that_differ(rng: np.random.Generator, seed: int) -> xr.DataTree:
    frames = []
    for name in "ABCDE":
        typical = LAWS["Ogden"][1]
        values = {k: v * np.exp(0.2 * rng.standard_normal()) for k, v in typical.items()}
        frames.append(curves("Ogden", values, rng, name))
    data = data_of(pd.concat(frames, ignore_index=True).drop(columns="axial_force"))
    settings = SETTINGS | {"variability": "specimen", "random_seed": seed}
    return ph.fit_classes(ph.Ogden(), {"group": data}, PRESSURE_SD, **settings)["group"]


RIGHT: dict[str, Callable[[np.random.Generator, int], xr.DataTree]] = {
    "Ogden, known noise": known_noise,
    "HGO, forces with an offset": forces_with_offset,
    "Demiray, error of the diameter": error_of_diameter,
    "PowerLawNeoHookean, inferred noise": inferred_noise,
    "Ogden, five specimens that differ": specimens_that_differ,
}

# --- mistakes: each changes the data, the geometry that is stated, the law or its priors ---------


class Mistaken(NamedTuple):
    """A study with a mistake."""

    frame: pd.DataFrame
    law: str
    tube: Mapping[str, float] = MappingProxyType({})
    priors: Mapping[str, Any] = MappingProxyType({})


def wrong_law(frame: pd.DataFrame, law: str, _: dict) -> Mistaken:
    others = {"Ogden": "Demiray", "Demiray": "PowerLawNeoHookean"}
    return Mistaken(frame, others.get(law, "Ogden"))


def wrong_prior_range(frame: pd.DataFrame, law: str, values: dict) -> Mistaken:
    name, value = next(iter(values.items()))
    return Mistaken(frame, law, priors={name: pm.Uniform.dist(0, value / 2)})


def mmhg_as_kilopascal(frame: pd.DataFrame, law: str, _: dict) -> Mistaken:
    return Mistaken(frame.assign(pressure=frame["pressure"] / ph.mmHg), law)


def offset_of_pressure(frame: pd.DataFrame, law: str, _: dict) -> Mistaken:
    return Mistaken(frame.assign(pressure=frame["pressure"] + 1.5), law)  # kPa


def wrong_axial_stretch(frame: pd.DataFrame, law: str, _: dict) -> Mistaken:
    return Mistaken(frame.assign(axial_stretch=frame["axial_stretch"] - 0.15), law)


def outliers(frame: pd.DataFrame, law: str, _: dict) -> Mistaken:
    far = np.isin(np.arange(len(frame)), [7, 33])
    return Mistaken(frame.assign(pressure=frame["pressure"] + 6 * PRESSURE_SD * far), law)


def drift(frame: pd.DataFrame, law: str, _: dict) -> Mistaken:
    time = frame.groupby("experiment").cumcount() / (POINTS - 1)
    return Mistaken(frame.assign(pressure=frame["pressure"] + 1.5 * time), law)  # kPa in a test


def one_bad_test(frame: pd.DataFrame, law: str, _: dict) -> Mistaken:
    leaks = np.where(frame["experiment"] == 2, 0.9, 1.0)
    return Mistaken(frame.assign(pressure=frame["pressure"] * leaks), law)


def wrong_thickness(frame: pd.DataFrame, law: str, _: dict) -> Mistaken:
    return Mistaken(frame, law, {"outer_radius": 9.6})  # mm: a wall that is 30 % thicker


def swapped_tests(frame: pd.DataFrame, law: str, _: dict) -> Mistaken:
    stretches = {1.2: 1.4, 1.4: 1.2, 1.6: 1.6}
    return Mistaken(frame.assign(axial_stretch=frame["axial_stretch"].map(stretches)), law)


MISTAKES = (
    wrong_law,
    wrong_prior_range,
    mmhg_as_kilopascal,
    offset_of_pressure,
    wrong_axial_stretch,
    outliers,
    drift,
    one_bad_test,
    wrong_thickness,
    swapped_tests,
)


def mistaken(kind: Callable[..., Mistaken], number: int, law: str) -> xr.DataTree:
    rng = np.random.default_rng([number, MISTAKES.index(kind)])
    values = dict(LAWS[law][1])
    values[next(iter(values))] *= FACTORS[number]
    study = kind(curves(law, values, rng), law, values)
    # Half of the studies have measured forces, too.
    likelihood = ph.Gaussian(PRESSURE_SD, force_sd=FORCE_SD if number % 2 else None)
    frame = study.frame if number % 2 else study.frame.drop(columns="axial_force")
    model = ph.inflation_model(
        LAWS[study.law][0],
        data_of(frame, **study.tube),
        likelihood,
        priors=dict(study.priors),
    )
    return ph.sample_smc(model, random_seed=number, **SETTINGS)


def studies(right: int) -> Iterator[tuple[str, int, str, Callable[[], xr.DataTree]]]:
    """Kind, number, model and computation of each study."""
    for i in range(right):
        model = [*RIGHT][i % len(RIGHT)]
        rng = np.random.default_rng([i, 99])
        yield "right", i, model, lambda rng=rng, i=i, model=model: RIGHT[model](rng, i)
    for kind in MISTAKES:
        for number, law in enumerate(LAWS):
            name = kind.__name__.replace("_", " ")
            yield name, number, law, lambda k=kind, n=number, law=law: mistaken(k, n, law)


def judged(tree: xr.DataTree) -> tuple[str, str, str]:
    said = ph.diagnose_evidence(tree)
    checks = said["check"].values[said["verdict"].values != "good"].tolist()
    return said.attrs["verdict"], " ".join(checks), said.attrs["words"]


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--right", type=int, default=100, help="right models (%(default)s)")
    options.add_argument("--out", type=Path, default=Path("results/misfits.csv"))
    args = options.parse_args()
    args.out.parent.mkdir(parents=True, exist_ok=True)
    rows = (
        pd.read_csv(args.out, keep_default_na=False).to_dict("records") if args.out.exists() else []
    )
    known = {(row["kind"], row["number"]) for row in rows}
    for kind, number, model, compute in studies(args.right):
        if (kind, number) in known:
            continue
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", ".* is (doubtful|not to be trusted)", UserWarning)
            try:
                said = judged(compute())
            except ValueError as error:
                said = "refused", "", str(error)
        rows.append(Outcome(kind, number, model, *said)._asdict())
        pd.DataFrame(rows).to_csv(args.out, index=False)
    table = pd.DataFrame(rows)
    found = table["checks"].str.contains("limits|residuals") | (table["verdict"] == "refused")
    for kind, group in table.assign(found=found).groupby("kind", sort=False):
        print(f"{kind:24} {group['found'].sum():3} of {len(group)}")


if __name__ == "__main__":
    main()
