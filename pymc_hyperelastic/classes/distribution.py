"""Fit the distribution of a class to draws of its specimens.

The number of draws of each specimen is increased until the error that they cause in the evidence of
the class is small. Classes with variability and joint fits of groups use this module.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.compile.sharedvalue import SharedVariable

from pymc_hyperelastic.classes.checks import CHECKS_OF_SPECIMENS
from pymc_hyperelastic.classes.specimen_evidence import variance_of_specimen
from pymc_hyperelastic.classes.specimens import PARTICLES, SpecimenSampler
from pymc_hyperelastic.data.select import specimens_apart
from pymc_hyperelastic.evidence.batched import without_traces
from pymc_hyperelastic.evidence.checks import no_progress
from pymc_hyperelastic.evidence.diagnosis import with_diagnosis
from pymc_hyperelastic.evidence.importance import (
    LARGEST_ERROR,
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
from pymc_hyperelastic.messages import warn_user
from pymc_hyperelastic.models.class_distribution import distributions_of
from pymc_hyperelastic.models.population import Population
from pymc_hyperelastic.models.specimen_draws import SpecimenDraws, log_density, stacked

Array = NDArray[np.float64]

# Numbers of draws that may represent a specimen in the model of its class. The class density is
# averaged over them; it is mostly far wider than the specimen's posterior, and few are enough.
DRAW_COUNTS = PARTICLES // np.array([8, 4, 2, 1])
# The guide, a cheaper target whose gradients lead the particles, has fewer draws by this factor.
# Its log density differs from that of the class by a fraction of a nat, so most moves are accepted.
_GUIDE_FACTOR = 16
# Fewest draws of a specimen in the guide.
_FEWEST_GUIDE_DRAWS = 64
# Standard error, in nats, above which specimens are sampled a third time: the class distribution
# that was their prior the second time was inaccurate, because the first draws were too few.
_INACCURATE = 0.3
# Number of particles of the fits before the final ones.
_FIRST_PARTICLES = 500
# Largest number of draws of the class distribution for estimates of the error, and for new priors.
DISTRIBUTIONS = 200
# Number of prior draws to which the first proposal is fitted.
_PRIOR_DRAWS = 2000
# Number of draws of the proposal for each particle.
_DRAWS_PER_PARTICLE = 4

Specimens = Mapping[str, SpecimenDraws]

registered_checks.append(CHECKS_OF_SPECIMENS)


def shared_draws(specimens: Iterable[SpecimenDraws]) -> dict[str, SharedVariable]:
    """Return the draws of all specimens of a class as shared variables, whose values may change.

    All specimens must have the same number of draws.
    """
    return {
        name: pytensor.shared(value, name=f"specimens_{name}", shape=(None,) * value.ndim)
        for name, value in stacked([*specimens]).items()
    }


@without_traces
def class_model(population: Population, shared: Mapping[str, SharedVariable]) -> pm.Model:
    """Return the PyMC model of a class distribution, with its specimens integrated out.

    The likelihood of each specimen is a weighted sum over its draws, which may be replaced.
    """
    names = population.scale.names
    with pm.Model(coords={"coordinate": names, "coordinate_2": names}, model=None) as model:
        distribution = population.register_class()
        inputs = dict(shared) | {"tests": pt.specify_broadcastable(shared["tests"], 1)}
        terms = inputs["log_weight"] + log_density(pt, inputs, distribution)
        pm.Potential("specimens", pt.sum(pt.logsumexp(terms, axis=-1)))
    return model


class ClassDraws(NamedTuple):
    """Draws of the specimens of a class, for :func:`fit_enough`."""

    specimens: Specimens
    """Draws of each specimen by its name."""
    size: int
    """Number of draws of each specimen that the first fit uses."""
    particles: Array | None
    """Particles of an earlier fit, to which the first proposal is fitted."""


class ClassModel:
    """Compiled model of a class distribution, for classes with the same settings.

    The model is compiled once for each pair of numbers of specimens and draws.
    """

    def __init__(self, settings: Population) -> None:
        self.settings = settings
        # The numbers of specimens and draws decide how many points are evaluated at once.
        self._kernels: dict[tuple[int, ...], tuple[dict[str, SharedVariable], BatchedSMC]] = {}

    def kernel(self, draws: Specimens, count: int) -> BatchedSMC:
        """Return the SMC kernel with `count` particles, and set the draws of its specimens."""
        arrays = stacked([*draws.values()])
        size = arrays["log_weight"].shape
        if size not in self._kernels:
            shared = shared_draws(draws.values())
            self._kernels[size] = shared, BatchedSMC(model=class_model(self.settings, shared))
        shared, kernel = self._kernels[size]
        for name, value in arrays.items():
            shared[name].set_value(value)
        kernel.draws = count
        return kernel

    def variances(self, tree: xr.DataTree, draws: Specimens) -> Array:
        """Variance of the log evidence of a fitted class, for each of `DRAW_COUNTS`."""
        distributions = distributions_of(tree, DISTRIBUTIONS)
        each = [variance_of_specimen(d, distributions, DRAW_COUNTS) for d in draws.values()]
        return np.sum(each, axis=0)


def draws_of_class(
    model: ClassModel,
    sampler: SpecimenSampler,
    data: xr.Dataset,
    specimens: Specimens,
    rng: np.random.Generator,
) -> ClassDraws:
    """Sample the specimens of a class again, with a fitted class distribution as the prior.

    The curves of a specimen may not constrain some coordinates. Few of its draws under the wide
    reference distribution then lie where the class density is large. The class is therefore fitted
    to these draws, and the specimens are sampled again under the fitted distribution, at most
    twice. They are not sampled again if the error of the class's evidence is small enough.

    Warns
    -----
    UserWarning
        If the draws of a specimen have an infinite error.
    """
    particles, current = None, dict(specimens)
    for limit in (LARGEST_ERROR, _INACCURATE):
        fit = _Fit(model, current, int(DRAW_COUNTS[0]), _FIRST_PARTICLES, particles)
        tree = fit.chains(rng.spawn(1))
        particles, variances = fit.particles, model.variances(tree, current)
        if variances[0] < limit**2:
            break
        distributions = distributions_of(tree, DISTRIBUTIONS)
        for name, part in specimens_apart(data).items():
            found = sampler.near(part, specimens[name], distributions, rng)
            # If this sample failed, an earlier successful one is kept.
            if np.isfinite(found.standard_error):
                current[name] = found
    for name, draws in current.items():
        if not np.isfinite(draws.standard_error):
            message = (
                f"specimen {name!r} was given up, because its sampling did not converge or its "
                "curves are inaccurate: the evidence of its class has an infinite error. Leave the "
                "specimen out, or give more informative priors"
            )
            warn_user(message)
    return ClassDraws(current, _enough(variances), particles)


class _Fit:
    """Fit of a class distribution to the first `size` draws of each specimen.

    `count` is the number of particles. The proposal is fitted to the `particles` of an earlier fit,
    if there are any.
    """

    def __init__(
        self, model: Any, draws: Mapping[str, Any], size: int, count: int, particles: Array | None
    ) -> None:
        self.model, self.draws, self.size, self.particles = model, draws, size, particles
        self._mixture: GaussianMixture | None = None
        self._bridge: BridgeFromParticles | None = None
        self.kernel = self._kernel(size, count)

    def _kernel(self, size: int, count: int) -> BatchedSMC:
        first = {name: specimen.first(size) for name, specimen in self.draws.items()}
        return self.model.kernel(first, count)

    @cached_property
    def _guide(self) -> Target | None:
        """The class with fewer draws of each specimen, whose gradients are cheaper; or None."""
        size = max(self.size // _GUIDE_FACTOR, _FEWEST_GUIDE_DRAWS)
        return self._kernel(size, self.kernel.draws).target if size < self.size else None

    def chains(
        self,
        rngs: Sequence[np.random.Generator],
        entropy: Any = None,
        advance: Callable[[], None] = no_progress,
    ) -> xr.DataTree:
        """Return posterior and evidence with one chain for each generator.

        `advance` is called after each chain.
        """
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
        """Return particles and evidence of one chain.

        The posterior of a class is not much narrower than its prior. Importance sampling therefore
        starts from the particles of an earlier fit or from prior draws. Modes are searched only if
        it fails.
        """
        target, count = self.kernel.target, self.kernel.draws
        if target.dimension > MOST_UNKNOWNS:
            self._bridge = self._bridge or BridgeFromParticles(
                target, rng, self.particles, self._guide
            )
            found = self._bridge.integral(count, rng)
            self.particles = found.particles
            return found
        found = importance_sampling(
            target.score,
            self._initial_proposal(rng),
            expectation_maximisation,
            count,
            rng,
            draw_prior=target.draw_prior,
            draws=_DRAWS_PER_PARTICLE * count,
        )
        if not found.pareto_k < LARGEST_PARETO_K:
            found = integrate(target, count, rng)
            self.particles = None
        if self.particles is None:
            self.particles, self._mixture = found.particles, None
        return found

    def _initial_proposal(self, rng: np.random.Generator) -> GaussianMixture:
        """Return a mixture fitted to the particles of an earlier fit, or to prior draws."""
        if self.particles is None:
            target = self.kernel.target
            return GaussianMixture.fit(target.draw_prior(_PRIOR_DRAWS, rng), 1, rng)
        components = components_for(len(self.particles), self.kernel.dimension)
        self._mixture = self._mixture or GaussianMixture.fit(self.particles, components, rng)
        return self._mixture


def fit_distribution(
    model: ClassModel,
    draws: ClassDraws,
    count: int,
    chains: int,
    random_seed: np.random.SeedSequence,
    advance: Callable[[], None] = no_progress,
) -> xr.DataTree:
    """Return posterior and evidence of a class distribution, and the draws of its specimens.

    The group ``specimens`` holds the draws. Its variables ``method`` and ``pareto_k`` give the
    method of the integral of each specimen, and the Pareto shape of its weights; those of the group
    ``evidence`` give the same for each chain. `advance` is called after each chain of the first
    fit.
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
    """Return posterior and evidence of a class, with enough draws of each specimen.

    The number of draws is increased, and the fit repeated, until the error that the draws cause in
    the evidence is small. `model` is a :class:`ClassModel`, or has the same methods, and `draws`
    are :class:`ClassDraws`. `advance` is called after each chain of the first fit.
    """
    rngs = [np.random.default_rng(seed) for seed in random_seed.spawn(chains)]
    specimens, size, particles = draws
    while True:
        fit = _Fit(model, specimens, size, count, particles)
        tree = fit.chains(rngs, random_seed.entropy, advance)
        variances, particles = model.variances(tree, specimens), fit.particles
        if (enough := _enough(variances)) <= size:
            break
        size, advance = enough, no_progress
    error = float(np.sqrt(variances[np.searchsorted(DRAW_COUNTS, size)]))
    tree["evidence"] = tree["evidence"].to_dataset().assign(specimens_se=error)
    return tree


@np.errstate(invalid="ignore")  # variances may be infinite
def _enough(variances: Array) -> int:
    """Return the smallest number of draws whose variance is close to that of all draws."""
    enough = variances - variances[-1] <= LARGEST_ERROR**2
    return int(DRAW_COUNTS[enough.argmax()]) if enough.any() else PARTICLES
