"""Posterior curves of fitted classes over the radius or the axial stretch, and the data beside."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.inflation import (
    at_points,
    check_inflation_data,
    evenly_along,
    extension_tests,
    held_stretches,
    points_of,
)
from pymc_hyperelastic.evidence.results import thinned_draws
from pymc_hyperelastic.mechanics.reference_tube import Tube
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.models.settings import inflation_data_of
from pymc_hyperelastic.plots.curves import BAND, POINTS, Array, Curve, band_rows, gathered
from pymc_hyperelastic.plots.style import MARKERS, per_kilopascal
from pymc_hyperelastic.predictions.draws import Draws, draws_of
from pymc_hyperelastic.predictions.measured import typical_tests
from pymc_hyperelastic.predictions.members import tests_of
from pymc_hyperelastic.rounding import DIGITS

_RADII = 80  # points of a curve over radii
# Points of a curve over axial stretches: at each one Newton's method finds the radius.
_STRETCHES = 24
_DRAWS = 1000  # draws of a band: more change no line visibly
# Part of the largest pressure by which a pressure that is held during an extension test varies.
_HELD = 0.5


class Drawn(NamedTuple):
    """The quantities of a figure, in the units that are drawn."""

    over_radius: Callable[[Draws, Array], xr.Dataset]
    """From draws and radii, curves with the coordinate "extrapolated"."""
    over_stretch: Callable[[Draws, Array], dict[str, Array]]
    """From draws and their radii along an extension test, curves."""
    measured: Callable[[xr.Dataset], dict[str, Array]]
    """From tests, coordinates (axis, point) of the same quantities; NaN if not measured."""


class Fits(NamedTuple):
    """Fitted classes, their data, and the curves and points that are drawn of them."""

    classes: dict[str, xr.DataTree]
    data: dict[str, xr.Dataset]
    by: str | None
    """The dimension of curves that have colours of their own: specimens or axial stretches."""
    curves: xr.Dataset
    points: xr.Dataset
    ci_prob: float


def fits_of(
    classes: dict[str, xr.DataTree],
    data: dict[str, xr.Dataset],
    ci_prob: float,
    material: Mapping[str, Any],
    drawn: Drawn,
    pressure_unit: str,
) -> Fits:
    """Compute curves of each class over its data: for each tube, and for each extension test."""
    by, labels, order = _labels(data, pressure_unit)
    curves, points = [], []
    for name, tree in classes.items():
        thinned, tests = thinned_draws(tree, _DRAWS), data[name]
        of_test = [(name, label) if by else (name,) for label in labels[name]]
        inferred: dict[str, float] = {}
        for curves_of in (_over_radii, _over_stretches):
            for test, inferred, rows in curves_of(thinned, tests, ci_prob, material, drawn):
                curves += [Curve(quantity, of_test[test], row) for quantity, row in rows.items()]
        typical = typical_tests(tests, inferred)
        place = typical["test"].values
        for quantity, rows_of_points in drawn.measured(typical).items():
            there = np.isfinite(rows_of_points).all(axis=0)
            for label in dict.fromkeys(of_test):
                own = there & np.array([one == label for one in of_test])[place]
                if own.any():
                    points.append(Curve(quantity, label, rows_of_points[:, own]))
    coords = {"class_label": list(classes)} | ({by: order} if by else {})
    curves.sort(key=lambda curve: is_over_stretch(curve.variable))
    gathered_points = gathered(points, coords, POINTS)
    return Fits(classes, data, by, gathered(curves, coords, BAND), gathered_points, ci_prob)


def data_beside(
    classes: Mapping[str, xr.DataTree], data: Any, specimen: str | None
) -> dict[str, xr.Dataset]:
    """Inflation data to be shown with each class: given ones, or those it was fitted to."""
    several = isinstance(data, Mapping) and not isinstance(data, xr.Dataset)
    shown = {}
    for name, tree in classes.items():
        if several and name not in data:
            raise ValueError(f"data has nothing for class {name!r}; it has {list(data)}")
        own = data[name] if several else data
        if own is None:
            if "inner_radius" not in tree.children.get("constant_data", {}):
                raise ValueError(f"{name!r} holds no inflation data: give them as data=...")
            own = inflation_data_of(tree)
            own = own if specimen is None else tests_of(own, specimen)
        check_inflation_data(own)
        shown[name] = own
    return shown


def is_over_stretch(quantity: str) -> bool:
    """Return True for quantities that are drawn over the axial stretch, not the radius."""
    return quantity.startswith("extension_")


def coordinates(data: xr.Dataset, **values: Array) -> dict[str, Array]:
    """Coordinates (axis, point) of quantities; NaN at points of tests of the other kind."""
    radius, stretch = data["radius"].values, at_points(data, "axial_stretch")
    extended = extension_tests(data)[data["test"].values]
    x = {False: np.where(extended, np.nan, radius), True: np.where(extended, stretch, np.nan)}
    return {name: np.array([x[is_over_stretch(name)], y]) for name, y in values.items()}


def stretch_labels(
    data: Iterable[xr.Dataset], pressure_unit: str
) -> tuple[list[list[str]], list[str]]:
    """Axial stretches of the tests of some data as figures name them, and all of them in order.

    The label of an extension test names its pressure; these labels are the last.
    """
    labels: list[list[str]] = []
    order: dict[str, tuple[float, float]] = {}
    for dataset in data:
        labels.append([])
        pressures = per_kilopascal(pressure_unit) * dataset["pressure"].values
        extended = extension_tests(dataset)
        for test, stretch in enumerate(held_stretches(dataset).tolist()):
            own, label = pressures[points_of(dataset, test)], "unknown"
            if extended[test]:
                held = np.ptp(own) <= _HELD * np.abs(own).max()
                levels = [own.mean()] if held else [own.min(), own.max()]
                at = " to ".join(f"{level:.3g}" for level in levels)
                label = f"varied at {at} {pressure_unit}"
            elif np.isfinite(stretch):
                label = f"{stretch:.4g}"
            order[label] = (stretch if np.isfinite(stretch) else np.inf, float(own.mean()))
            labels[-1].append(label)
    return labels, sorted(order, key=lambda label: order[label])


def _labels(
    shown: Mapping[str, xr.Dataset], pressure_unit: str
) -> tuple[str | None, dict[str, list[str]], list[str]]:
    """Dimension by which curves have colours, the label of each test, and all labels in order.

    Colours differ by axial stretch, by specimen if their tubes differ, or by class alone (None).
    """
    stretches, order = stretch_labels(shown.values(), pressure_unit)
    if 1 < len(order) <= len(MARKERS):
        return "axial_stretch", dict(zip(shown, stretches, strict=True)), order
    owners = {name: _owners(data) for name, data in shown.items()}
    by = "specimen" if any(len(set(of_class)) > 1 for of_class in owners.values()) else None
    return by, owners, list(dict.fromkeys(label for each in owners.values() for label in each))


def _owners(data: xr.Dataset) -> list[str]:
    """The specimens that have the tube of each test."""
    specimen, tube = data["specimen"].values, tubes_of(data)
    owners = [dict.fromkeys(specimen[tube == own].tolist()) for own in tube.tolist()]
    return [
        str(next(iter(names))) + (f" and {len(names) - 1} more" if len(names) > 1 else "")
        for names in owners
    ]


def tubes_of(data: xr.Dataset) -> NDArray[np.intp]:
    """The number of the tube of each test; tubes that differ by rounding errors are the same."""
    tubes = {name: data[name].values for name in GEOMETRY if name != "axial_stretch"}
    table = pd.DataFrame(tubes | {"axial_stretch": held_stretches(data)}).round(DIGITS)
    return table.groupby(list(GEOMETRY), dropna=False).ngroup().to_numpy()


def _known_tube(data: xr.Dataset, test: int) -> dict[str, Any]:
    """Known geometry of a test, without its axial stretch."""
    values = {n: float(data[n].values[test]) for n in GEOMETRY if n != "axial_stretch"}
    return {name: value for name, value in values.items() if np.isfinite(value)}


_CurvesOfTest = Iterator[tuple[int, dict[str, float], dict[str, Array]]]


def _over_radii(
    tree: xr.DataTree, data: xr.Dataset, ci_prob: float, material: Mapping[str, Any], drawn: Drawn
) -> _CurvesOfTest:
    """The first inflation test on each tube, medians of inferred geometry, and its curves."""
    held, tubes, stretches = ~extension_tests(data), tubes_of(data), held_stretches(data)
    for tube in np.unique(tubes[held]).tolist():
        tests = np.flatnonzero(held & (tubes == tube))
        known = _known_tube(data, int(tests[0]))
        if np.isfinite(stretch := stretches[tests[0]]):
            known["axial_stretch"] = float(stretch)
        draws = draws_of(tree, Tube(**known), **material)
        typical = typical_tests(data, draws.inferred)
        radius = typical["radius"].values[np.isin(typical["test"].values, tests)]
        grid = np.linspace(radius.min(), radius.max(), _RADII)
        curves = drawn.over_radius(draws, grid)
        beyond = curves.coords.get("extrapolated", xr.zeros_like(curves["radius"])).values
        rows = {
            str(name): band_rows(grid, curve.values, ci_prob, beyond)
            for name, curve in curves.data_vars.items()
        }
        yield int(tests[0]), draws.inferred, rows


def _over_stretches(
    tree: xr.DataTree, data: xr.Dataset, ci_prob: float, material: Mapping[str, Any], drawn: Drawn
) -> _CurvesOfTest:
    """Each extension test, medians of inferred geometry, and its curves.

    The radius of a draw is that at the pressure which was measured there, or between the points.
    """
    for test in np.flatnonzero(extension_tests(data)).tolist():
        points = points_of(data, test)
        measured = at_points(data, "axial_stretch")[points], data["pressure"].values[points]
        stretch, pressure = (evenly_along(measured[0], each, _STRETCHES) for each in measured)
        known = _known_tube(data, test) | {"axial_stretch": stretch}
        draws = draws_of(tree, Tube(**known), **material)
        radius = draws.radius_at(pressure)
        beyond = draws.extrapolated_pressures(pressure, radius, "kPa")
        extrapolated = 0.0 if beyond is None else beyond.points
        rows = {
            name: band_rows(stretch, curve, ci_prob, extrapolated)
            for name, curve in drawn.over_stretch(draws, radius).items()
        }
        yield test, draws.inferred, rows
