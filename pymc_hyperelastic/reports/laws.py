"""Strain energies and distributions in words."""

import re
from collections.abc import Mapping
from inspect import getdoc
from typing import Any

import xarray as xr

from pymc_hyperelastic.evidence.stored import damaged, read_json
from pymc_hyperelastic.mechanics.strain_energy import StrainEnergy
from pymc_hyperelastic.messages import shown
from pymc_hyperelastic.models.likelihoods.errors import SIZES
from pymc_hyperelastic.models.priors import prior_from_record
from pymc_hyperelastic.models.settings import NamedLayer, wall_of
from pymc_hyperelastic.reports.blocks import short

_RAISED = str.maketrans("0123456789+-i", "⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻ⁱ")
_LOWERED = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
_SIGNS = {
    r"\sum": "Σ",
    r"\qquad": " ",
    r"\left": "",
    r"\right": "",
    r"\{": "⟨",
    r"\}": "⟩",
    r"\,": " ",
}


def wall_in_words(tree: xr.DataTree) -> list[NamedLayer]:
    """Layers of the wall of a result, from the inside out; none if it does not name its law."""
    try:
        return wall_of(tree)
    except ValueError:
        return []


def equation_of(energy: StrainEnergy) -> str:
    """The equation in the documentation of a law, as text; without one, what that begins with.

    >>> import pymc_hyperelastic as ph
    >>> equation_of(ph.Demiray())
    'W = (μ/(2 b)) (e^(b (I₁ − 3)) − 1)'
    """
    documented = getdoc(type(energy)) or ""
    found = re.search(r"\.\. math::((?:.+\n?)+)", documented)
    return in_text(found[1]) if found else documented.strip().split("\n")[0]


def in_text(formula: str) -> str:
    r"""A formula of LaTeX as text.

    >>> in_text(r"\frac{c}{2} (I_1 - 3)^2 + \tfrac12 \ln λ_θ")
    '(c/2) (I₁ − 3)² + ½ ln λ_θ'
    """
    text = " ".join(formula.replace(r"\tfrac12", "½").split())
    for sign, plain in _SIGNS.items():
        text = text.replace(sign, plain)
    braces = r"\{((?:[^{}])*)\}"
    for _ in range(text.count("{") + 1):  # from the inside out
        text = re.sub(rf"\\t?frac\s*{braces}\s*{braces}", _fraction, text)
        text = re.sub(rf"\\text\s*{braces}", r"\1", text)
        text = re.sub(rf"\^{braces}", lambda m: _raised(m[1]), text)
        text = re.sub(rf"_{braces}", lambda m: _lowered(m[1]), text)
    text = re.sub(r"\^(\w)", lambda m: _raised(m[1]), text)
    text = re.sub(r"_(\d)", lambda m: _lowered(m[1]), text)
    text = re.sub(r"\\(\w+)", r"\1", text).translate(str.maketrans("-⟨⟩", "−{}"))
    return re.sub(r" +", " ", text).replace(" ,", ",").strip()


def _fraction(match: re.Match[str]) -> str:
    over, under = match[1].strip(), match[2].strip()
    if re.search(r"[+ −-]", over):
        over = f"({over})"
    if re.search(r"[+ −-]", under):
        under = f"({under})"
    return f"({over}/{under})"


def _raised(text: str) -> str:
    plain = re.fullmatch(r"[+-]?\d+|i", text)
    return text.translate(_RAISED) if plain else f"^({text})" if text[1:] else f"^{text}"


def _lowered(text: str) -> str:
    if text.isdigit():
        return text.translate(_LOWERED)
    return f"_{text}" if text.isalpha() else f"_({text})"


def distribution_in_words(record: list[Any], unit: str = "") -> str:
    """A distribution as results store it: its name in PyMC, parameters and perhaps its size.

    >>> distribution_in_words(["Uniform", [0.0, 100.0]], "kPa")
    'Uniform(0, 100) kPa'
    """
    prior_from_record(record)  # a record from a file is checked
    name, parameters, *size = record
    told = ", ".join(_value(p) for p in parameters)
    times = f", {size[0]} of them" if size else ""
    return f"{name}({told}){' ' + unit if unit else ''}{times}"


def _value(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    return short(float(value))


def units_of(tree: xr.DataTree) -> dict[str, str]:
    """Units of the variables of a result, as far as it says."""
    told: Mapping[str, str] = read_json(tree, "units", {})
    if not all(isinstance(unit, str) for unit in told.values()):
        raise damaged(tree, f"its attribute 'units' is {shown(told)}; expected the unit of each")
    layers = wall_in_words(tree)
    of_law = {p.name: p.unit for layer in layers for p in layer.energy.parameters}
    units = of_law | {name: size.unit for name, size in SIZES.items()} | dict(told)
    return {name: unit.replace("mm2", "mm²") for name, unit in units.items()}
