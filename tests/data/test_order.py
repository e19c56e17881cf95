"""Slopes are taken between neighbouring rows, so a test's rows are in the order of its curve."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from tables import GEOMETRY

import pymc_hyperelastic as ph
from pymc_hyperelastic.data.inflation import check_inflation_data, describe_test
from pymc_hyperelastic.models.observation.slopes import measured_slopes

RADIUS = np.linspace(7.2, 9.4, 12)
PRESSURE = np.exp(RADIUS - 7.0)  # kPa
S1E1 = "specimen 'S1', experiment 1"


def curve(radius=RADIUS, pressure=PRESSURE, **columns) -> pd.DataFrame:
    frame = pd.DataFrame({"specimen": "S1", "experiment": 1, "radius": radius})
    return frame.assign(pressure=pressure, **columns)


def cycle(hysteresis=1.0) -> pd.DataFrame:
    """Loading, and unloading at lower pressures between the same radii."""
    back = curve(RADIUS[-2::-1] + 0.05, PRESSURE[-2::-1] - hysteresis)
    return pd.concat([curve(phase="loading"), back.assign(phase="unloading")], ignore_index=True)


def build(frame, **arguments) -> xr.Dataset:
    return ph.inflation_data(frame, **GEOMETRY, **arguments)


def shuffled(frame: pd.DataFrame, seed: int) -> pd.DataFrame:
    return frame.sample(frac=1, random_state=seed)


@pytest.mark.parametrize("seed", range(5))
def test_shuffled_rows_are_sorted(seed):
    """A clean curve of shuffled rows is the curve itself, and it is told."""
    with pytest.warns(UserWarning, match=rf"{S1E1}, row \d+: radius turns.*sorted"):
        data = build(shuffled(curve(), seed))
    xr.testing.assert_identical(data, build(curve()))


def test_each_test_is_sorted_by_itself():
    """Rows of several tests, all shuffled, keep their tests, forces and labels."""
    frame = pd.concat(
        [curve().assign(experiment=i, axial_force=PRESSURE * i) for i in (1, 2, 3)],
        ignore_index=True,
    )
    with pytest.warns(UserWarning, match="and so are 2 others"):
        data = build(shuffled(frame, 1))
    for i in range(3):
        ours = data.isel(obs=data["test"] == i)
        np.testing.assert_array_equal(ours["radius"], RADIUS)
        np.testing.assert_array_equal(ours["axial_force"], PRESSURE * data["experiment"].values[i])


def test_what_to_do_about_shuffled_rows_can_be_chosen():
    """They raise, or are sorted in silence."""
    frame = shuffled(curve(), 1)
    with pytest.raises(ValueError, match="shuffled"):
        build(frame, check="raise")
    xr.testing.assert_identical(build(frame, check="ignore"), build(curve()))
    with pytest.raises(ValueError, match="check is 'maybe'"):
        build(frame, check="maybe")


NOISE = np.resize([0.0, 0.4, -0.4], 12)
IN_ORDER = {
    "one point": curve().iloc[:1],
    "two points": curve().iloc[1::-1],
    "deflation": curve().iloc[::-1],
    "errors of pressure": curve(pressure=PRESSURE + 2 * NOISE),
    "errors of the radius": curve(RADIUS + NOISE),
    "errors of both": curve(RADIUS + NOISE / 4, PRESSURE + NOISE[::-1] / 2),
    "radius that stays": curve(np.repeat(RADIUS[::2], 2)),
    "held pressure": curve(pressure=np.full(12, 5.0)),
    "softening": curve(pressure=10 - (RADIUS - 8.3) ** 2),
}


@pytest.mark.parametrize("frame", IN_ORDER.values(), ids=IN_ORDER)
def test_rows_in_order_stay(frame):
    """As they were measured, with their errors, and without a word."""
    data = build(frame)
    assert data["row"].values.tolist() == frame.index.tolist()
    np.testing.assert_array_equal(data["radius"], frame["radius"])


HYSTERESIS = {
    "loading and unloading": cycle(),
    "without hysteresis": cycle(hysteresis=0.0),
    "two cycles": pd.concat([cycle(), cycle().assign(radius=lambda f: f["radius"] + 0.01)]),
    "shuffled cycle": shuffled(cycle(hysteresis=2.0), 1),
    "unloading first": pd.concat([cycle()[12:], curve()], ignore_index=True),
}


@pytest.mark.parametrize("frame", HYSTERESIS.values(), ids=HYSTERESIS)
def test_loading_and_unloading_are_refused_together(frame):
    """The message says where the curve turns, and how to name its phases."""
    with pytest.raises(ValueError, match=rf"{S1E1}, row \d+: radius turns back.*'phase'.*'cycle'"):
        build(frame.drop(columns="phase", errors="ignore").reset_index(drop=True))


def test_phases_are_tests_of_their_own():
    """Named, loading and unloading stand beside each other, and one is chosen."""
    data = build(cycle())
    check_inflation_data(data)
    assert data["phase"].values.tolist() == ["loading", "unloading"]
    assert describe_test(data, 1) == f"{S1E1}, phase 'unloading'"
    loading = ph.select(data, phase="loading")
    xr.testing.assert_identical(loading.drop_vars("phase"), build(curve()))
    assert ph.select(data, phase="unloading")["row"].values.tolist() == list(range(12, 23))
    np.testing.assert_array_equal(measured_slopes(loading), measured_slopes(build(curve())))


def test_last_cycle_is_taken():
    """Cycles before the last of an experiment precondition the tissue, whatever they hold."""
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
    with pytest.raises(ValueError, match="cycles is 'first'"):
        build(frame, cycles="first")


def test_cycles_and_phases_survive_a_file(tmp_path):
    """They come back as they were."""
    data = build(cycle().assign(cycle=3))
    data.to_netcdf(tmp_path / "data.nc", engine="h5netcdf")
    loaded = xr.load_dataset(tmp_path / "data.nc", engine="h5netcdf")
    check_inflation_data(loaded)
    xr.testing.assert_identical(loaded, data)


def test_a_phase_that_is_not_named_is_not_selected():
    """The message says what is missing."""
    with pytest.raises(ValueError, match="do not name a phase"):
        ph.select(build(curve()), phase="loading")
    with pytest.raises(ValueError, match=r"no phase 'rest'.*'loading', 'unloading'"):
        ph.select(build(cycle()), phase="rest")


@pytest.mark.parametrize("force", [{}, {"axial_force": np.nan}, {"axial_force": 1.0}])
def test_repeated_rows_are_refused(force):
    """A row that is there twice would count twice."""
    frame = pd.concat([curve(**force), curve(**force).iloc[[4]]], ignore_index=True)
    with pytest.raises(ValueError, match=rf"{S1E1}, row 12: repeats row 4 \(radius 8, pressure"):
        build(frame)
    build(frame.assign(experiment=np.repeat([1, 2], [12, 1])))


def test_measured_diameters_are_sorted_too():
    """What counts is what was measured."""
    frame = curve().rename(columns={"radius": "outer_diameter"})
    frame["outer_diameter"] *= 3
    with pytest.warns(UserWarning, match="outer_diameter turns back"):
        data = build(shuffled(frame, 2), measured="outer_diameter")
    xr.testing.assert_identical(data, build(frame, measured="outer_diameter"))
