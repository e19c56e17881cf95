"""Fit the distribution of a class to draws of its specimens.

The number of draws of each specimen is increased until the error that they cause in the evidence of
the class is small. Classes with variability use :class:`ClassModel`; joint fits of several groups
derive from it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.compile.sharedvalue import SharedVariable

from pymc_hyperelastic.classes.interface import DRAWS
from pymc_hyperelastic.classes.specimen_evidence import (
    DISTRIBUTIONS,
    Unit,
    unit_of_specimen,
    variance_of_shares,
)
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
from pymc_hyperelastic.messages import warn_user
from pymc_hyperelastic.models.class_distribution import ClassDistribution, distributions_of
from pymc_hyperelastic.models.population import Population
from pymc_hyperelastic.models.specimen_draws import SpecimenDraws, log_density, stacked

Array = NDArray[np.float64]

# Numbers of draws that may represent a specimen in the model of its class. The class density is
# averaged over them; it is mostly far wider than the specimen's posterior, and few are enough.
DRAW_COUNTS = PARTICLES // np.array([8, 4, 2, 1])


# Units by names of groups and of units.
Units = Mapping[str, Mapping[str, Unit]]
# Shared variables by name, for each part of the units of each group.
Shared = Mapping[str, Sequence[Mapping[str, SharedVariable]]]
# Distributions of the parts of units, by group: variables of a model, or draws.
Distributions = dict[str, tuple[ClassDistribution, ...]]


def units_of(specimens: Mapping[str, SpecimenDraws]) -> Units:
    """Return the draws of the specimens of a :class:`ClassModel`, given by their names."""
    return {"class": {name: unit_of_specimen(draws) for name, draws in specimens.items()}}


class ClassDraws(NamedTuple):
    """Draws of the specimens of a class, for :func:`fit_distribution`."""

    specimens: dict[str, SpecimenDraws]
    """Draws of each specimen by its name."""
    size: int
    """Number of draws of each specimen that the first fit uses."""
    particles: Array | None
    """Particles of an earlier fit, to which the first proposal is fitted."""


@dataclass(frozen=True)
class ClassModel:
    """Model of a class distribution whose specimens are integrated out by their draws.

    The likelihood of each specimen is a weighted sum over its draws, which may be replaced. The
    model is compiled once for each pair of numbers of specimens and draws.
    """

    population: Population
    """Settings of the classes."""

    def register(self) -> Distributions:
        """Register the variables of the model in context; return the distributions of the parts."""
        return {"class": (self.population.register_class(),)}

    def distributions(self, tree: xr.DataTree, count: int) -> Distributions:
        """Return at most `count` posterior draws of the distributions of the parts."""
        return {"class": (distributions_of(tree, count),)}

    @without_traces
    def model(self, shared: Shared) -> pm.Model:
        """Return the PyMC model for shared draws of all units."""
        names = self.population.scale.names
        with pm.Model(coords={"coordinate": names, "coordinate_2": names}, model=None) as model:
            of_groups = self.register()
            for group, parts in shared.items():
                terms = parts[0]["log_weight"]
                for inputs, distribution in zip(parts, of_groups[group], strict=True):
                    tests = pt.specify_broadcastable(inputs["tests"], 1)
                    terms = terms + log_density(pt, {**inputs, "tests": tests}, distribution)
                pm.Potential(f"specimens_{group}", pt.sum(pt.logsumexp(terms, axis=-1)))
        return model

    @cached_property
    def _kernels(self) -> dict[tuple[Any, ...], tuple[Shared, BatchedSMC]]:
        """Kernels and their shared draws, by the shapes of the weights of each group."""
        return {}

    def kernel(self, units: Units, count: int) -> BatchedSMC:
        """Return the SMC kernel with `count` particles, and set the draws of its units.

        All units must have the same number of draws.
        """
        arrays = {group: _stacked_parts([*own.values()]) for group, own in units.items()}
        # The shapes decide how many points are evaluated at once.
        shapes = tuple((group, parts[0]["log_weight"].shape) for group, parts in arrays.items())
        if shapes not in self._kernels:
            made = {group: [*map(_shared, parts)] for group, parts in arrays.items()}
            self._kernels[shapes] = made, BatchedSMC(model=self.model(made))
        shared, kernel = self._kernels[shapes]
        for group, parts in arrays.items():
            for variables, part in zip(shared[group], parts, strict=True):
                for name, value in part.items():
                    variables[name].set_value(value)
        kernel.draws = count
        return kernel

    def variances(self, tree: xr.DataTree, units: Units) -> Array:
        """Return the variance of the log evidence for each number of draws in `DRAW_COUNTS`."""
        distributions = self.distributions(tree, DISTRIBUTIONS)
        variances = np.zeros(len(DRAW_COUNTS))
        for group, own in units.items():
            for unit in own.values():
                log_shares = unit.log_terms(distributions[group])
                variances += variance_of_shares(log_shares, unit.standard_error, DRAW_COUNTS)
        return variances


def _stacked_parts(units: Sequence[Unit]) -> list[dict[str, Array]]:
    """Return the draws of each part of the units; the first part holds the weights."""
    parts = [stacked(of_units) for of_units in zip(*(unit.parts for unit in units), strict=True)]
    parts[0]["log_weight"] = np.stack([unit.log_weight for unit in units])
    return parts


def _shared(arrays: Mapping[str, Array]) -> dict[str, SharedVariable]:
    """Return arrays as shared variables, whose values and sizes may change."""
    return {
        name: pytensor.shared(value, name=f"specimens_{name}", shape=(None,) * value.ndim)
        for name, value in arrays.items()
    }


def draws_of_class(
    model: ClassModel,
    sampler: SpecimenSampler,
    data: xr.Dataset,
    specimens: Mapping[str, SpecimenDraws],
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
    # Few specimens need a third sample: only if the class distribution that was their prior the
    # second time was inaccurate, because their first draws were too few.
    for limit in (LARGEST_ERROR, 10 * LARGEST_ERROR):
        units = units_of(current)
        fit = _Fit(model, units, int(DRAW_COUNTS[0]), PARTICLES, particles)
        tree = fit.chains(rng.spawn(1))
        particles, variances = fit.particles, model.variances(tree, units)
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
            warn_user(
                f"specimen {name!r} was given up, because its sampling did not converge or its "
                "curves are inaccurate: the evidence of its class has an infinite error. Leave the "
                "specimen out, or give more informative priors"
            )
    return ClassDraws(current, _enough(variances), particles)


class _Fit:
    """Fit of a class distribution to the first `size` draws of each unit.

    `count` is the number of particles. The proposal is fitted to the `particles` of an earlier fit,
    if there are any.
    """

    def __init__(
        self, model: ClassModel, units: Units, size: int, count: int, particles: Array | None
    ) -> None:
        self.model, self.units, self.particles = model, units, particles
        self._bridge: BridgeFromParticles | None = None
        self.kernel = self._kernel(size, count)

    def _kernel(self, size: int, count: int) -> BatchedSMC:
        first = {
            group: {name: unit.first(size) for name, unit in own.items()}
            for group, own in self.units.items()
        }
        return self.model.kernel(first, count)

    @cached_property
    def _guide(self) -> Target:
        """The class with few draws of each specimen, whose gradients are cheaper.

        A quarter of the fewest draws is enough: the log density differs from that of the class by a
        fraction of a nat, so most moves that the gradients lead are accepted.
        """
        return self._kernel(int(DRAW_COUNTS[0]) // 4, self.kernel.draws).target

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
            draws=4 * count,  # of which a quarter or more is effective
        )
        if not found.pareto_k < LARGEST_PARETO_K:
            found = integrate(target, count, rng)
            self.particles = None
        if self.particles is None:
            self.particles = found.particles
        return found

    def _initial_proposal(self, rng: np.random.Generator) -> GaussianMixture:
        """Return a mixture fitted to the particles of an earlier fit, or to prior draws."""
        if self.particles is None:
            return GaussianMixture.fit(self.kernel.target.draw_prior(DRAWS, rng), 1, rng)
        return GaussianMixture.fit(self.particles, components_for(*self.particles.shape), rng)


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
    specimens, size, particles = draws
    tree = fit_enough(
        model, units_of(specimens), count, chains, random_seed, advance, size, particles
    )
    dims: dict[str, tuple[str, ...]] = {
        "centre": ("specimen", "coordinate", "particle"),
        "scatter": ("specimen", "coordinate", "particle"),
        "log_size": ("specimen", "noise", "particle"),
        "deviations": ("specimen", "measure", "particle"),
        "log_weight": ("specimen", "particle"),
    }
    of_specimen = "tests", "standard_error", "misfit", "freedom", "method", "pareto_k"
    dims |= dict.fromkeys(of_specimen, ("specimen",))
    tree["specimens"] = xr.Dataset(
        {k: (v, np.stack([getattr(d, k) for d in specimens.values()])) for k, v in dims.items()},
        {
            "specimen": list(specimens),
            "coordinate": model.population.scale.names,
            "noise": model.population.noises,
            "measure": list(model.population.geometry),
        },
    )
    return with_diagnosis(tree)


def fit_enough(
    model: ClassModel,
    units: Units,
    count: int,
    chains: int,
    random_seed: np.random.SeedSequence,
    advance: Callable[[], None] = no_progress,
    size: int = int(DRAW_COUNTS[0]),
    particles: Array | None = None,
) -> xr.DataTree:
    """Return posterior and evidence of a class, with enough draws of each unit.

    The first fit uses `size` draws of each unit, and a proposal that is fitted to the `particles`
    of an earlier fit, if there are any. The number of draws is increased, and the fit repeated,
    until the error that the draws cause in the evidence is small. `advance` is called after each
    chain of the first fit.
    """
    rngs = [np.random.default_rng(seed) for seed in random_seed.spawn(chains)]
    while True:
        fit = _Fit(model, units, size, count, particles)
        tree = fit.chains(rngs, random_seed.entropy, advance)
        variances, particles = model.variances(tree, units), fit.particles
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
