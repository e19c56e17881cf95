"""A kernel for PyMC's sequential Monte Carlo that scores all particles in one call."""

from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np
import pymc as pm
from pymc.smc.kernels import SMC_KERNEL

from pymc_hyperelastic.evidence.checks import check_count, check_fraction, no_progress
from pymc_hyperelastic.evidence.mixture import Array
from pymc_hyperelastic.evidence.path import GeometricPath
from pymc_hyperelastic.evidence.search import Search, find_reference
from pymc_hyperelastic.evidence.target import Target, check_possible
from pymc_hyperelastic.evidence.tempering import Settings, TemperedSMC

# Unknowns of a reference, at most: a covariance of more is not known from some thousand particles.
_MOST_UNKNOWNS = 300
# Unknowns times numbers that are computed for a point, at most: more would take hours.
_MOST_NUMBERS = 1_000_000
# Unknowns up to which it does not matter how many numbers are computed.
_FEW_UNKNOWNS = 50


class BatchedSMC(SMC_KERNEL):
    r"""SMC kernel that tempers a whole population of particles in vectorised calls.

    Particles start from a reference ``r`` and are led along ``r^(1-β) p^β`` to the posterior ``p``,
    where ``β`` grows from 0 to 1. After each step of ``β`` they are resampled, and move until they
    have forgotten where they were; all places on their way count at the next stage [1]_.

    The reference is a mixture with a share of the prior, found from both ends [2]_: from particles
    tempered from the prior, and from modes. Moves are independent draws of a mixture with heavy
    tails, in turn with Hamiltonian Monte Carlo, or with random walks where there are few unknowns
    or no gradients.

    Use it in ``pm.sample_smc(kernel=...)``, or through :func:`sample_smc`.

    Parameters
    ----------
    draws : int
        Number of particles.
    start : dict of str to array, optional
        Initial particles by name of the value variable, on its unconstrained scale.
    model : pymc.Model, optional
        A model with continuous variables; that of the context when missing.
    random_seed : int, optional
        Seed of the particles.
    threshold : float
        Fraction of the effective sample size to be kept at each stage. After ``m`` moves at the
        stage before, ``m/(m + 5)`` is kept if that is more.
    compile_kwargs : dict, optional
        Options of ``pytensor.function``. By default particles are scored by NumPy, which compiles
        in a second; ``{"mode": "NUMBA"}`` takes a minute and scores faster.
    tempered : sequence of str, optional
        Names of the observed variables and Potentials whose likelihood is tempered; all when
        missing. The others count as prior, from which `start` must then be drawn.
    from_modes : bool, optional
        If True, particles start from a reference; if False, from the prior alone. By default they
        start from a reference unless `start` or `tempered` are given, which exclude a reference.
    forget : float
        Particles move until the correlation of every variable with its value before is below this.
    max_moves : int
        Largest number of moves at one stage; there are at least 4 if it is not below that. A chain
        whose particles have not moved enough at six stages moves them once at each further stage:
        its evidence has an infinite error.

    Raises
    ------
    ValueError
        If the model has discrete variables or nothing to temper; if it has more than 300 unknowns,
        or more than 50 and a density that takes long; or if no particle has a finite likelihood.

    See Also
    --------
    sample_smc

    Notes
    -----
    The evidence is the product of the mean weights of the stages. Its relative variance is
    estimated from the genealogy [3]_ [4]_: with ``w`` the mean weight on a particle's way divided
    by that of all,

    .. math:: \frac{1}{N^2} \sum_{e=1}^N \Big( \sum_{\text{descendants of } e} (w - 1) \Big)^2,

    summed over the initial particles ``e`` and, inside, over all stages.

    The ``effective_sample_size`` of a stage is that of all places visited; it may exceed the number
    of particles. Scores that are NaN count as ``−inf``; ``nan_scores`` is their number so far.

    References
    ----------
    .. [1] H.-D. Dau and N. Chopin, Waste-free sequential Monte Carlo, Journal of the Royal
       Statistical Society B 84 (2022) 114.
    .. [2] N. Surjanovic, S. Syed, A. Bouchard-Côté and T. Campbell, Parallel tempering with
       a variational reference, Advances in Neural Information Processing Systems 35 (2022) 565.
    .. [3] H. P. Chan and T. L. Lai, A general theory of particle filters in hidden Markov models
       and some applications, Annals of Statistics 41 (2013) 2877.
    .. [4] A. Lee and N. Whiteley, Variance estimation in the particle filter, Biometrika 105 (2018)
       609.

    Examples
    --------
    >>> import pymc as pm, pymc_hyperelastic as ph
    >>> with pm.Model():
    ...     mean = pm.Normal("mean", 0, 1)
    ...     y = pm.Normal("y", mean, 1, observed=[0.5, 1.5])
    ...     tree = pm.sample_smc(
    ...         500, kernel=ph.BatchedSMC, chains=2, cores=1, random_seed=1, progressbar=False
    ...     )
    >>> bool(abs(tree["posterior"]["mean"].mean() - 2 / 3) < 0.1)
    True
    """

    stats_dtypes_shapes: ClassVar[dict[str, tuple[type, list]]] = {
        **dict.fromkeys(("beta", "log_marginal_likelihood", "log_evidence_variance"), (float, [])),
        **dict.fromkeys(("effective_sample_size", "accept_rate", "pareto_k"), (float, [])),
        **dict.fromkeys(("moves", "capped", "ancestors", "nan_scores"), (int, [])),
    }
    search: Search | None

    def __init__(
        self,
        draws: int = 2000,
        start: dict[str, Array] | None = None,
        model: pm.Model | None = None,
        random_seed: Any = None,
        threshold: float = Settings.threshold,
        compile_kwargs: dict | None = None,
        *,
        tempered: Sequence[str] | None = None,
        from_modes: bool | None = None,
        forget: float = Settings.forget,
        max_moves: int = Settings.max_moves,
    ) -> None:
        # The base class, which is not called, would compile functions that score one particle.
        check_fraction("forget", forget)
        check_fraction("threshold", threshold)
        check_count("max_moves", max_moves, 1)
        self.model = model = pm.modelcontext(model)
        self.variables = model.value_vars
        self.target = Target(model, tempered, compile_kwargs)
        self.var_info, self.dimension = self.target.var_info, self.target.dimension
        alone = start is not None or tempered is not None
        if from_modes and alone:
            raise ValueError("from_modes is for particles that start from the prior, all tempered")
        self.from_modes = not alone if from_modes is None else from_modes
        if self.from_modes:
            self._check_size()
        # With fewer particles they have no covariance.
        check_count("draws", draws, self.dimension + 2)
        self.draws, self.start = draws, start
        self.settings = Settings(threshold, forget, max_moves)
        self.rng = np.random.default_rng(random_seed)
        self.search = None
        self._reset_state()

    def _check_size(self) -> None:
        """Raise if there are too many unknowns for a reference."""
        if self.dimension > _MOST_UNKNOWNS:
            why = f"more than the {_MOST_UNKNOWNS} of which particles can know a reference"
        elif self.dimension > _FEW_UNKNOWNS and self.dimension * self.target.cost() > _MOST_NUMBERS:
            why = "and its density takes so long that it would be hours until a reference is known"
        else:
            return
        raise ValueError(
            f"the model has {self.dimension} unknowns, {why}: sample it with NUTS (pm.sample), and "
            "take ph.bridge_sampling; or for classes of specimens ph.fit_classes"
        )

    def set_rng(self, rng: np.random.Generator) -> None:
        """Set the random generator; PyMC's own method copies functions that are not there."""
        self.rng = rng

    def find_reference(self, rng: np.random.Generator) -> None:
        """Find the reference from which chains start, if they start from one."""
        self.search = find_reference(self.target, rng) if self.from_modes else None

    def temper(
        self,
        start: dict[str, Array] | None,
        rng: np.random.Generator,
        report: Callable[[list[dict[str, float]]], None] = no_progress,
    ) -> list[dict[str, float]]:
        """Run one chain and return the statistics of its stages; `report` is called with each."""
        self.initialize(start, rng)
        stages: list[dict[str, float]] = []
        while self.beta < 1:
            self.update_beta_and_weights()
            stages.append(self.step())
            report(stages)
        return stages

    def _initialize_kernel(self) -> None:
        reference, start = None, self.start
        if start:
            if set(start) != set(self.var_info):
                raise ValueError(
                    f"start must hold the particles of {list(self.var_info)}; it has {list(start)}"
                )
            particles = self.target.columns(start)
        elif self.from_modes:
            if self.search is None:
                self.find_reference(self.rng)
            assert self.search is not None
            reference = self.search.reference
            particles = reference.draw(self.target.draw_prior, self.draws, self.rng)
        else:
            particles = self.target.draw_prior(self.draws, self.rng)
        self.draws = len(particles)
        path = GeometricPath(self.target, reference)
        self.tempering = TemperedSMC(path, particles, self.rng, self.settings)
        points = f"the {self.draws} initial particles"
        check_possible(self.tempering.possible, path.nan_count, points)
        self._read()

    def update_beta_and_weights(self) -> None:
        """Raise ``β`` as far as the effective sample size allows, and take the evidence's step."""
        self.iteration += 1
        self.tempering.reweight()
        self._read()

    def resample(self) -> None:
        """Resample the particles systematically from all places visited."""
        self.tempering.resample()

    def tune(self) -> None:
        """Fit the mixture from which moves are drawn."""
        self.tempering.adapt()

    def mutate(self) -> None:
        """Move the particles until they have forgotten their places."""
        self.tempering.move()
        self._read()

    def _read(self) -> None:
        """Set the attributes of a kernel that PyMC reads."""
        self.beta = self.tempering.beta
        self.log_marginal_likelihood = self.tempering.log_evidence
        self.tempered_posterior = self.tempering.particles

    def sample_stats(self) -> dict[str, float]:
        """Return the statistics of the last stage."""
        tempering = self.tempering
        return {
            "beta": tempering.beta,
            "log_marginal_likelihood": tempering.log_evidence,
            "log_evidence_variance": tempering.variance,
            "effective_sample_size": tempering.effective_sample_size,
            "accept_rate": tempering.acceptance,
            "moves": tempering.moves,
            "capped": int(tempering.stage_capped),
            "ancestors": tempering.ancestors,
            "pareto_k": tempering.pareto_k,
            "nan_scores": tempering.path.nan_count,
        }

    def sample_settings(self) -> dict[str, float]:
        """Settings of the run."""
        own = {name: getattr(self.settings, name) for name in ("threshold", "forget", "max_moves")}
        return {"_n_draws": self.draws, "from_modes": int(self.from_modes), **own}
