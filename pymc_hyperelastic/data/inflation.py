"""Inflation data: measured curves as one labelled, checked :class:`xarray.Dataset`.

Dimension ``obs`` holds the measured points, dimension ``test`` the inflation experiments. The
coordinate ``test`` on ``obs`` says to which experiment a point belongs. Pressures are in kPa,
lengths in mm, angles in rad.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from math import pi
from numbers import Real
from typing import Any, Literal, get_args

import numpy as np
import pandas as pd
import xarray as xr

from pymc_hyperelastic.data.units import to_internal
from pymc_hyperelastic.mechanics.tube import internal_radius_from_outer_radius

__all__ = [
    "check_inflation_data",
    "describe_test",
    "inflation_data",
    "measured_radius",
    "points_of",
    "select",
]

Measured = Literal["radius", "outer_diameter"]

# What states the reference tube of a test, in the order in which functions take it.
GEOMETRY = ("inner_radius", "outer_radius", "axial_stretch", "opening_angle")

# What the Dataset holds: name, (dimension, unit, name for people).
VARIABLES = {
    "radius": ("obs", "mm", "internal radius"),
    "pressure": ("obs", "kPa", "pressure"),
    "inner_radius": ("test", "mm", "inner radius of the reference tube"),
    "outer_radius": ("test", "mm", "outer radius of the reference tube"),
    "axial_stretch": ("test", "1", "axial stretch"),
    "opening_angle": ("test", "rad", "opening angle of the cut ring"),
}
# What it may hold.
OPTIONAL = {
    "outer_diameter": ("obs", "mm", "outer diameter"),
    "axial_force": ("obs", "mN", "reduced axial force"),
}
COORDINATES = {
    "test": ("obs", "1", "inflation experiment that the point belongs to"),
    "row": ("obs", "1", "row of the point in its table"),
    "specimen": ("test", "1", "specimen"),
    "experiment": ("test", "1", "experiment on the specimen"),
    "group": ("test", "1", "group"),
}


def inflation_data(
    frame: pd.DataFrame,
    *,
    inner_radius: float | str | None,
    outer_radius: float | str | None,
    axial_stretch: float | str | None = 1.0,
    opening_angle: float | str | None = 0.0,
    measured: Measured = "radius",
    radius_unit: str = "mm",
    pressure_unit: str = "kPa",
    angle_unit: str = "rad",
    force_unit: str = "mN",
) -> xr.Dataset:
    """Build the inflation Dataset from a table of measured points.

    Parameters
    ----------
    frame : pandas.DataFrame
        One row a point, with the columns ``specimen``, ``experiment``, what was `measured`,
        ``pressure`` and optionally ``axial_force`` (reduced axial force; missing where it was not
        measured) and ``group``; others are ignored. A specimen and an experiment together name one
        inflation test.
    inner_radius, outer_radius : float, str or None
        Radii of the reference tube in `radius_unit`: a number, or the name of a column that is
        constant within each test. None where they are not known: they are then inferred, see
        ``geometry`` of :func:`~pymc_hyperelastic.inflation_model`.
    axial_stretch, opening_angle : float, str or None
        Axial stretch, and opening angle of the cut ring in `angle_unit`, given in the same way.
    measured : {"radius", "outer_diameter"}
        What was measured against pressure, and has a column of that name: the current internal
        radius, or the current outer diameter, to which the internal radius belongs by
        incompressibility. Slopes are taken by what was measured.
    radius_unit, pressure_unit, angle_unit, force_unit : str
        Units of what is given, as pint knows them, such as ``"um"``, ``"mmHg"``, ``"deg"``. That of
        the radius is that of the diameter, too.

    Returns
    -------
    xarray.Dataset
        Dimension ``obs`` with ``radius`` (internal, mm; NaN where it depends on what is not
        known), ``pressure`` (kPa), ``outer_diameter`` (mm) and ``axial_force`` (mN) if measured,
        and the coordinates ``test`` and ``row`` (the frame's index label); the points of a test
        stand together, in the frame's order. Dimension ``test``, in order of first appearance,
        with ``inner_radius``, ``outer_radius`` (mm), ``axial_stretch``, ``opening_angle`` (rad),
        NaN where unknown, and the coordinates ``specimen``, ``experiment`` and ``group``
        (``"all"`` without such a column).

    Raises
    ------
    TypeError
        If `frame` is not a DataFrame, or a geometry argument is neither a number nor a str.
    ValueError
        If a column, label or value is missing, is text, is not finite or is impossible for a
        tube; if geometry or group change within a test; if a unit does not fit.

    Examples
    --------
    >>> import pandas as pd, pymc_hyperelastic as ph
    >>> frame = pd.DataFrame(
    ...     {"specimen": "S1", "experiment": 1, "radius": [7.1, 7.6], "pressure": [5.0, 30.0]}
    ... )
    >>> data = ph.inflation_data(frame, inner_radius=7.0, outer_radius=9.0, pressure_unit="mmHg")
    >>> dict(data.sizes)
    {'obs': 2, 'test': 1}
    """
    if measured not in get_args(Measured):
        raise ValueError(f"measured is {measured!r}; expected one of {get_args(Measured)}")
    _check_frame(frame, measured)
    specimen, experiment = _labels(frame, "specimen"), _labels(frame, "experiment")
    group = _labels(frame, "group") if "group" in frame else np.full(len(frame), "all")
    test, _ = pd.factorize(pd.MultiIndex.from_arrays([specimen, experiment]))
    first = np.unique(test, return_index=True)[1]
    # Stable: points keep the frame's order inside a test, also where its rows are scattered.
    order = np.argsort(test, kind="stable")

    def of_tests(name: str, given: float | str | None) -> np.ndarray:
        if given is None:
            return np.full(first.size, np.nan)
        if isinstance(given, str):
            return _constant_within_tests(frame, name, _geometry_column(frame, name, given), test)
        if isinstance(given, bool | np.bool_) or not isinstance(given, Real):
            raise TypeError(
                f"{name} is {given!r}; expected a number, the name of a column, or None if unknown"
            )
        if np.isnan(given):
            raise ValueError(f"{name} is {given}; where it is not known, give None")
        return np.full(first.size, float(given))

    def millimetres(values: np.ndarray) -> np.ndarray:
        return to_internal(values, radius_unit, "length", keyword="radius_unit")

    values = {
        measured: millimetres(_numbers(frame, measured)[order]),
        "pressure": to_internal(_numbers(frame, "pressure")[order], pressure_unit, "pressure"),
        "inner_radius": millimetres(of_tests("inner_radius", inner_radius)),
        "outer_radius": millimetres(of_tests("outer_radius", outer_radius)),
        "axial_stretch": of_tests("axial_stretch", axial_stretch),
        "opening_angle": to_internal(of_tests("opening_angle", opening_angle), angle_unit, "angle"),
    }
    if "axial_force" in frame:
        force = _numbers(frame, "axial_force", may_be_missing=True)[order]
        values["axial_force"] = to_internal(force, force_unit, "force")
    if measured == "outer_diameter":
        values["radius"] = _internal_radius(values, test[order])
    coordinates = {
        "test": test[order],
        "row": _plain_array(frame.index[order].tolist()),
        "specimen": specimen[first],
        "experiment": experiment[first],
        "group": _constant_within_tests(frame, "group", group, test),
    }
    kinds = VARIABLES | {name: kind for name, kind in OPTIONAL.items() if name in values}
    data = xr.Dataset(_variables(kinds, values), _variables(COORDINATES, coordinates))
    check_inflation_data(data)
    return data


def select(
    data: xr.Dataset,
    specimen: Hashable | Iterable[Hashable] | None = None,
    experiment: Hashable | Iterable[Hashable] | None = None,
    group: Hashable | Iterable[Hashable] | None = None,
) -> xr.Dataset:
    """Keep the tests with the given labels.

    Parameters
    ----------
    data : xarray.Dataset
        Inflation data, see :func:`inflation_data`.
    specimen, experiment, group : label or list of labels, optional
        What to keep; a test must satisfy all that are given.

    Returns
    -------
    xarray.Dataset
        The tests that were asked for, in the order of `data`, with ``test`` counted anew.

    Raises
    ------
    ValueError
        If a label is unknown or no test is left; the message lists what exists.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.load_dataset("simulated_sheep_aorta")
    >>> ph.select(data, group="C2", experiment=[1, 2]).sizes["test"]
    4
    """
    check_inflation_data(data)
    keep = np.ones(data.sizes["test"], dtype=bool)
    given = {"specimen": specimen, "experiment": experiment, "group": group}
    asked = {name: _as_labels(wanted) for name, wanted in given.items() if wanted is not None}
    for name, wanted in asked.items():
        # Compared as text: a specimen named 7 in a spreadsheet is '7' here.
        present = [str(label) for label in data[name].values.tolist()]
        unknown = [label for label in wanted if str(label) not in present]
        if unknown:
            existing = dict.fromkeys(data[name].values.tolist())
            raise ValueError(f"no {name} {unknown[0]!r} in the data; there are {_listed(existing)}")
        keep &= np.isin(present, [str(label) for label in wanted])
    if not keep.any():
        criteria = ", ".join(f"{name}={wanted!r}" for name, wanted in asked.items())
        raise ValueError(f"no test with {criteria} in the data; there are {_inventory(data)}")

    return tests_at(data, np.flatnonzero(keep))


def tests_at(data: xr.Dataset, positions: Sequence[int] | np.ndarray) -> xr.Dataset:
    """Keep the tests at the given positions, which must rise, with ``test`` counted anew."""
    test = data["test"].values
    points = np.isin(test, positions)
    chosen = data.isel(obs=points, test=positions)
    renumbered = np.searchsorted(positions, test[points])
    return chosen.assign_coords(test=("obs", renumbered, data["test"].attrs))


def describe_test(data: xr.Dataset, i: int) -> str:
    """Name test `i` as messages do.

    Parameters
    ----------
    data : xarray.Dataset
        Inflation data, see :func:`inflation_data`.
    i : int
        Position along dimension ``test``.

    Returns
    -------
    str
        Specimen and experiment.

    Examples
    --------
    >>> from pymc_hyperelastic.data.inflation import describe_test
    >>> from pymc_hyperelastic.data.datasets import load_dataset
    >>> describe_test(load_dataset("simulated_sheep_aorta"), 5)
    "specimen 'S2', experiment 3"
    """
    specimen, experiment = (data[name].values.tolist()[i] for name in ("specimen", "experiment"))
    return f"specimen {specimen!r}, experiment {experiment!r}"


def points_of(data: xr.Dataset, i: int) -> slice:
    """Find the points of test `i`.

    Parameters
    ----------
    data : xarray.Dataset
        Inflation data, see :func:`inflation_data`.
    i : int
        Position along dimension ``test``, from 0.

    Returns
    -------
    slice
        The positions of its points along dimension ``obs``.

    Raises
    ------
    IndexError
        If there is no such test.

    Examples
    --------
    >>> from pymc_hyperelastic.data.inflation import points_of
    >>> from pymc_hyperelastic.data.datasets import load_dataset
    >>> points_of(load_dataset("simulated_sheep_aorta"), 2)
    slice(40, 60, None)
    """
    points = np.flatnonzero(data["test"].values == i)
    if not points.size:
        raise IndexError(f"no test {i} in the data, which have {data.sizes['test']} tests from 0")
    return slice(int(points[0]), int(points[-1]) + 1)


def measured_radius(data: xr.Dataset) -> xr.DataArray:
    """The radius that was measured, mm: the internal one, or half of the outer diameter.

    Examples
    --------
    >>> from pymc_hyperelastic.data.inflation import measured_radius
    >>> from pymc_hyperelastic.data.datasets import load_dataset
    >>> data = load_dataset("simulated_sheep_aorta")
    >>> measured_radius(data).equals(data["radius"])
    True
    """
    return data["outer_diameter"] / 2 if "outer_diameter" in data else data["radius"]


def check_inflation_data(data: xr.Dataset) -> None:
    """Raise unless `data` is a sound inflation Dataset, as :func:`inflation_data` builds it.

    Whoever makes or alters a Dataset by hand is told here what is wrong with it.

    Parameters
    ----------
    data : xarray.Dataset
        Inflation data. The coordinate ``row`` may be missing.

    Raises
    ------
    TypeError
        If `data` is not a Dataset.
    ValueError
        If a variable is missing, lies on another dimension, has another unit or is not numeric; if
        the points of a test do not stand together; if a value is not finite or impossible for a
        tube.

    Examples
    --------
    >>> from pymc_hyperelastic.data.inflation import check_inflation_data
    >>> from pymc_hyperelastic.data.datasets import load_dataset
    >>> check_inflation_data(load_dataset("simulated_sheep_aorta"))
    """
    if not isinstance(data, xr.Dataset):
        raise TypeError(
            f"inflation data are an xarray.Dataset, not {type(data).__name__}; "
            "make one from a table with inflation_data(frame, ...)"
        )
    for name, (dimension, unit, _) in {**VARIABLES, **OPTIONAL, **COORDINATES}.items():
        if name in ("row", *OPTIONAL) and name not in data.variables:
            continue
        if name not in data.variables:
            raise ValueError(f"the inflation data lack {name!r} (dimension {dimension!r})")
        if data[name].dims != (dimension,):
            raise ValueError(
                f"{name!r} has dimensions {data[name].dims}; expected ({dimension!r},)"
            )
        if data[name].attrs.get("units", unit) != unit:
            raise ValueError(
                f"{name!r} is in {data[name].attrs['units']!r}; expected {unit!r}: convert it"
            )
    _check_test_positions(data)
    present = [*VARIABLES, *(name for name in OPTIONAL if name in data)]
    values = {name: _finite(data, name, _may_be_missing(data, name)) for name in present}
    for name, (impossible, expected) in _RULES.items():
        if name not in values:
            continue
        bad = np.flatnonzero(impossible(values))
        if bad.size:
            raise ValueError(f"{_found(data, name, bad[0], values[name])}; {expected}")


# For each variable: where its values are impossible, and what to say then.
_RULES = {
    "radius": (lambda v: v["radius"] <= 0, "expected a positive radius: correct or drop the row"),
    "outer_diameter": (
        lambda v: v["outer_diameter"] <= 0,
        "expected a positive diameter: correct or drop the row",
    ),
    "inner_radius": (lambda v: v["inner_radius"] <= 0, "expected a positive radius"),
    "outer_radius": (
        lambda v: v["outer_radius"] <= v["inner_radius"],
        "expected more than inner_radius: were the two exchanged, or is one a diameter?",
    ),
    "axial_stretch": (
        lambda v: v["axial_stretch"] <= 0,
        "expected a positive ratio of lengths, 1 for an unstretched tube",
    ),
    "opening_angle": (
        lambda v: np.abs(v["opening_angle"]) >= 2 * pi,
        'expected an angle between -2 pi and 2 pi: for degrees, say angle_unit="deg"',
    ),
}


def _check_test_positions(data: xr.Dataset) -> None:
    if not data.sizes["obs"]:
        raise ValueError("the inflation data hold no points")
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
        place = int(back[0]) + 1
        raise ValueError(
            f"{_point(data, place)}: the points of a test must stand together, in the order of the "
            "tests: sort the data with data.isel(obs=data['test'].argsort(stable=True).values)"
        )


def _may_be_missing(data: xr.Dataset, name: str) -> bool | np.ndarray:
    """Where NaN means something: a geometry that is not known, a force that was not measured."""
    if name == "radius" and "outer_diameter" in data:
        unknown = np.any([data[geometry].isnull().values for geometry in GEOMETRY], axis=0)
        return unknown[data["test"].values]
    return name in (*GEOMETRY, "axial_force")


def _internal_radius(values: dict[str, np.ndarray], test: np.ndarray) -> np.ndarray:
    """From outer diameters; NaN where the geometry is not known or the wall does not fit in."""
    geometry = {name: values[name][test] for name in GEOMETRY}
    with np.errstate(invalid="ignore"):
        return internal_radius_from_outer_radius(values["outer_diameter"] / 2, **geometry)


def _finite(data: xr.Dataset, name: str, may_be_missing: bool | np.ndarray) -> np.ndarray:
    try:
        values = np.asarray(data[name].values, dtype=float)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name!r} must hold numbers, not {data[name].dtype}") from error
    bad = np.flatnonzero(np.isinf(values) | (np.isnan(values) & ~np.asarray(may_be_missing)))
    if bad.size:
        expected = "a finite number"
        if name == "radius" and "outer_diameter" in data:
            expected = "an outer diameter in which the wall has room"
        raise ValueError(f"{_found(data, name, bad[0], values)}; expected {expected}")
    return values


def _found(data: xr.Dataset, name: str, i: int, values: np.ndarray) -> str:
    dimension, unit, _ = (VARIABLES | OPTIONAL)[name]
    place = _point(data, i) if dimension == "obs" else describe_test(data, i)
    return f"{place}: {name} is {values[i]:.6g}{'' if unit == '1' else ' ' + unit}"


def _point(data: xr.Dataset, i: int) -> str:
    row = f"row {data['row'].values.tolist()[i]}" if "row" in data.coords else f"point {i}"
    return f"{describe_test(data, int(data['test'].values[i]))}, {row}"


def _inventory(data: xr.Dataset) -> str:
    experiments: dict[tuple, list[str]] = {}
    labels = (data[name].values.tolist() for name in ("group", "specimen", "experiment"))
    for group, specimen, experiment in zip(*labels, strict=True):
        experiments.setdefault((group, specimen), []).append(repr(experiment))
    return "; ".join(
        f"group {group!r}, specimen {specimen!r}, experiment {', '.join(names)}"
        for (group, specimen), names in experiments.items()
    )


def _variables(kinds: dict, values: dict[str, np.ndarray]) -> dict[str, tuple]:
    return {
        name: (dimension, values[name], {"units": unit, "long_name": long_name})
        for name, (dimension, unit, long_name) in kinds.items()
    }


def _check_frame(frame: pd.DataFrame, measured: str) -> None:
    if not isinstance(frame, pd.DataFrame):
        raise TypeError(
            f"expected a pandas DataFrame, not {type(frame).__name__}; "
            "read a file with pandas.read_csv first"
        )
    for name in ("specimen", "experiment", measured, "pressure"):
        if name not in frame:
            raise ValueError(
                f"the frame has no column {name!r}; it has {_listed(frame.columns)}: "
                "rename the one that holds it"
            )
    twice = frame.columns[frame.columns.duplicated()]
    if twice.size:
        raise ValueError(f"the frame has more than one column {twice[0]!r}; drop or rename one")
    if frame.empty:
        raise ValueError("the frame has no rows; expected one row a measured point")


def _labels(frame: pd.DataFrame, column: str) -> np.ndarray:
    labels = frame[column].tolist()
    for i, label in enumerate(labels):
        if pd.isna(label) or not str(label).strip():
            raise ValueError(f"row {frame.index[i]}: {column} is missing; give every row a label")
    # A spreadsheet with gaps elsewhere yields 1.0 for experiment 1.
    labels = [int(x) if isinstance(x, float) and x.is_integer() else x for x in labels]
    return _plain_array(labels) if column == "experiment" else np.array([str(x) for x in labels])


def _numbers(frame: pd.DataFrame, column: str, *, may_be_missing: bool = False) -> np.ndarray:
    """Read a column as finite floats; numbers that came as text are fine."""
    numbers = np.full(len(frame), np.nan)
    for i, value in enumerate(frame[column].tolist()):
        if pd.isna(value):
            if may_be_missing:
                continue
            raise ValueError(
                f"{_row(frame, i)}: {column} is missing (nan); fill it or drop the row"
            )
        try:
            if isinstance(value, bool):
                raise TypeError("bool is a number to Python")
            numbers[i] = float(value)
        except (TypeError, ValueError):
            raise ValueError(
                f"{_row(frame, i)}: {column} is {value!r}, not a number; correct it "
                "(decimal points, no units)"
            ) from None
        if not np.isfinite(numbers[i]):
            raise ValueError(f"{_row(frame, i)}: {column} is {value}; expected a finite number")
    return numbers


def _geometry_column(frame: pd.DataFrame, name: str, column: str) -> np.ndarray:
    if column not in frame:
        raise ValueError(
            f"{name}={column!r}: the frame has no such column; it has {_listed(frame.columns)}. "
            f"Give {name} as a number or as the name of a column"
        )
    return _numbers(frame, column)


def _constant_within_tests(
    frame: pd.DataFrame, name: str, values: np.ndarray, test: np.ndarray
) -> np.ndarray:
    """One value a test, or an error at the first row that differs from its test's first."""
    of_test = values[np.unique(test, return_index=True)[1]]
    expected = of_test[test]
    varying = np.flatnonzero(values != expected)
    if varying.size:
        i = varying[0]
        raise ValueError(
            f"{_row(frame, i)}: {name} is {values[i].item()!r}, but {expected[i].item()!r} in the "
            "first row of this experiment; it must not change within one: correct it, or give "
            "the rows another experiment label"
        )
    return of_test


def _row(frame: pd.DataFrame, i: int) -> str:
    specimen, experiment = (_labels(frame.iloc[[i]], name) for name in ("specimen", "experiment"))
    return (
        f"specimen {specimen[0].item()!r}, experiment {experiment[0].item()!r}, "
        f"row {frame.index[i]}"
    )


def _plain_array(labels: list[Any]) -> np.ndarray:
    """Integers if all are, else text: what a file can hold."""
    if all(isinstance(x, int | np.integer) and not isinstance(x, bool) for x in labels):
        return np.array(labels, dtype=np.int64)
    return np.array([str(x) for x in labels])


def _as_labels(wanted: Hashable | Iterable[Hashable]) -> list[Hashable]:
    if isinstance(wanted, Iterable) and not isinstance(wanted, str):
        return [x.item() if isinstance(x, np.generic) else x for x in wanted]
    return [wanted.item() if isinstance(wanted, np.generic) else wanted]


def _listed(labels: Iterable[Hashable]) -> str:
    return ", ".join(repr(label) for label in labels)
