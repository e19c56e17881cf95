"""The paper's likelihood: misfits of pressure and slope, normalised as a density of pressures."""

from collections.abc import Mapping
from functools import reduce
from operator import add, and_
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
    switches: Mapping[str, Any] | None = None,
) -> TensorVariable:
    r"""Log-likelihood of :func:`~pymc_hyperelastic.inflation_likelihood`, of the tube's data.

    With `switches` it is that of the signals ``"pressure"``, ``"slope"`` and ``"force"`` whose
    switch is not 0. Slopes beside their pressures have the normaliser ``½ ln det(I + β DᵀD)``.
    Alone they are taken as ``N_s`` independent numbers, or where ``σ`` and ``β`` are inferred they
    would speak for any that are large:

    .. math:: -\frac{β}{σ^2} |Δs|^2 - \frac{N_s}{2} \ln\frac{π σ^2}{β}
    """
    if diameter_noise_sd is not None:
        errors = {"sigma": sigma, "force_sigma": force_sigma}
        errors |= {"force_offset_sd": force_offset_sd, "diameter_noise_sd": diameter_noise_sd}
        return log_likelihood_by_points(tube, switches=switches, **errors)
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
        if slopes:
            arrays["slopes"] = np.array(float(central_differences(data)[0].size))
        if forces:
            test = data["test"].values[rows_of_forces(data)]
            arrays["forces"] = np.bincount(test, minlength=data.sizes["test"]).astype(float)
        return arrays

    forward = tube.forward
    squares, conditions, force_sums = tube.misfits((slopes, forces, offsets), targets_of)
    weight = None if unknown_weight else float(slope_weight)
    inputs = forward.share(("normalisers", weight, forces), normalisers_of)
    log_area = pt.log(np.pi * pt.square(sigma))
    terms = {"pressure": -inputs["points"] / 2 * log_area}
    terms["pressure"] -= squares[forward.error_in] / pt.square(sigma)
    if slopes:
        terms["slope"] = -slope_weight * squares["slope"] / pt.square(sigma)
        if unknown_weight:
            logs = pt.log1p(slope_weight * inputs["eigenvalues"])
            beside = pt.sum(inputs["multiplicities"] * logs) / 2
        else:
            beside = inputs["half_log_determinant"]
        if switches is not None:
            log_weight = pt.log(pt.as_tensor(slope_weight, dtype="float64"))
            alone = inputs["slopes"] / 2 * (log_weight - log_area)
            beside = pt.where(switches["pressure"], beside, alone)
        terms["slope"] += beside
    if forces:
        terms["force"] = -pt.sum(inputs["forces"]) / 2 * pt.log(np.pi * pt.square(force_sigma))
        terms["force"] -= squares["force"] / pt.square(force_sigma)
    if force_sums is not None:
        # Of σ_F²/2 I + s² 1 1ᵀ, of each test, by the lemmas of Woodbury and of the determinant.
        prior, variance = pt.square(as_double(force_offset_sd)), pt.square(force_sigma) / 2
        total = variance + inputs["forces"] * prior
        terms["force"] -= pt.sum(pt.log(total / variance)) / 2
        terms["force"] += pt.sum(prior * pt.square(force_sums) / (variance * total)) / 2
    if switches is not None:
        terms = {name: pt.where(switches[name], term, 0.0) for name, term in terms.items()}
    return pt.where(reduce(and_, conditions), reduce(add, terms.values()), -np.inf)
