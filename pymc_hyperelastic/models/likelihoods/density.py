"""The density of the data of a tube, for a Potential and for observed variables.

For a Potential the terms of the signals come from sums of squared misfits, which the integrator can
compute from a few nodes in place of all points. If the diameter has an error, every point has a
variance of its own, and the terms are sums over points.
"""

from collections.abc import Callable, Collection, Mapping
from functools import reduce
from operator import add, and_
from typing import Any

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.tensor.variable import TensorVariable as Tensor
from scipy.linalg import solve_banded

from pymc_hyperelastic.models.forward import ForwardModel, SymbolicTube
from pymc_hyperelastic.models.forward.blocks import block_arrays, block_product, identity_of_tests
from pymc_hyperelastic.models.likelihoods.errors import Errors
from pymc_hyperelastic.models.likelihoods.signals import (
    LARGEST,
    as_double,
    force_arrays,
    force_errors,
    log_density_by_points,
    log_density_ratio_of_offset,
    measured,
    normal_log_density,
    offset_moments,
    rows_of_forces,
    signals_of,
    values_of,
    weights_of_tests,
)
from pymc_hyperelastic.models.likelihoods.slopes import (
    central_differences,
    half_log_determinant,
    measured_slopes,
    number_of_slopes,
    precision_root,
    squared_singular_values,
)
from pymc_hyperelastic.models.priors import is_inferred

Array = NDArray[np.float64]
Terms = tuple[dict[str, Any], Tensor]
"""Log density of each signal, and whether the material and the tube are possible."""
Bound = Callable[[Tensor], Tensor]
"""A function of means that makes those of an impossible tube infinite."""


def log_likelihood(tube: SymbolicTube, errors: Errors, signals: Collection[str]) -> Tensor:
    """Return the log likelihood of signals of the tube's data; minus infinity if it is impossible.

    The `signals` are some of ``"pressure"``, ``"slope"`` and ``"force"``.
    """
    by = _terms_by_points if errors.diameter_sd is not None else _terms_by_sums
    terms, possible = by(tube, errors, "pressure" in signals)
    counted = [term for name, term in terms.items() if name in signals]
    return pt.where(possible, reduce(add, counted), -np.inf)


def _terms_by_sums(tube: SymbolicTube, errors: Errors, with_pressure: bool) -> Terms:
    """Terms from sums of squared misfits, see :meth:`SymbolicTube.misfits`."""
    forward = tube.forward
    sd = errors.pressure_sd if errors.radius_sd is None else errors.radius_sd
    variance = pt.square(as_double(sd))  # of pressures, or of radii
    key = errors.counts_slopes, errors.force_sd is not None, errors.force_offset_sd is not None
    with_slopes, with_force, with_offset = key
    squares, conditions, force_sums = tube.misfits(key, lambda data: _targets(data, *key))
    points = _of_data(tube, _number_of_pressures)
    terms = {"pressure": normal_log_density(squares[forward.error_in], variance, points)}
    if with_slopes:
        normaliser = _slope_normaliser(tube, errors, with_pressure)
        weight = as_double(errors.slope_weight)
        terms["slope"] = normaliser - weight * squares["slope"] / (2 * variance)
    if with_force:
        of_force, count = pt.square(as_double(errors.force_sd)), force_arrays(tube)["count"]
        terms["force"] = normal_log_density(squares["force"], of_force, pt.sum(count))
        if with_offset:
            sums = count / of_force, force_sums / of_force
            terms["force"] += pt.sum(log_density_ratio_of_offset(*sums, errors.force_offset_sd))
    return terms, reduce(and_, conditions)


def _targets(data: xr.Dataset, slopes: bool, forces: bool, offsets: bool) -> dict[str, Array]:
    """Return the measured values with which curves are compared."""
    targets = {"pressure": data["pressure"].values.astype(float)}
    if slopes:
        targets["slope"] = np.full(data.sizes["obs"], np.nan)
        targets["slope"][central_differences(data)[0]] = measured_slopes(data)
    if forces:
        targets["force"] = values_of(data, "axial_force")
    if offsets:
        targets["force_sum"] = targets["force"]
    return targets


def _slope_normaliser(tube: SymbolicTube, errors: Errors, with_pressure: bool) -> Tensor:
    r"""Return the normaliser of the slope term, ``½ ln det(I + β DᵀD)`` beside the pressures.

    Slopes without their pressures count as ``N_s`` independent numbers. Otherwise an inferred ``σ``
    or ``β`` would favour large slopes:

    .. math:: -\frac{β}{σ^2} |Δs|^2 - \frac{N_s}{2} \ln\frac{π σ^2}{β}
    """
    weight = errors.slope_weight
    if not with_pressure:
        variance = pt.square(as_double(errors.pressure_sd)) / as_double(weight)
        return normal_log_density(0.0, variance, _of_data(tube, number_of_slopes))
    if is_inferred(weight):
        eigenvalues = _of_data(tube, squared_singular_values)
        return pt.sum(pt.log1p(as_double(weight) * eigenvalues)) / 2
    return _of_data(tube, half_log_determinant, weight)


def _number_of_pressures(data: xr.Dataset) -> int:
    return int(data["pressure"].notnull().sum())


def _of_data(tube: SymbolicTube, function: Callable[..., Any], *given: float) -> Tensor:
    """Return ``function(data, *given)`` as a variable that follows the data."""
    name = function.__name__
    arrays = tube.forward.share(
        (name, *given), lambda data: {name: np.asarray(function(data, *given), dtype=float)}
    )
    return arrays[name]


def _terms_by_points(tube: SymbolicTube, errors: Errors, with_pressure: bool) -> Terms:
    """Terms as sums over points, each with a variance of its own, see :func:`signals_of`."""
    curves = tube.curves()
    drawn = [curves[name] for name in ("pressure", "axial_force") if name in curves]
    small = [pt.all(pt.abs(curve) < LARGEST) for curve in drawn]
    possible = reduce(and_, [*small, *tube.conditions()])
    safe = {name: pt.where(possible, curve, 0.0) for name, curve in curves.items()}
    expected = signals_of(tube, safe, errors, with_pressure)
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
    tube: SymbolicTube, curves: Mapping[str, Tensor], errors: Errors
) -> tuple[Tensor, Tensor]:
    """Return mean and standard deviation of each test's offset, given material, tube and errors.

    With the error in the radius, forces are those at the model's radii in place of the `curves`.
    """
    if tube.forward.error_in == "radius":
        variance = pt.square(as_double(errors.force_sd))
        key = False, True, True
        force_sums = tube.misfits(key, lambda data: _targets(data, *key)).force_sums
        weighted = -pt.as_tensor(force_sums) / variance
        precision = force_arrays(tube)["count"] / variance
    else:
        expected = signals_of(tube, curves, errors)
        error, variance = force_errors(tube, expected), pt.square(expected.force_sd)
        weights = weights_of_tests(error, variance, force_arrays(tube))
        precision, weighted = (table.sum(axis=-1) for table in weights)
    mean, variance = offset_moments(precision, weighted, errors.force_offset_sd)
    return mean, pt.sqrt(variance)


def register_measurements(
    tube: SymbolicTube, curves: Mapping[str, Tensor], errors: Errors, dims: str | None = "obs"
) -> None:
    """Add the measured pressures, and forces, as observed variables.

    Each point has a log density, given the points before it in its test. If curves overflow, or the
    tube is impossible, means are infinite and the log-likelihood is ``−inf``.
    """
    conditions = tube.conditions()

    def bound(mean: Tensor) -> Tensor:
        possible = reduce(and_, [pt.all(pt.abs(mean) < LARGEST), *conditions])
        return pt.where(possible, mean, np.inf)

    expected = signals_of(tube, curves, errors)
    settings = _data_of(tube.forward, "pressure", dims)
    if errors.counts_slopes:
        pressure = _correlated_normal(tube, expected.pressure, errors, bound, **settings)
    else:
        mean, sd = bound(expected.pressure), expected.pressure_sd
        pressure = pm.Normal("measured_pressure", mean, sd, **settings)
    if expected.force is None:
        return
    if dims:
        model = pm.modelcontext(None)
        dims = model.name_for("force_obs")
        model.add_coord(dims, rows_of_forces(tube.forward.data))
    settings = _data_of(tube.forward, "axial_force", dims)
    # Predictions of forces are given the drawn pressures.
    mean = bound(expected.force_given(pressure, force_arrays(tube)["rows"]))
    if errors.force_offset_sd is None:
        pm.Normal("measured_axial_force", mean, expected.force_sd, **settings)
    else:
        _offset_normal(tube, mean, expected.force_sd, errors.force_offset_sd, **settings)


def _data_of(forward: ForwardModel, name: str, dims: str | None) -> dict[str, Any]:
    """Return the observed values of a quantity as ``pm.Data``, and their dimension."""
    values = measured(forward, name, lambda array, name: pm.Data(name, array, dims=dims))
    return {"observed": values, "dims": dims}


def _correlated_normal(
    tube: SymbolicTube, pressure: Tensor, errors: Errors, bound: Bound, **settings: Any
) -> Tensor:
    """Add pressures ``y ~ N(μ, s² P⁻¹)`` whose errors are correlated by slopes.

    ``P`` and ``μ`` are those of :class:`~pymc_hyperelastic.SlopeAugmented`. With the lower
    triangular ``B`` of ``P = BᵀB``, entry ``i`` of the log density of ``(B y − B μ)/s``, with
    ``ln B_ii``, is ``ln p(y_i | the y before)``.
    """
    weight = errors.slope_weight

    def arrays_of(data: xr.Dataset) -> dict[str, Array]:
        diagonal, before = precision_root(data, weight)
        bands = np.stack([diagonal, np.zeros_like(before), np.roll(before, -2)])
        inverse = solve_banded((2, 0), bands, identity_of_tests(data))
        interior, difference = central_differences(data)
        factor = np.zeros_like(diagonal)
        factor[interior] = weight * difference
        own = {"diagonal": diagonal, "before": before, "factor": factor}
        return own | block_arrays(data, inverse)

    inputs = tube.forward.share(("correlated", weight), arrays_of)
    weighted = inputs["factor"] * tube.slopes()["pressure"]
    right = pressure + pt.roll(weighted, 1, axis=-1) - pt.roll(weighted, -1, axis=-1)
    white_mean = bound(block_product(inputs["blocks"].transpose(0, 2, 1), inputs, right))

    def logp(value: Any, mean: Tensor, sd: Tensor, *_: Any) -> Tensor:
        # The first two of each test have the factor 0, so that no value of another test counts.
        white = inputs["diagonal"] * value + inputs["before"] * pt.roll(value, 2, axis=-1)
        # Otherwise the gradient by the standard deviation would be infinite where a mean is.
        possible = pt.isfinite(mean)
        square = pt.square(pt.where(possible, white - mean, 0.0))
        log_density = pt.log(inputs["diagonal"]) + normal_log_density(square, pt.square(sd))
        return pt.where(possible, log_density, -np.inf)

    def unwhitened(white: Tensor, blocks: Any, points: Any, place: Any) -> Tensor:
        return block_product(blocks, {"points": points, "place": place}, white)

    return pm.CustomDist(
        "measured_pressure",
        white_mean,
        pt.zeros_like(white_mean) + as_double(errors.pressure_sd),
        *(inputs[name] for name in ("blocks", "points", "place")),
        dist=lambda mean, sd, *inverse: unwhitened(pm.Normal.dist(mean, sd), *inverse[:3]),
        logp=logp,
        support_point=lambda _rv, _size, mean, _sd, *inverse: unwhitened(mean, *inverse),
        signature="(n),(n),(t,m,m),(k),(n)->(n)",
        **settings,
    )


def _offset_normal(
    tube: SymbolicTube, mean: Tensor, sd: Any, offset_sd: Any, **settings: Any
) -> None:
    """Add forces about `mean` with independent errors and an offset that each test shares."""
    inputs = force_arrays(tube)

    def logp(value: Any, mean: Tensor, sd: Tensor, offset_sd: Any, *_: Any) -> Tensor:
        possible = pt.isfinite(mean)
        error = pt.where(possible, value - mean, 0.0)
        log_density = log_density_by_points(error, pt.square(sd), offset_sd, inputs)
        return pt.where(possible, log_density, -np.inf)

    def dist(mean: Tensor, sd: Tensor, offset_sd: Any, test: Any, points: Any, _: Any) -> Tensor:
        of_tests = pt.zeros_like(points[:, 0], dtype="float64")
        offset = pm.Normal.dist(of_tests, offset_sd)
        return pm.Normal.dist(mean + offset[test], sd)

    pm.CustomDist(
        "measured_axial_force",
        mean,
        pt.zeros_like(mean) + sd,
        as_double(offset_sd),
        inputs["test"],
        inputs["points"],
        dist=dist,
        logp=logp,
        support_point=lambda _rv, _size, mean, *_: mean,
        signature="(n),(n),(),(n),(t,m)->(n)",
        **settings,
    )
