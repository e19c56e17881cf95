"""Weighted draws of one specimen, and their log density under distributions of a class.

The draws represent the likelihood of a specimen's data as a function of its coordinates. Classes
are fitted, and specimens classified, by averaging the class density over them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from types import ModuleType
from typing import Any

import numpy as np
import xarray as xr
from numpy.polynomial.hermite import hermgauss
from scipy.special import logsumexp

from pymc_hyperelastic.models.class_distribution import Array, ClassDistribution

# Number of distributions computed at once: larger temporary arrays take up to twice the time.
_BLOCK = 100
# Number of Gauss-Hermite nodes for the integral over the spread of a specimen's tests. The error is
# at most 0.002 nats in nine of ten cases, and up to 0.1 nats in the tails for a single test.
_QUADRATURE_ORDER = 5


@dataclass(frozen=True)
class SpecimenDraws:
    r"""Draws ``x_i`` of the coordinates of one specimen, with importance weights ``w_i``.

    For every density ``f`` of the coordinates, ``∫ p(D | x) f(x) dx ≈ Σ w_i f(x_i)``.

    The prior of the deviations is the same in all classes, and is not part of the weights.
    """

    centre: Array
    """Mean of the coordinates of the tests, shape (coordinate, draw)."""
    scatter: Array
    """Sum of the squared deviations of the tests from the mean, shape (coordinate, draw)."""
    log_size: Array
    """Logarithm of each inferred size of an error, shape (noise, draw)."""
    log_weight: Array
    """Logarithms of the weights, shape (draw)."""
    tests: int
    """Number of tests with coordinates of their own."""
    standard_error: float
    """Standard error of the logarithm of the sum of the weights."""
    points: Array
    """Points of the target density, shape (draw, entry): coordinates, sizes and deviations."""
    deviations: Array
    """Deviations of the tube's measures, in standard deviations, shape (measure, draw)."""
    method: str = ""
    """Method of the integral ``∫ p(D | x) f(x) dx``, see ``Integral``."""
    pareto_k: float = np.nan
    """Pareto shape of the weights of this integral."""
    covariates: Array = field(default_factory=lambda: np.empty(0))
    """Covariates of the specimen, which change the location of the class."""
    misfit: float = np.nan
    """Sum of the squared residuals of the best curve, in variances of the noise if it is known."""
    freedom: float = np.nan
    """Number of degrees of freedom of the misfit."""

    def as_dataset(self) -> xr.Dataset:
        """Return all attributes as a Dataset, to store them in a file."""
        values = vars(self).items()
        return xr.Dataset(
            {n: ([f"{n}_{axis}" for axis in range(np.ndim(v))], v) for n, v in values}
        )

    @classmethod
    def from_dataset(cls, stored: xr.Dataset) -> "SpecimenDraws":
        """Return the draws that :meth:`as_dataset` stored."""
        values = {str(n): v.values if v.ndim else v.item() for n, v in stored.data_vars.items()}
        return cls(**values)

    def first(self, count: int) -> "SpecimenDraws":
        """Return the first `count` draws, with weights scaled up by the ratio of the numbers."""
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
    """Arrays of several specimens for :func:`log_density`, with the axes (..., specimen, draw)."""
    names = "centre", "scatter", "log_size", "log_weight"
    arrays = {n: np.stack([getattr(draws, n) for draws in specimens], axis=-2) for n in names}
    covariates = np.stack([draws.covariates for draws in specimens], axis=-1)[..., None]
    arrays["monomials"] = _monomials(arrays["centre"], covariates)
    return arrays | {"tests": np.array([[float(draws.tests)] for draws in specimens])}


def log_density(xp: ModuleType, draws: Mapping[str, Any], distribution: ClassDistribution) -> Any:
    r"""Log density of draws of specimens under a class distribution.

    With an experiment effect, the coordinates ``x_t`` of the ``T`` tests are normal about the
    coordinates ``x`` of the specimen with the covariance ``Ω``, and ``x`` is integrated out. With
    the mean ``x̄`` of the coordinates of the tests,

    .. math:: \int \prod_t N(x_t; x, Ω) N(x; m, Σ) dx = N(\bar x; m, Σ + Ω/T) \,
        \frac{\exp(-\frac12 \sum_t |Ω^{-1/2} (x_t - \bar x)|^2)}{T^{d/2} \, |2πΩ|^{(T-1)/2}} .

    The scale of ``Ω`` differs between specimens and is integrated out by quadrature.

    `xp` is ``numpy`` for numbers and ``pytensor.tensor`` for variables. `draws` holds the arrays of
    :class:`SpecimenDraws` by name, or those of :func:`stacked`; `distribution` broadcasts against
    them.
    """
    monomials = draws["monomials"] if "monomials" in draws else _monomials(draws["centre"])
    if distribution.experiment_spread is None:
        total = _combined(_coefficients(xp, distribution), monomials)
    else:
        total = _log_density_of_tests(xp, {**draws, "monomials": monomials}, distribution)
    if distribution.log_size is not None:
        total = total + log_density_of_noise(xp, draws["log_size"], distribution)
    return total


def log_density_of_noise(xp: ModuleType, log_size: Any, distribution: ClassDistribution) -> Any:
    """Log density of the logarithms of the inferred sizes of errors, see :func:`log_density`."""
    moments = zip(distribution.log_size, distribution.noise_spread, strict=True)
    return sum(_log_normal(xp, log_size[i], *moment) for i, moment in enumerate(moments))


def log_densities(draws: SpecimenDraws, distributions: ClassDistribution) -> Array:
    """Log densities (distribution, draw) of a specimen's draws under draws of a class."""
    arrays = vars(draws) | {"monomials": _monomials(draws.centre, draws.covariates[:, None])}
    count = len(distributions.location[0])
    blocks = np.split(np.arange(count), range(_BLOCK, count, _BLOCK))
    return np.concatenate([log_density(np, arrays, distributions.at(block)) for block in blocks])


def mean_density(draws: SpecimenDraws, distributions: ClassDistribution) -> Array:
    """Logarithm of the density of each draw, averaged over draws of a class distribution."""
    densities = log_densities(draws, distributions)
    if len(densities) == 1:  # the reference, which is evaluated at each step of an optimisation
        return densities[0]
    return logsumexp(densities, axis=0) - np.log(len(densities))


def density_of_each(x: Array, distributions: ClassDistribution) -> Array:
    """Log density of coordinates (coordinate, draw, specimen), each draw under its distribution."""
    return np.einsum("df,fds->ds", _coefficients(np, distributions), _monomials(x))


def _monomials(x: Array, covariates: Array | None = None) -> Array:
    """Monomials of degree 2, 1 and 0 of coordinates ``x`` and covariates ``z``.

    A normal log density is a linear combination of them.
    """
    if covariates is not None:
        covariates = np.broadcast_to(covariates, (len(covariates), *x.shape[1:]))
        x = np.concatenate([x, covariates])
    products = (x[:, None] * x).reshape(-1, *x.shape[1:])
    return np.concatenate([products, x, np.ones_like(x[:1])])


def _coefficients(xp: ModuleType, distribution: ClassDistribution) -> Any:
    r"""Coefficients of the monomials in a normal log density, along the last axis.

    With the lower triangular ``A`` for which :math:`A Σ A^T = 1`, and the effects ``B`` of
    covariates, the log density is

    .. math:: \ln \det A - \tfrac{d}{2} \ln 2π - \tfrac12 |A (x - B z - m)|^2.

    One matrix product then gives the densities of many draws under many distributions.
    """
    size, factor = distribution.size, distribution.factor
    location, spread = (
        _coordinates_last(xp, values, size)
        for values in (distribution.location, distribution.spread)
    )
    whitening = _inverse(xp, factor) / spread[..., None, :]
    middle = (whitening * location[..., None, :]).sum(axis=-1)
    whitening = _with_effects(xp, whitening, distribution)
    slope = (whitening * middle[..., None]).sum(axis=-2)
    log_volume = -xp.log((factor * np.eye(size)).sum(axis=-1) * spread).sum(axis=-1)
    constant = log_volume - xp.square(middle).sum(axis=-1) / 2 - size / 2 * np.log(2 * np.pi)
    squares = -(whitening.mT @ whitening) / 2
    squares = squares.reshape((*location.shape[:-1], -1))
    return xp.concatenate([squares, slope, constant[..., None]], axis=-1)


def _inverse(xp: ModuleType, factor: Any) -> Any:
    """Inverse of a lower triangular matrix."""
    if isinstance(factor, np.ndarray):
        return np.linalg.inv(factor)
    return xp.linalg.solve_triangular(factor, np.eye(factor.type.shape[-1]), lower=True)


def _with_effects(xp: ModuleType, matrix: Any, distribution: ClassDistribution) -> Any:
    """Matrix for ``x - m``, with further columns for the covariates: ``-matrix @ B``."""
    size = distribution.size
    columns = [
        -(matrix * _coordinates_last(xp, effect, size)[..., None, :]).sum(axis=-1)[..., None]
        for effect in distribution.effects
    ]
    return xp.concatenate([matrix, *columns], axis=-1) if columns else matrix


def _log_density_of_tests(
    xp: ModuleType, draws: Mapping[str, Any], distribution: ClassDistribution
) -> Any:
    r"""Log density with an experiment effect, integrated over its log scale ``u = ln κ_s``.

    The standard deviations of a specimen's tests are ``κ_s`` times those of a typical specimen. The
    scatter of the tests determines ``u`` far better than its prior, the normal distribution with
    standard deviation ``η``, does. The quadrature nodes are therefore placed about the maximum of

    .. math:: -\tfrac12 Q e^{-2u} - a u - u^2/(2η^2), \qquad
        Q = \sum_t |\mathrm{diag}(ω)^{-1} (x_t - \bar x)|^2, \quad a = (T - 1) d

    It is at :math:`u = w/2 - aη^2` with the Wright omega function ``w``,
    :math:`w + \ln w = \ln(2 η^2 Q) + 2 a η^2`, and its width is :math:`η/\sqrt{1 + w}`.
    """
    size, tests, effect = distribution.size, draws["tests"], distribution.effect_spread
    axes = draws["centre"].ndim - 1
    # The last monomials have degree 1 and 0.
    linear = draws["monomials"][-(size + len(distribution.effects) + 1) :]
    spread, variances, of_centre = _independent_directions(xp, linear, distribution)
    scatter = _combined(1 / xp.square(spread), draws["scatter"])
    power, squared_effect = (tests - 1) * size, effect**2
    # A single test has no scatter: rounding keeps the logarithm finite.
    scaled = 2 * squared_effect * (scatter + np.finfo(float).eps)
    shift = 2 * power * squared_effect
    level = xp.log(scaled) + shift
    omega = xp.logaddexp(0.0, level)
    for _ in range(2):  # Newton steps for the Wright omega function
        omega = omega * (1 + level - xp.log(omega)) / (1 + omega)
    width = effect / xp.sqrt(1 + omega)
    middle, middle_square = (level - shift - xp.log(omega)) / 2, scaled / omega  # u and exp(2u)

    # A loop over nodes is faster than sums and maxima over an axis of nodes.
    steps = width * np.sqrt(8)  # twice the Gauss-Hermite step √2 width, for exp(2u)
    nodes, weights = hermgauss(_QUADRATURE_ORDER)
    exponents, volumes = [], []
    for node in nodes:
        square = middle_square * xp.exp(node * steps)  # κ² at the node
        misfit, volume = scatter / square, 1.0
        for i, deviation in enumerate(of_centre):
            variance = variances[(..., i, *(None,) * axes)] + square / tests
            misfit, volume = misfit + deviation / variance, volume * variance
        # Exponent of the prior of u, shifted by the power of κ from the volume of the tests.
        of_prior = xp.square((middle + node * steps / 2) / effect + power * effect)
        exponents.append(-(misfit + of_prior) / 2)
        volumes.append(volume)
    largest = reduce(xp.maximum, exponents)
    mean = sum(
        weight * np.exp(node**2) * xp.exp(exponent - largest) / xp.sqrt(volume)
        for node, weight, exponent, volume in zip(nodes, weights, exponents, volumes, strict=True)
    )
    total = largest + xp.log(mean * width)
    total = total + xp.square(power * effect) / 2 - xp.log(effect) - np.log(np.pi) / 2
    normaliser = xp.log(spread).sum(axis=-1)[(..., *(None,) * axes)] + size / 2 * np.log(2 * np.pi)
    return total - tests * normaliser - size / 2 * xp.log(tests)


def _independent_directions(
    xp: ModuleType, centre: Any, distribution: ClassDistribution
) -> tuple[Any, Any, list[Any]]:
    r"""Directions in which specimens, and the tests of one specimen, vary independently.

    With :math:`Σ = ω V λ V^T ω` and the standard deviations ``ω`` of tests, return ``ω``, ``λ``,
    and the square of each entry of :math:`V^T ω^{-1} (\bar x - m)`, for each draw.
    """
    size = distribution.size
    location, spread, within = (
        _coordinates_last(xp, values, size)
        for values in (distribution.location, distribution.spread, distribution.experiment_spread)
    )
    ratio = spread / within
    factor = ratio[..., None] * distribution.factor
    variances, vectors = xp.linalg.eigh(factor @ factor.mT)
    whitening = vectors.mT / within[..., None, :]
    moved = (whitening * location[..., None, :]).sum(axis=-1)
    whitening = _with_effects(xp, whitening, distribution)
    coefficients = xp.concatenate([whitening, -moved[..., None]], axis=-1)
    squares = [xp.square(_combined(coefficients[..., i, :], centre)) for i in range(size)]
    return within, variances, squares


def _coordinates_last(xp: ModuleType, values: Any, size: int) -> Any:
    """Move the axis of coordinates from the first place to the last."""
    return xp.concatenate([xp.atleast_1d(values[i]) for i in range(size)], axis=-1)


def _combined(coefficients: Any, draws: Any) -> Any:
    """Linear combinations of the arrays along the first axis of `draws`."""
    total = coefficients @ draws.reshape((draws.shape[0], -1))
    return total.reshape((*total.shape[:-1], *draws.shape[1:]))


def _log_normal(xp: ModuleType, x: Any, mean: Any, sd: Any) -> Any:
    return -xp.square((x - mean) / sd) / 2 - xp.log(sd) - np.log(2 * np.pi) / 2
