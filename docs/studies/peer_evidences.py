"""Compare evidences of the models in tests/evidence from this package and from other libraries.

``python peer_evidences.py results/peer_evidences.jsonl`` runs every installed sampler on every
problem, writes a line of JSON for each new run, and writes the results of all runs as the table of
the documentation page. The time includes compilation, but not imports. With ``--difficult`` the
program runs this package on the difficult models, and writes a table with a row for each kind.
"""

import argparse
import importlib.util
import json
import multiprocessing
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
from pymc.model.transform.conditioning import remove_value_transforms
from pytensor.graph.replace import clone_replace
from scipy.special import logsumexp

import pymc_hyperelastic as ph
from pymc_hyperelastic.evidence.target import Target

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "tests" / "evidence"))

from difficult_evidences import DIFFICULT  # noqa: E402
from evidences import PROBLEMS  # noqa: E402

ALL_DIFFICULT = {name: p for problems in DIFFICULT.values() for name, p in problems.items()}
# A run is right if its error is below RIGHT (nats). It is wrong if its error is above WRONG (nats)
# and above STANDARD_ERRORS times the stated error.
RIGHT, WRONG, STANDARD_ERRORS = 0.1, 0.3, 4


@dataclass(frozen=True)
class Peer:
    """A sampler: it takes a model and a seed, and returns a log evidence and its standard error.

    The optional third value is the sampler's own verdict on its accuracy.
    """

    title: str
    run: Callable[[pm.Model, int], tuple]
    seeds: int = 1
    most_unknowns: int = 500  # nested sampling, and training a flow, would take hours for more


def package(model, seed):
    tree = ph.sample_smc(model, random_seed=seed, progressbar=False)
    return *ph.log_evidence(tree), ph.diagnose_evidence(tree).attrs["verdict"]


def pymc(model, seed):
    """PyMC states no error: use the standard error of the mean over the chains."""
    tree = pm.sample_smc(model=model, chains=4, cores=1, random_seed=seed, progressbar=False)
    stages = tree["sample_stats"]["log_marginal_likelihood"].values
    chains = np.array([np.asarray(chain, float)[-1] for chain in stages])
    value = logsumexp(chains) - np.log(len(chains))
    return value, np.exp(chains - value).std(ddof=1) / np.sqrt(len(chains))


def on_cube(model):
    """Return the log likelihood as a function of independent uniform variables, and their number.

    The prior becomes a map from the unit cube: each variable, in the order of the model, is the
    inverse distribution function given its parents. Distributions without an inverse raise an
    error.
    """
    natural = remove_value_transforms(model)
    u, used, values = pt.vector("u"), 0, {}
    for rv in natural.free_RVs:
        value, size = from_uniform(rv, u[used:])
        # Parents come first, so their values are known.
        values[rv] = clone_replace(value, values)
        used += size
    logp = natural.logp([*natural.observed_RVs, *natural.potentials])
    at = {natural.rvs_to_values[rv]: value for rv, value in values.items()}
    # Values have known shapes, but slices of a vector do not.
    logp = clone_replace(logp, {v: v.type.filter_variable(value) for v, value in at.items()})
    return pytensor.function([u], logp, trust_input=True), used


def from_uniform(rv, u):
    """Return a variable as a function of uniform variables, and the number of them that it uses."""
    parameters, shape = rv.owner.op.dist_params(rv.owner), tuple(rv.shape.eval())
    size = int(np.prod(shape))
    match type(rv.owner.op).__name__:
        case "DirichletRV":
            alpha = parameters[0]
            later = pt.cumsum(alpha[::-1])[::-1][1:]
            part = pm.icdf(pm.Beta.dist(alpha[:-1], later), u[: size - 1])
            left = pt.concatenate([[1.0], pt.cumprod(1 - part)])
            return left * pt.concatenate([part, [1.0]]), size - 1
        case "RandomWalkRV":
            first, step = pm.icdf(parameters[0], u[:1]), pm.icdf(parameters[1], u[1:size])
            return pt.cumsum(pt.concatenate([first, step])), size
        case "_LKJCholeskyCovRV":  # of two variables
            eta, sd = parameters[1], pm.icdf(parameters[2], u[:2])
            z = 2 * pm.icdf(pm.Beta.dist(eta, eta), u[2]) - 1
            return pt.stack([sd[0], z * sd[1], pt.sqrt(1 - z**2) * sd[1]]), size
    return pm.icdf(rv, u[:size].reshape(shape)), size


def dynesty(model, seed):
    """Static nested sampling of the unit cube, with the compiled likelihood of single points."""
    import dynesty

    logp, unknowns = on_cube(model)
    sampler = dynesty.NestedSampler(
        lambda u: float(np.nan_to_num(logp(u), nan=-np.inf, neginf=-np.inf)),
        lambda u: u,
        ndim=unknowns,
        rstate=np.random.default_rng(seed),
    )
    sampler.run_nested(print_progress=False)
    return sampler.results.logz[-1], sampler.results.logzerr[-1]


def nested_slices(model, seed):
    """Nested slice sampling on the unconstrained scale, with the model as a JAX function."""
    import blackjax
    import jax
    from blackjax.ns.utils import finalise, log_weights
    from pymc.sampling.jax import get_jaxified_graph

    jax.config.update("jax_enable_x64", True)

    def jaxified(variables):
        function = get_jaxified_graph(model.value_vars, [model.logp(variables)])
        return lambda point: jax.numpy.nan_to_num(
            function(*(point[v.name] for v in model.value_vars))[0], nan=-np.inf, neginf=-np.inf
        )

    target = Target(model)
    sampler = blackjax.nss(
        jaxified(model.free_RVs),
        jaxified([*model.observed_RVs, *model.potentials]),
        num_inner_steps=max(5, 2 * target.dimension),  # recommended by blackjax
        num_delete=50,
    )
    # The same number of live points as in dynesty.
    drawn = target.by_name(target.draw_prior(500, np.random.default_rng(seed)))
    state = sampler.init(jax.tree.map(jax.numpy.asarray, drawn))
    step, key, dead = jax.jit(sampler.step), jax.random.key(seed), []
    while not state.integrator.logZ_live - state.integrator.logZ < -3:
        key, key_of_step = jax.random.split(key)
        state, info = step(key_of_step, state)
        dead.append(info)
    runs = logsumexp(log_weights(key, finalise(state, dead, update_info=False)), axis=0)
    return runs.mean(), runs.std()


def pocomc(model, seed):
    """Persistent sampling with a normalising flow, on the unconstrained scale."""
    import pocomc

    target, rng = Target(model), np.random.default_rng(seed)

    class Prior:
        dim = target.dimension
        bounds = np.tile([-np.inf, np.inf], (dim, 1))
        logpdf = staticmethod(lambda x: target.score(x)[0])
        rvs = staticmethod(lambda size: target.draw_prior(size, rng))

    options = {"vectorize": True, "random_state": seed}
    sampler = pocomc.Sampler(Prior(), lambda x: target.score(x)[1], **options)
    sampler.run(progress=False)
    return sampler.evidence()


PEERS = {
    "pymc_hyperelastic": Peer("`ph.sample_smc`", package, seeds=10, most_unknowns=10_000),
    "pymc": Peer("`pm.sample_smc`", pymc, seeds=2, most_unknowns=10_000),
    "dynesty": Peer("dynesty", dynesty),
    "blackjax": Peer("blackjax, nested slices", nested_slices),
    "pocomc": Peer("pocoMC", pocomc),
}


def measure(problem, name, seed):
    """Return the error of one run, its stated error, and its time."""
    importlib.import_module(name)
    problem = (PROBLEMS | ALL_DIFFICULT)[problem]
    model, start = problem.model(), time.perf_counter()
    value, stated, *said = PEERS[name].run(model, seed)
    row = {"stated": float(stated), "seconds": time.perf_counter() - start, "note": "".join(said)}
    return row | {"error": float(value) - problem.log_evidence()}


def measure_apart(problem, name, seed, limit):
    """Measure in a separate process, which may fail and is stopped after `limit` seconds."""
    row = {"problem": problem, "peer": name, "seed": seed}
    with multiprocessing.get_context("fork").Pool(1) as pool:
        try:
            return row | pool.apply_async(measure, (problem, name, seed)).get(limit)
        except multiprocessing.TimeoutError:
            return row | {"note": f"more than {limit} s"}
        except Exception as error:
            return row | {"note": f"{type(error).__name__}: {error}".splitlines()[0]}


def table_of(rows, problems):
    """Return a Markdown table of all runs: first this package with its calibration, then others."""
    peers, lines = list(PEERS), []
    header = ["model", "unknowns", PEERS[peers[0]].title, "error/stated", "flagged"]
    for p in problems:
        own, *others = (
            [r for r in rows if (r["problem"], r["peer"]) == (p.name, n)] for n in peers
        )
        lines.append([p.name, p.unknowns, cell(own), *honesty(own), *map(cell, others)])
    header += [PEERS[name].title for name in peers[1:]]
    return markdown(header, lines)


def table_of_kinds(rows):
    """Return a Markdown table of this package's runs: a row for each kind of difficult model."""
    lines = []
    for kind, problems in DIFFICULT.items():
        runs = [r for r in rows if r["problem"] in problems and "error" in r]
        # An infinite stated error is never wrong.
        off = np.array([[abs(r["error"]), r["stated"]] for r in runs]).reshape(-1, 2).T
        good = np.array([r["note"] == "good" for r in runs], bool)
        right = off[0] < RIGHT
        silent = good & (off[0] > WRONG) & (off[0] > STANDARD_ERRORS * off[1])
        flagged = sorted({r["problem"] for r in runs if r["note"] != "good"})
        counts = f"{right.sum()} of {len(runs)}", f"{(~good).sum()}", f"{silent.sum()}"
        seconds = f"{max((r['seconds'] for r in runs), default=0):.0f} s"
        lines.append([kind, len(problems), *counts, seconds, ", ".join(flagged)])
    header = ["kind", "models", "right within 0.1", "flagged", "wrong and good", "longest run"]
    return markdown([*header, "models with flagged runs"], lines)


def markdown(header, lines):
    """Return a Markdown table; all columns except the first are numbers."""
    lines = [header, ["---", *["---:"] * (len(header) - 1)], *lines]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


def cell(runs):
    """Return mean error ± root mean square of the stated errors, and mean time; or the failure."""
    done = np.array([[r["error"], r["stated"], r["seconds"]] for r in runs if "error" in r])
    if len(done):
        (error, _, seconds), stated = done.mean(axis=0), np.sqrt((done[:, 1] ** 2).mean())
        time_ = f"{seconds:.1f}" if seconds < 10 else f"{seconds:.0f}"
        return f"{rounded(error, '+')} ± {rounded(stated)}, {time_} s"
    note = runs[0]["note"] if runs else ""
    return note if note.startswith("more than") else "refused" if note else ""


def rounded(nats, sign=""):
    """Return a number with three decimals below 1 nat, and one decimal above."""
    return f"{nats:{sign}.3f}" if abs(nats) < 1 else f"{nats:{sign}.1f}"


def honesty(runs):
    """Return the root mean square of error / stated error, and the number of flagged runs."""
    ratios = [r["error"] / r["stated"] for r in runs if "error" in r]
    if not ratios:
        return "", ""
    flagged = sum(r["note"] != "good" for r in runs)
    return f"{np.sqrt(np.mean(np.square(ratios))):.2f}", f"{flagged} of {len(runs)}"


if __name__ == "__main__":
    installed = [name for name in PEERS if importlib.util.find_spec(name)]
    options = argparse.ArgumentParser(description="Measure evidences of general models.")
    options.add_argument("results", type=Path, help="file with a line of JSON for each run")
    options.add_argument("--difficult", action="store_true", help="difficult models, this package")
    options.add_argument("--problems", nargs="+", choices=[*PROBLEMS, *ALL_DIFFICULT])
    options.add_argument("--peers", nargs="+", choices=PEERS, default=installed)
    options.add_argument("--limit", type=int, default=400, help="seconds of a run, at most")
    # The file name does not end with .md: otherwise Sphinx would also make a page of the table.
    options.add_argument("--out", type=Path, help="file of the table; that of the documentation")
    given = options.parse_args()
    file = given.results.open("a+", encoding="utf-8", buffering=1)
    file.seek(0)
    rows = [json.loads(line) for line in file]
    table = ALL_DIFFICULT if given.difficult else PROBLEMS
    peers = ["pymc_hyperelastic"] if given.difficult else given.peers
    chosen = sorted((table[name] for name in given.problems or table), key=lambda p: p.unknowns)
    known = {(r["problem"], r["peer"], r["seed"]) for r in rows}
    for problem, name in product(chosen, peers):
        for seed in range(1, 1 + PEERS[name].seeds):
            run = problem.name, name, seed
            if run not in known and problem.unknowns <= PEERS[name].most_unknowns:
                rows.append(measure_apart(*run, given.limit))
                file.write(json.dumps(rows[-1]) + "\n")
    text = table_of_kinds(rows) if given.difficult else table_of(rows, chosen)
    name = "difficult_evidences.txt" if given.difficult else "evidence_table.txt"
    out = given.out or ROOT / "docs" / "project" / name
    out.write_text(text + "\n", encoding="utf-8")
