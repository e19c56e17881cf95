"""Cohorts on a Dask cluster whose workers and scheduler may die."""

import asyncio
import operator
import os
import signal
import subprocess
import sys
import threading

import pytest
import simulated_work
import xarray as xr
from simulated_work import POLL, SimulatedWork, computed, wait_for

import pymc_hyperelastic as ph
from pymc_hyperelastic.io.store import Part
from pymc_hyperelastic.parallel.workers import Cluster, WorkersLost

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("distributed")

# Connections of Dask to processes that were killed end in warnings where no test can catch them.
pytestmark = [pytest.mark.deep, pytest.mark.filterwarnings("ignore")]

PYTHONPATH = (
    os.path.dirname(simulated_work.__file__) + os.pathsep + os.environ.get("PYTHONPATH", "")
)
# A slow computer must not lose a worker that starts again.
PATIENT = {
    "distributed.deploy.lost-worker-timeout": "10 days",
    "distributed.scheduler.worker-ttl": None,
}


@pytest.fixture
def cluster(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", PYTHONPATH)
    settings = {"threads_per_worker": 1, "dashboard_address": None, "n_workers": 2}
    with dask.config.set(PATIENT), distributed.LocalCluster(**settings) as found:
        yield found


def test_killed_workers_are_replaced(cluster, data, undisturbed, tmp_path):
    """Two die while they compute a batch; S5 kills every worker, but not its other batches."""
    work = SimulatedWork(kills_once=("S2", "S11"), kills=("S5",), folder=tmp_path)
    with distributed.Client(cluster) as client:
        result = computed(work, data, tmp_path / "store", batch_size=1, client=client)
    assert work.note("S2").exists() and work.note("S11").exists()
    assert result["error"].sel(specimen="S5").item().startswith("the process that computed it died")
    assert not [*(tmp_path / "store").glob("*.begun")]
    others = result["specimen"] != "S5"
    assert result.sel(specimen=others).equals(undisturbed.sel(specimen=others))


def test_results_lost_with_their_worker_are_computed_again(cluster, data, tmp_path, monkeypatch):
    """The work object is sent again if its first transfer failed, as with a killed worker."""

    async def until(condition):
        while not condition():
            await asyncio.sleep(POLL)

    with distributed.Client(cluster) as client:
        gather = client.gather

        async def gather_after_deaths(future, asynchronous):
            await until(lambda: future.status == "finished")
            for worker in cluster.workers.values():
                os.kill(worker.pid, signal.SIGKILL)
            await until(lambda: future.status != "finished")
            return await gather(future, asynchronous=asynchronous)

        workers = Cluster(SimulatedWork(raises=("S5",)), "token", client)
        workers._work = client.submit(operator.truediv, 1, 0)
        distributed.wait(workers._work)
        monkeypatch.setattr(client, "gather", gather_after_deaths)
        failed = workers.submit(data, Part(tmp_path / "part.nc", "hash")).result()
    assert failed.failed == {"S5": "no curve"}


@pytest.mark.parametrize("processes", [True, False])
def test_workers_with_two_threads_give_the_same_numbers_as_one_process(processes, tmp_path):
    """Compiled functions keep their input between two steps: two threads could mix specimens."""
    data = ph.load_dataset("simulated_sheep_aorta")
    settings = {"by": "test", "draws": 50, "random_seed": 1, "progressbar": False}

    def fitted(name, **how):
        store = ph.Store(tmp_path / name, batch_size=1, **how)
        return ph.fit_cohort(ph.Ogden(), data, 0.5, store, **settings).load()

    workers = {"n_workers": 1, "threads_per_worker": 2, "processes": processes}
    with distributed.LocalCluster(**workers, dashboard_address=None) as cluster:
        with distributed.Client(cluster) as client:
            found = fitted("threads", client=client)
    xr.testing.assert_identical(found, fitted("series", cores=1))
    assert found["evidence"]["error"].values.tolist() == [""] * data.sizes["test"]


def test_cluster_without_workers_raises_an_error(data, tmp_path, monkeypatch):
    monkeypatch.setattr("pymc_hyperelastic.parallel.workers._PATIENCE", 1.0)
    monkeypatch.setattr("pymc_hyperelastic.parallel.run.LOOK", 0.2)
    with distributed.LocalCluster(n_workers=0, dashboard_address=None) as nobody:
        with distributed.Client(nobody) as client:
            with pytest.raises(WorkersLost, match=r"no worker for 1 s\. Finished batches are in"):
                computed(SimulatedWork(), data, tmp_path / "store", client=client)


SCHEDULER = """
import distributed, time
if __name__ == "__main__":
    cluster = distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None)
    print(cluster.scheduler_address, flush=True)
    while True:
        time.sleep(1)
"""


def connected(address):
    """Return a client, however long the scheduler takes to answer."""
    while True:
        try:
            # This is also the time for which a client tries to reach a lost scheduler again.
            return distributed.Client(address, timeout=5)
        except OSError:
            continue


def test_lost_scheduler_raises_an_error_and_finished_batches_are_kept(data, undisturbed, tmp_path):
    """The scheduler is killed while specimen S3 is computed."""
    (tmp_path / "scheduler.py").write_text(SCHEDULER)
    work = SimulatedWork(waits=("S3",), folder=tmp_path)
    command = [sys.executable, str(tmp_path / "scheduler.py")]
    settings = {"stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen(
        command, env=os.environ | {"PYTHONPATH": PYTHONPATH}, **settings
    ) as scheduler:

        def kill():
            wait_for(work.note("S3").exists, scheduler)
            scheduler.kill()

        with connected(scheduler.stdout.readline().strip()) as client:
            killer = threading.Thread(target=kill)
            killer.start()
            with pytest.raises(WorkersLost, match="the same call continues"):
                computed(work, data, tmp_path / "store", batch_size=1, client=client)
            killer.join()
    result = computed(SimulatedWork(), data, tmp_path / "store", batch_size=3)
    assert result.identical(undisturbed)
