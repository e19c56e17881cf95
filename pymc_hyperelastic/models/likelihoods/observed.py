"""The likelihood as observed variables: measured pressures and axial forces."""

from collections.abc import Callable, Mapping
from functools import reduce
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
    force_arrays,
    measured,
    rows_of_forces,
    signals_of,
)
from pymc_hyperelastic.models.likelihoods.slopes import central_differences, precision_root

Array = NDArray[np.float64]
Bound = Callable[[TensorVariable], TensorVariable]
"""A function of means that makes those of an impossible tube infinite."""


def register_measurements(
    tube: SymbolicTube,
    curves: Mapping[str, TensorVariable],
    errors: Errors,
    dims: str | None = "obs",
) -> None:
    """Add the measured pressures, and forces, as observed variables.

    Each point has a log density, given the points before it in its test. With an error of the
    diameter forces are given the pressures, too. If curves overflow, or the tube is impossible,
    means are infinite and the log-likelihood is ``−inf``.
    """
    conditions = tube.conditions()

    def bound(mean: TensorVariable) -> TensorVariable:
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
    tube: SymbolicTube, pressure: TensorVariable, errors: Errors, bound: Bound, **settings: Any
) -> TensorVariable:
    r"""Add pressures ``y`` whose errors are correlated by slopes.

    With ``m`` and ``s`` the model's pressures and slopes,

    .. math:: y \sim \mathcal{N}\big(\tilde μ, σ^2 (B^T B)^{-1}\big), \qquad
        B^T B = I + β D^T D, \qquad B^T B \tilde μ = m + β D^T s

    ``B`` is lower triangular and ``(B y − B μ̃)/σ`` standard normal: entry ``i`` of its log-density,
    with ``ln B_ii``, is ``ln p(y_i | the y before)``.
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

    def logp(value: Any, mean: TensorVariable, sd: TensorVariable, *_: Any) -> TensorVariable:
        # The first two of each test have the factor 0, so that no value of another test counts.
        white = inputs["diagonal"] * value + inputs["before"] * pt.roll(value, 2, axis=-1)
        # Otherwise the gradient by the standard deviation would be infinite where a mean is.
        possible = pt.isfinite(mean)
        square = pt.square(pt.where(possible, white - mean, 0.0))
        log_density = pt.log(inputs["diagonal"]) + normal_log_density(square, pt.square(sd))
        return pt.where(possible, log_density, -np.inf)

    def unwhitened(white: TensorVariable, blocks: Any, points: Any, place: Any) -> TensorVariable:
        return block_product(blocks, {"points": points, "place": place}, white)

    def dist(mean: TensorVariable, sd: TensorVariable, *inverse: Any) -> TensorVariable:
        return unwhitened(pm.Normal.dist(mean, sd), *inverse[:3])

    return pm.CustomDist(
        "measured_pressure",
        white_mean,
        pt.zeros_like(white_mean) + as_double(errors.pressure_sd),
        *(inputs[name] for name in ("blocks", "points", "place")),
        dist=dist,
        logp=logp,
        support_point=lambda _rv, _size, mean, _sd, *inverse: unwhitened(mean, *inverse),
        signature="(n),(n),(t,m,m),(k),(n)->(n)",
        **settings,
    )


def _offset_normal(
    tube: SymbolicTube, mean: TensorVariable, sd: Any, offset_sd: Any, **settings: Any
) -> None:
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
