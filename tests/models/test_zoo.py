"""Every law of the zoo as a model: pressures and axial forces in, parameters and evidence out."""

from functools import cache

import numpy as np
import pandas as pd
import pymc as pm
import pytest
from problems import AS_WRITTEN, LAWS
from tables import SECTOR
from tiers import long, tiers

import pymc_hyperelastic as ph

# Seeds are fixed, so that this is a statement about these runs: a right estimate and a right error
# bar miss this three times in a thousand.
STANDARD_ERRORS = 3
# A tube as laboratories test them: opened, stretched to two lengths, inflated by a half.
TUBE = {"inner_radius": 1.0, "outer_radius": 1.3, "opening_angle": 0.8}
AXIAL_STRETCHES, RADII = (1.3, 1.5), np.linspace(1.05, 1.5, 10)
NOISE = 0.02  # of the largest value

# Priors about the tissue at hand: with them fibres never slacken here, and matrices are possible.
PRIORS = {
    "Demiray": {"b": (0.0, 5.0)},
    "FungOrthotropic": {"a1": (0.0, 4.0), "a2": (0.0, 4.0), "a4": (0.0, 1.0)},
    "HolzapfelGasserOgden": {"k2": (0.0, 5.0), "beta": (25.0, 60.0)},
    "GasserOgdenHolzapfel": {"k2": (0.0, 5.0), "kappa": (0.0, 0.2), "beta": (25.0, 60.0)},
    "FourFiber": {
        "k2_axial": (0.0, 5.0),
        "k2_hoop": (0.0, 5.0),
        "k2_diagonal": (0.0, 5.0),
        "beta": (25.0, 60.0),
    },
}


@cache
def study(name):
    """Model of simulated experiments on a tube of the law's ordinary material, and that."""
    energy, parameters = LAWS[name].strain_energy, LAWS[name].parameters[0][0]
    tables = []
    for axial_stretch in AXIAL_STRETCHES:
        tube = {**TUBE, "axial_stretch": axial_stretch, **parameters}
        table = {
            "specimen": "A",
            "experiment": f"stretch {axial_stretch}",
            "axial": axial_stretch,
            "radius": RADII,
            "pressure": ph.inflation_pressure(energy, RADII, **tube).eval(mode=AS_WRITTEN),
            "axial_force": ph.axial_force(energy, RADII, **tube).eval(mode=AS_WRITTEN),
        }
        tables.append(pd.DataFrame(table))
    frame = pd.concat(tables, ignore_index=True)
    rng = np.random.default_rng(5)  # any will do
    sds = {}
    for column in ("pressure", "axial_force"):
        sds[column] = NOISE * frame[column].abs().max()
        frame[column] += rng.normal(0, sds[column], len(frame))
    data = ph.inflation_data(frame, **TUBE, **SECTOR, axial_stretch="axial", check="ignore")
    force = sds["axial_force"]  # one law has none
    model = ph.inflation_model(
        energy,
        data,
        sigma=np.sqrt(2) * sds["pressure"],
        slope_weight=1e-3,
        force_sigma=np.sqrt(2) * force if force > 0 else None,
        priors={n: pm.Uniform.dist(*ends) for n, ends in PRIORS.get(energy.name, {}).items()},
    )
    return model, parameters


def is_small(name):
    """Whether quadrature gives the evidence: up to two scalars."""
    return len(LAWS[name].entry_names) <= 2


# Three terms may change places, six modes that need their particles each; and what holds for the
# fibres of two laws needs no third one with eight parameters.
SLOW = ("OgdenSeries(terms=3)", "FourFiber")
SLOWEST = "GasserOgdenHolzapfel"


@pytest.mark.parametrize(
    "name",
    [
        *tiers([n for n in LAWS if n not in (*SLOW, SLOWEST)], first=is_small),
        *long([SLOWEST]),
    ],
)
def test_evidence_is_that_of_another_way(name):
    """SMC agrees with quadrature, or with a run of twice as many particles and other steps."""
    model, _ = study(name)
    settings = {"chains": 2, "progressbar": False, "var_names": []}
    # Of 500 in several dimensions a few decide at first in one run of six, which then says so.
    draws = 500 if is_small(name) else 1000
    value, error = ph.log_evidence(ph.sample_smc(model, draws, random_seed=1, **settings))
    if is_small(name):
        exact, exact_error = ph.log_evidence_by_quadrature(model)
    else:
        longer = ph.sample_smc(model, 2 * draws, random_seed=2, threshold=0.9, **settings)
        exact, exact_error = ph.log_evidence(longer)
    assert abs(value - exact) < STANDARD_ERRORS * np.hypot(error, exact_error)


@pytest.mark.parametrize("name", [name for name in LAWS if is_small(name)])
def test_parameters_are_found(name):
    """The posterior of one or two parameters holds those that the data were made with."""
    model, parameters = study(name)
    tree = ph.sample_smc(model, 1000, 2, 1, progressbar=False, var_names=list(parameters))
    for parameter, truth in parameters.items():
        # Ogden's exponent and Criscione's have either sign.
        draws = np.abs(tree["posterior"][parameter].values)
        assert np.abs(draws.mean() - np.abs(np.ravel(truth)[0])) < STANDARD_ERRORS * draws.std()


def test_prior_of_rising_pressures_is_a_density():
    """It is 0 where the pressure falls, and elsewhere larger by the share that is left."""
    radius = np.linspace(7.2, 12.0, 6)
    frame = {"specimen": "A", "experiment": 1, "radius": radius, "pressure": radius - 7}
    tube = {"inner_radius": 7.0, "outer_radius": 9.0}
    data = ph.inflation_data(pd.DataFrame(frame), **tube)
    settings = {"sigma": 1.0, "slope_weight": 0.0, "priors": {"n": pm.Uniform.dist(0.3, 5.0)}}
    screened = ph.power_law_neo_hookean_model(data, rising=True, **settings)
    potential = screened.compile_fn(
        screened["rising"], inputs=[screened["mu"], screened["n"]], point_fn=False, mode=AS_WRITTEN
    )
    # Whether pressure rises does not depend on the modulus: one integral over the exponent.
    exponents = np.linspace(0.3, 5.0, 401)
    between = np.linspace(radius[0], radius[-1], 200)[:, None]
    stiffness = ph.inflation_stiffness(
        ph.PowerLawNeoHookean(), between, **tube, mu=1.0, n=exponents
    ).eval(mode=AS_WRITTEN)
    share = np.mean(np.all(stiffness > 0, axis=0))
    assert 0.5 < share < 0.99
    assert potential(20.0, 0.35) == -np.inf
    assert np.abs(potential(20.0, 4.0) + np.log(share)) < 0.02  # of 20000 draws from the prior
