"""Simulation-based calibration of the models themselves: posteriors mean what they say."""

import numpy as np
import pandas as pd
import pymc as pm
import pytest
from shared_errors import dataset, table

import pymc_hyperelastic as ph

SEED = 1
SIMULATIONS = 150
# Of all parameters of a right model together, one seed in a hundred rejects one.
CHANCE = 0.01
# What is wrong by half is found out more clearly than a right model is by chance.
FAILS = 1e-3
PRIORS = {
    ph.PowerLawNeoHookean(): {"mu": pm.Uniform.dist(5, 60), "n": pm.Uniform.dist(1, 20)},
    ph.Ogden(): {"mu": pm.Uniform.dist(5, 60), "alpha": pm.Uniform.dist(2, 12)},
    ph.CriscioneType(): {"a": pm.Uniform.dist(0.5, 5), "b": pm.Uniform.dist(1, 6)},
}


def pooled(energy, sigma, slope_weight):
    """Model of one measured curve, of which the radii are kept."""
    data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1", experiment=1)
    return ph.inflation_model(
        energy,
        data,
        sigma=sigma,
        slope_weight=slope_weight,
        priors=PRIORS[energy],
        likelihood="generative",
    )


def calibrate(model, **settings):
    settings = {"simulations": SIMULATIONS, "random_seed": SEED, "progressbar": False} | settings
    return ph.simulation_based_calibration(model, **settings)


def assert_calibrated(result):
    p_values = result["p_value"].to_series()
    assert (p_values > CHANCE / p_values.size).all(), p_values


@pytest.mark.long
@pytest.mark.deep
@pytest.mark.parametrize(
    ("energy", "slope_weight"),
    list(zip(PRIORS, (3.0, 0.0, 3.0), strict=True)),
    ids=lambda value: getattr(value, "name", value),
)
def test_pooled_model_is_calibrated(energy, slope_weight):
    """Parameters of a law, with the generative likelihood, with and without slopes."""
    assert_calibrated(calibrate(pooled(energy, 5 * ph.mmHg, slope_weight)))


@pytest.mark.long
@pytest.mark.deep
def test_wrong_noise_is_found_out():
    """Data of half as much noise again as the model believes in."""
    right, wrong = (pooled(ph.Ogden(), sd * ph.mmHg, 0.0) for sd in (5, 7.5))
    assert calibrate(right, simulator=wrong, simulations=100)["p_value"].min() < FAILS


@pytest.mark.long
@pytest.mark.deep
def test_population_model_is_calibrated():
    """Class and specimens together: location, spread, correlation, and every coordinate."""
    radius = np.linspace(7.2, 8.8, 8)
    frame = pd.concat(
        pd.DataFrame({"specimen": f"S{i}", "experiment": 1, "radius": radius, "pressure": 1.0})
        for i in (1, 2, 3)
    )
    data = ph.inflation_data(frame, inner_radius=7.0, outer_radius=9.0)
    # Priors as for a tissue of which something is known: the default ones bring forth tubes that
    # stiffen by orders of magnitude at these radii.
    priors = {
        "location": pm.Normal.dist(np.log([0.2, 7.0]), [0.15, 0.3], shape=2),
        "spread": pm.LogNormal.dist(np.log(0.2), 0.4, shape=2),
    }
    model = ph.population_model(ph.Ogden(), data, sigma=0.3, priors=priors)
    # Each takes many seconds, and eleven parameters are ranked at once.
    result = calibrate(model, simulations=25)
    assert result.sizes["parameter"] == 2 + 2 + 1 + 2 * 3
    assert_calibrated(result)


def test_inflation_models_need_the_generative_likelihood():
    """Pressures are simulated from observed variables; a Potential says what to do instead."""
    data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1", experiment=1)
    settings = {"sigma": 5 * ph.mmHg, "slope_weight": 1.0}
    model = ph.power_law_neo_hookean_model(data, likelihood="generative", **settings)
    few = {"draws": 200, "simulations": 4}
    sbc = calibrate(model, **few)
    assert sbc["parameter"].values.tolist() == ["mu", "n"]
    # Pressures tell much of mu: posteriors are narrower than the prior.
    assert sbc["posterior_sd"].sel(parameter="mu").max() < sbc["truth"].sel(parameter="mu").std()
    with pytest.raises(ValueError, match='likelihood="generative"'):
        calibrate(ph.power_law_neo_hookean_model(data, **settings), **few)


def forced(**errors):
    """Model of pressures and forces of two tests; one force was not measured."""
    data = dataset(table((6, 5)))
    data["axial_force"][8] = np.nan
    data["axial_force"][6] = 100.0
    priors = {"mu": pm.Uniform.dist(2, 8), "alpha": pm.Uniform.dist(3, 6)}
    noise = {"noise_sd": 0.4, "force_noise_sd": 4.0, **errors}
    settings = {"slope_weight": 0.0, "priors": priors, "likelihood": "generative"}
    return ph.inflation_model(ph.Ogden(), data, **noise, **settings)


@pytest.mark.long
@pytest.mark.deep
def test_shared_errors_are_calibrated():
    """Material, and the inferred size of offsets, with an error of the diameter besides."""
    offset = pm.LogNormal.dist(3, 0.5)
    assert_calibrated(calibrate(forced(force_offset_sd=offset, diameter_noise_sd=0.05)))


@pytest.mark.long
@pytest.mark.deep
def test_an_offset_that_is_left_away_is_found_out():
    """Forces of a transducer with an offset, taken for forces of one without."""
    right, wrong = forced(), forced(force_offset_sd=60.0)
    assert calibrate(right, simulator=wrong, simulations=100)["p_value"].min() < FAILS


def every_signal(energy, priors):
    """Two inflation tests and an extension test, offsets, and a thickness that is not known."""
    radius = np.concatenate([np.linspace(1.05, 1.45, 5), np.linspace(1.3, 1.2, 5)])
    stretch = np.concatenate([np.full(5, 1.3), np.linspace(1.2, 1.5, 5)])
    points = {"radius": radius, "stretch": stretch, "pressure": 1.0, "axial_force": 1.0}
    frame = pd.DataFrame(points).assign(specimen="a", experiment=np.repeat(["p", "f"], 5))
    tube = {"inner_radius": 1.0, "outer_radius": 1.4, "axial_stretch": "stretch"}
    data = ph.inflation_data(frame, **tube, check="ignore")
    return ph.inflation_model(
        energy,
        data,
        noise_sd=pm.LogNormal.dist(0.0, 0.5),
        force_noise_sd=pm.LogNormal.dist(2.5, 0.5),
        force_offset_sd=30.0,
        geometry={"thickness": ph.Measured(sd=0.04)},
        priors=priors,
        slope_weight=0.0,
        likelihood="generative",
    )


@pytest.mark.long
@pytest.mark.deep
def test_a_model_of_every_signal_is_calibrated():
    """Material, both noises and the wall's thickness, with offsets integrated out."""
    priors = {"mu": pm.LogNormal.dist(2.0, 0.3), "alpha": pm.LogNormal.dist(1.4, 0.2)}
    assert_calibrated(calibrate(every_signal(ph.Ogden(), priors), simulations=25))
