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
from pymc_hyperelastic.plots.curves import Array
from pymc_hyperelastic.plots.fit_panels import draw_fits
from pymc_hyperelastic.plots.fitted_curves import Drawn, data_beside, fits_of
from pymc_hyperelastic.plots.style import Backend, Visuals, fitted_classes, per_kilopascal
from pymc_hyperelastic.predictions.curves import pressure_curve
from pymc_hyperelastic.predictions.draws import GivenTube

if TYPE_CHECKING:
    from arviz_plots import PlotCollection


@one_thread
def plot_pressure_fit(
    classes: xr.DataTree,
    data: xr.Dataset | Mapping[str, xr.Dataset] | None = None,
    *,
    prob: float = 0.95,
    energy: StrainEnergy | Sequence[Layer] | None = None,
    specimen: str | None = None,
    pressure_unit: str = "kPa",
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    """Plot the posterior of pressure and of stiffness over the data, a column for each class.

    The band is that of the tube's response, without measurement error: it is as narrow as the
    parameters are well known, and data may lie beside it. Where it is extrapolated from the data to
    which the class was fitted, see :func:`~pymc_hyperelastic.predict_pressure`, the median is
    dashed; a result that does not hold these data cannot say. Where internal radii depend on
    inferred dimensions of the tube, data are shown at the radii of the median tube.

    Extension tests have a panel of their own: the internal radius over the axial stretch, that of
    each draw at the pressures that were measured. :func:`~pymc_hyperelastic.plot_axial_force` shows
    how their forces fit.

    Each axial stretch at which there are tests, and each pressure at which the stretch was varied,
    has a colour and a marker, for its band and its data. If there is one stretch, or each specimen
    has its own, tubes that differ have them. The axis shows the data and the bands near them. Bands
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
    prob : float
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
    fitted, factor = fitted_classes(classes), per_kilopascal(pressure_unit)
    material: GivenTube = {"energy": energy, "specimen": specimen}
    drawn = Drawn(
        lambda draws, radius: pressure_curve(draws, radius) * factor,
        lambda _, radius: {"extension_radius": radius},
        lambda tests: _measured_pressures(tests, factor),
    )
    shown = data_beside(fitted, data, specimen)
    fits = fits_of(fitted, shown, prob, material, drawn, pressure_unit)
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
    at_stretch = extended[data["test"].values]
    held = np.where(at_stretch, np.nan, radius)
    varied = np.where(at_stretch, at_points(data, "axial_stretch"), np.nan)
    return {
        "pressure": np.array([held, pressure]),
        "stiffness": np.array([held, slope]),
        "extension_radius": np.array([varied, radius]),
    }
