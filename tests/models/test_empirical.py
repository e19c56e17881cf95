"""Laws where both stretches vary, by nodes that the law asks for, against quadrature."""

from functools import cache

import numpy as np
import pandas as pd
import pymc as pm
import pytest
from tiers import tiers

import pymc_hyperelastic as ph
from pymc_hyperelastic.classes.variable import Variability
from pymc_hyperelastic.evidence.batched import BatchedFunction
from pymc_hyperelastic.models.forward.collocated import Collocated
from pymc_hyperelastic.models.forward.direct import Direct
from pymc_hyperelastic.models.forward.divided import Divided
from pymc_hyperelastic.models.observation import Observation
from pymc_hyperelastic.models.priors import complete_priors

# Of the largest value of a curve; of a slope, for which nodes were not chosen, so many times that.
CURVE_TOLERANCE, OF_SLOPES = 1e-9, 10
# 1/mm: force divided by the smallest length over which it is seen to change, a hundredth of a mm.
SHORTEST = 100.0
SEED = 20261124
# Nodes are for materials whose pressures are below so many times those that were measured.
BEYOND = 10
WITH_FORCE = Observation(noise_sd=0.1, force_noise_sd=0.2)
RANGES = {
    "c": (1.0, 40.0),
    "k1": (0.0, 50.0),
    "k2": (0.0, 2.0),
    "mu": (0.1, 20.0),
    "alpha": (1.0, 6.0),
}


def protocols(growth=1.0, *, points=6, specimens=1):
    """Three inflation tests and four extension tests on mouse aortas of different size."""
    tests = []
    for specimen in range(specimens):
        size = growth * (1 + 0.05 * specimen)
        for stretch in (1.5, 1.6, 1.7):
            radius = size * np.linspace(0.42, 0.62, points)
            tests.append({"radius": radius, "stretch": stretch, "specimen": specimen})
        for radius in (0.45, 0.5, 0.55, 0.6):
            stretch = np.linspace(1.4, 1.7, points)
            radii = size * radius - 0.1 * (stretch - 1.4)
            tests.append({"radius": radii, "stretch": stretch, "specimen": specimen})
    frame = pd.concat([pd.DataFrame(t).assign(experiment=i) for i, t in enumerate(tests)])
    frame["pressure"] = 40 * (frame["radius"] - 0.3)
    frame["axial_force"] = 20 * (frame["stretch"] - 1.2)
    tube = {"inner_radius": 0.38, "outer_radius": 0.48}
    return ph.inflation_data(frame, axial_stretch="stretch", check="ignore", **tube)


def priors_of(energy):
    names = {n: RANGES.get(n.split("_")[0]) for n in energy.parameter_names}
    given = {n: pm.Uniform.dist(*between) for n, between in names.items() if between}
    return complete_priors(energy, given)


@cache
def forward_of(law, by_test=False):
    energy, tests = LAWS[law], protocols(specimens=SPECIMENS[law])
    if law == "Ogden":  # the prior of a class is wide; under a narrow one a grid is small enough
        return class_of(law).forward_model(tests, by_test=by_test)
    return WITH_FORCE.forward_model(energy, tests, priors_of(energy), by_test=by_test)


def class_of(law):
    return Variability.of_settings(LAWS[law], **WITH_FORCE.noise)


LOWER = -1.5, 0.7


def curves_both_ways(law, tests, by_test=False, draws=50):
    """Curves and slopes of draws by what was chosen for other tests, and by quadrature."""
    energy = LAWS[law]
    forward, outputs = forward_of(law, by_test), []
    shape = (tests.sizes["test"],) if by_test else ()
    with pm.Model() as model:
        parameters = {
            n: pm.Uniform(n, *(x.eval() for x in v.owner.op.dist_params(v.owner)), shape=shape)
            for n, v in priors_of(energy).items()
        }
        for way in (forward.way, Direct(32, True, by_test)):
            same = forward.with_data(tests)
            same.way = way
            tube = same.tube(parameters)
            outputs += [*tube.curves().values(), *tube.slopes().values()]
    values = model.replace_rvs_by_values(outputs)
    function = BatchedFunction.of_model(model, values, {"mode": "FAST_COMPILE"})
    # Of the lower part of each range: in the upper one most pressures are none that vessels bear.
    rng = np.random.default_rng(SEED)
    found = function(rng.logistic(*LOWER, size=(draws, function.dimension)))
    count, largest = len(found) // 2, np.abs(found[len(found) // 2]).max(axis=1)
    possible = largest < BEYOND * np.abs(tests["pressure"].values).max()
    assert possible.sum() > 15
    return [x[possible] for x in found[:count]], [x[possible] for x in found[count:]]


LAWS = {e.name: e for e in (ph.HolzapfelGasserOgden(), ph.FourFiber(), ph.Ogden())}
SPECIMENS = {"HolzapfelGasserOgden": 1, "FourFiber": 2, "Ogden": 3}
CASES = tiers([*LAWS], lambda law: law != "FourFiber")


def assert_alike(found, exact, tolerance=CURVE_TOLERANCE):
    """Pressure, stiffness, force, and slopes of pressure and force."""
    scales = [np.abs(curve).max(axis=1) for curve in exact]
    # Of stiff axial fibres the force hardly depends on the radius: a slope that is known to the
    # rounding of their stresses.
    scales[-1] = np.hypot(scales[-1], SHORTEST * scales[2])
    for i, (curve, scale) in enumerate(zip(exact, scales, strict=True)):
        error = np.abs(found[i] - curve).max(axis=1)
        of_slopes = 1 if i in (0, 2) else OF_SLOPES
        assert np.all(error <= of_slopes * tolerance * scale), (i, np.max(error / scale))


@pytest.mark.parametrize("law", CASES)
def test_curves_are_those_of_quadrature(law):
    """Of the data for which the nodes were made, in walls where fibres slacken, and elsewhere."""
    way = forward_of(law).way
    taut = way.taut if isinstance(way, Divided) else way
    assert isinstance(taut, Collocated) and taut.basis
    assert_alike(*curves_both_ways(law, protocols(specimens=SPECIMENS[law])))


@pytest.mark.parametrize("law", CASES)
def test_other_tests_in_place_of_those(law):
    """Fewer points of one specimen, and one of these protocols alone."""
    tests = protocols(points=5)
    assert_alike(*curves_both_ways(law, tests))
    assert_alike(*curves_both_ways(law, ph.select(tests, experiment=1)))


@pytest.mark.deep
@pytest.mark.parametrize("law", LAWS)
def test_each_test_with_parameters_of_its_own(law):
    """As where the experiments on a specimen differ."""
    assert_alike(*curves_both_ways(law, protocols(points=5), by_test=True, draws=150))


@pytest.mark.parametrize("law", CASES)
def test_the_prior_of_a_class_has_nodes(law):
    """Its fibres may stiffen by hundreds of orders of magnitude, its walls be of any thickness."""
    tests = protocols(specimens=max(3, SPECIMENS[law]))
    way = class_of(law).forward_model(tests).way
    taut = way.taut if isinstance(way, Divided) else way
    assert isinstance(taut, Collocated) and taut.basis


def test_larger_tubes_in_place_of_those():
    """Stretches a twentieth beyond those for which nodes were made: two digits are lost."""
    larger = protocols(growth=1.08)
    assert_alike(*curves_both_ways("HolzapfelGasserOgden", larger), tolerance=1e-6)
