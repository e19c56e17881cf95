"""Fits: a panel for each specimen with its data, its posterior curves and their residuals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import cycle
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.sheets import sheets_of, tubes_of
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.curves import BAND_VISUALS, draw_bands
from pymc_hyperelastic.plots.fit_figure import (
    RESIDUAL,
    Ends,
    FitFigure,
    ends_of_x,
    ends_of_y,
    figure_of,
)
from pymc_hyperelastic.plots.fitted_curves import SIGNALS, Specimen, data_beside, specimens_in
from pymc_hyperelastic.plots.fitted_sheets import tests_apart
from pymc_hyperelastic.plots.labels import axis_label, beside_panel, words
from pymc_hyperelastic.plots.panels import MOST_PANELS, evenly, panels_with_strips
from pymc_hyperelastic.plots.style import (
    MARKERS,
    Backend,
    Canvas,
    Visuals,
    Wishes,
    fitted_classes,
    law_of,
    literal,
    many_looks,
    training_attrs,
    with_margin,
)
from pymc_hyperelastic.predictions.curves import warn_of_no_force
from pymc_hyperelastic.predictions.offsets import less_offsets

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

# Light colours on which titles of panels stand, one for each group: other hues than those of tests.
_TINTS = ["#E2E2E2", "#FFE0AE", "#CDE7F7", "#F3D6E6", "#CBEADF"]

SignalName = Literal[
    "pressure", "stiffness", "axial_force", "extension_radius", "extension_force", "stress"
]


@one_thread
def plot_fit(
    classes: xr.DataTree,
    data: xr.Dataset | Mapping[str, xr.Dataset] | None = None,
    *,
    signal: SignalName | None = None,
    specimens: Sequence[str] | None = None,
    residuals: bool = False,
    ci_prob: float = 0.95,
    energy: StrainEnergy | Sequence[Layer] | None = None,
    pressure_unit: str = "kPa",
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    """Plot the fit of each specimen: its data, and the posterior of its curves, in its own panel.

    If specimens differ (``variability="specimen"``, :func:`~pymc_hyperelastic.population_model`),
    the curves have the parameters of the specimen, given its data and its class. Otherwise they are
    the curves of its class in the tube of the specimen. A specimen to which the class was not
    fitted has the curves of the typical specimen, and the title says so.

    The band is that of the response of the tube, without measurement error: it is as narrow as the
    parameters are well known, and data may lie beside it. The median is dashed beyond the data to
    which it was fitted, see :func:`~pymc_hyperelastic.predict_pressure`. Tests at several axial
    stretches have a colour and a marker each.

    Panels are in the order of the classes, or of the groups if there is one class. If there are
    more than 24 specimens, 24 of them are shown, evenly chosen; the title says so, and `specimens`
    shows others.

    Parameters
    ----------
    classes : xarray.DataTree
        Result of :func:`pymc_hyperelastic.fit_classes`, one of its classes, or a sampled model.
    data : xarray.Dataset or dict of str to xarray.Dataset, optional
        Data to show, or those for each class; by default the training data.
    signal : str, optional
        The signal to show; by default the first of these that the data have:

        - ``"pressure"``: pressures of inflation tests, over the measured radius or diameter;
        - ``"stiffness"``: slopes of the same curves, and central differences of the data;
        - ``"axial_force"``: axial forces of inflation tests;
        - ``"extension_radius"``: radii, or diameters, of extension tests over the axial stretch,
          at the measured pressures;
        - ``"extension_force"``: axial forces of extension tests, at the measured pressures;
        - ``"stress"``: stresses of sheets over the stretches, as :func:`plot_sheet_tests` shows
          them, in kPa, with a panel for each test. If tubes were measured too, the signal must be
          named.
    specimens : list of str, optional
        Specimens to show; by default all, at most 24.
    residuals : bool, default False
        If True, a strip below each panel shows standardised residuals: measured value minus
        posterior median of the curve, in standard deviations of the measurement error, with lines
        at ±2. The likelihood must be known, and must use the signal.
    ci_prob : float
        Probability that the band holds at each point, with equal tails.
    energy : StrainEnergy or list of Layer, optional
        The material, or the layers; needed if the result does not name it.
    pressure_unit : str, default "kPa"
        Unit of pressures, as pint knows it.
    backend, visuals, **pc_kwargs
        See :func:`~pymc_hyperelastic.plot_inflation`. The visuals are ``band``, ``median``,
        ``extrapolated`` (the dashed part of the median), ``points``, ``beyond`` (slopes beyond the
        axis), ``xlabel``, ``ylabel``, ``title`` (of a panel) and ``legend``.

    Returns
    -------
    arviz_plots.PlotCollection
        Its variables are the signal and, with `residuals`, ``residual``. Its dimensions are
        ``class_label`` (``group`` if one class has several groups), ``specimen``, ``curve`` and,
        if tests have colours, ``axial_stretch`` or ``experiment``. For stresses of sheets
        ``specimen`` names tests, and ``axis`` is the dimension of the colours.

    Warns
    -----
    UserWarning
        If a force is 0 whatever the parameters, see
        :func:`~pymc_hyperelastic.predict_axial_force`.

    Raises
    ------
    TypeError, ValueError
        If `classes` is no DataTree with a posterior, there are no data, no such tests, no such
        specimen or no strain energy, the data are unsound or lack a class, `residuals` are not
        known, or `ci_prob`, the signal, the unit, the backend or a visual is unknown.

    See Also
    --------
    predict_pressure, predict_axial_force, predict_stress, diagnose_evidence

    Notes
    -----
    The horizontal axis is the outer diameter if this was measured, so that data are where they were
    measured even if the wall is inferred. If the likelihood has an offset of the force transducer
    (``force_offset_sd``), forces are shown less the posterior mean of the offset of their test.
    Slopes far from all others, which close readings cause, are drawn as diamonds at the end of the
    axis. Bands that reach further beyond the data than twice the largest datum go on beyond the
    axis. The legend says all three.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1")
    >>> tree = ph.open_result("sampled.nc")  # saved from the example of sample_smc
    >>> figure = ph.plot_fit(tree, data, backend="none")
    >>> figure.viz["plot"]["specimen"].values.tolist()
    ['S1']
    """
    fitted = fitted_classes(classes)
    shown = data_beside(fitted, data)
    name = _checked_signal(signal, shown)
    part_of = sheets_of if SIGNALS[name].of_sheets else tubes_of
    parts = {label: part_of(tests) for label, tests in shown.items()}
    shown = {label: tests for label, tests in parts.items() if tests is not None}
    fitted = {label: tree for label, tree in fitted.items() if label in shown}
    of_force = SIGNALS[name].quantity == "axial_force"
    if of_force:
        shown = {label: less_offsets(tests, fitted[label]) for label, tests in shown.items()}
    group, found = specimens_in(fitted, shown)
    found = [one for one in found if SIGNALS[name].has_tests(one.tests).any()]
    chosen, note = _chosen(found, specimens, by_test=SIGNALS[name].of_sheets)
    settings: dict[str, Any] = {"energy": energy, "ci_prob": ci_prob, "residuals": residuals}
    figure = figure_of(name, chosen, group, pressure_unit, settings)
    if residuals and not figure.has_residuals:
        raise ValueError(
            f"residuals=True, but the fit does not state a likelihood that uses {name!r}, or the "
            "data do not have it: leave residuals out"
        )
    if of_force:
        warn_of_no_force(figure.curves[name].sel(plot_axis=["y_bottom", "y_top"]))
    canvas = _canvas(figure, (backend, visuals, pc_kwargs))
    x, y = ends_of_x(figure), ends_of_y(figure)
    entries = _draw(canvas, figure, ci_prob) | _limit(canvas, figure, x, y)
    _label(canvas, figure, pressure_unit, (x.shared, y.shared))
    canvas.legend(entries)
    typical = "typical specimen" if any(one.is_typical for one in chosen) else None
    law = law_of(next(iter(fitted.values())), energy)
    # The posterior is as simulated as the data that it comes from.
    origin = [{"simulated": attrs.get("simulated")} for attrs in training_attrs(fitted)]
    canvas.title([*(tests.attrs for tests in shown.values()), *origin], law, typical, note)
    return canvas.collection


def _checked_signal(signal: str | None, data: Mapping[str, xr.Dataset]) -> str:
    """Return the signal, by default the first that the data have; ValueError if they lack it."""
    if signal is not None and signal not in SIGNALS:
        raise ValueError(f"signal is {signal!r}; expected one of {[*SIGNALS]}")
    found = [n for n, s in SIGNALS.items() if any(s.has_tests(d).any() for d in data.values())]
    if signal is None:
        return found[0]
    if signal not in found:
        kind = SIGNALS[signal].tests
        raise ValueError(f"signal is {signal!r}, but there are no {kind}: give one of {found}")
    return signal


def _chosen(
    found: list[Specimen], names: Sequence[str] | None, by_test: bool = False
) -> tuple[list[Specimen], str | None]:
    """Return the specimens that are shown, and what the title says if some are not shown."""
    if names is None:
        panels = tests_apart(found) if by_test else found
        chosen = [panels[i] for i in evenly(len(panels), MOST_PANELS)]
        what = "tests" if by_test else "specimens"
        note = f"{len(chosen)} of {len(panels)} {what}" if len(chosen) < len(panels) else None
        return chosen, note
    names = [names] if isinstance(names, str) else list(names)
    known = list(dict.fromkeys(one.name for one in found))
    unknown = [name for name in names if name not in known]
    if unknown or not names:
        what = f"no specimen {unknown[0]!r} in the data" if unknown else "specimens is empty"
        raise ValueError(f"{what}: expected some of {known}")
    chosen = [one for one in found if one.name in names]
    note = f"{len(chosen)} of {len(found)} specimens" if len(chosen) < len(found) else None
    return tests_apart(chosen) if by_test else chosen, note


def _canvas(figure: FitFigure, wishes: Wishes) -> Canvas:
    """Make the panels, each with a strip below it if there are residuals."""
    count, columns, strip = len(figure.specimens), figure.columns, 0.7 * figure.has_residuals
    wide, high = (4.2, 2.8) if count == 1 else (2.35, 1.75)
    size = wide * columns + 0.5, (high + strip) * -(-count // columns) + 0.95
    settings: dict[str, Any] = {"aes": {"color": [figure.by or figure.group]}}
    if figure.by:
        # Each of a few labels has a marker of its own, which differs in grey, too.
        few = figure.curves.sizes[figure.by] <= len(MARKERS)
        settings |= many_looks() | ({"marker": MARKERS} if few else {})
        settings["aes"] |= {"linestyle": [figure.by], "marker": [figure.by]}
    settings["aes"]["overlay"] = ["curve"]
    known = f"{BAND_VISUALS} points beyond"
    share = {"height_ratios": [high, strip] if strip else [high]}
    places = [figure.panel(one) for one in figure.specimens]
    make = partial(panels_with_strips, places=places, columns=columns)
    return Canvas(make, figure.of_each_curve, known, wishes, size, share, **settings)


def _draw(canvas: Canvas, figure: FitFigure, ci_prob: float) -> dict[str, dict[str, Any]]:
    """Draw bands, data, residuals and ends of axes; return the entries of the legend."""
    entries: dict[str, dict[str, Any]] = {}
    if figure.by:
        style = ("color", "linestyle", "marker")[: 3 if figure.points else 2]
        entries |= canvas.entries(figure.by, f"{words(figure.by)} ", *style, markersize=4)
        if figure.has_tints:
            patch = {"marker": "s", "markersize": 8, "linestyle": "none"}
            for label, tint in _tints_of(figure).items():
                entries[f"{words(figure.group)} {literal(label)}"] = patch | {"color": tint}
    else:
        entries |= canvas.entries(figure.group, f"{words(figure.group)} ", "color")
    if figure.points:
        data = "data (of that colour)" if figure.by else "data"
        data += ", less its test's offset" * figure.less_offsets
        entries[data] = {"color": "0.25", "marker": "o", "markersize": 3, "linestyle": "none"}
        _draw_points(canvas, figure.points, "points", figure.by)
    entries |= draw_bands(canvas, figure.curves, ci_prob)
    return entries


def _tints_of(figure: FitFigure) -> dict[str, str]:
    """Return the colour of the titles of each group."""
    return dict(zip(figure.curves[figure.group].values.tolist(), cycle(_TINTS), strict=False))


def _draw_points(
    canvas: Canvas, points: xr.Dataset, name: str, by: str | None, **settings: Any
) -> None:
    """Draw points in the colour of their band, or in grey where there is one band."""
    looks: dict[str, Any] = {"size": 10, "ignore_aes": {"linestyle"}}
    if by is None:
        looks = {"size": 7, "color": "0.25", "ignore_aes": {"color"}}
    canvas.draw(name, "scatter_xy", data=points, **{"alpha": 0.6} | looks | settings)


def _limit(canvas: Canvas, figure: FitFigure, x: Ends, y: Ends) -> dict[str, dict[str, Any]]:
    """Limit all axes; return what the legend says of bands and data beyond them."""
    variables, signal = figure.of_each_panel, figure.signal
    for panel in map(figure.panel, figure.specimens):
        own = variables.sel(panel, drop=True)
        canvas.adjust("set_xlim", data=own, coords=panel, limits=x.of(panel))
        canvas.adjust("set_ylim", data=own[[signal]], coords=panel, limits=y.of(panel))
    if len(figure.specimens) > 1:
        canvas.few_xticks(4)
    if figure.has_residuals:
        _limit_residuals(canvas, figure)
    entries: dict[str, dict[str, Any]] = {}
    bands = figure.curves[signal].sel(plot_axis=["y_bottom", "y_top"])
    if bool(((bands < y.low) | (bands > y.high)).any()):
        entries["bands go on beyond the axis"] = {"color": "0.4", "linewidth": 0}
    if signal in figure.points:
        entries |= _draw_beyond(canvas, figure, y)
    return entries


def _limit_residuals(canvas: Canvas, figure: FitFigure) -> None:
    """Draw lines at 0 and at ±2, which one of twenty residuals exceeds, and limit the axes."""
    strips = {"data": figure.points[[RESIDUAL]]}

    def draw_levels(da: xr.DataArray, target: Any) -> None:
        for level, style in ((0.0, "-"), (-2.0, "--"), (2.0, "--")):
            canvas.backend.hline(level, target, color="0.6", width=0.8, linestyle=style)

    canvas.adjust(draw_levels, **strips)
    largest = float(np.abs(figure.points[RESIDUAL].sel(plot_axis="y")).max())
    reach = max(3.0, with_margin(-largest, largest)[1])
    canvas.adjust("set_ylim", limits=(-reach, reach), **strips)
    if reach < 8:  # else the numbers would overlap
        canvas.set_yticks([-2, 2], ["−2", "2"], **strips)


def _draw_beyond(canvas: Canvas, figure: FitFigure, ends: Ends) -> dict[str, dict[str, Any]]:
    """Draw data beyond the ends of their axis as diamonds there; return what the legend says."""
    points = figure.points[[figure.signal]]
    y = points.sel(plot_axis="y", drop=True)
    beyond = (y < ends.low) | (y > ends.high)
    far, count = int(beyond[figure.signal].sum()), int(np.isfinite(y[figure.signal]).sum())
    if not far:
        return {}
    clipped = points.clip(ends.low, ends.high)
    at_ends = xr.where(points["plot_axis"] == "y", clipped, points).where(beyond)
    looks = {"marker": "D", "size": 20, "alpha": 1, "clip_on": False, "zorder": 5}
    _draw_points(canvas, at_ends, "beyond", figure.by, **looks)
    marker = {"marker": "D", "linestyle": "none", "color": "0.25", "markersize": 5}
    return {f"{far} of {count} slopes beyond the axis": marker}


def _label(
    canvas: Canvas, figure: FitFigure, pressure_unit: str, shared: tuple[bool, bool]
) -> None:
    """Name the specimens, and label the axes of the panels on the left and at the bottom.

    Numbers are hidden on an axis that another panel on the left, or below, has as well.
    """
    variables, signal, tints = figure.of_each_panel, figure.signal, _tints_of(figure)
    horizontal, vertical = figure.quantities
    for n, one in enumerate(figure.specimens):
        coords = figure.panel(one)
        whole = {"data": variables.sel(coords, drop=True), "coords": coords}
        panel = whole | {"data": whole["data"][[signal]]}
        strip = whole | {"data": whole["data"].drop_vars(signal)}
        box = {"facecolor": tints[one.label], "edgecolor": "none", "pad": 2.0}
        canvas.label(
            "title", one.name, size="small", **panel, **{"bbox": box} if figure.has_tints else {}
        )
        lowest = strip if figure.has_residuals else panel
        hidden = {"axis": "x", "visible": False}
        if figure.has_residuals:
            canvas.adjust("set_ticklabel_visibility", **panel, **hidden)
        if n + figure.columns >= len(figure.specimens):
            canvas.label("xlabel", axis_label(horizontal), **lowest)
        elif shared[0]:
            canvas.adjust("set_ticklabel_visibility", **lowest, **hidden)
        if n % figure.columns == 0:
            canvas.label("ylabel", beside_panel(axis_label(vertical, pressure_unit)), **panel)
            canvas.label("ylabel", "residual\n(SD)", **strip)
        else:
            beside = whole if shared[1] else strip
            canvas.adjust("set_ticklabel_visibility", axis="y", visible=False, **beside)
