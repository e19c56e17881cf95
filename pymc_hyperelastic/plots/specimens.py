"""Specimens beside the distribution of their class: what a class adds to their own curves."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.classes.shrinkage import specimens_beside_class
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.labels import quantity_label
from pymc_hyperelastic.plots.style import (
    LOG_FROM,
    Backend,
    Canvas,
    Visuals,
    fitted_classes,
    law_of,
    literal,
    log_axis,
    set_yticks,
    stacked,
    training_attrs,
)

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

    from pymc_hyperelastic.predictions.conditions import Conditions

_ROW = 0.27  # inches of a row
_GAP = 0.6  # rows between two classes
# Heights above and below the middle of a row: the curves alone, and those with the class.
_ALONE, _OWN = 0.2, -0.1
_EDGE = 0.5  # rows from the outermost specimens of a class to the ends of its band
# How far intervals of curves alone widen the axis at most, as a part of the range of all others.
_BEYOND = 0.4
_MARGIN = 0.03  # between the outermost value and the end of the axis, as a part of the range
_DARK, _PALE = "0.1", "0.6"


@one_thread
def plot_specimens(
    classes: xr.DataTree,
    quantity: str,
    *,
    at: Conditions | Any = None,
    ci_prob: float = 0.95,
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    """Plot a quantity of each specimen beside the distribution of its class.

    Each specimen has a row, class by class. The grey point is the posterior by the curves of the
    specimen alone, under a wide distribution of specimens. The coloured point is the posterior with
    the class: the less the curves say, the nearer the point is to the typical specimen (shrinkage).
    The last row of a class is its typical specimen; the band behind the rows holds a new specimen.
    Points are medians, and lines are intervals. The axis cuts off very wide grey intervals.

    Parameters
    ----------
    classes : xarray.DataTree
        Result of :func:`pymc_hyperelastic.fit_classes` with ``variability``, or one of its classes.
    quantity : str
        Parameter, coordinate or property, see :func:`pymc_hyperelastic.compare_classes`.
    at : Conditions, or array_like of a pressure in kPa, optional
        Conditions of a property, at one pressure. All specimens are compared in one tube.
    ci_prob : float
        Probability that the intervals and the band hold, with equal tails.
    backend, visuals, **pc_kwargs
        See :func:`~pymc_hyperelastic.plot_inflation`. The visuals are ``new`` (the band),
        ``alone_interval``, ``alone``, ``interval``, ``specimens``, ``typical_interval``,
        ``typical``, ``xlabel`` and ``legend``.

    Returns
    -------
    arviz_plots.PlotCollection
        Visuals have the dimensions ``class_label`` and, for specimens, ``specimen``.

    Raises
    ------
    TypeError, ValueError
        If `classes` has no variability, the quantity is unknown, a property has no pressure or
        several, or the backend or a visual is unknown.

    See Also
    --------
    fit_classes, compare_classes, plot_comparison

    Notes
    -----
    With an experiment effect, a specimen has the means of the coordinates of its tests.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> classes = ph.open_result("hierarchical.nc")  # saved from an example of fit_classes
    >>> figure = ph.plot_specimens(classes, "mu", backend="none")
    >>> figure.viz["typical"]["specimens"].sizes["class_label"]
    2
    """
    fitted = fitted_classes(classes)
    table = specimens_beside_class(xr.DataTree(children=fitted), quantity, at, ci_prob)
    table = table.rename(group="class_label")
    heights, ticks = _heights(table)
    canvas = Canvas(
        "wrap",
        table[["alone"]].rename(alone="specimens").isel(point=1).fillna(0.0),
        "new alone_interval alone interval specimens typical_interval typical xlabel legend",
        (backend, visuals, pc_kwargs),
        (6.2, _ROW * (max(ticks["values"]) - min(ticks["values"]) + 1) + 1.2),
        {},
        aes={"color": ["class_label"], "overlay": ["class_label", "specimen"]},
    )
    _draw(canvas, table, heights)
    canvas.adjust(set_yticks, **ticks)
    canvas.adjust("set_ylim", limits=(min(ticks["values"]) - _EDGE, _EDGE))
    ends = _limits(table)
    if 0 < LOG_FROM * ends[0] < ends[1]:
        canvas.adjust(log_axis, ends=ends, axis="x")
    canvas.adjust("set_xlim", limits=ends)
    law = law_of(next(iter(fitted.values())))
    canvas.label("xlabel", quantity_label(quantity, law))
    point = {"marker": "o", "markersize": 4}
    canvas.legend(
        {
            "by its own curves": point | {"color": _PALE, "linewidth": 0.9},
            "with its class": point | {"color": _DARK, "linewidth": 1.5},
            f"{100 * ci_prob:.3g} % of new specimens": {
                "color": _PALE,
                "linewidth": 6,
                "alpha": 0.4,
            },
        }
    )
    pressure, unit = table.attrs["pressure"], table.attrs["pressure_unit"]
    where = f"at {pressure:.4g} {unit}" if pressure else None
    held = f"median and {100 * ci_prob:.3g} % of the posterior"
    canvas.title(training_attrs(fitted), law, where, held)
    return canvas.collection


def _heights(table: xr.Dataset) -> tuple[xr.Dataset, dict[str, list]]:
    """Heights of the specimens and of the typical specimen of each class; ticks of the axis."""
    measured = table["alone"].notnull().any("point") | table["own"].notnull().any("point")
    rows = measured.cumsum("specimen").where(measured) - 1
    count = measured.sum("specimen")
    above = count.cumsum() - count + (1 + _GAP) * np.arange(count.size)
    rows, typical = -(rows + above), -(count + above)
    labels: dict[float, str] = {}
    for label in table["class_label"].values.tolist():
        for specimen in table["specimen"].values.tolist():
            height = float(rows.sel(class_label=label, specimen=specimen))
            if np.isfinite(height):
                labels[height] = literal(specimen)
        labels[float(typical.sel(class_label=label))] = f"typical {literal(label)}"
    heights = xr.Dataset({"rows": rows, "typical": typical, "top": -above})
    return heights, {"values": [*labels], "labels": [*labels.values()]}


def _draw(canvas: Canvas, table: xr.Dataset, heights: xr.Dataset) -> None:
    """Draw bands, specimens by themselves, specimens with their class, and typical specimens."""
    ends, y = table.isel(point=[0, 2]), heights["rows"]
    bottom, top = heights["typical"] - _EDGE, heights["top"] + _EDGE
    band = _stacked(x=ends["new"], y_bottom=bottom, y_top=top).rename(plot_axis="kwarg")
    canvas.draw("new", "fill_between_y", data=band, alpha=0.15, linewidth=0, ignore_aes={"overlay"})
    plain: dict[str, Any] = {"color": _PALE, "ignore_aes": {"color"}}
    line, point = _stacked(x=ends["alone"], y=y + _ALONE), table["alone"].isel(point=1)
    canvas.draw("alone_interval", "line_xy", data=line, width=0.9, **plain)
    canvas.draw("alone", "scatter_xy", data=_stacked(x=point, y=y + _ALONE), size=8, **plain)
    line, point = _stacked(x=ends["own"], y=y + _OWN), table["own"].isel(point=1)
    canvas.draw("interval", "line_xy", data=line, width=1.5)
    canvas.draw("specimens", "scatter_xy", data=_stacked(x=point, y=y + _OWN), size=18)
    y, of_class = heights["typical"], {"ignore_aes": {"overlay"}}
    line, point = _stacked(x=ends["typical"], y=y), table["typical"].isel(point=1)
    canvas.draw("typical_interval", "line_xy", data=line, width=2.5, **of_class)
    data = _stacked(x=point, y=y)
    canvas.draw("typical", "scatter_xy", data=data, size=34, marker="s", **of_class)


def _stacked(**arrays: xr.DataArray) -> xr.Dataset:
    return stacked("specimens", **arrays)


def _limits(table: xr.Dataset) -> tuple[float, float]:
    """Ends of the horizontal axis, which cuts very wide intervals of curves alone."""
    with_class = np.concatenate([table[name].values.ravel() for name in ("own", "typical", "new")])
    ends = np.array([np.nanmin(with_class), np.nanmax(with_class)])
    by_log = 0 < LOG_FROM * ends[0] < ends[1]
    forth, back = (np.log, np.exp) if by_log else (np.array, np.array)
    ends, alone = forth(ends), table["alone"].values
    # The logarithm of a number that is not positive would be beyond all axes.
    alone = forth(np.maximum(alone, np.finfo(float).tiny) if by_log else alone)
    widest = ends + _BEYOND * np.ptp(ends) * np.array([-1, 1])
    low, high = np.clip([np.nanmin(alone), np.nanmax(alone)], *widest)
    low, high = min(low, ends[0]), max(high, ends[1])
    margin = _MARGIN * (high - low)
    return float(back(low - margin)), float(back(high + margin))
