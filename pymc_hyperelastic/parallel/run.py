"""Run batches on workers: replace what dies, and find the unit that kills its process."""

import os
import uuid
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import Any, NamedTuple

from pymc_hyperelastic.parallel.work import Part, Work
from pymc_hyperelastic.parallel.workers import (
    LOOK,
    Cluster,
    Processes,
    ThisProcess,
    WorkerDied,
    Workers,
)


class Batch(NamedTuple):
    """Units from one number to before another, and how many processes died of them."""

    first: int
    last: int
    deaths: int = 0

    @property
    def size(self) -> int:
        """Number of units."""
        return self.last - self.first

    def halves(self) -> list["Batch"]:
        """Return both halves, without deaths."""
        middle = (self.first + self.last) // 2
        return [Batch(self.first, middle), Batch(middle, self.last)]


def workers_for(work: Work, client: Any, cores: int | None, batches: int) -> Workers:
    """Return workers: those of a Dask client, or as many processes as are useful."""
    token = uuid.uuid4().hex
    if client is not None:
        return Cluster(work, token, client)
    count = min(cores or _cores(), batches)
    return ThisProcess(work, token) if count == 1 else Processes(work, count)


def run_batches[Answer](
    todo: deque[Batch],
    workers: Workers,
    data_of: Callable[[Batch], Any],
    part_of: Callable[[Batch], Part],
    give_up: Callable[[Batch, str], Answer],
) -> Iterator[tuple[Batch, Answer]]:
    """Yield each finished batch with the answer of its work.

    A batch whose process dies is tried again, and then halved.

    Parameters
    ----------
    todo : deque of Batch
        The batches.
    workers : Workers
        Who computes them.
    data_of, part_of : callable
        Data and part of a batch.
    give_up : callable
        Function of a batch of one unit of which several processes died, and of the reason. Its
        value is the answer.
    """
    running: dict[Future, Batch] = {}
    while todo or running:
        # One batch waits at the workers for each batch that is being computed.
        while todo and len(running) < 2 * workers.count:
            batch = todo.popleft()
            running[workers.submit(data_of(batch), part_of(batch))] = batch
        finished = wait(running, LOOK, FIRST_COMPLETED).done
        if not finished:
            workers.check()
        for future in finished:
            batch = running.pop(future)
            try:
                answer = future.result()
            except WorkerDied as died:
                again = batch._replace(deaths=batch.deaths + died.deaths)
                if again.deaths < 3:  # three deaths at one batch are hardly chance
                    todo.appendleft(again)
                    continue
                if batch.size > 1:
                    todo.extendleft(reversed(batch.halves()))
                    continue
                said = f"the process that computed it died {again.deaths} times: {died}"
                answer = give_up(again, said)
            yield batch, answer


def _cores() -> int:
    """Return the number of cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on every system
        return os.cpu_count() or 1
