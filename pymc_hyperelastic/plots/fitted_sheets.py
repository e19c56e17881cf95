"""Curves of fitted sheets, test by test, and the measured stresses beside them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from pymc_hyperelastic.data.select import tests_at
from pymc_hyperelastic.models.likelihoods.errors import Errors
from pymc_hyperelastic.plots.curves import CURVE_POINTS, Array, band_rows
from pymc_hyperelastic.plots.fitted_curves import FittedCurve, Specimen
from pymc_hyperelastic.plots.residuals import errors_of, slope_of
from pymc_hyperelastic.plots.stretches import names_of_tests, sheet_curves, shown_axis
from pymc_hyperelastic.predictions.sheets import SheetDraws, sheet_draws_of


def tests_apart(specimens: list[Specimen]) -> list[Specimen]:
    """Return each test of sheets as a specimen of its own, named as its test, for its panel."""
    several = len({one.name for one in specimens}) > 1
    apart = []
    for one in specimens:
        for test, name in enumerate(names_of_tests(one.tests)):
            named = f"{one.name}, {name}" if several else name
            apart.append(one._replace(name=named, tests=tests_at(one.tests, [test])))
    return apart


def stress_curves_of(
    specimen: Specimen, energy: Any, ci_prob: float, residuals: bool
) -> Iterator[tuple[str, FittedCurve]]:
    """Yield the axis and the curve of each measured stress of a sheet with one test."""
    tests = specimen.tests
    draws = sheet_draws_of(specimen.tree, specimen.member, energy)
    measured = {axis: tests[f"stretch_{axis}"].values.astype(float) for axis in "xy"}
    path = _along(measured)
    is_nominal = tests["stress_measure"].values[0] == "nominal"
    band = draws.measured(path, np.full(path["x"].size, is_nominal))
    beyond = draws.extrapolated(path)
    errors = errors_of(specimen.tree, draws)
    for of in sheet_curves(tests):
        over = path[shown_axis(measured, of.axis)]
        rows = band_rows(over, band[of.axis], ci_prob, 0.0 if beyond is None else beyond.points)
        standardised = None
        if residuals and errors is not None and errors.stress_sd is not None:
            standardised = _residuals(of.axis, of.stress, measured, is_nominal, draws, errors)
        points = np.array([of.stretch, of.stress])
        yield of.axis, FittedCurve(0, rows, points, standardised, False)


def _along(measured: Mapping[str, Array]) -> dict[str, Array]:
    """Return stretches on straight lines between the measured points, on logarithmic axes."""
    logs = {axis: np.log(values) for axis, values in measured.items()}
    steps = [np.abs(np.diff(log)) for log in logs.values()]
    free = {axis: bool(np.isnan(log).all()) for axis, log in logs.items()}
    partly = any(np.isnan(log).any() and not free[axis] for axis, log in logs.items())
    passed = np.append(0.0, np.cumsum(np.nan_to_num(steps).sum(axis=0)))
    if partly or not passed[-1]:
        return dict(measured)
    grid = np.linspace(0.0, passed[-1], CURVE_POINTS)
    return {
        axis: np.full(CURVE_POINTS, np.nan) if free[axis] else np.exp(np.interp(grid, passed, log))
        for axis, log in logs.items()
    }


def _residuals(
    axis: str,
    stress: Array,
    stretches: Mapping[str, Array],
    is_nominal: bool,
    draws: SheetDraws,
    errors: Errors,
) -> Array:
    """Return the posterior median of the standardised residual of each point, (point)."""
    nominal = np.full(stress.size, is_nominal)

    def curve(stretches: Mapping[str, Array]) -> Array:
        return draws.measured(stretches, nominal)[axis]

    variance = np.square(errors.stress_sd)
    if errors.stretch_sd is not None:
        for by, given in stretches.items():
            if np.isnan(given).all():
                continue

            def along(shifted: Array, by: str = by) -> Array:
                return curve({**stretches, by: shifted})

            slope = slope_of(along, given)
            variance = variance + np.square(errors.stretch_sd * np.nan_to_num(slope))
    return np.median((stress - curve(stretches)) / np.sqrt(variance), axis=(0, 1))
