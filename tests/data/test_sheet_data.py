"""sheet_data builds a checked Dataset from a table of measured points of sheets."""

import inspect
import re
import warnings

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from sheet_tables import NAN
from written import message_of

import pymc_hyperelastic as ph
from pymc_hyperelastic.data.inflation import check_data
from pymc_hyperelastic.data.variables import LABELS, POINTS
from pymc_hyperelastic.quantities import PLAUSIBLE, QUANTITIES, SHEET_VARIABLES

ROUNDING = 1e-14  # a few operations
STRAINS = 1e-12  # a difference of squares near 1
X, Y = np.array([1.0, 1.05, 1.1, 1.15, 1.2]), np.array([1.0, 1.02, 1.05, 1.08, 1.1])
ENGINEERING = "engineering_strain"
PLACE = "specimen 'S1', experiment 1"


def biaxial(**columns) -> pd.DataFrame:
    """One biaxial test of five points, rows labelled 10 to 14; stresses in kPa."""
    stresses = {"stress_x": 40 * (X - 1), "stress_y": 20 * (Y - 1)}
    labels = {"specimen": "S1", "experiment": 1}
    frame = pd.DataFrame({"stretch_x": X, "stretch_y": Y, **stresses}, index=range(10, 15))
    return frame.assign(**labels).assign(**columns)


def pulled(**columns) -> pd.DataFrame:
    """One test with a stretch and a stress without an axis."""
    frame = biaxial().drop(columns=["stretch_y", "stress_y"])
    return frame.rename(columns={"stretch_x": "stretch", "stress_x": "stress"}).assign(**columns)


def called(frame: pd.DataFrame, **names: str) -> pd.DataFrame:
    """Rename columns of both axes, or the one without an axis."""
    ends = ("", "_x", "_y")
    return frame.rename(columns={old + e: new + e for old, new in names.items() for e in ends})


def displaced(displacement: np.ndarray, **columns) -> pd.DataFrame:
    return called(pulled(stretch=displacement, **columns), stretch="displacement")


def changed(frame: pd.DataFrame, column: str, value: object, row: int = 12) -> pd.DataFrame:
    frame = frame.astype({column: object})
    frame.at[row, column] = value
    return frame


def build(frame: pd.DataFrame | None = None, stress: str = "nominal", **arguments) -> xr.Dataset:
    return ph.sheet_data(biaxial() if frame is None else frame, stress=stress, **arguments)


def along_x(frame: pd.DataFrame | None = None, **arguments) -> xr.Dataset:
    arguments = {"kind": "uniaxial"} | arguments
    return build(pulled() if frame is None else frame, **arguments)


def test_dataset_has_the_documented_variables_units_and_labels():
    frame = biaxial(group="A", cycle=1, phase="loading")
    data = build(frame, "cauchy", stress_unit="MPa")
    assert dict(data.sizes) == {"obs": 5, "test": 1}
    assert set(data.data_vars) == set(SHEET_VARIABLES)
    labels = (*LABELS, "cycle", "phase", "stress_measure")
    assert set(data.coords) == {*labels, *POINTS}
    for name in (*SHEET_VARIABLES, *labels):
        assert data[name].dims == (QUANTITIES[name].lies_on,)
        assert data[name].attrs == QUANTITIES[name].attributes
    assert data["stretch_y"].values.tolist() == Y.tolist()
    np.testing.assert_allclose(data["stress_x"], 40e3 * (X - 1), rtol=ROUNDING)
    assert [data[name].item() for name in labels] == ["S1", 1, "A", 1, "loading", "cauchy"]
    assert data["row"].values.tolist() == [10, 11, 12, 13, 14]
    check_data(data)


def test_signature_has_ten_parameters_that_are_named_after_the_frame():
    first, *others = inspect.signature(ph.sheet_data).parameters.values()
    assert first.name == "frame" and len(others) == 9
    assert {each.kind for each in others} == {inspect.Parameter.KEYWORD_ONLY}
    assert [each.name for each in others if each.default is each.empty] == ["stress"]


# The same stretches in other measures, and the arguments that state them.
SAME_STRETCHES = {
    "engineering strain": ("engineering_strain", lambda x, _: x - 1, {}),
    "Green strain": ("green_strain", lambda x, _: (x**2 - 1) / 2, {}),
    "displacement": ("displacement", lambda x, _: 12.5 * (x - 1), {"gauge_length": 12.5}),
    "displacement, column": ("displacement", lambda x, _: 8 * (x - 1), {"gauge_length": "L"}),
    "two displacements": (
        "displacement", lambda x, axis: {"x": 8, "y": 5}[axis] * (x - 1),
        {"gauge_length": ("L", 5.0)},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name, measure, how", SAME_STRETCHES.values(), ids=SAME_STRETCHES)
def test_strains_and_displacements_give_the_dataset_of_their_stretches(name, measure, how):
    frame = biaxial(L=8.0, stretch_x=measure(X, "x"), stretch_y=measure(Y, "y"))
    data = build(called(frame, stretch=name), **how)
    xr.testing.assert_allclose(data, build(biaxial()), rtol=STRAINS, atol=STRAINS)
    one = pulled(L=8.0, stretch=measure(X, "x"))
    data = along_x(called(one, stretch=name), **how)
    xr.testing.assert_allclose(data, along_x(), rtol=STRAINS, atol=STRAINS)


def test_forces_give_the_nominal_stress_and_cauchy_stress_differs_by_the_stretch():
    expected = build(biaxial())
    forces = biaxial(stress_x=3.0 * 40 * (X - 1), stress_y=6.0 * 20 * (Y - 1), A=3.0)
    forces = called(forces, stress="force")
    for area in ((3.0, 6.0), ("A", 6.0)):
        data = build(forces, "force", area=area)
        xr.testing.assert_allclose(data, expected, rtol=STRAINS)
    newton = forces.assign(force_x=forces["force_x"] / 1e3, force_y=forces["force_y"] / 2e3)
    data = build(newton, "force", area=3e6, force_unit="N", length_unit="um")
    xr.testing.assert_allclose(data, expected, rtol=STRAINS)
    data = along_x(pulled(force=120 * (X - 1)).drop(columns="stress"), stress="force", area=3.0)
    xr.testing.assert_allclose(data, along_x(), rtol=STRAINS)
    assert data["stress_measure"].item() == "nominal"
    cauchy = build(biaxial(stress_x=40 * X * (X - 1)), "cauchy")
    np.testing.assert_allclose(
        cauchy["stress_x"] / cauchy["stretch_x"], expected["stress_x"], atol=STRAINS
    )
    assert cauchy["stress_measure"].item() == "cauchy"


# A kind, and the stretches along x and y and the stresses for pulled().
STRESS, FREE = (40 * (X - 1)).tolist(), [NAN] * 5
KINDS = {
    "uniaxial": (X.tolist(), FREE, STRESS, FREE),
    "uniaxial_x": (X.tolist(), FREE, STRESS, FREE),
    "uniaxial_y": (FREE, X.tolist(), FREE, STRESS),
    "equibiaxial": (X.tolist(), X.tolist(), STRESS, FREE),
    "pure_shear": (X.tolist(), [1.0] * 5, STRESS, FREE),
}


@pytest.mark.parametrize("kind", KINDS)
def test_kinds_of_tests_give_the_stretches_and_stresses_of_their_axes(kind):
    data = build(pulled(), kind=kind)
    for name, expected in zip(SHEET_VARIABLES, KINDS[kind], strict=True):
        np.testing.assert_array_equal(data[name], expected, err_msg=name)
    # The same test with columns of both axes, and with a column that states the kind.
    by_axis = pulled(**dict(zip(SHEET_VARIABLES, KINDS[kind], strict=True)))
    by_axis = by_axis.drop(columns=["stretch", "stress"])
    xr.testing.assert_identical(build(by_axis, kind=kind), data)
    xr.testing.assert_identical(build(by_axis), data)
    words = kind.replace("_", " ").capitalize()
    xr.testing.assert_identical(build(pulled(how=words), kind="how"), data)


def test_one_column_states_the_kinds_of_several_tests():
    kinds = ["uniaxial", "equibiaxial", "pure shear", "uniaxial y"]
    frame = pd.concat([pulled(kind=kind, experiment=kind) for kind in kinds])
    data = build(frame, kind="kind")
    free = np.isnan([ph.select(data, None, kind)["stretch_y"].values[0] for kind in kinds])
    assert free.tolist() == [True, False, False, False]
    assert np.isnan(ph.select(data, None, "uniaxial y")["stretch_x"]).all()
    xr.testing.assert_equal(
        ph.select(data, None, "uniaxial"),
        build(pulled(experiment="uniaxial"), kind="uniaxial"),
    )


def test_stresses_across_are_used_and_zero_in_a_free_direction_is_none():
    """Pure shear and equibiaxial tests may have two load cells."""
    for kind, across in (("pure_shear", 1.0), ("equibiaxial", X)):
        data = build(biaxial(stretch_y=across), kind=kind)
        np.testing.assert_array_equal(data["stress_y"], biaxial()["stress_y"])
    data = build(biaxial(stretch_y=NAN, stress_y=0.0))
    assert np.isnan(data["stress_y"]).all()
    data = build(biaxial(stretch_y=X**-0.5, stress_y=0.0), kind="uniaxial")
    xr.testing.assert_equal(data, along_x())


def test_cycles_phases_and_shuffled_rows_are_treated_as_those_of_tubes():
    cycles = pd.concat([biaxial(cycle=1), biaxial(cycle=2, stress_x=38 * (X - 1))])
    assert build(cycles)["cycle"].values.tolist() == [2]
    assert build(cycles, cycles="all")["cycle"].values.tolist() == [1, 2]
    back = biaxial(phase="unloading", stress_x=30 * (X - 1)).iloc[::-1]
    data = build(pd.concat([biaxial(phase="loading"), back]))
    assert data["phase"].values.tolist() == ["loading", "unloading"]
    assert data["stretch_x"].values.tolist() == [*X, *X[::-1]]
    with pytest.warns(UserWarning) as warned:
        data = build(biaxial().iloc[[0, 4, 1, 3, 2]])
    assert [str(w.message) for w in warned] == [
        f"{PLACE}, row 11: stretch_x turns back here; the rows of the experiment were shuffled, "
        'and have been sorted by it; if it is right, say check="ignore"'
    ]
    assert warned[0].filename == __file__
    xr.testing.assert_equal(data, build())
    # A strip: only the other stretch varies.
    strip = biaxial(stretch_x=1.0)
    assert build(strip)["stretch_y"].values.tolist() == Y.tolist()
    noise = 1e-4 * np.array([1, -1, 1, -1, 1])
    assert build(biaxial(stretch_x=1 + noise))["row"].values.tolist() == [10, 11, 12, 13, 14]


def test_integer_labels_stay_integers_and_group_is_all(tmp_path):
    data = build(biaxial(specimen=7))
    assert data["specimen"].item() == "7" and data["experiment"].dtype.kind == "i"
    assert data["group"].item() == "all"
    data.to_netcdf(tmp_path / "data.nc", engine="h5netcdf")
    loaded = xr.load_dataset(tmp_path / "data.nc", engine="h5netcdf")
    check_data(loaded)
    xr.testing.assert_identical(loaded, data)


BOTH = "'specimen', 'experiment'"
HAS = "it has 'stretch_x', 'stretch_y', 'stress_x', 'stress_y', 'specimen', 'experiment'"
HAS_ONE = "it has 'stretch', 'stress', 'specimen', 'experiment'"
RENAME = "rename what holds it, frame.rename(columns={'...': "
KNOWN = "('biaxial', 'uniaxial', 'uniaxial_x', 'uniaxial_y', 'equibiaxial', 'pure_shear')"
MEASURES = (
    "rename the column, frame.rename(columns={...}), by its content: stretch (λ), "
    "engineering_strain (λ − 1), green_strain ((λ² − 1)/2), displacement (λ − 1 times gauge_length)"
)
STRAIN = (
    "expected a positive ratio of lengths, 1 for an unstretched sheet: was a strain given? Then "
    "name the column engineering_strain{0} (λ − 1) or green_strain{0} ((λ² − 1)/2)"
)
NO_AXIS = "; or of biaxial tests give 'stretch_x' and 'stretch_y'"
# A call, and its ValueError.
REFUSED = {
    "unknown stress": (
        lambda: build(stress="pk1"),
        "stress is 'pk1'; expected one of ('cauchy', 'nominal', 'force')",
    ),
    "no specimen": (
        lambda: build(pulled().drop(columns="specimen")),
        "the frame has no column 'specimen'; it has 'stretch', 'stress', 'experiment': "
        f"{RENAME}'specimen'}})",
    ),
    "no deformation": (
        lambda: build(pulled().drop(columns="stretch")),
        "the frame has no column of the deformation, such as 'stretch_x' and 'stretch_y', or "
        f"'stretch' with kind=...; it has 'stress', {BOTH}: {MEASURES}",
    ),
    "any strain": (
        lambda: along_x(pulled().rename(columns={"stretch": "strain"})),
        "the frame has no column of the deformation, such as 'stretch_x' and 'stretch_y', or "
        f"'stretch' with kind=...; it has 'strain', 'stress', {BOTH}: 'strain' may be of two "
        f"kinds; {MEASURES}",
    ),
    "two deformations": (
        lambda: along_x(pulled(displacement=X)),
        "the frame has 'stretch', 'displacement', which all state the deformation: keep one "
        "measure, frame.drop(columns=['displacement'])",
    ),
    "no kind": (
        lambda: build(pulled()),
        "'stretch' states no axis: say kind=..., one of uniaxial, equibiaxial, pure_shear"
        f"{NO_AXIS}",
    ),
    "kind in a column": (
        lambda: build(pulled(kind="uniaxial"), check="ignore"),
        f"'stretch' states no axis: say kind='kind', as the frame has such a column{NO_AXIS}",
    ),
    "no y": (
        lambda: build(biaxial().drop(columns="stretch_y")),
        f"the frame has no column 'stretch_y'; {HAS.replace(" 'stretch_y',", '')}: "
        f"{RENAME}'stretch_y'}}); or if there is one stretch, say kind=..., one of uniaxial, "
        "equibiaxial, pure_shear",
    ),
    "axis and none": (
        lambda: along_x(pulled(stretch_y=1.0)),
        "the frame has 'stretch' and 'stretch_y': keep the columns with an axis, or 'stretch' "
        "alone",
    ),
    "no stress of y": (
        lambda: build(pulled(), kind="uniaxial_y", stress="force", area=1.0),
        f"the frame has no column 'force_y'; {HAS_ONE}: of stresses say stress='cauchy' or "
        "stress='nominal'",
    ),
    "forces": (
        lambda: along_x(called(pulled(), stress="force")),
        f"the frame has no column 'stress_x'; {HAS_ONE.replace('stress', 'force')}: of forces say "
        "stress='force' and area=...",
    ),
    "unknown kind": (
        lambda: along_x(kind="shear"),
        f"kind is 'shear'; expected one of {KNOWN}, or the name of a column of these; the frame "
        f"has {HAS_ONE.removeprefix('it has ')}",
    ),
    "unknown kind in a column": (
        lambda: along_x(pulled(how="simple shear"), kind="how"),
        f"{PLACE}, row 10: how is 'simple shear'; expected one of {KNOWN}",
    ),
    "kind changes": (
        lambda: along_x(pulled(how=["uniaxial"] * 3 + ["pure shear"] * 2), kind="how"),
        "2 problems:\n" + "\n".join(
            f"- {PLACE}, row {row}: how is 'pure_shear', but 'uniaxial' in the first row of this "
            "experiment; it must not change within one: correct it, or give the rows another "
            "experiment label" for row in (13, 14)
        ),
    ),
    "no area": (
        lambda: along_x(called(pulled(), stress="force"), stress="force"),
        "stress='force', and area is not given: give the unloaded cross-section on which the "
        "force acts, in the square of length_unit, as a number or the name of a column",
    ),
    "area of stresses": (
        lambda: along_x(area=3.0),
        "area is given, and stress='nominal': say stress='force' if the columns hold forces, or "
        "leave area out",
    ),
    "area of zero": (
        lambda: along_x(called(pulled(A=0.0), stress="force"), stress="force", area="A"),
        f"{PLACE}, row 10: area is 0; expected a positive number",
    ),
    "no gauge length": (
        lambda: along_x(displaced(X - 1)),
        "the deformation is a displacement, and gauge_length is not given: give the unloaded "
        "length that it extends, in the same unit, as a number or the name of a column",
    ),
    "gauge length of stretches": (
        lambda: along_x(gauge_length=3.0),
        "gauge_length is given, and the deformation is a stretch: name its columns "
        "'displacement_x' and 'displacement_y' if they hold displacements, or leave gauge_length "
        "out",
    ),
    "gauge length of one axis": (
        lambda: build(called(biaxial(), stretch="displacement"), gauge_length=(5.0, NAN)),
        f"{PLACE}, row 10: gauge_length of y is nan; expected a positive number",
    ),
    "three gauge lengths": (
        lambda: build(called(biaxial(), stretch="displacement"), gauge_length=(5, 5, 5)),
        "gauge_length is (5, 5, 5); expected one gauge_length, or two in a tuple, for x and for y",
    ),
    "gauge length changes": (
        lambda: along_x(displaced(X - 1, L=[5, 5, 5, 5, 6]), gauge_length="L"),
        f"{PLACE}, row 14: gauge_length is 6.0, but 5.0 in the first row of this experiment; it "
        "must not change within one: correct it, or give the rows another experiment label",
    ),
    "strain with 0": (
        lambda: along_x(pulled(stretch=X - 1)),
        f"{PLACE}, row 10: stretch is 0; {STRAIN.format('')}",
    ),
    "negative strain": (
        lambda: build(biaxial(stretch_y=1 - X)),
        f"{PLACE}, row 10: stretch_y is 0; {STRAIN.format('_y')}",
    ),
    "engineering strain": (
        lambda: along_x(called(pulled(stretch=-X), stretch=ENGINEERING)),
        f"{PLACE}, row 10: engineering_strain is -1; expected more than -1, as it is λ − 1",
    ),
    "Green strain": (
        lambda: build(called(biaxial(stretch_x=-X), stretch="green_strain")),
        f"{PLACE}, row 10: green_strain_x is -1; expected more than -0.5, as it is (λ² − 1)/2",
    ),
    "displacement": (
        lambda: along_x(displaced(-9 * X), gauge_length=9.5),
        f"{PLACE}, row 12: displacement is -9.9; expected more than minus the gauge_length, at "
        "which no length is left",
    ),
    "free in one row": (
        lambda: build(changed(biaxial(), "stretch_y", NAN)),
        f"{PLACE}, row 12: stretch_y is missing (nan) here, and not in all rows of this "
        "experiment, as if the sheet were free along y in this row only; fill it or drop the row",
    ),
    "no stretch": (
        lambda: along_x(changed(pulled(), "stretch", NAN)),
        f"{PLACE}, row 12: stretch is missing (nan); fill it or drop the row",
    ),
    "no stretch of both": (
        lambda: build(changed(changed(biaxial(), "stretch_y", NAN), "stretch_x", NAN)),
        f"{PLACE}, row 12: stretch_x and stretch_y are missing (nan); fill one or drop the row",
    ),
    "no stress": (
        lambda: along_x(changed(pulled(), "stress", None)),
        f"{PLACE}, row 12: stress is missing (nan); fill it or drop the row",
    ),
    "no stress of both": (
        lambda: build(changed(changed(biaxial(), "stress_y", NAN), "stress_x", NAN)),
        f"{PLACE}, row 12: stress_x and stress_y are missing (nan); fill one or drop the row",
    ),
    "stress in a free direction": (
        lambda: build(biaxial(stretch_y=NAN)),
        f"{PLACE}, row 11: stress_y is 0.4, but a sheet that is free along y has none there: fill "
        "in its stretch along y, or leave the cell empty",
    ),
    "stress across a uniaxial test": (
        lambda: build(kind="uniaxial"),
        f"{PLACE}, row 11: stress_y is 0.4, but a sheet that is free along y has none there: "
        "leave the column out, or say kind='biaxial' and give both stretches",
    ),
    "unequal stretches": (
        lambda: build(kind="equibiaxial"),
        f"{PLACE}, row 11: the stretch along y is 1.02; expected 1.05 in a test of the kind "
        "equibiaxial: if it differs say kind='biaxial'",
    ),
    "pure shear with a stretch": (
        lambda: build(kind="pure_shear"),
        f"{PLACE}, row 11: the stretch along y is 1.02; expected 1 in a test of the kind "
        "pure_shear: if it differs say kind='biaxial'",
    ),
    "text": (
        lambda: along_x(changed(pulled(), "stress", "12,3")),
        f"{PLACE}, row 12: stress is '12,3', not a number; correct it (decimal points, no units)",
    ),
    "infinite": (
        lambda: build(changed(biaxial(), "stretch_y", np.inf)),
        f"{PLACE}, row 12: stretch_y is inf; expected a finite number",
    ),
    "unit of stress": (
        lambda: build(stress_unit="N"),
        "stress_unit='N' does not measure stress; expected a unit of stress: kPa, Pa, hPa, "
        "MPa, mmHg, torr, cmH2O, mbar, bar, psi",
    ),
    "up and down": (
        lambda: along_x(pulled(stretch=[1.0, 1.1, 1.2, 1.1, 1.0])),
        f"{PLACE}, row 13: stretch turns back here, as if this were loading and unloading, between "
        "which a material loses energy: name loading and unloading in a column 'phase', cycles in "
        "a column 'cycle', and choose with ph.select(data, phase=...); or, if the rows were only "
        "shuffled, sort them, frame.sort_values('stretch')",
    ),
    "cycle with equal ends": (
        lambda: along_x(pulled(stretch=[1, 1.1, 1.2, 1.1, 1], stress=[0, 2.0, 5.0, 1.5, 0])),
        f"{PLACE}, row 13: stretch turns back here, as if this were loading and unloading, between "
        "which a material loses energy: name loading and unloading in a column 'phase', cycles in "
        "a column 'cycle', and choose with ph.select(data, phase=...); or, if the rows were only "
        "shuffled, sort them, frame.sort_values('stretch')",
    ),
    "row twice": (
        lambda: build(pd.concat([biaxial(), biaxial().iloc[[2]].set_index(pd.Index([30]))])),
        f"{PLACE}, row 30: repeats row 12 (stretch_x 1.1, stretch_y 1.05, stress_x 4, stress_y 1), "
        "and would count twice: drop it, by frame.drop_duplicates(subset=[...]) of labels and "
        "measured values",
    ),
    "group changes": (
        lambda: build(biaxial(group=list("AAAAB"))),
        f"{PLACE}, row 14: group is 'B', but 'A' in the first row of this experiment; it must not "
        "change within one: correct it, or give the rows another experiment label",
    ),
}  # fmt: skip


@pytest.mark.parametrize("call, message", REFUSED.values(), ids=REFUSED)
def test_bad_table_of_sheets_is_refused_with_place_and_value(call, message):
    assert message_of(call) == message


def test_arguments_of_a_wrong_type_are_refused():
    with pytest.raises(TypeError, match="'stress'"):
        ph.sheet_data(biaxial())
    with pytest.raises(TypeError, match="pandas DataFrame, not list"):
        build([1, 2])
    with pytest.raises(TypeError, match="gauge_length is True; expected a number, the name of a"):
        along_x(displaced(X - 1), gauge_length=True)


def test_problems_of_all_tests_are_reported_at_once():
    frame = pd.concat([pulled(stretch=X - 1), changed(pulled(experiment=2), "stress", "?")])
    assert message_of(along_x, frame).splitlines() == [
        "2 problems:",
        "- specimen 'S1', experiment 2, row 12: stress is '?', not a number; correct it (decimal "
        "points, no units)",
        f"- {PLACE}, row 10: stretch is 0; {STRAIN.format('')}",
    ]


STRETCH_OF_0_3 = pulled(stretch=np.linspace(0.05, 0.3, 5))
WIDE = biaxial(stress_y=0.0)
THICK = biaxial(stress_y=0.0, stretch_y=X**-1.5)
# A call, and its warning behind the place and before the advice to silence it.
DOUBTED = {
    "strain": (
        lambda **c: along_x(STRETCH_OF_0_3, **c),
        "the largest stretch of a sheet is 0.3; expected at least 0.6: was a strain given? Then "
        "name its column engineering_strain (λ − 1) or green_strain ((λ² − 1)/2)",
    ),
    "per cent": (
        lambda **c: along_x(called(pulled(stretch=100 * X - 100), stretch=ENGINEERING), **c),
        "the largest stretch of a sheet is 21; expected at most 10: was a strain given in per "
        "cent, 45 for 0.45, or is the gauge length in another unit than the displacement?",
    ),
    "gauge length in another unit": (
        lambda **c: along_x(displaced(X - 1), gauge_length=1e3, **c),
        "the largest change of a length of a sheet over its unloaded length is 0.0002; expected "
        "at least 0.003: is the gauge length in another unit than the displacement, or is this the "
        "change of a stretch?",
    ),
    "compression by strains": (
        lambda **c: along_x(pulled(stretch=np.linspace(1, 0.2, 5), stress=40 * (1 - X)), **c),
        "the smallest stretch of a sheet is 0.2; expected at least 0.3: was a strain given? Then "
        "name its column engineering_strain (λ − 1) or green_strain ((λ² − 1)/2)",
    ),
    "Pa as kPa": (
        lambda **c: along_x(pulled(stress=1e6 * X), **c),
        "the largest stress of a sheet is 1.2e+06 kPa; expected at most 200000 kPa: was another "
        "unit meant, stress_unit=... or force_unit=..., length_unit=...?",
    ),
    "MPa as kPa": (
        lambda **c: along_x(pulled(stress=0.005 * (X - 1)), **c),
        "the largest stress of a sheet is 0.001 kPa; expected at least 0.01 kPa: was another unit "
        "meant, stress_unit=... or force_unit=..., length_unit=...?",
    ),
    "sign of the stress": (
        lambda **c: along_x(pulled(stress=40 * (1 - X)), **c),
        "where the sheet is stretched most, its stress pulls against the stretch (stretch_x 1.2, "
        "stress_x -8 kPa): was a sign exchanged, or is the stretch over another length than the "
        "unloaded one?",
    ),
    "wide": (
        lambda **c: build(WIDE, kind="uniaxial", **c),
        "the stretch across the axis along which a sheet is pulled is 1.1; expected at most 1.02: "
        "were the axes exchanged, or is this a biaxial test, kind='biaxial'?",
    ),
    "thick": (
        lambda **c: build(THICK, kind="uniaxial", **c),
        "the stretch of the thickness, 1/(λx λy), of a sheet pulled along one axis is 1.09545; "
        "expected at most 1.02: the sheet would become thicker where it is pulled: were the axes "
        "exchanged, is one stretch over another length, or is the material compressible?",
    ),
}  # fmt: skip


@pytest.mark.parametrize("call, expected", DOUBTED.values(), ids=DOUBTED)
def test_implausible_sheet_warns_with_its_likely_cause_raises_or_is_ignored(call, expected):
    with pytest.warns(UserWarning) as warned:
        call()
    (message,) = [str(w.message) for w in warned]
    assert message == f'{PLACE}: {expected}; if it is right, say check="ignore"'
    assert warned[0].filename == __file__
    with pytest.raises(ValueError, match=re.escape(expected)):
        call(check="raise")
    call(check="ignore")


def test_plausible_sheets_give_no_warning():
    """Fibres may keep the width or the thickness; a stress may be unknown where there is work."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for across in (X**-1.0, X**0.0, X**-0.5):
            build(biaxial(stretch_y=across, stress_y=0.0), kind="uniaxial")
        along_x(pulled(stretch=2 - X, stress=40 * (1 - X)))  # compression
        along_x(pulled(stretch=1 + 8 * (X - 1) / 0.2, stress=6e4 * (X - 1)))  # rubber
        # The y axis is pulled, and pulls x though that is shorter.
        build(biaxial(stretch_x=2 - X, stretch_y=X, stress_y=NAN))


@pytest.mark.parametrize("name", [name for name in PLAUSIBLE if "sheet" in PLAUSIBLE[name].what])
def test_sizes_of_sheets_warn_only_beyond_the_ends_of_their_plausible_range(name):
    def of_size(size):
        frame = {
            "largest_stretch": pulled(stretch=np.linspace(min(1, size), size, 5)),
            "smallest_stretch": pulled(stretch=np.linspace(1, size, 5), stress=40 * (1 - X)),
            "largest_strain": pulled(stretch=1 + size * (X - 1) / 0.2),
            "largest_stress": pulled(stress=size * (X - 1) / 0.2),
            "lateral_stretch": biaxial(stretch_y=1 + (size - 1) * (X - 1) / 0.2, stress_y=0.0),
            "thickness_stretch": biaxial(stretch_y=1 / (size * X), stress_y=0.0),
        }[name]
        return build(frame, kind="uniaxial")

    ends = {PLAUSIBLE[name].low: -1, PLAUSIBLE[name].high: 1}
    for end, outward in ends.items():
        if end and np.isfinite(end):
            of_size(end - outward * 1e-6 * end)
            with pytest.warns(UserWarning, match=re.escape(PLAUSIBLE[name].what)) as warned:
                of_size(end + outward * 1e-6 * end)
            assert len(warned) == 1


def test_unused_column_of_kinds_and_single_points_warn():
    with pytest.warns(UserWarning) as warned:
        build(biaxial(kind="equibiaxial"))
    assert [str(w.message) for w in warned] == [
        "the frame has a column 'kind', and all tests are taken as biaxial: to take the column, "
        "say kind='kind'; if it is right, say check=\"ignore\""
    ]
    with pytest.warns(UserWarning, match="each of the 5 specimens has a single measured point"):
        build(biaxial(specimen=list("abcde"), stretch_x=1.2, stress_x=5.0))
