"""Extension tests at the door: whether an axial stretch that varies was meant to.

A stretch that was mistyped in one row, or that was read repeatedly while it was held, would make an
extension test of an inflation test, which then has no slopes.
"""

import numpy as np
from numpy.typing import NDArray

from pymc_hyperelastic.data.columns import Rows
from pymc_hyperelastic.data.inflation import varies
from pymc_hyperelastic.rounding import DIGITS

#: Smallest strain that counts as one: smaller ones may be errors of measurement.
LEAST_STRAIN = 0.01


def clearly_extended(stretch: NDArray[np.float64]) -> bool:
    """Return True if a test's stretches are neither readings of one, nor one with exceptions."""
    return not (_held(stretch) or _usual(stretch)[1])


def stretches_of(
    rows: Rows, stretch: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Stretch of every row, one number in each test that holds it, and the tests that vary it.

    Impossible stretches of extension tests are errors; variations that look like errors of
    measurement or typing are doubted.
    """
    varying = varies(stretch, rows.test)
    stretch = np.where(varying[rows.test], stretch, stretch[rows.first][rows.test])
    for i in np.flatnonzero((stretch <= 0) & varying[rows.test]).tolist():
        what = f"axial_stretch is {stretch[i]:.6g}; expected a positive ratio of lengths, 1 for an "
        rows.refuse(i, f"{what}unstretched tube")
    for test in np.flatnonzero(varying):
        points = np.flatnonzero(rows.test == test)
        own = stretch[points]
        usual, often = _usual(own)
        if often:
            other = points[np.flatnonzero(own.round(DIGITS) != usual)[0]]
            rows.problems.doubt(
                "extension",
                rows.place(other),
                f"axial_stretch is {stretch[other]:.6g} here and {usual:.6g} in {often} of the "
                f"{points.size} rows of this experiment. If it varies the experiment is an "
                "extension test, and has no slopes: was it mistyped?",
            )
        elif _held(own):
            rows.problems.doubt(
                "extension",
                rows.place(points[np.argmax(own)]),
                f"axial_stretch varies from {own.min():.6g} to {own.max():.6g} in this experiment, "
                "which makes an extension test of it, without slopes: if it was held, give its "
                f"mean, {own.mean():.6g}, in all rows",
            )
    return stretch, varying


def _held(stretch: NDArray[np.float64]) -> bool:
    return bool(np.ptp(stretch) < LEAST_STRAIN * stretch.max())


def _usual(stretch: NDArray[np.float64]) -> tuple[float, int]:
    """The most frequent stretch, and in how many rows if these are most rows of several."""
    values, count = np.unique(stretch.round(DIGITS), return_counts=True)
    often = int(count.max())
    too_many = often > stretch.size / 2 and stretch.size > 2
    return float(values[np.argmax(count)]), often if too_many else 0
