"""Walls of one material or of several layers, as a list of concentric tubes.

Wall integrals add up over these tubes. Public functions check here what users give them.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from pytensor.graph.basic import Variable

from pymc_hyperelastic.mechanics.strain_energy.base import StrainEnergy
from pymc_hyperelastic.mechanics.tube import GEOMETRY, UNLOADED, current_radius


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
        unknown = sorted(set(parameters) - set(energy.parameter_names))
        if unknown:
            raise TypeError(
                f"{energy.name} has the parameters {list(energy.parameter_names)}, not {unknown}"
            )
        check_geometry(thickness=thickness)
        self.energy, self.thickness, self.parameters = energy, thickness, parameters

    def __repr__(self) -> str:
        settings = ", ".join(f"{name}={value!r}" for name, value in self.parameters.items())
        return f"Layer({self.energy!r}, {self.thickness!r}, {settings})"


class Tube(NamedTuple):
    """A tube of one material: the inputs of an integral over its wall."""

    energy: StrainEnergy
    """Strain energy of the material."""
    geometry: tuple[Any, ...]
    """Current internal radius, then the reference tube in the order of GEOMETRY."""
    entries: list[Any]
    """Entries of the material parameters, see :meth:`StrainEnergy.split`."""
    within: bool = False
    """True for all layers of a wall except the innermost."""

    @property
    def radius(self) -> Any:
        """Current internal radius, mm."""
        return self.geometry[0]

    @property
    def inputs(self) -> tuple[Any, ...]:
        """Geometry and entries of the parameters, in the order of a wall integral's inputs."""
        return *self.geometry, *self.entries


def tubes_of(
    energy: StrainEnergy | Sequence[Layer],
    internal_radius: Any,
    reference: Sequence[Any],
    parameters: Mapping[str, Any],
) -> list[Tube]:
    """Return the concentric tubes of a wall of one material or of layers, from the inside out.

    `reference` holds the reference tube in the order of GEOMETRY. For layers its outer radius is
    None, and `parameters` is empty. Raise TypeError for any other input.
    """
    inner_radius, outer_radius, axial_stretch, opening_angle = reference
    if isinstance(energy, str) or not isinstance(energy, Sequence):
        check_energy(energy)
        if outer_radius is None:
            raise TypeError("outer_radius is missing: the reference outer radius of the tube, mm")
        return [Tube(energy, (internal_radius, *reference), energy.split(parameters))]
    check_layers(energy)
    if outer_radius is not None or parameters:
        given = ["outer_radius"] * (outer_radius is not None) + sorted(parameters)
        raise TypeError(
            f"{given} cannot be given with layers: each layer has its own thickness and parameters"
        )
    measures = map(_number_or_variable, (inner_radius, axial_stretch, opening_angle))
    unloaded = dict(zip(UNLOADED, measures, strict=True))
    current = internal_radius = _number_or_variable(internal_radius)
    inner, tubes = unloaded["inner_radius"], list[Tube]()
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
    """Return the tubes of :func:`tubes_of`, after :func:`check_geometry`."""
    geometry = dict(zip(GEOMETRY, reference, strict=True))
    check_geometry(internal_radius=internal_radius, **geometry)
    return tubes_of(energy, internal_radius, reference, parameters)


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
    if {"inner_radius", "outer_radius"} <= set(numbers) and not np.all(
        numbers["outer_radius"] > numbers["inner_radius"]
    ):
        raise ValueError(
            f"outer_radius must exceed inner_radius; got {numbers['outer_radius']} and "
            f"{numbers['inner_radius']}"
        )
    if not np.all(np.abs(numbers.get("opening_angle", 0.0)) < 2 * np.pi):
        raise ValueError(
            f"opening_angle must be in radians and below 2π; got {numbers['opening_angle']}. "
            "Convert degrees by np.deg2rad(angle)"
        )


def check_layers(layers: Sequence[Any]) -> None:
    """Raise TypeError unless `layers` is a sequence of at least one :class:`Layer`."""
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


def _number_or_variable(value: Any) -> Any:
    return value if isinstance(value, Variable) else np.asarray(value, float)
