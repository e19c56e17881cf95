"""Inflation data from a table of measured points."""

from numbers import Real
from typing import Any, Literal, get_args

import numpy as np
import pandas as pd
import xarray as xr

from pymc_hyperelastic.data.inflation import (
    COORDINATES,
    OPTIONAL,
    VARIABLES,
    check_inflation_data,
    listed,
)
from pymc_hyperelastic.data.units import to_internal
from pymc_hyperelastic.mechanics.tube import GEOMETRY, internal_radius_from_outer_radius

Measured = Literal["radius", "outer_diameter"]


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
        geometry = {name: values[name][test[order]] for name in GEOMETRY}
        outer = values["outer_diameter"] / 2
        # NaN where the geometry is not known or the wall does not fit in.
        with np.errstate(invalid="ignore"):
            values["radius"] = internal_radius_from_outer_radius(outer, **geometry)
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
                f"the frame has no column {name!r}; it has {listed(frame.columns)}: "
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
            f"{name}={column!r}: the frame has no such column; it has {listed(frame.columns)}. "
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
