"""Draws of a specimen, and their density under any distribution of a class."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, reduce
from types import ModuleType
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymc_hyperelastic.models.class_distribution import ClassDistribution

Array = NDArray[np.float64]

# Log densities that are found at once: their arrays stay in the processor's cache.
_BLOCK = 16_000
# Gauss-Hermite quadrature over how much experiments on a specimen differ. Five nodes, placed where
# the integrand is, have an error of 0.002 nats in nine cases of ten; of a single test, which has no
# scatter to place them by, up to 0.1 nats in the tails.
_NODES, _WEIGHTS = np.polynomial.hermite.hermgauss(5)
_WEIGHTS = _WEIGHTS * np.exp(_NODES**2)
_NO_SCATTER = 1e-12


@dataclass(frozen=True)
class SpecimenDraws:
    r"""Draws ``x_i`` of the coordinates of one specimen, with weights ``w_i``.

    For every density ``f`` of its coordinates, ``∫ p(D | x) f(x) dx ≈ Σ w_i f(x_i)``.

    Attributes
    ----------
    centre, scatter : array, shape (coordinate, draw)
        Mean of the tests' coordinates, and the sum of their squared deviations from it.
    log_size : array, shape (noise, draw)
        Logarithm of each inferred size of an error.
    log_weight : array, shape (draw)
        Logarithm of the weights.
    tests : int
        Number of tests with coordinates of their own.
    standard_error : float
        Standard error of the logarithm of all weights together.
    points : array, shape (draw, entry)
        Unknowns of the curves: the coordinates of each test, the logarithm of each inferred size of
        an error, and the deviations of the tube.
    deviations : array, shape (measure, draw)
        By how much measures of the tube differ from what was measured, in standard deviations.
        Their prior is that of all classes, and is no part of the weights.
    covariates : array, shape (covariate)
        What else is known of the specimen, and moves the class's location.
    misfit, freedom : float
        Sum of the squared misfits of the best curve, in standard deviations of the noise if that is
        known, and the number of degrees of freedom that it would have.
    method, pareto_k : str, float
        How the integral was taken that all weights together are, see ``Integral``.
    """

    centre: Array
    scatter: Array
    log_size: Array
    log_weight: Array
    tests: int
    standard_error: float
    points: Array
    deviations: Array
    method: str = ""
    pareto_k: float = np.nan
    covariates: Array = field(default_factory=lambda: np.empty(0))
    misfit: float = np.nan
    freedom: float = np.nan

    def as_dataset(self) -> xr.Dataset:
        """All of it, as it is kept in a file."""
        found = xr.Dataset()
        for name, value in vars(self).items():
            dims = [f"{name}_{axis}" for axis in range(np.ndim(value))]
            found[name] = (dims, value) if dims else value
        return found

    @classmethod
    def of_dataset(cls, kept: xr.Dataset) -> "SpecimenDraws":
        """What :meth:`as_dataset` kept."""
        values = {str(n): v.values if v.ndim else v.item() for n, v in kept.data_vars.items()}
        return cls(**values)

    def first(self, count: int) -> "SpecimenDraws":
        """So many of the draws, in place of all."""
        return replace(
            self,
            centre=self.centre[:, :count],
            scatter=self.scatter[:, :count],
            log_size=self.log_size[:, :count],
            log_weight=self.log_weight[:count] + np.log(len(self.log_weight) / count),
            points=self.points[:count],
            deviations=self.deviations[:, :count],
        )


def stacked(specimens: Sequence[SpecimenDraws]) -> dict[str, Array]:
    """Arrays of several specimens, which follow the coordinates and come before the draws."""
    arrays = {
        name: np.stack([getattr(draws, name) for draws in specimens], axis=-2)
        for name in ("centre", "scatter", "log_size")
    }
    arrays["log_weight"] = np.stack([draws.log_weight for draws in specimens])
    covariates = np.stack([draws.covariates for draws in specimens], axis=-1)[..., None]
    arrays["products"] = _products(arrays["centre"], covariates)
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
    products = draws["products"] if "products" in draws else _products(draws["centre"])
    if distribution.experiment_spread is None:
        total = _of_draws(_coefficients(xp, distribution), products)
    else:
        total = _log_density_of_tests(xp, {**draws, "products": products}, distribution)
    if distribution.log_size is not None:
        total = total + log_density_of_noise(xp, draws["log_size"], distribution)
    return total


def log_density_of_noise(xp: ModuleType, log_size: Any, distribution: ClassDistribution) -> Any:
    """The part of :func:`log_density` that is the noise's."""
    moments = zip(distribution.log_size, distribution.noise_spread, strict=True)
    return sum(_log_normal(xp, log_size[i], *moment) for i, moment in enumerate(moments))


def log_densities(draws: SpecimenDraws, distributions: ClassDistribution) -> Array:
    """Log density of every draw of a specimen under each of many class distributions."""
    arrays = {name: getattr(draws, name) for name in ("centre", "scatter", "log_size", "tests")}
    arrays["products"] = _products(draws.centre, draws.covariates[:, None])
    count, size = len(distributions.location[0]), max(1, _BLOCK // len(draws.log_weight))
    blocks = np.split(np.arange(count), range(size, count, size))
    if distributions.experiment_spread is not None:
        parts = [log_density(np, arrays, distributions.at(block)) for block in blocks]
        return np.concatenate(parts)
    coefficients = _coefficients(np, distributions)
    densities = np.empty((count, len(draws.log_weight)))
    for block in blocks:
        densities[block] = _of_draws(coefficients[block], arrays["products"])
        if distributions.log_size is not None:
            noise = arrays["log_size"], distributions.at(block)
            densities[block] += log_density_of_noise(np, *noise)
    return densities


def mean_density(draws: SpecimenDraws, distributions: ClassDistribution) -> Array:
    """Logarithm of the mean density of every draw under many class distributions."""
    densities = log_densities(draws, distributions)
    largest = densities.max(axis=0)
    return largest + np.log(np.exp(densities - largest).mean(axis=0))


def density_of_each(x: Array, distributions: ClassDistribution) -> Array:
    """Log density of coordinates (coordinate, draw, specimen), each under the draw's distribution.

    Noise is left out, and so are differences between experiments.
    """
    return np.einsum("df,fds->ds", _coefficients(np, distributions), _products(x))


def _products(x: Array, covariates: Array | None = None) -> Array:
    """What a normal log density is a sum over, of coordinates ``x`` and covariates ``z``.

    All products of two of ``(x, z)``, each once, these themselves, and 1.
    """
    if covariates is not None:
        covariates = np.broadcast_to(covariates, (len(covariates), *x.shape[1:]))
        x = np.concatenate([x, covariates])
    rows, columns = np.triu_indices(len(x))
    return np.concatenate([x[rows] * x[columns], x, np.ones_like(x[:1])])


@cache
def _of_pairs(size: int) -> Array:
    """What makes one of both entries of a symmetric matrix, flat, that are of the same pair."""
    rows, columns = np.triu_indices(size)
    sums = np.zeros((size, size, len(rows)))
    sums[rows, columns, np.arange(len(rows))] = 1.0
    sums[columns, rows, np.arange(len(rows))] = 1.0
    return sums.reshape(size**2, -1)


def _coefficients(xp: ModuleType, distribution: ClassDistribution) -> Any:
    r"""Numbers by which the products enter a normal log density, along the last axis.

    With the lower triangular ``A`` for which :math:`A Σ A^T = 1`, and effects ``B`` of covariates,
    it is

    .. math:: \ln \det A - \tfrac{d}{2} \ln 2π - \tfrac12 |A (x - B z - m)|^2.

    For many draws under many distributions one matrix product is by far the fastest way.
    """
    size, factor = distribution.size, distribution.factor
    location, spread = (
        _side_by_side(xp, values, size) for values in (distribution.location, distribution.spread)
    )
    whitening = _inverse(xp, factor) / spread[..., None, :]
    middle = (whitening * location[..., None, :]).sum(axis=-1)
    whitening = _with_effects(xp, whitening, distribution)
    slope = (whitening * middle[..., None]).sum(axis=-2)
    log_volume = -xp.log((factor * np.eye(size)).sum(axis=-1) * spread).sum(axis=-1)
    constant = log_volume - xp.square(middle).sum(axis=-1) / 2 - size / 2 * np.log(2 * np.pi)
    squares = -(whitening.mT @ whitening) / 2
    squares = squares.reshape((*location.shape[:-1], -1))
    squares = squares @ _of_pairs(size + len(distribution.effects))
    return xp.concatenate([squares, slope, constant[..., None]], axis=-1)


def _inverse(xp: ModuleType, factor: Any) -> Any:
    """Inverse of a lower triangular matrix."""
    if isinstance(factor, np.ndarray):
        return np.linalg.inv(factor)
    return xp.linalg.solve_triangular(factor, np.eye(factor.type.shape[-1]), lower=True)


def _with_effects(xp: ModuleType, matrix: Any, distribution: ClassDistribution) -> Any:
    """A matrix of coordinates, continued by what it makes of covariates."""
    size = distribution.size
    columns = [
        -(matrix * _side_by_side(xp, effect, size)[..., None, :]).sum(axis=-1)[..., None]
        for effect in distribution.effects
    ]
    return xp.concatenate([matrix, *columns], axis=-1) if columns else matrix


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
    size, tests, effect = distribution.size, draws["tests"], distribution.effect_spread
    axes = draws["centre"].ndim - 1
    known = size + len(distribution.effects) + 1
    spread, variances, of_centre = _apart(xp, draws["products"][-known:], distribution)
    squares = _of_draws(1 / xp.square(spread), draws["scatter"])
    count, squared_effect = (tests - 1) * size, effect**2
    # A single test has no scatter.
    scaled, shift = 2 * squared_effect * (squares + _NO_SCATTER), 2 * count * squared_effect
    level = xp.log(scaled) + shift
    omega = xp.logaddexp(0.0, level)
    for _ in range(2):
        omega = omega * (1 + level - xp.log(omega)) / (1 + omega)
    width = effect / xp.sqrt(1 + omega)
    middle, growth = (level - shift - xp.log(omega)) / 2, scaled / omega

    # Node by node: sums and maxima over an axis in the midst take long.
    steps = width * np.sqrt(8)
    exponents, volumes = [], []
    for node, grown in zip(_NODES, _grown(xp, steps), strict=True):
        of_tests, volume = squares / (growth * grown), 1.0
        added = growth * grown / tests
        for i, square in enumerate(of_centre):
            variance = variances[(..., i, *(None,) * axes)] + added
            of_tests, volume = of_tests + square / variance, volume * variance
        # With it the prior of u, and the volume of the tests' coordinates.
        of_effect = xp.square((middle + node * steps / 2) / effect + count * effect)
        exponents.append(-(of_tests + of_effect) / 2)
        volumes.append(volume)
    largest = reduce(xp.maximum, exponents)
    mean = sum(
        weight * xp.exp(exponent - largest) / xp.sqrt(volume)
        for weight, exponent, volume in zip(_WEIGHTS, exponents, volumes, strict=True)
    )
    total = largest + xp.log(mean * width)
    total = total + xp.square(count * effect) / 2 - xp.log(effect) - np.log(np.pi) / 2
    normaliser = xp.log(spread).sum(axis=-1)[(..., *(None,) * axes)] + size / 2 * np.log(2 * np.pi)
    return total - tests * normaliser - size / 2 * xp.log(tests)


def _grown(xp: ModuleType, steps: Any) -> list[Any]:
    """The exponentials of so many steps as the nodes are, which are symmetric."""
    above = [xp.exp(node * steps) for node in _NODES if node > 0]
    return [*(1 / factor for factor in above[::-1]), 1.0, *above]


def _apart(
    xp: ModuleType, centre: Any, distribution: ClassDistribution
) -> tuple[Any, Any, list[Any]]:
    r"""Directions in which specimens, and experiments on one, both differ independently.

    There are ``V`` and ``λ`` with :math:`Σ = ω V λ V^T ω` where ``ω`` is the diagonal matrix of the
    experiments' standard deviations.

    Returns
    -------
    spread, variances : tensor_like, shape (..., coordinate)
        ``ω`` and ``λ``.
    squares : sequence of tensor_like
        Squares of each of :math:`V^T ω^{-1} (\bar x - m)`, of the draws.
    """
    size = distribution.size
    location, spread, within = (
        _side_by_side(xp, values, size)
        for values in (distribution.location, distribution.spread, distribution.experiment_spread)
    )
    ratio = spread / within
    factor = ratio[..., None] * distribution.factor
    variances, vectors = xp.linalg.eigh(factor @ factor.mT)
    whitening = vectors.mT / within[..., None, :]
    moved = (whitening * location[..., None, :]).sum(axis=-1)
    whitening = _with_effects(xp, whitening, distribution)
    coefficients = xp.concatenate([whitening, -moved[..., None]], axis=-1)
    squares = [xp.square(_of_draws(coefficients[..., i, :], centre)) for i in range(size)]
    return within, variances, squares


def _side_by_side(xp: ModuleType, values: Any, size: int) -> Any:
    """Numbers of the coordinates along the last axis, in place of the first."""
    return xp.concatenate([xp.atleast_1d(values[i]) for i in range(size)], axis=-1)


def _of_draws(coefficients: Any, draws: Any) -> Any:
    """Sums, by these coefficients, of what the draws have along their first axis."""
    total = coefficients @ draws.reshape((draws.shape[0], -1))
    return total.reshape((*total.shape[:-1], *draws.shape[1:]))


def _log_normal(xp: ModuleType, x: Any, mean: Any, sd: Any) -> Any:
    return -xp.square((x - mean) / sd) / 2 - xp.log(sd) - np.log(2 * np.pi) / 2
