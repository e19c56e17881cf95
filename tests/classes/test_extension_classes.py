"""Classes of specimens with extension tests: pressures count at the stretch of each point."""

from functools import cache

import numpy as np
import pandas as pd
import pymc as pm
import pytensor
import pytensor.tensor as pt
import pytest
import xarray as xr
from problems import AS_WRITTEN
from scipy.stats import norm

import pymc_hyperelastic as ph
from pymc_hyperelastic.data.inflation import at_points

TUBE = {"inner_radius": 1.0, "outer_radius": 1.4}
NOISE = {"noise_sd": 0.2, "slope_weight": 0.0}
# Curves of both ways to integrate, in a density of errors of this size.
TOLERANCE = 1e-8


@cache
def compiled():
    radius, stretch, mu = pt.dvectors(3)
    law = ph.inflation_pressure(ph.NeoHookean(), radius, **TUBE, axial_stretch=stretch, mu=mu)
    return pytensor.function([radius, stretch, mu], law, mode=AS_WRITTEN)


def pressure_of(radius, stretch, mu):
    return compiled()(radius, stretch, np.broadcast_to(mu, np.shape(radius)))


def specimens(moduli, first=1, seed=1) -> xr.Dataset:
    """Two inflation tests and two extension tests on each specimen, with errors of 0.2 kPa."""
    rng, tables = np.random.default_rng(seed), []
    for number, mu in enumerate(moduli, start=first):
        for experiment in range(4):
            radius = np.linspace(1.1, 1.4, 6)
            stretch = np.full(6, 1.1 + 0.15 * experiment)
            if experiment > 1:
                stretch, radius = np.linspace(1.05, 1.4, 6), np.full(6, 1.1 + 0.05 * experiment)
            pressure = pressure_of(radius, stretch, mu) + rng.normal(0, 0.2, 6)
            table = {"radius": radius, "pressure": pressure, "stretch": stretch}
            table |= {"specimen": f"S{number}", "experiment": experiment}
            tables.append(pd.DataFrame(table))
    frame = pd.concat(tables, ignore_index=True)
    return ph.inflation_data(frame, **TUBE, axial_stretch="stretch", check="ignore")


def test_population_of_specimens_with_both_kinds_of_tests():
    """Each point is normal about the pressure of its specimen, at its own stretch."""
    data = specimens([15.0, 25.0, 30.0])
    model = ph.population_model(ph.NeoHookean(), data, noise_sd=0.2)
    outputs = [*model.logp(model.observed_RVs, sum=False)]
    outputs += model.replace_rvs_by_values([model["mu"]])
    settings = {"mode": AS_WRITTEN, "on_unused_input": "ignore"}
    function = model.compile_fn(outputs, inputs=model.value_vars, **settings)
    found, mu = function(model.initial_point())
    of_point = mu[np.repeat(np.arange(3), 4)][data["test"].values]
    stretch = at_points(data, "axial_stretch")
    expected = pressure_of(data["radius"].values, stretch, of_point)
    np.testing.assert_allclose(
        found, norm.logpdf(data["pressure"].values, expected, 0.2), rtol=TOLERANCE
    )


@cache
def classes(variability):
    data = {"soft": specimens([9.5, 10.5]), "stiff": specimens([38.0, 42.0], 4)}
    settings = {"draws": 100, "chains": 1, "random_seed": 1, "progressbar": False}
    priors = {} if variability else {"priors": {"mu": pm.Uniform.dist(1, 60)}}
    kind = {"variability": variability} if variability else {}
    return ph.fit_classes(ph.NeoHookean(), data, **NOISE, **settings, **priors, **kind)


@pytest.mark.parametrize("variability", [None, "specimen"])
def test_classes_learn_from_both_kinds_and_judge_either(variability):
    """A new specimen is of its class by all its tests, and by its extension tests alone."""
    fitted = classes(variability)
    new = specimens([10.0, 40.0], 7, seed=2)
    for experiments in ([0, 1, 2, 3], [2, 3]):
        part = ph.select(new, experiment=experiments)
        found = ph.classify(part, fitted, by="specimen", random_seed=1)
        probability = found["class_probability"].transpose("specimen", "class_label").values
        assert np.diag(probability).min() > 0.85, (experiments, probability)
