"""The posterior of the axial force over the data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.inflation import at_points, extension_tests
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.bands import (
    VISUALS,
    bands_of,
    data_of,
    draw_bands,
    label_columns,
    limit_axis,
    rows_of,
    title_bands,
)
from pymc_hyperelastic.plots.extension import points_over
from pymc_hyperelastic.plots.style import Backend, Canvas, Visuals, fitted_classes
from pymc_hyperelastic.predictions.curves import force_curve, warn_of_no_force
from pymc_hyperelastic.predictions.draws import Array, Draws, GivenTube
from pymc_hyperelastic.predictions.offsets import less_offsets

if TYPE_CHECKING:
    from arviz_plots import PlotCollection


@one_thread
def plot_axial_force(
    classes: xr.DataTree,
    data: xr.Dataset | Mapping[str, xr.Dataset] | None = None,
    *,
    prob: float = 0.95,
    energy: StrainEnergy | Sequence[Layer] | None = None,
    specimen: str | None = None,
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    """Plot the posterior of the reduced axial force over the data, a column for each class.

    It is what a force transducer at the end of the closed tube reads, see
    :func:`~pymc_hyperelastic.predict_axial_force`. Forces that were measured, in the variable
    ``axial_force`` of the data, are shown beside the bands, whether the class was fitted to them or
    not; without any there are the bands alone. Bands are of the tube's own force. Where the class
    knows offsets of the transducer (``force_offset_sd``), the points are what was measured less the
    posterior mean of their test's offset, and the legend says so.

    Of extension tests the force is shown over the axial stretch, in a panel below: the band is that
    at the pressures that were measured, each draw at the radius that it has there.

    Parameters
    ----------
    classes, data, prob, energy, specimen, backend
        Those of :func:`~pymc_hyperelastic.plot_pressure_fit`, as are colours and bands.
    visuals : dict of str to dict or bool, optional
        Settings of ``band``, ``median``, ``extrapolated`` (the dashed part of the median),
        ``points``, ``xlabel``, ``ylabel``, ``title`` (of a column) and ``legend``; False leaves one
        out.
    **pc_kwargs
        Passed to :meth:`arviz_plots.PlotCollection.grid`.

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
    shown = {name: data_of(name, tree, data, specimen) for name, tree in fitted.items()}
    corrected = {name: less_offsets(shown[name], tree) for name, tree in fitted.items()}
    material: GivenTube = {"energy": energy, "specimen": specimen}
    bands = bands_of(classes, corrected, prob, material, force_curve, _measured, _along)
    if "axial_force" in bands.posterior:
        warn_of_no_force(bands.posterior["axial_force"].sel(plot_axis=["y_bottom", "y_top"]))
    columns, (rows, shared) = len(bands.fitted), rows_of(bands)
    canvas = Canvas(
        "grid",
        bands.posterior,
        VISUALS,
        backend,
        visuals,
        pc_kwargs,
        {"figsize": (max(2.9 * columns + 0.9, 5), 0.8 + 2.8 * rows)} | shared,
        rows=["__variable__"],
        cols=["class_label"],
        **bands.looks,
    )
    entries = draw_bands(canvas, bands)
    if any(corrected[name] is not shown[name] for name in shown):
        entries = {
            f"{name}, less its test's offset" if name.startswith("data") else name: looks
            for name, looks in entries.items()
        }
    if "axial_force" in bands.posterior:
        entries |= limit_axis(canvas, bands, "axial_force")[1]
    label_columns(canvas, bands, "axial_force")
    first = {"coords": {"class_label": next(iter(bands.fitted))}}
    canvas.label("ylabel", "reduced axial force (mN)", **first)
    canvas.legend(entries, loc="outside lower center")
    title_bands(canvas, bands, energy, specimen)
    return canvas.collection


def _along(draws: Draws, radius: Array) -> dict[str, Array]:
    """Axial force of draws at radii along an extension test."""
    return {"extension_force": draws.tube.axial_force(radius)}


def _measured(data: xr.Dataset) -> xr.Dataset:
    """Measured axial forces; NaN where there is none."""
    dims, radius = ("plot_axis", "point"), data["radius"].values
    force = data["axial_force"].values if "axial_force" in data else np.full_like(radius, np.nan)
    extended, measured = extension_tests(data), {}
    for name, x, there in (
        ("axial_force", radius, ~extended),
        ("extension_force", at_points(data, "axial_stretch"), extended),
    ):
        if there.any():
            known = np.where(np.isnan(force), np.nan, x)
            extension = name == "extension_force"
            measured[name] = dims, points_over(data, known, force, extension=extension)
    return xr.Dataset(measured)
