"""The joint posterior of two parameters."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.evidence.mixture import GaussianMixture
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
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
_COMPONENTS = 6  # of the mixture that stands for a posterior: they follow two bent ridges


def plot_parameter_density(
    classes: xr.DataTree,
    *,
    var_names: Sequence[str] | None = None,
    probs: Sequence[float] = (0.5, 0.94),
    specimen: str | None = None,
    backend: Backend = "matplotlib",
    visuals: Visuals | None = None,
    **pc_kwargs: Any,
) -> PlotCollection:
    r"""Plot the joint posterior of two parameters, a colour for each class.

    The filled regions are those of highest density that hold the given probabilities. Where a
    posterior has modes far apart, such as the mirrored ones of ``α`` and ``−α``, the axis is
    broken, so that each mode is seen in a panel of its own scale.

    Parameters
    ----------
    classes : xarray.DataTree
        Result of :func:`pymc_hyperelastic.fit_classes`, one of its classes, or a sampled model.
    var_names : sequence of two str, optional
        What is shown on the horizontal and the vertical axis; the first two variables when missing.
    probs : sequence of float
        Probabilities that the regions hold.
    specimen : str, optional
        Whose parameters are shown where specimens differ, as in classes with variability: the
        typical specimen's when missing, see :func:`~pymc_hyperelastic.predict_pressure`.
    backend : {"matplotlib", "none"}
        Plotting backend; ``"none"`` only collects what would be drawn.
    visuals : dict of str to dict or bool, optional
        Settings of ``area``, ``line``, ``xlabel``, ``ylabel`` and ``legend``; False leaves one out.
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

    Notes
    -----
    The density is that of a Gaussian mixture fitted to the draws: narrow modes and bent ridges are
    not smeared by the spread of the whole. It is cut at the ends of a uniform prior, and a region
    holds its probability of the draws.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1")
    >>> model = ph.ogden_model(data, sigma=5 * ph.mmHg, slope_weight=3.0)
    >>> tree = ph.sample_smc(model, draws=500, chains=2, random_seed=1, progressbar=False)
    >>> figure = ph.plot_parameter_density(tree, backend="none")
    >>> figure.viz["plot"].sizes["y_part"]  # one for each sign of alpha
    2
    """
    fitted = {k: with_parameters(tree, specimen) for k, tree in fitted_classes(classes).items()}
    names = _two_variables(fitted, var_names)
    probs = sorted(probs, reverse=True)
    if not probs or not all(0 < prob < 1 for prob in probs):
        raise ValueError(f"probs must hold probabilities between 0 and 1; got {probs}")
    density = _densities(fitted, names, probs)
    rows, columns = density.sizes["y_part"], density.sizes["x_part"]
    canvas = Canvas(
        "grid",
        density[["log_density"]],
        "area line xlabel ylabel legend",
        backend,
        visuals,
        pc_kwargs,
        {"figsize": (3.6 * columns + 1.6, (2.2 if rows > 1 else 3.2) * rows + 0.5)}
        | {"sharex": "col", "sharey": "row"},
        rows=["y_part"],
        cols=["x_part"],
        aes={"color": ["class_label"]},
    )
    regions = {key: density[key] for key in ("x", "y", "level")}
    regions["artist_dims"] = {"prob": len(probs)}
    canvas.draw("area", _contours, kind="contourf", alpha=0.4, **regions)
    canvas.draw("line", _contours, kind="contour", linewidths=1.2, linestyles="solid", **regions)
    tree = next(iter(fitted.values()))
    for part in range(columns):
        where = {"y_part": rows - 1, "x_part": part}
        canvas.label("xlabel", _axis_label(tree, names[0]), coords=where)
    for part in range(rows):
        where = {"y_part": part, "x_part": 0}
        canvas.label("ylabel", _axis_label(tree, names[1]), coords=where)
    held = " and ".join(f"{100 * prob:.3g} %" for prob in reversed(probs))
    entries = canvas.entries("class_label", "", "color", linewidth=5, alpha=0.7)
    canvas.legend(entries, title=f"posterior,\n{held}")
    whose = "typical specimen" if any(map(specimens_differ, fitted.values())) else None
    whose = f"specimen {specimen}" if specimen is not None else whose
    canvas.title(training_attrs(fitted), law_of(tree), whose)
    return canvas.collection


def _two_variables(
    fitted: Mapping[str, xr.DataTree], var_names: Sequence[str] | None
) -> tuple[str, str]:
    """Names of the variables on the two axes."""
    scalar = [
        [n for n, v in tree["posterior"].to_dataset().items() if set(v.dims) == {"chain", "draw"}]
        for tree in fitted.values()
    ]
    common = [str(name) for name in scalar[0] if all(name in names for names in scalar)]
    names = tuple(common[:2] if var_names is None else var_names)
    if isinstance(var_names, str) or len(set(names)) != 2 or not set(names) <= set(common):
        raise ValueError(
            f"two different variables are needed, not {var_names or names}; scalars in the "
            f"posterior of every class are {common} (for one variable see arviz.plot_dist)"
        )
    return names[0], names[1]


def _axis_label(tree: xr.DataTree, name: str) -> str:
    """Symbol and unit of a variable."""
    symbols = {"sigma": r"\sigma", "slope_weight": r"\beta"}
    try:
        energy = StrainEnergy.from_name(tree.attrs.get("strain_energy", ""))
        symbols |= {p.name: p.symbol for p in energy.parameters}
    except ValueError:
        pass  # a law of the user's own that is not defined here: its names have to do
    unit = json.loads(tree.attrs.get("units", "{}")).get(name, "").replace("mm2", "mm²")
    label = f"${symbols[name]}$" if name in symbols else name
    return f"{label} ({unit})" if unit else label


def _densities(
    fitted: Mapping[str, xr.DataTree], names: tuple[str, str], probs: Sequence[float]
) -> xr.Dataset:
    """Density of each class in each piece of the axes, and its levels of highest density."""
    draws = [
        np.stack([tree["posterior"][name].values.ravel() for name in names], axis=1)
        for tree in fitted.values()
    ]
    typical = [_without_extremes(points) for points in draws]
    breaks = [_breaks([points[:, axis] for points in typical]) for axis in (0, 1)]
    shape = (len(fitted), len(breaks[1]) + 1, len(breaks[0]) + 1)
    density = np.full((*shape, _GRID, _GRID), np.nan)
    grid = np.full((2, *shape, _GRID), np.nan)
    level = np.empty((len(fitted), len(probs)))
    for i, (tree, points) in enumerate(zip(fitted.values(), typical, strict=True)):
        components = int(np.clip(len(points) // 50, 1, _COMPONENTS))
        rng = np.random.default_rng(components)
        mixture = GaussianMixture.fit(points, components, rng, iterations=50).widened(1.5)
        # The region that holds a probability ends where the density of that share of draws is less.
        level[i] = np.quantile(mixture.log_density(draws[i]), 1 - np.array(probs))
        x_part = np.digitize(points[:, 0], breaks[0])
        y_part = len(breaks[1]) - np.digitize(points[:, 1], breaks[1])  # the highest is on top
        for j, k in set(zip(y_part.tolist(), x_part.tolist(), strict=True)):
            part = points[(y_part == j) & (x_part == k)]
            margin = 0.15 * np.ptp(part, axis=0)
            ends = np.clip(
                [part.min(axis=0) - margin, part.max(axis=0) + margin], *_bounds(tree, names)
            )
            x, y = grid[:, i, j, k] = np.linspace(ends[0], ends[1], _GRID, axis=1)
            nodes = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
            density[i, j, k] = mixture.log_density(nodes).reshape(_GRID, _GRID)
    of_part = ("class_label", "y_part", "x_part")
    return xr.Dataset(
        {
            "log_density": ((*of_part, "i", "j"), density),
            "x": ((*of_part, "i"), grid[0]),
            "y": ((*of_part, "j"), grid[1]),
            "level": (("class_label", "prob"), level),
        },
        {"class_label": list(fitted), "y_part": range(shape[1]), "x_part": range(shape[2])},
    )


def _without_extremes(points: Array) -> Array:
    """Leave out the outermost half per cent: draws that stray far off are no mode."""
    low, high = np.quantile(points, [0.005, 0.995], axis=0)
    return points[((points >= low) & (points <= high)).all(axis=1)]


def _breaks(values: Sequence[Array]) -> list[float]:
    """Where an axis is broken: in a gap inside a class, wider than what lies on either side."""
    pooled = np.sort(np.concatenate(values))
    widest = int(np.diff(pooled).argmax())
    low, high = pooled[widest], pooled[widest + 1]
    within = any(v.min() <= low and v.max() >= high for v in values)
    broken = within and high - low > max(low - pooled[0], pooled[-1] - high)
    return [float(low + high) / 2] if broken else []


def _bounds(tree: xr.DataTree, names: tuple[str, str]) -> Array:
    """Lower and upper ends of the uniform priors; infinite for others."""
    priors = json.loads(tree.attrs.get("priors", "{}"))
    records = [priors.get(name, ["", []]) for name in names]
    ends = [ends if kind == "Uniform" else [-np.inf, np.inf] for kind, ends in records]
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
