"""Kullback-Leibler divergence between the posteriors of two classes."""

import numpy as np
import xarray as xr
from arviz_stats import ess

from pymc_hyperelastic.classes.kinds import kind_of_classes
from pymc_hyperelastic.evidence.diagnosis import log_evidence
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.parallel import one_thread


@one_thread
def kl_divergence(classes: xr.DataTree, first: str, second: str) -> Estimate:
    r"""Compute the Kullback-Leibler divergence from the posterior of one class to another's.

    .. math:: KL = \int P(θ | C_1) \ln \frac{P(θ | C_1)}{P(θ | C_2)} \, dθ

    Both densities are normalised with the evidences. The integral is therefore the mean of their
    log ratio over the posterior draws of the first class, and no density is estimated from draws.

    Parameters
    ----------
    classes : xarray.DataTree
        Result of :func:`fit_classes` without variability.
    first, second : str
        Names of the classes ``C₁`` and ``C₂``. The divergence is not symmetric.

    Returns
    -------
    Estimate
        The pair (value, standard error), in nats.

    Raises
    ------
    ValueError
        If a class is unknown, the classes are not of one model, or they have variability.

    See Also
    --------
    fit_classes

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> classes = ph.open_result("pooled.nc")  # saved from the example of fit_classes
    >>> ph.kl_divergence(classes, "C1", "C2").value > 100
    True
    """
    kind = kind_of_classes(classes)
    for name in (first, second):
        if name not in classes.children:
            raise ValueError(
                f"there is no class {name!r}; the classes are {list(classes.children)}"
            )
    evidences = [log_evidence(classes[name]) for name in (first, second)]
    log_posteriors = [
        kind.log_density(classes[name], classes[first]) - evidence.value
        for name, evidence in zip((first, second), evidences, strict=True)
    ]
    difference = log_posteriors[0] - log_posteriors[1]
    chains = classes[first]["posterior"].sizes["chain"]
    variance = sum(evidence.standard_error**2 for evidence in evidences)
    if spread := np.var(difference):
        # Particles with a common ancestor are correlated: use the effective sample size.
        variance += spread / ess(difference.reshape(chains, -1), method="mean")
    if first == second:
        variance = 0.0
    return Estimate(float(np.mean(difference)), float(np.sqrt(variance)))
