"""Laws of fibres by constant matrices: taut and slack fibres, and parameters that no data allow."""

from functools import cache
from itertools import product

import numpy as np
import pandas as pd
import pymc as pm
import pytensor
import pytensor.tensor as pt
import pytest
from tables import SECTOR
from tiers import long, tiers

import pymc_hyperelastic as ph
from pymc_hyperelastic.evidence.batched import BatchedFunction
from pymc_hyperelastic.models.forward.collocated import Collocated
from pymc_hyperelastic.models.forward.direct import Direct
from pymc_hyperelastic.models.forward.divided import Divided
from pymc_hyperelastic.models.observation import Observation
from pymc_hyperelastic.models.priors import complete_priors

# Of the largest value of a curve.
CURVE_TOLERANCE = 1e-9
SEED = 20261123  # any would do
# Parameters are left out where pressures are so many times those that were measured.
FAR_BEYOND = 1000
OBSERVATION = Observation(noise_sd=0.3, slope_weight=0.0)
WITH_FORCE = Observation(noise_sd=0.3, slope_weight=0.01, force_noise_sd=1.0, force_offset_sd=20.0)
# Prior ranges of a soft tube, in which fibres are as stiff as in arteries.
RANGES = {"k1": (0.0, 50.0), "k2": (0.0, 10.0)}


def data(*, taut=False, stretches=(1.1, 1.25)):
    """Inflation tests, and an extension test, of a tube with an opening angle.

    Its inner face is shorter than unloaded, unless the wall is `taut`, and its outer face longer.
    """
    growth = 1.4 if taut else 1.0
    tests = [
        pd.DataFrame({"radius": growth * np.linspace(0.55, 0.68, 5), "stretch": stretch})
        for stretch in stretches
    ]
    extended = np.linspace(stretches[0], stretches[1], 7)
    tests.append(pd.DataFrame({"radius": growth * (0.75 - 0.12 * extended), "stretch": extended}))
    named = [test.assign(experiment=number) for number, test in enumerate(tests)]
    frame = pd.concat(named, ignore_index=True).assign(specimen="S")
    frame["pressure"] = 20 * (frame["radius"] / growth - 0.5)
    frame["axial_force"] = 60 * (frame["stretch"] - 0.5)
    frame.loc[[0, 3, 6], "axial_force"] = np.nan
    tube = {"inner_radius": 1.0, "outer_radius": 1.3, "opening_angle": 2.3}
    return ph.inflation_data(frame, axial_stretch="stretch", check="ignore", **tube, **SECTOR)


def priors_of(energy):
    ranges = {n: RANGES.get(n.split("_")[0]) for n in energy.parameter_names}
    return complete_priors(energy, {n: pm.Uniform.dist(*r) for n, r in ranges.items() if r})


def forward_of(energy, tests, mode="auto", observation=OBSERVATION):
    return observation.forward_model(energy, tests, priors_of(energy), mode=mode)


LAWS = {e.name: e for e in (ph.HolzapfelGasserOgden(), ph.FourFiber())}

# Forces and slopes take as long again.
SLOWEST = ("FourFiber", False, WITH_FORCE)
ALL = [
    ("HolzapfelGasserOgden", False, OBSERVATION),
    *((*case, WITH_FORCE) for case in product(LAWS, (False, True))),
]
CASES = [
    *tiers([case for case in ALL if case != SLOWEST], lambda case: case[2] is OBSERVATION),
    *long([SLOWEST]),
]


@cache
def both_ways(name, taut, observation):
    """Way that is chosen; curves, slopes and likelihood of draws by it, and by quadrature."""
    energy, tests = LAWS[name], data(taut=taut)
    forward = forward_of(energy, tests, "collocation", observation)
    with pm.Model() as model:
        parameters = {
            n: pm.Uniform(n, *(x.eval() for x in v.owner.op.dist_params(v.owner)))
            for n, v in priors_of(energy).items()
        }
        outputs = []
        for way in (forward.way, Direct(32, with_force=observation.with_force)):
            same = forward.with_data(tests)
            same.way = way
            tube = same.tube(parameters)
            outputs.append(tube.curves())
            if observation.with_force:
                outputs[-1] |= {f"slope of {n}": curve for n, curve in tube.slopes().items()}
                outputs[-1]["mapped"] = tube.mapped("sum", lambda _: lambda p, s: p + 0.1 * s)
            outputs[-1]["likelihood"] = observation.log_likelihood(tube)
    expressions = [x for of_way in outputs for x in of_way.values()]
    values = model.replace_rvs_by_values(expressions)
    function = BatchedFunction.of_model(model, values, {"mode": "FAST_COMPILE"})
    points = np.random.default_rng(SEED).logistic(size=(120, function.dimension))
    found = function(points)
    names = list(outputs[0])
    found, exact = (
        dict(zip(names, x, strict=True)) for x in (found[: len(names)], found[len(names) :])
    )
    limit = FAR_BEYOND * np.abs(tests["pressure"].values).max()
    return forward.way, found, exact, np.abs(exact["pressure"]).max(axis=1) < limit


@pytest.mark.parametrize(("name", "taut", "observation"), CASES)
def test_curves_are_those_of_quadrature(name, taut, observation):
    """Pressure, stiffness, force and slopes, wherever in the walls fibres slacken."""
    way, found, exact, possible = both_ways(name, taut, observation)
    assert isinstance(way, Collocated if taut else Divided)
    assert possible.sum() > 30
    for curve, expected in exact.items():
        if curve == "likelihood":
            np.testing.assert_allclose(found[curve][possible], expected[possible], CURVE_TOLERANCE)
            continue
        scale = np.abs(expected).max(axis=1)
        # Of stiff axial fibres the force hardly depends on the radius: it is known to its rounding.
        if curve == "slope of axial_force":
            scale = np.maximum(scale, np.abs(exact["axial_force"]).max(axis=1))
        error = np.abs(found[curve] - expected).max(axis=1)
        assert np.all(error[possible] <= CURVE_TOLERANCE * scale[possible]), curve


@pytest.mark.parametrize(("name", "taut", "observation"), CASES)
def test_parameters_that_were_left_out_stay_impossible(name, taut, observation):
    """Where pressures are far beyond the measured ones, so is the likelihood, by either way."""
    _, found, exact, possible = both_ways(name, taut, observation)
    best = exact["likelihood"].max()
    for likelihood in (found["likelihood"][~possible], exact["likelihood"][~possible]):
        assert not np.isnan(likelihood).any()
        assert np.all(likelihood < best - 1e6)


def test_draws_beyond_all_bounds_have_no_likelihood():
    """Fibres that are stiffer than any of the prior: huge pressures, and such that overflow."""
    tests = data(taut=True)
    forward = forward_of(ph.HolzapfelGasserOgden(), tests, "collocation")
    k2 = pt.scalar()
    tube = forward.tube({"c": 10.0, "k1": 500.0, "k2": k2, "beta": 1.0})
    outputs = [tube.curves()["pressure"], OBSERVATION.log_likelihood(tube)]
    function = pytensor.function([k2], outputs, mode="FAST_COMPILE")
    for stiffening in (10.0, 50.0, 1e4):
        with np.errstate(all="ignore"):
            pressure, likelihood = function(stiffening)
        # What overflows is not below anything either.
        assert not np.any(np.abs(pressure[-1]) < FAR_BEYOND * tests["pressure"].values.max())
        assert likelihood < -1e8
    assert likelihood == -np.inf


def test_kinks_elsewhere_are_not_collocated():
    """Of tubes that are pressed together fibres slacken at any stretch, of some laws anyhow."""
    energy = ph.HolzapfelGasserOgden()
    assert isinstance(forward_of(energy, data(stretches=(0.8, 0.9))).way, Direct)
    with pytest.raises(ValueError, match=r"HolzapfelGasserOgden.*mode='quadrature'"):
        forward_of(energy, data(stretches=(0.8, 0.9)), "collocation")


class Recruited(ph.StrainEnergy):
    """Fibres that are wavy until the hoop stretch is 1.05, told or not."""

    parameters = (ph.Parameter("mu", r"\mu", "kPa", (0.0, 50.0), "modulus"),)

    def __init__(self, told):
        self.told = told

    def energy(self, radial, hoop, axial, *, mu):
        taut = pt.maximum(hoop - 1.05, 0.0)
        return mu * (radial**2 + hoop**2 + axial**2 - 3 + taut**2)

    def kinks(self, log_axial, *, mu):
        return [pt.log(1.05) + pt.zeros_like(log_axial + mu)] if self.told else []


@pytest.mark.parametrize("told", [True, False])
def test_kinks_of_other_laws_are_not_collocated(told):
    """Those that a law tells of, and those that it does not."""
    assert isinstance(forward_of(Recruited(told), data()).way, Direct)
