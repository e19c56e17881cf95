"""Bands of posterior curves over the radius, and the data beside them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.inflation import check_inflation_data
from pymc_hyperelastic.evidence.checks import check_prob
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.models.study import inflation_data_of
from pymc_hyperelastic.plots.style import (
    MARKERS,
    MOST_DRAWS,
    RADIUS_LABEL,
    Canvas,
    by_stretch,
    fitted_classes,
    law_of,
    median_and_band,
    stretch_labels,
    told_apart,
    training_attrs,
)
from pymc_hyperelastic.predictions.draws import Draws, GivenTube, draws_of
from pymc_hyperelastic.predictions.measured import typical_tests
from pymc_hyperelastic.predictions.members import specimens_differ, tests_of

# From draws and radii, curves in the units that are drawn, with the coordinate "extrapolated".
Curve = Callable[[Draws, NDArray[np.float64]], xr.Dataset]
# From tests, what was measured of these curves: by (plot_axis, point).
Measured = Callable[[xr.Dataset], xr.Dataset]

VISUALS = "band median extrapolated points xlabel ylabel title legend"
_CURVE = 80  # points of a posterior curve
_LABELS = {"axial_stretch": "axial stretch", "specimen": "specimen"}


class Bands(NamedTuple):
    """What is drawn of classes."""

    fitted: dict[str, xr.DataTree]
    shown: dict[str, xr.Dataset]
    """Data by class."""
    told: str | None
    """What colours tell apart, if not classes."""
    posterior: xr.Dataset
    points: xr.Dataset
    prob: float

    @property
    def looks(self) -> dict[str, Any]:
        """Aesthetics of a PlotCollection."""
        told = self.told
        aes = {"color": [told or "class_label"], "overlay": ["tube"]}
        if told is None:
            return {"aes": aes}
        looks = told_apart() | {"aes": aes | {"linestyle": [told], "marker": [told]}}
        # Stretches are few: each has a marker of its own, which is seen in grey, too.
        return looks | ({"marker": MARKERS} if told == "axial_stretch" else {})

    @property
    def dots(self) -> dict[str, Any]:
        """Settings of points: of the colour of their band, or grey where there is one."""
        if self.told:
            return {"size": 12, "alpha": 0.6, "ignore_aes": {"linestyle", "overlay"}}
        return {"size": 7, "alpha": 0.6, "color": "0.25", "ignore_aes": {"color", "overlay"}}


def bands_of(
    classes: xr.DataTree,
    data: Any,
    prob: float,
    material: GivenTube,
    curve: Curve,
    measured: Measured,
) -> Bands:
    """Curves of fitted classes over the radii of data, or of what the classes were fitted to."""
    fitted = fitted_classes(classes)
    check_prob(prob)
    specimen = material.get("specimen")
    shown = {name: data_of(name, tree, data, specimen) for name, tree in fitted.items()}
    told = _told_by(shown)
    drawn = {
        name: _posterior_curves(tree, shown[name], told, prob, material, curve)
        for name, tree in fitted.items()
    }
    posterior = _side_by_side({name: curves for name, (curves, _) in drawn.items()}, told)
    points = {n: _told_points(measured(tests), tests, told) for n, (_, tests) in drawn.items()}
    return Bands(fitted, shown, told, posterior, _side_by_side(points, told), prob)


def draw_bands(canvas: Canvas, bands: Bands) -> dict[str, dict[str, Any]]:
    """Draw bands, medians and data; return what the legend says of them."""
    from arviz_plots.visuals import fill_between_y, line_xy, scatter_xy

    posterior = bands.posterior
    band = posterior.sel(plot_axis=["x", "y_bottom", "y_top"]).rename(plot_axis="kwarg")
    shape = {"linestyle", "marker"} if bands.told else set()
    canvas.draw("band", fill_between_y, data=band, alpha=0.35, linewidth=0, ignore_aes=shape)
    if bands.points.notnull().any().to_array().any():
        canvas.draw("points", scatter_xy, data=bands.points, **bands.dots)
    solid, dashed = _solid_and_dashed(posterior)
    line = {"width": 1.5, "ignore_aes": shape - {"linestyle"}}
    canvas.draw("median", line_xy, data=solid, **line)
    entries = _entries(canvas, bands)
    if dashed.notnull().any().to_array().any():
        canvas.draw("extrapolated", line_xy, data=dashed, linestyle="--", **line)
        entries["extrapolated"] = {"color": "0.4", "linestyle": "--"}
    return entries


def label_columns(canvas: Canvas, bands: Bands, top: str, bottom: str) -> None:
    """Name the radii below the lowest variable, and above the highest the class of each column."""
    for name, data in bands.shown.items():
        where = {"coords": {"class_label": name}}
        radius = RADIUS_LABEL
        if "outer_diameter" in data:
            radius += "\nfrom the measured outer diameter"
        canvas.label("xlabel", radius, data=bands.posterior[[bottom]], **where)
        if len(bands.shown) > 1:
            highest = bands.posterior[[top]]
            canvas.label("title", f"class {name}", data=highest, size="medium", **where)


def title_bands(
    canvas: Canvas,
    bands: Bands,
    energy: StrainEnergy | Sequence[Layer] | None,
    specimen: str | None,
) -> None:
    """Say by which law, of whom, and of which data."""
    fitted, shown = bands.fitted, bands.shown
    law = law_of(next(iter(fitted.values())), energy)
    # The posterior is as simulated as the data that it comes from.
    origin = [{"simulated": attrs.get("simulated")} for attrs in training_attrs(fitted)]
    whose = "typical specimen" if any(map(specimens_differ, fitted.values())) else None
    whose = f"specimen {specimen}" if specimen is not None else whose
    canvas.title([*(data.attrs for data in shown.values()), *origin], law, whose)


def _entries(canvas: Canvas, bands: Bands) -> dict[str, dict[str, Any]]:
    """What the legend says of data, median and band; of each tube that has its own colour."""
    entries: dict[str, dict[str, Any]] = {}
    measured = bool(bands.points.notnull().any().to_array().any())
    if bands.told:
        style = ("color", "linestyle", "marker")[: 3 if measured else 2]
        entries |= canvas.entries(bands.told, f"{_LABELS[bands.told]} ", *style, markersize=4)
    if measured:
        data = "data (of that colour)" if bands.told else "data"
        entries[data] = {"color": "0.25", "marker": "o", "markersize": 3, "linestyle": "none"}
    posterior = f"{100 * bands.prob:.3g} % of the posterior"
    entries["posterior median"] = {"color": "0.4", "linewidth": 1.5}
    return entries | {posterior: {"color": "0.4", "linewidth": 6, "alpha": 0.35}}


def data_of(name: str, tree: xr.DataTree, data: Any, specimen: str | None) -> xr.Dataset:
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


def _told_points(points: xr.Dataset, data: xr.Dataset, told: str | None) -> xr.Dataset:
    """Points of the data, apart from each other as their bands are."""
    points = points.assign_coords(plot_axis=["x", "y"], point=range(points.sizes["point"]))
    if told is None:
        return points
    labels = np.array(_labels(data, told))
    names = list(dict.fromkeys(labels.tolist()))
    of_point = xr.DataArray(labels[data["test"].values], dims="point")
    return points.where(of_point == xr.DataArray(names, {told: names}, told))


def _posterior_curves(
    tree: xr.DataTree,
    data: xr.Dataset,
    told: str | None,
    prob: float,
    material: GivenTube,
    curve: Curve,
) -> tuple[xr.Dataset, xr.Dataset]:
    """Median and band of curves for each of the tubes of the data.

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
        predicted = curve(draws, grid)
        beyond = predicted.coords.get("extrapolated", xr.zeros_like(predicted["radius"])).values
        y = predicted.quantile(median_and_band(prob), dim=["chain", "draw"])
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
