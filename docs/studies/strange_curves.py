"""Count how often unusual specimens get "none of these", and how often ordinary ones do.

``python strange_curves.py --out strange_curves.json`` simulates two classes of eight specimens with
two experiments each. The second class is 2.2 times as stiff as the first. The classes are fitted
with variability. `classify`, with ``none_below=0.05``, is then applied to ordinary new members of
the first class, and to unusual specimens with wrong walls, curves or numbers. An unusual specimen
is found if the decision is "none of these" or "cannot be judged". Implausible numbers already cause
a warning when the table is read; such warnings are counted separately, and the specimens are
classified too. The program prints a table by law, noise and experiment effect, and a table by kind.
Runs that are in the file are not repeated.

For comparison, each specimen is also tested without priors: Hotelling's test compares its
least-squares parameters with those of the eight specimens of a class, which is exact for normal
parameters, and a chi-square test compares its misfit with the known noise.

All data are SIMULATED with the fitted law, and with independent normal errors. Failures therefore
do not come from a law that does not fit.
"""

import argparse
import json
import warnings
from collections.abc import Callable
from dataclasses import replace
from itertools import chain, product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import pymc as pm
import pytensor
import pytensor.tensor as pt
from scipy import stats
from scipy.optimize import least_squares

import pymc_hyperelastic as ph

# Laws, with the median parameters of the first class: a modulus (kPa) and an exponent.
LAWS = {
    "Ogden": (ph.Ogden(), {"mu": 30.0, "alpha": 6.5}),
    "Demiray": (ph.Demiray(), {"mu": 60.0, "b": 1.2}),
}
STIFFER = 2.2
# Standard deviations of the log parameters: between specimens, and between experiments on one
# specimen.
SPREAD, BETWEEN = np.array([0.25, 0.15]), np.array([0.08, 0.05])
SPECIMENS, EXPERIMENTS, ORDINARY = 8, 2, 40

TUBE = ph.Tube(inner_radius=7.0, outer_radius=9.0)  # mm, a sheep's aorta
NOISE = 3 * ph.mmHg  # standard deviation of a pressure, kPa
# A test begins a little above the unloaded radius, at a low pressure. It ends at a high pressure or
# a large radius.
POINTS, FIRST, LOWEST = 15, (1.006, 1.02), 1.0
HIGHEST, WIDEST = (165 * ph.mmHg, 8 * ph.mmHg), 12.0
# Bounds of the log parameters in least squares.
REACH = ([-8.0, -4.0], [9.0, 5.0])
GRID = np.linspace(5.0, WIDEST, 2000)

NONE_BELOW = 0.05
SETTINGS = [
    ("Ogden", "known", False),
    ("Demiray", "known", False),
    ("Ogden", "known", True),
    ("Demiray", "known", True),
    ("Ogden", "unknown", True),
]

Change = Callable[[np.ndarray, np.ndarray, np.random.Generator], tuple]


def as_measured(radius, pressure, rng):
    return radius, pressure


def falling(radius, pressure, rng):
    return radius, pressure[::-1]


def flat(radius, pressure, rng):
    return radius, pressure.mean() + NOISE * rng.standard_normal(POINTS)


def straight(radius, pressure, rng):
    line = np.linspace(pressure[0], pressure[-1], POINTS)
    return radius, line + NOISE * rng.standard_normal(POINTS)


class Kind(NamedTuple):
    """How a specimen differs from a member of the first class."""

    factors: tuple[float, float] = (1.0, 1.0)
    """Factors of the modulus and of the exponent."""
    axial_stretch: float = 1.0
    """The true axial stretch; the data state 1."""
    change: Change = as_measured
    """Function that changes radii and pressures."""
    changed: tuple[int, ...] = (1, 2)
    """Numbers of the experiments that are changed."""


KINDS = (
    {f"stiffness x {x:g}": Kind((x, 1.0)) for x in (0.01, 0.1, 0.2, 5.0, 20.0)}
    | {
        "exponent x 0.4": Kind((1.0, 0.4)),
        "falling": Kind(change=falling),
        "one falling of two": Kind(change=falling, changed=(2,)),
        "flat": Kind(change=flat),
        "random": Kind(change=lambda r, p, rng: (r, p.max() * rng.random(POINTS))),
        "straight line": Kind(change=straight),
        "kPa given as mmHg": Kind(change=lambda r, p, rng: (r, p * ph.mmHg)),
        "mmHg given as kPa": Kind(change=lambda r, p, rng: (r, p / ph.mmHg)),
        "diameters as radii": Kind(change=lambda r, p, rng: (2 * r, p)),
        "strains halved": Kind(change=lambda r, p, rng: ((r + TUBE.inner_radius) / 2, p)),
    }
    | {f"axial stretch {x:g} as 1": Kind(axial_stretch=x) for x in (0.8, 1.2, 1.3, 1.6)}
)


class Study(NamedTuple):
    """The source of simulated specimens."""

    law: str
    effect: bool
    """True if experiments on a specimen differ."""
    pressure: Callable[..., np.ndarray]
    rng: np.random.Generator


def study_of(law, effect, rng):
    """Return a study; pressures (kPa) are a function of radius, parameters and axial stretch."""
    energy, medians = LAWS[law]
    radius, stretch = pt.vector("radius"), pt.scalar("axial_stretch")
    parameters = {name: pt.scalar(name) for name in medians}
    tube = replace(TUBE, axial_stretch=stretch)
    pressure = ph.inflation_pressure(energy, radius, tube, **parameters)
    compiled = pytensor.function([radius, *parameters.values(), stretch], pressure)
    return Study(law, effect, compiled, rng)


def inflate(study, parameters, kind, experiment):
    """Return the radii and pressures of one experiment."""
    rng, curve = study.rng, study.pressure(GRID, *parameters, kind.axial_stretch)
    # Curves rise. If a curve does not reach a pressure, take its last radius.
    unloaded, low, last = np.interp([0.0, LOWEST, rng.normal(*HIGHEST)], curve, GRID)
    radius = np.linspace(min(unloaded * rng.uniform(*FIRST), low), last, POINTS)
    pressure = study.pressure(radius, *parameters, kind.axial_stretch)
    pressure = pressure + NOISE * rng.standard_normal(POINTS)
    return kind.change(radius, pressure, rng) if experiment in kind.changed else (radius, pressure)


def specimen(study, name, kind, stiffness=1.0):
    """Return a table of the experiments on a new specimen."""
    _, medians = LAWS[study.law]
    middle = np.log([*medians.values()]) + np.log(kind.factors) + np.log([stiffness, 1.0])
    own = middle + SPREAD * study.rng.standard_normal(2)
    tables = []
    for experiment in range(1, EXPERIMENTS + 1):
        differs = study.effect * BETWEEN * study.rng.standard_normal(2)
        radius, pressure = inflate(study, np.exp(own + differs), kind, experiment)
        labels = {"specimen": name, "experiment": experiment}
        tables.append(pd.DataFrame(labels | {"radius": radius, "pressure": pressure}))
    return pd.concat(tables, ignore_index=True)


def training_of(study):
    """Return tables of the training specimens of both classes."""
    return {
        name: [specimen(study, f"{name}{i}", Kind(), x) for i in range(SPECIMENS)]
        for name, x in (("first", 1.0), ("second", STIFFER))
    }


def fit(study, training, noise, seed):
    """Fit both classes."""
    training = {
        name: ph.inflation_data(pd.concat(tables), TUBE) for name, tables in training.items()
    }
    pressure_sd = NOISE if noise == "known" else pm.LogNormal.dist(np.log(NOISE), 1.0)
    return ph.fit_classes(
        LAWS[study.law][0],
        training,
        pressure_sd,
        variability=ph.Variability(experiment_effect=study.effect),
        random_seed=seed,
        progressbar=False,
    )


def ask(table, classes, seed):
    """Return the warnings when the table of a specimen is read, and its classification."""
    said = {"doubted": "", "decision": "refused"}
    try:
        ph.inflation_data(table, TUBE, check="raise")
    except ValueError as error:
        said["doubted"] = str(error)
    try:
        data = ph.inflation_data(table, TUBE, check="ignore")
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "1 of 1 cannot be judged")
            answer = ph.classify(
                data,
                classes,
                by="specimen",
                none_below=NONE_BELOW,
                random_seed=seed,
                progressbar=False,
            )
    except ValueError as error:
        return said | {"refused": str(error)}
    said["decision"] = answer["decision"].item()
    names = ["class_probability", "p_value", "typical_p_value", "fit_p_value", "pareto_k"]
    return said | {name: answer[name].values.ravel().tolist() for name in names}


def best_fit(study, tables):
    """Return the least-squares log parameters, and the probability of a larger misfit."""
    _, medians = LAWS[study.law]
    start = np.log([*medians.values()])

    def misfit(x):
        curves = [study.pressure(table["radius"].values, *np.exp(x), 1.0) for table in tables]
        return (np.concatenate(curves) - pd.concat(tables)["pressure"].values) / NOISE

    # Several starting points: soft, stiff, and nearly straight.
    starts = (start + np.array(step) for step in ([0, 0], [2, 0], [-2, 0], [0, -1]))
    fits = [least_squares(misfit, x, bounds=REACH) for x in starts]
    best = min(fits, key=lambda fit: fit.cost)
    return best.x, stats.chi2.sf(2 * best.cost, best.fun.size - best.x.size)


def coordinates(study, table):
    """Fit all tests of a specimen, or average over its tests if experiments differ."""
    tests = [part for _, part in table.groupby("experiment")]
    fits = [best_fit(study, [test]) for test in tests] if study.effect else [best_fit(study, tests)]
    points, p_values = zip(*fits, strict=True)
    return np.mean(points, axis=0), either(*p_values)


def hotelling(point, others):
    """Return the p-value of Hotelling's test of a point against a normal sample."""
    count, size = others.shape
    away = point - others.mean(axis=0)
    distance = away @ np.linalg.solve(np.cov(others.T), away)
    scaled = distance * (count - size) / (size * (count - 1) * (1 + 1 / count))
    return stats.f.sf(scaled, size, count - size)


def without_bayes(study, members, table):
    """Return the p-value under each class by least squares with known noise."""
    point, p_fit = coordinates(study, table)
    return [float(either(hotelling(point, others), p_fit)) for others in members]


def either(*p_values):
    return 1 - (1 - min(p_values)) ** len(p_values)


def run(law, noise, effect, each, seed):
    """Classify `each` unusual specimens of every kind, and the ordinary specimens."""
    study = study_of(law, effect, np.random.default_rng(seed))
    training = training_of(study)
    classes = fit(study, training, noise, seed)
    members = [np.array([coordinates(study, t)[0] for t in own]) for own in training.values()]
    wanted = [(kind, i) for kind in KINDS for i in range(each)]
    wanted += [("ordinary", i) for i in range(ORDINARY)]
    asked = []
    for number, (kind, i) in enumerate(wanted):
        table = specimen(study, f"{kind} {i}", KINDS.get(kind, Kind()))
        said = {"kind": kind, "without_bayes": without_bayes(study, members, table)}
        asked.append(said | ask(table, classes, [seed, number]))
    return {"law": law, "noise": noise, "effect": effect, "seed": seed, "asked": asked}


def found(said):
    """Return True if the decision is not a class."""
    return said["decision"] not in ("first", "second")


def found_without_bayes(said):
    """Return True if least squares reject both classes."""
    return max(said["without_bayes"]) < NONE_BELOW


def share(some, is_so):
    return f"{np.mean([bool(is_so(said)) for said in some]):.0%}"


def by_setting(runs):
    """Return the answers for all specimens, by the name of the setting."""
    asked = {}
    for law, noise, effect in SETTINGS:
        name = f"{law}, {noise}, {'yes' if effect else 'no'}"
        some = [
            r["asked"] for r in runs if (r["law"], r["noise"], r["effect"]) == (law, noise, effect)
        ]
        asked |= {name: list(chain(*some))} if some else {}
    return asked


def of_kind(asked, kind):
    return [said for said in asked if said["kind"] == kind]


def markdown(head, *lines):
    rows = [head, ["---", *["---:"] * (len(head) - 1)], *lines]
    return "\n".join("| " + " | ".join(map(str, row)) + " |" for row in rows)


def table_of_settings(runs):
    """Return a table of the detected specimens by law, noise and experiment effect."""
    lines = []
    for name, asked in by_setting(runs).items():
        own = of_kind(asked, "ordinary")
        strange = [said for said in asked if said["kind"] != "ordinary"]
        line = [name]
        for some in (strange, own):
            line += [share(some, found), share(some, found_without_bayes), len(some)]
        lines.append([*line, share(strange, lambda said: found(said) or said["doubted"])])
    head = ["law, noise, experiment effect", "strangers found", "without Bayes", "of"]
    head += ["the class's own turned away", "without Bayes", "of", "found or doubted when read"]
    return markdown(head, *lines)


def table_of_kinds(runs):
    """Return a table of the detected specimens of each kind, by setting."""
    settings = by_setting(runs)
    lines = []
    for kind in KINDS:
        some = [of_kind(asked, kind) for asked in settings.values()]
        cells = [
            f"{sum(map(found, asked))}, {sum(map(found_without_bayes, asked))} of {len(asked)}"
            for asked in some
        ]
        lines.append([kind, *cells, share(chain(*some), lambda said: said["doubted"])])
    return markdown(["kind", *settings, "doubted when read"], *lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--each", type=int, default=3, help="strange specimens of each kind")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1], help="pairs of classes")
    parser.add_argument("--settings", type=int, nargs="+", default=range(len(SETTINGS)))
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    runs = json.loads(given.out.read_text()) if given.out and given.out.exists() else []
    known = {(r["law"], r["noise"], r["effect"], r["seed"]) for r in runs}
    for seed, number in product(given.seeds, given.settings):
        if (*SETTINGS[number], seed) not in known:
            runs.append(run(*SETTINGS[number], given.each, seed))
        if given.out:
            given.out.write_text(json.dumps(runs, indent=1))
    print(table_of_settings(runs), table_of_kinds(runs), sep="\n\n")


if __name__ == "__main__":
    main()
