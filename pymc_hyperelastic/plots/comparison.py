"""Differences between groups: how large they are, and how well they classify one specimen."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.evidence.stored import check_numbers, damaged, read_number, read_text
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.curves import Curve, band_rows
from pymc_hyperelastic.plots.properties import draw_over_pressure
from pymc_hyperelastic.plots.rows import (
    draw_lines,
    draw_points,
    draw_verticals,
    heights,
    row_panels,
)
from pymc_hyperelastic.plots.style import (
    MARKERS,
    Backend,
    Canvas,
    Visuals,
    Wishes,
    check_table,
)

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

_PANELS = ("effect_size", "best_accuracy")
_ORIGIN = "ph.compare_classes"
_ROW = 0.3  # inches of a quantity, and of each comparison of it
# Statistics of the curves of a group, and how they begin the label of an axis.
_STATISTICS = {"typical": "", "mean": "mean of\n", "spread": "spread of\n"}


@one_thread
def plot_comparison(
    result: xr.Dataset,
    *,
    statistic: str = "typical",
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    """Plot differences between groups, or their curves if several pressures were compared.

    Each quantity has a row. On the left stands the difference of the typical specimens, in units of
    the spread between specimens; on the right how often one would be right, at best, about the
    group of a single new specimen by this quantity: ½ is chance. Points are medians, lines
    intervals.

    If several pressures were compared, each quantity has a panel instead, with the median and an
    interval for each group.

    Parameters
    ----------
    result : xarray.Dataset
        Result of :func:`pymc_hyperelastic.compare_classes`.
    statistic : {"typical", "mean", "spread"}
        What curves show: the typical specimen, the mean over specimens, or their spread.
    backend, visuals, **pc_kwargs
        See :func:`~pymc_hyperelastic.plot_inflation`. The visuals are ``points``, ``interval``,
        ``nothing`` (the line of no difference), ``xlabel`` and ``legend``; of curves ``band``,
        ``median``, ``xlabel``, ``ylabel`` and ``legend``.

    Returns
    -------
    arviz_plots.PlotCollection
        With the dimensions ``panel``, ``quantity`` and ``comparison``; of curves its variables are
        the quantities.

    Raises
    ------
    TypeError, ValueError
        If `result` is no result of :func:`~pymc_hyperelastic.compare_classes`, or the statistic,
        the backend or a visual is unknown.

    See Also
    --------
    compare_classes

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> classes = ph.open_result("hierarchical.nc")  # saved from an example of fit_classes
    >>> result = ph.compare_classes(classes, ["mu", "alpha"], effect_prior=None, random_seed=1)
    >>> figure = ph.plot_comparison(result, backend="none")
    >>> figure.viz["points"]["difference"].sizes["quantity"]
    2
    """
    check_table(result, _ORIGIN, "draws", *_PANELS, "effect_size_interval", "overlap_interval")
    check_table(result, _ORIGIN, "quantity", "comparison", "group", "statistic")
    for name in ("effect_size_interval", "overlap_interval"):
        if result[name].sizes.get("bound") != 2:
            raise damaged(result, f"{name!r} has no two bounds: {dict(result[name].sizes)}")
    if statistic not in _STATISTICS:
        raise ValueError(f"statistic must be one of {list(_STATISTICS)}, not {statistic!r}")
    wishes, ci_prob = (backend, visuals, pc_kwargs), read_number(result, "interval")
    law, comparisons = read_text(result, "strain_energy"), result["comparison"].values.tolist()
    if "pressure" in result.dims:
        canvas = _curves(result, statistic, ci_prob, wishes)
        canvas.title([result.attrs], law)
    else:
        canvas, held = _rows(result, wishes), f"median and {100 * ci_prob:.3g} % of the posterior"
        comparison = str(comparisons[0]) if len(comparisons) == 1 else None
        canvas.title([result.attrs], law, comparison, held)
    return canvas.collection


def _rows(result: xr.Dataset, wishes: Wishes) -> Canvas:
    """Draw differences and accuracies as rows."""
    # A larger overlap means a smaller accuracy.
    accuracy = 1 - result["overlap_interval"].isel(bound=[1, 0]) / 2
    low, high = (
        _in_panels(result["effect_size_interval"].isel(bound=i), accuracy.isel(bound=i))
        for i in (0, 1)
    )
    value = _in_panels(*(result[name] for name in _PANELS))
    names = [str(name) for name in result["quantity"].values.tolist()]
    several = result.sizes["comparison"]
    canvas = row_panels(
        value.fillna(0.0).to_dataset(name="difference"),
        "points interval nothing xlabel legend",
        wishes,
        names,
        _ROW * (1 + several) / 2,
        aes={"color": ["comparison"], "marker": ["comparison"], "overlay": ["quantity"]},
        marker=MARKERS,
    )
    draw_verticals(canvas, "nothing", {"effect_size": 0.0, "best_accuracy": 0.5})
    places = np.linspace(0.3, -0.3, several) if several > 1 else [0.0]
    y = heights("quantity", len(names)) + xr.DataArray(places, dims="comparison")
    draw_lines(canvas, "interval", (low, high), y, ignore_aes={"marker"})
    draw_points(canvas, "points", value, y)
    canvas.adjust("set_xlim", limits=(0.48, 1.02), coords={"panel": "best_accuracy"})
    marks: dict[str, Any] = {"linestyle": "none", "markersize": 5}
    canvas.legend(canvas.entries("comparison", "", "color", "marker", **marks))
    return canvas


def _in_panels(*of_panels: xr.DataArray) -> xr.DataArray:
    """Join the numbers of both panels."""
    panel = xr.DataArray(list(_PANELS), dims="panel", name="panel")
    return xr.concat([each.reset_coords(drop=True) for each in of_panels], panel)


def _curves(result: xr.Dataset, statistic: str, ci_prob: float, wishes: Wishes) -> Canvas:
    """Draw the curves of each group over the pressure."""
    check_numbers(result, result, "pressure", ("pressure",))
    pressure, groups = result["pressure"].values, result["group"].values.tolist()
    draws = result["draws"].sel(statistic=statistic).transpose(..., "pressure")
    curves = [
        Curve(name, (group,), band_rows(pressure, draws.sel(of_one).values, ci_prob))
        for group in groups
        for name in result["quantity"].values.tolist()
        for of_one in [{"group": group, "quantity": name}]
    ]
    unit = read_text(result, "pressure_unit")
    return draw_over_pressure(curves, groups, ci_prob, unit, wishes, _STATISTICS[statistic])
