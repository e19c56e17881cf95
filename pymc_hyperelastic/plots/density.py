"""The joint posterior of two parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.evidence.mixture import GaussianMixture, components_for
from pymc_hyperelastic.evidence.stored import damaged, read_json, read_numbers
from pymc_hyperelastic.messages import shown
from pymc_hyperelastic.models.class_distribution import distributions_of
from pymc_hyperelastic.models.settings import model_settings_of
from pymc_hyperelastic.parallel import one_thread
from pymc_hyperelastic.plots.curves import Array
from pymc_hyperelastic.plots.labels import parameter_of, quantity_label
from pymc_hyperelastic.plots.style import LOG_FROM, Backend, Canvas, Visuals, fitted_classes
from pymc_hyperelastic.predictions.members import specimens_differ, with_parameters

if TYPE_CHECKING:
    from arviz_plots import PlotCollection

# Points along each side of the grid of a density. On 100 points a narrow ridge falls into pieces:
# its regions of 95 and 50 % hold 87 and 35 % of the draws; on 300 points 94 and 47 %.
_GRID = 300
_OF_CLASS = ("location[", "spread[")
# Variables that are shown by default only if the posterior has no others.
_NUISANCE = (
    "sigma pressure_sd noise_spread specimen_sigma specimen_pressure_sd force_sigma force_sd "
    "force_offset_sd force_offset_mean force_offset_error diameter_sd slope_weight "
    "experiment_spread effect_spread correlation_unit"
).split()
# Share of the draws that may be stray, and is no mode.
_STRAY = 0.01
# The density is that of a mixture, which follows two bent ridges. A kernel density estimate has one
# width: with 2000 draws, its 95 % region is 1.3 times as large for a parabola, 8 times for a
# hyperbola. The mixture is wider than the draws by this factor, so that contours are smooth.
_WIDENED = 1.5


@one_thread
def plot_parameter_density(
    classes: xr.DataTree,
    *,
    var_names: Sequence[str] | None = None,
    ci_probs: Sequence[float] = (0.5, 0.95),
    specimen: str | None = None,
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    r"""Plot the joint posterior of two parameters, a colour for each class.

    The filled regions are those of highest density that hold the given probabilities. If a
    posterior has modes far apart, such as the mirrored ones of ``α`` and ``−α``, the axis is
    broken, and each mode has a panel of its own scale.

    If specimens differ, as in classes with variability, the filled regions are of the typical
    specimen, and a dashed line holds a new specimen of the class: how far the class spreads.

    Parameters
    ----------
    classes : xarray.DataTree
        Result of :func:`pymc_hyperelastic.fit_classes`, one of its classes, or a sampled model.
    var_names : sequence of two str, optional
        Variables of the horizontal and the vertical axis; an entry of a vector is ``"mu[0]"``. By
        default the first two parameters of the wall. If the wall has a single one and specimens
        differ, they are its location and spread in the class, such as ``["location[log_mu]",
        "spread[log_mu]"]``. Errors are shown only if there are no other variables.
    ci_probs : sequence of float
        Probabilities that the regions hold.
    specimen : str, optional
        Specimen whose parameters are shown, where specimens differ; by default the typical one and
        new ones, see :func:`~pymc_hyperelastic.predict_pressure`.
    backend, visuals, **pc_kwargs
        See :func:`~pymc_hyperelastic.plot_inflation`. The visuals are ``area``, ``line``, ``new``
        (the line that holds new specimens), ``xlabel``, ``ylabel`` and ``legend``.

    Returns
    -------
    arviz_plots.PlotCollection
        A grid. Its dimensions ``y_part`` and ``x_part`` count the pieces of the broken axes.

    Raises
    ------
    TypeError, ValueError
        If `classes` is no DataTree with a posterior, or a variable, a probability, the backend or a
        visual is unknown.

    See Also
    --------
    sample_smc, fit_classes

    Notes
    -----
    The density is that of a Gaussian mixture fitted to the draws, which follows narrow modes and
    bent ridges. It is cut at the ends of a uniform prior, and a region holds its probability of the
    draws. If specimens differ, it is the density of the logarithms in which a class's specimens are
    spread, and an axis is logarithmic if its ends are far apart.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> tree = ph.open_result("sampled.nc")  # saved from the example of sample_smc
    >>> figure = ph.plot_parameter_density(tree, backend="none")
    >>> figure.viz["plot"].sizes["y_part"]  # one for each sign of alpha
    2
    """
    results = fitted_classes(classes)
    fitted = {name: with_parameters(tree, specimen) for name, tree in results.items()}
    names = _two_variables(fitted, var_names)
    for tree in fitted.values():
        for name in names:
            read_numbers(tree, "posterior", name.partition("[")[0], None)
    ci_probs = sorted(ci_probs, reverse=True)
    if not ci_probs or not all(0 < prob < 1 for prob in ci_probs):
        raise ValueError(f"ci_probs must hold probabilities between 0 and 1; got {ci_probs}")
    groups = {"typical": fitted}
    of_class = any(name.startswith(_OF_CLASS) for name in names)
    if specimen is None and not of_class:
        new = {name: _with_new_specimens(tree) for name, tree in results.items()}
        if all(tree is not None for tree in new.values()):
            groups["new"] = {name: with_parameters(tree, None) for name, tree in new.items()}
    regions, by_log = _regions(groups, names, ci_probs)
    rows, columns = regions.sizes["y_part"], regions.sizes["x_part"]
    canvas = Canvas(
        "grid",
        regions[["log_density"]].sel(whose="typical", drop=True),
        "area line new xlabel ylabel legend",
        (backend, visuals, pc_kwargs),
        (3.6 * columns + 0.7, (2.2 if rows > 1 else 3.2) * rows + 0.8),
        {"sharex": "col", "sharey": "row"},
        rows=["y_part"],
        cols=["x_part"],
        aes={"color": ["class_label"]},
    )
    _draw_regions(canvas, regions, by_log)
    _limit(canvas, regions["log_density"], by_log)
    tree = next(iter(fitted.values()))
    x_label, y_label = (_axis_label(tree, name) for name in names)
    for part in range(columns):
        canvas.label("xlabel", x_label, coords={"y_part": rows - 1, "x_part": part})
    for part in range(rows):
        canvas.label("ylabel", y_label, coords={"y_part": part, "x_part": 0})
    entries = canvas.entries("class_label", "class ", "color", linewidth=5, alpha=0.7)
    if "new" in groups:
        entries["typical specimen"] = {"color": "0.5", "linewidth": 5, "alpha": 0.7}
        entries[f"new specimen, {100 * ci_probs[0]:.3g} %"] = {"color": "0.5", "linestyle": "--"}
    canvas.legend(entries)
    owner = None if specimen is None else f"specimen {specimen}"
    if specimen is None and not of_class and any(map(specimens_differ, fitted.values())):
        owner = "typical specimen"
    held = " and ".join(f"{100 * prob:.3g} %" for prob in reversed(ci_probs))
    canvas.title_of_fits(fitted, None, owner, f"{held} of the posterior")
    return canvas.collection


def _with_new_specimens(tree: xr.DataTree) -> xr.DataTree | None:
    """The result with a new specimen in place of the typical one, for each draw of its class.

    None if specimens do not differ, or the result has no distribution of them.
    """
    if not specimens_differ(tree) or "spread" not in tree["posterior"]:
        return None
    posterior = tree["posterior"].to_dataset()
    of_class = distributions_of(tree, posterior.sizes["chain"] * posterior.sizes["draw"])
    # New specimens are the same at every call.
    normal = np.random.default_rng(1).standard_normal((of_class.size, len(of_class.factor)))
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
        # The location and the spread of a single parameter.
        names = tuple(name for name in common if name.startswith(_OF_CLASS))[:2]
    if isinstance(var_names, str) or len(set(names)) != 2 or not set(names) <= set(common):
        raise ValueError(
            f"two different variables are needed, not {var_names or names}; numbers in the "
            f"posterior of every class are {common} (for one variable see arviz.plot_dist)"
        )
    return names[0], names[1]


def _scalars(tree: xr.DataTree) -> dict[str, Array]:
    """Draws of each number of a posterior; entries of a vector have names of their own."""
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
    """Rank of a variable among defaults: the wall, the distribution of its class, the rest."""
    if name.startswith(_OF_CLASS):
        return 1
    return 2 if name.split("[")[0] in _NUISANCE else 0


def _axis_label(tree: xr.DataTree, name: str) -> str:
    """Symbol, or words, and unit of a variable."""
    units = read_json(tree, "units", {})
    if not all(isinstance(unit, str) for unit in units.values()):
        raise damaged(tree, f"its attribute 'units' is {shown(units)}; expected names of units")
    return quantity_label(name, tree.attrs.get("strain_energy"), units)


def _bounds(tree: xr.DataTree, names: tuple[str, str]) -> Array:
    """Lower and upper ends of uniform priors; infinite for other priors.

    The lower end of a spread is 0, and so is that of a modulus if all draws are positive.
    """
    settings = model_settings_of(tree)
    priors = (settings.priors if settings else None) or {}
    units, draws, ends = read_json(tree, "units", {}), _scalars(tree), []
    for name in names:
        kind, of_prior = priors.get(name, ["", []])[:2]
        is_modulus = units.get(name) == "kPa" and bool((draws[name] > 0).all())
        least = 0.0 if is_modulus or name.startswith("spread[") else -np.inf
        ends.append(of_prior if kind == "Uniform" else [least, np.inf])
    return np.transpose(ends)


def _regions(
    groups: Mapping[str, Mapping[str, xr.DataTree]],
    names: tuple[str, str],
    ci_probs: Sequence[float],
) -> tuple[xr.Dataset, NDArray[np.bool_]]:
    """Regions of typical and new specimens of each class, and which axes are of logarithms.

    The dataset holds mixtures, log densities at the ends of regions, and as ``log_density`` the
    ends of the axes of each panel, which are NaN if a class has no mode there.
    """
    first = next(iter(groups["typical"].values()))
    by_log = np.array([_is_log(first, name) for name in names])
    trees = [tree for of_group in groups.values() for tree in of_group.values()]
    draws = [np.stack([_scalars(tree)[name] for name in names], axis=1) for tree in trees]
    of_trees = [_region(_log(points, by_log), ci_probs) for points in draws]
    mixtures, levels, inside = zip(*of_trees, strict=True)
    breaks = [_breaks([points[:, axis] for points in inside]) for axis in (0, 1)]
    ends = [
        _ends(points, _log(_bounds(tree, names), by_log), breaks)
        for tree, points in zip(trees, inside, strict=True)
    ]
    whose = {"whose": list(groups), "class_label": list(groups["typical"])}
    parts = {"y_part": range(len(breaks[1]) + 1), "x_part": range(len(breaks[0]) + 1)}
    shape, dims = tuple(map(len, whose.values())), (*whose, *parts, "axis", "end")
    regions = {
        "mixture": ((*whose,), np.array(mixtures, object).reshape(shape)),
        "level": ((*whose, "prob"), np.reshape(levels, (*shape, -1))),
        "log_density": (dims, np.reshape(ends, (*shape, *ends[0].shape))),
    }
    return xr.Dataset(regions, whose | parts), by_log


def _draw_regions(canvas: Canvas, regions: xr.Dataset, by_log: NDArray[np.bool_]) -> None:
    """Draw areas and lines around typical specimens, and a line around new ones."""
    shown = regions.sizes["prob"]
    line = {"draw": canvas.backend.contour, "linewidths": 1.2}
    for name, whose, levels, settings in (
        ("area", "typical", shown, {"draw": canvas.backend.contourf, "alpha": 0.4}),
        ("line", "typical", shown, line | {"linestyles": "solid"}),
        ("new", "new", 1, line | {"linestyles": "dashed"}),
    ):
        if whose in regions["whose"]:
            own = regions.sel(whose=whose, drop=True).isel(prob=slice(levels))
            content = {"mixture": own["mixture"], "level": own["level"], "by_log": by_log}
            content |= {"data": own[["log_density"]], "artist_dims": {"prob": levels}}
            canvas.draw(name, _contours, **content, **settings)


def _is_log(tree: xr.DataTree, name: str) -> bool:
    """Return True if specimens are normal in the logarithm of this parameter."""
    if not specimens_differ(tree):
        return False
    parameter = parameter_of(tree.attrs.get("strain_energy"), name.split("[")[0])
    return parameter is not None and parameter.natural_scale == "log"


def _log(points: Array, by_log: NDArray[np.bool_]) -> Array:
    """Logarithms of some columns, and the others as they are; that of 0 is very small."""
    return np.where(by_log, np.log(np.maximum(points, np.finfo(float).tiny)), points)


def _region(points: Array, ci_probs: Sequence[float]) -> tuple[GaussianMixture, Array, Array]:
    """The mixture that stands for some draws, its levels, and the draws in the widest region."""
    low, high = np.quantile(points, [_STRAY / 2, 1 - _STRAY / 2], axis=0)
    typical = points[((points >= low) & (points <= high)).all(axis=1)]
    components = components_for(*typical.shape)
    rng = np.random.default_rng(components)
    mixture = GaussianMixture.fit(typical, components, rng, iterations=50).widened(_WIDENED)
    # A region with a probability of 95 % ends at the density that 5 % of the draws are below.
    density = mixture.log_density(points)
    levels = np.quantile(density, 1 - np.array(ci_probs))
    return mixture, levels, typical[mixture.log_density(typical) >= levels[0]]


def _breaks(values: Sequence[Array]) -> list[float]:
    """Break an axis in a gap inside a class that is wider than the draws on either side.

    Neither side may be a few stray draws.
    """
    pooled = np.sort(np.concatenate(values))
    widest = int(np.diff(pooled).argmax())
    low, high = pooled[widest], pooled[widest + 1]
    within = any(v.min() <= low and v.max() >= high for v in values)
    many = min(widest + 1, len(pooled) - widest - 1) > _STRAY * len(pooled)
    broken = within and many and high - low > max(low - pooled[0], pooled[-1] - high)
    return [float(low + high) / 2] if broken else []


def _ends(inside: Array, bounds: Array, breaks: list[list[float]]) -> Array:
    """Ends (y_part, x_part, axis, end) of the axes of one class, inside the bounds of the prior."""
    ends = np.full((len(breaks[1]) + 1, len(breaks[0]) + 1, 2, 2), np.nan)
    column = np.digitize(inside[:, 0], breaks[0])
    row = len(breaks[1]) - np.digitize(inside[:, 1], breaks[1])  # the highest part is on top
    for place in set(zip(row.tolist(), column.tolist(), strict=True)):
        part = inside[(row == place[0]) & (column == place[1])]
        # The region reaches beyond the draws in it.
        margin = 0.15 * np.ptp(part, axis=0)
        with_margin = [part.min(axis=0) - margin, part.max(axis=0) + margin]
        ends[place] = np.clip(with_margin, *bounds).T
    return ends


def _limit(canvas: Canvas, ends: xr.DataArray, by_log: NDArray[np.bool_]) -> None:
    """Let each panel end with the regions in it, and make wide axes of logarithms logarithmic."""
    for axis, name in enumerate("xy"):
        part = f"{name}_part"
        rest = [dim for dim in ends.dims if dim not in (part, "axis")]
        limits = np.array([ends.min(rest).isel(axis=axis), ends.max(rest).isel(axis=axis)])
        limits = np.exp(limits) if by_log[axis] else limits
        wide = by_log[axis] and bool((limits[1] > LOG_FROM * limits[0]).any())
        for i, (low, high) in enumerate(limits.T.tolist()):
            canvas.limit(name, (low, high), log=wide, coords={part: i})


def _contours(
    da: xr.DataArray,
    target: Any,
    *,
    draw: Callable,
    mixture: xr.DataArray,
    level: xr.DataArray,
    by_log: NDArray[np.bool_],
    **settings: Any,
) -> NDArray[np.object_]:
    """Draw one contour, or the area inside it, for each level that the density reaches here."""
    x, y = np.linspace(da.values[:, 0], da.values[:, 1], _GRID, axis=1)
    nodes = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    density = mixture.item().log_density(nodes).reshape(_GRID, _GRID)
    x, y = (np.exp(v) if logarithm else v for v, logarithm in zip((x, y), by_log, strict=True))
    artists, peak = np.full(level.size, None, dtype=object), float(density.max())
    for i, threshold in enumerate(level.values.tolist()):
        if peak > threshold:
            levels = [threshold, peak + 1]  # areas have two ends
            artists[i] = draw(x, y, density, target, levels=levels, **settings)
    return artists
