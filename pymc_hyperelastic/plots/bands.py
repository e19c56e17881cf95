"""Bands of posterior curves over the radius or the axial stretch, and the data beside them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.data.inflation import (
    check_inflation_data,
    extension_tests,
    held_stretches,
)
from pymc_hyperelastic.data.select import tests_at
from pymc_hyperelastic.evidence.checks import check_fraction
from pymc_hyperelastic.evidence.results import thinned_draws
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.mechanics.tube import GEOMETRY
from pymc_hyperelastic.models.settings import inflation_data_of
from pymc_hyperelastic.plots.extension import Along, extension_curves, is_over_stretch
from pymc_hyperelastic.plots.style import (
    MARKERS,
    MOST_DRAWS,
    RADIUS_LABEL,
    STRETCH_LABEL,
    Canvas,
    by_stretch,
    fitted_classes,
    law_of,
    median_and_band,
    solid_and_dashed,
    stretch_labels,
    told_apart,
    training_attrs,
)
from pymc_hyperelastic.predictions.draws import Draws, GivenTube, draws_of
from pymc_hyperelastic.predictions.measured import typical_tests
from pymc_hyperelastic.predictions.members import specimens_differ, tests_of

# Digits, in mm and radians, to which measures of tubes are rounded before they are compared.
_DIGITS = 9
# From draws and radii, curves in the units that are drawn, with the coordinate "extrapolated".
Curve = Callable[[Draws, NDArray[np.float64]], xr.Dataset]
# From tests, what was measured of these curves: by (plot_axis, point).
Measured = Callable[[xr.Dataset], xr.Dataset]

VISUALS = "band median extrapolated points xlabel ylabel title legend"
_ROOM = 2.0  # that bands may take on each side of the data, in sizes of the largest of these
_CURVE = 80  # points of a posterior curve
_FEWEST_DRAWS = 400  # of a band, where there are many in one panel
_CUT = "bands go on beyond the axis"
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
    along: Along,
    pressure_unit: str = "mmHg",
) -> Bands:
    """Curves of fitted classes over the radii of data, or of what the classes were fitted to.

    Those `along` extension tests are over their axial stretches, and have names of their own; the
    `pressure_unit` is that in which these tests are named.
    """
    fitted = fitted_classes(classes)
    check_fraction("prob", prob)
    specimen = material.get("specimen")
    shown = {name: data_of(name, tree, data, specimen) for name, tree in fitted.items()}
    labels = {name: stretch_labels(data, pressure_unit) for name, data in shown.items()}
    told = _told_by(shown, labels)
    if told != "axial_stretch":
        labels = {name: _owners(data, told) for name, data in shown.items()}
    drawn = {
        name: _posterior_curves(
            tree, shown[name], (told, labels[name]), prob, material, (curve, along)
        )
        for name, tree in fitted.items()
    }
    posterior = _side_by_side({name: curves for name, (curves, _) in drawn.items()}, told)
    points = {
        name: _told_points(measured(tests), tests, told, labels[name])
        for name, (_, tests) in drawn.items()
    }
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
    solid, dashed = solid_and_dashed(posterior, "point")
    line = {"width": 1.5, "ignore_aes": shape - {"linestyle"}}
    canvas.draw("median", line_xy, data=solid, **line)
    entries = _entries(canvas, bands)
    if dashed.notnull().any().to_array().any():
        canvas.draw("extrapolated", line_xy, data=dashed, linestyle="--", **line)
        entries["extrapolated"] = {"color": "0.4", "linestyle": "--"}
    return entries


def limit_axis(
    canvas: Canvas, bands: Bands, name: str, far_out: float | None = None
) -> tuple[tuple[float, float] | None, dict[str, dict[str, Any]]]:
    """Limit an axis that bands, or far-out data, would stretch until nothing is seen of the data.

    Bands are followed as far beyond the data as twice the largest of these: that of a typical
    specimen may reach a thousand times as far, in the tube of one that is stiffer or softer. Far
    out are Tukey's values, beyond so many interquartile ranges, that no band reaches; there are
    none where `far_out` is None. Returns the limits, if the axis has any, and what the legend says
    of the bands.
    """
    from arviz_plots.visuals import set_ylim

    limits, cut = _limits(bands.points[name], bands.posterior[name], far_out)
    if limits is None:
        return None, {}
    canvas.adjust(set_ylim, data=bands.points[[name]], limits=limits)
    return limits, {_CUT: {"color": "0.4", "linewidth": 0}} if cut else {}


def _limits(
    points: xr.DataArray, curve: xr.DataArray, far_out: float | None
) -> tuple[tuple[float, float] | None, bool]:
    """Ends of an axis that is to be limited, and whether bands go on beyond."""
    values = points.sel(plot_axis="y").values
    values = values[np.isfinite(values)]
    if not values.size:
        return None, False
    low, high = -np.inf, np.inf
    if far_out is not None:
        low, high = np.quantile(values, [0.25, 0.75])
        low, high = low - far_out * (high - low), high + far_out * (high - low)
    near = values[(values >= low) & (values <= high)]
    room = _ROOM * np.abs(near).max() or np.inf
    band = curve.sel(plot_axis=["y_bottom", "y_top"])
    ends = float(band.min()), float(band.max())
    held = max(ends[0], near.min() - room), min(ends[1], near.max() + room)
    near = values[(values >= min(low, held[0])) & (values <= max(high, held[1]))]
    if near.size == values.size and held == ends:
        return None, False
    low, high = min(near.min(), held[0]), max(near.max(), held[1])
    margin = 0.06 * (high - low)
    return (float(low - margin), float(high + margin)), held != ends


def label_columns(canvas: Canvas, bands: Bands, lowest: str) -> None:
    """Name the radii below the lowest variable over them, and on top the class of each column.

    Below each of the variables over axial stretches, these.
    """
    highest, *_ = names = list(map(str, bands.posterior.data_vars))
    for name, data in bands.shown.items():
        where = {"coords": {"class_label": name}}
        computed = "\nfrom the measured outer diameter" if "outer_diameter" in data else ""
        for variable in names:
            of_variable = bands.posterior[[variable]]
            if variable == lowest:
                canvas.label("xlabel", RADIUS_LABEL + computed, data=of_variable, **where)
            elif is_over_stretch(variable):
                canvas.label("xlabel", STRETCH_LABEL, data=of_variable, **where)
        if len(bands.shown) > 1:
            of_highest = bands.posterior[[highest]]
            canvas.label("title", f"class {name}", data=of_highest, size="medium", **where)


def rows_of(bands: Bands) -> tuple[int, dict[str, Any]]:
    """How many rows of panels there are, and which of them share an axis of radii."""
    names = list(map(str, bands.posterior.data_vars))
    of_stretch = any(map(is_over_stretch, names))
    shared = {"sharey": "row"} | ({} if of_stretch else {"sharex": "col"})
    return len(names), shared


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


def _told_by(shown: Mapping[str, xr.Dataset], labels: Mapping[str, list[str]]) -> str | None:
    """What colours tell apart besides the classes: axial stretches, or the tubes of specimens."""
    stretches = {label for of_class in labels.values() for label in of_class}
    if 1 < len(stretches) <= len(MARKERS):
        return "axial_stretch"
    tubes = max(len(_tubes(data)[0]) for data in shown.values())
    return "specimen" if tubes > 1 else None


def _tubes(data: xr.Dataset) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """The distinct tubes of the data, and which of them each test is on."""
    tubes = {name: data[name].values for name in GEOMETRY}
    tubes["axial_stretch"] = held_stretches(data)
    geometry = np.stack([tubes[name] for name in GEOMETRY], axis=1)
    # NaN are not equal to each other, infinities are.
    known = np.where(np.isnan(geometry), np.inf, geometry)
    # Measures that differ by rounding errors are of one tube.
    _, first, tube = np.unique(known.round(_DIGITS), axis=0, return_index=True, return_inverse=True)
    return known[first], tube


def _owners(data: xr.Dataset, told: str | None) -> list[str]:
    """What tells the band of each test apart: who has such a tube, if anything."""
    if told is None:
        return [""] * data.sizes["test"]
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


def _told_points(
    points: xr.Dataset, data: xr.Dataset, told: str | None, labels: list[str]
) -> xr.Dataset:
    """Points of the data, apart from each other as their bands are."""
    points = points.assign_coords(plot_axis=["x", "y"], point=range(points.sizes["point"]))
    if told is None:
        return points
    names = list(dict.fromkeys(labels))
    of_point = xr.DataArray(np.array(labels)[data["test"].values], dims="point")
    return points.where(of_point == xr.DataArray(names, {told: names}, told))


def _posterior_curves(
    tree: xr.DataTree,
    data: xr.Dataset,
    told: tuple[str | None, list[str]],
    prob: float,
    material: GivenTube,
    curves: tuple[Curve, Along],
) -> tuple[xr.Dataset, xr.Dataset]:
    """Median and band of curves for each of the tubes of the data, and for each extension test.

    With them the data, of which what is not known is that of the median tube.
    """
    dimension, labels = told
    over_radii, along = curves
    rows: dict[str, list[dict[str, NDArray[np.float64]]]] = {label: [] for label in labels}
    inferred: dict[str, float] = {}
    for test, inferred, of_tube in _over_radii(tree, data, prob, material, over_radii):
        rows[labels[test]].append(of_tube)
    for test, inferred, of_test in extension_curves(tree, data, prob, material, along):
        rows[labels[test]].append(of_test)
    names = dict.fromkeys(name for of_label in rows.values() for one in of_label for name in one)
    in_order = sorted(names, key=is_over_stretch)
    axes: dict[str, Any] = {"plot_axis": ["x", "extrapolated", "y", "y_bottom", "y_top"]}
    bands = []
    for of_label in rows.values():
        values = np.full((len(in_order), len(of_label), 5, _CURVE), np.nan)
        for i, one in enumerate(of_label):
            for name, curve in one.items():
                values[in_order.index(name), i, :, : curve.shape[1]] = curve
        variables = {
            name: (("tube", "plot_axis", "point"), of_name)
            for name, of_name in zip(in_order, values, strict=True)
        }
        bands.append(xr.Dataset(variables, axes | {"tube": range(len(of_label))}))
    tests = typical_tests(data, inferred)
    if dimension is None:
        return bands[0], tests
    places = xr.DataArray(list(rows), dims=dimension, name=dimension)
    return xr.concat(bands, dim=places, join="outer", fill_value=np.nan), tests


def _over_radii(
    tree: xr.DataTree, data: xr.Dataset, prob: float, material: GivenTube, curve: Curve
) -> Iterator[tuple[int, dict[str, float], dict[str, NDArray[np.float64]]]]:
    """The first inflation test on each tube, medians of what is inferred, and its curves.

    Rows of a curve are radius, whether it is extrapolated, median and both ends of the band.
    """
    held = np.flatnonzero(~extension_tests(data))
    if not held.size:
        return
    data = tests_at(data, held)
    tubes, tube_of_test = _tubes(data)
    thinned = thinned_draws(tree, max(MOST_DRAWS // len(tubes), _FEWEST_DRAWS))
    for i, tube in enumerate(tubes):
        known = {k: v for k, v in zip(GEOMETRY, tube.tolist(), strict=True) if np.isfinite(v)}
        draws = draws_of(thinned, **material, **known)
        tests = typical_tests(data, draws.inferred)
        radius = tests["radius"].values[tube_of_test[data["test"].values] == i]
        grid = np.linspace(radius.min(), radius.max(), _CURVE)
        predicted = curve(draws, grid)
        beyond = predicted.coords.get("extrapolated", xr.zeros_like(predicted["radius"])).values
        y = predicted.quantile(median_and_band(prob), dim=["chain", "draw"])
        curves = {
            str(name): np.array([grid, beyond, *of_levels.values]) for name, of_levels in y.items()
        }
        yield int(held[tube_of_test == i][0]), draws.inferred, curves
