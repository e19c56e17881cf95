"""What drives an answer: parts of the log ratio of a specimen's evidences under two classes."""

from collections.abc import Sequence
from math import factorial
from typing import Any

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


def with_parts(
    averaged: Sequence[Prediction],
    laws: Laws,
    predictions: Sequence[Sequence[Prediction]],
    log_prior: Array,
) -> list[Prediction]:
    r"""Predictions of the classes, each with its most probable rival and what tells it from that.

    `averaged` are those of the `laws` together, and `predictions` those of every class by law.
    """
    if len(averaged) < 2:
        return [prediction._replace(hybrids=None) for prediction in averaged]
    chances = np.nan_to_num([p.log_evidence.value for p in averaged], nan=-np.inf) + log_prior
    chances = chances.round(_DIGITS)
    known: dict[tuple[int, int], Array] = {}
    result = []
    for own, prediction in enumerate(averaged):
        rival = max((i for i in range(len(chances)) if i != own), key=lambda i: chances[i])
        if (rival, own) in known:
            parts = -known[rival, own]
        else:
            parts = shapley(_hybrids(laws, predictions, own, rival))
        known[own, rival] = parts
        told = tuple(parts.tolist())
        # What hybrids are made of is large, and of no more use.
        result.append(prediction._replace(rival=rival, parts=told, hybrids=None))
    return result


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


def table_of_parts(
    predictions: Sequence[Sequence[Prediction]], by: str, names: Sequence[str], parts: Sequence[str]
) -> dict[str, Any]:
    """Rivals, and parts of log ratios, as variables of the result of classifying."""
    if len(names) < 2:
        return {}
    rivals = [["" if p.rival < 0 else names[p.rival] for p in row] for row in predictions]
    nothing = (np.nan,) * len(parts)
    values = np.array([[p.parts or nothing for p in row] for row in predictions])
    return {
        "rival": ((by, "class_label"), np.array(rivals)),
        "log_ratio_part": ((by, "class_label", "part"), values),
        "part": ("part", list(parts)),
    }
