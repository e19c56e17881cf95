"""What the curves of one specimen say, in a form that any class distribution can be held against.

The evidence of a class with variability is an integral over the parameters of every specimen. Each
specimen is sampled once, under a wide reference distribution; under any class distribution its
likelihood is then a weighted mean over these draws, and a class has few unknowns left.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.classes.density import SpecimenDraws, independent, log_density, stacked
from pymc_hyperelastic.evidence.batched import BatchedFunction
from pymc_hyperelastic.evidence.importance import sample_from_modes
from pymc_hyperelastic.evidence.kernel import BatchedSMC
from pymc_hyperelastic.models.class_distribution import ClassDistribution
from pymc_hyperelastic.models.forward import ForwardModel
from pymc_hyperelastic.models.natural_scale import NaturalScale
from pymc_hyperelastic.models.population import Population, register_curves, register_specimens
from pymc_hyperelastic.models.priors import is_inferred

Array = NDArray[np.float64]

# Particles of a specimen.
_PARTICLES = 2000
# Spreads of the reference distribution, in medians of a class's.
_WIDER = 2.0
_EFFECT = 1.0
_NOISE_DRAWS = 2000


class _SpecimenModel(NamedTuple):
    """Model of a specimen with so many tests, whose data may be replaced."""

    forward: ForwardModel
    kernel: BatchedSMC
    pressure: BatchedFunction


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
        kernel = self._model_for(data).kernel
        particles, evidence = sample_from_modes(kernel, rng)
        ends = np.cumsum([size for _, size in kernel.var_info.values()])
        columns = dict(zip(kernel.var_info, np.split(particles, ends[:-1], axis=1), strict=True))
        own = self.reference.experiment_spread is not None
        of_tests = np.stack(
            [columns[f"{name}_of_test" if own else name] for name in self.scale.names]
        )
        centre, nothing = of_tests.mean(axis=2), np.zeros(len(particles))
        draws = SpecimenDraws(
            centre,
            ((of_tests - centre[..., None]) ** 2).sum(axis=2),
            columns["log_specimen_sigma"][:, 0] if self.sigma is None else nothing,
            nothing,
            of_tests.shape[2] if own else 1,
            evidence.standard_error,
        )
        weight = evidence.value - np.log(len(particles))
        density = log_density(np, vars(draws), self.reference)
        return replace(draws, log_weight=weight - density)

    def curves(self, data: xr.Dataset, draws: Mapping[str, Array]) -> Array:
        """Pressures of the tests of these data for draws of a specimen: (draw, obs)."""
        model = self._model_for(data)
        particles = np.concatenate([draws[name] for name in model.kernel.var_info], axis=1)
        return model.pressure(particles)[0]

    def _model_for(self, data: xr.Dataset) -> _SpecimenModel:
        """Model of a specimen with as many tests, with these data."""
        tests = data.sizes["test"]
        if tests not in self._models:
            self._models[tests] = self._model(data, tests)
        self._models[tests].forward.set_data(data)
        return self._models[tests]

    def _model(self, data: xr.Dataset, tests: int) -> _SpecimenModel:
        forward = self.forward.with_data(data)
        coords = {"specimen": [0], "test": np.arange(tests)}
        with pm.Model(coords=coords, model=None) as model:
            of_test = np.zeros(tests, int)
            coordinates, sigma = register_specimens(self.scale, self.reference, of_test)
            sigma = pt.full((1,), np.float64(self.sigma)) if sigma is None else sigma
            register_curves(forward, self.scale, coordinates, sigma[of_test])
        pressure = BatchedFunction.of_model(model, model.replace_rvs_by_values([model["pressure"]]))
        return _SpecimenModel(forward, BatchedSMC(draws=_PARTICLES, model=model), pressure)


def reference_of(population: Population) -> ClassDistribution:
    """Distribution of a specimen of which not even the class is known."""
    sigma, (mean, sd) = population.sigma, population.scale.location_prior
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


def class_model(population: Population, specimens: Mapping[str, SpecimenDraws]) -> pm.Model:
    """PyMC model of a class's distribution alone, its specimens integrated out by their draws."""
    names = population.scale.names
    coords = {"coordinate": names, "coordinate_2": names, "specimen": list(specimens)}
    with pm.Model(coords=coords, model=None) as model:
        distribution = population.register_class()
        inputs = {
            name: pytensor.shared(value, name=f"specimens_{name}", shape=(None,) * value.ndim)
            for name, value in stacked([*specimens.values()]).items()
        }
        inputs["tests"] = pt.specify_broadcastable(inputs["tests"], 1)
        terms = inputs["log_weight"] + log_density(pt, inputs, distribution)
        pm.Potential("specimens", pt.sum(pt.logsumexp(terms, axis=-1)))
    return model
