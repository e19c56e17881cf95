"""A table of inflated tubes with known answers, and the materials that they are made of.

A new strain energy needs one row in `LAWS`: the class, its energy written once more in
`tests.oracles`, and parameters. It is then inflated in every tube of `TUBES`, at every set of
parameters, and compared with adaptive quadrature in pressure, stiffness and gradient.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import radians

import oracles

import pymc_hyperelastic as ph


@dataclass(frozen=True)
class Law:
    """A strain energy, the oracle that knows its answers, and parameters, each with its reason."""

    strain_energy: ph.StrainEnergy
    energy: oracles.Energy
    parameters: tuple[tuple[Mapping[str, float], str], ...]  # the first set is the ordinary one


LAWS = {
    "PowerLawNeoHookean": Law(
        ph.PowerLawNeoHookean(),
        oracles.power_law_neo_hookean_energy,
        (
            ({"mu": 20.0, "n": 4.0}, "a stiffening artery"),
            ({"mu": 20.0, "n": 1.0}, "the neo-Hookean solid, which has a closed form"),
            ({"mu": 20.0, "n": 0.3}, "end of the prior: softens, with a falling pressure"),
            ({"mu": 20.0, "n": 30.0}, "end of the prior: almost exponential"),
            ({"mu": 1e-3, "n": 0.5}, "a solid as soft as jelly, which softens"),
        ),
    ),
    "Ogden": Law(
        ph.Ogden(),
        oracles.ogden_energy,
        (
            ({"mu": 6.0, "alpha": 8.0}, "an artery"),
            ({"mu": 6.0, "alpha": 0.0}, "the limit of an energy that reads 0/0"),
            ({"mu": 6.0, "alpha": 1e-12}, "almost 0: the printed energy cancels to nothing"),
            ({"mu": 6.0, "alpha": -1e-12}, "almost 0 from below"),
            ({"mu": 6.0, "alpha": 0.3}, "the series of sinh(x)/x ends within the wall"),
            ({"mu": 6.0, "alpha": 2.0}, "a Mooney-Rivlin solid"),
            ({"mu": 6.0, "alpha": 25.0}, "steep"),
            ({"mu": 6.0, "alpha": -25.0}, "steep; the energy is even"),
        ),
    ),
    "CriscioneType": Law(
        ph.CriscioneType(),
        oracles.criscione_type_energy,
        (
            ({"a": 3.0, "b": 4.0}, "an artery"),
            ({"a": 3.0, "b": 0.0}, "no stress at all"),
            ({"a": 3.0, "b": 1e-12}, "almost no stress"),
            ({"a": 3.0, "b": -1e-12}, "almost no stress, from below"),
            ({"a": 3.0, "b": 20.0}, "end of the prior"),
            ({"a": 3.0, "b": -20.0}, "end of the prior; the energy is even"),
            ({"a": 3.0, "b": 25.0}, "steeper than the prior allows"),
            ({"a": 3.0, "b": -25.0}, "steeper than the prior allows"),
        ),
    ),
}


@dataclass(frozen=True)
class Tube:
    """Geometry of an inflated tube (mm, degrees) and the reason why it is in the table."""

    name: str
    internal_radius: float
    inner_radius: float
    outer_radius: float
    axial_stretch: float
    opening_angle: float
    why: str
    hard: bool = False  # taken with every set of parameters, not only with the ordinary one


TUBES = (
    Tube("at rest", 7.0, 7.0, 9.0, 1.0, 0.0, "zero pressure exactly"),
    Tube("just inflated", 7.0 * (1 + 1e-9), 7.0, 9.0, 1.0, 0.0, "0/0 in many forms", hard=True),
    Tube("just deflated", 7.0 * (1 - 1e-9), 7.0, 9.0, 1.0, 0.0, "0/0 from below", hard=True),
    Tube("inflated", 8.4, 7.0, 9.0, 1.0, 0.0, "a sheep aorta at work, a = 1.2 A"),
    Tube("inflated far", 11.9, 7.0, 9.0, 1.0, 0.0, "a = 1.7 A"),
    Tube("deflated", 5.6, 7.0, 9.0, 1.0, 0.0, "a = 0.8 A, pressure outside"),
    Tube("deflated far", 4.2, 7.0, 17.5, 1.0, 0.0, "a = 0.6 A in the thickest wall", hard=True),
    Tube("thin", 0.52, 0.4, 0.42, 1.0, 0.0, "B/A = 1.05, a mouse's vessel"),
    Tube("thick", 1.7, 1.0, 2.5, 1.0, 0.0, "B/A = 2.5, a = 1.7 A", hard=True),
    Tube("thick, a little", 1.05, 1.0, 2.5, 1.0, 0.0, "B/A = 2.5, a = 1.05 A"),
    Tube("stretched", 0.5, 0.4, 0.5, 1.9, 0.0, "axial stretch 1.9"),
    Tube("stretched, unpressurised", 7.0, 7.0, 9.0, 1.3, 0.0, "axial stretch at a = A"),
    Tube("shortened", 8.0, 7.0, 9.0, 0.8, 0.0, "axial stretch 0.8"),
    Tube("shortened, deflated", 6.0, 7.0, 12.0, 0.8, 0.0, "axial stretch 0.8 with a < A"),
    Tube("opened", 0.36, 0.4, 0.55, 1.0, 60.0, "opening angle 60 degrees with a < A"),
    Tube("opened wide", 3.2, 3.0, 4.0, 1.0, 160.0, "opening angle 160 degrees"),
    Tube("in vivo", 0.48, 0.4, 0.52, 1.5, 90.0, "axial stretch and residual stress", hard=True),
    Tube("extreme", 1.7, 1.0, 2.5, 1.9, 160.0, "every end at once", hard=True),
    Tube("extreme, shortened", 1.7, 1.0, 2.5, 0.8, 160.0, "every end, the other axial one"),
)


@dataclass(frozen=True)
class Problem:
    """One tube of one material; the exact answer comes from `oracles`."""

    name: str
    law: str
    parameters: Mapping[str, float]
    internal_radius: float
    inner_radius: float
    outer_radius: float
    axial_stretch: float
    opening_angle: float
    """Degrees, as it is measured."""
    why: str

    @property
    def inputs(self) -> dict[str, float]:
        """Inputs of the integral in the Op's order, the angle in radians, parameters last."""
        geometry = {name: getattr(self, name) for name in oracles.GEOMETRY}
        return {**geometry, "opening_angle": radians(self.opening_angle), **self.parameters}

    def exact(self, *by: str) -> float:
        """Return the pressure, or its derivative by the named inputs."""
        return oracles.tube_derivative(LAWS[self.law].energy, self.inputs, *by)


def _problem(law: str, tube: Tube, parameters: Mapping[str, float], why: str) -> Problem:
    values = ", ".join(f"{name} = {value:g}" for name, value in parameters.items())
    return Problem(
        f"{law}, {values}, {tube.name}",
        law,
        parameters,
        *(getattr(tube, name) for name in oracles.GEOMETRY),
        f"{why}; {tube.why}",
    )


PROBLEMS = tuple(
    _problem(name, tube, parameters, why)
    for name, law in LAWS.items()
    for i, (parameters, why) in enumerate(law.parameters)
    for tube in TUBES
    if i == 0 or tube.hard
)
