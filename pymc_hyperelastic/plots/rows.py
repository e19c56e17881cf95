"""Draw rows of points with intervals: laws, groups or planned tests by two measures."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.plots.labels import axis_label
from pymc_hyperelastic.plots.style import Canvas, Wishes, few_ticks, literal, set_yticks, stacked

_MARGIN = 0.6  # from the first and the last row to the ends of the axis, in rows


def row_panels(
    data: xr.Dataset, known: str, wishes: Wishes, labels: list[str], inches: float, **settings: Any
) -> Canvas:
    """Two panels, along dimension ``panel`` of the data, with rows of this height.

    The first row is on top, at height 0; the others are at -1, -2 and so on.
    """
    longest = max(len(line) for label in labels for line in label.splitlines())
    size = (6.6 + 0.075 * longest, inches * len(labels) + 1.4)
    layout = {"cols": ["panel"], "col_wrap": 2} | settings
    canvas = Canvas("wrap", data, known, wishes, size, {"sharey": True}, **layout)
    panels = [str(name) for name in data["panel"].values]
    row_ticks(canvas, labels, coords={"panel": panels[0]})
    canvas.adjust(few_ticks, intervals=5)
    for panel in panels:
        canvas.label("xlabel", axis_label(panel), coords={"panel": panel})
    return canvas


def row_ticks(canvas: Canvas, labels: list[str], **where: Any) -> None:
    """Name the rows on the vertical axis of panels, and leave room for the first and the last."""
    canvas.adjust("set_ylim", limits=(_MARGIN - len(labels), _MARGIN))
    rows = {"values": [-i for i in range(len(labels))], "labels": [*map(literal, labels)]}
    canvas.adjust(set_yticks, **rows, **where)


def heights(dim: str, count: int) -> xr.DataArray:
    """Heights of the rows."""
    return xr.DataArray(-np.arange(float(count)), dims=dim)


def draw_points(
    canvas: Canvas, name: str, x: xr.DataArray, y: xr.DataArray, **settings: Any
) -> None:
    """Draw a visual of points, where `x` is not NaN."""
    data = stacked(*canvas.collection.data.data_vars, x=x, y=y.where(x.notnull()))
    canvas.draw(name, "scatter_xy", data=data, **{"size": 22} | settings)


def draw_lines(
    canvas: Canvas,
    name: str,
    ends: tuple[xr.DataArray, xr.DataArray],
    y: xr.DataArray,
    **settings: Any,
) -> None:
    """Draw a visual of horizontal lines between two ends, where these are not NaN."""
    x = xr.concat(ends, dim="end", coords="minimal", compat="override")
    data = stacked(*canvas.collection.data.data_vars, x=x, y=y.where(x.notnull()))
    canvas.draw(name, "line_xy", data=data, **{"width": 1.3} | settings)


def draw_verticals(canvas: Canvas, name: str, x: dict[str, float]) -> None:
    """Draw a grey line across all rows of each panel, unless its place is NaN."""
    (variable,) = canvas.collection.data.data_vars
    places = xr.DataArray(list(x.values()), {"panel": list(x)}, "panel").to_dataset(name=variable)
    canvas.draw(name, "vline", data=places, ignore_aes="all", color="0.6", width=0.8)
