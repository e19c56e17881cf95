"""Outer diameters that a posterior predicts, as they would be measured."""

import warnings

import numpy as np
import xarray as xr

import pymc_hyperelastic as ph


def predicted_diameter(
    tree: xr.DataTree, pressure: np.ndarray, rng: np.random.Generator, **tube: float
) -> list[np.ndarray]:
    """Outer diameter (µm) at pressures in kPa: median, and ends of 95 % of measurements.

    An error of pressure moves the inner radius by 1/stiffness, and the outer one, as the wall keeps
    its area, by inner/outer of that. σ is √2 standard deviations. Draws whose curve ends below a
    pressure are left out there.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "of .* draws .* do not reach")
        inflated = ph.tube_properties(tree, pressure, **tube)
    sigma = tree["posterior"]["sigma"]
    error = sigma / np.sqrt(2) * sigma.copy(data=rng.normal(size=sigma.shape))
    outer = inflated["outer_radius"]
    measured = outer + inflated["radius"] / (outer * inflated["stiffness"]) * error
    low, high = measured.quantile([0.025, 0.975], dim=("chain", "draw")).values
    return [2e3 * radius for radius in (outer.median(dim=("chain", "draw")).values, low, high)]
