"""Sizes beyond the ranges of soft tubes give a warning with the likely cause."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import tables
import xarray as xr

import pymc_hyperelastic as ph
from pymc_hyperelastic.quantities import PLAUSIBLE

PAGE = Path(__file__).parents[2] / "docs" / "guides" / "file_format.md"
TUBE = {"inner_radius": 7.0, "outer_radius": 9.0}
# Pressures of an aorta, kPa.
RADIUS, PRESSURE = np.linspace(7.2, 9.6, 10), np.linspace(1.0, 20.0, 10)


def curve(radius=RADIUS, pressure=PRESSURE, **columns) -> pd.DataFrame:
    return tables.curve(radius, pressure, **columns)


def build(frame=None, **arguments) -> xr.Dataset:
    frame = curve() if frame is None else frame
    return ph.inflation_data(frame, **tables.with_tube(TUBE | arguments))


RING = {"radii_of": "ring", "convention": "whole"}
# A call, and a regular expression of its warning.
IMPLAUSIBLE = {
    "stretch in per cent": (lambda **c: build(axial_stretch=145.0, **c), "145;.*per cent"),
    "strain for a stretch": (lambda **c: build(axial_stretch=0.45, **c), "0.45;.*strain"),
    "diameter as radius": (lambda **c: build(curve(2 * RADIUS), **c), "measured radius a diameter"),
}


@pytest.mark.parametrize("call, expected", IMPLAUSIBLE.values(), ids=IMPLAUSIBLE)
def test_implausible_size_warns_with_its_likely_cause_raises_or_is_ignored(call, expected):
    with pytest.warns(UserWarning) as warned:
        call()
    messages = [str(w.message) for w in warned]
    assert all(m.startswith("specimen 'S1', experiment 1: ") for m in messages), messages
    assert any(re.search(expected, m) for m in messages), messages
    # The warning points to the line that gave the number.
    assert {w.filename for w in warned} == {__file__}
    with pytest.raises(ValueError, match=r"experiment 1: .* expected at"):
        call(check="raise")
    call(check="ignore")


@pytest.mark.parametrize(
    ("name", "values", "cut"),
    [("axial_stretch", [0.9] * 10, {}), ("opening_angle", ["60"] * 9 + [""], RING)],
)
def test_unused_column_of_stretch_or_angle_warns(name, values, cut):
    frame = curve(**{name: values})
    expected = f"column {name!r} with values other than .*say Tube.{name}={name!r}"
    with pytest.warns(UserWarning, match=expected) as warned:
        build(frame)
    assert [w.filename for w in warned] == [__file__]
    # A column that is used, holds no numbers, or agrees gives no warning.
    build(frame[:5], angle_unit="deg", **{name: name}, **cut)
    build(curve(**{name: "not written down"}))
    build(curve(**{name: [1.5] * 10}), **{name: 1.5}, **cut)


# Relative distance from the end of a range, well above rounding.
MARGIN = 1e-9
AREA = np.pi * (9.0**2 - 7.0**2)


def rising(first, last, **arguments) -> xr.Dataset:
    return build(curve(np.linspace(first, last, 10)), **arguments)


def hoop_stretched(first, last, stretch=1.0, k=1.0, **arguments) -> xr.Dataset:
    """Build a test with these hoop stretches of the middle of the wall over those without load."""
    middle = 8.0 * np.array([first, last]) / k / np.sqrt(stretch)
    ends = np.sqrt(middle**2 - (8.0**2 - 7.0**2) / (k * stretch))
    return rising(*ends, axial_stretch=stretch, **arguments)


# A sector that lacks a third of a circle, of which the opening factor k is 1.5.
SECTOR = tables.SECTOR | {"opening_angle": 2 * np.pi / 3}
# A range, one of its ends, and a function of a size that builds a test of this size.
ENDS = [
    ("highest_pressure", 0.1, lambda p: build(curve(pressure=np.linspace(p / 2, p, 10)))),
    ("highest_pressure", 40.0, lambda p: build(curve(pressure=np.linspace(1.0, p, 10)))),
    ("lowest_pressure", -2.0, lambda p: build(curve(pressure=np.linspace(p, 20.0, 10)))),
    ("ring_radius", 0.01, lambda a: rising(a, 1.3 * a, inner_radius=a, outer_radius=1.3 * a)),
    ("ring_radius", 30.0, lambda a: rising(30, 39, inner_radius=a, outer_radius=34.0)),
    ("largest_radius", 40.0, lambda r: rising(29.5, r, inner_radius=29.0, outer_radius=33.0)),
    ("wall", 0.01, lambda h: build(outer_radius=7 * (2 + h) / (2 - h))),
    ("wall", 0.8, lambda h: build(inner_radius=9 * (2 - h) / (2 + h))),
    ("wall", 0.8, lambda h: rising(5.1, 6.7, inner_radius=9 * (3 - h) / (3 + h), **SECTOR)),
    ("axial_stretch", 0.8, lambda z: build(curve(RADIUS / z**0.5), axial_stretch=z)),
    ("axial_stretch", 2.5, lambda z: rising(5, 8, axial_stretch=z)),
    ("opening_angle", 0.06, lambda angle: build(opening_angle=-angle, **RING)),
    ("first_stretch", 0.75, lambda x: hoop_stretched(x, 2.0)),
    ("first_stretch", 1.7, lambda x: hoop_stretched(x, 2.0)),
    ("first_stretch", 1.7, lambda x: hoop_stretched(x, 2.0, 1.44, 1.5, **SECTOR)),
    ("last_stretch", 0.9, lambda x: hoop_stretched(0.8, x)),
    ("last_stretch", 2.6, lambda x: hoop_stretched(1.0, x)),
    ("axial_stress", 2000.0, lambda s: build(curve(axial_force=s * AREA))),
    ("axial_stress", 2000.0, lambda s: build(curve(axial_force=-s * AREA / 1.5), **SECTOR)),
]


@pytest.mark.parametrize(
    "name, end, of_size", ENDS, ids=[f"{name} at {end:g}" for name, end, _ in ENDS]
)
def test_sizes_warn_only_beyond_the_ends_of_their_plausible_range(name, end, of_size):
    outward = {PLAUSIBLE[name].low: -1, PLAUSIBLE[name].high: 1}[end]
    of_size(end - outward * MARGIN * abs(end))
    with pytest.warns(UserWarning, match=re.escape(PLAUSIBLE[name].what)) as warned:
        of_size(end + outward * MARGIN * abs(end))
    assert len(warned) == 1


def test_hoop_stretches_are_checked_only_near_zero_pressure_or_if_inflated():
    """A first stretch is checked below 2 kPa only, and a last stretch above 2 kPa only."""
    above, below = np.linspace(2.0, 20.0, 10), np.linspace(0.5, 2.0, 10)
    build(curve(np.linspace(14.0, 16.0, 10), above))
    build(curve(np.linspace(5.0, 5.2, 10), below))
    with pytest.warns(UserWarning, match=PLAUSIBLE["first_stretch"].what):
        build(curve(np.linspace(14.0, 16.0, 10), above - MARGIN))
    with pytest.warns(UserWarning, match=PLAUSIBLE["last_stretch"].what):
        build(curve(np.linspace(5.0, 5.2, 10), below + MARGIN))


@pytest.mark.parametrize("function", [ph.radius_at_pressure, ph.tube_properties, ph.wall_stress])
def test_prediction_pressure_that_is_probably_in_mmhg_warns(function):
    posterior = xr.Dataset({"mu": (("chain", "draw"), [[700.0, 900.0]])})
    tree = xr.DataTree.from_dict({"posterior": posterior})
    tube, material = ph.Tube(**TUBE), {"energy": ph.NeoHookean()}
    at = ph.Conditions([16.0, 100.0], tube=tube)
    with pytest.warns(UserWarning, match="100 kPa, 750 mmHg.*pressure_unit='mmHg'") as warned:
        with_warning = function(tree, at, **material)
    assert [w.filename for w in warned] == [__file__]
    with pytest.raises(ValueError, match="750 mmHg"):
        function(tree, ph.Conditions(100, tube=tube), check="raise", **material)
    silent = function(tree, at, check="ignore", **material)
    xr.testing.assert_identical(silent, with_warning)
    function(tree, ph.Conditions(120 * ph.mmHg, tube=tube), **material)


def test_specimens_with_single_points_warn(written):
    """The likely cause is that a column of numbers was read as labels of specimens."""
    rows = [f"{101.5 + i},1,{7 + i},{1 + i}\n" for i in range(3)]
    with pytest.warns(
        UserWarning, match=r"each of the 3 specimens has a single measured point, .*'101"
    ):
        written("sample,test,radius_mm,p_kPa\n" + "".join(rows))
    written("sample,test,radius_mm,p_kPa\nS1,1,7.2,1\nS2,1,7.2,1\nS2,1,8.4,6\n")


def test_pressure_that_falls_at_each_larger_radius_warns():
    """A balloon, whose pressure falls after it has risen, and small errors do not."""
    with pytest.warns(UserWarning, match="experiment 1: the pressure falls .* from 20 to 1 kPa"):
        build(curve(pressure=PRESSURE[::-1]))
    for pressure in (PRESSURE * (21 - PRESSURE) / 10 - 1.5, np.linspace(10.1, 9.9, 10)):
        build(curve(pressure=pressure))
    build(curve(radius=RADIUS[::-1], pressure=PRESSURE[::-1]))


def test_guide_states_all_plausible_ranges():
    page = PAGE.read_text(encoding="utf-8")
    for expected in PLAUSIBLE.values():
        ends = [f"{x:g}" if np.isfinite(x) and x else "" for x in (expected.low, expected.high)]
        if expected.unit == "rad":
            ends[1] = "2π"
        what = expected.what.rstrip(",")
        assert f"| {what} | {expected.unit} | {ends[0]} | {ends[1]} |" in page, what
