"""Convergence of chains of draws: R-hat, effective sample sizes and divergences."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from arviz_stats.base import array_stats

from pymc_hyperelastic.evidence.mixture import Array

# Largest split R-hat of chains that agree.
LARGEST_RHAT = 1.05
# Standard errors by which numbers may differ by chance, which they exceed once in 16,000 times.
LARGEST_DEVIATION = 4.0
# Effective draws, at least: errors of bridge sampling were right with 48, and eight times too small
# with 8.
FEWEST_EFFECTIVE = 40
# Digits to which numbers are rounded before the worst one is named, so that the first of several
# equal ones is named.
DIGITS = 6
# Share of divergent transitions, at most: with more, NUTS missed a fifth of the mass in the neck of
# a hierarchy; with fewer it missed no mass.
_MOST_DIVERGENT = 0.001


def effective_size(values: Array, method: str = "mean") -> float:
    """Effective number of values, (chain, draw); antithetic chains count as independent draws."""
    return min(float(array_stats.ess(values, method=method)), float(values.size))


def largest_rhat(names: Sequence[str], draws: Array) -> tuple[float, str]:
    """Return the largest R-hat of unknowns, (chain, draw, unknown), and the name of the unknown."""
    with np.errstate(all="ignore"):
        rhat = array_stats.rhat(draws, chain_axis=0, draw_axis=1)
    rhat = np.nan_to_num(rhat, nan=np.inf)  # of chains that stand still
    worst = int(rhat.round(DIGITS).argmax())
    return float(rhat[worst]), names[worst]


def disagreement(names: Sequence[str], draws: Array, log_density: Array) -> list[str]:
    """Return doubts if the chains differ in an unknown, or in the log density.

    The tails count as well as the bulk: a mode that is seldom met is a tail.
    """
    values = np.concatenate([draws, log_density[..., None]], axis=2)
    names = [*names, "the log density"]
    rhat, worst = largest_rhat(names, values)
    if rhat > LARGEST_RHAT:
        return [
            f"the chains disagree (R-hat {rhat:.2f} of {worst}): they have not met the same parts "
            "of the posterior, or are too short"
        ]
    axes = {"chain_axis": 0, "draw_axis": 1}
    with np.errstate(all="ignore"):
        bulk = array_stats.ess(values, method="bulk", **axes)
        # The tails of Vehtari et al. (2021).
        tail = array_stats.ess(values, method="tail", prob=(0.05, 0.95), **axes)
    effective = np.nan_to_num(np.minimum(bulk, tail))
    if effective.min() < FEWEST_EFFECTIVE:
        worst = names[effective.round(DIGITS).argmin()]
        return [
            f"the chains are too short ({effective.min():.0f} effective draws of {worst}, "
            "in the bulk or the tails)"
        ]
    return []


def divergence(tree: xr.DataTree) -> list[str]:
    """Return doubts if transitions of the sampler diverged."""
    stats = tree.children.get("sample_stats", {})
    diverging = np.asarray(stats["diverging"]) if "diverging" in stats else np.zeros(1)
    if diverging.mean() <= _MOST_DIVERGENT:
        return []
    return [
        f"{int(diverging.sum())} of {diverging.size} transitions diverged: the draws miss a part "
        "of the posterior; sample with a higher target_accept, or in other coordinates"
    ]
