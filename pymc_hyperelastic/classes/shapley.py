"""Shapley values: parts of the log ratio of a specimen's evidences under two classes."""

from collections.abc import Sequence
from math import factorial

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, softmax

from pymc_hyperelastic.classes.average import Laws
from pymc_hyperelastic.classes.interface import Prediction

Array = NDArray[np.float64]

# Share of an average over laws below which a law changes no digit that is told of a part.
_NEGLIGIBLE = 1e-4
# Digits to which log probabilities of classes are rounded before they are compared, so that
# rounding errors do not decide.
_DIGITS = 9


def parts_of(laws: Laws) -> list[str]:
    """Parts of a class that can be told apart by any of the laws."""
    by_number = sorted(laws.parts, key=len, reverse=True)
    return list(dict.fromkeys(part for parts in by_number for part in parts))


def log_ratio_parts(
    laws: Laws, predictions: Sequence[Sequence[Prediction]], own: int, rival: int
) -> Array:
    """Parts of the log ratio of the evidences of two classes, from predictions by law and class."""
    return shapley(_hybrids(laws, predictions, own, rival))


def rivals_of(log_probability: Array) -> list[int]:
    """Number of the most probable other class of each."""
    # So rounded, rounding errors do not decide; what is not known is least probable.
    known = np.nan_to_num(log_probability.round(_DIGITS), nan=-np.inf)
    first, second = np.argsort(-known, kind="stable")[:2].tolist()
    return [second if own == first else first for own in range(len(known))]


def _hybrids(
    laws: Laws, predictions: Sequence[Sequence[Prediction]], own: int, rival: int
) -> Array:
    """Log evidences with parts of the rival in place of the class's own, averaged over laws.

    Laws that count for nothing are not asked what is between the two ends: it may not be known.
    """
    parts, terms = parts_of(laws), []
    both = np.array([[of[i].log_evidence.value for i in (own, rival)] for of in predictions])
    for law, counts in enumerate(_count(laws, both)):
        of_law, hybrids = laws.parts[law], predictions[law][own].hybrids
        if hybrids is not None and counts:
            values = hybrids(rival)
        else:
            values = np.full((2,) * len(of_law), -np.inf)
            values.flat[[0, -1]] = both[law]
        # What a law does not have changes nothing.
        values = values[tuple(slice(None) if part in of_law else None for part in parts)]
        terms.append(laws.log_probability[law] + np.broadcast_to(values, (2,) * len(parts)))
    return logsumexp(terms, axis=0)


def _count(laws: Laws, ends: Array) -> NDArray[np.bool_]:
    """Whether a law counts: by its probability, or in what is said of the class or its rival."""
    if len(ends) == 1:
        return np.array([True])
    shares = softmax(laws.log_probability[:, None] + ends, axis=0)
    # What is not a number counts: it must not be passed over.
    return ~((np.exp(laws.log_probability) < _NEGLIGIBLE) & (shares.max(axis=1) < _NEGLIGIBLE))


def shapley(values: Array) -> Array:
    r"""Parts of the difference between the first and the last of the values (2, 2, ...).

    Each axis is a part, which is a class's own or its rival's. With the set ``S`` of parts that
    are the rival's already, of ``n`` in all, the part ``j`` has the difference

    .. math:: φ_j = \sum_{S \not\ni j} \frac{|S|! \, (n - 1 - |S|)!}{n!} \,
        \bigl[v(S) - v(S \cup \{j\})\bigr]

    which is the mean over all orders in which the parts can be exchanged (L. S. Shapley, A value
    for n-person games, Contributions to the Theory of Games II (1953) 307-317).
    """
    n = values.ndim
    exchanged = np.indices((2,) * (n - 1)).sum(axis=0)
    orders = [factorial(s) * factorial(n - 1 - s) / factorial(n) for s in range(n)]
    weights = np.array(orders)[exchanged]
    gains = [values.take(0, axis=j) - values.take(1, axis=j) for j in range(n)]
    return np.array([np.sum(weights * gain) for gain in gains])
