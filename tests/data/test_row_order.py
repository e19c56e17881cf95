"""Rows of a test keep the order of its curve, are sorted, or are refused."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from tables import build, curve

import pymc_hyperelastic as ph
from pymc_hyperelastic.data.inflation import check_data, describe_test

RADIUS = np.linspace(7.2, 9.4, 12)
PRESSURE = np.exp(RADIUS - 7.0)  # kPa
S1E1 = "specimen 'S1', experiment 1"


def loading(radius=RADIUS, pressure=PRESSURE, **columns) -> pd.DataFrame:
    return curve(radius, pressure, **columns)


def cycle(hysteresis=1.0) -> pd.DataFrame:
    """Loading, and unloading at lower pressures between the same radii."""
    back = loading(RADIUS[-2::-1] + 0.05, PRESSURE[-2::-1] - hysteresis)
    return pd.concat([loading(phase="loading"), back.assign(phase="unloading")], ignore_index=True)


def test_shuffled_rows_are_sorted_with_a_warning_that_names_the_first_turn():
    frame = loading(RADIUS[:6], PRESSURE[:6])
    with pytest.warns(UserWarning, match=rf"{S1E1}, row 0: radius turns.*sorted"):
        data = build(frame.loc[[1, 2, 4, 0, 5, 3]])
    xr.testing.assert_identical(data, build(frame))


def test_each_test_is_sorted_by_itself():
    tests = [loading(experiment=i, axial_force=PRESSURE * i) for i in (1, 2, 3)]
    with pytest.warns(UserWarning, match="and so are 2 others"):
        data = build(pd.concat(tests, ignore_index=True).sample(frac=1, random_state=1))
    with pytest.warns(UserWarning, match="outer_diameter turns back"):
        frame = loading(outer_diameter=3 * RADIUS).sample(frac=1, random_state=2)
        build(frame, measured="outer_diameter")
    for i in range(3):
        own = data.isel(obs=data["test"] == i)
        np.testing.assert_array_equal(own["radius"], RADIUS)
        np.testing.assert_array_equal(own["axial_force"], PRESSURE * data["experiment"].values[i])


NOISE = np.resize([0.0, 0.4, -0.4], 12)
# A reading falls back by 9 % of the range of its curve, which is still one that rises.
NEARLY_A_TURN = 7.0 + 0.2 * np.array([1.0, 5.0, 4.1, 8.0, 7.1, 11.0])
IN_ORDER = {
    "one point": loading().iloc[:1],
    "two points": loading().iloc[1::-1],
    "deflation": loading().iloc[::-1],
    "errors of pressure": loading(pressure=PRESSURE + 2 * NOISE),
    "errors of the radius": loading(RADIUS + NOISE),
    "errors of both": loading(RADIUS + NOISE / 4, PRESSURE + NOISE[::-1] / 2),
    "errors of both, of 9 %": loading(NEARLY_A_TURN, [1.0, 5.0, 6.0, 5.1, 9.0, 11.0]),
    "radius that stays": loading(np.repeat(RADIUS[::2], 2)),
    "softening": loading(pressure=10 - (RADIUS - 8.3) ** 2),
}


@pytest.mark.parametrize("frame", IN_ORDER.values(), ids=IN_ORDER)
def test_rows_of_a_rising_or_falling_curve_keep_their_order(frame):
    data = build(frame)
    assert data["row"].values.tolist() == frame.index.tolist()
    np.testing.assert_array_equal(data["radius"], frame["radius"])


UP_AND_DOWN = {
    "loading and unloading": cycle(),
    "two experiments under one label": pd.concat([loading(), loading(pressure=PRESSURE + 0.1)]),
    # A fall of 11 % of the range is a turn, and one turn is loading and unloading.
    "one turn of 11 %": loading([1.0, 9.0, 11.0, 9.9], [1.0, 9.0, 11.0, 9.9]),
}


@pytest.mark.parametrize("frame", UP_AND_DOWN.values(), ids=UP_AND_DOWN)
def test_loading_and_unloading_in_one_test_are_refused(frame):
    frame = frame.drop(columns="phase", errors="ignore").reset_index(drop=True)
    with pytest.raises(ValueError, match=rf"{S1E1}, row \d+: radius turns back.*'phase'.*'cycle'"):
        build(frame)


def test_each_phase_of_an_experiment_is_a_test():
    data = build(cycle())
    check_data(data)
    assert data["phase"].values.tolist() == ["loading", "unloading"]
    assert describe_test(data, 1) == f"{S1E1}, phase 'unloading'"
    up = ph.select(data, phase="loading")
    xr.testing.assert_identical(up.drop_vars("phase"), build(loading()))
    assert ph.select(data, phase="unloading")["row"].values.tolist() == list(range(12, 23))


def test_only_the_last_cycle_of_each_experiment_is_kept_by_default():
    cycles = [cycle().assign(cycle=i) for i in (1, 2, 10)]
    cycles[0].loc[3, "pressure"] = np.nan
    other = cycle().assign(cycle=1, experiment=2)
    frame = pd.concat([*cycles, other], ignore_index=True)
    data = build(frame)
    assert data["cycle"].values.tolist() == [10, 10, 1, 1]
    assert data["experiment"].values.tolist() == [1, 1, 2, 2]
    whole = build(frame.dropna(), cycles="all")
    assert ph.select(whole, cycle=2, phase="loading").sizes["test"] == 1
    xr.testing.assert_equal(ph.select(whole, cycle=10), ph.select(data, cycle=10))
    named = frame.assign(cycle=frame["cycle"].map({1: "pre", 2: "more", 10: "last"}))
    assert set(build(named)["cycle"].values) == {"last", "pre"}


@pytest.mark.parametrize(
    "force",
    [{}, {"axial_force": np.nan}, {"axial_force": 1.0}],
    ids=["no force column", "force missing", "force"],
)
def test_repeated_rows_are_refused(force):
    frame = pd.concat([loading(**force), loading(**force).iloc[[4]]], ignore_index=True)
    with pytest.raises(ValueError, match=rf"{S1E1}, row 12: repeats row 4 \(radius 8, pressure"):
        build(frame)
    build(frame.assign(experiment=np.repeat([1, 2], [12, 1])))
