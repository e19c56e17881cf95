"""An evidence with its standard error."""

from typing import NamedTuple

import numpy as np
import xarray as xr
from scipy.special import logsumexp
from scipy.stats import chi2

from pymc_hyperelastic.evidence.mixture import Array
from pymc_hyperelastic.evidence.results import check_result

# The spread of a few chains is a poor estimate of their variance, unless it refutes the other one.
_CHANCE = 0.01


class Estimate(NamedTuple):
    """A number with its standard error; ``float(estimate)`` is the number."""

    value: float
    standard_error: float

    def __float__(self) -> float:
        return self.value

    def __str__(self) -> str:
        return f"{self.value:.3f} ± {self.standard_error:.3f}"


def log_evidence(tree: xr.DataTree) -> Estimate:
    r"""Log evidence (log marginal likelihood) of a sampled model, with its standard error.

    The evidences of independent chains are averaged. The relative variance of one chain is
    estimated within the chains (see :class:`BatchedSMC`), unless they differ more from each other
    than one time in a hundred by chance: then it is that of their spread.

    Parameters
    ----------
    tree : xarray.DataTree
        Result of :func:`sample_smc`, or one class of :func:`pymc_hyperelastic.fit_classes`.

    Returns
    -------
    Estimate
        The pair (value, standard error), in nats.

    Raises
    ------
    ValueError
        If the result holds no evidence.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1")
    >>> model = ph.ogden_model(data, sigma=5 * ph.mmHg, slope_weight=3.0)
    >>> tree = ph.sample_smc(model, draws=500, chains=2, random_seed=1, progressbar=False)
    >>> value, standard_error = ph.log_evidence(tree)
    """
    check_result(tree)
    if "evidence" not in tree.children:
        raise ValueError(
            f"the result has no evidence; its groups are {sorted(tree.children)}. It comes from "
            "ph.sample_smc or ph.fit_classes (for a class: ph.log_evidence(classes['C1']))"
        )
    evidence = tree["evidence"]
    estimate = combine_chains(evidence["log_evidence"].values, evidence["log_evidence_se"].values)
    # What all chains have in common no mean of theirs removes.
    common = float(evidence["specimens_se"]) if "specimens_se" in evidence else 0.0
    return Estimate(estimate.value, float(np.hypot(estimate.standard_error, common)))


def combine_chains(log_evidences: Array, standard_errors: Array) -> Estimate:
    """Mean evidence of independent chains, as its logarithm with a standard error."""
    chains = len(log_evidences)
    value = logsumexp(log_evidences) - np.log(chains)
    variance = np.mean(np.square(standard_errors))
    if chains > 1:
        spread = np.var(np.exp(log_evidences - value), ddof=1)
        if spread > variance * chi2.isf(_CHANCE, chains - 1) / (chains - 1):
            variance = spread
    return Estimate(float(value), float(np.sqrt(variance / chains)))
