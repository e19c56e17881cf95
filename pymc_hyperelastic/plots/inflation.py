"""The measured curves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.inflation import at_points, check_data, extension_tests, points_of
from pymc_hyperelastic.data.select import specimens_of, tests_at
from pymc_hyperelastic.data.sheets import tubes_of
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.curves import POINTS, Curve, gathered
from pymc_hyperelastic.plots.fitted_curves import radius_of, stretch_labels
from pymc_hyperelastic.plots.labels import axis_label, words
from pymc_hyperelastic.plots.panels import columns_of, evenly, size_of
from pymc_hyperelastic.plots.style import (
    MARKERS,
    Backend,
    Canvas,
    Visuals,
    Wishes,
    check_choice,
    many_looks,
    per_kilopascal,
    with_margin,
)

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

# Specimens and tests in one figure: more neither look different nor are drawn in some seconds.
_MOST_SPECIMENS = 60
_MOST_TESTS = 240
# Labels by which tests may be grouped, the coarsest first.
_GROUPINGS = ("group", "specimen", "axial_stretch", "experiment")


@one_thread
def plot_inflation(
    data: xr.Dataset,
    *,
    group_by: Literal["group", "specimen", "axial_stretch", "experiment"] | None = "group",
    pressure_unit: str = "kPa",
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    """Plot the measured curves: pressure over internal radius, or over measured outer diameter.

    Extension tests have panels of their own beside these: axial force over axial stretch, or if no
    forces were measured the radius, or the diameter. Forces of inflation tests are not shown. Tests
    of sheets in the same data are shown by :func:`plot_sheet_tests`.

    Colours differ by specimen, or by group if a panel holds several; beyond seven of them, line
    styles differ, too. Markers differ by axial stretch; if there is one stretch, or each specimen
    has its own, by experiment. The curves of a single specimen have colours by axial stretch.

    If there are more than 60 specimens, or 240 tests, 60 or 240 of them are shown, evenly chosen;
    the title says so.

    Parameters
    ----------
    data : xarray.Dataset
        Inflation data, see :func:`pymc_hyperelastic.inflation_data`.
    group_by : {"group", "specimen", "axial_stretch", "experiment"} or None
        Label of the tests that share a panel; with None all tests share one.
    pressure_unit : str, default "kPa"
        Unit of the pressure axis, as pint knows it.
    backend : {"matplotlib", "none"}
        Plotting backend; ``"none"`` only collects what would be drawn.
    visuals : dict of str to dict or bool, optional
        Settings of each visual of the figure, passed to its function in ``arviz_plots.visuals``;
        False leaves it out. The visuals are ``line``, ``points``, ``xlabel``, ``ylabel``, ``title``
        (of a panel) and ``legend``.
    **pc_kwargs
        Passed to :meth:`arviz_plots.PlotCollection.wrap`, or ``grid`` where the figure is one, such
        as ``figure_kwargs={"figsize": (6, 3)}``.

    Returns
    -------
    arviz_plots.PlotCollection
        Its title is that of the data, and says whether they are simulated. Its variable is
        ``pressure``, and with extension tests ``axial_force`` or ``radius``.

    Raises
    ------
    TypeError, ValueError
        If the data are unsound, or `group_by`, the unit, the backend or a visual is unknown.

    See Also
    --------
    inflation_data, plot_sheet_tests

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> figure = ph.plot_inflation(ph.load_dataset("simulated_sheep_aorta"), backend="none")
    >>> figure.viz["plot"]["group"].values
    array(['C1', 'C2'], dtype='<U2')
    """
    check_data(data)
    tubes = tubes_of(data)
    if tubes is None:
        raise ValueError("the data hold no tubes: tests of sheets are shown by plot_sheet_tests")
    check_choice("group_by", group_by, (*_GROUPINGS, None))
    data, note = thinned(tubes)
    labels = {name: data[name].values.tolist() for name in _GROUPINGS if name != "axial_stretch"}
    coords = {name: list(dict.fromkeys(of_tests)) for name, of_tests in labels.items()}
    (labels["axial_stretch"],), coords["axial_stretch"] = stretch_labels([data], pressure_unit)
    colour, marker = _colour_and_marker(labels, group_by)
    dims = [name for name in _GROUPINGS if name in (group_by, colour, marker)]
    curves = gathered(
        _curves(data, [labels[name] for name in dims], pressure_unit),
        {name: coords[name] for name in dims},
        POINTS,
    )
    aes = {"color": [colour], "linestyle": [colour], "marker": [marker or colour]}
    looks = many_looks() | ({"marker": MARKERS} if marker else {})
    looks["aes"] = aes | {"overlay": [*dims, "curve"]}
    radius, title = radius_of(data), f"{words(group_by)} " if group_by else ""
    axes = {
        name: (
            axis_label(radius if name == "pressure" else "axial_stretch"),
            axis_label(radius if name == "radius" else name, pressure_unit),
        )
        for name in map(str, curves.data_vars)
    }
    wishes = backend, visuals, pc_kwargs
    canvas = panels_of_tests(curves, (group_by, title), axes, wishes, looks)
    for name in axes:
        x = curves[name].sel(plot_axis="x")
        ends = with_margin(float(x.min()), float(x.max()))
        canvas.adjust("set_xlim", limits=ends, data=curves[[name]])
    if backend == "matplotlib":
        for panel in canvas.collection.get_viz("figure").axes:
            if not panel.has_data():
                panel.set_axis_off()
    entries: dict[str, Any] = {}
    if colour != group_by:
        style = ("color", "linestyle") if marker else ("color", "linestyle", "marker")
        settings: dict[str, Any] = {"marker": "o", "markersize": 4}
        entries |= canvas.entries(colour, f"{words(colour)} ", *style, **settings)
    if marker:
        grey = {"color": "0.3", "linestyle": "none", "markersize": 5}
        entries |= canvas.entries(marker, f"{words(marker)} ", "marker", **grey)
    canvas.legend(entries)
    canvas.title([data.attrs], note)
    return canvas.collection


def thinned(data: xr.Dataset) -> tuple[xr.Dataset, str | None]:
    """Choose tests that one figure can show, evenly from all, and say how many they are."""
    names, of_test = specimens_of(data)
    note = None
    if len(names) > _MOST_SPECIMENS:
        note = f"{_MOST_SPECIMENS} of {len(names)} specimens"
    tests = np.flatnonzero(np.isin(of_test, evenly(len(names), _MOST_SPECIMENS)))
    if tests.size > _MOST_TESTS:
        note = f"{_MOST_TESTS} of {of_test.size} tests"
    return tests_at(data, tests[evenly(tests.size, _MOST_TESTS)]), note


def panels_of_tests(
    curves: xr.Dataset,
    by_group: tuple[str | None, str],
    axes: Mapping[str, tuple[str, str]],
    wishes: Wishes,
    looks: Mapping[str, Any],
) -> Canvas:
    """Draw measured curves and points in panels side by side, with labels.

    If there are curves of two kinds, each group has a row of both. `by_group` is the label of the
    panels, and how their titles begin; `axes` are the labels of the axes of each kind.
    """
    group_by, title = by_group
    groups = curves[group_by].values.tolist() if group_by else [None]
    cols, wraps = [group_by] if group_by else [], len(axes) == 1
    columns = columns_of(len(groups), 3) if wraps else len(axes)
    layout: dict[str, Any] = {"cols": ["__variable__"], "rows": cols}
    if wraps:
        layout = {"cols": cols, "col_wrap": columns}
    canvas = Canvas(
        "wrap" if wraps else "grid",
        curves,
        "line points xlabel ylabel title legend",
        wishes,
        size_of(len(groups) * len(axes), columns),
        {"sharey": "all" if wraps else "col"},
        **looks,
        **layout,
    )
    canvas.draw("line", "line_xy", width=0.8, alpha=0.7, ignore_aes={"marker"})
    canvas.draw("points", "scatter_xy", size=10, width=0.8, ignore_aes={"linestyle"})
    for kind, (horizontal, vertical) in axes.items():
        for i, group in enumerate(groups):
            here = {group_by: group} if group_by else {}
            panel = {"data": curves[[kind]].sel(here, drop=True), "coords": here}
            canvas.label("xlabel", horizontal, **panel)
            if not wraps or i % columns == 0:
                canvas.label("ylabel", vertical, **panel)
            if len(groups) > 1:
                canvas.label("title", f"{title}{group}", size="medium", **panel)
    return canvas


def _colour_and_marker(labels: Mapping[str, list], group_by: str | None) -> tuple[str, str | None]:
    """Labels that colours and markers show, if any: the coarser one in a panel has colours."""

    def count(*names: str | None) -> int:
        """Count combinations of these labels."""
        return len(set(zip(*(labels[name] for name in names if name), strict=True)))

    several = [name for name in _GROUPINGS if count(name) > 1 and name != group_by]
    if not several:
        return "specimen", None
    colour, *finer = several
    # If each specimen has stretches of its own, markers show its experiments.
    if "axial_stretch" in finer and count("axial_stretch") <= len(MARKERS):
        return colour, "axial_stretch"
    differs = "experiment" in finer and count(group_by, colour, "experiment") > count(
        group_by, colour
    )
    return colour, "experiment" if differs else None


def _curves(data: xr.Dataset, labels: list[list[str]], pressure_unit: str) -> list[Curve]:
    """The curve of each test with its labels: inflation tests before extension tests."""
    radius = data[radius_of(data)].values
    extended, stretch = extension_tests(data), at_points(data, "axial_stretch")
    force = data["axial_force"].values if "axial_force" in data else np.full(radius.size, np.nan)
    pulled = {"radius": [stretch, radius]}
    if np.isfinite(force[extended[data["test"].values]]).any():
        pulled = {"axial_force": [stretch, force]}
    inflated = {"pressure": [radius, per_kilopascal(pressure_unit) * data["pressure"].values]}
    curves = []
    for test in np.argsort(extended, kind="stable").tolist():
        ((name, xy),) = (pulled if extended[test] else inflated).items()
        own = tuple(of_tests[test] for of_tests in labels)
        curves.append(Curve(name, own, np.array(xy)[:, points_of(data, test)]))
    return curves
