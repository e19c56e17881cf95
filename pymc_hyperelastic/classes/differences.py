"""Differences, effect sizes and overlaps of groups for each posterior draw, and their summaries.

Called by :func:`~pymc_hyperelastic.compare_classes`.
"""

import warnings
from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import stats

from pymc_hyperelastic.classes.groups import GroupDraws, Groups
from pymc_hyperelastic.classes.quantities import is_logarithm, values_of
from pymc_hyperelastic.models.specimen_draws import density_of_each
from pymc_hyperelastic.predictions.conditions import Conditions
from pymc_hyperelastic.rounding import ROUNDING

Array = NDArray[np.float64]

STATISTICS = ["typical", "mean", "spread"]
# Number of grid points for the overlap of two kernel density estimates.
_GRID_POINTS = 128


def by_draw(of_law: Groups, found: GroupDraws, names: Sequence[str], at: Conditions) -> xr.Dataset:
    """Return statistics and overlaps of the groups for each draw of their distributions."""
    groups, kind, pairs = of_law.groups, of_law.kind, of_law.comparisons
    values = xr.DataArray(
        [[*values_of(kind, found.coordinates[g], names, at).values()] for g in groups],
        {"group": groups, "quantity": list(names), "pressure": at.pressures},
        ("group", "quantity", "pressure", "draw", "member"),
    )
    typical, others = values.isel(member=0), values.isel(member=slice(1, None))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # all specimens may lack the quantity
        statistics = [typical, others.mean("member"), others.std("member")]
    overlaps = [
        [_overlap(of) for of in others.sel(group=[*pair]).values.swapaxes(0, 1)] for pair in pairs
    ]
    of_specimens = [_overlap_of_specimens(found, *pair) for pair in pairs]
    result = xr.Dataset(
        {
            "draws": xr.concat(statistics, "statistic").assign_coords(statistic=STATISTICS),
            "lacking": others.isnull().mean("member"),
            "overlap": (("comparison", "quantity", "pressure", "draw"), overlaps),
            "overlap_of_specimens": (("comparison", "draw"), of_specimens),
        },
        {
            "has_ratio": ("quantity", [not is_logarithm(n, kind) for n in names]),
            "comparison": [f"{b} − {a}" for a, b in pairs],
            "first": ("comparison", [a for a, _ in pairs]),
            "second": ("comparison", [b for _, b in pairs]),
        },
    )
    if of_law.pairs:
        change = others.isel(group=1, drop=True) - others.isel(group=0, drop=True)
        rising = (change > 0).where(change.notnull())
        of_change = {
            "spread_of_change": change.std("member"),
            "share_rising": rising.mean("member"),
        }
        result = result.assign({n: v.expand_dims("comparison") for n, v in of_change.items()})
    return result.assign(_of_specimens(of_law, found, names, at))


def _of_specimens(
    of_law: Groups, found: GroupDraws, names: Sequence[str], at: Conditions
) -> xr.Dataset:
    """Return quantities of the measured specimens of all groups for each draw."""
    of_groups = [values_of(of_law.kind, found.measured[g], names, at) for g in of_law.groups]
    values = np.concatenate([np.stack([*v.values()]) for v in of_groups], axis=-1)
    specimens = [(group, name) for group, own in of_law.names().items() for name in own]
    groups, labels = zip(*specimens, strict=True)
    result = xr.Dataset(
        {"specimens": (("quantity", "pressure", "draw", "specimen"), values)},
        {"specimen": list(labels), "specimen_group": ("specimen", list(groups))},
    )
    if of_law.pairs:
        animals = [str(animal) for animal, *_ in of_law.pairs] * len(of_law.groups)
        result = result.assign_coords(animal=("specimen", animals))
    return result


def _overlap(both: Array) -> Array:
    r"""Return the overlap ``∫ min(f, g)`` of two groups of specimens, shape (2, ..., specimen).

    ``f`` and ``g`` are normal kernel density estimates with Silverman's bandwidth, of logarithms if
    all values are positive. Specimens are shrunk towards their mean, so that the variance of the
    estimate is that of the specimens. The smaller of the two fractions of specimens without the
    quantity counts as overlap.
    """
    if np.nanmin(both) > 0:
        both = np.log(both)
    count = both.shape[-1]
    width = 1.06 * count**-0.2
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # all specimens may lack the quantity
        mean, sd = (f(both, axis=-1, keepdims=True) for f in (np.nanmean, np.nanstd))
        # Equal values also need a kernel density estimate of some width.
        sd = np.maximum(sd, ROUNDING * np.abs(mean))
        x, width = mean + (both - mean) / np.hypot(1, width), width * sd / np.hypot(1, width)
        # A normal kernel is negligible at a distance of four bandwidths.
        low = np.nanmin(x - 4 * width, axis=(0, -1))
        high = np.nanmax(x + 4 * width, axis=(0, -1))
        grid = np.linspace(low, high, _GRID_POINTS)
        density = [
            np.nansum(stats.norm.pdf(grid[..., None], x[k], width[k]), axis=-1) / count
            for k in range(2)
        ]
    shared = np.minimum(*density).sum(axis=0) * (grid[1] - grid[0])
    lacking = np.isnan(both).mean(axis=-1)
    # If no specimen of one group has the quantity, no value is shared.
    shared = np.where((lacking == 1).any(axis=0), 0.0, shared)
    return shared + lacking.min(axis=0)


def _overlap_of_specimens(draws: GroupDraws, first: str, second: str) -> Array:
    """Return the overlap of the densities ``f`` and ``g`` of two groups, for each draw.

    The estimate is the mean of ``min(1, g/f)`` over specimens of ``f``, averaged with the mean of
    ``min(1, f/g)`` over specimens of ``g``.
    """
    found = []
    for own, other in ((first, second), (second, first)):
        x = draws.coordinates[own][..., 1:]
        f, g = (density_of_each(x, draws.distributions[group]) for group in (own, other))
        found.append(np.exp(np.minimum(g - f, 0.0)).mean(axis=-1))
    return np.mean(found, axis=0)


def summary(by_draw: xr.Dataset, ci_prob: float) -> xr.Dataset:
    """Return posterior medians, standard deviations and intervals of groups and comparisons."""
    draws = by_draw["draws"]
    first, second = both(by_draw)
    difference = second - first
    typical = difference.sel(statistic="typical", drop=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = (second / first).where((first > 0) & (second > 0) & by_draw["has_ratio"])
        spreads = xr.concat([first, second], "of").sel(statistic="spread", drop=True)
        effect = typical / np.sqrt((spreads**2).mean("of"))
        found = {
            "value": draws,
            "specimen_value": by_draw["specimens"],
            "difference": difference,
            "ratio": ratio,
            "effect_size": effect,
            "overlap": by_draw["overlap"],
            "overlap_of_specimens": by_draw["overlap_of_specimens"],
        }
        if "spread_of_change" in by_draw:
            found["effect_size_of_change"] = typical / by_draw["spread_of_change"]
            found |= {name: by_draw[name] for name in ("spread_of_change", "share_rising")}
    result = xr.Dataset()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a quantity may be NaN in all draws
        for name, values in found.items():
            result[name] = values.median("draw")
            result[f"{name}_sd"] = values.std("draw", ddof=1)
            result[f"{name}_interval"] = interval(values, ci_prob)
    rises = ((difference > 0) + (difference == 0) / 2).where(difference.notnull())
    positive = rises.mean("draw")
    result["probability_of_rise"] = positive
    result["probability_of_direction"] = np.maximum(positive, 1 - positive)
    result["best_accuracy"] = 1 - result["overlap"] / 2
    result["lacking"] = by_draw["lacking"].mean("draw")
    return result.assign(draws=draws)


def both(result: xr.Dataset) -> tuple[xr.DataArray, xr.DataArray]:
    """Return draws of the first and of the second group of each comparison."""
    first, second = (
        result["draws"].sel(group=result[name].drop_vars(["first", "second"])).drop_vars("group")
        for name in ("first", "second")
    )
    return first, second


def differences(result: xr.Dataset) -> xr.DataArray:
    """Return draws of ``second − first`` for each comparison."""
    first, second = both(result)
    return second - first


def interval(values: xr.DataArray, ci_prob: float) -> xr.DataArray:
    """Return the ends of the equal-tailed interval with probability `ci_prob`."""
    ends = values.quantile([(1 - ci_prob) / 2, (1 + ci_prob) / 2], "draw").rename(quantile="bound")
    return ends.assign_coords(bound=["low", "high"]).transpose(..., "bound")
