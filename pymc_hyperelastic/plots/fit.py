"""The posterior of pressure and stiffness over the data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.inflation import check_inflation_data, points_of
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.models.study import inflation_data_of
from pymc_hyperelastic.plots.style import (
    MARKERS,
    MOST_DRAWS,
    RADIUS_LABEL,
    Backend,
    Canvas,
    Visuals,
    by_stretch,
    fitted_classes,
    law_of,
    per_kilopascal,
    stretch_labels,
    told_apart,
    training_attrs,
)
from pymc_hyperelastic.predictions.curves import pressure_curve
from pymc_hyperelastic.predictions.draws import GivenTube, draws_of
from pymc_hyperelastic.predictions.measured import typical_tests
from pymc_hyperelastic.predictions.members import specimens_differ, tests_of

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

_CURVE = 80  # points of a posterior curve
_FAR_OUT = 3.0  # interquartile ranges, Tukey's outer fence
_LABELS = {"axial_stretch": "axial stretch", "specimen": "specimen"}


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

    Where tests are at several axial stretches, each has a colour and a marker, those of its band
    and its data. Where there is one stretch, or each specimen has its own, and tubes differ,
    specimens are told apart in the same way. Slopes far outside of the others, as close readings
    make them, do not stretch the axis: an arrowhead at its end stands for each, and the legend
    counts them.

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
        Its variables are ``pressure`` and ``stiffness``, its dimensions ``class_label``, ``tube``
        and, where they have colours of their own, ``axial_stretch`` or ``specimen``.

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
    from arviz_plots.visuals import fill_between_y, line_xy, scatter_xy, set_ylim

    fitted = fitted_classes(classes)
    if not 0 < prob < 1:
        raise ValueError(f"prob must be a probability between 0 and 1, not {prob}")
    factor = per_kilopascal(pressure_unit)
    shown = {name: _data_of(name, tree, data, specimen) for name, tree in fitted.items()}
    told = _told_by(shown)
    material: GivenTube = {"energy": energy, "specimen": specimen}
    drawn = {
        n: _posterior_curves(tree, shown[n], told, prob, material, factor)
        for n, tree in fitted.items()
    }
    posterior = _side_by_side({name: curves for name, (curves, _) in drawn.items()}, told)
    measured = {name: _measured(tests, told, factor) for name, (_, tests) in drawn.items()}
    points = _side_by_side(measured, told)
    limits = _limits(points["stiffness"], posterior["stiffness"])
    style = {"color": [told or "class_label"], "overlay": ["tube"]}
    looks = told_apart() if told else {}
    if told == "axial_stretch":
        looks["marker"] = MARKERS  # they are few: each has its own, which is seen in grey, too
    canvas = Canvas(
        "grid",
        posterior,
        "band median extrapolated points above below xlabel ylabel title legend",
        backend,
        visuals,
        pc_kwargs,
        {"figsize": (max(2.9 * len(fitted) + 0.9, 5), 5.6), "sharex": "col", "sharey": "row"},
        rows=["__variable__"],
        cols=["class_label"],
        aes=style | ({"linestyle": [told], "marker": [told]} if told else {}),
        **looks,
    )
    band = posterior.sel(plot_axis=["x", "y_bottom", "y_top"]).rename(plot_axis="kwarg")
    shape = {"linestyle", "marker"} if told else set()
    canvas.draw("band", fill_between_y, data=band, alpha=0.35, linewidth=0, ignore_aes=shape)
    dots: dict[str, Any] = {"size": 7, "alpha": 0.6}
    if told:
        dots |= {"size": 12, "ignore_aes": {"linestyle", "overlay"}}
    else:
        dots |= {"color": "0.25", "ignore_aes": {"color", "overlay"}}
    canvas.draw("points", scatter_xy, data=points, **dots)
    solid, dashed = _solid_and_dashed(posterior)
    line = {"width": 1.5, "ignore_aes": shape - {"linestyle"}}
    canvas.draw("median", line_xy, data=solid, **line)
    entries = _entries(canvas, told, prob)
    if dashed.notnull().any().to_array().any():
        canvas.draw("extrapolated", line_xy, data=dashed, linestyle="--", **line)
        entries["extrapolated"] = {"color": "0.4", "linestyle": "--"}
    if limits:
        canvas.adjust(set_ylim, data=points[["stiffness"]], limits=limits)
        entries |= _draw_beyond(canvas, points, limits, dots)
    _label(canvas, posterior, shown, pressure_unit)
    canvas.legend(entries, loc="outside lower center")
    _title(canvas, fitted, shown, energy, specimen)
    return canvas.collection


def _entries(canvas: Canvas, told: str | None, prob: float) -> dict[str, dict[str, Any]]:
    """What the legend says of data, median and band; of each tube that has its own colour."""
    of_tubes, points = {}, "data"
    if told:
        style = ("color", "linestyle", "marker")
        of_tubes = canvas.entries(told, f"{_LABELS[told]} ", *style, markersize=4)
        points = "data (of that colour)"
    return of_tubes | {
        points: {"color": "0.25", "marker": "o", "markersize": 3, "linestyle": "none"},
        "posterior median": {"color": "0.4", "linewidth": 1.5},
        f"{100 * prob:.3g} % of the posterior": {"color": "0.4", "linewidth": 6, "alpha": 0.35},
    }


def _label(
    canvas: Canvas, posterior: xr.Dataset, shown: dict[str, xr.Dataset], pressure_unit: str
) -> None:
    """Name the axes, and the class of each column."""
    top, bottom = posterior[["pressure"]], posterior[["stiffness"]]
    for name, data in shown.items():
        where = {"coords": {"class_label": name}}
        radius = RADIUS_LABEL
        if "outer_diameter" in data:
            radius += "\nfrom the measured outer diameter"
        canvas.label("xlabel", radius, data=bottom, **where)
        if len(shown) > 1:
            canvas.label("title", f"class {name}", data=top, size="medium", **where)
    where = {"coords": {"class_label": next(iter(shown))}}
    canvas.label("ylabel", f"pressure ({pressure_unit})", data=top, **where)
    canvas.label("ylabel", f"stiffness d$p$/d$a$ ({pressure_unit}/mm)", data=bottom, **where)


def _title(
    canvas: Canvas,
    fitted: Mapping[str, xr.DataTree],
    shown: Mapping[str, xr.Dataset],
    energy: StrainEnergy | Sequence[Layer] | None,
    specimen: str | None,
) -> None:
    """Say by which law, of whom, and of which data."""
    law = energy.name if isinstance(energy, StrainEnergy) else law_of(next(iter(fitted.values())))
    # The posterior is as simulated as the data that it comes from.
    origin = [{"simulated": attrs.get("simulated")} for attrs in training_attrs(fitted)]
    whose = "typical specimen" if any(map(specimens_differ, fitted.values())) else None
    whose = f"specimen {specimen}" if specimen is not None else whose
    canvas.title([*(data.attrs for data in shown.values()), *origin], law, whose)


def _limits(slope: xr.DataArray, curve: xr.DataArray) -> tuple[float, float] | None:
    """Ends of the axis of slopes, where some are so far off that they would flatten the rest.

    These are Tukey's far-out values, beyond three interquartile ranges, that no band reaches.
    """
    slopes = slope.sel(plot_axis="y").values
    slopes = slopes[np.isfinite(slopes)]
    if not slopes.size:
        return None
    low, high = np.quantile(slopes, [0.25, 0.75])
    reach = _FAR_OUT * (high - low)
    band = curve.sel(plot_axis=["y_bottom", "y_top"])
    low = min(low - reach, float(band.min()))
    high = max(high + reach, float(band.max()))
    near = slopes[(slopes >= low) & (slopes <= high)]
    if near.size == slopes.size:
        return None
    low, high = min(near.min(), float(band.min())), max(near.max(), float(band.max()))
    margin = 0.06 * (high - low)
    return float(low - margin), float(high + margin)


def _draw_beyond(
    canvas: Canvas, points: xr.Dataset, limits: tuple[float, float], dots: dict[str, Any]
) -> dict[str, dict[str, Any]]:
    """Draw arrowheads at the end of the axis where slopes are beyond it; the legend counts them."""
    from arviz_plots.visuals import scatter_xy

    slope = points[["stiffness"]].sel(plot_axis="y", drop=True)
    at_end = {"size": 25, "clip_on": False, "zorder": 5, "alpha": 1}
    entries = {}
    for name, marker, end, beyond in (
        ("above", "^", limits[1], slope > limits[1]),
        ("below", "v", limits[0], slope < limits[0]),
    ):
        count = int(beyond["stiffness"].sum())
        if count:
            ends = points[["stiffness"]].where(beyond)
            ends = ends.where((points["plot_axis"] == "x") | ~beyond, end)
            canvas.draw(name, scatter_xy, data=ends, **dots | at_end | {"marker": marker})
            what = {"marker": marker, "linestyle": "none", "color": "0.25", "markersize": 5}
            entries[f"{count} of {int(slope.count()['stiffness'])} slopes {name} the axis"] = what
    return entries


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


def _told_by(shown: Mapping[str, xr.Dataset]) -> str | None:
    """What colours tell apart besides the classes: axial stretches, or the tubes of specimens."""
    stretches = {s for data in shown.values() for s in stretch_labels(data["axial_stretch"])}
    if 1 < len(stretches) <= len(MARKERS):
        return "axial_stretch"
    tubes = max(len(_tubes(data)[0]) for data in shown.values())
    return "specimen" if tubes > 1 else None


def _tubes(data: xr.Dataset) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """The distinct tubes of the data, and which of them each test is on."""
    geometry = np.stack([data[name].values for name in GEOMETRY], axis=1)
    # NaN are not equal to each other, infinities are.
    known = np.where(np.isnan(geometry), np.inf, geometry)
    return np.unique(known, axis=0, return_inverse=True)


def _labels(data: xr.Dataset, told: str | None) -> list[str]:
    """What tells the band of each test apart: its axial stretch, or who has such a tube."""
    if told is None:
        return [""] * data.sizes["test"]
    if told == "axial_stretch":
        return stretch_labels(data[told])
    specimen, (_, tube) = data[told].values, _tubes(data)
    owners = [dict.fromkeys(specimen[tube == t].tolist()) for t in tube.tolist()]
    return [
        str(next(iter(of_tube))) + (f" and {len(of_tube) - 1} more" if len(of_tube) > 1 else "")
        for of_tube in owners
    ]


def _side_by_side(of_class: dict[str, xr.Dataset], told: str | None) -> xr.Dataset:
    """Join what is drawn for each class; what one has more of is NaN in the other."""
    names = xr.DataArray(list(of_class), dims="class_label", name="class_label")
    joined = xr.concat(of_class.values(), dim=names, join="outer", fill_value=np.nan)
    if told is None:
        return joined
    labels = list(dict.fromkeys(v for d in of_class.values() for v in d[told].values.tolist()))
    if told == "axial_stretch":
        labels.sort(key=by_stretch)
    return joined.sel({told: labels})


def _measured(data: xr.Dataset, told: str | None, pressure_factor: float) -> xr.Dataset:
    """Measured pressures, and their central differences inside each test."""
    radius, pressure = data["radius"].values, pressure_factor * data["pressure"].values
    slope = np.full_like(pressure, np.nan)
    for i in range(data.sizes["test"]):
        test = points_of(data, i)
        step = radius[test][2:] - radius[test][:-2]
        step[step == 0] = np.nan
        slope[test][1:-1] = (pressure[test][2:] - pressure[test][:-2]) / step
    dims = ("plot_axis", "point")
    measured = xr.Dataset(
        {"pressure": (dims, [radius, pressure]), "stiffness": (dims, [radius, slope])},
        {"plot_axis": ["x", "y"], "point": range(len(radius))},
    )
    if told is None:
        return measured
    labels = np.array(_labels(data, told))
    names = list(dict.fromkeys(labels.tolist()))
    of_point = xr.DataArray(labels[data["test"].values], dims="point")
    return measured.where(of_point == xr.DataArray(names, {told: names}, told))


def _posterior_curves(
    tree: xr.DataTree,
    data: xr.Dataset,
    told: str | None,
    prob: float,
    material: GivenTube,
    pressure_factor: float,
) -> tuple[xr.Dataset, xr.Dataset]:
    """Median and band of pressure and stiffness for each of the tubes of the data.

    With them the data, of which what is not known is that of the median tube.
    """
    posterior = tree["posterior"].to_dataset()
    step = -(-posterior.sizes["chain"] * posterior.sizes["draw"] // MOST_DRAWS)
    thinned = tree.copy()
    thinned["posterior"] = xr.DataTree(posterior.isel(draw=slice(None, None, step)))
    tubes, tube_of_test = _tubes(data)
    tests, labels = data, _labels(data, told)
    curves: dict[str, list[xr.Dataset]] = {label: [] for label in labels}
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
        label = labels[int(np.flatnonzero(tube_of_test == i)[0])]
        of_tube = xr.Dataset({name: (("plot_axis", "point"), v) for name, v in rows.items()})
        curves[label].append(of_tube)
    axes: dict[str, Any] = {"plot_axis": ["x", "extrapolated", "y", "y_bottom", "y_top"]}
    bands = [
        xr.concat(of_label, dim="tube").assign_coords(axes | {"tube": range(len(of_label))})
        for of_label in curves.values()
    ]
    if told is None:
        return bands[0], tests
    names = xr.DataArray(list(curves), dims=told, name=told)
    return xr.concat(bands, dim=names, join="outer", fill_value=np.nan), tests


def _solid_and_dashed(posterior: xr.Dataset) -> tuple[xr.Dataset, xr.Dataset]:
    """The median where it is measured, and where it is extrapolated; which reaches the first."""
    line = posterior.sel(plot_axis=["x", "y"])
    beyond = posterior.sel(plot_axis="extrapolated", drop=True)
    next_to = beyond.rolling(point=3, center=True, min_periods=1).max()
    return line.where(beyond != 1), line.where(next_to == 1)
