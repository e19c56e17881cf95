"""The content of a figure of a fit: curves, points and residuals by panel, and ends of axes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from pymc_hyperelastic.plots.curves import BAND, POINTS, Array, Curve, gathered
from pymc_hyperelastic.plots.fitted_curves import (
    SIGNALS,
    Specimen,
    curves_of,
    radius_of,
    stretch_labels,
    tubes_of,
)
from pymc_hyperelastic.plots.fitted_sheets import stress_curves_of
from pymc_hyperelastic.plots.stretches import AXIS, stress_label
from pymc_hyperelastic.plots.style import MARKERS, per_kilopascal

#: Variable of the standardised residuals in a figure.
RESIDUAL = "residual"
# Panels share an axis if the data of each span at least this part of the data of all.
_SPAN = 0.3
# Interquartile ranges beyond which slopes are far out: Tukey's outer fence.
_FENCE = 3.0
# Room of bands above and below the data on an axis, in sizes of the largest datum.
_ROOM = 2.0
# Margin at both ends of an axis, as a fraction of its length.
_MARGIN = 0.06
# Least half length of the axis of residuals, in standard deviations.
_LEAST_REACH = 3.0


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
    def horizontal(self) -> str:
        """Quantity on the horizontal axis."""
        if SIGNALS[self.signal].of_sheets:
            return "stretch"
        if SIGNALS[self.signal].over_stretch:
            return "axial_stretch"
        return radius_of(self.specimens[0].tests)

    @property
    def vertical(self) -> str:
        """Quantity on the vertical axis."""
        if SIGNALS[self.signal].of_sheets:
            return stress_label(one.tests for one in self.specimens)
        if self.signal == "extension_radius":
            return radius_of(self.specimens[0].tests)
        return SIGNALS[self.signal].quantity

    @property
    def of_each_curve(self) -> xr.Dataset:
        """The variables of the figure, with a number for each curve."""
        names = [self.signal] + [RESIDUAL] * self.has_residuals
        return xr.Dataset(dict.fromkeys(names, self.curves[self.signal].isel(plot_axis=0)))

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
            [(of_tests[fit.tests[0]], fit) for fit in curves_of(one, signal, **settings)]
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
    by = "axial_stretch"
    used = {own[i] for own, tests in zip(labels, shown, strict=True) for i in tests}
    if len(used) > len(MARKERS):
        by, labels = "experiment", [_first_experiments(signal, one) for one in specimens]
        order = list(dict.fromkeys(label for own in labels for label in own))
        used = {own[i] for own, tests in zip(labels, shown, strict=True) for i in tests}
    several = any(
        len({own[i] for i in tests}) > 1 for own, tests in zip(labels, shown, strict=True)
    )
    differ = several or (by == "axial_stretch" and len(used) > 1)
    return by if differ else None, labels, [label for label in order if label in used]


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
    fence = _FENCE if figure.signal == "stiffness" else np.inf
    if figure.signal not in figure.points:
        return _ends(figure, bands, bands, lambda _, band: (band.min(), band.max()))
    measured = figure.points[figure.signal].sel(plot_axis="y", drop=True)
    return _ends(figure, measured, bands, lambda values, band: _near(values, band, fence))


def reach_of_residuals(figure: FitFigure) -> float:
    """Return half of the length of the axis of residuals, in standard deviations."""
    largest = np.nanmax(np.abs(figure.points[RESIDUAL].sel(plot_axis="y").values))
    return float(max(_LEAST_REACH, (1 + _MARGIN) * largest))


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
    shared = min(spans) >= _SPAN * np.ptp(np.concatenate(by_panel))
    coords = {dim: figure.curves[dim] for dim in (figure.group, "specimen")}
    shape = [coord.size for coord in coords.values()]
    low, high = (xr.DataArray(np.full(shape, np.nan), coords, [*coords]) for _ in range(2))
    for panel, own in zip(panels, by_panel, strict=True):
        alone = own.size and not shared
        at = ends(
            own if alone else np.concatenate(by_panel),
            _finite(bands.sel(panel) if alone else bands),
        )
        margin = _MARGIN * (at[1] - at[0])
        low.loc[panel], high.loc[panel] = at[0] - margin, at[1] + margin
    return Ends(low, high, bool(shared))


def _finite(values: xr.DataArray) -> Array:
    return values.values[np.isfinite(values.values)]


def _near(values: Array, band: Array, fence: float) -> tuple[float, float]:
    """Return the ends of an axis that shows data within the fence, and bands near them."""
    quartiles = np.quantile(values, [0.25, 0.75])
    reach = fence * np.ptp(quartiles) if np.isfinite(fence) else np.inf
    near = values[(values >= quartiles[0] - reach) & (values <= quartiles[1] + reach)]
    room = _ROOM * np.abs(near).max() or np.inf
    low, high = max(band.min(), near.min() - room), min(band.max(), near.max() + room)
    return min(low, near.min()), max(high, near.max())
