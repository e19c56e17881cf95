"""Posteriors of elastic properties and of wall stresses at given pressures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import xarray as xr

from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.reference_tube import Tube
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.curves import (
    BAND,
    BAND_VISUALS,
    Array,
    Curve,
    band_rows,
    draw_bands,
    gathered,
    looks_of,
)
from pymc_hyperelastic.plots.labels import LABELS, axis_label
from pymc_hyperelastic.plots.panels import columns_of, size_of
from pymc_hyperelastic.plots.style import Backend, Canvas, Visuals, Wishes, fitted_classes
from pymc_hyperelastic.predictions.conditions import Conditions, as_conditions
from pymc_hyperelastic.predictions.members import TYPICAL
from pymc_hyperelastic.predictions.properties import tube_properties
from pymc_hyperelastic.predictions.stress import wall_stress

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

# Quantities over the pressure; the first ones are shown unless others are asked for.
_OF_THE_CURVE = (
    "compliance",
    "distensibility",
    "peterson_modulus",
    "incremental_modulus",
    "pulse_wave_velocity",
)
_KNOWN = (
    *_OF_THE_CURVE,
    "circumferential_stress",
    "axial_stress",
    "circumferential_material_stiffness",
    "axial_material_stiffness",
    "stored_energy",
)
_STRESSES = ("sigma_rr", "sigma_tt", "sigma_zz")


@one_thread
def plot_elastic_properties(
    classes: xr.DataTree,
    at: Conditions | Any,
    *,
    var_names: Sequence[str] = _OF_THE_CURVE,
    ci_prob: float = 0.95,
    specimen: str | None = None,
    energy: StrainEnergy | Sequence[Layer] | None = None,
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    """Plot the posterior of elastic properties over the pressure, a colour for each class.

    The median is dashed at pressures that are extrapolated, see
    :func:`~pymc_hyperelastic.tube_properties`.

    Parameters
    ----------
    classes : xarray.DataTree
        Result of :func:`pymc_hyperelastic.fit_classes`, one of its classes, or a sampled model.
    at : Conditions, or array_like of pressures in kPa, shape (pressure,)
        The pressures, whose unit is that of the pressure axis, the tube and the density of the
        fluid. Moduli are in kPa.
    var_names : sequence of str
        Quantities that have a panel: those of :func:`~pymc_hyperelastic.tube_properties` at each
        pressure, from ``compliance`` to ``stored_energy``; by default those up to
        ``pulse_wave_velocity``, which follow from the curve of pressure alone.
    ci_prob : float
        Probability that the bands hold at each pressure, with equal tails.
    specimen, energy
        See :func:`~pymc_hyperelastic.predict_pressure`.
    backend, visuals, **pc_kwargs
        See :func:`~pymc_hyperelastic.plot_inflation`. The visuals are ``band``, ``median``,
        ``extrapolated`` (the dashed part of the median), ``xlabel``, ``ylabel`` and ``legend``.

    Returns
    -------
    arviz_plots.PlotCollection
        Its variables are those of `var_names`.

    Raises
    ------
    TypeError, ValueError
        If `classes` is no DataTree with a posterior, a name, `ci_prob`, the backend or a visual is
        unknown, or :func:`~pymc_hyperelastic.tube_properties` raises it.

    See Also
    --------
    tube_properties

    Examples
    --------
    >>> import xarray as xr, pymc_hyperelastic as ph
    >>> posterior = xr.Dataset({"mu": (("chain", "draw"), [[20.0, 30.0]])})
    >>> tree = xr.DataTree.from_dict({"posterior": posterior})
    >>> at = ph.Conditions([1.0, 2.0], tube=ph.Tube(7.0, 9.0))
    >>> figure = ph.plot_elastic_properties(tree, at, energy=ph.NeoHookean(), backend="none")
    >>> list(figure.viz["plot"].data_vars)[:2]
    ['compliance', 'distensibility']
    """
    names = list(var_names)
    unknown = [name for name in names if name not in _KNOWN]
    if unknown or not names or isinstance(var_names, str):
        raise ValueError(f"var_names must be a list of {list(_KNOWN)}; got {var_names!r}")
    fitted = fitted_classes(classes)
    at = _conditions(at, pc_kwargs)
    tables = {
        name: tube_properties(tree, at, specimen=specimen, energy=energy)
        for name, tree in fitted.items()
    }
    curves = []
    for of_class, table in tables.items():
        curves += _bands(table, names, (of_class,), table["pressure"].values, ci_prob)
    wishes = backend, visuals, pc_kwargs
    canvas = draw_over_pressure(curves, list(fitted), ci_prob, at.pressure_unit, wishes)
    _title(canvas, fitted, tables, energy)
    return canvas.collection


def draw_over_pressure(
    curves: list[Curve],
    classes: list[str],
    ci_prob: float,
    pressure_unit: str,
    wishes: Wishes,
    prefix: str = "",
) -> Canvas:
    """Draw bands of each class over the pressure, a panel for each quantity."""
    bands = gathered(curves, {"class_label": classes}, BAND)
    names = list(map(str, bands.data_vars))
    columns = columns_of(len(names), 3)
    looks = looks_of("class_label") | {"cols": ["__variable__"], "col_wrap": columns}
    size = size_of(len(names), columns)
    canvas = Canvas("wrap", bands, BAND_VISUALS, wishes, size, {}, **looks)
    entries = canvas.entries("class_label", "class ", "color", "linestyle")
    canvas.legend(entries | draw_bands(canvas, bands, ci_prob))
    for name in names:
        canvas.label("xlabel", axis_label("pressure", pressure_unit), data=bands[[name]])
        canvas.label("ylabel", prefix + axis_label(name), data=bands[[name]])
    return canvas


@one_thread
def plot_wall_stress(
    classes: xr.DataTree,
    at: Conditions | Any,
    *,
    points: Any = 21,
    ci_prob: float = 0.95,
    specimen: str | None = None,
    energy: StrainEnergy | Sequence[Layer] | None = None,
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    """Plot the posterior of the stresses through the wall, a row for each class.

    The median is dashed at pressures that are extrapolated, see
    :func:`~pymc_hyperelastic.wall_stress`.

    Parameters
    ----------
    classes, at, ci_prob, specimen, energy
        Those of :func:`~pymc_hyperelastic.plot_elastic_properties`. Each pressure has a colour.
        Stresses are in kPa.
    points : int or array_like, default 21
        Circles in the wall, see :func:`~pymc_hyperelastic.wall_stress`. A jump between two layers
        looks like a slope if there are few: give 200.
    backend, visuals, **pc_kwargs
        See :func:`~pymc_hyperelastic.plot_inflation`. The visuals are ``band``, ``median``,
        ``extrapolated``, ``xlabel``, ``ylabel``, ``title`` (of a column) and ``legend``.

    Returns
    -------
    arviz_plots.PlotCollection
        A grid. Its variables are ``sigma_rr``, ``sigma_tt`` and ``sigma_zz``.

    Raises
    ------
    TypeError, ValueError
        If `classes` is no DataTree with a posterior, `ci_prob`, the backend or a visual is
        unknown, or :func:`~pymc_hyperelastic.wall_stress` raises it.

    See Also
    --------
    wall_stress

    Examples
    --------
    >>> import xarray as xr, pymc_hyperelastic as ph
    >>> posterior = xr.Dataset({"mu": (("chain", "draw"), [[20.0, 30.0]])})
    >>> tree = xr.DataTree.from_dict({"posterior": posterior})
    >>> at = ph.Conditions([1.0, 2.0], tube=ph.Tube(7.0, 9.0))
    >>> figure = ph.plot_wall_stress(tree, at, energy=ph.NeoHookean(), backend="none")
    >>> figure.viz["median"]["sigma_tt"].sizes["pressure"]
    2
    """
    fitted = fitted_classes(classes)
    at = _conditions(at, pc_kwargs)
    tables = {
        name: wall_stress(tree, at, points, specimen=specimen, energy=energy)
        for name, tree in fitted.items()
    }
    table = next(iter(tables.values()))
    levels = [f"{p:.4g} {at.pressure_unit}" for p in table["pressure"].values]
    curves = []
    for of_class, table in tables.items():
        for i, level in enumerate(levels):
            labels, x = (of_class, level), table["position"].values
            curves += _bands(table.isel(pressure=i), _STRESSES, labels, x, ci_prob)
    coords = {"class_label": list(fitted), "pressure": list(dict.fromkeys(levels))}
    bands = gathered(curves, coords, BAND)
    size, share = (8.2, 2.5 * len(fitted) + 0.8), {"sharex": True, "sharey": "col"}
    layout = looks_of("pressure") | {"rows": ["class_label"], "cols": ["__variable__"]}
    wishes = backend, visuals, pc_kwargs
    canvas = Canvas("grid", bands, BAND_VISUALS, wishes, size, share, **layout)
    entries = canvas.entries("pressure", "", "color", "linestyle")
    canvas.legend(entries | draw_bands(canvas, bands, ci_prob))
    top, bottom = ({"class_label": name} for name in (next(iter(fitted)), list(fitted)[-1]))
    for name in _STRESSES:
        panels = {"data": bands[[name]]}
        canvas.label("title", LABELS[name][0], size="medium", coords=top, **panels)
        canvas.label("xlabel", axis_label("position"), coords=bottom, **panels)
    for name in fitted:
        text = (f"class {name}\n" if len(fitted) > 1 else "") + axis_label("stress")
        panel = {"data": bands[["sigma_rr"]], "coords": {"class_label": name}}
        canvas.label("ylabel", text, **panel)
    single = levels[0] if len(levels) == 1 else None
    _title(canvas, fitted, tables, energy, single)
    return canvas.collection


def _conditions(at: Any, settings: Mapping[str, Any]) -> Conditions:
    """Conditions of a figure; TypeError if some of them stand among the settings of its canvas."""
    of_tube, of_conditions = ({field.name for field in fields(c)} for c in (Tube, Conditions))
    for name, value in settings.items():
        said = f"{name}={value!r}"
        if name in of_tube:
            said = f"tube=ph.Tube({said})"
        if name in of_tube | of_conditions:
            raise TypeError(f"state {name} as at=ph.Conditions(..., {said})")
    # No figure shows properties that depend on two pressures.
    return replace(as_conditions(at), pressure_range=None)


def _bands(
    table: xr.Dataset, names: Sequence[str], labels: tuple[str, ...], x: Array, ci_prob: float
) -> list[Curve]:
    """Bands of quantities of a table; without data, no pressure is marked as extrapolated."""
    beyond = table.coords.get("extrapolated", xr.zeros_like(table["pressure"])).values
    draws = {name: table[name].values for name in names}
    return [Curve(n, labels, band_rows(x, values, ci_prob, beyond)) for n, values in draws.items()]


def _title(
    canvas: Canvas,
    fitted: Mapping[str, xr.DataTree],
    tables: Mapping[str, xr.Dataset],
    energy: Any,
    pressure: str | None = None,
) -> None:
    """Name the law, the specimen, the pressure if there is one, and the data."""
    specimen = next(iter(tables.values())).attrs.get("specimen")
    whose = f"{specimen} specimen" if specimen == TYPICAL else specimen and f"specimen {specimen}"
    canvas.title_of_fits(fitted, energy, whose, pressure)
