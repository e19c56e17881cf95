"""The log likelihood of the data of a tube as one number, for a Potential.

The terms of the signals come from sums of squared misfits, which the integrator can compute from a
few nodes in place of all points. If the diameter has an error, every point has a variance of its
own, and the terms are sums over points.
"""

from collections.abc import Callable, Mapping
from functools import reduce
from operator import add, and_
from typing import Any

import numpy as np
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.models.forward import SymbolicTube
from pymc_hyperelastic.models.likelihoods.errors import Errors
from pymc_hyperelastic.models.likelihoods.normal import (
    as_double,
    log_density_by_points,
    log_density_ratio_of_offset,
    normal_log_density,
    offset_moments,
    weights_of_tests,
)
from pymc_hyperelastic.models.likelihoods.signals import (
    LARGEST,
    force_arrays,
    force_errors,
    measured,
    signals_of,
)
from pymc_hyperelastic.models.likelihoods.slopes import (
    central_differences,
    measured_slopes,
    precision_root,
    squared_singular_values,
)
from pymc_hyperelastic.models.priors import is_inferred

Array = NDArray[np.float64]
Terms = tuple[dict[str, Any], TensorVariable]
"""Log density of each signal, and whether the material and the tube are possible."""


def log_likelihood(
    tube: SymbolicTube, errors: Errors, switches: Mapping[str, Any] | None = None
) -> TensorVariable:
    """Return the log likelihood of the tube's data; minus infinity for an impossible tube.

    With `switches` only the signals ``"pressure"``, ``"slope"`` and ``"force"`` whose switch is
    not 0 count.
    """
    by = _terms_by_points if errors.diameter_sd is not None else _terms_by_sums
    terms, possible = by(tube, errors, switches)
    if switches is not None:
        terms = {name: pt.where(switches[name], term, 0.0) for name, term in terms.items()}
    return pt.where(possible, reduce(add, terms.values()), -np.inf)


def _terms_by_sums(tube: SymbolicTube, errors: Errors, switches: Mapping[str, Any] | None) -> Terms:
    """Terms from sums of squared misfits, see :meth:`SymbolicTube.misfits`."""
    forward = tube.forward
    sd = errors.pressure_sd if errors.radius_sd is None else errors.radius_sd
    variance = pt.square(as_double(sd))
    key = errors.counts_slopes, errors.force_sd is not None, errors.force_offset_sd is not None
    with_slopes, with_force, with_offset = key
    squares, conditions, force_sums = tube.misfits(key, _targets(*key))
    points = measured(forward, "pressure").shape[0]
    terms = {"pressure": normal_log_density(squares[forward.error_in], variance, points)}
    if with_slopes:
        normaliser = _slope_normaliser(tube, errors, switches)
        weight = as_double(errors.slope_weight)
        terms["slope"] = normaliser - weight * squares["slope"] / (2 * variance)
    if with_force:
        variance, forces = pt.square(as_double(errors.force_sd)), _forces_of_tests(tube)
        terms["force"] = normal_log_density(squares["force"], variance, pt.sum(forces))
        if with_offset:
            sums = forces / variance, force_sums / variance
            terms["force"] += pt.sum(log_density_ratio_of_offset(*sums, errors.force_offset_sd))
    return terms, reduce(and_, conditions)


def _targets(slopes: bool, forces: bool, offsets: bool) -> Callable[[xr.Dataset], dict[str, Array]]:
    """Return a function of data: the values with which curves are compared."""

    def targets_of(data: xr.Dataset) -> dict[str, Array]:
        targets = {"pressure": data["pressure"].values.astype(float)}
        if slopes:
            targets["slope"] = np.full(data.sizes["obs"], np.nan)
            targets["slope"][central_differences(data)[0]] = measured_slopes(data)
        if forces:
            targets["force"] = data["axial_force"].values.astype(float)
        if offsets:
            targets["force_sum"] = targets["force"]
        return targets

    return targets_of


def _forces_of_tests(tube: SymbolicTube) -> TensorVariable:
    """Return the number of measured forces of each test."""
    return pt.sum(force_arrays(tube)["there"], axis=-1)


def _slope_normaliser(
    tube: SymbolicTube, errors: Errors, switches: Mapping[str, Any] | None
) -> TensorVariable:
    r"""Return the normaliser of the slope term, ``½ ln det(I + β DᵀD)`` beside the pressures.

    Slopes without their pressures count as ``N_s`` independent numbers. Otherwise an inferred ``σ``
    or ``β`` would favour large slopes:

    .. math:: -\frac{β}{σ^2} |Δs|^2 - \frac{N_s}{2} \ln\frac{π σ^2}{β}
    """
    inferred = is_inferred(errors.slope_weight)

    def arrays_of(data: xr.Dataset) -> dict[str, Array]:
        arrays = {"slopes": np.array(float(central_differences(data)[0].size))}
        if inferred:
            return arrays | {"eigenvalues": squared_singular_values(data)}
        diagonal, _ = precision_root(data, errors.slope_weight)
        return arrays | {"half_log_determinant": np.array(np.log(diagonal).sum())}

    weight = None if inferred else float(errors.slope_weight)
    inputs = tube.forward.share(("slope normaliser", weight), arrays_of)
    if inferred:
        beside = pt.sum(pt.log1p(errors.slope_weight * inputs["eigenvalues"])) / 2
    else:
        beside = inputs["half_log_determinant"]
    if switches is None:
        return beside
    variance = pt.square(as_double(errors.pressure_sd)) / as_double(errors.slope_weight)
    alone = normal_log_density(0.0, variance, inputs["slopes"])
    return pt.where(switches["pressure"], beside, alone)


def _terms_by_points(
    tube: SymbolicTube, errors: Errors, switches: Mapping[str, Any] | None
) -> Terms:
    """Terms as sums over points, each with a variance of its own, see :func:`signals_of`."""
    curves = tube.curves()
    drawn = [curves[name] for name in ("pressure", "axial_force") if name in curves]
    small = [pt.all(pt.abs(curve) < LARGEST) for curve in drawn]
    possible = reduce(and_, [*small, *tube.conditions()])
    safe = {name: pt.where(possible, curve, 0.0) for name, curve in curves.items()}
    pressure_switch = None if switches is None else switches["pressure"]
    expected = signals_of(tube, safe, errors, pressure_switch)
    square = pt.square(measured(tube.forward, "pressure") - expected.pressure)
    terms = {"pressure": pt.sum(normal_log_density(square, pt.square(expected.pressure_sd)))}
    if expected.force is not None:
        error, variance = force_errors(tube, expected), pt.square(expected.force_sd)
        if errors.force_offset_sd is None:
            densities = normal_log_density(pt.square(error), variance)
        else:
            settings = errors.force_offset_sd, force_arrays(tube)
            densities = log_density_by_points(error, variance, *settings)
        terms["force"] = pt.sum(densities)
    return terms, possible


def posterior_of_offsets(
    tube: SymbolicTube, curves: Mapping[str, TensorVariable], errors: Errors
) -> tuple[TensorVariable, TensorVariable]:
    """Return mean and standard deviation of each test's offset, given material, tube and errors.

    If the radius has the error, the forces at the model's radii are used in place of `curves`.
    """
    if tube.forward.error_in == "radius":
        variance = pt.square(as_double(errors.force_sd))
        force_sums = tube.misfits("offsets", _targets(False, True, True)).force_sums
        weighted = -pt.as_tensor(force_sums) / variance
        precision = _forces_of_tests(tube) / variance
    else:
        expected = signals_of(tube, curves, errors)
        error, variance = force_errors(tube, expected), pt.square(expected.force_sd)
        weights = weights_of_tests(error, variance, force_arrays(tube))
        precision, weighted = (table.sum(axis=-1) for table in weights)
    mean, variance = offset_moments(precision, weighted, errors.force_offset_sd)
    return mean, pt.sqrt(variance)
