"""A grid of panels, each of which may have strips below it that share its horizontal axis."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

# Panels side by side at most: a wider figure would not fit on a page.
_COLUMNS = 4


def columns_of(count: int) -> int:
    """Return the number of columns that leaves few places in the last row empty."""
    return -(-count // -(-count // _COLUMNS))


def panels_with_strips(
    data: xr.Dataset,
    places: list[dict[str, str]],
    backend: str,
    figure_kwargs: dict[str, Any],
    **settings: Any,
) -> PlotCollection:
    """Make a PlotCollection with a panel at each place, and its variables below each other.

    The ``height_ratios`` are those of the variables.
    """
    from arviz_plots import PlotCollection

    variables, columns = list(data.data_vars), columns_of(len(places))
    rows, count = -(-len(places) // columns), len(variables)
    heights = list(figure_kwargs["height_ratios"]) * rows
    figure, axes = import_module(f"arviz_plots.backend.{backend}").create_plotting_grid(
        rows * columns * count,
        rows * count,
        columns,
        squeeze=False,
        **figure_kwargs | {"height_ratios": heights},
    )
    coords = {dim: data[dim].values.tolist() for dim in places[0]}
    plots = {name: np.full([*map(len, coords.values())], None, object) for name in variables}
    for n in range(rows * columns):
        for i, name in enumerate(variables):
            target = axes[n // columns * count + i, n % columns]
            if n < len(places):
                at = tuple(coords[dim].index(label) for dim, label in places[n].items())
                plots[name][at] = target
            elif backend == "matplotlib":
                target.remove()
    arrays = {name: ([*coords], array) for name, array in plots.items()}
    viz = {
        "/": xr.Dataset({"figure": np.array(figure, object)}),
        "plot": xr.Dataset(arrays, coords),
    }
    return PlotCollection(data, xr.DataTree.from_dict(viz), backend=backend, **settings)
