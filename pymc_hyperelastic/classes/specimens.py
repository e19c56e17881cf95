"""What the curves of one specimen say, in a form that any class distribution can be held against.

The evidence of a class with variability is an integral over the parameters of every specimen. Each
specimen is sampled once, under a wide reference distribution; under any class distribution its
likelihood is then a weighted mean over these draws, and a class has few unknowns left.
"""

import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pymc.distributions.distribution import support_point
from pytensor.compile.sharedvalue import SharedVariable
from pytensor.tensor.variable import TensorVariable
from scipy import stats
from scipy.special import logsumexp

from pymc_hyperelastic.classes.specimen_target import SpecimenPrior, SpecimenTarget
from pymc_hyperelastic.data.select import specimens_of
from pymc_hyperelastic.evidence.batched import BatchedFunction, without_traces
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.importance import Integral, importance_sampling
from pymc_hyperelastic.evidence.integral import integrate
from pymc_hyperelastic.evidence.mixture import GaussianMixture, components_for
from pymc_hyperelastic.evidence.proposal import expectation_maximisation
from pymc_hyperelastic.evidence.target import Target
from pymc_hyperelastic.messages import PACKAGE
from pymc_hyperelastic.models.checks import LARGEST_CURVE_ERROR
from pymc_hyperelastic.models.class_distribution import ClassDistribution
from pymc_hyperelastic.models.forward import ForwardModel, until_accurate
from pymc_hyperelastic.models.geometry import deviation_name
from pymc_hyperelastic.models.population import (
    Population,
    Specimens,
    log_noise_name,
    register_curves,
    register_specimens,
    tube_of,
)
from pymc_hyperelastic.models.specimen_draws import (
    SpecimenDraws,
    log_density,
    mean_density,
    stacked,
)

Array = NDArray[np.float64]

# Particles of a specimen.
PARTICLES = 2000
# Share of the first draws of a specimen that is kept where it is sampled again.
_KEPT = 0.25
# Particles whose curves are compared with quadrature.
_MATERIALS = 16
# Spreads of the reference distribution, in medians of a class's.
_WIDER = 2.0
_EFFECT = 1.0
_NOISE_DRAWS = 2000


# An integral, and by which target it was taken.
Taken = tuple[Integral, SpecimenTarget]


@dataclass(frozen=True)
class _SpecimenModel:
    """Model of a specimen with so many tests, whose data may be replaced."""

    forward: ForwardModel
    whole: Target
    compressed: TensorVariable | None
    """The log likelihood by sums of squares, for which few numbers stand for all points."""

    @cached_property
    def log_likelihood(self) -> BatchedFunction:
        """Log likelihood, for very many points."""
        model = self.whole.model
        total = self.compressed
        if total is None:
            total = sum(pt.sum(pm.logp(rv, model.rvs_to_values[rv])) for rv in model.observed_RVs)
        return BatchedFunction.of_model(model, model.replace_rvs_by_values([total]))

    @cached_property
    def misfits(self) -> BatchedFunction:
        """Log likelihood, and the size of every standard error, by what its density lacks."""
        model = self.whole.model
        terms, lacking = [], []
        for rv in model.observed_RVs:
            term = pm.logp(rv, model.rvs_to_values[rv])
            terms.append(pt.sum(term))
            lacking.append(pt.flatten(pm.logp(rv, support_point(rv)) - term))
        errors = pt.sqrt(2 * pt.clip(pt.concatenate(lacking), 0.0, np.inf))
        return BatchedFunction.of_model(model, model.replace_rvs_by_values([sum(terms), errors]))


class SpecimenSampler:
    """Sample specimens, each by itself, under one reference distribution.

    Specimens with the same number of tests share one compiled model. Each brings data of its own,
    and noise of its own if that is not known. What is said
    of one depends on no other.
    """

    def __init__(
        self, population: Population, forward: ForwardModel, reference: ClassDistribution
    ) -> None:
        self.population, self.scale = population, population.scale
        self.forward, self.reference = forward, reference
        self._models: dict[int, _SpecimenModel] = {}

    def __call__(self, data: xr.Dataset, rng: np.random.Generator) -> SpecimenDraws:
        """Sample the specimen of these data."""

        def take(sampler: SpecimenSampler) -> Taken:
            target = sampler.target(data)
            return integrate(target, PARTICLES, rng), target

        found, target = self._with_accurate_curves(data, take)
        draws = self._with_misfit(data, self.draws_at(found.particles), target)
        value, error = found.log_value
        return _weighted(draws, self.log_reference(found.particles) - value, error, found)

    def near(
        self,
        data: xr.Dataset,
        draws: SpecimenDraws,
        distributions: ClassDistribution,
        rng: np.random.Generator,
    ) -> SpecimenDraws:
        """Sample the specimen of these data again, as one of a class of these distributions.

        The draws that are known of it show where; they are returned where this does not succeed.
        A share of specimens of the class is among those tried: curves may leave a coordinate open,
        as far as the class goes. Some of the known draws stay, since a class that is a little wider
        than these distributions has specimens where hardly one is tried. All count as if each
        were drawn from the mixture of both posteriors. Of a specimen that was given up none stay.

        References
        ----------
        Such weights: E. Veach and L. J. Guibas, Optimally combining sampling techniques for Monte
        Carlo rendering, SIGGRAPH 95 (1995) 419.
        """
        prior = self.prior(distributions, data.sizes["test"])
        components = components_for(*draws.points.shape)
        mixture = GaussianMixture.fit(draws.points, components, rng)

        def take(sampler: SpecimenSampler) -> Taken:
            target, builder = sampler.target(data, prior), expectation_maximisation
            found = importance_sampling(
                target.score, mixture, builder, PARTICLES, rng, draw_prior=target.draw_prior
            )
            return found, target

        found, target = self._with_accurate_curves(data, take)
        if not found.reliable:
            return draws
        count = len(draws.points)
        if np.isinf(draws.standard_error):
            points = found.particles[:count]
            again = self._with_misfit(data, self.draws_at(points), target)
            value, error = found.log_value
            return _weighted(again, prior.of_class(points) - value, error, found)
        old = round(_KEPT * count)
        points = np.concatenate([draws.points[:old], found.particles[: count - old]])
        points = rng.permutation(points)
        known = logsumexp(draws.log_weight + self.log_reference(draws.points))
        log_density = np.logaddexp(
            np.log(_KEPT) + self.log_reference(points) - known,
            np.log1p(-_KEPT) + prior.of_class(points) - found.log_value.value,
        )
        errors = _KEPT * draws.standard_error, (1 - _KEPT) * found.log_value.standard_error
        again = replace(self.draws_at(points), misfit=draws.misfit, freedom=draws.freedom)
        return _weighted(again, log_density, float(np.hypot(*errors)), found)

    def _with_accurate_curves(
        self, data: xr.Dataset, take: Callable[["SpecimenSampler"], Taken]
    ) -> Taken:
        """Take an integral until the curves of its particles are accurate.

        Curves are accurate over the range of the class's default priors. If the data want other
        materials, the integrator is refined for these, and the integral is taken again. Nothing of
        that is kept: what is said of a specimen must not depend on what was sampled before it.
        """

        def with_curves(forward: ForwardModel) -> tuple[Taken, tuple[Any, ...]]:
            sampler = self
            if forward is not self.forward:
                sampler = SpecimenSampler(self.population, forward, self.reference)
            found, target = take(sampler)
            return (found, target), (data, self._parameters(found.particles[:_MATERIALS]))

        (found, target), accurate = until_accurate(self.forward, with_curves, LARGEST_CURVE_ERROR)
        if accurate:
            return found, target
        (name,) = specimens_of(data)[0]
        warnings.warn(
            f"curves of specimen {name!r} are wrong by more than {LARGEST_CURVE_ERROR:.0e} of "
            "their largest value, and its evidence has no error: its material is far from what "
            "priors expect",
            skip_file_prefixes=(PACKAGE,),
        )
        return found._replace(log_value=Estimate(found.log_value.value, np.inf)), target

    def _parameters(self, points: Array) -> dict[str, Array]:
        """Material parameters of particles, of all their tests."""
        return self.scale.numbers([np.ravel(x) for x in self._parts(points)[0]])

    def _parts(self, points: Array) -> tuple[Array, Array, Array]:
        """Coordinates (coordinate, draw, test), noises and deviations of particles."""
        sizes = len(self.population.noises), len(self.population.geometry)
        ends = points.shape[1] - np.cumsum([0, *sizes[::-1]])[::-1]
        of_tests, log_size, deviations = np.split(points, ends[:-1], axis=1)
        of_tests = of_tests.reshape(len(points), len(self.scale.names), -1)
        return np.moveaxis(of_tests, 1, 0), log_size, deviations

    def target(self, data: xr.Dataset, prior: SpecimenPrior | None = None) -> SpecimenTarget:
        """Return the specimen of these data under a prior; under the reference if it is missing."""
        model = self._model_for(data)
        prior = prior or self.prior(one_draw(self.reference), data.sizes["test"])
        functions = model.log_likelihood, model.misfits
        return SpecimenTarget(model.whole, self._places(model.whole), prior, *functions)

    def prior(self, distributions: ClassDistribution, tests: int) -> "ClassPrior":
        """Return the prior of a specimen with so many tests that belongs to a class."""
        return ClassPrior(self, distributions, tests)

    def simulator(
        self, data: xr.Dataset, seed: int
    ) -> Callable[[xr.Dataset, Mapping[str, Array]], Any]:
        """Function of data like these, and of a specimen: what would be measured of it."""
        model = self._model_for(data)
        pm_model = model.whole.model
        observed = pm_model.observed_RVs
        draw = pm.compile(
            pm_model.free_RVs,
            observed,
            mode="FAST_COMPILE",
            on_unused_input="ignore",
            random_seed=seed,
        )

        def simulate(data: xr.Dataset, specimen: Mapping[str, Array]) -> dict[str, Array]:
            model.forward.set_data(data)
            values = draw(*(specimen[rv.name] for rv in pm_model.free_RVs))
            return dict(zip((rv.name for rv in observed), values, strict=True))

        return simulate

    def points_of(self, specimens: Mapping[str, Array]) -> Array:
        """Specimens by the variables of their model, as points of the target."""
        return np.concatenate([specimens[name] for name in self._names], axis=1)

    def variables_of(self, points: Array) -> dict[str, Array]:
        """The other way round, where tests of a specimen share its parameters."""
        return {name: points[:, [i]] for i, name in enumerate(self._names)}

    def log_reference(self, points: Array) -> Array:
        """Log density of the reference at points of the target."""
        return self.log_density(points, self.reference)

    def log_density(self, points: Array, distribution: ClassDistribution) -> Array:
        """Log density of a distribution of specimens at points of the target."""
        return log_density(np, vars(self.draws_at(points)), distribution)

    @property
    def _names(self) -> list[str]:
        """Variables on which curves depend: coordinates of each test, noises, and the tube."""
        own = self.reference.experiment_spread is not None
        return [
            *(f"{name}_of_test" if own else name for name in self.scale.names),
            *map(log_noise_name, self.population.noises),
            *map(deviation_name, self.population.geometry),
        ]

    def _places(self, whole: Target) -> NDArray[np.intp]:
        """Columns of particles on which curves depend."""
        ends = np.cumsum([size for _, size in whole.var_info.values()])
        columns = dict(zip(whole.var_info, np.split(np.arange(ends[-1]), ends[:-1]), strict=True))
        return np.concatenate([columns[name] for name in self._names])

    def draws_at(self, points: Array) -> SpecimenDraws:
        """Points of the target as draws of a specimen; they are not weighted yet."""
        own = self.reference.experiment_spread is not None
        of_tests, log_size, deviations = self._parts(points)
        centre = of_tests.mean(axis=2)
        scatter = ((of_tests - centre[..., None]) ** 2).sum(axis=2)
        tests = of_tests.shape[2] if own else 1
        unweighted = np.zeros(len(points))
        known = centre, scatter, log_size.T, unweighted, tests, 0.0, points, deviations.T
        return SpecimenDraws(*known)

    def _with_misfit(
        self, data: xr.Dataset, draws: SpecimenDraws, target: SpecimenTarget
    ) -> SpecimenDraws:
        """Draws of a target with their misfit, which is told by errors whose size is known."""
        if not self.population.known_noise:
            return draws
        squares = target.squares(draws.points)
        misfit, freedom = self._misfit(data, squares, target.dimension)
        return replace(draws, misfit=misfit, freedom=freedom)

    def _misfit(self, data: xr.Dataset, squares: Array, unknown: int) -> tuple[float, float]:
        """Squared misfit of the best of the posterior's curves, by that of all; its freedom.

        The mean over draws exceeds that of the best by the number of parameters of which the curves
        tell, which is half of the variance over the draws.
        """
        count = data.sizes["obs"]
        if self.population.likelihood.with_force:
            count += int(data["axial_force"].notnull().sum())
        with np.errstate(over="ignore", invalid="ignore"):
            told = np.var(squares) / 2 if np.isfinite(squares).all() else 0.0
            # Where prior and curves contradict each other squares vary by more than that.
            told = min(told, unknown, count - 1)
            return float(squares.mean() - told), float(count - told)

    def _model_for(self, data: xr.Dataset) -> _SpecimenModel:
        """Model of a specimen with as many tests, with these data."""
        tests = data.sizes["test"]
        if tests not in self._models:
            self._models[tests] = self._model(data, tests)
        self._models[tests].forward.set_data(data)
        return self._models[tests]

    @without_traces
    def _model(self, data: xr.Dataset, tests: int) -> _SpecimenModel:
        forward = self.forward.with_data(data)
        with pm.Model(model=None) as model:
            # Lengths that are known take less time to compile for.
            for name, length in (("specimen", 1), ("test", tests)):
                model.add_coord(name, np.arange(length), length=pt.constant(length))
            of_test = np.zeros(tests, int)
            specimens = register_specimens(self.population, self.reference, of_test)
            register_curves(self.population, forward, specimens)
            compressed = self._compressed(forward, specimens)
        return _SpecimenModel(forward, Target(model), compressed)

    def _compressed(self, forward: ForwardModel, specimens: Specimens) -> TensorVariable | None:
        """The log likelihood by sums of squares; None with slopes or errors of diameters."""
        likelihood = self.population.likelihood
        if likelihood.needs_slopes:
            return None
        own = {name: size[0] for name, size in specimens.noises.items()}
        tube = tube_of(self.population, forward, specimens)
        total = likelihood.log_likelihood(tube, own)
        # What overflows is no number, and counts as one that is none.
        return pt.where(pt.isinf(total), np.nan, total)


class ClassPrior:
    """A specimen of a class whose distribution is one of several draws, and its tube.

    Parameters
    ----------
    sampler : SpecimenSampler
    distributions : ClassDistribution
        Draws of the class's distribution.
    tests : int
        Number of tests of the specimen.
    """

    def __init__(
        self, sampler: SpecimenSampler, distributions: ClassDistribution, tests: int
    ) -> None:
        self._sampler, self._distributions, self._tests = sampler, distributions, tests

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """Draw points, shape (count, d)."""
        distributions = self._distributions
        chosen = distributions.at(rng.integers(len(distributions.location[0]), size=count))
        fresh = fresh_specimens(self._sampler.population, chosen, self._tests, rng)
        return self._sampler.points_of(fresh)

    def log_density(self, points: Array) -> Array:
        """Return the log density of points."""
        deviations = points[:, points.shape[1] - len(self._sampler.population.geometry) :]
        return self.of_class(points) + stats.norm.logpdf(deviations).sum(axis=1)

    def of_class(self, points: Array) -> Array:
        """Return the log density without that of the tube, which is the same for all classes."""
        return mean_density(self._sampler.draws_at(points), self._distributions)


def one_draw(distribution: ClassDistribution) -> ClassDistribution:
    """Return a single distribution as draws of a class's distribution, of which there is one."""
    d = distribution
    vectors = "location", "spread", "experiment_spread", "log_size", "noise_spread"
    changes: dict[str, Any] = {
        name: np.asarray(getattr(d, name), float)[:, None, None]
        for name in vectors
        if getattr(d, name) is not None
    }
    if d.effect_spread is not None:
        changes["effect_spread"] = np.full((1, 1), float(np.squeeze(d.effect_spread)))
    return replace(d, factor=np.asarray(d.factor)[None], **changes)


def _weighted(
    draws: SpecimenDraws, log_density: Array, standard_error: float, found: Integral
) -> SpecimenDraws:
    """Draws with the weights of draws from this density, by which the likelihood is divided."""
    return replace(
        draws,
        log_weight=-np.log(len(log_density)) - log_density,
        standard_error=standard_error,
        method=found.method,
        pareto_k=found.pareto_k,
    )


def reference_of(population: Population) -> ClassDistribution:
    """Distribution of a specimen of which not even the class is known."""
    mean, sd = population.scale.location_prior
    spread = _WIDER * np.exp(population.scale.spread_prior[0])
    optional: dict[str, Any] = {}
    if population.experiment_effect:
        optional |= {"experiment_spread": spread / 2, "effect_spread": _EFFECT}
    inferred = [population.likelihood.sizes[name] for name in population.noises]
    if inferred:
        drawn = pm.draw(inferred, draws=_NOISE_DRAWS, random_seed=1, mode="FAST_COMPILE")
        logs = np.log(drawn)
        spreads = np.hypot(logs.std(axis=1), 0.5)
        optional |= {"log_size": logs.mean(axis=1), "noise_spread": spreads}
    return ClassDistribution(mean, np.hypot(sd, spread), np.eye(len(mean)), **optional)


def fresh_specimens(
    population: Population,
    distributions: ClassDistribution,
    tests: int,
    rng: np.random.Generator,
) -> dict[str, Array]:
    """One new specimen of each distribution, by the variables of its model: (draw, entry)."""
    count, names = len(distributions.location[0]), population.scale.names

    def noise(entries: int = 1) -> Array:
        return rng.standard_normal((count, entries))

    standard = np.stack([noise() for _ in names], axis=1)
    draws = dict(zip(names, distributions.coordinates(standard), strict=True))
    if distributions.experiment_spread is not None:
        draws["log_effect"] = distributions.effect_spread * noise()
        for i, name in enumerate(names):
            within = distributions.experiment_spread[i] * np.exp(draws["log_effect"])
            draws[f"{name}_of_test"] = draws[name] + within * noise(tests)
    for i, name in enumerate(population.noises):
        logs = distributions.log_size[i] + distributions.noise_spread[i] * noise()
        draws[log_noise_name(name)] = logs
    return draws | {deviation_name(name): noise() for name in population.geometry}


def shared_draws(specimens: Iterable[SpecimenDraws]) -> dict[str, SharedVariable]:
    """Draws of the specimens of a class, as many of each, that others may replace."""
    return {
        name: pytensor.shared(value, name=f"specimens_{name}", shape=(None,) * value.ndim)
        for name, value in stacked([*specimens]).items()
    }


@without_traces
def class_model(population: Population, shared: Mapping[str, SharedVariable]) -> pm.Model:
    """PyMC model of a class's distribution alone, its specimens integrated out by their draws."""
    names = population.scale.names
    with pm.Model(coords={"coordinate": names, "coordinate_2": names}, model=None) as model:
        distribution = population.register_class()
        inputs = dict(shared) | {"tests": pt.specify_broadcastable(shared["tests"], 1)}
        terms = inputs["log_weight"] + log_density(pt, inputs, distribution)
        pm.Potential("specimens", pt.sum(pt.logsumexp(terms, axis=-1)))
    return model
