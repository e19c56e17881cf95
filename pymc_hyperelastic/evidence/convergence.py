"""Convergence of chains of draws: R-hat, effective sample sizes and divergences."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from arviz_stats.base import array_stats

from pymc_hyperelastic.evidence.mixture import Array

# Largest split R-hat of chains that agree.
LARGEST_RHAT = 1.05
# Effective draws, in the bulk and in the tails, at least.
_FEWEST_EFFECTIVE = 40
# Quantiles of the tails: a mode that is seldom met is a tail.
_TAILS = (0.05, 0.95)
# Digits to which R-hat and effective sample sizes are rounded before the worst unknown is named, so
# that the first of several equal ones is named.
DIGITS = 6
# Share of divergent transitions, at most: with more, NUTS missed a fifth of the mass in the neck of
# a hierarchy; with fewer it missed no mass.
_MOST_DIVERGENT = 0.001


def effective_size(values: Array, method: str = "mean") -> float:
    """Effective number of values, (chain, draw); antithetic chains count as independent draws."""
    return min(float(array_stats.ess(values, method=method)), float(values.size))


def disagreement(names: Sequence[str], draws: Array, log_density: Array) -> list[str]:
    """Return doubts if the chains differ in an unknown, or in the log density."""
    values = np.concatenate([draws, log_density[..., None]], axis=2)
    axes = {"chain_axis": 0, "draw_axis": 1}
    with np.errstate(all="ignore"):
        rhat = array_stats.rhat(values, **axes)
        bulk = array_stats.ess(values, method="bulk", **axes)
        tail = array_stats.ess(values, method="tail", prob=_TAILS, **axes)
    rhat = np.nan_to_num(rhat, nan=np.inf)  # of chains that stand still
    effective = np.nan_to_num(np.minimum(bulk, tail))
    names = [*names, "the log density"]
    if rhat.max() > LARGEST_RHAT:
        worst = names[rhat.round(DIGITS).argmax()]
        return [
            f"the chains disagree (R-hat {rhat.max():.2f} of {worst}): they have "
            "not met the same parts of the posterior, or are too short"
        ]
    if effective.min() < _FEWEST_EFFECTIVE:
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
