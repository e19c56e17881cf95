"""Extension tests at the door: whether an axial stretch that varies was meant to.

A stretch that was mistyped in one row, or that was read again and again while it was held, would
make an extension test of an inflation test, and take its slopes away.
"""

import numpy as np
from numpy.typing import NDArray

from pymc_hyperelastic.data.columns import Rows
from pymc_hyperelastic.data.inflation import varies

# Parts of its stretch by which a tube is extended at least; what varies by less was held.
_LEAST_EXTENSION = 0.01
# The part of the rows of an extension test that have one and the same stretch, at most.
_MOST_ALIKE = 0.5
# Digits to which stretches are rounded before they are compared, so that rounding errors do not
# decide.
_DIGITS = 9


def clearly_extended(stretch: NDArray[np.float64]) -> bool:
    """Whether a test's stretches are neither readings of one, nor one with exceptions.

    Examples
    --------
    >>> clearly_extended(np.array([1.2, 1.25])), clearly_extended(np.array([1.2, 1.2004]))
    (True, False)
    """
    return not (_held(stretch) or _alike(stretch)[1])


def stretches_of(
    rows: Rows, given: float | str | None
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Axial stretch of every row, and in which tests it varies; in the others it is one number.

    Raises ValueError where one that varies is impossible.
    """
    stretch = rows.of_points("axial_stretch", given)
    varying = varies(stretch, rows.test)
    stretch = np.where(varying[rows.test], stretch, stretch[rows.first][rows.test])
    impossible = np.flatnonzero((stretch <= 0) & varying[rows.test])
    if impossible.size:
        i = impossible[0]
        raise ValueError(
            f"{rows.place(i)}: axial_stretch is {stretch[i]:.6g}; expected a positive ratio of "
            "lengths, 1 for an unstretched tube"
        )
    return stretch, varying


def doubtful_stretches(
    rows: Rows, stretch: NDArray[np.float64], varying: NDArray[np.bool_]
) -> list[str]:
    """What is doubted of tests whose stretch, given by rows, is varying."""
    doubts = []
    for test in np.flatnonzero(varying):
        points = np.flatnonzero(rows.test == test)
        own = stretch[points]
        usual, alike = _alike(own)
        if alike:
            other = points[np.flatnonzero(own.round(_DIGITS) != usual)[0]]
            doubts.append(
                f"{rows.place(other)}: axial_stretch is {stretch[other]:.6g} here and {usual:.6g} "
                f"in {alike} of the {points.size} rows of this experiment. Where it varies the "
                "experiment is an extension test, and has no slopes: was it mistyped?"
            )
        elif _held(own):
            doubts.append(
                f"{rows.place(points[np.argmax(own)])}: axial_stretch varies from {own.min():.6g} "
                f"to {own.max():.6g} in this experiment, which makes an extension test of it, "
                f"without slopes: if it was held, give its mean, {own.mean():.6g}, in all rows"
            )
    return doubts


def _held(stretch: NDArray[np.float64]) -> bool:
    return bool(np.ptp(stretch) < _LEAST_EXTENSION * stretch.max())


def _alike(stretch: NDArray[np.float64]) -> tuple[float, int]:
    """The stretch of most rows, and of how many if that is too many for an extension test."""
    values, count = np.unique(stretch.round(_DIGITS), return_counts=True)
    often = int(count.max())
    too_many = often > _MOST_ALIKE * stretch.size and stretch.size > 2
    return float(values[np.argmax(count)]), often if too_many else 0
