"""Numbers that no soft tube has are doubted, with what was probably meant; others are not."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import pymc_hyperelastic as ph
from pymc_hyperelastic.data.plausible import RANGES

PAGE = Path(__file__).parents[2] / "docs" / "guides" / "file_format.md"
TUBE = {"inner_radius": 7.0, "outer_radius": 9.0}
# Pressures in kPa, that of an aorta.
RADIUS, PRESSURE = np.linspace(7.2, 9.6, 10), np.linspace(1.0, 20.0, 10)


def curve(radius=RADIUS, pressure=PRESSURE, **columns) -> pd.DataFrame:
    frame = pd.DataFrame({"specimen": "S1", "experiment": 1, "radius": radius})
    return frame.assign(pressure=pressure, **columns)


def build(frame=None, **arguments) -> xr.Dataset:
    return ph.inflation_data(curve() if frame is None else frame, **TUBE | arguments)


RING = {"radii_of": "ring", "opening_angle_convention": "whole"}
# What was done wrong, the call, and what the doubt says.
DOUBTFUL = [
    ("mmHg as kPa", lambda **c: build(curve(pressure=PRESSURE * 7.5), **c), "150 kPa.*mmHg"),
    ("Pa as kPa", lambda **c: build(curve(pressure=PRESSURE * 1e3), **c), "20000 kPa.*Pa"),
    ("MPa as kPa", lambda **c: build(curve(pressure=PRESSURE / 1e3), **c), "0.02 kPa.*MPa"),
    ("other gauge", lambda **c: build(curve(pressure=PRESSURE - 9), **c), "-8 kPa.*zero"),
    (
        "centimetres as mm",
        lambda **c: build(curve(RADIUS * 50), inner_radius=350.0, outer_radius=450.0, **c),
        "350 mm; expected at most 30 mm.*radius_unit",
    ),
    (
        "metres as mm",
        lambda **c: build(curve(RADIUS / 1e3), inner_radius=0.007, outer_radius=0.009, **c),
        "0.007 mm; expected at least 0.01 mm.*radius_unit",
    ),
    ("stretch in per cent", lambda **c: build(axial_stretch=145.0, **c), "145;.*per cent"),
    ("strain for a stretch", lambda **c: build(axial_stretch=0.45, **c), "0.45;.*strain"),
    (
        "measured diameter as radius",
        lambda **c: build(curve(2 * RADIUS), **c),
        "is the measured radius a diameter",
    ),
    (
        "measured in um, the tube in mm",
        lambda **c: build(curve(1e3 * RADIUS), **c),
        "in another unit than inner_radius",
    ),
    (
        "the tube in mm, measured in um, and radius_unit for both",
        lambda **c: build(curve(1e3 * RADIUS), radius_unit="um", **c),
        "radius_unit=... is that of every length",
    ),
    ("outer diameter as radius", lambda **c: build(outer_radius=18.0, **c), "is outer_radius a"),
    (
        "diameters as radii of the tube",
        lambda **c: build(inner_radius=14.0, outer_radius=18.0, **c),
        "diameters",
    ),
    ("thin as foil", lambda **c: build(outer_radius=7.001, **c), "thickness of the wall"),
    (
        "radians as degrees",
        lambda **c: build(opening_angle=1.2, angle_unit="deg", **RING, **c),
        r"0.0209\d* rad; expected at least 0.06 rad.*radians",
    ),
    ("uN as mN", lambda **c: build(curve(axial_force=2e6), **c), "axial force over.*force_unit"),
]


@pytest.mark.parametrize("row", DOUBTFUL, ids=[row[0] for row in DOUBTFUL])
def test_what_is_doubted(row):
    """It is warned of with the number and the likely cause, raised, or taken in silence."""
    _, call, expected = row
    with pytest.warns(UserWarning) as warned:
        call()
    told = [str(w.message) for w in warned]
    assert all(t.startswith("specimen 'S1', experiment 1: ") for t in told), told
    assert any(re.search(expected, t) for t in told), told
    # It points to the line that gave the number.
    assert {w.filename for w in warned} == {__file__}
    with pytest.raises(ValueError, match=r"experiment 1: .* expected at"):
        call(check="raise")
    call(check="ignore")


@pytest.mark.parametrize(
    ("name", "values", "cut"),
    [("axial_stretch", [1.2] * 10, {}), ("opening_angle", ["60"] * 9 + [""], RING)],
)
def test_a_column_that_is_not_taken(name, values, cut):
    """A table that states the stretch or the angle is not taken at 1 or 0 without a word."""
    frame = curve(**{name: values})
    doubted = f"column {name!r} with values other than .*say {name}={name!r}"
    with pytest.warns(UserWarning, match=doubted) as warned:
        build(frame)
    assert [w.filename for w in warned] == [__file__]
    with pytest.raises(ValueError, match=doubted):
        build(frame, check="raise")
    build(frame, check="ignore")
    # Where it is taken, is no number, or says the same, nothing is doubted.
    build(frame[:5], angle_unit="deg", **{name: name}, **cut)
    build(frame, **{name: None})
    build(curve(**{name: "not written down"}))
    build(curve(**{name: [1.5] * 10}), **{name: 1.5}, **cut)


def test_many_experiments_give_one_warning():
    """The first is named, and the others are counted."""
    frame = pd.concat([curve(pressure=PRESSURE * 8).assign(experiment=i) for i in range(5)])
    with pytest.warns(UserWarning, match=r"experiment 0: .*and so are 4 others") as warned:
        build(frame)
    assert len(warned) == 1


def test_unknown_geometry_is_not_doubted():
    """What follows from nothing is nothing to doubt."""
    build(inner_radius=None, outer_radius=None)
    build(axial_stretch=None)


def test_shipped_data_are_plausible():
    """The package's own data pass."""
    for name in ph.list_datasets():
        ph.load_dataset(name)


@pytest.mark.parametrize(
    "function", [ph.radius_at_pressure, ph.tube_properties, ph.pulse_wave_velocity, ph.wall_stress]
)
def test_pressures_of_predictions(function):
    """A pressure that was probably given in mmHg is doubted."""
    posterior = xr.Dataset({"mu": (("chain", "draw"), [[700.0, 900.0]])})
    tree = xr.DataTree.from_dict({"posterior": posterior})
    material = {"energy": ph.NeoHookean(), **TUBE}
    with pytest.warns(UserWarning, match="100 kPa, 750 mmHg.*pressure_unit='mmHg'") as warned:
        doubted = function(tree, [16.0, 100.0], **material)
    assert [w.filename for w in warned] == [__file__]
    with pytest.raises(ValueError, match="750 mmHg"):
        function(tree, 100, check="raise", **material)
    with pytest.raises(ValueError, match="check is 'no'"):
        function(tree, 1.0, check="no", **material)
    silent = function(tree, [16.0, 100.0], check="ignore", **material)
    xr.testing.assert_identical(silent, doubted)
    function(tree, 120 * ph.mmHg, **material)


def test_page_states_the_ranges():
    """The table of the page is that of the code."""
    page = PAGE.read_text(encoding="utf-8")
    for expected in RANGES.values():
        ends = [f"{x:g}" if np.isfinite(x) and x else "" for x in expected[2:4]]
        if expected.unit == "rad":
            ends[1] = "2π"
        what = expected.what.rstrip(",")
        assert f"| {what} | {expected.unit} | {ends[0]} | {ends[1]} |" in page, what
