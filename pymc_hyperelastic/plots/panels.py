"""Panels side by side: columns, sizes, and strips below panels that share their horizontal axis."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

# Panels of a figure that are shown unless the user chooses others: six rows of four.
MOST_PANELS = 24


def columns_of(count: int, most: int) -> int:
    """Return the number of columns, `most` at most, that fills the last row best."""
    return -(-count // -(-count // most))


def size_of(count: int, columns: int) -> tuple[float, float]:
    """Return the size in inches of a figure of panels with labels, a title and a legend."""
    return max(3 * columns + 0.2, 4.4), 2.7 * -(-count // columns) + 0.5


def evenly(count: int, most: int) -> list[int]:
    """Return places of `count` things, evenly from all if there are more than `most`."""
    return np.linspace(0, count - 1, min(count, most)).round().astype(int).tolist()


def panels_with_strips(
    data: xr.Dataset,
    places: list[dict[str, str]],
    columns: int,
    backend: str,
    figure_kwargs: dict[str, Any],
    **settings: Any,
) -> PlotCollection:
    """Make a PlotCollection with a panel at each place, and its variables below each other.

    The ``height_ratios`` are those of the variables.
    """
    from arviz_plots import PlotCollection

    variables, rows = list(data.data_vars), -(-len(places) // columns)
    heights = list(figure_kwargs["height_ratios"]) * rows
    shape = rows * len(variables), columns
    figure, axes = import_module(f"arviz_plots.backend.{backend}").create_plotting_grid(
        shape[0] * columns, *shape, squeeze=False, **figure_kwargs | {"height_ratios": heights}
    )
    coords = {dim: data[dim].values.tolist() for dim in places[0]}
    plots = {name: np.full([*map(len, coords.values())], None, object) for name in variables}
    for i, name in enumerate(variables):
        targets = axes[i :: len(variables)].ravel()
        for place, target in zip(places, targets, strict=False):
            plots[name][tuple(coords[dim].index(label) for dim, label in place.items())] = target
        for target in targets[len(places) :] if backend == "matplotlib" else ():
            target.remove()
    arrays = {name: ([*coords], array) for name, array in plots.items()}
    viz = {
        "/": xr.Dataset({"figure": np.array(figure, object)}),
        "plot": xr.Dataset(arrays, coords),
    }
    return PlotCollection(data, xr.DataTree.from_dict(viz), backend=backend, **settings)
