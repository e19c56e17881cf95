"""Posteriors of what follows from a fit at given pressures: elastic properties, wall stresses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

import xarray as xr

from pymc_hyperelastic.evidence.checks import check_fraction
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.style import (
    PALETTE,
    Backend,
    Canvas,
    Visuals,
    fitted_classes,
    law_of,
    median_and_band,
    per_kilopascal,
    solid_and_dashed,
    told_apart,
    training_attrs,
)
from pymc_hyperelastic.predictions.draws import GivenTube
from pymc_hyperelastic.predictions.members import TYPICAL
from pymc_hyperelastic.predictions.properties import tube_properties
from pymc_hyperelastic.predictions.stress import wall_stress
from pymc_hyperelastic.quantities import IN_RESULTS

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

# Drawn unless other properties are asked for.
_OF_THE_CURVE = (
    "compliance",
    "distensibility",
    "peterson_modulus",
    "incremental_modulus",
    "pulse_wave_velocity",
)
_OF_THE_WALL = (
    "circumferential_stress",
    "axial_stress",
    "circumferential_material_stiffness",
    "axial_material_stiffness",
    "stored_energy",
)
# Letters of a line of a label.
_LABEL_WIDTH = 28
# As axes name them; radii and the slope are left out, see plot_pressure_fit.
PROPERTY_LABELS = {
    name: fill(IN_RESULTS[name].label, _LABEL_WIDTH) for name in (*_OF_THE_CURVE, *_OF_THE_WALL)
}
_STRESSES = {"sigma_rr": "radial", "sigma_tt": "hoop", "sigma_zz": "axial"}
_VISUALS = "band median extrapolated xlabel ylabel title legend"


@one_thread
def plot_elastic_properties(
    classes: xr.DataTree,
    pressure: Any,
    *,
    var_names: Sequence[str] = _OF_THE_CURVE,
    prob: float = 0.95,
    pressure_unit: str = "mmHg",
    tube: Mapping[str, Any] | None = None,
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    """Plot the posterior of elastic properties over the pressure, a colour for each class.

    Where pressures are extrapolated, see :func:`~pymc_hyperelastic.tube_properties`, the median is
    dashed.

    Parameters
    ----------
    classes : xarray.DataTree
        Result of :func:`pymc_hyperelastic.fit_classes`, one of its classes, or a sampled model.
    pressure : array_like, shape (pressure,)
        Internal pressures, in `pressure_unit`.
    var_names : sequence of str
        What has a panel: names of :func:`~pymc_hyperelastic.tube_properties` with a value at each
        pressure, from ``compliance`` to ``stored_energy``; by default those up to
        ``pulse_wave_velocity``, which follow from the curve of pressure alone.
    prob : float
        Probability that the bands hold at each pressure, with equal tails.
    pressure_unit : str
        Unit of the pressures, as pint knows it.
    tube : dict of str to object, optional
        What :func:`~pymc_hyperelastic.tube_properties` is told besides: the material, the
        ``specimen``, the tube, the ``density`` of the fluid, such as ``{"axial_stretch": 1.2}``.
    backend : {"matplotlib", "none"}
        Plotting backend; ``"none"`` only collects what would be drawn.
    visuals : dict of str to dict or bool, optional
        Settings of ``band``, ``median``, ``extrapolated`` (the dashed part of the median),
        ``xlabel``, ``ylabel`` and ``legend``; False leaves one out.
    **pc_kwargs
        Passed to :meth:`arviz_plots.PlotCollection.wrap`.

    Returns
    -------
    arviz_plots.PlotCollection
        Its variables are those of `var_names`.

    Raises
    ------
    TypeError, ValueError
        If `classes` is no DataTree with a posterior, a name, `prob`, the backend or a visual is
        unknown, or :func:`~pymc_hyperelastic.tube_properties` raises it.

    See Also
    --------
    tube_properties

    Examples
    --------
    >>> import xarray as xr, pymc_hyperelastic as ph
    >>> posterior = xr.Dataset({"mu": (("chain", "draw"), [[20.0, 30.0]])})
    >>> tree = xr.DataTree.from_dict({"posterior": posterior})
    >>> tube = {"energy": ph.NeoHookean(), "inner_radius": 7.0, "outer_radius": 9.0}
    >>> figure = ph.plot_elastic_properties(tree, [5.0, 10.0], tube=tube, backend="none")
    >>> list(figure.viz["plot"].data_vars)[:2]
    ['compliance', 'distensibility']
    """
    names = list(var_names)
    unknown = [name for name in names if name not in PROPERTY_LABELS]
    if unknown or not names or isinstance(var_names, str):
        raise ValueError(f"var_names must be a list of {list(PROPERTY_LABELS)}; got {var_names!r}")
    fitted = fitted_classes(classes)
    told = _told(tube, pressure_unit, pc_kwargs)
    tables = {n: tube_properties(tree, pressure, **told)[names] for n, tree in fitted.items()}
    factor = per_kilopascal(pressure_unit)
    bands = bands_over(tables, {n: t["pressure"] * factor for n, t in tables.items()}, prob)
    columns = min(len(names), 3)
    canvas = Canvas(
        "wrap",
        bands,
        _VISUALS,
        backend,
        visuals,
        pc_kwargs,
        {"figsize": (3 * columns + 1.2, 2.6 * -(-len(names) // columns) + 0.3)},
        cols=["__variable__"],
        col_wrap=columns,
        aes={"color": ["class_label"], "linestyle": ["class_label"]},
        **lines_told_apart(),
    )
    dashed = draw_bands(canvas, bands, "pressure")
    for name in names:
        canvas.label("xlabel", f"pressure ({pressure_unit})", data=bands[[name]])
        canvas.label("ylabel", PROPERTY_LABELS[name], data=bands[[name]])
    entries = canvas.entries("class_label", "", "color", "linestyle")
    if len(fitted) == 1:
        entries = {"posterior median": {"color": PALETTE[0]}}
    canvas.legend(entries | dashed, title="class" if len(fitted) > 1 else None)
    _title(canvas, fitted, tables, prob, (tube or {}).get("energy"))
    return canvas.collection


@one_thread
def plot_wall_stress(
    classes: xr.DataTree,
    pressure: Any,
    *,
    prob: float = 0.95,
    pressure_unit: str = "mmHg",
    tube: Mapping[str, Any] | None = None,
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    """Plot the posterior of the stresses through the wall, a row for each class.

    Where the pressure is extrapolated, see :func:`~pymc_hyperelastic.wall_stress`, the median is
    dashed.

    Parameters
    ----------
    classes, prob, pressure_unit, backend
        Those of :func:`~pymc_hyperelastic.plot_elastic_properties`.
    pressure : array_like, shape (pressure,)
        Internal pressures, in `pressure_unit`; each has a colour.
    tube : dict of str to object, optional
        What :func:`~pymc_hyperelastic.wall_stress` is told besides: the material, the ``specimen``,
        the tube, the ``points`` in the wall.
    visuals : dict of str to dict or bool, optional
        Settings of ``band``, ``median``, ``extrapolated``, ``xlabel``, ``ylabel``, ``title`` (of a
        column) and ``legend``; False leaves one out.
    **pc_kwargs
        Passed to :meth:`arviz_plots.PlotCollection.grid`.

    Returns
    -------
    arviz_plots.PlotCollection
        Its variables are ``sigma_rr``, ``sigma_tt`` and ``sigma_zz``.

    Raises
    ------
    TypeError, ValueError
        If `classes` is no DataTree with a posterior, `prob`, the backend or a visual is unknown, or
        :func:`~pymc_hyperelastic.wall_stress` raises it.

    See Also
    --------
    wall_stress

    Examples
    --------
    >>> import xarray as xr, pymc_hyperelastic as ph
    >>> posterior = xr.Dataset({"mu": (("chain", "draw"), [[20.0, 30.0]])})
    >>> tree = xr.DataTree.from_dict({"posterior": posterior})
    >>> tube = {"energy": ph.NeoHookean(), "inner_radius": 7.0, "outer_radius": 9.0}
    >>> figure = ph.plot_wall_stress(tree, [5.0, 10.0], tube=tube, backend="none")
    >>> figure.viz["median"]["sigma_tt"].sizes["pressure"]
    2
    """
    fitted = fitted_classes(classes)
    told = _told(tube, pressure_unit, pc_kwargs)
    tables = {n: wall_stress(tree, pressure, **told)[[*_STRESSES]] for n, tree in fitted.items()}
    factor = per_kilopascal(pressure_unit)
    bands = bands_over(tables, {n: t["position"] for n, t in tables.items()}, prob)
    levels = [f"{p * factor:.4g} {pressure_unit}" for p in bands["pressure"].values]
    bands = bands.assign_coords(pressure=levels)
    canvas = Canvas(
        "grid",
        bands,
        _VISUALS,
        backend,
        visuals,
        pc_kwargs,
        {"figsize": (9.2, 2.5 * len(fitted) + 0.6), "sharex": True, "sharey": "col"},
        rows=["class_label"],
        cols=["__variable__"],
        aes={"color": ["pressure"], "linestyle": ["pressure"]},
        **lines_told_apart(),
    )
    dashed = draw_bands(canvas, bands, "position")
    first, *_, last = [*fitted, *fitted]
    for name, direction in _STRESSES.items():
        of_one = bands[[name]]
        top, bottom = {"coords": {"class_label": first}}, {"coords": {"class_label": last}}
        canvas.label("title", f"{direction} stress", data=of_one, size="medium", **top)
        canvas.label("xlabel", "place in the wall $(R-A)/(B-A)$", data=of_one, **bottom)
    for name in fitted:
        text = "Cauchy stress (kPa)" if len(fitted) == 1 else f"class {name}\nCauchy stress (kPa)"
        where = {"data": bands[["sigma_rr"]], "coords": {"class_label": name}}
        canvas.label("ylabel", text, **where)
    entries = canvas.entries("pressure", "", "color", "linestyle")
    canvas.legend(entries | dashed, title="pressure")
    single = levels[0] if len(levels) == 1 else None
    _title(canvas, fitted, tables, prob, (tube or {}).get("energy"), single)
    return canvas.collection


def _told(tube: Mapping[str, Any] | None, unit: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """What a prediction is told; TypeError if some of it was not given in `tube`."""
    strays = [name for name in given if name in (*GivenTube.__annotations__, "density", "points")]
    if strays:
        said = ", ".join(f"{name!r}: {given[name]!r}" for name in strays)
        raise TypeError(f"what a figure is to know of the tube is given as tube={{{said}}}")
    return {"pressure_unit": unit, **(tube or {})}


def lines_told_apart() -> dict[str, list[str]]:
    """Colours and line styles; there are no points to mark."""
    looks = told_apart()
    return {name: looks[name] for name in ("color", "linestyle")}


def bands_over(
    tables: Mapping[str, xr.Dataset], axes: Mapping[str, xr.DataArray], prob: float
) -> xr.Dataset:
    """Medians and bands of the draws of each class over its axis."""
    check_fraction("prob", prob)
    names = xr.DataArray(list(tables), dims="class_label", name="class_label")
    return xr.concat([_band(table, axes[n], prob) for n, table in tables.items()], dim=names)


def _band(table: xr.Dataset, x: xr.DataArray, prob: float) -> xr.Dataset:
    """Median and band of draws over an axis; what no draw reaches is left out."""
    beyond = table.coords.get("extrapolated", xr.zeros_like(table["pressure"])).astype(float)
    table = table.reset_coords(drop=True)
    some = table.notnull().any(["chain", "draw"])
    y = table.where(some, 0.0).quantile(median_and_band(prob), ["chain", "draw"]).where(some)
    y = y.rename(quantile="plot_axis").assign_coords(plot_axis=["y", "y_bottom", "y_top"])
    rows = {"x": x, "extrapolated": beyond}
    along = [
        xr.zeros_like(y.isel(plot_axis=[0])).assign_coords(plot_axis=[name])
        + row.reset_coords(drop=True)
        for name, row in rows.items()
    ]
    return xr.concat([*along, y], dim="plot_axis")


def draw_bands(canvas: Canvas, bands: xr.Dataset, along: str) -> dict[str, dict[str, Any]]:
    """Draw bands and medians; return what the legend says of dashes, if there are any."""
    from arviz_plots.visuals import fill_between_y, line_xy

    band = bands.sel(plot_axis=["x", "y_bottom", "y_top"]).rename(plot_axis="kwarg")
    settings: dict[str, Any] = {"alpha": 0.3, "linewidth": 0, "ignore_aes": {"linestyle"}}
    canvas.draw("band", fill_between_y, data=band, **settings)
    solid, dashed = solid_and_dashed(bands, along)
    canvas.draw("median", line_xy, data=solid, width=1.5)
    if not dashed.notnull().any().to_array().any():
        return {}
    line: dict[str, Any] = {"linestyle": "--", "width": 1.5, "ignore_aes": {"linestyle"}}
    canvas.draw("extrapolated", line_xy, data=dashed, **line)
    return {"extrapolated": {"color": "0.4", "linestyle": "--"}}


def _title(
    canvas: Canvas,
    fitted: Mapping[str, xr.DataTree],
    tables: Mapping[str, xr.Dataset],
    prob: float,
    energy: Any,
    pressure: str | None = None,
) -> None:
    """Say by which law, of whom, at which pressure if there is one, and of which data."""
    table = next(iter(tables.values()))
    law = law_of(next(iter(fitted.values())), energy)
    whose = table.attrs.get("specimen")
    whose = f"{whose} specimen" if whose == TYPICAL else whose and f"specimen {whose}"
    held = f"median and {100 * prob:.3g} % of the posterior"
    canvas.title(training_attrs(fitted), law, whose, pressure, held)
