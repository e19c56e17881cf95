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
    stacked,
    with_margin,
)

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

    from pymc_hyperelastic.predictions.conditions import Conditions

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
        (6.2, 0.27 * (max(ticks["values"]) - min(ticks["values"]) + 1) + 1.2),
        {},
        aes={"color": ["class_label"], "overlay": ["class_label", "specimen"]},
    )
    _draw(canvas, table, heights)
    canvas.set_yticks(**ticks)
    canvas.adjust("set_ylim", limits=(min(ticks["values"]) - 0.5, 0.5))
    ends = _limits(table)
    canvas.limit("x", ends, log=0 < LOG_FROM * ends[0] < ends[1])
    law = law_of(next(iter(fitted.values())), None)
    canvas.label("xlabel", quantity_label(quantity, law))
    point = {"marker": "o", "markersize": 4}
    entries = {
        "by its own curves": point | {"color": _PALE, "linewidth": 0.9},
        "with its class": point | {"color": _DARK, "linewidth": 1.5},
    }
    band = {"color": _PALE, "linewidth": 6, "alpha": 0.4}
    canvas.legend(entries | {f"{100 * ci_prob:.3g} % of new specimens": band})
    pressure, unit = table.attrs["pressure"], table.attrs["pressure_unit"]
    where = f"at {pressure:.4g} {unit}" if pressure else None
    held = f"median and {100 * ci_prob:.3g} % of the posterior"
    canvas.title_of_fits(fitted, None, where, held)
    return canvas.collection


def _heights(table: xr.Dataset) -> tuple[xr.Dataset, dict[str, list]]:
    """Heights of the specimens and of the typical specimen of each class; ticks of the axis."""
    measured = table["alone"].notnull().any("point") | table["own"].notnull().any("point")
    rows = measured.cumsum("specimen").where(measured) - 1
    count = measured.sum("specimen")
    # Each class has one more row, and a gap below it.
    above = count.cumsum() - count + 1.6 * np.arange(count.size)
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
    ends, middle = table.isel(point=[0, 2]), table.isel(point=1)
    bottom, top = heights["typical"] - 0.5, heights["top"] + 0.5
    band = stacked("specimens", x=ends["new"], y_bottom=bottom, y_top=top).rename(plot_axis="kwarg")
    canvas.draw("new", "fill_between_y", data=band, alpha=0.15, linewidth=0, ignore_aes={"overlay"})
    plain: dict[str, Any] = {"color": _PALE, "ignore_aes": {"color"}}
    of_class: dict[str, Any] = {"ignore_aes": {"overlay"}}
    above, below = heights["rows"] + 0.2, heights["rows"] - 0.1
    for line, points, column, y, width, size, settings in (
        ("alone_interval", "alone", "alone", above, 0.9, 8, plain),
        ("interval", "specimens", "own", below, 1.5, 18, {}),
        ("typical_interval", "typical", "typical", heights["typical"], 2.5, 34, of_class),
    ):
        canvas.draw_xy(line, "line_xy", ends[column], y, width=width, **settings)
        marker = {"marker": "s"} if column == "typical" else {}
        canvas.draw_xy(points, "scatter_xy", middle[column], y, size=size, **marker, **settings)


def _limits(table: xr.Dataset) -> tuple[float, float]:
    """Ends of the horizontal axis, which cuts very wide intervals of curves alone.

    These widen the axis by two fifths of the range of all others on each side at most.
    """
    with_class = np.concatenate([table[name].values.ravel() for name in ("own", "typical", "new")])
    ends = np.array([np.nanmin(with_class), np.nanmax(with_class)])
    by_log = 0 < LOG_FROM * ends[0] < ends[1]
    forth, back = (np.log, np.exp) if by_log else (np.array, np.array)
    ends, alone = forth(ends), table["alone"].values
    # The logarithm of a number that is not positive would be beyond all axes.
    alone = forth(np.maximum(alone, np.finfo(float).tiny) if by_log else alone)
    widest = ends + 0.4 * np.ptp(ends) * np.array([-1, 1])
    low, high = np.clip([np.nanmin(alone), np.nanmax(alone)], *widest)
    low, high = with_margin(min(low, ends[0]), max(high, ends[1]))
    return float(back(low)), float(back(high))
