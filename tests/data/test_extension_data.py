"""Extension tests, in which the axial stretch varies from point to point."""

import numpy as np
import pandas as pd
import pytest
import tables
import xarray as xr

import pymc_hyperelastic as ph
from pymc_hyperelastic.data.inflation import (
    at_points,
    check_data,
    extension_tests,
    held_stretches,
)

STRETCH = np.linspace(1.1, 1.5, 9)
S1E1 = "specimen 'S1', experiment 1"


def extension(stretch=STRETCH, **columns) -> pd.DataFrame:
    """A test at a held pressure: the tube narrows as it is pulled, with readings that repeat."""
    frame = pd.DataFrame({"specimen": "S1", "experiment": 1, "stretch": stretch})
    frame["radius"] = np.round(8.5 - frame["stretch"], 1)
    frame["pressure"] = 10 + 0.2 * np.resize([0.0, 1.0, -1.0, 0.5], len(frame))
    frame["axial_force"] = 50 * (frame["stretch"] - 1)
    return frame.assign(**columns)


def inflation(stretch=1.3, experiment=2, *, points=5, **columns) -> pd.DataFrame:
    frame = pd.DataFrame({"radius": np.linspace(7.1, 8.4, points)})
    frame["pressure"] = np.linspace(1, 15, points)
    return frame.assign(specimen="S1", experiment=experiment, stretch=stretch, **columns)


def both() -> pd.DataFrame:
    return pd.concat([inflation(), extension(), inflation(1.4, 3)], ignore_index=True)


def build(frame, **arguments) -> xr.Dataset:
    known = tables.GEOMETRY | {"axial_stretch": "stretch"}
    return ph.inflation_data(frame, **tables.with_tube(known | arguments))


def test_constant_stretch_is_a_value_of_the_test_despite_rounding():
    frame = pd.concat([inflation(), inflation(1.4, 3)], ignore_index=True)
    data = build(frame)
    assert data["axial_stretch"].dims == ("test",)
    np.testing.assert_array_equal(data["axial_stretch"], [1.3, 1.4])
    frame.loc[1, "stretch"] = 1.3 * (1 + 1e-10)  # below the limit of rounding, 1e-9
    xr.testing.assert_identical(build(frame), data)
    assert not extension_tests(data).any()
    frame.loc[1, "stretch"] = 1.3 * (1 + 1e-8)
    assert extension_tests(build(frame, check="ignore")).tolist() == [True, False]


def test_stretch_is_a_value_of_each_point_if_one_test_is_an_extension_test():
    frame = both()
    data = build(frame)
    check_data(data)
    assert data["axial_stretch"].dims == ("obs",)
    np.testing.assert_array_equal(data["axial_stretch"], frame["stretch"])
    np.testing.assert_array_equal(extension_tests(data), [False, True, False])
    np.testing.assert_array_equal(at_points(data, "axial_stretch"), frame["stretch"])
    np.testing.assert_array_equal(held_stretches(data), [1.3, np.nan, 1.4])


def test_internal_radius_depends_on_the_stretch_of_its_point():
    frame = extension(radius=np.nan).assign(outer_diameter=22.0)
    data = build(frame, measured="outer_diameter", opening_angle=0.0)
    np.testing.assert_allclose(data["radius"] ** 2, 121 - (81 - 49) / STRETCH, rtol=1e-14)


def test_selecting_inflation_tests_equals_a_table_of_them_alone():
    data = build(both())
    of_two = ph.select(data, experiment=[2, 3])
    alone = pd.concat([inflation(axial_force=np.nan), inflation(1.4, 3)], ignore_index=True)
    xr.testing.assert_identical(of_two.drop_vars("row"), build(alone).drop_vars("row"))


def test_points_in_order_of_stretch_keep_their_order():
    for stretch in (STRETCH, STRETCH[::-1], STRETCH + np.resize([0, 0.02, -0.02], 9)):
        frame = extension(stretch)
        assert build(frame)["row"].values.tolist() == frame.index.tolist()


def test_shuffled_points_are_sorted_by_stretch_with_a_warning():
    frame = extension(np.repeat(STRETCH[::2], 2)[:9])
    with pytest.warns(UserWarning, match=rf"{S1E1}, row \d+: axial_stretch turns.*sorted by it"):
        data = build(frame.sample(frac=1, random_state=1))
    np.testing.assert_array_equal(data["axial_stretch"], np.sort(frame["stretch"]))
    rows = data["row"].values
    np.testing.assert_array_equal(data["radius"].values, frame["radius"].values[rows])


def test_stretching_and_releasing_in_one_test_are_refused():
    back = extension(STRETCH[-2::-1], axial_force=10.0)
    frame = pd.concat([extension(phase="pull"), back.assign(phase="back")], ignore_index=True)
    expected = rf"{S1E1}, row 9: axial_stretch turns back.*'phase'.*sort_values\('axial_stretch'\)"
    with pytest.raises(ValueError, match=expected):
        build(frame.drop(columns="phase"))
    data = build(frame)
    back = ph.select(data, phase="back")["axial_stretch"]
    assert back.values.tolist() == STRETCH[-2::-1].tolist()


def test_points_equal_in_stretch_radius_pressure_and_force_are_refused():
    build(extension(np.repeat(STRETCH[:3], 3), radius=np.linspace(7.4, 7.0, 9)))
    build(extension(radius=7.3, pressure=10.0, axial_force=5.0))
    frame = pd.concat([extension(), extension().iloc[[4]]], ignore_index=True)
    expected = rf"{S1E1}, row 9: repeats row 4 \(axial_stretch 1.3, radius 7.2, pressure"
    with pytest.raises(ValueError, match=expected):
        build(frame)


def test_stretch_that_differs_in_few_rows_of_a_test_warns():
    frame = inflation()
    frame.loc[3, "stretch"] = 3.1
    expected = r"experiment 2, row 3: axial_stretch is 3.1 here and 1.3 in 4 of the 5 rows"
    with pytest.raises(ValueError, match=expected):
        build(frame, check="raise")
    with pytest.warns(UserWarning) as warned:
        build(frame)
    assert {w.filename for w in warned} == {__file__}
    assert extension_tests(build(frame, check="ignore")).all()
    # Half of the rows, or one of two rows, may share a stretch.
    for stretch in ([1.3, 1.3, 1.4, 1.5], [1.3, 1.4]):
        frame = inflation(np.array(stretch), points=len(stretch))
        assert extension_tests(build(frame, check="raise")).all()


def test_stretch_that_varies_by_less_than_one_per_cent_warns():
    """The warning proposes the mean, and the rows keep their order as in an inflation test."""
    frame = inflation(1.3 * (1 - 0.0101 * np.linspace(0, 1, 5)))
    assert extension_tests(build(frame, check="raise")).all()
    frame = inflation(1.3 * (1 - 0.0099 * np.array([0.0, 0.5, 1.0, 0.3, 0.6])))
    mean = f"{frame['stretch'].mean():.6g}"
    expected = rf"experiment 2, row 0: axial_stretch varies from 1.28713 to 1.3 .*mean, {mean}"
    with pytest.warns(UserWarning, match=expected):
        data = build(frame)
    assert data["row"].values.tolist() == [0, 1, 2, 3, 4]


def test_impossible_stretch_is_refused_with_row_and_value():
    frame = extension()
    frame.loc[4, "stretch"] = 0.0
    with pytest.raises(ValueError, match=f"{S1E1}, row 4: axial_stretch is 0; expected a positive"):
        build(frame, check="ignore")


@pytest.mark.parametrize(("stretch", "why"), [(3.0, "at most 2.5"), (0.3, "at least 0.8")])
def test_implausible_stretch_at_the_end_of_an_extension_test_warns(stretch, why):
    frame = extension(np.linspace(1.2, stretch, 9), radius=7.5)
    with pytest.warns(UserWarning, match=f"{S1E1}: axial_stretch is {stretch:g}; expected {why}"):
        build(frame)
