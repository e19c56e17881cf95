"""Columns of a table of sheets, read as stretches and stresses along x and y.

The name of a column states its content: ``stretch_x`` and ``stretch_y``, or one of the other
measures of :data:`DEFORMATIONS`. A column without ``_x`` or ``_y`` belongs to the axis along which
the kind of test pulls.
"""

import re
from collections.abc import Iterable
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pymc_hyperelastic.data.columns import Rows, labels_of
from pymc_hyperelastic.messages import listed, shown
from pymc_hyperelastic.rounding import ROUNDING

Array = NDArray[np.float64]
ByAxis = dict[str, Array]
# A measure of the sheet: a number or the name of a column, or one of these for each axis.
Measure = float | str | tuple[float | str, float | str]
StatedStress = Literal["cauchy", "nominal", "force"]
Kind = Literal["biaxial", "uniaxial", "uniaxial_x", "uniaxial_y", "equibiaxial", "pure_shear"]

AXES = ("x", "y")


#: Names of columns of the deformation, with their equations by the stretch λ.
DEFORMATIONS = {
    "stretch": "λ",
    "engineering_strain": "λ − 1",
    "green_strain": "(λ² − 1)/2",
    "displacement": "λ − 1 times gauge_length",
}
_NAMES = ", ".join(f"{name} ({equation})" for name, equation in DEFORMATIONS.items())


def columns_of(name: str) -> tuple[str, str, str]:
    """Names of the columns that may hold a quantity: of the pulled axis, along x and along y."""
    return name, f"{name}_x", f"{name}_y"


def deformation_in(columns: Iterable[str]) -> str:
    """Measure of deformation that a frame has. Raises ValueError if it has none, or several."""
    columns = [*columns]
    there = [name for names in map(columns_of, DEFORMATIONS) for name in names if name in columns]
    measures = [name for name in DEFORMATIONS if {*columns_of(name)} & {*there}]
    if len(measures) > 1:
        raise ValueError(
            f"the frame has {listed(there)}, which all state the deformation: keep one measure, "
            f"frame.drop(columns=[{there[-1]!r}])"
        )
    if measures:
        return measures[0]
    strain = next((name for name in columns_of("strain") if name in columns), None)
    why = f"{strain!r} may be of two kinds; " if strain else ""
    raise ValueError(
        "the frame has no column of the deformation, such as 'stretch_x' and 'stretch_y', or "
        f"'stretch' with kind=...; it has {listed(columns)}: {why}rename the column, "
        f"frame.rename(columns={{...}}), by its content: {_NAMES}"
    )


def kinds_of(rows: Rows, kind: str) -> NDArray[np.str_]:
    """Kind of test of every row: the given one, or those of the column of the given name."""
    known = get_args(Kind)
    if not isinstance(kind, str) or (kind not in known and kind not in rows.frame):
        raise ValueError(
            f"kind is {shown(kind)}; expected one of {known}, or the name of a column of these; "
            f"the frame has {listed(rows.frame.columns)}"
        )
    if kind in known:
        if "kind" in rows.frame:
            rows.problems.doubt(
                "overlooked kind",
                "",
                f"the frame has a column 'kind', and all tests are taken as {kind}: to take the "
                "column, say kind='kind'",
            )
        return np.full(len(rows.test), kind)
    labels = labels_of(rows.frame, kind)
    kinds = np.array([re.sub(r"[\s_-]+", "_", str(label).strip().casefold()) for label in labels])
    unknown = ~np.isin(kinds, known)
    rows.refuse_first(
        unknown, lambda i: f"{kind} is {shown(labels[i].item())}; expected one of {known}"
    )
    if not unknown.any():
        rows.constant(kind, kinds)
    return kinds


def axes_of(kinds: NDArray[np.str_]) -> NDArray[np.str_]:
    """Axis along which each row is pulled; x for both."""
    return np.where(kinds == "uniaxial_y", "y", "x")


def check_columns(rows: Rows, name: str, kinds: NDArray[np.str_]) -> None:
    """Raise unless the frame has the columns of a quantity that its kinds of tests need."""
    bare, *by_axis = columns_of(name)
    there = [column for column in by_axis if column in rows.frame]
    how = "say kind=..., one of uniaxial, equibiaxial, pure_shear"
    if rows.of_files:
        how = "say the kind, uniaxial, equibiaxial or pure_shear, in a column or in constants.kind"
    elif "kind" in rows.frame:
        how = "say kind='kind', as the frame has such a column"
    biaxial = bool((kinds == "biaxial").any())
    if bare in rows.frame:
        if there:
            raise ValueError(
                f"the frame has {bare!r} and {there[0]!r}: keep the columns with an axis, or "
                f"{bare!r} alone"
            )
        if biaxial:
            raise ValueError(
                f"{bare!r} states no axis: {how}; or of biaxial tests give {by_axis[0]!r} and "
                f"{by_axis[1]!r}"
            )
        return
    needed = by_axis if biaxial else [f"{name}_{axis}" for axis in np.unique(axes_of(kinds))]
    missing = [column for column in needed if column not in rows.frame]
    if missing:
        fix = "rename what holds it"
        if not rows.of_files:
            fix += f", frame.rename(columns={{'...': {missing[0]!r}}})"
        if name == "stress" and {*columns_of("force")} & {*rows.frame}:
            fix = "of forces say stress='force' and area=..."
        elif name == "force" and {*columns_of("stress")} & {*rows.frame}:
            fix = "of stresses say stress='cauchy' or stress='nominal'"
        elif biaxial and len(missing) == 1:
            fix += f"; or if there is one {name}, {how}"
        raise ValueError(
            f"the frame has no column {' and no column '.join(map(repr, missing))}; it has "
            f"{listed(rows.frame.columns)}: {fix}"
        )


def numbers_of(rows: Rows, name: str, kinds: NDArray[np.str_]) -> ByAxis:
    """Numbers of a quantity along both axes, NaN if not measured."""
    if name in rows.frame:
        numbers, pulled = rows.numbers(name, may_be_missing=True), axes_of(kinds)
        return {axis: np.where(pulled == axis, numbers, np.nan) for axis in AXES}
    return {
        axis: rows.numbers(column, may_be_missing=True)
        if (column := f"{name}_{axis}") in rows.frame
        else np.full(len(rows.test), np.nan)
        for axis in AXES
    }


def as_in_frame(rows: Rows, name: str, numbers: ByAxis) -> ByAxis:
    """Return numbers along both axes by the names of their columns."""
    if name in rows.frame:
        return {name: np.where(np.isnan(numbers["x"]), numbers["y"], numbers["x"])}
    return {f"{name}_{axis}": numbers[axis] for axis in AXES}


def name_of(rows: Rows, name: str, axis: str) -> str:
    """Name of the column that holds a quantity along an axis."""
    return name if name in rows.frame else f"{name}_{axis}"


def measures_of(rows: Rows, name: str, given: Measure, used: ByAxis) -> ByAxis:
    """Return a positive measure of the sheet for every row and axis: one, or one for each axis.

    Errors are of axes along which there are numbers to divide, the `used` ones.
    """
    several = isinstance(given, tuple | list)
    parts = tuple(given) if isinstance(given, tuple | list) else (given,)
    if several and len(parts) != len(AXES):
        raise ValueError(
            f"{name} is {shown(given)}; expected one {name}, or two in a tuple, for x and for y"
        )
    values = [rows.of_tests(name, part)[rows.test] for part in parts]
    measures = dict(zip(AXES, values * (1 if several else 2), strict=True))
    for axis, of_axis in measures.items():
        bad = ~((of_axis > 0) & np.isfinite(of_axis)) & ~np.isnan(used[axis])
        of = f" of {axis}" if several else ""
        _refuse(rows, bad, f"{name}{of} is {{:.6g}}; expected a positive number", of_axis)
        measures[axis] = np.where(of_axis > 0, of_axis, np.nan)
    return measures


def stretches_of_sheet(rows: Rows, name: str, numbers: ByAxis, gauge_length: ByAxis) -> ByAxis:
    """Stretches for the given measure of them, `name`, with errors where no sheet has them."""
    stretches = {}
    for axis, given in numbers.items():
        column = name_of(rows, name, axis)
        end = column.removeprefix(name)
        expected = {
            "stretch": "expected a positive ratio of lengths, 1 for an unstretched sheet: was a "
            f"strain given? Then name the column engineering_strain{end} (λ − 1) or "
            f"green_strain{end} ((λ² − 1)/2)",
            "engineering_strain": "expected more than -1, as it is λ − 1",
            "green_strain": "expected more than -0.5, as it is (λ² − 1)/2",
            "displacement": "expected more than minus the gauge_length, at which no length is left",
        }[name]
        of_axis = _stretch(name, given / gauge_length[axis] if gauge_length else given)
        _refuse(rows, of_axis <= 0, f"{column} is {{:.6g}}; {expected}", given)
        stretches[axis] = np.where(of_axis > 0, of_axis, np.nan)
    return stretches


def _stretch(name: str, deformation: Array) -> Array:
    """Return the stretch of a measure of deformation; 0 or less where no sheet has it."""
    if name == "stretch":
        return deformation
    if name == "green_strain":
        return np.sqrt(np.maximum(1 + 2 * deformation, 0))
    return 1 + deformation


def completed(
    rows: Rows, name: str, stretches: ByAxis, kinds: NDArray[np.str_]
) -> tuple[ByAxis, Array]:
    """Stretches as the kinds of tests state them, NaN if free; and measured lateral stretches."""
    pulled, biaxial = axes_of(kinds), kinds == "biaxial"
    _refuse_missing(rows, name, stretches, biaxial)
    for axis, of_axis in stretches.items():
        missing = np.isnan(of_axis)
        column = name_of(rows, name, axis)
        fill = f"{column} is missing (nan){{}}; fill it or drop the row"
        _refuse(rows, missing & ~biaxial & (pulled == axis), fill.format(""))
        some = np.bincount(rows.test, ~missing)[rows.test] > 0
        partly = " here, and not in all rows of this experiment, as if the sheet were free along "
        _refuse(rows, missing & biaxial & some, fill.format(f"{partly}{axis} in this row only"))
    along, other = (np.where(pulled == axis, stretches["x"], stretches["y"]) for axis in AXES)
    expected = np.where(kinds == "equibiaxial", along, 1.0)
    held = np.isin(kinds, ("equibiaxial", "pure_shear"))
    bad = held & np.isfinite(other) & ~np.isclose(other, expected, rtol=ROUNDING, atol=0)
    rows.refuse_first(
        bad,
        lambda i: (
            f"the stretch along y is {other[i]:.6g}; expected {expected[i]:.6g} in a test of "
            f"the kind {kinds[i]}: if it differs {_say_biaxial(rows)}"
        ),
    )
    uniaxial = ~held & ~biaxial
    other = np.where(uniaxial, np.nan, np.where(held, expected, other))
    completed = {
        "x": np.where(pulled == "x", along, other),
        "y": np.where(pulled == "x", other, along),
    }
    lateral = np.where(pulled == "x", stretches["y"], stretches["x"])
    return completed, np.where(uniaxial, lateral, np.nan)


def without_free(
    rows: Rows, name: str, stresses: ByAxis, stretches: ByAxis, kinds: NDArray[np.str_]
) -> ByAxis:
    """Stresses, NaN in free directions, in which any stress but 0 is an error."""
    stresses = dict(stresses)
    for axis, given in stresses.items():
        free, column = np.isnan(stretches[axis]), name_of(rows, name, axis)
        bad = free & (np.nan_to_num(given) != 0)
        what = f"{column} is {{:.6g}}, but a sheet that is free along {axis} has none there: "
        biaxial = kinds == "biaxial"
        fill = f"fill in its stretch along {axis}, or leave the cell empty"
        _refuse(rows, bad & biaxial, what + fill, given)
        fill = f"leave the column out, or {_say_biaxial(rows)} and give both stretches"
        _refuse(rows, bad & ~biaxial, what + fill, given)
        stresses[axis] = np.where(free, np.nan, given)
    _refuse_missing(rows, name, stresses, np.full(len(rows.test), True))
    return stresses


def _say_biaxial(rows: Rows) -> str:
    return "say kind = 'biaxial' in its column" if rows.of_files else "say kind='biaxial'"


def _refuse_missing(rows: Rows, name: str, numbers: ByAxis, expected: NDArray[np.bool_]) -> None:
    """Record rows without a number along either axis as errors."""
    missing = np.all([np.isnan(of_axis) for of_axis in numbers.values()], axis=0)
    one = f"{name} is missing (nan); fill it or drop the row"
    both = f"{name}_x and {name}_y are missing (nan); fill one or drop the row"
    _refuse(rows, missing & expected, one if name in rows.frame else both)


def _refuse(rows: Rows, bad: NDArray[np.bool_], what: str, values: Array | None = None) -> None:
    """Record the first bad row of each test as an error, with its value in place of the braces."""
    rows.refuse_first(bad, lambda i: what if values is None else what.format(values[i]))
