"""Normal distribution of the specimens of a class: variables and priors in a model, and draws.

Population models and classes with variability register it in the coordinates of
:class:`~pymc_hyperelastic.models.natural_scale.NaturalScale`; what uses classes reads its draws.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.evidence.stored import damaged, read_draws, read_numbers
from pymc_hyperelastic.models.likelihoods import Likelihood
from pymc_hyperelastic.models.likelihoods.errors import SIZES
from pymc_hyperelastic.models.natural_scale import NaturalScale
from pymc_hyperelastic.models.priors import register_prior

Array = NDArray[np.float64]

# Default number of posterior draws of a class's distribution, over which densities are averaged.
_DISTRIBUTIONS = 1000
# Measurement errors that may differ between specimens, and the names of the standard deviations of
# their logarithms.
SPREAD_OF_NOISE = {
    "pressure_sd": "noise_spread",
    "sigma": "noise_spread",
    "force_sd": "force_noise_spread",
    "force_sigma": "force_noise_spread",
    "diameter_sd": "diameter_noise_spread",
    "stress_sd": "stress_noise_spread",
    "stretch_sd": "stretch_noise_spread",
}
# Log-normal priors, dimensionless: median, and standard deviation of the logarithm.
SPREADS = {
    # Spread of the tests of one specimen, in spreads of the specimens: tests differ less.
    "experiment_spread": (0.375, 0.8),
    # Standard deviation, between specimens, of the logarithm of the spread of their tests.
    "effect_spread": (0.5, 0.5),
    # Standard deviation, between specimens, of the logarithm of the measurement error.
    "noise_spread": (0.3, 0.5),
}
# Concentration η of the LKJ prior of correlations, ∝ det(R)^(η − 1): correlations near ±1, and thus
# nearly singular covariance matrices, are improbable.
_CONCENTRATION = 2.0
# Scalar and vector variables of a class's posterior; vectors have one entry per coordinate.
_SCALARS = ("effect_spread", *SPREAD_OF_NOISE.values(), *SIZES)
_VECTORS = ("location", "spread", "experiment_spread")


@dataclass(frozen=True)
class ClassDistribution:
    """Distribution of the specimens of a class, as variables of a model or as draws.

    Vectors have one entry for each coordinate, or each size of an error. Draws have two further
    axes after that one, (draw, 1); the factor has one before, (draw).
    """

    location: Any
    """Mean of the coordinates of specimens."""
    spread: Any
    """Standard deviation of the coordinates of specimens."""
    factor: Any
    """Lower Cholesky factor of the correlation matrix of specimens."""
    experiment_spread: Any = None
    """Standard deviation of the tests of a typical specimen about its coordinates."""
    effect_spread: Any = None
    """Standard deviation, between specimens, of the logarithm of `experiment_spread`."""
    log_size: Any = None
    """Mean, between specimens, of the logarithm of each inferred size of an error."""
    noise_spread: Any = None
    """Standard deviation, between specimens, of the same logarithm."""
    effects: Sequence[Any] = ()
    """Change of the location per unit of each covariate."""

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return getattr(self.factor, "type", self.factor).shape[-1]

    def at(self, draws: NDArray[np.intp]) -> "ClassDistribution":
        """Return the draws with these indices; values without a draw axis are kept."""

        def some(values: Any) -> Any:
            return values if np.ndim(values) < 2 else np.asarray(values)[..., draws, :]

        factor = self.factor if np.ndim(self.factor) < 3 else self.factor[draws]
        effects = [some(effect) for effect in self.effects]
        rest = {n: some(v) for n, v in vars(self).items() if n not in ("factor", "effects")}
        return ClassDistribution(factor=factor, effects=effects, **rest)

    def without_effects(self) -> "ClassDistribution":
        """Return the distribution of specimens whose covariates are all 0."""
        return replace(self, effects=())

    def coordinates(self, standard: Array) -> Array:
        """Transform standard normal numbers to coordinates (coordinate, draw, specimen).

        `standard` has the shape (coordinate, specimen), or (draw, coordinate, specimen).
        """
        mixed = self.factor @ standard
        of_draws = np.moveaxis(mixed.reshape(-1, *mixed.shape[-2:]), 0, 1)
        return np.asarray(self.location) + np.asarray(self.spread) * of_draws

    def covariance(self) -> Array:
        """Covariance matrices of the draws, (draw, coordinate, coordinate)."""
        root = np.asarray(self.spread)[..., 0].T[..., None] * self.factor
        return root @ root.transpose(0, 2, 1)

    def variance_of_tests(self) -> Array:
        """Variance of the tests of one specimen, averaged over specimens: (draw, coordinate)."""
        spread, effect = np.asarray(self.experiment_spread), np.ravel(self.effect_spread)
        return (spread[..., 0] ** 2 * np.exp(2 * effect**2)).T

    def with_covariance(self, covariance: Array, location: Array) -> "ClassDistribution":
        """Return the draws with these covariance matrices and locations."""
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
    """Register the variables of a class's distribution in the model in context.

    With `experiment_effect` the tests of one specimen differ. An inferred size of an error in
    `likelihood` differs between specimens. `priors` replace default priors by name.
    """
    given = dict(priors or {})
    size = len(scale.names)

    def variable(name: str, default: TensorVariable) -> Any:
        prior = register_prior(name, given.get(name, default))
        if prior.type.ndim:
            pm.modelcontext(None).named_vars_to_dims[name] = ("coordinate",)
        return prior

    mean, sd = scale.location_prior
    location = variable("location", pm.Normal.dist(mean, sd, shape=size))
    logs, sd_of_logs = scale.spread_prior
    spread = variable("spread", pm.LogNormal.dist(logs, sd_of_logs, shape=size))
    factor = correlation_factor(size)
    optional: dict[str, Any] = {}
    if experiment_effect:
        median, sd_of_log = SPREADS["experiment_spread"]
        prior = pm.LogNormal.dist(logs + np.log(median), sd_of_log, shape=size)
        optional["experiment_spread"] = variable("experiment_spread", prior)
        median, sd_of_log = SPREADS["effect_spread"]
        prior = pm.LogNormal.dist(np.log(median), sd_of_log)
        optional["effect_spread"] = variable("effect_spread", prior)
    inferred = noises_of(likelihood)
    if inferred:
        sizes = likelihood.register_unknowns()
        median, sd_of_log = SPREADS["noise_spread"]
        prior = pm.LogNormal.dist(np.log(median), sd_of_log)
        optional["log_size"] = [pt.log(sizes[name]) for name in inferred]
        optional["noise_spread"] = [variable(SPREAD_OF_NOISE[name], prior) for name in inferred]
    return ClassDistribution(location, spread, factor, **optional)


def noises_of(likelihood: Likelihood) -> list[str]:
    """Return the inferred sizes of measurement errors, which differ between specimens."""
    return [name for name in SPREAD_OF_NOISE if name in likelihood.unknowns]


def correlation_factor(size: int, prefix: str = "") -> Any:
    r"""Cholesky factor of a correlation matrix with an LKJ prior.

    The entries are :math:`r_{ij} \prod_{k<j} \sqrt{1 - r_{ik}^2}`, with :math:`r_{ii} = 1` and
    the partial correlations :math:`r_{ij}` of coordinates i > j given the coordinates before j.
    Their independent beta priors imply the LKJ prior of the matrix: D. Lewandowski, D. Kurowicka
    and H. Joe, Generating random correlation matrices based on vines and extended onion method,
    Journal of Multivariate Analysis 100 (2009) 1989-2001.
    """
    if size == 1:
        return np.ones((1, 1))
    shape = shape_of_partial_correlations(size)
    partial = 2 * pm.Beta(f"{prefix}correlation_unit", shape, shape, shape=len(shape)) - 1
    # Few operations on matrices are faster than many on scalars.
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
    """Both parameters of the beta prior of (1 + r)/2, for the partial correlations row by row."""
    _, column = np.tril_indices(size, -1)
    return _CONCENTRATION + (size - 2 - column) / 2


def distributions_of(tree: xr.DataTree, count: int = _DISTRIBUTIONS) -> ClassDistribution:
    """Read at most `count` posterior draws of a class's distribution from a fitted class."""
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
    """Return at most `count` draws, evenly spaced in the chains, along one dimension sample."""
    posterior = class_posterior(tree).stack(sample=("chain", "draw"))
    chosen = np.linspace(0, posterior.sizes["sample"] - 1, count).round().astype(int)
    return posterior.isel(sample=np.unique(chosen))


def class_posterior(tree: xr.DataTree) -> xr.Dataset:
    """Return the posterior of a fitted class; ValueError for impossible spreads or correlations."""
    posterior, sample = read_draws(tree, "posterior"), ("chain", "draw")
    by_coordinate = (*sample, "coordinate")
    for name in map(str, posterior.data_vars):
        if name in _SCALARS:
            read_numbers(tree, "posterior", name, sample)
        elif name in _VECTORS:
            read_numbers(tree, "posterior", name, by_coordinate)
            if name != "location" and not np.all(posterior[name] > 0):
                raise damaged(tree, f"{name!r} of 'posterior' has values that are not positive")
        elif name == "correlation":
            dims = (*by_coordinate, "coordinate_2")
            matrices = read_numbers(tree, "posterior", name, dims).transpose(*dims).values
            try:
                np.linalg.cholesky(matrices)
            except np.linalg.LinAlgError:
                what = "'correlation' of 'posterior' is no correlation matrix"
                raise damaged(tree, what) from None
    return posterior


def check_class(tree: xr.DataTree, names: Sequence[str], needed: Sequence[str]) -> None:
    """Raise ValueError unless a fitted class has these coordinates and all needed variables."""
    posterior = class_posterior(tree)
    lacking = [name for name in needed if name not in posterior]
    lacking += ["correlation"] * (len(names) > 1 and "correlation" not in posterior)
    if lacking:
        raise damaged(tree, f"the variable {lacking[0]!r} of 'posterior' is missing")
    stored = posterior["coordinate"].values.tolist() if "coordinate" in posterior.coords else names
    if stored != list(names) or posterior.sizes["coordinate"] != len(names):
        raise ValueError(
            f"class {tree.name!r} was fitted with the coordinates {stored}, but its material now "
            f"has the coordinates {list(names)}. Fit the class again"
        )


def factor_of(posterior: xr.Dataset, name: str) -> Array:
    """Cholesky factors (sample, coordinate, coordinate) of the correlation matrices `name`."""
    if posterior.sizes["coordinate"] == 1:
        return np.ones((posterior.sizes["sample"], 1, 1))
    if name not in posterior:
        raise damaged(posterior, f"the variable {name!r} of 'posterior' is missing")
    return np.linalg.cholesky(posterior[name].transpose("sample", ...).values)
