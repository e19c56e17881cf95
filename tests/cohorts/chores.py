"""Work that costs nothing, and fails as it is told; and specimens to do it with."""

import os
import signal
import time
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pandas as pd
import xarray as xr

import pymc_hyperelastic as ph
from pymc_hyperelastic.cohorts.work import Work, labels_of
from pymc_hyperelastic.data.select import tests_at, units_of

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


@dataclass(frozen=True)
class Chore(Work):
    """The sum of a specimen's pressures, and how many of the chores before failed."""

    name: ClassVar[str] = "chore"

    by: str = "specimen"
    raises: tuple[str, ...] = ()
    kills: tuple[str, ...] = ()
    seconds: float = 0.0
    factor: float = 1.0

    def manifest(self):
        return {"factor": self.factor, "random_seed": 1}

    def prepare(self):
        return self.of

    def of(self, data):
        units = units_of(data, self.by)
        for label in units:
            if label in self.kills:
                os.kill(os.getpid(), signal.SIGKILL)
            if label in self.raises:
                raise KeyError(label)
        time.sleep(self.seconds * len(units))
        totals = [
            self.factor * float(tests_at(data, tests)["pressure"].sum()) for tests in units.values()
        ]
        variables = {
            "total": (self.by, totals),
            "text": (self.by, [f"{total:.1f}" for total in totals]),
            "pair": (("of_two", self.by), np.array([totals, totals]), {"units": "kPa"}),
            "error": (self.by, [""] * len(units)),
            "common": ("of_two", [1.0, 2.0]),
        }
        return xr.Dataset(variables, labels_of(data, self.by), {"strain_energy": "none"})
