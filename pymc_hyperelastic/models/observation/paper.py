"""The paper's likelihood: misfits of pressure and slope, normalised as a density of pressures."""

from collections.abc import Mapping
from functools import reduce
from operator import and_
from typing import Any

import numpy as np
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.graph.basic import Variable
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.models.forward import ForwardModel
from pymc_hyperelastic.models.observation.slopes import (
    central_differences,
    compressed_spectrum,
    half_log_determinant,
    measured_slopes,
    with_slopes,
)

__all__ = ["paper_log_likelihood"]

Array = NDArray[np.float64]


def paper_log_likelihood(
    forward: ForwardModel,
    parameters: Mapping[str, Any],
    geometry: Mapping[str, Any],
    *,
    sigma: Any,
    slope_weight: Any,
    force_sigma: Any,
    error_in: str,
) -> TensorVariable:
    """Log-likelihood of :func:`~pymc_hyperelastic.inflation_likelihood`, of the forward's data."""
    slopes, forces = with_slopes(slope_weight), force_sigma is not None
    unknown_weight = isinstance(slope_weight, Variable)

    def targets_of(data: xr.Dataset) -> dict[str, Array]:
        targets = {"pressure": data["pressure"].values.astype(float)}
        if slopes:
            targets["slope"] = np.full(data.sizes["obs"], np.nan)
            targets["slope"][central_differences(data)[0]] = measured_slopes(data)
        if forces:
            targets["force"] = data["axial_force"].values.astype(float)
        return targets

    def normalisers_of(data: xr.Dataset) -> dict[str, Array]:
        arrays = {"points": np.array(float(data.sizes["obs"]))}
        if unknown_weight:
            arrays["eigenvalues"], arrays["multiplicities"] = compressed_spectrum(data)
        elif slopes:
            arrays["half_log_determinant"] = np.array(half_log_determinant(data, slope_weight))
        if forces:
            measured = np.isfinite(data["axial_force"].values.astype(float))
            arrays["forces"] = np.array(float(measured.sum()))
        return arrays

    key = slopes, forces
    squares, conditions = forward.misfits(key, targets_of, parameters, geometry)
    weight = None if unknown_weight else float(slope_weight)
    inputs = forward.share(("normalisers", weight, forces), normalisers_of)
    log_density = -inputs["points"] / 2 * pt.log(np.pi * pt.square(sigma))
    log_density -= squares[error_in] / pt.square(sigma)
    if slopes:
        log_density -= slope_weight * squares["slope"] / pt.square(sigma)
        if unknown_weight:
            logs = pt.log1p(slope_weight * inputs["eigenvalues"])
            log_density += pt.sum(inputs["multiplicities"] * logs) / 2
        else:
            log_density += inputs["half_log_determinant"]
    if forces:
        log_density -= inputs["forces"] / 2 * pt.log(np.pi * pt.square(force_sigma))
        log_density -= squares["force"] / pt.square(force_sigma)
    return pt.where(reduce(and_, conditions), log_density, -np.inf)
