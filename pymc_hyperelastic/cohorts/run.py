"""Do the work of a cohort in batches, and keep finished batches."""

import os
import uuid
import warnings
from collections import deque
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from pymc.progress_bar import create_simple_progress

from pymc_hyperelastic.cohorts.work import DOUBTFUL, Remarks, Work, failure, labels_of
from pymc_hyperelastic.cohorts.workers import DEATHS, WorkerDied, Workers, workers_for
from pymc_hyperelastic.data.select import tests_at, units_of
from pymc_hyperelastic.evidence.checks import check_count
from pymc_hyperelastic.io.atomic import remove_abandoned
from pymc_hyperelastic.io.checksum import digests_of
from pymc_hyperelastic.io.store import Store
from pymc_hyperelastic.messages import PACKAGE

# Batches that wait at the workers for each that is being done.
_WAITING = 2
# Seconds without news after which it is looked whether anybody is still there.
_LOOK = 5.0
#: Units of a cohort by their numbers, at the end of names of parts.
UNITS = "units"
# Attribute of a part that could not be computed because processes died. It may not have been its
# fault, and the next call tries it again.
_DIED = "processes_that_died"


class Batch(NamedTuple):
    """Units from one number to before another, and how many processes died of them."""

    first: int
    last: int
    deaths: int = 0

    @property
    def part(self) -> str:
        """Name of its part of the store."""
        return f"{self.first:09d}-{self.last:09d}"

    def halves(self) -> list["Batch"]:
        """Return both halves, without deaths."""
        middle = (self.first + self.last) // 2
        return [Batch(self.first, middle), Batch(middle, self.last)]


def run_cohort(
    work: Work,
    data: xr.Dataset,
    folder: str | Path,
    *,
    client: Any = None,
    cores: int | None = None,
    batch_size: int = 64,
    progressbar: bool = True,
) -> None:
    """Compute the missing batches of a cohort; see :func:`~pymc_hyperelastic.fit_cohort`."""
    check_count("batch_size", batch_size, 1)
    if cores is not None:
        check_count("cores", cores, 1)
    units = units_of(data, work.by)
    manifest = work.manifest() | digests_of({"data": data})
    store = Store(folder, {"work": work.name, "by": work.by, "units": len(units), **manifest})
    store.remember(UNITS, lambda: xr.Dataset(coords=labels_of(data, work.by)))
    todo = deque(_missing(store, len(units), batch_size))
    if not todo:
        return
    cores = min(cores or _cores(), len(todo))
    workers = workers_for(work, uuid.uuid4().hex, client, cores)
    tests, remarks = [*units.values()], Remarks([], [])

    def of(batch: Batch) -> xr.Dataset:
        return tests_at(data, np.sort(np.concatenate(tests[batch.first : batch.last])))

    with (progress := create_simple_progress(progressbar)):
        bar = progress.add_task(work.name, completed=0, total=len(units))
        progress.update(bar, completed=len(units) - sum(b.last - b.first for b in todo))
        try:
            for batch, said in _done(todo, workers, store, of, work.by):
                remarks.failed.extend(said.failed)
                remarks.doubtful.extend(said.doubtful)
                progress.advance(bar, batch.last - batch.first)
        except OSError as error:
            raise type(error)(
                f"{error}. Finished batches are in {store.folder}: the same call continues"
            ) from error
        except KeyboardInterrupt:
            warnings.warn(
                f"interrupted: finished batches are in {store.folder}; the same call continues",
                skip_file_prefixes=(PACKAGE,),
            )
            raise
        finally:
            workers.close()
            if client is None:  # a worker of a cluster may still write, on a disk without locks
                remove_abandoned(store.folder)
    for words, name, kind in (
        (remarks.failed, "error", "failed"),
        (remarks.doubtful, DOUBTFUL, "have a doubtful fit"),
    ):
        if words:
            warnings.warn(
                f"{len(words)} of {len(units)} {kind}: see {name!r} of the result; the first is "
                f"{words[0]}",
                skip_file_prefixes=(PACKAGE,),
            )


def _done(
    todo: deque[Batch], workers: Workers, store: Store, of: Any, by: str
) -> Iterator[tuple[Batch, Remarks]]:
    """Yield each finished batch with its remarks.

    A batch whose process dies is tried again, and then halved.
    """
    running: dict[Future, Batch] = {}
    while todo or running:
        while todo and len(running) < _WAITING * workers.count:
            batch = todo.popleft()
            running[workers.submit(of(batch), store.of_part(batch.part))] = batch
        finished = wait(running, _LOOK, FIRST_COMPLETED).done
        if not finished:
            workers.check()
        for future in finished:
            batch = running.pop(future)
            try:
                remarks = future.result()
            except WorkerDied as died:
                again = batch._replace(deaths=batch.deaths + died.deaths)
                if again.deaths < DEATHS:
                    todo.appendleft(again)
                    continue
                if batch.last - batch.first > 1:
                    todo.extendleft(reversed(batch.halves()))
                    continue
                said = f"the process that computed it died {again.deaths} times: {died}"
                row = failure(of(batch), by, said).assign_attrs({_DIED: again.deaths})
                store.of_part(batch.part).save(row)
                failed = [f"{label}: {said}" for label in units_of(of(batch), by)]
                remarks = Remarks(failed, [])
            yield batch, remarks


def _missing(store: Store, units: int, batch_size: int) -> list[Batch]:
    """Batches of the units of which the store has no part."""
    there = np.zeros(units, bool)
    for batch in parts_of(store.folder):
        kept = store.kept(Batch(*batch).part)
        there[slice(*batch)] = kept is not None and _DIED not in kept.attrs
    lacking = np.flatnonzero(~there)
    runs = np.split(lacking, np.flatnonzero(np.diff(lacking) > 1) + 1)
    return [
        Batch(first, min(first + batch_size, int(run[-1]) + 1))
        for run in runs
        if run.size
        for first in range(int(run[0]), int(run[-1]) + 1, batch_size)
    ]


def parts_of(folder: Path) -> list[tuple[int, int]]:
    """First and last number of the units of each part of a store, none of them twice."""
    names = [path.stem.split("-") for path in folder.glob("?????????-?????????.nc")]
    ends = [(int(first), int(last)) for first, last in names if (first + last).isdigit()]
    kept: list[tuple[int, int]] = []
    # Take the longest of several parts that begin at the same unit. Parts overlap if a process that
    # outlived its driver has written units that another process has computed again.
    for first, last in sorted(ends, key=lambda pair: (pair[0], -pair[1])):
        if not kept or first >= kept[-1][1]:
            kept.append((first, last))
    return kept


def _cores() -> int:
    """Cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on every system
        return os.cpu_count() or 1
