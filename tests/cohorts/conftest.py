"""Cheap work, by which it is seen how a cohort is done, and specimens to do it with."""

import numpy as np
import pandas as pd
import pytest

import pymc_hyperelastic as ph

SPECIMENS = 20


def cohort(specimens: int = SPECIMENS, seed: int = 1):
    """Specimens with two experiments each, which are no tubes of any material."""
    rng = np.random.default_rng(seed)
    radius = np.linspace(7.1, 9.0, 5)
    frames = [
        pd.DataFrame(
            {
                "specimen": f"S{specimen}",
                "experiment": experiment,
                "group": f"G{specimen % 2}",
                "radius": radius,
                "pressure": (radius - 7) * rng.uniform(4, 6) + 0.1 * rng.standard_normal(5),
            }
        )
        for specimen in range(specimens)
        for experiment in (1, 2)
    ]
    return ph.inflation_data(pd.concat(frames), inner_radius=7.0, outer_radius=9.0, check="ignore")


@pytest.fixture(scope="session")
def data():
    return cohort()
