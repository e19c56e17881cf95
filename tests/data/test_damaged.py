"""Damaged tables end in a clear error or warning, and right ones of odd form in no word at all.

What is refused of a good frame of six points, and of Datasets made by hand, is in
``test_bad_data.py``; here are whole curves, as they come from laboratories and spreadsheets.
"""

import decimal
import warnings

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import pymc_hyperelastic as ph
from pymc_hyperelastic.data.inflation import check_inflation_data
from pymc_hyperelastic.models.observation.slopes import (
    compressed_spectrum,
    half_log_determinant,
    precision_root,
)

TUBE = {"inner_radius": 7.0, "outer_radius": 9.0}
RADIUS, PRESSURE = np.linspace(7.2, 9.6, 9), np.linspace(1.0, 17.0, 9)
RING = {"radii_of": "ring", "opening_angle_convention": "fung", "angle_unit": "deg"}
FUNG = RING | {"opening_angle": 60.0}


def curve(**columns) -> pd.DataFrame:
    """One inflation of specimen S1, with other columns or some replaced."""
    frame = pd.DataFrame({"specimen": "S1", "experiment": 1, "radius": RADIUS})
    return frame.assign(pressure=PRESSURE).assign(**columns)


def at(column: str, row: int, value: object) -> pd.DataFrame:
    """The curve with one value replaced."""
    frame = curve(A=7.0, B=9.0, z=1.0, phi=0.0, group="C1", cycle=1, phase="loading")
    frame["axial_force"] = 10.0
    frame[column] = frame[column].astype(object)
    frame.loc[row, column] = value
    return frame


def several(*frames: pd.DataFrame) -> pd.DataFrame:
    return pd.concat(frames, ignore_index=True)


def diameters(scale=1.0) -> pd.DataFrame:
    wall = 9.0**2 - 7.0**2
    return curve(outer_diameter=2 * scale * np.sqrt(RADIUS**2 + wall)).drop(columns="radius")


BACK = curve(radius=RADIUS[::-1] + 0.05, pressure=PRESSURE[::-1] - 0.7)
PLACE = r"specimen 'S1', experiment 1"
# The frame, other arguments than the tube's radii, and what the error or the warning says.
CYCLES = several(*[curve(), BACK] * 3)
CYCLES["pressure"] += CYCLES.index / 1e3
MICROMETRES = {"inner_radius": 7e3, "outer_radius": 9e3}
DAMAGED = {
    # Labels and columns.
    "no columns": (curve()[["radius"]], {}, "no column 'specimen'"),
    "names in capitals": (curve().rename(columns=str.upper), {}, "it has 'SPECIMEN'"),
    "a space in a name": (curve().rename(columns={"radius": "radius "}), {}, "no column 'radius'"),
    "columns twice": (pd.concat([curve(), curve()], axis=1), {}, "more than one column"),
    "nothing left": (curve()[curve()["radius"] > 99], {}, "no rows"),
    "label missing": (at("specimen", 3, None), {}, "row 3: specimen is missing"),
    "label of spaces": (at("experiment", 3, "  "), {}, "row 3: experiment is missing"),
    "group missing": (at("group", 8, pd.NA), {}, "row 8: group is missing"),
    "group changes": (at("group", 8, "C2"), {}, f"{PLACE}.*row 8: group is 'C2', but 'C1'"),
    "phase missing": (at("phase", 2, np.nan), {}, "row 2: phase is missing"),
    "cycle missing": (at("cycle", 2, None), {}, "row 2: cycle is missing"),
    # Values.
    "empty cell": (at("pressure", 4, ""), {}, f"{PLACE}.*row 4: pressure is '', not a number"),
    "comma": (at("radius", 4, "8,4"), {}, "row 4: radius is '8,4', not a number"),
    "unit in a cell": (at("radius", 4, "8.4 mm"), {}, "not a number.*no units"),
    "error of a spreadsheet": (at("pressure", 4, "#DIV/0!"), {}, "'#DIV/0!', not a number"),
    "dash": (at("pressure", 4, "-"), {}, "'-', not a number"),
    "complex": (at("pressure", 4, 1 + 2j), {}, r"\(1\+2j\), not a number"),
    "list in a cell": (at("radius", 4, [8.4]), {}, "row 4: radius is .*not a number"),
    "date": (at("radius", 4, pd.Timestamp("2024-08-04")), {}, "Timestamp.*not a number"),
    "truth": (at("radius", 4, True), {}, "True, not a number"),
    "gap": (at("radius", 4, np.nan), {}, "row 4: radius is missing"),
    "infinity as text": (at("pressure", 4, "inf"), {}, "pressure is inf; expected a finite"),
    "integer beyond floats": (at("pressure", 4, 10**400), {}, "row 4: pressure is 1000*, not a"),
    "radius below zero": (at("radius", 0, -7.2), {}, "row 0: radius is -7.2 mm"),
    "unit row": (at("radius", 0, "mm"), {}, "row 0: radius is 'mm', not a number"),
    "force in words": (at("axial_force", 4, "none"), {}, "axial_force is 'none', not a number"),
    # The tube.
    "inner radius changes": (at("A", 4, 7.1), {"inner_radius": "A"}, "row 4: inner_radius is 7.1"),
    "stretch drifts": (at("z", 8, 1.001), {"axial_stretch": "z"}, "row 8: axial_stretch is 1.001"),
    "gap in the tube": (at("B", 4, None), {"outer_radius": "B"}, "row 4: B is missing"),
    "radii exchanged": (curve(), {"inner_radius": 9.0, "outer_radius": 7.0}, "exchanged"),
    "stretch of 0": (curve(), {"axial_stretch": 0}, f"{PLACE}: axial_stretch is 0"),
    "stretch below 0": (curve(), {"axial_stretch": -1.2}, "axial_stretch is -1.2"),
    "infinite radius": (curve(), {"outer_radius": np.inf}, "outer_radius is inf mm; expected"),
    "whose angle": (curve(), {"opening_angle": 1.0}, f"{PLACE}: .*two conventions"),
    "angle in a column": (at("phi", slice(None), 0.9), {"opening_angle": "phi"}, "two conventions"),
    "degrees in a column": (at("phi", slice(None), 90.0), {"opening_angle": "phi"}, "angle_unit"),
    "too much of a turn": (curve(), FUNG | {"opening_angle": 200.0}, "6.98.* rad as a whole"),
    "too thick": (diameters(0.4), {"measured": "outer_diameter"}, "in which the wall has room"),
    "wall twice": (curve(), {"thickness": 2.0}, "with both of inner_radius"),
    "unknown unit": (curve(), {"pressure_unit": "mm Hg"}, "pressure_unit='mm Hg'"),
    "unit of another kind": (curve(), {"radius_unit": "deg"}, "does not measure length"),
    # The order of rows.
    "loading and unloading": (several(curve(), BACK), {}, rf"{PLACE}, row \d+: .*loading and unl"),
    "three cycles": (CYCLES, {}, "'cycle'"),
    "same experiment twice": (several(curve(), curve(pressure=PRESSURE + 0.1)), {}, "turns back"),
    "pasted twice": (several(curve(), curve()), {}, "row 9: repeats row 0"),
    "a row twice": (several(curve(), curve().iloc[[8]]), {}, "row 9: repeats row 8"),
    "two rows exchanged": (curve().loc[[0, 1, 2, 3, 5, 4, 6, 7, 8]], {}, "shuffled|turns back"),
    "sorted as text": (curve().sort_values("pressure", key=lambda p: p.astype(str)), {}, "turns"),
    # Sizes.
    "mmHg": (curve(pressure=PRESSURE * 7.5), {}, "127.5 kPa.*mmHg"),
    "micrometres": (curve(radius=RADIUS * 1e3), MICROMETRES, "radius_unit"),
    "per cent": (curve(), {"axial_stretch": 120}, "per cent"),
    "strain": (curve(), {"axial_stretch": 0.2}, "strain"),
    "diameter of the tube": (curve(), {"inner_radius": 14, "outer_radius": 18}, "diameters"),
    "diameter measured": (diameters().rename(columns={"outer_diameter": "radius"}), {}, "diameter"),
    "newtons as N/1e9": (at("axial_force", 8, 1e7), {}, "force_unit"),
    "radians": (curve(), FUNG | {"opening_angle": 1.05}, "were radians given"),
}  # fmt: skip


@pytest.mark.parametrize("row", DAMAGED.values(), ids=DAMAGED)
def test_damaged(row):
    """A clear error; as one too where it is a doubt, of which else a warning tells."""
    frame, arguments, expected = row
    with pytest.raises((ValueError, TypeError), match=expected):
        ph.inflation_data(frame, **TUBE | arguments, check="raise")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            ph.inflation_data(frame, **TUBE | arguments)
        except ValueError:
            return
    assert caught and all(w.category is UserWarning for w in caught)


def indexed(index) -> pd.DataFrame:
    return curve().set_index(pd.Index(index))


NOISE = np.resize([0.0, 0.2, -0.2], 9)
BY_VOLUME = {"outer_radius": None, "wall_volume": 5 * np.pi * (9.0**2 - 7.0**2), "length": 5}
SCATTERED = [i for k in range(9) for i in (k, k + 9)]
# Right tables and settings of odd form.
RIGHT = {
    # Labels.
    "huge experiment": (curve(experiment=2**70), {}),
    "huge specimen": (curve(specimen=10**30), {}),
    "huge cycle": (curve(cycle=2**64), {}),
    "huge row labels": (indexed(pd.Index([2**70 + i for i in range(9)], dtype=object)), {}),
    "huge float for a label": (curve(experiment=1e300), {}),
    "unsigned": (curve(experiment=np.uint64(2**63 + 5)), {}),
    "negative experiment": (curve(experiment=-3), {}),
    "experiment 1.0": (curve(experiment=1.0), {}),
    "experiment 1.5": (curve(experiment=1.5), {}),
    "experiment of truth": (curve(experiment=True), {}),
    "date of experiment": (curve(experiment=pd.Timestamp("2024-05-01")), {}),
    "labels of both kinds": (several(curve(), curve(experiment="b")), {}),
    "categories": (curve().astype({"specimen": "category"}), {}),
    "Greek": (curve(specimen="Αορτή"), {}),
    "spaces in a label": (curve(specimen=" S 1 "), {}),
    "quotes": (curve(specimen="S'1\""), {}),
    "string dtype": (curve().astype({"specimen": "string"}), {}),
    "specimen of number": (curve(specimen=7), {}),
    # Rows.
    "rows twice in the index": (indexed([0] * 9), {}),
    "dates as rows": (indexed(pd.date_range("2024-05-01", periods=9, freq="s")), {}),
    "index of pairs": (indexed(pd.MultiIndex.from_product([["a"], range(9)])), {}),
    "text as rows": (indexed(list("abcdefghi")), {}),
    "scattered tests": (several(curve(), curve(experiment=2)).loc[SCATTERED], {}),
    "deflation": (curve().iloc[::-1], {}),
    "one point": (curve().iloc[:1], {}),
    "two points": (curve().iloc[:2], {}),
    "noise of pressure": (curve(pressure=PRESSURE + 5 * NOISE), {}),
    "noise of radius": (curve(radius=RADIUS + NOISE), {}),
    "radius read twice": (curve(radius=RADIUS.round(0) + 0.4), {}),
    "held pressure": (curve(pressure=13.0), {}),
    "no pressure at first": (curve(pressure=PRESSURE - 1), {}),
    "a little suction": (curve(pressure=PRESSURE - 2), {}),
    "phases": (several(curve(phase="loading"), BACK.assign(phase="unloading")), {}),
    "cycles": (several(*[curve(cycle=i) for i in (1, 2, 3)]), {}),
    "all cycles": (several(*[curve(cycle=i) for i in (1, 2, 3)]), {"cycles": "all"}),
    # Numbers.
    "numbers as text": (curve().astype({"pressure": str}), {}),
    "exponents as text": (curve(pressure=[f"{p:e}" for p in PRESSURE]), {}),
    "decimals": (curve(pressure=[decimal.Decimal(str(p)) for p in PRESSURE]), {}),
    "integers": (curve(pressure=range(1, 10)), {}),
    "single precision": (curve(radius=RADIUS.astype(np.float32)), {}),
    "nullable": (curve().astype({"pressure": "Float64"}), {}),
    "forces with gaps": (curve(axial_force=[1.0, None, np.nan, 4, 5, 6, 7, 8, "9"]), {}),
    "no forces at all": (curve(axial_force=np.nan), {}),
    "other columns": (curve(note=None, **{"pressure (mmHg)": "x"}), {}),
    # The tube and units.
    "mmHg": (curve(pressure=PRESSURE * 7.5), {"pressure_unit": "mmHg"}),
    "pascals": (curve(pressure=PRESSURE * 1e3), {"pressure_unit": "Pa"}),
    "micrometres": (curve(radius=RADIUS * 1e3), MICROMETRES | {"radius_unit": "um"}),
    "numpy numbers": (curve(), {"inner_radius": np.float32(7), "outer_radius": np.int8(9)}),
    "unknown tube": (curve(), {"inner_radius": None, "outer_radius": None}),
    "unknown stretch": (curve(), {"axial_stretch": None}),
    "unknown angle": (curve(), {"opening_angle": None}),
    "angle of 0 in degrees": (curve(), {"opening_angle": 0, "angle_unit": "deg"}),
    "ring": (curve(), FUNG),
    "ring that bends back": (curve(), FUNG | {"opening_angle": -20.0}),
    "ring by volume": (curve(), FUNG | BY_VOLUME),
    "ring that stays closed": (curve(), RING | {"opening_angle": 0.0}),
    "outer diameters": (diameters(), {"measured": "outer_diameter"}),
    "arteriole": (curve(radius=RADIUS / 250), {"inner_radius": 0.028, "outer_radius": 0.036}),
    "dilated aorta": (curve(radius=RADIUS * 3.5), {"inner_radius": 24.5, "outer_radius": 26.5}),
}  # fmt: skip


@pytest.mark.parametrize("row", RIGHT.values(), ids=RIGHT)
def test_right(row, tmp_path):
    """No word, sound data, one number for every point, and a file that gives them back."""
    frame, arguments = row
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        data = ph.inflation_data(frame, **TUBE | arguments)
    check_inflation_data(data)
    if "cycle" not in frame:
        assert data.sizes["obs"] == len(frame)
    data.to_netcdf(tmp_path / "data.nc", engine="h5netcdf")
    xr.testing.assert_identical(xr.load_dataset(tmp_path / "data.nc", engine="h5netcdf"), data)


def test_there_are_enough():
    """Some fifty of each."""
    assert len(DAMAGED) >= 50 and len(RIGHT) >= 50


STEPS = {"nothing": 0.0, "rounding": 1e-15, "a femtometre": 1e-12, "a picometre": 1e-9}


@pytest.mark.parametrize("step", STEPS.values(), ids=STEPS)
@pytest.mark.parametrize("points", [3, 9])
def test_radii_that_are_one_have_no_slope(step, points):
    """Where rounding would make the slopes, the rows are named; without slopes all is well."""
    radius = RADIUS[:points].copy()
    radius[1], radius[2] = radius[0] + step / 2, radius[0] + step
    data = ph.inflation_data(curve().iloc[:points].assign(radius=radius), **TUBE)
    for function in (ph.balanced_slope_weight, compressed_spectrum):
        with pytest.raises(ValueError, match=rf"{PLACE}: radius repeats at rows 0 and 2"):
            function(data)
    with pytest.raises(ValueError, match="slope_weight=0"):
        ph.ogden_model(data, sigma=1.0, slope_weight=1.0)
    ph.ogden_model(data, sigma=1.0, slope_weight=0)


def test_diameters_that_repeat_are_not_called_radii():
    """Where outer diameters were measured, the size that is named is half of one."""
    radius = RADIUS.copy()
    radius[1:3] = radius[0] + 0.01, radius[0]
    frame = curve(outer_diameter=2 * radius + 4.0).drop(columns="radius")
    data = ph.inflation_data(frame, **TUBE, measured="outer_diameter")
    named = rf"half the outer diameter repeats at rows 0 and 2 \({RADIUS[0] + 2:.6g} mm\)"
    with pytest.raises(ValueError, match=named):
        ph.balanced_slope_weight(data)


def test_slope_weight_that_drowns_all_else_is_refused():
    """The determinant would be that of rounding: the nearest rows are named."""
    radius = RADIUS.copy()
    radius[4] = radius[3] + 1e-5
    radius[5] = radius[3] + 2e-5
    data = ph.inflation_data(curve(radius=radius), **TUBE)
    weight = ph.balanced_slope_weight(data)
    spectrum, count = compressed_spectrum(data)
    exact = 0.5 * np.sum(count * np.log1p(weight * spectrum))
    np.testing.assert_allclose(half_log_determinant(data, weight), exact, rtol=1e-4)
    for function in (half_log_determinant, precision_root):
        with pytest.raises(ValueError, match=rf"{PLACE}: the radii of rows 3 and 5 are 2e-05 mm"):
            function(data, 1e6)
