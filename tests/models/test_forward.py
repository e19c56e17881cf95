"""The forward model: other data in the place of its own, without compiling again."""

import numpy as np
import pandas as pd
import pymc as pm
import pytensor
import pytest

import pymc_hyperelastic as ph
from pymc_hyperelastic.models.observation import Observation
from pymc_hyperelastic.models.priors import complete_priors

# The same sums of the same numbers, by another compilation.
ROUNDING = 1e-12
# Correlations of so many draws are known to 0.02; those between neighbours of a point are 0.2.
DRAWS, CORRELATION_TOLERANCE = 3000, 0.08
FAST = "FAST_COMPILE"
PARAMETERS = {"mu": 6.0, "alpha": 8.0}


def data(points, *, seed=1, tests=2, measured="radius"):
    """Tests of tubes of different geometry, of so many points the first and more the next."""
    rng = np.random.default_rng(seed)
    frames = []
    for test in range(tests):
        count = points + 2 * test
        growth = np.sort(rng.uniform(1.0, 1.4, count))
        frame = pd.DataFrame({"specimen": "S", "experiment": test, measured: 7.0 * growth})
        if measured == "outer_diameter":
            frame[measured] = 18.0 * growth
        frame["pressure"] = 10 * (growth - 1) + 0.1 * rng.standard_normal(count)
        frame["axial_force"] = np.where(np.arange(count) % 3, 20.0 * growth, np.nan)
        frames.append(frame.assign(stretch=1.0 + 0.1 * test))
    return ph.inflation_data(
        pd.concat(frames, ignore_index=True),
        inner_radius=7.0,
        outer_radius=9.0,
        axial_stretch="stretch",
        measured=measured,
    )


OBSERVATIONS = {
    "pressures": Observation(0.5),
    "slopes": Observation(0.5, 2.0),
    "forces": Observation(0.5, 2.0, 3.0),
}


@pytest.mark.parametrize("measured", ["radius", "outer_diameter"])
@pytest.mark.parametrize("mode", ["collocation", "quadrature"])
@pytest.mark.parametrize("observation", OBSERVATIONS.values(), ids=OBSERVATIONS)
def test_other_data_take_the_place_of_these(observation, mode, measured):
    """A compiled likelihood follows the data, of other lengths too, as one made of them does."""
    energy = ph.Ogden()
    first, other = (data(n, seed=n, measured=measured) for n in (6, 9))
    forward = observation.forward_model(energy, first, complete_priors(energy), mode=mode)
    tube = forward.tube(PARAMETERS)
    outputs = [observation.log_likelihood(tube), *tube.curves().values()]
    function = pytensor.function([], outputs, mode=FAST)
    before = function()
    forward.set_data(other)
    found = function()
    fresh = forward.with_data(other).tube(PARAMETERS)
    expected = pytensor.function(
        [], [observation.log_likelihood(fresh), *fresh.curves().values()], mode=FAST
    )()
    for value, exact in zip(found, expected, strict=True):
        np.testing.assert_allclose(value, exact, rtol=ROUNDING)
    assert found[0] != before[0]
    assert len(found[1]) == other.sizes["obs"]


@pytest.mark.parametrize("mode", ["collocation", "quadrature"])
def test_measurements_that_are_drawn_follow_the_data(mode):
    """Of the generative likelihood the density follows other data, and so do its draws."""
    energy, first, other = ph.Ogden(), data(6, seed=6), data(9, seed=9)
    settings = {"sigma": 0.5, "slope_weight": 2.0, "likelihood": "generative"}
    observation = Observation(**settings)
    forward = observation.forward_model(energy, first, complete_priors(energy), mode=mode)
    with pm.Model() as model:
        tube = forward.tube(PARAMETERS)
        observation.register(tube, tube.curves(), dims=None)
    forward.set_data(other)
    fixed = {
        name: pm.Uniform.dist(value - 1e-9, value + 1e-9) for name, value in PARAMETERS.items()
    }
    fresh = ph.inflation_model(energy, other, priors=fixed, mode=mode, **settings)
    density, expected = (
        m.compile_logp(m.observed_RVs, sum=False, mode=FAST)(m.initial_point())[0]
        for m in (model, fresh)
    )
    # The parameters of the other model are only as fixed as a prior can be.
    np.testing.assert_allclose(density, expected, rtol=1e-6)
    drawn, others = (
        np.corrcoef(pm.draw(m["measured_pressure"], DRAWS, random_seed=3, mode=FAST), rowvar=False)
        for m in (model, fresh)
    )
    assert drawn.shape == (other.sizes["obs"],) * 2
    np.testing.assert_allclose(drawn, others, atol=CORRELATION_TOLERANCE)


def test_targets_of_one_model_are_kept_apart():
    """Two observations of one forward model, with slopes of different weights, do not mix."""
    energy, curves = ph.Ogden(), data(7)
    one, two = Observation(0.5, 1.0), Observation(0.5, 3.0)
    forward = one.forward_model(energy, curves, complete_priors(energy))
    together = [o.log_likelihood(forward.tube(PARAMETERS)) for o in (one, two)]
    alone = [o.log_likelihood(forward.with_data(curves).tube(PARAMETERS)) for o in (one, two)]
    found = pytensor.function([], [*together, *alone], mode=FAST)()
    np.testing.assert_allclose(found[:2], found[2:], rtol=ROUNDING)
    assert found[0] != found[1]


def test_constants_are_not_replaced():
    """A model of which data are constants says so, in place of keeping the old ones."""
    energy, curves = ph.Ogden(), data(6)
    forward = Observation(0.5).forward_model(
        energy, curves, complete_priors(energy), replaceable=False
    )
    with pytest.raises(TypeError, match="constants"):
        forward.set_data(data(9))


def test_data_of_another_kind_are_refused():
    """Diameters do not take the place of radii where each is an input of its own."""
    energy = ph.Ogden()
    forward = Observation(0.5).forward_model(
        energy, data(6), complete_priors(energy), mode="quadrature"
    )
    forward.tube(PARAMETERS).curves()
    with pytest.raises(ValueError, match=r"another kind.*current_outer_radius"):
        forward.set_data(data(6, measured="outer_diameter"))
