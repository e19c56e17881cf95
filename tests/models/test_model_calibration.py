"""Simulation-based calibration of whole models."""

import numpy as np
import pandas as pd
import pymc as pm
import pytest

import pymc_hyperelastic as ph

SETTINGS = {"random_seed": 1, "progressbar": False}
# A correct model is rejected by one seed in a hundred.
CHANCE = 0.01


def one_curve_with_slopes():
    data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1", experiment=1)
    likelihood = ph.SlopeAugmented(sigma=5 * ph.mmHg, slope_weight=3.0, observed=True)
    priors = {"a": pm.Uniform.dist(0.5, 5), "b": pm.Uniform.dist(1, 6)}
    return ph.criscione_model(data, likelihood, priors=priors)


def population():
    """Three specimens with priors of a known tissue: default priors allow any stiffness."""
    radius = np.linspace(7.2, 8.8, 8)
    frame = pd.concat(
        pd.DataFrame({"specimen": f"S{i}", "experiment": 1, "radius": radius, "pressure": 1.0})
        for i in (1, 2, 3)
    )
    data = ph.inflation_data(frame, ph.Tube(7.0, 9.0))
    priors = {
        "location": pm.Normal.dist(np.log([0.2, 7.0]), [0.15, 0.3], shape=2),
        "spread": pm.LogNormal.dist(np.log(0.2), 0.4, shape=2),
    }
    return ph.population_model(ph.Ogden(), data, 0.3 / np.sqrt(2), priors=priors)


def every_signal():
    """Inflation and extension tests, inferred noises, offsets, and an uncertain thickness."""
    radius = np.concatenate([np.linspace(1.05, 1.45, 5), np.linspace(1.3, 1.2, 5)])
    stretch = np.concatenate([np.full(5, 1.3), np.linspace(1.2, 1.5, 5)])
    points = {"radius": radius, "stretch": stretch, "pressure": 1.0, "axial_force": 1.0}
    frame = pd.DataFrame(points).assign(specimen="a", experiment=np.repeat(["p", "f"], 5))
    tube = ph.Tube(inner_radius=1.0, outer_radius=1.4, axial_stretch="stretch")
    likelihood = ph.Gaussian(
        pressure_sd=pm.LogNormal.dist(0.0, 0.5),
        force_sd=pm.LogNormal.dist(2.5, 0.5),
        force_offset_sd=30.0,
        observed=True,
    )
    return ph.inflation_model(
        ph.Ogden(),
        ph.inflation_data(frame, tube, check="ignore"),
        likelihood,
        priors={
            "mu": pm.LogNormal.dist(2.0, 0.3),
            "alpha": pm.LogNormal.dist(1.4, 0.2),
            "thickness": ph.MeasuredValue(sd=0.04),
        },
    )


# Models and numbers of simulations, which are smaller if one simulation takes many seconds.
MODELS = {
    "one curve with slopes": (one_curve_with_slopes, 150),
    "population": (population, 25),
    "every signal": (every_signal, 25),
}


@pytest.mark.long
@pytest.mark.deep
@pytest.mark.parametrize("name", MODELS)
def test_ranks_of_simulation_based_calibration_are_uniform(name):
    make, simulations = MODELS[name]
    result = ph.simulation_based_calibration(make(), simulations=simulations, **SETTINGS)
    p_values = result["p_value"].to_series()
    assert (p_values > CHANCE / p_values.size).all(), p_values
