"""A wall as a sequence of layers, each a tube within the tube."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from pytensor.graph.basic import Variable

from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.tube import GEOMETRY, current_radius

_NO_LAYERS = (
    ": walls of layers are for curves, ph.inflation_model, ph.population_model and predictions"
)


class Layer:
    """One layer of a wall: a material, its thickness and its parameters.

    A list of layers, from the inside out, takes the place of the strain energy and the outer radius
    in :func:`~pymc_hyperelastic.inflation_pressure`,
    :func:`~pymc_hyperelastic.inflation_stiffness`, :func:`~pymc_hyperelastic.axial_force` and
    :func:`~pymc_hyperelastic.inflation_model`. All layers are free of stress in the same opened
    tube.

    Parameters
    ----------
    energy : StrainEnergy
        The material.
    thickness : tensor_like
        Thickness in the reference tube, mm.
    **parameters : tensor_like
        The material parameters by name. In a model distributions are inferred, also that of a
        thickness; one distribution in two layers is one parameter of both; and what is missing has
        its default prior.

    Raises
    ------
    TypeError
        If `energy` is no strain energy, or a parameter is unknown.
    ValueError
        If a number given as thickness is not positive.

    See Also
    --------
    inflation_pressure, Measured

    Examples
    --------
    >>> import pymc_hyperelastic as ph
    >>> media = ph.Layer(ph.NeoHookean(), 0.26, mu=30.0)
    >>> adventitia = ph.Layer(ph.Demiray(), 0.13, mu=3.0, b=2.0)
    >>> pressure = ph.inflation_pressure([media, adventitia], 1.6, inner_radius=1.43)
    >>> round(float(pressure.eval()), 3)
    1.671
    """

    def __init__(self, energy: StrainEnergy, thickness: Any, **parameters: Any) -> None:
        check_energy(energy)
        strangers = sorted(set(parameters) - set(energy.parameter_names))
        if strangers:
            raise TypeError(
                f"{energy.name} has the parameters {list(energy.parameter_names)}, not {strangers}"
            )
        if not isinstance(thickness, Variable) and not np.all(np.asarray(thickness, float) > 0):
            raise ValueError(f"thickness must be positive; got {thickness}")
        self.energy = energy
        self.thickness = thickness
        self.parameters = parameters

    def __repr__(self) -> str:
        settings = ", ".join(f"{name}={value!r}" for name, value in self.parameters.items())
        return f"Layer({self.energy!r}, {self.thickness!r}, {settings})"


class Tube(NamedTuple):
    """A tube of one material: inputs of an integral over its wall."""

    energy: StrainEnergy
    geometry: tuple[Any, ...]
    """Internal, inner and outer radius, axial stretch, opening angle."""
    entries: list[Any]
    """Entries of the parameters."""
    within: bool = False
    """Whether it lies around another one."""

    @property
    def radius(self) -> Any:
        """Current internal radius."""
        return self.geometry[0]

    @property
    def inputs(self) -> tuple[Any, ...]:
        """Geometry and parameters, as an integral takes them."""
        return *self.geometry, *self.entries


def tubes_of(
    energy: StrainEnergy | Sequence[Layer],
    internal_radius: Any,
    reference: Sequence[Any],
    parameters: Mapping[str, Any],
) -> list[Tube]:
    """The tubes, one within the other, that make up a wall of one material or of layers.

    `reference` states the tube in the order of GEOMETRY; with layers its outer radius is None.
    Raises TypeError for what is no such wall, and for parameters that are not those of its law.
    """
    inner_radius, outer_radius, axial_stretch, opening_angle = reference
    if isinstance(energy, str) or not isinstance(energy, Sequence):
        check_energy(energy)
        if outer_radius is None:
            raise TypeError("outer_radius is missing: the reference outer radius of the tube, mm")
        return [Tube(energy, (internal_radius, *reference), energy.split(parameters))]
    check_layers(energy)
    if outer_radius is not None or parameters:
        given = [*(["outer_radius"] if outer_radius is not None else []), *sorted(parameters)]
        raise TypeError(f"{given} cannot be given with layers: each has its own thickness and law")
    unloaded = {
        "inner_radius": _number_or_variable(inner_radius),
        "axial_stretch": _number_or_variable(axial_stretch),
        "opening_angle": _number_or_variable(opening_angle),
    }
    internal_radius = _number_or_variable(internal_radius)
    tubes: list[Tube] = []
    inner, current = unloaded["inner_radius"], internal_radius
    for layer in energy:
        outer = inner + _number_or_variable(layer.thickness)
        geometry = (current, inner, outer, axial_stretch, opening_angle)
        entries = layer.energy.split(layer.parameters)
        tubes.append(Tube(layer.energy, geometry, entries, within=bool(tubes)))
        inner, current = outer, current_radius(outer, internal_radius, **unloaded)
    return tubes


def checked_tubes(
    energy: StrainEnergy | Sequence[Layer],
    internal_radius: Any,
    reference: Sequence[Any],
    parameters: Mapping[str, Any],
) -> list[Tube]:
    """The tubes that make up a wall, see :func:`tubes_of`, after a check of given numbers."""
    known = dict(zip(GEOMETRY, reference, strict=True))
    if known["outer_radius"] is None:
        del known["outer_radius"]
    check_geometry(internal_radius=internal_radius, **known)
    return tubes_of(energy, internal_radius, reference, parameters)


def check_geometry(**geometry: Any) -> None:
    """Raise for impossible numbers; random variables have no value to look at yet."""
    known = {
        name: _as_numbers(name, value)
        for name, value in geometry.items()
        if not isinstance(value, Variable)
    }
    for name, value in known.items():
        if name != "opening_angle" and not np.all((value > 0) & (value < np.inf)):
            raise ValueError(f"{name} must be positive and finite; got {value}")
    if {"inner_radius", "outer_radius"} <= set(known) and not np.all(
        known["outer_radius"] > known["inner_radius"]
    ):
        raise ValueError(
            f"outer_radius must exceed inner_radius; got {known['outer_radius']} and "
            f"{known['inner_radius']}"
        )
    if not np.all(np.abs(known.get("opening_angle", 0.0)) < 2 * np.pi):
        raise ValueError(
            f"opening_angle is in radians and below 2π; got {known['opening_angle']} (from "
            "degrees: np.deg2rad(angle))"
        )


def _as_numbers(name: str, value: Any) -> np.ndarray:
    try:
        return np.asarray(value, float)
    except (TypeError, ValueError):
        raise TypeError(f"{name} is {value!r}; expected a number or an array of numbers") from None


def check_layers(layers: Sequence[Any]) -> None:
    """Raise TypeError unless these are layers."""
    strangers = [layer for layer in layers if not isinstance(layer, Layer)]
    if strangers or not layers:
        raise TypeError(
            "a wall is a strain energy or a list of layers such as ph.Layer(ph.NeoHookean(), 0.3, "
            f"mu=20.0); this list holds {strangers[0] if strangers else 'nothing'!r}"
        )


def _number_or_variable(value: Any) -> Any:
    return value if isinstance(value, Variable) else np.asarray(value, float)


def check_energy(energy: Any) -> None:
    """Raise TypeError unless `energy` is a strain energy."""
    if not isinstance(energy, StrainEnergy):
        raise TypeError(
            f"a strain energy such as ph.Ogden() is needed, not {energy!r}"
            + (" (call the class)" if isinstance(energy, type) else "")
            + (_NO_LAYERS if isinstance(energy, list | tuple) else "")
        )
