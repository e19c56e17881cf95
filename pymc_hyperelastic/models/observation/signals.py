r"""Pressures and forces point by point, where measurements share an error.

An error of the diameter shifts pressure and force of a point together, along the curves. With the
model's slopes ``p'`` and ``F'`` by the radius that was measured, and half of the standard deviation
of the diameter ``s_r``, both errors have, to first order, the covariance

.. math:: \begin{pmatrix} s_p^2 & 0 \\ 0 & s_F^2 \end{pmatrix}
    + s_r^2 \begin{pmatrix} p'^2 & p' F' \\ p' F' & F'^2 \end{pmatrix} .

It enters as the density of the pressure times that of the force given the pressure, so that no
matrix is factorised. An offset ``o ~ N(0, s_o²)`` shifts all forces of a test. By errors ``u_i`` of
forces, given those of the pressures, and their variances ``w_i``, it is known as

.. math:: o \sim \mathcal{N}(v \textstyle\sum_i u_i / w_i,\ v), \qquad
    1/v = 1/s_o^2 + \textstyle\sum_i 1/w_i .

With those before a point it is integrated out of that one: its mean and its variance are added.
"""

from collections.abc import Callable, Mapping
from functools import reduce
from operator import add, and_
from typing import Any, NamedTuple

import numpy as np
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.models.forward import ForwardModel, SymbolicTube
from pymc_hyperelastic.models.forward.blocks import table_arrays, table_of
from pymc_hyperelastic.models.observation.noise import sd_of_sigma

# What a model holds of each test's offset.
OFFSET_VARIABLES = ("force_offset_mean", "force_offset_error")
# kPa, or mN, and these by mm: beyond any tube; the square of what is smaller does not overflow.
LARGEST = np.float64(1e30)


class Signals(NamedTuple):
    """What a model expects of the measurements, and standard deviations about that."""

    pressure: TensorVariable
    pressure_sd: TensorVariable
    force: Any = None
    """Where forces were measured."""
    force_sd: Any = None
    """Given the error of the pressure at the point."""
    by_pressure: Any = None
    """What a force is expected to err by for each kPa that the pressure of its point does."""

    def force_given(self, pressure: Any, rows: Any) -> TensorVariable:
        """The expected forces, given what the pressures are at all points."""
        if self.by_pressure is None:
            return self.force
        return self.force + self.by_pressure * (pressure - self.pressure)[rows]


def signals_of(
    tube: SymbolicTube,
    curves: Mapping[str, TensorVariable],
    *,
    sigma: Any,
    force_sigma: Any = None,
    diameter_noise_sd: Any = None,
    pressure_known: Any = None,
) -> Signals:
    """What is expected of the measurements, of the tube's `curves`.

    An error is one number, or one for each point. Where the switch `pressure_known` is 0, forces
    are those without the pressures of their points.
    """
    pressure, pressure_sd = curves["pressure"], sd_of_sigma(as_double(sigma))
    force = force_sd = rows = None
    if force_sigma is not None:
        rows = force_arrays(tube)["rows"]
        force, force_sd = curves["axial_force"][rows], sd_of_sigma(as_double(force_sigma))
        force_sd = force_sd[rows] if force_sd.ndim else force_sd
    if diameter_noise_sd is None:
        return Signals(pressure, pressure_sd, force, force_sd)
    radius_sd = as_double(diameter_noise_sd) / 2
    # A slope that overflows belongs to curves that do, which are judged elsewhere.
    shifts = {
        name: radius_sd * pt.where(pt.abs(slope) < LARGEST, slope, LARGEST)
        for name, slope in tube.slopes().items()
    }
    shift, total = shifts["pressure"], pt.square(pressure_sd) + pt.square(shifts["pressure"])
    if force is None:
        return Signals(pressure, pt.sqrt(total), force, force_sd)
    shift, of_force, of_pressure = shift[rows], shifts["axial_force"][rows], total[rows]
    # Fraction of the variance of the diameter error that the measured pressure leaves.
    known_sd = pressure_sd[rows] if pressure_sd.ndim else pressure_sd
    open_share, by_pressure = pt.square(known_sd) / of_pressure, shift * of_force / of_pressure
    if pressure_known is not None:
        open_share = pt.where(pressure_known, open_share, 1.0)
        by_pressure = pt.where(pressure_known, by_pressure, 0.0)
    force_sd = pt.sqrt(pt.square(force_sd) + pt.square(of_force) * open_share)
    return Signals(pressure, pt.sqrt(total), force, force_sd, by_pressure)


def force_arrays(tube: SymbolicTube) -> dict[str, Any]:
    """Where forces were measured: ``rows`` of the points, and the table of the tests."""

    def arrays_of(data: xr.Dataset) -> dict[str, NDArray]:
        rows = rows_of_forces(data)
        test = data["test"].values[rows]
        return table_arrays(test, data.sizes["test"]) | {"rows": rows, "test": test}

    return tube.forward.share("forces", arrays_of)


def rows_of_forces(data: xr.Dataset) -> NDArray[np.intp]:
    """Points at which a force was measured."""
    return np.flatnonzero(np.isfinite(data["axial_force"].values.astype(float)))


def measured(
    forward: ForwardModel, name: str, make: Callable[[NDArray, str], Any] | None = None
) -> Any:
    """What was measured of a quantity, where it was, as a shared variable."""

    def arrays_of(data: xr.Dataset) -> dict[str, NDArray]:
        values = data[name].values.astype(float)
        return {f"{name}_data": values[np.isfinite(values)]}

    return forward.share(("measured", name), arrays_of, make)[f"{name}_data"]


def log_likelihood_by_points(
    tube: SymbolicTube,
    *,
    force_offset_sd: Any = None,
    switches: Mapping[str, Any] | None = None,
    **errors: Any,
) -> TensorVariable:
    """Log-likelihood of pressures and forces, each point with a variance of its own.

    The `errors` are those of :func:`signals_of`. With `switches` it is that of the signals
    ``"pressure"`` and ``"force"`` whose switch is not 0.
    """
    curves = tube.curves()
    drawn = [curves[name] for name in ("pressure", "axial_force") if name in curves]
    small = [pt.all(pt.abs(curve) < LARGEST) for curve in drawn]
    possible = reduce(and_, [*small, *tube.conditions()])
    safe = {name: pt.where(possible, curve, 0.0) for name, curve in curves.items()}
    pressure_known = None if switches is None else switches["pressure"]
    expected = signals_of(tube, safe, **errors, pressure_known=pressure_known)
    error = measured(tube.forward, "pressure") - expected.pressure
    of_pressures = pt.sum(normal_log_density(error, pt.square(expected.pressure_sd)))
    terms = {"pressure": of_pressures}
    if expected.force is not None:
        error, variance = _force_errors(tube, expected), pt.square(expected.force_sd)
        if force_offset_sd is None:
            of_forces = normal_log_density(error, variance)
        else:
            of_forces = offset_log_density(error, variance, force_offset_sd, force_arrays(tube))
        terms["force"] = pt.sum(of_forces)
    if switches is not None:
        terms = {name: pt.where(switches[name], term, 0.0) for name, term in terms.items()}
    return pt.where(possible, reduce(add, terms.values()), -np.inf)


def offsets_given(
    tube: SymbolicTube,
    curves: Mapping[str, TensorVariable],
    *,
    force_offset_sd: Any,
    **errors: Any,
) -> tuple[TensorVariable, TensorVariable]:
    """Mean and standard deviation of each test's offset, given material, tube and errors.

    With the error in the radius forces are those at the model's radii, and not those of `curves`.
    """
    if tube.forward.error_in == "radius":
        variance = pt.square(sd_of_sigma(as_double(errors["force_sigma"])))
        sums = tube.misfits("offsets", _targets_of_offsets).force_sums
        weighted = -pt.as_tensor(sums) / variance
        precision = force_arrays(tube)["there"].sum(axis=-1) / variance
        mean, left = _normal_offset(precision, weighted, force_offset_sd)
        return mean, pt.sqrt(left)
    expected = signals_of(tube, curves, **errors)
    error, variance = _force_errors(tube, expected), pt.square(expected.force_sd)
    mean, left = _known_offset(error, variance, force_offset_sd, force_arrays(tube), before=False)
    return mean, pt.sqrt(left)


def _targets_of_offsets(data: xr.Dataset) -> dict[str, NDArray]:
    pressure, force = (data[name].values.astype(float) for name in ("pressure", "axial_force"))
    return {"pressure": pressure, "force": force, "force_sum": force}


def _force_errors(tube: SymbolicTube, expected: Signals) -> TensorVariable:
    """Measured forces less those that are expected, given the measured pressures."""
    pressure, force = (measured(tube.forward, name) for name in ("pressure", "axial_force"))
    return force - expected.force_given(pressure, force_arrays(tube)["rows"])


def normal_log_density(error: Any, variance: Any) -> TensorVariable:
    """Log-density of normal errors."""
    return -pt.log(2 * np.pi * variance) / 2 - pt.square(error) / (2 * variance)


def offset_log_density(
    error: TensorVariable, variance: Any, offset_sd: Any, inputs: Mapping[str, Any]
) -> TensorVariable:
    """Log-density of each force, given those before it in its test, its offset integrated out."""
    mean, left = _known_offset(error, variance, offset_sd, inputs, before=True)
    place = inputs["place"]
    mean, left = mean.flatten()[place], left.flatten()[place]
    return normal_log_density(error - mean, variance + left)


def _known_offset(
    error: TensorVariable,
    variance: Any,
    offset_sd: Any,
    inputs: Mapping[str, Any],
    *,
    before: bool,
) -> tuple[TensorVariable, TensorVariable]:
    """Mean and variance of offsets by all forces of a test, or by those before each of them."""
    precision = table_of(pt.zeros_like(error) + 1 / variance, inputs)
    weighted = table_of(error / variance, inputs)
    if before:
        precision, weighted = (pt.cumsum(x, axis=-1) - x for x in (precision, weighted))
    else:
        precision, weighted = precision.sum(axis=-1), weighted.sum(axis=-1)
    return _normal_offset(precision, weighted, offset_sd)


def _normal_offset(
    precision: TensorVariable, weighted: TensorVariable, offset_sd: Any
) -> tuple[TensorVariable, TensorVariable]:
    """Mean and variance of offsets, by the precisions of errors and the errors times these."""
    prior = pt.square(as_double(offset_sd))
    left = prior / (1 + prior * precision)
    return left * weighted, left


def as_double(value: Any) -> TensorVariable:
    """A number in double precision: PyTensor reads 7.0 as a single-precision one."""
    return pt.as_tensor(value, dtype="float64")
