"""Bands of posterior curves over the axial stretch of extension tests."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.inflation import (
    at_points,
    evenly_along,
    extension_tests,
    points_of,
)
from pymc_hyperelastic.evidence.results import thinned_draws
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.plots.style import median_and_band
from pymc_hyperelastic.predictions.draws import Draws, GivenTube, draws_of

Array = NDArray[np.float64]
# From draws and the radii that they have along a test, curves in the units that are drawn.
Along = Callable[[Draws, Array], dict[str, Array]]

# Axial stretches of a test at which its band is drawn, and draws of which it is made: at each, the
# radius at the measured pressure is found by Newton's method.
_STRETCHES, _DRAWS = 24, 500


def extension_curves(
    tree: xr.DataTree, data: xr.Dataset, prob: float, material: GivenTube, along: Along
) -> Iterator[tuple[int, dict[str, float], dict[str, Array]]]:
    """Each extension test of data, medians of what is inferred of its tube, and its curves.

    The radius of a draw is that at the pressure which was measured there, or between the points.
    Rows of a curve are stretch, whether it is extrapolated, median and both ends of the band.
    """
    extended = np.flatnonzero(extension_tests(data)).tolist()
    thinned = thinned_draws(tree, _DRAWS) if extended else tree
    for test in extended:
        stretch, pressure = _path(data, test)
        values = {n: float(data[n].values[test]) for n in GEOMETRY if n != "axial_stretch"}
        known: Any = {name: value for name, value in values.items() if np.isfinite(value)}
        draws = draws_of(thinned, **material, **known | {"axial_stretch": stretch})
        radius = draws.radius_at(pressure)
        beyond = draws.extrapolated_pressures(pressure, radius, "kPa")
        extrapolated = np.zeros(stretch.size) if beyond is None else beyond.points.astype(float)
        curves = {
            name: np.array([stretch, extrapolated, *_quantiles(curve, prob)])
            for name, curve in along(draws, radius).items()
        }
        yield test, draws.inferred, curves


def is_over_stretch(name: str) -> bool:
    """Whether a variable of a figure is drawn over the axial stretch, and not over the radius."""
    return name.startswith("extension_")


def points_over(data: xr.Dataset, x: Array, y: Array, *, extension: bool) -> Array:
    """Points (axis, point) of tests of one kind; NaN is in place of those of the other."""
    of_extension = extension_tests(data)[data["test"].values]
    return np.where(of_extension == extension, [x, y], np.nan)


def _path(data: xr.Dataset, test: int) -> tuple[Array, Array]:
    """Axial stretches spread evenly over a test, and the pressures there."""
    points = points_of(data, test)
    stretch, pressure = at_points(data, "axial_stretch")[points], data["pressure"].values[points]
    return evenly_along(stretch, stretch, _STRETCHES), evenly_along(stretch, pressure, _STRETCHES)


def _quantiles(curve: Array, prob: float) -> Array:
    """Quantiles of draws (chain, draw, point); of those that reach the pressure, if any do."""
    reached = np.isfinite(curve).any(axis=(0, 1))
    quantiles = np.full((3, reached.size), np.nan)
    draws = curve[..., reached].reshape(-1, int(reached.sum()))
    quantiles[:, reached] = np.nanquantile(draws, median_and_band(prob), axis=0)
    return quantiles
