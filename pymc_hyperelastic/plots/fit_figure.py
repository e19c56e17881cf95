"""The content of a figure of a fit: curves, points and residuals by panel, and ends of axes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.plots.curves import BAND, POINTS, Array, Curve, gathered
from pymc_hyperelastic.plots.fitted_curves import (
    SIGNALS,
    Specimen,
    curves_of,
    quantities_of,
    stretch_labels,
    tubes_of,
)
from pymc_hyperelastic.plots.fitted_sheets import stress_curves_of
from pymc_hyperelastic.plots.panels import columns_of
from pymc_hyperelastic.plots.stretches import AXIS, stress_label
from pymc_hyperelastic.plots.style import MARKERS, per_kilopascal, with_margin

#: Variable of the standardised residuals in a figure.
RESIDUAL = "residual"
# Panels share an axis if the data of each span at least this part of the data of all.
_LEAST_SPAN = 0.3


class Ends(NamedTuple):
    """Ends of the axes of all panels, by group and specimen."""

    low: xr.DataArray
    high: xr.DataArray
    shared: bool
    """True if all panels have the same ends."""

    def of(self, panel: Mapping[str, str]) -> tuple[float, float]:
        """Return the ends of the axis of a panel."""
        return float(self.low.sel(panel)), float(self.high.sel(panel))


class FitFigure(NamedTuple):
    """What a figure shows."""

    signal: str
    specimens: list[Specimen]
    group: str
    """Dimension of the labels of specimens: ``class_label``, or ``group`` if there is one class."""
    by: str | None
    """Dimension of tests by which curves have colours; None if they have those of `group`."""
    curves: xr.Dataset
    points: xr.Dataset
    """The variables are the signal, if it was measured, and the residuals."""
    less_offsets: bool
    """True if the offsets of their tests are subtracted from forces."""

    @property
    def has_residuals(self) -> bool:
        """True if there are strips of residuals."""
        return RESIDUAL in self.points

    @property
    def has_tints(self) -> bool:
        """True if titles have the colours of groups, because curves have those of tests."""
        return self.by is not None and self.curves.sizes[self.group] > 1

    @property
    def quantities(self) -> tuple[str, str]:
        """Quantities on the horizontal and on the vertical axis."""
        if SIGNALS[self.signal].of_sheets:
            return "stretch", stress_label(one.tests for one in self.specimens)
        return quantities_of(self.signal, self.specimens[0].tests)

    @property
    def columns(self) -> int:
        """Number of panels side by side."""
        return columns_of(len(self.specimens), 4)

    @property
    def of_each_curve(self) -> xr.Dataset:
        """The variables of the figure, with a number for each curve."""
        names = [self.signal] + [RESIDUAL] * self.has_residuals
        return xr.Dataset(
            dict.fromkeys(names, self.curves[self.signal].isel(plot_axis=0, drop=True))
        )

    @property
    def of_each_panel(self) -> xr.Dataset:
        """The variables of the figure, with a number for each panel, and NaN elsewhere."""
        each = self.of_each_curve
        return each.max([dim for dim in each.dims if dim not in (self.group, "specimen")])

    def panel(self, one: Specimen) -> dict[str, str]:
        """Coordinates of the panel of a specimen."""
        return {self.group: one.label, "specimen": one.name}


def figure_of(
    signal: str,
    specimens: list[Specimen],
    group: str,
    pressure_unit: str,
    settings: Mapping[str, Any],
) -> FitFigure:
    """Compute all curves, points and residuals of a figure."""
    of_pressure = signal in ("pressure", "stiffness")
    scale = per_kilopascal(pressure_unit) if of_pressure else 1.0
    if SIGNALS[signal].of_sheets:
        found = [[*stress_curves_of(one, **settings)] for one in specimens]
        order = sorted({axis for fits in found for axis, _ in fits})
        by = AXIS if len(order) > 1 else None
    else:
        by, labels, order = _labels_of_tests(signal, specimens, pressure_unit)
        found = [
            [(of_tests[fit.test], fit) for fit in curves_of(one, signal, **settings)]
            for one, of_tests in zip(specimens, labels, strict=True)
        ]
    curves, points = [], []
    offsets = False
    for one, fits in zip(specimens, found, strict=True):
        for label, fit in fits:
            place = (one.label, one.name) + ((label,) if by else ())
            curves.append(Curve(signal, place, fit.band * [[1.0], [1.0], *[[scale]] * 3]))
            measured = np.isfinite(fit.points[1])
            if measured.any():
                rows = fit.points * [[1.0], [scale]]
                points.append(Curve(signal, place, rows[:, measured]))
            if fit.residuals is not None:
                rows = np.array([fit.points[0], fit.residuals])
                points.append(Curve(RESIDUAL, place, rows[:, measured]))
            offsets |= fit.less_offset
    coords = {
        group: list(dict.fromkeys(one.label for one in specimens)),
        "specimen": list(dict.fromkeys(one.name for one in specimens)),
    } | ({by: order} if by else {})
    return FitFigure(
        signal,
        specimens,
        group,
        by,
        gathered(curves, coords, BAND),
        gathered(points, coords, POINTS),
        offsets,
    )


def _labels_of_tests(
    signal: str, specimens: list[Specimen], pressure_unit: str
) -> tuple[str | None, list[list[str]], list[str]]:
    """Return the dimension by which tests have colours, the label of each test, and all labels.

    The label is the axial stretch; if there are many, it is the name of the first experiment at
    this stretch. The dimension is None if the tests of each specimen are on one tube.
    """
    shown = [np.flatnonzero(SIGNALS[signal].has_tests(one.tests)) for one in specimens]
    labels, order = stretch_labels([one.tests for one in specimens], pressure_unit)
    by, used = "axial_stretch", _used(labels, shown)
    if len(set().union(*used)) > len(MARKERS):
        by, labels = "experiment", [_first_experiments(signal, one) for one in specimens]
        order = list(dict.fromkeys(label for own in labels for label in own))
        used = _used(labels, shown)
    names = set().union(*used)
    several = any(len(own) > 1 for own in used)
    differ = several or (by == "axial_stretch" and len(names) > 1)
    return by if differ else None, labels, [label for label in order if label in names]


def _used(labels: list[list[str]], shown: list[NDArray[np.intp]]) -> list[set[str]]:
    """Return the labels of the shown tests of each specimen."""
    return [{own[i] for i in tests} for own, tests in zip(labels, shown, strict=True)]


def _first_experiments(signal: str, one: Specimen) -> list[str]:
    """Return the name of the first experiment on the tube of each test of a specimen."""
    names = [str(name) for name in one.tests["experiment"].values.tolist()]
    if SIGNALS[signal].over_stretch:
        return names
    tubes = tubes_of(one.tests).tolist()
    return [names[tubes.index(tube)] for tube in tubes]


def ends_of_x(figure: FitFigure) -> Ends:
    """Return the ends of the horizontal axes."""
    x = figure.curves[figure.signal].sel(plot_axis="x", drop=True)
    return _ends(figure, x, x, lambda values, _: (values.min(), values.max()))


def ends_of_y(figure: FitFigure) -> Ends:
    """Return the ends of the vertical axes, which show the data, and bands near them."""
    bands = figure.curves[figure.signal].sel(plot_axis=["y_bottom", "y_top"])
    has_outliers = figure.signal == "stiffness"
    if figure.signal not in figure.points:
        return _ends(figure, bands, bands, lambda _, band: (band.min(), band.max()))
    measured = figure.points[figure.signal].sel(plot_axis="y", drop=True)
    return _ends(figure, measured, bands, lambda values, band: _near(values, band, has_outliers))


def _ends(
    figure: FitFigure,
    values: xr.DataArray,
    bands: xr.DataArray,
    ends: Callable[[Array, Array], tuple[float, float]],
) -> Ends:
    """Return ends of axes: of all panels, unless a panel would be narrow on such an axis."""
    panels = [figure.panel(one) for one in figure.specimens]
    by_panel = [_finite(values.sel(panel)) for panel in panels]
    spans = [np.ptp(own) for own in by_panel if own.size]
    shared = min(spans) >= _LEAST_SPAN * np.ptp(np.concatenate(by_panel))
    low = xr.full_like(figure.of_each_panel[figure.signal], np.nan)
    high = low.copy()
    whole = np.concatenate(by_panel), _finite(bands)
    for panel, own in zip(panels, by_panel, strict=True):
        alone = own.size and not shared
        at = ends(own, _finite(bands.sel(panel))) if alone else ends(*whole)
        low.loc[panel], high.loc[panel] = with_margin(*at)
    return Ends(low, high, bool(shared))


def _finite(values: xr.DataArray) -> Array:
    return values.values[np.isfinite(values.values)]


def _near(values: Array, band: Array, has_outliers: bool) -> tuple[float, float]:
    """Return the ends of an axis that shows data, and bands near them.

    Outliers are left out: data beyond Tukey's outer fences, three interquartile ranges from the
    quartiles. Bands have room for twice the largest datum above and below the data.
    """
    if has_outliers:
        quartiles = np.quantile(values, [0.25, 0.75])
        reach = 3 * np.ptp(quartiles)
        values = values[(values >= quartiles[0] - reach) & (values <= quartiles[1] + reach)]
    low, high = values.min(), values.max()
    room = 2 * np.abs(values).max() or np.inf
    return min(low, max(band.min(), low - room)), max(high, min(band.max(), high + room))
