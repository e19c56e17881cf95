"""Materials in the unit system of a finite-element model, and the interface of the codes."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from pymc_hyperelastic.mechanics import strain_energy as laws
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy

Values = Mapping[str, Any]
"""Parameters of a law by name, vectors as tuples."""

# Default ratio of the bulk modulus to the stiffness at rest. It gives a Poisson ratio of 0.4995:
# the volume hardly changes, and elements still converge.
_BULK_TO_SHEAR = 1000.0


class Units(NamedTuple):
    """A consistent system of units, in which stress is force per square millimetre."""

    stress: str
    per_kpa: float
    """Number of kPa in one unit of stress."""
    words: str
    """Units of the system, for the header of the card."""


UNITS = {
    "kPa": Units("kPa", 1.0, "mm, mN, kg, s, kPa; a density of 1060 kg/m3 is 1.06e-6 kg/mm3"),
    "MPa": Units("MPa", 1e3, "mm, N, t, s, MPa; a density of 1060 kg/m3 is 1.06e-9 t/mm3"),
}


class Material(NamedTuple):
    """One material of a card."""

    name: str
    energy: StrainEnergy
    values: dict[str, Any]
    """Parameters in the unit system of the card; angles in degrees."""
    bulk_modulus: float
    notes: list[str]
    """Paragraphs of the comment above the material."""


class CodeLaw(NamedTuple):
    """A law as a finite-element code has it."""

    formula: str
    """Strain energy in the notation of the code."""
    write: Callable[..., Any]
    """Function of parameters and bulk modulus that returns the entry of the card."""


class Code(NamedTuple):
    """A finite-element code."""

    label: str
    laws: dict[type[StrainEnergy], CodeLaw]
    reasons: dict[type[StrainEnergy], str]
    """Reasons why the code does not have other laws."""
    write: Callable[[list[str], list[Material]], str]
    """Function of the header's paragraphs and the materials that returns the text of the card."""


# Reason why no code has these laws.
_TWO_DIMENSIONS = (
    "its energy does not depend on radial strain and shear, for which such a code needs moduli"
)
SILENT_LAWS: dict[type[StrainEnergy], str] = {
    laws.FungOrthotropic: _TWO_DIMENSIONS,
    laws.CriscioneType: _TWO_DIMENSIONS,
}
"""Laws that describe a tube only, so that no code has them, with the reason."""


def in_units(energy: StrainEnergy, values: Values, units: Units) -> dict[str, Any]:
    """Return the parameters in a system of units."""
    found = {}
    for p in energy.parameters:
        value = np.asarray(values[p.name], float) / (units.per_kpa if p.unit == "kPa" else 1.0)
        found[p.name] = value.item() if p.size is None else tuple(value.tolist())
    return found


def stiffness_at_rest(energy: StrainEnergy, values: Values) -> float:
    r"""Return the small-strain shear modulus, plus ``4 k1`` with fibres.

    ``4 k1`` is the second derivative of a fibre family's energy by its stretch, at the stretch
    where it starts to bear load.

    Raises
    ------
    ValueError
        If the stiffness is not positive, so that the solid is unstable at rest.
    """
    stiffness = float(_STIFFNESS[type(energy)](values))
    if not stiffness > 0:
        raise ValueError(
            f"{energy.name} with {_listed(values)} has the shear modulus {stiffness:.6g}; a "
            "finite-element model needs a positive one: choose another point or other draws"
        )
    return stiffness


def bulk_modulus_of(energy: StrainEnergy, values: Values, given: float | None) -> float:
    """Return the given bulk modulus, or 1000 times the stiffness at rest."""
    stiffness = stiffness_at_rest(energy, values)
    return _BULK_TO_SHEAR * stiffness if given is None else given


def check_positive(name: str, values: Iterable[float], why: str) -> None:
    """Raise ValueError, with the reason `why`, unless all values are positive."""
    for value in values:
        if not value > 0:
            raise ValueError(f"{name} is {value:.6g}; expected a positive number, because {why}")


def _listed(values: Values) -> str:
    return ", ".join(f"{name} = {value}" for name, value in values.items())


def _series_of_chains(v: Values) -> float:
    """Return the shear modulus ``2 dW/dI1`` of the Arruda-Boyce solid at rest."""
    relative = 3 / v["lock"] ** 2
    return 2 * v["mu"] * sum(i * c * relative ** (i - 1) for i, c in enumerate(LANGEVIN, start=1))


# Coefficients of the series of the inverse Langevin function in the energy of Arruda and Boyce, as
# printed in the manuals of the codes.
LANGEVIN = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)

# Stiffness at rest of each law, as a function of its parameters.
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
