"""Simulated classes whose specimens differ, of a material with one parameter."""

import numpy as np
import pandas as pd
from problems import AS_WRITTEN

import pymc_hyperelastic as ph

SEED = 911
TUBE = {"inner_radius": 7.0, "outer_radius": 9.0}
RADIUS = np.linspace(7.3, 9.0, 7)
SIGMA = 0.5
NAMES = ("soft", "stiff")


def unit_pressure(radius):
    """Pressure of a neo-Hookean tube of unit modulus."""
    return ph.inflation_pressure(ph.NeoHookean(), radius, mu=1.0, **TUBE).eval(mode=AS_WRITTEN)


UNIT_PRESSURE = unit_pressure(RADIUS)


def curves(specimens, seed):
    """Data of specimens: the moduli of the experiments on each, by its name."""
    rng = np.random.default_rng(seed)
    tables = []
    for name, moduli in specimens.items():
        for experiment, mu in enumerate(moduli, start=1):
            noise = SIGMA / np.sqrt(2) * rng.standard_normal(RADIUS.size)
            points = {"radius": RADIUS, "pressure": mu * UNIT_PRESSURE + noise}
            labels = {"specimen": name, "experiment": experiment, "group": "all"}
            tables.append(pd.DataFrame(labels | points))
    return ph.inflation_data(pd.concat(tables, ignore_index=True), **TUBE, check="ignore")


TRAINING = {
    "soft": curves({"A1": [30.0], "A2": [38.0], "A3": [50.0]}, 1),
    "stiff": curves({"B1": [70.0], "B2": [85.0, 85.0], "B3": [110.0]}, 2),
}


def fit(energy=None, training=None, **settings):
    defaults = {"draws": 500, "chains": 2, "sigma": SIGMA, "slope_weight": 0.0}
    defaults |= {"variability": "specimen", "random_seed": SEED, "progressbar": False}
    return ph.fit_classes(energy or ph.NeoHookean(), training or TRAINING, **defaults | settings)


def classify(data, classes, **settings):
    defaults = {"by": "specimen", "random_seed": SEED, "progressbar": False}
    return ph.classify(data, classes, **defaults | settings)
