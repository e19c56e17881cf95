"""Specimens of a class differ: each has its own parameters, drawn from the class's distribution."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np
import pymc as pm
import pytensor.tensor as pt
import xarray as xr
from numpy.typing import NDArray
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.data.inflation import describe_test
from pymc_hyperelastic.mechanics.collocation import CollocatedPressureIntegral, curve_matrices
from pymc_hyperelastic.mechanics.layers import check_energy
from pymc_hyperelastic.mechanics.pressure import wall_pressure
from pymc_hyperelastic.mechanics.strain_energy.base import Parameter, StrainEnergy
from pymc_hyperelastic.models.likelihood import check_likelihood, shared_inputs
from pymc_hyperelastic.models.priors import check_prior, is_inferred, register_prior
from pymc_hyperelastic.models.results import Study
from pymc_hyperelastic.models.rules import Rule, current_tube, rule_for, tube_inputs

__all__ = [
    "ClassDistribution",
    "NaturalScale",
    "check_population",
    "curve_inputs",
    "population_model",
    "population_rule",
    "register_class",
    "register_curves",
    "register_specimens",
    "specimens_of",
]

Array = NDArray[np.float64]

# Priors of a class, each as the median and the standard deviation of a logarithm.
_REFERENCE_STRAIN = (0.2, 0.7)
_SPREAD, _EXPERIMENT_SPREAD = (0.4, 0.7), (0.15, 0.8)
_EFFECT_SPREAD, _NOISE_SPREAD = (0.5, 0.5), (0.3, 0.5)
# Of a shape parameter: its median as a fraction of the upper end of its range.
_SHAPE = (1 / 6, 1.2)
_RATIO_SD, _LOGIT_SD = 1.5, 1.5
# The range of a parameter on "real", in prior standard deviations and in spreads.
_REAL_SD, _REAL_SPREAD = 4.0, 20.0
# Exponent of the prior of a correlation matrix, its determinant to the power of η − 1.
_CONCENTRATION = 2.0
# Standard deviations over which it is asked whether curves can be collocated.
_REACH = 3.0
# Draws of a prior that tell whether it is one of positive numbers.
_SIGMA_DRAWS = 2000


@dataclass(frozen=True)
class NaturalScale:
    r"""Coordinates of a specimen, in which the specimens of a class are spread normally.

    One stands in place of each parameter: the logarithm of a positive one, the logit of one between
    two ends, see :class:`~pymc_hyperelastic.Parameter`. A modulus at rest is hardly known from a
    curve that stiffens, and lies with the stiffening on a thin ridge. In place of the first modulus
    stands therefore the hoop strain :math:`e = \ln λ_θ` at which the wall's stress has a
    physiological size,

    .. math:: T(e, \ln λ_z = 0) = T_0, \qquad x_1 = \ln e,

    and in place of any other modulus the logarithm of its ratio to the first. Stress is
    proportional to the moduli together, so that they follow in closed form.

    Attributes
    ----------
    energy : StrainEnergy
        The material.
    reference_stress : float
        ``T₀ = σθθ − σrr``, kPa.
    """

    energy: StrainEnergy
    reference_stress: float = 20.0

    @property
    def _entries(self) -> list[tuple[str, Parameter]]:
        sized = [p for p in self.energy.parameters for _ in range(p.size or 1)]
        return list(zip(self.energy.entry_names, sized, strict=True))

    @property
    def _moduli(self) -> list[int]:
        """Places of the moduli among the entries."""
        return [
            i
            for i, (_, p) in enumerate(self._entries)
            if p.unit == "kPa" and p.natural_scale == "log"
        ]

    @property
    def names(self) -> list[str]:
        """Names of the coordinates, such as ``log_alpha``."""
        names = [f"{p.natural_scale}_{name}" for name, p in self._entries]
        for place in self._moduli[1:]:
            names[place] += "_ratio"
        if self._moduli:
            names[self._moduli[0]] = "log_reference_strain"
        return names

    @property
    def location_prior(self) -> tuple[Array, Array]:
        """Mean and standard deviation of the normal prior of a class's location."""
        first = self._moduli[0] if self._moduli else None
        moments = []
        for i, (_, p) in enumerate(self._entries):
            low, high = p.prior_range
            if i == first:
                moments.append((np.log(_REFERENCE_STRAIN[0]), _REFERENCE_STRAIN[1]))
            elif i in self._moduli:
                largest = self._entries[self._moduli[0]][1].prior_range[1]
                moments.append((np.log(high / largest), _RATIO_SD))
            elif p.natural_scale == "log":
                moments.append((np.log(high * _SHAPE[0]), _SHAPE[1]))
            elif p.natural_scale == "logit":
                moments.append((0.0, _LOGIT_SD))
            else:
                moments.append(((low + high) / 2, (high - low) / _REAL_SD))
        mean, sd = np.array(moments).T
        return mean, sd

    @property
    def spread_prior(self) -> tuple[Array, float]:
        """Mean and standard deviation of the logarithm of a class's spread."""
        median = [
            (p.prior_range[1] - p.prior_range[0]) / _REAL_SPREAD
            if p.natural_scale == "real"
            else _SPREAD[0]
            for _, p in self._entries
        ]
        return np.log(median), _SPREAD[1]

    def parameters(self, coordinates: Sequence[TensorVariable]) -> dict[str, Any]:
        """Material parameters by name, as the strain energy takes them."""
        entries: list[Any] = []
        for x, (_, p) in zip(coordinates, self._entries, strict=True):
            low, high = p.prior_range
            if p.natural_scale == "log":
                entries.append(pt.exp(x))
            elif p.natural_scale == "logit":
                entries.append(low + (high - low) * pt.sigmoid(x))
            else:
                entries.append(x)
        if self._moduli:
            first = self._moduli[0]
            strain = entries[first]
            entries[first] = pt.ones_like(strain)
            unit = self.energy.stress_difference(
                strain, pt.zeros_like(strain), **self.energy.join(entries)
            )
            for place in self._moduli:
                entries[place] = entries[place] * self.reference_stress / unit
        return self.energy.join(entries)


@dataclass(frozen=True)
class ClassDistribution:
    """The distribution of a class's specimens: variables of a model, or numbers.

    Attributes
    ----------
    location, spread : tensor_like, shape (coordinate)
        Mean and standard deviation of the specimens' coordinates.
    factor : sequence of sequence
        Lower Cholesky factor of their correlation matrix, row by row.
    experiment_spread : tensor_like, shape (coordinate), optional
        Standard deviation by which experiments on a typical specimen differ from it.
    effect_spread : tensor_like, optional
        Standard deviation of the logarithm of that, between specimens.
    log_sigma, noise_spread : tensor_like, optional
        Mean and standard deviation of ``ln σ`` of the specimens, if the noise is inferred.
    """

    location: Any
    spread: Any
    factor: Sequence[Sequence[Any]]
    experiment_spread: Any = None
    effect_spread: Any = None
    log_sigma: Any = None
    noise_spread: Any = None


def population_model(
    energy: StrainEnergy,
    data: xr.Dataset,
    *,
    sigma: Any,
    experiment_effect: bool = False,
    reference_stress: float = 20.0,
    priors: Mapping[str, Any] | None = None,
) -> pm.Model:
    r"""PyMC model of a class whose specimens differ: each has its own parameters.

    On the natural scale of the parameters (see below) the coordinates ``x`` of the specimens ``s``
    are drawn from the class's distribution, and experiments ``t`` share those of their specimen:

    .. math:: x_s \sim N(m, \mathrm{diag}(τ) R \, \mathrm{diag}(τ)), \qquad
        x_t \sim N(x_{s(t)}, κ_s^2 \, \mathrm{diag}(ω)^2), \qquad
        p_i \sim N(p(a_i; θ(x_t)), σ_s^2/2)

    Specimens differ also in how much their experiments differ, ``ln κ_s ~ N(0, η²)``, and with an
    unknown ``σ`` in their noise, ``ln σ_s ~ N(ln σ, ν²)``.

    Pressures alone enter: axial forces in the data play no part. The model stands by itself, as
    that of :func:`~pymc_hyperelastic.inflation_model` does, also if it is made in the context of
    another one.

    Parameters
    ----------
    energy : StrainEnergy
        The material, such as ``ph.Ogden()``.
    data : xarray.Dataset
        Inflation data, see :func:`pymc_hyperelastic.inflation_data`: the specimens of one class.
    sigma : float or distribution
        The paper's ``σ``, kPa, ``√2`` times the standard deviation of a pressure. With a
        distribution, that of the class's median, each specimen has its own.
    experiment_effect : bool, default False
        Whether experiments on one specimen differ by more than noise, as at several axial stretches
        of a material whose law does not couple the directions rightly. Otherwise ``ω = 0``.
    reference_stress : float, default 20
        Stress ``T₀`` (kPa) of the reference strain, which stands in place of the first modulus.
    priors : dict of str to distribution, optional
        Other priors of the class: of ``location``, ``spread`` and ``experiment_spread``, with one
        entry a coordinate, and of ``effect_spread`` and ``noise_spread``.

    Returns
    -------
    pymc.Model
        With the dimensions ``specimen``, ``coordinate``, ``test`` and ``obs``; the deterministics
        of the specimens carry the names of the material parameters, and the observed variable is
        ``measured_pressure``: predictive sampling and ``log_likelihood`` work.

    Raises
    ------
    TypeError
        If the strain energy, the data or a prior is not one.
    ValueError
        If the data are unsound, or a number is impossible.

    Notes
    -----
    Default priors, with :math:`x \sim LN(m, s)` for a normal logarithm of median ``m``: the
    reference strain LN(0.2, 0.7); a shape parameter LN(u/6, 1.2) of its largest value ``u``;
    ``τ`` LN(0.4, 0.7), a coefficient of variation from 10 to 160 %; ``ω`` LN(0.15, 0.8); ``η``
    LN(0.5, 0.5); ``ν`` LN(0.3, 0.5); the correlation matrix ``R`` its determinant to the first
    power. None of the spreads can vanish: with a handful of specimens a prior with mass at zero
    makes a funnel, in which samplers get stuck.

    Specimens are sampled themselves, not their distances from the class in units of its spread: a
    curve of many points says more about its specimen than the class does.

    Terms of a series such as :class:`~pymc_hyperelastic.OgdenSeries` may change places from one
    specimen to the next: their location and spread then mean little.

    References
    ----------
    The distribution of ``R`` is made of partial correlations: D. Lewandowski, D. Kurowicka and
    H. Joe, Journal of Multivariate Analysis 100 (2009) 1989-2001. Priors of spreads that avoid
    zero: Y. Chung et al., Psychometrika 78 (2013) 685-709.

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> data = ph.select(ph.load_dataset("simulated_sheep_aorta"), group="C1")
    >>> model = ph.population_model(ph.Ogden(), data, sigma=5 * ph.mmHg)
    >>> [rv.name for rv in model.free_RVs]
    ['location', 'spread', 'correlation_unit', 'log_reference_strain', 'log_alpha']
    """
    scale = NaturalScale(energy, reference_stress)
    check_population(scale, data, sigma, experiment_effect, priors)
    specimens, of_test = specimens_of(data)
    coords = {
        "specimen": specimens,
        "coordinate": scale.names,
        "coordinate_2": scale.names,
        "obs": np.arange(data.sizes["obs"]),
        "test": [describe_test(data, test) for test in range(data.sizes["test"])],
    }
    with pm.Model(coords=coords, model=None) as model:
        distribution = register_class(scale, sigma, experiment_effect, priors)
        coordinates, specimen_sigma = register_specimens(scale, distribution, of_test)
        if specimen_sigma is None:
            specimen_sigma = pt.full((len(specimens),), np.float64(sigma))
        rule = population_rule(scale, data)
        inputs = shared_inputs("data", curve_inputs(data, rule))
        pressures = data["pressure"].values.astype(float)
        inputs["pressure"] = pm.Data("pressure_data", pressures, dims="obs")
        register_curves(scale, inputs, rule, coordinates, specimen_sigma[of_test], dims="obs")
    model.study = Study(energy, data, {}, {}, likelihood="population")
    return model


def check_population(
    scale: NaturalScale,
    data: xr.Dataset,
    sigma: Any,
    experiment_effect: bool,
    priors: Mapping[str, Any] | None,
) -> None:
    """Raise unless the population model of these can be written down."""
    check_energy(scale.energy)
    _check_moduli(scale.energy)
    if is_inferred(sigma):
        _check_sigma(sigma)
    stress = scale.reference_stress
    if not isinstance(stress, Real) or not np.isfinite(stress) or stress <= 0:
        raise ValueError(f"reference_stress is {stress!r}; expected a positive number of kPa")
    parameters = {p.name: np.zeros(p.size) if p.size else 0.0 for p in scale.energy.parameters}
    check_likelihood(scale.energy, data, parameters, sigma=sigma, slope_weight=0.0)
    if priors is not None and not isinstance(priors, Mapping):
        raise TypeError(
            'priors must be a dict such as {"noise_spread": pm.LogNormal.dist(-1, 0.5)}, not '
            f"{type(priors).__name__}"
        )
    sizes = {"location": len(scale.names), "spread": len(scale.names)}
    if experiment_effect:
        sizes |= {"experiment_spread": len(scale.names), "effect_spread": None}
    if is_inferred(sigma):
        sizes["noise_spread"] = None
    for name, prior in (priors or {}).items():
        if name not in sizes:
            raise ValueError(
                f"a prior is given for {name!r}; this class has the unknowns {list(sizes)}"
            )
        check_prior(name, prior, sizes[name])


def _check_moduli(energy: StrainEnergy) -> None:
    """Raise if stress at the reference strain is more than what the positive moduli make of it."""
    scales = {p.name: p.natural_scale for p in energy.parameters if p.unit == "kPa"}
    others = [name for name, scale in scales.items() if scale != "log"]
    if "log" in scales.values() and others:
        raise ValueError(
            f"the parameter {others[0]!r} of {energy.name} is a modulus on the scale "
            f"{scales[others[0]]!r}, but population models need moduli that are positive, on the "
            "scale 'log': give it a prior_range above zero"
        )


def _check_sigma(sigma: Any) -> None:
    """Raise unless `sigma` is a distribution of positive numbers: its logarithm is spread."""
    check_prior("sigma", sigma)
    smallest = pm.draw(sigma, draws=_SIGMA_DRAWS, random_seed=1, mode="FAST_COMPILE").min()
    if smallest <= 0:
        raise ValueError(
            f"the prior of 'sigma' holds numbers such as {smallest:.3g}; expected a distribution "
            "of positive numbers, such as pm.LogNormal.dist(0, 1)"
        )


def specimens_of(data: xr.Dataset) -> tuple[list[str], NDArray[np.intp]]:
    """Specimens in the order of the data, and which of them each test is of."""
    labels = [str(name) for name in data["specimen"].values.tolist()]
    specimens = list(dict.fromkeys(labels))
    return specimens, np.array([specimens.index(name) for name in labels])


def register_class(
    scale: NaturalScale,
    sigma: Any,
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
    factor = _correlation_factor(size)
    optional: dict[str, Any] = {}
    if experiment_effect:
        # Experiments differ less than specimens, on any scale in the same proportion.
        medians = logs + np.log(_EXPERIMENT_SPREAD[0] / _SPREAD[0])
        prior = pm.LogNormal.dist(medians, _EXPERIMENT_SPREAD[1], shape=size)
        optional["experiment_spread"] = variable("experiment_spread", prior)
        prior = pm.LogNormal.dist(np.log(_EFFECT_SPREAD[0]), _EFFECT_SPREAD[1])
        optional["effect_spread"] = variable("effect_spread", prior, dims=None)
    if is_inferred(sigma):
        optional["log_sigma"] = pt.log(register_prior("sigma", sigma))
        prior = pm.LogNormal.dist(np.log(_NOISE_SPREAD[0]), _NOISE_SPREAD[1])
        optional["noise_spread"] = variable("noise_spread", prior, dims=None)
    return ClassDistribution(location, spread, factor, **optional)


def _correlation_factor(size: int) -> list[list[Any]]:
    """Cholesky factor of a random correlation matrix, entry by entry."""
    rows: list[list[Any]] = [[np.float64(1.0)]]
    if size == 1:
        return rows
    column = np.array([j for i in range(1, size) for j in range(i)])
    shape = _CONCENTRATION + (size - 2 - column) / 2
    partial = 2 * pm.Beta("correlation_unit", shape, shape, shape=len(column)) - 1
    place = 0
    for i in range(1, size):
        left: Any = np.float64(1.0)
        row = []
        for _ in range(i):
            row.append(partial[place] * left)
            left = left * pt.sqrt(1 - pt.square(partial[place]))
            place += 1
        rows.append([*row, left])
    correlation = [
        [sum(a * b for a, b in zip(rows[i], rows[j], strict=False)) for j in range(size)]
        for i in range(size)
    ]
    matrix = pt.stack([pt.stack([pt.as_tensor(v) for v in row]) for row in correlation])
    pm.Deterministic("correlation", matrix, dims=("coordinate", "coordinate_2"))
    return rows


def register_specimens(
    scale: NaturalScale, distribution: ClassDistribution, of_test: NDArray[np.intp]
) -> tuple[list[TensorVariable], TensorVariable | None]:
    """Variables of the specimens: coordinates of every test, and noise of every specimen."""
    location, spread = distribution.location, distribution.spread
    standard: list[Any] = []
    coordinates = []
    # One coordinate after another, each given those before: no matrix is inverted.
    for j, (name, row) in enumerate(zip(scale.names, distribution.factor, strict=True)):
        given = sum(a * z for a, z in zip(row[:-1], standard, strict=True))
        x = pm.Normal(name, location[j] + spread[j] * given, spread[j] * row[-1], dims="specimen")
        standard.append(((x - location[j]) / spread[j] - given) / row[-1])
        coordinates.append(x)
    for name, value in scale.parameters(coordinates).items():
        value = pt.stack(value, axis=-1) if isinstance(value, tuple) else value
        pm.Deterministic(name, value, dims=("specimen",) + (None,) * (value.type.ndim - 1))
    of_tests = [x[of_test] for x in coordinates]
    if distribution.experiment_spread is not None:
        log_effect = pm.Normal("log_effect", 0.0, distribution.effect_spread, dims="specimen")
        within = pt.exp(log_effect)[of_test]
        of_tests = [
            pm.Normal(f"{name}_of_test", x, distribution.experiment_spread[j] * within, dims="test")
            for j, (name, x) in enumerate(zip(scale.names, of_tests, strict=True))
        ]
    if distribution.log_sigma is None:
        return of_tests, None
    log_sigma = pm.Normal(
        "log_specimen_sigma", distribution.log_sigma, distribution.noise_spread, dims="specimen"
    )
    return of_tests, pt.exp(log_sigma)


def population_rule(scale: NaturalScale, data: xr.Dataset) -> Rule:
    """How the walls of these data are integrated, over the range of the specimens' coordinates."""
    mean, sd = scale.location_prior
    reach = _REACH * sd
    coordinates = [pm.Uniform.dist(m - r, m + r) for m, r in zip(mean, reach, strict=True)]
    return rule_for(scale.energy, data, scale.parameters(coordinates))


def curve_inputs(data: xr.Dataset, rule: Rule) -> dict[str, NDArray]:
    """Arrays by which the data enter :func:`register_curves`."""
    inputs = {"test": data["test"].values, "pressure": data["pressure"].values.astype(float)}
    if rule.method == "quadrature":
        return inputs | tube_inputs(data)
    matrices, place = curve_matrices(data, rule.nodes, by_test=True)
    del matrices["force_matrix"]
    return inputs | matrices | {"place": place}


def register_curves(
    scale: NaturalScale,
    inputs: Mapping[str, Any],
    rule: Rule,
    coordinates: Sequence[TensorVariable],
    sigma: Any,
    dims: str | None = None,
) -> None:
    """Curves of the tests, and the measured pressures about them, with ``σ`` of every test."""
    test = inputs["test"]
    entries = scale.energy.split(scale.parameters(coordinates))
    if rule.method == "collocation":
        constants = ("log_hoop", "log_axial", "pressure_matrix", "stiffness_matrix")
        integral = CollocatedPressureIntegral(strain_energy=scale.energy, per_group=True)
        pressure, _ = integral(*(inputs[name] for name in constants), *entries)
        pressure = pressure.flatten()[inputs["place"]]
    else:
        parameters = scale.energy.join([x[test] for x in entries])
        current = current_tube(scale.energy, inputs, {}, parameters)
        pressure = wall_pressure(current.tubes, rule.nodes)[0]
    # The paper's σ is √2 standard deviations.
    sd = sigma[test] / np.sqrt(2)
    pressure = pm.Deterministic("pressure", pressure, dims=dims)
    pm.Normal("measured_pressure", pressure, sd, observed=inputs["pressure"], dims=dims)
