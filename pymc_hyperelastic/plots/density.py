"""The joint posterior of two parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.evidence.mixture import GaussianMixture
from pymc_hyperelastic.evidence.stored import damaged, read_json, read_numbers
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.messages import shown
from pymc_hyperelastic.models.class_distribution import distributions_of
from pymc_hyperelastic.models.settings import model_settings_of
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.style import (
    Backend,
    Canvas,
    Visuals,
    fitted_classes,
    law_of,
    training_attrs,
)
from pymc_hyperelastic.predictions.members import specimens_differ, with_parameters

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

Array = NDArray[np.float64]

_GRID = 100  # points along each side of the grid on which a density is computed
_SEED = 1  # new specimens are the same at every call
_OF_CLASS = ("location[", "spread[")
# Shown only if there is nothing else.
_NUISANCE = (
    "sigma pressure_sd noise_spread specimen_sigma specimen_pressure_sd force_sigma force_sd "
    "force_offset_sd force_offset_mean force_offset_error diameter_sd slope_weight "
    "experiment_spread effect_spread correlation_unit"
).split()
_LOG_FROM = 10.0  # ratio of the ends of an axis of positive numbers, from which it is logarithmic
_LEAST_SHOWN = 0.5  # probability of what axes hold, where the regions that are asked for hold less
_STRAY = 0.01  # share of the draws that is no mode
_COMPONENTS = 6  # of the mixture that stands for a posterior: they follow two bent ridges


@one_thread
def plot_parameter_density(
    classes: xr.DataTree,
    *,
    var_names: Sequence[str] | None = None,
    probs: Sequence[float] = (0.5, 0.95),
    specimen: str | None = None,
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    r"""Plot the joint posterior of two parameters, a colour for each class.

    The filled regions are those of highest density that hold the given probabilities. Where a
    posterior has modes far apart, such as the mirrored ones of ``α`` and ``−α``, the axis is
    broken, so that each mode is seen in a panel of its own scale.

    Where specimens differ, as in classes with variability, the filled regions are of the typical
    specimen, and a dashed line holds a new specimen of the class: how far the class spreads.

    Parameters
    ----------
    classes : xarray.DataTree
        Result of :func:`pymc_hyperelastic.fit_classes`, one of its classes, or a sampled model.
    var_names : sequence of two str, optional
        What is shown on the horizontal and the vertical axis; an entry of a vector is
        ``"mu[0]"``. When missing, the first two parameters of the wall, or of a single one whose
        specimens differ the class's location and spread, such as
        ``["location[log_mu]", "spread[log_mu]"]``; noise only if there is nothing else.
    probs : sequence of float
        Probabilities that the regions hold.
    specimen : str, optional
        Whose parameters are shown where specimens differ, as in classes with variability: the
        typical one's and those of new ones when missing, see
        :func:`~pymc_hyperelastic.predict_pressure`.
    backend : {"matplotlib", "none"}
        Plotting backend; ``"none"`` only collects what would be drawn.
    visuals : dict of str to dict or bool, optional
        Settings of ``area``, ``line``, ``new`` (the line that holds new specimens), ``xlabel``,
        ``ylabel`` and ``legend``; False leaves one out.
    **pc_kwargs
        Passed to :meth:`arviz_plots.PlotCollection.grid`.

    Returns
    -------
    arviz_plots.PlotCollection
        Its dimensions ``y_part`` and ``x_part`` count the pieces of the broken axes.

    Raises
    ------
    TypeError, ValueError
        If `classes` is no DataTree with a posterior, or a variable, a probability, the backend or
        a visual is unknown.

    See Also
    --------
    sample_smc, fit_classes

    Notes
    -----
    The density is that of a Gaussian mixture fitted to the draws: narrow modes and bent ridges are
    not smeared by the spread of the whole. It is cut at the ends of a uniform prior, and a region
    holds its probability of the draws. Where specimens differ it is that of the logarithms in which
    a class's specimens are spread, and an axis is logarithmic if its ends are far apart.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> tree = ph.open_result("sampled.nc")  # saved from the example of sample_smc
    >>> figure = ph.plot_parameter_density(tree, backend="none")
    >>> figure.viz["plot"].sizes["y_part"]  # one for each sign of alpha
    2
    """
    results = fitted_classes(classes)
    fitted = {k: with_parameters(tree, specimen) for k, tree in results.items()}
    names = _two_variables(fitted, var_names)
    for tree in fitted.values():
        for name in names:
            read_numbers(tree, "posterior", name.partition("[")[0], None)
    probs = sorted(probs, reverse=True)
    if not probs or not all(0 < prob < 1 for prob in probs):
        raise ValueError(f"probs must hold probabilities between 0 and 1; got {probs}")
    shown = {"": fitted}
    of_class = any(name.startswith(_OF_CLASS) for name in names)
    if specimen is None and not of_class:
        new = {k: _with_new_specimens(tree) for k, tree in results.items()}
        if all(tree is not None for tree in new.values()):
            shown["new"] = {k: with_parameters(tree, None) for k, tree in new.items()}
    density = _densities(shown, names, probs)
    rows, columns = density.sizes["y_part"], density.sizes["x_part"]
    canvas = Canvas(
        "grid",
        density[["log_density"]].isel(whose=0, drop=True),
        "area line new xlabel ylabel legend",
        backend,
        visuals,
        pc_kwargs,
        {"figsize": (3.6 * columns + 1.6, (2.2 if rows > 1 else 3.2) * rows + 0.5)}
        | {"sharex": "col", "sharey": "row"},
        rows=["y_part"],
        cols=["x_part"],
        aes={"color": ["class_label"]},
    )
    for name, kind, of_whom, levels, settings in (
        ("area", "contourf", "", probs, {"alpha": 0.4}),
        ("line", "contour", "", probs, {"linewidths": 1.2, "linestyles": "solid"}),
        ("new", "contour", "new", probs[:1], {"linewidths": 1.2, "linestyles": "dashed"}),
    ):
        if of_whom in shown:
            of_one = density.sel(whose=of_whom, drop=True).isel(prob=slice(len(levels)))
            regions = {key: of_one[key] for key in ("x", "y", "level")}
            regions["artist_dims"] = {"prob": len(levels)}
            data = of_one[["log_density"]]
            canvas.draw(name, _contours, data=data, kind=kind, **regions, **settings)
    _limit(canvas, density)
    tree = next(iter(fitted.values()))
    for part in range(columns):
        where = {"y_part": rows - 1, "x_part": part}
        canvas.label("xlabel", _axis_label(tree, names[0]), coords=where)
    for part in range(rows):
        where = {"y_part": part, "x_part": 0}
        canvas.label("ylabel", _axis_label(tree, names[1]), coords=where)
    held = " and ".join(f"{100 * prob:.3g} %" for prob in reversed(probs))
    entries = canvas.entries("class_label", "", "color", linewidth=5, alpha=0.7)
    if "new" in shown:
        entries["typical specimen"] = {"color": "0.5", "linewidth": 5, "alpha": 0.7}
        entries[f"new specimen, {100 * probs[0]:.3g} %"] = {"color": "0.5", "linestyle": "--"}
    canvas.legend(entries, title=f"posterior,\n{held}")
    whose = None if specimen is None else f"specimen {specimen}"
    if specimen is None and not of_class and any(map(specimens_differ, fitted.values())):
        whose = "typical specimen"
    canvas.title(training_attrs(fitted), law_of(tree), whose)
    return canvas.collection


def _limit(canvas: Canvas, density: xr.Dataset) -> None:
    """Let the pieces of the axes end with the regions; those of logarithms may be logarithmic."""
    from arviz_plots import visuals

    for axis in ("x", "y"):
        ends, part = density[axis], f"{axis}_part"
        across = [dim for dim in ends.dims if dim != part]
        low, high = ends.min(across), ends.max(across)
        if density.attrs["by_log"][axis] and float((high / low).max()) > _LOG_FROM:
            canvas.adjust(getattr(visuals, f"set_{axis}scale"), scale="log")
        for i in range(ends.sizes[part]):
            limits = float(low[i]), float(high[i])
            canvas.adjust(getattr(visuals, f"set_{axis}lim"), limits=limits, coords={part: i})


def _with_new_specimens(tree: xr.DataTree) -> xr.DataTree | None:
    """The result with a new specimen in place of the typical one, for each draw of its class.

    None if specimens do not differ, or the result does not tell how.
    """
    if not specimens_differ(tree) or "spread" not in tree["posterior"]:
        return None
    posterior = tree["posterior"].to_dataset()
    of_class = distributions_of(tree, posterior.sizes["chain"] * posterior.sizes["draw"])
    shape = of_class.size, of_class.factor.shape[0]
    normal = np.random.default_rng(_SEED).standard_normal(shape)
    new_ones = of_class.coordinates(normal.T[..., None])[..., 0]
    stacked = posterior["location"].stack(sample=("chain", "draw")).transpose("coordinate", ...)
    new = stacked.copy(data=new_ones).unstack("sample")
    tree = tree.copy()
    tree["posterior"] = xr.DataTree(posterior.assign(location=new))
    return tree


def _two_variables(
    fitted: Mapping[str, xr.DataTree], var_names: Sequence[str] | None
) -> tuple[str, str]:
    """Names of the variables on the two axes."""
    scalar = [_scalars(tree) for tree in fitted.values()]
    common = [name for name in scalar[0] if all(name in of_class for of_class in scalar)]
    names = tuple(sorted(common, key=_interest)[:2] if var_names is None else var_names)
    if var_names is None and names[1:] and _interest(names[0]) < _interest(names[1]) == 1:
        # A single parameter, of which the class has a location and a spread.
        names = tuple(name for name in common if name.startswith(_OF_CLASS))[:2]
    if isinstance(var_names, str) or len(set(names)) != 2 or not set(names) <= set(common):
        raise ValueError(
            f"two different variables are needed, not {var_names or names}; numbers in the "
            f"posterior of every class are {common} (for one variable see arviz.plot_dist)"
        )
    return names[0], names[1]


def _scalars(tree: xr.DataTree) -> dict[str, Array]:
    """Draws of the numbers of a posterior, those of a vector by the names of its entries."""
    scalars = {}
    for name, variable in tree["posterior"].to_dataset().items():
        rest = [dim for dim in variable.dims if dim not in ("chain", "draw")]
        if not rest:
            scalars[str(name)] = variable.values.ravel()
        elif len(rest) == 1 and rest[0] != "obs":  # not the curves
            for i, label in enumerate(variable[rest[0]].values.tolist()):
                scalars[f"{name}[{label}]"] = variable.isel({rest[0]: i}).values.ravel()
    return scalars


def _interest(name: str) -> int:
    """Rank of what is shown unless asked: the wall, the distribution of its class, the rest."""
    if name.startswith(_OF_CLASS):
        return 1
    return 2 if name.split("[")[0] in _NUISANCE else 0


def _axis_label(tree: xr.DataTree, name: str) -> str:
    """Symbol and unit of a variable."""
    symbols = {"sigma": r"\sigma", "slope_weight": r"\beta"}
    units = read_json(tree, "units", {})
    if not all(isinstance(unit, str) for unit in units.values()):
        raise damaged(tree, f"its attribute 'units' is {shown(units)}; expected names of units")
    try:
        energy = StrainEnergy.from_name(tree.attrs.get("strain_energy", ""))
        symbols |= {p.name: p.symbol for p in energy.parameters}
        units = {p.name: p.unit for p in energy.parameters} | units
    except ValueError:
        pass  # a law of the user's own that is not defined here: its names have to do
    unit = units.get(name, "").replace("mm2", "mm²")
    label = f"${symbols[name]}$" if name in symbols else name
    return f"{label} ({unit})" if unit else label


def _densities(
    shown: Mapping[str, Mapping[str, xr.DataTree]], names: tuple[str, str], probs: Sequence[float]
) -> xr.Dataset:
    """Density of each class in each piece of the axes, and its levels of highest density.

    The attribute ``by_log`` says on which axes it is that of logarithms.
    """
    trees = [tree for of_class in shown.values() for tree in of_class.values()]
    by_log = np.array([_spread_by_log(trees[0], name) for name in names])
    draws = [np.stack([_scalars(tree)[name] for name in names], axis=1) for tree in trees]
    for points in draws:
        points[:, by_log] = np.log(np.maximum(points[:, by_log], np.finfo(float).tiny))
    mixtures, levels, inside = zip(*(_regions(points, probs) for points in draws), strict=True)
    breaks = [_breaks([points[:, axis] for points in inside]) for axis in (0, 1)]
    shape = (len(trees), len(breaks[1]) + 1, len(breaks[0]) + 1)
    density = np.full((*shape, _GRID, _GRID), np.nan)
    grid = np.full((2, *shape, _GRID), np.nan)
    for i, (tree, mixture, points) in enumerate(zip(trees, mixtures, inside, strict=True)):
        x_part = np.digitize(points[:, 0], breaks[0])
        y_part = len(breaks[1]) - np.digitize(points[:, 1], breaks[1])  # the highest is on top
        for j, k in set(zip(y_part.tolist(), x_part.tolist(), strict=True)):
            part = points[(y_part == j) & (x_part == k)]
            margin = 0.15 * np.ptp(part, axis=0)
            bounds = _bounds(tree, names)
            with np.errstate(divide="ignore"):
                bounds[:, by_log] = np.log(np.maximum(bounds[:, by_log], 0.0))
            ends = np.clip([part.min(axis=0) - margin, part.max(axis=0) + margin], *bounds)
            x, y = grid[:, i, j, k] = np.linspace(ends[0], ends[1], _GRID, axis=1)
            nodes = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
            density[i, j, k] = mixture.log_density(nodes).reshape(_GRID, _GRID)
    grid[by_log] = np.exp(grid[by_log])
    whose = len(shown), len(trees) // len(shown)
    of_part = ("whose", "class_label", "y_part", "x_part")
    return xr.Dataset(
        {
            "log_density": ((*of_part, "i", "j"), density.reshape(*whose, *density.shape[1:])),
            "x": ((*of_part, "i"), grid[0].reshape(*whose, *grid.shape[2:])),
            "y": ((*of_part, "j"), grid[1].reshape(*whose, *grid.shape[2:])),
            "level": (("whose", "class_label", "prob"), np.reshape(levels, (*whose, -1))),
        },
        {"whose": list(shown), "class_label": list(next(iter(shown.values())))}
        | {"y_part": range(shape[1]), "x_part": range(shape[2])},
        {"by_log": dict(zip("xy", by_log.tolist(), strict=True))},
    )


def _regions(points: Array, probs: Sequence[float]) -> tuple[GaussianMixture, Array, Array]:
    """The mixture that stands for some draws, its levels, and the draws in the widest region."""
    typical = _without_extremes(points)
    components = int(np.clip(len(typical) // 50, 1, _COMPONENTS))
    rng = np.random.default_rng(components)
    mixture = GaussianMixture.fit(typical, components, rng, iterations=50).widened(1.5)
    # The region that holds a probability ends where the density of that share of draws is less.
    density = mixture.log_density(points)
    widest = np.quantile(density, 1 - max(*probs, _LEAST_SHOWN))
    inside = typical[mixture.log_density(typical) >= widest]
    return mixture, np.quantile(density, 1 - np.array(probs)), inside


def _spread_by_log(tree: xr.DataTree, name: str) -> bool:
    """Whether specimens of a class are spread in the logarithm of this parameter."""
    if not specimens_differ(tree):
        return False
    try:
        energy = StrainEnergy.from_name(tree.attrs.get("strain_energy", ""))
    except ValueError:
        return False  # a law of the user's own that is not defined here
    scales = {p.name: p.natural_scale for p in energy.parameters}
    return scales.get(name.split("[")[0]) == "log"


def _without_extremes(points: Array) -> Array:
    """Leave out the outermost half per cent: draws that stray far off are no mode."""
    low, high = np.quantile(points, [0.005, 0.995], axis=0)
    return points[((points >= low) & (points <= high)).all(axis=1)]


def _breaks(values: Sequence[Array]) -> list[float]:
    """Where an axis is broken: in a gap inside a class, wider than what lies on either side.

    Neither side is a few stray draws.
    """
    pooled = np.sort(np.concatenate(values))
    widest = int(np.diff(pooled).argmax())
    low, high = pooled[widest], pooled[widest + 1]
    within = any(v.min() <= low and v.max() >= high for v in values)
    many = min(widest + 1, len(pooled) - widest - 1) > _STRAY * len(pooled)
    broken = within and many and high - low > max(low - pooled[0], pooled[-1] - high)
    return [float(low + high) / 2] if broken else []


def _bounds(tree: xr.DataTree, names: tuple[str, str]) -> Array:
    """Lower and upper ends of the uniform priors; infinite for others, but a spread's 0."""
    settings = model_settings_of(tree)
    priors = (settings.priors if settings else None) or {}
    records = [priors.get(name, ["", []])[:2] for name in names]
    low = [0.0 if name.startswith("spread[") else -np.inf for name in names]
    ends = [
        of_one if kind == "Uniform" else [least, np.inf]
        for (kind, of_one), least in zip(records, low, strict=True)
    ]
    return np.transpose(ends)


def _contours(
    da: xr.DataArray,
    target: Any,
    *,
    kind: str,
    x: xr.DataArray,
    y: xr.DataArray,
    level: xr.DataArray,
    **settings: Any,
) -> NDArray[np.object_]:
    """Draw one contour, or the area inside it, for each level that the density reaches here."""
    from arviz_plots.plot_collection import backend_from_object

    draw = getattr(backend_from_object(target), kind)
    artists = np.full(level.size, None, dtype=object)
    peak = float(da.max())
    for i, threshold in enumerate(level.values.tolist()):
        if peak > threshold:
            levels = [threshold, peak + 1] if kind == "contourf" else [threshold]
            artists[i] = draw(x.values, y.values, da.values, target, levels=levels, **settings)
    return artists
