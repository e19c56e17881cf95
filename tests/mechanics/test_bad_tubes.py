"""Impossible tubes and materials: one error says which argument and what was expected."""

import numpy as np
import pytest
from bad_input import OGDEN, TUBE, assert_refused, table

import pymc_hyperelastic as ph
from pymc_hyperelastic import inflation_pressure, inflation_stiffness

OGDEN_TUBE = {**TUBE, "mu": 6.0, "alpha": 8.0}


def disagreeing_energy() -> type:
    class Disagreeing(ph.StrainEnergy):
        parameters = (ph.Parameter("mu", r"\mu", "kPa", (0.0, 1.0), "modulus"),)

        def energy(self, radial, hoop, axial, *, modulus):
            return modulus * hoop

    return Disagreeing


# Each row: what is wrong, a call that does it, the error, and fragments that its message must hold.
BAD_INPUT = [
    (
        "missing material parameter",
        lambda: ph.inflation_pressure(OGDEN, 8.0, **TUBE, mu=6.0),
        TypeError,
        ["Ogden", "['mu', 'alpha']", "['mu'] were given"],
    ),
    (
        "unknown material parameter",
        lambda: ph.inflation_stiffness(OGDEN, 8.0, **TUBE, mu=6.0, n=2.0),
        TypeError,
        ["Ogden", "['mu', 'alpha']", "['mu', 'n'] were given"],
    ),
    (
        "class for strain energy",
        lambda: ph.inflation_pressure(ph.Ogden, 8.0, **OGDEN_TUBE),
        TypeError,
        ["ph.Ogden()", "call the class"],
    ),
    (
        "name for strain energy",
        lambda: ph.inflation_stiffness("Ogden", 8.0, **OGDEN_TUBE),
        TypeError,
        ["ph.Ogden()", "not 'Ogden'"],
    ),
    (
        "tube without wall",
        lambda: ph.inflation_pressure(OGDEN, 8.0, **{**OGDEN_TUBE, "outer_radius": 7.0}),
        ValueError,
        ["outer_radius must exceed inner_radius", "7.0"],
    ),
    (
        "one negative radius",
        lambda: ph.inflation_pressure(OGDEN, [8.0, -8.0], **OGDEN_TUBE),
        ValueError,
        ["internal_radius must be positive", "-8."],
    ),
    (
        "one radius missing",
        lambda: ph.inflation_pressure(OGDEN, [8.0, np.nan], **OGDEN_TUBE),
        ValueError,
        ["internal_radius must be positive", "nan"],
    ),
    (
        "no axial stretch",
        lambda: ph.inflation_stiffness(OGDEN, 8.0, **OGDEN_TUBE, axial_stretch=0.0),
        ValueError,
        ["axial_stretch must be positive", "0.0"],
    ),
    (
        "opening angle in degrees",
        lambda: ph.inflation_pressure(OGDEN, 8.0, **OGDEN_TUBE, opening_angle=60.0),
        ValueError,
        ["opening_angle is in radians", "60.0", "np.deg2rad"],
    ),
    (
        "text for radius",
        lambda: ph.inflation_pressure(OGDEN, "wide", **OGDEN_TUBE),
        TypeError,
        ["internal_radius", "wide"],
    ),
    (
        "unknown strain energy",
        lambda: ph.StrainEnergy.from_name("Fung"),
        ValueError,
        ["'Fung'", "'Ogden'", "import its class"],
    ),
    (
        "energy of other parameters",
        disagreeing_energy,
        TypeError,
        ["Disagreeing", "['mu']", "['modulus']"],
    ),
]


@pytest.mark.parametrize(("call", "error", "fragments"), table(BAD_INPUT))
def test_bad_input(call, error, fragments):
    """Each kind of bad input raises one error that names the place and what was expected."""
    assert_refused(call, error, fragments)


MATERIAL = {"mu": 6.0, "alpha": 8.0}


@pytest.mark.parametrize("function", [inflation_pressure, inflation_stiffness])
@pytest.mark.parametrize(
    ("energy", "radius", "arguments", "error", "message"),
    [
        (ph.Ogden(), 8.0, {**TUBE, "mu": 6.0}, TypeError, r"Ogden.*'mu', 'alpha'.*\['mu'\]"),
        (ph.Ogden(), 8.0, {**TUBE, **MATERIAL, "n": 1.0}, TypeError, r"Ogden.*'n'"),
        (ph.Ogden(), 8.0, {**TUBE, "mu": 6.0, "n": 1.0}, TypeError, r"'alpha'.*'n'"),
        (ph.Ogden, 8.0, {**TUBE, **MATERIAL}, TypeError, "call the class"),
        ("Ogden", 8.0, {**TUBE, **MATERIAL}, TypeError, "'Ogden'"),
        (
            ph.Ogden(),
            8.0,
            {**MATERIAL, "inner_radius": 9.0, "outer_radius": 7.0},
            ValueError,
            "outer_radius must exceed inner_radius.*7.*9",
        ),
        (
            ph.Ogden(),
            8.0,
            {**MATERIAL, "inner_radius": 7.0, "outer_radius": [9.0, 7.0]},
            ValueError,
            "outer_radius must exceed inner_radius",
        ),
        (ph.Ogden(), 8.0, {**TUBE, **MATERIAL, "opening_angle": 60.0}, ValueError, "np.deg2rad"),
        (
            ph.Ogden(),
            [8.0, 0.0],
            {**TUBE, **MATERIAL},
            ValueError,
            "internal_radius must be positive",
        ),
        (ph.Ogden(), np.nan, {**TUBE, **MATERIAL}, ValueError, "internal_radius must be positive"),
        (
            ph.Ogden(),
            8.0,
            {**TUBE, **MATERIAL, "inner_radius": -7.0},
            ValueError,
            "inner_radius must be positive.*-7",
        ),
        (
            ph.Ogden(),
            8.0,
            {**TUBE, **MATERIAL, "axial_stretch": 0.0},
            ValueError,
            "axial_stretch must be positive",
        ),
    ],
)
def test_bad_input_is_refused_with_a_clear_message(
    function, energy, radius, arguments, error, message
):
    """Each mistake has one error, which names the argument and the value."""
    with pytest.raises(error, match=message):
        function(energy, radius, **arguments)
