"""The posterior of pressure and stiffness over the data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from pymc_hyperelastic.data.inflation import check_inflation_data, points_of
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.models.study import inflation_data_of
from pymc_hyperelastic.plots.style import (
    MOST_DRAWS,
    RADIUS_LABEL,
    Backend,
    Canvas,
    Visuals,
    fitted_classes,
    law_of,
    per_kilopascal,
    training_attrs,
)
from pymc_hyperelastic.predictions.curves import pressure_curve
from pymc_hyperelastic.predictions.draws import GivenTube, draws_of
from pymc_hyperelastic.predictions.measured import typical_tests
from pymc_hyperelastic.predictions.members import specimens_differ, tests_of

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

_CURVE = 80  # points of a posterior curve


def plot_pressure_fit(
    classes: xr.DataTree,
    data: xr.Dataset | Mapping[str, xr.Dataset] | None = None,
    *,
    prob: float = 0.94,
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

    Parameters
    ----------
    classes : xarray.DataTree
        Result of :func:`pymc_hyperelastic.fit_classes`, one of its classes, or a sampled model.
    data : xarray.Dataset or dict of str to xarray.Dataset, optional
        What is shown with the posterior: inflation data, or those for each class. The training
        data when missing. Tests on tubes of other dimensions have bands of their own.
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
        ``points``, ``xlabel``, ``ylabel``, ``title`` (of a column) and ``legend``; False leaves one
        out.
    **pc_kwargs
        Passed to :meth:`arviz_plots.PlotCollection.grid`.

    Returns
    -------
    arviz_plots.PlotCollection
        Its variables are ``pressure`` and ``stiffness``.

    Raises
    ------
    TypeError, ValueError
        If `classes` is no DataTree with a posterior, there are no data or no strain energy, the
        data are unsound or lack a class, or `prob`, the unit, the backend or a visual is unknown.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1")
    >>> model = ph.ogden_model(data, sigma=5 * ph.mmHg, slope_weight=3.0)
    >>> tree = ph.sample_smc(model, draws=500, chains=2, random_seed=1, progressbar=False)
    >>> figure = ph.plot_pressure_fit(tree, data, backend="none")
    >>> list(figure.viz["plot"].data_vars)
    ['pressure', 'stiffness']
    """
    from arviz_plots.visuals import fill_between_y, line_xy, scatter_xy

    fitted = fitted_classes(classes)
    if not 0 < prob < 1:
        raise ValueError(f"prob must be a probability between 0 and 1, not {prob}")
    factor = per_kilopascal(pressure_unit)
    shown = {name: _data_of(name, tree, data, specimen) for name, tree in fitted.items()}
    material: GivenTube = {"energy": energy, "specimen": specimen}
    drawn = {n: _posterior_curves(fitted[n], shown[n], prob, material, factor) for n in fitted}
    posterior = _side_by_side({name: curves for name, (curves, _) in drawn.items()})
    measured = _side_by_side({name: _measured(tests, factor) for name, (_, tests) in drawn.items()})
    canvas = Canvas(
        "grid",
        posterior,
        "band median extrapolated points xlabel ylabel title legend",
        backend,
        visuals,
        pc_kwargs,
        {"figsize": (max(2.9 * len(fitted) + 0.9, 5), 5.6), "sharex": "col", "sharey": "row"},
        rows=["__variable__"],
        cols=["class_label"],
        aes={"color": ["class_label"], "overlay": ["tube"]},
    )
    band = posterior.sel(plot_axis=["x", "y_bottom", "y_top"]).rename(plot_axis="kwarg")
    grey = {"color": "0.25", "ignore_aes": {"color", "overlay"}}
    canvas.draw("band", fill_between_y, data=band, alpha=0.35, linewidth=0)
    canvas.draw("points", scatter_xy, data=measured, size=7, alpha=0.6, **grey)
    solid, dashed = _solid_and_dashed(posterior)
    canvas.draw("median", line_xy, data=solid, width=1.5)
    extrapolated = bool(dashed.notnull().any().to_array().any())
    if extrapolated:
        canvas.draw("extrapolated", line_xy, data=dashed, width=1.5, linestyle="--")
    top, bottom = posterior[["pressure"]], posterior[["stiffness"]]
    for name in fitted:
        where = {"coords": {"class_label": name}}
        canvas.label("xlabel", RADIUS_LABEL, data=bottom, **where)
        if len(fitted) > 1:
            canvas.label("title", f"class {name}", data=top, size="medium", **where)
    where = {"coords": {"class_label": next(iter(fitted))}}
    canvas.label("ylabel", f"pressure ({pressure_unit})", data=top, **where)
    canvas.label("ylabel", f"stiffness d$p$/d$a$ ({pressure_unit}/mm)", data=bottom, **where)
    canvas.legend(
        {
            "data": {"color": "0.25", "marker": "o", "markersize": 3, "linestyle": "none"},
            "posterior median": {"color": "0.4", "linewidth": 1.5},
            **({"extrapolated": {"color": "0.4", "linestyle": "--"}} if extrapolated else {}),
            f"{100 * prob:.3g} % of the posterior": {"color": "0.4", "linewidth": 6, "alpha": 0.35},
        },
        loc="outside lower center",
        ncols=4 if extrapolated else 3,
    )
    law = energy.name if isinstance(energy, StrainEnergy) else law_of(next(iter(fitted.values())))
    # The posterior is as simulated as the data that it comes from.
    origin = [{"simulated": attrs.get("simulated")} for attrs in training_attrs(fitted)]
    whose = "typical specimen" if any(map(specimens_differ, fitted.values())) else None
    whose = f"specimen {specimen}" if specimen is not None else whose
    canvas.title([*(data.attrs for data in shown.values()), *origin], law, whose)
    return canvas.collection


def _data_of(name: str, tree: xr.DataTree, data: Any, specimen: str | None) -> xr.Dataset:
    """Inflation data to be shown with a class."""
    if isinstance(data, Mapping) and not isinstance(data, xr.Dataset):
        if name not in data:
            raise ValueError(f"data has nothing for class {name!r}; it has {list(data)}")
        data = data[name]
    elif data is None:
        if "inner_radius" not in tree.children.get("constant_data", {}):
            raise ValueError(f"{name!r} holds no inflation data: give them as data=...")
        data = inflation_data_of(tree)
        data = data if specimen is None else tests_of(data, specimen)
    check_inflation_data(data)
    return data


def _side_by_side(of_class: dict[str, xr.Dataset]) -> xr.Dataset:
    """Join what is drawn for each class; what one has more of is NaN in the other."""
    names = xr.DataArray(list(of_class), dims="class_label", name="class_label")
    return xr.concat(of_class.values(), dim=names, join="outer", fill_value=np.nan)


def _measured(data: xr.Dataset, pressure_factor: float) -> xr.Dataset:
    """Measured pressures, and their central differences inside each test."""
    radius, pressure = data["radius"].values, pressure_factor * data["pressure"].values
    slope = np.full_like(pressure, np.nan)
    for i in range(data.sizes["test"]):
        test = points_of(data, i)
        step = radius[test][2:] - radius[test][:-2]
        step[step == 0] = np.nan
        slope[test][1:-1] = (pressure[test][2:] - pressure[test][:-2]) / step
    dims = ("plot_axis", "point")
    return xr.Dataset(
        {"pressure": (dims, [radius, pressure]), "stiffness": (dims, [radius, slope])},
        {"plot_axis": ["x", "y"], "point": range(len(radius))},
    )


def _posterior_curves(
    tree: xr.DataTree, data: xr.Dataset, prob: float, material: GivenTube, pressure_factor: float
) -> tuple[xr.Dataset, xr.Dataset]:
    """Median and band of pressure and stiffness for each of the tubes of the data.

    With them the data, of which what is not known is that of the median tube.
    """
    posterior = tree["posterior"].to_dataset()
    step = -(-posterior.sizes["chain"] * posterior.sizes["draw"] // MOST_DRAWS)
    thinned = tree.copy()
    thinned["posterior"] = xr.DataTree(posterior.isel(draw=slice(None, None, step)))
    geometry = np.stack([data[name].values for name in GEOMETRY], axis=1)
    # NaN are not equal to each other, infinities are.
    tubes, tube_of_test = np.unique(
        np.where(np.isnan(geometry), np.inf, geometry), axis=0, return_inverse=True
    )
    curves, tests = [], data
    for i, tube in enumerate(tubes):
        known = {k: v for k, v in zip(GEOMETRY, tube.tolist(), strict=True) if np.isfinite(v)}
        draws = draws_of(thinned, **material, **known)
        tests = typical_tests(data, draws.inferred)
        radius = tests["radius"].values[tube_of_test[data["test"].values] == i]
        grid = np.linspace(radius.min(), radius.max(), _CURVE)
        curve = pressure_curve(draws, grid)
        beyond = curve.coords.get("extrapolated", xr.zeros_like(curve["radius"])).values
        levels = [0.5, (1 - prob) / 2, (1 + prob) / 2]
        y = (curve * pressure_factor).quantile(levels, dim=["chain", "draw"])
        rows = {name: [grid, beyond, *of_levels.values] for name, of_levels in y.items()}
        curves.append(xr.Dataset({name: (("plot_axis", "point"), v) for name, v in rows.items()}))
    axes = {
        "plot_axis": ["x", "extrapolated", "y", "y_bottom", "y_top"],
        "tube": range(len(curves)),
    }
    return xr.concat(curves, dim="tube").assign_coords(axes), tests


def _solid_and_dashed(posterior: xr.Dataset) -> tuple[xr.Dataset, xr.Dataset]:
    """The median where it is measured, and where it is extrapolated; which reaches the first."""
    line = posterior.sel(plot_axis=["x", "y"])
    beyond = posterior.sel(plot_axis="extrapolated", drop=True)
    next_to = beyond.rolling(point=3, center=True, min_periods=1).max()
    return line.where(beyond != 1), line.where(next_to == 1)
