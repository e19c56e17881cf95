"""Draw curves with bands: the median of a posterior, an interval around it, and points beside it.

All figures of curves state each curve as a :class:`Curve`, in the units that are drawn.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from pymc_hyperelastic.evidence.checks import check_fraction
from pymc_hyperelastic.plots.style import LINE_STYLES, PALETTE, Canvas

Array = NDArray[np.float64]

# Rows of the array of a curve with a band, and of points.
BAND = ["x", "extrapolated", "y", "y_bottom", "y_top"]
POINTS = ["x", "y"]
# Draws, or simulations, of a band: the probability that it holds is then known to 1 %, and more
# draws change no line visibly.
DRAWS = 1000
# Points of a curve that is drawn smoothly.
CURVE_POINTS = 50
BAND_VISUALS = "band median extrapolated xlabel ylabel title legend"


class Curve(NamedTuple):
    """One curve of a figure."""

    variable: str
    labels: tuple[str, ...]
    """A label on each dimension by which curves of a variable differ."""
    rows: Array
    """Rows `BAND` or `POINTS` of the points of the curve."""


def band_rows(x: Array, draws: Array, ci_prob: float, extrapolated: ArrayLike = 0.0) -> Array:
    """Median and interval with equal tails of draws (chain, draw, point), as rows `BAND`.

    A point that no draw has is NaN.
    """
    check_fraction("ci_prob", ci_prob)
    draws = draws.reshape(-1, x.size)
    there = ~np.isnan(draws).all(axis=0)
    quantiles = np.full((3, x.size), np.nan)
    levels = [0.5, (1 - ci_prob) / 2, (1 + ci_prob) / 2]
    quantiles[:, there] = np.nanquantile(draws[:, there], levels, axis=0)
    return np.array([x, np.broadcast_to(extrapolated, x.shape), *quantiles])


def gathered(
    curves: Iterable[Curve], coords: Mapping[str, list[str]], axis: list[str]
) -> xr.Dataset:
    """Curves as variables with the dimensions of their labels, ``curve``, ``plot_axis``, ``point``.

    The dimension ``curve`` counts curves of equal labels. NaN stands where there is no curve, and
    after the end of short ones.
    """
    curves = list(curves)
    count = Counter((curve.variable, curve.labels) for curve in curves)
    longest = max((curve.rows.shape[1] for curve in curves), default=0)
    shape = *map(len, coords.values()), max(count.values(), default=0), len(axis), longest
    dims = (*coords, "curve", "plot_axis", "point")
    variables = {
        name: (dims, np.full(shape, np.nan)) for name in dict.fromkeys(c.variable for c in curves)
    }
    for curve in reversed(curves):
        key = curve.variable, curve.labels
        count[key] -= 1
        pairs = zip(coords.values(), curve.labels, strict=True)
        place: tuple[Any, ...] = tuple(of_dim.index(label) for of_dim, label in pairs)
        array = variables[curve.variable][1]
        array[*place, count[key], :, : curve.rows.shape[1]] = curve.rows
    return xr.Dataset(variables, {**coords, "plot_axis": axis})


def looks_of(dim: str) -> dict[str, Any]:
    """Settings of a PlotCollection whose curves differ by colour and line style along `dim`.

    Neighbours differ in both, so that they differ in grey, too.
    """
    aes = {"color": [dim], "linestyle": [dim], "overlay": ["curve"]}
    count = len(LINE_STYLES), len(PALETTE)
    return {"aes": aes, "color": PALETTE * count[0], "linestyle": LINE_STYLES * count[1]}


def draw_bands(canvas: Canvas, bands: xr.Dataset, ci_prob: float) -> dict[str, dict[str, Any]]:
    """Draw bands and medians, dashed where extrapolated; return their entries of a legend."""
    shape = {"linestyle", "marker"} & canvas.collection.aes_set
    band = bands.sel(plot_axis=["x", "y_bottom", "y_top"]).rename(plot_axis="kwarg")
    canvas.draw("band", "fill_between_y", data=band, alpha=0.3, linewidth=0, ignore_aes=shape)
    line = bands.sel(plot_axis=["x", "y"])
    beyond = bands.sel(plot_axis="extrapolated", drop=True)
    settings: dict[str, Any] = {"width": 1.5, "ignore_aes": shape - {"linestyle"}}
    canvas.draw("median", "line_xy", data=line.where(beyond != 1), **settings)
    # Grey stands for all colours.
    colour = "0.4" if len(canvas.collection.aes["color"]["mapping"]) > 1 else PALETTE[0]
    entries: dict[str, dict[str, Any]] = {
        "posterior median": {"color": colour, "linewidth": 1.5},
        f"{100 * ci_prob:.3g} % of the posterior": {"color": colour, "linewidth": 6, "alpha": 0.35},
    }
    if bool((beyond == 1).any().to_array().any()):
        # Dashes reach the first point that was measured.
        next_to = beyond.rolling(point=3, center=True, min_periods=1).max()
        settings = {"width": 1.5, "ignore_aes": shape, "linestyle": "--"}
        canvas.draw("extrapolated", "line_xy", data=line.where(next_to == 1), **settings)
        entries["extrapolated"] = {"color": colour, "linestyle": "--"}
    return entries
