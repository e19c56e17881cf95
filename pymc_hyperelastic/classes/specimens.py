"""Sample single specimens.

The evidence of a class with variability is an integral over the parameters of all its specimens.
Each specimen is therefore sampled once, under a wide reference distribution. The likelihood of the
specimen under any class distribution is then a weighted mean over its draws (importance sampling),
and the model of a class has only the parameters of the class distribution as unknowns. Fits of
classes and predictions for new specimens use this module.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pymc.distributions.distribution import support_point
from pytensor.tensor.variable import TensorVariable
from scipy.special import logsumexp

from pymc_hyperelastic.classes.reference import ClassPrior, one_draw
from pymc_hyperelastic.classes.specimen_target import SpecimenPrior, SpecimenTarget
from pymc_hyperelastic.data.select import specimens_of
from pymc_hyperelastic.data.variables import kinds_of_tests
from pymc_hyperelastic.evidence.batched import BatchedFunction, without_traces
from pymc_hyperelastic.evidence.estimate import Estimate
from pymc_hyperelastic.evidence.importance import Integral, importance_sampling
from pymc_hyperelastic.evidence.integral import integrate
from pymc_hyperelastic.evidence.mixture import GaussianMixture, components_for
from pymc_hyperelastic.evidence.proposal import expectation_maximisation
from pymc_hyperelastic.evidence.target import Target
from pymc_hyperelastic.messages import warn_user
from pymc_hyperelastic.models.checks import LARGEST_CURVE_ERROR
from pymc_hyperelastic.models.class_distribution import ClassDistribution
from pymc_hyperelastic.models.forward import ForwardModel, until_accurate
from pymc_hyperelastic.models.geometry import deviation_name
from pymc_hyperelastic.models.population import (
    Population,
    Specimens,
    log_noise_name,
    register_specimens,
    register_tests,
    tests_of,
)
from pymc_hyperelastic.models.priors import FEW_DRAWS
from pymc_hyperelastic.models.specimen_draws import SpecimenDraws, log_density

Array = NDArray[np.float64]

# Number of particles of each specimen.
PARTICLES = 2000
# Fraction of the first draws that is kept when a specimen is sampled a second time.
_KEPT_FRACTION = 0.25


# An integral over the parameters of a specimen, and its target density.
Taken = tuple[Integral, SpecimenTarget]


@dataclass(frozen=True)
class _SpecimenModel:
    """PyMC model of a specimen with a given number of tests; its data can be replaced."""

    forward: ForwardModel
    whole: Target
    compressed: TensorVariable | None
    """The log likelihood from sums of squares, which need few numbers for all points, or None."""

    @cached_property
    def log_likelihood(self) -> BatchedFunction:
        """Compiled log likelihood of many points."""
        model = self.whole.model
        total = self.compressed
        if total is None:
            total = sum(pt.sum(pm.logp(rv, model.rvs_to_values[rv])) for rv in model.observed_RVs)
        return BatchedFunction.of_model(model, model.replace_rvs_by_values([total]))

    @cached_property
    def misfits(self) -> BatchedFunction:
        """Compiled log likelihood, and the absolute standardised residual of each measurement.

        The residual follows from the difference between the log density and its maximum.
        """
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

    Specimens with the same number and kinds of tests share one compiled model. The model holds the
    data of one specimen at a time. The result of a specimen does not depend on other specimens.
    """

    def __init__(
        self, population: Population, forward: ForwardModel, reference: ClassDistribution
    ) -> None:
        self.population, self.scale = population, population.scale
        self.forward, self.reference = forward, reference
        self._models: dict[tuple[int, bool, bool], _SpecimenModel] = {}

    def __call__(self, data: xr.Dataset, rng: np.random.Generator) -> SpecimenDraws:
        """Sample the specimen of these data under the reference distribution."""

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
        """Sample a specimen again, with draws of its class distribution as the prior.

        The first proposal is fitted to the specimen's earlier `draws`, and a fraction of each
        proposal is the prior: the curves may not constrain a coordinate, which then varies as in
        the class. A quarter of the earlier draws is kept, because a slightly wider class
        distribution also covers regions in which new draws are rare. The weights are those of the
        mixture of both posteriors (balance heuristic). If the earlier draws have an infinite error,
        none of them is kept. If the new sample is not reliable, the earlier draws are returned.

        References
        ----------
        E. Veach and L. J. Guibas, Optimally combining sampling techniques for Monte Carlo
        rendering, SIGGRAPH 95 (1995) 419.
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
        old = round(_KEPT_FRACTION * count)
        points = np.concatenate([draws.points[:old], found.particles[: count - old]])
        points = rng.permutation(points)
        log_evidence = logsumexp(draws.log_weight + self.log_reference(draws.points))
        log_density = np.logaddexp(
            np.log(_KEPT_FRACTION) + self.log_reference(points) - log_evidence,
            np.log1p(-_KEPT_FRACTION) + prior.of_class(points) - found.log_value.value,
        )
        errors = (
            _KEPT_FRACTION * draws.standard_error,
            (1 - _KEPT_FRACTION) * found.log_value.standard_error,
        )
        again = replace(self.draws_at(points), misfit=draws.misfit, freedom=draws.freedom)
        return _weighted(again, log_density, float(np.hypot(*errors)), found)

    def _with_accurate_curves(
        self, data: xr.Dataset, take: Callable[["SpecimenSampler"], Taken]
    ) -> Taken:
        """Compute an integral, repeatedly until the curves of its particles are accurate.

        The curves are accurate for materials of the class's default priors. If the particles have
        other materials, the integrator is refined for them, and the integral is computed again. The
        refined integrator is not kept, so that results do not depend on the order of specimens.
        """

        def with_curves(forward: ForwardModel) -> tuple[Taken, tuple[Any, ...]]:
            sampler = self
            if forward is not self.forward:
                sampler = SpecimenSampler(self.population, forward, self.reference)
            found, target = take(sampler)
            return (found, target), (data, self._parameters(found.particles[:FEW_DRAWS]))

        (found, target), accurate = until_accurate(self.forward, with_curves, LARGEST_CURVE_ERROR)
        if accurate:
            return found, target
        (name,) = specimens_of(data)[0]
        warn_user(
            f"the curves of specimen {name!r} are wrong by more than {LARGEST_CURVE_ERROR:.0e} of "
            "their largest value, because its material is far from the prior: the standard error "
            "of its evidence is infinite"
        )
        return found._replace(log_value=Estimate(found.log_value.value, np.inf)), target

    def _parameters(self, points: Array) -> dict[str, Array]:
        """Material parameters of all tests of all particles."""
        return self.scale.numbers([np.ravel(x) for x in self._parts(points)[0]])

    def _parts(self, points: Array) -> tuple[Array, Array, Array]:
        """Split points into coordinates (coordinate, draw, test), log noises and deviations."""
        sizes = len(self.population.noises), len(self.population.geometry)
        ends = points.shape[1] - np.cumsum([0, *sizes[::-1]])[::-1]
        of_tests, log_size, deviations = np.split(points, ends[:-1], axis=1)
        of_tests = of_tests.reshape(len(points), len(self.scale.names), -1)
        return np.moveaxis(of_tests, 1, 0), log_size, deviations

    def target(self, data: xr.Dataset, prior: SpecimenPrior | None = None) -> SpecimenTarget:
        """Return the target density of a specimen; the default prior is the reference."""
        model = self._model_for(data)
        prior = prior or self.prior(one_draw(self.reference), data.sizes["test"])
        functions = model.log_likelihood, model.misfits
        return SpecimenTarget(model.whole, self._places(model.whole), prior, *functions)

    def prior(self, distributions: ClassDistribution, tests: int) -> ClassPrior:
        """Return the prior of a specimen of a class with a given number of tests."""
        return ClassPrior(self.population, distributions, tests, self.points_of, self.draws_at)

    def simulator(
        self, data: xr.Dataset, seed: int
    ) -> Callable[[xr.Dataset, Mapping[str, Array]], Any]:
        """Return a function that draws measurements of a given specimen.

        The function takes data of the same shape and the parameters of the specimen by name. It
        returns the drawn values by the name of the observed variable.
        """
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
        """Convert values by variable name, (draw, entry) each, to points of the target."""
        return np.concatenate([specimens[name] for name in self._names], axis=1)

    def variables_of(self, points: Array) -> dict[str, Array]:
        """Convert points to values by variable name; all tests must share their parameters."""
        return {name: points[:, [i]] for i, name in enumerate(self._names)}

    def log_reference(self, points: Array) -> Array:
        """Log density of the reference distribution at points of the target."""
        return self.log_density(points, self.reference)

    def log_density(self, points: Array, distribution: ClassDistribution) -> Array:
        """Log density of one class distribution at points of the target."""
        return log_density(np, vars(self.draws_at(points)), distribution)

    @property
    def _names(self) -> list[str]:
        """Variables in a point: coordinates (of each test), log noises, deviations of the tube."""
        tests_differ = self.reference.experiment_spread is not None
        return [
            *(f"{name}_of_test" if tests_differ else name for name in self.scale.names),
            *map(log_noise_name, self.population.noises),
            *map(deviation_name, self.population.geometry),
        ]

    def _places(self, whole: Target) -> NDArray[np.intp]:
        """Columns of the variables of a point among all unknowns of the model."""
        ends = np.cumsum([size for _, size in whole.var_info.values()])
        columns = dict(zip(whole.var_info, np.split(np.arange(ends[-1]), ends[:-1]), strict=True))
        return np.concatenate([columns[name] for name in self._names])

    def draws_at(self, points: Array) -> SpecimenDraws:
        """Convert points of the target to draws of a specimen, with log weights of 0."""
        tests_differ = self.reference.experiment_spread is not None
        of_tests, log_size, deviations = self._parts(points)
        centre = of_tests.mean(axis=2)
        scatter = ((of_tests - centre[..., None]) ** 2).sum(axis=2)
        tests = of_tests.shape[2] if tests_differ else 1
        unweighted = np.zeros(len(points))
        values = centre, scatter, log_size.T, unweighted, tests, 0.0, points, deviations.T
        return SpecimenDraws(*values)

    def _with_misfit(
        self, data: xr.Dataset, draws: SpecimenDraws, target: SpecimenTarget
    ) -> SpecimenDraws:
        """Return the draws with the sum of squares of the best curve, and its degrees of freedom.

        The mean sum of squares over draws exceeds the smallest one by the number of parameters that
        the curves determine. This number is half of the variance over draws. If the noise is
        inferred, there is no misfit.
        """
        if not self.population.known_noise:
            return draws
        squares, count = target.squares(draws.points), self.population.likelihood.count(data)
        with np.errstate(over="ignore", invalid="ignore"):
            determined = np.var(squares) / 2 if np.isfinite(squares).all() else 0.0
            # The variance is larger if the prior and the curves contradict each other.
            determined = min(determined, target.dimension, count - 1)
            misfit, freedom = float(squares.mean() - determined), float(count - determined)
        return replace(draws, misfit=misfit, freedom=freedom)

    def _model_for(self, data: xr.Dataset) -> _SpecimenModel:
        """Return the model for this number and kinds of tests, and set its data."""
        tests = data.sizes["test"]
        key = tests, *kinds_of_tests(data)
        if key not in self._models:
            self._models[key] = self._model(data, tests)
        self._models[key].forward.set_data(data)
        return self._models[key]

    @without_traces
    def _model(self, data: xr.Dataset, tests: int) -> _SpecimenModel:
        forward = self.forward.with_data(data)
        with pm.Model(model=None) as model:
            # Constant lengths compile faster.
            for name, length in (("specimen", 1), ("test", tests)):
                model.add_coord(name, np.arange(length), length=pt.constant(length))
            of_test = np.zeros(tests, int)
            specimens = register_specimens(self.population, self.reference, of_test)
            register_tests(self.population, forward, specimens)
            compressed = self._compressed(forward, specimens)
        return _SpecimenModel(forward, Target(model), compressed)

    def _compressed(self, forward: ForwardModel, specimens: Specimens) -> TensorVariable | None:
        """Log likelihood from sums of squares; None if the likelihood needs slopes."""
        likelihood = self.population.likelihood
        if likelihood.needs_slopes:
            return None
        sizes = {name: size[0] for name, size in specimens.noises.items()}
        tube = tests_of(self.population, forward, specimens)
        total = likelihood.log_likelihood(tube, sizes)
        # An infinite sum has overflowed: it must count as an impossible point, as NaN does.
        return pt.where(pt.isinf(total), np.nan, total)


def _weighted(
    draws: SpecimenDraws, log_density: Array, standard_error: float, found: Integral
) -> SpecimenDraws:
    """Return the draws with their importance weights.

    `log_density` is the log density from which they were drawn, divided by their likelihood.
    """
    return replace(
        draws,
        log_weight=-np.log(len(log_density)) - log_density,
        standard_error=standard_error,
        method=found.method,
        pareto_k=found.pareto_k,
    )
