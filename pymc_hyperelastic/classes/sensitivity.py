"""How far priors, and data, decide what is said."""

import numpy as np
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.evidence.batched import BatchedFunction
from pymc_hyperelastic.evidence.kernel import BatchedSMC
from pymc_hyperelastic.evidence.stored import read_draws, read_numbers

Array = NDArray[np.float64]

_POWERS = "prior", "likelihood"
# Draws without which no sensitivity is known.
_FEWEST = 100


def log_prior_and_likelihood(kernel: BatchedSMC, tree: xr.DataTree, count: int) -> Array:
    """Both at so many draws of a result, (2, draw): those of `some_of_posterior`.

    The prior is that of the variables themselves, on whose scale it is raised to a power.
    """
    group = "unconstrained_posterior"
    for name in kernel.target.var_info:
        read_numbers(tree, group, name, None)
    particles = read_draws(tree, group).stack(sample=("chain", "draw"))
    chosen = np.linspace(0, particles.sizes["sample"] - 1, count).round().astype(int)
    particles = particles.isel(sample=np.unique(chosen))
    target, model = kernel.target, kernel.model
    by_name = {n: particles[n].transpose("sample", ...).values for n in target.var_info}
    points = target.columns(by_name)
    priors = model.logp(vars=model.free_RVs, jacobian=False, sum=False)
    (prior,) = BatchedFunction.of_model(model, [sum(pt.sum(term) for term in priors)])(points)
    return np.stack([prior, target.score(points)[1]])


def power_scaling(draws: xr.DataArray, log_prior: Array, log_likelihood: Array) -> xr.Dataset:
    """Sensitivity of draws, along ``draw``, to the powers of the prior and of the likelihood.

    Each is that of the draws which have the quantity at all.
    """
    from arviz_stats import psense

    rest = [d for d in draws.dims if d != "draw"]
    values = draws.transpose("draw", *rest)
    flat = values.values.reshape(len(log_prior), -1)
    there, which = np.unique(np.isfinite(flat), axis=1, return_inverse=True)
    found = np.full((2, flat.shape[1]), np.nan)
    for number, some in enumerate(there.T):
        if some.sum() < _FEWEST:
            continue
        known = {"log_prior": log_prior[some], "log_likelihood": log_likelihood[some]}
        own = np.ravel(which) == number
        posterior = xr.Dataset({"value": (("chain", "draw", "place"), flat[some][None][..., own])})
        tree = xr.DataTree.from_dict(
            {"posterior": posterior}
            | {k: xr.Dataset({"all": (("chain", "draw"), v[None])}) for k, v in known.items()}
        )
        found[:, own] = [psense(tree, group=group)["value"] for group in _POWERS]
    shape = values.isel(draw=0, drop=True)
    return xr.Dataset(
        {
            f"{group}_sensitivity": shape.copy(data=of_group.reshape(shape.shape))
            for group, of_group in zip(_POWERS, found, strict=True)
        }
    )
