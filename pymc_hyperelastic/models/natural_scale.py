"""Coordinates of a specimen in which the specimens of a class are normally distributed.

Population models and classes with variability between specimens use them: the transformation to
material parameters, and the default priors of a class. The page Variability gives reasons.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, reduce
from operator import or_
from typing import Any, NamedTuple

import numpy as np
import pytensor
import pytensor.tensor as pt
from numpy.typing import NDArray
from pytensor.graph.fg import FrozenFunctionGraph
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy.base import Parameter, StrainEnergy
from pymc_hyperelastic.models.moduli import has_additive_stress, moduli_by_ratio, moduli_by_stress
from pymc_hyperelastic.models.priors import (
    PRIOR_DRAWS,
    complete_layers,
    is_inferred,
    positive_draws,
    with_variables,
)
from pymc_hyperelastic.models.settings import NamedLayer, named_layers

Array = NDArray[np.float64]


class _Prior(NamedTuple):
    """Priors of a class in one coordinate: a normal location, and a log-normal spread."""

    mean: float
    """Mean of the location."""
    sd: float
    """Standard deviation of the location."""
    spread: float = 0.4
    """Median of the spread. Seven mouse aortas have 0.29 to 0.9."""


# Standard deviation of the logarithm of every spread: a factor of 4 each way with 95 % probability.
_SD_OF_LOG_SPREAD = 0.7
# Priors by kind of coordinate.
_PRIORS = {
    # Logarithm of the strain at the reference stress: 0.05 to 0.8 with 95 % probability. Seven
    # mouse aortas have 0.11 to 0.24, with a standard deviation of 0.29 of the logarithm.
    "strain": _Prior(np.log(0.2), 0.7),
    # Logarithm of the stress of a modulus over that of the first: a factor of 50 with 95 %
    # probability. Mouse aortas have spreads of 0.7 to 0.9.
    "stress ratio": _Prior(0.0, 2.0, 0.8),
    # Logarithm of the ratio of a modulus to the first, over that of their upper bounds: a factor of
    # 20 with 95 % probability.
    "ratio": _Prior(0.0, 1.5),
    # Logarithm of a modulus, without a reference stress, over its upper bound: the bound is 1.5
    # standard deviations above the median.
    "modulus": _Prior(np.log(1 / 20), 2.0),
    # The same of a dimensionless parameter.
    "shape": _Prior(np.log(1 / 6), 1.2),
    # Logit of an angle or a dispersion: nearly uniform between the bounds.
    "logit": _Prior(0.0, 1.5),
    # A parameter of either sign, from the middle of its range and in units of the range, which is
    # two standard deviations each side.
    "real": _Prior(0.0, 1 / 4, 1 / 20),
    # Logarithm of a thickness, whose location has the moments of its distribution: vessels of one
    # group differ less in thickness than in material.
    "thickness": _Prior(np.nan, np.nan, 0.15),
}


@dataclass(frozen=True)
class NaturalScale:
    r"""Coordinates of a specimen in which the specimens of a class are normally distributed.

    A positive parameter is replaced by its logarithm, and one between two bounds by its logit. If a
    reference stress ``T₀`` is given, the first modulus is replaced by the logarithm of a strain:

    - One modulus: this is the hoop strain :math:`\ln λ_θ` where :math:`T_θ = T_0` and ``λz = 1``.
    - Several moduli and an additive stress, see
      :func:`~pymc_hyperelastic.models.moduli.has_additive_stress`: this is the equibiaxial strain
      ``e``. The mean of ``Tθ`` and ``Tz`` is ``T₀`` there. Each other modulus is replaced by the
      logarithm of its stress over that of the first. With the stress ``t_i`` of a modulus of 1 kPa

      .. math:: θ_i = \frac{T_i}{t_i(e)}, \qquad \sum_i T_i = T_0, \quad \ln\frac{T_i}{T_1} = x_i .

    - Other laws: as with one modulus; each other modulus is replaced by its log ratio to the first.

    Each layer has the coordinates of its law. A parameter that is a number has no coordinate; if a
    modulus is a number, the other moduli of the layer are replaced by their logarithms. An inferred
    thickness is replaced by its logarithm.

    Attributes
    ----------
    wall : StrainEnergy or sequence of Layer
        The material, or the layers. Missing parameters of layers are inferred, and so are
        thicknesses that are distributions.
    reference_stress : float, optional
        ``T₀ = σθθ − σrr``, or the mean of ``σθθ − σrr`` and ``σzz − σrr``, kPa.

    Raises
    ------
    TypeError
        If a parameter of a layer is a distribution.
    ValueError
        If the distribution of a thickness has values that are not positive.
    """

    wall: StrainEnergy | Sequence[Layer]
    reference_stress: float | None = 20.0

    @cached_property
    def _materials(self) -> list["_Material"]:
        layers = named_layers(self.wall)
        if isinstance(self.wall, StrainEnergy):
            return [_Material(layers[0], "", self.reference_stress)]
        materials = []
        for number, (layer, stated) in enumerate(zip(layers, self.wall, strict=True), start=1):
            given = [name for name, value in stated.parameters.items() if is_inferred(value)]
            if given:
                raise TypeError(
                    f"layer {number} has a distribution for {given[0]!r}, but in a model of "
                    "specimens the distribution of the class replaces it. Omit the parameter, or "
                    "give a number"
                )
            materials.append(_Material(layer, f"_{number}", self.reference_stress))
        return materials

    @cached_property
    def _thicknesses(self) -> dict[str, TensorVariable]:
        """Distributions of the inferred thicknesses of layers, by name."""
        if isinstance(self.wall, StrainEnergy):
            return {}
        names = [material.layer.values["thickness"] for material in self._materials]
        stated = zip(names, self.wall, strict=True)
        return {name: layer.thickness for name, layer in stated if isinstance(name, str)}

    @cached_property
    def _priors(self) -> dict[str, _Prior]:
        """Default priors by coordinate."""
        priors = {f"log_{n}": _prior_of_thickness(n, d) for n, d in self._thicknesses.items()}
        return reduce(or_, [material.coordinates for material in self._materials]) | priors

    @property
    def names(self) -> list[str]:
        """Names of the coordinates, such as ``log_alpha``."""
        return [*self._priors]

    @property
    def location_prior(self) -> tuple[Array, Array]:
        """Mean and standard deviation of the normal prior of the location of a class."""
        mean, sd, _ = np.array([*self._priors.values()]).T
        return mean, sd

    @property
    def spread_prior(self) -> tuple[Array, float]:
        """Mean and standard deviation of the logarithm of the spread of a class."""
        return np.log([prior.spread for prior in self._priors.values()]), _SD_OF_LOG_SPREAD

    def parameters(self, coordinates: Sequence[TensorVariable]) -> dict[str, Any]:
        """Material parameters by name, as arguments of the strain energy.

        Parameters of layers have the names of :func:`~pymc_hyperelastic.inflation_model`, and
        inferred thicknesses are included.
        """
        rest = iter(coordinates)
        by_layer = [material.parameters(rest) for material in self._materials]
        if isinstance(self.wall, StrainEnergy):
            return by_layer[0]
        parameters: dict[str, Any] = {}
        for material, values in zip(self._materials, by_layer, strict=True):
            for name, value in values.items():
                variable = material.layer.values[name]
                if isinstance(variable, str):
                    parameters[variable] = _stacked(value)
        return parameters | dict(zip(self._thicknesses, (pt.exp(x) for x in rest), strict=True))

    def wall_of(self, parameters: Mapping[str, Any]) -> StrainEnergy | list[Layer]:
        """Wall with the values of `parameters` for the inferred parameters of its layers."""
        if isinstance(self.wall, StrainEnergy):
            return self.wall
        return with_variables(*complete_layers(self.wall), parameters)

    def numbers(self, coordinates: Sequence[Array]) -> dict[str, Array]:
        """Material parameters for numerical coordinates; entries of vectors on the last axis."""
        names, function = self._numbers
        shape = np.shape(coordinates[0])
        values = function(*(np.ravel(x) for x in coordinates))
        return {n: v.reshape(shape + v.shape[1:]) for n, v in zip(names, values, strict=True)}

    @cached_property
    def _numbers(self) -> tuple[list[str], Any]:
        """Names of the parameters, and the compiled function from coordinates to parameters."""
        coordinates = [pt.vector(name, dtype="float64") for name in self.names]
        parameters = self.parameters(coordinates)
        outputs = [_stacked(value) for value in parameters.values()]
        return [*parameters], _compiled(FrozenFunctionGraph.from_io(coordinates, outputs))


@lru_cache(maxsize=64)
def _compiled(graph: FrozenFunctionGraph) -> Any:
    """Compiled function of a graph; compiling takes longer than most calls."""
    inputs = [x.type() for x in graph.inputs]
    outputs = graph.bind(dict(zip(graph.inputs, inputs, strict=True)))
    return pytensor.function(inputs, outputs, mode="FAST_COMPILE")


def _stacked(value: Any) -> Any:
    """Return a vector parameter, given as a tuple of entries, as one variable."""
    return pt.stack(value, axis=-1) if isinstance(value, tuple) else value


class _Entry(NamedTuple):
    """One entry of a parameter."""

    name: str
    parameter: Parameter
    number: float | None
    """Value of the entry; None if the entry is inferred."""

    @property
    def coordinate(self) -> tuple[str, _Prior]:
        """Name and prior of the entry by itself: its logarithm, its logit, or the entry."""
        scale, (low, high) = self.parameter.natural_scale, self.parameter.prior_range
        if scale == "log":
            prior = _PRIORS["modulus" if self.parameter.unit == "kPa" else "shape"]
            median, sd = self.parameter.typical or (high * np.exp(prior.mean), prior.sd)
            return f"log_{self.name}", _Prior(np.log(median), sd, prior.spread)
        prior = _PRIORS[scale]
        if scale == "real":
            prior = _Prior((low + high) / 2, *((high - low) * x for x in prior[1:]))
        return f"{scale}_{self.name}", prior

    def value(self, x: TensorVariable | None) -> Any:
        """Value of the entry at its coordinate `x`, or its number."""
        if x is None:
            return pt.as_tensor(self.number)
        scale, (low, high) = self.parameter.natural_scale, self.parameter.prior_range
        if scale == "log":
            return pt.exp(x)
        return low + (high - low) * pt.sigmoid(x) if scale == "logit" else x


class _Material:
    """Coordinates of the law of a wall, or of one layer: their names then end with its `suffix`."""

    def __init__(self, layer: NamedLayer, suffix: str, reference_stress: float | None) -> None:
        self.layer, self.energy = layer, layer.energy
        self._suffix, self._stress = suffix, reference_stress
        self._entries = [e for p in self.energy.parameters for e in self._entries_of(p)]
        moduli = {i: e for i, e in enumerate(self._entries) if e.parameter.unit == "kPa"}
        # The reference stress determines the moduli only if all of them are inferred.
        if reference_stress is None or any(e.number is not None for e in moduli.values()):
            moduli = {}
        # Indices of the moduli that the reference stress determines.
        self._moduli = [i for i, e in moduli.items() if e.parameter.natural_scale == "log"]
        self._additive = len(self._moduli) > 1 and has_additive_stress(self.energy)

    def _entries_of(self, p: Parameter) -> list[_Entry]:
        size, value, name = p.size or 1, self.layer.values[p.name], p.name + self._suffix
        names = [name] if p.size is None else [f"{name}[{i}]" for i in range(size)]
        numbers = [None] * size if isinstance(value, str) else np.atleast_1d(value).tolist()
        return [_Entry(n, p, number) for n, number in zip(names, numbers, strict=True)]

    @property
    def coordinates(self) -> dict[str, _Prior]:
        """Name and prior of the coordinate of each inferred entry, in the order of the entries."""
        return dict(self._coordinate(i) for i, e in enumerate(self._entries) if e.number is None)

    def _coordinate(self, index: int) -> tuple[str, _Prior]:
        entry = self._entries[index]
        if index not in self._moduli:
            return entry.coordinate
        first = self._entries[self._moduli[0]]
        if entry is first:
            state = "biaxial" if self._additive else "reference"
            return f"log_{state}_strain{self._suffix}", _PRIORS["strain"]
        if self._additive:
            return f"log_stress_{entry.name}_over_{first.name}", _PRIORS["stress ratio"]
        largest = entry.parameter.prior_range[1] / first.parameter.prior_range[1]
        prior = _PRIORS["ratio"]._replace(mean=np.log(largest) + _PRIORS["ratio"].mean)
        return f"log_{entry.name}_ratio", prior

    def parameters(self, coordinates: Iterator[TensorVariable]) -> dict[str, Any]:
        """Parameters by name, vectors as tuples, from the next coordinates, of inferred entries."""
        given = [next(coordinates) if e.number is None else None for e in self._entries]
        entries = [e.value(x) for e, x in zip(self._entries, given, strict=True)]
        if self._moduli and self._stress is not None:
            first, *others = self._moduli
            moduli_of = moduli_by_stress if self._additive else moduli_by_ratio
            state = entries[first], [given[i] for i in others], self._stress
            entries = moduli_of(self.energy, entries, self._moduli, *state)
        return self.energy.join(entries)


@lru_cache(maxsize=128)
def _prior_of_thickness(name: str, distribution: TensorVariable) -> _Prior:
    """Priors of ``ln h``, whose location has the moments of the distribution."""
    logs = np.log(positive_draws(name, distribution, PRIOR_DRAWS))
    return _PRIORS["thickness"]._replace(mean=logs.mean(), sd=logs.std())


def check_moduli(wall: StrainEnergy | Sequence[Layer]) -> None:
    """Raise ValueError if a law has both positive moduli and moduli of either sign."""
    for energy in {layer.energy for layer in named_layers(wall)}:
        scales = {p.name: p.natural_scale for p in energy.parameters if p.unit == "kPa"}
        others = [name for name, scale in scales.items() if scale != "log"]
        if "log" in scales.values() and others:
            raise ValueError(
                f"the modulus {others[0]!r} of {energy.name} has the scale {scales[others[0]]!r}, "
                "but population models need positive moduli, with the scale 'log'. Give the "
                "parameter a positive prior_range"
            )
