"""Axial forces and outer diameters in the likelihood, by adaptive quadrature and by matrices."""

import numpy as np
import oracles
import pandas as pd
import pymc as pm
import pytensor
import pytest
from problems import AS_WRITTEN, LAWS, entries
from tables import SECTOR

import pymc_hyperelastic as ph

# Both sides are exact to about 1e-12 of the largest pressure, which enters as a square.
LIKELIHOOD_TOLERANCE = 1e-9
# The gradient sums the same terms with a derivative of the response, which loses two digits more.
GRADIENT_TOLERANCE = 1e-7
# Sums of the same terms in another order.
ROUNDING = 1e-12
SIGMA, SLOPE_WEIGHT = 15 * ph.mmHg, 3.2

# Unloaded inner and outer radius (mm), axial stretch and opening angle (degrees): inflated, no
# fibre slackens in any of them.
RIG_TUBES = ((1.0, 1.4, 1.0, 0.0), (0.4, 0.52, 1.5, 90.0), (3.0, 4.0, 1.2, 60.0))
FORCE_SIGMA = 7.0


# Of each kind of law one.
COLLOCATED = (
    "NeoHookean",
    "Gent",
    "Demiray",
    "OgdenSeries(terms=3)",
    "CriscioneType",
    "FungOrthotropic",
    "HolzapfelGasserOgden",
)


def rig_frame(points=5):
    """Made-up pressures and forces against the outer diameter; some forces were not measured."""
    rng = np.random.default_rng(3)
    frames = []
    for number, (inner, outer, axial, angle) in enumerate(RIG_TUBES):
        radius = inner * np.sort(rng.uniform(1.05, 1.35, points))
        k = 360 / (360 - angle)
        frame = pd.DataFrame({"radius": radius, "pressure": np.linspace(1.0, 16.0, points)})
        frame["outer_diameter"] = 2 * np.sqrt(radius**2 + (outer**2 - inner**2) / (k * axial))
        frame["pressure"] += rng.normal(0, 0.3, points)
        frame["axial_force"] = 10 * inner**2 * np.linspace(1.0, 2.0, points)
        frame.loc[number, "axial_force"] = np.nan
        names = {"inner": inner, "outer": outer, "axial": axial, "angle": angle}
        frames.append(frame.assign(specimen="S", experiment=number, **names))
    return pd.concat(frames, ignore_index=True)


def rig(measured="outer_diameter", frame=None):
    return ph.inflation_data(
        rig_frame() if frame is None else frame,
        inner_radius="inner",
        outer_radius="outer",
        axial_stretch="axial",
        opening_angle="angle",
        angle_unit="deg",
        measured=measured,
        check="ignore",
        **SECTOR,
    )


def around(parameters):
    """Priors that hold some of the ordinary parameters of a law, half as large and half more."""
    priors = {}
    for name, value in parameters.items():
        ends = np.sort(np.multiply.outer([0.5, 1.5], value), axis=0)
        priors[name] = pm.Uniform.dist(*ends, shape=np.shape(value) or None)
    return priors


def function_of(energy, data, priors, gradient=False, **settings):
    """Log-likelihood, perhaps with its gradient, as a function of the parameters themselves."""
    settings = {"sigma": SIGMA, "slope_weight": SLOPE_WEIGHT, **settings}
    with pm.Model() as model:
        parameters = {}
        for name, prior in priors.items():
            low, high = (x.eval() for x in prior.owner.op.dist_params(prior.owner))
            parameters[name] = pm.Uniform(
                name, low, high, shape=prior.type.shape or None, default_transform=None
            )
        potential = ph.inflation_likelihood("curves", energy, data, parameters, **settings)
    (value,) = model.replace_rvs_by_values([potential])
    inputs = model.value_vars
    outputs = [value, *(pytensor.grad(value, inputs) if gradient else ())]
    return pytensor.function(inputs, outputs, mode=AS_WRITTEN)


def exact_rig_likelihood(law, parameters, frame, *, by_outer_radius, force_sigma):
    """The likelihood by adaptive quadrature of each point, written in NumPy."""
    total = 0.0
    for _, test in frame.groupby("experiment"):
        curve = {"pressure": [], "stiffness": [], "force": []}
        for point in test.itertuples():
            inputs = {
                "internal_radius": point.radius,
                "inner_radius": point.inner,
                "outer_radius": point.outer,
                "axial_stretch": point.axial,
                "opening_angle": np.deg2rad(point.angle),
                **entries(parameters),
            }
            curve["pressure"].append(law.exact(inputs))
            curve["stiffness"].append(law.exact(inputs, "internal_radius"))
            curve["force"].append(law.exact(inputs, quantity=oracles.layered_force))
        radius, outer = test["radius"].to_numpy(), test["outer_diameter"].to_numpy() / 2
        measured = outer if by_outer_radius else radius
        # Of the chain rule, a da = r_o dr_o.
        slope = np.array(curve["stiffness"]) * (outer / radius if by_outer_radius else 1.0)
        difference = np.zeros((len(test) - 2, len(test)))
        for row in range(len(test) - 2):
            step = measured[row + 2] - measured[row]
            difference[row, [row, row + 2]] = -1 / step, 1 / step
        pressure = test["pressure"].to_numpy()
        misfit = np.sum((curve["pressure"] - pressure) ** 2)
        misfit += SLOPE_WEIGHT * np.sum((slope[1:-1] - difference @ pressure) ** 2)
        gram = np.eye(len(test)) + SLOPE_WEIGHT * difference.T @ difference
        total += np.linalg.slogdet(gram / (np.pi * SIGMA**2))[1] / 2 - misfit / SIGMA**2
        error = (curve["force"] - test["axial_force"]).dropna()
        total -= np.sum(error**2) / force_sigma**2
        total -= len(error) / 2 * np.log(np.pi * force_sigma**2)
    return total


@pytest.mark.parametrize("measured", ["radius", "outer_diameter"])
@pytest.mark.parametrize("name", ["Ogden", "HolzapfelGasserOgden"])
def test_forces_and_diameters_enter_as_written(name, measured):
    """Pressures, slopes by the measured radius, forces where they are, and the normaliser."""
    law = LAWS[name]
    parameters = law.parameters[0][0]
    frame = rig_frame(points=3).query("experiment > 0")
    expected = exact_rig_likelihood(
        law,
        parameters,
        frame,
        by_outer_radius=measured == "outer_diameter",
        force_sigma=FORCE_SIGMA,
    )
    for mode in ("collocation", "quadrature"):
        function = function_of(
            law.strain_energy,
            rig(measured, frame),
            around(parameters),
            mode=mode,
            force_sigma=FORCE_SIGMA,
        )
        value, *_ = function(*parameters.values())
        np.testing.assert_allclose(value, expected, rtol=LIKELIHOOD_TOLERANCE, err_msg=mode)


@pytest.mark.parametrize("name", COLLOCATED)
def test_laws_collocate_with_force_and_diameter(name):
    """Constant matrices have the value and gradient of direct quadrature, for all kinds of laws."""
    law = LAWS[name]
    parameters = law.parameters[0][0]
    priors = around(parameters)
    collocated, direct = (
        function_of(law.strain_energy, rig(), priors, True, mode=mode, force_sigma=FORCE_SIGMA)
        for mode in ("collocation", "quadrature")
    )
    for factor in (0.51, 1.0, 1.49):
        point = [factor * np.asarray(value, float) for value in parameters.values()]
        (first, *first_gradient), (second, *second_gradient) = collocated(*point), direct(*point)
        np.testing.assert_allclose(first, second, rtol=LIKELIHOOD_TOLERANCE)
        # Components in comparable units: what the log-likelihood changes by over the prior.
        first, second = (
            np.concatenate([np.ravel(g * x) for g, x in zip(gradient, point, strict=True)])
            for gradient in (first_gradient, second_gradient)
        )
        assert np.max(np.abs(first - second)) <= GRADIENT_TOLERANCE * np.max(np.abs(second))


@pytest.mark.parametrize("mode", ["collocation", "quadrature"])
def test_a_force_that_was_not_measured_is_left_out_of_the_forces_alone(mode):
    """Without any force of a test its pressures still count, and so without the whole column."""
    energy, parameters = ph.Ogden(), {"mu": 6.0, "alpha": 8.0}

    def value(frame, **settings):
        function = function_of(energy, rig(frame=frame), around(parameters), mode=mode, **settings)
        return function(*parameters.values())[0]

    frame = rig_frame()
    one = frame.assign(axial_force=frame["axial_force"].where(frame.index == 7))
    other = frame.assign(axial_force=frame["axial_force"].where(frame.index != 7))
    without = frame.drop(columns="axial_force")
    both, first, second = (value(f, force_sigma=FORCE_SIGMA) for f in (frame, one, other))
    np.testing.assert_allclose(both, first + second - value(without), rtol=ROUNDING * 10)
    # A column that is there but has no part in the likelihood.
    assert value(frame) == value(without)


def test_inferred_force_error_gives_the_number_of_a_known_one():
    """Its normaliser counts the forces, and not the points."""
    parameters = {"mu": 6.0, "alpha": 8.0}
    data, noise = rig(), {"sigma": SIGMA, "slope_weight": SLOPE_WEIGHT}
    with pm.Model() as model:
        force_sigma = pm.Uniform("force_sigma", 0.0, 100.0, default_transform=None)
        ph.inflation_likelihood(
            "curves", ph.Ogden(), data, parameters, force_sigma=force_sigma, **noise
        )
    (potential,) = model.replace_rvs_by_values(model.potentials)
    function = pytensor.function(model.value_vars, potential, mode=AS_WRITTEN)
    for value in (0.05, 2.0, 90.0):
        known = function_of(ph.Ogden(), data, around(parameters), force_sigma=value)
        np.testing.assert_allclose(
            function(value), known(*parameters.values())[0], rtol=LIKELIHOOD_TOLERANCE
        )
