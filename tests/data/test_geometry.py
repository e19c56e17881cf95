"""However a laboratory states its reference tube, the same tube arrives, or nothing does."""

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import brentq
from tables import SECTOR, build, by_diameter, good_frame

import pymc_hyperelastic as ph
from pymc_hyperelastic.mechanics.tube import (
    current_radius,
    internal_radius_from_outer_radius,
    opened_sector,
    opening_factor,
)

ROUNDING = 1e-12
# What the middle line of a ring is off by, relative: a sixth of (thickness/radius)² at the most.
MIDDLE_LINE = 1 / 6

# One tube: a ring of radii 7 and 9 mm that opens by 60 degrees in all, 30 by Fung.
RING = {"inner_radius": 7.0, "outer_radius": 9.0, "radii_of": "ring"}
OPENED = {"inner_radius": 8.6, "outer_radius": 10.6, "radii_of": "sector"}
WHOLE = {"opening_angle": 60.0, "opening_angle_convention": "whole", "angle_unit": "deg"}
FUNG = {"opening_angle": 30.0, "opening_angle_convention": "fung", "angle_unit": "deg"}
AREA = np.pi * (9.0**2 - 7.0**2)
STATED = {
    "sector, whole": OPENED | WHOLE,
    "sector, Fung": OPENED | FUNG,
    "sector by thickness": OPENED | WHOLE | {"inner_radius": None, "thickness": 2.0},
    "sector by area": OPENED | FUNG | {"outer_radius": None, "wall_area": AREA},
    "ring, whole": RING | WHOLE,
    "ring, Fung": RING | FUNG,
    "ring by thickness": RING | FUNG | {"outer_radius": None, "thickness": 2.0},
    "ring by area": RING | FUNG | {"inner_radius": None, "wall_area": AREA},
    "ring by volume": RING | WHOLE | {"outer_radius": None, "wall_volume": 5 * AREA, "length": 5.0},
    "micrometres": RING
    | FUNG
    | {"inner_radius": None, "outer_radius": 9e3, "wall_area": AREA * 1e6, "radius_unit": "um"},
}


@pytest.mark.parametrize("stated", STATED.values(), ids=STATED)
def test_one_tube_stated_in_many_ways(stated):
    """Every way to state the tube gives the opened sector and the whole angle."""
    frame = good_frame()
    if "radius_unit" in stated:
        frame["radius"] *= 1000
    data = build(frame, **stated)
    for name, expected in {**OPENED, "opening_angle": np.pi / 3}.items():
        if name != "radii_of":
            np.testing.assert_allclose(data[name], expected, rtol=ROUNDING)


def test_columns_state_the_tube_as_numbers_do():
    """Geometry by columns, of rings that open and that do not, each by itself."""
    frame = good_frame().assign(angle=[30.0, 30.0, 0.0, 0.0, -15.0, -15.0], h=2.0)
    stated = {"opening_angle": "angle", "opening_angle_convention": "fung", "angle_unit": "deg"}
    data = build(
        frame, **RING | stated | {"inner_radius": "A", "outer_radius": None}, thickness="h"
    )
    k = 180 / (180 - np.array([30.0, 0.0, -15.0]))
    np.testing.assert_allclose(data["inner_radius"] + data["outer_radius"], 16 * k, rtol=ROUNDING)
    np.testing.assert_allclose(data["outer_radius"] - data["inner_radius"], 2.0, rtol=ROUNDING)
    # A ring that stays closed keeps its radii to the last bit.
    assert data["inner_radius"].values[1] == 7.0 and data["outer_radius"].values[1] == 9.0


def test_nothing_is_asked_where_nothing_may_be_meant_otherwise():
    """Without an angle, or where it is not known, neither convention nor reference is needed."""
    build(opening_angle=0.0)
    build(opening_angle=None, inner_radius=7.0, outer_radius=9.0)
    build(inner_radius=None, outer_radius=None, opening_angle=None, radii_of="ring")


@pytest.mark.parametrize("thickness", [0.1, 0.2, 0.35, 0.5])
@pytest.mark.parametrize("angle", [-60.0, 60.0, 140.0, 200.0])
def test_middle_line_of_an_elastic_ring(thickness, angle):
    """A neo-Hookean sector, closed without load, is the ring to the second order in thickness."""
    tube = {"opening_angle": np.deg2rad(angle)}
    ring = np.array([1 - thickness / 2, 1 + thickness / 2])
    inner, outer = opened_sector(*ring, **tube)

    def pressure(a):
        places = np.linspace(inner, outer, 401)
        r = current_radius(places, a, inner_radius=inner, **tube)
        stretch = opening_factor(np.deg2rad(angle)) * r / places
        return np.trapezoid((stretch**2 - stretch**-2) / r**2 * places, places)

    closed = brentq(pressure, 0.5 * ring[0], 2 * ring[0])
    assert abs(closed - ring[0]) < MIDDLE_LINE * thickness**2 * abs(angle) / 200


def test_fung_angle_is_the_inscribed_one():
    """Half of the missing angle is what is seen from the middle of the inner side."""
    missing, radius = np.deg2rad(140.0), 3.0
    ends = radius * np.exp(1j * np.array([-1, 1]) * (np.pi - missing / 2))
    seen = np.angle((ends - radius)[0] / (ends - radius)[1])
    np.testing.assert_allclose(abs(seen), missing / 2, rtol=ROUNDING)


def test_wrong_convention_is_wrong_radii():
    """What is asked for matters: radii change by tenths of mm if a ring is taken for a sector."""
    right, wrong = (by_diameter(**stated) for stated in (RING | FUNG, RING | WHOLE | SECTOR))
    assert abs(right["radius"] - wrong["radius"]).min() > 0.1


@pytest.mark.skipif("MURINE_ELASTASE" not in os.environ, reason="needs measured tables")
def test_measured_tables_in_both_conventions():
    """Measured diameters give the internal radii that were derived from the wall's volume."""
    folder = Path(os.environ["MURINE_ELASTASE"])
    geometry = pd.read_csv(folder / "murine_elastase_geometry.csv")
    points = pd.read_csv(folder / "murine_elastase_pd.csv")
    points = points[points["pressure_mmHg"] > 3.5]
    points = points.drop(columns=["group", "animal"]).merge(geometry, on="specimen")
    points["outer"] = points["outer_diameter_unloaded_mm"] / 2
    points["inner"] = points["inner_diameter_unloaded_mm"] / 2
    whole = 2 * points["opening_angle_deg"]
    middle = 360 / (360 - whole) * (points["inner"] + points["outer"]) / 2
    half = (points["outer"] - points["inner"]) / 2
    frame = points.assign(
        experiment=points["test"],
        pressure=points["pressure_mmHg"],
        outer_diameter=points["outer_diameter_um"] / 1e3,
        whole=whole,
        sector_inner=middle - half,
        sector_outer=middle + half,
    )
    ring = {"radii_of": "ring", "outer_radius": "outer"}
    fung = {"opening_angle": "opening_angle_deg", "opening_angle_convention": "fung"}
    sector = {"inner_radius": "sector_inner", "outer_radius": "sector_outer"}
    volume = {"wall_volume": "wall_volume_mm3", "length": "length_unloaded_mm"}
    for stated in (
        ring | fung | {"inner_radius": "inner"},
        ring | fung | {"inner_radius": None, "thickness": "thickness_unloaded_mm"},
        ring | fung | {"inner_radius": None} | volume,
        sector | SECTOR | {"opening_angle": "whole"},
    ):
        data = ph.inflation_data(
            frame,
            **stated,
            axial_stretch="axial_stretch",
            measured="outer_diameter",
            pressure_unit="mmHg",
            angle_unit="deg",
        )
        derived = frame["inner_radius_mm_derived"].loc[data["row"].values]
        np.testing.assert_allclose(data["radius"], derived, rtol=0, atol=1e-4)


def test_internal_radius_is_that_of_the_rings_area():
    """Whatever line keeps its length, the internal radius follows from the ring's area alone."""
    data = by_diameter(**RING | FUNG, axial_stretch=1.2)
    outer = data["outer_diameter"] / 2
    expected = internal_radius_from_outer_radius(
        outer, inner_radius=7.0, outer_radius=9.0, axial_stretch=1.2
    )
    np.testing.assert_allclose(data["radius"], expected, rtol=ROUNDING)


S1E1 = "specimen 'S1', experiment 1: "
# What is wrong, what is given, and what the message must hold.
AMBIGUOUS = [
    ("no convention", {"opening_angle": 1.0}, [S1E1, "is 1 rad", '="whole"', '"fung"', "half"]),
    (
        "no reference",
        {"opening_angle": 1.0, "opening_angle_convention": "fung"},
        [S1E1, 'radii_of="ring"', '"sector"'],
    ),
    (
        "neither convention nor reference",
        {"opening_angle": 1.0},
        [S1E1, "opening_angle_convention=", "; and the ring and the sector", "radii_of="],
    ),
    (
        "other convention",
        FUNG | {"opening_angle_convention": "half"},
        ["'half'", "'whole', 'fung'"],
    ),
    ("other reference", FUNG | {"radii_of": "tube"}, ["'tube'", "'sector', 'ring'"]),
    ("ring of unknown angle", RING | {"opening_angle": None}, [S1E1, "without its opening_angle"]),
    ("half a ring", RING | FUNG | {"inner_radius": None}, [S1E1, "one radius is not known"]),
    (
        "ring inside out",
        RING | FUNG | {"outer_radius": 6.0},
        [S1E1, "outer_radius of the ring is 6"],
    ),
    ("ring of no radius", RING | FUNG | {"inner_radius": -1.0}, [S1E1, "inner_radius is -1 mm"]),
    (
        "angle of more than a turn",
        RING | FUNG | {"opening_angle": 190.0},
        [S1E1, "6.63225 rad as a whole", 'angle_unit="deg"'],
    ),
    (
        "ring bent back",
        RING | WHOLE | {"opening_angle": -350.0, "inner_radius": 0.5},
        ["inside out"],
    ),
    ("two of the wall", {"thickness": 2.0, "wall_area": 9.0}, ["thickness, wall_area are given"]),
    ("volume without length", {"wall_volume": 2.0}, ["wall_volume is given", "with length"]),
    ("both radii and a wall", {"thickness": 2.0}, ["thickness is given with both"]),
    (
        "no radius and a wall",
        {"thickness": 2.0, "inner_radius": None, "outer_radius": None},
        ["with neither"],
    ),
    (
        "no thickness",
        {"thickness": 0.0, "inner_radius": None},
        [S1E1, "thickness is 0;", "positive"],
    ),
    ("too much wall", {"wall_area": 300.0, "inner_radius": None}, [S1E1, "300 mm² does not fit"]),
    ("too thick", {"thickness": 9.5, "inner_radius": None}, [S1E1, "inner_radius is -0.5 mm"]),
    (
        "area of a sector of unknown angle",
        {"wall_area": 30.0, "outer_radius": None, "opening_angle": None},
        [S1E1, "opening_angle is not known", "wall_area"],
    ),
]


@pytest.mark.parametrize(
    ("stated", "fragments"), [row[1:] for row in AMBIGUOUS], ids=[row[0] for row in AMBIGUOUS]
)
def test_what_does_not_state_a_tube_is_refused(stated, fragments):
    """The message names the test and says what would state it."""
    with pytest.raises(ValueError) as raised:
        build(**stated)
    message = str(raised.value)
    assert not [fragment for fragment in fragments if fragment not in message], message
