"""Find posteriors that are pressed against a limit of a prior."""

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

# Share of the posterior that is nearer to the limit than a tenth of the median: 0.05 to 0.07 of one
# that is pressed against it, less of one that ends before it, as of a true value that is near.
_PRESSED = 0.03


def mass_at_limits(
    model: pm.Model,
    unconstrained: Mapping[str, Array],
    physical: Mapping[str, tuple[float, float]] | None = None,
) -> xr.Dataset:
    """Return the share of the posterior within 1 % of each limit, by the name of the limit.

    It is 0 where the posterior is not pressed against the limit, but ends before it. Counted are
    variables whose prior has two ends. A lower end of 0 is no choice of whoever stated the prior:
    a modulus is not negative, and may be small. Nor are both ends of a fraction, 0 and 1, or the
    `physical` ends of other variables by name, such as the 90° of an angle.
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
            own = (physical or {}).get(rv.name, ())
            if (lowest[index], highest[index]) != (0, 1) and highest[index] not in own:
                shares[f"upper limit {highest[index]:g} of {name}"] = _share_at_end(1 - entry)
            if lowest[index] not in (0, *own):
                shares[f"lower limit {lowest[index]:g} of {name}"] = _share_at_end(entry)
    if not shares:
        return xr.Dataset()
    return xr.Dataset({"at_limit": ("limit", [*shares.values()])}, {"limit": [*shares]})


def _share_at_end(distance: Array) -> float:
    """Share of the posterior within 1 % of an end of the prior, of distances in its widths."""
    pressed = np.mean(distance <= np.median(distance) / 10) > _PRESSED
    return float(np.mean(distance < 0.01)) if pressed else 0.0
