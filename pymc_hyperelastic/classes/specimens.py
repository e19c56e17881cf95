"""What the curves of one specimen say, in a form that any class distribution can be held against.

The evidence of a class with variability is an integral over the parameters of every specimen. Each
specimen is sampled once, under a wide reference distribution; under any class distribution its
likelihood is then a weighted mean over these draws, and a class has few unknowns left.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.evidence.batched import BatchedFunction
from pymc_hyperelastic.evidence.importance import (
    adapted_mixture,
    fitted_mixture,
    mean_weight,
    weighted_draws,
)
from pymc_hyperelastic.evidence.kernel import BatchedSMC
from pymc_hyperelastic.evidence.mixture import GaussianMixture, components_for
from pymc_hyperelastic.evidence.modes import mixture_at_modes
from pymc_hyperelastic.evidence.smc import Estimate
from pymc_hyperelastic.evidence.weights import systematic
from pymc_hyperelastic.models.likelihood import shared_inputs
from pymc_hyperelastic.models.population import (
    ClassDistribution,
    NaturalScale,
    curve_inputs,
    register_class,
    register_curves,
    register_specimens,
)
from pymc_hyperelastic.models.priors import is_inferred
from pymc_hyperelastic.models.rules import Rule

__all__ = [
    "SpecimenDraws",
    "SpecimenSampler",
    "class_model",
    "log_densities",
    "log_density",
    "reference_of",
]

Array = NDArray[np.float64]

# Particles of a specimen, and how many of them are held against many distributions at once.
_PARTICLES, _BLOCK = 2000, 25
# Draws of importance sampling, and the Pareto shape from which on their mean cannot be believed.
_DRAWS, _LARGEST_PARETO_K = 8000, 0.7
# Effective draws without which nothing is known of a mean.
_ENOUGH = 300
# Spreads of the reference distribution, in medians of a class's.
_WIDER = 2.0
_EFFECT = 1.0
_NOISE_DRAWS = 2000
# Gauss-Hermite quadrature over how much experiments on a specimen differ. Five nodes, placed where
# the integrand is, have an error of 0.002 nats in nine cases of ten; of a single test, which has no
# scatter to place them by, up to 0.1 nats in the tails.
_NODES, _WEIGHTS = np.polynomial.hermite.hermgauss(5)
_LOG_WEIGHTS = np.log(_WEIGHTS) + _NODES**2
_NO_SCATTER = 1e-12


@dataclass(frozen=True)
class SpecimenDraws:
    r"""Draws ``x_i`` of the coordinates of one specimen, with weights ``w_i``.

    For every density ``f`` of its coordinates, ``∫ p(D | x) f(x) dx ≈ Σ w_i f(x_i)``.

    Attributes
    ----------
    centre, scatter : array, shape (coordinate, draw)
        Mean of the tests' coordinates, and the sum of their squared deviations from it.
    log_sigma : array, shape (draw)
        ``ln σ``, zero if the noise is known.
    log_weight : array, shape (draw)
        Logarithm of the weights.
    tests : int
        Number of tests with coordinates of their own.
    standard_error : float
        Standard error of the logarithm of all weights together.
    """

    centre: Array
    scatter: Array
    log_sigma: Array
    log_weight: Array
    tests: int
    standard_error: float

    def first(self, count: int) -> "SpecimenDraws":
        """So many of the draws, in place of all."""
        return replace(
            self,
            centre=self.centre[:, :count],
            scatter=self.scatter[:, :count],
            log_sigma=self.log_sigma[:count],
            log_weight=self.log_weight[:count] + np.log(len(self.log_weight) / count),
        )


def sample(kernel: BatchedSMC, rng: np.random.Generator) -> tuple[Array, Estimate]:
    """Particles of the posterior in random order, and the evidence.

    Posteriors here have few variables and mostly one mode: importance sampling from a mixture gives
    them in a tenth of the time of SMC, which is left the others.
    """
    kernel.set_rng(rng)
    steps = max(1000, 250 * kernel.dimension)
    start = kernel.initialize_population()
    columns = [np.reshape(start[v.name], (len(start[v.name]), -1)) for v in kernel.variables]
    prior = np.concatenate(columns, axis=1)
    modes = mixture_at_modes(kernel.score, prior)
    best, found = Estimate(-np.inf, np.inf), prior
    for broad in (False, True):
        mixture = modes
        if broad:
            # A posterior that is hardly narrower than the prior is not like its mode.
            wide = GaussianMixture.fit(prior, components_for(steps, kernel.dimension), rng)
            followed = adapted_mixture(kernel.score, wide, rng, steps)
            mixture = modes.joined(followed or wide)
        mixture = fitted_mixture(kernel.score, mixture, rng, steps)
        points, log_weights = weighted_draws(kernel.score, mixture, _DRAWS, rng)
        evidence, pareto_k = mean_weight(log_weights, enough=_ENOUGH)
        if evidence.value > best.value:
            weights = np.exp(log_weights - log_weights.max())
            best, found = evidence, points[systematic(weights, kernel.draws, rng)]
        if pareto_k < _LARGEST_PARETO_K:
            return rng.permutation(found), best
    kernel.temper(None, rng)
    # Both are unbiased, and miss modes rather than invent them: the larger is the better one.
    if kernel.log_marginal_likelihood > best.value:
        best = Estimate(
            kernel.log_marginal_likelihood, float(np.sqrt(kernel.log_evidence_variance))
        )
        found = kernel.tempered_posterior
    return rng.permutation(found), best


class SpecimenSampler:
    """Sample specimens, each by itself, under one reference distribution.

    Specimens with the same number of tests share one compiled model.

    Parameters
    ----------
    scale : NaturalScale
        The coordinates.
    rule : Rule
        How the walls are integrated.
    reference : ClassDistribution
        The reference distribution, in numbers.
    sigma : float, optional
        The noise; None where each specimen has its own.
    """

    def __init__(
        self, scale: NaturalScale, rule: Rule, reference: ClassDistribution, sigma: float | None
    ) -> None:
        self.scale, self.rule, self.reference, self.sigma = scale, rule, reference, sigma
        self._kernels: dict[int, tuple[BatchedSMC, dict[str, Any], BatchedFunction]] = {}

    def __call__(self, data: xr.Dataset, rng: np.random.Generator) -> SpecimenDraws:
        """Sample the specimen of these data."""
        kernel, _ = self._kernel_for(data)
        particles, evidence = sample(kernel, rng)
        columns = dict(zip(kernel.var_info, self._columns(kernel, particles), strict=True))
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
        kernel, pressure = self._kernel_for(data)
        particles = np.concatenate([draws[name] for name in kernel.var_info], axis=1)
        return pressure(particles)[0]

    def _kernel_for(self, data: xr.Dataset) -> tuple[BatchedSMC, BatchedFunction]:
        """Kernel of the model of a specimen with as many tests, and its curves, with these data."""
        tests = data.sizes["test"]
        arrays = curve_inputs(data, self.rule)
        if tests not in self._kernels:
            self._kernels[tests] = self._model(arrays, tests)
        kernel, inputs, pressure = self._kernels[tests]
        for name, value in arrays.items():
            inputs[name].set_value(value, borrow=True)
        return kernel, pressure

    @staticmethod
    def _columns(kernel: BatchedSMC, particles: Array) -> list[Array]:
        ends = np.cumsum([size for _, size in kernel.var_info.values()])
        return np.split(particles, ends[:-1], axis=1)

    def _model(
        self, arrays: dict[str, Array], tests: int
    ) -> tuple[BatchedSMC, dict[str, Any], BatchedFunction]:
        inputs = shared_inputs("specimen", arrays)
        coords = {"specimen": [0], "test": np.arange(tests)}
        with pm.Model(coords=coords, model=None) as model:
            of_test = np.zeros(tests, int)
            coordinates, sigma = register_specimens(self.scale, self.reference, of_test)
            sigma = pt.full((1,), np.float64(self.sigma)) if sigma is None else sigma
            register_curves(self.scale, inputs, self.rule, coordinates, sigma[of_test])
        pressure = BatchedFunction.of_model(model, model.replace_rvs_by_values([model["pressure"]]))
        return BatchedSMC(draws=_PARTICLES, model=model), inputs, pressure


def reference_of(scale: NaturalScale, sigma: Any, experiment_effect: bool) -> ClassDistribution:
    """Distribution of a specimen of which not even the class is known."""
    mean, sd = scale.location_prior
    spread = _WIDER * np.exp(scale.spread_prior[0])
    optional: dict[str, Any] = {}
    if experiment_effect:
        optional |= {"experiment_spread": spread / 2, "effect_spread": _EFFECT}
    if is_inferred(sigma):
        logs = np.log(pm.draw(sigma, draws=_NOISE_DRAWS, random_seed=1, mode="FAST_COMPILE"))
        optional |= {"log_sigma": logs.mean(), "noise_spread": np.hypot(logs.std(), 0.5)}
    return ClassDistribution(mean, np.hypot(sd, spread), independent(len(mean)), **optional)


def independent(size: int) -> list[list[float]]:
    """Cholesky factor of no correlation, row by row."""
    return [row[: i + 1] for i, row in enumerate(np.eye(size).tolist())]


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


def stacked(specimens: Sequence[SpecimenDraws]) -> dict[str, Array]:
    """Arrays of several specimens, which follow the coordinates and come before the draws."""
    arrays = {
        name: np.stack([getattr(draws, name) for draws in specimens], axis=-2)
        for name in ("centre", "scatter")
    }
    for name in ("log_sigma", "log_weight"):
        arrays[name] = np.stack([getattr(draws, name) for draws in specimens])
    return arrays | {"tests": np.array([[float(draws.tests)] for draws in specimens])}


def log_density(xp: ModuleType, draws: Mapping[str, Any], distribution: ClassDistribution) -> Any:
    r"""Log density of draws of specimens under a class distribution.

    The coordinates of the specimen itself are integrated out: with the mean ``x̄`` of the
    coordinates of its ``T`` tests

    .. math:: \int \prod_t N(x_t; x, Ω) N(x; m, Σ) dx = N(\bar x; m, Σ + Ω/T) \,
        \frac{\exp(-\frac12 \sum_t |Ω^{-1/2} (x_t - \bar x)|^2)}{T^{d/2} \, |2πΩ|^{(T-1)/2}}

    and so is, by quadrature, how much its experiments differ.

    `draws` holds the arrays of :class:`SpecimenDraws`, coordinates along the first axis, and
    `distribution` what broadcasts against them; `xp` is ``numpy`` for numbers and
    ``pytensor.tensor`` for variables.
    """
    if distribution.experiment_spread is None:
        total = _log_density_of_centre(xp, draws["centre"], distribution)
    else:
        total = _log_density_of_tests(xp, draws, distribution)
    if distribution.log_sigma is not None:
        mean, sd = distribution.log_sigma, distribution.noise_spread
        total = total + _log_normal(xp, draws["log_sigma"], mean, sd)
    return total


def log_densities(draws: SpecimenDraws, distributions: ClassDistribution) -> Array:
    """Log density of every draw of a specimen under each of many class distributions."""
    of_draws = ("centre", "scatter", "log_sigma")
    blocks = np.split(
        np.arange(len(draws.log_weight)), range(_BLOCK, len(draws.log_weight), _BLOCK)
    )
    return np.concatenate(
        [
            log_density(
                np,
                {name: getattr(draws, name)[..., block] for name in of_draws}
                | {"tests": draws.tests},
                distributions,
            )
            for block in blocks
        ],
        axis=1,
    )


def _log_density_of_centre(
    xp: ModuleType, centre: Any, distribution: ClassDistribution, added: Sequence[Any] = ()
) -> Any:
    """Normal log density of the mean of the tests' coordinates, with variances that add."""
    size, spread = len(distribution.factor), distribution.spread

    def covariance(i: int, j: int) -> Any:
        rows = distribution.factor[i], distribution.factor[j]
        common = sum(a * b for a, b in zip(*rows, strict=False)) * spread[i] * spread[j]
        return common + added[i] if added and i == j else common

    total: Any = -size / 2 * np.log(2 * np.pi)
    factor: list[list[Any]] = []
    standard: list[Any] = []
    # The Cholesky factor, entry by entry: for many distributions at once that is far faster than
    # one after the other.
    for i in range(size):
        row: list[Any] = []
        for j in range(i):
            known = sum(a * b for a, b in zip(row, factor[j], strict=False))
            row.append((covariance(i, j) - known) / factor[j][j])
        row.append(xp.sqrt(covariance(i, i) - sum(a * a for a in row)))
        factor.append(row)
        offset = centre[i] - distribution.location[i]
        offset = offset - sum(a * z for a, z in zip(row, standard, strict=False))
        standard.append(offset / row[i])
        total = total - xp.square(standard[i]) / 2 - xp.log(row[i])
    return total


def _log_density_of_tests(
    xp: ModuleType, draws: Mapping[str, Any], distribution: ClassDistribution
) -> Any:
    r"""Log density where experiments on a specimen differ, by an unknown ``u = ln κ_s``.

    The scatter of its tests says what ``u`` is, far more sharply than the class does: quadrature
    has its nodes around the maximum of

    .. math:: -\tfrac12 Q e^{-2u} - a u - u^2/(2η^2), \qquad
        Q = \sum_t |\mathrm{diag}(ω)^{-1} (x_t - \bar x)|^2, \quad a = (T - 1) d

    which is at :math:`u = w/2 - aη^2` with :math:`w + \ln w = \ln(2 η^2 Q) + 2 a η^2`, the Wright
    omega function, and as wide as :math:`η/\sqrt{1 + w}`.
    """
    size, tests, effect = len(distribution.factor), draws["tests"], distribution.effect_spread
    variance = [xp.square(distribution.experiment_spread[i]) for i in range(size)]
    squares = sum(draws["scatter"][i] / variance[i] for i in range(size))
    count, squared_effect = (tests - 1) * size, effect**2
    # A single test has no scatter.
    level = xp.log(2 * squared_effect * (squares + _NO_SCATTER)) + 2 * count * squared_effect
    omega = xp.logaddexp(0.0, level)
    for _ in range(2):
        omega = omega * (1 + level - xp.log(omega)) / (1 + omega)
    middle, width = omega / 2 - count * squared_effect, effect / xp.sqrt(1 + omega)

    shape = (-1,) + (1,) * middle.ndim
    log_effect = middle + np.sqrt(2) * width * _NODES.reshape(shape)
    growth = xp.exp(2 * log_effect)
    added = [v * growth / tests for v in variance]
    terms = _log_density_of_centre(xp, draws["centre"], distribution, added)
    terms = terms - squares / (2 * growth) - count * log_effect
    terms = terms + _log_normal(xp, log_effect, 0.0, effect) + _LOG_WEIGHTS.reshape(shape)
    largest = xp.max(terms, axis=0)
    total = largest + xp.log(xp.sum(xp.exp(terms - largest), axis=0)) + xp.log(np.sqrt(2) * width)
    normaliser = sum(xp.log(2 * np.pi * v) for v in variance)
    return total - (tests - 1) / 2 * normaliser - size / 2 * xp.log(tests)


def _log_normal(xp: ModuleType, x: Any, mean: Any, sd: Any) -> Any:
    return -xp.square((x - mean) / sd) / 2 - xp.log(sd) - np.log(2 * np.pi) / 2


def class_model(
    scale: NaturalScale,
    specimens: Sequence[SpecimenDraws],
    names: Sequence[str],
    *,
    sigma: Any,
    experiment_effect: bool,
    priors: Any = None,
) -> pm.Model:
    """PyMC model of a class's distribution alone, its specimens integrated out by their draws."""
    coords = {"coordinate": scale.names, "coordinate_2": scale.names, "specimen": list(names)}
    with pm.Model(coords=coords, model=None) as model:
        distribution = register_class(scale, sigma, experiment_effect, priors)
        inputs = shared_inputs("specimens", stacked(specimens))
        inputs["tests"] = pt.specify_broadcastable(inputs["tests"], 1)
        terms = inputs["log_weight"] + log_density(pt, inputs, distribution)
        pm.Potential("specimens", pt.sum(pt.logsumexp(terms, axis=-1)))
    return model
