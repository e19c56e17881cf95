"""Ways to the evidence of the known problem: this package, and what a user would do without it.

``python peers.py NAME`` runs one of them in a process of its own and prints the evidence as JSON.
Libraries are imported by the peer that needs them, so that a process pays for no other.
"""

import argparse
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from known_problem import (
    ALPHA,
    INNER_RADIUS,
    LOG_EVIDENCE,
    MU,
    OUTER_RADIUS,
    SIGMA,
    SLOPE_WEIGHT,
    constants,
    known_curves,
    log_likelihood,
)

DRAWS, CHAINS = 2000, 2


class Evidence(NamedTuple):
    """Log evidence, with the standard error that the method itself states, if it does."""

    value: float
    standard_error: float | None = None

    @property
    def error(self) -> float:
        return self.value - LOG_EVIDENCE


@dataclass(frozen=True)
class Peer:
    """One way to the evidence."""

    title: str
    run: Callable[..., Evidence]
    """Called with ``draws``, ``chains`` and ``seed``."""
    rounds: int = 5
    """How often it is run."""
    compiled_for_size: bool = False
    """True if another number of draws needs another compilation."""


# --- this package --------------------------------------------------------------------------------


def known_model():
    """Our model of the known problem."""
    import pymc as pm

    import pymc_hyperelastic as ph

    return ph.ogden_model(
        as_inflation_data(known_curves()),
        ph.SlopeAugmented(SIGMA, SLOPE_WEIGHT),
        priors={"mu": pm.Uniform.dist(*MU), "alpha": pm.Uniform.dist(*ALPHA)},
    )


def as_inflation_data(curves):
    """Inflation Dataset of simulated experiments, each on a specimen of its own."""
    import pandas as pd

    import pymc_hyperelastic as ph

    tables = [
        pd.DataFrame({"specimen": f"S{i}", "experiment": 1, "radius": r, "pressure": p})
        for i, (r, p) in enumerate(curves)
    ]
    return ph.inflation_data(
        pd.concat(tables),
        ph.Tube(inner_radius=INNER_RADIUS, outer_radius=OUTER_RADIUS),
        check="ignore",
    )


def package(draws, chains, seed, var_names=("mu", "alpha")):
    """Store only the parameters, as all other peers do; with None also the curves."""
    import pymc_hyperelastic as ph

    keep = None if var_names is None else list(var_names)
    tree = ph.sample_smc(
        known_model(), draws, chains, random_seed=seed, progressbar=False, var_names=keep
    )
    return Evidence(*ph.log_evidence(tree))


def package_by_quadrature(draws, chains, seed):
    import pymc_hyperelastic as ph

    return Evidence(*ph.log_evidence_by_quadrature(known_model()))


# --- PyMC's own sampler --------------------------------------------------------------------------


def pymc_by_hand(draws, chains, seed):
    """Write the likelihood as a graph, with every node of every point."""
    import pymc as pm
    import pytensor.tensor as pt

    data = constants(known_curves())
    with pm.Model() as model:
        mu, alpha = pm.Uniform("mu", *MU), pm.Uniform("alpha", *ALPHA)
        pm.Potential("likelihood", log_likelihood(data, mu, alpha, pt.sinh))
    return _stock_smc(model, draws, chains, seed)


def pymc_on_our_model(draws, chains, seed):
    """Keep the curves too: stock SMC has no option to leave them out."""
    return _stock_smc(known_model(), draws, chains, seed)


def _stock_smc(model, draws, chains, seed):
    import pymc as pm

    tree = pm.sample_smc(
        draws=draws,
        chains=chains,
        cores=1,
        model=model,
        random_seed=seed,
        progressbar=False,
        compute_convergence_checks=False,
    )
    stages = tree["sample_stats"]["log_marginal_likelihood"].values
    # A single chain comes without the axis of chains; each is NaN but for its last stage.
    ends = [np.asarray(chain, float)[-1] for chain in (stages if chains > 1 else [stages])]
    return Evidence(log_mean(ends))


# --- JAX -----------------------------------------------------------------------------------------


def jax_by_hand(draws, chains, seed, **tricks):
    """Write SMC in JAX; the tricks are those of `_jax_chain`."""
    import jax

    jax.config.update("jax_enable_x64", True)
    key = draws, *sorted(tricks)
    if key not in _compiled:
        _compiled[key] = jax.jit(_jax_chain(draws, **tricks))
    run = _compiled[key]
    keys = jax.random.split(jax.random.key(seed), chains)
    return Evidence(log_mean([float(run(key)) for key in keys]))


_compiled: dict[tuple, Any] = {}
# The fewest with which the error of a chain no longer falls.
JAX_MOVES = 10


def _jax_chain(draws, *, fast_sinh=False, one_grid=False):
    """Tempered SMC as one compiled function from a random key to a log evidence.

    Particles live in the unit square, so that the prior is 1. They move by random walks along
    differences of pairs of the resampled particles: these have the shape of each mirrored mode,
    and now and then lead from one to the other.

    Two tricks: ``jnp.sinh`` takes six times as long on a CPU as two exponentials, whose digits near
    0 do not matter here, and these six experiments were simulated at the same radii.
    """
    import jax
    import jax.numpy as jnp
    from jax.scipy.special import logsumexp

    data = constants(known_curves(), one_grid=one_grid)
    low, width = np.array([MU[0], ALPHA[0]]), np.array([np.ptp(MU), np.ptp(ALPHA)])

    def sinh(x):
        if not fast_sinh:
            return jnp.sinh(x)
        growth = jnp.exp(x)
        return (growth - 1 / growth) / 2

    @jax.vmap
    def score(u):
        inside = jnp.all((u > 0) & (u < 1))
        return jnp.where(inside, log_likelihood(data, *(low + width * u), sinh), -jnp.inf)

    def effective_sample_size(log_weights):
        return jnp.exp(2 * logsumexp(log_weights) - logsumexp(2 * log_weights))

    def next_step(beta, logp):
        def halve(_, ends):
            middle = (ends[0] + ends[1]) / 2
            enough = effective_sample_size(middle * logp) > draws / 2
            return jnp.where(enough, middle, ends[0]), jnp.where(enough, ends[1], middle)

        rest = 1 - beta
        step, _ = jax.lax.fori_loop(0, 60, halve, (0.0, rest))
        return jnp.where(effective_sample_size(rest * logp) > draws / 2, rest, step)

    def stage(state):
        key, u, logp, beta, log_evidence, scale = state
        key, key_of_comb, key_of_moves = jax.random.split(key, 3)
        step = next_step(beta, logp)
        total = logsumexp(step * logp)
        log_evidence += total - jnp.log(draws)
        beta = jnp.where(step == 1 - beta, 1.0, beta + step)

        comb = (jax.random.uniform(key_of_comb) + jnp.arange(draws)) / draws
        cumulative = jnp.cumsum(jnp.exp(step * logp - total))
        chosen = jnp.searchsorted(cumulative / cumulative[-1], comb)
        population = u[chosen]

        def move(state, key):
            u, logp, scale = state
            key_of_pairs, key_of_lengths, key_of_thresholds = jax.random.split(key, 3)
            first, second = jax.random.randint(key_of_pairs, (2, draws), 0, draws)
            length = scale * jnp.abs(jax.random.normal(key_of_lengths, (draws, 1)))
            proposal = u + length * (population[first] - population[second])
            proposed = score(proposal)
            threshold = jnp.log(jax.random.uniform(key_of_thresholds, (draws,)))
            accepted = threshold < beta * (proposed - logp)
            u = jnp.where(accepted[:, None], proposal, u)
            scale *= jnp.exp(accepted.mean() - 0.25)
            return (u, jnp.where(accepted, proposed, logp), scale), None

        moved, _ = jax.lax.scan(
            move, (population, logp[chosen], scale), jax.random.split(key_of_moves, JAX_MOVES)
        )
        return key, *moved[:2], beta, log_evidence, moved[2]

    def chain(key):
        key, key_of_prior = jax.random.split(key)
        u = jax.random.uniform(key_of_prior, (draws, 2))
        start = key, u, score(u), 0.0, 0.0, 1.0
        return jax.lax.while_loop(lambda state: state[3] < 1, stage, start)[4]

    return chain


# --- nested sampling -----------------------------------------------------------------------------


def dynesty(draws, chains, seed, as_many_live_points=False):
    """Run once, with as many live points as dynesty thinks right or as there are draws."""
    import dynesty

    data = constants(known_curves())
    low, width = np.array([MU[0], ALPHA[0]]), np.array([np.ptp(MU), np.ptp(ALPHA)])
    sampler = dynesty.NestedSampler(
        lambda theta: log_likelihood(data, *theta, np.sinh),
        lambda u: low + width * u,
        ndim=2,
        rstate=np.random.default_rng(seed),
        **({"nlive": draws} if as_many_live_points else {}),
    )
    sampler.run_nested(print_progress=False)
    return Evidence(float(sampler.results.logz[-1]), float(sampler.results.logzerr[-1]))


# --- all of them ---------------------------------------------------------------------------------


PEERS = {
    # As many rounds as take the time of the slowest peer, because the speed of a machine varies.
    "package": Peer("`ph.sample_smc`, parameters kept", package, rounds=60),
    "package_with_curves": Peer(
        "`ph.sample_smc`, curves kept too", partial(package, var_names=None)
    ),
    "package_by_quadrature": Peer("`ph.log_evidence_by_quadrature`", package_by_quadrature),
    "pymc_by_hand": Peer("`pm.sample_smc`, model written by hand", pymc_by_hand, rounds=2),
    "pymc_on_our_model": Peer("`pm.sample_smc`, our model", pymc_on_our_model, rounds=2),
    "jax_by_hand": Peer("SMC written in JAX", jax_by_hand, compiled_for_size=True),
    "jax_with_two_exponentials": Peer(
        "the same, sinh as two exponentials",
        partial(jax_by_hand, fast_sinh=True),
        compiled_for_size=True,
    ),
    "jax_by_hand_on_one_grid": Peer(
        "that, knowing the common radii",
        partial(jax_by_hand, fast_sinh=True, one_grid=True),
        compiled_for_size=True,
    ),
    "dynesty": Peer("dynesty, default settings", dynesty),
    "dynesty_with_live_points": Peer(
        "dynesty, 2000 live points", partial(dynesty, as_many_live_points=True), rounds=2
    ),
}
"""All of them; the first is the one to which others are compared."""


def log_mean(logs):
    """Logarithm of the mean."""
    return float(np.logaddexp.reduce(logs) - np.log(len(logs)))


if __name__ == "__main__":
    options = argparse.ArgumentParser(description="Run one peer and print its evidence.")
    options.add_argument("name", choices=PEERS)
    options.add_argument("--draws", type=int, default=DRAWS)
    options.add_argument("--chains", type=int, default=CHAINS)
    options.add_argument("--seed", type=int, default=1)
    given = vars(options.parse_args())
    print(json.dumps(PEERS[given.pop("name")].run(**given)))
