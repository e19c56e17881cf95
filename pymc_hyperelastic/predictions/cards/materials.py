"""What a card is of: a material in the unit system of a finite-element model."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from pymc_hyperelastic.mechanics import strain_energy as laws
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy

Values = Mapping[str, Any]
"""Parameters of a law by name, vectors as tuples."""

# By how much the wall is stiffer against a change of its volume than of its shape: a Poisson ratio
# of 0.4995, at which tubes have lost little of their volume and elements still converge.
_BULK_TO_SHEAR = 1000.0


class Units(NamedTuple):
    """A consistent system of units, in which stress is force per square millimetre."""

    stress: str
    per_kpa: float
    """How many kPa one unit of stress is."""
    words: str


UNITS = {
    "kPa": Units("kPa", 1.0, "mm, mN, kg, s, kPa; a density of 1060 kg/m3 is 1.06e-6 kg/mm3"),
    "MPa": Units("MPa", 1e3, "mm, N, t, s, MPa; a density of 1060 kg/m3 is 1.06e-9 t/mm3"),
}


class Material(NamedTuple):
    """One material of a card."""

    name: str
    energy: StrainEnergy
    values: dict[str, Any]
    """In the unit system of the card; angles in degrees."""
    bulk_modulus: float
    notes: list[str]
    """What a comment says of it."""


class CodeLaw(NamedTuple):
    """What a code makes of a law."""

    formula: str
    """The energy as the code has it."""
    write: Callable[..., Any]
    """From the parameters and the bulk modulus, what stands in the card."""


class Code(NamedTuple):
    """A finite-element code."""

    label: str
    laws: dict[type[StrainEnergy], CodeLaw]
    reasons: dict[type[StrainEnergy], str]
    """Why it does not have others."""
    write: Callable[[list[str], list[Material]], str]
    """The card, of paragraphs that stand above it and of materials."""


_TWO_DIMENSIONS = (
    "its energy says nothing of radial strain and of shear, for which such a code needs moduli"
)
SILENT_LAWS: dict[type[StrainEnergy], str] = {
    laws.FungOrthotropic: _TWO_DIMENSIONS,
    laws.CriscioneType: _TWO_DIMENSIONS,
}
"""Laws that are enough for a tube, and no material of a code."""


def in_units(energy: StrainEnergy, values: Values, units: Units) -> dict[str, Any]:
    """Parameters in a system of units."""
    found = {}
    for p in energy.parameters:
        value = np.asarray(values[p.name], float) / (units.per_kpa if p.unit == "kPa" else 1.0)
        found[p.name] = value.item() if p.size is None else tuple(value.tolist())
    return found


def stiffness_at_rest(energy: StrainEnergy, values: Values) -> float:
    r"""Small-strain shear modulus, to which fibres add ``4 k1``.

    That is the second derivative of a family's energy by its stretch where it starts to bear load.

    Raises
    ------
    ValueError
        If it is not positive: such a solid has no shape of its own.
    """
    stiffness = float(_STIFFNESS[type(energy)](values))
    if not stiffness > 0:
        raise ValueError(
            f"{energy.name} with {_listed(values)} has the shear modulus {stiffness:.6g}; a "
            "material of a finite-element model needs a positive one: another point, or draws"
        )
    return stiffness


def bulk_modulus_of(energy: StrainEnergy, values: Values, given: float | None) -> float:
    """The bulk modulus: as it is given, else so large that the volume hardly changes."""
    stiffness = stiffness_at_rest(energy, values)
    return _BULK_TO_SHEAR * stiffness if given is None else given


def check_positive(name: str, values: Iterable[float], why: str) -> None:
    """Raise ValueError unless all values are positive."""
    for value in values:
        if not value > 0:
            raise ValueError(f"{name} is {value:.6g}; {why}")


def _listed(values: Values) -> str:
    return ", ".join(f"{name} = {value}" for name, value in values.items())


def _series_of_chains(v: Values) -> float:
    """``2 dW/dI1`` of the Arruda-Boyce solid at rest."""
    relative = 3 / v["lock"] ** 2
    return 2 * v["mu"] * sum(i * c * relative ** (i - 1) for i, c in enumerate(LANGEVIN, start=1))


# The printed series of the inverse Langevin function, once more as the codes have it.
LANGEVIN = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)

_STIFFNESS: dict[type[StrainEnergy], Callable[[Values], float]] = {
    laws.NeoHookean: lambda v: v["mu"],
    laws.MooneyRivlin: lambda v: 2 * (v["c10"] + v["c01"]),
    laws.Yeoh: lambda v: 2 * v["c1"],
    laws.Gent: lambda v: v["mu"],
    laws.Demiray: lambda v: v["mu"],
    laws.PowerLawNeoHookean: lambda v: v["mu"],
    laws.ArrudaBoyce: _series_of_chains,
    laws.Ogden: lambda v: 2 * v["mu"],
    laws.OgdenSeries: lambda v: np.dot(v["mu"], v["alpha"]) / 2,
    laws.HolzapfelGasserOgden: lambda v: v["c"] + 4 * v["k1"],
    laws.GasserOgdenHolzapfel: lambda v: v["c"] + 4 * v["k1"],
    laws.FourFiber: lambda v: v["c"] + 4 * max(x for name, x in v.items() if name[:2] == "k1"),
}
