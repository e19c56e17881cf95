"""Differences between groups: how large they are, and what a single specimen tells of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.evidence.stored import check_numbers, damaged, read_number, read_text
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.properties import (
    PROPERTY_LABELS,
    bands_over,
    draw_bands,
    lines_told_apart,
)
from pymc_hyperelastic.plots.style import (
    MARKERS,
    Backend,
    Canvas,
    Visuals,
    check_table,
    rows_of,
    stacked,
    tick_rows,
)

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

_LABELS = {
    "effect_size": "difference of typical specimens\n(spreads between specimens)",
    "best_accuracy": "right answers, at best,\nabout a single specimen",
}
_ORIGIN = "ph.compare_classes"
_ROW = 0.3  # inches of a quantity, and of each comparison of it
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

    Of several pressures each quantity has a panel instead, with a band for each group: the median
    and an interval.

    Parameters
    ----------
    result : xarray.Dataset
        Result of :func:`pymc_hyperelastic.compare_classes`.
    statistic : {"typical", "mean", "spread"}
        Of what there are curves: the typical specimen, the mean over specimens, or their spread.
    backend : {"matplotlib", "none"}
        Plotting backend; ``"none"`` only collects what would be drawn.
    visuals : dict of str to dict or bool, optional
        Settings of ``points``, ``interval``, ``nothing`` (the line of no difference), ``xlabel``
        and ``legend``; of curves those of ``band``, ``median``, ``xlabel``, ``ylabel`` and
        ``legend``. False leaves one out.
    **pc_kwargs
        Passed to :meth:`arviz_plots.PlotCollection.wrap`.

    Returns
    -------
    arviz_plots.PlotCollection
        With the dimensions ``panel``, ``quantity`` and ``comparison``; of curves its variables are
        the quantities.

    Raises
    ------
    TypeError, ValueError
        If `result` is none of :func:`~pymc_hyperelastic.compare_classes`, or the statistic, the
        backend or a visual is unknown.

    See Also
    --------
    compare_classes

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> classes = ph.open_result("hierarchical.nc")  # saved from an example of fit_classes
    >>> result = ph.compare_classes(classes, ["mu", "alpha"], bayes_factor=False, random_seed=1)
    >>> figure = ph.plot_comparison(result, backend="none")
    >>> figure.viz["points"]["difference"].sizes["quantity"]
    2
    """
    check_table(result, _ORIGIN, "draws", *_LABELS, "effect_size_interval", "overlap_interval")
    check_table(result, _ORIGIN, "quantity", "comparison", "group", "statistic")
    for name in ("effect_size_interval", "overlap_interval"):
        if result[name].sizes.get("bound") != 2:
            raise damaged(result, f"{name!r} has no two bounds: {dict(result[name].sizes)}")
    if statistic not in _STATISTICS:
        raise ValueError(f"statistic must be one of {list(_STATISTICS)}, not {statistic!r}")
    settings = result, backend, visuals, pc_kwargs
    return _curves(statistic, *settings) if "pressure" in result.dims else _rows(*settings)


def _rows(
    result: xr.Dataset, backend: Backend, visuals: Visuals | None, given: dict[str, Any]
) -> PlotCollection:
    from arviz_plots.visuals import line_xy, scatter_xy, set_xlim, set_ylim, vline

    # What overlaps less is told by more.
    accuracy = (
        1 - result["overlap_interval"].isel(bound=[1, 0]).assign_coords(bound=["low", "high"]) / 2
    )
    ends = {"effect_size": result["effect_size_interval"], "best_accuracy": accuracy}
    panel = xr.DataArray(list(_LABELS), dims="panel", name="panel")
    value = xr.concat([result[name].reset_coords(drop=True) for name in _LABELS], panel)
    interval = xr.concat([e.reset_coords(drop=True) for e in ends.values()], panel)
    count, several = result.sizes["quantity"], result.sizes["comparison"]
    row = rows_of("quantity", count)
    beside = xr.DataArray(
        np.linspace(0.3, -0.3, several) if several > 1 else [0.0], dims="comparison"
    )
    names = [str(name) for name in result["quantity"].values.tolist()]
    canvas = Canvas(
        "wrap",
        value.fillna(0.0).to_dataset(name="difference"),
        "points interval nothing xlabel legend",
        backend,
        visuals,
        given,
        {
            "figsize": (
                6.2 + 0.075 * max(map(len, names)),
                _ROW * count * (0.5 + several / 2) + 1.3,
            ),
            "sharey": True,
        },
        cols=["panel"],
        col_wrap=2,
        aes={name: ["comparison"] for name in ("color", "marker")} | {"overlay": ["quantity"]},
        marker=MARKERS,
    )
    chance = xr.DataArray([0.0, 0.5], {"panel": list(_LABELS)}, "panel").to_dataset(
        name="difference"
    )
    canvas.draw("nothing", vline, data=chance, ignore_aes="all", color="0.6", width=0.8)
    y = row + beside
    lines = stacked("difference", x=interval.rename(bound="end"), y=y)
    canvas.draw("interval", line_xy, data=lines, width=1.4, ignore_aes={"marker"})
    canvas.draw("points", scatter_xy, data=stacked("difference", x=value, y=y), size=26)
    canvas.adjust(set_xlim, limits=(0.48, 1.02), coords={"panel": "best_accuracy"})
    canvas.adjust(set_ylim, limits=(0.6 - count, 0.6))
    canvas.adjust(tick_rows, labels=names, coords={"panel": "effect_size"})
    for name, text in _LABELS.items():
        canvas.label("xlabel", text, coords={"panel": name})
    marks: dict[str, Any] = {"linestyle": "none", "markersize": 5}
    entries = canvas.entries("comparison", "", "color", "marker", **marks)
    canvas.legend(entries, loc="outside lower center")
    held = f"median and {100 * read_number(result, 'interval'):.3g} % of the posterior"
    one = result["comparison"].values.tolist()[0] if several == 1 else None
    canvas.title([result.attrs], read_text(result, "strain_energy"), one, held)
    return canvas.collection


def _curves(
    statistic: str,
    result: xr.Dataset,
    backend: Backend,
    visuals: Visuals | None,
    given: dict[str, Any],
) -> PlotCollection:
    check_numbers(result, result, "pressure", ("pressure",))
    names = result["quantity"].values.tolist()
    draws = result["draws"].sel(statistic=statistic, drop=True).expand_dims("chain")
    tables = {
        group: draws.sel(group=group, drop=True).to_dataset("quantity")[names]
        for group in result["group"].values.tolist()
    }
    prob = read_number(result, "interval")
    bands = bands_over(tables, {group: t["pressure"] for group, t in tables.items()}, prob)
    columns, unit = min(len(names), 3), read_text(result, "pressure_unit")
    canvas = Canvas(
        "wrap",
        bands,
        "band median extrapolated xlabel ylabel legend",
        backend,
        visuals,
        given,
        {"figsize": (3 * columns + 1.2, 2.6 * -(-len(names) // columns) + 0.3)},
        cols=["__variable__"],
        col_wrap=columns,
        aes={"color": ["class_label"], "linestyle": ["class_label"]},
        **lines_told_apart(),
    )
    draw_bands(canvas, bands, "pressure")
    for name in names:
        canvas.label("xlabel", f"pressure ({unit})", data=bands[[name]])
        label = PROPERTY_LABELS.get(name, name)
        canvas.label("ylabel", _STATISTICS[statistic] + label, data=bands[[name]])
    canvas.legend(canvas.entries("class_label", "", "color", "linestyle"), title="class")
    held = f"median and {100 * prob:.3g} % of the posterior"
    canvas.title([result.attrs], read_text(result, "strain_energy"), held)
    return canvas.collection
