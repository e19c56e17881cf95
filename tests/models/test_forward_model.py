"""The forward model: curves of every law at every point, and replaced data."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pymc as pm
import pytensor
import pytensor.tensor as pt
import pytest
import shared_errors
from problems import AS_WRITTEN, LAWS
from shared_errors import EXTENDED, Dense, extended, ogden
from tables import SECTOR
from tiers import tiers

import pymc_hyperelastic as ph
from pymc_hyperelastic.data.inflation import at_points
from pymc_hyperelastic.models.forward import forward_model
from pymc_hyperelastic.models.forward.blocks import table_arrays
from pymc_hyperelastic.models.priors import complete_priors

# Relative to the largest pressure, or force, of a curve.
CURVE_TOLERANCE = 1e-8
# Relative error of sums of squares of curves that are exact to 1e-12, and of one sum twice.
LIKELIHOOD_TOLERANCE, ROUNDING = 1e-9, 1e-12

INNER, OUTER, ANGLE = 1.0, 1.3, 0.8
OGDEN = {"mu": 6.0, "alpha": 5.0}
PRIORS = {"mu": pm.Uniform.dist(1, 20), "alpha": pm.Uniform.dist(2, 8)}


def evaluated(outputs):
    return pytensor.function([], outputs, mode=AS_WRITTEN)()


def opened_tube(outer=OUTER):
    """Two points of an inflation test, and two of an extension test, of a tube that was cut."""
    frame = pd.DataFrame({"specimen": "S", "experiment": [1, 1, 2, 2]})
    frame = frame.assign(radius=[1.1, 1.25, 1.15, 1.2], stretch=[1.3, 1.3, 1.45, 1.2])
    frame = frame.assign(pressure=[2.0, 9.0, 4.0, 5.0], axial_force=30.0)
    tube = ph.Tube(INNER, outer, axial_stretch="stretch", opening_angle=ANGLE, **SECTOR)
    return ph.inflation_data(frame, tube, check="ignore")


def around(parameters):
    """Priors from half of each parameter to one and a half of it."""
    priors = {}
    for name, value in parameters.items():
        ends = np.sort(np.multiply.outer([0.5, 1.5], value), axis=0)
        priors[name] = pm.Uniform.dist(*ends, shape=np.shape(value) or None)
    return priors


# Laws with fibres are in test_integrators.py.
FIRST = ("Gent", "OgdenSeries(terms=2)", "CriscioneType")
BY_LAW = tiers(LAWS, lambda name: name in FIRST)


@pytest.mark.parametrize("name", BY_LAW)
def test_curves_of_every_law_use_the_axial_stretch_of_each_point(name):
    """By tabulated and by pointwise quadrature, and as the inner one of two layers."""
    law, data = LAWS[name], opened_tube()
    parameters = {n: np.array(v, float) for n, v in law.parameters[0][0].items()}
    inner = ph.Layer(law.strain_energy, OUTER - INNER, **parameters)
    wall = [inner, ph.Layer(ph.NeoHookean(), 0.1, mu=12.0)]
    curves = []
    for mode in ("quadrature", "collocation"):
        priors = around(law.parameters[0][0])
        forward = forward_model(law.strain_energy, data, priors, mode=mode, with_force=True)
        curves.append(forward.with_variables(parameters).curves())
    forward = forward_model(wall, opened_tube(None), {}, with_force=True)
    curves.append(forward.with_variables({}).curves())
    # tests/mechanics compare these functions with independent quadrature.
    axial, radius = at_points(data, "axial_stretch"), data["radius"].values
    tube = ph.Tube(INNER, axial_stretch=axial, opening_angle=ANGLE)
    single = law.strain_energy, radius, replace(tube, outer_radius=OUTER)
    for curve, function in (("pressure", ph.inflation_pressure), ("axial_force", ph.axial_force)):
        expected = [function(*single, **parameters)] * 2 + [function(wall, radius, tube)]
        both = evaluated([*(c[curve] for c in curves), *expected])
        for found, exact in zip(both[:3], both[3:], strict=True):
            # The energy of one law does not depend on the axial stretch: its force is 0.
            scale = max(np.abs(exact).max(), 1e-6)
            np.testing.assert_allclose(found, exact, rtol=0, atol=CURVE_TOLERANCE * scale)


# --- other data ----------------------------------------------------------------------------------


SDS = {"pressure_sd": 0.4, "force_sd": 3.0}
OFFSET = SDS | {"force_offset_sd": 25.0}
DIAMETER = SDS | {"diameter_sd": 0.1}


def dense(data, sds):
    return Dense(data, [(ogden(**OGDEN), 2.0)], **sds)


@pytest.mark.parametrize(
    ("sds", "mode", "measured"),
    [
        (SDS, "collocation", "radius"),
        (OFFSET, "quadrature", "outer_diameter"),
        (DIAMETER, "collocation", "outer_diameter"),
    ],
)
def test_compiled_likelihood_of_replaced_data_is_exact(sds, mode, measured):
    """The replacing data differ in length, number of forces, and kinds of tests."""
    likelihood, first = ph.Gaussian(**sds), extended(measured)
    forward = likelihood.forward_model(ph.Ogden(), first, PRIORS, mode=mode)
    log_likelihood = likelihood.log_likelihood(forward.with_variables(OGDEN))
    function = pytensor.function([], log_likelihood, mode=AS_WRITTEN)
    inflated = [test for test in range(5) if test not in EXTENDED]
    others = [shared_errors.dataset(shared_errors.table((3, 7), seed=2), measured)]
    others += [ph.select(first, experiment=list(own)) for own in (EXTENDED, inflated)]
    # With more points than stretches, a part of the misfit is a constant.
    others.append(shared_errors.dataset(shared_errors.table((100, 60)), measured))
    without = others[0].copy(deep=True)
    without["axial_force"][:] = np.nan
    for data in (*others, without, first):
        forward.set_data(data)
        expected = dense(data, sds).log_density()
        assert function() == pytest.approx(expected, rel=LIKELIHOOD_TOLERANCE)
    again = likelihood.log_likelihood(forward.with_data(others[1]).with_variables(OGDEN))
    expected = dense(others[1], sds).log_density()
    assert evaluated([again])[0] == pytest.approx(expected, rel=LIKELIHOOD_TOLERANCE)


def test_data_of_another_kind_cannot_replace_the_first_data():
    """Data that are constants, radii by diameters, and inflation tests by extension tests."""
    data, other = shared_errors.dataset(), shared_errors.dataset(measured="outer_diameter")
    fixed = forward_model(ph.Ogden(), data, PRIORS, replaceable=False)
    with pytest.raises(TypeError, match="constants"):
        fixed.set_data(other)
    direct = forward_model(ph.Ogden(), data, PRIORS, mode="quadrature")
    direct.with_variables(OGDEN).curves()
    with pytest.raises(ValueError, match=r"another kind.*current_outer_radius"):
        direct.set_data(other)
    inflated = ph.select(extended(), experiment=[1, 2, 4])
    forward = forward_model(ph.Ogden(), inflated, PRIORS, mode="collocation")
    forward.with_variables(OGDEN).curves()
    with pytest.raises(ValueError, match=r"axial_stretch varies.*data that hold extension tests"):
        forward.set_data(extended())


def test_between_returns_evenly_spaced_points_of_each_test():
    """Along the radius of an inflation test, and along the stretch of an extension test."""
    both = extended()
    between = forward_model(ph.Ogden(), both, PRIORS, mode="quadrature").between().data
    assert between.sizes["obs"] == 20 * both.sizes["test"]
    for test in range(4):
        own, measured = (d.isel(obs=d["test"].values == test) for d in (between, both))
        along = "axial_stretch" if test in EXTENDED else "radius"
        ends = measured[along].values.min(), measured[along].values.max()
        np.testing.assert_allclose(own[along], np.linspace(*ends, 20))


@pytest.mark.parametrize("mode", ["auto", "collocation"])
def test_curves_are_exact_for_a_law_that_polynomials_cannot_approximate(mode):
    """Near n = 0 the response of this law has a pole: nodes are selected, or walls integrated."""
    frame = pd.DataFrame({"specimen": "S", "experiment": 1, "radius": np.linspace(6.4, 10.5, 9)})
    frame = frame.assign(pressure=2 * (frame["radius"] - 6.0), axial=1.0)
    data, energy = shared_errors.dataset(frame), ph.PowerLawNeoHookean()
    priors = complete_priors(energy, {"n": pm.Normal.dist(0, 10)})
    forward = forward_model(energy, data, priors, mode=mode)
    assert forward.integrator.by_points == (mode == "auto")
    tube = forward.with_variables({"mu": 20.0, "n": pt.constant(2.0)})
    pressure = evaluated([tube.curves()["pressure"]])[0]
    names = ("inner_radius", "outer_radius", "axial_stretch")
    known = ph.Tube(**{name: at_points(data, name) for name in names})
    exact = ph.inflation_pressure(energy, data["radius"].values, known, mu=20.0, n=2.0)
    exact = exact.eval(mode=AS_WRITTEN)
    np.testing.assert_allclose(pressure, exact, rtol=0, atol=1e-9 * exact.max())  # its tolerance


def test_table_of_points_has_as_many_columns_as_the_longest_test():
    found = table_arrays(np.array([0, 0, 0, 2, 2]), 3)
    assert found["there"].tolist() == [[True] * 3, [False] * 3, [True, True, False]]
    assert found["place"].tolist() == [0, 1, 2, 6, 7]


def test_improper_prior_warns_and_uses_quadrature_of_32_nodes():
    """The range of parameters with flat priors is unknown: walls are integrated with 32 nodes."""
    priors = {name: pm.Flat.dist() for name in ("mu", "alpha")}
    data = shared_errors.dataset()
    with pytest.warns(UserWarning, match=r"cannot be drawn from.*32 nodes"):
        forward = forward_model(ph.Ogden(), data, priors)
    assert forward.integrator.by_points and forward.integrator.order == 32
    with pytest.raises(ValueError, match=r"cannot be drawn from.*mode='quadrature'"):
        forward_model(ph.Ogden(), data, priors, mode="collocation")
    assert forward_model(ph.Ogden(), data, priors, mode="quadrature").integrator.order == 32


def test_parameter_that_is_data_warns_and_follows_a_change_of_the_data():
    """The range of ``pm.Data`` is unknown: walls are integrated with 32 nodes, and are exact."""
    data = shared_errors.dataset()

    def log_density(model):
        return model.compile_logp()({"mu_interval__": 0.0})

    with pm.Model() as own:
        priors = {"mu": pm.Uniform("mu", 0, 50), "alpha": pm.Data("alpha", 4.0)}
        with pytest.warns(UserWarning, match=r"cannot be drawn from \(alpha depends on no random"):
            ph.inflation_model(ph.Ogden(), data, 0.5, priors=priors, name="tube")
        pm.set_data({"alpha": 9.0})
    with pm.Model() as expected:
        parameters = {"mu": pm.Uniform("mu", 0, 50), "alpha": 9.0}
        ph.inflation_likelihood("tube", ph.Ogden(), data, 0.5, parameters, mode="quadrature")
    np.testing.assert_allclose(log_density(own), log_density(expected), rtol=1e-9)


def test_prior_that_depends_on_data_warns_and_follows_a_change_of_the_data():
    """Tables for the range of a prior would be wrong after ``pm.set_data``."""
    data = shared_errors.dataset()
    found = []
    for first in (0.5, 9.0):
        with pm.Model() as own:
            center = pm.Data("center", first)
            priors = {"mu": pm.Uniform("mu", 0, 50), "alpha": pm.Normal("alpha", center, 0.01)}
            with pytest.warns(UserWarning, match="depends on center, which may be set"):
                ph.inflation_model(ph.Ogden(), data, 0.5, priors=priors, name="tube")
            pm.set_data({"center": 9.0})
        found.append(own.compile_logp()({"mu_interval__": 0.0, "alpha": 9.0}))
    assert found[0] == pytest.approx(found[1], rel=ROUNDING)


def test_sizes_of_priors_may_depend_on_lengths_of_dimensions():
    with pm.Model(coords={"term": [1, 2]}):
        mu = pm.LogNormal("mu", 2, 1, dims="term")
        alpha = pm.Normal("alpha", [2.0, 6.0], 1, dims="term")
        priors = {"mu": mu, "alpha": alpha}
        ph.inflation_model(ph.OgdenSeries(2), shared_errors.dataset(), 0.5, priors=priors, name="t")
