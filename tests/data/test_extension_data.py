"""Tests in which the axial stretch varies from point to point, beside those in which it is held."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from tables import GEOMETRY

import pymc_hyperelastic as ph
from pymc_hyperelastic.data.inflation import at_points, check_inflation_data, extension_tests

STRETCH = np.linspace(1.1, 1.5, 9)
S1E1 = "specimen 'S1', experiment 1"


def extension(stretch=STRETCH, **columns) -> pd.DataFrame:
    """A test at a held pressure: the tube narrows as it is pulled, with readings that repeat."""
    frame = pd.DataFrame({"specimen": "S1", "experiment": 1, "stretch": stretch})
    frame["radius"] = np.round(8.5 - frame["stretch"], 1)
    frame["pressure"] = 10 + 0.2 * np.resize([0.0, 1.0, -1.0, 0.5], len(frame))
    frame["axial_force"] = 50 * (frame["stretch"] - 1)
    return frame.assign(**columns)


def inflation(stretch=1.3, experiment=2, **columns) -> pd.DataFrame:
    frame = pd.DataFrame({"radius": np.linspace(7.1, 8.4, 5), "pressure": np.linspace(1, 15, 5)})
    return frame.assign(specimen="S1", experiment=experiment, stretch=stretch, **columns)


def both() -> pd.DataFrame:
    return pd.concat([inflation(), extension(), inflation(1.4, 3)], ignore_index=True)


def build(frame, **arguments) -> xr.Dataset:
    return ph.inflation_data(frame, **GEOMETRY, **{"axial_stretch": "stretch", **arguments})


def test_held_stretches_make_the_dataset_that_they_made():
    """One stretch a test lies on the tests, also where it is rounded."""
    frame = pd.concat([inflation(), inflation(1.4, 3)], ignore_index=True)
    data = build(frame)
    assert data["axial_stretch"].dims == ("test",)
    np.testing.assert_array_equal(data["axial_stretch"], [1.3, 1.4])
    frame.loc[1, "stretch"] = 1.3 * (1 + 1e-15)
    xr.testing.assert_identical(build(frame), data)
    assert not extension_tests(data).any()


def test_stretches_that_vary_are_those_of_the_points():
    """One table holds inflation and extension tests; every point has the stretch of its row."""
    frame = both()
    data = build(frame)
    check_inflation_data(data)
    assert data["axial_stretch"].dims == ("obs",)
    assert data["axial_stretch"].attrs == {"units": "1", "long_name": "axial stretch"}
    np.testing.assert_array_equal(data["axial_stretch"], frame["stretch"])
    np.testing.assert_array_equal(extension_tests(data), [False, True, False])
    np.testing.assert_array_equal(at_points(data, "axial_stretch"), frame["stretch"])
    np.testing.assert_array_equal(at_points(data, "inner_radius"), np.full(len(frame), 7.0))


def test_internal_radius_is_that_at_the_stretch_of_its_point():
    """The longer the tube, the thinner its wall at one and the same outer diameter."""
    frame = extension(radius=np.nan).assign(outer_diameter=22.0)
    data = build(frame, measured="outer_diameter", opening_angle=0.0)
    np.testing.assert_allclose(data["radius"] ** 2, 121 - (81 - 49) / STRETCH, rtol=1e-14)


def test_selected_inflation_tests_are_as_if_there_were_no_others():
    """What is chosen does not show what it was chosen from; what is left has its own stretches."""
    data = build(both())
    of_two = ph.select(data, experiment=[2, 3])
    alone = pd.concat([inflation(axial_force=np.nan), inflation(1.4, 3)], ignore_index=True)
    xr.testing.assert_identical(of_two.drop_vars("row"), build(alone).drop_vars("row"))
    of_one = ph.select(data, experiment=1)
    xr.testing.assert_identical(of_one.drop_vars("row"), build(extension()).drop_vars("row"))


def test_they_survive_a_file(tmp_path):
    """They come back as they were."""
    data = build(both())
    data.to_netcdf(tmp_path / "data.nc", engine="h5netcdf")
    loaded = xr.load_dataset(tmp_path / "data.nc", engine="h5netcdf")
    check_inflation_data(loaded)
    xr.testing.assert_identical(loaded, data)


@pytest.mark.parametrize(
    "frame",
    [extension(), extension(STRETCH[::-1]), extension(STRETCH + np.resize([0, 0.02, -0.02], 9))],
    ids=["pulled", "let go", "errors of reading"],
)
def test_points_in_order_of_stretch_stay(frame):
    """Whatever radius and pressure do, the rows are as they were measured, without a word."""
    data = build(frame)
    assert data["row"].values.tolist() == frame.index.tolist()


@pytest.mark.parametrize("seed", range(3))
def test_shuffled_points_are_sorted_by_stretch(seed):
    """And it is told; with equal stretches in the order of the table."""
    frame = extension(np.repeat(STRETCH[::2], 2)[:9])
    with pytest.warns(UserWarning, match=rf"{S1E1}, row \d+: axial_stretch turns.*sorted by it"):
        data = build(frame.sample(frac=1, random_state=seed))
    np.testing.assert_array_equal(data["axial_stretch"], np.sort(frame["stretch"]))
    rows = data["row"].values
    np.testing.assert_array_equal(data["radius"].values, frame["radius"].values[rows])


def test_pulling_and_letting_go_are_two_tests():
    """Together they are refused, and named they stand beside each other."""
    back = extension(STRETCH[-2::-1], axial_force=10.0)
    frame = pd.concat([extension(phase="pull"), back.assign(phase="back")], ignore_index=True)
    expected = rf"{S1E1}, row 9: axial_stretch turns back.*'phase'.*sort_values\('axial_stretch'\)"
    with pytest.raises(ValueError, match=expected):
        build(frame.drop(columns="phase"))
    data = build(frame)
    assert data["phase"].values.tolist() == ["pull", "back"]
    assert (
        ph.select(data, phase="back")["axial_stretch"].values.tolist() == STRETCH[-2::-1].tolist()
    )


def test_a_repeated_stretch_is_no_repeated_point():
    """A row repeats another if radius and pressure repeat at the same stretch, and the force."""
    held = extension(np.repeat(STRETCH[:3], 3), radius=np.linspace(7.4, 7.0, 9))
    build(held)
    at_one_radius = extension(radius=7.3, pressure=10.0, axial_force=5.0)
    build(at_one_radius)
    frame = pd.concat([extension(), extension().iloc[[4]]], ignore_index=True)
    expected = rf"{S1E1}, row 9: repeats row 4 \(axial_stretch 1.3, radius 7.2, pressure"
    with pytest.raises(ValueError, match=expected):
        build(frame)


def test_a_mistyped_stretch_is_doubted():
    """It would make an extension test of an inflation test: row and value are named."""
    frame = inflation()
    frame.loc[3, "stretch"] = 3.1
    expected = r"experiment 2, row 3: axial_stretch is 3.1 here and 1.3 in 4 of the 5 rows"
    with pytest.raises(ValueError, match=expected):
        build(frame, check="raise")
    with pytest.warns(UserWarning) as warned:
        build(frame)
    assert {w.filename for w in warned} == {__file__}
    assert extension_tests(build(frame, check="ignore")).all()


def test_readings_of_a_held_stretch_are_doubted():
    """Their mean is proposed, and the order of the rows is that of an inflation test."""
    frame = inflation(1.3 + np.array([0.0, 1e-4, -2e-4, 1e-4, 3e-4]))
    expected = r"experiment 2, row 4: axial_stretch varies from 1.2998 to 1.3003 .*mean, 1.30006"
    with pytest.warns(UserWarning, match=expected):
        data = build(frame)
    assert data["row"].values.tolist() == [0, 1, 2, 3, 4]


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (-1.2, f"{S1E1}, row 4: axial_stretch is -1.2; expected a positive ratio"),
        (0.0, f"{S1E1}, row 4: axial_stretch is 0; expected a positive ratio"),
        (np.nan, f"{S1E1}, row 4: stretch is missing"),
        (np.inf, f"{S1E1}, row 4: stretch is inf; expected a finite"),
        ("long", f"{S1E1}, row 4: stretch is 'long', not a number"),
    ],
)
def test_impossible_stretches_are_refused(value, expected):
    """Specimen, experiment, row and value are named."""
    frame = extension().astype({"stretch": object})
    frame.loc[4, "stretch"] = value
    with pytest.raises(ValueError, match=expected):
        build(frame, check="ignore")


def test_a_stretch_of_points_that_was_lost_is_refused():
    """Behind the builder's back too."""
    data = build(both())
    values = data["axial_stretch"].values.copy()
    values[7] = np.nan
    with pytest.raises(ValueError, match=f"{S1E1}, row 7: axial_stretch is nan"):
        check_inflation_data(data.assign(axial_stretch=("obs", values)))
    with pytest.raises(ValueError, match=r"'axial_stretch' has dimensions \(\); expected"):
        check_inflation_data(data.assign(axial_stretch=1.2))


@pytest.mark.parametrize(("stretch", "why"), [(3.0, "at most 2.5"), (0.3, "at least 0.8")])
def test_stretches_that_no_tube_has_are_doubted(stretch, why):
    """At whichever end of a test they are."""
    frame = extension(np.linspace(1.2, stretch, 9), radius=7.5)
    with pytest.warns(UserWarning, match=f"{S1E1}: axial_stretch is {stretch:g}; expected {why}"):
        build(frame)


def test_other_measures_of_the_tube_do_not_vary():
    """Radii and angle are those of the unloaded tube, of which there is one."""
    frame = extension().assign(A=np.linspace(7.0, 7.2, 9))
    with pytest.raises(ValueError, match=f"{S1E1}, row 1: inner_radius is 7.025, but 7.0"):
        ph.inflation_data(frame, inner_radius="A", outer_radius=9.0, axial_stretch="stretch")
