"""Rows of points with intervals: laws, groups or planned tests by two measures."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.plots.labels import axis_label
from pymc_hyperelastic.plots.style import DOUBT, Canvas, Wishes, inches_of, literal


def row_panels(
    data: xr.Dataset, known: str, wishes: Wishes, labels: list[str], inches: float, **settings: Any
) -> Canvas:
    """Two panels, along dimension ``panel`` of the data, with rows of this height.

    The first row is on top, at height 0; the others are at -1, -2 and so on.
    """
    size = (6.6 + inches_of(labels), inches * len(labels) + 1.4)
    layout = {"cols": ["panel"], "col_wrap": 2} | settings
    canvas = Canvas("wrap", data, known, wishes, size, {"sharey": True}, **layout)
    panels = [str(name) for name in data["panel"].values]
    row_ticks(canvas, labels, coords={"panel": panels[0]})
    canvas.few_xticks(5)
    for panel in panels:
        canvas.label("xlabel", axis_label(panel), coords={"panel": panel})
    return canvas


def row_ticks(canvas: Canvas, labels: list[str], **where: Any) -> None:
    """Name the rows on the vertical axis of panels, and leave room for the first and the last."""
    canvas.adjust("set_ylim", limits=(0.6 - len(labels), 0.6))
    canvas.set_yticks([-i for i in range(len(labels))], [*map(literal, labels)], **where)


def heights(dim: str, count: int) -> xr.DataArray:
    """Heights of the rows."""
    return xr.DataArray(-np.arange(float(count)), dims=dim)


def joined(*ends: xr.DataArray) -> xr.DataArray:
    """Ends of lines, along dimension ``end``."""
    return xr.concat(ends, dim="end", coords="minimal", compat="override")


def write(
    canvas: Canvas,
    name: str,
    places: tuple[xr.DataArray, xr.DataArray],
    text: xr.DataArray,
    known: xr.DataArray,
    **settings: Any,
) -> None:
    """Write texts on the right of some places, in another colour where no answer is known."""

    def annotate(da: xr.DataArray, target: Any, text: Any, known: Any, **settings: Any) -> Any:
        from arviz_plots.visuals import annotate_xy

        settings = {"color": "0.1" if known.item() else DOUBT} | settings
        return annotate_xy(da, target, text=literal(text.item()), **settings)

    align: dict[str, Any] = {"horizontal_align": "left", "vertical_align": "center", "size": 9}
    content = {"function": annotate, "text": text, "known": known}
    canvas.draw_xy(name, x=places[0], y=places[1], **content, **align, **settings)
