"""Sensitivity of posterior quantities to the prior and to the likelihood, by power scaling.

:func:`~pymc_hyperelastic.compare_classes` reports it for each difference between groups. The
method is that of N. Kallioinen, T. Paananen, P.-C. Bürkner and A. Vehtari, Statistics and Computing
34 (2024) 57, as implemented in ``arviz_stats.psense``.
"""

import numpy as np
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.classes.interface import FEWEST_DRAWS
from pymc_hyperelastic.evidence.batched import BatchedFunction
from pymc_hyperelastic.evidence.kernel import BatchedSMC
from pymc_hyperelastic.evidence.stored import read_draws, read_numbers

Array = NDArray[np.float64]

# Parts of the posterior density that are raised to a power.
_GROUPS = "prior", "likelihood"


def log_prior_and_likelihood(kernel: BatchedSMC, tree: xr.DataTree, count: int) -> Array:
    """Return log prior and log likelihood at the draws of `some_of_posterior`, (2, draw).

    The log prior is that of the untransformed variables, without the Jacobian of the transform.
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
    """Return the sensitivities of draws, along ``draw``, to powers of prior and likelihood.

    Only draws with finite values are used; with fewer than 100 of them the result is NaN.
    """
    from arviz_stats import psense

    rest = [d for d in draws.dims if d != "draw"]
    values = draws.transpose("draw", *rest)
    flat = values.values.reshape(len(log_prior), -1)
    # Columns that are finite at the same draws are computed together.
    patterns, which = np.unique(np.isfinite(flat), axis=1, return_inverse=True)
    found = np.full((2, flat.shape[1]), np.nan)
    for number, finite in enumerate(patterns.T):
        if finite.sum() < FEWEST_DRAWS:
            continue
        logs = {"log_prior": log_prior[finite], "log_likelihood": log_likelihood[finite]}
        columns = np.ravel(which) == number
        chosen = flat[finite][None][..., columns]
        posterior = xr.Dataset({"value": (("chain", "draw", "place"), chosen)})
        tree = xr.DataTree.from_dict(
            {"posterior": posterior}
            | {k: xr.Dataset({"all": (("chain", "draw"), v[None])}) for k, v in logs.items()}
        )
        found[:, columns] = [psense(tree, group=group)["value"] for group in _GROUPS]
    shape = values.isel(draw=0, drop=True)
    return xr.Dataset(
        {
            f"{group}_sensitivity": shape.copy(data=of_group.reshape(shape.shape))
            for group, of_group in zip(_GROUPS, found, strict=True)
        }
    )
