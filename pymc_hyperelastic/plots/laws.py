"""The probability of each strain energy, and the evidences that it rests on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.classes.average import laws_of_fits
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.rows import heights, joined, row_panels, write
from pymc_hyperelastic.plots.style import (
    MARKERS,
    Backend,
    Canvas,
    Visuals,
    check_table,
    rounded_probability,
    training_attrs,
    with_margin,
)
from pymc_hyperelastic.rounding import rounded

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

_PANELS = ("probability", "log_evidence")
_NEEDED = ("log_evidence", "log_evidence_se", "probability", "probability_se")
_ORIGIN = "ph.classify(..., average_over=...)"


@one_thread
def plot_law_probability(
    result: xr.Dataset | Mapping[str, xr.DataTree] | Sequence[xr.DataTree],
    *,
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    r"""Plot how probable each strain energy is, and by how many nats evidences differ.

    If all laws ``k`` are equally probable beforehand, their probabilities are

    .. math:: P_k = \frac{Z_k}{\sum_j Z_j},

    with the most probable law on top. Beside it stands the log evidence ``ln Z_k`` less the largest
    one. Lines are one standard error to each side: that of a difference includes the errors of both
    evidences, and that of a probability is the root mean square over draws of all evidences within
    their errors. If the error of an evidence is infinite, the law "cannot be judged", and no
    probability can: the law might be the best.

    For several classes, small markers show how probable each law is by one class alone. The
    evidence of all classes together is the product of theirs, since each class has parameters of
    its own.

    Parameters
    ----------
    result : xarray.Dataset, or dict or list of xarray.DataTree
        Result of :func:`pymc_hyperelastic.classify` with `average_over`; or the fits themselves,
        results of :func:`pymc_hyperelastic.sample_smc`, classes of a
        :func:`pymc_hyperelastic.fit_classes`, or results of it as a whole. A dict names them; of a
        list each has the name of its strain energy.
    backend, visuals, **pc_kwargs
        See :func:`~pymc_hyperelastic.plot_inflation`. The visuals are ``bar``, ``points`` (the
        differences), ``error``, ``number``, ``class_points``, ``class_error``, ``xlabel`` and
        ``legend``.

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
        If a fit does not state its data or its noise.

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
    table, attrs = _table(result)
    labels = [fill(label, 26) for label in table["strain_energy"].values.tolist()]
    classes = table.sizes["class_label"] if "class_probability" in table else 0
    lines = max(1 + classes, *(label.count("\n") + 1 for label in labels))
    names = ["value", *(["class_probability"] if classes else [])]
    # A panel of NaN would be left out.
    data = table[names].to_dataarray().sum("variable").to_dataset(name="law")
    by = "class_label" if classes else "strain_energy"
    canvas = row_panels(
        data,
        "bar points error number class_points class_error xlabel legend",
        (backend, visuals, pc_kwargs),
        labels,
        0.15 + 0.17 * lines,
        aes={"color": [by], "marker": [by], "overlay": ["strain_energy"]},
        marker=MARKERS,
    )
    limits = _limits(table)
    canvas.adjust("set_xlim", limits=limits[1], coords={"panel": "log_evidence"})
    canvas.end_at_0_and_1(coords={"panel": "probability"})
    # The bar of a law is above the markers of its classes.
    places = np.linspace(0.26, -0.28, 1 + classes) if classes else np.zeros(1)
    rows = heights("strain_energy", len(labels))
    _draw_laws(canvas, table, limits, rows, float(places[0]))
    if classes:
        _draw_classes(canvas, table, rows + xr.DataArray(places[1:], dims="class_label"))
    canvas.title(attrs, "strain energies by their evidence")
    return canvas.collection


def _table(result: Any) -> tuple[xr.Dataset, list[Mapping[Any, Any]]]:
    """Numbers of each law by panel, the best law on top; and attributes of the data."""
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
                "the result holds probabilities of laws for each specimen that was left out; give "
                f"the result of {_ORIGIN}"
            )
    value, error, chance, chance_se = (laws[f"strain_energy_{name}"] for name in _NEEDED)
    judged = np.isfinite(error) & value.notnull()
    order = np.lexsort((-value.values, ~judged.values))
    best = int(order[0])
    # The difference of the best law from itself has no error.
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
    return drawn.assign_coords(panel=list(_PANELS)).isel(strain_energy=order), attrs


def _limits(table: xr.Dataset) -> list[tuple[float, float]]:
    """Ends of the axis of each panel."""
    difference, error = (table[name].sel(panel="log_evidence") for name in ("value", "error"))
    ends = np.array([difference - error, difference + error])
    shown = [-1.0, 0.0, *ends[np.isfinite(ends)].tolist()]
    return [(0.0, 1.0), with_margin(min(shown), max(shown))]


def _draw_laws(
    canvas: Canvas,
    table: xr.Dataset,
    limits: Sequence[tuple[float, float]],
    rows: xr.DataArray,
    above: float,
) -> None:
    """Draw bars, differences, their errors, and their numbers on the right."""
    y = rows + xr.DataArray([above, 0.0], {"panel": list(_PANELS)}, "panel")
    value, error = table["value"], table["error"]
    plain: dict[str, Any] = {"ignore_aes": {"color", "marker"}, "color": "0.1"}
    chance, difference = (value.where(value["panel"] == panel) for panel in _PANELS)
    bar = plain | {"color": "0.65", "width": 9 if above == 0 else 6, "solid_capstyle": "butt"}
    canvas.draw_xy("bar", "line_xy", joined(xr.zeros_like(chance), chance), y, **bar)
    ends = joined(value - error, value + error)
    ends = xr.where(ends["panel"] == "probability", ends.clip(0, 1), ends)
    canvas.draw_xy("error", "line_xy", ends, y, width=1.3, **plain)
    canvas.draw_xy("points", "scatter_xy", difference, y, size=22, **plain)
    right = [high + 0.03 * (high - low) for low, high in limits]
    beside = xr.DataArray(right, {"panel": list(_PANELS)}, "panel").broadcast_like(value)
    text = xr.apply_ufunc(_number, value, error, table["known"], value["panel"], vectorize=True)
    write(canvas, "number", (beside, y), text, table["known"], ignore_aes={"color", "marker"})


def _draw_classes(canvas: Canvas, table: xr.Dataset, y: xr.DataArray) -> None:
    """Draw the probabilities by one class alone, and the legend."""
    value, error = (table[f"class_probability{end}"] for end in ("", "_se"))
    here: dict[str, Any] = {"coords": {"panel": "probability"}}
    ends = joined(value - error, value + error).clip(0, 1)
    canvas.draw_xy("class_error", "line_xy", ends, y, width=1.0, ignore_aes={"marker"}, **here)
    canvas.draw_xy("class_points", "scatter_xy", value, y, size=18, clip_on=False, **here)
    entries: dict[str, dict[str, Any]] = {"by all classes": {"color": "0.65", "linewidth": 6}}
    marks: dict[str, Any] = {"linestyle": "none", "markersize": 5}
    canvas.legend(entries | canvas.entries("class_label", "by class ", "color", "marker", **marks))


def _number(value: float, error: float, known: bool, panel: str) -> str:
    """Number of a law with its error, if it is known."""
    if not known:
        return "cannot be judged"
    if panel == "probability":
        return rounded_probability(value, error)
    if error:
        return " ± ".join(rounded([value, error], error))
    return rounded([value], 0.1)[0]  # exact differences have two decimals
