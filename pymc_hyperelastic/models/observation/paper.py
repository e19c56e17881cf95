"""The paper's likelihood: misfits of pressure and slope, normalised as a density of pressures."""

from functools import reduce
from operator import and_
from typing import Any

import numpy as np
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.graph.basic import Variable
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.models.forward import SymbolicTube
from pymc_hyperelastic.models.observation.signals import (
    as_double,
    log_likelihood_by_points,
    rows_of_forces,
)
from pymc_hyperelastic.models.observation.slopes import (
    central_differences,
    compressed_spectrum,
    half_log_determinant,
    measured_slopes,
    with_slopes,
)

Array = NDArray[np.float64]


def paper_log_likelihood(
    tube: SymbolicTube,
    *,
    sigma: Any,
    slope_weight: Any,
    force_sigma: Any = None,
    force_offset_sd: Any = None,
    diameter_noise_sd: Any = None,
) -> TensorVariable:
    """Log-likelihood of :func:`~pymc_hyperelastic.inflation_likelihood`, of the tube's data."""
    if diameter_noise_sd is not None:
        errors = {"sigma": sigma, "force_sigma": force_sigma}
        errors |= {"force_offset_sd": force_offset_sd, "diameter_noise_sd": diameter_noise_sd}
        return log_likelihood_by_points(tube, **errors)
    slopes, forces = with_slopes(slope_weight), force_sigma is not None
    offsets = force_offset_sd is not None
    unknown_weight = isinstance(slope_weight, Variable)

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

    def normalisers_of(data: xr.Dataset) -> dict[str, Array]:
        arrays = {"points": np.array(float(data.sizes["obs"]))}
        if unknown_weight:
            arrays["eigenvalues"], arrays["multiplicities"] = compressed_spectrum(data)
        elif slopes:
            arrays["half_log_determinant"] = np.array(half_log_determinant(data, slope_weight))
        if forces:
            test = data["test"].values[rows_of_forces(data)]
            arrays["forces"] = np.bincount(test, minlength=data.sizes["test"]).astype(float)
        return arrays

    forward = tube.forward
    squares, conditions, force_sums = tube.misfits((slopes, forces, offsets), targets_of)
    weight = None if unknown_weight else float(slope_weight)
    inputs = forward.share(("normalisers", weight, forces), normalisers_of)
    log_density = -inputs["points"] / 2 * pt.log(np.pi * pt.square(sigma))
    log_density -= squares[forward.error_in] / pt.square(sigma)
    if slopes:
        log_density -= slope_weight * squares["slope"] / pt.square(sigma)
        if unknown_weight:
            logs = pt.log1p(slope_weight * inputs["eigenvalues"])
            log_density += pt.sum(inputs["multiplicities"] * logs) / 2
        else:
            log_density += inputs["half_log_determinant"]
    if forces:
        log_density -= pt.sum(inputs["forces"]) / 2 * pt.log(np.pi * pt.square(force_sigma))
        log_density -= squares["force"] / pt.square(force_sigma)
    if force_sums is not None:
        # Of σ_F²/2 I + s² 1 1ᵀ, of each test, by the lemmas of Woodbury and of the determinant.
        prior, variance = pt.square(as_double(force_offset_sd)), pt.square(force_sigma) / 2
        total = variance + inputs["forces"] * prior
        log_density -= pt.sum(pt.log(total / variance)) / 2
        log_density += pt.sum(prior * pt.square(force_sums) / (variance * total)) / 2
    return pt.where(reduce(and_, conditions), log_density, -np.inf)
