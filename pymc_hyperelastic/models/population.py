"""Specimens of a class differ: each has its own parameters, drawn from the class's distribution."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, NamedTuple, Self

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.data.select import specimens_of
from pymc_hyperelastic.data.sheets import sheet_tests, tubes_of
from pymc_hyperelastic.evidence.results import attach_study
from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.messages import PACKAGE
from pymc_hyperelastic.models.class_distribution import (
    SPREAD_OF_NOISE,
    ClassDistribution,
    noises_of,
    register_class,
)
from pymc_hyperelastic.models.forward import ForwardModel, SymbolicTests, register_curves
from pymc_hyperelastic.models.geometry import (
    MeasuredValue,
    check_geometry,
    check_measured_only,
    register_deviations,
    register_measures,
    split_by_owner,
)
from pymc_hyperelastic.models.likelihoods import Likelihood, as_likelihood
from pymc_hyperelastic.models.likelihoods.errors import OF_SHEETS
from pymc_hyperelastic.models.natural_scale import NaturalScale, check_moduli
from pymc_hyperelastic.models.priors import (
    check_prior,
    check_priors,
    complete_wall,
    is_inferred,
    positive_draws,
)
from pymc_hyperelastic.models.study import Study, coords_of
from pymc_hyperelastic.models.variability import Variability, as_variability
from pymc_hyperelastic.parallel import one_thread

# Range of each coordinate over which curves must be accurate, in prior standard deviations.
_REACH = 3.0
# Default of `variability`.
_SPECIMEN = Variability()


@dataclass(frozen=True)
class Population:
    """Settings of specimens that differ, see :func:`population_model`."""

    energy: Any
    """A strain energy, or layers."""
    likelihood: Likelihood
    """With observed variables."""
    variability: Variability = _SPECIMEN
    priors: Mapping[str, Any] | None = None
    """Of the class's distribution."""
    geometry: Mapping[str, MeasuredValue] = field(default_factory=dict)
    """Measures of the tube that have an error."""

    @classmethod
    def of_settings(
        cls, energy: Any, likelihood: Any, priors: Any = None, variability: Any = _SPECIMEN
    ) -> Self:
        """Return the settings from arguments of :func:`population_model`."""
        of_class, tube = split_by_owner(energy, "priors", priors)
        observed, geometry = as_likelihood(likelihood).as_observed(), check_geometry(tube)
        return cls(energy, observed, as_variability(variability), of_class, geometry)

    @cached_property
    def scale(self) -> NaturalScale:
        """Coordinates of the specimens."""
        return NaturalScale(self.energy, self.variability.reference_stress)

    @property
    def noises(self) -> list[str]:
        """Names of the inferred standard deviations of errors, one for each specimen."""
        return noises_of(self.likelihood)

    @property
    def known_noise(self) -> bool:
        """True if the standard deviation of pressures, forces or stresses is a number."""
        errors = self.likelihood.errors()
        sizes = errors.pressure_sd, errors.force_sd, errors.stress_sd
        return not all(v is None or is_inferred(v) for v in sizes)

    def check(self, data: xr.Dataset, *, partial: bool = False) -> None:
        """Raise unless the specimens of these data can be modelled, see :class:`Likelihood`."""
        wall, parameters = complete_wall(self.energy)
        check_moduli(self.energy)
        for name, prior in self.likelihood.unknowns.items():
            check_prior(name, prior)
            positive_draws(name, prior)
        if "force_offset_sd" in self.likelihood.unknowns:
            raise ValueError(
                "force_offset_sd is a distribution; where specimens differ, expected a number of "
                "mN: each test has an offset of its own, and the number is their prior"
            )
        check_measured_only(self.geometry)
        self.likelihood.check(wall, data, parameters, self.geometry, partial=partial)
        count = len(self.scale.names)
        sizes: dict[str, int | None] = {"location": count, "spread": count}
        if self.variability.experiment_effect:
            sizes |= {"experiment_spread": count, "effect_spread": None}
        sizes |= {SPREAD_OF_NOISE[name]: None for name in self.noises}
        check_priors(self.priors, sizes, "this class")

    def register_class(self) -> ClassDistribution:
        """Register the class's distribution in the model in context."""
        effect = self.variability.experiment_effect
        return register_class(self.scale, self.likelihood, effect, self.priors)

    def forward_model(
        self, data: xr.Dataset, *, by_test: bool = True, **settings: Any
    ) -> ForwardModel:
        """Return a forward model that is accurate over the range of the coordinates.

        With `by_test` each test has parameters of its own, otherwise all are of one specimen. Other
        settings are those of :class:`ForwardModel`.
        """
        mean, sd = self.scale.location_prior
        low, high = mean - _REACH * sd, mean + _REACH * sd
        parameters = self.scale.parameters([*map(pm.Uniform.dist, low, high)])
        wall = self.scale.wall_of(parameters)
        settings |= {"geometry": self.geometry, "by_test": by_test}
        return self.likelihood.forward_model(wall, data, parameters, **settings)


@one_thread
def population_model(
    energy: StrainEnergy | Sequence[Layer],
    data: xr.Dataset,
    likelihood: Likelihood | Any,
    *,
    priors: Mapping[str, Any] | None = None,
    variability: Variability | Literal["specimen"] = _SPECIMEN,
) -> pm.Model:
    r"""PyMC model of a class whose specimens differ: each has its own parameters.

    On the natural scale of the parameters (theory page on variability) the coordinates ``x`` of the
    specimens ``s`` are drawn from the class's distribution, and tests ``t`` share those of theirs:

    .. math:: x_s \sim N(m, \mathrm{diag}(τ) R \, \mathrm{diag}(τ)), \qquad
        x_t \sim N(x_{s(t)}, κ_s^2 \, \mathrm{diag}(ω)^2), \qquad
        p_i \sim N(p(a_i; θ(x_t)), ς_s^2)

    Specimens differ also in how much their tests differ, ``ln κ_s ~ N(0, η²)``. If the standard
    deviation ``ς`` of an error is a distribution, specimens differ in it too,
    ``ln ς_s ~ N(ln ς, ν²)``. Measurements are observed variables, as those of
    :func:`~pymc_hyperelastic.inflation_model` with ``observed=True``. The model stands by itself:
    it is no part of a model of the context.

    Parameters
    ----------
    energy : StrainEnergy or list of Layer
        The material, or the layers of the wall from the inside out. Specimens differ in the
        parameters that a layer does not state, and in a thickness that is a distribution.
    data : xarray.Dataset
        Inflation data, see :func:`pymc_hyperelastic.inflation_data`: the specimens of one class.
    likelihood : Gaussian, SlopeAugmented, float or distribution
        As in :func:`~pymc_hyperelastic.inflation_model`. A distribution is the prior of the class's
        median; each specimen has its own standard deviation, such as ``specimen_pressure_sd``.
        Pressures must have the error, and `slope_weight` and `force_offset_sd` must be numbers.
    priors : dict of str to distribution or MeasuredValue, optional
        Other priors of the class: of ``location``, ``spread`` and ``experiment_spread``, with one
        entry a coordinate, and of ``effect_spread``, ``noise_spread``, ``force_noise_spread``,
        ``diameter_noise_spread``, ``stress_noise_spread`` and ``stretch_noise_spread``. Measures
        of the tube that have an error stand beside them, such as ``{"thickness":
        ph.MeasuredValue(sd=0.01)}``: each specimen then has its own ``thickness_deviation`` and
        ``thickness``.
    variability : Variability or "specimen"
        How the specimens differ; ``"specimen"`` is short for ``ph.Variability()``. Without
        `experiment_effect`, ``ω = 0``. With the reference stress ``T₀`` the first modulus is
        replaced by the reference strain, see :class:`~pymc_hyperelastic.Variability`.

    Returns
    -------
    pymc.Model
        With the dimensions ``specimen``, ``coordinate``, ``test`` and ``obs``; deterministics of
        the specimens carry the names of the material parameters.

    Warns
    -----
    UserWarning
        If another model is in context.

    Raises
    ------
    TypeError, ValueError
        If an argument is not of its kind, the data are unsound, or a number is impossible.

    See Also
    --------
    Variability, inflation_model, fit_classes

    Notes
    -----
    Default priors of location and ``τ`` are on the theory page on variability. With ``LN(m, s)``
    for a normal logarithm of median ``m``, ``ω`` has 0.375 times the median of ``τ`` and ``s`` 0.8;
    ``η`` has LN(0.5, 0.5), every ``ν`` LN(0.3, 0.5), and the density of ``R`` is proportional to
    its determinant. No spread can vanish: with a handful of specimens a prior with mass at zero
    makes a funnel, in which samplers get stuck.

    Terms of a series such as :class:`~pymc_hyperelastic.OgdenSeries` may change places from one
    specimen to the next: their location and spread then mean little.

    References
    ----------
    D. Lewandowski, D. Kurowicka and H. Joe, Journal of Multivariate Analysis 100 (2009) 1989-2001
    (``R``). Y. Chung et al., Psychometrika 78 (2013) 685-709 (spreads that avoid zero).

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.select(ph.load_dataset("simulated_sheep_aorta"), group="C1")
    >>> model = ph.population_model(ph.Ogden(), data, ph.Gaussian(pressure_sd=4 * ph.mmHg))
    >>> [rv.name for rv in model.free_RVs]
    ['location', 'spread', 'correlation_unit', 'log_reference_strain', 'log_alpha']
    """
    population = Population.of_settings(energy, likelihood, priors, variability)
    population.check(data)
    if pm.Model.get_context(error_if_none=False) is not None:
        warnings.warn(
            "population_model makes a model that stands by itself: nothing of it is in the model "
            "of the context. Make it outside of `with`, or make tubes that are parts of the model "
            "of the context by ph.inflation_model(..., name=...)",
            skip_file_prefixes=(PACKAGE,),
        )
    names = population.scale.names
    coords = coords_of(data) | {"coordinate": names, "coordinate_2": names}
    with pm.Model(coords=coords, model=None) as model:
        distribution = population.register_class()
        of_specimens = register_specimens(population, distribution, specimens_of(data)[1])
        for name, value in of_specimens.noises.items():
            pm.Deterministic(f"specimen_{name}", value, dims="specimen")
        forward = population.forward_model(data)
        register_tests(population, forward, of_specimens, dims="obs")
        if (tubes := tubes_of(data)) is not None:
            register_measures(tubes, population.geometry, of_specimens.deviations)
    stress = population.variability.reference_stress
    study = Study(energy, data, {}, reference_stress=stress, forward=forward)
    attach_study(model, study)
    return model


class Specimens(NamedTuple):
    """Variables of the specimens."""

    of_test: NDArray[np.intp]
    """Index of each test's specimen."""
    coordinates: list[TensorVariable]
    """Coordinates of each test."""
    noises: dict[str, TensorVariable]
    """Inferred standard deviations of the errors of each specimen."""
    deviations: dict[str, TensorVariable]
    """Standardised deviation of each specimen's tube from its measured value."""


def register_specimens(
    population: Population, distribution: ClassDistribution, of_test: NDArray[np.intp]
) -> Specimens:
    """Register the variables of the specimens in the model in context."""
    scale = population.scale
    location, spread = distribution.location, distribution.spread
    standard: list[Any] = []
    coordinates = []
    # One coordinate after another, each given those before: no matrix is inverted.
    for j, name in enumerate(scale.names):
        given = sum(distribution.factor[j, k] * z for k, z in enumerate(standard))
        left = distribution.factor[j, j]
        x = pm.Normal(name, location[j] + spread[j] * given, spread[j] * left, dims="specimen")
        standard.append(((x - location[j]) / spread[j] - given) / left)
        coordinates.append(x)
    for name, value in scale.parameters(coordinates).items():
        value = pt.stack(value, axis=-1) if isinstance(value, tuple) else value
        pm.Deterministic(name, value, dims=("specimen",) + (None,) * (value.type.ndim - 1))
    of_tests = [x[of_test] for x in coordinates]
    if distribution.experiment_spread is not None:
        log_effect = pm.Normal("log_effect", 0.0, distribution.effect_spread, dims="specimen")
        within = pt.exp(log_effect)[of_test]
        for j, name in enumerate(scale.names):
            sd = distribution.experiment_spread[j] * within
            of_tests[j] = pm.Normal(f"{name}_of_test", of_tests[j], sd, dims="test")
    noises = {}
    for i, name in enumerate(population.noises):
        moments = distribution.log_size[i], distribution.noise_spread[i]
        noises[name] = pt.exp(pm.Normal(log_noise_name(name), *moments, dims="specimen"))
    return Specimens(of_test, of_tests, noises, register_deviations(population.geometry))


def log_noise_name(name: str) -> str:
    """Return the name of the logarithm of a specimen's standard deviation."""
    return f"log_specimen_{name}"


def tests_of(population: Population, forward: ForwardModel, specimens: Specimens) -> SymbolicTests:
    """Return the tests with the parameters of their specimens."""
    deviations = {name: z[specimens.of_test] for name, z in specimens.deviations.items()}
    coordinates = [x if forward.by_test else x[0] for x in specimens.coordinates]
    return forward.with_variables(population.scale.parameters(coordinates), deviations=deviations)


def register_tests(
    population: Population, forward: ForwardModel, specimens: Specimens, dims: str | None = None
) -> None:
    """Add the curves of the tests, and the measurements, to the model of the context."""
    tests = tests_of(population, forward, specimens)
    curves = register_curves(tests, dims)
    test = forward.share("test", _test_of_points)
    own = {
        name: size[specimens.of_test][test["sheets" if name in OF_SHEETS else "tubes"]]
        for name, size in specimens.noises.items()
    }
    population.likelihood.register(tests, curves, own, dims)


def _test_of_points(data: xr.Dataset) -> dict[str, NDArray]:
    """Return the test of each point of tubes, and of each point of sheets."""
    test = data["test"].values
    sheets = sheet_tests(data)[test]
    return {"tubes": test[~sheets], "sheets": test[sheets]}
