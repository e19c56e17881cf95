"""A tube can be stated in several ways; each gives the radii and the angle of the opened sector.

``tests/data/test_tube_statements.py`` tests tubes that columns of a table state.
"""

from dataclasses import FrozenInstanceError, replace
from math import pi

import numpy as np
import pytensor.tensor as pt
import pytest
from problems import AS_WRITTEN

import pymc_hyperelastic as ph
from pymc_hyperelastic.mechanics.reference_tube import with_both_radii

# Radii and angles of a few sums, products and roots.
ROUNDING = 1e-14

# One sector: radii A and B, mm, and the whole angle that it lacks of a full circle, rad.
INNER, OUTER, ANGLE = 1.2, 1.7, 0.9
# The area of its wall, mm², which is a part of that of the full ring.
AREA = (OUTER**2 - INNER**2) * (2 * pi - ANGLE) / 2
# The closed ring keeps the thickness, and its middle line is as long as that of the sector.
MIDDLE = (INNER + OUTER) / 2 * (2 * pi - ANGLE) / (2 * pi)
RING = {"inner_radius": MIDDLE - 0.25, "outer_radius": MIDDLE + 0.25, "radii_of": "ring"}

SECTOR = {"inner_radius": INNER, "outer_radius": OUTER}
WHOLE, FUNG = {"opening_angle": ANGLE}, {"opening_angle": ANGLE / 2, "convention": "fung"}
# Each measure of the wall, in place of one radius.
WALLS = {
    "thickness": {"thickness": OUTER - INNER},
    "area": {"wall_area": AREA},
}
ANGLES = {"whole": WHOLE, "whole, stated": WHOLE | {"convention": "whole"}, "Fung's": FUNG}


def stated_by(radii, wall, name):
    """Return the radii without one of them, with a measure of the wall."""
    return {k: v for k, v in radii.items() if k != name} | wall


STATED = {
    f"{of}, {which}, {how}": measures | angle
    for of, radii in {"sector": SECTOR, "ring": RING}.items()
    for which, angle in ANGLES.items()
    for how, measures in (
        {"radii": radii}
        | {f"{name}, inner": stated_by(radii, w, "outer_radius") for name, w in WALLS.items()}
        | {f"{name}, outer": stated_by(radii, w, "inner_radius") for name, w in WALLS.items()}
    ).items()
}


@pytest.mark.parametrize("stated", STATED.values(), ids=STATED)
def test_equivalent_statements_of_a_tube_give_the_same_sector(stated):
    tube = ph.Tube(**stated, axial_stretch=1.3)
    expected = SECTOR | {"axial_stretch": 1.3, "opening_angle": ANGLE}
    assert tube.geometry() == pytest.approx(expected, rel=ROUNDING)
    both = with_both_radii(tube)
    radii = RING if "radii_of" in stated else SECTOR
    for name in SECTOR:
        assert getattr(both, name) == pytest.approx(radii[name], rel=ROUNDING)
    assert both.thickness is both.wall_area is None


@pytest.mark.parametrize("radii_of", [None, "sector", "ring"])
@pytest.mark.parametrize("wall", [{"thickness": 2.0}, {"wall_area": 32 * pi}])
def test_tube_without_an_opening_angle_has_equal_ring_and_sector(wall, radii_of):
    expected = {"inner_radius": 7.0, "outer_radius": 9.0}
    for name, radius in expected.items():
        tube = ph.Tube(**{name: radius}, **wall, radii_of=radii_of)
        assert tube.geometry() == pytest.approx(expected, rel=ROUNDING)


def test_geometry_omits_measures_that_are_not_stated():
    assert ph.Tube().geometry() == {}
    assert ph.Tube(axial_stretch=1.2).geometry() == {"axial_stretch": 1.2}
    # An angle of a ring without radii is stated by itself.
    angle = ph.Tube(opening_angle=0.3, convention="fung", radii_of="ring")
    assert angle.geometry() == {"opening_angle": 0.6}


def test_tube_shows_its_statement_and_is_immutable():
    tube = ph.Tube(7.0, thickness=2.0, axial_stretch="stretch")
    assert repr(tube) == "Tube(inner_radius=7.0, axial_stretch='stretch', thickness=2.0)"
    with pytest.raises(FrozenInstanceError):
        tube.inner_radius = 8.0
    assert replace(tube, inner_radius=8.0) == ph.Tube(8.0, thickness=2.0, axial_stretch="stretch")
    assert ph.Tube(7.0, 9.0) == ph.Tube(inner_radius=7.0, outer_radius=9.0)


# Arguments of a tube that is refused when it is stated, the error and its message.
IMPOSSIBLE = {
    "convention": ({"convention": "half"}, ValueError, r"convention is 'half'.*'whole', 'fung'"),
    "radii of": ({"radii_of": "wall"}, ValueError, r"radii_of is 'wall'.*'sector', 'ring'"),
    "two measures": ({"thickness": 1.0, "wall_area": 2.0}, ValueError, "thickness and wall_area"),
    "both radii": (SECTOR | {"thickness": 0.5}, ValueError, "thickness is given with both radii"),
    "no dict": ({"sd": 0.1}, TypeError, 'sd must be a dict such as .*"thickness": 0.01.*not float'),
    "no measure": ({"sd": {"length": 0.1}}, ValueError, r"sd holds 'length'; expected some of \['"),
}


@pytest.mark.parametrize("arguments, error, message", IMPOSSIBLE.values(), ids=IMPOSSIBLE)
def test_contradictory_or_unknown_statement_is_refused(arguments, error, message):
    with pytest.raises(error, match=message):
        ph.Tube(**arguments)


# Tubes that are fine, but state no sector.
INCOMPLETE = {
    "no radius": ({"wall_area": 2.0}, "wall_area is given with neither inner_radius nor outer_rad"),
    "half a ring": (RING | WHOLE | {"outer_radius": None}, "only one radius of the closed ring"),
    "full turn": (
        RING | {"opening_angle": pi, "convention": "fung"},
        "6.28319 rad as a whole",
    ),
    "errors": (SECTOR | {"sd": {"thickness": 0.1}}, "only ph.inflation_data accepts errors"),
}


@pytest.mark.parametrize("stated, message", INCOMPLETE.values(), ids=INCOMPLETE)
def test_geometry_of_an_incomplete_tube_is_refused(stated, message):
    with pytest.raises(ValueError, match=message):
        ph.Tube(**stated).geometry()


@pytest.mark.parametrize("of", ["sector", "ring"])
def test_curves_of_equivalent_statements_of_a_tube_are_equal(of):
    """Numbers, and a tensor in place of one of them, give the pressure of the sector."""
    sector = ph.Tube(**SECTOR, **WHOLE, axial_stretch=1.1)
    settings = {"energy": ph.NeoHookean(), "internal_radius": [1.3, 1.6], "mu": 20.0}
    expected = [
        function(tube=sector, **settings).eval(mode=AS_WRITTEN)
        for function in (ph.inflation_pressure, ph.inflation_stiffness, ph.axial_force)
    ]
    radii, area = {"sector": SECTOR, "ring": RING}[of], pt.dscalar()
    wall = {"outer_radius": None, "wall_area": area}
    for tube, given in (
        (ph.Tube(**radii | FUNG, axial_stretch=1.1), {}),
        (ph.Tube(**radii | FUNG | wall, axial_stretch=1.1), {area: AREA}),
    ):
        for function, values in zip(
            (ph.inflation_pressure, ph.inflation_stiffness, ph.axial_force), expected, strict=True
        ):
            found = function(tube=tube, **settings).eval(given, mode=AS_WRITTEN)
            np.testing.assert_allclose(found, values, rtol=1e-12)


def test_arrays_of_measures_broadcast():
    tube = ph.Tube(inner_radius=[1.0, 1.1], thickness=[[0.3], [0.4]])
    pressure = ph.inflation_pressure(ph.NeoHookean(), 1.2, tube, mu=20.0).eval(mode=AS_WRITTEN)
    assert pressure.shape == (2, 2)
    single = ph.inflation_pressure(ph.NeoHookean(), 1.2, ph.Tube(1.1, 1.5), mu=20.0)
    np.testing.assert_allclose(pressure[1, 1], single.eval(mode=AS_WRITTEN), rtol=1e-13)
