"""Which strange specimens are seen to be strange, and how many ordinary ones are turned away.

``python strange_curves.py --out strange_curves.json`` simulates two classes of eight specimens, two
experiments each, the second class 2.2 times as stiff as the first, and fits them with variability.
Then it asks `classify`, with ``none_below=0.05``, of fresh members of the first class: of ordinary
ones, and of strange ones, whose walls, curves or numbers are not what they should be. A stranger is
found if the decision is no class: "none of these" or "cannot be judged". Numbers that no soft tube
has are doubted before, when the table is read; that is counted apart, and such specimens are
classified all the same. It prints a table by law, noise and experiment effect, and one by kind;
what stands in the file already is not run again.

Beside it stands what can be seen at best without priors: the parameters of least squares of a new
specimen are held against those of the eight by Hotelling's test, which is exact for normal ones,
and the misfit against the noise, by who knows it.

All is SIMULATED, of the law that is fitted, with errors that are independent and normal: what is
missed here is not missed for a law that does not fit.
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

# Each with the medians of the first class's parameters: a modulus, kPa, and an exponent.
LAWS = {
    "Ogden": (ph.Ogden(), {"mu": 30.0, "alpha": 6.5}),
    "Demiray": (ph.Demiray(), {"mu": 60.0, "b": 1.2}),
}
STIFFER = 2.2
# Standard deviations of the logarithms of both, between specimens and between experiments on one.
SPREAD, BETWEEN = np.array([0.25, 0.15]), np.array([0.08, 0.05])
SPECIMENS, EXPERIMENTS, ORDINARY = 8, 2, 40

TUBE = ph.Tube(inner_radius=7.0, outer_radius=9.0)  # mm, a sheep's aorta
NOISE = 3 * ph.mmHg  # standard deviation of a pressure, kPa
# A test begins a little above the radius without load, at a low pressure, and ends at a high one or
# where the tube is wide.
POINTS, FIRST, LOWEST = 15, (1.006, 1.02), 1.0
HIGHEST, WIDEST = (165 * ph.mmHg, 8 * ph.mmHg), 12.0
# Logarithms of parameters between which least squares look.
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
    """Of its modulus and of its exponent."""
    axial_stretch: float = 1.0
    """At which it is held, while 1 is stated."""
    change: Change = as_measured
    """What becomes of radii and pressures."""
    changed: tuple[int, ...] = (1, 2)
    """Experiments of which something becomes."""


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
    """Where specimens come from."""

    law: str
    effect: bool
    """Whether experiments on a specimen differ."""
    pressure: Callable[..., np.ndarray]
    rng: np.random.Generator


def study_of(law, effect, rng):
    """A study whose pressures, kPa, are a function of radius, parameters and axial stretch."""
    energy, medians = LAWS[law]
    radius, stretch = pt.vector("radius"), pt.scalar("axial_stretch")
    parameters = {name: pt.scalar(name) for name in medians}
    tube = replace(TUBE, axial_stretch=stretch)
    pressure = ph.inflation_pressure(energy, radius, tube, **parameters)
    compiled = pytensor.function([radius, *parameters.values(), stretch], pressure)
    return Study(law, effect, compiled, rng)


def inflate(study, parameters, kind, experiment):
    """Radii and pressures of one experiment."""
    rng, curve = study.rng, study.pressure(GRID, *parameters, kind.axial_stretch)
    # Curves rise; where one does not reach a pressure, its last radius is taken.
    unloaded, low, last = np.interp([0.0, LOWEST, rng.normal(*HIGHEST)], curve, GRID)
    radius = np.linspace(min(unloaded * rng.uniform(*FIRST), low), last, POINTS)
    pressure = study.pressure(radius, *parameters, kind.axial_stretch)
    pressure = pressure + NOISE * rng.standard_normal(POINTS)
    return kind.change(radius, pressure, rng) if experiment in kind.changed else (radius, pressure)


def specimen(study, name, kind, stiffness=1.0):
    """Table of the experiments on a new specimen."""
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
    """Tables of the specimens of both classes."""
    return {
        name: [specimen(study, f"{name}{i}", Kind(), x) for i in range(SPECIMENS)]
        for name, x in (("first", 1.0), ("second", STIFFER))
    }


def fit(study, training, noise, seed):
    """Both classes."""
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
    """What is said of a specimen: by who reads the table, and by who classifies it."""
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
    """Logarithms of the parameters of least squares, and the chance of a worse misfit."""
    _, medians = LAWS[study.law]
    start = np.log([*medians.values()])

    def misfit(x):
        curves = [study.pressure(table["radius"].values, *np.exp(x), 1.0) for table in tables]
        return (np.concatenate(curves) - pd.concat(tables)["pressure"].values) / NOISE

    # From several places: soft and stiff, and nearly straight.
    starts = (start + np.array(step) for step in ([0, 0], [2, 0], [-2, 0], [0, -1]))
    fits = [least_squares(misfit, x, bounds=REACH) for x in starts]
    best = min(fits, key=lambda fit: fit.cost)
    return best.x, stats.chi2.sf(2 * best.cost, best.fun.size - best.x.size)


def coordinates(study, table):
    """The same of a specimen: of all its curves, or the mean of its tests where these differ."""
    tests = [part for _, part in table.groupby("experiment")]
    fits = [best_fit(study, [test]) for test in tests] if study.effect else [best_fit(study, tests)]
    points, p_values = zip(*fits, strict=True)
    return np.mean(points, axis=0), either(*p_values)


def hotelling(point, others):
    """P-value of Hotelling's test that a point is of the normal distribution of some others."""
    count, size = others.shape
    away = point - others.mean(axis=0)
    distance = away @ np.linalg.solve(np.cov(others.T), away)
    scaled = distance * (count - size) / (size * (count - 1) * (1 + 1 / count))
    return stats.f.sf(scaled, size, count - size)


def without_bayes(study, members, table):
    """P-value under each class by least squares, for who knows the noise."""
    point, p_fit = coordinates(study, table)
    return [float(either(hotelling(point, others), p_fit)) for others in members]


def either(*p_values):
    return 1 - (1 - min(p_values)) ** len(p_values)


def run(law, noise, effect, each, seed):
    """All that is said of strange specimens, `each` of a kind, and of ordinary ones."""
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
    """Whether the decision is no class."""
    return said["decision"] not in ("first", "second")


def found_without_bayes(said):
    """Whether least squares tell a stranger from both classes."""
    return max(said["without_bayes"]) < NONE_BELOW


def share(some, is_so):
    return f"{np.mean([bool(is_so(said)) for said in some]):.0%}"


def by_setting(runs):
    """What was said of all specimens under each setting that was run, by its name."""
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
    """What was found, by law, noise and effect."""
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
    """How many of each kind were found, and how many without Bayes, by setting."""
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
