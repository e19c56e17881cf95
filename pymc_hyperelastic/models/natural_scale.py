"""Coordinates of a specimen, in which the specimens of a class are spread normally."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
import pymc as pm
import pytensor
import pytensor.tensor as pt
from numpy.typing import NDArray
from pytensor.graph.fg import FrozenFunctionGraph
from pytensor.tensor.variable import TensorVariable

from pymc_hyperelastic.mechanics.layers import Layer
from pymc_hyperelastic.mechanics.strain_energy.base import Parameter, StrainEnergy
from pymc_hyperelastic.models.moduli import (
    has_additive_stress,
    moduli_by_ratio,
    moduli_by_stress,
)
from pymc_hyperelastic.models.priors import is_inferred
from pymc_hyperelastic.models.records import NamedLayer, named_layers

Array = NDArray[np.float64]

# Functions of coordinates in numbers, by their expressions.
_known_functions: dict[FrozenFunctionGraph, Any] = {}

# Priors of a class's location, each as the median and the standard deviation of a logarithm.
_REFERENCE_STRAIN = (0.2, 0.7)
# Of a shape parameter: its median as a fraction of the upper end of its range.
_SHAPE = (1 / 6, 1.2)
# Of a modulus that keeps its own logarithm, in the same way.
_MODULUS = (1 / 20, 2.0)
# Of the stress of one modulus, as a multiple of that of the first.
_STRESS_RATIO = (1.0, 2.0)
_RATIO_SD, _LOGIT_SD = 1.5, 1.5
# Of spreads, each as the median and the standard deviation of a logarithm.
SPREAD = (0.4, 0.7)
_STRESS_RATIO_SPREAD, _THICKNESS_SPREAD = 0.8, 0.15
# The range of a parameter on "real", in prior standard deviations and in spreads.
_REAL_SD, _REAL_SPREAD = 4.0, 20.0
_THICKNESS_DRAWS = 4000


@dataclass(frozen=True)
class NaturalScale:
    r"""Coordinates of a specimen, in which the specimens of a class are spread normally.

    One stands in place of each parameter: the logarithm of a positive one, the logit of one between
    two ends, see :class:`~pymc_hyperelastic.Parameter`. A modulus at rest is hardly known from a
    curve that stiffens, and lies with the stiffening on a thin ridge. In place of a law's only
    modulus stands therefore the hoop strain :math:`e = \ln λ_θ` at which the wall's stress has a
    physiological size,

    .. math:: T_θ(e, \ln λ_z = 0) = T_0, \qquad x_1 = \ln e .

    Several moduli share the stress. Where it is a sum to which each adds its own, which is tried
    out in numbers, the first gives way to the equibiaxial strain at which

    .. math:: \tfrac12 (T_θ + T_z)(\ln λ_θ = \ln λ_z = e) = T_0, \qquad x_1 = \ln e,

    and any other to the logarithm of the ratio of the stress that it bears there to that which the
    first bears, :math:`\ln (T_i/T_1)`. All fibres are stretched there alike, wherever they run.
    With the stress :math:`t_i` of a modulus of 1 kPa they follow in closed form:

    .. math:: θ_i = \frac{T_i}{t_i(e)}, \qquad T_i = T_0 \frac{e^{x_i}}{1 + \sum_{j>1} e^{x_j}},
        \qquad x_{i>1} = \ln\frac{T_i}{T_1} .

    Where stress is no such sum the others give way to the logarithms of their ratios to the first,
    at the hoop strain of a law of one modulus.

    Without a stress of reference every modulus keeps its own logarithm.

    Of a wall of layers each has the coordinates of its law. Numbers stay what they are; beside a
    modulus that is a number any other has its logarithm. A thickness that is inferred has its
    logarithm, too.

    Attributes
    ----------
    wall : StrainEnergy or sequence of Layer
        The material, or the layers: what is missing in them is inferred, and so is a thickness that
        is a distribution.
    reference_stress : float, optional
        ``T₀ = σθθ − σrr``, or its mean with ``σzz − σrr``, kPa.

    Raises
    ------
    TypeError
        If the parameter of a layer is a distribution: those of a class take its place.
    ValueError
        If the distribution of a thickness holds negative numbers.
    """

    wall: StrainEnergy | Sequence[Layer]
    reference_stress: float | None = 20.0

    @cached_property
    def _materials(self) -> list["_Material"]:
        layers = named_layers(self.wall)
        if isinstance(self.wall, StrainEnergy):
            return [_Material(layers[0], "", self.reference_stress)]
        for number, layer in enumerate(self.wall, start=1):
            given = [name for name, value in layer.parameters.items() if is_inferred(value)]
            if given:
                raise TypeError(
                    f"layer {number} has a distribution for {given[0]!r}, but where specimens "
                    "differ the distribution of the class takes its place: leave it out, or give "
                    "a number"
                )
        return [
            _Material(layer, f"_{number}", self.reference_stress)
            for number, layer in enumerate(layers, start=1)
        ]

    @cached_property
    def _thicknesses(self) -> dict[str, TensorVariable]:
        """Distributions of what is inferred of the layers, by name."""
        if isinstance(self.wall, StrainEnergy):
            return {}
        names = (material.layer.values["thickness"] for material in self._materials)
        given = ((name, layer.thickness) for name, layer in zip(names, self.wall, strict=True))
        return {name: thickness for name, thickness in given if isinstance(name, str)}

    @cached_property
    def _coordinates(self) -> list["_Coordinate"]:
        of_materials = [c for material in self._materials for c in material.coordinates]
        of_thicknesses = [_of_thickness(name, d) for name, d in self._thicknesses.items()]
        return of_materials + of_thicknesses

    @property
    def names(self) -> list[str]:
        """Names of the coordinates, such as ``log_alpha``."""
        return [c.name for c in self._coordinates]

    @property
    def location_prior(self) -> tuple[Array, Array]:
        """Mean and standard deviation of the normal prior of a class's location."""
        mean, sd = np.array([(c.mean, c.sd) for c in self._coordinates]).T
        return mean, sd

    @property
    def spread_prior(self) -> tuple[Array, float]:
        """Mean and standard deviation of the logarithm of a class's spread."""
        return np.log([c.spread for c in self._coordinates]), SPREAD[1]

    def parameters(self, coordinates: Sequence[TensorVariable]) -> dict[str, Any]:
        """Material parameters by name, as the strain energy takes them.

        Of layers they have the names of :func:`~pymc_hyperelastic.inflation_model`, and thicknesses
        are among them.
        """
        rest = iter(coordinates)
        parameters: dict[str, Any] = {}
        for material in self._materials:
            own = material.parameters([*islice(rest, len(material.coordinates))])
            if isinstance(self.wall, StrainEnergy):
                parameters = own
                break
            for name, value in own.items():
                variable = material.layer.values[name]
                if isinstance(variable, str):
                    stacked = pt.stack(value, axis=-1) if isinstance(value, tuple) else value
                    parameters[variable] = stacked
        return parameters | dict(zip(self._thicknesses, (pt.exp(x) for x in rest), strict=True))

    def wall_of(self, parameters: Mapping[str, Any]) -> StrainEnergy | list[Layer]:
        """The wall with such parameters in place of what is inferred of its layers."""
        if isinstance(self.wall, StrainEnergy):
            return self.wall

        def known(layer: NamedLayer) -> Layer:
            values = {
                n: parameters[v] if isinstance(v, str) else v for n, v in layer.values.items()
            }
            return Layer(layer.energy, **values)

        return [known(material.layer) for material in self._materials]

    def numbers(self, coordinates: Sequence[Array]) -> dict[str, Array]:
        """Material parameters of coordinates in numbers; entries of vectors along a last axis."""
        names, function = self._numbers
        shape = np.shape(coordinates[0])
        values = function(*(np.ravel(x) for x in coordinates))
        return {n: v.reshape(shape + v.shape[1:]) for n, v in zip(names, values, strict=True)}

    @cached_property
    def _numbers(self) -> tuple[list[str], Any]:
        """Names of the parameters, and their function of coordinates in numbers."""
        coordinates = [pt.vector(name, dtype="float64") for name in self.names]
        parameters = self.parameters(coordinates)
        symbols = [
            pt.stack(value, axis=-1) if isinstance(value, tuple) else value
            for value in parameters.values()
        ]
        # One that was asked for before is remembered: it takes longer to compile than to call.
        key = FrozenFunctionGraph.from_io(coordinates, symbols)
        if key not in _known_functions:
            function = pytensor.function(coordinates, symbols, mode="FAST_COMPILE")
            _known_functions[key] = function
        return [*parameters], _known_functions[key]


class _Coordinate(NamedTuple):
    """A coordinate and its default priors."""

    name: str
    mean: float
    sd: float
    """Of the location."""
    spread: float = SPREAD[0]
    """Its median."""


class _Entry(NamedTuple):
    """An entry of a parameter: a number, or None if it is inferred."""

    name: str
    parameter: Parameter
    number: float | None

    @property
    def coordinate(self) -> _Coordinate:
        """That of a parameter that does not give way to another."""
        scale, (low, high) = self.parameter.natural_scale, self.parameter.prior_range
        name = f"{scale}_{self.name}"
        if scale == "log":
            share, sd = _MODULUS if self.parameter.unit == "kPa" else _SHAPE
            median, sd = self.parameter.typical or (high * share, sd)
            return _Coordinate(name, np.log(median), sd)
        if scale == "logit":
            return _Coordinate(name, 0.0, _LOGIT_SD)
        return _Coordinate(
            name, (low + high) / 2, (high - low) / _REAL_SD, (high - low) / _REAL_SPREAD
        )

    def value(self, x: TensorVariable | None) -> Any:
        """The entry at its coordinate."""
        scale, (low, high) = self.parameter.natural_scale, self.parameter.prior_range
        if x is None:
            return pt.as_tensor(self.number)
        if scale == "log":
            return pt.exp(x)
        return low + (high - low) * pt.sigmoid(x) if scale == "logit" else x


class _Material:
    """Coordinates of the law of a layer, or of a wall."""

    def __init__(self, layer: NamedLayer, suffix: str, reference_stress: float | None) -> None:
        self.layer, self.energy = layer, layer.energy
        self._suffix, self._stress = suffix, reference_stress
        self._entries = [e for p in self.energy.parameters for e in self._entries_of(p)]
        moduli = [e.parameter.unit == "kPa" for e in self._entries]
        numbers = [e.number is not None for e in self._entries]
        # A modulus that is a number leaves no stress to be chosen.
        free = reference_stress is not None and not np.any(np.logical_and(moduli, numbers))
        self._moduli = [
            i
            for i, e in enumerate(self._entries)
            if free and moduli[i] and e.parameter.natural_scale == "log"
        ]
        self._additive = len(self._moduli) > 1 and has_additive_stress(self.energy)

    def _entries_of(self, p: Parameter) -> list[_Entry]:
        size, value, name = p.size or 1, self.layer.values[p.name], p.name + self._suffix
        names = [name] if p.size is None else [f"{name}[{i}]" for i in range(size)]
        numbers = [None] * size if isinstance(value, str) else np.atleast_1d(value).tolist()
        return [_Entry(n, p, number) for n, number in zip(names, numbers, strict=True)]

    @property
    def coordinates(self) -> list[_Coordinate]:
        """One for each entry that is inferred."""
        inferred = (i for i, entry in enumerate(self._entries) if entry.number is None)
        return [self._coordinate(i) for i in inferred]

    def _coordinate(self, place: int) -> _Coordinate:
        entry = self._entries[place]
        if place not in self._moduli:
            return entry.coordinate
        first = self._entries[self._moduli[0]]
        if entry is first:
            state = "biaxial" if self._additive else "reference"
            strain, sd = _REFERENCE_STRAIN
            return _Coordinate(f"log_{state}_strain{self._suffix}", np.log(strain), sd)
        if self._additive:
            ratio, sd = _STRESS_RATIO
            name = f"log_stress_{entry.name}_over_{first.name}"
            return _Coordinate(name, np.log(ratio), sd, _STRESS_RATIO_SPREAD)
        largest = entry.parameter.prior_range[1] / first.parameter.prior_range[1]
        return _Coordinate(f"log_{entry.name}_ratio", np.log(largest), _RATIO_SD)

    def parameters(self, coordinates: Sequence[TensorVariable]) -> dict[str, Any]:
        """Parameters by name, vectors as tuples."""
        rest = iter(coordinates)
        given = [next(rest) if e.number is None else None for e in self._entries]
        entries = [e.value(x) for e, x in zip(self._entries, given, strict=True)]
        if self._moduli and self._stress is not None:
            first, *others = self._moduli
            moduli_of = moduli_by_stress if self._additive else moduli_by_ratio
            ratios = [given[place] for place in others]
            moduli = moduli_of(
                self.energy, entries, self._moduli, entries[first], ratios, self._stress
            )
            for place, modulus in zip(self._moduli, moduli, strict=True):
                entries[place] = modulus
        return self.energy.join(entries)


@lru_cache
def _of_thickness(name: str, distribution: TensorVariable) -> _Coordinate:
    """Coordinate of a thickness: its logarithm has the moments that the distribution gives it."""
    draws = pm.draw(distribution, draws=_THICKNESS_DRAWS, random_seed=1, mode="FAST_COMPILE")
    if draws.min() <= 0:
        raise ValueError(
            f"the prior of {name!r} holds numbers such as {draws.min():.3g}; expected a "
            "distribution of positive numbers, such as pm.LogNormal.dist(-1, 0.3)"
        )
    logs = np.log(draws)
    return _Coordinate(f"log_{name}", logs.mean(), logs.std(), _THICKNESS_SPREAD)


def check_moduli(wall: StrainEnergy | Sequence[Layer]) -> None:
    """Raise if stress at the reference strain is more than what the positive moduli make of it."""
    for energy in {layer.energy for layer in named_layers(wall)}:
        scales = {p.name: p.natural_scale for p in energy.parameters if p.unit == "kPa"}
        others = [name for name, scale in scales.items() if scale != "log"]
        if "log" in scales.values() and others:
            raise ValueError(
                f"the parameter {others[0]!r} of {energy.name} is a modulus on the scale "
                f"{scales[others[0]]!r}, but population models need moduli that are positive, on "
                "the scale 'log': give it a prior_range above zero"
            )
