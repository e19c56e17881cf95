"""The measured stresses of sheets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.inflation import check_data
from pymc_hyperelastic.data.select import tests_at
from pymc_hyperelastic.data.sheets import sheets_of
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.curves import POINTS, Curve, gathered
from pymc_hyperelastic.plots.inflation import panels_of_tests, thinned
from pymc_hyperelastic.plots.labels import axis_label, words
from pymc_hyperelastic.plots.panels import MOST_PANELS, evenly
from pymc_hyperelastic.plots.stretches import AXIS, sheet_curves, stress_label
from pymc_hyperelastic.plots.style import (
    MARKERS,
    Backend,
    Visuals,
    check_choice,
    many_looks,
    per_kilopascal,
)

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

_GROUPINGS = ("experiment", "specimen", "group")


@one_thread
def plot_sheet_tests(
    data: xr.Dataset,
    *,
    group_by: Literal["experiment", "specimen", "group"] | None = "experiment",
    stress_unit: str = "kPa",
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    """Plot the measured stresses of sheets over the stretches.

    There is a panel for each experiment, such as a protocol of biaxial tests. Stresses along x and
    y differ in colour, and are shown over the stretch along their own axis; a stress along an axis
    that is held, as in pure shear, is shown over the stretch along the other axis. If a panel holds
    several specimens, or several experiments, they differ in marker and line style.

    Tests of tubes in the same data are not shown, see :func:`plot_inflation`. If there are more
    than 60 specimens, 240 tests or 24 panels, as many of them are shown, evenly chosen; the title
    says so.

    Parameters
    ----------
    data : xarray.Dataset
        Data of sheets, see :func:`pymc_hyperelastic.sheet_data`, also with tests of tubes.
    group_by : {"experiment", "specimen", "group"} or None
        Label of the tests that share a panel; with None all tests share one.
    stress_unit : str, default "kPa"
        Unit of the stresses, as pint knows it.
    backend, visuals, **pc_kwargs
        See :func:`plot_inflation`.

    Returns
    -------
    arviz_plots.PlotCollection
        Its variable is ``stress``.

    Raises
    ------
    TypeError, ValueError
        If the data are unsound or hold no tests of sheets, or `group_by`, the unit, the backend or
        a visual is unknown.

    See Also
    --------
    sheet_data, plot_fit, plot_inflation

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> figure = ph.plot_sheet_tests(ph.load_dataset("treloar_rubber"), stress_unit="MPa")
    >>> figure.viz["plot"]["experiment"].values.tolist()
    ['uniaxial', 'equibiaxial', 'pure shear']
    """
    check_data(data)
    check_choice("group_by", group_by, (*_GROUPINGS, None))
    sheets = sheets_of(data)
    if sheets is None:
        raise ValueError("the data hold no tests of sheets: tubes are shown by ph.plot_inflation")
    sheets, note = _chosen(sheets, group_by)
    labels = {name: sheets[name].values.astype(str).tolist() for name in _GROUPINGS}
    finer = _label_in_panels(labels, group_by)
    dims = [name for name in (group_by, finer) if name]
    coords = {name: list(dict.fromkeys(labels[name])) for name in dims} | {AXIS: ["x", "y"]}
    scale = per_kilopascal(stress_unit)
    curves = []
    for of in sheet_curves(sheets):
        known = np.isfinite(of.stress)
        rows = np.array([of.stretch, scale * of.stress])[:, known]
        place = (*(labels[name][of.test] for name in dims), of.axis)
        curves.append(Curve("stress", place, rows))
    figure = gathered(curves, coords, POINTS)
    axes = {"stress": (axis_label("stretch"), axis_label(stress_label([sheets]), stress_unit))}
    title = "" if group_by in ("experiment", None) else f"{words(group_by)} "
    wishes, looks = (backend, visuals, pc_kwargs), _looks_of(finer)
    canvas = panels_of_tests(figure, (group_by, title), axes, wishes, looks)
    entries: dict[str, dict[str, Any]] = {}
    if len({of.labels[-1] for of in curves}) > 1:
        entries |= canvas.entries(AXIS, f"{words(AXIS)} ", "color", marker="o", markersize=4)
    if finer:
        grey = {"color": "0.3", "markersize": 5}
        entries |= canvas.entries(finer, f"{words(finer)} ", "marker", "linestyle", **grey)
    canvas.legend(entries)
    canvas.title([sheets.attrs], note)
    return canvas.collection


def _chosen(sheets: xr.Dataset, group_by: str | None) -> tuple[xr.Dataset, str | None]:
    """Choose tests that one figure can show, evenly from all, and say how many they are."""
    chosen, note = thinned(sheets)
    names = list(dict.fromkeys(chosen[group_by].values.tolist())) if group_by else []
    if len(names) > MOST_PANELS:
        kept = np.isin(chosen[group_by].values, [names[i] for i in evenly(len(names), MOST_PANELS)])
        chosen = tests_at(chosen, np.flatnonzero(kept))
        note = f"{MOST_PANELS} of {len(names)} {group_by}s"
    return chosen, note


def _label_in_panels(labels: dict[str, list[str]], group_by: str | None) -> str | None:
    """Return the label by which the tests of some panel differ; None if each has one test."""
    panels = labels[group_by] if group_by else [""] * len(labels["specimen"])
    for name in ("specimen", "experiment"):
        pairs = {*zip(panels, labels[name], strict=True)}
        if name != group_by and len(pairs) > len({*panels}):
            return name
    return None


def _looks_of(finer: str | None) -> dict[str, Any]:
    """Colours of the axes of stresses, and markers and line styles of tests."""
    if finer is None:
        return {"aes": {"color": [AXIS], "overlay": ["curve"]}}
    aes = {"color": [AXIS], "marker": [finer], "linestyle": [finer], "overlay": [finer, "curve"]}
    return many_looks() | {"marker": MARKERS * len(MARKERS), "aes": aes}
