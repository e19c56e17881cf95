"""Time and accuracy of the evidence by each peer, and how the cost of this package grows.

Costs grow with the number of points, of particles and of new experiments.
"""

import json
import os
import subprocess
import sys
from functools import cache
from itertools import count
from pathlib import Path

import numpy as np
import peers
import pymc as pm
import pytest
from known_problem import ALPHA, LOG_EVIDENCE, MU, SIGMA, SLOPE_WEIGHT, simulate
from peers import CHAINS, DRAWS, PEERS, Evidence

import pymc_hyperelastic as ph
from pymc_hyperelastic.evidence.batched import BatchedFunction

SEED = 100
# Nats. A peer with a larger error does not solve the problem, so that its time is not compared.
TOLERANCE = 1.0
# Particles of a run that only compiles.
FEW = 100
POINTS = (60, 600, 6_000, 60_000)
PARTICLES = (500, 1000, 2000, 4000, 8000)
NEW_EXPERIMENTS = (10, 100, 1000)
LIKELIHOOD = ph.SlopeAugmented(SIGMA, SLOPE_WEIGHT)
# Modulus and exponent of two classes that differ enough to classify most curves.
CLASSES = {"soft": (45.0, 7.5), "stiff": (60.0, 8.0)}


def report(benchmark, peer, evidences):
    """Check that the peer solves the problem, and store how accurate it is."""
    add_accuracy(benchmark, evidences)
    assert max(map(abs, benchmark.extra_info["error"])) < TOLERANCE
    benchmark.extra_info["title"] = peer.title


# By chance, one run in a hundred is called doubtful.
@pytest.mark.filterwarnings("ignore:the evidence is doubtful")
@pytest.mark.parametrize("name", PEERS)
def test_repeated_run_of_each_package(benchmark, name):
    """Run a peer in a session in which it has been compiled before."""
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
def test_first_run_of_each_package_in_a_new_process(benchmark, name, tmp_path):
    """Run a peer in a new Python process with an empty compile cache."""
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


def priors():
    return {"mu": pm.Uniform.dist(*MU), "alpha": pm.Uniform.dist(*ALPHA)}


@cache
def data_of(points):
    """Six experiments of many points; slopes of dense noisy points would drown in noise."""
    rng = np.random.default_rng(SEED)
    curves = simulate(rng, 45.0, 7.5, specimens=3, experiments=2, points=points // 6, noise=0.0)
    return peers.as_inflation_data(curves)


@cache
def model_of(points):
    return ph.ogden_model(data_of(points), LIKELIHOOD, priors=priors())


@pytest.mark.parametrize("points", POINTS)
def test_building_a_model_by_number_of_points(benchmark, points):
    """Build a model."""
    data = data_of(points)
    benchmark.group = "model by points"
    benchmark.pedantic(
        lambda: ph.ogden_model(data, LIKELIHOOD, priors=priors()), rounds=5, warmup_rounds=1
    )


@pytest.mark.parametrize("points", POINTS)
def test_log_density_by_number_of_points(benchmark, points):
    """Evaluate the log density at one point, by PyMC's default compiler."""
    model = model_of(points)
    logp, point = model.compile_logp(), model.initial_point()
    benchmark.group = "logp by points"
    benchmark.pedantic(logp, (point,), rounds=20, iterations=50, warmup_rounds=1)


@pytest.mark.parametrize("points", POINTS)
def test_batched_log_density_by_number_of_points(benchmark, points):
    """Evaluate the log density at 2000 particles."""
    model = model_of(points)
    score = BatchedFunction.of_model(model, [model.logp()])
    particles = np.random.default_rng(SEED).standard_normal((2000, 2))
    benchmark.group = "score by points"
    benchmark.pedantic(score, (particles,), rounds=20, warmup_rounds=1)


@pytest.mark.parametrize("points", POINTS)
def test_sampling_by_number_of_points(benchmark, points):
    """Sample a model that is built, 2 chains of 2000 particles, parameters kept."""
    model, seeds, trees = model_of(points), count(1), []
    sample(model, 500, seed=0)
    benchmark.group = "sampling by points"
    benchmark.pedantic(lambda: trees.append(sample(model, 2000, seed=next(seeds))), rounds=5)
    add_evidences(benchmark, trees, ph.log_evidence_by_quadrature(model).value)
    benchmark.extra_info["stages"] = trees[0]["sample_stats"].sizes["stage"]


@pytest.mark.parametrize("particles", PARTICLES)
def test_sampling_by_number_of_particles(benchmark, particles):
    """Sample the known problem, 2 chains, parameters kept."""
    model, seeds, trees = peers.known_model(), count(1), []
    sample(model, 500, seed=0)
    benchmark.group = "sampling by particles"
    benchmark.pedantic(lambda: trees.append(sample(model, particles, seed=next(seeds))), rounds=5)
    add_evidences(benchmark, trees, LOG_EVIDENCE)


def sample(model, draws, seed):
    return ph.sample_smc(
        model, draws, 2, random_seed=seed, progressbar=False, var_names=["mu", "alpha"]
    )


def add_evidences(benchmark, trees, truth):
    add_accuracy(benchmark, [ph.log_evidence(tree) for tree in trees], truth)


def add_accuracy(benchmark, estimates, truth=LOG_EVIDENCE):
    """Put the accuracy beside the time."""
    benchmark.extra_info |= {
        "log_evidence": [estimate.value for estimate in estimates],
        "standard_error": [estimate.standard_error for estimate in estimates],
        "error": [estimate.value - truth for estimate in estimates],
    }


@pytest.fixture(scope="module")
def fitted_classes():
    rng = np.random.default_rng(SEED)
    training = {
        name: peers.as_inflation_data(simulate(rng, *center, specimens=3, experiments=2))
        for name, center in CLASSES.items()
    }
    settings = {"draws": 2000, "chains": 2, "random_seed": SEED, "progressbar": False}
    return ph.fit_classes(ph.Ogden(), training, LIKELIHOOD, priors=priors(), **settings)


@pytest.mark.parametrize("experiments", NEW_EXPERIMENTS)
def test_classification_by_number_of_experiments(benchmark, experiments, fitted_classes):
    """Classify new experiments, half from each class, against 2 chains of 2000 particles."""
    rng = np.random.default_rng(SEED + 1)
    curves = [
        curve
        for center in CLASSES.values()
        for curve in simulate(rng, *center, specimens=experiments // 2, experiments=1)
    ]
    new = peers.as_inflation_data(curves)
    ph.classify(ph.select(new, specimen="S0"), fitted_classes, random_seed=0, progressbar=False)
    benchmark.group = "classification"
    result = benchmark.pedantic(
        lambda: ph.classify(new, fitted_classes, random_seed=1, progressbar=False), rounds=1
    )
    right = np.repeat(list(CLASSES), experiments // 2)
    assigned = result["class_probability"].idxmax("class_label").values
    benchmark.extra_info["standard_error"] = float(result["log_evidence_se"].median())
    benchmark.extra_info["right"] = float(np.mean(assigned == right))
