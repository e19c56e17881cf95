"""What the curves of one specimen say, in a form that any class distribution can be held against.

The evidence of a class with variability is an integral over the parameters of every specimen. Each
specimen is sampled once, under a wide reference distribution; under any class distribution its
likelihood is then a weighted mean over these draws, and a class has few unknowns left.
"""

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
from pytensor.compile.sharedvalue import SharedVariable
from scipy.special import logsumexp

from pymc_hyperelastic.classes.specimen_target import SpecimenTarget
from pymc_hyperelastic.evidence.batched import BatchedFunction, without_traces
from pymc_hyperelastic.evidence.importance import Integral, by_importance
from pymc_hyperelastic.evidence.integral import integrate
from pymc_hyperelastic.evidence.mixture import GaussianMixture, components_for
from pymc_hyperelastic.evidence.target import Target
from pymc_hyperelastic.models.class_distribution import ClassDistribution
from pymc_hyperelastic.models.forward import ForwardModel
from pymc_hyperelastic.models.natural_scale import NaturalScale
from pymc_hyperelastic.models.observation.noise import sd_of_sigma
from pymc_hyperelastic.models.population import Population, register_curves, register_specimens
from pymc_hyperelastic.models.priors import is_inferred
from pymc_hyperelastic.models.specimen_draws import (
    SpecimenDraws,
    independent,
    log_density,
    mean_density,
    stacked,
)

Array = NDArray[np.float64]

# Particles of a specimen.
PARTICLES = 2000
# Share of the first draws of a specimen that is kept where it is sampled again.
_KEPT = 0.25
# Spreads of the reference distribution, in medians of a class's.
_WIDER = 2.0
_EFFECT = 1.0
_NOISE_DRAWS = 2000


@dataclass(frozen=True)
class _SpecimenModel:
    """Model of a specimen with so many tests, whose data may be replaced."""

    forward: ForwardModel
    whole: Target

    @cached_property
    def pressure(self) -> BatchedFunction:
        """Pressures of the tests."""
        model = self.whole.model
        return BatchedFunction.of_model(model, model.replace_rvs_by_values([model["pressure"]]))


class SpecimenSampler:
    """Sample specimens, each by itself, under one reference distribution.

    Specimens with the same number of tests share one compiled model. Each brings data of its own,
    and noise of its own if that is not known.
    """

    def __init__(
        self, population: Population, forward: ForwardModel, reference: ClassDistribution
    ) -> None:
        self.scale, self.sigma = population.scale, population.known_sigma
        self.forward, self.reference = forward, reference
        self._models: dict[int, _SpecimenModel] = {}

    def __call__(self, data: xr.Dataset, rng: np.random.Generator) -> SpecimenDraws:
        """Sample the specimen of these data."""
        model = self._model_for(data)
        target = self._target(model.whole, self._log_reference)
        found = integrate(target, PARTICLES, rng)
        curves = model.pressure(target.particles(found.particles))[0]
        misfit, freedom = self._misfit(data, curves)
        draws = replace(self._draws(found.particles), misfit=misfit, freedom=freedom)
        return _weighted(draws, self._log_reference(found.particles), found)

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
        were drawn from the mixture of both posteriors.

        References
        ----------
        Such weights: E. Veach and L. J. Guibas, Optimally combining sampling techniques for Monte
        Carlo rendering, SIGGRAPH 95 (1995) 419.
        """

        def log_prior(points: Array) -> Array:
            return mean_density(self._draws(points), distributions)

        def draw_prior(count: int, rng: np.random.Generator) -> Array:
            chosen = distributions.at(rng.integers(len(distributions.location[0]), size=count))
            fresh = fresh_specimens(self.scale, chosen, data.sizes["test"], rng)
            return np.concatenate([fresh[name] for name in self._names], axis=1)

        target = self._target(self._model_for(data).whole, log_prior)
        mixture = GaussianMixture.fit(
            draws.points, components_for(len(draws.points), target.dimension), rng
        )
        found = by_importance(target.score, mixture, PARTICLES, rng, draw_prior)
        if not found.trusted:
            return draws
        count = len(draws.points)
        old = round(_KEPT * count)
        points = np.concatenate([draws.points[:old], found.particles[: count - old]])
        points = rng.permutation(points)
        known = logsumexp(draws.log_weight + self._log_reference(draws.points))
        log_density = np.logaddexp(
            np.log(_KEPT) + self._log_reference(points) - known,
            np.log1p(-_KEPT) + log_prior(points) - found.log_value.value,
        )
        errors = _KEPT * draws.standard_error, (1 - _KEPT) * found.log_value.standard_error
        return replace(
            self._draws(points),
            log_weight=-np.log(count) - log_density,
            standard_error=float(np.hypot(*errors)),
            misfit=draws.misfit,
            freedom=draws.freedom,
            method=found.method,
            pareto_k=found.pareto_k,
        )

    def _target(self, whole: Target, log_prior: Callable[[Array], Array]) -> SpecimenTarget:
        return SpecimenTarget(whole, self._places(whole), log_prior)

    def _log_reference(self, points: Array) -> Array:
        return log_density(np, vars(self._draws(points)), self.reference)

    @property
    def _names(self) -> list[str]:
        """Variables on which curves depend: coordinates of each test, and ``ln σ``."""
        own = self.reference.experiment_spread is not None
        names = [f"{name}_of_test" if own else name for name in self.scale.names]
        return names + (["log_specimen_sigma"] if self.sigma is None else [])

    def _places(self, whole: Target) -> NDArray[np.intp]:
        """Columns of particles on which curves depend."""
        ends = np.cumsum([size for _, size in whole.var_info.values()])
        columns = dict(zip(whole.var_info, np.split(np.arange(ends[-1]), ends[:-1]), strict=True))
        return np.concatenate([columns[name] for name in self._names])

    def _draws(self, points: Array) -> SpecimenDraws:
        """Draws of a specimen that are not weighted yet."""
        count, own = len(self.scale.names), self.reference.experiment_spread is not None
        log_sigma = points[:, -1] if self.sigma is None else np.zeros(len(points))
        of_tests = points[:, : points.shape[1] - (self.sigma is None)]
        of_tests = np.moveaxis(of_tests.reshape(len(points), count, -1), 1, 0)
        centre = of_tests.mean(axis=2)
        scatter = ((of_tests - centre[..., None]) ** 2).sum(axis=2)
        tests = of_tests.shape[2] if own else 1
        return SpecimenDraws(centre, scatter, log_sigma, 0 * log_sigma, tests, 0.0, points)

    def _misfit(self, data: xr.Dataset, curves: Array) -> tuple[float, float]:
        """Squared misfit of the best of these posterior curves (draw, obs), and its freedom.

        The mean over draws exceeds that of the best by the number of parameters of which the curves
        tell, which is half of the variance over the draws.
        """
        if self.sigma is None:
            return np.nan, np.nan
        measured, sd = data["pressure"].values.astype(float), sd_of_sigma(self.sigma)
        with np.errstate(over="ignore", invalid="ignore"):
            squares = np.sum(((measured - curves) / sd) ** 2, axis=1)
        told = min(np.var(squares) / 2, measured.size - 1) if np.isfinite(squares).all() else 0.0
        return float(squares.mean() - told), float(measured.size - told)

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
        coords = {"specimen": [0], "test": np.arange(tests)}
        with pm.Model(coords=coords, model=None) as model:
            of_test = np.zeros(tests, int)
            coordinates, sigma = register_specimens(self.scale, self.reference, of_test)
            sigma = pt.full((1,), np.float64(self.sigma)) if sigma is None else sigma
            register_curves(forward, self.scale, coordinates, sigma[of_test])
        return _SpecimenModel(forward, Target(model))


def _weighted(draws: SpecimenDraws, log_density: Array, found: Integral) -> SpecimenDraws:
    """Draws of the posterior under a prior of this log density, with the weights that they need."""
    return replace(
        draws,
        log_weight=found.log_value.value - np.log(len(log_density)) - log_density,
        standard_error=found.log_value.standard_error,
        method=found.method,
        pareto_k=found.pareto_k,
    )


def reference_of(population: Population) -> ClassDistribution:
    """Distribution of a specimen of which not even the class is known."""
    sigma = population.observation.sigmas["sigma"]
    mean, sd = population.scale.location_prior
    spread = _WIDER * np.exp(population.scale.spread_prior[0])
    optional: dict[str, Any] = {}
    if population.experiment_effect:
        optional |= {"experiment_spread": spread / 2, "effect_spread": _EFFECT}
    if is_inferred(sigma):
        logs = np.log(pm.draw(sigma, draws=_NOISE_DRAWS, random_seed=1, mode="FAST_COMPILE"))
        optional |= {"log_sigma": logs.mean(), "noise_spread": np.hypot(logs.std(), 0.5)}
    return ClassDistribution(mean, np.hypot(sd, spread), independent(len(mean)), **optional)


def fresh_specimens(
    scale: NaturalScale, distributions: ClassDistribution, tests: int, rng: np.random.Generator
) -> dict[str, Array]:
    """One new specimen of each distribution, by the variables of its model: (draw, entry)."""
    count = len(distributions.location[0])

    def noise(entries: int = 1) -> Array:
        return rng.standard_normal((count, entries))

    standard = [noise() for _ in scale.names]
    draws = {}
    for i, name in enumerate(scale.names):
        mixed = sum(a * z for a, z in zip(distributions.factor[i], standard, strict=False))
        draws[name] = distributions.location[i] + distributions.spread[i] * mixed
    if distributions.experiment_spread is not None:
        draws["log_effect"] = distributions.effect_spread * noise()
        for i, name in enumerate(scale.names):
            within = distributions.experiment_spread[i] * np.exp(draws["log_effect"])
            draws[f"{name}_of_test"] = draws[name] + within * noise(tests)
    if distributions.log_sigma is not None:
        draws["log_specimen_sigma"] = distributions.log_sigma + distributions.noise_spread * noise()
    return draws


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
