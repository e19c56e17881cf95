"""What each measured signal says of classes whose specimens share one set of parameters."""

from collections.abc import Callable, Collection, Sequence
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from pymc_hyperelastic.classes.interface import Prediction

Array = NDArray[np.float64]

# Log evidence of some signals alone, under the class of a number; NaN where it is not known.
EvidenceOf = Callable[[int, frozenset[str]], float]


def with_hybrids(
    predictions: Sequence[Prediction],
    signals: Sequence[str],
    measured: Collection[str],
    evidence_of: EvidenceOf,
) -> list[Prediction]:
    r"""Predictions that tell what any two of the classes say of the signals, each of some.

    With the signals in ``S`` told by the other class, and those in its complement ``S'`` by the
    class itself,

    .. math:: v(S) = \ln P(D_{S'} | C) + \ln P(D_S | C_{\mathrm{other}})

    Of `signals` that were not `measured` nothing is told. Evidences of some signals alone are
    taken only when they are asked for, and once.
    """
    evidence_of, known = cache(evidence_of), frozenset(measured)

    def log_evidence(number: int, told: frozenset[str]) -> float:
        if told >= known:
            value, error = predictions[number].log_evidence
            return value if np.isfinite(error) else np.nan
        return evidence_of(number, told & known) if told & known else 0.0

    def hybrids(own: int, other: int) -> Array:
        values = np.empty((2,) * len(signals))
        for place in np.ndindex(values.shape):
            told = frozenset(s for s, by_other in zip(signals, place, strict=True) if by_other)
            values[place] = log_evidence(own, known - told) + log_evidence(other, told)
        return values

    return [p._replace(hybrids=partial(hybrids, i)) for i, p in enumerate(predictions)]
