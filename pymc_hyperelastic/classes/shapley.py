"""Shapley values of the log ratio of a specimen's evidences under two classes.

:func:`~pymc_hyperelastic.explain_classification` reports them. Reference: L. S. Shapley, A value
for n-person games, Contributions to the Theory of Games II (1953) 307-317.
"""

from collections.abc import Sequence
from math import factorial

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, softmax

from pymc_hyperelastic.classes.average import Laws
from pymc_hyperelastic.classes.interface import Prediction
from pymc_hyperelastic.rounding import DIGITS

Array = NDArray[np.float64]

#: Probability of a strain energy, or of a class, below which it changes no reported digit of an
#: average.
NEGLIGIBLE = 1e-4


def parts_of(laws: Laws) -> list[str]:
    """Return the names of all parts that the classes have under any of the strain energies."""
    by_number = sorted(laws.parts, key=len, reverse=True)
    return list(dict.fromkeys(part for parts in by_number for part in parts))


def log_ratio_parts(
    laws: Laws, predictions: Sequence[Sequence[Prediction]], own: int, rival: int
) -> Array:
    """Return the Shapley values of the log evidence ratio of the classes `own` and `rival`.

    `predictions` has the order (law, class).
    """
    return shapley(_hybrids(laws, predictions, own, rival))


def rivals_of(log_probability: Array) -> list[int]:
    """Return, for each class, the index of the most probable other class."""
    # Unknown probabilities are ranked last.
    ranked = np.nan_to_num(log_probability.round(DIGITS), nan=-np.inf)
    first, second = np.argsort(-ranked, kind="stable")[:2].tolist()
    return [second if own == first else first for own in range(len(ranked))]


def _hybrids(
    laws: Laws, predictions: Sequence[Sequence[Prediction]], own: int, rival: int
) -> Array:
    """Return log evidences for each set of replaced parts, averaged over strain energies.

    Each axis is a part: index 0 for the class `own`, 1 for the rival. For strain energies with
    negligible weights only the two ends are used, since other entries may be unknown.
    """
    parts, terms = parts_of(laws), []
    both = np.array([[of[i].log_evidence.value for i in (own, rival)] for of in predictions])
    for law, relevant in enumerate(_are_relevant(laws, both)):
        of_law, hybrids = laws.parts[law], predictions[law][own].hybrids
        if hybrids is not None and relevant:
            values = hybrids(rival)
        else:
            values = np.full((2,) * len(of_law), -np.inf)
            values.flat[[0, -1]] = both[law]
        # Replacing a part that this strain energy lacks changes nothing.
        values = values[tuple(slice(None) if part in of_law else None for part in parts)]
        terms.append(laws.log_probability[law] + np.broadcast_to(values, (2,) * len(parts)))
    return logsumexp(terms, axis=0)


def _are_relevant(laws: Laws, ends: Array) -> NDArray[np.bool_]:
    """Return True for each law whose prior weight, or weight given either class, is relevant."""
    if len(ends) == 1:
        return np.array([True])
    shares = softmax(laws.log_probability[:, None] + ends, axis=0)
    # The comparison is False for NaN: an unknown weight is not negligible.
    return ~((np.exp(laws.log_probability) < NEGLIGIBLE) & (shares.max(axis=1) < NEGLIGIBLE))


def shapley(values: Array) -> Array:
    r"""Return the Shapley values of the difference between the first and the last value.

    `values`, of shape (2, ..., 2) with one axis for each of ``n`` parts, holds ``v(S)``: index 1
    along the axes of the parts in ``S``, which are replaced with those of the rival. The Shapley
    value of part ``j`` is

    .. math:: φ_j = \sum_{S \not\ni j} \frac{|S|! \, (n - 1 - |S|)!}{n!} \,
        \bigl[v(S) - v(S \cup \{j\})\bigr]

    the mean change over all orders in which the parts can be replaced.
    """
    n = values.ndim
    replaced = np.indices((2,) * (n - 1)).sum(axis=0)
    orders = [factorial(s) * factorial(n - 1 - s) / factorial(n) for s in range(n)]
    weights = np.array(orders)[replaced]
    gains = [values.take(0, axis=j) - values.take(1, axis=j) for j in range(n)]
    return np.array([np.sum(weights * gain) for gain in gains])
