r"""Expected measurements of a tube, the standard deviations of their errors, and normal densities.

An error of the diameter correlates pressure and force of a point, see
:class:`~pymc_hyperelastic.Gaussian`: the joint density is that of the pressure times that of the
force given the pressure. An offset ``o ~ N(0, s_o²)`` shifts all forces of a test. Given errors
``u_i`` with variances ``w_i``,

.. math:: o \sim \mathcal{N}(v \textstyle\sum_i u_i / w_i,\ v), \qquad
    1/v = 1/s_o^2 + \textstyle\sum_i 1/w_i .
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.tensor.variable import TensorVariable as Tensor

from pymc_hyperelastic.models.forward import OVERFLOW, ForwardModel, SymbolicTube
from pymc_hyperelastic.models.forward.blocks import table_arrays, table_of
from pymc_hyperelastic.models.likelihoods.errors import Errors

# Largest pressure (kPa), force (mN) or slope of these (per mm) whose square does not overflow.
LARGEST = np.sqrt(OVERFLOW)


class Signals(NamedTuple):
    """Expected measurements and standard deviations of their errors."""

    pressure: Tensor
    pressure_sd: Tensor
    force: Any = None
    """At the points where forces were measured."""
    force_sd: Any = None
    """Given the error of the pressure at the same point."""
    by_pressure: Any = None
    """Expected error of the force at each point for each kPa of error of the pressure there."""

    def force_given(self, pressure: Any, rows: Any) -> Tensor:
        """Return the expected forces, given the measured pressures of all points."""
        if self.by_pressure is None:
            return self.force
        return self.force + (self.by_pressure * (pressure - self.pressure))[rows]


def signals_of(
    tube: SymbolicTube, curves: Mapping[str, Tensor], errors: Errors, with_pressure: bool = True
) -> Signals:
    """Return the expected measurements for the curves of a tube.

    Expected forces depend on the measured pressures if these are used, `with_pressure`.
    """
    pressure, pressure_sd = curves["pressure"], as_double(errors.pressure_sd)
    force_sd = None if errors.force_sd is None else as_double(errors.force_sd)
    by_pressure = None
    if errors.diameter_sd is not None:
        radius_sd = as_double(errors.diameter_sd) / 2
        # A slope that overflows, or is not a number, counts as a huge one.
        shifts = {
            name: radius_sd * pt.where(pt.abs(slope) < LARGEST, slope, LARGEST)
            for name, slope in tube.slopes().items()
        }
        known, of_pressure = pt.square(pressure_sd), shifts["pressure"]
        total = known + pt.square(of_pressure)
        pressure_sd = pt.sqrt(total)
        if force_sd is not None:
            of_force, left = shifts["axial_force"], 1.0
            if with_pressure:
                # Fraction of the variance of the diameter error that the measured pressure leaves.
                left, by_pressure = known / total, of_pressure * of_force / total
            force_sd = pt.sqrt(pt.square(force_sd) + pt.square(of_force) * left)
    if force_sd is None:
        return Signals(pressure, pressure_sd)
    rows = force_arrays(tube)["rows"]
    force_sd = force_sd[rows] if force_sd.ndim else force_sd
    return Signals(pressure, pressure_sd, curves["axial_force"][rows], force_sd, by_pressure)


def force_arrays(tube: SymbolicTube) -> dict[str, Any]:
    """Return the ``rows`` of points with a measured force, their table, and ``count`` by test."""

    def arrays_of(data: xr.Dataset) -> dict[str, NDArray]:
        rows = rows_of_forces(data)
        test = data["test"].values[rows]
        count = np.bincount(test, minlength=data.sizes["test"]).astype(float)
        own = {"rows": rows, "test": test, "count": count}
        return table_arrays(test, data.sizes["test"]) | own

    return tube.forward.share("forces", arrays_of)


def rows_of_forces(data: xr.Dataset) -> NDArray[np.intp]:
    """Return the points at which a force was measured."""
    return np.flatnonzero(np.isfinite(values_of(data, "axial_force")))


def values_of(data: xr.Dataset, name: str) -> NDArray[np.float64]:
    """Return the values of a quantity at all points; NaN where it was not measured."""
    if name not in data:
        return np.full(data.sizes["obs"], np.nan)
    return data[name].values.astype(float)


def force_errors(tube: SymbolicTube, expected: Signals) -> Tensor:
    """Return measured minus expected forces, given the measured pressures."""
    pressure, force = (measured(tube.forward, name) for name in ("pressure", "axial_force"))
    return force - expected.force_given(pressure, force_arrays(tube)["rows"])


def measured(
    forward: ForwardModel, name: str, make: Callable[[NDArray, str], Any] | None = None
) -> Any:
    """Return the measured values of a quantity, where it was measured, as a shared variable."""

    def arrays_of(data: xr.Dataset) -> dict[str, NDArray]:
        values = values_of(data, name)
        return {f"{name}_data": values[np.isfinite(values)]}

    return forward.share(("measured", name), arrays_of, make)[f"{name}_data"]


def normal_log_density(square: Any, variance: Any, count: Any = 1.0) -> Tensor:
    """Return the log density of normal errors from their squares, or sums of `count` squares."""
    return -(square / variance + count * pt.log(2 * np.pi * variance)) / 2


def log_density_by_points(
    error: Tensor, variance: Any, offset_sd: Any, inputs: Mapping[str, Any]
) -> Tensor:
    """Return the log density of each force, given those before it in its test, without offset."""
    tables = weights_of_tests(error, variance, inputs)
    precision, weighted = (pt.cumsum(x, axis=-1) - x for x in tables)
    moments = offset_moments(precision, weighted, offset_sd)
    mean, left = (x.flatten()[inputs["place"]] for x in moments)
    return normal_log_density(pt.square(error - mean), variance + left)


def log_density_ratio_of_offset(precision: Any, weighted: Any, offset_sd: Any) -> Tensor:
    """Return what an offset adds to the log density of independent errors, from the same sums."""
    mean, variance = offset_moments(precision, weighted, offset_sd)
    shrinkage = variance / pt.square(as_double(offset_sd))
    return (pt.square(mean) / variance + pt.log(shrinkage)) / 2


def offset_moments(precision: Any, weighted: Any, offset_sd: Any) -> tuple[Tensor, Tensor]:
    """Return the posterior mean and variance of an offset.

    The arguments are the sums of the precisions of the errors, and of errors times precisions.
    """
    prior = pt.square(as_double(offset_sd))
    variance = prior / (1 + prior * precision)
    return variance * weighted, variance


def weights_of_tests(
    error: Tensor, variance: Any, inputs: Mapping[str, Any]
) -> tuple[Tensor, Tensor]:
    """Return the precision of each error, and error times precision, as tables by test."""
    precision = table_of(pt.zeros_like(error) + 1 / variance, inputs)
    return precision, table_of(error / variance, inputs)


def as_double(value: Any) -> Tensor:
    """Return a tensor in double precision: PyTensor reads 7.0 as a single-precision number."""
    return pt.cast(pt.as_tensor(value), "float64")
