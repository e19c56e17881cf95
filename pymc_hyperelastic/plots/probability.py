"""The probability of each class for new experiments."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.evidence.stored import damaged, read_number, read_text
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.labels import axis_label
from pymc_hyperelastic.plots.rows import heights, joined, row_ticks, write
from pymc_hyperelastic.plots.style import (
    Backend,
    Canvas,
    Visuals,
    check_table,
    inches_of,
    rounded_probability,
)
from pymc_hyperelastic.rounding import DIGITS

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

_PANELS = ("probability", "p_value")


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
    """Plot the probability of each class for new specimens: a row for each, a bar for each class.

    The decision stands beside the bars, with the probability of its class; "undecided", "none of
    these" and "cannot be judged" have another colour, and their bars are pale. Probabilities whose
    error is infinite have no bar. A triangle marks the true class, if it is known.

    If classes have variability, a second panel shows the p-values: near 0 no specimen of the class
    looks like this one, however probable the class is among those given.

    Parameters
    ----------
    result : xarray.Dataset or dict of str to xarray.Dataset
        Result of :func:`pymc_hyperelastic.classify`, or a result of
        :func:`pymc_hyperelastic.cross_validate` for one strain energy. The results of a dict, such
        as one of strain energies, have panels of their own. Experiments that are not classified yet
        (NaN) have no bar.
    undecided_below, none_below : float, optional
        Limits of the probability and of the p-values, drawn as lines unless 0; by default the
        limits that :func:`pymc_hyperelastic.classify` was given.
    backend, visuals, **pc_kwargs
        See :func:`~pymc_hyperelastic.plot_inflation`. The visuals are ``bar``, ``doubtful`` (bars
        of a decision that is no class), ``error`` (one standard error to each side), ``true``,
        ``decision`` (the words), ``p_value``, ``undecided_below``, ``none_below`` (the lines),
        ``xlabel``, ``title`` (of a model) and ``legend``.

    Returns
    -------
    arviz_plots.PlotCollection
        With the dimensions ``model`` and ``panel`` ("probability" and "p_value"), ``test`` or
        ``specimen``, and ``class_label``.

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
    >>> figure.get_viz("decision", specimen="S1")["string"]
    'C1 0.900 ± 0.020'
    """
    several = isinstance(result, Mapping) and not isinstance(result, xr.Dataset)
    given_results: dict[str, Any] = dict(result) if several else {"": result}
    results = {name: _with_errors(of_model) for name, of_model in given_results.items()}
    labels = [_labels(of_model) for of_model in results.values()]
    given = {"undecided_below": undecided_below, "none_below": none_below}
    limits = _limits(given, next(iter(results.values())))
    row, headings, classes, _ = labels[0]
    if any(other != labels[0] for other in labels):
        raise ValueError("the results differ in their experiments or classes; plot them apart")
    table = _table(results, *labels[0])
    panels = [name for name in _PANELS if name in table]
    widths = [2.6, 1.2][: len(panels)]
    width = sum(widths) + inches_of(headings) + inches_of(table["words"].values.ravel()) + 0.3
    of_row = 0.09 * len(classes) + 0.1
    height = of_row * (len(headings) + 0.2) + 1.35
    drawn = table["probability"].fillna(0.0).expand_dims(panel=panels)
    canvas = Canvas(
        "wrap",
        drawn.to_dataset(name="classes"),
        f"bar doubtful error true decision p_value {' '.join(limits)} xlabel title legend",
        (backend, visuals, pc_kwargs),
        (width, height * len(results)),
        {"sharey": True, "width_ratios": widths},
        cols=["model", "panel"],
        col_wrap=len(panels),
        aes={"color": ["class_label"], "overlay": [row, "class_label"]},
    )
    rows = heights(row, len(headings))
    # The bars of a row fill 0.8 of it; 72 points are an inch.
    places = 0.4 - 0.8 * (np.arange(len(classes)) + 0.5) / len(classes)
    _draw_bars(canvas, table, rows + xr.DataArray(places, dims="class_label"), 72 * 0.8 * of_row)
    x = xr.full_like(table["decided"], 1.08, dtype=float)
    where: dict[str, Any] = {"coords": {"panel": "probability"}, "ignore_aes": {"color"}}
    write(canvas, "decision", (x, rows), table["words"], table["decided"], **where)
    entries = _legend_of(table) | _draw_limits(canvas, table, limits)
    canvas.end_at_0_and_1()
    for panel in panels:
        canvas.label("xlabel", axis_label(panel), coords={"panel": panel})
    for model in results if several else ():
        law = model or read_text(results[model], "strain_energy", None)
        if law:
            canvas.label("title", law, size="medium", coords={"model": model, "panel": panels[0]})
    row_ticks(canvas, headings)
    of_classes = canvas.entries("class_label", "", "color", linewidth=6, alpha=0.75)
    canvas.legend(of_classes | entries)
    laws = None if several else read_text(results[""], "strain_energy", None)
    canvas.title([r.attrs for r in results.values()], laws, "class probabilities")
    if backend == "matplotlib":
        # Long names change the width of a panel, and only a second layout finds room for the words.
        canvas.collection.get_viz("figure").draw_without_rendering()
    return canvas.collection


def _with_errors(result: Any) -> Any:
    """Return the result with errors of 0 if it states none, as cross-validation does."""
    names = ("class_probability", "class_probability_se")
    if isinstance(result, xr.Dataset) and [name in result for name in names] == [True, False]:
        return result.assign(class_probability_se=xr.zeros_like(result["class_probability"]))
    return result


def _table(
    results: Mapping[str, xr.Dataset],
    row: str,
    headings: list[str],
    classes: list[str],
    truth: list[str | None],
) -> xr.Dataset:
    """Numbers and words of each row, class and model; NaN where there is nothing to draw."""
    parts = []
    for result in results.values():
        part = result[["class_probability", "class_probability_se"]]
        part = part.rename(class_probability="probability", class_probability_se="error")
        part = part.transpose(row, "class_label").where(np.isfinite(part["error"]))
        decided, words = zip(*_words_of(result, row), strict=True)
        part = part.assign(decided=(row, list(decided)), words=(row, list(words)))
        if "p_value" in result and bool(result["p_value"].notnull().any()):
            part["p_value"] = result["p_value"]
        parts.append(part.reset_coords(drop=True).drop_vars(row, errors="ignore"))
    table = xr.concat(parts, dim="model", coords="minimal", compat="override", join="override")
    true = [[1.0 if name == known else np.nan for name in classes] for known in truth]
    table["true"] = ((row, "class_label"), true)
    return table.assign_coords({"model": list(results), row: headings})


def _words_of(result: xr.Dataset, row: str) -> list[tuple[bool, str]]:
    """Return True for a decision for a class, and the words of each row."""
    classes, rows = result["class_label"].values.tolist(), []
    for i in range(result.sizes[row]):
        own = result.isel({row: i})
        probability, error = own["class_probability"].values, own["class_probability_se"].values
        if np.isnan(probability).all():
            rows.append((False, "not classified"))
            continue
        largest = int(np.nanargmax(probability.round(DIGITS)))
        decision = str(own["decision"].item()) if "decision" in own else classes[largest]
        if decision in classes:
            place = classes.index(decision)
            number = rounded_probability(float(probability[place]), float(error[place]))
            rows.append((True, f"{decision} {number}"))
        else:
            rows.append((False, decision or "not classified"))
    return rows


def _draw_bars(canvas: Canvas, table: xr.Dataset, y: xr.DataArray, row_width: float) -> None:
    """Draw bars with their errors, the marks of true classes, and p-values."""
    here: dict[str, Any] = {"coords": {"panel": "probability"}}
    probability, error = table["probability"], table["error"]
    bar = {"width": row_width / y.sizes["class_label"], "solid_capstyle": "butt", **here}
    for name, chosen, alpha in (
        ("bar", table["decided"], 0.75),
        ("doubtful", ~table["decided"], 0.25),
    ):
        own = probability.where(chosen)
        canvas.draw_xy(name, "line_xy", joined(0 * own, own), y, alpha=alpha, **bar)
    ends = joined(probability - error, probability + error).clip(0, 1).where(error > 0)
    plain: dict[str, Any] = {"color": "0.1", "ignore_aes": {"color"}, **here}
    canvas.draw_xy("error", "line_xy", ends, y, width=1.2, **plain)
    mark: dict[str, Any] = {"function": "scatter_xy", "clip_on": False}
    beside = (1.035 * table["true"]).broadcast_like(probability)
    canvas.draw_xy("true", x=beside, y=y, marker="<", size=20, **mark, **here)
    if "p_value" in table:
        own = {"coords": {"panel": "p_value"}, "marker": "d", "size": 16}
        canvas.draw_xy("p_value", x=table["p_value"], y=y, **mark, **own)


def _legend_of(table: xr.Dataset) -> dict[str, dict[str, Any]]:
    """Legend entries of errors, marks of true classes and p-values."""
    grey, marks = {"color": "0.3"}, {"linestyle": "none", "markersize": 5}
    entries: dict[str, dict[str, Any]] = {}
    if bool((table["error"] > 0).any()):
        entries["± one standard error"] = {"color": "0.1"}
    if bool(table["true"].notnull().any()):
        entries["true class"] = grey | marks | {"marker": "<"}
    if "p_value" in table:
        entries["p-value"] = grey | marks | {"marker": "d"}
    return entries


def _draw_limits(
    canvas: Canvas, table: xr.Dataset, limits: Mapping[str, float]
) -> dict[str, dict[str, Any]]:
    """Draw the limits of the decision; return their legend entries."""
    entries: dict[str, dict[str, Any]] = {}
    for panel, style, (name, limit) in zip(_PANELS, (":", "--"), limits.items(), strict=True):
        if limit and panel in table:
            line = {"color": "0.3", "linestyle": style}
            level = xr.full_like(table["model"], limit, dtype=float).to_dataset(name="classes")
            settings: dict[str, Any] = {"coords": {"panel": panel}, "ignore_aes": "all", "width": 1}
            canvas.draw(name, "vline", data=level, **settings, **line)
            entries[f"{name.replace('_', ' ')} {limit:g}"] = line
    return entries


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


def _labels(result: Any) -> tuple[str, list[str], list[str], list[str | None]]:
    """Dimension of the rows, their headings, the classes, and the true class of each row."""
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
    known = ("specimen", "experiment", "group", "true_class")
    columns = {name: result[name].values.tolist() for name in known if name in result.coords}
    headings, truth = [], []
    for i in range(result.sizes[row]):
        of_row = {name: column[i] for name, column in columns.items()}
        heading = str(of_row.get("specimen", f"{row} {i + 1}"))
        if "experiment" in of_row:
            heading += f", experiment {of_row['experiment']}"
        headings.append(heading)
        true = of_row.get("true_class", of_row.get("group"))
        truth.append(true if true in classes else None)
    if len(set(headings)) < len(headings):
        headings = [f"{i}: {heading}" for i, heading in enumerate(headings, 1)]
    return row, headings, classes, truth
