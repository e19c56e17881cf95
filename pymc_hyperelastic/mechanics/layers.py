"""Unloaded tubes of one material or of several layers.

Wall integrals add up over the layers. Public functions check here what users give them.
"""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from typing import Any, NamedTuple

import numpy as np
from pytensor.graph.basic import Variable

from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.tube import UNLOADED, current_radius


class Layer:
    """One layer of a wall: its material, thickness and parameters.

    A list of layers, from the inside out, replaces the strain energy and the outer radius in
    :func:`~pymc_hyperelastic.inflation_pressure`,
    :func:`~pymc_hyperelastic.inflation_stiffness`, :func:`~pymc_hyperelastic.axial_force` and
    :func:`~pymc_hyperelastic.inflation_model`. All layers are stress-free in the same opened tube.

    Parameters
    ----------
    energy : StrainEnergy
        The material.
    thickness : tensor_like
        Thickness in the reference tube, mm.
    **parameters : tensor_like
        Material parameters by name. In a model, a distribution makes a parameter or the thickness a
        random variable; a distribution that is used in two layers makes one variable of both; and
        missing parameters have their default priors.

    Raises
    ------
    TypeError, ValueError
        If `energy` is no strain energy, a parameter is unknown, or the thickness is impossible.

    See Also
    --------
    inflation_pressure, MeasuredValue

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> media = ph.Layer(ph.NeoHookean(), 0.26, mu=30.0)
    >>> adventitia = ph.Layer(ph.Demiray(), 0.13, mu=3.0, b=2.0)
    >>> pressure = ph.inflation_pressure([media, adventitia], 1.6, ph.Tube(1.43))
    >>> round(float(pressure.eval()), 3)
    1.671
    """

    def __init__(self, energy: StrainEnergy, thickness: Any, **parameters: Any) -> None:
        check_energy(energy)
        unknown = sorted(set(parameters) - set(energy.parameter_names))
        if unknown:
            raise TypeError(
                f"{energy.name} has the parameters {list(energy.parameter_names)}, not {unknown}"
            )
        check_geometry(thickness=thickness)
        self.energy, self.thickness, self.parameters = energy, thickness, parameters

    def mapped(self, change: Callable[[Any], Any]) -> "Layer":
        """Return the layer with its thickness and all entries changed, without a check."""
        layer = copy(self)
        entries = [change(entry) for entry in self.energy.split(self.parameters)]
        layer.thickness, layer.parameters = change(self.thickness), self.energy.join(entries)
        return layer

    def __repr__(self) -> str:
        settings = ", ".join(f"{name}={value!r}" for name, value in self.parameters.items())
        return f"Layer({self.energy!r}, {self.thickness!r}, {settings})"


class ReferenceLayer(NamedTuple):
    """A layer of an unloaded tube."""

    energy: StrainEnergy
    inner_radius: Any
    outer_radius: Any
    entries: list[Any]
    """Entries of the material parameters, see :meth:`StrainEnergy.split`."""


class LayeredTube(NamedTuple):
    """An unloaded tube: its layers from the inside out, of which a wall of one material has one."""

    layers: list[ReferenceLayer]
    geometry: dict[str, Any]
    """Measures of the whole tube by name, at least those in UNLOADED."""

    @property
    def inputs(self) -> list[Any]:
        """The measures in UNLOADED, then the outer radius and the entries of each layer."""
        inputs = [*self.unloaded.values()]
        for layer in self.layers:
            inputs += [layer.outer_radius, *layer.entries]
        return inputs

    @classmethod
    def of_inputs(cls, energies: Sequence[StrainEnergy], inputs: Sequence[Any]) -> "LayeredTube":
        """Return a tube of these materials with other :attr:`inputs`."""
        geometry, rest = dict(zip(UNLOADED, inputs, strict=False)), inputs[len(UNLOADED) :]
        inner, layers = geometry["inner_radius"], []
        for energy in energies:
            outer, *entries = rest[: 1 + len(energy.entry_names)]
            layers.append(ReferenceLayer(energy, inner, outer, entries))
            inner, rest = outer, rest[1 + len(entries) :]
        return cls(layers, geometry)

    @property
    def unloaded(self) -> dict[str, Any]:
        """The measures in UNLOADED, on which the current radii of all circles depend."""
        return {name: self.geometry[name] for name in UNLOADED}

    def current(self, reference: Any, radius: Any) -> Any:
        """Return the current radii of circles of these reference radii, at an internal radius."""
        return current_radius(reference, radius, **self.unloaded)


def tube_of(
    energy: StrainEnergy | Sequence[Layer], reference: Sequence[Any], parameters: Mapping[str, Any]
) -> LayeredTube:
    """Return the tube of one material or of layers.

    `reference` holds the reference tube in the order of GEOMETRY. For layers its outer radius is
    None, and `parameters` is empty. Raise TypeError for any other input.
    """
    inner, outer, axial_stretch, opening_angle = map(double, reference)
    geometry = dict(zip(UNLOADED, (inner, axial_stretch, opening_angle), strict=True))
    if not isinstance(energy, Sequence):
        check_energy(energy)
        if outer is None:
            raise TypeError("outer_radius is missing: the reference outer radius of the tube, mm")
        return LayeredTube(
            [ReferenceLayer(energy, inner, outer, energy.split(parameters))], geometry
        )
    check_layers(energy)
    if outer is not None or parameters:
        given = ["outer_radius"] * (outer is not None) + sorted(parameters)
        raise TypeError(
            f"{given} cannot be given with layers: each layer has its own thickness and parameters"
        )
    layers = []
    for layer in energy:
        outer = inner + double(layer.thickness)
        entries = layer.energy.split(layer.parameters)
        layers.append(ReferenceLayer(layer.energy, inner, outer, entries))
        inner = outer
    return LayeredTube(layers, geometry)


def double(value: Any) -> Any:
    """Return numbers in double precision: PyTensor reads the number 7.0 as single precision."""
    return value if value is None or isinstance(value, Variable) else np.asarray(value, float)


def check_geometry(**geometry: Any) -> None:
    """Raise TypeError or ValueError for impossible numbers; skip variables and None."""
    numbers: dict[str, np.ndarray] = {}
    for name, given in geometry.items():
        if given is None or isinstance(given, Variable):
            continue
        try:
            value = numbers[name] = np.asarray(given, float)
        except (TypeError, ValueError):
            expected = "expected a number or an array of numbers"
            raise TypeError(f"{name} is {given!r}; {expected}") from None
        if name != "opening_angle" and not np.all((value > 0) & (value < np.inf)):
            raise ValueError(f"{name} must be positive and finite; got {value}")
    inner, outer = numbers.get("inner_radius", 0.0), numbers.get("outer_radius", np.inf)
    if not np.all(outer > inner):
        raise ValueError(f"outer_radius must exceed inner_radius; got {outer} and {inner}")
    if not np.all(np.abs(numbers.get("opening_angle", 0.0)) < 2 * np.pi):
        raise ValueError(
            f"opening_angle must be in radians and below 2π; got {numbers['opening_angle']}. "
            "Convert degrees by np.deg2rad(angle)"
        )


def check_layers(layers: Sequence[Any]) -> None:
    """Raise TypeError unless `layers` is a sequence of at least one :class:`Layer`."""
    if isinstance(layers, str):  # a sequence, too
        check_energy(layers)
    others = [layer for layer in layers if not isinstance(layer, Layer)]
    if others or not layers:
        raise TypeError(
            f"a list of layers holds {others[0] if others else 'nothing'!r}; expected layers such "
            "as ph.Layer(ph.NeoHookean(), 0.3, mu=20.0)"
        )


def check_energy(energy: Any) -> None:
    """Raise TypeError unless `energy` is a strain energy."""
    if isinstance(energy, StrainEnergy):
        return
    hint = " (call the class)" if isinstance(energy, type) else ""
    if isinstance(energy, list | tuple):
        hint = (
            ": only curves, ph.inflation_model, ph.population_model and predictions accept layers"
        )
    raise TypeError(f"expected a strain energy such as ph.Ogden(), got {energy!r}{hint}")
