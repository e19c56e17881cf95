"""Write materials as keyword lines of Abaqus; CalculiX also reads those of isotropic laws.

Sources: for the strain energies, Abaqus Analysis User's Guide, "Hyperelastic behavior of rubberlike
materials" and "Anisotropic hyperelastic behavior"; for the keywords, Abaqus Keywords Guide,
``*HYPERELASTIC``, ``*ANISOTROPIC HYPERELASTIC`` and ``*ORIENTATION``; for the format of lines,
"Input syntax rules"; CalculiX CrunchiX User's Manual, ``*HYPERELASTIC``.
"""

from collections.abc import Sequence
from itertools import batched
from math import cos, radians, sin
from typing import Any, NamedTuple

from pymc_hyperelastic.mechanics import strain_energy as laws
from pymc_hyperelastic.predictions.cards.materials import (
    SILENT_LAWS,
    Code,
    CodeLaw,
    Material,
    check_ogden,
    check_positive,
    check_range,
    lines_of,
)

# Volumetric energy of most laws.
_VOLUME = " + 1/D1 (J - 1)^2"
# Volumetric energy of the Arruda-Boyce and Holzapfel laws.
_VOLUME_LOG = " + 1/D [(J^2 - 1)/2 - ln J]"


class _Option(NamedTuple):
    """A keyword line, its data, and the angle of its fibres."""

    keyword: str
    data: list[float]
    angle: float | None = None
    """Angle between fibres and circumferential direction, degrees; None without fibres."""


def number(x: float) -> str:
    """Format a number with as many digits as fit in a field, which has at most 20 characters.

    Most numbers read back exactly; numbers below 0.01 keep at least 14 digits.

    Examples
    --------
    >>> number(12.345678901234567), number(0.00012345678901234567)
    ('12.345678901234567', '1.234567890123457E-4')
    """
    text = repr(float(x)).upper()
    if "." not in text:
        text = text.replace("E", ".0E")
    for digits in range(16, 0, -1):
        if len(text) <= 20:
            break
        mantissa, exponent = f"{x:.{digits}E}".split("E")
        text = f"{mantissa}E{int(exponent)}"
    return text


def _ogden(terms: Sequence[tuple[float, float]], d: float) -> _Option:
    """Return the option for ``Σ 2 μi/αi² (...)``, from pairs of modulus and exponent."""
    check_ogden("Abaqus", terms)
    data = [x for term in terms for x in term] + [d] + [0.0] * (len(terms) - 1)
    return _Option(f"*HYPERELASTIC, OGDEN, N={len(terms)}", data)


def _neo_hooke(v: Any, d: float) -> _Option:
    return _Option("*HYPERELASTIC, NEO HOOKE", [v["mu"] / 2, d])


def _yeoh(v: Any, d: float) -> _Option:
    return _Option("*HYPERELASTIC, YEOH", [v["c1"], v["c2"], v["c3"], d, 0.0, 0.0])


def _two_powers(v: Any, d: float) -> _Option:
    return _ogden([(v["mu"], v["alpha"]), (v["mu"], -v["alpha"])], d)


def _series(v: Any, d: float) -> _Option:
    """Return the option for Ogden's series: its ``μp/αp`` is ``2 μi/αi²`` in Abaqus."""
    return _ogden([(m * a / 2, a) for m, a in zip(v["mu"], v["alpha"], strict=True)], d)


def _holzapfel(v: Any, d: float) -> _Option:
    check_positive("k2", v["k2"], "Abaqus divides by it")
    check_range("Abaqus", "c", v["c"])
    check_range("Abaqus", "k1", v["k1"])
    kappa = v.get("kappa", 0.0)
    check_range("Abaqus", "kappa", kappa, 1 / 3)
    keyword = "*ANISOTROPIC HYPERELASTIC, HOLZAPFEL, LOCAL DIRECTIONS=2"
    return _Option(keyword, [v["c"] / 2, d, v["k1"], v["k2"], kappa], v["beta"])


_HGO = (
    "U = C10 (I1 - 3) + k1/(2 k2) sum over both families of {exp[k2 <E>^2] - 1}"
    + _VOLUME_LOG
    + ", E = kappa (I1 - 3) + (1 - 3 kappa)(I4 - 1), with the invariants of the isochoric"
    " deformation and C10 = c/2. A family bears no load where its E is negative. CalculiX does not"
    " have this law"
)
_OGDEN = (
    "U = sum of 2 mu_i/alpha_i^2 (l1^alpha_i + l2^alpha_i + l3^alpha_i - 3)" + _VOLUME + ", with "
)

_LAWS = {
    laws.NeoHookean: CodeLaw("U = C10 (I1 - 3)" + _VOLUME + ", with C10 = mu/2", _neo_hooke),
    laws.MooneyRivlin: CodeLaw(
        "U = C10 (I1 - 3) + C01 (I2 - 3)" + _VOLUME,
        lambda v, d: _Option("*HYPERELASTIC, MOONEY-RIVLIN", [v["c10"], v["c01"], d]),
    ),
    laws.Yeoh: CodeLaw("U = C10 (I1 - 3) + C20 (I1 - 3)^2 + C30 (I1 - 3)^3" + _VOLUME, _yeoh),
    laws.ArrudaBoyce: CodeLaw(
        "U = mu sum of C_i/lambda_m^(2i - 2) (I1^i - 3^i), i = 1 to 5" + _VOLUME_LOG,
        lambda v, d: _Option("*HYPERELASTIC, ARRUDA-BOYCE", [v["mu"], v["lock"], d]),
    ),
    laws.Ogden: CodeLaw(_OGDEN + "the two terms (mu, alpha) and (mu, -alpha)", _two_powers),
    laws.OgdenSeries: CodeLaw(
        _OGDEN + "mu_i = mu alpha/2 of each term, where the package has mu/alpha", _series
    ),
    laws.HolzapfelGasserOgden: CodeLaw(_HGO + ". Here kappa = 0", _holzapfel),
    laws.GasserOgdenHolzapfel: CodeLaw(_HGO, _holzapfel),
}

# Reason why a law has no keyword of Abaqus.
_BY_SUBROUTINE = "Abaqus has it through the user subroutine UHYPER only"
_REASONS: dict[type[laws.StrainEnergy], str] = {
    laws.PowerLawNeoHookean: _BY_SUBROUTINE,
    laws.Demiray: _BY_SUBROUTINE,
    laws.Gent: _BY_SUBROUTINE,
    laws.FourFiber: "its fibre families have different moduli, and those of Abaqus share one",
}


def _card(header: list[str], materials: list[Material]) -> str:
    """Return the text of the card, with the paragraphs of the header as comments."""
    lines = _comment(header)
    for material in materials:
        lines += [*_comment(material.notes), *_material(material)]
    return "\n".join(lines) + "\n"


def _material(material: Material) -> list[str]:
    option = _LAWS[type(material.energy)].write(material.values, 2 / material.bulk_modulus)
    lines = [f"*MATERIAL, NAME={material.name}", option.keyword, *_data(option.data)]
    if option.angle is None:
        return lines
    beta = radians(option.angle)
    directions = [(0.0, cos(beta), sin(beta)), (0.0, cos(beta), -sin(beta))]
    return [
        f"*ORIENTATION, NAME={material.name}_axes, SYSTEM=CYLINDRICAL, LOCAL DIRECTIONS=2",
        *_data([0.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
        "1, 0.0",
        *(line for direction in directions for line in _data(direction)),
        *lines,
    ]


def _data(numbers: Sequence[float]) -> list[str]:
    """Return data lines, in which Abaqus reads at most eight fields."""
    return [", ".join(fields) for fields in batched(map(number, numbers), 8)]


def _comment(paragraphs: list[str]) -> list[str]:
    return [f"** {line}" for line in lines_of(paragraphs)]


ABAQUS = Code("Abaqus", _LAWS, _REASONS | SILENT_LAWS, _card)
