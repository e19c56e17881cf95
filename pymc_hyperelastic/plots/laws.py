"""The probability of each strain energy, and the evidences that it rests on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.classes.average import laws_of_fits
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.style import (
    DOUBT,
    MARKERS,
    Backend,
    Canvas,
    Visuals,
    check_table,
    rounded_probability,
    rows_of,
    stacked,
    tick_rows,
    training_attrs,
)

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

_LABELS = {
    "probability": "probability",
    "log_evidence": "log evidence less the largest (nats)",
}
_NEEDED = ("log_evidence", "log_evidence_se", "probability", "probability_se")
_ORIGIN = "ph.classify(..., average_over=...)"
_WIDEST = 26  # letters of a line of a law's name
_LINE = 0.17  # inches that such a line is high


@one_thread
def plot_law_probability(
    result: xr.Dataset | Mapping[str, xr.DataTree] | Sequence[xr.DataTree],
    *,
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    r"""Plot how probable each strain energy is, and by how many nats evidences differ.

    Equal beforehand, the laws ``k`` have the probabilities

    .. math:: P_k = \frac{Z_k}{\sum_j Z_j},

    the most probable on top. Beside each stands what its log evidence ``ln Z_k`` lacks of the
    largest. Lines are one standard error to each side: that of a difference holds both evidences,
    and that of a probability is the root mean square over draws of all of them within their errors.
    Where the error of an evidence is infinite the law "cannot be judged", and no probability can:
    it might be the best.

    Of several classes small markers tell how probable each law is by one class alone. The evidence
    of all classes together, in which each has parameters of its own, is the product of theirs.

    Parameters
    ----------
    result : xarray.Dataset, or dict or list of xarray.DataTree
        Result of :func:`pymc_hyperelastic.classify` with `average_over`; or the fits themselves,
        results of :func:`pymc_hyperelastic.sample_smc`, classes of a
        :func:`pymc_hyperelastic.fit_classes`, or results of it as a whole. A dict names them; of a
        list each has the name of its strain energy.
    backend : {"matplotlib", "none"}
        Plotting backend; ``"none"`` only collects what would be drawn.
    visuals : dict of str to dict or bool, optional
        Settings of ``bar``, ``points`` (the differences), ``error``, ``number``, ``class_points``,
        ``class_error``, ``xlabel`` and ``legend``; False leaves one out.
    **pc_kwargs
        Passed to :meth:`arviz_plots.PlotCollection.wrap`.

    Returns
    -------
    arviz_plots.PlotCollection
        With the dimensions ``panel`` ("probability" and "log_evidence"), ``strain_energy`` and, of
        several classes, ``class_label``.

    Raises
    ------
    TypeError, ValueError
        If `result` holds no evidences of laws; if those of fits do not compare, since the data, the
        noise or the likelihood differ, which is named; or if the backend or a visual is unknown.

    Warns
    -----
    UserWarning
        If a fit does not say from which data, or with which noise, it was made.

    See Also
    --------
    log_evidence

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1", experiment=1)
    >>> fits = [
    ...     ph.sample_smc(
    ...         ph.inflation_model(energy, data, 2 * ph.mmHg),
    ...         draws=500,
    ...         chains=2,
    ...         random_seed=1,
    ...         progressbar=False,
    ...     )
    ...     for energy in (ph.NeoHookean(), ph.Ogden())
    ... ]
    >>> figure = ph.plot_law_probability(fits, backend="none")
    >>> figure.get_viz("number", panel="probability", strain_energy="Ogden")["string"]
    '>0.999'
    """
    from arviz_plots.visuals import set_xlim, set_xticks, set_ylim

    table, attrs = _table(result)
    labels = [fill(label, _WIDEST) for label in table["strain_energy"].values.tolist()]
    widest = max(len(line) for label in labels for line in label.splitlines())
    highest = max(label.count("\n") + 1 for label in labels)
    several = "class_probability" in table
    # Panels of which nothing is known would be left out.
    panels = sum(xr.zeros_like(table[n]) for n in ("value", "class_probability") if n in table)
    row = 0.15 + max(_LINE * highest, _LINE * (1 + several * table.sizes.get("class_label", 0)))
    told_by = "class_label" if several else "strain_energy"
    canvas = Canvas(
        "wrap",
        panels.to_dataset(name="law"),
        "bar points error number class_points class_error xlabel legend",
        backend,
        visuals,
        pc_kwargs,
        {"figsize": (7.2 + 0.075 * widest, row * len(labels) + 1.2), "sharey": True},
        cols=["panel"],
        col_wrap=2,
        aes={name: [told_by] for name in ("color", "marker")} | {"overlay": ["strain_energy"]},
        marker=MARKERS,
    )
    limits = _limits(table)
    entries = _draw_laws(canvas, table, limits)
    for panel, ends in limits.items():
        canvas.adjust(set_xlim, limits=ends, coords={"panel": panel})
    ticks = {"values": [0, 0.5, 1], "labels": ["0", "0.5", "1"]}
    canvas.adjust(set_xticks, **ticks, coords={"panel": "probability"})
    canvas.adjust(set_ylim, limits=(0.5 - len(labels), 0.5))
    canvas.adjust(tick_rows, labels=labels, coords={"panel": "probability"})
    for panel, text in _LABELS.items():
        canvas.label("xlabel", text, coords={"panel": panel})
    canvas.legend(entries, loc="outside lower center")
    canvas.title(attrs, "strain energies by their evidence")
    return canvas.collection


def _table(result: Any) -> tuple[xr.Dataset, list[Mapping[Any, Any]]]:
    """What is drawn of each law, by panel, the best on top; and what is said of the data."""
    if isinstance(result, xr.DataTree):
        raise TypeError(
            "one fit is no comparison: give a dict of names to fits, or a list of fits, such as "
            "{'Ogden': tree, 'Gent': other}"
        )
    if isinstance(result, Mapping | list | tuple) and not isinstance(result, xr.Dataset):
        laws = xr.Dataset(laws_of_fits(result).as_variables())
        fits = result.values() if isinstance(result, Mapping) else result
        attrs = [a for tree in fits for a in training_attrs({"": tree, **tree.children})]
    else:
        check_table(result, _ORIGIN, *(f"strain_energy_{name}" for name in _NEEDED))
        laws, attrs = result, [result.attrs]
        if laws["strain_energy_probability"].dims != ("strain_energy",):
            raise ValueError(
                "the result tells probabilities of laws for each specimen that was left out; give "
                f"the result of {_ORIGIN}"
            )
    value, error, chance, chance_se = (laws[f"strain_energy_{name}"] for name in _NEEDED)
    judged = np.isfinite(error) & value.notnull()
    order = np.lexsort((-value.values, ~judged.values))
    best = int(order[0])
    # The best one's difference from itself is known.
    of_difference = np.hypot(error, error[best]) * (np.arange(len(order)) != best)
    values, errors = (
        xr.concat(pair, dim="panel", coords="minimal", compat="override")
        for pair in ((chance, value - value[best]), (chance_se, of_difference))
    )
    known = xr.concat([np.isfinite(chance_se) & chance.notnull(), judged], dim="panel")
    table = {"value": values.where(known), "error": errors.where(known), "known": known}
    if laws.sizes.get("class_label", 0) > 1 and "strain_energy_class_probability" in laws:
        of_class, of_class_se = (laws[f"strain_energy_class_probability{x}"] for x in ("", "_se"))
        table["class_probability"] = of_class.where(np.isfinite(of_class_se))
        table["class_probability_se"] = of_class_se
    drawn = xr.Dataset({name: x.reset_coords(drop=True) for name, x in table.items()})
    return drawn.assign_coords(panel=list(_LABELS)).isel(strain_energy=order), attrs


def _limits(table: xr.Dataset) -> dict[str, tuple[float, float]]:
    """Ends of the axes."""
    difference, error = (table[name].sel(panel="log_evidence") for name in ("value", "error"))
    ends = difference - error, difference + error
    finite = [x.where(np.isfinite(x)) for x in ends]
    low = min(-1.0, float(finite[0].min().fillna(-1.0)))
    high = max(0.0, float(finite[1].max().fillna(0.0)))
    margin = 0.05 * (high - low)
    return {"probability": (0.0, 1.0), "log_evidence": (low - margin, high + margin)}


def _draw_laws(
    canvas: Canvas, table: xr.Dataset, limits: Mapping[str, tuple[float, float]]
) -> dict[str, dict[str, Any]]:
    """Draw what is known of each law, and say what is not; return the legend's entries."""
    from arviz_plots.visuals import line_xy, scatter_xy

    several = "class_probability" in table
    row = rows_of("strain_energy", table.sizes["strain_energy"])
    # Bars stand above what classes say by themselves.
    lines = np.linspace(0.26, -0.28, 1 + table.sizes["class_label"]) if several else np.zeros(1)
    y = row + xr.DataArray([lines[0], 0.0], {"panel": list(_LABELS)}, "panel")
    value, error = table["value"], table["error"]
    plain = {"ignore_aes": {"color", "marker"}, "color": "0.1"}
    panels = [{"panel": panel} for panel in _LABELS]
    chance, difference = (
        {name: x.sel(panel, drop=True) for name, x in (("x", value), ("y", y))} for panel in panels
    )
    from_zero = stacked("law", **chance | {"x": _ends(xr.zeros_like(chance["x"]), chance["x"])})
    bar = plain | {"color": "0.65", "width": 9 / len(lines) ** 0.3, "solid_capstyle": "butt"}
    canvas.draw("bar", line_xy, data=from_zero, coords=panels[0], **bar)
    ends = _ends(value - error, value + error)
    ends = xr.where(ends["panel"] == "probability", ends.clip(0, 1), ends)
    canvas.draw("error", line_xy, data=stacked("law", x=ends, y=y), width=1.2, **plain)
    points = {"data": stacked("law", **difference), "coords": panels[1], "size": 22}
    canvas.draw("points", scatter_xy, **points, **plain)
    right = [high + 0.03 * (high - low) for low, high in limits.values()]
    beside = xr.DataArray(right, {"panel": list(limits)}, "panel").broadcast_like(value)
    said = xr.apply_ufunc(_said, value, error, table["known"], value["panel"], vectorize=True)
    told = {"data": stacked("law", x=beside, y=y), "text": said, "known": table["known"]}
    canvas.draw("number", _write, **told, ignore_aes={"color", "marker"}, size=9)
    if not several:
        return {}
    of_class = row + xr.DataArray(lines[1:], dims="class_label")
    value, error = table["class_probability"], table["class_probability_se"]
    ends = _ends((value - error).clip(0, 1), (value + error).clip(0, 1))
    drawn = stacked("law", x=ends, y=of_class)
    here = {"coords": panels[0]}
    canvas.draw("class_error", line_xy, data=drawn, **here, width=1.0, ignore_aes={"marker"})
    drawn = stacked("law", x=value, y=of_class)
    canvas.draw("class_points", scatter_xy, data=drawn, **here, size=18, clip_on=False)
    entries: dict[str, dict[str, Any]] = {"by all classes": {"color": "0.65", "linewidth": 6}}
    marks: dict[str, Any] = {"linestyle": "none", "markersize": 5}
    return entries | canvas.entries("class_label", "by class ", "color", "marker", **marks)


def _ends(low: xr.DataArray, high: xr.DataArray) -> xr.DataArray:
    return xr.concat([low, high], dim="end", coords="minimal", compat="override")


def _said(value: float, error: float, known: bool, panel: str) -> str:
    """Number of a law, with its error, as far as it is known."""
    if not known:
        return "cannot be judged"
    if panel == "probability":
        return rounded_probability(value, error)
    number = f"{round(value, 2) + 0.0:.2f}".replace("-", "−").replace("inf", "∞")
    return f"{number} ± {error:.2f}" if error else number


def _write(da: xr.DataArray, target: Any, *, text: Any, known: Any, **settings: Any) -> Any:
    from arviz_plots.visuals import annotate_xy

    settings = {"color": "0.1" if known.item() else DOUBT, "vertical_align": "center"} | settings
    return annotate_xy(da, target, text=text.item(), horizontal_align="left", **settings)
