r"""The density of measured stresses of sheets, for a Potential and for observed variables.

Errors of the stresses are independent. An error of the stretches, with standard deviation ``s_λ``,
shifts both stresses of a point along the curves, so that their errors have to first order the
covariance

.. math:: s^2 I + s_λ^2 J J^T, \qquad J = \frac{∂(σ_x, σ_y)}{∂(λ_x, λ_y)} .

The density of the stress along y is that given the stress along x of the same point.
"""

from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.tensor.variable import TensorVariable as Tensor

from pymc_hyperelastic.models.forward import OVERFLOW, SymbolicSheets
from pymc_hyperelastic.models.likelihoods.errors import Errors
from pymc_hyperelastic.models.likelihoods.signals import (
    LARGEST,
    as_double,
    measured,
    normal_log_density,
)
from pymc_hyperelastic.quantities import STRESSES


class Stresses(NamedTuple):
    """Expected stresses of all points, and the standard deviations of their errors."""

    x: Tensor
    x_sd: Tensor
    y: Tensor
    y_sd: Tensor
    """Given the error of the stress along x at the same point."""
    by_x: Tensor | None = None
    """Expected error along y for each kPa of error along x."""

    def y_given(self, measured_x: Any, inputs: Mapping[str, Any]) -> Tensor:
        """Return the expected stresses along y, given the measured stresses along x."""
        if self.by_x is None:
            return self.y
        # Points without a stress along x take the last error, 0.
        errors = pt.concatenate([measured_x - self.x[inputs["x_rows"]], 0.0 * self.x[:1]])
        return self.y + self.by_x * errors[inputs["x_place"]]


def log_likelihood_of_stresses(sheets: SymbolicSheets, errors: Errors) -> Tensor:
    """Return the log likelihood of the stresses; minus infinity if a sheet is impossible."""
    square = sheets.sum_of_squares() if errors.stretch_sd is None else None
    if square is not None:
        return _from_sum_of_squares(sheets, errors, square)
    curves = sheets.curves()
    possible = _possible(curves)
    safe = {name: pt.where(possible, curve, 0.0) for name, curve in curves.items()}
    expected, inputs = stresses_of(sheets, safe, errors), _inputs(sheets)
    x, y = (measured(sheets.forward, name) for name in STRESSES)
    of_x, of_y = inputs["x_rows"], inputs["y_rows"]
    error_x, error_y = x - expected.x[of_x], y - expected.y_given(x, inputs)[of_y]
    terms = [
        pt.sum(normal_log_density(pt.square(error_x), pt.square(expected.x_sd[of_x]))),
        pt.sum(normal_log_density(pt.square(error_y), pt.square(expected.y_sd[of_y]))),
    ]
    return pt.where(possible, sum(terms), -np.inf)


def _from_sum_of_squares(sheets: SymbolicSheets, errors: Errors, square: Tensor) -> Tensor:
    """Return the log likelihood of stresses whose errors have one standard deviation."""
    inputs, variance = _inputs(sheets), pt.square(as_double(errors.stress_sd))
    count, possible = inputs["x_rows"].shape[0] + inputs["y_rows"].shape[0], square < OVERFLOW
    # Else the gradient by the standard deviation would be 0 * inf.
    known = pt.where(possible, square, 0.0)
    return pt.where(possible, normal_log_density(known, variance, count), -np.inf)


def register_stresses(
    sheets: SymbolicSheets, curves: Mapping[str, Tensor], errors: Errors, dims: str | None = "obs"
) -> None:
    """Add the measured stresses as observed variables; with `dims`, only where there are some.

    If a sheet is impossible, means are infinite and the log-likelihood is ``−inf``.
    """
    forward, model = sheets.forward, pm.modelcontext(None)
    observed, dims_of = {}, {}
    for name, rows in zip(STRESSES, _rows(forward.data).values(), strict=False):
        if dims and not rows.size:
            continue
        if dims:
            dims_of[name] = model.name_for(f"{name}_obs")
            model.add_coord(dims_of[name], np.asarray(model.coords[dims])[rows])
        as_data = partial(_as_data, dims=dims_of.get(name))
        observed[name] = measured(forward, name, as_data)
    possible, expected = _possible(curves), stresses_of(sheets, curves, errors)
    inputs, measured_x = _inputs(sheets), pt.zeros(0)
    for name, values in observed.items():
        rows, mean, sd = inputs["x_rows"], expected.x, expected.x_sd
        if name == "stress_y":
            # Predictions of stresses along y are given the drawn ones along x.
            mean, sd = expected.y_given(measured_x, inputs), expected.y_sd
            rows = inputs["y_rows"]
        mean = pt.where(possible, mean[rows], np.inf)
        of_axis = {"observed": values, "dims": dims_of.get(name)}
        measured_x = pm.Normal(f"measured_{name}", mean, sd[rows], **of_axis)


def stresses_of(sheets: SymbolicSheets, curves: Mapping[str, Tensor], errors: Errors) -> Stresses:
    """Return the expected stresses for the curves of sheets."""
    x, y = (curves[name] for name in STRESSES)
    variance = pt.square(as_double(errors.stress_sd))
    variance_x, variance_y = variance + pt.zeros_like(x), variance + pt.zeros_like(y)
    if errors.stretch_sd is None:
        return Stresses(x, pt.sqrt(variance_x), y, pt.sqrt(variance_y))
    # A slope that overflows, or is not a number, counts as a huge one.
    shifts = {
        axes: as_double(errors.stretch_sd) * pt.where(pt.abs(slope) < LARGEST, slope, LARGEST)
        for axes, slope in sheets.slopes().items()
    }
    for by in "xy":
        variance_x += pt.square(shifts["x", by])
        variance_y += pt.square(shifts["y", by])
    covariance = sum(shifts["x", by] * shifts["y", by] for by in "xy")
    # A stress along x that was not measured says nothing about the error along y.
    by_x = covariance / variance_x * _inputs(sheets)["x_measured"]
    return Stresses(x, pt.sqrt(variance_x), y, pt.sqrt(variance_y - covariance * by_x), by_x)


def _inputs(sheets: SymbolicSheets) -> dict[str, Any]:
    return sheets.forward.share("measured stresses", _rows)


def _rows(data: xr.Dataset) -> dict[str, NDArray]:
    """Return the points at which each stress was measured."""
    x, y = (np.isfinite(data[name].values.astype(float)) for name in STRESSES)
    rows: dict[str, NDArray] = {"x_rows": np.flatnonzero(x), "y_rows": np.flatnonzero(y)}
    # Place of each point among those with a stress along x; behind all others without one.
    place = np.where(x, np.cumsum(x) - 1, x.sum())
    return rows | {"x_measured": x.astype(float), "x_place": place}


def _as_data(values: NDArray, name: str, dims: str | None) -> Any:
    return pm.Data(name, values, dims=dims)


def _possible(curves: Mapping[str, Tensor]) -> Tensor:
    x, y = (pt.all(pt.abs(curves[name]) < LARGEST) for name in STRESSES)
    return x & y
