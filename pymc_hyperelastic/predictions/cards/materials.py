"""Materials in the unit system of a finite-element model, and the interface of the codes."""

from collections.abc import Callable, Mapping, Sequence
from math import inf
from textwrap import wrap
from typing import Any, NamedTuple

import numpy as np

from pymc_hyperelastic.data.units import to_internal
from pymc_hyperelastic.mechanics import strain_energy as laws
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy

Values = Mapping[str, Any]
"""Parameters of a law by name, vectors as tuples."""

# Consistent systems of units, in which stress is force per square millimetre, by the unit of
# stress, and the words about them in the header of a card.
UNITS = {
    "kPa": "mm, mN, kg, s, kPa; a density of 1060 kg/m3 is 1.06e-6 kg/mm3",
    "MPa": "mm, N, t, s, MPa; a density of 1060 kg/m3 is 1.06e-9 t/mm3",
}
# Terms of Ogden's law, at most: a limit of Abaqus and of FEBio.
_MOST_TERMS = 6


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


def in_units(energy: StrainEnergy, values: Values, unit: str) -> dict[str, Any]:
    """Return the parameters with stresses in another unit than kPa."""
    found = {}
    for p in energy.parameters:
        value = np.asarray(values[p.name], float)
        if p.unit == "kPa":
            value = value / to_internal(1.0, unit, "pressure")
        found[p.name] = value.item() if p.size is None else tuple(value.tolist())
    return found


def bulk_modulus_of(energy: StrainEnergy, values: Values, given: float | None) -> float:
    """Return the given bulk modulus, or 1000 times the stiffness at rest.

    The factor 1000 gives a Poisson ratio of 0.4995: the volume hardly changes, and elements still
    converge.

    Raises
    ------
    ValueError
        If the stiffness is not positive, so that the solid is unstable at rest, or if the given
        bulk modulus is so small that the solid is compressible.
    """
    stiffness = _stiffness_at_rest(energy, values)
    if not stiffness > 0:
        listed = ", ".join(f"{name} = {value}" for name, value in values.items())
        raise ValueError(
            f"{energy.name} with {listed} has the shear modulus {stiffness:.6g}; a "
            "finite-element model needs a positive one: choose another point or other draws"
        )
    if given is not None and given < 10 * stiffness:
        raise ValueError(
            f"the bulk modulus is {given:g}, less than 10 times the stiffness at rest of "
            f"{energy.name}, {stiffness:.4g} in the same unit; the volume would not stay nearly "
            "constant, as the fit assumes: is it in another unit?"
        )
    return 1000.0 * stiffness if given is None else given


def check_positive(name: str, value: float, why: str) -> None:
    """Raise ValueError, with the reason `why`, unless a value is positive."""
    if not value > 0:
        raise ValueError(f"{name} is {value:.6g}; expected a positive number, because {why}")


def check_range(code: str, name: str, value: float, high: float = inf) -> None:
    """Raise ValueError unless a value is from 0 to `high`."""
    if not 0 <= value <= high:
        raise ValueError(f"{name} is {value:.6g}; {code} takes values from 0 to {high:.6g}")


def check_ogden(code: str, terms: Sequence[tuple[float, float]]) -> None:
    """Raise ValueError unless a code accepts the moduli and exponents of Ogden's law."""
    if len(terms) > _MOST_TERMS:
        raise ValueError(
            f"{code} has at most {_MOST_TERMS} terms of Ogden's law; the material has {len(terms)}"
        )
    if not all(exponent for _, exponent in terms):
        raise ValueError(f"an exponent of Ogden's law is 0, by which {code} divides")


def lines_of(paragraphs: list[str]) -> list[str]:
    """Return the lines of a comment."""
    return [line for text in paragraphs for line in wrap(text)]


def _stiffness_at_rest(energy: StrainEnergy, v: Values) -> float:
    """Return the small-strain shear modulus ``2 dW/dI1``, plus ``4 k1`` with fibres.

    ``4 k1`` is the second derivative of a fibre family's energy by its stretch, at the stretch
    where it starts to bear load.
    """
    match energy:
        case laws.NeoHookean() | laws.Gent() | laws.Demiray() | laws.PowerLawNeoHookean():
            return v["mu"]
        case laws.MooneyRivlin():
            return 2 * (v["c10"] + v["c01"])
        case laws.Yeoh():
            return 2 * v["c1"]
        case laws.ArrudaBoyce():
            terms = enumerate(energy.coefficients, start=1)
            return 2 * v["mu"] * sum(i * c * (3 / v["lock"] ** 2) ** (i - 1) for i, c in terms)
        case laws.Ogden():
            return 2 * v["mu"]
        case laws.OgdenSeries():
            return float(np.dot(v["mu"], v["alpha"])) / 2
    return v["c"] + 4 * max(x for name, x in v.items() if name[:2] == "k1")
