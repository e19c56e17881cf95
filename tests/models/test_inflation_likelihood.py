"""The likelihood of inflation curves as a part of another model."""

import exact
import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
import pytest
from problems import AS_WRITTEN

import pymc_hyperelastic as ph

# Sums of squares of pressures that are exact to 1e-12.
LIKELIHOOD_TOLERANCE = 1e-9
NOISE = {"sigma": 15 * ph.mmHg, "slope_weight": 3.2}


@pytest.fixture(scope="module")
def data():
    return ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen=["S1", "S4"], experiment=1)


def test_likelihoods_of_a_hierarchical_model_are_exact(data):
    """Each specimen has its own modulus, and noise of its own; they share the exponent."""
    specimens = ["S1", "S4"]
    with pm.Model(coords={"specimen": specimens}) as hierarchy:
        log_mu = pm.Normal("log_mu", np.log(30), 0.2, dims="specimen")
        alpha, sd = pm.Normal("alpha", 7, 2), pm.HalfNormal("sd", dims="specimen")
        for i, specimen in enumerate(specimens):
            own = ph.select(data, specimen=specimen)
            parameters = {"mu": pt.exp(log_mu[i]), "alpha": alpha}
            noise = {"noise_sd": sd[i], "slope_weight": 3.2}
            ph.inflation_likelihood(specimen, ph.Ogden(), own, parameters, **noise)
    inputs = [log_mu, alpha, sd]
    function = pytensor.function(inputs, hierarchy.potentials, mode=AS_WRITTEN)
    found = function(np.log([30.0, 50.0]), 6.5, [1.4, 0.9])
    for value, specimen, mu, noise_sd in zip(found, specimens, (30, 50), (1.4, 0.9), strict=True):
        curves = exact.curves_of(ph.select(data, specimen=specimen))
        noise = {"sigma": np.sqrt(2) * noise_sd, "slope_weight": 3.2}
        expected = exact.log_likelihood(curves, "Ogden", mu, 6.5, **noise)
        np.testing.assert_allclose(value, expected[0], rtol=LIKELIHOOD_TOLERANCE)


def test_parameters_and_geometry_may_be_numbers(data):
    """Numbers have double precision, and a geometry takes the place of that of the data."""
    with pm.Model() as model:
        settings = NOISE | {"geometry": {"inner_radius": pt.constant(7.1)}}
        ph.inflation_likelihood("curves", ph.Ogden(), data, {"mu": 30, "alpha": 6.7}, **settings)
    moved = data.assign(inner_radius=("test", np.full(2, 7.1)))
    expected = exact.log_likelihood(exact.curves_of(moved), "Ogden", 30.0, 6.7, **NOISE)
    found = model["curves"].eval(mode=AS_WRITTEN)
    np.testing.assert_allclose(found, expected[0], rtol=LIKELIHOOD_TOLERANCE)
