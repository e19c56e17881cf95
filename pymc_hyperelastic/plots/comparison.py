"""Differences between groups beside the specimens of the groups: an estimation plot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import xarray as xr

from pymc_hyperelastic.evidence.stored import check_numbers, damaged, read_number, read_text
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.curves import Curve, band_rows
from pymc_hyperelastic.plots.labels import beside_panel, quantity_label
from pymc_hyperelastic.plots.properties import draw_over_pressure
from pymc_hyperelastic.plots.style import (
    Backend,
    Canvas,
    Visuals,
    Wishes,
    check_choice,
    check_table,
    inches_of,
    literal,
    with_margin,
)
from pymc_hyperelastic.rounding import rounded_interval

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

_ORIGIN = "ph.compare_classes"
_PANELS = ("value", "contrast")
_DARK, _PALE, _LINE = "0.1", "0.6", "0.75"
# Statistics of a group: how they are called, and how they begin the label of an axis of curves.
_STATISTICS = {
    "typical": ("typical specimen", ""),
    "mean": ("mean of the group", "mean of\n"),
    "spread": ("spread of the group", "spread of\n"),
}
# Contrasts of two groups, and how they are written.
_CONTRASTS = {"difference": "−", "ratio": "/"}


@one_thread
def plot_comparison(
    result: xr.Dataset,
    *,
    statistic: Literal["typical", "mean", "spread"] = "typical",
    contrast: Literal["difference", "ratio"] = "difference",
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    """Plot the specimens of groups, and differences between the groups, as an estimation plot [1]_.

    Each quantity has a row. The left panel shows each specimen as a point with a thin interval, and
    beside the specimens of a group its typical specimen, with a thick interval. The right panel
    shows the difference, or the ratio, of two groups with its interval; the line is no difference.
    The two axes of two groups are aligned: no difference is at the height of the first group, and
    the difference at that of the second. Points are posterior medians.

    If several pressures were compared, each quantity has a panel instead, with the median and an
    interval for each group over the pressure.

    Parameters
    ----------
    result : xarray.Dataset
        Result of :func:`pymc_hyperelastic.compare_classes`.
    statistic : {"typical", "mean", "spread"}
        The compared statistic: the typical specimen, the mean over specimens, or their spread.
        Specimens are not shown beside spreads.
    contrast : {"difference", "ratio"}
        Content of the right panel: ``second − first`` or ``second / first``. A quantity without a
        ratio, such as a logarithm, shows its difference.
    backend, visuals, **pc_kwargs
        See :func:`~pymc_hyperelastic.plot_inflation`. The visuals are ``specimen_interval``,
        ``specimens``, ``animals`` (lines between specimens of one animal), ``interval``,
        ``groups``, ``contrast_interval``, ``contrast``, ``nothing`` (the line of no difference),
        ``ylabel`` and ``legend``; of curves ``band``, ``median``, ``xlabel``, ``ylabel`` and
        ``legend``.

    Returns
    -------
    arviz_plots.PlotCollection
        A grid with the dimensions ``quantity`` and ``panel`` ("value" and "contrast"); visuals have
        the dimensions ``group``, ``specimen`` and ``comparison``. Variables of curves are the
        quantities.

    Raises
    ------
    TypeError, ValueError
        If `result` is no result of :func:`~pymc_hyperelastic.compare_classes`, or the statistic,
        the contrast, the backend or a visual is unknown.

    See Also
    --------
    compare_classes, plot_specimens

    References
    ----------
    .. [1] J. Ho, T. Tumkaya, S. Aryal, H. Choi and A. Claridge-Chang, Moving beyond P values: data
       analysis with estimation graphics, Nature Methods 16 (2019) 565-566.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> classes = ph.open_result("hierarchical.nc")  # saved from an example of fit_classes
    >>> result = ph.compare_classes(classes, ["mu", "alpha"], effect_prior=None, random_seed=1)
    >>> figure = ph.plot_comparison(result, backend="none")
    >>> figure.viz["contrast"]["estimation"].sizes["quantity"]
    2
    """
    _check(result)
    check_choice("statistic", statistic, _STATISTICS)
    check_choice("contrast", contrast, _CONTRASTS)
    wishes, ci_prob = (backend, visuals, pc_kwargs), read_number(result, "interval")
    law = read_text(result, "strain_energy")
    if "pressure" in result.dims:
        canvas = _curves(result, statistic, ci_prob, wishes)
        canvas.title([result.attrs], law)
    else:
        canvas = _estimation(result, statistic, contrast, wishes)
        at = float(result["pressure"]) if "pressure" in result.coords else 0.0
        where = f"at {at:.4g} {read_text(result, 'pressure_unit')}" if at else None
        held = f"median and {100 * ci_prob:.3g} % of the posterior"
        canvas.title([result.attrs], law, where, held)
    return canvas.collection


def _check(result: Any) -> None:
    """Raise unless this is a whole result of a comparison."""
    both = [f"{name}{end}" for name in ("value", *_CONTRASTS) for end in ("", "_interval")]
    check_table(result, _ORIGIN, "draws", "specimen_value", "specimen_value_interval", *both)
    check_table(result, _ORIGIN, "quantity", "comparison", "group", "statistic", "specimen_group")
    for name in ("value_interval", "specimen_value_interval"):
        if result[name].sizes.get("bound") != 2:
            raise damaged(result, f"{name!r} has no two bounds: {dict(result[name].sizes)}")


def _estimation(result: xr.Dataset, statistic: str, contrast: str, wishes: Wishes) -> Canvas:
    """Draw specimens and groups on the left, and their contrasts on the right."""
    specimens, groups = _by_group(result), result.sel(statistic=statistic, drop=True)
    if statistic == "spread":
        specimens = specimens.isel(specimen=slice(0))
    contrasts = _contrasts(groups, contrast)
    sizes = {dim: result.sizes[dim] for dim in ("quantity", "group", "comparison")}
    names = result["quantity"].values.tolist()
    words = {name: _words_of(groups, contrasts.sel(quantity=name)) for name in names}
    of_comparison = max(1.3, inches_of(w for of_quantity in words.values() for w in of_quantity))
    widths = [1.15 * sizes["group"], of_comparison * sizes["comparison"]]
    coords = {name: result[name].values for name in sizes}
    coords |= {"panel": list(_PANELS), "specimen": specimens["specimen"].values}
    drawn = xr.DataArray(0.0, coords, [*coords], "estimation")
    canvas = Canvas(
        "grid",
        drawn.to_dataset(),
        "specimen_interval specimens animals interval groups contrast_interval contrast nothing "
        "ylabel legend",
        wishes,
        (sum(widths) + 1.4, 2.2 * sizes["quantity"] + 0.8),
        {"width_ratios": widths},
        rows=["quantity"],
        cols=["panel"],
        aes={"color": ["group"], "overlay": ["specimen", "comparison"]},
    )
    _draw_groups(canvas, specimens, groups, "animal" in result.coords)
    _draw_contrasts(canvas, contrasts, groups)
    _set_axes(canvas, result, words, [specimens, groups, contrasts])
    of_one = {"marker": "o", "color": _PALE, "linestyle": "none", "markersize": 4}
    entries = {"specimen": of_one} if specimens.sizes["specimen"] else {}
    if entries and "animal" in result.coords:
        entries["same animal"] = {"color": _LINE, "linewidth": 0.7}
    of_group = {"marker": "s", "color": _DARK, "linewidth": 2, "markersize": 5}
    canvas.legend(entries | {_STATISTICS[statistic][0]: of_group})
    return canvas


def _by_group(result: xr.Dataset) -> xr.Dataset:
    """Specimens, or animals of pairs, in the dimensions group and specimen; NaN where none is.

    ``x`` is the place of a specimen on the axis, on the left of the middle of its group, in the
    order of the specimens.
    """
    label = "animal" if "animal" in result.coords else "specimen"
    found = result[["specimen_value", "specimen_value_interval"]].transpose(..., "bound")
    labels, parts = result[label].values, []
    for i, group in enumerate(result["group"].values.tolist()):
        own = np.flatnonzero(result["specimen_group"] == group)
        part = found.isel(specimen=own).reset_coords(drop=True).drop_vars("specimen")
        places = i - 0.36 + 0.46 * (np.arange(len(own)) + 0.5) / max(len(own), 1)
        part = part.assign(x=("specimen", places))
        parts.append(part.assign_coords(specimen=labels[own]))
    group = xr.DataArray(result["group"].values, dims="group", name="group")
    return xr.concat(parts, group, join="outer")


def _contrasts(groups: xr.Dataset, contrast: str) -> xr.Dataset:
    """Median and ends of the contrast of each comparison; True where it is a ratio."""
    is_ratio = groups["ratio"].notnull().all("comparison") & (contrast == "ratio")
    ends = {"median": "", "interval": "_interval"}
    contrasts = {
        name: xr.where(is_ratio, groups[f"ratio{end}"], groups[f"difference{end}"])
        for name, end in ends.items()
    }
    return xr.Dataset(contrasts | {"is_ratio": is_ratio, "nothing": is_ratio.astype(float)})


def _draw_groups(canvas: Canvas, specimens: xr.Dataset, groups: xr.Dataset, paired: bool) -> None:
    """Draw specimens, lines between those of an animal, and the groups beside them."""
    left: dict[str, Any] = {"coords": {"panel": "value"}}
    if specimens.sizes["specimen"]:
        x, y, interval = (specimens[n] for n in ("x", "specimen_value", "specimen_value_interval"))
        if paired:
            of_animal = [v.rename(group="end").drop_vars("end") for v in (x, y)]
            plain = {"color": _LINE, "ignore_aes": {"color"}}
            canvas.draw_xy(
                "animals", "line_xy", of_animal[0], of_animal[1], width=0.7, **plain, **left
            )
        canvas.draw_xy("specimen_interval", "line_xy", x, interval, width=0.7, alpha=0.6, **left)
        canvas.draw_xy("specimens", "scatter_xy", x, y, size=14, **left)
    x = xr.DataArray(np.arange(groups.sizes["group"]) + 0.32, {"group": groups["group"]}, "group")
    canvas.draw_xy("interval", "line_xy", x, groups["value_interval"], width=2.2, **left)
    canvas.draw_xy("groups", "scatter_xy", x, groups["value"], size=32, marker="s", **left)


def _draw_contrasts(canvas: Canvas, contrasts: xr.Dataset, groups: xr.Dataset) -> None:
    """Draw contrasts with their intervals, and the line of no difference in both panels."""
    first = groups["value"].isel(group=0, drop=True)
    # With more than two groups, the line would belong to some contrasts only.
    first = first.where(groups.sizes["group"] == 2)
    panels = xr.DataArray([*_PANELS], dims="panel", name="panel")
    both = [n.reset_coords(drop=True) for n in (first, contrasts["nothing"])]
    lines = xr.concat(both, panels).to_dataset(name="estimation")
    settings: dict[str, Any] = {"color": _PALE, "width": 0.8, "linestyle": "--"}
    canvas.draw("nothing", "hline", data=lines, ignore_aes="all", **settings)
    names = contrasts["comparison"]
    x = xr.DataArray(np.arange(float(names.size)), {"comparison": names}, "comparison")
    right: dict[str, Any] = {"coords": {"panel": "contrast"}, "color": _DARK}
    right["ignore_aes"] = {"color"}
    canvas.draw_xy("contrast_interval", "line_xy", x, contrasts["interval"], width=2.2, **right)
    canvas.draw_xy("contrast", "scatter_xy", x, contrasts["median"], size=32, **right)


def _set_axes(
    canvas: Canvas, result: xr.Dataset, words: dict[str, list[str]], tables: list[xr.Dataset]
) -> None:
    """Set limits, ticks and labels of the axes."""
    of_groups = []
    for group in result["group"].values.tolist():
        count = int((result["specimen_group"] == group).sum())
        of_groups.append(f"{literal(group)}\n($n$ = {count})")
    law = read_text(result, "strain_energy")
    for name, of_contrasts in words.items():
        of_one = [table.sel(quantity=name) for table in tables]
        ticks = of_groups, of_contrasts
        for panel, ends, labels in zip(_PANELS, _limits(*of_one), ticks, strict=True):
            where: dict[str, Any] = {"coords": {"quantity": name, "panel": panel}}
            canvas.limit("y", ends, log=bool(of_one[-1]["is_ratio"]), **where)
            canvas.adjust("set_xlim", limits=(-0.5, len(labels) - 0.5), **where)
            canvas.adjust("set_xticks", values=range(len(labels)), labels=labels, **where)
            if panel == "value":
                canvas.label("ylabel", beside_panel(quantity_label(name, law)), **where)
            else:
                canvas.on_axes(lambda axes: axes.yaxis.tick_right(), **where)


def _words_of(groups: xr.Dataset, contrasts: xr.Dataset) -> list[str]:
    """Name and number of each contrast of a quantity, below its point."""
    sign = _CONTRASTS["ratio" if contrasts["is_ratio"] else "difference"]
    words = []
    for i, (first, second) in enumerate(zip(groups["first"], groups["second"], strict=True)):
        own = contrasts.isel(comparison=i)
        median, low, high = rounded_interval(own["median"].item(), *own["interval"].values.tolist())
        of_both = f"{literal(second.item())} {sign} {literal(first.item())}"
        words.append(f"{of_both}\n{median} ({low} to {high})")
    return words


def _limits(
    specimens: xr.Dataset, groups: xr.Dataset, contrasts: xr.Dataset
) -> list[tuple[float, float]]:
    """Ends of both vertical axes of a quantity, which are aligned for two groups."""
    forth, back = (np.log, np.exp) if contrasts["is_ratio"] else (np.array, np.array)
    left = [specimens["specimen_value_interval"], groups["value_interval"]]
    right = [contrasts["interval"], contrasts["nothing"]]
    ends = np.zeros((2, 2))
    for of_axis, shown in zip(ends, (left, right), strict=True):
        values = np.concatenate([forth(values.values).ravel() for values in shown])
        values = values[np.isfinite(values)]
        if values.size:
            of_axis[:] = values.min(), values.max()
    first = float(forth(groups["value"].values[0]))
    aligned = groups.sizes["group"] == 2 and np.isfinite(first)
    if aligned:
        ends[1] += first
        ends[:] = ends[:, 0].min(), ends[:, 1].max()
    ends = np.array([with_margin(*e) if e[0] < e[1] else (e[0] - 1, e[1] + 1) for e in ends])
    if aligned:
        ends[1] -= first
    return [(float(low), float(high)) for low, high in back(ends)]


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
    return draw_over_pressure(curves, groups, ci_prob, unit, wishes, _STATISTICS[statistic][1])
