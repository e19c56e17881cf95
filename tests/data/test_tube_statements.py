"""A reference tube can be stated in several ways, which all give the opened sector."""

import numpy as np
import pytest
from tables import build, by_diameter, good_frame

from pymc_hyperelastic import Tube, inflation_data

ROUNDING = 1e-12

# One tube: a ring of radii 7 and 9 mm with an opening angle of 60 degrees, 30 by Fung's convention.
RING = {"inner_radius": 7.0, "outer_radius": 9.0, "radii_of": "ring"}
OPENED = {"inner_radius": 8.6, "outer_radius": 10.6, "radii_of": "sector"}
WHOLE = {"opening_angle": 60.0, "convention": "whole", "angle_unit": "deg"}
FUNG = {"opening_angle": 30.0, "convention": "fung", "angle_unit": "deg"}
AREA = np.pi * (9.0**2 - 7.0**2)
MICROMETRES = {"radius_unit": "um", "inner_radius": None, "outer_radius": 9e3}
MICROMETRES["wall_area"] = AREA * 1e6
STATED = {
    "sector, whole": OPENED | WHOLE,
    "sector, Fung": OPENED | FUNG,
    "sector by area": OPENED | FUNG | {"outer_radius": None, "wall_area": AREA},
    "ring, whole": RING | WHOLE,
    "ring, Fung": RING | FUNG,
    "ring by thickness": RING | FUNG | {"outer_radius": None, "thickness": 2.0},
    "ring by area": RING | FUNG | {"inner_radius": None, "wall_area": AREA},
    "micrometres": RING | FUNG | MICROMETRES,
}


@pytest.mark.parametrize("stated", STATED.values(), ids=STATED)
def test_equivalent_statements_of_a_tube_give_the_same_opened_sector(stated):
    frame = good_frame()
    if "radius_unit" in stated:
        frame["radius"] *= 1000
    data = build(frame, **stated)
    for name, expected in {**OPENED, "opening_angle": np.pi / 3}.items():
        if name != "radii_of":
            np.testing.assert_allclose(data[name], expected, rtol=ROUNDING)


def test_columns_state_the_ring_of_each_test():
    frame = good_frame().assign(angle=[30.0, 30.0, 0.0, 0.0, -15.0, -15.0], h=2.0)
    stated = {"opening_angle": "angle", "convention": "fung", "angle_unit": "deg"}
    data = build(
        frame, **RING | stated | {"inner_radius": "A", "outer_radius": None}, thickness="h"
    )
    k = 180 / (180 - np.array([30.0, 0.0, -15.0]))
    np.testing.assert_allclose(data["inner_radius"] + data["outer_radius"], 16 * k, rtol=ROUNDING)
    np.testing.assert_allclose(data["outer_radius"] - data["inner_radius"], 2.0, rtol=ROUNDING)
    # A ring that stays closed keeps its radii to the last bit.
    assert data["inner_radius"].values[1] == 7.0 and data["outer_radius"].values[1] == 9.0


def test_measures_not_stated_have_defaults_and_nan_stays_unknown():
    """Default radii are unknown, the default stretch is 1 and the default opening angle 0."""
    frame = good_frame()
    data = inflation_data(frame, Tube())
    assert np.isnan(data["inner_radius"]).all() and np.isnan(data["outer_radius"]).all()
    assert (data["axial_stretch"] == 1).all() and (data["opening_angle"] == 0).all()
    unknown = inflation_data(frame, Tube(*[np.nan] * 4))
    for name in ("inner_radius", "outer_radius", "axial_stretch", "opening_angle"):
        assert np.isnan(unknown[name]).all()
    # A measure of the wall that is not known leaves the other radius unknown.
    half = inflation_data(frame, Tube(inner_radius=7.0, thickness=np.nan))
    assert (half["inner_radius"] == 7).all() and np.isnan(half["outer_radius"]).all()


def test_closed_ring_can_have_one_known_radius():
    data = inflation_data(good_frame(), Tube(inner_radius=7.0, radii_of="ring"))
    assert (data["inner_radius"] == 7).all() and np.isnan(data["outer_radius"]).all()


def test_tube_argument_that_is_no_tube_is_refused():
    with pytest.raises(TypeError, match=r"tube is 7.0; expected a reference tube such as ph.Tube"):
        inflation_data(good_frame(), 7.0)


S1E1 = "specimen 'S1', experiment 1: "
NO_INNER, NO_OUTER = {"inner_radius": None}, {"outer_radius": None}
NO_ANGLE = {"opening_angle": np.nan}
# Arguments, and a regular expression of the ValueError.
BAD_TUBES = {
    "no convention": ({"opening_angle": 1.0}, rf'{S1E1}.*Tube\(convention="fung"\).*radii_of='),
    "neither ring nor sector": (
        FUNG | {"opening_angle": 1.0}, f'{S1E1}.*radii_of="ring".*"sector"',
    ),
    "unknown convention": (FUNG | {"convention": "half"}, "'half'.*'whole', 'fung'"),
    "ring of unknown angle": (RING | NO_ANGLE, f"{S1E1}.*without its opening_angle"),
    "ring with one radius": (RING | FUNG | NO_INNER, f"{S1E1}.*one radius is not known"),
    "ring without a wall": (RING | FUNG | {"outer_radius": 7.0}, f"{S1E1}outer_radius of .* 7 mm"),
    "ring of no radius": (RING | FUNG | {"inner_radius": 0.0}, f"{S1E1}inner_radius is 0 mm"),
    "a full turn": (RING | FUNG | {"opening_angle": 180.0}, f"{S1E1}.*6.28319 rad as a whole"),
    "a whole angle as Fung's": (
        FUNG | {"opening_angle": 200.0, "radii_of": "sector"},
        f"{S1E1}.*6.98132 rad as a whole, twice Fung's; .* its convention is \"whole\"",
    ),
    "bent back": (RING | WHOLE | {"opening_angle": -350.0, "inner_radius": 0.5}, "inside out"),
    "thickness and wall area": (
        {"thickness": 2.0, "wall_area": 9.0}, "thickness and wall_area are given",
    ),
    "wall alone": ({"wall_area": 30.0} | NO_INNER | NO_OUTER, "with neither inner_radius"),
    "no wall": ({"wall_area": 0.0} | NO_INNER, f"{S1E1}wall_area is 0; expected a positive"),
    "too much wall": ({"wall_area": 300.0} | NO_INNER, f"{S1E1}.*300 mm² does not fit"),
    "too thick": ({"thickness": 9.5} | NO_INNER, f"{S1E1}inner_radius is -0.5 mm"),
    "unknown angle": ({"wall_area": 30.0} | NO_ANGLE | NO_OUTER, "angle is not known"),
    "error of a ring": (RING | FUNG | {"sd": {"outer_radius": 0.1}}, "those of the ring"),
    "error of any angle": ({"sd": {"opening_angle": 0.1}}, "error of the opening angle"),
}  # fmt: skip


@pytest.mark.parametrize("stated, message", BAD_TUBES.values(), ids=BAD_TUBES)
def test_incomplete_or_contradictory_tube_is_refused_with_what_to_state(stated, message):
    with pytest.raises(ValueError, match=message):
        build(**stated)


def test_full_turn_of_a_tube_with_measured_diameters_is_refused_without_a_warning():
    with pytest.raises(ValueError, match=r"6.28319 rad.*angle between -2 pi and 2 pi"):
        by_diameter(**RING | FUNG | {"opening_angle": 180.0})


def test_missing_angle_convention_is_reported_once_for_all_tests():
    frame = good_frame()
    frame["angle"] = np.where(frame["specimen"] == "S1", 1.0, 2.0)
    with pytest.raises(ValueError, match="and so are") as caught:
        build(frame, opening_angle="angle")
    assert str(caught.value).count("two conventions are in use") == 1


@pytest.mark.parametrize("wall", [{"thickness": 2.0}, {"wall_area": AREA}])
def test_data_say_that_a_thicker_wall_keeps_the_outer_radius_only_if_that_was_stated(wall):
    assert (build(inner_radius=None, **wall)["kept_circle"] == 1).all()
    for tube in ({"outer_radius": None} | wall, {}):
        assert "kept_circle" not in build(**tube)
