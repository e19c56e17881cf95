"""Divide the evidence between measured signals, for classes without variability.

The signals are pressure, slope and force. Predictions of classes without variability call
:func:`with_hybrids`.
"""

from collections.abc import Callable, Collection, Sequence
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from pymc_hyperelastic.classes.interface import Prediction

Array = NDArray[np.float64]

# Function of the number of a class and of a set of signals: the log evidence, in nats, of these
# signals alone under the class; NaN if it is unknown.
EvidenceOf = Callable[[int, frozenset[str]], float]


def with_hybrids(
    predictions: Sequence[Prediction],
    signals: Sequence[str],
    measured: Collection[str],
    evidence_of: EvidenceOf,
) -> list[Prediction]:
    r"""Return the predictions with a function for evidences of hybrids of two classes.

    A hybrid takes the signals in a set ``S`` from the other class, and those in its complement
    ``S'`` from the class itself:

    .. math:: v(S) = \ln P(D_{S'} | C) + \ln P(D_S | C_{\mathrm{other}})

    `signals` that were not `measured` do not contribute. The evidence of some of the signals is
    computed when it is first needed, and then cached. See ``Prediction.hybrids``.
    """
    evidence_of, all_measured = cache(evidence_of), frozenset(measured)

    def log_evidence(number: int, chosen: frozenset[str]) -> float:
        if chosen >= all_measured:
            value, error = predictions[number].log_evidence
            return value if np.isfinite(error) else np.nan
        chosen &= all_measured
        return evidence_of(number, chosen) if chosen else 0.0

    def hybrids(own: int, other: int) -> Array:
        values = np.empty((2,) * len(signals))
        for place in np.ndindex(values.shape):
            from_other = frozenset(s for s, moved in zip(signals, place, strict=True) if moved)
            of_own = log_evidence(own, all_measured - from_other)
            values[place] = of_own + log_evidence(other, from_other)
        return values

    return [p._replace(hybrids=partial(hybrids, i)) for i, p in enumerate(predictions)]
