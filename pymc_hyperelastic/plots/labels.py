"""Words, symbols and units of quantities in figures."""

import re
from collections.abc import Mapping
from contextlib import suppress
from textwrap import fill

from pymc_hyperelastic.mechanics.strain_energy import Parameter, StrainEnergy
from pymc_hyperelastic.quantities import IN_RESULTS, unit_text

# Letters of a line of a label beside a panel: 20 fit the height of a panel.
_WIDTH = 20
# Name of a quantity: words of its axis, and the unit of its numbers; None if it has none.
LABELS: dict[str, tuple[str, str | None]] = {
    name: (
        fill(spec.long_name, _WIDTH) + (f" ${spec.symbol}$" if spec.symbol else ""),
        None if spec.unit == "1" else unit_text(spec.unit),
    )
    for name, spec in IN_RESULTS.items()
}
LABELS |= {
    "position": ("place in the wall $(R-A)/(B-A)$", None),
    "inner_radius": ("unloaded internal radius $A$", "mm"),
    "outer_radius": ("unloaded outer radius $B$", "mm"),
    "thickness": ("unloaded thickness $B-A$", "mm"),
    "pressure": ("pressure", "kPa"),
    "axial_force": ("reduced axial force", "mN"),
    "stress": ("Cauchy stress", "kPa"),
    "cauchy_stress": ("Cauchy stress", "kPa"),
    "nominal_stress": ("nominal stress", "kPa"),
    "stress_of_sheets": ("nominal or Cauchy stress", "kPa"),
    "stretch": ("stretch", None),
    "sigma_rr": ("radial stress", "kPa"),
    "sigma_tt": ("hoop stress", "kPa"),
    "sigma_zz": ("axial stress", "kPa"),
    # Parameters whose symbols no strain energy states.
    "sigma": (r"$\sigma$", None),
    "slope_weight": (r"$\beta$", None),
    # Measures by which laws, groups and planned tests are compared.
    "probability": ("probability", None),
    "log_evidence": ("log evidence less the largest", "nats"),
    "p_value": ("p-value", None),
    "information": ("expected information", "nats"),
    "difference": ("difference from the first", "nats"),
    # Labels by which curves differ.
    "group": ("group", None),
    "class_label": ("class", None),
    "specimen": ("specimen", None),
    "experiment": ("experiment", None),
    "axis": ("stress along", None),
}


def axis_label(name: str, pressure_unit: str = "kPa") -> str:
    r"""Label of an axis: a quantity and its unit, in which this unit of pressure replaces kPa.

    Examples
    --------
    >>> axis_label("stiffness", "mmHg")
    'stiffness $\\mathrm{d}p/\\mathrm{d}a$ (mmHg/mm)'
    """
    words, unit = LABELS.get(name, (name, None))
    return f"{words} ({unit.replace('kPa', pressure_unit)})" if unit else words


def beside_panel(label: str) -> str:
    r"""Label of a vertical axis; the unit of a long label has a line of its own.

    Examples
    --------
    >>> beside_panel("pressure (kPa)"), beside_panel("reduced axial force (mN)")
    ('pressure (kPa)', 'reduced axial force\n(mN)')
    """
    long = max(map(len, label.splitlines())) > _WIDTH
    return "\n(".join(label.rsplit(" (", 1)) if long else label


def words(name: str) -> str:
    """Words of a quantity or a label, without symbol and unit.

    Examples
    --------
    >>> words("axial_stretch"), words("specimen")
    ('axial stretch', 'specimen')
    """
    return LABELS[name][0].split(" $")[0]


def quantity_label(name: str, law: str | None, units: Mapping[str, str] | None = None) -> str:
    r"""Label of an axis: a property, a parameter of the law, a coordinate, or a logarithm.

    Units that are given replace the known ones.

    Examples
    --------
    >>> quantity_label("mu", "Ogden"), quantity_label("log_reference_strain", "Ogden")
    ('$\\mu$ (kPa)', 'log reference strain')
    >>> quantity_label("log stiffness", "Ogden")
    'log of stiffness $\\mathrm{d}p/\\mathrm{d}a$ (kPa/mm)'
    """
    if name.startswith("log "):
        return f"log of {quantity_label(name.removeprefix('log '), law)}"
    parameter = parameter_of(law, name.partition("[")[0])
    if parameter is None:
        label, unit = LABELS.get(name, (name.replace("_", " "), None))
    else:
        label = f"${parameter.symbol}${name.removeprefix(parameter.name)}"
        unit = parameter.unit
    unit = unit_text((units or {}).get(name, unit or ""))
    return f"{label} ({unit})" if unit else label


def parameter_of(law: str | None, name: str) -> Parameter | None:
    """The parameter of a law by its name; None if the law, such as a user's own, is not defined.

    If the text names several laws, the first one counts.
    """
    first = re.match(r"\w*", law or "")
    with suppress(ValueError):
        energy = StrainEnergy.from_name(first.group() if first else "")
        return next((p for p in energy.parameters if p.name == name), None)
    return None
