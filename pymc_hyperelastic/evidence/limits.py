"""Whether a posterior is pressed against a limit of a prior."""

from collections.abc import Mapping

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import xarray as xr
from pymc.exceptions import NotConstantValueError
from pymc.logprob.transforms import IntervalTransform
from pymc.pytensorf import constant_fold
from scipy.special import expit

from pymc_hyperelastic.evidence.mixture import Array

# Part of the width of a prior that is counted as its limit.
_NEAR = 0.01


def mass_at_limits(model: pm.Model, unconstrained: Mapping[str, Array]) -> xr.Dataset:
    """Return the share of the posterior within 1 % of each limit, by the name of the limit.

    Counted are variables whose prior has two ends. A lower end of 0 is no choice of whoever stated
    the prior: a modulus is not negative, and may be small.
    """
    shares: dict[str, float] = {}
    for rv in model.free_RVs:
        transform = model.rvs_to_transforms[rv]
        if not isinstance(transform, IntervalTransform):
            continue
        lower, upper, *bounded = transform.get_a_and_b(rv.owner.inputs)
        if not all(bounded):
            continue
        try:
            ends = constant_fold([pt.as_tensor(end) for end in (lower, upper)])
        except NotConstantValueError:  # depends on other variables
            continue
        place = expit(unconstrained[model.rvs_to_values[rv].name])
        shape = place.shape[2:]
        lowest, highest = (np.broadcast_to(end, shape) for end in ends)
        for index in np.ndindex(shape):
            entry = place[(..., *index)]
            name = f"{rv.name}{list(index) if index else ''}"
            shares[f"upper limit {highest[index]:g} of {name}"] = float(np.mean(entry > 1 - _NEAR))
            if lowest[index] != 0:
                shares[f"lower limit {lowest[index]:g} of {name}"] = float(np.mean(entry < _NEAR))
    if not shares:
        return xr.Dataset()
    return xr.Dataset({"at_limit": ("limit", [*shares.values()])}, {"limit": [*shares]})
