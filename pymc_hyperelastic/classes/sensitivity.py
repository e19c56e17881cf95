"""How far priors, and data, decide what is said."""

from typing import Any

import numpy as np
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.evidence.batched import BatchedFunction
from pymc_hyperelastic.evidence.kernel import BatchedSMC

Array = NDArray[np.float64]


def log_prior_and_likelihood(kernel: BatchedSMC, tree: xr.DataTree, count: int) -> Array:
    """Both at so many draws of a result, (2, draw): those of `some_of_posterior`.

    The prior is that of the variables themselves, on whose scale it is raised to a power.
    """
    particles = tree["unconstrained_posterior"].to_dataset().stack(sample=("chain", "draw"))
    chosen = np.linspace(0, particles.sizes["sample"] - 1, count).round().astype(int)
    particles = particles.isel(sample=np.unique(chosen))
    target, model = kernel.target, kernel.model
    by_name = {n: particles[n].transpose("sample", ...).values for n in target.var_info}
    points = target.columns(by_name)
    priors = model.logp(vars=model.free_RVs, jacobian=False, sum=False)
    (prior,) = BatchedFunction.of_model(model, [sum(pt.sum(term) for term in priors)])(points)
    return np.stack([prior, target.score(points)[1]])


def power_scaling(draws: xr.DataArray, log_prior: Array, log_likelihood: Array) -> xr.Dataset:
    """Sensitivity of draws, along ``draw``, to the powers of the prior and of the likelihood."""
    from arviz_stats import psense

    rest = [d for d in draws.dims if d != "draw"]
    posterior = draws.drop_vars(set(draws.coords) - set(rest)).rename("value")
    posterior = posterior.transpose("draw", *rest).expand_dims("chain")
    known: dict[str, Any] = {"log_prior": log_prior, "log_likelihood": log_likelihood}
    tree = xr.DataTree.from_dict(
        {"posterior": posterior.to_dataset()}
        | {k: xr.Dataset({"all": (("chain", "draw"), v[None])}) for k, v in known.items()}
    )
    return xr.Dataset(
        {
            f"{name}_sensitivity": psense(tree, group=group)["value"]
            for name, group in (("prior", "prior"), ("likelihood", "likelihood"))
        }
    )
