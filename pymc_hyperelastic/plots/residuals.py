"""Standardised residuals: measured minus fitted values, in standard deviations of the noise.

The errors are those of the likelihood of the fit. An error of the radius, or of the diameter,
shifts pressure and force by the slope of their curves, to first order, see
:class:`~pymc_hyperelastic.Gaussian`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from pymc_hyperelastic.models.forward import TubeNumbers
from pymc_hyperelastic.models.likelihoods import Likelihood
from pymc_hyperelastic.models.likelihoods.errors import Errors
from pymc_hyperelastic.models.settings import model_settings_of
from pymc_hyperelastic.plots.curves import Array
from pymc_hyperelastic.predictions.draws import Draws
from pymc_hyperelastic.predictions.sheets import SheetDraws


class Points(NamedTuple):
    """Tubes of a posterior at measured points, arrays (chain, draw, point) or broadcastable."""

    tube: TubeNumbers
    radius: Array
    """Measured internal radii, mm, of each draw if they follow from outer diameters."""
    tests: xr.Dataset
    slopes: Array
    """Slopes of the measured pressures, kPa/mm, (point); NaN at the ends of tests."""


def likelihood_of(tree: xr.DataTree) -> Likelihood | None:
    """Return the likelihood of a result; None if the result does not state it."""
    settings = model_settings_of(tree)
    return None if settings is None else settings.make_likelihood()


def knows_noise(tree: xr.DataTree) -> bool:
    """Return True if a result states its likelihood, and has the sizes of all errors."""
    likelihood = likelihood_of(tree)
    return likelihood is not None and {*likelihood.unknowns} <= {*tree["posterior"].data_vars}


def errors_of(tree: xr.DataTree, draws: Draws | SheetDraws) -> Errors | None:
    """Return the sizes of errors, as arrays (chain, draw, 1); None if the result lacks them.

    Inferred sizes are those of the specimen; without its draws they are those of the class.
    """
    likelihood, sizes = likelihood_of(tree), {}
    if likelihood is None or not knows_noise(tree):
        return None
    for name in likelihood.unknowns:
        holder = draws.member.posterior
        holder = holder if name in holder else tree["posterior"].to_dataset()
        sizes[name] = holder[name].transpose("chain", "draw").values[..., None]
    return likelihood.errors(sizes)


def residuals_of(signal: str, points: Points, errors: Errors) -> Array:
    """Return the posterior median of the standardised residual of each point, (point).

    It is positive where the measured point lies above the curve of the figure.
    """
    tests, tube, radius = points.tests, points.tube, points.radius
    if signal in ("axial_force", "extension_force"):
        noise = _force_sd(points, errors)
        residuals = (tests["axial_force"].values - tube.axial_force(radius)) / noise
    else:
        pressure, slope = tube.pressure(radius)
        if signal == "stiffness":
            noise = errors.pressure_sd / np.sqrt(errors.slope_weight)
            residuals = (points.slopes - slope) / noise
            if "outer_diameter" in tests:
                # The likelihood has slopes by the outer radius b, and a da = b db.
                residuals = residuals * tests["outer_diameter"].values / (2 * radius)
        else:
            pressure_sd = 0.0 if errors.pressure_sd is None else errors.pressure_sd
            noise = np.hypot(pressure_sd, _radius_sd(errors) * slope)
            residuals = (tests["pressure"].values - pressure) / noise
            # A radius above its curve is a pressure below its own.
            residuals = -residuals if signal == "extension_radius" else residuals
    return np.median(residuals, axis=(0, 1))


def offsets_of(points: Points, errors: Errors) -> Array:
    """Return the posterior mean of each test's force offset, at its points, mN, (point).

    Each draw has the mean of :func:`~pymc_hyperelastic.force_offsets`.
    """
    tests = points.tests
    force = tests["axial_force"].values
    error = force - points.tube.axial_force(points.radius)
    weight = np.where(np.isfinite(force), 1 / _force_sd(points, errors) ** 2, 0.0)
    weight = np.broadcast_to(weight, error.shape)
    members = tests["test"].values == np.arange(tests.sizes["test"])[:, None]
    precision = weight @ members.T + 1 / errors.force_offset_sd**2
    mean = (np.nan_to_num(error) * weight) @ members.T / precision
    return mean.mean(axis=(0, 1))[tests["test"].values]


def _radius_sd(errors: Errors) -> Any:
    """Standard deviation of the measured radius, mm; 0 if it has no error."""
    if errors.radius_sd is not None:
        return errors.radius_sd
    return 0.0 if errors.diameter_sd is None else errors.diameter_sd / 2


def _force_sd(points: Points, errors: Errors) -> Any:
    """Standard deviation of the difference of measured and fitted forces, mN."""
    radius_sd = _radius_sd(errors)
    if not np.any(radius_sd):
        return errors.force_sd
    slope = slope_of(points.tube.axial_force, points.radius)
    return np.hypot(errors.force_sd, radius_sd * slope)


def slope_of(curve: Callable[[Array], Array], x: Array) -> Array:
    """Return the slope of a curve at `x` as a central difference."""
    step = 1e-4 * x  # the relative error of the slope is about the square of this relative step
    return (curve(x + step) - curve(x - step)) / (2 * step)
