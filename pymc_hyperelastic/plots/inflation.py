"""The measured curves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.inflation import (
    at_points,
    check_inflation_data,
    extension_tests,
    points_of,
)
from pymc_hyperelastic.data.select import specimens_of, tests_at
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.style import (
    DIAMETER_LABEL,
    MARKERS,
    RADIUS_LABEL,
    STRETCH_LABEL,
    Backend,
    Canvas,
    Visuals,
    by_stretch,
    per_kilopascal,
    stretch_labels,
    told_apart,
)

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

# Specimens and tests in one figure: more can neither be told apart nor drawn in some seconds.
_MOST_SPECIMENS = 60
_MOST_TESTS = 240
# From the coarsest, and as figures name them.
_LABELS = {
    "group": "group",
    "specimen": "specimen",
    "axial_stretch": "axial stretch",
    "experiment": "experiment",
}


@one_thread
def plot_inflation(
    data: xr.Dataset,
    *,
    group_by: Literal["group", "specimen", "axial_stretch", "experiment"] | None = "group",
    pressure_unit: str = "mmHg",
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    """Plot the measured curves: pressure over internal radius, or outer diameter if that was read.

    Extension tests have panels of their own beside these: axial force over axial stretch, or if no
    forces were measured the radius, or the diameter. Of the others, forces are not shown.

    Colours tell specimens apart, or groups where a panel holds several; where there are more than
    seven, line styles do it with them. Markers tell axial stretches, or if there is one, or as many
    as there are specimens, experiments. The curves of a single specimen have colours by axial
    stretch, where that varies by the pressure.

    Of more than 60 specimens, or 240 tests, so many are shown, chosen evenly from the groups; the
    title says how many of how many.

    Parameters
    ----------
    data : xarray.Dataset
        Inflation data, see :func:`pymc_hyperelastic.inflation_data`.
    group_by : {"group", "specimen", "axial_stretch", "experiment"} or None
        What has a panel of its own; with None all curves share one.
    pressure_unit : str
        Unit of the pressure axis, as pint knows it.
    backend : {"matplotlib", "none"}
        Plotting backend; ``"none"`` only collects what would be drawn.
    visuals : dict of str to dict or bool, optional
        Settings of ``line``, ``points``, ``xlabel``, ``ylabel``, ``title`` (of a panel) and
        ``legend``; False leaves one out.
    **pc_kwargs
        Passed to :meth:`arviz_plots.PlotCollection.wrap`.

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
    inflation_data

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> figure = ph.plot_inflation(ph.load_dataset("simulated_sheep_aorta"), backend="none")
    >>> figure.viz["plot"]["group"].values
    array(['C1', 'C2'], dtype='<U2')
    """
    from arviz_plots.visuals import line_xy, scatter_xy

    check_inflation_data(data)
    if group_by not in (*_LABELS, None):
        raise ValueError(f"group_by must be one of {', '.join(_LABELS)} or None, not {group_by!r}")
    data, of_many = _thinned(data)
    labels = {name: data[name].values.tolist() for name in _LABELS if name != "axial_stretch"}
    labels["axial_stretch"] = stretch_labels(data, pressure_unit)
    colour, marker = _told_by(labels, group_by)
    dims = [name for name in _LABELS if name in (group_by, colour, marker)]
    curves = _curves(data, {name: labels[name] for name in dims}, per_kilopascal(pressure_unit))
    canvas = _panels(
        curves,
        group_by,
        backend,
        visuals,
        pc_kwargs,
        aes={"color": [colour], "linestyle": [colour], "marker": [marker or colour]}
        | {"overlay": [*dims, "curve"]},
        **told_apart() | ({"marker": MARKERS} if marker else {}),
    )
    canvas.draw("line", line_xy, width=0.8, alpha=0.7, ignore_aes={"marker"})
    canvas.draw("points", scatter_xy, size=10, width=0.8, ignore_aes={"linestyle"})
    _label(canvas, curves, data, group_by, pressure_unit)
    if backend == "matplotlib":
        _blank(canvas, curves, group_by)
    entries: dict[str, Any] = {}
    if curves.sizes[colour] > 1 and colour != group_by:
        style = ("color", "linestyle") if marker else ("color", "linestyle", "marker")
        settings: dict[str, Any] = {"marker": "o", "markersize": 4}
        entries |= canvas.entries(colour, f"{_LABELS[colour]} ", *style, **settings)
    if marker:
        grey = {"color": "0.3", "linestyle": "none", "markersize": 5}
        entries |= canvas.entries(marker, f"{_LABELS[marker]} ", "marker", **grey)
    canvas.legend(entries)
    canvas.title([data.attrs], of_many)
    return canvas.collection


def _thinned(data: xr.Dataset) -> tuple[xr.Dataset, str | None]:
    """Return tests that one figure can show, evenly from all groups; and how many of how many."""
    names, of_test = specimens_of(data)
    tests, words = np.arange(of_test.size), None
    if len(names) > _MOST_SPECIMENS:
        groups = data["group"].values[np.unique(of_test, return_index=True)[1]]
        by_group = np.argsort(groups, kind="stable")
        tests = np.flatnonzero(np.isin(of_test, by_group[_evenly(len(names), _MOST_SPECIMENS)]))
        words = f"{_MOST_SPECIMENS} of {len(names)} specimens"
    if tests.size > _MOST_TESTS:
        tests = tests[_evenly(tests.size, _MOST_TESTS)]
        words = f"{_MOST_TESTS} of {of_test.size} tests"
    return (tests_at(data, tests), words) if words else (data, None)


def _evenly(count: int, most: int) -> np.ndarray:
    """Return so many positions among `count`, evenly from the first to the last."""
    return np.linspace(0, count - 1, most).round().astype(int)


def _panels(
    curves: xr.Dataset,
    group_by: str | None,
    backend: str,
    visuals: Visuals | None,
    given: dict[str, Any],
    **settings: Any,
) -> Canvas:
    """Panels side by side; where there are curves of two kinds, a row of both for each group."""
    known = "line points xlabel ylabel title legend"
    groups, kinds = curves.sizes[group_by] if group_by else 1, len(curves.data_vars)
    columns, rows = (min(groups, 3), -(-groups // 3)) if kinds == 1 else (kinds, groups)
    size = (3 * columns + (1.2 if columns > 1 else 2.2), 2.9 * rows + 0.3)
    of_groups = [group_by] if group_by else []
    if kinds == 1:
        figure = {"figsize": size, "sharey": True}
        settings |= {"cols": of_groups, "col_wrap": 3}
        return Canvas("wrap", curves, known, backend, visuals, given, figure, **settings)
    figure = {"figsize": size, "sharey": "col"}
    settings |= {"cols": ["__variable__"], "rows": of_groups}
    return Canvas("grid", curves, known, backend, visuals, given, figure, **settings)


def _label(
    canvas: Canvas, curves: xr.Dataset, data: xr.Dataset, group_by: str | None, pressure_unit: str
) -> None:
    """Label and limit the panels of each kind of curves."""
    from arviz_plots.visuals import set_xlim

    read = DIAMETER_LABEL if "outer_diameter" in data else RADIUS_LABEL
    axes = {
        "pressure": (read, f"pressure ({pressure_unit})"),
        "axial_force": (STRETCH_LABEL, "axial force (mN)"),
        "radius": (STRETCH_LABEL, read),
    }
    names = curves[group_by].values.tolist() if group_by else [None]
    several = len(curves.data_vars) > 1
    columns = 1 if several else min(len(names), 3)
    titled = set()
    for kind in map(str, curves.data_vars):
        one = {"data": curves[[kind]]}
        x = curves[kind].sel(plot_axis="x")
        low, high = (float(f(x)) for f in (np.nanmin, np.nanmax))
        margin = 0.04 * (high - low)
        canvas.adjust(set_xlim, limits=(low - margin, high + margin), **one)
        canvas.label("xlabel", axes[kind][0], **one)
        for i, name in enumerate(names):
            here = {"coords": {group_by: name}} if group_by else {}
            if i % columns == 0:
                canvas.label("ylabel", axes[kind][1], **one, **here)
            there = bool(x.sel(here.get("coords", {})).notnull().any())
            if group_by and len(names) > 1 and there and name not in titled:
                titled.add(name)
                canvas.label("title", f"{_LABELS[group_by]} {name}", size="medium", **one, **here)


def _blank(canvas: Canvas, curves: xr.Dataset, group_by: str | None) -> None:
    """Leave panels blank in which there is no curve, as of a group without extension tests."""
    if not group_by:
        return
    for kind, of_kind in curves.data_vars.items():
        for name in curves[group_by].values.tolist():
            if not of_kind.sel({group_by: name}).notnull().any():
                canvas.collection.get_viz("plot", kind, {group_by: name}).set_axis_off()


def _told_by(labels: Mapping[str, list], group_by: str | None) -> tuple[str, str | None]:
    """What colours tell apart, and what markers do, if anything.

    Colours tell the coarser of the labels that share a panel.
    """

    def count(*names: str | None) -> int:
        """How many tests these labels tell apart."""
        return len(set(zip(*(labels[name] for name in names if name), strict=True)))

    several = [name for name in _LABELS if count(name) > 1 and name != group_by]
    if not several:
        return "specimen", None
    colour, *finer = several
    # Stretches of which each specimen has its own are known by the order of its experiments.
    if "axial_stretch" in finer and count("axial_stretch") <= len(MARKERS):
        return colour, "axial_stretch"
    told = "experiment" in finer and count(group_by, colour, "experiment") > count(group_by, colour)
    return colour, "experiment" if told else None


def _curves(data: xr.Dataset, labels: Mapping[str, list], pressure_factor: float) -> xr.Dataset:
    """Curves by label: each is a dimension, so that panels and colours follow from it."""
    coords = {name: list(dict.fromkeys(values)) for name, values in labels.items()}
    if "axial_stretch" in coords:
        coords["axial_stretch"].sort(key=by_stretch)
    places = [
        tuple(coords[name].index(values[i]) for name, values in labels.items())
        for i in range(data.sizes["test"])
    ]
    # Cycles and phases of an experiment have the same labels.
    repeats = [places[:i].count(place) for i, place in enumerate(places)]
    longest = np.bincount(data["test"].values).max()
    shape = *map(len, coords.values()), max(repeats) + 1, 2, longest
    read = data["outer_diameter" if "outer_diameter" in data else "radius"].values
    extended, stretch = extension_tests(data), at_points(data, "axial_stretch")
    force = data["axial_force"].values if "axial_force" in data else np.full(read.size, np.nan)
    of_extended = np.isfinite(force) & extended[data["test"].values]
    pulled = ("axial_force", force) if of_extended.any() else ("radius", read)
    curves: dict[str, np.ndarray] = {}
    for i, (place, repeat) in enumerate(zip(places, repeats, strict=True)):
        test = points_of(data, i)
        kind, x, y = ("pressure", read, pressure_factor * data["pressure"].values)
        if extended[i]:
            (kind, y), x = pulled, stretch
        of_kind = curves.setdefault(kind, np.full(shape, np.nan))
        of_kind[place][repeat, :, : test.stop - test.start] = [x[test], y[test]]
    dims = (*coords, "curve", "plot_axis", "point")
    variables = {kind: (dims, curves[kind]) for kind in sorted(curves, key="pressure".__ne__)}
    return xr.Dataset(variables, {**coords, "plot_axis": ["x", "y"]})
