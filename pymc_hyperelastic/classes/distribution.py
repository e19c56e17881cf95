"""The distribution of a class, fitted to draws of its specimens: as many as its evidence needs."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pytensor.compile.sharedvalue import SharedVariable

from pymc_hyperelastic.classes.checks import CHECKS_OF_SPECIMENS
from pymc_hyperelastic.classes.specimen_evidence import variance_of_specimen
from pymc_hyperelastic.classes.specimens import (
    PARTICLES,
    SpecimenSampler,
    class_model,
    shared_draws,
)
from pymc_hyperelastic.data.select import specimens_apart
from pymc_hyperelastic.evidence.checks import no_progress
from pymc_hyperelastic.evidence.diagnosis import with_diagnosis
from pymc_hyperelastic.evidence.importance import (
    LARGEST_PARETO_K,
    MOST_UNKNOWNS,
    Integral,
    importance_sampling,
)
from pymc_hyperelastic.evidence.integral import BridgeFromParticles, integrate
from pymc_hyperelastic.evidence.kernel import BatchedSMC
from pymc_hyperelastic.evidence.mixture import GaussianMixture, components_for
from pymc_hyperelastic.evidence.proposal import expectation_maximisation
from pymc_hyperelastic.evidence.smc import particles_to_tree
from pymc_hyperelastic.evidence.target import Target
from pymc_hyperelastic.evidence.verdicts import registered_checks
from pymc_hyperelastic.messages import PACKAGE
from pymc_hyperelastic.models.class_distribution import distributions_of
from pymc_hyperelastic.models.population import Population
from pymc_hyperelastic.models.specimen_draws import SpecimenDraws, stacked

Array = NDArray[np.float64]

# Draws that stand for a specimen in the model of its class, at first: its density, which is mostly
# far wider than what a specimen's curves leave open, is averaged over them.
_IN_CLASS = 256
# A guide has so many times fewer, and so many at least: the evidence of a class of these differs
# by a fraction of a nat from place to place, and particles mostly stay where it has led them.
_GUIDE, _IN_GUIDE = 16, 64
# Nats, of the standard error that these draws leave to a class's evidence. Below the first number
# the densities of all draws are so alike that none is lacking; above the second so many are that
# the class of which a specimen was taken was another one. Evidences of classes are compared, and
# the third is little there; since it is known roughly, draws are added until half is expected.
_ALIKE, _ANOTHER, _ENOUGH = 0.03, 0.3, 0.1
# Fits by which it is found how many draws are needed; particles and distributions of a first one,
# and draws of the prior that lead to it.
_MOST_FITS, _PARTICLES, _DISTRIBUTIONS, _PRIOR_DRAWS = 4, 500, 200, 2000
# Draws of a class's distribution of which one becomes a particle.
_DRAWS_OF_EACH = 4

Specimens = Mapping[str, SpecimenDraws]

registered_checks.append(CHECKS_OF_SPECIMENS)


class ClassDraws(NamedTuple):
    """Draws of the specimens of a class, how many of each it needs, and particles near its own."""

    specimens: Specimens
    size: int
    particles: Array | None


class ClassModel:
    """Model of a class's distribution, made once for classes of as many specimens and draws."""

    def __init__(self, settings: Population) -> None:
        self.settings = settings
        # By the numbers of specimens and draws, on which it depends how many points fit into cache.
        self._made: dict[tuple[int, ...], tuple[dict[str, SharedVariable], BatchedSMC]] = {}

    def kernel(self, draws: Specimens, count: int) -> BatchedSMC:
        """Sampler of so many particles, of draws that stand for the specimens from now on."""
        arrays = stacked([*draws.values()])
        size = arrays["log_weight"].shape
        if size not in self._made:
            shared = shared_draws(draws.values())
            self._made[size] = shared, BatchedSMC(model=class_model(self.settings, shared))
        shared, kernel = self._made[size]
        for name, value in arrays.items():
            shared[name].set_value(value)
        kernel.draws = count
        return kernel

    def variances(self, tree: xr.DataTree, draws: Specimens, size: int) -> dict[str, float]:
        """What so many draws of each specimen leave open of the evidence of a fitted class."""
        distributions = distributions_of(tree, _DISTRIBUTIONS)
        return {n: variance_of_specimen(d, distributions, size) for n, d in draws.items()}


def draws_of_class(
    model: ClassModel,
    sampler: SpecimenSampler,
    data: xr.Dataset,
    specimens: Specimens,
    rng: np.random.Generator,
) -> ClassDraws:
    """Draws of each specimen as one of its class, where those under a wider distribution are few.

    What curves leave open only the class tells, and few of the draws of a specimen then are where
    the class has it. It is sampled again, under the distributions of a class that was fitted to the
    draws so far.
    """
    known, close = None, dict(specimens)
    for limit in (_ALIKE, _ANOTHER):
        fit = _Fit(model, close, _IN_CLASS, _PARTICLES, known)
        tree = fit.chains(rng.spawn(1))
        known = fit.known
        variances = fit.variances(tree)
        if sum(variances.values()) < limit**2:
            break
        distributions = distributions_of(tree, _DISTRIBUTIONS)
        for name, part in specimens_apart(data).items():
            found = sampler.near(part, specimens[name], distributions, rng)
            # One that was given up, and then found, is not lost again.
            if np.isfinite(found.standard_error):
                close[name] = found
    for name, draws in close.items():
        if not np.isfinite(draws.standard_error):
            said = (
                f"specimen {name!r} was given up after long, or has curves that are wrong, and its "
                "class has no evidence: leave it out, or give more informative priors"
            )
            warnings.warn(said, skip_file_prefixes=(PACKAGE,))
    return ClassDraws(close, _larger(_IN_CLASS, sum(variances.values())), known)


class _Fit:
    """A class, of so many of the draws that stand for its specimens."""

    def __init__(
        self, model: Any, draws: Mapping[str, Any], size: int, count: int, known: Array | None
    ) -> None:
        self.model, self.draws, self.size, self.known = model, draws, size, known
        self._mixture: GaussianMixture | None = None
        self._bridge: BridgeFromParticles | None = None
        self.kernel = self._kernel(size, count)

    def _kernel(self, size: int, count: int) -> BatchedSMC:
        few = {name: specimen.first(size) for name, specimen in self.draws.items()}
        return self.model.kernel(few, count)

    @cached_property
    def _guide(self) -> Target | None:
        """The class of few draws, whose slopes take a fraction of the time."""
        few = max(self.size // _GUIDE, _IN_GUIDE)
        return self._kernel(few, self.kernel.draws).target if few < self.size else None

    def variances(self, tree: xr.DataTree) -> dict[str, float]:
        """What the draws of each specimen leave open of the evidence."""
        return self.model.variances(tree, self.draws, self.size)

    def chains(
        self,
        rngs: Sequence[np.random.Generator],
        entropy: Any = None,
        advance: Callable[[], None] = no_progress,
    ) -> xr.DataTree:
        """Posterior and evidence; `advance` is called after each chain."""
        integrals = []
        for rng in rngs:
            integrals.append(self._chain(rng))
            advance()
        stats: list[list[dict[str, float]]] = [
            [
                {
                    "beta": 1.0,
                    "log_marginal_likelihood": i.log_value.value,
                    "log_evidence_variance": i.log_value.standard_error**2,
                    "pareto_k": i.pareto_k,
                }
            ]
            for i in integrals
        ]
        populations = [i.particles for i in integrals]
        variables = self.kernel.model.unobserved_RVs
        tree = particles_to_tree(self.kernel, populations, stats, variables, entropy)
        method = "chain", [i.method for i in integrals]
        tree["evidence"] = tree["evidence"].to_dataset().assign(method=method)
        return tree

    def _chain(self, rng: np.random.Generator) -> Integral:
        """Particles and evidence.

        A class is not much narrower than its prior, which leads to it: its modes are searched only
        where neither particles nor the prior tell of them.
        """
        target, count = self.kernel.target, self.kernel.draws
        if target.dimension > MOST_UNKNOWNS:
            self._bridge = self._bridge or BridgeFromParticles(target, rng, self.known, self._guide)
            found = self._bridge.integral(count, rng)
            self.known = found.particles
            return found
        found = importance_sampling(
            target.score,
            self._initial_proposal(rng),
            expectation_maximisation,
            count,
            rng,
            draw_prior=target.draw_prior,
            draws=_DRAWS_OF_EACH * count,
        )
        if not found.pareto_k < LARGEST_PARETO_K:
            found = integrate(target, count, rng)
            self.known = None
        if self.known is None:
            self.known, self._mixture = found.particles, None
        return found

    def _initial_proposal(self, rng: np.random.Generator) -> GaussianMixture:
        """Return a mixture that is roughly like the posterior, or wider."""
        if self.known is None:
            target = self.kernel.target
            return GaussianMixture.fit(target.draw_prior(_PRIOR_DRAWS, rng), 1, rng)
        components = components_for(len(self.known), self.kernel.dimension)
        self._mixture = self._mixture or GaussianMixture.fit(self.known, components, rng)
        return self._mixture


def fit_distribution(
    model: ClassModel,
    draws: ClassDraws,
    count: int,
    chains: int,
    random_seed: np.random.SeedSequence,
    advance: Callable[[], None] = no_progress,
) -> xr.DataTree:
    """Posterior and evidence of a class's distribution, with the draws of its specimens.

    After each chain `advance` is called; where more draws are needed, chains are fitted again.

    Both say by which ``method`` an integral was found, with the ``pareto_k`` of its weights:
    ``evidence`` by chain, and ``specimens`` by specimen.
    """
    specimens = draws.specimens
    tree = fit_enough(model, draws, count, chains, random_seed, advance)
    dims = {
        "centre": ("specimen", "coordinate", "particle"),
        "scatter": ("specimen", "coordinate", "particle"),
        "log_size": ("specimen", "noise", "particle"),
        "deviations": ("specimen", "measure", "particle"),
        "log_weight": ("specimen", "particle"),
        "tests": ("specimen",),
        "standard_error": ("specimen",),
        "misfit": ("specimen",),
        "freedom": ("specimen",),
        "method": ("specimen",),
        "pareto_k": ("specimen",),
    }
    tree["specimens"] = xr.Dataset(
        {k: (v, np.stack([getattr(d, k) for d in specimens.values()])) for k, v in dims.items()},
        {
            "specimen": list(specimens),
            "coordinate": model.settings.scale.names,
            "noise": model.settings.noises,
            "measure": list(model.settings.geometry),
        },
    )
    return with_diagnosis(tree)


def fit_enough(
    model: Any,
    draws: Any,
    count: int,
    chains: int,
    random_seed: np.random.SeedSequence,
    advance: Callable[[], None] = no_progress,
) -> xr.DataTree:
    """Posterior and evidence by as many of the draws as leave little of it open."""
    rngs = [np.random.default_rng(seed) for seed in random_seed.spawn(chains)]
    specimens, size, known = draws
    for _ in range(_MOST_FITS):
        fit = _Fit(model, specimens, size, count, known)
        tree = fit.chains(rngs, random_seed.entropy, advance)
        advance = no_progress
        variance, known = sum(fit.variances(tree).values()), fit.known
        if size == PARTICLES or variance < _ENOUGH**2:
            break
        size = _larger(size, variance)
    error = float(np.sqrt(variance))
    tree["evidence"] = tree["evidence"].to_dataset().assign(specimens_se=error)
    return tree


def _larger(size: int, variance: float) -> int:
    """Number of draws of each specimen, doubled until it would be enough."""
    while size < PARTICLES and variance > (_ENOUGH / 2) ** 2:
        size, variance = min(2 * size, PARTICLES), variance / 2
    return size
