"""The same work on a cluster, whose workers and scheduler may die."""

import asyncio
import operator
import os
import signal
import threading
import time

import numpy as np
import pytest
from chores import Chore
from test_cohorts import done

from pymc_hyperelastic.cohorts.workers import Cluster, ClusterLost

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("distributed")

# Dask's own connections, and processes that were killed, end in warnings where nobody can catch
# them.
pytestmark = [
    pytest.mark.deep,
    pytest.mark.filterwarnings("ignore"),
]


@pytest.fixture(scope="module")
def undisturbed(data, tmp_path_factory):
    return done(Chore(), data, tmp_path_factory.mktemp("undisturbed") / "store")


@pytest.fixture(params=[2])
def cluster(request):
    settings = {"threads_per_worker": 1, "dashboard_address": None}
    here = os.path.dirname(__file__)
    os.environ["PYTHONPATH"] = here + os.pathsep + os.environ.get("PYTHONPATH", "")
    # A cluster of this kind gives up a worker that is not there, again, so long after a death.
    with dask.config.set({"distributed.deploy.lost-worker-timeout": "1 hour"}):
        with distributed.LocalCluster(n_workers=request.param, **settings) as found:
            yield found


def test_a_cluster_gives_the_same_numbers(cluster, data, undisturbed, tmp_path):
    with distributed.Client(cluster) as client:
        result = done(Chore(), data, tmp_path / "store", batch_size=3, client=client)
        assert result.identical(undisturbed)


def test_killed_workers_of_a_cluster_are_replaced(cluster, data, undisturbed, tmp_path):
    """Two die at some moment; the nanny starts others, and their batches are done again."""
    rng = np.random.default_rng(1)

    def kill():
        for _ in range(2):
            time.sleep(rng.uniform(1.0, 3.0))
            workers = list(cluster.workers.values())
            os.kill(workers[rng.integers(len(workers))].pid, signal.SIGKILL)

    killer = threading.Thread(target=kill)
    with distributed.Client(cluster) as client:
        killer.start()
        chore = Chore(seconds=0.2)
        result = done(chore, data, tmp_path / "store", batch_size=1, client=client)
        killer.join()
    assert result.identical(undisturbed)


@pytest.mark.parametrize("cluster", [1, 2], indirect=True)
def test_a_specimen_that_kills_workers_stands_alone(cluster, data, undisturbed, tmp_path):
    """One worker has others too when it dies, which are not to blame."""
    with distributed.Client(cluster) as client:
        chore = Chore(kills=("S5",))
        result = done(chore, data, tmp_path / "store", batch_size=1, client=client)
    assert result["error"].sel(specimen="S5").item().startswith("the process that computed it died")
    assert not [*(tmp_path / "store").glob("*.begun")]
    others = result["specimen"] != "S5"
    assert result.sel(specimen=others).equals(undisturbed.sel(specimen=others))


def test_answers_that_die_with_their_worker_are_made_again(cluster, data, tmp_path, monkeypatch):
    """Before anybody has fetched them."""

    async def until(true):
        while not true():
            await asyncio.sleep(0.01)

    with distributed.Client(cluster) as client:
        gather = client.gather

        async def gather_late(future, asynchronous):
            await until(lambda: future.status == "finished")
            for worker in cluster.workers.values():
                os.kill(worker.pid, signal.SIGKILL)
            await until(lambda: future.status != "finished")
            return await gather(future, asynchronous=asynchronous)

        monkeypatch.setattr(client, "gather", gather_late)
        workers = Cluster(Chore(raises=("S5",)), "token", client)
        failed = workers.submit(data, tmp_path / "part.nc").result(timeout=60)
    assert failed == ["S5: KeyError: 'S5'"]


def test_work_that_could_not_be_made_is_made_again(cluster, data, tmp_path):
    """It may have been made where a batch killed workers."""
    with distributed.Client(cluster) as client:
        workers = Cluster(Chore(), "token", client)
        workers._work = client.submit(operator.truediv, 1, 0)
        distributed.wait(workers._work)
        assert workers.submit(data, tmp_path / "part.nc").result(timeout=60) == []


def test_without_workers_the_work_stops_with_a_message(data, tmp_path, monkeypatch):
    """There is a scheduler, but nobody works."""
    monkeypatch.setattr("pymc_hyperelastic.cohorts.workers._PATIENCE", 1.0)
    with distributed.LocalCluster(n_workers=0, dashboard_address=None) as nobody:
        with distributed.Client(nobody) as client:
            with pytest.raises(ClusterLost, match=r"no worker for 1 s\. What was computed is in"):
                done(Chore(), data, tmp_path / "store", client=client)


def test_without_its_scheduler_the_work_stops_with_a_message(data, undisturbed, tmp_path):
    """What was done is kept, and another cluster, or none, goes on."""
    code = (
        "import distributed, time\n"
        "if __name__ == '__main__':\n"
        "    cluster = distributed.LocalCluster(n_workers=1, threads_per_worker=1,"
        " dashboard_address=None)\n"
        "    print(cluster.scheduler_address, flush=True)\n"
        "    time.sleep(600)\n"
    )
    script = tmp_path / "scheduler.py"
    script.write_text(code)
    import subprocess
    import sys

    here = os.path.dirname(__file__)
    environment = os.environ | {"PYTHONPATH": here + os.pathsep + os.environ.get("PYTHONPATH", "")}
    with subprocess.Popen(
        [sys.executable, str(script)], stdout=subprocess.PIPE, text=True, env=environment
    ) as scheduler:
        address = scheduler.stdout.readline().strip()
        threading.Timer(6.0, scheduler.kill).start()
        with distributed.Client(address, timeout=10) as client:
            with pytest.raises(ClusterLost, match="goes on from there"):
                chore = Chore(seconds=2.0)
                done(chore, data, tmp_path / "store", batch_size=1, client=client)
    assert done(Chore(), data, tmp_path / "store", batch_size=3).identical(undisturbed)
