"""Whether chains of draws have come to the same distribution, and how many draws are effective."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from arviz_stats.base import array_stats

from pymc_hyperelastic.evidence.mixture import Array

# Chains that agree have a smaller split R-hat.
_LARGEST_RHAT = 1.05
# With as many divergent transitions NUTS missed a tenth of the mass in funnels. With half as many
# nothing was missing.
_MOST_DIVERGENT = 0.0025


def effective_size(values: Array, method: str = "mean") -> float:
    """Effective number of values, (chain, draw); antithetic chains count as independent draws."""
    return min(float(array_stats.ess(values, method=method)), float(values.size))


def disagreement(names: Sequence[str], draws: Array, log_density: Array) -> list[str]:
    """Whether the chains differ in one of the unknowns, which have these names, or the density."""
    values = np.concatenate([draws, log_density[..., None]], axis=2)
    with np.errstate(all="ignore"):
        rhat = array_stats.rhat(values, chain_axis=0, draw_axis=1)
    rhat = np.nan_to_num(rhat, nan=np.inf)  # of chains that stand still
    worst = rhat.argmax()
    if rhat[worst] <= _LARGEST_RHAT:
        return []
    name = [*names, "the log density"][worst]
    return [
        f"the chains disagree (R-hat {rhat[worst]:.2f} of {name}): they have not met the same "
        "parts of the posterior, or are too short"
    ]


def divergence(tree: xr.DataTree) -> list[str]:
    """Whether the sampler itself said that it could not go everywhere."""
    stats = tree.children.get("sample_stats", {})
    diverging = np.asarray(stats["diverging"]) if "diverging" in stats else np.zeros(1)
    if diverging.mean() <= _MOST_DIVERGENT:
        return []
    return [
        f"{int(diverging.sum())} of {diverging.size} transitions diverged: the draws miss a part "
        "of the posterior; sample with a higher target_accept, or in other coordinates"
    ]
