"""The distribution of a class's specimens, its priors and its draws."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.files.stored import damaged, read_draws, read_numbers
from pymc_hyperelastic.models.likelihoods import Likelihood
from pymc_hyperelastic.models.likelihoods.errors import SIZES
from pymc_hyperelastic.models.natural_scale import SPREAD, NaturalScale
from pymc_hyperelastic.models.priors import register_prior

Array = NDArray[np.float64]

# Draws of a class's distribution against which a specimen is held.
_DISTRIBUTIONS = 1000
# Sizes of errors that may differ from specimen to specimen, and the name of the standard deviation
# of their logarithms.
SPREAD_OF_NOISE = {
    "pressure_sd": "noise_spread",
    "sigma": "noise_spread",
    "force_sd": "force_noise_spread",
    "force_sigma": "force_noise_spread",
    "diameter_sd": "diameter_noise_spread",
}
# Priors of a class, each as the median and the standard deviation of a logarithm.
_EXPERIMENT_SPREAD, _EFFECT_SPREAD, _NOISE_SPREAD = (0.15, 0.8), (0.5, 0.5), (0.3, 0.5)
# Variables of a stored class by draw, and by draw and coordinate.
_NUMBERS_OF_CLASS = ("effect_spread", *SPREAD_OF_NOISE.values(), *SIZES)
_VECTORS_OF_CLASS = ("location", "spread", "experiment_spread")
# Exponent of the prior of a correlation matrix, its determinant to the power of η − 1.
_CONCENTRATION = 2.0


@dataclass(frozen=True)
class ClassDistribution:
    """The distribution of a class's specimens: variables of a model, or numbers.

    Attributes
    ----------
    location, spread : tensor_like, shape (coordinate)
        Mean and standard deviation of the specimens' coordinates.
    factor : tensor_like, shape (coordinate, coordinate)
        Lower Cholesky factor of their correlation matrix; of several, one after the other.
    experiment_spread : tensor_like, shape (coordinate), optional
        Standard deviation by which experiments on a typical specimen differ from it.
    effect_spread : tensor_like, optional
        Standard deviation of the logarithm of that, between specimens.
    log_size, noise_spread : tensor_like, shape (noise), optional
        Mean and standard deviation of the logarithm of each inferred size of an error.
    effects : sequence of tensor_like, shape (coordinate)
        By how much one of each covariate moves the location.
    """

    location: Any
    spread: Any
    factor: Any
    experiment_spread: Any = None
    effect_spread: Any = None
    log_size: Any = None
    noise_spread: Any = None
    effects: Sequence[Any] = ()

    @property
    def size(self) -> int:
        """Number of the coordinates."""
        return getattr(self.factor, "type", self.factor).shape[-1]

    def at(self, draws: NDArray[np.intp]) -> "ClassDistribution":
        """Some of the draws, in the order in which they are named; a number is that of all."""

        def some(values: Any) -> Any:
            return values if np.ndim(values) < 2 else np.asarray(values)[..., draws, :]

        factor = self.factor if np.ndim(self.factor) < 3 else self.factor[draws]
        effects = [some(effect) for effect in self.effects]
        rest = {n: some(v) for n, v in vars(self).items() if n not in ("factor", "effects")}
        return ClassDistribution(factor=factor, effects=effects, **rest)

    def without_effects(self) -> "ClassDistribution":
        """That of specimens whose covariates are all 0."""
        return replace(self, effects=())

    def coordinates(self, standard: Array) -> Array:
        """Coordinates (coordinate, draw, specimen) of specimens, from standard normal numbers.

        These are (coordinate, specimen) for all draws, or for each (draw, coordinate, specimen).
        """
        mixed = self.factor @ standard
        of_draws = np.moveaxis(mixed.reshape(-1, *mixed.shape[-2:]), 0, 1)
        return np.asarray(self.location) + np.asarray(self.spread) * of_draws

    def covariance(self) -> Array:
        """Covariance matrices (draw, coordinate, coordinate), of numbers."""
        root = self._root()
        return root @ root.transpose(0, 2, 1)

    def variance_of_tests(self) -> Array:
        """Variance (draw, coordinate) of experiments around their specimen, over all specimens."""
        spread, effect = np.asarray(self.experiment_spread), np.ravel(self.effect_spread)
        return (spread[..., 0] ** 2 * np.exp(2 * effect**2)).T

    def _root(self) -> Array:
        """Lower Cholesky factors of them."""
        return np.asarray(self.spread)[..., 0].T[..., None] * self.factor

    def with_covariance(self, covariance: Array, location: Array) -> "ClassDistribution":
        """The same with other covariance matrices, and other locations."""
        root = np.linalg.cholesky(covariance)
        spread = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        factor = root / spread[:, :, None]
        return replace(self, location=location, spread=spread.T[..., None], factor=factor)


def register_class(
    scale: NaturalScale,
    likelihood: Likelihood,
    experiment_effect: bool,
    priors: Mapping[str, Any] | None = None,
) -> ClassDistribution:
    """Variables of a class's distribution, in the model of the context."""
    given = dict(priors or {})
    size = len(scale.names)

    def variable(name: str, default: TensorVariable, dims: str | None = "coordinate") -> Any:
        prior = register_prior(name, given.get(name, default))
        if dims:
            pm.modelcontext(None).named_vars_to_dims[name] = (dims,)
        return prior

    mean, sd = scale.location_prior
    location = variable("location", pm.Normal.dist(mean, sd, shape=size))
    logs, sd_of_logs = scale.spread_prior
    spread = variable("spread", pm.LogNormal.dist(logs, sd_of_logs, shape=size))
    factor = correlation_factor(size)
    optional: dict[str, Any] = {}
    if experiment_effect:
        # Experiments differ less than specimens, on any scale in the same proportion.
        medians = logs + np.log(_EXPERIMENT_SPREAD[0] / SPREAD[0])
        prior = pm.LogNormal.dist(medians, _EXPERIMENT_SPREAD[1], shape=size)
        optional["experiment_spread"] = variable("experiment_spread", prior)
        prior = pm.LogNormal.dist(np.log(_EFFECT_SPREAD[0]), _EFFECT_SPREAD[1])
        optional["effect_spread"] = variable("effect_spread", prior, dims=None)
    inferred = noises_of(likelihood)
    if inferred:
        sizes = likelihood.register_unknowns()
        prior = pm.LogNormal.dist(np.log(_NOISE_SPREAD[0]), _NOISE_SPREAD[1])
        optional["log_size"] = [pt.log(sizes[name]) for name in inferred]
        optional["noise_spread"] = [
            variable(SPREAD_OF_NOISE[name], prior, dims=None) for name in inferred
        ]
    return ClassDistribution(location, spread, factor, **optional)


def noises_of(likelihood: Likelihood) -> list[str]:
    """Return the inferred sizes of errors, which differ from specimen to specimen."""
    return [name for name in SPREAD_OF_NOISE if name in likelihood.unknowns]


def correlation_factor(size: int, prefix: str = "") -> Any:
    r"""Cholesky factor of a random correlation matrix.

    With the partial correlations :math:`r_{ij}` of one coordinate and another, given those before
    both, its entries are :math:`r_{ij} \prod_{k<j} \sqrt{1 - r_{ik}^2}`, and those of its diagonal
    this without the first factor.
    """
    if size == 1:
        return np.ones((1, 1))
    shape = shape_of_partial_correlations(size)
    partial = 2 * pm.Beta(f"{prefix}correlation_unit", shape, shape, shape=len(shape)) - 1
    # Few operations on whole matrices, not many on numbers, since each takes time by itself.
    below, place = np.tril_indices(size, -1), np.zeros((size, size), int)
    place[below] = np.arange(len(shape))
    entries = partial[place] * np.tri(size, k=-1)
    left = pt.exp(pt.log1p(-pt.square(entries)) @ np.triu(np.ones((size, size)), 1) / 2)
    factor = pt.specify_shape((entries + np.eye(size)) * left, (size, size))
    off = 1 - np.eye(size)
    matrix = off * (factor @ factor.T) + np.eye(size)
    pm.Deterministic(f"{prefix}correlation", matrix, dims=("coordinate", "coordinate_2"))
    return factor


def shape_of_partial_correlations(size: int) -> Array:
    """Both parameters of the beta prior of (1 + r)/2, for partial correlations r row by row."""
    _, column = np.tril_indices(size, -1)
    return _CONCENTRATION + (size - 2 - column) / 2


def distributions_of(tree: xr.DataTree, count: int = _DISTRIBUTIONS) -> ClassDistribution:
    """Return at most `count` draws of a class's distribution, along the first of two axes."""
    posterior = some_of_posterior(tree, count)

    def vector(name: str) -> Array | None:
        if name not in posterior:
            return None
        return posterior[name].transpose("coordinate", "sample").values[..., None]

    optional = {}
    if "effect_spread" in posterior:
        optional["effect_spread"] = posterior["effect_spread"].values[:, None]
    inferred = [name for name in SPREAD_OF_NOISE if name in posterior]
    spreads = [SPREAD_OF_NOISE[name] for name in inferred]
    for name in dict.fromkeys(SPREAD_OF_NOISE.values()):
        if (name in posterior) != (name in spreads):
            raise damaged(
                tree, f"its posterior has only one of {name!r} and the size of that error"
            )
    if inferred:
        optional["log_size"] = np.log([posterior[name].values for name in inferred])[..., None]
        optional["noise_spread"] = np.array([posterior[name].values for name in spreads])[..., None]
    return ClassDistribution(
        vector("location"),
        vector("spread"),
        factor_of(posterior, "correlation"),
        vector("experiment_spread"),
        **optional,
    )


def some_of_posterior(tree: xr.DataTree, count: int) -> xr.Dataset:
    """Return at most `count` draws, evenly spread over the chains, by sample."""
    posterior = class_posterior(tree).stack(sample=("chain", "draw"))
    chosen = np.linspace(0, posterior.sizes["sample"] - 1, count).round().astype(int)
    return posterior.isel(sample=np.unique(chosen))


def class_posterior(tree: xr.DataTree) -> xr.Dataset:
    """Draws of a class's distribution, or of several; ValueError unless they are sound."""
    posterior, sample = read_draws(tree, "posterior"), ("chain", "draw")
    by_coordinate = (*sample, "coordinate")
    for name in map(str, posterior.data_vars):
        if name in _NUMBERS_OF_CLASS:
            read_numbers(tree, "posterior", name, sample)
        elif name in _VECTORS_OF_CLASS:
            read_numbers(tree, "posterior", name, by_coordinate)
            if name != "location" and not np.all(posterior[name] > 0):
                raise damaged(tree, f"{name!r} of 'posterior' holds numbers that are not positive")
        elif name == "correlation":
            matrices = read_numbers(tree, "posterior", name, (*by_coordinate, "coordinate_2"))
            try:
                np.linalg.cholesky(matrices.transpose(*by_coordinate, "coordinate_2").values)
            except np.linalg.LinAlgError:
                raise damaged(tree, "'correlation' of 'posterior' holds no correlations") from None
    return posterior


def check_class(tree: xr.DataTree, names: Sequence[str], needed: Sequence[str]) -> None:
    """Raise unless a fitted class has these coordinates, and draws of all that is needed."""
    posterior = class_posterior(tree)
    lacking = [name for name in needed if name not in posterior]
    lacking += ["correlation"] * (len(names) > 1 and "correlation" not in posterior)
    if lacking:
        raise damaged(tree, f"the variable {lacking[0]!r} of 'posterior' is missing")
    stored = posterior["coordinate"].values.tolist() if "coordinate" in posterior.coords else names
    if stored != list(names) or posterior.sizes["coordinate"] != len(names):
        raise ValueError(
            f"the specimens of class {tree.name!r} have the coordinates {stored}, and those of its "
            f"material are now {list(names)}: fit the class again"
        )


def factor_of(posterior: xr.Dataset, name: str) -> Array:
    """Cholesky factors (sample, coordinate, coordinate) of a correlation matrix by sample."""
    if posterior.sizes["coordinate"] == 1:
        return np.ones((posterior.sizes["sample"], 1, 1))
    if name not in posterior:
        raise damaged(posterior, f"the variable {name!r} of 'posterior' is missing")
    return np.linalg.cholesky(posterior[name].transpose("sample", ...).values)
