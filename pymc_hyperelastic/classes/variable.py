"""Classes whose specimens differ: how they are fitted, stored, and held against new specimens."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pymc as pm
import xarray as xr
from arviz_stats.base import array_stats
from numpy.typing import NDArray
from scipy.special import logsumexp

from pymc_hyperelastic.classes.specimens import (
    SpecimenDraws,
    SpecimenSampler,
    class_model,
    fresh_specimens,
    independent,
    log_densities,
    reference_of,
    sample,
)
from pymc_hyperelastic.data.inflation import tests_at
from pymc_hyperelastic.evidence.kernel import BatchedSMC
from pymc_hyperelastic.evidence.smc import Estimate, particles_to_tree
from pymc_hyperelastic.evidence.weights import effective_sample_size
from pymc_hyperelastic.models.population import (
    ClassDistribution,
    NaturalScale,
    check_population,
    population_rule,
    specimens_of,
)
from pymc_hyperelastic.models.priors import is_inferred, prior_from_record, prior_to_record
from pymc_hyperelastic.models.results import strain_energy_attrs, strain_energy_of

__all__ = [
    "SpecimenPredictive",
    "Variability",
    "fit_distribution",
    "sample_specimens",
]

Array = NDArray[np.float64]

# Draws of a specimen that stand for it in the model of its class: its density, which is mostly far
# wider than what a specimen's curves leave open, is averaged over them.
_IN_CLASS = 128
# Draws of a class's distribution against which a specimen is held.
_DISTRIBUTIONS = 1000
# Weights of a larger Pareto shape, or fewer effective ones, do not make a mean: the specimen is
# sampled again, closer to the class.
_LARGEST_PARETO_K, _ENOUGH = 0.7, 50
# kPa: curves beyond these are not of tubes. With fewer than so many of them at the radii of a
# specimen there is no telling how unlikely it is.
_SMALLEST_PRESSURE, _LARGEST_PRESSURE, _FEWEST_CURVES = 1e-6, 1e6, 100
# Curves of a class differ along directions in which they differ by this fraction, or more, of how
# they do along the first.
_LEAST_SHARE = 0.003


@dataclass(frozen=True)
class Variability:
    """Settings that all classes of one comparison share."""

    energy: Any
    sigma: Any
    experiment_effect: bool = False
    reference_stress: float = 20.0
    priors: Mapping[str, Any] | None = None

    @property
    def scale(self) -> NaturalScale:
        """Coordinates of the specimens."""
        return NaturalScale(self.energy, self.reference_stress)

    @property
    def known_sigma(self) -> float | None:
        """The noise, or None if it is inferred."""
        return None if is_inferred(self.sigma) else float(self.sigma)

    @cached_property
    def reference(self) -> ClassDistribution:
        """Distribution under which each specimen is sampled."""
        return reference_of(self.scale, self.sigma, self.experiment_effect)

    def check(self, data: xr.Dataset) -> None:
        """Raise unless these data can be modelled so."""
        check_population(self.scale, data, self.sigma, self.experiment_effect, self.priors)

    def check_classes(self, classes: Mapping[str, xr.Dataset]) -> None:
        """Raise, naming the class, unless the data of each can be modelled so."""
        for name, data in classes.items():
            try:
                self.check(data)
            except (TypeError, ValueError) as error:
                raise type(error)(f"class {name!r}: {error}") from error

    def sampler(self, data: xr.Dataset) -> SpecimenSampler:
        """Sampler of the specimens of these data, each by itself."""
        rule = population_rule(self.scale, data)
        return SpecimenSampler(self.scale, rule, self.reference, self.known_sigma)

    def model(self, draws: Mapping[str, SpecimenDraws]) -> pm.Model:
        """Model of a class with these specimens."""
        return class_model(
            self.scale,
            list(draws.values()),
            list(draws),
            sigma=self.sigma,
            experiment_effect=self.experiment_effect,
            priors=self.priors,
        )

    def attrs(self) -> dict[str, str]:
        """The settings as text, for attributes of a file.

        Raises
        ------
        ValueError
            If a prior, or a setting of the strain energy, cannot be written down.
        """
        sigma = self.known_sigma
        settings = {
            "sigma": prior_to_record("sigma", self.sigma) if sigma is None else sigma,
            "experiment_effect": bool(self.experiment_effect),
            "reference_stress": float(self.reference_stress),
            "priors": {k: prior_to_record(k, v) for k, v in (self.priors or {}).items()},
        }
        return strain_energy_attrs(self.energy) | {
            "variability": "specimen",
            "variability_settings": json.dumps(settings),
        }

    @classmethod
    def of_tree(cls, tree: xr.DataTree) -> "Variability":
        """Settings of a fitted class."""
        settings = json.loads(tree.attrs["variability_settings"])
        sigma = settings["sigma"]
        return cls(
            strain_energy_of(tree),
            sigma if isinstance(sigma, float) else prior_from_record(sigma),
            settings["experiment_effect"],
            settings["reference_stress"],
            {name: prior_from_record(record) for name, record in settings["priors"].items()},
        )


def sample_specimens(
    sampler: SpecimenSampler, data: xr.Dataset, rng: np.random.Generator
) -> dict[str, SpecimenDraws]:
    """Draws of each specimen of the data."""
    names, of_test = specimens_of(data)
    return {
        name: sampler(tests_at(data, np.flatnonzero(of_test == i)), rng)
        for i, name in enumerate(names)
    }


def fit_distribution(
    settings: Variability,
    draws: Mapping[str, SpecimenDraws],
    count: int,
    chains: int,
    random_seed: np.random.SeedSequence,
) -> xr.DataTree:
    """Posterior and evidence of a class's distribution, with the draws of its specimens."""
    few = {name: specimen.first(_IN_CLASS) for name, specimen in draws.items()}
    kernel = BatchedSMC(draws=count, model=settings.model(few))
    populations, stats = [], []
    for seed in random_seed.spawn(chains):
        particles, evidence = sample(kernel, np.random.default_rng(seed))
        populations.append(particles)
        last = {
            "beta": 1.0,
            "log_marginal_likelihood": evidence.value,
            "log_evidence_variance": evidence.standard_error**2,
        }
        stats.append({name: [value] for name, value in last.items()})
    tree = particles_to_tree(
        kernel, populations, stats, kernel.model.unobserved_RVs, random_seed.entropy
    )
    error = _error_of_specimens(few, distributions_of(tree))
    tree["evidence"] = tree["evidence"].to_dataset().assign(specimens_se=error)
    dims = {
        "centre": ("specimen", "coordinate", "particle"),
        "scatter": ("specimen", "coordinate", "particle"),
        "log_sigma": ("specimen", "particle"),
        "log_weight": ("specimen", "particle"),
        "tests": ("specimen",),
        "standard_error": ("specimen",),
    }
    tree["specimens"] = xr.Dataset(
        {k: (v, np.stack([getattr(d, k) for d in draws.values()])) for k, v in dims.items()},
        {"specimen": list(draws), "coordinate": settings.scale.names},
    )
    tree.attrs |= settings.attrs()
    return tree


def distributions_of(tree: xr.DataTree) -> ClassDistribution:
    """Draws of a class's distribution, along the first of two axes."""
    posterior = tree["posterior"].to_dataset().stack(sample=("chain", "draw"))
    chosen = np.linspace(0, posterior.sizes["sample"] - 1, _DISTRIBUTIONS).round().astype(int)
    posterior = posterior.isel(sample=np.unique(chosen))

    def vector(name: str) -> Array | None:
        if name not in posterior:
            return None
        return posterior[name].transpose("coordinate", "sample").values[..., None]

    size = posterior.sizes["coordinate"]
    factors = np.ones((posterior.sizes["sample"], 1, 1))
    if size > 1:
        factors = np.linalg.cholesky(posterior["correlation"].transpose("sample", ...).values)
    optional = {
        name: posterior[name].values[:, None]
        for name in ("effect_spread", "noise_spread")
        if name in posterior
    }
    if "noise_spread" in posterior:
        optional["log_sigma"] = np.log(posterior["sigma"].values)[:, None]
    return ClassDistribution(
        vector("location"),
        vector("spread"),
        [[factors[:, i, j, None] for j in range(i + 1)] for i in range(size)],
        vector("experiment_spread"),
        **optional,
    )


def _error_of_specimens(
    draws: Mapping[str, SpecimenDraws], distributions: ClassDistribution
) -> float:
    """Standard error of a class's log evidence that comes from the draws of its specimens."""
    variance = 0.0
    for specimen in draws.values():
        log_weights = specimen.log_weight + log_densities(specimen, distributions)
        log_weights -= logsumexp(log_weights, axis=1, keepdims=True)
        effective = np.exp(-logsumexp(2 * log_weights, axis=1))
        variance += specimen.standard_error**2 + np.mean(1 / effective) - 1 / log_weights.shape[1]
    return float(np.sqrt(variance))


class SpecimenEvidence(NamedTuple):
    """Log evidence of a specimen under a class, and how far it can be trusted.

    The second standard error leaves out what the evidences of all classes have in common, the
    draws of the specimen.
    """

    log_evidence: Estimate
    own_error: float
    pareto_k: float


def specimen_evidence(draws: SpecimenDraws, distributions: ClassDistribution) -> SpecimenEvidence:
    """Evidence of a specimen that is a fresh draw from a class, its distribution averaged over."""
    density = log_densities(draws, distributions)
    count = len(density)
    log_weights = draws.log_weight + logsumexp(density, axis=0) - np.log(count)
    value = float(logsumexp(log_weights))
    effective = effective_sample_size(log_weights)
    pareto_k = float(array_stats.psislw(-log_weights)[1])
    of_draws = max(1 / effective - 1 / log_weights.size, 0.0)
    each = np.exp(logsumexp(density + draws.log_weight, axis=1) - value)
    own = float(np.sqrt(of_draws + np.var(each) / count))
    estimate = Estimate(value, float(np.hypot(own, draws.standard_error)))
    if effective < _ENOUGH:
        pareto_k = np.inf
    return SpecimenEvidence(estimate, own, pareto_k)


def near_class(distributions: ClassDistribution) -> ClassDistribution:
    """One distribution like those of a class, and wider: a reference for a specimen of it."""
    d = distributions
    location, spread = np.asarray(d.location)[..., 0], np.asarray(d.spread)[..., 0]
    mean = location.mean(axis=1)
    wide = 1.5 * np.sqrt(location.var(axis=1) + (spread**2).mean(axis=1))
    optional: dict[str, Any] = {}
    if d.experiment_spread is not None:
        within = np.asarray(d.experiment_spread)[..., 0]
        optional |= {
            "experiment_spread": 1.5 * np.sqrt((within**2).mean(axis=1)),
            "effect_spread": np.sqrt(np.mean(np.square(d.effect_spread))),
        }
    if d.log_sigma is not None:
        spread_of = np.var(d.log_sigma) + np.mean(np.square(d.noise_spread))
        optional |= {"log_sigma": np.mean(d.log_sigma), "noise_spread": 1.5 * np.sqrt(spread_of)}
    return ClassDistribution(mean, wide, independent(len(mean)), **optional)


class ClassPrediction(NamedTuple):
    """What a class says of a new specimen."""

    evidence: SpecimenEvidence
    p_value: float


class SpecimenPredictive:
    """What fitted classes say of new specimens.

    Parameters
    ----------
    settings : Variability
        Settings of all classes.
    classes : dict of str to xarray.DataTree
        The classes by name.
    sampler : SpecimenSampler
        Sampler of the new specimens.
    """

    def __init__(
        self, settings: Variability, classes: Mapping[str, xr.DataTree], sampler: SpecimenSampler
    ) -> None:
        self._settings, self._sampler = settings, sampler
        self._distributions = {name: distributions_of(tree) for name, tree in classes.items()}
        self._closer: dict[str, SpecimenSampler] = {}

    def __call__(
        self, data: xr.Dataset, rng: np.random.Generator, draws: SpecimenDraws | None = None
    ) -> list[ClassPrediction]:
        """Evidence and predictive p-value of the specimen of these data under each class."""
        draws = draws or self._sampler(data, rng)
        predictions = []
        for name, distributions in self._distributions.items():
            evidence = specimen_evidence(draws, distributions)
            if evidence.pareto_k >= _LARGEST_PARETO_K:
                again = specimen_evidence(self._near(name)(data, rng), distributions)
                if again.pareto_k < evidence.pareto_k:
                    # From draws of its own, which no other class shares.
                    evidence = again._replace(own_error=again.log_evidence.standard_error)
            p_value = self._p_value(data, distributions, rng)
            predictions.append(ClassPrediction(evidence, p_value))
        return predictions

    def _near(self, name: str) -> SpecimenSampler:
        """Sampler under a distribution like that of a class."""
        if name not in self._closer:
            self._closer[name] = SpecimenSampler(
                self._settings.scale,
                self._sampler.rule,
                near_class(self._distributions[name]),
                self._settings.known_sigma,
            )
        return self._closer[name]

    def _p_value(
        self, data: xr.Dataset, distributions: ClassDistribution, rng: np.random.Generator
    ) -> float:
        """Share of the specimens of a class that are as unlikely as this one, or more.

        The class brings forth specimens, measured as this one was. Each, and the new one, is held
        against all the others: how likely it is depends on how far it is from its neighbours. What
        no combination of the class's curves could follow is noise, and says nothing here: else
        specimens measured better than usual would be of every class, and others of none.
        """
        tests = data.sizes["test"]
        draws = fresh_specimens(self._settings.scale, distributions, tests, rng)
        curves = self._sampler.curves(data, draws)
        sigma = self._settings.known_sigma
        sd = np.full((len(curves), 1), sigma) if sigma else np.exp(draws["log_specimen_sigma"])
        sd = sd / np.sqrt(2)
        sizes = np.abs(curves).max(axis=1)
        # No comparison with NaN is true.
        possible = (sizes < _LARGEST_PRESSURE) & (sizes > _SMALLEST_PRESSURE)
        if possible.sum() < _FEWEST_CURVES:
            return np.nan
        curves, sd = curves[possible], sd[possible]
        alike = curves / np.linalg.norm(curves, axis=1, keepdims=True)
        _, shares, directions = np.linalg.svd(alike, full_matrices=False)
        directions = directions[shares > _LEAST_SHARE * shares[0]].T
        curves = curves @ directions
        measured = np.concatenate(
            [
                data["pressure"].values[None] @ directions,
                curves + sd * rng.standard_normal(curves.shape),
            ]
        )
        scaled = curves / sd**2
        squares = (measured**2).sum(axis=1, keepdims=True)
        misfit = squares / (sd**2).T - 2 * measured @ scaled.T + (scaled * curves).sum(axis=1)
        log_likelihood = -misfit / 2 - curves.shape[1] * np.log(sd).T
        # Not against itself.
        np.fill_diagonal(log_likelihood[1:], -np.inf)
        likely = logsumexp(log_likelihood, axis=1)
        likely[0] += np.log((len(curves) - 1) / len(curves))
        return float((1 + np.sum(likely[1:] <= likely[0])) / len(likely))
