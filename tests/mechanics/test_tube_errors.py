"""Errors for impossible tubes, walls and materials name the argument and the expected value."""

import numpy as np
import pytest
from tables import with_tube

import pymc_hyperelastic as ph

TUBE = {"inner_radius": 7.0, "outer_radius": 9.0}
MATERIAL = {"mu": 6.0, "alpha": 8.0}
FUNG = {"convention": "fung"}
RING = TUBE | FUNG | {"radii_of": "ring"}
UNIT, THIN = {"inner_radius": 1.0}, {"inner_radius": 7.0, "outer_radius": [9.0, 7.0]}
OGDEN, LAYER = ph.Ogden(), ph.Layer(ph.NeoHookean(), 0.3, mu=20.0)
SERIES = ph.Layer(ph.OgdenSeries(2), 0.3, mu=[1.0], alpha=[2.0, 3.0])
FUNCTIONS = (ph.inflation_pressure, ph.inflation_stiffness, ph.axial_force)

# Strain energy or layers, internal radius, other arguments, error and message.
TUBES = [
    (OGDEN, 8.0, TUBE | {"mu": 6.0}, TypeError, r"Ogden.*'mu', 'alpha'.*\['mu'\] were given"),
    (ph.Ogden, 8.0, TUBE | MATERIAL, TypeError, r"ph\.Ogden\(\).*call the class"),
    ("Ogden", 8.0, TUBE | MATERIAL, TypeError, r"ph\.Ogden\(\).*got 'Ogden'$"),
    (OGDEN, 8.0, {"inner_radius": 7.0, **MATERIAL}, TypeError, "outer_radius is missing"),
    (OGDEN, 8.0, MATERIAL, TypeError, r"Tube\(\) has no inner_radius"),
    (OGDEN, 8.0, UNIT | MATERIAL | {"thickness": -0.1}, ValueError, "thickness must be.*-0.1"),
    (OGDEN, 8.0, UNIT | MATERIAL | {"wall_area": "S"}, TypeError, "wall_area is 'S'; expected"),
    (OGDEN, 8.0, TUBE | MATERIAL | {"sd": {}}, ValueError, "only ph.inflation_data .*leave sd"),
    (OGDEN, "wide", TUBE | MATERIAL, TypeError, "internal_radius is 'wide'"),
    (OGDEN, 8.0, MATERIAL | THIN, ValueError, r"exceed inner_radius; got \[9. 7.\] and 7.0"),
    (OGDEN, [8.0, 0.0], TUBE | MATERIAL, ValueError, "internal_radius must be positive.*0"),
    (OGDEN, [8.0, np.inf], TUBE | MATERIAL, ValueError, "must be positive and finite.*inf"),
    (OGDEN, 8.0, TUBE | MATERIAL | {"inner_radius": -7.0}, ValueError, "^inner_radius must.*-7"),
    (OGDEN, 8.0, TUBE | MATERIAL | {"axial_stretch": 0.0}, ValueError, "axial_stretch must be"),
    (OGDEN, 8.0, TUBE | MATERIAL | {"opening_angle": 60.0}, ValueError, "radians.*60.*np.deg2rad"),
    (OGDEN, 8.0, TUBE | MATERIAL | {"opening_angle": 2 * np.pi}, ValueError, "below 2π"),
    (OGDEN, 8.0, TUBE | MATERIAL | FUNG | {"opening_angle": 4.0}, ValueError, "2π; got 8"),
    (OGDEN, 8.0, RING | MATERIAL | {"opening_angle": [1.0, np.pi]}, ValueError, "below 2π; got"),
    ([], 1.2, UNIT, TypeError, "holds 'nothing'"),
    ([ph.NeoHookean()], 1.2, UNIT, TypeError, r"of layers.*holds NeoHookean\(\)"),
    (LAYER, 1.2, UNIT, TypeError, "a strain energy such as"),
    ([LAYER], 8.0, TUBE | {"mu": 2.0}, TypeError, r"\['outer_radius', 'mu'\] cannot be given"),
    ([LAYER], 8.0, UNIT | {"thickness": 0.3}, TypeError, r"\['outer_radius'\] cannot be given"),
    ([ph.Layer(ph.NeoHookean(), 0.3)], 1.2, UNIT, TypeError, r"\['mu'\], but \[\] were given"),
    ([SERIES], 1.2, UNIT, TypeError, r"'mu' of OgdenSeries\(terms=2\).*\(1,\); expected 2"),
    ([LAYER], 0.0, UNIT, ValueError, "internal_radius must be positive"),
]


@pytest.mark.parametrize(("energy", "radius", "arguments", "error", "message"), TUBES)
def test_impossible_tube_or_material_is_refused_with_the_expected_value(
    energy, radius, arguments, error, message
):
    for function in FUNCTIONS:
        with pytest.raises(error, match=message):
            function(energy, radius, **with_tube(arguments))


def test_extreme_but_possible_tubes_are_accepted():
    """The checks refuse no thin wall, no negative opening angle and no symbolic radius."""
    radius = ph.inflation_pressure(OGDEN, 8.0, ph.Tube(**TUBE), **MATERIAL)
    for arguments in ({"outer_radius": 7.0 + 1e-9}, {"opening_angle": -6.28}):
        for function in FUNCTIONS:
            curve = function(OGDEN, radius, ph.Tube(**TUBE | arguments), **MATERIAL)
            assert curve.ndim == 0


def test_dict_in_place_of_a_tube_is_refused():
    for function in FUNCTIONS:
        with pytest.raises(TypeError, match=r"tube is \{'inner.*expected .* ph.Tube\(7.0, 9.0\)"):
            function(OGDEN, 8.0, TUBE, **MATERIAL)


@pytest.mark.parametrize(
    ("energy", "thickness", "parameters", "error", "message"),
    [
        (ph.NeoHookean, 0.3, {"mu": 20.0}, TypeError, "call the class"),
        ([LAYER], 0.3, {"mu": 20.0}, TypeError, "only curves, .* accept layers"),
        (ph.NeoHookean(), 0.3, {"mu": 20.0, "n": 1.0}, TypeError, r"NeoHookean.*not \['n'\]"),
        (ph.NeoHookean(), 0.0, {"mu": 20.0}, ValueError, "thickness must be positive.* got 0.0"),
        (ph.NeoHookean(), [0.1, np.nan], {"mu": 20.0}, ValueError, "thickness must be positive"),
        (ph.NeoHookean(), np.inf, {"mu": 20.0}, ValueError, "must be positive and finite; got inf"),
        (ph.NeoHookean(), "thin", {"mu": 20.0}, TypeError, "thickness is 'thin'; expected"),
    ],
)
def test_impossible_layer_is_refused(energy, thickness, parameters, error, message):
    with pytest.raises(error, match=message):
        ph.Layer(energy, thickness, **parameters)
