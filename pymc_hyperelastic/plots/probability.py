"""The probability of each class for new experiments."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.evidence.stored import damaged, read_number, read_text
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.labels import axis_label
from pymc_hyperelastic.plots.style import (
    DOUBT,
    Backend,
    Canvas,
    Visuals,
    check_table,
    literal,
    rounded_probability,
    set_yticks,
    stacked,
)
from pymc_hyperelastic.rounding import ROUNDING

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

# Rows and columns of panels of a single result.
_MOST_ROWS, _MOST_COLUMNS = 8, 4


@one_thread
def plot_class_probability(
    result: xr.Dataset | Mapping[str, xr.Dataset],
    *,
    undecided_below: float | None = None,
    none_below: float | None = None,
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    """Plot the probability of each class: a panel for each new experiment, a bar for each class.

    The decision stands above the bars, in another colour where it is no class ("undecided", "none
    of these", "cannot be judged"). If classes have variability, a diamond beside each bar is the
    p-value: near 0 no specimen of the class looks like this one, however probable the class is
    among those given.

    Parameters
    ----------
    result : xarray.Dataset or dict of str to xarray.Dataset
        Result of :func:`pymc_hyperelastic.classify`. The results of a dict, such as one of strain
        energies, have a column each; the panels of a single result share a few columns. Experiments
        that are not classified yet (NaN) have no bar.
    undecided_below, none_below : float, optional
        Limits drawn as lines unless 0, that of the probability and that of the p-values; when
        missing those that :func:`pymc_hyperelastic.classify` was given.
    backend, visuals, **pc_kwargs
        See :func:`~pymc_hyperelastic.plot_inflation`. The visuals are ``bar``, ``error`` (one
        standard error to each side), ``number``, ``p_value``, ``p_number``, ``undecided_below``,
        ``none_below`` (the lines), ``xlabel``, ``ylabel``, ``title`` (of a panel) and ``legend``.

    Returns
    -------
    arviz_plots.PlotCollection
        With the dimensions ``test`` or ``specimen`` and ``model`` (panels), and ``class_label``.

    Raises
    ------
    TypeError, ValueError
        If `result` holds no class probabilities, results of a dict differ in their experiments or
        classes, a limit is no number from 0 to 1, or the backend or a visual is unknown.

    See Also
    --------
    classify

    Examples
    --------
    >>> import xarray as xr, pymc_hyperelastic as ph
    >>> result = xr.Dataset(
    ...     {
    ...         "class_probability": (("specimen", "class_label"), [[0.9, 0.1]]),
    ...         "class_probability_se": (("specimen", "class_label"), [[0.02, 0.02]]),
    ...     },
    ...     {"specimen": ["S1"], "class_label": ["C1", "C2"]},
    ... )
    >>> figure = ph.plot_class_probability(result, backend="none")
    >>> figure.get_viz("number", class_label="C1")["string"]
    '0.900'
    """
    several = isinstance(result, Mapping) and not isinstance(result, xr.Dataset)
    results: dict[str, Any] = dict(result) if several else {"": result}
    labels = [_labels(of_model) for of_model in results.values()]
    given = {"undecided_below": undecided_below, "none_below": none_below}
    limits = _limits(given, next(iter(results.values())))
    row, headings, classes = labels[0]
    if any(other != labels[0] for other in labels):
        raise ValueError("the results differ in their experiments or classes; plot them apart")
    drawn = ["class_probability", "class_probability_se", "p_value"]
    tables = [r[[name for name in drawn if name in r]] for r in results.values()]
    table = xr.concat(tables, dim="model", coords="minimal", compat="override", join="override")
    table = table.reset_coords(drop=True).assign_coords({"model": list(results), row: headings})
    panels = _panels(results, headings)
    columns = len(results) if several else min(-(-len(headings) // _MOST_ROWS), _MOST_COLUMNS)
    longest = max(len(line) for *_, title, _ in panels for line in title.splitlines())
    of_class = 0.95 if "p_value" in table else 0.55
    width = max(1 + of_class * len(classes), 2.2, 0 if several else 0.066 * longest)
    rows = -(-len(panels) // columns)
    canvas = Canvas(
        "wrap",
        table[["class_probability"]],
        f"bar error number p_value p_number {' '.join(limits)} xlabel ylabel title legend",
        (backend, visuals, pc_kwargs),
        (max(width * columns + 0.8, 3.6), (1.4 if several else 1.25) * rows + 0.7),
        # If panels shared an axis, the one above an empty place would have no ticks.
        {"sharex": len(panels) % columns == 0, "sharey": True},
        cols=[row, "model"],
        col_wrap=columns,
        aes={"color": ["class_label"]},
    )
    entries = _draw_bars(canvas, table, limits)
    # Panels without bars have axes, too.
    everywhere = {"data": table[["class_probability"]].fillna(0.0)}
    canvas.adjust("set_ylim", limits=(0, 1), **everywhere)
    canvas.adjust("set_xlim", limits=(-0.6, len(classes) - 0.4), **everywhere)
    canvas.adjust(set_yticks, values=[0, 0.5, 1], labels=["0", "0.5", "1"], **everywhere)
    ticks = {"values": range(len(classes)), "labels": [*map(literal, classes)]}
    canvas.adjust("set_xticks", **ticks, **everywhere)
    for i, (heading, model, title, colour) in enumerate(panels):
        where = {"coords": {row: heading, "model": model}}
        canvas.label("title", title, size="small", loc="left", color=colour, **where)
        if i + columns >= len(panels):
            law = model or read_text(results[model], "strain_energy", None)
            canvas.label("xlabel", f"class ({law})" if law else "class", **where)
        if i % columns == 0:
            canvas.label("ylabel", axis_label("probability"), **where)
    canvas.legend(entries)
    canvas.title([r.attrs for r in results.values()], "class probabilities")
    return canvas.collection


def _panels(
    results: Mapping[str, xr.Dataset], headings: list[str]
) -> list[tuple[str, str, str, str]]:
    """Heading, model, title and its colour of each panel, row by row."""
    panels = []
    for i, heading in enumerate(headings):
        for j, (model, result) in enumerate(results.items()):
            title, colour = heading if j == 0 else "", "0.1"
            if "decision" in result:
                decision = str(result["decision"].values[i]) or "not classified"
                title += f"{chr(10) if len(results) > 1 else ' '}→ {decision}"
                colour = colour if decision in result["class_label"] else DOUBT
            panels.append((heading, model, title, colour))
    return panels


def _draw_bars(
    canvas: Canvas, table: xr.Dataset, limits: Mapping[str, float]
) -> dict[str, dict[str, Any]]:
    """Draw bars and p-values with their numbers, and the limits; return the legend's entries."""
    probability, error = table["class_probability"], table["class_probability_se"]
    place = xr.DataArray(np.arange(table.sizes["class_label"]), dims="class_label")
    place = place.where(probability.notnull())  # no bar if not classified
    half, centre = (0.22, place - 0.2) if "p_value" in table else (0.35, place)
    edges = {"left_edges": centre - half, "right_edges": centre + half}
    bars = stacked("class_probability", **edges, histogram=probability)
    canvas.draw("bar", "hist", data=bars.expand_dims("bar", axis=-1), alpha=0.5)
    top, bottom = (probability + error).clip(0, 1), (probability - error).clip(0, 1)
    ends = stacked("class_probability", x=centre, y_bottom=bottom, y_top=top)
    canvas.draw("error", "ci_line_y", data=ends, color="0.1", width=1.2)
    canvas.draw("number", "annotate_xy", **_written(probability, centre, bottom, top))
    entries: dict[str, dict[str, Any]] = {}
    if "p_value" in table:
        p_value = table["p_value"].where(probability.notnull())
        points = stacked("class_probability", x=(place + 0.28).where(p_value.notnull()), y=p_value)
        dark = {"color": "0.1", "marker": "d"}
        canvas.draw("p_value", "scatter_xy", data=points, size=22, clip_on=False, **dark)
        canvas.draw("p_number", "annotate_xy", **_written(p_value, place + 0.28, p_value, p_value))
        entries["probability"] = {"color": "0.6", "linewidth": 6}
        entries["p-value"] = dark | {"linestyle": "none", "markersize": 5}
    for (name, limit), style in zip(limits.items(), (":", "--"), strict=True):
        if limit:
            line = {"color": "0.3", "linestyle": style}
            level = xr.full_like(probability.isel(class_label=0, drop=True), limit).to_dataset()
            canvas.draw(name, "hline", data=level, width=1, ignore_aes="all", **line)
            entries[f"{name} = {limit:g}"] = line
    return entries


def _written(
    values: xr.DataArray, x: xr.DataArray, low: xr.DataArray, high: xr.DataArray
) -> dict[str, Any]:
    """Numbers above or below the interval from low to high: the side with more room."""
    above = 1 - high >= low - ROUNDING
    return {
        "data": values.to_dataset(name="class_probability"),
        "text": rounded_probability,
        "x": x,
        "y": xr.where(above, high + 0.07, low - 0.07),
        "vertical_align": xr.where(above, "bottom", "top"),
        "color": "0.1",
        "size": 8,
    }


def _limits(given: Mapping[str, float | None], result: xr.Dataset) -> dict[str, float]:
    """Limits of a decision, from the result where they are not given."""
    limits = {
        name: read_number(result, name, 0.0) if limit is None else limit
        for name, limit in given.items()
    }
    for name, limit in limits.items():
        if not 0 <= limit < 1:
            raise ValueError(f"{name} is {limit!r}; expected a number from 0 to 1")
    return limits


def _labels(result: Any) -> tuple[str, list[str], list[str]]:
    """Dimension of the rows, their headings, and the classes."""
    variables = ("class_probability", "class_probability_se", "class_label")
    check_table(result, "ph.classify", *variables)
    for name in variables[:2]:
        dims = result[name].dims
        if len(dims) != 2 or "class_label" not in dims:
            raise damaged(
                result, f"{name!r} has the dimensions {dims}; expected class_label and another"
            )
    row = next(str(d) for d in result["class_probability"].dims if d != "class_label")
    classes = result["class_label"].values.tolist()
    known = [name for name in ("specimen", "experiment", "group") if name in result.coords]
    headings = []
    for i in range(result.sizes[row]):
        of_row = {name: result[name].values.tolist()[i] for name in known}
        heading = str(of_row.get("specimen", f"{row} {i + 1}"))
        if "experiment" in of_row:
            heading += f", experiment {of_row['experiment']}"
        if of_row.get("group") in classes:
            heading += f" (true class {of_row['group']})"
        headings.append(heading)
    if len(set(headings)) < len(headings):
        headings = [f"{i}: {heading}" for i, heading in enumerate(headings, 1)]
    return row, headings, classes
