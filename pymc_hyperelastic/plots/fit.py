"""The posterior of pressure and stiffness over the data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.inflation import extension_tests, points_of
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.curves import BAND_VISUALS, Array, draw_bands
from pymc_hyperelastic.plots.fitted_curves import (
    Drawn,
    Fits,
    coordinates,
    data_beside,
    fits_of,
    is_over_stretch,
)
from pymc_hyperelastic.plots.labels import axis_label, words
from pymc_hyperelastic.plots.style import (
    MARKERS,
    Backend,
    Canvas,
    Visuals,
    Wishes,
    fitted_classes,
    law_of,
    many_looks,
    per_kilopascal,
    training_attrs,
)
from pymc_hyperelastic.predictions.curves import pressure_curve
from pymc_hyperelastic.predictions.members import specimens_differ

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

# Interquartile ranges beyond which slopes are far out: Tukey's outer fence.
_FENCE = 3.0
# Room of bands above and below the data on an axis, in sizes of the largest datum.
_ROOM = 2.0
# Margin at both ends of an axis, as a fraction of its length.
_MARGIN = 0.06


@one_thread
def plot_pressure_fit(
    classes: xr.DataTree,
    data: xr.Dataset | Mapping[str, xr.Dataset] | None = None,
    *,
    ci_prob: float = 0.95,
    energy: StrainEnergy | Sequence[Layer] | None = None,
    specimen: str | None = None,
    pressure_unit: str = "kPa",
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    """Plot the posterior of pressure and of stiffness over the data, a column for each class.

    The band is that of the tube's response, without measurement error: it is as narrow as the
    parameters are well known, and data may lie beside it. The median is dashed beyond
    the data to which the class was fitted, see :func:`~pymc_hyperelastic.predict_pressure`, if the
    result holds these data. If internal radii depend on inferred dimensions of the tube, data are
    shown at the radii of the median tube.

    Extension tests have a panel of their own: the internal radius over the axial stretch, that of
    each draw at the pressures that were measured. :func:`~pymc_hyperelastic.plot_axial_force` shows
    how their forces fit.

    Bands and data of each axial stretch have a colour and a marker, and so have extension tests at
    each pressure. If there is one stretch, or each specimen has its own, they differ by tube. The
    axis shows the data and the bands near them. Bands
    that reach farther beyond the data than twice the largest datum, such as that of a typical
    specimen in the tube of a far stiffer one, go on beyond the axis. Slopes far from all others,
    which close readings cause, are drawn as diamonds at its end. The legend says both.

    Parameters
    ----------
    classes : xarray.DataTree
        Result of :func:`pymc_hyperelastic.fit_classes`, one of its classes, or a sampled model.
    data : xarray.Dataset or dict of str to xarray.Dataset, optional
        Inflation data to show with the posterior, or those for each class; by default the training
        data. Each tube has a band of its own.
    ci_prob : float
        Probability that the band holds at each radius, with equal tails.
    energy : StrainEnergy or list of Layer, optional
        The material, or the layers; needed where the result does not name it.
    specimen : str, optional
        Specimen whose curve, and whose training data, are shown, see
        :func:`~pymc_hyperelastic.predict_pressure`; by default the typical specimen where specimens
        differ, as in classes with variability.
    pressure_unit : str, default "kPa"
        Unit of the pressure axis, as pint knows it.
    backend, visuals, **pc_kwargs
        See :func:`~pymc_hyperelastic.plot_inflation`. The visuals are ``band``, ``median``,
        ``extrapolated`` (the dashed part of the median), ``points``, ``beyond`` (slopes beyond the
        axis), ``xlabel``, ``ylabel``, ``title`` (of a column) and ``legend``.

    Returns
    -------
    arviz_plots.PlotCollection
        A grid. Its variables are ``pressure`` and ``stiffness``, and of extension tests
        ``extension_radius``, its dimensions ``class_label``, ``curve`` and, where they have colours
        of their own, ``axial_stretch`` or ``specimen``.

    Raises
    ------
    TypeError, ValueError
        If `classes` is no DataTree with a posterior, there are no data or no strain energy, the
        data are unsound or lack a class, or `ci_prob`, the unit, the backend or a visual is
        unknown.

    See Also
    --------
    predict_pressure

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1")
    >>> tree = ph.open_result("sampled.nc")  # saved from the example of sample_smc
    >>> figure = ph.plot_pressure_fit(tree, data, backend="none")
    >>> list(figure.viz["plot"].data_vars)
    ['pressure', 'stiffness']
    """
    fitted, factor = fitted_classes(classes), per_kilopascal(pressure_unit)
    material: dict[str, Any] = {"energy": energy, "specimen": specimen}
    drawn = Drawn(
        lambda draws, radius: pressure_curve(draws, radius) * factor,
        lambda _, radius: {"extension_radius": radius},
        lambda tests: _measured_pressures(tests, factor),
    )
    shown = data_beside(fitted, data, specimen)
    fits = fits_of(fitted, shown, ci_prob, material, drawn, pressure_unit)
    return draw_fits(fits, material, pressure_unit, (backend, visuals, pc_kwargs))


def _measured_pressures(data: xr.Dataset, factor: float) -> dict[str, Array]:
    """Measured pressures and their central differences; of extension tests the radii."""
    radius, pressure = data["radius"].values, factor * data["pressure"].values
    slope = np.full_like(pressure, np.nan)
    extended = extension_tests(data)
    for i in np.flatnonzero(~extended).tolist():
        test = points_of(data, i)
        step = radius[test][2:] - radius[test][:-2]
        step[step == 0] = np.nan
        slope[test][1:-1] = (pressure[test][2:] - pressure[test][:-2]) / step
    return coordinates(data, pressure=pressure, stiffness=slope, extension_radius=radius)


def draw_fits(
    fits: Fits, material: Mapping[str, Any], pressure_unit: str, wishes: Wishes, note: str = ""
) -> PlotCollection:
    """Draw bands, medians and data; the `note` is what the legend says of the data besides."""
    quantities = list(map(str, fits.curves.data_vars))
    columns, rows = len(fits.classes), len(quantities)
    known = f"{BAND_VISUALS} points beyond"
    size = (max(2.9 * columns + 0.9, 5), 0.7 + 2.5 * rows)
    share = {"sharey": "row"} | ({} if any(map(is_over_stretch, quantities)) else {"sharex": "col"})
    layout: dict[str, Any] = {"rows": ["__variable__"], "cols": ["class_label"], **_looks(fits.by)}
    canvas = Canvas("grid", fits.curves, known, wishes, size, share, **layout)
    entries: dict[str, dict[str, Any]] = {}
    if fits.by:
        style = ("color", "linestyle", "marker")[: 3 if fits.points else 2]
        entries |= canvas.entries(fits.by, f"{words(fits.by)} ", *style, markersize=4)
    if fits.points:
        data = "data (of that colour)" if fits.by else "data"
        marker = {"color": "0.25", "marker": "o", "markersize": 3, "linestyle": "none"}
        entries[data + note] = marker
        _draw_points(canvas, fits.points, "points", fits.by)
    entries |= draw_bands(canvas, fits.curves, fits.ci_prob)
    for quantity in quantities:
        if quantity in fits.points and not is_over_stretch(quantity):
            fence = _FENCE if quantity == "stiffness" else np.inf
            entries |= _limit(canvas, fits, quantity, fence)
    _label(canvas, fits, quantities, pressure_unit)
    canvas.legend(entries)
    law = law_of(next(iter(fits.classes.values())), material["energy"])
    specimen, differ = material["specimen"], any(map(specimens_differ, fits.classes.values()))
    whose = f"specimen {specimen}" if specimen is not None else "typical specimen" * differ
    # The posterior is as simulated as the data that it comes from.
    origin = [{"simulated": attrs.get("simulated")} for attrs in training_attrs(fits.classes)]
    canvas.title([*(data.attrs for data in fits.data.values()), *origin], law, whose)
    return canvas.collection


def _looks(by: str | None) -> dict[str, Any]:
    """Settings of a PlotCollection; classes alone differ only in colour."""
    if by is None:
        return {"aes": {"color": ["class_label"], "overlay": ["curve"]}}
    looks = many_looks() | {"aes": {"color": [by], "linestyle": [by], "marker": [by]}}
    looks["aes"]["overlay"] = ["curve"]
    # There are few stretches: each has a marker of its own, which differs in grey, too.
    return looks | ({"marker": MARKERS} if by == "axial_stretch" else {})


def _draw_points(
    canvas: Canvas, points: xr.Dataset, name: str, by: str | None, **settings: Any
) -> None:
    """Draw points in the colour of their band, or in grey where there is one band."""
    looks: dict[str, Any] = {"size": 12, "ignore_aes": {"linestyle"}}
    if by is None:
        looks = {"size": 7, "color": "0.25", "ignore_aes": {"color"}}
    canvas.draw(name, "scatter_xy", data=points, **{"alpha": 0.6} | looks | settings)


def _limit(canvas: Canvas, fits: Fits, quantity: str, fence: float) -> dict[str, dict[str, Any]]:
    """Limit an axis that distant bands, or data beyond the fence, would stretch.

    Returns what the legend says of bands and data beyond the axis.
    """
    points = fits.points[[quantity]]
    values = points[quantity].sel(plot_axis="y").values
    values = values[np.isfinite(values)]
    quartiles = np.quantile(values, [0.25, 0.75])
    reach = fence * np.ptp(quartiles) if np.isfinite(fence) else np.inf
    near = values[(values >= quartiles[0] - reach) & (values <= quartiles[1] + reach)]
    room = _ROOM * np.abs(near).max() or np.inf
    band = fits.curves[quantity].sel(plot_axis=["y_bottom", "y_top"])
    low, high = max(float(band.min()), near.min() - room), min(float(band.max()), near.max() + room)
    cut = low > float(band.min()) or high < float(band.max())
    low, high = min(low, near.min()), max(high, near.max())
    far = int(((values < low) | (values > high)).sum())
    if not cut and not far:
        return {}
    margin = _MARGIN * (high - low)
    low, high = float(low - margin), float(high + margin)
    canvas.adjust("set_ylim", data=points, limits=(low, high))
    entries: dict[str, dict[str, Any]] = {}
    if cut:
        entries["bands go on beyond the axis"] = {"color": "0.4", "linewidth": 0}
    if far:
        y = points.sel(plot_axis="y", drop=True)
        ends = xr.where(points["plot_axis"] == "y", points.clip(low, high), points)
        ends = ends.where((y < low) | (y > high))
        _draw_points(
            canvas, ends, "beyond", fits.by, marker="D", size=20, alpha=1, clip_on=False, zorder=5
        )
        marker = {"marker": "D", "linestyle": "none", "color": "0.25", "markersize": 5}
        entries[f"{far} of {values.size} slopes beyond the axis"] = marker
    return entries


def _label(canvas: Canvas, fits: Fits, quantities: list[str], pressure_unit: str) -> None:
    """Label axes, and name the class on top of each column."""
    over_radius = [name for name in quantities if not is_over_stretch(name)]
    first = next(iter(fits.classes))
    for name, data in fits.data.items():
        where = {"coords": {"class_label": name}}
        computed = "\nfrom the measured outer diameter" if "outer_diameter" in data else ""
        for quantity in quantities:
            panel = where | {"data": fits.curves[[quantity]]}
            if quantity in over_radius[-1:]:
                canvas.label("xlabel", axis_label("radius") + computed, **panel)
            elif is_over_stretch(quantity):
                canvas.label("xlabel", axis_label("axial_stretch"), **panel)
            if name == first:
                quantity_of = {"extension_radius": "radius", "extension_force": "axial_force"}
                text = axis_label(quantity_of.get(quantity, quantity), pressure_unit)
                canvas.label("ylabel", text, **panel)
        if len(fits.data) > 1:
            top = where | {"data": fits.curves[quantities[:1]]}
            canvas.label("title", f"class {name}", size="medium", **top)
