"""Sequential Monte Carlo that scores all particles in one call."""

from collections.abc import Callable, Mapping, Sequence
from itertools import cycle, islice
from math import prod
from typing import Any, ClassVar

import numpy as np
import pymc as pm
import pytensor.tensor as pt
from pymc.smc.kernels import SMC_KERNEL
from pymc.vartypes import discrete_types
from pytensor.graph.traversal import ancestors
from pytensor.tensor.variable import TensorVariable
from scipy.special import logsumexp

from pymc_hyperelastic.evidence.batched import (
    BatchedFunction,
    prior_sampler,
    side_by_side,
    value_shapes,
)
from pymc_hyperelastic.evidence.checks import check_count, check_fraction
from pymc_hyperelastic.evidence.mixture import Array, GaussianMixture, components_for, log_sum_exp
from pymc_hyperelastic.evidence.modes import mixture_at_modes
from pymc_hyperelastic.evidence.weights import effective_sample_size, largest_step, systematic

# Correlation cannot show how fast particles move before they had a few moves.
_FEWEST_MOVES = 4
# The proposals look ahead as far as this fraction of the particles is effective there, and this
# share of them is drawn for what is seen there.
_AHEAD, _SHARE_AHEAD = 0.02, 0.3


class BatchedSMC(SMC_KERNEL):
    r"""SMC kernel that tempers a whole population of particles in vectorised calls.

    Particles start from the prior, and the likelihood is raised to a power ``β`` that grows from 0
    to 1. Each step of ``β`` keeps the effective sample size at a set fraction; resampled particles
    then move by Metropolis-Hastings until they have forgotten where they were, and all places on
    their way count at the next stage [1]_.

    Moves are drawn from a mixture with heavy tails, fitted to the population, in turn with local
    random walks of the covariance of the component at hand. This finds mirrored modes and bent
    ridges. The population is in part weighted as at a later, larger ``β``: the few particles that
    will carry the weight then are met by proposals now.

    A likelihood of unknown noise has a sudden transition on the way: up to a certain ``β`` a poor
    curve with large noise is preferred, from there on a good curve with small noise, which no
    particle has met. In a hierarchical model half of the particles therefore start from modes that
    were climbed to, and ``β`` leads from that mixture of prior and modes to the posterior.

    It works for any PyMC model with continuous variables, and in ``pm.sample_smc(kernel=...)``.

    Parameters
    ----------
    draws : int
        Number of particles.
    start : dict of str to array, optional
        Initial particles by name of the value variable, on its unconstrained scale; drawn from the
        prior when missing.
    model : pymc.Model, optional
        The model; that of the context when missing.
    random_seed : int, optional
        Seed of the particles.
    threshold : float, optional
        Fraction of the effective sample size to be kept at each stage; when missing, 0.5 in one or
        two dimensions and 0.8 in more. After ``m`` moves at the stage before, ``m/(m + 5)`` is kept
        if that is more: where particles move with difficulty, smaller steps pay.
    compile_kwargs : dict, optional
        Options of ``pytensor.function``. By default particles are scored by NumPy, which compiles
        in a second; ``{"mode": "NUMBA"}`` takes a minute and scores faster.
    tempered : sequence of str, optional
        Names of the observed variables and Potentials whose likelihood is tempered; all when
        missing. The others count as prior, from which `start` must then be drawn.
    from_modes : bool, optional
        Whether half of the particles start from modes of the posterior. When missing, in models in
        which the prior of a variable depends on another one. Mirrored modes are found more surely
        without. Not with `start` or `tempered`.
    forget : float
        Particles move until the correlation of every variable with its value before is below this,
        and that of the weight far ahead below half of it.
    max_moves : int
        Largest number of moves at one stage; there are at least 4 if it is not below that.

    Raises
    ------
    ValueError
        If the model has discrete variables, nothing to temper, or no particle has a finite
        likelihood.

    Notes
    -----
    The evidence is the product of the mean weights of the stages. Its relative variance is
    estimated from the genealogy [2]_ [3]_: with ``w`` the mean weight on a particle's way divided
    by that of all,

    .. math:: \frac{1}{N^2} \sum_{e=1}^N \Big( \sum_{\text{descendants of } e} (w - 1) \Big)^2,

    summed over the initial particles ``e`` and, inside, over all stages. Whatever relatives
    inherit from each other, at any stage, is thereby counted.

    The ``effective_sample_size`` that is reported is that of all places visited; it may exceed the
    number of particles. Scores that are NaN count as ``−inf``, and their number is reported for
    each stage.

    References
    ----------
    .. [1] H.-D. Dau and N. Chopin, Waste-free sequential Monte Carlo, Journal of the Royal
       Statistical Society B 84 (2022) 114.
    .. [2] H. P. Chan and T. L. Lai, A general theory of particle filters in hidden Markov models
       and some applications, Annals of Statistics 41 (2013) 2877.
    .. [3] A. Lee and N. Whiteley, Variance estimation in the particle filter, Biometrika 105 (2018)
       609.
    """

    stats_dtypes_shapes: ClassVar[dict[str, tuple[type, list]]] = {
        "beta": (float, []),
        "log_marginal_likelihood": (float, []),
        "log_evidence_variance": (float, []),
        "effective_sample_size": (float, []),
        "accept_rate": (float, []),
        "moves": (int, []),
        "nan_scores": (int, []),
    }
    beta: float
    mixture: GaussianMixture
    _modes: GaussianMixture | None

    def __init__(
        self,
        draws: int = 2000,
        start: dict[str, Array] | None = None,
        model: pm.Model | None = None,
        random_seed: Any = None,
        threshold: float | None = None,
        compile_kwargs: dict | None = None,
        *,
        tempered: Sequence[str] | None = None,
        from_modes: bool | None = None,
        forget: float = 0.1,
        max_moves: int = 50,
    ) -> None:
        # The base class would compile functions that score one particle; everything that it sets is
        # set here instead.
        check_fraction("forget", forget)
        if threshold is not None:
            check_fraction("threshold", threshold)
        check_count("max_moves", max_moves, 1)
        self.model = model = pm.modelcontext(model)
        self.variables = model.value_vars
        discrete = [v.name for v in self.variables if v.dtype in discrete_types]
        if discrete or not self.variables:
            what = f"discrete: {discrete}" if discrete else "none"
            raise ValueError(f"SMC needs a model with continuous free variables; here are {what}")
        self.draws = draws
        self.start = start
        self.forget = forget
        self.max_moves = max_moves
        self.rng = np.random.default_rng(random_seed)

        shapes = value_shapes(model)
        self.var_info = {name: (shape, prod(shape)) for name, shape in shapes.items()}
        self.dimension = sum(size for _, size in self.var_info.values())
        self.threshold = threshold or (0.5 if self.dimension <= 2 else 0.8)
        # With fewer particles they have no covariance.
        check_count("draws", draws, self.dimension + 2)
        prior_and_likelihood = _scored_terms(model, tempered)
        if from_modes and (start is not None or tempered is not None):
            raise ValueError("from_modes is for particles that start from the prior, all tempered")
        hierarchical = start is None and tempered is None and _is_hierarchical(model)
        self.from_modes = hierarchical if from_modes is None else from_modes
        self._score = BatchedFunction.of_model(model, prior_and_likelihood, compile_kwargs)
        self._draw_prior: Callable[[np.random.Generator], dict[str, Array]] | None = None
        self._reset_state()

    def set_rng(self, rng: np.random.Generator) -> None:
        """Use `rng` from now on."""
        self.rng = rng

    def initialize_population(self) -> dict[str, Array]:
        """Draw particles from the prior."""
        try:
            self._draw_prior = self._draw_prior or prior_sampler(self.model, self.draws)
            return self._draw_prior(self.rng)
        except NotImplementedError as error:
            raise ValueError(
                f"particles cannot be drawn from the prior ({error}): give every variable a proper "
                f"prior, with a density that integrates to 1; here are {list(self.var_info)}"
            ) from error

    def columns(self, particles: Mapping[str, Array]) -> Array:
        """Particles by the name of the value variable as a matrix, in which each has a row."""
        return side_by_side([particles[v.name] for v in self.variables]).astype(float)

    def _initialize_kernel(self) -> None:
        start = self.start or self.initialize_population()
        if set(start) != set(self.var_info):
            raise ValueError(
                f"start must hold the particles of {list(self.var_info)}; it has {list(start)}"
            )
        self.tempered_posterior = self.columns(start)
        self.draws = len(self.tempered_posterior)
        self.prior_logp, self.likelihood_logp = self.score(self.tempered_posterior)
        if not np.isfinite(self.likelihood_logp).any():
            raise ValueError(
                f"none of the {self.draws} initial particles has a finite likelihood "
                f"({self.nan_scores} are NaN): is the prior far from what the data allow, or is a "
                "unit wrong?"
            )
        if self.from_modes and self.start is None:
            self._modes = mixture_at_modes(self.score, self.tempered_posterior).heavy_tailed()
            self.tempered_posterior[::2] = self._modes.draw((self.draws + 1) // 2, self.rng)
            self.prior_logp, self.likelihood_logp = self.score(self.tempered_posterior)
        self.eve = np.arange(self.draws)
        self.influence = np.zeros(self.draws)
        self._visited = [(self.tempered_posterior, self.prior_logp, self.likelihood_logp)]

    def _reset_state(self) -> None:
        super()._reset_state()
        self._modes = None
        self.log_evidence_variance = 0.0
        self.effective_sample_size = float(self.draws)
        self.nan_scores = 0
        self.walk_scale = 2.38 / np.sqrt(self.dimension)
        self.moves = 0

    def temper(self, start: dict[str, Array] | None, rng: np.random.Generator) -> None:
        """Run one chain from the prior, or `start`, to the posterior, silently."""
        self.initialize(start, rng)
        while self.beta < 1:
            self.update_beta_and_weights()
            self.step()

    def score(self, particles: Array) -> tuple[Array, Array]:
        """Log prior and log likelihood of every particle; NaN counts as ``−inf``.

        Of particles that come from modes as well as from the prior: the log density of both
        together, and what is left of the posterior's.
        """
        # A Potential of plain numbers may come in single precision.
        prior, likelihood = (np.asarray(logp, float) for logp in self._score(particles))
        bad = np.isnan(prior) | np.isnan(likelihood)
        self.nan_scores += int(bad.sum())
        prior, likelihood = np.where(bad, -np.inf, prior), np.where(bad, -np.inf, likelihood)
        if self._modes is None:
            return prior, likelihood
        start = np.logaddexp(prior, self._modes.log_density(particles)) - np.log(2)
        return start, prior + likelihood - start

    def update_beta_and_weights(self) -> None:
        """Raise ``β`` as far as the effective sample size allows, and take the evidence's step."""
        self.iteration += 1
        logp = np.concatenate([likelihood for *_, likelihood in self._visited])
        remaining = 1.0 - self.beta
        threshold = max(self.threshold, self.moves / (self.moves + 5))
        step = largest_step(logp, threshold, remaining)
        self.beta = 1.0 if step == remaining else self.beta + step
        log_weights = step * logp
        total = logsumexp(log_weights)
        self.weights = np.exp(log_weights - total)
        self.effective_sample_size = effective_sample_size(log_weights)
        self.log_marginal_likelihood += total - np.log(logp.size)

        ways = self.weights.reshape(-1, self.draws).sum(axis=0) * self.draws
        self.influence += np.bincount(self.eve, ways - 1, self.draws)
        self.log_evidence_variance = float(np.sum(self.influence**2)) / self.draws**2

        self.step_ahead = max(largest_step(logp, _AHEAD, remaining) - step, 0.0)
        self.weights_ahead = self.weights
        if self.step_ahead > 0:
            log_weights += self.step_ahead * logp
            self.weights_ahead = np.exp(log_weights - logsumexp(log_weights))

    def resample(self) -> None:
        """Resample the particles systematically from all places visited."""
        particles, prior, likelihood = (np.concatenate(x) for x in zip(*self._visited, strict=True))
        self.resampling_indexes = chosen = systematic(self.weights, self.draws, self.rng)
        self.eve = self.eve[chosen % self.draws]
        self.tempered_posterior = particles[chosen]
        self.prior_logp, self.likelihood_logp = prior[chosen], likelihood[chosen]
        self.tempered_posterior_logp = self.prior_logp + self.beta * self.likelihood_logp
        share = (1 - _SHARE_AHEAD) * self.weights + _SHARE_AHEAD * self.weights_ahead
        size = max(self.draws // 2, min(self.draws, 1000))  # enough to know the mixture
        self._learn_from = particles[systematic(share, size, self.rng)]

    def tune(self) -> None:
        """Fit the mixture from which moves are drawn."""
        components = components_for(len(self._learn_from), self.dimension)
        # The mixture of the stage before is nearly right, unless components have died out.
        alive = self.iteration > 1 and len(self.mixture.means) == components
        self.mixture = GaussianMixture.fit(
            self._learn_from,
            components,
            self.rng,
            start=self.mixture if alive else None,
            iterations=4 if alive else 10,
        ).heavy_tailed()

    def mutate(self) -> None:
        """Move the particles until they have forgotten their places."""
        origin, far = self.tempered_posterior, self._weight_ahead()
        self._visited = [(origin, self.prior_logp, self.likelihood_logp)]
        self._terms = self.mixture.log_density_of_components(origin)
        self.nan_scores = 0
        rates: list[float] = []
        for move in islice(cycle((self._move_independently, self._walk)), self.max_moves):
            rates.append(move())
            # The few particles that stick in the tails are lost in the first correlation, but will
            # carry the weight of later stages.
            if (
                len(rates) >= _FEWEST_MOVES
                and _largest_correlation(origin, self.tempered_posterior) < self.forget
                and _largest_correlation(far, self._weight_ahead()) < self.forget / 2
            ):
                break
        self.moves = len(rates)
        self.acceptance = float(np.mean(rates))

    def _weight_ahead(self) -> Array:
        logp = self.step_ahead * self.likelihood_logp
        return np.exp(logp - logp.max())[:, None]

    def _move_independently(self) -> float:
        proposal = self.mixture.draw(self.draws, self.rng)
        terms = self.mixture.log_density_of_components(proposal)
        log_ratio = log_sum_exp(self._terms) - log_sum_exp(terms)
        return self._accept(proposal, terms, log_ratio)

    def _walk(self) -> float:
        # The component is drawn by its responsibility for the particle, so that steps follow a bent
        # ridge; the ratio of responsibilities makes the move reversible.
        here = self._terms - log_sum_exp(self._terms)[:, None]
        component = (np.exp(here).cumsum(axis=1) < self.rng.random((self.draws, 1))).sum(axis=1)
        component = component.clip(max=here.shape[1] - 1)
        # Lengths of all orders: what suits the bulk is too long in the neck of a funnel.
        lengths = self.walk_scale * self.rng.lognormal(0.0, 1.5, (self.draws, 1))
        steps = lengths * self.mixture.draw_steps(component, self.rng)
        proposal = self.tempered_posterior + steps
        terms = self.mixture.log_density_of_components(proposal)
        chosen = np.arange(self.draws), component
        there = terms[chosen] - log_sum_exp(terms)
        rate = self._accept(proposal, terms, there - here[chosen])
        self.walk_scale *= np.exp(rate - 0.3)
        return rate

    def _accept(self, proposal: Array, terms: Array, log_ratio: Array) -> float:
        """Metropolis-Hastings step of all particles; the rate of acceptance."""
        prior, likelihood = self.score(proposal)
        logp = prior + self.beta * likelihood
        threshold = -self.rng.exponential(size=self.draws)
        with np.errstate(invalid="ignore"):
            accepted = threshold < logp - self.tempered_posterior_logp + log_ratio
        moved = accepted[:, None]
        self.tempered_posterior = np.where(moved, proposal, self.tempered_posterior)
        self._terms = np.where(moved, terms, self._terms)
        self.prior_logp = np.where(accepted, prior, self.prior_logp)
        self.likelihood_logp = np.where(accepted, likelihood, self.likelihood_logp)
        self.tempered_posterior_logp = np.where(accepted, logp, self.tempered_posterior_logp)
        self._visited.append((self.tempered_posterior, self.prior_logp, self.likelihood_logp))
        return float(accepted.mean())

    def sample_stats(self) -> dict[str, float]:
        """What is reported of each stage."""
        return {
            "beta": self.beta,
            "log_marginal_likelihood": self.log_marginal_likelihood,
            "log_evidence_variance": self.log_evidence_variance,
            "effective_sample_size": self.effective_sample_size,
            "accept_rate": self.acceptance,
            "moves": self.moves,
            "nan_scores": self.nan_scores,
        }

    def sample_settings(self) -> dict[str, float]:
        """Settings of the run."""
        return {
            "_n_draws": self.draws,
            "threshold": self.threshold,
            "from_modes": int(self.from_modes),
            "forget": self.forget,
            "max_moves": self.max_moves,
        }


def _scored_terms(model: pm.Model, tempered: Sequence[str] | None) -> list[TensorVariable]:
    """Log density of all that counts as prior, and of all that is tempered."""
    terms = [*model.observed_RVs, *model.potentials]
    names = [term.name for term in terms]
    unknown = sorted(set(tempered or ()) - set(names))
    if unknown or not terms:
        raise ValueError(
            f"nothing to temper: the model has the observed variables and Potentials {names}"
            + (f", not {unknown}" if unknown else "")
        )
    hot = [term for term in terms if tempered is None or term.name in tempered]
    cold = [*model.free_RVs, *(term for term in terms if term not in hot)]
    logp = model.logp([*cold, *hot], sum=False)
    groups = logp[: len(cold)], logp[len(cold) :]
    return [sum(pt.sum(term) for term in group) for group in groups]


def _is_hierarchical(model: pm.Model) -> bool:
    """Whether the prior of a variable depends on another one."""
    free = set(model.free_RVs)
    return any(free.intersection(ancestors(rv.owner.inputs)) for rv in model.free_RVs)


def _largest_correlation(before: Array, after: Array) -> float:
    """Largest correlation of a variable with its own value before."""
    before, after = before - before.mean(axis=0), after - after.mean(axis=0)
    norm = np.sqrt((before**2).sum(axis=0) * (after**2).sum(axis=0))
    return float(np.max(np.abs((before * after).sum(axis=0)) / np.maximum(norm, 1e-300)))
