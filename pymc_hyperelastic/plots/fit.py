"""The posterior of pressure and stiffness over the data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.inflation import at_points, extension_tests, points_of
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.bands import (
    VISUALS,
    Bands,
    bands_of,
    draw_bands,
    label_columns,
    limit_axis,
    rows_of,
    title_bands,
)
from pymc_hyperelastic.plots.extension import points_over
from pymc_hyperelastic.plots.style import RADIUS_LABEL, Backend, Canvas, Visuals, per_kilopascal
from pymc_hyperelastic.predictions.curves import pressure_curve

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

_FAR_OUT = 3.0  # interquartile ranges, Tukey's outer fence


@one_thread
def plot_pressure_fit(
    classes: xr.DataTree,
    data: xr.Dataset | Mapping[str, xr.Dataset] | None = None,
    *,
    prob: float = 0.95,
    energy: StrainEnergy | Sequence[Layer] | None = None,
    specimen: str | None = None,
    pressure_unit: str = "mmHg",
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    """Plot the posterior of pressure and of stiffness over the data, a column for each class.

    The band is that of the tube's response, without measurement error: it is as narrow as the
    parameters are well known, and data may lie beside it. Where it is extrapolated from the data to
    which the class was fitted, see :func:`~pymc_hyperelastic.predict_pressure`, the median is
    dashed; a result that does not hold these cannot say. Where internal radii depend on what is
    inferred of the tube, data are shown at those of the median tube.

    Extension tests have a panel of their own: the internal radius over the axial stretch, that of
    each draw at the pressures that were measured. How their forces fit is shown by
    :func:`~pymc_hyperelastic.plot_axial_force`.

    Where tests are at several axial stretches, each has a colour and a marker, those of its band
    and its data, and so has each pressure at which the stretch was varied. Where there is one
    stretch, or each specimen has its own, and tubes differ, specimens are told apart in the same
    way. Slopes far outside of the others, as close readings make them, do not stretch the axis: an
    arrowhead at its end stands for each, and the legend counts them. Nor do bands that reach
    several times as far as the data, as that of a typical specimen in the tube of a far stiffer or
    softer one: they go on beyond the axis, and the legend says so.

    Parameters
    ----------
    classes : xarray.DataTree
        Result of :func:`pymc_hyperelastic.fit_classes`, one of its classes, or a sampled model.
    data : xarray.Dataset or dict of str to xarray.Dataset, optional
        What is shown with the posterior: inflation data, or those for each class. The training
        data when missing. Each tube has a band of its own.
    prob : float
        Probability that the band holds at each radius, with equal tails.
    energy : StrainEnergy or list of Layer, optional
        The material, or the layers; needed where the result does not name it.
    specimen : str, optional
        Of whom the curve is, and the data if none are given, see
        :func:`~pymc_hyperelastic.predict_pressure`; by default of the typical specimen where
        specimens differ, as in classes with variability.
    pressure_unit : str
        Unit of the pressure axis, as pint knows it.
    backend : {"matplotlib", "none"}
        Plotting backend; ``"none"`` only collects what would be drawn.
    visuals : dict of str to dict or bool, optional
        Settings of ``band``, ``median``, ``extrapolated`` (the dashed part of the median),
        ``points``, ``above`` and ``below`` (arrowheads of slopes beyond the axis), ``xlabel``,
        ``ylabel``, ``title`` (of a column) and ``legend``; False leaves one out.
    **pc_kwargs
        Passed to :meth:`arviz_plots.PlotCollection.grid`.

    Returns
    -------
    arviz_plots.PlotCollection
        Its variables are ``pressure`` and ``stiffness``, and of extension tests
        ``extension_radius``, its dimensions ``class_label``, ``tube`` and, where they have colours
        of their own, ``axial_stretch`` or ``specimen``.

    Raises
    ------
    TypeError, ValueError
        If `classes` is no DataTree with a posterior, there are no data or no strain energy, the
        data are unsound or lack a class, or `prob`, the unit, the backend or a visual is unknown.

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
    factor = per_kilopascal(pressure_unit)
    bands = bands_of(
        classes,
        data,
        prob,
        {"energy": energy, "specimen": specimen},
        lambda draws, radius: pressure_curve(draws, radius) * factor,
        lambda tests: _measured(tests, factor),
        lambda _, radius: {"extension_radius": radius},
        pressure_unit,
    )
    columns, (rows, shared) = len(bands.fitted), rows_of(bands)
    canvas = Canvas(
        "grid",
        bands.posterior,
        f"{VISUALS} above below",
        backend,
        visuals,
        pc_kwargs,
        {"figsize": (max(2.9 * columns + 0.9, 5), 0.6 + 2.5 * rows)} | shared,
        rows=["__variable__"],
        cols=["class_label"],
        **bands.looks,
    )
    entries = draw_bands(canvas, bands)
    there = [str(name) for name in bands.posterior.data_vars]
    if "pressure" in there:
        entries |= limit_axis(canvas, bands, "pressure")[1]
    if "stiffness" in there:
        limits, cut = limit_axis(canvas, bands, "stiffness", _FAR_OUT)
        entries |= cut
        if limits:
            entries |= _draw_beyond(canvas, bands, limits)
    label_columns(canvas, bands, "stiffness")
    where = {"coords": {"class_label": next(iter(bands.fitted))}}
    texts = {
        "pressure": f"pressure ({pressure_unit})",
        "stiffness": f"stiffness d$p$/d$a$ ({pressure_unit}/mm)",
        "extension_radius": RADIUS_LABEL,
    }
    for name in there:
        canvas.label("ylabel", texts[name], data=bands.posterior[[name]], **where)
    canvas.legend(entries, loc="outside lower center")
    title_bands(canvas, bands, energy, specimen)
    return canvas.collection


def _draw_beyond(
    canvas: Canvas, bands: Bands, limits: tuple[float, float]
) -> dict[str, dict[str, Any]]:
    """Draw arrowheads at the end of the axis where slopes are beyond it; the legend counts them."""
    from arviz_plots.visuals import scatter_xy

    points = bands.points[["stiffness"]]
    slope = points.sel(plot_axis="y", drop=True)
    at_end = {"size": 25, "clip_on": False, "zorder": 5, "alpha": 1}
    entries = {}
    for name, marker, end, beyond in (
        ("above", "^", limits[1], slope > limits[1]),
        ("below", "v", limits[0], slope < limits[0]),
    ):
        count = int(beyond["stiffness"].sum())
        if count:
            ends = points.where(beyond)
            ends = ends.where((points["plot_axis"] == "x") | ~beyond, end)
            canvas.draw(name, scatter_xy, data=ends, **bands.dots | at_end | {"marker": marker})
            what = {"marker": marker, "linestyle": "none", "color": "0.25", "markersize": 5}
            entries[f"{count} of {int(slope.count()['stiffness'])} slopes {name} the axis"] = what
    return entries


def _measured(data: xr.Dataset, pressure_factor: float) -> xr.Dataset:
    """Measured pressures, and their central differences inside each inflation test.

    Of extension tests the radii.
    """
    radius, pressure = data["radius"].values, pressure_factor * data["pressure"].values
    slope = np.full_like(pressure, np.nan)
    extended, dims = extension_tests(data), ("plot_axis", "point")
    for i in np.flatnonzero(~extended).tolist():
        test = points_of(data, i)
        step = radius[test][2:] - radius[test][:-2]
        step[step == 0] = np.nan
        slope[test][1:-1] = (pressure[test][2:] - pressure[test][:-2]) / step
    measured = {}
    if not extended.all():
        measured["pressure"] = dims, points_over(data, radius, pressure, extension=False)
        measured["stiffness"] = dims, points_over(data, radius, slope, extension=False)
    if extended.any():
        stretch = at_points(data, "axial_stretch")
        measured["extension_radius"] = dims, points_over(data, stretch, radius, extension=True)
    return xr.Dataset(measured)
