"""An evidence with its standard error."""

from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp
from scipy.stats import chi2

from pymc_hyperelastic.evidence.mixture import Array


class Estimate(NamedTuple):
    """A number with its standard error; ``float(estimate)`` is the number.

    See Also
    --------
    log_evidence

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> log_evidence = ph.Estimate(-41.27, 0.03)
    >>> print(log_evidence)
    -41.270 ± 0.030
    >>> float(log_evidence)
    -41.27
    """

    value: float
    standard_error: float

    def __float__(self) -> float:
        return self.value

    def __str__(self) -> str:
        return f"{self.value:.3f} ± {self.standard_error:.3f}"


def largest_spread(standard_errors: Array) -> float:
    """Return the sd of log evidences with these errors that chance exceeds once in 100 times.

    Only a larger sd refutes the errors: the sd of a few chains is itself poorly known.
    """
    more = len(standard_errors) - 1
    return float(np.sqrt(np.mean(np.square(standard_errors)) * chi2.isf(0.01, more) / more))


def combine_chains(log_evidences: Array, standard_errors: Array) -> Estimate:
    """Mean evidence of independent chains, as its logarithm with a standard error.

    It is infinite if a chain has failed. The spread of the chains is that of the evidences,
    relative to their mean, or that of the logarithms if it is larger: the first one has a ceiling.
    """
    chains = len(log_evidences)
    value = float(logsumexp(log_evidences) - np.log(chains))
    variance = np.mean(np.square(standard_errors))
    if not np.all(np.isfinite([*log_evidences, variance])):
        return Estimate(value, np.inf)
    if chains > 1:
        relative = np.exp(log_evidences - value)
        spread = max(np.var(relative, ddof=1), np.var(log_evidences, ddof=1))
        if spread > largest_spread(standard_errors) ** 2:
            variance = spread
    return Estimate(value, float(np.sqrt(variance / chains)))
