"""Evidences of populations with many unknowns, by two ways that share nothing but the model.

``python population_evidences.py --specimens 8 18`` simulates specimens of an Ogden solid, four
experiments on each, and prints the evidence that `fit_classes` finds, the one by bridge sampling
from draws of NUTS, and what `sample_smc` says of such a model. All is SIMULATED.
"""

import argparse
import time

import numpy as np
import pandas as pd
import pymc as pm

import pymc_hyperelastic as ph

TUBE = {"inner_radius": 7.0, "outer_radius": 9.0}  # mm
RADII = np.linspace(7.1, 9.5, 12)  # mm
EXPERIMENTS, NOISE = 4, 0.5  # kPa
MEDIAN = np.log([30.0, 6.5])  # of the modulus, kPa, and of the exponent
# Standard deviations of both logarithms, between specimens and between experiments on one.
SPREAD, BETWEEN = (0.25, 0.15), (0.08, 0.05)
SETTINGS = {"noise_sd": NOISE, "experiment_effect": True}


def simulate(specimens, seed):
    """Inflation data of one class."""
    rng = np.random.default_rng(seed)
    frames = []
    for specimen in range(specimens):
        own = MEDIAN + rng.normal(0, SPREAD)
        for experiment in range(EXPERIMENTS):
            mu, alpha = np.exp(own + rng.normal(0, BETWEEN))
            ideal = ph.inflation_pressure(ph.Ogden(), RADII, **TUBE, mu=mu, alpha=alpha).eval()
            pressure = ideal + rng.normal(0, NOISE, RADII.size)
            names = {"specimen": f"s{specimen}", "experiment": experiment}
            frames.append(pd.DataFrame({"radius": RADII, "pressure": pressure}).assign(**names))
    return ph.inflation_data(pd.concat(frames), check="ignore", **TUBE)


def measure(specimens, seed):
    """Print the evidence of a population of so many specimens, way by way."""
    data = simulate(specimens, seed)
    model = ph.population_model(ph.Ogden(), data, **SETTINGS)
    unknowns = sum(np.size(x) for x in model.initial_point().values())
    print(f"{specimens} specimens, {unknowns} unknowns", flush=True)

    start = time.perf_counter()
    fitted = ph.fit_classes(
        ph.Ogden(),
        {"all": data},
        variability="specimen",
        random_seed=seed,
        progressbar=False,
        **SETTINGS,
    )
    report("fit_classes", ph.log_evidence(fitted["all"]), start)

    start = time.perf_counter()
    with model:
        tree = pm.sample(
            2000, target_accept=0.99, chains=4, cores=2, random_seed=seed, progressbar=False
        )
    report("bridge", ph.log_evidence_by_bridge(model, tree, random_seed=seed), start)

    try:
        report("sample_smc", ph.log_evidence(ph.sample_smc(model, random_seed=seed)), start)
    except ValueError as refused:
        print(f"sample_smc refuses: {refused}", flush=True)


def report(way, found, start):
    """One line: the evidence, its error, and the time."""
    taken = time.perf_counter() - start
    print(f"{way}: {found.value:.3f} +- {found.standard_error:.3f} in {taken:.0f} s", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--specimens", type=int, nargs="+", default=[8, 18])
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    for specimens in given.specimens:
        measure(specimens, given.seed)
