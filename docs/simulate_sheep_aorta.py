"""Make ``simulated_sheep_aorta.csv``: SIMULATED inflation of five aortas, not measured.

``python docs/simulate_sheep_aorta.py`` writes the file; the result is always the same.

The tissue is an exponential material with two fibre families. It differs from the package's laws
with two parameters, so that a fit of such a law has a model error, as with real tissue. This file
has its own integral over the wall, so that an error of the package's integral cannot affect the
data.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from pymc_hyperelastic.data import datasets
from pymc_hyperelastic.data.units import mmHg

PATH = Path(datasets.__file__).with_name("simulated_sheep_aorta.csv")

# An arbitrary number, not selected by its result. NumPy guarantees that the streams of
# `RandomState`, unlike those of `default_rng`, never change, so the file is always the same.
SEED = 20130801

CLASSES = {"C1": ("S1", "S2", "S3"), "C2": ("S4", "S5")}
EXPERIMENTS = (1, 2, 3)
N_POINTS = 20

# The unloaded tube (mm): thick-walled, with the axial stretch 1 and no opening angle.
INNER_RADIUS, OUTER_RADIUS = 7.0, 9.0

# The two fibre families have this angle on both sides of the circumferential direction.
FIBRE_ANGLE = np.deg2rad(40.0)

# Class medians of c (kPa), k1 (kPa), k2 (1).
MEDIANS = {"C1": (55.0, 24.0, 2.0), "C2": (70.0, 32.0, 3.0)}

# Standard deviations of the logarithms of c, k1, k2: between specimens, and between the experiments
# on one specimen. A specimen with more collagen stiffens sooner, so k1 and k2 are correlated.
SPECIMEN_SD = np.array([0.04, 0.06, 0.05])
EXPERIMENT_SD = np.array([0.015, 0.02, 0.02])
CORRELATION = np.array([[1.0, 0.5, 0.0], [0.5, 1.0, 0.6], [0.0, 0.6, 1.0]])

FINAL_PRESSURE, FINAL_PRESSURE_SD = 165.0, 8.0  # mmHg, where an experiment is stopped
DRIFT_SD = 1.5  # mmHg, of the first smooth error along the radius
READING_SD = 0.5  # mmHg, of the independent error of a point


def pressure(internal_radius: np.ndarray, c: float, k1: float, k2: float) -> np.ndarray:
    r"""Inflation pressure of the two-fibre tube.

    The energy is :math:`W = \frac c2 (I_1 - 3) + \frac{k_1}{2 k_2} \sum_{i=4,6}
    (e^{k_2 (I_i - 1)^2} - 1)`, where only stretched fibres contribute,
    and :math:`p = \int_A^B \frac{1}{r} \frac{\partial W}{\partial \lambda_\theta} \, dR`.

    Parameters
    ----------
    internal_radius : numpy.ndarray, shape (n,)
        Current internal radii, mm.
    c, k1 : float
        Stiffness of the matrix and of the fibres, kPa.
    k2 : float
        Rate of stiffening of the fibres.

    Returns
    -------
    numpy.ndarray, shape (n,)
        Pressures, mmHg.

    Examples
    --------
    >>> pressure(np.array([8.0, 10.0]), c=55.0, k1=24.0, k2=2.0).round(1).tolist()
    [51.8, 155.9]
    """
    nodes, weights = np.polynomial.legendre.leggauss(64)
    half_wall = (OUTER_RADIUS - INNER_RADIUS) / 2
    reference = INNER_RADIUS + half_wall * (nodes + 1)
    current = np.sqrt(internal_radius[:, None] ** 2 + reference**2 - INNER_RADIUS**2)
    stretch = current / reference

    cosine2 = np.cos(FIBRE_ANGLE) ** 2
    fibre_strain = np.maximum((stretch**2 - 1) * cosine2, 0.0)  # I4 - 1 at axial stretch 1
    matrix = c * (stretch - stretch**-3)
    fibres = 4 * k1 * fibre_strain * np.exp(k2 * fibre_strain**2) * stretch * cosine2
    return ((matrix + fibres) / current) @ (half_wall * weights) / mmHg


def simulate() -> pd.DataFrame:
    """Simulate the whole study.

    Returns
    -------
    pandas.DataFrame
        One row a point: group, specimen, experiment, radius_mm, pressure_mmHg, inner_radius_mm,
        outer_radius_mm.

    Examples
    --------
    >>> len(simulate())
    300
    """
    rng = np.random.RandomState(SEED)
    correlate = np.linalg.cholesky(CORRELATION)
    experiments = []
    for group, specimens in CLASSES.items():
        for specimen in specimens:
            of_specimen = np.log(MEDIANS[group]) + SPECIMEN_SD * (correlate @ rng.normal(size=3))
            for experiment in EXPERIMENTS:
                log_parameters = of_specimen + EXPERIMENT_SD * (correlate @ rng.normal(size=3))
                radius, reading = _inflate(rng, *np.exp(log_parameters))
                experiments.append(
                    pd.DataFrame(
                        {
                            "group": group,
                            "specimen": specimen,
                            "experiment": experiment,
                            "radius_mm": radius,
                            "pressure_mmHg": reading,
                            "inner_radius_mm": INNER_RADIUS,
                            "outer_radius_mm": OUTER_RADIUS,
                        }
                    )
                )
    return pd.concat(experiments, ignore_index=True)


def _inflate(
    rng: np.random.RandomState, c: float, k1: float, k2: float
) -> tuple[np.ndarray, np.ndarray]:
    """Inflate one tube in equal steps of volume; return radii (mm) and pressures (mmHg)."""
    first = INNER_RADIUS + rng.uniform(0.04, 0.14)
    final_pressure = rng.normal(FINAL_PRESSURE, FINAL_PRESSURE_SD)
    grid = np.linspace(first, 12.0, 2000)
    last = np.interp(final_pressure, pressure(grid, c, k1, k2), grid)

    progress = np.linspace(0.0, 1.0, N_POINTS)
    radius = np.sqrt(first**2 + progress * (last**2 - first**2)).round(3)

    # Smooth errors that start at zero: the gauge is zeroed at the start, and then drifts.
    drift = sum(
        rng.normal(scale=DRIFT_SD / order) * np.sin((order - 0.5) * np.pi * progress)
        for order in (1, 2, 3)
    )
    noise = rng.normal(scale=READING_SD, size=N_POINTS)
    return radius, (pressure(radius, c, k1, k2) + drift + noise).round(1)


def csv_text() -> str:
    """Return the content of ``simulated_sheep_aorta.csv``.

    Returns
    -------
    str
        A comment line about the file, the column names, and the points.

    Examples
    --------
    >>> csv_text()[:11]
    '# SIMULATED'
    """
    frame = simulate()
    frame["radius_mm"] = frame["radius_mm"].map("{:.3f}".format)
    frame["pressure_mmHg"] = frame["pressure_mmHg"].map("{:.1f}".format)
    comment = "# SIMULATED by simulate_sheep_aorta.py from a two-fibre material: not measured.\n"
    return comment + frame.to_csv(index=False, lineterminator="\n")


if __name__ == "__main__":
    PATH.write_text(csv_text(), encoding="utf-8", newline="\n")
    print(f"wrote {PATH}")
