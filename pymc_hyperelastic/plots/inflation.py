"""The measured curves."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.inflation import check_inflation_data, points_of
from pymc_hyperelastic.plots.style import (
    DIAMETER_LABEL,
    MARKERS,
    RADIUS_LABEL,
    Backend,
    Canvas,
    Visuals,
    by_stretch,
    per_kilopascal,
    stretch_labels,
    told_apart,
)

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

# From the coarsest, and as figures name them.
_LABELS = {
    "group": "group",
    "specimen": "specimen",
    "axial_stretch": "axial stretch",
    "experiment": "experiment",
}


def plot_inflation(
    data: xr.Dataset,
    *,
    group_by: Literal["group", "specimen", "axial_stretch", "experiment"] | None = "group",
    pressure_unit: str = "mmHg",
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    """Plot the measured curves: pressure over internal radius, or outer diameter if that was read.

    Colours tell specimens apart, or groups where a panel holds several; where there are more than
    seven, line styles do it with them. Markers tell axial stretches, or if there is one, or as many
    as there are specimens, experiments. The curves of a single specimen have colours by axial
    stretch.

    Parameters
    ----------
    data : xarray.Dataset
        Inflation data, see :func:`pymc_hyperelastic.inflation_data`.
    group_by : {"group", "specimen", "axial_stretch", "experiment"} or None
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
    colour, marker = _told_by(curves, group_by)
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
        aes={"color": [colour], "linestyle": [colour], "marker": [marker or colour]}
        | {"overlay": [*_LABELS, "curve"]},
        **told_apart() | ({"marker": MARKERS} if marker else {}),
    )
    canvas.draw("line", line_xy, width=0.8, alpha=0.7, ignore_aes={"marker"})
    canvas.draw("points", scatter_xy, size=10, width=0.8, ignore_aes={"linestyle"})
    low, high = (float(f(curves["pressure"].sel(plot_axis="x"))) for f in (np.nanmin, np.nanmax))
    margin = 0.04 * (high - low)
    canvas.adjust(set_xlim, limits=(low - margin, high + margin))
    canvas.label("xlabel", DIAMETER_LABEL if "outer_diameter" in data else RADIUS_LABEL)
    for i, name in enumerate(names):
        here = {"coords": {group_by: name}} if group_by else {}
        if i % columns == 0:
            canvas.label("ylabel", f"pressure ({pressure_unit})", **here)
        if group_by and len(names) > 1:
            canvas.label("title", f"{_LABELS[group_by]} {name}", size="medium", **here)
    entries: dict[str, Any] = {}
    if curves.sizes[colour] > 1 and colour != group_by:
        style = ("color", "linestyle") if marker else ("color", "linestyle", "marker")
        settings: dict[str, Any] = {"marker": "o", "markersize": 4}
        entries |= canvas.entries(colour, f"{_LABELS[colour]} ", *style, **settings)
    if marker:
        grey = {"color": "0.3", "linestyle": "none", "markersize": 5}
        entries |= canvas.entries(marker, f"{_LABELS[marker]} ", "marker", **grey)
    canvas.legend(entries)
    canvas.title([data.attrs])
    return canvas.collection


def _told_by(curves: xr.Dataset, group_by: str | None) -> tuple[str, str | None]:
    """What colours tell apart, and what markers do, if anything.

    Colours tell the coarser of the labels that share a panel.
    """
    several = [name for name in _LABELS if curves.sizes[name] > 1 and name != group_by]
    if not several:
        return "specimen", None
    colour, *finer = several
    # Stretches of which each specimen has its own are known by the order of its experiments.
    if "axial_stretch" in finer and curves.sizes["axial_stretch"] <= len(MARKERS):
        return colour, "axial_stretch"
    there = curves["pressure"].notnull()
    seen, named = (
        int(there.any(set(there.dims) - {group_by, colour, *more}).sum())
        for more in ([], ["experiment"])
    )
    told = "experiment" in finer and named > seen
    return colour, "experiment" if told else None


def _curves(data: xr.Dataset, pressure_factor: float) -> xr.Dataset:
    """Curves by label: each is a dimension, so that panels and colours follow from it."""
    labels = {name: data[name].values.tolist() for name in _LABELS}
    labels["axial_stretch"] = stretch_labels(data["axial_stretch"])
    coords = {name: list(dict.fromkeys(values)) for name, values in labels.items()}
    coords["axial_stretch"].sort(key=by_stretch)
    places = [
        tuple(coords[name].index(labels[name][i]) for name in _LABELS)
        for i in range(data.sizes["test"])
    ]
    # Cycles and phases of an experiment have the same labels.
    repeats = [places[:i].count(place) for i, place in enumerate(places)]
    longest = np.bincount(data["test"].values).max()
    curves = np.full((*map(len, coords.values()), max(repeats) + 1, 2, longest), np.nan)
    read = data["outer_diameter" if "outer_diameter" in data else "radius"].values
    for i, (place, repeat) in enumerate(zip(places, repeats, strict=True)):
        test = points_of(data, i)
        curve = [read[test], pressure_factor * data["pressure"].values[test]]
        curves[place][repeat, :, : test.stop - test.start] = curve
    dims = (*_LABELS, "curve", "plot_axis", "point")
    return xr.Dataset({"pressure": (dims, curves)}, {**coords, "plot_axis": ["x", "y"]})
