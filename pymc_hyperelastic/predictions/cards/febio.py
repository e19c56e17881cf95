"""Write materials as the material section of a FEBio file, format 4.0.

Sources: for the strain energies, FEBio User's Manual 4, chapter Materials, "Uncoupled materials",
sections "Mooney-Rivlin", "Ogden", "Yeoh", "Holzapfel-Gasser-Ogden", "Fiber with exponential-power
law, uncoupled formulation" and "Uncoupled solid mixture"; for the axes, "mat_axis", "cylindrical".
FEBio's "uncoupled hyperelastic" material takes an energy as an expression, and differentiates it.
Its source code, FEBioMech/FEGenericHyperelasticUC.cpp, and the manual's appendix "Math expressions"
describe it.
"""

from collections.abc import Sequence
from math import cos, radians, sin
from typing import Any
from xml.etree import ElementTree

import numpy as np

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

Body = tuple[str, list[ElementTree.Element]]
"""Type of a material, and its parameters."""

# Declaration in the first line of a file.
_HEAD = '<?xml version="1.0" encoding="ISO-8859-1"?>\n'


def _parameters(**values: float) -> list[ElementTree.Element]:
    return [_element(name, repr(float(value))) for name, value in values.items()]


def _element(
    tag: str, content: str | Sequence[ElementTree.Element] = (), **attributes: str
) -> ElementTree.Element:
    """Return an element with a text or with other elements."""
    element = ElementTree.Element(tag, attributes)
    if isinstance(content, str):
        element.text = content
    else:
        element.extend(content)
    return element


def _neo_hookean(v: Any, k: float) -> Body:
    return "Mooney-Rivlin", _parameters(c1=v["mu"] / 2, c2=0.0, k=k)


def _mooney_rivlin(v: Any, k: float) -> Body:
    return "Mooney-Rivlin", _parameters(c1=v["c10"], c2=v["c01"], k=k)


def _ogden(terms: Sequence[tuple[float, float]], k: float) -> Body:
    """Return the material ``Σ ci/mi² (...)``, from pairs of modulus and exponent."""
    check_ogden("FEBio", terms)
    numbers: dict[str, float] = {}
    for i, (c, m) in enumerate(terms, start=1):
        numbers |= {f"c{i}": c, f"m{i}": m}
    return "Ogden", _parameters(**numbers, k=k)


def _two_powers(v: Any, k: float) -> Body:
    return _ogden([(2 * v["mu"], v["alpha"]), (2 * v["mu"], -v["alpha"])], k)


def _series(v: Any, k: float) -> Body:
    """Return the material of Ogden's series: its ``μp/αp`` is ``ci/mi²`` in FEBio."""
    return _ogden([(m * a, a) for m, a in zip(v["mu"], v["alpha"], strict=True)], k)


def _expression(k: float, text: str, **numbers: float) -> Body:
    """Return a material whose energy is an expression in ``I1``, with the numbers inserted."""
    # Some versions of FEBio cannot read powers of ten, such as 1e-5, in an expression.
    digits = {name: np.format_float_positional(x, trim="0") for name, x in numbers.items()}
    written = text.format(**digits)
    # FEBio reads an expression into a buffer of 512 characters.
    if len(written) > 500:
        raise ValueError(
            f"the energy has {len(written)} characters, and FEBio reads at most 500: {written}"
        )
    return "uncoupled hyperelastic", [_element("W", written), *_parameters(k=k)]


def _power_law(v: Any, k: float) -> Body:
    check_positive("n", v["n"], "FEBio's card divides by it")
    numbers = {"a": v["mu"] / 2, "b": 1 / v["n"], "n": v["n"]}
    return _expression(k, "{a}*((1+{b}*(I1-3))^{n}-1)", **numbers)


def _demiray(v: Any, k: float) -> Body:
    check_positive("b", v["b"], "FEBio's card divides by it")
    return _expression(k, "{a}*(exp({b}*(I1-3))-1)", a=v["mu"] / (2 * v["b"]), b=v["b"])


def _gent(v: Any, k: float) -> Body:
    check_positive("limit", v["limit"], "FEBio's card divides by it")
    numbers = {"a": v["mu"] * v["limit"] / 2, "b": 1 / v["limit"]}
    return _expression(k, "-{a}*ln(1-{b}*(I1-3))", **numbers)


def _arruda_boyce(v: Any, k: float) -> Body:
    coefficients = enumerate(laws.ArrudaBoyce.coefficients)
    terms = {f"a{i}": v["mu"] * c / v["lock"] ** (2 * i) for i, c in coefficients}
    powers = "+".join(f"{{a{i}}}*(I1^{i + 1}-{3 ** (i + 1)})" for i in range(1, 5))
    return _expression(k, "{a0}*(I1-3)+" + powers, **terms)


def _holzapfel(v: Any, k: float) -> Body:
    check_positive("k2", v["k2"], "FEBio divides by it")
    numbers = {"c": v["c"], "k1": v["k1"], "k2": v["k2"]}
    numbers |= {"gamma": v["beta"], "kappa": v.get("kappa", 0.0)}
    for name, high in {"c": np.inf, "k1": np.inf, "kappa": 1 / 3}.items():
        check_range("FEBio", name, numbers[name], high)
    return "Holzapfel-Gasser-Ogden", [*_parameters(**numbers, k=k), _axes()]


def _four_fiber(v: Any, k: float) -> Body:
    matrix = _element("solid", _parameters(c1=v["c"] / 2, c2=0.0), type="Mooney-Rivlin")
    beta = v["beta"]
    angles = {"axial": [90.0], "hoop": [0.0], "diagonal": [beta, -beta]}
    fibres = [
        _fibres(v[f"k1_{name}"], v[f"k2_{name}"], angle)
        for name, families in angles.items()
        if f"k1_{name}" in v  # a wall may have no hoop fibres
        for angle in families
    ]
    return "uncoupled solid mixture", [*_parameters(k=k), _axes(), matrix, *fibres]


def _fibres(k1: float, k2: float, angle: float) -> ElementTree.Element:
    """Return a fibre family, ``ksi/(alpha beta) (exp[alpha (I4 - 1)^beta] - 1)``, ``beta = 2``."""
    check_range("FEBio", "k1", k1)
    check_range("FEBio", "k2", k2)
    direction = ",".join(repr(x) for x in (cos(radians(angle)), sin(radians(angle)), 0.0))
    parameters = _parameters(ksi=k1, alpha=k2, beta=2.0)
    fibre = _element("fiber", direction, type="vector")
    return _element("solid", [*parameters, fibre], type="fiber-exp-pow-uncoupled")


def _axes() -> ElementTree.Element:
    """Return the local axes: 1 around the tube, 2 along it, 3 through its wall."""
    vectors = {"center": "0,0,0", "axis": "0,0,1", "vector": "0,1,0"}
    children = [_element(name, vector) for name, vector in vectors.items()]
    return _element("mat_axis", children, type="cylindrical")


_WITHOUT_VOLUME = ", of the isochoric deformation"
_TENSION = ". A family bears no load where its E is negative"
_HGO = (
    "W = c/2 (I1 - 3) + k1/(2 k2) sum over both families of {exp[k2 <E>^2] - 1}, "
    "E = kappa (I1 - 3) + (1 - 3 kappa)(I4 - 1)" + _WITHOUT_VOLUME + _TENSION
)
_OGDEN = "W = sum of c_i/m_i^2 (l1^m_i + l2^m_i + l3^m_i - 3)" + _WITHOUT_VOLUME + ", with "
_AS_EXPRESSION = (
    "W is an expression in I1" + _WITHOUT_VOLUME + ", which FEBio differentiates. It stands for "
)

_LAWS = {
    laws.NeoHookean: CodeLaw(
        "W = c1 (I1 - 3) + c2 (I2 - 3)" + _WITHOUT_VOLUME + ", with c1 = mu/2 and c2 = 0",
        _neo_hookean,
    ),
    laws.MooneyRivlin: CodeLaw(
        "W = c1 (I1 - 3) + c2 (I2 - 3)" + _WITHOUT_VOLUME + ", with c1 = c10 and c2 = c01",
        _mooney_rivlin,
    ),
    laws.Yeoh: CodeLaw(
        "W = c1 (I1 - 3) + c2 (I1 - 3)^2 + c3 (I1 - 3)^3" + _WITHOUT_VOLUME,
        lambda v, k: ("Yeoh", _parameters(c1=v["c1"], c2=v["c2"], c3=v["c3"], k=k)),
    ),
    # FEBio's own Gent solid has the same stress, but no derivative of dW/dI1 in its stiffness, and
    # its Arruda-Boyce solid multiplies the terms of the series by their order.
    laws.Gent: CodeLaw(_AS_EXPRESSION + "-mu Jm/2 ln[1 - (I1 - 3)/Jm]", _gent),
    laws.ArrudaBoyce: CodeLaw(
        _AS_EXPRESSION + "mu sum of C_i/lambda_m^(2i - 2) (I1^i - 3^i), i = 1 to 5", _arruda_boyce
    ),
    laws.Demiray: CodeLaw(_AS_EXPRESSION + "mu/(2 b) {exp[b (I1 - 3)] - 1}", _demiray),
    laws.PowerLawNeoHookean: CodeLaw(_AS_EXPRESSION + "mu/2 {[1 + (I1 - 3)/n]^n - 1}", _power_law),
    laws.Ogden: CodeLaw(_OGDEN + "the two terms (2 mu, alpha) and (2 mu, -alpha)", _two_powers),
    laws.OgdenSeries: CodeLaw(
        _OGDEN + "c_i = mu alpha of each term, where the package has mu/alpha", _series
    ),
    laws.HolzapfelGasserOgden: CodeLaw(_HGO + ". Here kappa = 0", _holzapfel),
    laws.GasserOgdenHolzapfel: CodeLaw(_HGO, _holzapfel),
    laws.FourFiber: CodeLaw(
        "W = c1 (I1 - 3) with c1 = c/2, and of each family ksi/(alpha beta) {exp[alpha E^beta] - 1}"
        ", E = I4 - 1" + _WITHOUT_VOLUME + ", with ksi = k1, alpha = k2 and beta = 2" + _TENSION,
        _four_fiber,
    ),
}


def _card(header: list[str], materials: list[Material]) -> str:
    """Return the text of a file with the materials, and the paragraphs as comments."""
    section = _element("Material")
    section.append(_comment(header))
    for i, material in enumerate(materials, start=1):
        kind, body = _LAWS[type(material.energy)].write(material.values, material.bulk_modulus)
        section.append(_comment(material.notes))
        section.append(_element("material", body, id=str(i), name=material.name, type=kind))
    root = _element("febio_spec", [section], version="4.0")
    ElementTree.indent(root)
    return _HEAD + ElementTree.tostring(root, encoding="unicode") + "\n"


def _comment(paragraphs: list[str]) -> Any:
    # XML does not allow two hyphens in a comment.
    text = "\n".join(["", *lines_of(paragraphs), ""]).replace("--", "- -").replace("--", "- -")
    return ElementTree.Comment(text)


FEBIO = Code("FEBio", _LAWS, SILENT_LAWS, _card)
