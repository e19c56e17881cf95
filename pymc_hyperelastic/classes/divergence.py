"""How different two classes are."""

import numpy as np
import xarray as xr
from arviz_stats import ess

from pymc_hyperelastic.classes.kinds import kind_of_classes
from pymc_hyperelastic.evidence.diagnosis import log_evidence
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.parallel import one_thread


@one_thread
def kl_divergence(classes: xr.DataTree, first: str, second: str) -> Estimate:
    r"""Kullback-Leibler divergence of the posterior of one class from that of another, in nats.

    .. math:: KL = \int P(θ | C_1) \ln \frac{P(θ | C_1)}{P(θ | C_2)} \, dθ

    Both densities are known with their normalisers, the evidences, so that the integral is a mean
    over the particles of the first class; no density is estimated.

    Parameters
    ----------
    classes : xarray.DataTree
        Result of :func:`fit_classes`.
    first, second : str
        Names of the classes. The divergence is not symmetric.

    Returns
    -------
    Estimate
        The pair (value, standard error).

    Raises
    ------
    ValueError
        If a class is unknown or the classes are not of one model.

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
            raise ValueError(f"there is no class {name!r}; there are {list(classes.children)}")
    evidences = [log_evidence(classes[name]) for name in (first, second)]
    log_posteriors = [
        kind.log_density(classes[name], classes[first]) - evidence.value
        for name, evidence in zip((first, second), evidences, strict=True)
    ]
    difference = log_posteriors[0] - log_posteriors[1]
    chains = classes[first]["posterior"].sizes["chain"]
    variance = sum(evidence.standard_error**2 for evidence in evidences)
    if spread := np.var(difference):
        # Particles that were resampled from one are not independent.
        variance += spread / ess(difference.reshape(chains, -1), method="mean")
    if first == second:
        variance = 0.0
    return Estimate(float(np.mean(difference)), float(np.sqrt(variance)))
