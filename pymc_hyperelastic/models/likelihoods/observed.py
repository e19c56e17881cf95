"""The likelihood as observed variables: measured pressures and axial forces."""

from collections.abc import Callable, Mapping
from functools import partial, reduce
from operator import and_
from typing import Any

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.tensor.variable import TensorVariable
from scipy.linalg import solve_banded

from pymc_hyperelastic.models.forward import ForwardModel, SymbolicTube
from pymc_hyperelastic.models.forward.blocks import block_arrays, block_product, identity_of_tests
from pymc_hyperelastic.models.likelihoods.errors import Errors
from pymc_hyperelastic.models.likelihoods.normal import (
    as_double,
    log_density_by_points,
    normal_log_density,
)
from pymc_hyperelastic.models.likelihoods.signals import (
    LARGEST,
    Signals,
    force_arrays,
    measured,
    rows_of_forces,
    signals_of,
)
from pymc_hyperelastic.models.likelihoods.slopes import precision_root, whiten

Array = NDArray[np.float64]
Bound = Callable[[TensorVariable], TensorVariable]
"""A function of means that makes those of an impossible tube infinite."""


def register_measurements(
    tube: SymbolicTube,
    curves: Mapping[str, TensorVariable],
    errors: Errors,
    *,
    dims: str | None = "obs",
    bounded: bool = True,
) -> None:
    r"""Add the measured pressures, and forces, as observed variables.

    .. math:: y \sim \mathcal{N}\big(\tilde μ, s^2 (B^T B)^{-1}\big), \qquad
        B^T B = I + β D^T D, \qquad B^T B \tilde μ = m + β D^T s

    ``B`` is lower triangular and ``(B y − B μ̃)/s`` standard normal: entry ``i`` of its
    log-density, with ``ln B_ii``, is ``ln p(y_i | the y before)``. If curves overflow, or the
    tube is impossible, means are infinite and the log-likelihood is ``−inf``. Without `bounded`,
    curves that overflow are not looked for.

    With an offset of the transducer the entries of forces are those of each force given the ones
    before it in its test, see :func:`log_density_by_points`. With an error of the diameter they are
    given the pressures, too, see :func:`signals_of`.
    """
    conditions = tube.conditions()

    def bound(mean: TensorVariable) -> TensorVariable:
        small = [pt.all(pt.abs(mean) < LARGEST)] if bounded else []
        needed = [*small, *conditions]
        return pt.where(reduce(and_, needed), mean, np.inf) if needed else mean

    expected = signals_of(tube, curves, errors)
    pressure = _register_pressure(tube, expected, errors, bound, dims)
    if errors.force_sd is not None:
        _register_force(tube, expected, errors, bound, dims, pressure)


def _register_pressure(
    tube: SymbolicTube, expected: Signals, errors: Errors, bound: Bound, dims: str | None
) -> TensorVariable:
    """Add the observed variable ``measured_pressure``."""
    settings = _data_of(tube.forward, "pressure", dims)
    if not errors.counts_slopes:
        mean, sd = bound(expected.pressure), expected.pressure_sd
        return pm.Normal("measured_pressure", mean, sd, **settings)
    weight = errors.slope_weight

    def linear_of(data: xr.Dataset) -> Callable[[Array, Array], Array]:
        return partial(whiten, precision_root(data, weight), data, weight)

    mean = bound(tube.mapped(("whitened", weight), linear_of))
    return _correlated_normal(tube.forward, mean, errors.pressure_sd, weight, **settings)


def _register_force(
    tube: SymbolicTube,
    expected: Signals,
    errors: Errors,
    bound: Bound,
    dims: str | None,
    pressure: TensorVariable,
) -> None:
    """Add the observed variable ``measured_axial_force``."""
    if dims:
        model = pm.modelcontext(None)
        dims = model.name_for("force_obs")
        model.add_coord(dims, rows_of_forces(tube.forward.data))
    settings = _data_of(tube.forward, "axial_force", dims)
    # With an error of the diameter forces depend on the pressures; on drawn pressures in
    # predictions.
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
    forward: ForwardModel, mean: TensorVariable, sd: Any, slope_weight: float, **settings: Any
) -> TensorVariable:
    """Add pressures ``y`` with independent ``B y`` about `mean`, of the standard deviation `sd`."""

    def arrays_of(data: xr.Dataset) -> dict[str, Array]:
        root = precision_root(data, slope_weight)
        below = np.zeros_like(root)
        below[0], below[2, :-2] = root[2], root[0, 2:]
        inverse = solve_banded((2, 0), below, identity_of_tests(data))
        return {"before": root[0], "root": root[2], **block_arrays(data, inverse)}

    inputs = forward.share(("root", slope_weight), arrays_of)

    def logp(value: Any, mean: TensorVariable, sd: TensorVariable, *_: Any) -> TensorVariable:
        # The first two of each test have the factor 0, so that no value of another test counts.
        white = inputs["root"] * value + inputs["before"] * pt.roll(value, 2, axis=-1)
        # Otherwise the gradient by the standard deviation would be infinite where a mean is.
        possible = pt.isfinite(mean)
        square = pt.square(pt.where(possible, white - mean, 0.0))
        log_density = pt.log(inputs["root"]) + normal_log_density(square, pt.square(sd))
        return pt.where(possible, log_density, -np.inf)

    def unwhitened(white: TensorVariable, blocks: Any, points: Any, place: Any) -> TensorVariable:
        return block_product(blocks, {"points": points, "place": place}, white)

    def dist(mean: TensorVariable, sd: TensorVariable, *inverse: Any) -> TensorVariable:
        return unwhitened(pm.Normal.dist(mean, sd), *inverse[:3])

    # One density for each point, given those before it, as LOO needs.
    return pm.CustomDist(
        "measured_pressure",
        mean,
        pt.zeros_like(mean) + as_double(sd),
        *(inputs[name] for name in ("blocks", "points", "place")),
        dist=dist,
        logp=logp,
        support_point=lambda _rv, _size, mean, _sd, *inverse: unwhitened(mean, *inverse),
        signature="(n),(n),(t,m,m),(k),(n)->(n)",
        **settings,
    )


def _offset_normal(
    tube: SymbolicTube, mean: TensorVariable, sd: Any, offset_sd: Any, **settings: Any
) -> TensorVariable:
    """Add forces about `mean` with independent errors and an offset that each test shares."""
    inputs = force_arrays(tube)

    def logp(
        value: Any, mean: TensorVariable, sd: TensorVariable, offset_sd: Any, *_: Any
    ) -> TensorVariable:
        possible = pt.isfinite(mean)
        error = pt.where(possible, value - mean, 0.0)
        log_density = log_density_by_points(error, pt.square(sd), offset_sd, inputs)
        return pt.where(possible, log_density, -np.inf)

    def dist(
        mean: TensorVariable, sd: TensorVariable, offset_sd: Any, test: Any, points: Any, _: Any
    ) -> TensorVariable:
        of_tests = pt.zeros_like(points.sum(axis=-1), dtype="float64")
        offset = pm.Normal.dist(of_tests, offset_sd)
        return pm.Normal.dist(mean + offset[test], sd)

    return pm.CustomDist(
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
