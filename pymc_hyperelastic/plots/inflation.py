"""The measured curves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.inflation import (
    at_points,
    check_data,
    extension_tests,
    points_of,
)
from pymc_hyperelastic.data.select import specimens_of, tests_at
from pymc_hyperelastic.data.sheets import tubes_of
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.curves import POINTS, Curve, gathered
from pymc_hyperelastic.plots.fitted_curves import stretch_labels
from pymc_hyperelastic.plots.labels import axis_label, words
from pymc_hyperelastic.plots.style import (
    MARKERS,
    Backend,
    Canvas,
    Visuals,
    Wishes,
    many_looks,
    per_kilopascal,
)

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

# Specimens and tests in one figure: more neither look different nor are drawn in some seconds.
_MOST_SPECIMENS = 60
_MOST_TESTS = 240
# Labels by which tests may be grouped, the coarsest first.
_GROUPINGS = ("group", "specimen", "axial_stretch", "experiment")
# Margin at both ends of a horizontal axis, as a fraction of its length.
_MARGIN = 0.04


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
    data = tubes
    if group_by not in (*_GROUPINGS, None):
        names = ", ".join(_GROUPINGS)
        raise ValueError(f"group_by must be one of {names} or None, not {group_by!r}")
    data, note = thinned(data)
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
    canvas = _panels(curves, group_by, (backend, visuals, pc_kwargs), looks)
    canvas.draw("line", "line_xy", width=0.8, alpha=0.7, ignore_aes={"marker"})
    canvas.draw("points", "scatter_xy", size=10, width=0.8, ignore_aes={"linestyle"})
    radius = "outer_diameter" if "outer_diameter" in data else "radius"
    _label(canvas, curves, group_by, radius, pressure_unit)
    if backend == "matplotlib":
        for axes in canvas.collection.get_viz("figure").axes:
            if not axes.has_data():
                axes.set_axis_off()
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

    def evenly(count: int, most: int) -> np.ndarray:
        return np.linspace(0, count - 1, most).round().astype(int)

    names, of_test = specimens_of(data)
    tests, note = np.arange(of_test.size), None
    if len(names) > _MOST_SPECIMENS:
        tests = np.flatnonzero(np.isin(of_test, evenly(len(names), _MOST_SPECIMENS)))
        note = f"{_MOST_SPECIMENS} of {len(names)} specimens"
    if tests.size > _MOST_TESTS:
        tests = tests[evenly(tests.size, _MOST_TESTS)]
        note = f"{_MOST_TESTS} of {of_test.size} tests"
    return (tests_at(data, tests), note) if note else (data, None)


def _panels(
    curves: xr.Dataset, group_by: str | None, wishes: Wishes, settings: dict[str, Any]
) -> Canvas:
    """Panels side by side; where there are curves of two kinds, a row of both for each group."""
    groups, kinds = curves.sizes[group_by] if group_by else 1, len(curves.data_vars)
    of_groups = [group_by] if group_by else []
    columns, rows = (kinds, groups) if kinds > 1 else (min(groups, 3), -(-groups // 3))
    layout: dict[str, Any] = {"cols": ["__variable__"], "rows": of_groups}
    if kinds == 1:
        layout = {"cols": of_groups, "col_wrap": 3}
    return Canvas(
        "wrap" if kinds == 1 else "grid",
        curves,
        "line points xlabel ylabel title legend",
        wishes,
        (max(3 * columns + 0.2, 4.4), 2.9 * rows + 0.5),
        {"sharey": "all" if kinds == 1 else "col"},
        **settings | layout,
    )


def _label(
    canvas: Canvas, curves: xr.Dataset, group_by: str | None, radius: str, pressure_unit: str
) -> None:
    """Label and limit the panels of each kind of curves."""
    kinds = list(map(str, curves.data_vars))
    names = curves[group_by].values.tolist() if group_by else [None]
    columns = min(len(names), 3) if len(kinds) == 1 else 1
    for kind in kinds:
        one = {"data": curves[[kind]]}
        x = curves[kind].sel(plot_axis="x")
        low, high = float(x.min()), float(x.max())
        margin = _MARGIN * (high - low)
        canvas.adjust("set_xlim", limits=(low - margin, high + margin), **one)
        horizontal = radius if kind == "pressure" else "axial_stretch"
        canvas.label("xlabel", axis_label(horizontal), **one)
        for i, name in enumerate(names):
            here = {group_by: name} if group_by else {}
            panel = {"data": curves[[kind]].sel(here, drop=True), "coords": here}
            if i % columns == 0:
                vertical = axis_label(radius if kind == "radius" else kind, pressure_unit)
                canvas.label("ylabel", vertical, **panel)
            if len(names) > 1:
                title = f"{words(str(group_by))} {name}"
                canvas.label("title", title, size="medium", **panel)


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
    radius = data["outer_diameter" if "outer_diameter" in data else "radius"].values
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
