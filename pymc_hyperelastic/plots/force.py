"""The posterior of the axial force over the data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import xarray as xr

from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.curves import Array
from pymc_hyperelastic.plots.fit import draw_fits
from pymc_hyperelastic.plots.fitted_curves import Drawn, coordinates, data_beside, fits_of
from pymc_hyperelastic.plots.style import Backend, Visuals, fitted_classes
from pymc_hyperelastic.predictions.curves import force_curve, warn_of_no_force
from pymc_hyperelastic.predictions.offsets import less_offsets

if TYPE_CHECKING:
    from arviz_plots import PlotCollection


@one_thread
def plot_axial_force(
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
    """Plot the posterior of the reduced axial force over the data, a column for each class.

    A force transducer at the end of the closed tube reads this force, see
    :func:`~pymc_hyperelastic.predict_axial_force`. Measured forces, in the variable ``axial_force``
    of the data, are shown beside the bands, whether the class was fitted to them or not. Bands are
    of the tube's own force. If the class has offsets of the transducer (``force_offset_sd``),
    the points are measured forces less the posterior mean of their test's offset, and the legend
    says so.

    The force of extension tests is shown over the axial stretch, in a panel below: its band is that
    at the measured pressures, where each draw has a radius of its own.

    Parameters
    ----------
    classes, data, ci_prob, energy, specimen, backend, visuals, **pc_kwargs
        Those of :func:`~pymc_hyperelastic.plot_pressure_fit`, as are colours and bands.
    pressure_unit : str, default "kPa"
        Unit of the pressures by which the legend names extension tests.

    Returns
    -------
    arviz_plots.PlotCollection
        Its variables are ``axial_force`` and, of extension tests, ``extension_force``, its
        dimensions are those of :func:`~pymc_hyperelastic.plot_pressure_fit`.

    Warns
    -----
    UserWarning
        If the force is 0 whatever the parameters, see
        :func:`~pymc_hyperelastic.predict_axial_force`.

    Raises
    ------
    TypeError, ValueError
        As :func:`~pymc_hyperelastic.plot_pressure_fit` does.

    See Also
    --------
    predict_axial_force

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1")
    >>> model = ph.inflation_model(ph.Demiray(), data, ph.Gaussian(5 * ph.mmHg))
    >>> tree = ph.sample_smc(model, draws=500, chains=2, random_seed=1, progressbar=False)
    >>> figure = ph.plot_axial_force(tree, backend="none")
    >>> "points" in figure.viz.children  # nobody measured a force
    False
    """
    fitted = fitted_classes(classes)
    shown = data_beside(fitted, data, specimen)
    corrected = {name: less_offsets(shown[name], tree) for name, tree in fitted.items()}
    material: dict[str, Any] = {"energy": energy, "specimen": specimen}
    drawn = Drawn(
        force_curve,
        lambda draws, radius: {"extension_force": draws.tube.axial_force(radius)},
        _measured_forces,
    )
    fits = fits_of(fitted, corrected, ci_prob, material, drawn, pressure_unit)
    if "axial_force" in fits.curves:
        warn_of_no_force(fits.curves["axial_force"].sel(plot_axis=["y_bottom", "y_top"]))
    less = any(corrected[name] is not shown[name] for name in shown)
    note = ", less its test's offset" if less else ""
    return draw_fits(fits, material, pressure_unit, (backend, visuals, pc_kwargs), note)


def _measured_forces(data: xr.Dataset) -> dict[str, Array]:
    if "axial_force" not in data:
        return {}
    force = data["axial_force"].values
    return coordinates(data, axial_force=force, extension_force=force)
