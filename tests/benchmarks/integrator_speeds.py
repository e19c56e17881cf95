"""Time log densities and gradients of inflation models, and the sampling of one specimen.

python tests/benchmarks/integrator_speeds.py [--only PATTERN]

Each law is inflated at three axial stretches, 20 points each; some data have axial forces, some
four extension tests at held radii, and some start below the unloaded radius, where fibres are
slack. Printed are seconds to make and compile the model, and milliseconds for one log density with
its gradient; for a specimen of a class, seconds to make the sampler and to sample it (the second
time, after compilation). Times are those of one core.
"""

import argparse
import re
import time

import numpy as np
import pandas as pd
from pymc.blocking import DictToArrayBijection

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.hierarchical import HierarchicalClass

LAWS = {
    "Ogden": {"mu": 20.0, "alpha": 3.0},
    "PowerLawNeoHookean": {"mu": 20.0, "n": 2.0},
    "Demiray": {"mu": 20.0, "b": 0.8},
    "HolzapfelGasserOgden": {"c": 15.0, "k1": 5.0, "k2": 0.4, "beta": 39.0},
    "FourFiber": {
        "c": 13.0,
        "k1_axial": 3.0,
        "k2_axial": 0.05,
        "k1_hoop": 1.0,
        "k2_hoop": 0.1,
        "k1_diagonal": 3.8,
        "k2_diagonal": 0.4,
        "beta": 39.0,
    },
}
TUBE = {"inner_radius": 0.45, "outer_radius": 0.57}
STRETCHES, RADII, POINTS = (1.4, 1.5, 1.6), (0.45, 0.5, 0.55, 0.6), 20
PRESSURE_SD, FORCE_SD = 0.15, 0.5  # kPa, mN


def data_of(law, *, force, extended, slack):
    """Simulated tests of one law."""
    first = 0.36 if slack else 0.46
    tests = [(np.linspace(first, 0.62, POINTS), np.full(POINTS, s)) for s in STRETCHES]
    if extended:
        stretch = np.linspace(STRETCHES[0], STRETCHES[-1], POINTS)
        tests += [(radius - 0.1 * (stretch - 1.4), stretch) for radius in RADII]
    rng, rows = np.random.default_rng(1), []
    for number, (radius, stretch) in enumerate(tests):
        tube, material = ph.Tube(**TUBE, axial_stretch=stretch), LAWS[law.name]
        measured = {"radius": radius, "stretch": stretch, "experiment": number, "specimen": "A"}
        noise = rng.standard_normal((2, POINTS))
        pressure = ph.inflation_pressure(law, radius, tube, **material)
        measured["pressure"] = pressure.eval(mode="FAST_COMPILE") + PRESSURE_SD * noise[0]
        if force:
            axial_force = ph.axial_force(law, radius, tube, **material)
            measured["axial_force"] = axial_force.eval(mode="FAST_COMPILE") + FORCE_SD * noise[1]
        rows.append(pd.DataFrame(measured))
    frame = pd.concat(rows)
    return ph.inflation_data(frame, ph.Tube(**TUBE, axial_stretch="stretch"), check="ignore")


def density(law, data, likelihood):
    """Seconds to make and compile a model, and milliseconds of its log density and gradient."""
    start = time.perf_counter()
    model = ph.inflation_model(law, data, likelihood)
    function = model.logp_dlogp_function(ravel_inputs=True)
    function.set_extra_values({})
    point = DictToArrayBijection.map(model.initial_point())
    function(point)
    made = time.perf_counter() - start
    best = np.inf
    for _ in range(5):
        start, count = time.perf_counter(), 0
        while time.perf_counter() - start < 0.3:
            function(point)
            count += 1
        best = min(best, (time.perf_counter() - start) / count)
    return f"{made:8.1f} s{1e3 * best:10.3f} ms"


def specimen(law, data, likelihood):
    """Seconds to make a sampler of specimens, and to sample one the second time."""
    start = time.perf_counter()
    sampler = HierarchicalClass.of_settings(law, likelihood).sampler(data)
    sampler(data, np.random.default_rng(1))
    made, start = time.perf_counter() - start, time.perf_counter()
    for seed in (2, 3):
        draws = sampler(data, np.random.default_rng(seed))
    took = (time.perf_counter() - start) / 2
    return f"{made:8.1f} s{took:10.2f} s   method {draws.method}, k {draws.pareto_k:.2f}"


KINDS = {
    "inflation": {"force": False, "extended": False, "slack": False},
    "forces": {"force": True, "extended": False, "slack": False},
    "extension": {"force": True, "extended": True, "slack": False},
    "slack": {"force": True, "extended": False, "slack": True},
}
options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
options.add_argument("--only", default="", help="regular expression for the rows")
args = options.parse_args()
for name in LAWS:
    law = getattr(ph, name)()
    for kind, settings in KINDS.items():
        likelihood = ph.Gaussian(PRESSURE_SD, force_sd=FORCE_SD if settings["force"] else None)
        for words, function in (("density", density), ("specimen", specimen)):
            row = f"{name}, {kind}, {words}"
            if re.search(args.only, row):
                print(f"{row:<46}{function(law, data_of(law, **settings), likelihood)}", flush=True)
