"""Time and accuracy of the evidence of the known problem, peer by peer."""

import json
import os
import subprocess
import sys
from itertools import count
from pathlib import Path

import peers
import pytest
from peers import CHAINS, DRAWS, PEERS, Evidence

# Nats. What is further off does not solve the problem, and its time means nothing.
TOLERANCE = 1.0
# Particles of a run that is there to compile.
FEW = 100


def report(benchmark, peer, evidences):
    """Put the accuracy beside the time."""
    assert max(abs(evidence.error) for evidence in evidences) < TOLERANCE
    benchmark.extra_info |= {
        "title": peer.title,
        "log_evidence": [evidence.value for evidence in evidences],
        "standard_error": [evidence.standard_error for evidence in evidences],
        "error": [evidence.error for evidence in evidences],
    }


@pytest.mark.parametrize("name", PEERS)
def test_warm(benchmark, name):
    """In a session in which the same has been run before."""
    peer = PEERS[name]
    peer.run(draws=DRAWS if peer.compiled_for_size else FEW, chains=1, seed=0)
    seeds, evidences = count(1), []
    benchmark.group = "warm"
    benchmark.pedantic(
        lambda: evidences.append(peer.run(draws=DRAWS, chains=CHAINS, seed=next(seeds))),
        rounds=peer.rounds,
    )
    report(benchmark, peer, evidences)


@pytest.mark.parametrize("name", PEERS)
def test_cold(benchmark, name, tmp_path):
    """A whole process, from the start of Python, with nothing compiled beforehand."""
    environment = os.environ | {"PYTENSOR_FLAGS": f"base_compiledir={tmp_path}"}
    command = [sys.executable, Path(peers.__file__), name, "--seed", "11"]
    benchmark.group = "cold"
    done = benchmark.pedantic(
        lambda: subprocess.run(
            command, env=environment, check=True, capture_output=True, text=True
        ),
        rounds=1,
    )
    report(benchmark, PEERS[name], [Evidence(*json.loads(done.stdout))])
