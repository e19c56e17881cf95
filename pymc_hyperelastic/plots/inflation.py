"""The measured curves."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.inflation import check_inflation_data, points_of
from pymc_hyperelastic.plots.style import RADIUS_LABEL, Backend, Canvas, Visuals, per_kilopascal

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

_LABELS = ("group", "specimen", "experiment")
_MARKERS = ["o", "^", "s", "d", "x", "+", "."]


def plot_inflation(
    data: xr.Dataset,
    *,
    group_by: Literal["group", "specimen", "experiment"] | None = "group",
    pressure_unit: str = "mmHg",
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    """Plot the measured curves: pressure over internal radius.

    Colours tell specimens apart, or groups where a panel holds several; markers tell experiments.

    Parameters
    ----------
    data : xarray.Dataset
        Inflation data, see :func:`pymc_hyperelastic.inflation_data`.
    group_by : {"group", "specimen", "experiment"} or None
        What has a panel of its own; with None all curves share one.
    pressure_unit : str
        Unit of the pressure axis, as pint knows it.
    backend : {"matplotlib", "none"}
        Plotting backend; ``"none"`` only collects what would be drawn.
    visuals : dict of str to dict or bool, optional
        Settings of ``line``, ``points``, ``xlabel``, ``ylabel``, ``title`` (of a panel) and
        ``legend``; False leaves one out.
    **pc_kwargs
        Passed to :meth:`arviz_plots.PlotCollection.wrap`.

    Returns
    -------
    arviz_plots.PlotCollection
        Its title is that of the data, and says whether they are simulated.

    Raises
    ------
    TypeError, ValueError
        If the data are unsound, or `group_by`, the unit, the backend or a visual is unknown.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> figure = ph.plot_inflation(ph.load_dataset("simulated_sheep_aorta"), backend="none")
    >>> figure.viz["plot"]["group"].values
    array(['C1', 'C2'], dtype='<U2')
    """
    from arviz_plots.visuals import line_xy, scatter_xy, set_xlim

    check_inflation_data(data)
    if group_by not in (*_LABELS, None):
        raise ValueError(f"group_by must be one of {', '.join(_LABELS)} or None, not {group_by!r}")
    curves = _curves(data, per_kilopascal(pressure_unit))
    # The coarser of the labels that share a panel: groups, or else specimens, or else experiments.
    several = [name for name in _LABELS if curves.sizes[name] > 1 and name != group_by]
    colour = several[0] if several else "specimen"
    aes, marker = {"color": [colour], "overlay": list(_LABELS)}, {}
    if "experiment" in several[1:]:
        aes["marker"], marker = ["experiment"], {"marker": _MARKERS}
    names = curves[group_by].values.tolist() if group_by else [None]
    columns, rows = min(len(names), 3), -(-len(names) // 3)
    canvas = Canvas(
        "wrap",
        curves,
        "line points xlabel ylabel title legend",
        backend,
        visuals,
        pc_kwargs,
        {"figsize": (3 * columns + (1.2 if columns > 1 else 2.2), 2.9 * rows + 0.3)}
        | {"sharey": True},
        cols=[group_by] if group_by else [],
        col_wrap=3,
        aes=aes,
        **marker,
    )
    canvas.draw("line", line_xy, width=0.8, alpha=0.7, ignore_aes={"marker"} & set(aes))
    canvas.draw("points", scatter_xy, size=10, width=0.8)
    low, high = data["radius"].values.min(), data["radius"].values.max()
    margin = 0.04 * (high - low)
    canvas.adjust(set_xlim, limits=(low - margin, high + margin))
    canvas.label("xlabel", RADIUS_LABEL)
    for i, name in enumerate(names):
        here = {"coords": {group_by: name}} if group_by else {}
        if i % columns == 0:
            canvas.label("ylabel", f"pressure ({pressure_unit})", **here)
        if len(names) > 1:
            canvas.label("title", f"{group_by} {name}", size="medium", **here)
    entries: dict[str, Any] = {}
    if several:
        entries |= canvas.entries("color", colour, f"{colour} ", marker="o", markersize=4)
    if marker:
        grey = {"color": "0.3", "linestyle": "none", "markersize": 5}
        entries |= canvas.entries("marker", "experiment", "experiment ", **grey)
    canvas.legend(entries)
    canvas.title([data.attrs])
    return canvas.collection


def _curves(data: xr.Dataset, pressure_factor: float) -> xr.Dataset:
    """Curves by label: each is a dimension, so that panels and colours follow from it."""
    labels = {name: data[name].values.tolist() for name in _LABELS}
    coords = {name: list(dict.fromkeys(values)) for name, values in labels.items()}
    longest = np.bincount(data["test"].values).max()
    curves = np.full((*map(len, coords.values()), 2, longest), np.nan)
    for i in range(data.sizes["test"]):
        place = tuple(coords[name].index(labels[name][i]) for name in _LABELS)
        test = points_of(data, i)
        curve = [data["radius"].values[test], pressure_factor * data["pressure"].values[test]]
        curves[place][:, : test.stop - test.start] = curve
    dims = (*_LABELS, "plot_axis", "point")
    return xr.Dataset({"pressure": (dims, curves)}, {**coords, "plot_axis": ["x", "y"]})
