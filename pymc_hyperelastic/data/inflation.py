"""Inflation data: measured curves as one labelled, checked :class:`xarray.Dataset`.

Dimension ``obs`` holds the measured points, dimension ``test`` the experiments. The coordinate
``test`` on ``obs`` says to which experiment a point belongs. Pressures are in kPa, lengths in mm,
angles in rad.

In an *inflation test* the axial stretch is held; in an *extension test* it varies from point to
point, mostly while the pressure is held. Where there are extension tests ``axial_stretch`` lies on
``obs``, for all tests; who needs it, or another measure of the tube, asks :func:`at_points`.
"""

from collections.abc import Hashable, Iterable
from functools import partial
from math import pi

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.messages import shown

# Labels that a message names.
_MOST_LISTED = 30
# Relative: a stretch that varies by less was held, and is rounded.
_ROUNDING = 1e-9

# What the Dataset holds: name, (dimension, unit, name for people). The axial stretch lies on "obs"
# where there are extension tests.
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
# All measures that may state a tube, and the unit of each; they may have errors.
MEASURES = {
    "inner_radius": "mm",
    "outer_radius": "mm",
    "thickness": "mm",
    "wall_area": "mm2",
    "axial_stretch": "1",
    "opening_angle": "rad",
}
OPTIONAL |= {
    f"{name}_sd": ("test", unit, f"standard deviation of the {name.replace('_', ' ')}")
    for name, unit in MEASURES.items()
}
COORDINATES = {
    "test": ("obs", "1", "inflation experiment that the point belongs to"),
    "row": ("obs", "1", "row of the point in its table"),
    "specimen": ("test", "1", "specimen"),
    "experiment": ("test", "1", "experiment on the specimen"),
    "group": ("test", "1", "group"),
}
# Where an experiment holds more than one curve.
OPTIONAL_COORDINATES = {
    "cycle": ("test", "1", "cycle of the experiment"),
    "phase": ("test", "1", "phase of the cycle"),
}


def describe_test(data: xr.Dataset, i: int) -> str:
    """Specimen and experiment of the test at position `i`, as messages name it.

    Examples
    --------
    >>> from pymc_hyperelastic.data.datasets import load_dataset
    >>> describe_test(load_dataset("simulated_sheep_aorta"), 5)
    "specimen 'S2', experiment 3"
    """
    names = [n for n in ("specimen", "experiment", "cycle", "phase") if n in data.coords]
    return ", ".join(f"{name} {data[name].values[[i]].tolist()[0]!r}" for name in names)


def points_of(data: xr.Dataset, i: int) -> slice:
    """Positions along dimension ``obs`` of the points of test `i`, counted from 0.

    Examples
    --------
    >>> from pymc_hyperelastic.data.datasets import load_dataset
    >>> points_of(load_dataset("simulated_sheep_aorta"), 2)
    slice(40, 60, None)
    """
    points = np.flatnonzero(data["test"].values == i)
    if not points.size:
        raise IndexError(f"no test {i} in the data, which have {data.sizes['test']} tests from 0")
    return slice(int(points[0]), int(points[-1]) + 1)


def at_points(data: xr.Dataset, name: str) -> NDArray[np.float64]:
    """A measure of the tube at every point, whether it lies on ``test`` or varies within a test.

    Examples
    --------
    >>> from pymc_hyperelastic.data.datasets import load_dataset
    >>> at_points(load_dataset("simulated_sheep_aorta"), "axial_stretch").shape
    (300,)
    """
    return _at_points(data, data[name]).astype(float)


def _at_points(data: xr.Dataset, variable: xr.DataArray) -> NDArray:
    return variable.values if variable.dims == ("obs",) else variable.values[data["test"].values]


def evenly_along(
    x: NDArray[np.float64], values: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """Values at `count` places that are spread evenly between the ends of `x`.

    Between points, which may stand in any order, values are linear.

    Examples
    --------
    >>> evenly_along(np.array([1.4, 1.0, 1.1]), np.array([8.0, 2.0, 4.0]), 3).round(6)
    array([2.      , 5.333333, 8.      ])
    """
    order = np.argsort(x, kind="stable")
    return np.interp(np.linspace(x.min(), x.max(), count), x[order], values[order])


def varies(stretch: NDArray[np.float64], test: NDArray[np.integer]) -> NDArray[np.bool_]:
    """In which tests, numbered from 0, an axial stretch given by points is not one number.

    Examples
    --------
    >>> varies(np.array([1.5, 1.5 + 1e-15, 1.2, 1.3]), np.array([0, 0, 1, 1]))
    array([False,  True])
    """
    low, high = np.full((2, int(test.max()) + 1), [[np.inf], [-np.inf]])
    with np.errstate(invalid="ignore"):  # NaN, where it is not known, is one number
        np.minimum.at(low, test, stretch)
        np.maximum.at(high, test, stretch)
    return high - low > _ROUNDING * np.abs(high)


def extension_tests(data: xr.Dataset) -> NDArray[np.bool_]:
    """Which tests are extension tests: those whose axial stretch varies by more than rounding.

    Examples
    --------
    >>> from pymc_hyperelastic.data.datasets import load_dataset
    >>> extension_tests(load_dataset("simulated_sheep_aorta")).any()
    np.False_
    """
    if data["axial_stretch"].dims != ("obs",):
        return np.zeros(data.sizes["test"], bool)
    return varies(at_points(data, "axial_stretch"), data["test"].values)


def held_stretches(data: xr.Dataset) -> NDArray[np.float64]:
    """Axial stretch of each test, by test; NaN of an extension test.

    Examples
    --------
    >>> from pymc_hyperelastic.data.datasets import load_dataset
    >>> set(held_stretches(load_dataset("simulated_sheep_aorta")).tolist())
    {1.0}
    """
    first = [points_of(data, test).start for test in range(data.sizes["test"])]
    return np.where(extension_tests(data), np.nan, at_points(data, "axial_stretch")[first])


def measured_radius(data: xr.Dataset) -> xr.DataArray:
    """The radius that was measured, mm: the internal one, or half of the outer diameter.

    Examples
    --------
    >>> from pymc_hyperelastic.data.datasets import load_dataset
    >>> data = load_dataset("simulated_sheep_aorta")
    >>> measured_radius(data).equals(data["radius"])
    True
    """
    return data["outer_diameter"] / 2 if "outer_diameter" in data else data["radius"]


def check_inflation_data(data: xr.Dataset) -> None:
    """Raise unless `data` is a sound inflation Dataset, as :func:`inflation_data` builds it.

    Whoever makes or alters a Dataset by hand is told here what is wrong with it: a variable that is
    missing, lies on another dimension, has another unit or is not numeric; points of a test that do
    not stand together; a value that is not finite or impossible for a tube. The coordinates
    ``row``, ``cycle`` and ``phase`` may be missing.

    Examples
    --------
    >>> from pymc_hyperelastic.data.datasets import load_dataset
    >>> check_inflation_data(load_dataset("simulated_sheep_aorta"))
    """
    if not isinstance(data, xr.Dataset):
        raise TypeError(
            f"inflation data are an xarray.Dataset, not {type(data).__name__}; "
            "make one from a table with inflation_data(frame, ...)"
        )
    known = VARIABLES | OPTIONAL | COORDINATES | OPTIONAL_COORDINATES
    for name, (dimension, unit, _) in known.items():
        if name in ("row", *OPTIONAL_COORDINATES, *OPTIONAL) and name not in data.variables:
            continue
        if name not in data.variables:
            raise ValueError(f"the inflation data lack {name!r} (dimension {dimension!r})")
        allowed = [(dimension,), ("obs",)] if name == "axial_stretch" else [(dimension,)]
        if data[name].dims not in allowed:
            expected = " or ".join(map(str, allowed))
            raise ValueError(f"{name!r} has dimensions {data[name].dims}; expected {expected}")
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


def _negative(name: str, values: dict[str, np.ndarray]) -> np.ndarray:
    return values[name] < 0


_RULES |= {
    f"{name}_sd": (partial(_negative, f"{name}_sd"), "expected a standard deviation, not below 0")
    for name in MEASURES
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
        unknown = [_at_points(data, data[geometry].isnull()) for geometry in GEOMETRY]
        return np.any(unknown, axis=0)
    if data[name].dims == ("obs",):  # a stretch that varies was measured
        return name == "axial_force"
    return name in GEOMETRY


def _finite(data: xr.Dataset, name: str, may_be_missing: bool | np.ndarray) -> np.ndarray:
    found = data[name].values
    try:
        # Text that looks like numbers is none, and a date is none.
        if found.dtype.kind not in "biufO" or (
            found.dtype.kind == "O" and any(isinstance(x, str) for x in found.flat)
        ):
            raise TypeError
        values = np.asarray(found, dtype=float)
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
    _, unit, _ = (VARIABLES | OPTIONAL)[name]
    place = _point(data, i) if data[name].dims == ("obs",) else describe_test(data, i)
    return f"{place}: {name} is {values[i]:.6g}{'' if unit == '1' else ' ' + unit}"


def _point(data: xr.Dataset, i: int) -> str:
    row = f"row {data['row'].values.tolist()[i]}" if "row" in data.coords else f"point {i}"
    return f"{describe_test(data, int(data['test'].values[i]))}, {row}"


def listed(labels: Iterable[Hashable]) -> str:
    """Labels as messages name them, the first of many.

    Examples
    --------
    >>> listed(["a", "b"]), listed(range(100))[-20:]
    ("'a', 'b'", '28, 29 and 70 others')
    """
    labels = list(labels)
    others = len(labels) - _MOST_LISTED
    told = ", ".join(map(shown, labels[:_MOST_LISTED]))
    return f"{told} and {others} others" if others > 0 else told
