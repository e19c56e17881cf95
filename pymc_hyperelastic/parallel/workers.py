"""Workers that compute batches: this process, other processes of this machine, or a cluster."""

import asyncio
import os
import pickle
import signal
import sys
import threading
import time
from abc import ABC, abstractmethod
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from functools import cache
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any

import cloudpickle
from loky import ProcessPoolExecutor
from loky.backend.resource_tracker import ensure_running

from pymc_hyperelastic.parallel.work import Part, Work, run_batch

# Seconds for which a cluster may be without any worker: it may be about to start some.
_PATIENCE = 60.0
#: Seconds between two checks that the other processes still run.
LOOK = 2.0
# Libraries that would start threads of their own in each process.
_THREADS = ("OMP", "OPENBLAS", "MKL", "NUMBA", "VECLIB_MAXIMUM", "NUMEXPR")


class WorkerDied(Exception):
    """A number of processes died, one after another, while they computed a batch."""

    def __init__(self, how: str, deaths: int = 1) -> None:
        super().__init__(how)
        self.deaths = deaths


class WorkersLost(OSError):
    """No worker can start, or a cluster no longer answers."""


class Workers(ABC):
    """Workers that compute batches."""

    count = 1

    @abstractmethod
    def submit(self, data: Any, part: Part) -> Future:
        """Submit a batch. The result of the future is the answer of the work."""

    def check(self) -> None:
        """Raise if no worker is left: by default a worker that dies is replaced."""

    def close(self) -> None:
        """Stop the processes that this object has started."""


class ThisProcess(Workers):
    """The process that asks, which does a batch when it is submitted."""

    def __init__(self, work: Work, token: str) -> None:
        self._work, self._token = work, token

    def submit(self, data: Any, part: Part) -> Future:
        """Do a batch."""
        future: Future = Future()
        try:
            future.set_result(run_batch(self._work, self._token, data, part))
        except Exception as error:
            future.set_exception(error)
        return future


class Processes(Workers):
    """Worker processes of this machine.

    Each is the only one of its executor: if it dies, its batch is known, and another one takes its
    place. It has one thread for linear algebra.
    """

    def __init__(self, work: Work, count: int) -> None:
        self.count = count
        self._work = cloudpickle.dumps(work)
        self._own, self._all = threading.local(), set[ProcessPoolExecutor]()
        self._threads = ThreadPoolExecutor(count)
        self._closed = False
        _start_trackers()

    def submit(self, data: Any, part: Part) -> Future:
        """Let the next free worker do a batch."""
        return self._threads.submit(self._do, data, part)

    def close(self) -> None:
        """Stop all workers."""
        self._closed = True
        for executor in list(self._all):
            executor.shutdown(kill_workers=True)
        self._threads.shutdown(cancel_futures=True)

    def _do(self, data: Any, part: Part) -> Any:
        executor = getattr(self._own, "executor", None) or self._start()
        try:
            return executor.submit(_run_sent, data, part).result()
        except BrokenProcessPool as died:
            self._own.executor = None
            self._all.discard(executor)
            raise WorkerDied(str(died.__cause__ or died)) from None

    def _start(self) -> ProcessPoolExecutor:
        """Start the worker of this thread."""
        if self._closed:
            raise WorkerDied("it was stopped")
        # Import nothing from the current folder, which may be somebody else's.
        env = {"PYTHONSAFEPATH": "1", **{f"{name}_NUM_THREADS": "1" for name in _THREADS}}
        known = {"paths": _search_path(), "work": self._work, "parent": os.getpid()}
        executor = ProcessPoolExecutor(1, env=env, initializer=exec, initargs=(_SET_UP, known))
        self._all.add(executor)
        self._own.executor = executor
        try:
            executor.submit(_check_work).result()
        except Exception as error:
            raise WorkersLost(f"no worker process can start: {error}") from error
        return executor


def _start_trackers() -> None:
    """Start the processes that clean up semaphores, without modules of the current folder."""
    before = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        ensure_running()
        resource_tracker.ensure_running()
    finally:
        if before is None:
            del os.environ["PYTHONSAFEPATH"]
        else:
            os.environ["PYTHONSAFEPATH"] = before


# Code that a worker process runs first, also a process by which loky replaces another. It searches
# modules in the paths of this process, and in the current folder last.
_SET_UP = """
import sys
sys.path[:] = paths
from pymc_hyperelastic.parallel import workers
workers.set_up(work, parent)
"""
# The pickled work, in a worker process.
_sent: list[bytes] = []


def set_up(work: bytes, parent: int) -> None:
    """Set up a worker of the process `parent`."""
    # The process that asks stops its workers after an interrupt.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    _sent[:] = [work]


@cache
def _received() -> Work:
    """Return the work of this worker process."""
    return pickle.loads(_sent[0])


def _check_work() -> None:
    """Raise what keeps the work from being received."""
    _received()


def _end_with(parent: int) -> None:
    """End this process when the one that started it has been killed."""
    while os.getppid() == parent:
        time.sleep(LOOK)
    os._exit(1)


def _run_sent(data: Any, part: Part) -> Any:
    return run_batch(_received(), "here", data, part)


def _search_path() -> list[str]:
    """Return where workers look for modules: relative paths, as the current folder, come last."""
    absolute = [path for path in sys.path if os.path.isabs(path)]
    return absolute + [os.path.abspath(path) for path in sys.path if not os.path.isabs(path)]


class Cluster(Workers):
    """The workers of a Dask client; the data of a batch go there, and its part is written there.

    A worker may have several batches when it dies. Notes beside the parts say which of them it had
    begun.
    """

    def __init__(self, work: Work, token: str, client: Any) -> None:
        self._client, self._token = client, token
        self.count = max(1, sum(client.nthreads().values()))
        self._pickled = cloudpickle.dumps(work)
        self._work = self._there()
        self._futures: set[Any] = set()
        self._seen, self._news = time.monotonic(), ()

    def _there(self) -> Any:
        """The work on the cluster.

        Dask loses scattered data with its workers, but computes the result of a task again.
        """
        return self._client.submit(pickle.loads, self._pickled, pure=False)

    def submit(self, data: Any, part: Part) -> Future:
        """Let a batch be done by some worker."""
        if self._work.status == "error":  # it was being made where a batch killed workers
            self._work = self._there()
        _begun(part.path)  # its note may be of a call before
        on_cluster = self._client.submit(
            _run_noted, self._work, self._token, data, part, pure=False
        )
        self._futures.add(on_cluster)
        return asyncio.run_coroutine_threadsafe(
            self._result(on_cluster, part.path), self._client.loop.asyncio_loop
        )

    def check(self) -> None:
        """Raise if the cluster has had no worker for long."""
        try:
            there, news = bool(self._client.nthreads()), self._client.get_events("all")[-1:]
        except Exception as lost:
            raise WorkersLost(f"the scheduler does not answer: {lost}") from lost
        # One that a batch kills as soon as it has come is hardly ever there.
        if there or news != self._news:
            self._seen, self._news = time.monotonic(), news
        elif time.monotonic() - self._seen > _PATIENCE:
            raise WorkersLost(f"the cluster has had no worker for {_PATIENCE:.0f} s")

    def close(self) -> None:
        """Cancel unfinished batches."""
        with suppress(Exception):
            self._client.cancel(list(self._futures))
        self._futures.clear()

    async def _result(self, on_cluster: Any, part: Path) -> Any:
        """Return the answer of a batch; Dask repeats a batch whose answer was lost."""
        from distributed import KilledWorker
        from distributed.comm import CommClosedError

        try:
            return await self._client.gather(on_cluster, asynchronous=True)
        except KilledWorker:
            # A cluster has tried again by itself. A batch that none of them had begun is counted
            # once, or it would be tried for ever.
            deaths = max(1, _begun(part))
            raise WorkerDied("workers of the cluster were killed, or ended", deaths) from None
        except (CancelledError, CommClosedError) as lost:
            raise WorkersLost("the cluster was lost, or its scheduler started again") from lost
        finally:
            self._futures.discard(on_cluster)


def _note(part: Path) -> Path:
    """A file as long as the number of times that a batch was begun and did not end."""
    return part.with_suffix(".begun")


def _run_noted(work: Work, token: str, data: Any, part: Part) -> Any:
    """Do a batch, and leave a note that it was begun if the process dies."""
    with suppress(OSError), _note(part.path).open("a") as note:
        note.write(".")
    try:
        return run_batch(work, token, data, part)
    finally:
        _note(part.path).unlink(missing_ok=True)


def _begun(part: Path) -> int:
    """How often a batch was begun and did not end; its note is taken away."""
    try:
        return _note(part).stat().st_size
    except FileNotFoundError:
        return 0
    finally:
        _note(part).unlink(missing_ok=True)
