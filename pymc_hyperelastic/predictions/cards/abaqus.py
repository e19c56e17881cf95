"""Write materials as keyword lines of Abaqus; CalculiX also reads those of isotropic laws.

Sources: for the strain energies, Abaqus Analysis User's Guide, "Hyperelastic behavior of rubberlike
materials" and "Anisotropic hyperelastic behavior"; for the keywords, Abaqus Keywords Guide,
``*HYPERELASTIC``, ``*ANISOTROPIC HYPERELASTIC`` and ``*ORIENTATION``; for the format of lines,
"Input syntax rules"; CalculiX CrunchiX User's Manual, ``*HYPERELASTIC``.
"""

from collections.abc import Sequence
from math import cos, radians, sin
from textwrap import wrap
from typing import Any, NamedTuple

from pymc_hyperelastic.mechanics import strain_energy as laws
from pymc_hyperelastic.predictions.cards.materials import (
    SILENT_LAWS,
    Code,
    CodeLaw,
    Material,
    check_positive,
)

# Characters in a field of a data line, at most: a rule of Abaqus.
_FIELD = 20
# Fields in a data line, at most: a rule of Abaqus.
_FIELDS = 8
# Characters in a line of a comment: chosen for reading.
_COLUMNS = 96
# Terms of Ogden's law, at most: a limit of Abaqus.
_TERMS = 6

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
    """Format a number in at most 20 characters, with as many digits as fit.

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
        if len(text) <= _FIELD:
            break
        mantissa, exponent = f"{x:.{digits}E}".split("E")
        text = f"{mantissa}E{int(exponent)}"
    return text


def _ogden(terms: Sequence[tuple[float, float]], d: float) -> _Option:
    """Return the option for ``Σ 2 μi/αi² (...)``, from pairs of modulus and exponent."""
    if len(terms) > _TERMS:
        raise ValueError(
            f"Abaqus has at most {_TERMS} terms of Ogden's law; the material has {len(terms)}"
        )
    if not all(alpha for _, alpha in terms):
        raise ValueError("an exponent of Ogden's law is 0, by which Abaqus divides")
    data = [x for term in terms for x in term] + [d] + [0.0] * (len(terms) - 1)
    return _Option(f"*HYPERELASTIC, OGDEN, N={len(terms)}", data)


def _two_powers(v: Any, d: float) -> _Option:
    return _ogden([(v["mu"], v["alpha"]), (v["mu"], -v["alpha"])], d)


def _series(v: Any, d: float) -> _Option:
    """Return the option for Ogden's series: its ``μp/αp`` is ``2 μi/αi²`` in Abaqus."""
    return _ogden([(m * a / 2, a) for m, a in zip(v["mu"], v["alpha"], strict=True)], d)


def _holzapfel(v: Any, d: float) -> _Option:
    check_positive("k2", [v["k2"]], "Abaqus divides by it")
    _check_range("c", v["c"], 0.0)
    _check_range("k1", v["k1"], 0.0)
    kappa = v.get("kappa", 0.0)
    _check_range("kappa", kappa, 0.0, 1 / 3)
    keyword = "*ANISOTROPIC HYPERELASTIC, HOLZAPFEL, LOCAL DIRECTIONS=2"
    return _Option(keyword, [v["c"] / 2, d, v["k1"], v["k2"], kappa], v["beta"])


def _check_range(name: str, value: float, low: float, high: float = float("inf")) -> None:
    if not low <= value <= high:
        raise ValueError(f"{name} is {value:.6g}; Abaqus takes values from {low:g} to {high:.6g}")


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
    laws.NeoHookean: CodeLaw(
        "U = C10 (I1 - 3)" + _VOLUME + ", with C10 = mu/2",
        lambda v, d: _Option("*HYPERELASTIC, NEO HOOKE", [v["mu"] / 2, d]),
    ),
    laws.MooneyRivlin: CodeLaw(
        "U = C10 (I1 - 3) + C01 (I2 - 3)" + _VOLUME,
        lambda v, d: _Option("*HYPERELASTIC, MOONEY-RIVLIN", [v["c10"], v["c01"], d]),
    ),
    laws.Yeoh: CodeLaw(
        "U = C10 (I1 - 3) + C20 (I1 - 3)^2 + C30 (I1 - 3)^3" + _VOLUME,
        lambda v, d: _Option("*HYPERELASTIC, YEOH", [v["c1"], v["c2"], v["c3"], d, 0.0, 0.0]),
    ),
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
    texts = [number(x) for x in numbers]
    return [", ".join(texts[i : i + _FIELDS]) for i in range(0, len(texts), _FIELDS)]


def _comment(paragraphs: list[str]) -> list[str]:
    return [f"** {line}" for text in paragraphs for line in wrap(text, _COLUMNS)]


ABAQUS = Code("Abaqus", _LAWS, _REASONS | SILENT_LAWS, _card)
