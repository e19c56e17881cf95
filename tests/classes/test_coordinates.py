"""The same specimens in other coordinates of a class."""

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import norm
from test_hidden_modes import specimen

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.variable import Variability
from pymc_hyperelastic.models.natural_scale import NaturalScale

NOISE = {"noise_sd": 0.1, "force_noise_sd": 0.2, "force_offset_sd": 5.0}
STEP = 1e-5


def logarithms(energy, natural, x):
    """Coordinates in which each modulus has its logarithm, of those with a stress of reference."""
    values, columns = natural.numbers(list(x)), []
    for p in energy.parameters:
        low, high = p.prior_range
        value = values[p.name]
        logit = np.log((value - low) / (high - value)) if p.natural_scale == "logit" else None
        columns.append(np.log(value) if logit is None else logit)
    return np.array(columns)


def test_names_and_numbers_without_a_stress_of_reference():
    """Each parameter has its own coordinate."""
    scale = NaturalScale(ph.FourFiber(), None)
    assert scale.names == [
        "log_c",
        "log_k1_axial",
        "log_k2_axial",
        "log_k1_hoop",
        "log_k2_hoop",
        "log_k1_diagonal",
        "log_k2_diagonal",
        "logit_beta",
    ]
    x = np.random.default_rng(1).standard_normal((8, 3))
    found = scale.numbers(list(x))
    for name, own in zip(ph.FourFiber().parameter_names[:-1], x, strict=False):
        np.testing.assert_allclose(found[name], np.exp(own), rtol=1e-14)
    np.testing.assert_allclose(found["beta"], 90 / (1 + np.exp(-x[-1])), rtol=1e-14)


@pytest.mark.long
@pytest.mark.deep
def test_a_specimen_says_the_same_in_either():
    """Its evidence under one distribution, by draws of two samplers that priors lead elsewhere."""
    energy, data = ph.FourFiber(), specimen()
    kinds = [Variability.of_settings(energy, reference_stress=s, **NOISE) for s in (20.0, None)]
    natural, own = (kind.sampler(data)(data, np.random.default_rng(1)) for kind in kinds)
    x, scale = natural.centre, kinds[0].scale
    slopes = np.empty((x.shape[1], len(x), len(x)))
    for i, step in enumerate(STEP * np.eye(len(x))[:, :, None]):
        up, down = (logarithms(energy, scale, x + s) for s in (step, -step))
        slopes[:, :, i] = ((up - down) / (2 * STEP)).T
    volume = np.linalg.slogdet(slopes)[1]
    y = logarithms(energy, scale, x)
    prior = kinds[1].reference
    evidences = [
        logsumexp(weight + norm.logpdf(z.T, prior.location, prior.spread).sum(axis=1))
        for z, weight in ((y, natural.log_weight + volume), (own.centre, own.log_weight))
    ]
    assert abs(evidences[0] - evidences[1]) < 0.1
