"""The probability of each class for new experiments."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.plots.style import Backend, Canvas, Visuals, check_table, stacked

if TYPE_CHECKING:
    from arviz_plots import PlotCollection


def plot_class_probability(
    result: xr.Dataset | Mapping[str, xr.Dataset],
    *,
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    """Plot the probability of each class: a row for each new experiment, a bar for each class.

    Parameters
    ----------
    result : xarray.Dataset or dict of str to xarray.Dataset
        Result of :func:`pymc_hyperelastic.classify`; of a dict, such as one of strain energies,
        each has a column. What is not yet classified (NaN) has no bar.
    backend : {"matplotlib", "none"}
        Plotting backend; ``"none"`` only collects what would be drawn.
    visuals : dict of str to dict or bool, optional
        Settings of ``bar``, ``error`` (one standard error to each side), ``number``, ``xlabel``,
        ``ylabel`` and ``title`` (of a row); False leaves one out.
    **pc_kwargs
        Passed to :meth:`arviz_plots.PlotCollection.grid`.

    Returns
    -------
    arviz_plots.PlotCollection
        With the dimensions ``model`` (column), ``test`` or ``specimen`` (row), and
        ``class_label``.

    Raises
    ------
    TypeError, ValueError
        If `result` holds no class probabilities, results of a dict differ in their experiments or
        classes, or the backend or a visual is unknown.

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
    from arviz_plots.visuals import annotate_xy, ci_line_y, hist, set_xticks, set_ylim

    single = isinstance(result, xr.Dataset) or not isinstance(result, Mapping)
    results: dict[str, Any] = {"": result} if single else dict(result)
    labels = [_labels(of_model) for of_model in results.values()]
    row, headings, classes = labels[0]
    if any(other != labels[0] for other in labels):
        raise ValueError("the results differ in their experiments or classes; plot them apart")
    table = xr.concat(
        [r[["class_probability", "class_probability_se"]] for r in results.values()],
        dim="model",
        coords="minimal",
        compat="override",
    )
    table = table.reset_coords(drop=True).assign_coords({"model": list(results), row: headings})
    probability, error = table["class_probability"], table["class_probability_se"]
    width = max(1 + 0.55 * len(classes), 2.2)
    canvas = Canvas(
        "grid",
        table[["class_probability"]],
        "bar error number xlabel ylabel title",
        backend,
        visuals,
        pc_kwargs,
        {"figsize": (max(width * len(results) + 0.8, 3.6), 1.25 * len(headings) + 0.7)}
        | {"sharex": True, "sharey": True},
        rows=[row],
        cols=["model"],
        aes={"color": ["class_label"]},
    )
    place = xr.DataArray(np.arange(len(classes)), dims="class_label")
    place = place.where(probability.notnull())  # no bar where nothing is known
    edges = {"left_edges": place - 0.35, "right_edges": place + 0.35}
    bars = stacked("class_probability", **edges, histogram=probability)
    canvas.draw("bar", hist, data=bars.expand_dims("bar", axis=-1), alpha=0.75)
    top = (probability + error).clip(0, 1)
    bottom = (probability - error).clip(0, 1)
    ends = stacked("class_probability", x=place, y_bottom=bottom, y_top=top)
    canvas.draw("error", ci_line_y, data=ends, color="0.1", width=1.2)
    settings = {"vertical_align": "bottom", "color": "0.1", "size": 8}
    canvas.draw("number", annotate_xy, text=_number, x=place, y=top + 0.04, **settings)
    canvas.adjust(set_ylim, limits=(0, 1.3))
    canvas.adjust(_probability_ticks)
    canvas.adjust(set_xticks, values=range(len(classes)), labels=classes)
    for model, of_model in results.items():
        law = model or of_model.attrs.get("strain_energy")
        where = {"coords": {row: headings[-1], "model": model}}
        canvas.label("xlabel", f"class ({law})" if law else "class", **where)
    for heading in headings:
        where = {"coords": {row: heading, "model": next(iter(results))}}
        canvas.label("ylabel", "probability", **where)
        canvas.label("title", heading, size="small", loc="left", **where)
    canvas.title([r.attrs for r in results.values()], "class probabilities")
    return canvas.collection


def _labels(result: Any) -> tuple[str, list[str], list[str]]:
    """Dimension of the rows, their headings, and the classes."""
    variables = ("class_probability", "class_probability_se", "class_label")
    check_table(result, "ph.classify", *variables)
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


def _number(probability: float) -> str:
    if probability < 0.0005:
        return "<0.001"
    return ">0.999" if probability > 0.9995 else f"{probability:.3f}"


def _probability_ticks(da: xr.DataArray, target: Any) -> None:
    from arviz_plots.plot_collection import backend_from_object

    backend_from_object(target).yticks([0, 0.5, 1], ["0", "0.5", "1"], target)
