"""predict_pressure and predict_axial_force."""

import numpy as np
import oracles
import pytest
import xarray as xr
from problems import AS_WRITTEN
from tube_posteriors import ROUNDING, TUBES, ask, fitted_tree, result

import pymc_hyperelastic as ph

pytestmark = pytest.mark.compiled  # in both tiers: predictions are compiled for each law

INNER, THICKNESS = np.array([6.8, 7.0, 7.2]), np.array([1.9, 2.0, 2.2])


@pytest.mark.parametrize(
    ("predict", "name", "function"),
    [
        (ph.predict_pressure, "pressure", ph.inflation_pressure),
        (ph.predict_pressure, "stiffness", ph.inflation_stiffness),
        (ph.predict_axial_force, "axial_force", ph.axial_force),
    ],
    ids=["pressure", "stiffness", "axial force"],
)
def test_each_draw_is_predicted_with_its_own_parameters(predict, name, function):
    values = {"mu": [4.0, 6.0, 5.0], "alpha": [8.0, 12.0, -3.0]}
    # The result does not depend on the order of dimensions.
    posterior = result(**values)["posterior"].to_dataset().transpose()
    tree = xr.DataTree.from_dict({"posterior": posterior})
    tube, radius = TUBES["in vivo"], [0.3, 0.5]
    found = predict(tree, radius, tube=ph.Tube(**tube), energy=ph.Ogden())[name]
    assert found.dims == ("chain", "draw", "radius")
    assert found.attrs["units"] == {"pressure": "kPa", "stiffness": "kPa/mm"}.get(name, "mN")
    for draw in range(3):
        at = {n: of_draws[draw] for n, of_draws in values.items()}
        expected = function(ph.Ogden(), radius, ph.Tube(**tube), **at).eval(mode=AS_WRITTEN)
        np.testing.assert_allclose(found[0, draw], expected, rtol=ROUNDING)


INFERRED = {
    "outer radius": {"outer_radius": INNER + THICKNESS},
    "thickness": {"thickness": THICKNESS},
    # The opened sector has the area of the ring.
    "wall area": {"wall_area": (1 - 0.3 / np.pi) * np.pi * ((INNER + THICKNESS) ** 2 - INNER**2)},
}


@pytest.mark.parametrize("wall", INFERRED.values(), ids=INFERRED)
def test_each_draw_is_predicted_with_its_own_geometry(wall):
    axial, angle = np.array([1.1, 1.2, 1.3]), np.full(3, 0.6)
    tree = result(
        mu=np.full(3, 20.0), inner_radius=INNER, axial_stretch=axial, opening_angle=angle, **wall
    )
    functions = (ph.predict_pressure, ph.predict_axial_force, ph.radius_at_pressure, ph.wall_stress)
    arguments = ([7.5, 8.0], [7.5, 8.0], [1.0, 2.0], [1.0, 2.0])
    for function, argument in zip(functions, arguments, strict=True):
        found = ask(function, tree, argument, energy=ph.NeoHookean())
        for draw in range(3):
            tube = {
                "inner_radius": INNER[draw],
                "outer_radius": INNER[draw] + THICKNESS[draw],
                "axial_stretch": axial[draw],
                "opening_angle": angle[draw],
            }
            alone = ask(function, result(mu=[20.0]), argument, tube, energy=ph.NeoHookean())
            for name in alone:
                np.testing.assert_allclose(
                    found[name][:, [draw]], alone[name], rtol=1e-10, atol=1e-12
                )


@pytest.mark.parametrize(
    ("given", "inferred", "outer"),
    [
        ({}, {}, 9.0),
        ({}, {"outer_radius": [8.5], "thickness": [1.0]}, 8.5),
        ({"outer_radius": 8.2}, {"thickness": [1.0]}, 8.2),
        ({"outer_radius": 8.2}, {"outer_radius": [8.5]}, 8.2),
    ],
)
def test_tube_argument_overrides_posterior_and_posterior_overrides_data(given, inferred, outer):
    tree = fitted_tree(mu=[20.0], **inferred)
    found = ph.predict_pressure(tree, [8.0], tube=ph.Tube(**given))
    expected = oracles.neo_hookean_pressure(20.0, 8.0, 7.0, outer)
    np.testing.assert_allclose(found["pressure"].item(), expected, rtol=ROUNDING)
