"""Tests of sheets in figures: their names, and the stretch over which each stress is shown."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.inflation import points_of
from pymc_hyperelastic.data.variables import OPTIONAL_LABELS
from pymc_hyperelastic.plots.curves import Array

#: Dimension of the labels "x" and "y" of curves.
AXIS = "axis"
# A quantity is held in a test if it varies less than this part of its size, or a stretch less than
# this part of the other one. Machines control it to a few percent.
HELD = 0.1


class SheetCurve(NamedTuple):
    """A measured stress of a test."""

    test: int
    axis: str
    """Along which the stress is: ``"x"`` or ``"y"``."""
    stretch: Array
    stress: Array
    """NaN where it was not measured."""


def sheet_curves(data: xr.Dataset) -> Iterator[SheetCurve]:
    """Yield the measured stresses of all tests of sheets, test by test."""
    for test in range(data.sizes["test"]):
        points = points_of(data, test)
        for axis in "xy":
            stress = data[f"stress_{axis}"].values[points].astype(float)
            if np.isfinite(stress).any():
                stretches = {a: data[f"stretch_{a}"].values[points].astype(float) for a in "xy"}
                over = stretches[shown_axis(stretches, axis)]
                yield SheetCurve(test, axis, over, stress)


def shown_axis(stretches: dict[str, Array], axis: str) -> str:
    """Return the axis of the stretch over which a stress is shown.

    It is the axis of the stress, unless the sheet is held along it, as in pure shear.
    """
    other = "y" if axis == "x" else "x"
    spans = {}
    for name in (axis, other):
        known = np.log(stretches[name][np.isfinite(stretches[name])])
        spans[name] = np.ptp(known) if known.size else 0.0
    return axis if spans[axis] >= HELD * spans[other] else other


def names_of_tests(data: xr.Dataset) -> list[str]:
    """Return short names of tests, which leave out labels that all tests share."""
    columns = ["specimen", "experiment", *(n for n in OPTIONAL_LABELS if n in data.coords)]
    labels = {name: data[name].values.astype(str).tolist() for name in columns}
    several = [n for n in columns if n == "experiment" or len({*labels[n]}) > 1]
    rows = zip(*(labels[name] for name in several), strict=True)
    return [", ".join(filter(None, row)) for row in rows]


def stress_label(data: Iterable[xr.Dataset]) -> str:
    """Return the name of the stresses of sheets: a key of the labels of axes."""
    measures = {str(name) for tests in data for name in tests["stress_measure"].values.tolist()}
    return "stress_of_sheets" if len(measures) > 1 else f"{measures.pop()}_stress"
