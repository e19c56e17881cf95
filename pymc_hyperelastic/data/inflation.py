"""Measured curves of tubes and of sheets as one labelled, checked :class:`xarray.Dataset`.

Dimension ``obs`` holds the measured points, dimension ``test`` the experiments. The coordinate
``test`` on ``obs`` says to which experiment a point belongs. Pressures and stresses are in kPa,
lengths in mm, angles in rad. Data of tubes are *inflation data*; ``variables.py`` says what data
hold.

In an *inflation test* the axial stretch is held; in an *extension test* it varies from point to
point, mostly at a held pressure. If there are extension tests, ``axial_stretch`` lies on ``obs``,
for all tests; :func:`at_points` returns it, or another measure of the tube, at every point.
"""

from collections.abc import Hashable, Iterator

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.validation import Problem
from pymc_hyperelastic.data.variables import (
    OPTIONAL,
    REQUIRED,
    STRESS_MEASURE,
    TEST_LABELS,
    dimensions_of,
    sheet_tests,
)
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.quantities import IN_DATA, SHEET_VARIABLES, STRESSES
from pymc_hyperelastic.rounding import ROUNDING

#: Points of a test that another test has too, as if one were a copy; fewer may agree by chance.
FEWEST_COPIED = 3
# Names of data by whether there are tubes and sheets.
_KINDS = {
    (True, False): "inflation data",
    (False, True): "data of sheets",
    (True, True): "data of tubes and sheets",
}


def names_of_test(data: xr.Dataset) -> list[str]:
    """Names of the labels that together name a test."""
    return [name for name in TEST_LABELS if name in data.coords]


def describe_test(data: xr.Dataset, i: int) -> str:
    """Specimen and experiment of the test at position `i`, as messages name it."""
    names = names_of_test(data)
    return ", ".join(f"{name} {data[name].values[[i]].tolist()[0]!r}" for name in names)


def file_of(row: Hashable) -> str:
    """File of a row that is labelled by file and line, or nothing."""
    return row.rpartition(", line ")[0] if isinstance(row, str) else ""


def row_text(row: Hashable) -> str:
    """A row as messages name it: by its file and line, or by its label in the frame."""
    return str(row) if file_of(row) else f"row {row}"


def place_of_test(data: xr.Dataset, i: int) -> str:
    """File and labels of a test, as messages name it."""
    file = file_of(data["row"].values[points_of(data, i).start].item()) if "row" in data else ""
    return f"{file}: {describe_test(data, i)}" if file else describe_test(data, i)


def _place_of_point(data: xr.Dataset, i: int) -> str:
    row = row_text(data["row"].values.tolist()[i]) if "row" in data.coords else f"point {i}"
    return f"{describe_test(data, int(data['test'].values[i]))}, {row}"


def points_of(data: xr.Dataset, i: int) -> slice:
    """Positions along dimension ``obs`` of the points of test `i`, counted from 0."""
    points = np.flatnonzero(data["test"].values == i)
    if not points.size:
        raise IndexError(f"no test {i} in the data; expected 0 to {data.sizes['test'] - 1}")
    return slice(int(points[0]), int(points[-1]) + 1)


def at_points(data: xr.Dataset, name: str) -> NDArray[np.float64]:
    """A measure of the tube at every point, whether it lies on ``test`` or varies within a test."""
    return _at_points(data, data[name]).astype(float)


def _at_points(data: xr.Dataset, variable: xr.DataArray) -> NDArray:
    return variable.values if variable.dims == ("obs",) else variable.values[data["test"].values]


def evenly_along(
    x: NDArray[np.float64], values: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """Values, interpolated linearly, at `count` places evenly between the ends of `x`.

    The points may stand in any order.
    """
    order = np.argsort(x, kind="stable")
    return np.interp(np.linspace(x.min(), x.max(), count), x[order], values[order])


def varies(stretch: NDArray[np.float64], test: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Return True for tests in which an axial stretch given by points varies beyond rounding."""
    low, high = np.full((2, int(test.max()) + 1), [[np.inf], [-np.inf]])
    with np.errstate(invalid="ignore"):  # NaN, an unknown stretch, is one number
        np.minimum.at(low, test, stretch)
        np.maximum.at(high, test, stretch)
    return high - low > ROUNDING * np.abs(high)


def extension_tests(data: xr.Dataset) -> NDArray[np.bool_]:
    """Return True for extension tests, whose axial stretch varies."""
    if data["axial_stretch"].dims != ("obs",):
        return np.zeros(data.sizes["test"], bool)
    return varies(at_points(data, "axial_stretch"), data["test"].values)


def held_stretches(data: xr.Dataset) -> NDArray[np.float64]:
    """Axial stretch of each test; NaN of an extension test."""
    first = [points_of(data, test).start for test in range(data.sizes["test"])]
    return np.where(extension_tests(data), np.nan, at_points(data, "axial_stretch")[first])


def measured_radius(data: xr.Dataset) -> xr.DataArray:
    """The measured radius, mm: the internal one, or half of the outer diameter."""
    return data["outer_diameter"] / 2 if "outer_diameter" in data else data["radius"]


def check_data(data: xr.Dataset) -> None:
    """Raise unless `data` is a sound Dataset of tests of tubes, of sheets, or of both.

    That is a Dataset as :func:`inflation_data` and :func:`sheet_data` build it. A variable may be
    missing, lie on another dimension, have another unit or not be numeric. Points of a test may not
    stand together. Two tests, or specimens of two groups, may have one label. A value may not be
    finite, or be impossible. All these are errors. The coordinates ``row``, ``cycle`` and ``phase``
    may be missing.
    """
    _check_structure(data)
    for place, what, *_ in defects_of(data):
        raise ValueError(f"{place}: {what}")


def _check_structure(data: xr.Dataset) -> None:
    if not isinstance(data, xr.Dataset):
        raise TypeError(
            f"inflation data are an xarray.Dataset, not {type(data).__name__}; make one from a "
            "table with inflation_data(frame, ...), or of sheets with sheet_data(frame, ...)"
        )
    required, optional = dimensions_of(data)
    variables = data.variables  # whose access is much faster than that of the Dataset
    for name, dimension in (required | optional).items():
        if name not in variables:
            if name in optional:
                continue
            kinds = ("radius" in required, "stretch_x" in required)
            raise ValueError(f"the {_KINDS[kinds]} lack {name!r} (dimension {dimension!r})")
        allowed = [(dimension,), ("obs",)] if name == "axial_stretch" else [(dimension,)]
        if variables[name].dims not in allowed:
            expected = " or ".join(map(str, allowed))
            raise ValueError(
                f"{name!r} has dimensions {variables[name].dims}; expected {expected}. If points "
                "were selected by `where`, select them by data.isel(obs=condition)"
            )
        expected = IN_DATA[name].unit if name in IN_DATA else "1"
        unit = variables[name].attrs.get("units", expected)
        if unit != expected:
            raise ValueError(f"{name!r} is in {unit!r}; expected {expected!r}: convert it")
    _check_tests(data)
    _check_labels(data)


def _check_tests(data: xr.Dataset) -> None:
    if not data.sizes["obs"]:
        raise ValueError("the data hold no points")
    test = data["test"].values
    if test.dtype.kind not in "iu":
        raise ValueError(f"'test' must hold integers, not {test.dtype}")
    counts = np.isin(np.arange(data.sizes["test"]), test)
    if not counts.all():
        empty = int(np.flatnonzero(~counts)[0])
        raise ValueError(
            f"{describe_test(data, empty)} has no points: choose tests with select(), "
            "which drops them whole"
        )
    if test.min() < 0 or test.max() >= data.sizes["test"]:
        raise ValueError(
            f"'test' runs from {test.min()} to {test.max()}, but there are {data.sizes['test']} "
            "tests, counted from 0"
        )
    back = np.flatnonzero(np.diff(test) < 0)
    if back.size:
        raise ValueError(
            f"{_place_of_point(data, int(back[0]) + 1)}: the points of a test must stand together, "
            "in the order of the tests: sort the data with "
            "data.isel(obs=data['test'].argsort(stable=True).values)"
        )


def _check_labels(data: xr.Dataset) -> None:
    """Raise if two tests, or specimens of two groups, have one label: one would be lost."""
    tests: dict[tuple, int] = {}
    groups: dict[str, tuple[int, str]] = {}
    names = (*names_of_test(data), "group")
    columns = (data.variables[name].values.tolist() for name in names)
    for i, (specimen, *others, group) in enumerate(zip(*columns, strict=True)):
        first = tests.setdefault((specimen, *others), i)
        if first != i:
            points = (_place_of_point(data, points_of(data, j).start) for j in (first, i))
            raise ValueError(
                f"tests {first} and {i} have the same labels ({' and '.join(points)}): give one "
                "of them another experiment or specimen, "
                "data.assign_coords(experiment=('test', [...]))"
            )
        first, other = groups.setdefault(specimen, (i, group))
        if other != group:
            raise ValueError(
                f"specimen {specimen!r} is in group {other!r} ({place_of_test(data, first)}) and "
                f"in group {group!r} ({place_of_test(data, i)}): a specimen has one group. Give "
                "the specimens of the two groups different names"
            )


# Expected value of an outer diameter that is less than that of the wall without a lumen.
_ROOM = (
    "an outer diameter in which the wall has room: is it an inner diameter, are inner_radius and "
    "outer_radius diameters or in another unit, or is axial_stretch a strain?"
)
# Expected values of variables that must be positive.
_POSITIVE = {
    "radius": "expected a positive radius: correct or drop the row",
    "outer_diameter": "expected a positive diameter: correct or drop the row",
    "inner_radius": "expected a positive radius",
    "axial_stretch": "expected a positive ratio of lengths, 1 for an unstretched tube",
}
#: Expected value of an opening angle.
ANGLE = 'expected an angle between -2 pi and 2 pi: for degrees, say angle_unit="deg"'


def defects_of(data: xr.Dataset) -> Iterator[Problem]:
    """Values of a Dataset that are not finite, or impossible for a tube or a sheet."""
    sheets = sheet_tests(data)
    if not sheets.all():
        yield from _defects_of_tubes(data, sheets)
    if STRESS_MEASURE in data.variables:
        yield from _defects_of_sheets(data, sheets)


def _defects_of_tubes(data: xr.Dataset, sheets: np.ndarray) -> Iterator[Problem]:
    present = [*REQUIRED, *(name for name in OPTIONAL if name in data.variables)]
    values = {name: _numbers(data, name) for name in present}
    for name, numbers in values.items():
        expected = "a finite number"
        if name == "radius" and "outer_diameter" in values:
            expected = _ROOM
        missing = np.isnan(numbers) & ~np.asarray(_may_be_missing(data, name))
        bad = {f"expected {expected}": np.isinf(numbers) | missing}
        if name in _POSITIVE:
            bad[_POSITIVE[name]] = numbers <= 0
        elif name == "outer_radius":
            exchanged = "were the two exchanged, or is one a diameter?"
            bad[f"expected more than inner_radius: {exchanged}"] = numbers <= values["inner_radius"]
        elif name == "opening_angle":
            bad[ANGLE] = np.abs(numbers) >= 2 * np.pi
        elif name.endswith("_sd"):
            bad["expected a standard deviation, not below 0"] = numbers < 0
        if sheets.any():
            on_points = data.variables[name].dims == ("obs",)
            of_sheet = sheets[data["test"].values] if on_points else sheets
            bad = {expected: found & ~of_sheet for expected, found in bad.items()}
            bad["expected nan, as the test is of a sheet"] = ~np.isnan(numbers) & of_sheet
        for expected, found in bad.items():
            # The user states the diameter, not the internal radius that follows from it.
            stated = "outer_diameter" if expected.endswith(_ROOM) else name
            yield from _found(data, stated, values[stated], found, expected)


def _defects_of_sheets(data: xr.Dataset, sheets: np.ndarray) -> Iterator[Problem]:
    of_sheet = sheets[data["test"].values]
    values = {name: _numbers(data, name) for name in SHEET_VARIABLES}
    missing = {name: np.isnan(numbers) for name, numbers in values.items()}
    bad = {
        "expected nan, as the test is of a tube": {
            name: ~missing[name] & ~of_sheet for name in SHEET_VARIABLES
        },
        "expected a positive ratio of lengths, 1 for an unstretched sheet: was a strain given?": {
            name: of_sheet & (np.isinf(values[name]) | (values[name] <= 0))
            for name in ("stretch_x", "stretch_y")
        },
        "expected a finite number, or nan if it was not measured": {
            name: of_sheet & np.isinf(values[name]) for name in STRESSES
        },
        "expected a number: both stretches are missing": {
            "stretch_x": of_sheet & missing["stretch_x"] & missing["stretch_y"]
        },
        "expected a number: both stresses are missing; drop the row": {
            "stress_x": of_sheet & missing["stress_x"] & missing["stress_y"]
        },
    }
    for axis in "xy":
        free = of_sheet & missing[f"stretch_{axis}"] & ~missing[f"stress_{axis}"]
        expected = f"expected nan, as the sheet is free along {axis}: stretch_{axis} is nan"
        bad[expected] = {f"stress_{axis}": free}
    for expected, of_variables in bad.items():
        for name, points in of_variables.items():
            yield from _found(data, name, values[name], points, expected)


def _may_be_missing(data: xr.Dataset, name: str) -> bool | np.ndarray:
    """Return True for variables that may be NaN: unknown geometry, a force without reading."""
    if name == "radius" and "outer_diameter" in data:
        unknown = [_at_points(data, data[geometry].isnull()) for geometry in GEOMETRY]
        return np.any(unknown, axis=0)
    if data.variables[name].dims == ("obs",):  # a stretch that varies was measured
        return name == "axial_force"
    return name in (*GEOMETRY, "kept_circle")


def _numbers(data: xr.Dataset, name: str) -> np.ndarray:
    found = data.variables[name].values
    is_text = found.dtype.kind == "O" and any(isinstance(x, str) for x in found.flat)
    try:
        if found.dtype.kind not in "biufO" or is_text:  # dates and text that looks like numbers
            raise TypeError
        return np.asarray(found, dtype=float)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name!r} must hold numbers, not {data[name].dtype}") from error


def _found(
    data: xr.Dataset, name: str, values: np.ndarray, bad: np.ndarray, expected: str
) -> Iterator[Problem]:
    spec = IN_DATA[name]
    unit = "" if spec.unit == "1" else f" {spec.unit}"
    of_test = data.variables[name].dims == ("test",)
    place = place_of_test if of_test else _place_of_point
    dimension = spec.dimension if "_unit=" in expected else ""
    for i in np.flatnonzero(bad):
        what = f"{name} is {values[i]:.6g}{unit}; {expected}"
        test = int(i if of_test else data.variables["test"].values[i])
        yield Problem(place(data, int(i)), what, dimension, of_test, test)
