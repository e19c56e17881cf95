"""Compute the evidence from draws of any sampler, by bridge sampling."""

import warnings
from collections.abc import Callable
from itertools import compress
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import pymc as pm
import xarray as xr
from scipy.optimize import brentq
from scipy.special import expit, log_expit, logsumexp

from pymc_hyperelastic.evidence.checks import check_count, check_repeatable
from pymc_hyperelastic.evidence.convergence import (
    FEWEST_EFFECTIVE,
    LARGEST_DEVIATION,
    disagreement,
    divergence,
    effective_size,
)
from pymc_hyperelastic.evidence.estimate import Estimate, combine_chains
from pymc_hyperelastic.evidence.mixture import Array
from pymc_hyperelastic.evidence.proposal import fitted_proposal
from pymc_hyperelastic.evidence.smc import seed_sequence
from pymc_hyperelastic.evidence.unconstrained import (
    NOTHING,
    log_density_function,
    refuse_draws,
    unconstrained_draws,
)
from pymc_hyperelastic.messages import PACKAGE
from pymc_hyperelastic.parallel import one_thread

Proposal = Literal["auto", "normal", "warped", "mixture"]

# Draws of a chain, at least: the autocorrelation of fewer cannot be estimated.
_SHORTEST_CHAIN = 10
# Draws of all chains, at least: a proposal cannot be fitted to fewer.
_FEWEST_DRAWS = 200
# Largest number of proposals; else there is one for each chain.
_MOST_PARTS = 8


@one_thread
def bridge_sampling(
    model: pm.Model,
    tree: xr.DataTree,
    *,
    proposal: Proposal = "auto",
    proposal_draws: int | None = None,
    random_seed: Any = None,
) -> Estimate:
    r"""Log evidence of a model from draws of its posterior by any sampler: bridge sampling.

    With ``q(θ) = p(y | θ) p(θ)`` on the unconstrained scale, and a normalised proposal ``g`` that
    is like it, the evidence ``Z`` is the one number for which [1]_

    .. math:: Z = \frac{\mathrm{E}_g[h q]}{\mathrm{E}_{q/Z}[h g]}, \qquad
        h = \frac{1}{s_1 q + s_2 Z g}, \quad s_i = \frac{n_i}{n_1 + n_2},

    with means over ``n₂`` draws of the proposal, and over the draws of the posterior, of which
    ``n₁`` are effective. A poor proposal costs little: from 4000 draws of a posterior of 1000
    unknowns the standard error can be 0.03 nats.

    Parameters
    ----------
    model : pymc.Model
        A model with continuous free variables. Observed variables and Potentials all count.
    tree : xarray.DataTree
        Draws of its posterior, as ``pm.sample``, ``pm.sample_smc``, nutpie or :func:`sample_smc`
        return them: the group ``posterior`` holds every free variable. A group
        ``unconstrained_posterior`` that holds all of them is taken instead.
    proposal : {"auto", "normal", "warped", "mixture"}
        ``"normal"``: mean and covariance of the draws, with correlations shrunk as far as predicts
        other draws best. ``"warped"``: the same, for the posterior made symmetric about the mean
        [2]_, which takes twice the evaluations. ``"mixture"``: several normal, or Student's t,
        distributions. ``"auto"``: the one that predicts other draws best; warped if it is a single
        one.
    proposal_draws : int, optional
        Number of draws from the proposals; as many as of the posterior when missing.
    random_seed : int or sequence of int, optional
        Seed of the proposals' draws; the same seed gives the same result.

    Returns
    -------
    Estimate
        The pair (value, standard error), in nats.

    Raises
    ------
    TypeError
        If `model` is no PyMC model, or `tree` no DataTree.
    ValueError
        If the model has discrete variables; if draws lack a variable, have another shape than the
        model's, are not finite, at a bound, all the same, of density zero under the model, or too
        few for the number of unknowns; if the density of the model is random; or if an option is
        unknown.

    Warns
    -----
    UserWarning
        If the chains disagree (a split R-hat above 1.05, or less than 40 effective draws), if more
        than one in 1000 transitions of NUTS diverged, if the draws hardly overlap with those of the
        proposals, or if they are not distributed as the model says. The standard error is then
        infinite.

    See Also
    --------
    log_evidence : The evidence that :func:`sample_smc` finds itself.

    Notes
    -----
    **A mode, or a tail, that no chain has met is missing**, and the standard error does not know
    it. Use chains that start far apart, or :func:`sample_smc`, to look for several modes.

    Each chain (of a single one, each half) is compared with a proposal that was fitted to the
    others [3]_. The standard error is that of [4]_, or the spread of these evidences if chance
    explains it less than one time in a hundred. A score test finds draws of other data, or of a
    posterior that was sampled 5 % too wide. A tutorial of the method is [5]_.

    References
    ----------
    .. [1] X.-L. Meng and W. H. Wong, Simulating ratios of normalizing constants via a simple
       identity: a theoretical exploration, Statistica Sinica 6 (1996) 831.
    .. [2] X.-L. Meng and S. Schilling, Warp bridge sampling, Journal of Computational and Graphical
       Statistics 11 (2002) 552.
    .. [3] J. S. T. Wong, J. J. Forster and P. W. F. Smith, Properties of the bridge sampler with a
       focus on splitting the MCMC sample, Statistics and Computing 30 (2020) 799.
    .. [4] S. Frühwirth-Schnatter, Estimating marginal likelihoods for mixture and Markov switching
       models using bridge sampling techniques, Econometrics Journal 7 (2004) 143.
    .. [5] Q. F. Gronau et al., A tutorial on bridge sampling, Journal of Mathematical Psychology 81
       (2017) 80.

    Examples
    --------
    Here draws of :func:`sample_smc`; those of ``pm.sample`` do as well.

    >>> import pymc as pm, pymc_hyperelastic as ph
    >>> with pm.Model() as model:
    ...     mean = pm.Normal("mean", 0.0, 3.0)
    ...     y = pm.Normal("y", mean, 4.0, observed=1.0)
    >>> tree = ph.sample_smc(model, draws=500, chains=4, random_seed=1, progressbar=False)
    >>> evidence = ph.bridge_sampling(model, tree, random_seed=1)
    >>> abs(evidence.value - -2.548376) < 3 * evidence.standard_error
    True
    """
    if proposal not in get_args(Proposal):
        raise ValueError(f"proposal is {proposal!r}; expected one of {get_args(Proposal)}")
    if proposal_draws is not None:
        check_count("proposal_draws", proposal_draws, _FEWEST_DRAWS)
    draws, names = unconstrained_draws(model, tree)
    _check_enough(draws, names)
    density = log_density_function(model)
    log_density = density(draws)
    refuse_draws(
        log_density == NOTHING,
        "draws",
        "have a density of zero, or none: are these draws of this model, with these data?",
    )
    check_repeatable(log_density[:, :1], density(draws[:, :1]))
    if len(draws) == 1:
        draws, log_density = _halves(draws), _halves(log_density)
    doubts = [*disagreement(names, draws, log_density), *divergence(tree)]

    rng = np.random.default_rng(seed_sequence(random_seed))
    estimate, misfit = bridged(density, draws, log_density, rng, proposal, proposal_draws)
    doubts += misfit
    if doubts:
        said = f"the evidence cannot be trusted: {'; '.join(doubts)}"
        warnings.warn(said, skip_file_prefixes=(PACKAGE,))
        return Estimate(estimate.value, np.inf)
    return estimate


def bridged(
    density: Callable[[Array], Array],
    draws: Array,
    log_density: Array,
    rng: np.random.Generator,
    proposal: Proposal,
    proposal_draws: int | None = None,
) -> tuple[Estimate, list[str]]:
    """Return the evidence from draws of at least two chains, (chain, draw, unknown), and doubts.

    Each part of the chains is compared with draws of a proposal that is fitted to the others.
    """
    size = proposal_draws or log_density.size
    parts = np.arange(len(draws)) % _MOST_PARTS
    count = int(parts.max()) + 1
    bridges, mixtures = [], proposal in ("mixture", "auto")
    for part in range(count):
        this, others = parts == part, parts != part
        effective = effective_size(log_density[others])
        mixture = fitted_proposal(draws[others], effective, mixtures, rng)
        proposed = mixture.draw(-(-size // count), rng)
        at_drawn, at_proposed = log_density[this], density(proposed)
        if proposal in ("auto", "warped") and len(mixture.means) == 1:
            # Half of the posterior, and half of its mirror image.
            centre = 2 * mixture.means[0]
            at_drawn = np.logaddexp(at_drawn, density(centre - draws[this])) - np.log(2)
            at_proposed = np.logaddexp(at_proposed, density(centre - proposed)) - np.log(2)
        of_proposal = mixture.log_density(draws[this].reshape(-1, draws.shape[2]))
        at_drawn = at_drawn - of_proposal.reshape(at_drawn.shape)
        bridges.append(_bridge(at_drawn, at_proposed - mixture.log_density(proposed)))
    values = np.array([b.log_evidence for b in bridges])
    errors = np.sqrt([b.variance for b in bridges])
    return combine_chains(values, errors), _misfit(bridges)


def _check_enough(draws: Array, names: list[str]) -> None:
    chains, each, dimension = draws.shape
    least = max(_FEWEST_DRAWS, 2 * (dimension + 2))
    if chains * each < least or each < _SHORTEST_CHAIN:
        raise ValueError(
            f"{chains} chain(s) of {each} draws are too few for {dimension} unknown(s): there must "
            f"be {least} draws in all, and {_SHORTEST_CHAIN} of each chain"
        )
    still = np.ptp(draws, axis=(0, 1)) == 0
    if still.any():
        raise ValueError(f"all draws of {list(dict.fromkeys(compress(names, still)))} are the same")
    # The R-hat of two chains that move and one that stands still is large, which is found later.
    stuck = (np.ptp(_halves(draws).reshape(2, chains, -1, dimension), axis=2) == 0).any(axis=0)
    if np.sum(~stuck.any(axis=1)) < min(2, chains):
        chain = int(np.flatnonzero(stuck.any(axis=1))[0])
        constant = list(dict.fromkeys(compress(names, stuck[chain])))
        raise ValueError(
            f"chain {chain} stands still for half of its draws, in {constant}, and there are not "
            "two that move: the sampler got stuck; sample again, from other places"
        )


def _halves(values: Array) -> Array:
    """Two chains of one: its halves are nearly independent of each other."""
    middle = values.shape[1] // 2
    return np.concatenate([values[:, :middle], values[:, -middle:]])


class _Bridge(NamedTuple):
    """The evidence from one part of the draws."""

    log_evidence: float
    variance: float
    effective: tuple[float, float]  # draws of the posterior and of the proposal that count
    score: float  # of an exponent of q/g that is not 1
    score_variance: float


def _bridge(drawn: Array, proposed: Array) -> _Bridge:
    """Evidence from ``ln q/g`` at draws of the posterior, (chain, draw), and of the proposal.

    With ``c = ln (Z n₂/n₁)`` a draw is from the posterior with the probability
    ``1/(1 + e^{c - ln q/g})``, and as many effective draws of either are taken for the other.
    """
    n1, n2 = effective_size(drawn, "bulk"), proposed.size
    log_odds = np.log(n2 / n1)

    def excess(c: float) -> float:
        mistaken = logsumexp(log_expit(c - drawn)) - np.log(drawn.size)
        return mistaken + np.log(n1) - logsumexp(log_expit(proposed - c))

    # Beyond these one of the two sides vanishes, and it rises in between.
    low, high = sorted([drawn.min(), proposed.max()])
    c = brentq(excess, low - 100, high + 100, xtol=1e-10, maxiter=1000) if low > NOTHING else np.nan
    f, g = expit(c - drawn), expit(proposed - c)  # of each, the probability to be of the other kind
    size_f = effective_size(f)
    variance_f, variance_g = _relative_variance(f, size_f), _relative_variance(g, n2)
    # The derivative by an exponent b of q/g, at b = 1, when c is always that which suits best.
    weight_f, weight_g = n1 / drawn.size * f * (1 - f), g * (1 - g)
    centre = (weight_f * drawn).sum() + (weight_g * proposed).sum()
    centre /= weight_f.sum() + weight_g.sum() + np.finfo(float).tiny
    score_f, score_g = f * (drawn - centre), g * (proposed - centre)
    return _Bridge(
        float(c - log_odds),
        2 * variance_f + variance_g,
        (1 / (1 / size_f + variance_f), 1 / (1 / n2 + variance_g)),
        float(n1 * score_f.mean() - score_g.sum()),
        float(2 * n1**2 * score_f.var() / effective_size(score_f) + n2 * score_g.var()),
    )


def _relative_variance(values: Array, size: float) -> float:
    """Return the relative variance of the mean of values of which `size` are independent."""
    mean = values.mean()
    return float((values / mean).var() / size) if mean > 0 else np.inf


def _misfit(bridges: list[_Bridge]) -> list[str]:
    """Return doubts: too few effective draws, or draws of another density."""
    doubts = []
    effective = np.sum([b.effective for b in bridges], axis=0).min()
    if not effective >= FEWEST_EFFECTIVE:
        doubts.append(
            f"posterior and proposals hardly overlap (effective draws: {effective:.0f}): draw "
            "more, or choose another proposal"
        )
    variance = sum(b.score_variance for b in bridges)
    score = abs(sum(b.score for b in bridges)) / np.sqrt(max(variance, np.finfo(float).tiny))
    if score > LARGEST_DEVIATION:
        doubts.append(
            f"the draws are not distributed as the posterior ({score:.1f} standard errors away): "
            "are they of this model and these data, and did the sampler converge?"
        )
    return doubts
