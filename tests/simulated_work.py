"""A cohort, and fast simulated work on it that fails, dies or waits at chosen specimens."""

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pandas as pd
import xarray as xr

import pymc_hyperelastic as ph
from pymc_hyperelastic.data.select import tests_at, units_of
from pymc_hyperelastic.io.batches import UnitWork, labels_of, run_in_batches, warn_of

SPECIMENS = 20
# Seconds between two looks whether a condition holds.
POLL = 0.01


def cohort(specimens: int = SPECIMENS, seed: int = 1) -> xr.Dataset:
    """Return specimens with two tests each; the curves are random numbers."""
    rng = np.random.default_rng(seed)
    radius = np.linspace(7.1, 9.0, 5)
    frames = []
    for specimen in range(specimens):
        for experiment in (1, 2):
            labels = {"specimen": f"S{specimen}", "experiment": experiment}
            pressure = (radius - 7) * rng.uniform(4, 6) + 0.1 * rng.standard_normal(5)
            frames.append(pd.DataFrame(labels | {"radius": radius, "pressure": pressure}))
    return ph.inflation_data(pd.concat(frames), ph.Tube(7.0, 9.0), check="ignore")


@dataclass(frozen=True)
class SimulatedWork(UnitWork):
    """The sum of the pressures of each specimen.

    The work raises an error at `raises`, and kills its process at `kills` and, once, at
    `kills_once`. At `waits` it leaves a note in `folder`, and waits for the end of its parent.
    """

    name: ClassVar[str] = "simulated"

    by: str = "specimen"
    raises: tuple[str, ...] = ()
    kills: tuple[str, ...] = ()
    kills_once: tuple[str, ...] = ()
    waits: tuple[str, ...] = ()
    folder: Path = Path()
    factor: float = 1.0

    def manifest(self):
        return {"factor": self.factor, "random_seed": 1}

    def prepare(self):
        return self.run

    def note(self, label: str) -> Path:
        """Return the file that exists once the work has begun at this specimen."""
        return self.folder / f"{label}.note"

    def run(self, data):
        units = units_of(data, self.by)
        for label in units:
            first = not self.note(label).exists()
            if label in self.waits + self.kills_once:
                self.note(label).touch()
            if label in self.kills or (label in self.kills_once and first):
                os.kill(os.getpid(), signal.SIGKILL)
            if label in self.raises:
                raise ValueError("no curve")
            parent = os.getppid()
            while label in self.waits and os.getppid() == parent:
                time.sleep(POLL)
        totals = [self.factor * tests_at(data, t)["pressure"].values.sum() for t in units.values()]
        variables = {
            "total": (self.by, totals),
            "text": (self.by, [f"{total:.1f}" for total in totals]),
            "pair": (("of_two", self.by), np.array([totals, totals]), {"units": "kPa"}),
            "error": (self.by, [""] * len(units)),
            "common": ("of_two", [1.0, 2.0]),
        }
        return xr.Dataset(variables, labels_of(data, self.by), {"strain_energy": "none"})


def computed(work: SimulatedWork, data: xr.Dataset, folder: Path, **settings) -> xr.Dataset:
    """Run the work on a cohort in this process, unless settings say otherwise; read the result."""
    store = ph.Store(folder, **({} if "client" in settings else {"cores": 1}) | settings)
    remarks = run_in_batches(work, work.manifest(), data, store, progressbar=False)
    warn_of(remarks, len(units_of(data, work.by)))
    result = ph.open_result(folder).load()
    assert list(remarks.failed.values()) == [text for text in result["error"].values if text]
    return result


def wait_for(condition, process) -> None:
    """Wait, without a limit, until a condition holds; fail if the process ends before."""
    while not condition():
        assert process.poll() is None, "the process ended too early"
        time.sleep(POLL)
