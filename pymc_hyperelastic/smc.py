"""Sequential Monte Carlo that scores all particles in one call, and the evidence it gives."""

import warnings
from collections.abc import Sequence
from numbers import Integral, Real
from typing import Any, ClassVar, NamedTuple

import numpy as np
import pymc as pm
import xarray as xr
from numpy.typing import NDArray
from pymc.progress_bar import SMCProgressBarManager
from pymc.smc.kernels import SMC_KERNEL
from pymc.vartypes import discrete_types
from pytensor.tensor.variable import TensorVariable
from scipy.optimize import brentq
from scipy.special import logsumexp

from pymc_hyperelastic.batched import BatchedFunction, draw_from_prior
from pymc_hyperelastic.mixture import GaussianMixture
from pymc_hyperelastic.results import check_result, sampling_tree

__all__ = ["BatchedSMC", "Estimate", "log_evidence", "sample_smc"]

Array = NDArray[np.float64]

# Correlation is blind to the few particles that stick, but these bias the evidence when the
# posterior has to travel far: with two moves a stage it was low by 0.2 where this is not seen.
_FEWEST_MOVES = 4


class Estimate(NamedTuple):
    """A number with its standard error; ``float(estimate)`` is the number."""

    value: float
    standard_error: float

    def __float__(self) -> float:
        return self.value

    def __str__(self) -> str:
        return f"{self.value:.3f} ± {self.standard_error:.3f}"


class BatchedSMC(SMC_KERNEL):
    r"""SMC kernel that tempers a whole population of particles in vectorised calls.

    Particles start from the prior, and the likelihood is raised to a power ``β`` that grows from 0
    to 1. Each step of ``β`` keeps the effective sample size at a set fraction; resampled particles
    then move by Metropolis-Hastings until they have forgotten where they were. Moves are drawn from
    a Student-t mixture fitted to the population, which finds mirrored modes and bent ridges, in
    turn with local random walks of the covariance of the mixture's component at hand.

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
    threshold : float
        Fraction of the effective sample size to be kept at each stage.
    compile_kwargs : dict, optional
        Options of ``pytensor.function``. By default particles are scored by NumPy, which compiles
        in a second; ``{"mode": "NUMBA"}`` takes a minute and scores faster.
    tempered : sequence of str, optional
        Names of the observed variables and Potentials whose likelihood is tempered; all when
        missing. The others count as prior, from which `start` must then be drawn.
    forget : float
        Particles move until the correlation of every variable with its value before is below this.
    max_moves : int
        Largest number of moves at one stage.

    Raises
    ------
    ValueError
        If the model has discrete variables, nothing to temper, or no particle has a finite
        likelihood.

    Notes
    -----
    The evidence is the product of the mean weights of the stages. With the particles of a stage
    nearly independent its relative variance is ``Σ (1/ESS − 1/N)`` over the stages.
    Scores that are NaN count as ``−inf``, and their number is reported for each stage.
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

    def __init__(
        self,
        draws: int = 2000,
        start: dict[str, Array] | None = None,
        model: pm.Model | None = None,
        random_seed: Any = None,
        threshold: float = 0.7,
        compile_kwargs: dict | None = None,
        *,
        tempered: Sequence[str] | None = None,
        forget: float = 0.1,
        max_moves: int = 50,
    ) -> None:
        # The base class would compile functions that score one particle; everything that it sets is
        # set here instead.
        for name, fraction in (("threshold", threshold), ("forget", forget)):
            if not isinstance(fraction, Real) or not 0 < fraction < 1:
                raise ValueError(f"{name} is {fraction!r}; expected a number between 0 and 1")
        _check_count("max_moves", max_moves, 1)
        self.model = model = pm.modelcontext(model)
        self.variables = model.value_vars
        discrete = [v.name for v in self.variables if v.dtype in discrete_types]
        if discrete or not self.variables:
            what = f"discrete: {discrete}" if discrete else "none"
            raise ValueError(f"SMC needs a model with continuous free variables; here are {what}")
        self.draws = draws
        self.start = start
        self.threshold = threshold
        self.forget = forget
        self.max_moves = max_moves
        self.rng = np.random.default_rng(random_seed)

        point = model.initial_point(random_seed=self.rng.integers(2**30))
        self.var_info = {v.name: (point[v.name].shape, point[v.name].size) for v in self.variables}
        self.dimension = sum(size for _, size in self.var_info.values())
        # With fewer particles they have no covariance.
        _check_count("draws", draws, self.dimension + 2)
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
        self._score = BatchedFunction.of_model(
            model, [model.logp(cold), model.logp(hot)], compile_kwargs
        )
        self._reset_state()

    def set_rng(self, rng: np.random.Generator) -> None:
        """Use `rng` from now on."""
        self.rng = rng

    def initialize_population(self) -> dict[str, Array]:
        """Draw particles from the prior."""
        try:
            return draw_from_prior(self.model, self.draws, self.rng)
        except NotImplementedError as error:
            raise ValueError(
                f"particles cannot be drawn from the prior ({error}): give every variable a proper "
                f"prior, with a density that integrates to 1; here are {list(self.var_info)}"
            ) from error

    def _initialize_kernel(self) -> None:
        start = self.start or self.initialize_population()
        if set(start) != set(self.var_info):
            raise ValueError(
                f"start must hold the particles of {list(self.var_info)}; it has {list(start)}"
            )
        columns = [np.reshape(start[v.name], (len(start[v.name]), -1)) for v in self.variables]
        self.tempered_posterior = np.concatenate(columns, axis=1).astype(float)
        self.draws = len(self.tempered_posterior)
        self.prior_logp, self.likelihood_logp = self.score(self.tempered_posterior)
        if not np.isfinite(self.likelihood_logp).any():
            raise ValueError(
                f"none of the {self.draws} initial particles has a finite likelihood "
                f"({self.nan_scores} are NaN): is the prior far from what the data allow, or is a "
                "unit wrong?"
            )

    def _reset_state(self) -> None:
        super()._reset_state()
        self.log_evidence_variance = 0.0
        self.effective_sample_size = float(self.draws)
        self.nan_scores = 0
        self.walk_scale = 2.38 / np.sqrt(self.dimension)
        self.stages_fitted = 0

    def score(self, particles: Array) -> tuple[Array, Array]:
        """Log prior and log likelihood of every particle; NaN counts as ``−inf``."""
        prior, likelihood = self._score(particles)
        bad = np.isnan(prior) | np.isnan(likelihood)
        self.nan_scores += int(bad.sum())
        return np.where(bad, -np.inf, prior), np.where(bad, -np.inf, likelihood)

    def update_beta_and_weights(self) -> None:
        """Raise ``β`` as far as the effective sample size allows, and take the evidence's step."""
        self.iteration += 1
        logp = self.likelihood_logp
        possible = np.isfinite(logp)
        target = self.threshold * possible.sum()
        step = 1.0 - self.beta
        if _effective_sample_size(step * logp) < target:
            spread = np.ptp(logp[possible])
            # Searched on a logarithmic scale: the first steps may be 1e-13.
            step = np.exp(
                brentq(
                    lambda log_step: _effective_sample_size(np.exp(log_step) * logp) - target,
                    np.log(1e-6 / spread),
                    np.log(step),
                    xtol=1e-6,
                )
            )
            self.beta += step
        else:
            self.beta = 1.0
        log_weights = step * logp
        total = logsumexp(log_weights)
        self.weights = np.exp(log_weights - total)
        self.effective_sample_size = _effective_sample_size(log_weights)
        self.log_marginal_likelihood += total - np.log(self.draws)
        self.log_evidence_variance += 1 / self.effective_sample_size - 1 / self.draws

    def resample(self) -> None:
        """Resample the particles systematically."""
        positions = (self.rng.random() + np.arange(self.draws)) / self.draws
        cumulative = np.cumsum(self.weights)
        self.resampling_indexes = np.searchsorted(cumulative / cumulative[-1], positions)
        self.tempered_posterior = self.tempered_posterior[self.resampling_indexes]
        self.prior_logp = self.prior_logp[self.resampling_indexes]
        self.likelihood_logp = self.likelihood_logp[self.resampling_indexes]
        self.tempered_posterior_logp = self.prior_logp + self.beta * self.likelihood_logp

    def tune(self) -> None:
        """Fit the mixture from which moves are drawn."""
        dimension = self.dimension
        # Each component has to be known from several times as many points as it has parameters.
        parameters = (dimension + 1) * (dimension + 2) // 2
        components = int(np.clip(self.draws / (10 * parameters), 1, 6))
        # The mixture of the stage before is nearly right, unless components have died out.
        alive = self.stages_fitted > 0 and len(self.mixture.means) == components
        self.stages_fitted += 1
        self.mixture = GaussianMixture.fit(
            self.tempered_posterior,
            components,
            self.rng,
            start=self.mixture if alive else None,
            iterations=4 if alive else 10,
        )
        self.independent = self.mixture.widened(1 + 0.6 / dimension, freedom=5)

    def mutate(self) -> None:
        """Move the particles until they have forgotten their places."""
        origin = self.tempered_posterior.copy()
        self.nan_scores = 0
        rates: list[float] = []
        while len(rates) < self.max_moves:
            # Walking reaches those in the tails, where proposals from the mixture are rare. They
            # will carry the weight of the next stage if the likelihood lies that way.
            rates += [self._move_independently(), self._walk()]
            forgotten = _largest_correlation(origin, self.tempered_posterior) < self.forget
            if forgotten and len(rates) >= _FEWEST_MOVES:
                break
        self.moves = len(rates)
        self.acceptance = float(np.mean(rates))

    def _move_independently(self) -> float:
        proposal = self.independent.draw(self.draws, self.rng)
        log_ratio = self.independent.log_density(self.tempered_posterior)
        return self._accept(proposal, log_ratio - self.independent.log_density(proposal))

    def _walk(self) -> float:
        # The component is drawn by its responsibility for the particle, so that steps follow a bent
        # ridge; the ratio of responsibilities makes the move reversible.
        here = self.mixture.responsibilities(self.tempered_posterior)
        component = (here.cumsum(axis=1) < self.rng.random((self.draws, 1))).sum(axis=1)
        component = component.clip(max=here.shape[1] - 1)
        steps = self.walk_scale * self.mixture.draw_steps(component, self.rng)
        proposal = self.tempered_posterior + steps
        there = self.mixture.responsibilities(proposal)
        chosen = np.arange(self.draws), component
        with np.errstate(divide="ignore"):
            rate = self._accept(proposal, np.log(there[chosen]) - np.log(here[chosen]))
        self.walk_scale *= np.exp(rate - 0.3)
        return rate

    def _accept(self, proposal: Array, log_ratio: Array) -> float:
        """Metropolis-Hastings step of all particles; the rate of acceptance."""
        prior, likelihood = self.score(proposal)
        logp = prior + self.beta * likelihood
        threshold = -self.rng.exponential(size=self.draws)
        with np.errstate(invalid="ignore"):
            accepted = threshold < logp - self.tempered_posterior_logp + log_ratio
        self.tempered_posterior[accepted] = proposal[accepted]
        self.prior_logp[accepted] = prior[accepted]
        self.likelihood_logp[accepted] = likelihood[accepted]
        self.tempered_posterior_logp[accepted] = logp[accepted]
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
            "forget": self.forget,
            "max_moves": self.max_moves,
        }


def sample_smc(
    model: pm.Model,
    draws: int = 2000,
    chains: int = 4,
    random_seed: Any = None,
    progressbar: bool = True,
    *,
    start: Sequence[dict[str, Array]] | None = None,
    var_names: Sequence[str] | None = None,
    **kernel_settings: Any,
) -> xr.DataTree:
    """Sample a model by sequential Monte Carlo and estimate its evidence.

    Parameters
    ----------
    model : pymc.Model
        Any model with continuous variables.
    draws : int
        Number of particles of a chain.
    chains : int
        Number of independent runs.
    random_seed : int or sequence of int, optional
        One seed for the whole; the same seed gives the same result.
    progressbar : bool
        Whether to show progress. After an interrupt the chains already complete are returned.
    start : sequence of dict, optional
        Initial particles of each chain on the unconstrained scale, see :class:`BatchedSMC`.
    var_names : sequence of str, optional
        Variables to keep in the posterior; all free variables and deterministics when missing.
    **kernel_settings
        Further settings of :class:`BatchedSMC`, such as ``threshold``.

    Returns
    -------
    xarray.DataTree
        ArviZ schema: ``posterior`` and ``unconstrained_posterior`` (chain, draw), ``sample_stats``
        (chain, stage; padded with NaN where a chain had fewer stages) and ``evidence`` (chain).

    Raises
    ------
    TypeError, ValueError
        If a model has discrete variables, nothing to temper, or no finite likelihood anywhere, or
        a setting is impossible.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1")
    >>> model = ph.ogden_model(data, sigma=5 * ph.mmHg, slope_weight=3.0)
    >>> tree = ph.sample_smc(model, draws=500, chains=2, random_seed=1, progressbar=False)
    >>> tree["posterior"].sizes["draw"]
    500
    """
    if not isinstance(model, pm.Model):
        raise TypeError(f"expected a pm.Model, not {type(model).__name__}")
    _check_count("chains", chains, 1)
    if start is not None and len(start) != chains:
        raise ValueError(f"start holds {len(start)} dict(s) of particles for {chains} chains")
    variables = _variables_to_keep(model, var_names)
    # Chosen here if it was not given, so that every result can be had again.
    random_seed = seed_sequence(random_seed).entropy
    kernel = BatchedSMC(draws=draws, model=model, **kernel_settings)
    populations: list[Array] = []
    stats: list[dict[str, list[float]]] = []
    with SMCProgressBarManager(kernel, chains, progressbar) as progress:
        for chain, seed in enumerate(np.random.SeedSequence(random_seed).spawn(chains)):
            kernel.initialize(start[chain] if start else None, np.random.default_rng(seed))
            try:
                stats.append(_temper(kernel, chain, progress))
            except KeyboardInterrupt:
                if not populations:
                    raise
                warnings.warn(f"interrupted: {chain} of {chains} chains are complete", stacklevel=2)
                break
            populations.append(kernel.tempered_posterior)
    return _to_datatree(kernel, populations, stats, variables, random_seed)


def seed_sequence(random_seed: Any) -> np.random.SeedSequence:
    """Seed sequence of a number, several numbers or None; its entropy can be written as JSON."""
    try:
        return np.random.SeedSequence(
            None if random_seed is None else np.asarray(random_seed).tolist()
        )
    except (TypeError, ValueError) as error:
        raise type(error)(
            f"random_seed is {random_seed!r}; expected a whole number, not negative, or several"
        ) from None


def _check_count(name: str, value: Any, least: int) -> None:
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise TypeError(f"{name} is {value!r}; expected a whole number")
    if value < least:
        raise ValueError(f"{name} is {value}; expected at least {least}")


def _variables_to_keep(model: pm.Model, var_names: Sequence[str] | None) -> list[TensorVariable]:
    variables = {v.name: v for v in model.unobserved_RVs}
    if isinstance(var_names, str):
        raise TypeError(f"var_names must be a list of names, not {var_names!r}")
    lacking = sorted(set(var_names or ()) - set(variables))
    if lacking:
        raise ValueError(f"the model has no variables {lacking} to keep; it has {list(variables)}")
    return [v for name, v in variables.items() if var_names is None or name in var_names]


def log_evidence(tree: xr.DataTree) -> Estimate:
    r"""Log evidence (log marginal likelihood) of a sampled model, with its standard error.

    The evidences of independent chains are averaged. The relative variance of one chain is the
    larger of two estimates: that from within the chains (see :class:`BatchedSMC`), and the spread
    between them.

    Parameters
    ----------
    tree : xarray.DataTree
        Result of :func:`sample_smc`, or one class of :func:`pymc_hyperelastic.fit_classes`.

    Returns
    -------
    Estimate
        The pair (value, standard error), in nats.

    Raises
    ------
    ValueError
        If the result holds no evidence.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.select(ph.load_dataset("simulated_sheep_aorta"), specimen="S1")
    >>> model = ph.ogden_model(data, sigma=5 * ph.mmHg, slope_weight=3.0)
    >>> tree = ph.sample_smc(model, draws=500, chains=2, random_seed=1, progressbar=False)
    >>> value, standard_error = ph.log_evidence(tree)
    """
    check_result(tree)
    if "evidence" not in tree.children:
        raise ValueError(
            f"the result has no evidence; its groups are {sorted(tree.children)}. It comes from "
            "ph.sample_smc or ph.fit_classes (for a class: ph.log_evidence(classes['C1']))"
        )
    evidence = tree["evidence"]
    return combine_chains(evidence["log_evidence"].values, evidence["log_evidence_se"].values)


def combine_chains(log_evidences: Array, standard_errors: Array) -> Estimate:
    """Mean evidence of independent chains, as its logarithm with a standard error."""
    chains = len(log_evidences)
    value = logsumexp(log_evidences) - np.log(chains)
    variance = np.mean(np.square(standard_errors))
    if chains > 1:
        variance = max(variance, np.var(np.exp(log_evidences - value), ddof=1))
    return Estimate(float(value), float(np.sqrt(variance / chains)))


def _temper(
    kernel: BatchedSMC, chain: int, progress: SMCProgressBarManager
) -> dict[str, list[float]]:
    """Run one chain from the prior to the posterior; what each stage reports."""
    stages: dict[str, list[float]] = {name: [] for name in kernel.stats_dtypes_shapes}
    while kernel.beta < 1:
        beta = kernel.beta
        kernel.update_beta_and_weights()
        progress.update(chain, len(stages["beta"]), kernel.beta, beta)
        for name, value in kernel.step().items():
            stages[name].append(value)
    progress.update(chain, len(stages["beta"]), 1.0, 1.0, is_last=True)
    return stages


def _to_datatree(
    kernel: BatchedSMC,
    populations: list[Array],
    stats: list[dict[str, list[float]]],
    variables: list[TensorVariable],
    random_seed: Any,
) -> xr.DataTree:
    model = kernel.model
    constrain = BatchedFunction.of_model(model, model.replace_rvs_by_values(variables))
    chains = [constrain(population) for population in populations]
    posterior = {v.name: np.stack([chain[i] for chain in chains]) for i, v in enumerate(variables)}
    particles = np.stack(populations)
    unconstrained, start = {}, 0
    for name, (shape, size) in kernel.var_info.items():
        column = particles[..., start : start + size]
        unconstrained[name] = column.reshape(*particles.shape[:2], *shape)
        start += size
    return sampling_tree(
        model, posterior, unconstrained, stats, kernel.sample_settings(), random_seed
    )


def _effective_sample_size(log_weights: Array) -> float:
    return float(np.exp(2 * logsumexp(log_weights) - logsumexp(2 * log_weights)))


def _largest_correlation(before: Array, after: Array) -> float:
    """Largest correlation of a variable with its own value before."""
    before, after = before - before.mean(axis=0), after - after.mean(axis=0)
    norm = np.sqrt((before**2).sum(axis=0) * (after**2).sum(axis=0))
    return float(np.max(np.abs((before * after).sum(axis=0)) / np.maximum(norm, 1e-300)))
